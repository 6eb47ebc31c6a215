//! Binds the names of an expression, once per statement, so that evaluation looks up none.

mod data;
mod matrix;
pub(crate) mod resolver;
pub(crate) mod rows;
mod samples;
