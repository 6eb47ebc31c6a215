//! What can be written at a place.

use crate::requests::navigate::detail;
use crate::view::View;
use gen_lsp_types::{CompletionItem, CompletionItemKind as Kind, Position};
use pe_frontend::symbols::SymbolKind;
use pe_frontend::vocabulary::{self, WordKind};
use pe_ir::index::{self, number};
use pe_ir::model::Solver;

/// What can be written at a position of a file; the editor chooses among it by what stands there already.
pub(crate) fn items(view: &View, file: usize, position: Position) -> Vec<CompletionItem> {
    let offset = view.offset(file, position);
    let base = view.sources.files()[file].span().start;
    let text = view.text(file);
    let at = index::at(offset - base);
    let words = vocabulary::words(text);
    let inside = words.iter().find(|word| word.span.start < number(at) && number(at) <= word.span.end);
    let line_start = text[..at].rfind('\n').map_or(0, |found| found + 1);
    // What stands before the word that is being written.
    let before = text[line_start..at].trim_end_matches(|c: char| c.is_ascii_alphanumeric() || c == '_');
    match inside.map(|word| word.kind) {
        Some(WordKind::Comment) => return Vec::new(),
        Some(WordKind::Text) => return Vec::new(),
        _ if before.matches('"').count() % 2 == 1 => return Vec::new(),
        Some(WordKind::Unit) => return plain(vocabulary::units(), Kind::Unit, "unit"),
        _ if in_unit(before) => return plain(vocabulary::units(), Kind::Unit, "unit"),
        _ => {}
    }
    match before.trim() {
        "" => {
            let mut items = plain(vocabulary::statements().iter().copied(), Kind::Keyword, "statement");
            items.extend(plain(["time"].into_iter(), Kind::Keyword, "statement"));
            items.extend(names(view, offset));
            items
        }
        "solver" => {
            Solver::ALL.iter().map(|solver| item(solver.name(), Kind::EnumMember, solver.title().to_owned())).collect()
        }
        "units" => plain(vocabulary::modes(), Kind::EnumMember, "check of units"),
        // A name that does not exist yet.
        "model" | "const" | "param" | "input" | "state" | "angle" | "matrix" | "function" | "index" => Vec::new(),
        _ => expression(view, offset, before),
    }
}

/// What an expression is made of.
fn expression(view: &View, offset: u32, before: &str) -> Vec<CompletionItem> {
    let after_number = before.ends_with(' ') && before.trim_end().ends_with(|c: char| c.is_ascii_digit());
    let mut items = names(view, offset);
    if after_number {
        items.extend(plain(vocabulary::measures(), Kind::Unit, "unit of time or frequency"));
    }
    items.extend(vocabulary::functions().map(|call| item(call.name, Kind::Function, call.signature)));
    items.extend(plain(vocabulary::constants(), Kind::Constant, "of the language"));
    items.extend(plain(vocabulary::keywords().iter().copied(), Kind::Keyword, "keyword"));
    items.extend(plain(vocabulary::CONTEXTUAL.into_iter().filter(|word| *word != "time"), Kind::Keyword, "keyword"));
    items
}

/// Names that can be seen.
fn names(view: &View, offset: u32) -> Vec<CompletionItem> {
    let mut items: Vec<CompletionItem> = Vec::new();
    for symbol in view.symbols().visible(offset) {
        let kind = match symbol.kind {
            SymbolKind::Function => Kind::Function,
            SymbolKind::Component => Kind::Class,
            SymbolKind::Const | SymbolKind::Param => Kind::Constant,
            _ => Kind::Variable,
        };
        let new = item(&symbol.name, kind, detail(symbol));
        // What hides a name takes its place.
        match items.iter_mut().find(|known| known.label == new.label) {
            Some(known) => *known = new,
            None => items.push(new),
        }
    }
    items
}

/// Whether a bracket that holds a unit is open: one after a name and a blank.
fn in_unit(before: &str) -> bool {
    let Some(open) = before.rfind('[') else { return false };
    let name = before[..open].trim_end();
    let after_name = name.ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_' || c == ']' || c == '\'');
    !before[open..].contains(']') && name.len() < open && after_name
}

fn plain(words: impl Iterator<Item = &'static str>, kind: Kind, what: &str) -> Vec<CompletionItem> {
    words.map(|word| item(word, kind, what.to_owned())).collect()
}

fn item(label: &str, kind: Kind, detail: String) -> CompletionItem {
    CompletionItem { label: label.to_owned(), kind: Some(kind), detail: Some(detail), ..CompletionItem::default() }
}
