//! The last passes: names that nothing uses, and the model of what the outputs depend on.

pub(crate) mod assemble;
pub(crate) mod unused;
