//! Judges a folder that `compile` wrote by running its files, and measures what that judgement is worth.
//!
//! [`judge`] compares every engine with the simulator, bit for bit; [`inject`] damages copies of the folder and counts
//! what is caught; [`native`] measures the generated native program. [`engines`] builds and runs GHDL, Verilator and
//! the Rust reference.

mod child;
pub mod climb;
pub mod coverage;
pub mod engines;
pub mod folder;
pub mod handshake;
pub mod host;
pub mod inject;
pub mod judge;
pub mod native;
mod pace;
pub mod package;
mod scratch;
pub mod stimuli;

pub use scratch::Scratch;
