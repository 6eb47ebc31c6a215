//! The period of an oscillation, and its error in a run.
//!
//! Periods are counted between upward crossings of the middle between the solution's extremes. Crossings are
//! interpolated by a cubic through four samples, in the solution and in the run at the same times, so that most of
//! what the interpolation costs is the same in both.

use pe_ir::index::StateId;

/// Crossings that make an oscillation, at least.
const CROSSINGS: usize = 3;

/// Samples in a period, at least; fewer do not tell where it begins.
const SAMPLES: f64 = 8.0;

/// Largest spread of the periods relative to their mean: what varies more is no oscillation.
const SPREAD: f64 = 0.05;

/// The period of a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period {
    /// The state.
    pub state: StateId,
    /// Mean period of the solution in seconds.
    pub seconds: f64,
    /// Mean period of the run over that of the solution, minus one; infinite if the run oscillates less than twice.
    pub error: f64,
}

/// The period of a state whose solution and run were sampled at `times`, in seconds; none if the solution does not
/// oscillate regularly.
pub fn period(state: StateId, times: &[f64], solution: &[f64], run: &[f64]) -> Option<Period> {
    let (low, high) = solution.iter().fold((f64::MAX, f64::MIN), |(low, high), n| (low.min(*n), high.max(*n)));
    let level = 0.5 * (low + high);
    let crossed = crossings(times, solution, level);
    if crossed.len() < CROSSINGS {
        return None;
    }
    let seconds = mean(&crossed)?;
    let lengths = crossed.windows(2).map(|pair| pair[1] - pair[0]);
    let (least, most) = lengths.fold((f64::MAX, 0.0f64), |(least, most), n| (least.min(n), most.max(n)));
    let sampling = times.last()? / times.len() as f64;
    if most - least > SPREAD * seconds || seconds < SAMPLES * sampling {
        return None;
    }
    let error = mean(&crossings(times, run, level)).map_or(f64::INFINITY, |other| other / seconds - 1.0);
    Some(Period { state, seconds, error })
}

/// Mean distance of crossings.
fn mean(crossed: &[f64]) -> Option<f64> {
    let (first, last) = (crossed.first()?, crossed.last()?);
    (crossed.len() > 1).then(|| (last - first) / (crossed.len() - 1) as f64)
}

/// Times at which the samples rise through a level.
fn crossings(times: &[f64], samples: &[f64], level: f64) -> Vec<f64> {
    let rises = |at: &usize| samples[*at] < level && samples[*at + 1] >= level;
    let inside = 1..times.len().saturating_sub(2);
    inside.filter(rises).map(|at| crossing(&times[at - 1..at + 3], &samples[at - 1..at + 3], level)).collect()
}

/// Where the cubic through four samples meets the level between the second and the third.
fn crossing(times: &[f64], samples: &[f64], level: f64) -> f64 {
    let cubic = |time: f64| -> f64 {
        let basis = |i: usize| -> f64 {
            (0..4).filter(|j| *j != i).map(|j| (time - times[j]) / (times[i] - times[j])).product()
        };
        (0..4).map(|i| samples[i] * basis(i)).sum()
    };
    let (mut low, mut high) = (times[1], times[2]);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if cubic(middle) < level { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(times: &[f64], period: f64) -> Vec<f64> {
        times.iter().map(|time| 3.0 + libm::sin(std::f64::consts::TAU * time / period)).collect()
    }

    #[test]
    fn a_period_that_is_wrong_by_a_millionth_is_found() {
        let times: Vec<f64> = (1..=400).map(|k| f64::from(k) * 0.1).collect();
        let found = period(StateId::new(0), &times, &sine(&times, 4.0), &sine(&times, 4.0 * (1.0 + 1e-6))).unwrap();
        assert!((found.seconds - 4.0).abs() < 1e-5, "{found:?}");
        assert!((found.error - 1e-6).abs() < 2e-8, "{found:?}");
    }

    #[test]
    fn what_is_irregular_or_sampled_too_rarely_has_no_period() {
        let times: Vec<f64> = (1..=400).map(|k| f64::from(k) * 0.1).collect();
        let chirp: Vec<f64> = times.iter().map(|time| libm::sin(time * time)).collect();
        assert_eq!(period(StateId::new(0), &times, &chirp, &chirp), None);
        let fast = sine(&times, 0.5);
        assert_eq!(period(StateId::new(0), &times, &fast, &fast), None);
        let constant = vec![1.0; 400];
        assert_eq!(period(StateId::new(0), &times, &constant, &constant), None);
        let still = period(StateId::new(0), &times, &sine(&times, 4.0), &constant).unwrap();
        assert_eq!(still.error, f64::INFINITY);
    }
}
