//! Evaluates bound expressions for given index values.

mod delays;
mod elementary;
pub(crate) mod evaluator;
mod fold;
pub(crate) mod signals;
mod systems;
