//! The result of the check.

use pe_ir::source::Diagnostic;

use crate::pivots::SmallestPivot;

use super::observed::{Chaos, DeadBand, StepGrowth};
use super::prediction::Prediction;
use super::rest::Rest;
use super::swinging::Swing;
use super::trials::{Accuracy, Found};

/// What was found about a model and its step.
pub struct Check {
    /// What eigenvalues say.
    pub prediction: Prediction,
    /// Whether the model was linearised along the run of its own step.
    pub own_trajectory: bool,
    /// The end of the stable steps by trial.
    pub found: Option<Found>,
    /// Step for the accuracy asked for, and its method error.
    pub accuracy: Option<Accuracy>,
    /// The stable step that accuracy is compared with, by trial or by eigenvalues, in seconds.
    pub stable: Option<f64>,
    /// How many times the stable step accuracy would allow.
    pub stiffness_ratio: Option<f64>,
    /// Growth of one step, with exact and rounded coefficients.
    pub growth: Option<StepGrowth>,
    /// Growth of differences along the run of the implicit step of a mechanism, in the place of that.
    pub swing: Option<Swing>,
    /// The smallest pivot of an implicit method.
    pub pivot: Option<SmallestPivot>,
    /// States that lose increments.
    pub dead_bands: Vec<DeadBand>,
    /// Whether sampled parts come to rest without inputs; none of models without any.
    pub rest: Option<Rest>,
    /// Whether the model is chaotic; only found when the accuracy is asked for.
    pub chaos: Option<Chaos>,
    /// Time from which on a step that was refused and half of it go different ways, in seconds.
    pub parted: Option<f64>,
    /// All findings, warnings and refusals, those of the runs among them.
    pub findings: Vec<Diagnostic>,
}
