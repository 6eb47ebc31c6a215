//! What else the runs show: states that stand still or lose their increments, steps that rounded coefficients let grow,
//! sensitivity to the last bit.

use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::{self, StateId};
use pe_ir::model::{Model, Solver, State, Variable};
use pe_ir::place::Place;
use pe_sim::double::DoubleRun;
use pe_sim::linear::{Linearised, is_affine};
use pe_sim::spectrum::{eigenvalues, outer_eigenvalues};

use super::trusted::Trusted;
use crate::runs::{APART, Judged, SENSITIVE, Sensitivity};

/// Points at which increments are looked at, fewer in models of very many states, but some.
const POINTS: usize = 150;
const NUMBERS: usize = 3_000_000;
const FEWEST_POINTS: usize = 5;

/// Part of the run from which on lost increments are worth a word, and part of a state's magnitude that they must come
/// to: a state that comes to rest loses its last increments, and nothing with them.
const DEAD_PART: f64 = 0.01;
const DEAD_LOSS: f64 = 1e-3;

/// States up to which the matrix of a step is found column by column.
const COLUMNS: usize = 120;

/// A pole as close as this to the unit circle is on it, as that of an integrator is.
const INTEGRATOR: f64 = 1e-9;

/// Part of the growth of a sensitive model that rounding errors show in any case, which are no single difference.
const MULTIPLIED: f64 = 0.1;

/// Growth of the distance between the two runs in the second half of the time from which on a model may be sensitive: one
/// that multiplies differences by [`SENSITIVE`] at an even rate multiplies them by the root of that there.
const LASTING: f64 = 20.0;

/// Vectors of Arnoldi's method for larger ones.
const VECTORS: usize = 40;

/// Products that the columns of a step's matrix may take.
const PRODUCTS: u64 = 400_000_000;

/// A state whose increments are below half an LSB, so that rounding loses them, for a part of the run.
#[derive(Clone, Debug, PartialEq)]
pub struct DeadBand {
    /// The state.
    pub state: StateId,
    /// First time at which its increment is lost, in seconds.
    pub time: f64,
    /// Part of the run in which increments are below one LSB.
    pub part: f64,
    /// What the lost increments come to, relative to its largest magnitude.
    pub loss: f64,
}

/// States whose increments vanish for long enough to matter, those that lose most first.
pub fn dead_bands(model: &Model, graph: &StepGraph, fixed: &FixedPoint, trusted: &Trusted) -> Vec<DeadBand> {
    let states = model.states.len();
    let points = trusted.points((NUMBERS / states.max(1)).clamp(FEWEST_POINTS, POINTS));
    let mut found: Vec<DeadBand> = (0..states)
        .map(|state| DeadBand { state: StateId::at(state), time: f64::INFINITY, part: 0.0, loss: 0.0 })
        .collect();
    let mut largest = vec![0.0f64; states];
    let weight = 1.0 / points.len() as f64;
    for point in &points {
        let (time, at) = (trusted.times[*point], trusted.at(*point));
        let inputs = model.sample_inputs(time);
        let linear = Linearised::at(model, at, &inputs);
        let step = match model.step_ratio() {
            Some(Variable::Input(ratio)) => model.step / inputs[index::at(ratio)],
            _ => model.step,
        };
        for (state, dead) in found.iter_mut().enumerate() {
            largest[state] = largest[state].max(at[state].abs());
            let increment = (step * linear.derivatives[state]).abs();
            let lsb = libm::scalbn(1.0, fixed.exponents[graph.states[StateId::at(state)].0.index()]);
            if increment > 0.0 && increment < lsb {
                dead.part += weight;
                if increment < 0.5 * lsb {
                    dead.time = dead.time.min(time);
                    dead.loss += weight * increment * model.steps() as f64;
                }
            }
        }
    }
    found.iter_mut().for_each(|dead| dead.loss /= largest[dead.state.index()].max(f64::MIN_POSITIVE));
    found.retain(|dead| dead.part > DEAD_PART && dead.loss > DEAD_LOSS);
    found.sort_by(|a, b| b.loss.total_cmp(&a.loss).then(a.state.cmp(&b.state)));
    found
}

/// Whether no state ever moves, not even in double precision.
pub fn is_still(model: &Model, trusted: &Trusted) -> bool {
    if model.states.iter().all(|state| state.motion.is_some()) {
        // Nothing is there to move.
        return false;
    }
    let (states, first) = (trusted.states.states, trusted.at(0));
    let inputs = model.sample_inputs(0.0);
    let derivatives = Place::new(model, first, &inputs).derivatives();
    let rests = |((state, at), derivative): ((&State, &f64), &f64)| match state.rate {
        _ if state.motion.is_some() => true,
        Some(_) => derivative == at,
        None => at + model.step * derivative == *at,
    };
    let same = |sample: &[f64]| {
        let mut numbers = model.states.iter().zip(sample.iter().zip(first));
        numbers.all(|(state, (number, first))| state.motion.is_some() || number == first)
    };
    trusted.states.samples.chunks_exact(states.max(1)).all(same)
        && model.states.iter().zip(first).zip(&derivatives).all(rests)
}

/// Magnitudes of the eigenvalues of one step, or, of a model with sampled parts, of as many steps as its ticks take to
/// repeat; the largest first.
#[derive(Clone, Debug, PartialEq)]
pub struct StepGrowth {
    exact: Vec<f64>,
    rounded: Vec<f64>,
    /// Number of steps.
    pub steps: u64,
    /// Whether all eigenvalues were computed; else the outer ones were estimated.
    pub all: bool,
    /// Time around which a step that is not linear was linearised, in seconds.
    pub linearised: Option<f64>,
}

impl StepGrowth {
    /// The largest magnitude with coefficients in double precision.
    pub fn exact(&self) -> f64 {
        self.exact.first().copied().unwrap_or(0.0)
    }

    /// The same with the coefficients of the hardware.
    pub fn rounded(&self) -> f64 {
        self.rounded.first().copied().unwrap_or(0.0)
    }

    /// The pole whose distance from the unit circle rounded coefficients change most, of those inside of it: its magnitude
    /// with exact and with rounded coefficients.
    pub fn moved_pole(&self) -> Option<(f64, f64)> {
        let inside = self.exact.iter().copied().zip(self.rounded.iter().copied());
        let margin = |(exact, rounded): &(f64, f64)| (1.0 - rounded) / (1.0 - exact);
        inside.filter(|(exact, _)| *exact < 1.0 - INTEGRATOR).min_by(|a, b| margin(a).total_cmp(&margin(b)))
    }
}

/// Eigenvalues of one step around the middle of the trajectory; none if they cannot be had.
pub fn step_growth(model: &Model, graph: &StepGraph, fixed: &FixedPoint, trusted: &Trusted) -> Option<StepGrowth> {
    let affine = is_affine(model);
    // Of a mechanism differences are followed along the whole run.
    if !affine && (model.states.len() > COLUMNS || model.mechanism.is_some() && model.solver == Solver::Trapezoidal) {
        return None;
    }
    let point = trusted.count() / 2;
    let steps = model.tick_cycle()?;
    let all = graph.states.len();
    let columns = all.min(COLUMNS) as u64;
    if steps.saturating_mul(columns * graph.macs()) > PRODUCTS {
        return None;
    }
    // What a method keeps from step to step is part of what a step maps.
    let keeps = !affine && all > model.states.len();
    let around = if keeps { reached(model, graph, trusted.times[point])? } else { Around::of(trusted, point, all) };
    let exact = magnitudes(model, DoubleRun::new(graph), affine, &around)?;
    let rounded = magnitudes(model, DoubleRun::quantised(graph, fixed), affine, &around)?;
    let linearised = (!affine).then_some(around.time);
    Some(StepGrowth { exact, rounded, steps, all: all <= COLUMNS, linearised })
}

/// All that a step keeps, at a time, and how large it is.
struct Around {
    time: f64,
    states: Vec<f64>,
    scales: Vec<f64>,
}

impl Around {
    /// A point of a trajectory; what is kept besides is zero, as it is of a step that is affine.
    fn of(trusted: &Trusted, point: usize, all: usize) -> Around {
        let mut around =
            Around { time: trusted.times[point], states: trusted.at(point).to_vec(), scales: scales(trusted) };
        around.states.resize(all, 0.0);
        around.scales.resize(all, 1.0);
        around
    }
}

/// Where the step itself has come to at a time, or before it as far as that takes no more products than the columns may;
/// none if it does not come there.
fn reached(model: &Model, graph: &StepGraph, time: f64) -> Option<Around> {
    let mut run = DoubleRun::new(graph);
    let mut step = 0;
    while model.time(step, 0.0) < time - 0.5 * model.step && step.saturating_mul(graph.macs()) < PRODUCTS {
        run.step(&model.sample_inputs(model.time(step, 0.0))).ok()?;
        step += 1;
    }
    let largest = run.largest();
    let mut scales: Vec<f64> = graph.states.iter().map(|(state, _)| largest[state.index()]).collect();
    let most = scales.iter().copied().fold(0.0, f64::max);
    scales
        .iter_mut()
        .filter(|scale| **scale == 0.0)
        .for_each(|scale| *scale = if most > 0.0 { 1e-6 * most } else { 1.0 });
    Some(Around { time: model.time(step, 0.0), states: run.states().collect(), scales })
}

fn magnitudes(model: &Model, run: DoubleRun, affine: bool, around: &Around) -> Option<Vec<f64>> {
    let states = around.states.len();
    let run = std::cell::RefCell::new(run);
    let input = |step: u64| model.hold_inputs(around.time, model.step * step as f64);
    let inputs: Vec<Vec<f64>> = (0..model.tick_cycle()?).map(input).collect();
    let step = |at: &[f64]| {
        let mut run = run.borrow_mut();
        at.iter().enumerate().for_each(|(index, number)| run.set_state(StateId::at(index), *number));
        let finite = inputs.iter().all(|inputs| run.step(inputs).is_ok());
        (0..states).map(|index| if finite { run.state(StateId::at(index)) } else { f64::NAN }).collect::<Vec<f64>>()
    };
    // An affine step is the same everywhere; of others a difference quotient around the point is taken.
    let at = if affine { vec![0.0; states] } else { around.states.clone() };
    let scales = if affine { vec![1.0; states] } else { around.scales.clone() };
    let size = if affine { 1.0 } else { 1e-6 };
    let origin = step(&at);
    let product = |vector: &[f64]| -> Vec<f64> {
        let moved: Vec<f64> = (0..states).map(|i| at[i] + size * scales[i] * vector[i]).collect();
        let after = step(&moved);
        // No mode of the model moves states that stand for signals.
        let stands = |i: usize| i < model.states.len() && model.states[StateId::at(i)].motion.is_some();
        let by = |i: usize| model.difference(StateId::at(i), after[i], origin[i]);
        let moved = |i: usize| if stands(i) { 0.0 } else { by(i) / (size * scales[i]) };
        (0..states).map(moved).collect()
    };
    let values = if states <= COLUMNS {
        let mut unit = vec![0.0; states];
        let mut columns = Vec::with_capacity(states * states);
        for column in 0..states {
            unit[column] = 1.0;
            columns.extend(product(&unit));
            unit[column] = 0.0;
        }
        eigenvalues(states, &columns)?
    } else {
        outer_eigenvalues(states, VECTORS, product)?
    };
    let mut magnitudes: Vec<f64> = values.iter().map(|(re, im)| libm::hypot(*re, *im)).collect();
    magnitudes.sort_by(|a, b| b.total_cmp(a));
    Some(magnitudes)
}

/// Largest magnitude of each state, or of the whole model where it is zero.
pub(super) fn scales(trusted: &Trusted) -> Vec<f64> {
    let quantities: Vec<u32> = (0..trusted.states.states as u32).collect();
    let own = trusted.states.scales(&quantities);
    let largest = own.iter().copied().fold(0.0, f64::max);
    let floor = if largest > 0.0 { 1e-6 * largest } else { 1.0 };
    own.into_iter().map(|scale| scale.max(floor)).collect()
}

/// How fast two runs that begin almost alike part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chaos {
    /// Largest Lyapunov exponent, estimated, in 1/s.
    pub rate: f64,
    /// Time at which a difference of one LSB has grown to a tenth of a state, in seconds.
    pub divergence: f64,
}

/// Whether a model may multiply differences as chaotic ones do. The run in fixed point is one that is disturbed: rounding
/// moves each state by about an LSB in every step. If it stays near the one in double precision, nothing is multiplied. What
/// multiplies differences all the time does so in the second half of the time, too, up to where the two have parted; where
/// roundings merely add up, they add up to a few times as much there.
pub fn may_be_sensitive(model: &Model, graph: &StepGraph, judged: &Judged, trusted: &Trusted) -> bool {
    let (scales, fixed) = (scales(trusted), &judged.fixed);
    // The lowest bit that a data port sees: below it words are rounded whenever they are read.
    let lsb = |(index, scale): (usize, &f64)| {
        libm::scalbn(1.0, fixed.exponents[graph.states[StateId::at(index)].0.index()] + fixed.format.data_drop() as i32)
            / scale
    };
    let coarsest = scales.iter().enumerate().map(lsb).fold(0.0, f64::max);
    if judged.errors.word_length < MULTIPLIED * SENSITIVE * coarsest {
        return false;
    }
    let (states, mut largest) = (scales.len().max(1), coarsest);
    let samples = judged.hardware.samples.chunks_exact(states).zip(judged.double.samples.chunks_exact(states));
    let mut course: Vec<f64> = Vec::new();
    for (hardware, double) in samples {
        if largest > APART {
            break;
        }
        let apart =
            |state: usize| model.difference(StateId::at(state), hardware[state], double[state]).abs() / scales[state];
        largest = (0..hardware.len()).map(apart).fold(largest, f64::max);
        course.push(largest);
    }
    let middle = course.get(course.len() / 2).copied().unwrap_or(coarsest);
    largest >= LASTING * middle
}

/// How a model multiplies differences; none if it is affine, or that would take too long to find out.
pub fn sensitivity(model: &Model, graph: &StepGraph, trusted: &Trusted) -> Option<Sensitivity> {
    Sensitivity::of(model, graph, &scales(trusted))
}

/// The same of a step that was refused.
pub fn refused_sensitivity(model: &Model, graph: &StepGraph, trusted: &Trusted) -> Option<Sensitivity> {
    Sensitivity::beside_half(model, graph, &scales(trusted))
}

/// Whether a model is chaotic; none if it is not. Without number formats an LSB is that of 32 bits.
pub fn chaos(
    graph: &StepGraph,
    fixed: Option<&FixedPoint>,
    trusted: &Trusted,
    sensitivity: Sensitivity,
) -> Option<Chaos> {
    let (scales, rate) = (scales(trusted), sensitivity.rate?);
    let of = |fixed: &FixedPoint| {
        let lsb = |index: usize| {
            libm::scalbn(1.0, fixed.exponents[graph.states[StateId::at(index)].0.index()]) / scales[index]
        };
        (0..scales.len()).map(lsb).fold(0.0, f64::max)
    };
    let lsb = fixed.map_or(libm::scalbn(1.0, -31), of);
    Some(Chaos { rate, divergence: libm::log(APART / lsb.max(f64::MIN_POSITIVE)) / rate })
}
