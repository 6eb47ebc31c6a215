//! The data that the stages of pe-synth exchange, and the rules that belong to the data alone.
//!
//! Modules in pipeline order; each uses only those before it: [`source`], [`codes`], [`model`], [`word`], [`graph`],
//! [`mapping`], [`schedule`], [`memory`], [`program`], [`verify`].

pub mod codes;
mod expr;
pub mod functions;
mod gradient;
pub mod graph;
pub mod mapping;
pub mod memory;
pub mod model;
pub mod program;
pub mod schedule;
pub mod source;
mod stability;
pub mod verify;
mod waveform;
pub mod word;
