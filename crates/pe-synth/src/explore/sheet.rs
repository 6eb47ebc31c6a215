//! The rows of a sweep, and the fronts among them.

use pe_flow::explore::fronts::{Pair, front, knee, size_and_time, time_and_error};
use pe_flow::explore::row::Row;
use pe_flow::report::Figures;
use serde_json::{Map, Value};

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
    /// Number of points of the whole sweep.
    pub total: usize,
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
        if self.rows.len() < self.total {
            text += &format!(" of {}, the {run} was interrupted", self.total);
        }
        let lacking = self.rows.iter().filter(|row| row.figures().is_none()).count();
        if lacking > 0 {
            text += &format!("; {lacking} {failed} and are not shown");
        }
        text
    }

    /// Both fronts.
    pub fn fronts(&self) -> [Front; 2] {
        let of = |key, title: String, pair: Pair, rows: Vec<usize>| {
            let rows = front(&self.rows, &rows, pair);
            Front { key, title, knee: knee(&self.rows, &rows, pair), rows }
        };
        let right_enough = |index: &usize| {
            let total = self.rows[*index].figures().and_then(Figures::total_error);
            self.max_error.is_none_or(|limit| total.is_some_and(|error| error <= limit))
        };
        let all = 0..self.rows.len();
        let within = self.max_error.map_or(String::new(), |limit| format!(", total error at most {limit:e}"));
        [
            of("error_time", "Error against run time".into(), time_and_error, all.clone().collect()),
            of("size_speed", format!("Size against speed{within}"), size_and_time, all.filter(right_enough).collect()),
        ]
    }
}
