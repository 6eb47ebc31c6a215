//! Standard output and standard error.
//!
//! Colour reaches terminals only, and none of them where `NO_COLOR` is set. A closed pipe (`| head`) ends the output,
//! not the program: what a command writes to files does not depend on who reads along.

use std::io::Write;

/// Prints to standard output.
pub fn out(text: &str) {
    let mut stream = anstream::stdout().lock();
    let _ = stream.write_all(text.as_bytes()).and_then(|()| stream.flush());
}

/// Prints to standard error.
pub fn err(text: &str) {
    let mut stream = anstream::stderr().lock();
    let _ = stream.write_all(text.as_bytes()).and_then(|()| stream.flush());
}
