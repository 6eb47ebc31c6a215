//! The total error: the hardware's states against the reference solution of the model.

use indicatif::ProgressBar;
use pe_ir::model::Model;
use pe_sim::error::Trajectory;
use pe_sim::reference::{self, ReferenceError};

/// How much looser the tolerance of the second solution is, which tells how far the first can be trusted.
const LOOSER: f64 = 10.0;

/// Parts of the progress bar.
const BAR: u64 = 1000;

/// A reference solution at sample times.
pub struct Reference {
    solution: Trajectory,
    /// Magnitudes that errors are relative to.
    scales: Vec<f64>,
    /// Relative difference to a solution with a tolerance `LOOSER` times as large.
    pub uncertainty: f64,
}

/// The largest error of all states, and where it is.
#[derive(Clone, Copy, Debug)]
pub struct Worst {
    /// The state.
    pub state: usize,
    /// Error relative to the scale of the state.
    pub error: f64,
}

/// The total error of a run.
#[derive(Clone, Copy, Debug)]
pub struct TotalError {
    /// Over all samples.
    pub whole: Worst,
    /// At the last one.
    pub end: Worst,
    /// How far the reference itself can be trusted.
    pub uncertainty: f64,
}

impl Reference {
    /// Solves the model twice, with different tolerances, side by side.
    ///
    /// # Errors
    /// If there is no solution up to the last of the times.
    pub fn solve(model: &Model, times: &[f64], progress: &ProgressBar) -> Result<Reference, ReferenceError> {
        let end = times.last().copied().unwrap_or(0.0);
        progress.set_length(BAR);
        let mut silent = |_: f64| {};
        let mut tell = |time: f64| progress.set_position((time / end * BAR as f64) as u64);
        let (loose, solution) = std::thread::scope(|scope| {
            let loose = scope.spawn(|| reference::solve(model, times, LOOSER * reference::TOLERANCE, &mut silent));
            let solution = reference::solve(model, times, reference::TOLERANCE, &mut tell);
            (loose.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), solution)
        });
        let (loose, solution) = (loose?, solution?);
        let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
        let scales = solution.scales(&quantities);
        let uncertainty = solution.deviation(&loose).worst(&scales).1.max(reference::TOLERANCE);
        Ok(Reference { solution, scales, uncertainty })
    }

    /// How far `run`, sampled at the same times, is from it.
    pub fn compare(&self, run: &Trajectory) -> TotalError {
        let worst = |solution: &Trajectory, run: &Trajectory| {
            let (state, error) = solution.deviation(run).worst(&self.scales);
            Worst { state, error }
        };
        TotalError {
            whole: worst(&self.solution, run),
            end: worst(&self.solution.last(), &run.last()),
            uncertainty: self.uncertainty,
        }
    }
}
