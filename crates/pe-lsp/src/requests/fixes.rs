//! Changes that mend a finding: what its help says, where that is one text to write in the place of the finding.
//!
//! Each is tried out first. One is offered only if the spec then has fewer errors and none that it did not have.

use crate::files::{Document, Texts};
use crate::findings;
use crate::view::View;
use gen_lsp_types::{CodeAction, CodeActionKind, Range, TextEdit, Uri, WorkspaceEdit};
use pe_frontend::{Overrides, examine, sort};
use pe_ir::source::{Diagnostic, Severity, Span};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Findings that are looked at.
const MOST: usize = 4;

/// Fixes of the findings in a range of a file.
pub(crate) fn fixes(view: &View, found: &[Diagnostic], file: usize, range: Range) -> Vec<CodeAction> {
    let (from, to) = (view.offset(file, range.start), view.offset(file, range.end));
    let near = |span: &Span| span.start <= to && from <= span.end && view.file_at(span.start) == file;
    let mut actions = Vec::new();
    for finding in found.iter().filter(|finding| finding.severity == Severity::Error) {
        let (Some(span), Some(help)) = (finding.span.filter(near), &finding.help) else { continue };
        let Some(new) = written(help, view.words(span)) else { continue };
        if actions.len() >= MOST || !mends(view, found, span, &new) {
            continue;
        }
        let location = view.location(span);
        let title = format!("Write `{new}`");
        let edits = vec![TextEdit { range: location.range, new_text: new }];
        actions.push(CodeAction {
            title,
            kind: Some(CodeActionKind::QuickFix),
            diagnostics: Some(vec![findings::shown(view, finding).1]),
            is_preferred: Some(true),
            edit: Some(WorkspaceEdit {
                changes: Some(HashMap::from([(Uri(location.uri.0), edits)])),
                ..WorkspaceEdit::default()
            }),
            ..CodeAction::default()
        });
    }
    actions
}

/// The one text that a help says to write, in quotes where those stand.
fn written(help: &str, now: &str) -> Option<String> {
    let parts: Vec<&str> = help.split('`').collect();
    let [_, new, _] = parts.as_slice() else { return None };
    let quoted = now.starts_with('"') && !new.starts_with('"');
    Some(if quoted { format!("\"{new}\"") } else { (*new).to_owned() }).filter(|new| new != now)
}

/// Whether a text in the place of a span leaves fewer errors and adds none.
fn mends(view: &View, found: &[Diagnostic], span: Span, new: &str) -> bool {
    let mut texts = view.texts.clone();
    let file = view.file_at(span.start);
    let base = view.sources.files()[file].span().range().start;
    let mut text = view.text(file).to_owned();
    let Some(range) = span.range().start.checked_sub(base).map(|start| start..start + span.length()) else {
        return false;
    };
    if text.get(range.clone()).is_none() {
        return false;
    }
    text.replace_range(range, new);
    put(&mut texts, view, file, text);
    let Some(other) = View::read(&view.root, &texts) else { return false };
    let (before, after) = (errors(found), errors(&all_findings(&other)));
    let mut left = before.clone();
    let known = after.iter().all(|code| left.iter().position(|old| old == code).map(|at| left.remove(at)).is_some());
    known && after.len() < before.len()
}

/// Opens a file of a model with another text.
pub(crate) fn put(texts: &mut Texts, view: &View, file: usize, text: String) {
    let key = view.key(file);
    let (uri, version) = (texts.uri(&key), texts.get(&key).map_or(0, |document| document.version));
    texts.set(key, Document { uri, version, text: Arc::from(text) });
}

/// All that the front end finds in a model.
pub(crate) fn all_findings(view: &View) -> Vec<Diagnostic> {
    let mut found = view.findings.clone();
    found.extend(examine(&view.spec, &Overrides::default(), &Arc::new(AtomicBool::new(false))).findings);
    sort(&mut found);
    found
}

fn errors(findings: &[Diagnostic]) -> Vec<&'static str> {
    findings.iter().filter(|finding| finding.severity == Severity::Error).map(|finding| finding.code).collect()
}
