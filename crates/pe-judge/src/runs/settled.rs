//! Formats that were settled on, and what the run in them shows.

use pe_hls::rounding::Aim;
use pe_ir::graph::FixedPoint;
use pe_sim::compared::Compared;
use pe_sim::error::Trajectory;

use crate::proof::Proof;

use super::judged::Checkpoint;

/// Formats under which the span runs without saturation, and what they cost in accuracy.
pub struct Settled {
    pub(super) fixed: FixedPoint,
    /// What its roundings cancel in; none if they were given.
    pub(super) aim: Option<Aim>,
    pub(super) widenings: usize,
    pub(super) measured: Measured,
    /// What is proven of them; none if no proof was asked for.
    pub(super) proof: Option<Proof>,
}

impl Settled {
    /// The formats.
    pub fn fixed(&self) -> &FixedPoint {
        &self.fixed
    }

    /// Word-length error of the run: the worst state's largest deviation from the run in double precision.
    pub fn word_length(&self) -> f64 {
        self.measured.run.word.worst().1
    }
}

/// What a run in fixed point shows, and one in double precision with the same coefficients.
pub(super) struct Measured {
    pub run: Run,
    /// Quantised coefficients alone, in double precision.
    pub quantised: Compared,
}

/// What a run in fixed point shows.
pub(super) struct Run {
    /// States against double precision.
    pub word: Compared,
    /// Outputs against double precision.
    pub outputs: Compared,
    /// States at samples.
    pub hardware: Trajectory,
    /// States at the other steps that are looked at.
    pub looks: Trajectory,
    /// Outputs at samples.
    pub curves: Trajectory,
    pub checkpoint: Checkpoint,
    /// Time of the fixed-point run.
    pub seconds: f64,
}

impl Run {
    /// With the run of the same coefficients.
    pub fn with(self, quantised: Compared) -> Measured {
        Measured { run: self, quantised }
    }
}
