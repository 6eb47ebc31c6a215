//! `pe-synth diff`: what has changed between two compilations of a design, and whether that is tolerated.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::{Value, json};

use crate::console;
use crate::figures::{FIGURES, Figure, Record, SETUP, TRACE};
use crate::messages::MessageFormat;
use pe_flow::failure::Failure;

/// Compares the figures of two compilations of a design
///
/// The exit code is 4 if a figure has changed beyond its tolerance, or is missing on the new side.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth diff models/weibel5/golden out/weibel5
  pe-synth diff models/weibel5/golden out/weibel5 --tolerance cycles=2,lut=5%,trace=any")]
pub struct Diff {
    /// Expected: folder written by `golden` or `compile`, or a report
    old: PathBuf,
    /// Actual: folder written by `compile`, or a report
    new: PathBuf,
    /// Tolerances that override the defaults, for example `cycles=0,lut=2%,error=10%,trace=any`; may be repeated
    #[arg(long, value_name = "NAME=LIMIT[,...]")]
    tolerance: Vec<String>,
    /// Format of the result on standard output, and of errors
    #[arg(long, value_enum, default_value_t)]
    message_format: MessageFormat,
}

/// How far a figure may move in either direction.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Tolerance {
    /// By this much.
    Absolute(f64),
    /// By this part of the old value.
    Relative(f64),
    /// The figure is not judged.
    Any,
}

/// Tolerances other than none.
const DEFAULTS: [(&str, Tolerance); 3] =
    [("lut", Tolerance::Relative(0.02)), ("ff", Tolerance::Relative(0.02)), ("error", Tolerance::Relative(0.1))];

/// What became of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Same,
    Within,
    Beyond,
    /// The old side does not have it.
    New,
    NotJudged,
}

impl Verdict {
    fn name(self) -> &'static str {
        match self {
            Verdict::Same => "same",
            Verdict::Within => "within",
            Verdict::Beyond => "BEYOND",
            Verdict::New => "new",
            Verdict::NotJudged => "not judged",
        }
    }
}

/// A line of the comparison.
struct Row {
    name: &'static str,
    old: Option<Value>,
    new: Option<Value>,
    tolerance: Tolerance,
    verdict: Verdict,
}

impl Diff {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let tolerances = tolerances(&self.tolerance)?;
        let (old, new) = (Record::read(&self.old)?, Record::read(&self.new)?);
        let mut rows: Vec<Row> = Vec::new();
        for figure in FIGURES {
            rows.extend(compare(figure, &old, &new, tolerances[figure.group]));
        }
        rows.extend(compare_outputs(&old, &new, tolerances[TRACE]));
        let count = |verdict: Verdict| rows.iter().filter(|row| row.verdict == verdict).count();
        if count(Verdict::Same) + count(Verdict::Within) + count(Verdict::Beyond) == 0 {
            return Err(Failure::Mismatch("nothing was compared".to_owned()));
        }
        let text = match self.message_format {
            MessageFormat::Human => table(&rows),
            MessageFormat::Json => {
                let rows: Vec<Value> = rows.iter().map(Row::as_json).collect();
                format!("{}\n", json!({"beyond": count(Verdict::Beyond), "figures": rows}))
            }
        };
        let told = console::out(&text);
        match rows.iter().filter(|row| row.verdict == Verdict::Beyond).map(|row| row.name).collect::<Vec<_>>() {
            beyond if beyond.is_empty() => told,
            beyond => Err(Failure::Mismatch(format!("changed beyond the tolerance: {}", beyond.join(", ")))),
        }
    }
}

/// The tolerance of each group; later words count.
fn tolerances(lists: &[String]) -> Result<BTreeMap<&'static str, Tolerance>, Failure> {
    let mut tolerances: BTreeMap<&'static str, Tolerance> =
        FIGURES.iter().map(|figure| (figure.group, Tolerance::Absolute(0.0))).collect();
    tolerances.extend(DEFAULTS);
    for word in lists.iter().flat_map(|list| list.split(',')) {
        let (name, limit) = word.split_once('=').unwrap_or((word, ""));
        let known = tolerances.keys().copied().find(|known| *known == name.trim());
        let Some(known) = known else {
            let known: Vec<&str> = tolerances.keys().copied().collect();
            return Err(Failure::Usage(format!(
                "no figure has the tolerance `{name}`; there are {}",
                known.join(", ")
            )));
        };
        let limit = parse_tolerance(limit.trim()).ok_or_else(|| {
            Failure::Usage(format!("`{word}`: expected a limit such as `{known}=0`, `{known}=2%` or `{known}=any`"))
        })?;
        tolerances.insert(known, limit);
    }
    Ok(tolerances)
}

fn parse_tolerance(text: &str) -> Option<Tolerance> {
    if text == "any" {
        return Some(Tolerance::Any);
    }
    let (number, relative) = text.strip_suffix('%').map_or((text, false), |number| (number, true));
    let number: f64 = number.trim_end().parse().ok().filter(|number: &f64| number.is_finite() && *number >= 0.0)?;
    Some(if relative { Tolerance::Relative(number / 100.0) } else { Tolerance::Absolute(number) })
}

/// Compares a figure; `None` if neither side has it.
fn compare(figure: &Figure, old: &Record, new: &Record, tolerance: Tolerance) -> Option<Row> {
    let (old, new) = (old.figure(figure), new.figure(figure));
    let verdict = match (&old, &new) {
        (None, None) => return None,
        _ if tolerance == Tolerance::Any => Verdict::NotJudged,
        (None, Some(_)) => Verdict::New,
        (Some(_), None) => Verdict::Beyond,
        (Some(old), Some(new)) if old == new => Verdict::Same,
        (Some(old), Some(new)) => match (old.as_f64(), new.as_f64()) {
            (Some(old), Some(new)) if permits(tolerance, old, new) => Verdict::Within,
            _ => Verdict::Beyond,
        },
    };
    Some(Row { name: figure.name, old, new, tolerance, verdict })
}

fn permits(tolerance: Tolerance, old: f64, new: f64) -> bool {
    // What was exactly representable in decimal, such as 100 and 102 at 2 %, must not fail by a rounding.
    const ROUNDING: f64 = 1e-9;
    let limit = match tolerance {
        Tolerance::Absolute(limit) => limit,
        Tolerance::Relative(part) => part * old.abs(),
        Tolerance::Any => return true,
    };
    (new - old).abs() <= limit * (1.0 + ROUNDING)
}

/// The first output word that differs; `None` if a side has none.
fn compare_outputs(old: &Record, new: &Record, tolerance: Tolerance) -> Option<Row> {
    let (before, after) = (old.outputs.as_ref()?, new.outputs.as_ref()?);
    let name_of = |line: &str| {
        let mut fields = line.split_ascii_whitespace();
        let (step, index) = (fields.next()?, fields.next()?.parse::<usize>().ok()?);
        let name = old.report.outputs.as_ref().and_then(|names| names.get(index)).map_or("?", String::as_str);
        Some(json!(format!("`{name}` = {} in step {step}", fields.next()?)))
    };
    let (mut left, mut right) = (before.lines(), after.lines());
    let (old, new, same) = loop {
        match (left.next(), right.next()) {
            (None, None) => break (json!("equal"), json!("equal"), true),
            (one, other) if one == other => {}
            (one, other) => {
                let shown = |line: Option<&str>| line.and_then(name_of).unwrap_or_else(|| json!("end"));
                break (shown(one), shown(other), false);
            }
        }
    };
    let verdict = match (tolerance, same) {
        (Tolerance::Any, _) => Verdict::NotJudged,
        (_, true) => Verdict::Same,
        (_, false) => Verdict::Beyond,
    };
    Some(Row { name: "first outputs", old: Some(old), new: Some(new), tolerance, verdict })
}

impl Row {
    fn change(&self) -> String {
        let numbers = (self.old.as_ref().and_then(Value::as_f64), self.new.as_ref().and_then(Value::as_f64));
        match numbers {
            (Some(old), Some(new)) if old == new => String::new(),
            (Some(old), Some(new)) if new / old >= 10.0 => format!("x {:.3}", new / old),
            (Some(old), Some(new)) if old != 0.0 => format!("{:+.2} %", 100.0 * (new - old) / old.abs()),
            (Some(old), Some(new)) => format!("{:+}", new - old),
            _ => String::new(),
        }
    }

    fn as_json(&self) -> Value {
        json!({
            "figure": self.name,
            "old": self.old,
            "new": self.new,
            "change": self.change(),
            "tolerance": self.tolerance.text(),
            "verdict": self.verdict.name().to_lowercase(),
        })
    }
}

impl Tolerance {
    fn text(self) -> String {
        match self {
            Tolerance::Absolute(limit) => limit.to_string(),
            Tolerance::Relative(part) => format!("{} %", (part * 1e6).round() / 1e4),
            Tolerance::Any => "any".to_owned(),
        }
    }
}

/// A value as the table shows it.
fn shown(value: Option<&Value>) -> String {
    match value {
        None => "-".to_owned(),
        Some(Value::String(text)) if text.len() == 64 => format!("{}...", &text[..12]),
        Some(Value::String(text)) => text.clone(),
        Some(Value::Array(values)) => values.iter().map(|v| shown(Some(v))).collect::<Vec<_>>().join(" "),
        Some(Value::Number(number)) if number.is_f64() => {
            let number = number.as_f64().unwrap_or(f64::NAN);
            if number != 0.0 && number.abs() < 0.1 { format!("{number:.3e}") } else { number.to_string() }
        }
        Some(other) => other.to_string(),
    }
}

/// A cell that leaves room for the others; `--message-format json` has the whole.
fn clipped(cell: String) -> String {
    const WIDEST: usize = 28;
    if cell.chars().count() <= WIDEST { cell } else { cell.chars().take(WIDEST - 3).chain("...".chars()).collect() }
}

/// The rows as a table: figures that are equal and tell which design it is go into one line.
fn table(rows: &[Row]) -> String {
    let mut lines = vec![["figure", "expected", "now", "change", "tolerance", ""].map(str::to_owned)];
    for row in rows {
        let setup = FIGURES.iter().any(|figure| figure.name == row.name && figure.group == SETUP);
        if setup && row.verdict == Verdict::Same {
            continue;
        }
        let tolerance = if row.verdict == Verdict::Same { String::new() } else { row.tolerance.text() };
        let [old, new] = [&row.old, &row.new].map(|value| clipped(shown(value.as_ref())));
        lines.push([row.name.to_owned(), old, new, row.change(), tolerance, row.verdict.name().to_owned()]);
    }
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..6).map(width).collect();
    let mut text = String::new();
    for line in &lines {
        let [name, old, new, change, tolerance, verdict] = line;
        let row = format!(
            "{name:<0$}  {old:>1$}  {new:>2$}  {change:>3$}  {tolerance:>4$}  {verdict}",
            widths[0], widths[1], widths[2], widths[3], widths[4]
        );
        text += row.trim_end();
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerances_are_read_and_the_last_one_counts() {
        let words = ["cycles=3,lut=0.5%".to_owned(), "cycles=any, error=0".to_owned()];
        let tolerances = tolerances(&words).unwrap();
        assert_eq!(tolerances["cycles"], Tolerance::Any);
        assert_eq!(tolerances["lut"], Tolerance::Relative(0.005));
        assert_eq!(tolerances["error"], Tolerance::Absolute(0.0));
        assert_eq!(tolerances["ff"], Tolerance::Relative(0.02));
        assert_eq!(tolerances["connections"], Tolerance::Absolute(0.0));
    }

    #[test]
    fn misspelt_tolerances_are_refused() {
        for word in ["cycle=3", "cycles", "cycles=", "cycles=-1", "cycles=nan", "cycles=inf%", "cycles=2%%", "", "=1"] {
            let result = tolerances(&[word.to_owned()]);
            assert!(matches!(result, Err(Failure::Usage(_))), "{word} is accepted");
        }
    }

    #[test]
    fn limits_are_inclusive() {
        assert!(permits(Tolerance::Relative(0.02), 100.0, 102.0) && permits(Tolerance::Relative(0.02), 100.0, 98.0));
        assert!(!permits(Tolerance::Relative(0.02), 100.0, 102.1));
        assert!(permits(Tolerance::Absolute(2.0), 0.0, 2.0) && !permits(Tolerance::Absolute(2.0), 0.0, 3.0));
        assert!(!permits(Tolerance::Relative(0.5), 0.0, 1e-12));
    }
}
