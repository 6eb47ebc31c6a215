//! The pass that writes whole arrays with subscripts, so that no later pass knows of them.

mod algebra;
pub(crate) mod write;
