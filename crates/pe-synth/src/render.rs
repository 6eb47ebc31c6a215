//! Findings as text with source lines, and as JSON.

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};
use pe_ir::source::{Diagnostic, Position, Severity, Sources, Span};
use serde_json::{Value, json};

/// Columns that an excerpt may take.
const WIDTH: usize = 120;

/// Places further apart, in bytes, are shown as excerpts of their own: within a line, and over several lines.
const NEAR_IN_LINE: u32 = 160;
const NEAR: u32 = 4096;

/// Excerpts of longer lines would take seconds; of these only the place is named.
const LONGEST_LINE: u32 = 1 << 20;

/// A marked place.
struct Mark<'a> {
    span: Span,
    primary: bool,
    label: &'a str,
}

/// A finding with the lines it is about, its help, and colours for a terminal.
pub fn for_people(finding: &Diagnostic, sources: &Sources) -> String {
    rendered(finding, sources, &Renderer::styled()) + "\n\n"
}

/// The same without colours.
pub fn plain(finding: &Diagnostic, sources: &Sources) -> String {
    rendered(finding, sources, &Renderer::plain())
}

fn rendered(finding: &Diagnostic, sources: &Sources, renderer: &Renderer) -> String {
    let level = match finding.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let labels: Vec<(Span, String)> = finding.labels.iter().map(|(span, text)| (*span, visible(text))).collect();
    let excerpts = excerpts(finding.span, &labels, sources);
    let names: Vec<String> = excerpts.iter().map(|marks| name_of(marks[0].span, sources)).collect();
    let mut group = Group::with_title(level.primary_title(visible(&finding.message)).id(finding.code));
    for (marks, name) in excerpts.iter().zip(&names) {
        group = excerpt(group, marks, name, sources);
    }
    if excerpts.is_empty() {
        group = group.element(Origin::path(visible(sources.main().name())));
    }
    if let Some(help) = &finding.help {
        group = group.element(Level::HELP.message(visible(help)));
    }
    renderer.clone().term_width(WIDTH).render(&[group])
}

/// A finding as one JSON object; its keys are in `docs/report.md`.
pub fn for_tools(finding: &Diagnostic, sources: &Sources) -> Value {
    let labels: Vec<Value> =
        finding.labels.iter().map(|(span, text)| json!({"place": place(*span, sources), "text": text})).collect();
    let file = finding.span.map_or(sources.main().name(), |span| sources.file_at(span.start).name());
    json!({
        "severity": if finding.severity == Severity::Error { "error" } else { "warning" },
        "kind": "model",
        "code": finding.code,
        "message": finding.message,
        "file": file,
        "place": finding.span.map(|span| place(span, sources)),
        "labels": labels,
        "help": finding.help,
    })
}

/// Lines, columns and bytes of a span, counted in its file.
fn place(span: Span, sources: &Sources) -> Value {
    let Position { file, line, column } = sources.position(span.start);
    let end = sources.position(span.end);
    let base = sources.file_at(span.start).span().start;
    json!({
        "file": file,
        "line": line,
        "column": column,
        "end_line": end.line,
        "end_column": end.column,
        "start": span.start - base,
        "end": span.end - base,
    })
}

/// Marks that are shown together: near each other and in one file. The excerpt with the primary mark comes first.
fn excerpts<'a>(primary: Option<Span>, labels: &'a [(Span, String)], sources: &Sources) -> Vec<Vec<Mark<'a>>> {
    // A label at the place of the finding itself is its text.
    let own = labels.iter().position(|(span, _)| Some(*span) == primary);
    let first = primary.map(|span| Mark { span, primary: true, label: own.map_or("", |at| &labels[at].1) });
    let others = labels.iter().enumerate().filter(|(at, _)| Some(*at) != own);
    let others = others.map(|(_, (span, label))| Mark { span: *span, primary: false, label });
    let mut marks: Vec<Mark> = first.into_iter().chain(others).collect();
    marks.sort_by_key(|mark| (mark.span.start, mark.span.end));
    let mut groups: Vec<Vec<Mark>> = Vec::new();
    for mark in marks {
        match groups.last_mut() {
            Some(group) if group.last().is_some_and(|last| near(last.span, mark.span, sources)) => group.push(mark),
            _ => groups.push(vec![mark]),
        }
    }
    groups.sort_by_key(|group| !group.iter().any(|mark| mark.primary));
    groups
}

fn near(a: Span, b: Span, sources: &Sources) -> bool {
    let same_file = sources.file_at(a.start).span() == sources.file_at(b.start).span();
    let same_line = sources.lines_around(a) == sources.lines_around(b);
    same_file && b.start.saturating_sub(a.end) <= if same_line { NEAR_IN_LINE } else { NEAR }
}

fn name_of(span: Span, sources: &Sources) -> String {
    visible(sources.file_at(span.start).name())
}

fn excerpt<'a>(group: Group<'a>, marks: &[Mark<'a>], name: &'a str, sources: &'a Sources) -> Group<'a> {
    let union = marks.iter().fold(marks[0].span, |union, mark| Span {
        start: union.start.min(mark.span.start),
        end: union.end.max(mark.span.end),
    });
    let lines = sources.lines_around(union);
    let Position { line, column, .. } = sources.position(marks[0].span.start);
    let text = &sources.text()[lines.start as usize..lines.end as usize];
    if text.lines().any(|line| line.len() > LONGEST_LINE as usize) {
        return group.element(Origin::path(name).line(line).char_column(column));
    }
    let first_line = sources.position(lines.start).line;
    let annotations = marks.iter().map(|mark| {
        let kind = if mark.primary { AnnotationKind::Primary } else { AnnotationKind::Context };
        let range = (mark.span.start - lines.start) as usize..(mark.span.end - lines.start) as usize;
        kind.span(range).label((!mark.label.is_empty()).then_some(mark.label))
    });
    group.element(Snippet::source(text).path(name).line_start(first_line).annotations(annotations))
}

/// A text on one line in which nothing is hidden: control characters, and those that turn the direction of writing,
/// are written out.
pub fn visible(text: &str) -> String {
    let hidden = |c: char| {
        c.is_control()
            || matches!(c, '\u{61C}' | '\u{200B}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2060}'..='\u{2069}' | '\u{FEFF}')
    };
    text.chars().map(|c| if hidden(c) { c.escape_default().to_string() } else { c.to_string() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    /// The finding about the nth `@` of a text that is shown without them.
    fn rendered(parts: &[(&str, &str)], labels: &[(&str, &str)]) -> String {
        let mut sources = Sources::new(parts[0].0, parts[0].1);
        for (name, text) in &parts[1..] {
            sources.add(*name, text);
        }
        let find = |word: &str| {
            let start = sources.text().find(word).unwrap_or_else(|| panic!("no {word}")) as u32;
            Span { start, end: start + word.len() as u32 }
        };
        let mut finding = Diagnostic::error("E0201", find(labels[0].0), labels[0].1).with_help("mend it");
        for (word, text) in &labels[1..] {
            finding = finding.with_label(find(word), *text);
        }
        anstream::adapter::strip_str(&for_people(&finding, &sources)).to_string()
    }

    #[test]
    fn marks_stand_under_their_words_whatever_the_width_of_characters() {
        let text = "\tx' = \u{8D28}\u{91CF} + e\u{301}*zz // no line end";
        let shown = rendered(&[("m.spec", text)], &[("zz", "unknown"), ("x'", "of this")]);
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[..2], ["error[E0201]: unknown", " --> m.spec:1:15"], "{shown}");
        // Two wide characters and a combining one: 2 columns more, 1 less than characters.
        let column = |line: &str, mark: char| line.chars().take_while(|c| *c != mark).count();
        assert_eq!(column(lines[4], '^'), column(lines[3], 'z') + 2 - 1, "{shown}");
        assert!(lines[4].contains("--") && shown.contains("of this") && shown.contains("= help: mend it"), "{shown}");
    }

    #[test]
    fn labels_in_other_files_and_far_away_have_excerpts_of_their_own() {
        let far = format!("param r = 1\n{}x' = qq\n", "// nothing\n".repeat(100_000));
        let shown = rendered(
            &[("m.spec", &far), ("lib/a.spec", "state s = 0\n")],
            &[("qq", "unknown"), ("param r", "first"), ("state s", "second")],
        );
        for part in ["--> m.spec:100002:6", "::: m.spec:1:1", "::: lib/a.spec:1:1", "first", "second"] {
            assert!(shown.contains(part), "no {part} in\n{shown}");
        }
        assert!(shown.len() < 1000, "{shown}");
    }

    #[test]
    fn a_megabyte_on_one_line_is_cut_around_the_marks() {
        let begin = Instant::now();
        let line =
            format!("{}first + {}second + {}\n", "a + ".repeat(1000), "b + ".repeat(120_000), "c + ".repeat(1000));
        let shown = rendered(&[("m.spec", &line)], &[("second", "twice"), ("first", "here")]);
        assert!(shown.contains("second") && shown.contains("here") && shown.len() < 1000, "{shown}");
        let longer = format!("{}first\n", "a + ".repeat(1 << 20));
        let shown = rendered(&[("m.spec", &longer)], &[("first", "unknown")]);
        assert!(shown.contains("m.spec:1:4194305") && shown.len() < 1000, "{shown}");
        assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    }

    #[test]
    fn nothing_in_a_name_or_text_reaches_the_terminal_as_a_command() {
        let shown =
            rendered(&[("a\nb\u{1b}[2J", "x = \u{1b}[31m y\u{202E}")], &[("y", "\u{1b}]0;\u{7}"), ("x", "\u{9b}\r")]);
        let commands: Vec<char> = shown.chars().filter(|c| c.is_control() && *c != '\n').collect();
        assert!(commands.is_empty() && !shown.contains('\u{202E}'), "{commands:?} in {shown:?}");
    }

    #[test]
    fn places_for_tools_count_within_their_file() {
        let mut sources = Sources::new("m.spec", "x = 1\n");
        let lib = sources.add("lib.spec", "\u{e9}\nab\n");
        let span = Span { start: lib.start + 3, end: lib.start + 5 };
        let finding = for_tools(&Diagnostic::error("E0201", span, "unknown"), &sources);
        let wanted =
            json!({"file": "lib.spec", "line": 2, "column": 1, "end_line": 2, "end_column": 3, "start": 3, "end": 5});
        assert_eq!((&finding["place"], &finding["file"]), (&wanted, &json!("lib.spec")));
        let global = for_tools(&Diagnostic::global("E0303", "no output"), &sources);
        assert_eq!((&global["place"], &global["file"]), (&Value::Null, &json!("m.spec")));
    }
}
