//! Evaluates bound expressions for given index values.

mod elementary;
pub(crate) mod evaluator;
mod fold;
mod guards;
pub(crate) mod signals;
mod systems;
