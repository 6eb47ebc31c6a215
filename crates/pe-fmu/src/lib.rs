//! Functional mock-up units for co-simulation, FMI 2.0 and 3.0.
//!
//! An FMU is an archive: a description, [`pack`]ed from a design's map, the folder of the design, and the shared library
//! that this crate is. The library serves both versions and knows no model: at run time it opens the folder as any other
//! host does, by the transport that the parameter `transport` names.

mod c;
mod fmi2;
mod fmi3;
mod instance;
mod package;
mod saved;
mod variables;

pub use package::{Error, Version, pack};
