//! A language server for specs: what editors show while a spec is being written.
//!
//! Speaks the Language Server Protocol over two streams of bytes. Text comes in with every key press; findings, hover,
//! definitions, renaming and completion go out. Findings are those of the command line: the same front end computes
//! them, from what is open in the editor where that differs from the disk.
//!
//! ```text
//! transport  bytes <-> messages; what is no message is answered and skipped
//! server     one loop over messages and results: open texts, which models they belong to, answers
//! view       a model as the syntax tree has it; requests are answered from it at once
//! worker     a thread that elaborates the models that changed last, and one that runs them when nothing is typed
//! ```
//!
//! Nothing here prints or knows options, and no message ends the server but `exit` and the end of the stream.

mod capabilities;
mod files;
mod findings;
mod keys;
mod requests;
mod server;
mod text;
mod transport;
mod view;
mod worker;

use std::io::{BufRead, Write};

/// How a session ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The editor asked for it with `shutdown` before.
    Orderly,
    /// `exit` or the end of the stream came without `shutdown`.
    Abruptly,
}

/// Serves an editor until it says `exit` or closes the stream. `input` is read and `output` written by a thread each.
pub fn serve(input: impl BufRead + Send + 'static, output: impl Write + Send + 'static) -> Ended {
    server::run(input, output)
}
