//! Why a call failed.

use std::fmt;
use std::path::Path;
use std::time::Duration;

/// Why a call failed: `crate::faults` says what each kind means. Nothing fails without an answer within
/// [`Transport::timeout`](crate::Transport::timeout).
#[derive(Clone, Debug, PartialEq)]
pub enum Error {
    /// A file or device cannot be opened, read or written, or holds something else than it should.
    File(String),
    /// The transport is not understood.
    Transport(String),
    /// A program that the transport needs is not installed.
    MissingTool(String),
    /// A program that builds or simulates the network failed.
    Tool(String),
    /// What answers is another design: the hash in the map, and the one that was read.
    WrongHash {
        /// In the map, as far as it is compared.
        expected: String,
        /// Of what answers.
        found: String,
    },
    /// What answers is no register bank, or of another version than this program.
    Foreign(String),
    /// So many words or numbers are needed, so many were given.
    Count {
        /// Needed.
        needed: usize,
        /// Given.
        given: usize,
    },
    /// The number for this input is not a number.
    NotANumber(String),
    /// The word for this input or state does not fit its format.
    Range(String),
    /// The output has no value before the first step.
    NoSample(String),
    /// The network, or its wrapper, cannot do this.
    Lacks(&'static str),
    /// The bus answers an access by an error: its byte address.
    Refused(u32),
    /// A step took more clocks than the budget, and the run was stopped.
    TimeExceeded,
    /// A paced step was not ready in time, and the run was stopped.
    Overrun,
    /// There was no answer in this time.
    Late(String, Duration),
    /// The connection or the simulation is gone.
    Lost(String),
    /// An answer is damaged.
    Damaged(String),
}

impl Error {
    /// A file operation failed.
    pub(crate) fn file(action: &str, path: &Path, error: impl fmt::Display) -> Error {
        Error::File(format!("cannot {action} {}: {error}", path.display()))
    }

    /// What kind of error it is, as other languages see it.
    pub fn kind(&self) -> &'static str {
        match self {
            Error::File(_) => "file",
            Error::Transport(_) => "transport",
            Error::MissingTool(_) => "missing-tool",
            Error::Tool(_) => "tool",
            Error::WrongHash { .. } => "wrong-hash",
            Error::Foreign(_) => "foreign",
            Error::Count { .. } => "count",
            Error::NotANumber(_) => "not-a-number",
            Error::Range(_) => "range",
            Error::NoSample(_) => "no-sample",
            Error::Lacks(_) => "lacks",
            Error::Refused(_) => "refused",
            Error::TimeExceeded => "time-exceeded",
            Error::Overrun => "overrun",
            Error::Late(..) => "late",
            Error::Lost(_) => "lost",
            Error::Damaged(_) => "damaged",
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Error::File(what) | Error::Transport(what) | Error::MissingTool(what) | Error::Tool(what) => {
                write!(f, "{what}")
            }
            Error::WrongHash { expected, found } => {
                write!(
                    f,
                    "another design answers: its hash begins with {found:.16}, that of the map with {expected:.16}"
                )
            }
            Error::Foreign(what) => write!(f, "{what}"),
            Error::Count { needed, given } => write!(f, "{needed} values are needed, {given} were given"),
            Error::NotANumber(input) => write!(f, "input `{input}` is not a number"),
            Error::Range(name) => write!(f, "the word of `{name}` does not fit its format"),
            Error::NoSample(output) => write!(f, "output `{output}` has no value before the first step"),
            Error::Lacks(what) => write!(f, "there are no {what} here; ports for a host need `compile --host`"),
            Error::Refused(address) => write!(f, "the bus answers an access to {address:#05x} by an error"),
            Error::TimeExceeded => write!(f, "a step took more clocks than the budget; the run was stopped"),
            Error::Overrun => write!(f, "a paced step was not ready in time; the run was stopped"),
            Error::Late(what, after) => write!(f, "{what} within {} ms", after.as_millis()),
            Error::Lost(what) => write!(f, "{what}"),
            Error::Damaged(what) => write!(f, "{what}"),
        }
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::FAULTS;

    #[test]
    fn every_kind_is_in_the_fault_table_once() {
        let text = String::new;
        let all = [
            Error::File(text()),
            Error::Transport(text()),
            Error::MissingTool(text()),
            Error::Tool(text()),
            Error::WrongHash { expected: text(), found: text() },
            Error::Foreign(text()),
            Error::Count { needed: 0, given: 0 },
            Error::NotANumber(text()),
            Error::Range(text()),
            Error::NoSample(text()),
            Error::Lacks(""),
            Error::Refused(0),
            Error::TimeExceeded,
            Error::Overrun,
            Error::Late(text(), Duration::ZERO),
            Error::Lost(text()),
            Error::Damaged(text()),
        ];
        let mut kinds: Vec<&str> = all.iter().map(Error::kind).collect();
        let mut listed: Vec<&str> = FAULTS.iter().map(|fault| fault.kind).collect();
        kinds.sort_unstable();
        listed.sort_unstable();
        assert_eq!(kinds, listed);
    }
}
