//! The data that compiler stages exchange, and the rules that belong to the data alone.
//!
//! Modules in pipeline order; each uses only those before it: [`index`], [`element`], [`source`], [`codes`], [`model`],
//! [`coefficients`], [`place`], [`functions`], [`word`], [`graph`], [`mapping`], [`schedule`], [`memory`], [`program`],
//! [`verify`], [`text`].

pub mod cholesky;
pub mod closing;
pub mod codes;
pub mod coefficients;
mod complex;
pub mod element;
mod expr;
pub mod functions;
mod gradient;
pub mod graph;
pub mod index;
pub mod mapping;
pub mod mechanism;
pub mod memory;
pub mod model;
pub mod motion;
mod moved;
pub mod multiplier;
pub mod parts;
pub mod pasts;
pub mod place;
pub mod program;
pub mod schedule;
mod solution;
mod solver;
pub mod source;
mod stability;
mod state;
pub mod text;
pub mod turns;
pub mod verify;
mod waveform;
pub mod word;
