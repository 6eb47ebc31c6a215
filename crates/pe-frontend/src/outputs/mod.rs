//! The pass that finds the outputs.

pub(crate) mod item;
pub(crate) mod observed;
pub(crate) mod spec;
