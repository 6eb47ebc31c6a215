//! Why a command did not succeed, and the exit code that says so.

use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use pe_ir::source::{Diagnostic, Severity, Sources};
use serde_json::json;

use crate::{console, render};

/// A command's failure; every kind has an exit code of its own (see the README).
#[derive(Debug)]
pub enum Failure {
    /// The spec is wrong, or its result would be: findings and the texts they refer to.
    Spec(Vec<Diagnostic>, Sources),
    /// Every one of several models or points is wrong, each for its own reason.
    Fruitless(String),
    /// The options do not go together. Exit code 2, as for options that do not exist.
    Usage(String),
    /// A file could not be read or written.
    File(String),
    /// Engines disagree, or nothing was compared.
    Mismatch(String),
    /// A program that the command needs is not installed.
    MissingTool(String),
    /// The program found its own result to be wrong.
    Internal(String),
    /// The user ended a command that can be continued; 128 and the number of the signal, as shells do.
    Interrupted(String),
}

impl Failure {
    /// Exit code of [`Failure::Internal`].
    pub const INTERNAL: u8 = 70;

    /// A file operation failed.
    pub fn file(action: &str, path: &Path, error: impl Display) -> Failure {
        Failure::File(format!("cannot {action} {}: {error}", path.display()))
    }

    /// The process's exit code.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.code())
    }

    /// The number of the exit code.
    pub fn code(&self) -> u8 {
        match self {
            Failure::Spec(..) | Failure::Fruitless(_) => 1,
            Failure::Usage(_) => 2,
            Failure::File(_) => 3,
            Failure::Mismatch(_) => 4,
            Failure::MissingTool(_) => 5,
            Failure::Internal(_) => Failure::INTERNAL,
            Failure::Interrupted(_) => 130,
        }
    }

    /// What kind of failure it is, as tools read it.
    fn kind(&self) -> &'static str {
        match self {
            Failure::Spec(..) | Failure::Fruitless(_) => "model",
            Failure::Usage(_) => "usage",
            Failure::File(_) => "file",
            Failure::Mismatch(_) => "mismatch",
            Failure::MissingTool(_) => "missing-tool",
            Failure::Internal(_) => "internal",
            Failure::Interrupted(_) => "interrupted",
        }
    }

    /// Prints the failure to standard error.
    pub fn print(&self, format: MessageFormat) {
        match self {
            Failure::Spec(findings, sources) => print_findings(findings, sources, format),
            Failure::Fruitless(text)
            | Failure::Usage(text)
            | Failure::File(text)
            | Failure::Mismatch(text)
            | Failure::MissingTool(text)
            | Failure::Interrupted(text) => print_plain(self.kind(), text, None, format),
            Failure::Internal(text) => {
                let help = "this is a bug of pe-synth; please report it with the command and the spec";
                print_plain(self.kind(), &format!("internal error: {text}"), Some(help), format);
            }
        }
    }
}

/// Runs a command; a panic is a bug and becomes an internal error.
pub fn guarded<T>(command: impl FnOnce() -> T) -> Result<T, Failure> {
    static LAST: Mutex<String> = Mutex::new(String::new());
    // Whoever asks for a backtrace gets it, from the hook that prints it.
    let silent = std::env::var_os("RUST_BACKTRACE").is_none();
    if silent {
        std::panic::set_hook(Box::new(|panic| {
            let text = panic.to_string().lines().collect::<Vec<_>>().join(" ");
            *LAST.lock().unwrap_or_else(PoisonError::into_inner) = text;
        }));
    }
    let outcome = catch_unwind(AssertUnwindSafe(command));
    if silent {
        drop(std::panic::take_hook());
    }
    outcome.map_err(|_| {
        let text = std::mem::take(&mut *LAST.lock().unwrap_or_else(PoisonError::into_inner));
        Failure::Internal(if text.is_empty() { "a panic".to_owned() } else { text })
    })
}

/// Codes that the last line after errors names.
const SHOWN_CODES: usize = 4;

/// How findings are printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum MessageFormat {
    /// For people, with the line and a caret.
    #[default]
    Human,
    /// One JSON object per line.
    Json,
}

/// Prints an error that is not about the text of a spec.
pub fn print_plain(kind: &str, message: &str, help: Option<&str>, format: MessageFormat) {
    console::err(&match format {
        MessageFormat::Human => {
            let help = help.map_or_else(String::new, |help| format!("  = help: {help}\n"));
            format!("error: {message}\n{help}")
        }
        MessageFormat::Json => {
            let object = json!({"severity": "error", "kind": kind, "code": null, "message": message, "file": null,
                                "place": null, "labels": [], "help": help});
            format!("{object}\n")
        }
    });
}

/// Prints findings of the spec.
pub fn print_findings(findings: &[Diagnostic], sources: &Sources, format: MessageFormat) {
    for finding in findings {
        console::err(&match format {
            MessageFormat::Human => render::for_people(finding, sources),
            MessageFormat::Json => format!("{}\n", render::for_tools(finding, sources)),
        });
    }
    let mut codes: Vec<&str> = findings.iter().filter(|f| f.severity == Severity::Error).map(|f| f.code).collect();
    let errors = codes.len();
    if errors > 0 && format == MessageFormat::Human {
        codes.sort_unstable();
        codes.dedup();
        let more = if codes.len() > SHOWN_CODES { " ..." } else { "" };
        let codes = codes[..codes.len().min(SHOWN_CODES)].join(" ");
        let noun = if errors == 1 { "error" } else { "errors" };
        console::err(&format!("{errors} {noun}; `pe-synth explain CODE` tells more about {codes}{more}\n"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_internal_error() {
        assert!(matches!(guarded(|| 3), Ok(3)));
        let failure = guarded(|| panic!("out of words")).map(|()| 0);
        assert!(matches!(failure, Err(Failure::Internal(text)) if !text.is_empty()));
    }
}
