//! The parser that pest makes of the grammar.

use pest_derive::Parser;

#[derive(Parser)]
#[grammar = "grammar/ode.pest"]
pub(crate) struct OdeParser;
