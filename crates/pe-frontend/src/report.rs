//! Collects diagnostics, with a limit on their number.

use crate::fault::Fault;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Severity, Span};

/// Findings shown per run and severity; more help nobody.
const MOST: usize = 100;

/// The findings of one stage.
#[derive(Debug, Default)]
pub(crate) struct Report {
    findings: Vec<Diagnostic>,
    errors: usize,
    warnings: usize,
    /// Whether the work limit has been reported; it concerns every later expression.
    out_of_work: bool,
}

impl Report {
    /// Takes a finding; beyond the cap it is only counted.
    pub(crate) fn push(&mut self, finding: Diagnostic) {
        let count = match finding.severity {
            Severity::Error => &mut self.errors,
            Severity::Warning => &mut self.warnings,
        };
        *count += 1;
        if *count <= MOST {
            self.findings.push(finding);
        }
    }

    /// The value of a result; its fault is reported after `dress` has told more about its place.
    pub(crate) fn settle<T>(
        &mut self,
        result: Result<T, Fault>,
        dress: impl FnOnce(Diagnostic) -> Diagnostic,
    ) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(Fault::Report(diagnostic)) => {
                let about_work = diagnostic.code == codes::TOO_MUCH_WORK;
                if !(about_work && std::mem::replace(&mut self.out_of_work, about_work)) {
                    self.push(dress(*diagnostic));
                }
                None
            }
            // Only constants wait for one another, and what has no value by now has been reported.
            Err(Fault::Silent | Fault::Missing(..)) => None,
        }
    }

    /// Whether the work limit has been met, after which evaluating on is pointless.
    pub(crate) fn is_exhausted(&self) -> bool {
        self.out_of_work
    }

    /// Whether something of a code was found at a place.
    pub(crate) fn tells(&self, code: &str, span: Span) -> bool {
        self.findings.iter().any(|finding| finding.code == code && finding.span == Some(span))
    }

    /// Number of findings so far.
    pub(crate) fn count(&self) -> usize {
        self.findings.len()
    }

    /// Adds a place to all findings but the first `count`.
    pub(crate) fn label_from(&mut self, count: usize, span: Span, text: &str) {
        self.findings[count..].iter_mut().for_each(|finding| finding.labels.push((span, text.to_owned())));
    }

    /// Whether an error was found.
    pub(crate) fn failed(&self) -> bool {
        self.errors > 0
    }

    /// The findings in source order, those about the whole model last.
    pub(crate) fn finish(mut self) -> Vec<Diagnostic> {
        sort(&mut self.findings);
        if self.errors > MOST {
            let message = format!("{} more errors are not shown", self.errors - MOST);
            self.findings.push(Diagnostic::global(codes::TOO_MANY_ERRORS, message));
        }
        self.findings
    }
}

/// Sorts findings by place, those about the whole model last; equal places keep their order.
pub fn sort(findings: &mut [Diagnostic]) {
    findings.sort_by_key(|finding| finding.span.map_or((true, 0), |span| (false, span.start)));
}
