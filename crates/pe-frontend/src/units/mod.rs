//! Units of measurement: what a unit text means, arithmetic with units, and the pass that checks them.

pub(crate) mod check;
pub(crate) mod dimension;
pub(crate) mod known;
pub(crate) mod parse;
