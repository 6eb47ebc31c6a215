//! What is known of a name: its definition, value, unit, equations, range and number format.

use crate::requests::navigate::detail;
use crate::view::View;
use crate::worker::{Analysis, Ranges, Values};
use gen_lsp_types::{Contents, Hover, MarkupContent, MarkupKind, Position};
use pe_flow::variables::Variable;
use pe_frontend::symbols::{Role, Symbol, SymbolKind};
use pe_frontend::vocabulary;
use pe_ir::source::Span;

/// Equations that are shown.
const MOST_EQUATIONS: usize = 3;

/// Characters of a statement that are shown.
const LONGEST: usize = 600;

/// What is known beside the text: results of threads, as far as they are there.
pub(crate) struct Results<'a> {
    /// Of the text as it is.
    pub(crate) analysis: Option<&'a Analysis>,
    /// Of this text or of an earlier one.
    pub(crate) ranges: Option<&'a Ranges>,
}

/// What is known of what stands at a position.
pub(crate) fn hover(view: &View, file: usize, position: Position, results: &Results) -> Option<Hover> {
    let (text, span) = match view.name_at(file, position) {
        Some((at, symbol)) => (of_symbol(view, at.symbol, symbol, results), at.span),
        None => of_language(view, file, view.offset(file, position))?,
    };
    let contents = Contents::MarkupContent(MarkupContent { kind: MarkupKind::Markdown, value: text });
    Some(Hover { contents, range: Some(view.range(span).1) })
}

/// A function or signal of the language.
fn of_language(view: &View, file: usize, offset: u32) -> Option<(String, Span)> {
    let base = view.sources.files()[file].span().start;
    let words = vocabulary::words(view.text(file));
    let word = words.iter().find(|word| (word.span.start..=word.span.end).contains(&(offset - base)))?;
    let call = vocabulary::functions().find(|call| call.name == &view.text(file)[word.span.range()])?;
    let kind = if call.signal { "signal" } else { "function" };
    let span = Span { start: word.span.start + base, end: word.span.end + base };
    Some((format!("{}{kind} of the language", code(&call.signature)), span))
}

fn of_symbol(view: &View, number: usize, symbol: &Symbol, results: &Results) -> String {
    let mut text = code(view.words(symbol.statement));
    text += &detail(symbol);
    if symbol.scope.is_none()
        && !matches!(symbol.kind, SymbolKind::Function | SymbolKind::Component | SymbolKind::Instance)
    {
        let values = results.analysis.and_then(|analysis| analysis.values.get(&symbol.name));
        text += &values.map(|values| of_values(symbol, values)).unwrap_or_default();
    }
    let written = view.symbols().places(number).filter(|place| place.role == Role::Written);
    let mut statements: Vec<Span> = written.map(|place| place.statement).collect();
    statements.dedup();
    statements.retain(|statement| *statement != symbol.statement);
    if !statements.is_empty() {
        let shown: Vec<&str> = statements.iter().take(MOST_EQUATIONS).map(|statement| view.words(*statement)).collect();
        let more = statements.len().saturating_sub(MOST_EQUATIONS);
        let more = if more > 0 { format!("{more} more equations") } else { String::new() };
        text += &format!("\n\n{}{more}", code(&shown.join("\n")));
    }
    let changes = matches!(
        symbol.kind,
        SymbolKind::State | SymbolKind::Angle | SymbolKind::Tunable | SymbolKind::Input | SymbolKind::Algebraic
    );
    if changes && symbol.scope.is_none() {
        text += &of_runs(symbol, results);
    }
    text
}

/// Extents and values.
fn of_values(symbol: &Symbol, values: &Values) -> String {
    let extents: Vec<String> = values.extents.iter().map(|(low, high)| format!("{low}..{high}")).collect();
    let extents = if extents.is_empty() { String::new() } else { format!(", {}", extents.join(", ")) };
    let known = values.values.iter().copied().filter(|value| !value.is_nan());
    let (low, high) =
        known.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return extents;
    }
    let what = if matches!(symbol.kind, SymbolKind::Const | SymbolKind::Param) { "value" } else { "at time zero" };
    let range = if low == high { shown(low) } else { format!("{} to {}", shown(low), shown(high)) };
    let unit = symbol.unit.as_ref().map(|unit| format!(" {unit}")).unwrap_or_default();
    format!("{extents}\n\n{what}: **{range}**{unit}")
}

/// Range and number format, with the part of the span that they were measured over.
fn of_runs(symbol: &Symbol, results: &Results) -> String {
    let Some(ranges) = results.ranges else {
        return "\n\nrange and number format: not measured yet".to_owned();
    };
    let current = results.analysis.is_some_and(|analysis| analysis.generation == ranges.generation);
    let when = if current { "" } else { ", before the last change" };
    let variables = match &ranges.variables {
        Ok(variables) => variables,
        Err(reason) => return format!("\n\nrange and number format: not measured{when}: {reason}"),
    };
    let elements = format!("{}[", symbol.name);
    let own: Vec<&Variable> = variables
        .values()
        .filter(|variable| variable.name == symbol.name || variable.name.starts_with(&elements))
        .collect();
    let worst = own.iter().min_by(|a, b| a.headroom().total_cmp(&b.headroom()));
    let Some(worst) = worst else {
        return "\n\nrange and number format: not a variable of its own in the design".to_owned();
    };
    let largest = own.iter().map(|variable| variable.largest).fold(0.0, f64::max);
    let (part, whole) = ranges.span;
    let span = match part < whole {
        true => format!("the first {} s of {} s", shown(part), shown(whole)),
        false => format!("the span of {} s", shown(whole)),
    };
    let of =
        if own.len() > 1 { format!(" (`{}`, the least headroom of {})", worst.name, own.len()) } else { String::new() };
    format!(
        "\n\nrange: magnitudes up to **{}**, measured over {span} with default options{when}\n\n\
         number format{of}: steps of {}, up to {}, {:.1} bits of headroom",
        shown(largest),
        shown(worst.lsb),
        shown(worst.limit),
        worst.headroom()
    )
}

/// A number with six digits.
fn shown(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    if rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs()) { rounded.to_string() } else { format!("{rounded:e}") }
}

/// A block of code. A fence in it cannot end the block: the language has no such sign outside of comments and texts.
fn code(text: &str) -> String {
    let cut = text.char_indices().nth(LONGEST).map_or(text.len(), |(at, _)| at);
    let dots = if cut < text.len() { "\n..." } else { "" };
    format!("```ode\n{}{dots}\n```\n\n", text[..cut].replace("```", "'''"))
}
