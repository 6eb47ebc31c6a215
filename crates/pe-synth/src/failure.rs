//! Why a command did not succeed, and the exit code that says so.

use std::fmt::Display;
use std::path::Path;
use std::process::ExitCode;

use pe_ir::source::{Diagnostic, Position, Sources};
use serde_json::json;

/// A command's failure; every kind has an exit code of its own (see the README).
#[derive(Debug)]
pub enum Failure {
    /// The spec is wrong, or its result would be: findings and the texts they refer to.
    Spec(Vec<Diagnostic>, Sources),
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
}

impl Failure {
    /// A file operation failed.
    pub fn file(action: &str, path: &Path, error: impl Display) -> Failure {
        Failure::File(format!("cannot {action} {}: {error}", path.display()))
    }

    /// The process's exit code.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Failure::Spec(..) => 1,
            Failure::Usage(_) => 2,
            Failure::File(_) => 3,
            Failure::Mismatch(_) => 4,
            Failure::MissingTool(_) => 5,
            Failure::Internal(_) => 70,
        })
    }

    /// Prints the failure to standard error.
    pub fn print(&self, format: MessageFormat) {
        match self {
            Failure::Spec(findings, sources) => print_findings(findings, sources, format),
            Failure::Usage(text) | Failure::File(text) | Failure::Mismatch(text) | Failure::MissingTool(text) => {
                print_line(text, format);
            }
            Failure::Internal(text) => print_line(&format!("internal error, please report it: {text}"), format),
        }
    }
}

/// How findings are printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum MessageFormat {
    /// For people, with the line and a caret.
    #[default]
    Human,
    /// One JSON object per line.
    Json,
}

fn print_line(text: &str, format: MessageFormat) {
    match format {
        MessageFormat::Human => eprintln!("error: {text}"),
        MessageFormat::Json => eprintln!("{}", json!({"severity": "error", "message": text})),
    }
}

/// Prints findings of the spec.
pub fn print_findings(findings: &[Diagnostic], sources: &Sources, format: MessageFormat) {
    for finding in findings {
        match format {
            MessageFormat::Human => eprint!("{}", finding.render(sources)),
            MessageFormat::Json => eprintln!("{}", as_json(finding, sources)),
        }
    }
    let errors = findings.iter().filter(|finding| finding.severity == pe_ir::source::Severity::Error).count();
    if errors > 0 && format == MessageFormat::Human {
        let code = findings.iter().find(|f| f.severity == pe_ir::source::Severity::Error).map_or("", |f| f.code);
        eprintln!("{errors} error(s); `pe-synth explain {code}` tells more");
    }
}

fn as_json(finding: &Diagnostic, sources: &Sources) -> serde_json::Value {
    let place = |span: pe_ir::source::Span| {
        let Position { file, line, column } = sources.position(span.start);
        json!({"file": file, "line": line, "column": column, "start": span.start, "end": span.end})
    };
    let labels: Vec<_> =
        finding.labels.iter().map(|(span, text)| json!({"place": place(*span), "text": text})).collect();
    json!({
        "severity": if finding.severity == pe_ir::source::Severity::Error { "error" } else { "warning" },
        "code": finding.code,
        "message": finding.message,
        "place": finding.span.map(place),
        "labels": labels,
        "help": finding.help,
    })
}
