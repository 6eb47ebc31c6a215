//! Resources of a design on a device: its cells, and its clock.
//!
//! [`area`] estimates the cells of a program for a family of devices, [`clock`] its frequency, [`devices`] holds the
//! figures of data sheets against both. Everything rests on measured networks and on nothing but the program.

pub mod area;
pub mod clock;
pub mod devices;
