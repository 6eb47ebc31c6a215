//! The names of a spec and what is known of them.

pub(crate) mod collect;
pub(crate) mod table;
