//! The pass that finds the outputs.

mod constants;
pub(crate) mod item;
pub(crate) mod observed;
pub(crate) mod spec;
