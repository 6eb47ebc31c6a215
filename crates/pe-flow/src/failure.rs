//! Failures of a command, and their exit codes.

use std::fmt::Display;
use std::path::Path;
use std::process::ExitCode;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Severity, Sources};

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

    /// No design meets the goals: which of them is out of reach and by how much, and what would help.
    pub fn out_of_reach(message: impl Into<String>, help: impl Into<String>, sources: &Sources) -> Failure {
        let finding = Diagnostic::global(codes::OUT_OF_REACH, message).with_help(help);
        Failure::Spec(vec![finding], sources.clone())
    }

    /// Why a design, of several that are tried, is not the one: [`Failure::out_of_reach`], or a reason without a code.
    pub fn why_not(&self) -> Option<&str> {
        match self {
            Failure::Fruitless(text) => Some(text),
            Failure::Spec(findings, _) if findings[0].code == codes::OUT_OF_REACH => Some(&findings[0].message),
            _ => None,
        }
    }

    /// The text of a failure that has no findings; those say themselves what is wrong, and where.
    pub fn text(&self) -> Option<&str> {
        match self {
            Failure::Spec(..) => None,
            Failure::Fruitless(text)
            | Failure::Usage(text)
            | Failure::File(text)
            | Failure::Mismatch(text)
            | Failure::MissingTool(text)
            | Failure::Internal(text)
            | Failure::Interrupted(text) => Some(text),
        }
    }

    /// The first error among the findings.
    pub fn finding(&self) -> Option<&Diagnostic> {
        match self {
            Failure::Spec(findings, _) => findings.iter().find(|finding| finding.severity == Severity::Error),
            _ => None,
        }
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
    pub fn kind(&self) -> &'static str {
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
}
