//! Text to syntax tree: files, words, statements, expressions. No name is looked up here.

pub mod ast;
pub(crate) mod delay;
mod errors;
pub(crate) mod files;
pub(crate) mod format;
mod grammar;
mod habits;
pub(crate) mod lexer;
mod operators;
mod parser;
mod quotients;
pub(crate) mod reader;
mod statements;
pub(crate) mod tables;
