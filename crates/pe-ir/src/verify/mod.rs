//! Independent checkers: each proves a stage's result from its predecessor, sharing no code with the stage.

pub mod mapping;
pub mod program;
pub mod ranges;
pub mod schedule;
