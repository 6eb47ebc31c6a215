//! Estimated time of a sweep, and the share of each piece of work.

use std::time::{Duration, Instant};

use pe_hls::mapping::MapOptions;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_sim::double::DoubleRun;

use super::family::{Family, Job};
use crate::settings::MappingOptions;
use pe_judge::DesignPoint;

/// Seconds that work takes on the machine on which this was measured, in release mode: a product in double precision
/// and in fixed point, a try of the annealer, and scheduling, assembling and checking a product.
const DOUBLE: f64 = 3.3e-9;
const FIXED: f64 = 12e-9;
const TRY: f64 = 0.5e-6;
const PRODUCT: f64 = 20e-6;

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
            runs: if varying { 5.0 } else { 3.0 },
            tries: tries as f64,
            slowness: graphs.first().map_or(1.0, |(_, graph)| slowness(graph)),
        }
    }

    /// Products of a point's runs over the span, and of its step.
    fn products(&self, point: &DesignPoint) -> (f64, f64) {
        let of = |(solver, _): &&(Solver, f64)| Some(*solver) == point.solver;
        // A step graph that is refused costs nothing.
        let macs = self.macs.iter().find(of).map_or(0.0, |(_, macs)| *macs);
        (macs * self.span / point.step.unwrap_or(self.span), macs)
    }

    /// The runs in double precision that points with the same step graph share.
    pub fn family(&self, point: &DesignPoint) -> f64 {
        self.products(point).0 * DOUBLE * self.runs * self.slowness
    }

    /// The reference solution of points with the same step.
    pub fn reference(&self, point: &DesignPoint) -> f64 {
        self.products(point).0 * REFERENCE * self.slowness
    }

    /// The runs that points with the same formats share.
    pub fn format(&self, point: &DesignPoint) -> f64 {
        self.products(point).0 * (FIXED + DOUBLE) * self.slowness
    }

    /// The network of a point.
    pub fn network(&self, point: &DesignPoint) -> f64 {
        (self.tries * TRY + self.products(point).1 * PRODUCT) * self.slowness
    }

    /// All jobs, one after another.
    pub fn total(&self, families: &[Family]) -> f64 {
        let of_format = |jobs: &Vec<Job>| {
            self.format(&jobs[0].point) + jobs.iter().map(|job| self.network(&job.point)).sum::<f64>()
        };
        let of_family = |family: &Family| {
            self.family(&family.formats[0][0].point) + family.formats.iter().map(of_format).sum::<f64>()
        };
        families.iter().map(of_family).sum()
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
