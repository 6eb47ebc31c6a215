//! Failures and findings as the user reads them, on standard error.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError};

use pe_flow::failure::Failure;
use pe_ir::source::{Diagnostic, Severity, Sources};
use serde_json::json;

use crate::{console, render};

/// Prints a failure to standard error.
pub fn print_failure(failure: &Failure, format: MessageFormat) {
    match failure {
        Failure::Spec(findings, sources) => print_findings(findings, sources, format),
        Failure::Fruitless(text)
        | Failure::Usage(text)
        | Failure::File(text)
        | Failure::Mismatch(text)
        | Failure::MissingTool(text)
        | Failure::Interrupted(text) => print_plain(failure.kind(), text, None, format),
        Failure::Internal(text) => {
            let help = "this is a bug of pe-synth; please report it with the command and the spec";
            print_plain(failure.kind(), &format!("internal error: {text}"), Some(help), format);
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
