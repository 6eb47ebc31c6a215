//! Renames a name in all files of all models that it is part of.
//!
//! Nothing is taken on trust: the renamed text is read again, and the rename is refused unless every name means what it
//! meant and the flat model is the same but for names.

use crate::files::Texts;
use crate::keys::Key;
use crate::requests::fixes::{all_findings, put};
use crate::view::View;
use gen_lsp_types::{Position, Range, TextEdit, Uri, WorkspaceEdit};
use pe_frontend::symbols::Symbols;
use pe_frontend::{Overrides, examine, vocabulary};
use pe_ir::model::Model;
use pe_ir::source::Span;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Places in a file, by their offsets there.
type Places = BTreeMap<Key, BTreeSet<(usize, usize)>>;

/// The place of the name at a position, and the name.
///
/// # Errors
/// Why it cannot be renamed.
pub(crate) fn place(view: &View, file: usize, position: Position) -> Result<(Range, String), String> {
    let (at, symbol) = view.name_at(file, position).ok_or("there is no name of the spec here")?;
    Ok((view.range(at.span).1, symbol.name.clone()))
}

/// The changes that give the name at a position another one. `models` tells the models that a file is part of.
///
/// # Errors
/// Why it cannot be done, in words for the user.
pub(crate) fn rename(
    view: &View,
    (file, position): (usize, Position),
    new: &str,
    models: &mut dyn FnMut(&Key) -> Vec<View>,
) -> Result<WorkspaceEdit, String> {
    let (at, symbol) = view.name_at(file, position).ok_or("there is no name of the spec here")?;
    let old = symbol.name.clone();
    if new == old {
        return Ok(WorkspaceEdit::default());
    }
    vocabulary::definable(new)?;
    let mut places = Places::new();
    let mut concerned: BTreeMap<Key, View> = BTreeMap::new();
    take(view, at.symbol, &mut places);
    // A file that several models share takes these with it, and they may hold more files.
    loop {
        let count = places.values().map(BTreeSet::len).sum::<usize>();
        for key in places.keys().cloned().collect::<Vec<_>>() {
            for model in models(&key) {
                concerned.entry(model.root.clone()).or_insert(model);
            }
        }
        for model in concerned.values() {
            for symbol in touched(model, &places) {
                take(model, symbol, &mut places);
            }
        }
        if places.values().map(BTreeSet::len).sum::<usize>() == count {
            break;
        }
    }
    let mut changed = view.texts.clone();
    let mut edits = HashMap::new();
    for model in concerned.values() {
        check(model, &places, new)?;
        for file in 0..model.sources.files().len() {
            let key = model.key(file);
            let Some(own) = places.get(&key) else { continue };
            let mut text = model.text(file).to_owned();
            own.iter().rev().for_each(|(from, to)| text.replace_range(*from..*to, new));
            put(&mut changed, model, file, text);
            let base = model.sources.files()[file].span().range().start;
            let edit = |(from, to): &(usize, usize)| TextEdit {
                range: model.range(Span::of(base + from, base + to)).1,
                new_text: new.to_owned(),
            };
            edits.insert(Uri(model.texts.uri(&key)), own.iter().map(edit).collect());
        }
    }
    for model in concerned.values() {
        compare(model, &changed, &old, new)?;
    }
    Ok(WorkspaceEdit { changes: Some(edits), ..WorkspaceEdit::default() })
}

/// Adds all places of a symbol.
fn take(view: &View, symbol: usize, places: &mut Places) {
    for occurrence in view.symbols().places(symbol) {
        let (key, from, to) = within(view, occurrence.span);
        places.entry(key).or_default().insert((from, to));
    }
}

/// File and offsets there of a span.
fn within(view: &View, span: Span) -> (Key, usize, usize) {
    let file = view.file_at(span.start);
    let base = view.sources.files()[file].span().range().start;
    (view.key(file), span.range().start - base, span.range().end - base)
}

/// Symbols of a model that stand at places.
fn touched(view: &View, places: &Places) -> BTreeSet<usize> {
    let stands = |span: Span| {
        let (key, from, to) = within(view, span);
        places.get(&key).is_some_and(|own| own.contains(&(from, to)))
    };
    view.symbols().occurrences.iter().filter(|place| stands(place.span)).map(|place| place.symbol).collect()
}

/// What can be said without trying.
fn check(view: &View, places: &Places, new: &str) -> Result<(), String> {
    let name = view.root.name();
    let name = name.rsplit(['/', '\\']).next().unwrap_or_default();
    if !view.spec.broken.is_empty() || view.spec.names_missing {
        return Err(format!("a statement of {name} is not understood and may hold the name: mend it first"));
    }
    let symbols = view.symbols();
    for number in touched(view, places) {
        let symbol = &symbols.all[number];
        if symbol.repeated {
            return Err(format!("`{}` is defined twice in {name}", symbol.name));
        }
        let taken = symbols.all.iter().find(|other| other.name == new && other.scope.is_none());
        if let Some(other) = taken {
            let line = view.sources.position(other.place.start).line;
            return Err(format!("`{new}` is taken: {} in line {line} of {name}", other.kind.describe()));
        }
    }
    Ok(())
}

/// Compares a model with what it is after the rename.
fn compare(view: &View, changed: &Texts, old: &str, new: &str) -> Result<(), String> {
    let renamed = View::read(&view.root, changed).ok_or("a file is gone")?;
    if bindings(view.symbols()) != bindings(renamed.symbols()) {
        return Err(format!("`{new}` would hide another name, or be hidden by one"));
    }
    let codes = |view| all_findings(view).iter().map(|finding| finding.code).collect::<Vec<_>>();
    if codes(view) != codes(&renamed) {
        return Err(format!("the spec has other errors or warnings with `{new}` in the place of `{old}`"));
    }
    if meaning(view) != meaning(&renamed) {
        return Err(format!(
            "the model is another one with `{new}` in the place of `{old}`; indices of tables are found by their names"
        ));
    }
    Ok(())
}

/// Which name stands where: symbols in the order of their places.
fn bindings(symbols: &Symbols) -> Vec<(usize, pe_frontend::symbols::Role)> {
    symbols.occurrences.iter().map(|place| (place.symbol, place.role)).collect()
}

/// The flat model without names and places.
fn meaning(view: &View) -> Option<String> {
    let stop = Arc::new(AtomicBool::new(false));
    let Model {
        title,
        solver,
        step,
        phases,
        span,
        mut states,
        mut rates,
        mut algebraics,
        mut inputs,
        mut signals,
        mut outputs,
        left_out,
        ..
    } = examine(&view.spec, &Overrides::default(), &stop).model?;
    let nowhere = Span::default();
    for state in states.iter_mut() {
        (state.name, state.span) = (String::new(), nowhere);
    }
    for algebraic in &mut algebraics {
        (algebraic.name, algebraic.span) = (String::new(), nowhere);
    }
    for input in &mut inputs {
        (input.name, input.span) = (String::new(), nowhere);
    }
    for output in &mut outputs {
        (output.name, output.span) = (String::new(), nowhere);
    }
    rates.iter_mut().for_each(|rate| rate.span = nowhere);
    signals.iter_mut().for_each(|signal| signal.span = nowhere);
    let settings = (title, solver, step, phases, span, rates, signals, left_out.len());
    Some(format!("{:?}", (settings, states, algebraics, inputs, outputs)))
}
