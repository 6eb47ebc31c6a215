//! Findings as the editor shows them, each in the file that it is about.

use crate::keys::Key;
use crate::view::View;
use gen_lsp_types::{
    Code, Diagnostic as Shown, DiagnosticRelatedInformation, DiagnosticSeverity, DiagnosticTag, Message, Position,
    Range,
};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Severity};
use std::collections::BTreeMap;

/// Who says it.
const SOURCE: &str = "pe-synth";

/// Findings of a model by file; those about the whole model are at the beginning of its main file.
pub(crate) fn by_file(view: &View, findings: &[Diagnostic]) -> BTreeMap<Key, Vec<Shown>> {
    let mut files: BTreeMap<Key, Vec<Shown>> = BTreeMap::new();
    for finding in findings {
        let (file, shown) = shown(view, finding);
        files.entry(view.key(file)).or_default().push(shown);
    }
    files
}

/// A finding and the number of its file.
pub(crate) fn shown(view: &View, finding: &Diagnostic) -> (usize, Shown) {
    let (file, range) = finding.span.map_or((0, Range::default()), |span| view.range(span));
    let related = finding
        .labels
        .iter()
        .map(|(span, text)| DiagnosticRelatedInformation { location: view.location(*span), message: text.clone() });
    let related: Vec<DiagnosticRelatedInformation> = related.collect();
    let help = finding.help.as_ref().map(|help| format!("\nhelp: {help}")).unwrap_or_default();
    let severity = match finding.severity {
        Severity::Error => DiagnosticSeverity::Error,
        Severity::Warning => DiagnosticSeverity::Warning,
    };
    let shown = Shown {
        range,
        severity: Some(severity),
        code: Some(Code::String(finding.code.to_owned())),
        source: Some(SOURCE.to_owned()),
        message: Message::String(finding.message.clone() + &help),
        related_information: (!related.is_empty()).then_some(related),
        tags: (finding.code == codes::UNUSED).then(|| vec![DiagnosticTag::Unnecessary]),
        ..Shown::default()
    };
    (file, shown)
}

/// Something to know about a file as a whole.
pub(crate) fn note(text: &str, severity: DiagnosticSeverity) -> Shown {
    let start = Position { line: 0, character: 0 };
    Shown {
        range: Range { start, end: start },
        severity: Some(severity),
        source: Some(SOURCE.to_owned()),
        message: Message::String(text.to_owned()),
        ..Shown::default()
    }
}
