//! The step graph as the loops of a Rust program for the computer at hand: what a programmer who knows the model's
//! structure would write, with the same tiles that [`crate::double`] runs.

use std::fmt::Write;

use pe_ir::functions::Segments;
use pe_ir::graph::{Factor, Role, StepGraph, ValueId};

use crate::double::power_of_two;
use crate::slots::Slots;
use crate::tiles::{Factors, Lookups, Place, Shared, Tile, Tiles};

/// Loops and tables of a step. Numbers are of the type `R`, which the program defines.
///
/// * `LEVELS`: functions that may run in any order or at the same time, level after level;
/// * `COPIES`: what ends a step, `(from, to, length)`;
/// * `INITIAL`, `INPUTS`, `STATES`: values at the beginning, and where inputs and states lie.
pub fn loops(graph: &StepGraph) -> String {
    let slots = Slots::new(graph);
    let coefficient = |term: usize| match graph.terms[term].factor {
        Factor::Coefficient(coefficient) => coefficient,
        Factor::Value(_) => 0.0,
    };
    let tiles = slots.arrange(graph, |_, _| 0, coefficient, |_, _, write| write.weight);
    let mut initial = vec![0.0; slots.count()];
    for (index, value) in graph.values.iter().enumerate() {
        if let Role::Constant(number) = value.role {
            initial[slots.of(ValueId(index as u32)) as usize] = number;
        }
    }
    for ((state, _), number) in graph.states.iter().zip(&graph.initial) {
        initial[slots.of(*state) as usize] = *number;
    }
    for (value, segment, slot) in slots.column_entries(graph) {
        if let Role::Column(lookup, column) = graph.value(value).role {
            let table = graph.functions.lookups[lookup as usize].table;
            let column = &graph.functions.tables[table as usize].columns[usize::from(column)];
            initial[slot as usize] = column[segment];
        }
    }
    let mut text = String::new();
    if !graph.functions.lookups.is_empty() {
        text.push_str(&segment_function(graph.functions.segments));
        table(&mut text, "CHOICES", "u32", &tiles.columns.choices, |slot| slot.to_string());
        table(&mut text, "FIRSTS", "u32", &tiles.firsts, |first| first.to_string());
    }
    for (index, tile) in tiles.tiles.iter().enumerate() {
        function(&mut text, &tiles, tile, index);
    }
    let of = |values: &mut dyn Iterator<Item = ValueId>| values.map(|value| slots.of(value)).collect::<Vec<_>>();
    table(&mut text, "SLOTS", "u32", &tiles.slots, |slot| slot.to_string());
    table(&mut text, "NUMBERS", "R", &tiles.coefficients, literal);
    table(&mut text, "WEIGHTS", "R", &tiles.shifts, |weight| literal(&power_of_two(*weight)));
    table(&mut text, "INITIAL", "R", &initial, literal);
    table(&mut text, "INPUTS", "usize", &of(&mut graph.inputs.iter().copied()), |slot| slot.to_string());
    table(&mut text, "STATES", "usize", &of(&mut graph.states.iter().map(|(state, _)| *state)), |s| s.to_string());
    table(&mut text, "COPIES", "(usize, usize, usize)", slots.copies(), |copy| format!("{copy:?}"));
    let mut levels: Vec<String> = Vec::new();
    for (index, tile) in tiles.tiles.iter().enumerate() {
        levels.resize((tile.level as usize + 1).max(levels.len()), String::new());
        levels[tile.level as usize] += &format!("t{index}, ");
    }
    table(&mut text, "LEVELS", "&[unsafe fn(*mut R)]", &levels, |level| format!("&[{level}]"));
    text
}

fn table<T>(text: &mut String, name: &str, kind: &str, rows: &[T], row: impl Fn(&T) -> String) {
    let _ = write!(text, "static {name}: &[{kind}] = &[");
    for (index, item) in rows.iter().enumerate() {
        let _ = write!(text, "{}{},", if index % 16 == 0 { "\n    " } else { " " }, row(item));
    }
    text.push_str("\n];\n");
}

/// A function that gives the segment of a number, as [`Segments::index_of`] has it.
fn segment_function(segments: Segments) -> String {
    let count = segments.count();
    let last = (1u32 << segments.octave_bits) - 1;
    let mantissas = 1u32 << (segments.index_bits - segments.octave_bits);
    format!(
        "fn segment(x: R, octaves: bool) -> usize {{
    if !octaves {{
        return (((x + 1.0) * {half}.0).max(0.0) as usize).min({count} - 1);
    }}
    let (mut x, mut octave) = (x.max(0.0), 0);
    while octave < {last} && x < 0.5 {{
        x *= 2.0;
        octave += 1;
    }}
    let mantissa = if octave < {last} {{ (x - 0.5) * 2.0 }} else {{ x }};
    octave * {mantissas} + ((mantissa * {mantissas}.0) as usize).min({mantissas} - 1)
}}
",
        half = count / 2,
    )
}

/// A tile of lookups.
fn lookups(text: &mut String, (lanes, index): (u32, usize), lookups: Lookups) {
    let (target, number) = match lookups {
        Lookups::Segments { targets, arguments, octaves } => {
            (targets, format!("segment({}, {octaves}) as R", at(arguments)))
        }
        Lookups::Choices { targets, segments, among } => {
            let first = match among {
                Shared::Same(first) => first.to_string(),
                Shared::Each(start) => format!("*FIRSTS.get_unchecked({start} + i) as usize"),
            };
            let segment = at(segments);
            (targets, format!("*v.add(*CHOICES.get_unchecked({first} + {segment} as usize) as usize)"))
        }
    };
    let target = at(target);
    let _ = writeln!(text, "unsafe fn t{index}(v: *mut R) {{\n    for i in 0..{lanes} {{ {target} = {number}; }}\n}}");
}

/// A tile: the sums of all lanes, then the writes.
fn function(text: &mut String, tiles: &Tiles<f64>, tile: &Tile, index: usize) {
    let lanes = tile.lanes;
    if let Some(found) = tile.lookups {
        return lookups(text, (lanes, index), found);
    }
    let _ = writeln!(text, "unsafe fn t{index}(v: *mut R) {{\n    let mut sums: [R; {lanes}] = [0.0; {lanes}];");
    let _ = writeln!(text, "    for i in 0..{lanes} {{\n        let mut sum: R = 0.0;");
    for products in &tiles.products[tile.products.start as usize..tile.products.end as usize] {
        let factor = match products.factors {
            Factors::Values(place) => at(place),
            Factors::Coefficients(Shared::Same(number)) => literal(&number),
            Factors::Coefficients(Shared::Each(start)) => format!("*NUMBERS.get_unchecked({start} + i)"),
        };
        let _ = writeln!(text, "        sum += {} * {factor};", at(products.operands));
    }
    text.push_str("        sums[i] = sum;\n    }\n");
    for writes in &tiles.writes[tile.writes.start as usize..tile.writes.end as usize] {
        let weight = match writes.shifts {
            Shared::Same(weight) => literal(&power_of_two(weight)),
            Shared::Each(start) => format!("*WEIGHTS.get_unchecked({start} + i)"),
        };
        let (target, base) = (at(writes.targets), at(writes.bases));
        let _ = writeln!(text, "    for i in 0..{lanes} {{ {target} = {base} + {weight} * sums[i]; }}");
    }
    text.push_str("}\n");
}

/// The value of lane `i`.
fn at(place: Place) -> String {
    match place {
        Place::Row(start) => format!("*v.add({start} + i)"),
        Place::Same(slot) => format!("*v.add({slot})"),
        Place::Each(start) => format!("*v.add(*SLOTS.get_unchecked({start} + i) as usize)"),
    }
}

/// A number that reads back the same.
fn literal(number: &f64) -> String {
    format!("({number:e})")
}
