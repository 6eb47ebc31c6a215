//! The axes of a sweep, and the points they span.

use pe_hls::schedule::Bound;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_ir::word::{Latency, MultiplierPorts, Pipeline};

use super::steps::suitable;
use crate::settings::{MappingOptions, step_options};
use pe_judge::check::stiffness;
use pe_judge::{Coefficients, DesignPoint, FormChoice, default_ports};

/// Multipliers of a sweep unless told otherwise, beside that of the other commands: one block each way round.
const SINGLE_BLOCK: [MultiplierPorts; 2] = [MultiplierPorts::new(25, 18), MultiplierPorts::new(18, 25)];

/// The axes: a list of values for each.
#[derive(Clone, Debug)]
pub struct Axes {
    /// Numbers of PEs; powers of two, for as long as more of them can be faster, if there are none.
    pub pes: Vec<u32>,
    /// Numerical methods; those that suit the model if there are none.
    pub solver: Vec<Solver>,
    /// Steps in seconds; the spec's, its half and its double if there are none.
    pub step: Vec<f64>,
    /// Longest time between two outputs in seconds: steps are whole parts of it.
    pub sample: Option<f64>,
    /// Registers that an operation passes.
    pub pipeline: Pipeline,
    /// Form of the step of a model that is affine in its states.
    pub form: FormChoice,
    /// Bits of the multiplier's ports.
    pub multiplier: Vec<MultiplierPorts>,
    /// Bits of a stored word, without its guard bits.
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
        let options = step_options(point, mapping);
        // What is refused is refused again when the point is compiled.
        pe_hls::step::build_with(&model, &options).map_or(point.form, |graph| FormChoice::of(graph.form))
    };
    let form = |point: DesignPoint| {
        let asked = |point: &DesignPoint| (point.solver, step_options(point, mapping));
        let same = |(other, _): &&(DesignPoint, FormChoice)| asked(other) == asked(&point);
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
