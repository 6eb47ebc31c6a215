//! What the language defines itself: words, functions, signals and units of time.

pub(crate) mod functions;
pub(crate) mod measures;
pub(crate) mod waveforms;
pub(crate) mod words;
