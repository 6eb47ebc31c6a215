//! Written by `cargo run -p pe-synth --example fit_area`; do not edit.

use super::{FF_TERMS, LUT_TERMS, TRAITS};

/// What was fitted to the measured PEs of a family.
#[derive(Debug)]
pub struct Fitted {
    /// LUTs per unit of each of [`LUT_TERMS`].
    pub lut: [f64; LUT_TERMS.len()],
    /// Root mean square of the relative residuals of LUTs.
    pub lut_deviation: f64,
    /// Flip-flops per unit of each of [`FF_TERMS`].
    pub ff: [f64; FF_TERMS.len()],
    /// Root mean square of the relative residuals of flip-flops.
    pub ff_deviation: f64,
    /// Measured PEs with each of [`TRAITS`].
    pub shapes: [u32; TRAITS.len()],
    /// LUTs per bit that a deep pipeline chooses in LUTs of their own.
    pub deep_lut: f64,
    /// Root mean square of the relative residuals of the LUTs of deep PEs.
    pub deep_lut_deviation: f64,
    /// Flip-flops per bit of second registers of a deep pipeline.
    pub deep_ff: f64,
    /// Root mean square of the relative residuals of the flip-flops of deep PEs.
    pub deep_ff_deviation: f64,
}

/// Xilinx 6 and 7 series, and LUTs of UltraScale+.
pub const XC6V: Fitted = Fitted {
    lut: [0.988, 1.0, 1.003, 1.043, 1.017, 4.0, 1.999, 0.837, 1.0, 16.0],
    lut_deviation: 0.0194,
    ff: [1.069, 0.942, 0.932, 1.003, 0.796, 1.998],
    ff_deviation: 0.0193,
    shapes: [4, 3, 0, 2, 0, 2, 3, 1, 2, 2, 3, 7, 0, 0],
    deep_lut: 0.909,
    deep_lut_deviation: 0.0372,
    deep_ff: 1.043,
    deep_ff_deviation: 0.0091,
};

/// Lattice ECP5.
pub const ECP5: Fitted = Fitted {
    lut: [0.997, 1.048, 0.99, 1.033, 0.975, 4.001, 2.0, 1.049, 1.038, 45.001],
    lut_deviation: 0.0267,
    ff: [1.061, 1.002, 0.978, 1.0, 0.935, 1.999],
    ff_deviation: 0.0129,
    shapes: [2, 1, 4, 9, 1, 2, 0, 2, 2, 7, 4, 6, 0, 4],
    deep_lut: 0.0,
    deep_lut_deviation: 0.0609,
    deep_ff: 1.022,
    deep_ff_deviation: 0.0062,
};

/// Gowin GW1N and GW2A.
pub const GOWIN: Fitted = Fitted {
    lut: [0.946, 1.202, 1.207, 1.106, 1.039, 4.001, 2.0, 0.998, 1.139, 45.003],
    lut_deviation: 0.0365,
    ff: [1.06, 0.981, 0.968, 1.0, 0.947, 1.999],
    ff_deviation: 0.0136,
    shapes: [2, 1, 4, 3, 1, 2, 0, 2, 2, 2, 2, 6, 0, 0],
    deep_lut: 0.0,
    deep_lut_deviation: 0.0661,
    deep_ff: 1.03,
    deep_ff_deviation: 0.0072,
};
