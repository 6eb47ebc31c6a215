//! Passes over equations: written out for all elements, sampled parts held, algebraic ones put in order.

pub(crate) mod constrained;
pub(crate) mod events;
pub(crate) mod order;
pub(crate) mod pattern;
pub(crate) mod sampled;
pub(crate) mod systems;
pub(crate) mod write;
