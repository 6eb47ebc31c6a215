//! What the language defines itself: words, functions, signals and units of time; and what other languages call them.

pub(crate) mod functions;
pub(crate) mod habits;
pub(crate) mod measures;
pub(crate) mod waveforms;
pub(crate) mod words;
