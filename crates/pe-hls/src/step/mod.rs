//! Builds the step graph: one solver step of a model as chains of products.

mod build;
mod polynomial;
mod prune;
mod sharing;

pub use build::build;
