//! The pass that writes whole arrays with subscripts, so that no later pass sees them.

pub(crate) mod algebra;
pub(crate) mod write;
