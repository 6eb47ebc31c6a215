//! Independent checkers: each proves a stage's result from its predecessor, sharing no code with the stage.

pub mod fixed;
pub mod mapping;
pub mod model;
pub mod program;
pub mod ranges;
pub mod schedule;
pub mod step;
