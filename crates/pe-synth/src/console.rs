//! Standard output and standard error.
//!
//! Colour reaches terminals only, and none of them where `NO_COLOR` is set. A closed pipe (`| head`) ends the output,
//! not the program: what a command writes to files does not depend on who reads along. Any other failure of standard output,
//! such as a full disk, is one of the command.

use std::io::{ErrorKind, Write};

use pe_flow::failure::Failure;

/// Prints to standard output.
///
/// # Errors
/// [`Failure::File`] if it cannot be written, unless nobody reads it any more.
pub fn out(text: &str) -> Result<(), Failure> {
    let mut stream = anstream::stdout().lock();
    match stream.write_all(text.as_bytes()).and_then(|()| stream.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::File(format!("cannot write standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints to standard error.
pub fn err(text: &str) {
    let mut stream = anstream::stderr().lock();
    let _ = stream.write_all(text.as_bytes()).and_then(|()| stream.flush());
}
