//! The command line of pe-synth: options, printing, and everything that touches files.
//!
//! A library so that tests and other tools can run single stages; `main.rs` only parses arguments.

pub mod accuracy;
pub mod check;
pub mod cmd_accuracy;
pub mod cmd_bench;
pub mod cmd_check;
pub mod cmd_compile;
pub mod cmd_diff;
pub mod cmd_dump;
pub mod cmd_explain;
pub mod cmd_explore;
pub mod cmd_fmt;
pub mod cmd_fmu;
pub mod cmd_golden;
pub mod cmd_import;
pub mod cmd_lsp;
pub mod cmd_new;
pub mod cmd_rates;
pub mod cmd_serve;
pub mod cmd_shell;
pub mod cmd_sim;
pub mod cmd_verify;
pub mod cmd_wrap;
pub mod command;
pub mod compiled;
pub mod console;
pub mod explore;
pub mod figures;
pub mod foreign;
pub mod import;
pub mod messages;
pub mod options;
pub mod origin;
pub mod output;
pub mod page;
pub mod pictures;
pub mod progress;
pub mod render;
pub mod rerun;
pub mod waveforms;
