//! The growth of a tiny difference of the initial values: whether the model or the last bit decides a trajectory.

use pe_hls::step::{StepOptions, build_with};
use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_sim::double::DoubleRun;
use pe_sim::linear::is_affine;

/// First difference of the two runs, relative to each state, and products that all runs may take.
const DISTURBANCE: f64 = 1e-9;
const PRODUCTS: u64 = 1_200_000_000;

/// Times at which the runs are compared.
const LOOKS: u64 = 200;

/// Growth of a difference from which on a model is sensitive; chaotic if it grows all the time.
pub const SENSITIVE: f64 = 1e4;

/// Part of its rate that growth has to have with half the step to be the model's: nearly all of chaos, a tenth at most of
/// what a step too large for jumps makes of differences.
const SAME: f64 = 0.5;

/// Part of a state's magnitude at which two runs have nothing in common.
pub const APART: f64 = 0.1;

/// How two runs part that begin almost alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity {
    /// Largest difference over the span, relative to the magnitude of the state, over the relative one at the beginning.
    pub growth: f64,
    /// Largest Lyapunov exponent, estimated, in 1/s; none if the model is not chaotic.
    pub rate: Option<f64>,
    /// Time in seconds from which on the step and half of it go different ways; none if they do not.
    pub parted: Option<f64>,
}

impl Sensitivity {
    /// Runs the step beside a disturbed one; none for models that are affine, and if it would take too long. `scales`
    /// are the magnitudes of the states.
    ///
    /// A step that is too coarse multiplies differences that the model does not, where it lands before or behind a jump.
    /// So half the step has to multiply them alike, and the runs are looked at for only as long as it goes the same way.
    pub fn of(model: &Model, graph: &StepGraph, scales: &[f64]) -> Option<Sensitivity> {
        let growth = disturbed_growth(model, graph, scales)?;
        if growth < SENSITIVE {
            return Some(Sensitivity { growth, rate: None, parted: None });
        }
        Sensitivity::beside_half(model, graph, scales)
    }

    /// The same of a step that was refused, with the time from which on half of it goes elsewhere.
    pub fn beside_half(model: &Model, graph: &StepGraph, scales: &[f64]) -> Option<Sensitivity> {
        if is_affine(model) || model.steps().saturating_mul(6 * graph.macs()) > PRODUCTS {
            return None;
        }
        let half = model.in_steps_of(model.step / 2.0);
        let options = StepOptions { form: Some(graph.form), ..StepOptions::default() };
        let finer = build_with(&half, &options.in_parts(2)).ok()?;
        let mut pair = [DoubleRun::new(graph), DoubleRun::new(graph)];
        let mut fine = [DoubleRun::new(&finer), DoubleRun::new(&finer)];
        for (index, state) in model.states.iter().enumerate() {
            let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
            let part = if state.motion.is_none() { sign * DISTURBANCE } else { 0.0 };
            let disturbed = state.initial * (1.0 + part);
            [&mut pair, &mut fine].into_iter().for_each(|[_, other]| other.set_state(StateId::at(index), disturbed));
        }
        let difference = |run: &DoubleRun, other: &DoubleRun| {
            (0..scales.len())
                .map(|state| apart(model, run, other, StateId::at(state)) / scales[state])
                .fold(0.0, f64::max)
        };
        let first = difference(&pair[0], &pair[1]);
        let (mut largest, mut parted) = (first, None);
        let stride = model.steps().div_ceil(LOOKS);
        // Natural logarithms of the differences over time, until the runs have parted.
        let (mut course, mut fine_course) = (Vec::new(), Vec::new());
        for done in 1..=model.steps() {
            let time = model.time(done - 1, 0.0);
            let inputs = model.sample_inputs(time);
            for run in &mut pair {
                run.step(&inputs).ok()?;
            }
            let halves = in_halves(model, &half, done - 1);
            let finite = fine.iter_mut().all(|run| halves.iter().all(|inputs| run.step(inputs).is_ok()));
            if !finite || done % stride == 0 || done == model.steps() {
                let now = model.time(done, 0.0);
                if !finite || difference(&pair[0], &fine[0]) > APART {
                    parted = Some(now);
                    break;
                }
                let apart = difference(&pair[0], &pair[1]);
                largest = largest.max(apart);
                if apart > APART {
                    break;
                }
                let logarithm = |difference: f64| libm::log(difference.max(f64::MIN_POSITIVE));
                course.push((now, logarithm(apart)));
                fine_course.push((now, logarithm(difference(&fine[0], &fine[1]))));
            }
        }
        let rate = rate(first, &course).filter(|rate| slope(&fine_course) >= SAME * rate);
        Some(Sensitivity { growth: largest / DISTURBANCE, rate, parted })
    }
}

/// How far a state of two runs is apart.
fn apart(model: &Model, one: &DoubleRun, other: &DoubleRun, state: StateId) -> f64 {
    model.difference(state, one.state(state), other.state(state)).abs()
}

/// Inputs of both halves of a step; `half` is the model with half the step.
pub(super) fn in_halves(model: &Model, half: &Model, step: u64) -> [Vec<f64>; 2] {
    [0.5, 1.0].map(|part| {
        let mut inputs = half.hold_inputs(model.time(step, 0.0), model.time(step, part - 0.5));
        model.draw_lines(step, part, &mut inputs);
        inputs
    })
}

/// What becomes of a difference of the initial values over the whole span, relative to itself: nothing more needs to be
/// asked of a model that does not multiply it.
fn disturbed_growth(model: &Model, graph: &StepGraph, scales: &[f64]) -> Option<f64> {
    if is_affine(model) || model.steps().saturating_mul(6 * graph.macs()) > PRODUCTS {
        return None;
    }
    let mut pair = [DoubleRun::new(graph), DoubleRun::new(graph)];
    for (index, state) in model.states.iter().enumerate() {
        let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
        pair[1].set_state(StateId::at(index), state.initial * (1.0 + sign * DISTURBANCE));
    }
    let stride = model.steps().div_ceil(LOOKS);
    let mut largest: f64 = 0.0;
    for done in 1..=model.steps() {
        let inputs = model.sample_inputs(model.time(done - 1, 0.0));
        for run in &mut pair {
            run.step(&inputs).ok()?;
        }
        if done % stride == 0 || done == model.steps() {
            let apart = |state: usize| apart(model, &pair[0], &pair[1], StateId::at(state)) / scales[state];
            largest = (0..scales.len()).map(apart).fold(largest, f64::max);
            if largest / DISTURBANCE >= SENSITIVE {
                break;
            }
        }
    }
    Some(largest / DISTURBANCE)
}

/// The Lyapunov exponent from a first difference and its course; none if the growth is not that of chaos.
fn rate(first: f64, course: &[(f64, f64)]) -> Option<f64> {
    let (end, last) = *course.last()?;
    if first == 0.0 || last - libm::log(first) < libm::log(SENSITIVE) {
        return None;
    }
    let rate = slope(course);
    // The difference grows for the whole time, not in one leap: each third of the time has its part.
    let third = |part: usize| course[(course.len() - 1) * part / 3].1;
    let steady = (1..=3).all(|part| third(part) > third(part - 1));
    (rate > 0.0 && steady && rate * end >= libm::log(SENSITIVE) / 2.0).then_some(rate)
}

/// Slope of the straight line through points with the least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), point| (x + point.0 / count, y + point.1 / count));
    let (above, below) = points.iter().fold((0.0, 0.0), |(above, below), point| {
        (above + (point.0 - x) * (point.1 - y), below + (point.0 - x) * (point.0 - x))
    });
    if below > 0.0 { above / below } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_that_of_the_line() {
        assert!((slope(&[(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]) - 2.0).abs() < 1e-12);
        assert_eq!(slope(&[(1.0, 1.0)]), 0.0);
    }

    #[test]
    fn steady_growth_is_chaos_and_a_leap_is_none() {
        let steady: Vec<(f64, f64)> = (1..=90).map(|k| (f64::from(k), -20.0 + 0.2 * f64::from(k))).collect();
        assert!(rate(libm::exp(-20.0), &steady).is_some_and(|rate| (rate - 0.2).abs() < 1e-9));
        let leap: Vec<(f64, f64)> = (1..=90).map(|k| (f64::from(k), if k < 80 { -20.0 } else { -3.0 })).collect();
        assert_eq!(rate(libm::exp(-20.0), &leap), None);
    }
}
