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
    lut: [0.99, 1.0, 0.997, 1.064, 0.972, 4.001, 1.999, 0.837, 1.0, 16.001],
    lut_deviation: 0.0197,
    ff: [1.06, 0.943, 0.922, 1.004, 0.801, 1.998],
    ff_deviation: 0.0187,
    shapes: [4, 3, 0, 2, 0, 2, 3, 1, 2, 2, 3, 3, 0, 0],
    deep_lut: 0.912,
    deep_lut_deviation: 0.0378,
    deep_ff: 1.047,
    deep_ff_deviation: 0.0095,
};

/// Lattice ECP5.
pub const ECP5: Fitted = Fitted {
    lut: [0.993, 1.034, 0.994, 1.023, 1.056, 4.0, 2.0, 1.037, 1.027, 45.0],
    lut_deviation: 0.0261,
    ff: [1.056, 1.003, 0.977, 1.0, 0.937, 1.999],
    ff_deviation: 0.0137,
    shapes: [2, 1, 4, 9, 1, 2, 0, 2, 2, 7, 4, 2, 0, 4],
    deep_lut: 0.0,
    deep_lut_deviation: 0.0595,
    deep_ff: 1.023,
    deep_ff_deviation: 0.0064,
};

/// Gowin GW1N and GW2A.
pub const GOWIN: Fitted = Fitted {
    lut: [0.942, 1.21, 1.196, 1.1, 1.052, 4.001, 2.0, 0.999, 1.135, 45.003],
    lut_deviation: 0.0377,
    ff: [1.038, 0.977, 0.963, 1.0, 0.956, 2.0],
    ff_deviation: 0.0140,
    shapes: [2, 1, 4, 3, 1, 2, 0, 2, 2, 2, 2, 2, 0, 0],
    deep_lut: 0.0,
    deep_lut_deviation: 0.0648,
    deep_ff: 1.037,
    deep_ff_deviation: 0.0082,
};
