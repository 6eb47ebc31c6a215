//! The rows of a sweep, and the fronts among them.

use pe_flow::accuracy::wanted::{Goals, USUAL_ERROR};
use pe_flow::explore::fronts::{Pair, front, knee, size_and_time, time_and_error};
use pe_flow::explore::row::Row;
use pe_flow::report::Figures;
use serde_json::{Map, Value};

/// Largest total error of points that some front shows, where so large a one competes in size and speed.
pub fn shown(max_error: Option<f64>) -> Option<f64> {
    max_error.map(|limit| limit.max(USUAL_ERROR))
}

/// The rows of a sweep, and what it was asked for.
pub struct Sheet {
    /// Keys of `points.json` that say what was asked for.
    pub head: Map<String, Value>,
    /// Name and title of the model.
    pub title: String,
    /// The clock, as a person reads it.
    pub clock: String,
    /// Largest total error of points that compete in size and speed.
    pub max_error: Option<f64>,
    /// What the best point is wanted to be.
    pub goals: Goals,
    /// Number of points of the whole sweep.
    pub total: usize,
    /// Whether the time ran out that the sweep was given.
    pub late: bool,
    /// The points that are done, in the order of the sweep, each with its place in it.
    pub rows: Vec<Row>,
    /// The place of each row in the sweep.
    pub places: Vec<usize>,
}

/// A front of a sweep, with its name in the files.
pub struct Front {
    /// Name in `points.json`.
    pub key: &'static str,
    /// Title.
    pub title: String,
    /// Indices of rows.
    pub rows: Vec<usize>,
    /// The row at which the front bends most.
    pub knee: Option<usize>,
}

impl Sheet {
    /// How many points there are, in words: `run` is what may have been interrupted, `failed` what became of those
    /// that a picture lacks.
    pub fn points(&self, run: &str, failed: &str) -> String {
        let mut text = format!("{} points", self.rows.len());
        if self.late {
            let differs = "how many that are differs from run to run";
            text += &format!(" of {}, the {run} was stopped by `--within` ({differs})", self.total);
        } else if self.rows.len() < self.total {
            text += &format!(" of {}, the {run} was interrupted", self.total);
        }
        let lacking = self.rows.iter().filter(|row| row.figures().is_none()).count();
        if lacking > 0 {
            text += &format!("; {lacking} {failed} and are not shown");
        }
        text
    }

    /// Both fronts. Size and speed are compared among points that are right enough; a front of errors shows larger ones
    /// than [`USUAL_ERROR`] only if they are asked for.
    pub fn fronts(&self) -> [Front; 2] {
        let of = |key, title: &str, pair: Pair, limit: Option<f64>| {
            let right_enough = |index: &usize| {
                let total = self.rows[*index].figures().and_then(Figures::total_error);
                limit.is_none_or(|limit| total.is_some_and(|error| error <= limit))
            };
            let rows: Vec<usize> = (0..self.rows.len()).filter(right_enough).collect();
            let rows = front(&self.rows, &rows, pair);
            let within = limit.map_or(String::new(), |limit| format!(", total error at most {limit:e}"));
            Front { key, title: format!("{title}{within}"), knee: knee(&self.rows, &rows, pair), rows }
        };
        [
            of("error_time", "Error against run time", time_and_error, shown(self.max_error)),
            of("size_speed", "Size against speed", size_and_time, self.max_error),
        ]
    }

    /// Largest total error of points that a sweep designs: those of any front.
    pub fn runs_within(&self) -> Option<f64> {
        shown(self.max_error)
    }

    /// The smallest total error, if it is larger than what competes.
    pub fn out_of_reach(&self) -> Option<f64> {
        let errors = self.rows.iter().filter_map(|row| row.figures()?.total_error());
        let smallest = errors.fold(f64::INFINITY, f64::min);
        self.max_error.filter(|limit| smallest.is_finite() && smallest > *limit).map(|_| smallest)
    }
}
