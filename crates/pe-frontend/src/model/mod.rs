//! The last passes: names that nothing uses, the model of what the outputs depend on, and angles in it.

pub(crate) mod angles;
pub(crate) mod assemble;
pub(crate) mod consistent;
mod contradiction;
pub(crate) mod delays;
pub(crate) mod events;
mod moving;
pub(crate) mod unused;
