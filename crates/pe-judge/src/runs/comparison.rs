//! What smaller steps, exact functions and the means of inputs say about the step: runs in double precision, all
//! compared at every step.

use std::ops::Range;
use std::sync::Arc;

use pe_hls::step::StepOptions;
use pe_ir::codes;
use pe_ir::graph::{StageForm, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Diagnostic;
use pe_sim::compared::{Compared, Rows};
use pe_sim::double::DoubleRun;

use crate::progress::silent;

use super::exact::{Exact, compared_outputs};
use super::inputs::{self, Blindness, Sight, varying_inputs};
use super::kept::Kept;
use super::lockstep::{Pass, Plan};
use super::magnitudes::Magnitudes;
use super::settle::Aids;

/// The beginning of a span, where a step may pass over what decays at once: this part of all steps, but so many of spans
/// that have ten times as many at least.
const BEGINNING_PART: u64 = 100;
const SHORTEST_BEGINNING: u64 = 64;

/// Part of the largest difference to half the step from which on a finding counts time.
const PART: f64 = 0.1;

/// The first steps are also taken in quarters, to see the order of the method: this part of all steps, but so many at
/// least.
const QUARTERED_PART: u64 = 64;
const FEWEST_QUARTERED: u64 = 64;

/// Part of the largest difference that has to be seen among these steps for their order to count, and the difference
/// below which all is rounding.
const TELLING: f64 = 0.1;
const ROUNDING: f64 = 1e-11;

/// What is left of a difference when the step is halved, at most: a smaller step is not worth more than four times the
/// difference.
const LEAST_GAIN: f64 = 0.75;

/// The same where right-hand sides have bends: a method of any order keeps the first.
const BENT_GAIN: f64 = 0.5;

/// What smaller steps say about the method.
#[derive(Clone)]
pub struct Comparison {
    /// Tables against the functions that they stand for.
    pub(super) function: Option<Compared>,
    /// The step against half of it.
    pub(super) halved: Compared,
    /// Method error over the largest difference to half the step.
    pub(super) gain: f64,
    /// What quarters of the step say, of models with bends.
    bent: Option<Bent>,
    /// By how much the magnitude of each state in the run, which errors are relative to, is larger than it should be.
    overshoot: Vec<f64>,
    /// What the step does not see of inputs, which are compared in their means; none if they are constant, or covered by
    /// the method.
    pub(super) unseen_inputs: Option<Compared>,
}

/// What a method makes of a bend depends on where in the step it lies: the errors of the step and of half of it may be
/// the same by chance.
#[derive(Clone)]
struct Bent {
    /// The step against a quarter of it.
    quarters: Compared,
    /// Half the step against a quarter of it.
    rest: Compared,
    /// Method error over the difference to a quarter of the step.
    gain: f64,
}

/// Numbers of a run that is kept, at most: 128 MiB.
const MOST_KEPT: u64 = 1 << 24;

impl Comparison {
    /// The method error of each state: with an error C h^p the difference of steps h and h/2 is C h^p (1 - 2^-p).
    fn methods(&self) -> Vec<f64> {
        let mut errors: Vec<f64> = self.halved.relative().map(|error| self.gain * error).collect();
        if let Some(Bent { quarters, rest, gain }) = &self.bent {
            for ((error, quarters), rest) in errors.iter_mut().zip(quarters.relative()).zip(rest.relative()) {
                *error = error.max(gain * quarters).max(rest);
            }
        }
        errors.iter_mut().zip(&self.overshoot).for_each(|(error, larger)| *error *= larger);
        errors
    }

    /// The method error of the worst state.
    pub fn method(&self) -> f64 {
        self.methods().into_iter().fold(0.0, f64::max)
    }

    /// The method error after the beginning of the span. What is wrong before it fades away, or else is wrong later, too.
    pub(super) fn lasting(&self, model: &Model) -> f64 {
        let steps = model.steps();
        let beginning = (steps / BEGINNING_PART).max(SHORTEST_BEGINNING.min(steps / 10));
        let bent = self.bent.as_ref().map_or(0.0, |bent| bent.gain * bent.quarters.after(beginning));
        bent.max(self.gain * self.halved.after(beginning))
    }

    /// What the step does not see of inputs.
    pub(super) fn blindness(&self) -> Option<Blindness> {
        self.unseen_inputs.as_ref().map(Blindness::of)
    }

    /// The error of inputs held over the step.
    pub fn input_hold(&self) -> f64 {
        self.blindness().map_or(0.0, |blindness| blindness.error)
    }

    /// The same two relative to the magnitudes up to then.
    pub(super) fn to_date(&self) -> (f64, f64) {
        let hold = self.unseen_inputs.as_ref().map_or(0.0, Compared::to_date);
        let bent = self.bent.as_ref().map_or(0.0, |bent| bent.gain * bent.quarters.to_date());
        (self.method().max(bent).max(self.gain * self.halved.to_date()), hold)
    }

    /// How much larger the errors of each state are than at the steps that were seen, all added up.
    pub fn unseen(&self) -> Vec<f64> {
        let mut unseen: Vec<f64> = self.halved.unseen().map(|error| self.gain * error).collect();
        if let Some(Bent { quarters, gain, .. }) = &self.bent {
            unseen.iter_mut().zip(quarters.unseen()).for_each(|(most, error)| *most = most.max(gain * error));
        }
        unseen.iter_mut().zip(&self.overshoot).for_each(|(error, larger)| *error *= larger);
        for compared in self.unseen_inputs.iter().chain(&self.function) {
            unseen.iter_mut().zip(compared.unseen()).for_each(|(sum, error)| *sum += error);
        }
        unseen
    }

    /// The finding that a large method error is.
    pub(super) fn finding(&self, model: &Model) -> Diagnostic {
        let quarters = self.bent.as_ref().map(|bent| &bent.quarters);
        let (part, compared) = match quarters.filter(|quarters| quarters.worst().1 > self.halved.worst().1) {
            Some(quarters) => ("a quarter", quarters),
            None => ("half", &self.halved),
        };
        let (worst, difference) = compared.worst();
        let state = &model.states[StateId::at(worst)];
        let time = model.time(compared.since(PART * difference), 0.0);
        let message = format!(
            "the step is too large for `{}`: from t = {time:.6e} s on {part} of it changes the result by up to {difference:.1e}",
            state.name
        );
        Diagnostic::error(codes::STEP_TOO_LARGE, state.span, message)
            .with_help(format!("try `--step {:.3e}`; a chaotic model needs a shorter `--span`", model.step / 2.0))
    }
}

impl Exact {
    /// Compares with smaller steps.
    ///
    /// # Errors
    /// `E0901` non-finite.
    pub fn compare(&self, model: &Model, graph: &StepGraph) -> Result<Comparison, Vec<Diagnostic>> {
        self.compare_telling(model, graph, &mut |_| false)
    }

    /// The same; keeps the run of the step itself if that is not too large.
    pub fn compare_keeping(
        &self,
        model: &Model,
        graph: &StepGraph,
    ) -> (Result<Comparison, Vec<Diagnostic>>, Option<Kept>) {
        if let Some(kept) = &self.kept {
            return (self.compare(model, graph), Some(kept.clone()));
        }
        let width = (model.states.len() + compared_outputs(graph)) as u64;
        let small = self.plan.steps.saturating_mul(width) <= MOST_KEPT;
        let mut blocks = Vec::new();
        let comparison = self.compare_telling(model, graph, &mut |rows| {
            if small {
                blocks.push(Arc::clone(rows));
            }
            small
        });
        (comparison, small.then(|| Kept::of(blocks)))
    }

    /// The same, where somebody listens to the run of the step itself, block by block, for as long as that says so.
    pub(super) fn compare_telling(
        &self,
        model: &Model,
        graph: &StepGraph,
        listener: &mut dyn FnMut(&Arc<Rows>) -> bool,
    ) -> Result<Comparison, Vec<Diagnostic>> {
        let plan = &self.plan;
        let frame = self.frame();
        let graphs = Graphs::of(&frame, model);
        let mut others = graphs.as_ref().map(|graphs| Others::new(&frame, graph, graphs)).map_err(Clone::clone);
        let mut own = self.source(graph, Aids::default());
        let mut listens = true;
        for block in plan.blocks() {
            let rows = own.next(plan, &block);
            listens = listens && listener(&rows);
            if let Ok(runs) = &mut others
                && let Err(findings) = runs.block(plan, &block, &rows)
            {
                others = Err(findings);
            }
            if !listens && others.is_err() {
                break;
            }
        }
        others.map(|runs| runs.conclude(&frame))
    }

    fn frame(&self) -> Frame<'_> {
        Frame { plan: &self.plan, form: self.form, tables: self.tables, scales: &self.scales }
    }

    /// A comparison of states with those of this run.
    pub(super) fn compared(&self) -> Compared {
        self.frame().compared()
    }

    /// The run of the step itself.
    pub(super) fn own<'a>(&self, graph: &'a StepGraph) -> Pass<'a> {
        Pass::new(&self.plan, DoubleRun::new(graph), compared_outputs(graph))
    }
}

/// The method error of a step with exact functions, whose states have such magnitudes: a run of it beside smaller steps.
///
/// # Errors
/// `E0901` non-finite.
pub fn method_error(model: &Model, graph: &StepGraph, scales: &[f64]) -> Result<f64, Vec<Diagnostic>> {
    let plan = Plan::of(model, silent());
    let frame = Frame { plan: &plan, form: graph.form, tables: false, scales };
    let graphs = Graphs::of(&frame, model)?;
    let mut others = Others { seeing: None, ..Others::new(&frame, graph, &graphs) };
    let mut own = Pass::new(&plan, DoubleRun::new(graph), 0);
    for block in plan.blocks() {
        let rows = own.block(&plan, &block)?;
        others.block(&plan, &block, rows)?;
    }
    Ok(others.conclude(&frame).method())
}

/// Step graphs of the runs that the step is compared with.
struct Graphs {
    /// With exact functions in the place of tables.
    functions: Option<StepGraph>,
    half: StepGraph,
    quarter: StepGraph,
    /// The step of the model with its signals as inputs, if it has any.
    seen: Option<StepGraph>,
    /// Half the step with a method that keeps nothing from step to step, for inputs that others only cover if smooth.
    one_step: Option<StepGraph>,
    /// The model with its signals as inputs.
    model: Model,
    /// The model of the runs with parts of the step.
    divided: Model,
}

/// What runs are compared in.
struct Frame<'a> {
    plan: &'a Plan,
    form: StageForm,
    /// Whether tables stand for functions.
    tables: bool,
    /// Magnitudes of the states.
    scales: &'a [f64],
}

impl Frame<'_> {
    fn compared(&self) -> Compared {
        let start: Vec<f64> = self.plan.model.states.iter().map(|state| state.initial).collect();
        Compared::new(0, self.scales, &start).modulo(self.plan.model.turns())
    }
}

impl Graphs {
    fn of(exact: &Frame, model: &Model) -> Result<Graphs, Vec<Diagnostic>> {
        let options = StepOptions { form: Some(exact.form), ..StepOptions::default() };
        let covered = model.solver.covers_inputs();
        // What steps do not see of jumps is no error of the method.
        let apart = model.has_played() && !covered;
        let jumping = Some(model.with_jumps_as_inputs()).filter(|_| apart);
        // A step that is affine with them as inputs may lack the form: then the method error counts them, too.
        let jumping = jumping.filter(|jumping| pe_hls::step::build_with(jumping, &options).is_ok());
        let jumping = jumping.unwrap_or_else(|| model.clone());
        let divided = |count: u32| {
            pe_hls::step::build_with(&jumping.in_steps_of(model.step / f64::from(count)), &options.in_parts(count))
        };
        let functions = exact.tables.then(|| divided(1)).transpose()?;
        let signals = model.with_signals_as_inputs();
        let jumps = covered && inputs::cause(&signals).is_some();
        let seen = model.has_played() && !covered && varying_inputs(model);
        let seen = seen.then(|| pe_hls::step::build_with(&signals, &StepOptions::default())).transpose()?;
        let one_step = Model { solver: Solver::Rk4, ..signals.in_steps_of(model.step / 2.0) };
        let one_step =
            jumps.then(|| pe_hls::step::build_with(&one_step, &StepOptions::default().in_parts(2))).transpose()?;
        let (half, quarter) = (divided(2)?, divided(4)?);
        Ok(Graphs { functions, half, quarter, seen, one_step, model: signals, divided: jumping })
    }
}

/// Runs that the step is compared with.
struct Others<'a> {
    functions: Option<(Pass<'a>, Compared)>,
    half: (Pass<'a>, Compared),
    /// With the means of inputs; and with what the hardware makes of them, if that is not the step's own run.
    seeing: Option<(Pass<'a>, Option<Pass<'a>>, Compared)>,
    /// Quarters of the step; none once they are done.
    quarter: Option<Quarters<'a>>,
    /// Largest difference to half the step among the first steps, and what it is with a quarter of it.
    first: Option<(f64, f64)>,
    graphs: &'a Graphs,
    magnitudes: Magnitudes,
}

/// The run with a quarter of the step.
struct Quarters<'a> {
    pass: Pass<'a>,
    /// Half the step against it.
    rest: Compared,
    /// Steps that tell the order of the method.
    first: u64,
    /// The step against it over the whole span, of models with bends.
    run: Option<Compared>,
}

impl<'a> Others<'a> {
    fn new(exact: &Frame, own: &'a StepGraph, graphs: &'a Graphs) -> Others<'a> {
        let (plan, model) = (exact.plan, &exact.plan.model);
        // Otherwise the method's own history of slopes would see inputs that move at every other of its steps.
        let covered = model.solver.covers_inputs();
        let sight = if covered { Sight::Sampled } else { Sight::Held };
        let pass = |graph, count, sight| Pass::of_model(&graphs.divided, DoubleRun::new(graph), count, sight);
        let bent = model.has_bends();
        if bent {
            plan.progress.add_length(4 * plan.steps);
        }
        // A mean does in a step what the signal itself does, to second order.
        let taken =
            graphs.seen.as_ref().map(|graph| Pass::of_model(&graphs.model, DoubleRun::new(graph), 1, Sight::Taken));
        let own = graphs.seen.as_ref().unwrap_or(own);
        let means = (varying_inputs(model) && !covered).then_some((own, 1));
        let means = means.or(graphs.one_step.as_ref().map(|graph| (graph, 2)));
        Others {
            functions: graphs.functions.as_ref().map(|graph| (pass(graph, 1, Sight::Held), exact.compared())),
            half: (pass(&graphs.half, 2, sight), exact.compared()),
            seeing: means.map(|(graph, count)| {
                let means = Pass::of_model(&graphs.model, DoubleRun::new(graph), count, Sight::Mean);
                (means, taken, exact.compared())
            }),
            quarter: Some(Quarters {
                pass: pass(&graphs.quarter, 4, sight),
                rest: exact.compared(),
                first: (plan.steps / QUARTERED_PART).max(FEWEST_QUARTERED),
                run: bent.then(|| exact.compared()),
            }),
            first: None,
            graphs,
            magnitudes: Magnitudes::new(model.states.iter().map(|state| state.initial)),
        }
    }

    /// Goes on with a block of the step's own run.
    fn block(&mut self, plan: &Plan, block: &Range<u64>, own: &Rows) -> Result<(), Vec<Diagnostic>> {
        let Others { functions, half, seeing, quarter, first, graphs, magnitudes } = self;
        let mut run = own;
        if let Some((pass, compared)) = functions {
            let exact = pass.block(plan, block)?;
            plan.compare(block, compared, exact, own);
            run = exact;
        }
        let halves = half.0.block(plan, block)?;
        plan.compare(block, &mut half.1, run, halves);
        if let Some((pass, taken, compared)) = seeing {
            let own = match taken {
                Some(taken) => taken.block(plan, block)?,
                None => own,
            };
            plan.compare(block, compared, pass.block(plan, block)?, own);
        }
        let Some(Quarters { pass, rest, first: steps, run: bent }) = quarter else {
            magnitudes.include(halves);
            return Ok(());
        };
        let Ok(quarters) = pass.block(plan, block) else {
            // Where a quarter of the step fails, nothing is known of it.
            *quarter = None;
            magnitudes.include(halves);
            return Ok(());
        };
        plan.include(block, rest, halves, quarters);
        if let Some(bent) = bent {
            plan.compare(block, bent, run, quarters);
        }
        magnitudes.include(quarters);
        if first.is_none() && block.end >= *steps {
            *first = Some((half.1.worst().1, rest.worst().1));
            magnitudes.see_within(half.0.largest(&graphs.half), pass.largest(&graphs.quarter));
            if bent.is_none() {
                *quarter = None;
            }
        }
        Ok(())
    }

    fn conclude(self, exact: &Frame) -> Comparison {
        let model = &exact.plan.model;
        let left = 1.0 / f64::from(1u32 << model.solver.order());
        let (_, largest) = self.half.1.worst();
        let telling = |(half, quarter): &(f64, f64)| *half >= TELLING * largest && *quarter > ROUNDING;
        let seen = self.first.filter(telling).map_or(0.0, |(half, quarter)| (quarter / half).min(LEAST_GAIN));
        let bent = self.quarter.and_then(|Quarters { run, rest, .. }| {
            // What halving leaves, twice.
            let left = (rest.worst().1 / largest.max(ROUNDING)).min(BENT_GAIN).max(left);
            run.map(|quarters| Bent { quarters, rest, gain: 1.0 / (1.0 - left * left) })
        });
        let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
        let within_steps = self.half.0.largest(&self.graphs.half);
        let overshoot = self.magnitudes.overshoot(&quantities, exact.scales, &within_steps);
        // Of what the step does not see the run has no magnitude.
        let unseen_inputs = self.seeing.map(|(.., compared)| compared.in_scale(&quantities));
        Comparison {
            function: self.functions.map(|(_, compared)| compared),
            halved: self.half.1,
            gain: 1.0 / (1.0 - left.max(seen)),
            bent,
            overshoot,
            unseen_inputs,
        }
    }
}
