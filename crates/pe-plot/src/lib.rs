//! Pictures as SVG text, drawn from plain data.
//!
//! What goes in are numbers and names, what comes out is the text of an SVG file: the same data give the same bytes,
//! and no name, however odd, leaves its place as text. All pictures share the fonts, tones and sizes of [`style`];
//! what they distinguish they distinguish by shape, dash and lightness, so that they can be printed in black and white.

pub mod axis;
pub mod canvas;
pub mod chart;
pub mod layout;
pub mod network;
pub mod occupancy;
pub mod ranges;
pub mod raster;
pub mod style;
