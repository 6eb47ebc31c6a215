//! Written by `cargo run -p pe-synth --example fit_area`; do not edit.

/// Look-up tables per unit of each of `LUT_TERMS`.
pub const LUT: [f64; 8] = [0.99, 0.997, 1.064, 0.972, 4.001, 1.999, 0.837, 16.001];

/// Root mean square of the relative residuals of look-up tables.
pub const LUT_DEVIATION: f64 = 0.0197;

/// Flip-flops per unit of each of `FF_TERMS`.
pub const FF: [f64; 6] = [1.06, 0.943, 0.922, 1.004, 0.801, 1.998];

/// Root mean square of the relative residuals of flip-flops.
pub const FF_DEVIATION: f64 = 0.0187;

/// Measured PEs with each of `TRAITS`.
pub const SHAPES: [u32; 14] = [4, 3, 0, 2, 0, 2, 3, 1, 2, 2, 3, 3, 0, 0];

/// Look-up tables per bit that a deep pipeline chooses in tables of their own.
pub const DEEP_LUT: f64 = 0.912;

/// Root mean square of the relative residuals of the look-up tables of deep PEs.
pub const DEEP_LUT_DEVIATION: f64 = 0.0378;

/// Flip-flops per bit of second registers of a deep pipeline.
pub const DEEP_FF: f64 = 1.047;

/// Root mean square of the relative residuals of the flip-flops of deep PEs.
pub const DEEP_FF_DEVIATION: f64 = 0.0095;
