//! The result of the runs: errors, and the data kept of each run.

use std::sync::Arc;

use pe_hls::rounding::Aim;
use pe_ir::graph::FixedPoint;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::error::Trajectory;

use crate::corners::Corner;
use crate::pivots::SmallestPivot;
use crate::proof::Proof;

use super::tally::Tally;

/// Errors of all steps, relative to the largest magnitude of a state over the span; see `pe_sim::error` for the floor.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// State with the largest word-length error.
    pub worst_state: StateId,
    /// Fixed point against double precision with exact coefficients, same step: rounding and coefficients together.
    pub word_length: f64,
    /// The part of it that quantised coefficients alone cause.
    pub coefficient: f64,
    /// Both at the end of the span alone.
    pub at_end: (f64, f64),
    /// Tables against the functions that they stand for, both in double precision; none without functions.
    pub function: Option<f64>,
    /// Step `h` against step `h/2`, extrapolated with the order of the method.
    pub method: f64,
    /// Inputs held over `h` against their means; zero if all inputs are constant.
    pub input_hold: f64,
    /// The same errors relative to the largest magnitude of a state up to the step in question.
    pub to_date: ToDate,
}

/// Errors relative to the largest magnitude that a state has up to the step in question, at least a millionth of its
/// scale over the span.
#[derive(Clone, Copy, Debug)]
pub struct ToDate {
    /// As [`Errors::word_length`].
    pub word_length: f64,
    /// As [`Errors::coefficient`].
    pub coefficient: f64,
    /// As [`Errors::function`].
    pub function: Option<f64>,
    /// As [`Errors::method`].
    pub method: f64,
    /// As [`Errors::input_hold`].
    pub input_hold: f64,
}

impl Errors {
    /// Takes the larger of each.
    fn include(&mut self, other: &Errors) {
        if other.word_length > self.word_length {
            (self.worst_state, self.word_length) = (other.worst_state, other.word_length);
        }
        let larger = |own: Option<f64>, other: Option<f64>| own.zip(other).map(|(own, other)| own.max(other)).or(own);
        self.coefficient = self.coefficient.max(other.coefficient);
        self.at_end = (self.at_end.0.max(other.at_end.0), self.at_end.1.max(other.at_end.1));
        self.function = larger(self.function, other.function);
        self.method = self.method.max(other.method);
        self.input_hold = self.input_hold.max(other.input_hold);
        let (own, other) = (&mut self.to_date, &other.to_date);
        own.word_length = own.word_length.max(other.word_length);
        own.coefficient = own.coefficient.max(other.coefficient);
        own.function = larger(own.function, other.function);
        own.method = own.method.max(other.method);
        own.input_hold = own.input_hold.max(other.input_hold);
    }

    /// The largest part of the error relative to the largest magnitude of a state up to the step in question.
    pub fn largest_to_date(&self) -> f64 {
        let ToDate { word_length, function, method, input_hold, .. } = self.to_date;
        [word_length, function.unwrap_or(0.0), method, input_hold].into_iter().fold(0.0, f64::max)
    }
}

impl ToDate {
    /// How much larger such an error has to be than that over the span to be worth telling.
    pub const APART: f64 = 10.0;
}

/// State words in the middle of a run, to start from there.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// Steps done.
    pub step: u64,
    /// Stored word of each state.
    pub words: Vec<i64>,
}

/// Outputs of which curves are kept, at most.
const MOST_CURVES: usize = 4096;

/// Outputs at the sample times, for pictures.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// Which outputs of the model these are, ascending: all, or of very many the scalars and the first elements of arrays.
    pub outputs: Vec<usize>,
    /// In double precision.
    pub double: Trajectory,
    /// In fixed point.
    pub fixed: Trajectory,
}

impl Curves {
    /// Empty curves of a model's outputs.
    pub(super) fn of(model: &Model) -> Curves {
        let mut outputs: Vec<usize> = (0..model.outputs.len()).collect();
        outputs.sort_by_key(|output| model.outputs[*output].name.contains('['));
        outputs.truncate(MOST_CURVES);
        outputs.sort_unstable();
        let empty = || Trajectory::new(outputs.len());
        Curves { double: empty(), fixed: empty(), outputs }
    }
}

/// What the runs found.
#[derive(Clone)]
pub struct Judged {
    /// Number formats under which the span runs without saturation.
    pub fixed: FixedPoint,
    /// What the roundings of its coefficients cancel in; none if they were given.
    pub aim: Option<Aim>,
    /// Errors.
    pub errors: Errors,
    /// Number of times formats were widened.
    pub widenings: usize,
    /// Middle of the run.
    pub checkpoint: Checkpoint,
    /// Steps of the span: errors are the largest of all of them.
    pub steps: u64,
    /// Times of evenly spread samples, in seconds.
    pub times: Vec<f64>,
    /// States of the fixed-point run at these times.
    pub hardware: Trajectory,
    /// States of the run in double precision at these times.
    pub double: Arc<Trajectory>,
    /// States at other times of interest.
    pub looks: Looks,
    /// How much larger the errors of each state are than at the samples and looks.
    pub unseen: Unseen,
    /// Warnings.
    pub warnings: Vec<Diagnostic>,
    /// Nanoseconds per product in double precision and in fixed point.
    pub ns_per_mac: (f64, f64),
    /// Outputs over time.
    pub curves: Curves,
    /// Largest magnitude of each value of the step graph in the run in double precision.
    pub largest: Vec<f64>,
    /// Word-length error of each state.
    pub state_errors: Vec<f64>,
    /// Word-length error of each output that has a curve, relative to its largest magnitude.
    pub output_errors: Vec<f64>,
    /// The smallest pivot of an implicit method.
    pub smallest_pivot: Option<SmallestPivot>,
    /// Which ranges are proven; none if no proof was asked for.
    pub proof: Option<Proof>,
    /// Events of the runs, where a design is judged by these.
    pub tally: Option<Tally>,
    /// Where tunable parameters were beside their values in the spec: the errors are the worst of all.
    pub corners: Vec<String>,
}

impl Judged {
    /// Takes in what was found with other values of tunable parameters. Trajectories and magnitudes of the run stay.
    pub(super) fn include(&mut self, corner: &Corner, other: Judged) {
        self.errors.include(&other.errors);
        for (own, other) in
            [(&mut self.state_errors, other.state_errors), (&mut self.output_errors, other.output_errors)]
        {
            own.iter_mut().zip(other).for_each(|(own, other)| *own = own.max(other));
        }
        let known: Vec<&str> = self.warnings.iter().map(|warning| warning.code).collect();
        let new = other.warnings.into_iter().filter(|warning| !known.contains(&warning.code)).collect();
        self.warnings.extend(corner.named(new));
        self.corners.push(corner.name.clone());
    }
}

/// States at steps that deserve a look beside the samples: the first ones, and those after a jump of an input.
#[derive(Clone, Debug, Default)]
pub struct Looks {
    /// Times in seconds; none of them is that of a sample.
    pub times: Vec<f64>,
    /// States of the fixed-point run at these times.
    pub hardware: Trajectory,
    /// States of the run in double precision at these times.
    pub double: Arc<Trajectory>,
}

/// By how much errors are larger than at those steps at which states are kept, state by state, relative to their scales.
#[derive(Clone, Debug, Default)]
pub struct Unseen {
    /// Of the word length.
    pub word_length: Vec<f64>,
    /// Of method, held inputs and functions together.
    pub double: Vec<f64>,
}
