//! Text forms of the compiler's representations: printed, read back, and written by hand for tests.
//!
//! A file has a section for each stage up to the one it was printed after, in the order of [`Stage::ALL`]. A section
//! begins with a line `pe-synth STAGE VERSION`; every other line is an item: a word that says what it is, and its
//! fields. Blank lines and lines that begin with `#` say nothing. Numbers are the shortest decimals that read back
//! exactly; words of memories are hexadecimal. A name with characters other than letters, digits, `_`, `.`, `~` and
//! subscripts stands in quotes. What is read has the places of the file's lines.

mod elimination;
pub mod expr;
pub mod fixed;
pub mod labels;
pub mod mapping;
pub mod model;
mod reader;
mod scaled;
pub mod schedule;
pub mod step;
mod waveform;
mod writer;

use std::fmt;
use std::ops::Range;

use crate::codes;
use crate::index;
use crate::source::{Diagnostic, Sources, Span};

pub use self::reader::{Line, Lines};
pub use self::writer::{name, number, quoted};

/// Version of all text forms.
const VERSION: u32 = 1;

/// What a section holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Flat equations with folded constants: [`crate::model::Model`].
    Model,
    /// Chains of one solver step: [`crate::graph::StepGraph`].
    Step,
    /// Number formats: [`crate::graph::FixedPoint`].
    Fixed,
    /// PE of each equation: [`crate::mapping::Mapping`].
    Mapping,
    /// Time of each chain and transfer: [`crate::schedule::Schedule`].
    Schedule,
    /// Control words, memory images and links: [`crate::program::Program`].
    Program,
}

impl Stage {
    /// All stages, each after those that it needs.
    pub const ALL: [Stage; 6] =
        [Stage::Model, Stage::Step, Stage::Fixed, Stage::Mapping, Stage::Schedule, Stage::Program];

    /// The name in headers and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Model => "model",
            Stage::Step => "step",
            Stage::Fixed => "fixed",
            Stage::Mapping => "mapping",
            Stage::Schedule => "schedule",
            Stage::Program => "program",
        }
    }

    /// The first line of its section, without line end.
    pub fn header(self) -> String {
        format!("pe-synth {} {VERSION}", self.name())
    }
}

/// A place in a text that is not what a text form has there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextError {
    /// Bytes of the text.
    pub span: Span,
    /// Line, from 1 on.
    pub line: usize,
    /// Column in characters, from 1 on.
    pub column: usize,
    /// What is wrong, or what was expected.
    pub message: String,
}

impl TextError {
    fn at(text: &str, place: Range<usize>, message: String) -> TextError {
        let span = Span { start: index::number(place.start), end: index::number(place.end) };
        let position = Sources::new("", text);
        let position = position.position(span.start);
        TextError { span, line: position.line, column: position.column, message }
    }

    /// As a finding about the text.
    pub fn finding(self) -> Diagnostic {
        Diagnostic::error(codes::BAD_STAGE_TEXT, self.span, self.message).with_help(
            "`pe-synth dump --stage STAGE` prints what can be read; `docs/stages.md` has the items of each stage",
        )
    }
}

impl fmt::Display for TextError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}: {}", self.line, self.column, self.message)
    }
}

impl std::error::Error for TextError {}

/// The part of a text that belongs to one stage.
#[derive(Clone, Debug)]
pub struct Section<'a> {
    /// The stage.
    pub stage: Stage,
    text: &'a str,
    /// Its lines after the header.
    body: Range<usize>,
    header: Range<usize>,
}

/// Where a section is in its text.
#[derive(Clone, Debug)]
pub struct Place {
    stage: Stage,
    body: Range<usize>,
    header: Range<usize>,
}

impl Place {
    /// The section that is there in the text in which it was found.
    pub fn section<'a>(&self, text: &'a str) -> Section<'a> {
        Section { stage: self.stage, text, body: self.body.clone(), header: self.header.clone() }
    }
}

impl<'a> Section<'a> {
    /// Where it is.
    pub fn place(&self) -> Place {
        Place { stage: self.stage, body: self.body.clone(), header: self.header.clone() }
    }

    /// Its lines, one item each.
    pub fn lines(&self) -> Lines<'a> {
        Lines::new(self.text, self.body.clone())
    }

    /// An error about the section as a whole, at its header.
    pub fn error(&self, message: impl Into<String>) -> TextError {
        TextError::at(self.text, self.header.clone(), message.into())
    }

    /// What was read from it, unless its checker found a problem; `what` it is.
    ///
    /// # Errors
    /// The first problem.
    fn accept<T>(&self, read: T, what: &str, check: impl Fn(&T) -> Vec<String>) -> Result<T, TextError> {
        match check(&read).first() {
            None => Ok(read),
            Some(problem) => Err(self.error(format!("this is no valid {what}: {problem}"))),
        }
    }

    /// The bytes of its header.
    pub fn span(&self) -> Span {
        Span { start: index::number(self.header.start), end: index::number(self.header.end) }
    }
}

/// Whether a text begins as a stage's does.
pub fn is_stage_text(text: &str) -> bool {
    text.lines().find(|line| !is_blank(line)).is_some_and(|line| line.starts_with("pe-synth "))
}

fn is_blank(line: &str) -> bool {
    let line = line.trim();
    line.is_empty() || line.starts_with('#')
}

/// The sections of a text, in order: each stage at most once, and after those that it needs.
///
/// # Errors
/// The text does not begin with a header, a header names no stage or another version, or stages are out of order.
pub fn sections(text: &str) -> Result<Vec<Section<'_>>, TextError> {
    let mut sections: Vec<Section> = Vec::new();
    let mut begin = 0;
    for line in text.split_inclusive('\n') {
        let at = begin..begin + line.trim_end().len();
        begin += line.len();
        let error = |message: String| TextError::at(text, at.clone(), message);
        let Some(rest) = line.strip_prefix("pe-synth ") else {
            match sections.last_mut() {
                Some(section) => section.body.end = begin,
                None if is_blank(line) => {}
                None => {
                    return Err(error(format!("expected the header of a stage, such as `{}`", Stage::Model.header())));
                }
            }
            continue;
        };
        let (named, version) = rest.trim_end().split_once(' ').unwrap_or((rest.trim_end(), ""));
        let Some(stage) = Stage::ALL.into_iter().find(|stage| stage.name() == named) else {
            let names = Stage::ALL.map(Stage::name).join(", ");
            return Err(error(format!("`{named}` is no stage: expected one of {names}")));
        };
        if version != VERSION.to_string() {
            return Err(error(format!("expected version {VERSION} of the text form, found `{version}`")));
        }
        if sections.last().is_some_and(|last| last.stage >= stage) {
            return Err(error(format!("the section of stage `{named}` comes too late: {}", order())));
        }
        sections.push(Section { stage, text, body: begin..begin, header: at });
    }
    if sections.is_empty() {
        return Err(TextError::at(
            text,
            0..0,
            format!("expected the header of a stage, such as `{}`", Stage::Model.header()),
        ));
    }
    Ok(sections)
}

fn order() -> String {
    format!("stages come in the order {}", Stage::ALL.map(Stage::name).join(", "))
}

/// The only section of a text, of a stage that is known.
///
/// # Errors
/// Those of [`sections`], and another stage.
pub fn single(text: &str, stage: Stage) -> Result<Section<'_>, TextError> {
    let mut sections = sections(text)?;
    match sections.pop() {
        Some(section) if section.stage == stage && sections.is_empty() => Ok(section),
        section => {
            let place = section.map_or(0..0, |section| section.header);
            Err(TextError::at(text, place, format!("expected one section, `{}`", stage.header())))
        }
    }
}

#[cfg(test)]
mod tests;
