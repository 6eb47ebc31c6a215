//! Source text, positions in it, and diagnostics.

use std::fmt;

/// A spec file: its display name and its text.
#[derive(Clone, Debug)]
pub struct SourceFile {
    /// Name as the user gave it; shown in diagnostics, never opened again.
    pub name: String,
    /// The whole text.
    pub text: String,
}

impl SourceFile {
    /// 1-based line and column (in characters) of a byte offset.
    pub fn line_column(&self, offset: usize) -> (usize, usize) {
        let mut end = offset.min(self.text.len());
        while !self.text.is_char_boundary(end) {
            end -= 1;
        }
        let before = &self.text[..end];
        let line = before.bytes().filter(|b| *b == b'\n').count() + 1;
        let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
        (line, column)
    }

    /// Text of a 1-based line, without its line end.
    pub fn line(&self, number: usize) -> &str {
        self.text.lines().nth(number.saturating_sub(1)).unwrap_or("")
    }
}

/// A byte range in the source file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
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

    /// Renders the finding with file, line, caret and help, as a compiler would.
    pub fn render(&self, source: &SourceFile) -> String {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        let mut text = format!("{severity}[{}]: {}\n", self.code, self.message);
        let places = self.span.map(|span| (span, String::new())).into_iter();
        for (span, label) in places.chain(self.labels.iter().cloned()) {
            text += &render_place(source, span, &label);
        }
        if self.span.is_none() {
            text += &format!("  --> {}\n", source.name);
        }
        if let Some(help) = &self.help {
            text += &format!("  = help: {help}\n");
        }
        text
    }
}

fn render_place(source: &SourceFile, span: Span, label: &str) -> String {
    // Long lines are cut around the caret so that a megabyte on one line stays readable.
    const CONTEXT: usize = 60;
    let (line, column) = source.line_column(span.start as usize);
    let shown: Vec<char> = source.line(line).chars().collect();
    let from = (column - 1).saturating_sub(CONTEXT);
    let to = shown.len().min(column - 1 + CONTEXT);
    let excerpt: String = shown[from.min(to)..to].iter().map(|c| if c.is_control() { ' ' } else { *c }).collect();
    let end = (span.end as usize).min(source.text.len()).max(span.start as usize);
    let width = source.text.get(span.start as usize..end).map_or(1, |t| t.lines().next().unwrap_or("").chars().count());
    let width = width.clamp(1, (to + 1).saturating_sub(column).max(1));
    let gutter = line.to_string().len();
    format!(
        "{0:gutter$}--> {1}:{line}:{column}\n{0:gutter$} |\n{line} | {excerpt}\n{0:gutter$} | {2}{3}{4}{label}\n",
        "",
        source.name,
        " ".repeat(column - 1 - from),
        "^".repeat(width),
        if label.is_empty() { "" } else { " " },
    )
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.start, self.end)
    }
}
