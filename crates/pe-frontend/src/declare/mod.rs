//! Passes over declarations: what is known before any equation.

pub(crate) mod constants;
pub(crate) mod initial;
pub(crate) mod overrides;
pub(crate) mod settings;
pub(crate) mod sizes;
pub(crate) mod times;
