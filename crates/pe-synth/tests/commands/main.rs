//! The command line as its users meet it, and rules about the source tree.

#![allow(clippy::disallowed_methods, reason = "the tests' own numbers may come from the standard library")]

#[path = "../support/mod.rs"]
mod support;

mod accuracy;
mod bench;
mod cli;
mod console;
mod damage;
mod everyday;
mod explore;
mod foreign;
mod golden;
mod host;
mod import;
mod import_diffsl;
mod inject;
mod interruption;
mod library;
mod lsp;
mod map;
mod mapping_file;
mod options;
mod outputs;
mod python_options;
mod report;
mod store;
mod sweep;
mod tidy;
mod transports;
mod tunable;
mod wanted;
mod within;
mod wrap;
mod wrap_files;
