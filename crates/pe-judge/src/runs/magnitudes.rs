//! How large states should be, where the step makes them larger: an implicit method that passes over a fast decay may
//! carry a state to many times its true magnitude, which is then no measure of an error.

use pe_sim::compared::Rows;
use pe_sim::error::{SCALE_FLOOR, Trajectory};

/// How much larger than it should be a state has to get for its errors to be taken relative to what it should be.
const OVERSHOOT: f64 = 1.25;

/// What is left of a magnitude that comes from the step alone when the step is halved, at most.
const FALLING: f64 = 0.6;

/// Largest magnitudes of states in runs with smaller steps.
pub(super) struct Magnitudes {
    /// After steps of the plan, in the run with the smallest steps.
    after: Vec<f64>,
    /// After the first steps: within steps, too, with half the step and a quarter of it.
    within: Option<(Vec<f64>, Vec<f64>)>,
}

impl Magnitudes {
    /// Those of the initial values.
    pub fn new(initial: impl Iterator<Item = f64>) -> Magnitudes {
        Magnitudes { after: initial.map(f64::abs).collect(), within: None }
    }

    /// Goes on with states after steps.
    pub fn include(&mut self, rows: &Rows) {
        for row in 0..rows.len() {
            self.after.iter_mut().zip(rows.row(row)).for_each(|(most, number)| *most = most.max(number.abs()));
        }
    }

    /// Takes note of the largest magnitudes within the first steps: with half the step, and with a quarter of it.
    pub fn see_within(&mut self, half: Vec<f64>, quarter: Vec<f64>) {
        self.within = Some((half, quarter));
    }

    /// By how much each of `scales`, the magnitudes of states in the run of the step itself, is larger than it should be;
    /// 1 if it is not. `half` are the largest magnitudes with half the step over the whole span; `quantities` are those of
    /// the states, as in [`Trajectory::scales`].
    pub fn overshoot(self, quantities: &[u32], scales: &[f64], half: &[f64]) -> Vec<f64> {
        let mut largest = self.after;
        for (state, most) in largest.iter_mut().enumerate() {
            let (half, run) = (half[state], scales[state]);
            let within = match self.within.as_ref().map(|(first, quarter)| (first[state], quarter[state])) {
                Some((first, quarter)) if half <= first => {
                    let falls = half <= FALLING * run && quarter <= FALLING * half;
                    if falls { 2.0 * quarter - half } else { quarter }
                }
                _ => half,
            };
            *most = most.max(within);
        }
        let solution = Trajectory { largest, ..Trajectory::new(scales.len()) };
        let pairs = scales.iter().zip(solution.scales(quantities));
        let larger =
            pairs.map(|(run, solution)| if run.is_finite() { (run / solution).min(1.0 / SCALE_FLOOR) } else { 1.0 });
        larger.map(|larger| if larger > OVERSHOOT { larger } else { 1.0 }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_magnitude_that_falls_with_the_step_is_an_overshoot_and_one_that_grows_is_not() {
        let overshoot = |half: f64, quarter: f64, after: f64, later: f64| {
            let mut magnitudes = Magnitudes::new([0.0].into_iter());
            let mut rows = Rows::new(1);
            rows.add([after].into_iter());
            magnitudes.include(&rows);
            magnitudes.see_within(vec![half], vec![quarter]);
            magnitudes.overshoot(&[0], &[8.0], &[later])[0]
        };
        // 8, 4, 2 with ever smaller steps, 0.4 after the first step.
        assert_eq!(overshoot(4.0, 2.0, 0.4, 4.0), 20.0);
        // The same, but as large again later on.
        assert_eq!(overshoot(4.0, 2.0, 0.4, 9.0), 1.0);
        // A peak between steps, which smaller ones see, or meet at its sides.
        assert_eq!(overshoot(7.0, 4.0, 0.4, 7.0), 2.0);
        assert_eq!(overshoot(10.0, 12.0, 0.4, 10.0), 1.0);
    }
}
