//! The axes of a sweep, and the points they span.

use clap::Args;
use pe_hls::schedule::Bound;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_ir::word::{Latency, Pipeline};

use super::steps::suitable;
use crate::check::stiffness;
use crate::options::{
    Coefficients, DesignPoint, FormChoice, default_ports, duration, multiplier, pipeline, solver, storage,
};
use crate::pipeline::MappingOptions;

/// Multipliers of a sweep unless told otherwise, beside that of the other commands: one block each way round.
const SINGLE_BLOCK: [(u32, u32); 2] = [(25, 18), (18, 25)];

/// Options of the axes: lists in place of the single values that the other commands take.
#[derive(Args, Clone, Debug)]
pub struct Axes {
    /// Numbers of processing elements [default: powers of two, for as long as more of them can be faster]
    #[arg(long, value_name = "N,...", value_delimiter = ',', help_heading = "Sweep")]
    pub pes: Vec<u32>,
    /// Numerical methods [default: euler,heun,heun3,rk4; of stiff models all that apply]
    #[arg(long, value_name = "SOLVER,...", value_delimiter = ',', value_parser = solver(), help_heading = "Sweep")]
    pub solver: Vec<Solver>,
    /// Steps [default: the spec's, its half and its double]
    #[arg(long, value_name = "T,...", value_delimiter = ',', value_parser = duration, help_heading = "Sweep")]
    pub step: Vec<f64>,
    /// Longest time between two outputs: steps are whole parts of it
    #[arg(long, value_name = "T", value_parser = duration, help_heading = "Sweep")]
    pub sample: Option<f64>,
    /// Registers that an operation passes
    #[arg(long, default_value = "short", value_parser = pipeline(), help_heading = "Sweep")]
    pub pipeline: Pipeline,
    /// Form of the step of a model that is affine in its states
    #[arg(long, value_enum, default_value_t, help_heading = "Sweep")]
    pub form: FormChoice,
    /// Multipliers [default: 25x18,18x25,32x32]
    #[arg(long, value_name = "AxB,...", value_delimiter = ',', value_parser = multiplier, help_heading = "Sweep")]
    pub multiplier: Vec<(u32, u32)>,
    /// Bits of a stored word, without its guard bits
    #[arg(long, value_name = "BITS,...", value_delimiter = ',', default_value = "32", value_parser = storage(), help_heading = "Sweep")]
    pub storage: Vec<u32>,
}

/// Axes without a list that is empty.
pub struct Completed {
    /// The axes.
    pub axes: Axes,
    /// The step graph of each solver at the spec's step, if it has one.
    pub graphs: Vec<(Solver, StepGraph)>,
    /// How many times the stable step of RK4 accuracy would allow, if the solvers were chosen for that.
    pub stiffness: Option<f64>,
}

impl Axes {
    /// Puts the defaults of a model in the place of lists that were not given, and takes every value once.
    pub fn complete(&self, model: &Model) -> Completed {
        let mut axes = self.clone();
        let build = |solver: &Solver| pe_hls::step::build(&Model { solver: *solver, ..model.clone() }).ok();
        let mut stiffness = None;
        if axes.solver.is_empty() {
            stiffness = stiffness::explicit(model).filter(|ratio| *ratio > stiffness::STIFF);
            axes.solver = match stiffness {
                Some(_) => Solver::ALL.into_iter().filter(|solver| build(solver).is_some()).collect(),
                None => Solver::RUNGE_KUTTA.to_vec(),
            };
        }
        if axes.step.is_empty() {
            let steps = [2.0 * model.step, model.step, model.step / 2.0];
            axes.step = match axes.sample {
                None => steps.into_iter().filter_map(|step| model.suitable_step(step)).collect(),
                sample => steps.into_iter().filter_map(|step| suitable(model, sample, step)).collect(),
            };
        }
        if axes.multiplier.is_empty() {
            axes.multiplier = SINGLE_BLOCK.to_vec();
            axes.multiplier.push(default_ports(model, axes.storage.first().copied().unwrap_or_default()));
        }
        once(&mut axes.solver);
        once(&mut axes.step);
        once(&mut axes.multiplier);
        once(&mut axes.storage);
        let graph = |solver: &Solver| Some((*solver, build(solver)?));
        let graphs: Vec<(Solver, StepGraph)> = axes.solver.iter().filter_map(graph).collect();
        if axes.pes.is_empty() {
            axes.pes = axes.useful_pes(model, &graphs);
        }
        once(&mut axes.pes);
        Completed { axes, graphs, stiffness }
    }

    /// Powers of two, for as long as the bound of some solver and multiplier falls.
    fn useful_pes(&self, model: &Model, graphs: &[(Solver, StepGraph)]) -> Vec<u32> {
        // The lists other than that of the PEs are complete.
        let points = Axes { pes: vec![1], ..self.clone() }.points();
        let formats = points.iter().filter_map(|point| point.format(model).ok());
        let mut latencies: Vec<Latency> = formats.map(|format| Latency::of(&format)).collect();
        once(&mut latencies);
        let bound = |graph: &StepGraph, pes: u32, latency: &Latency| Bound::of(graph, pes, *latency).binding().0;
        let faster = |graph: &StepGraph, pes: u32| {
            pes as usize <= graph.equations.len()
                && latencies.iter().any(|latency| bound(graph, pes, latency) < bound(graph, pes / 2, latency))
        };
        let mut pes = vec![1];
        while graphs.iter().any(|(_, graph)| faster(graph, 2 * pes[pes.len() - 1])) {
            pes.push(2 * pes[pes.len() - 1]);
        }
        pes
    }

    /// The points with the form that each would choose.
    pub fn formed(&self, model: &Model, mapping: &MappingOptions) -> Vec<DesignPoint> {
        with_forms(self.points(), model, mapping)
    }

    /// All points, those that share most side by side.
    fn points(&self) -> Vec<DesignPoint> {
        let mut points = Vec::new();
        for step in &self.step {
            for solver in &self.solver {
                for multiplier in &self.multiplier {
                    for storage in &self.storage {
                        points.extend(self.pes.iter().map(|pes| DesignPoint {
                            pes: Some(*pes),
                            solver: Some(*solver),
                            step: Some(*step),
                            early_steps: None,
                            form: self.form,
                            coefficients: Coefficients::OneSlot,
                            storage: *storage,
                            multiplier: Some(*multiplier),
                            pipeline: self.pipeline,
                        }));
                    }
                }
            }
        }
        points
    }
}

/// The points with the form that each would choose, so that those with the same step graph are found.
pub fn with_forms(points: Vec<DesignPoint>, model: &Model, mapping: &MappingOptions) -> Vec<DesignPoint> {
    let mut known: Vec<(DesignPoint, FormChoice)> = Vec::new();
    let choose = |point: &DesignPoint| {
        let model = Model { solver: point.solver.unwrap_or(model.solver), ..model.clone() };
        let options = point.step_options(mapping);
        // What is refused is refused again when the point is compiled.
        pe_hls::step::build_with(&model, &options).map_or(point.form, |graph| FormChoice::of(graph.form))
    };
    let form = |point: DesignPoint| {
        let same = |(other, _): &&(DesignPoint, FormChoice)| other.solver == point.solver && other.pes == point.pes;
        let form = known.iter().find(same).map_or_else(|| choose(&point), |(_, form)| *form);
        known.push((point, form));
        DesignPoint { form, ..point }
    };
    points.into_iter().map(form).collect()
}

/// Drops repeated values; the first of each stays where it is.
pub fn once<T: Copy + PartialEq>(values: &mut Vec<T>) {
    let mut seen: Vec<T> = Vec::new();
    values.retain(|value| {
        let new = !seen.contains(value);
        seen.push(*value);
        new
    });
}
