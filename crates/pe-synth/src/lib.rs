//! The command line of pe-synth: options, the way through the stages, reports, and everything that touches files.
//!
//! A library so that tests and other tools can run single stages; `main.rs` only parses arguments.

pub mod accuracy;
pub mod area;
pub mod bottleneck;
pub mod check;
pub mod clock;
pub mod cmd_accuracy;
pub mod cmd_bench;
pub mod cmd_check;
pub mod cmd_compile;
pub mod cmd_diff;
pub mod cmd_dump;
pub mod cmd_explain;
pub mod cmd_explore;
pub mod cmd_golden;
pub mod cmd_shell;
pub mod cmd_sim;
pub mod cmd_verify;
pub mod command;
pub mod conserved;
pub mod console;
pub mod contest;
pub mod devices;
pub mod engines;
pub mod explore;
pub mod failure;
pub mod features;
pub mod figures;
pub mod files;
pub mod mapping_file;
pub mod options;
pub mod oscillation;
pub mod output;
pub mod pictures;
pub mod pipeline;
pub mod pivots;
pub mod render;
pub mod report;
pub mod runs;
pub mod scene;
pub mod slots;
pub mod tables;
pub mod total;
pub mod variables;
pub mod waveforms;
