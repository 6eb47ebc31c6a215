//! From model to program: step graph, number formats, mapping, schedule, assembly.
//!
//! [`PASSES`] has the passes in the order in which `pe-flow` runs them. Each is a function of its module, and each has
//! cases of its own in `tests/passes`.

mod alike;
pub mod assemble;
pub mod formats;
pub mod functions;
pub mod fuse;
pub mod grid;
pub mod kinks;
pub mod lift;
pub mod mapping;
pub mod norms;
pub mod outputs;
pub mod pairs;
pub mod parts;
mod passes;
pub mod relay;
pub mod rings;
pub mod rounding;
pub mod rounds;
pub mod route;
pub mod schedule;
pub mod shorten;
pub mod split;
pub mod step;
pub mod sums;
pub mod two_slots;

pub use passes::{PASSES, Pass};
