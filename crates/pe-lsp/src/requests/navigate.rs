//! Where a name is defined and read, which file a path is, and what a file defines.

use crate::view::View;
use gen_lsp_types::{
    DocumentHighlight, DocumentHighlightKind, DocumentSymbol, Location, Position, SymbolKind as ShownKind,
};
use pe_frontend::ast::StatementKind;
use pe_frontend::symbols::{Role, Symbol, SymbolKind};
use pe_ir::source::Span;

/// Where the name at a position is defined, or the file that a path there stands for.
pub(crate) fn definition(view: &View, file: usize, position: Position) -> Option<Location> {
    if let Some((_, symbol)) = view.name_at(file, position) {
        return Some(view.location(symbol.place));
    }
    let offset = view.offset(file, position);
    let (_, named) = view.spec.files.iter().find(|(path, _)| (path.start..=path.end).contains(&offset))?;
    Some(view.location(Span { start: named.start, end: named.start }))
}

/// All places of the name at a position.
pub(crate) fn references(view: &View, file: usize, position: Position, declaration: bool) -> Option<Vec<Location>> {
    let (at, symbol) = view.name_at(file, position)?;
    let places = view.symbols().places(at.symbol).filter(|place| declaration || place.span != symbol.place);
    Some(places.map(|place| view.location(place.span)).collect())
}

/// The places in one file of the name at a position.
pub(crate) fn highlights(view: &View, file: usize, position: Position) -> Option<Vec<DocumentHighlight>> {
    let (at, _) = view.name_at(file, position)?;
    let shown = view.symbols().places(at.symbol).filter_map(|place| {
        let (own, range) = view.range(place.span);
        let kind = if place.role == Role::Read { DocumentHighlightKind::Read } else { DocumentHighlightKind::Write };
        (own == file).then_some(DocumentHighlight { range, kind: Some(kind) })
    });
    Some(shown.collect())
}

/// What a file defines, in source order.
pub(crate) fn symbols(view: &View, file: usize) -> Vec<DocumentSymbol> {
    let mut found = Vec::new();
    for statement in &view.spec.statements {
        if let StatementKind::Model { name, title } = &statement.kind {
            found.push((name.span, entry(view, &name.text, title, ShownKind::Module, (statement.span, name.span))));
        }
    }
    for symbol in view.symbols().all.iter().filter(|symbol| symbol.scope.is_none()) {
        let spans = (symbol.statement, symbol.place);
        found.push((symbol.place, entry(view, &symbol.name, &detail(symbol), shown_kind(symbol.kind), spans)));
    }
    found.retain(|(place, _)| view.file_at(place.start) == file);
    found.sort_by_key(|(place, _)| *place);
    found.into_iter().map(|(_, symbol)| symbol).collect()
}

fn entry(view: &View, name: &str, detail: &str, kind: ShownKind, (whole, place): (Span, Span)) -> DocumentSymbol {
    #[expect(deprecated, reason = "the type has no other way to be made")]
    DocumentSymbol {
        name: name.to_owned(),
        detail: (!detail.is_empty()).then(|| detail.to_owned()),
        kind,
        tags: None,
        deprecated: None,
        range: view.range(whole).1,
        selection_range: view.range(place).1,
        children: None,
    }
}

/// A symbol in a few words: kind, indices or arguments, unit.
pub(crate) fn detail(symbol: &Symbol) -> String {
    let list = symbol.arguments.join(", ");
    let arguments = match (symbol.kind, list.is_empty()) {
        (SymbolKind::Function | SymbolKind::Component, _) => format!(" ({list})"),
        (_, true) => String::new(),
        (_, false) => format!(" [{list}]"),
    };
    let unit = symbol.unit.as_ref().map(|unit| format!(" in {unit}")).unwrap_or_default();
    format!("{}{arguments}{unit}", symbol.kind.describe())
}

fn shown_kind(kind: SymbolKind) -> ShownKind {
    match kind {
        SymbolKind::Const | SymbolKind::Param => ShownKind::Constant,
        SymbolKind::Tunable => ShownKind::Property,
        SymbolKind::Input => ShownKind::Interface,
        SymbolKind::State | SymbolKind::Angle => ShownKind::Field,
        SymbolKind::Matrix => ShownKind::Array,
        SymbolKind::Algebraic | SymbolKind::Argument => ShownKind::Variable,
        SymbolKind::Index => ShownKind::Key,
        SymbolKind::Function => ShownKind::Function,
        SymbolKind::Component => ShownKind::Class,
        SymbolKind::Instance => ShownKind::Object,
    }
}
