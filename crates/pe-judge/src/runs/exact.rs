//! The run in double precision that all others are compared to.

use std::sync::Arc;

use pe_hls::formats::{self, Ranges};
use pe_hls::rounding::{self, Aim, Moments, Sampling};
use pe_ir::codes;
use pe_ir::graph::{Factor, FixedPoint, Role, StageForm, StepGraph, Term, ValueId};
use pe_ir::index::{StateId, at};
use pe_ir::model::{Model, State, Variable};
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;
use pe_sim::double::{Diverged, DoubleRun};
use pe_sim::error::Trajectory;

use crate::angles;
use crate::corners::{self, Corner};
use crate::pivots::{self, SmallestPivot};
use crate::progress::{Progress, silent};
use crate::times::thread_seconds;

use super::copies;
use super::events;
use super::inputs;
use super::judged::Curves;
use super::jumping::left_at;
use super::kept::{Keeping, Kept, Room};
use super::lockstep::Plan;
use super::siblings::Siblings;

/// Numbers of a run that is kept where nobody else keeps any, at most: 8 MiB.
const MOST_KEPT_ALONE: u64 = 1 << 20;

/// Outputs that are compared at every step, at most: the first ones.
const COMPARED_OUTPUTS: usize = 8;

pub(super) fn compared_outputs(graph: &StepGraph) -> usize {
    graph.outputs.len().min(COMPARED_OUTPUTS)
}

/// The run in double precision, which knows nothing of formats: ranges, and what others are compared to.
pub struct Exact {
    pub(super) plan: Plan,
    pub(super) form: StageForm,
    /// Whether tables stand for functions.
    pub(super) tables: bool,
    pub(super) reference: Arc<Trajectory>,
    /// States at the plan's looks.
    pub(super) looks: Arc<Trajectory>,
    /// Largest magnitude of each output that has a curve.
    pub(super) output_scales: Vec<f64>,
    /// Outputs in double precision alone.
    pub(super) curves: Curves,
    pub(super) largest: Vec<f64>,
    pub(super) ranges: Ranges,
    /// Values that share ranges; of models with events.
    pub(super) siblings: Option<Siblings>,
    pub(super) moments: Moments,
    pub(super) scales: Vec<f64>,
    pub(super) seconds: f64,
    pub(super) smallest_pivot: Option<SmallestPivot>,
    /// The run itself, if it is short and the same however inputs are seen: what it is compared with needs no other one.
    pub(super) kept: Option<Kept>,
    /// The same with tunable parameters at the ends of their ranges.
    pub(super) corners: Vec<AtCorner>,
}

/// A run with other values of tunable parameters.
pub(super) struct AtCorner {
    pub(super) corner: Corner,
    pub(super) model: Model,
    pub(super) exact: Exact,
}

impl Exact {
    /// Runs the step graph over the span.
    ///
    /// # Errors
    /// `E0901` non-finite, `E0905` a pivot of an implicit method close to zero, `E0914` a sine faster than the steps.
    pub fn run(model: &Model, graph: &StepGraph, progress: Arc<dyn Progress>) -> Result<Exact, Vec<Diagnostic>> {
        let whole = Exact::run_while(model, graph, progress, &mut |_, _| true, &Room::new(MOST_KEPT_ALONE))?;
        Ok(whole.expect("nobody ends it"))
    }

    /// The same, for as long as `goes_on` says so: it hears of every sample and look how many came before, and the
    /// states. None if it ended the run. The run is kept where there is room.
    ///
    /// # Errors
    /// Those of [`Exact::run`].
    pub fn run_while(
        model: &Model,
        graph: &StepGraph,
        progress: Arc<dyn Progress>,
        goes_on: &mut dyn FnMut(usize, &[f64]) -> bool,
        room: &Arc<Room>,
    ) -> Result<Option<Exact>, Vec<Diagnostic>> {
        let Some(mut own) = Exact::run_alone(model, graph, Arc::clone(&progress), goes_on, room)? else {
            return Ok(None);
        };
        for corner in corners::corners(model) {
            let other = corner.model(model);
            let graph = corner.graph(graph);
            let exact = Exact::run_alone(&other, &graph, Arc::clone(&progress), &mut |_, _| true, room)
                .map_err(|findings| corner.named(findings))?
                .expect("nobody ends it");
            for (own, other) in own.largest.iter_mut().zip(&exact.largest) {
                *own = own.max(*other);
            }
            for (own, other) in own.ranges.largest.iter_mut().zip(&exact.ranges.largest) {
                *own = own.max(*other);
            }
            own.corners.push(AtCorner { corner, model: other, exact });
        }
        Ok(Some(own))
    }

    /// With the values of the spec alone.
    fn run_alone(
        model: &Model,
        graph: &StepGraph,
        progress: Arc<dyn Progress>,
        goes_on: &mut dyn FnMut(usize, &[f64]) -> bool,
        room: &Arc<Room>,
    ) -> Result<Option<Exact>, Vec<Diagnostic>> {
        if let Some(finding) = inputs::too_fast(model) {
            return Err(vec![finding]);
        }
        let plan = Plan::of(model, progress);
        let begin = thread_seconds();
        let Some(run) = reference_run(model, graph, &plan, goes_on, room)? else { return Ok(None) };
        let ReferenceRun { reference, looks, curves, mut ranges, moments, kept } = run;
        let (reference, looks) = (Arc::new(reference), Arc::new(looks));
        let output_scales =
            graph.outputs[..compared_outputs(graph)].iter().map(|output| ranges.largest[output.index()]);
        let output_scales = output_scales.collect();
        let largest = ranges.largest.clone();
        let smallest_pivot = pivots::smallest(model, graph, &largest)?;
        let seconds = thread_seconds() - begin;
        include_declared(model, graph, &mut ranges);
        if let Some(finding) = events::lost(model, graph, &largest) {
            return Err(vec![finding]);
        }
        include_possible(model, graph, &largest, &mut ranges);
        let siblings = model.has_jumps().then(|| Siblings::of(graph));
        siblings.iter().for_each(|siblings| siblings.include(&mut ranges));
        copies::include(graph, &mut ranges);
        let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
        let scales = model.own_scales(reference.scales(&quantities));
        Ok(Some(Exact {
            plan,
            form: graph.form,
            tables: !graph.functions.tables.is_empty(),
            reference,
            looks,
            output_scales,
            curves,
            largest,
            ranges,
            siblings,
            moments,
            scales,
            seconds,
            smallest_pivot,
            kept,
            corners: Vec::new(),
        }))
    }

    /// Times of samples and of looks of a model's runs, in seconds.
    pub fn times(model: &Model) -> (Vec<f64>, Vec<f64>) {
        let plan = Plan::of(model, silent());
        (plan.times(&plan.samples), plan.times(&plan.looks))
    }

    /// States at these times.
    pub fn states(&self) -> (&Trajectory, &Trajectory) {
        (&self.reference, &self.looks)
    }

    /// Formats for such ranges.
    ///
    /// # Errors
    /// `E080x` no format.
    pub(super) fn formats(
        &self,
        graph: &StepGraph,
        ranges: &Ranges,
        format: WordFormat,
        aim: Aim,
    ) -> Result<FixedPoint, Vec<Diagnostic>> {
        let mut fixed = formats::choose(graph, ranges, format).map_err(|error| vec![error])?;
        rounding::improve(graph, &mut fixed, &self.moments, aim);
        Ok(fixed)
    }
}

/// What the first run in double precision finds.
struct ReferenceRun {
    reference: Trajectory,
    looks: Trajectory,
    curves: Curves,
    ranges: Ranges,
    moments: Moments,
    kept: Option<Kept>,
}

fn reference_run(
    model: &Model,
    graph: &StepGraph,
    plan: &Plan,
    goes_on: &mut dyn FnMut(usize, &[f64]) -> bool,
    room: &Arc<Room>,
) -> Result<Option<ReferenceRun>, Vec<Diagnostic>> {
    let mut sampling = Sampling::new(graph);
    let mut run = DoubleRun::new(graph);
    let mut reference = Trajectory::new(model.states.len());
    let mut looks = Trajectory::new(model.states.len());
    let mut curves = Curves::of(model);
    let (mut samples, mut looked_at) = (plan.samples.iter().peekable(), plan.looks.iter().peekable());
    let (states, outputs) = (model.states.len(), compared_outputs(graph));
    let mut keeping = Keeping::new(plan, states + outputs, room);
    keeping.stop_if(!model.inputs.is_empty() || !model.rates.is_empty());
    for done in 1..=plan.steps {
        let time = model.time(done - 1, 0.0);
        run.step(&model.sample_inputs(time)).map_err(|diverged| vec![non_finite(graph, diverged, time)])?;
        plan.advance(done, 1);
        let row = || run.states().take(states).chain((0..outputs).map(|output| run.output(output)));
        keeping.add(done, row);
        let sampled = samples.next_if_eq(&&done).is_some();
        if sampled {
            reference.push(|state| run.state(StateId::at(state)));
            let Curves { outputs, double, .. } = &mut curves;
            double.push(|at| run.output(outputs[at]));
            sampling.add(|value| run.value(value));
        }
        let looked = looked_at.next_if_eq(&&done).is_some();
        if looked {
            looks.push(|state| run.state(StateId::at(state)));
        }
        let before = reference.len() + looks.len();
        if sampled || looked {
            let states: Vec<f64> = run.states().take(states).collect();
            if !goes_on(before - 1, &states) {
                return Ok(None);
            }
        }
    }
    let largest = run.largest();
    reference.largest = graph.states.iter().map(|(state, _)| largest[state.index()]).collect();
    let ranges = Ranges { largest, widened: vec![0; graph.values.len()] };
    let (moments, kept) = (sampling.moments(), keeping.kept());
    Ok(Some(ReferenceRun { reference, looks, curves, ranges, moments, kept }))
}

/// Magnitude of an argument from which on an infinite value is an overflow, not a pole.
const OVERFLOWING: f64 = 500.0;

/// What a run says that met a value that is not finite.
pub fn non_finite(graph: &StepGraph, diverged: Diverged, time: f64) -> Diagnostic {
    let equation = graph.equation_of(diverged.value).expect("an equation computes it");
    // An exponential that overflows has a domain; what its argument is has left all bounds.
    let overflows = |(function, argument): &(u32, f64)| {
        let value = graph.functions.exact[at(*function)].evaluate(*argument);
        value.is_infinite() && argument.abs() > OVERFLOWING
    };
    if let Some((function, argument)) = diverged.outside.filter(|outside| !overflows(outside)) {
        let function = &graph.functions.exact[at(function)].name;
        let message = format!("`{}` has no value at t = {time:.6e} s: `{function}` at x = {argument:e}", equation.name);
        return Diagnostic::error(codes::OUTSIDE_DOMAIN, equation.span, message)
            .with_help("try a smaller `--step`; or keep the argument in the domain, with `max`, `min` or `if`");
    }
    let message = format!("`{}` is no longer a finite number at t = {time:.6e} s", equation.name);
    Diagnostic::error(codes::DIVERGED, equation.span, message)
        .with_help("the model or the step is unstable: try a smaller `--step`, then check the equation")
}

/// Gives products of two variables that are never both nonzero in the run the range of what they could be, and so what follows
/// from these in models with events: an event that has not come yet must not find the finest format there is. `seen` are the largest
/// magnitudes in the run.
fn include_possible(model: &Model, graph: &StepGraph, seen: &[f64], ranges: &mut Ranges) {
    let stays_zero = |value: ValueId| match graph.value(value).role {
        Role::Next(state) => model.states.find(state).is_some_and(State::stays_zero),
        _ => false,
    };
    for chain in graph.chains.iter().filter(|chain| !stays_zero(chain.write.value)) {
        let largest = |value: ValueId| ranges.largest[value.index()];
        let of_term = |term: &Term| match term.factor {
            Factor::Coefficient(factor) => factor.abs() * largest(term.operand),
            Factor::Value(factor) => largest(factor) * largest(term.operand),
        };
        if chain.function.is_some() {
            continue;
        }
        let terms = graph.chain_terms(chain);
        let products = terms.iter().any(|term| matches!(term.factor, Factor::Value(_)));
        let sum: f64 = match products {
            true => terms.iter().map(of_term).sum(),
            // Terms that cancel in the run are no reason for room.
            false => terms.iter().filter(|term| seen[term.operand.index()] == 0.0).map(of_term).sum(),
        };
        if !products && (sum == 0.0 || !model.has_jumps()) {
            continue;
        }
        for write in chain.writes() {
            let base = write.base.map_or(0.0, |base| ranges.largest[base.index()]);
            let slot = &mut ranges.largest[write.value.index()];
            if *slot == 0.0 {
                *slot = base + libm::scalbn(sum, write.weight);
            }
        }
    }
}

/// Widens measured ranges to what the spec states and inputs can reach.
fn include_declared(model: &Model, graph: &StepGraph, ranges: &mut Ranges) {
    let mut include = |value: ValueId, (low, high): (f64, f64)| {
        let slot = &mut ranges.largest[value.index()];
        *slot = slot.max(low.abs()).max(high.abs());
    };
    for (input, value) in model.inputs.iter().zip(&graph.inputs) {
        include(*value, input.waveform.bounds());
        input.range.into_iter().for_each(|range| include(*value, range));
    }
    for (state, (value, _)) in model.states.iter().zip(&graph.states) {
        state.range.into_iter().for_each(|range| include(*value, range));
    }
    for (value, state) in left_at(model, graph) {
        model.states[state].range.into_iter().for_each(|range| include(value, range));
    }
    for (value, largest) in angles::functions(model, graph).into_iter().chain(angles::sums(model, graph)) {
        include(value, (-largest, largest));
    }
    for (index, value) in graph.values.iter().enumerate() {
        let variable = match value.role {
            Role::Algebraic(algebraic, _) => Variable::Algebraic(algebraic),
            Role::Published(output) => model.outputs[at(output)].variable,
            _ => continue,
        };
        if let Variable::Algebraic(algebraic) = variable {
            let range = model.algebraics.get(at(algebraic)).and_then(|algebraic| algebraic.range);
            range.into_iter().for_each(|range| include(ValueId::at(index), range));
        }
    }
}
