//! Tables of sweeps, once for the CSV file and the page: what a column is called, and how a person reads its cells.

use std::collections::HashMap;

use serde_json::{Map, Value, json};

/// How the page shows the cells of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// As they are.
    Text,
    /// In three digits.
    Number,
    /// In full.
    Count,
    /// A time in seconds, in the unit that suits it.
    Seconds,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::Text => "text",
            Kind::Number => "number",
            Kind::Count => "count",
            Kind::Seconds => "seconds",
        }
    }
}

/// A column.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Its name in the CSV file.
    pub key: &'static str,
    /// Its name on the page.
    pub name: &'static str,
    /// Its cells.
    pub kind: Kind,
    /// Whether the page shows it at first.
    pub visible: bool,
}

impl Column {
    /// A column that the page shows when it is asked to.
    pub const fn new(key: &'static str, name: &'static str, kind: Kind) -> Column {
        Column { key, name, kind, visible: false }
    }

    /// A column that the page always shows.
    pub const fn shown(key: &'static str, name: &'static str, kind: Kind) -> Column {
        Column { visible: true, ..Column::new(key, name, kind) }
    }
}

/// A table as a CSV file.
pub fn csv<const N: usize>(columns: &[Column; N], rows: &[[String; N]]) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns.map(|column| column.key)).expect("memory takes every record");
    for fields in rows {
        writer.write_record(fields).expect("memory takes every record");
    }
    let bytes = writer.into_inner().expect("memory takes every record");
    String::from_utf8(bytes).expect("fields are text")
}

/// A table as the page reads it, column by column. Numbers have five digits, those of the columns `exact` all: the page
/// compares them.
pub fn data<const N: usize>(columns: &[Column; N], rows: &[[String; N]], exact: &[&str]) -> Value {
    let stored = columns.iter().enumerate().map(|(at, column)| {
        let cells = rows.iter().map(|row| row[at].as_str());
        let mut stored = match column.kind {
            Kind::Text if column.key == "command" => rests(&cells.collect::<Vec<_>>()),
            Kind::Text => words(cells),
            _ => json!({"values": cells.map(|cell| number(cell, exact.contains(&column.key))).collect::<Vec<_>>()}),
        };
        let Column { key, name, kind, visible } = column;
        let about =
            [("key", json!(key)), ("name", json!(name)), ("kind", json!(kind.name())), ("visible", json!(visible))];
        let map = stored.as_object_mut().expect("written as an object");
        map.extend(about.map(|(key, value)| (key.to_owned(), value)));
        stored
    });
    stored.collect()
}

/// A cell as a number; infinite ones are a word, for JSON has none.
fn number(cell: &str, exact: bool) -> Value {
    let Ok(number) = cell.parse::<f64>() else { return Value::Null };
    if number.is_infinite() {
        return json!("inf");
    }
    let number = if exact { number } else { rounded(number) };
    // Whole numbers without a point take less.
    if number.fract() == 0.0 && number.abs() < 1e15 { json!(number as i64) } else { json!(number) }
}

/// A number with five digits; with all digits if it counts something.
pub fn rounded(number: f64) -> f64 {
    digits(number, 5)
}

/// A number with so many digits; with all digits if it counts something.
pub fn digits(number: f64, digits: usize) -> f64 {
    if number.fract() == 0.0 { number } else { format!("{number:.*e}", digits - 1).parse().expect("a number") }
}

/// Texts that repeat: each once, and which one each row has.
fn words<'a>(cells: impl Iterator<Item = &'a str>) -> Value {
    let (mut known, mut words) = (HashMap::new(), Vec::new());
    let places: Vec<usize> = cells
        .map(|cell| {
            *known.entry(cell).or_insert_with(|| {
                words.push(cell);
                words.len() - 1
            })
        })
        .collect();
    json!({"words": words, "places": places})
}

/// Texts that begin alike: what they have in common, and the rest of each.
fn rests(cells: &[&str]) -> Value {
    let first = cells.first().copied().unwrap_or("");
    let alike = |cell: &&str| first.char_indices().zip(cell.chars()).find(|((_, a), b)| a != b).map(|((at, _), _)| at);
    let common = cells.iter().map(|cell| alike(cell).unwrap_or(first.len().min(cell.len()))).min().unwrap_or(0);
    json!({"prefix": &first[..common], "rest": cells.iter().map(|cell| &cell[common..]).collect::<Vec<_>>()})
}

/// Adds what all pages of sweeps have to the data of one.
pub fn page_data(own: Value) -> Value {
    let Value::Object(mut map) = own else { unreachable!("written as an object") };
    let looks: Vec<Value> = (0..pe_plot::style::LOOKS.len()).map(|at| look(pe_plot::style::Look::joined(at))).collect();
    let solvers: Map<String, Value> = pe_ir::model::Solver::ALL
        .iter()
        .map(|solver| (solver.name().to_owned(), look(pe_plot::style::Look::of_solver(*solver))))
        .collect();
    map.extend([
        ("kind".to_owned(), json!("sweep")),
        ("looks".to_owned(), json!(looks)),
        ("solvers".to_owned(), Value::Object(solvers)),
    ]);
    Value::Object(map)
}

/// A look for the page.
pub fn look(look: pe_plot::style::Look) -> Value {
    let (r, g, b) = look.tone;
    let marker = look.marker.map(|marker| format!("{marker:?}").to_lowercase());
    json!({"colour": format!("#{r:02x}{g:02x}{b:02x}"), "marker": marker, "dash": look.line, "width": look.width})
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_come_back_as_they_were() {
        for cells in
            [vec!["größer -a", "größe -b", "größer"], vec!["é", "è"], vec!["", "x"], vec!["same", "same"], vec![]]
        {
            let stored = rests(&cells);
            let prefix = stored["prefix"].as_str().unwrap();
            let rest =
                stored["rest"].as_array().unwrap().iter().map(|rest| format!("{prefix}{}", rest.as_str().unwrap()));
            assert_eq!(rest.collect::<Vec<_>>(), cells);
        }
    }

    #[test]
    fn numbers_keep_what_is_compared() {
        assert_eq!(number("1.23456789e-5", true), json!(1.23456789e-5));
        assert_eq!(number("1.23456789e-5", false), json!(1.2346e-5));
        assert_eq!(
            [number("1234567", false), number("", true), number("inf", true)],
            [json!(1234567), Value::Null, json!("inf")]
        );
    }
}
