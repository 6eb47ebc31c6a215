//! Estimated time of a sweep: the share of each piece of work, corrected by what the finished ones took.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pe_hls::mapping::MapOptions;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_sim::double::DoubleRun;

use super::axes::once;
use super::family::{Family, Job};
use crate::settings::MappingOptions;
use pe_judge::DesignPoint;

/// Seconds that work takes on the machine on which this was measured, in release mode: a product in double precision,
/// with coefficients rounded in two ways, and in fixed point, a try of the annealer, and scheduling, assembling and checking
/// a product.
const DOUBLE: f64 = 3.3e-9;
const ROUNDED: f64 = 5e-9;
const FIXED: f64 = 9e-9;
const TRY: f64 = 0.5e-6;
const PRODUCT: f64 = 25e-6;

/// Seconds of the reference solution per product and step of the model.
const REFERENCE: f64 = 40e-9;

/// Time to find out how fast this machine is.
const CALIBRATION: Duration = Duration::from_millis(20);
const TRIALS: u32 = 10;

/// Seconds of each piece of work.
#[derive(Clone, Debug)]
pub struct Estimate {
    span: f64,
    macs: Vec<(Solver, f64)>,
    /// Runs in double precision of a family, in full steps.
    runs: f64,
    tries: f64,
    /// Points that have a mapping in common, on average.
    alike: f64,
    /// How much slower this machine is.
    slowness: f64,
}

impl Estimate {
    /// For the points of a model whose step graphs are known.
    pub fn of(model: &Model, graphs: &[(Solver, StepGraph)], mapping: &MappingOptions) -> Estimate {
        let equations = graphs.iter().map(|(_, graph)| graph.equations.len()).max().unwrap_or(0);
        let tries = mapping.tries.unwrap_or_else(|| MapOptions::default_tries(equations as u32));
        let varying = pe_judge::runs::varying_inputs(model);
        Estimate {
            span: model.span,
            macs: graphs.iter().map(|(solver, graph)| (*solver, graph.macs() as f64)).collect(),
            // Without inputs the run itself serves for comparisons.
            runs: if varying { 4.0 } else { 2.0 + f64::from(u8::from(!model.inputs.is_empty())) },
            tries: tries as f64,
            alike: 1.0,
            slowness: graphs.first().map_or(1.0, |(_, graph)| slowness(graph)),
        }
    }

    /// Where these are the points: those with the same solver on as many PEs mostly share a mapping.
    #[must_use]
    pub fn among<'p>(self, points: impl Iterator<Item = &'p DesignPoint>) -> Estimate {
        let mut kinds: Vec<(Option<Solver>, Option<u32>)> = points.map(|point| (point.solver, point.pes)).collect();
        let count = kinds.len();
        once(&mut kinds);
        Estimate { alike: count.max(1) as f64 / kinds.len().max(1) as f64, ..self }
    }

    /// Products of a point's runs over the span, and of its step.
    fn products(&self, point: &DesignPoint) -> (f64, f64) {
        let of = |(solver, _): &&(Solver, f64)| Some(*solver) == point.solver;
        // A step graph that is refused costs nothing.
        let macs = self.macs.iter().find(of).map_or(0.0, |(_, macs)| *macs);
        (macs * self.span / point.step.unwrap_or(self.span), macs)
    }

    /// The run in double precision of points with the same step graph.
    pub fn run(&self, point: &DesignPoint) -> f64 {
        self.products(point).0 * DOUBLE * self.slowness
    }

    /// The other runs that they share.
    pub fn comparison(&self, point: &DesignPoint) -> f64 {
        self.run(point) * self.runs
    }

    /// The reference solution of points with the same step.
    pub fn reference(&self, point: &DesignPoint) -> f64 {
        self.products(point).0 * REFERENCE * self.slowness
    }

    /// The runs that points with the same formats share.
    pub fn format(&self, point: &DesignPoint) -> f64 {
        self.products(point).0 * (FIXED + ROUNDED) * self.slowness
    }

    /// The network of a point.
    pub fn network(&self, point: &DesignPoint) -> f64 {
        let tries = if point.pes == Some(1) { 0.0 } else { self.tries / self.alike };
        (tries * TRY + self.products(point).1 * PRODUCT) * self.slowness
    }

    /// The networks of points with the same formats.
    pub fn networks(&self, jobs: &[Job]) -> f64 {
        jobs.iter().map(|job| self.network(&job.point)).sum()
    }

    /// All work of a family but the reference.
    pub fn whole(&self, family: &Family) -> f64 {
        let any = &family.formats[0][0].point;
        let of_format = |jobs: &Vec<Job>| self.format(&jobs[0].point) + self.networks(jobs);
        self.run(any) + self.comparison(any) + family.formats.iter().map(of_format).sum::<f64>()
    }

    /// All jobs, one after another, by the kind of work.
    pub fn planned(&self, families: &[Family]) -> [f64; KINDS] {
        let mut planned = [0.0; KINDS];
        let mut add = |kind: Kind, seconds: f64| planned[kind as usize] += seconds;
        for (index, family) in families.iter().enumerate() {
            let any = &family.formats[0][0].point;
            let shared = |other: &Family| Arc::ptr_eq(&other.reference, &family.reference);
            if !families[..index].iter().any(shared) {
                add(Kind::Reference, self.reference(any));
            }
            add(Kind::Run, self.run(any));
            add(Kind::Comparison, self.comparison(any));
            for jobs in &family.formats {
                add(Kind::Format, self.format(&jobs[0].point));
                add(Kind::Network, self.networks(jobs));
            }
        }
        planned
    }
}

/// Kinds of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The solution that runs are compared with.
    Reference,
    /// A run in double precision.
    Run,
    /// What smaller steps say about it.
    Comparison,
    /// Runs in fixed point.
    Format,
    /// A network.
    Network,
}

/// Number of kinds.
pub const KINDS: usize = 5;

/// Work that is no longer to be done: that which ended early says nothing about the rest.
#[derive(Clone, Copy, Debug)]
pub struct Work {
    /// Its kind.
    pub kind: Kind,
    /// Seconds that it was estimated to take.
    pub estimated: f64,
    /// Seconds of its thread that it took; none if it was not done to the end.
    pub took: Option<f64>,
}

/// Part of all work of a kind, or of all kinds, that the estimate made beforehand counts for beside what was measured.
const PRIOR: f64 = 0.02;

/// The time that is left of a sweep.
#[derive(Clone, Debug)]
pub struct Forecast {
    /// Estimated beforehand.
    planned: [f64; KINDS],
    /// That part of it that is not to be done any more.
    over: [f64; KINDS],
    /// That part of it that was done, and what it took.
    done: [(f64, f64); KINDS],
    threads: f64,
}

impl Forecast {
    /// Before any work is done, in so many threads.
    pub fn new(planned: [f64; KINDS], threads: usize) -> Forecast {
        Forecast { planned, over: [0.0; KINDS], done: [(0.0, 0.0); KINDS], threads: threads.max(1) as f64 }
    }

    /// Takes in what happened to a piece of work.
    pub fn include(&mut self, work: &Work) {
        let kind = work.kind as usize;
        self.over[kind] += work.estimated;
        if let Some(took) = work.took {
            self.done[kind].0 += work.estimated;
            self.done[kind].1 += took;
        }
    }

    /// Seconds until the end if nobody else uses the machine: what is left of each kind takes as much longer than estimated as what was done of it, or
    /// as all runs and networks that were done where none was: how long a library takes for a solution says nothing of
    /// these.
    pub fn remaining(&self) -> f64 {
        let own = &self.done[Kind::Run as usize..];
        let sum = |of: fn(&(f64, f64)) -> f64| own.iter().map(of).sum::<f64>();
        let prior = PRIOR * self.planned.iter().sum::<f64>();
        let factor = |(estimated, took): (f64, f64), prior: f64, known: f64| {
            if estimated + prior > 0.0 { (took + prior * known) / (estimated + prior) } else { known }
        };
        let all = factor((sum(|done| done.0), sum(|done| done.1)), prior, 1.0);
        let kinds = self.planned.iter().zip(&self.over).zip(&self.done);
        let left = kinds.map(|((planned, over), done)| (planned - over).max(0.0) * factor(*done, PRIOR * planned, all));
        left.sum::<f64>() / self.threads
    }
}

/// Time of a product here against [`DOUBLE`]; the best of several trials, for other programs only make it longer.
fn slowness(graph: &StepGraph) -> f64 {
    let mut run = DoubleRun::new(graph);
    let inputs = vec![0.0; graph.inputs.len()];
    let mut trial = || {
        let clock = Instant::now();
        let mut steps = 0.0;
        while clock.elapsed() < CALIBRATION / TRIALS {
            // A run that leaves the finite numbers starts again: only its time counts.
            if run.step(&inputs).is_err() {
                run = DoubleRun::new(graph);
            }
            steps += 1.0;
        }
        clock.elapsed().as_secs_f64() / (steps * graph.macs().max(1) as f64 * DOUBLE)
    };
    (0..TRIALS).map(|_| trial()).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_finished_work_took_corrects_the_rest_of_its_kind() {
        let mut forecast = Forecast::new([0.0, 10.0, 0.0, 100.0, 10.0], 2);
        assert!((forecast.remaining() - 60.0).abs() < 1e-9);
        // Runs in fixed point take three times as long as estimated; networks that are not needed take none.
        forecast.include(&Work { kind: Kind::Format, estimated: 50.0, took: Some(150.0) });
        forecast.include(&Work { kind: Kind::Network, estimated: 10.0, took: None });
        forecast.include(&Work { kind: Kind::Run, estimated: 10.0, took: Some(10.0) });
        assert!((forecast.remaining() / 75.0 - 1.0).abs() < 0.05, "{}", forecast.remaining());
    }
}
