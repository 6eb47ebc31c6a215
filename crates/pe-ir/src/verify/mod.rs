//! Independent checkers: each proves a pass's result from its input, sharing no code with the pass.

pub mod fixed;
pub mod mapping;
pub mod model;
pub mod program;
pub mod ranges;
mod rings;
pub mod schedule;
pub mod step;
