//! The input of a check, and its size limits.

use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::word::WordFormat;

use crate::criteria::Criteria;
use crate::point::DesignPoint;

/// Method error that the accuracy step is for unless the user gives another.
pub const ACCURACY: f64 = 1e-3;

/// States above which no trials with other steps are run.
pub const TRIED_STATES: usize = 10_000;

/// States up to which a compilation explains its step by eigenvalues and trials: that takes about a second then.
pub const JUDGED_STATES: usize = 500;

/// States up to which methods are tried that eliminate or fill a matrix.
pub const MATRIX_STATES: usize = 200;

/// Part of the largest stable step that is proposed.
pub const SAFE: f64 = 0.8;

/// What is asked about.
#[derive(Clone, Copy)]
pub struct Question<'a> {
    /// The model.
    pub model: &'a Model,
    /// Its step.
    pub graph: &'a StepGraph,
    /// How it is computed.
    pub point: &'a DesignPoint,
    /// What it is judged over.
    pub criteria: &'a Criteria,
    /// Word widths.
    pub format: WordFormat,
    /// Method error that the accuracy step is for; none if that is not asked.
    pub goal: Option<f64>,
}

/// A step with two digits, as it can be typed; never larger than asked for.
pub fn rounded(step: f64) -> f64 {
    let unit = libm::pow(10.0, libm::floor(libm::log10(step)) - 1.0);
    let text = format!("{:.1e}", libm::floor(step / unit * (1.0 + 1e-9)) * unit);
    text.parse().unwrap_or(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_rounded_down_to_what_can_be_typed() {
        assert_eq!([1.279e-3, 0.1, 4e-4, 9.99e-7, 3.0].map(rounded), [1.2e-3, 0.1, 4e-4, 9.9e-7, 3.0]);
    }
}
