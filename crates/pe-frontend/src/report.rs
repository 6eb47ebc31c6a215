//! Collects diagnostics, with a limit on their number.

use crate::fault::Fault;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Severity, Span};
use std::borrow::Cow;

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
        for finding in &mut self.findings {
            let texts = std::iter::once(&mut finding.message).chain(&mut finding.help);
            for text in texts.chain(finding.labels.iter_mut().map(|(_, text)| text)) {
                if let Cow::Owned(written) = as_written(text) {
                    *text = written;
                }
            }
        }
        if self.errors > MOST {
            let message = format!("{} more errors are not shown", self.errors - MOST);
            self.findings.push(Diagnostic::global(codes::TOO_MANY_ERRORS, message));
        }
        self.findings
    }
}

/// Text with names as they are written: `cell.w` for the quantity `cell[].w` of all instances.
pub(crate) fn as_written(text: &str) -> Cow<'_, str> {
    let Some((first, rest)) = text.split_once('[') else { return Cow::Borrowed(text) };
    let mut written = first.to_owned();
    for part in rest.split('[') {
        match part.trim_start_matches(',').strip_prefix(']') {
            Some(behind) if behind.starts_with('.') => written += behind,
            _ => written.extend(["[", part]),
        }
    }
    if written.len() == text.len() { Cow::Borrowed(text) } else { Cow::Owned(written) }
}

/// Sorts findings by place, those about the whole model last; equal places keep their order.
pub fn sort(findings: &mut [Diagnostic]) {
    findings.sort_by_key(|finding| finding.span.map_or((true, 0), |span| (false, span.start)));
}

#[cfg(test)]
mod tests {
    use super::as_written;

    #[test]
    fn places_within_names_are_not_shown() {
        assert_eq!(as_written("`grid[,].cell[].w` of `a[1].v`, `[m]`, x[]"), "`grid.cell.w` of `a[1].v`, `[m]`, x[]");
        assert_eq!(as_written("no `name`"), "no `name`");
        assert_eq!(as_written("[].[,]."), "..");
    }
}
