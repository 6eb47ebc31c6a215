//! Runs a model at every level, from double precision to single clock cycles.
//!
//! * [`double`]: the step graph in double precision, the yardstick of ranges and errors;
//! * [`rounded`]: the same with coefficients rounded in several ways, side by side;
//! * [`fixed`]: the step graph in fixed point, what the hardware computes;
//! * [`roomy`]: the same without the ends of ranges, how far rounding carries values;
//! * [`machine`]: the program, control word by control word, what the hardware does;
//! * [`clocked`]: the same register by register, and what of it was at work;
//! * [`native`]: the step graph as loops for the computer at hand;
//! * [`reference`]: the model's equations by a library for differential equations, what is right;
//! * [`linear`]: the model and its Jacobian at a point;
//! * [`spectrum`]: the eigenvalues of a matrix;
//! * [`error`], [`compared`]: comparison of runs, at sample times and at every step.

pub mod clocked;
pub mod compared;
pub mod coverage;
pub mod double;
pub mod error;
pub mod fixed;
mod functions;
mod lanes;
pub mod linear;
pub mod machine;
pub mod native;
mod record;
pub mod reference;
pub mod roomy;
pub mod rounded;
mod rows;
mod slots;
pub mod spectrum;
mod tape;
mod tiles;
pub mod trace;
mod words;
