//! Source text, positions in it, and diagnostics.

use crate::index::{at, number};
use std::fmt;
use std::ops::Range;

/// All files of a spec in one space of byte offsets: the main file first, then included files and data files in the
/// order in which they were read.
///
/// The texts are kept one after the other with a line end between them, so a [`Span`] is a range of [`Sources::text`]
/// and needs no number of a file.
#[derive(Clone, Debug)]
pub struct Sources {
    text: String,
    files: Vec<SourceFile>,
}

/// One file among [`Sources`].
#[derive(Clone, Debug)]
pub struct SourceFile {
    name: String,
    span: Span,
    /// Offset of the first byte of each line.
    lines: Vec<u32>,
}

/// A position as a person counts it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position<'a> {
    /// Name of the file.
    pub file: &'a str,
    /// Line, from 1 on.
    pub line: usize,
    /// Column in characters, from 1 on.
    pub column: usize,
}

impl Sources {
    /// A spec of one file so far. `name` is shown in diagnostics and never opened.
    pub fn new(name: impl Into<String>, text: &str) -> Self {
        let mut sources = Sources { text: String::new(), files: Vec::new() };
        sources.add(name, text);
        sources
    }

    /// Takes in one more file and gives its span. All files together must stay below 4 GiB; whoever reads them limits
    /// their size long before.
    pub fn add(&mut self, name: impl Into<String>, text: &str) -> Span {
        if !self.files.is_empty() {
            self.text.push('\n');
        }
        let start = self.text.len();
        self.text.push_str(text);
        let offset = |at: usize| u32::try_from(at).unwrap_or(u32::MAX);
        let span = Span { start: offset(start), end: offset(self.text.len()) };
        let breaks = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| offset(start + at + 1));
        let lines = std::iter::once(span.start).chain(breaks).collect();
        self.files.push(SourceFile { name: name.into(), span, lines });
        span
    }

    /// The texts of all files; what spans are ranges of.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// All files, the main one first.
    pub fn files(&self) -> &[SourceFile] {
        &self.files
    }

    /// The main file.
    pub fn main(&self) -> &SourceFile {
        &self.files[0]
    }

    /// The file that holds an offset.
    pub fn file_at(&self, offset: u32) -> &SourceFile {
        let next = self.files.partition_point(|file| file.span.start <= offset);
        &self.files[next.saturating_sub(1)]
    }

    /// File, line and column of an offset; found by bisection.
    pub fn position(&self, offset: u32) -> Position<'_> {
        let file = self.file_at(offset);
        let mut end = at(offset.min(file.span.end));
        while !self.text.is_char_boundary(end) {
            end -= 1;
        }
        let line = file.lines.partition_point(|start| at(*start) <= end).max(1);
        let start = at(file.lines[line - 1]);
        Position { file: &file.name, line, column: self.text[start..end].chars().count() + 1 }
    }

    /// The lines that a span touches, from the beginning of the first to the end of the last, line end excluded.
    pub fn lines_around(&self, span: Span) -> Span {
        let file = self.file_at(span.start);
        let line_of = |offset: u32| file.lines.partition_point(|start| *start <= offset).max(1);
        let end = span.end.clamp(file.span.start, file.span.end).max(span.start);
        let next = file.lines.get(line_of(end)).map_or(file.span.end, |next| next - 1);
        Span { start: file.lines[line_of(span.start) - 1], end: next }
    }
}

impl SourceFile {
    /// Name as the user gave it, or as the spec names it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its bytes among those of all files.
    pub fn span(&self) -> Span {
        self.span
    }
}

/// A byte range in the text of all files, see [`Sources::text`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

impl Span {
    /// From the first byte to one past the last one, which lie in the text of [`Sources`].
    pub fn of(start: usize, end: usize) -> Span {
        Span { start: number(start), end: number(end) }
    }

    /// The bytes as a range of [`Sources::text`].
    pub fn range(self) -> Range<usize> {
        at(self.start)..at(self.end)
    }

    /// Number of bytes; zero for a span that ends before it begins.
    pub fn length(self) -> usize {
        self.range().len()
    }
}

/// How serious a diagnostic is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The result is usable, but the user should know.
    Warning,
    /// No output is written.
    Error,
}

/// A finding about the spec, with a stable code (`E0xxx`, `W0xxx`).
///
/// Messages start in lower case, carry no full stop and put names in backticks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Stable code; a number is never used again for something else.
    pub code: &'static str,
    /// Error or warning.
    pub severity: Severity,
    /// What is wrong.
    pub message: String,
    /// Where it is wrong; `None` when the finding belongs to the whole model.
    pub span: Option<Span>,
    /// Other places that explain the finding, each with a short text.
    pub labels: Vec<(Span, String)>,
    /// How to mend it.
    pub help: Option<String>,
}

impl Diagnostic {
    /// An error at `span`.
    pub fn error(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        Diagnostic {
            code,
            severity: Severity::Error,
            message: message.into(),
            span: Some(span),
            labels: Vec::new(),
            help: None,
        }
    }

    /// An error that no single place in the spec causes.
    pub fn global(code: &'static str, message: impl Into<String>) -> Self {
        Diagnostic { span: None, ..Diagnostic::error(code, Span::default(), message) }
    }

    /// The same finding as a warning.
    pub fn into_warning(self) -> Self {
        Diagnostic { severity: Severity::Warning, ..self }
    }

    /// Adds the remedy.
    pub fn with_help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Adds a second place.
    pub fn with_label(mut self, span: Span, text: impl Into<String>) -> Self {
        self.labels.push((span, text.into()));
        self
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = if self.severity == Severity::Error { "error" } else { "warning" };
        write!(f, "{severity}[{}]: {}", self.code, self.message)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.start, self.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_those_of_the_file_that_holds_them() {
        let mut sources = Sources::new("a", "one\ntw\u{f6}\n");
        let second = sources.add("b", "");
        let third = sources.add("c", "x\r\n\u{e9}y");
        let at = |offset: u32| {
            let Position { file, line, column } = sources.position(offset);
            let lines = sources.lines_around(Span { start: offset, end: offset });
            (file, line, column, &sources.text()[lines.start as usize..lines.end as usize])
        };
        assert_eq!([at(0), at(3), at(4)], [("a", 1, 1, "one"), ("a", 1, 4, "one"), ("a", 2, 1, "tw\u{f6}")]);
        // Inside of a character, at its end, at the end of the file.
        assert_eq!([at(7), at(8), at(9)], [("a", 2, 3, "tw\u{f6}"), ("a", 2, 4, "tw\u{f6}"), ("a", 3, 1, "")]);
        assert_eq!((second, at(second.start)), (Span { start: 10, end: 10 }, ("b", 1, 1, "")));
        assert_eq!([at(third.start), at(third.start + 5)], [("c", 1, 1, "x\r"), ("c", 2, 2, "\u{e9}y")]);
        assert_eq!([at(third.end), at(u32::MAX)], [("c", 2, 3, "\u{e9}y"), ("c", 2, 3, "\u{e9}y")]);
    }
}
