//! Text to syntax tree: files, words, statements, expressions. No name is looked up here.

pub mod ast;
mod errors;
pub(crate) mod files;
mod grammar;
mod lexer;
mod parser;
pub(crate) mod reader;
mod statements;
pub(crate) mod tables;
