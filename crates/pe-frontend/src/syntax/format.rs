//! Lays out the text of a spec: blanks between words, indentation, columns. Words, line ends and comments stay.
//!
//! A statement on one line is laid out anew; one over several lines keeps the layout of its writer, for it may be a table
//! with columns of its own.

use crate::report::Report;
use crate::syntax::lexer::{Token, TokenKind, is_keyword, tokenize};
use crate::syntax::statements::text_of;
use crate::syntax::{parser, statements};
use pe_ir::source::{Diagnostic, Severity, Sources};

/// Blanks before a statement of a block.
const INDENT: usize = 4;

/// Most blanks that align a column; lines further apart are not aligned.
const WIDEST: usize = 32;

/// Blanks before a comment behind a statement, at least.
const BEFORE_COMMENT: usize = 2;

/// Statements that give a name a value.
const DECLARATIONS: [&str; 6] = ["param", "const", "input", "state", "angle", "matrix"];

/// Statements whose first words are made equally wide.
const SETTINGS: [&str; 4] = ["solver", "step", "span", "units"];

/// The text of the main file, laid out.
///
/// # Errors
/// The syntax errors of the file: what is not understood is not touched. Files that it names are not read.
pub fn format(sources: &Sources) -> Result<String, Vec<Diagnostic>> {
    let text = sources.text();
    let mut report = Report::default();
    let tokens = tokenize(text, 0, &mut report);
    let statements = statements::split(text, &tokens);
    for statement in &statements {
        if statements::check(text, statement, &mut report) {
            parser::parse_statement(text, statement, &mut report);
        }
    }
    let findings = report.finish();
    if findings.iter().any(|finding| finding.severity == Severity::Error) {
        return Err(findings);
    }
    let mut lines = lines(text, &statements);
    align(&mut lines, |line| line.word.map(|end| (Group::Settings, end)));
    align(&mut lines, |line| line.unit.map(|at| (Group::Declarations, at)));
    align(&mut lines, |line| line.equals);
    align_comments(&mut lines);
    Ok(written(&lines))
}

/// What is aligned with one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Group {
    Settings,
    Declarations,
    Equations,
}

/// A line as it will be written.
#[derive(Debug, Default)]
struct Line {
    /// Blanks before it.
    indent: usize,
    /// Words without the comment.
    code: String,
    comment: String,
    /// Where its first word ends, of a setting.
    word: Option<usize>,
    /// Where its unit stands, of a declaration.
    unit: Option<usize>,
    /// Where its `=` stands, of a statement that gives a value.
    equals: Option<(Group, usize)>,
    /// Whether it belongs to a statement over several lines, or is in any other way left as it is.
    kept: bool,
    /// Whether a comment alone goes on with that of the line before.
    goes_on: bool,
}

/// Number of the line of each token, and the offsets at which lines begin.
fn lines(text: &str, statements: &[Vec<Token>]) -> Vec<Line> {
    let mut starts = vec![0usize];
    starts.extend(text.match_indices('\n').map(|(at, _)| at + 1));
    let line_of = |token: &Token| starts.partition_point(|start| *start <= token.span.range().start) - 1;
    let mut found: Vec<Line> = starts.iter().map(|_| Line::default()).collect();
    let mut ends: Vec<usize> = starts.clone();
    let mut depth = 0usize;
    let mut depths = vec![None; starts.len()];
    for statement in statements {
        let (Some(first), Some(last)) = (statement.first(), statement.last()) else { continue };
        let (from, to) = (line_of(first), line_of(last));
        let closes = text_of(text, *first) == "}";
        depth = if closes { depth.saturating_sub(1) } else { depth };
        depths[from] = depths[from].or(Some(depth));
        depth += usize::from(text_of(text, *last) == "{");
        statement.iter().for_each(|token| ends[line_of(token)] = token.span.range().end);
        if from < to {
            found[from..=to].iter_mut().for_each(|line| line.kept = true);
        } else if !found[from].kept {
            add(&mut found[from], text, statement);
            // What separates assignments of an event.
            let behind = &text[ends[to]..];
            let blanks = behind.len() - behind.trim_start_matches([' ', '\t']).len();
            if behind[blanks..].starts_with(';') {
                found[from].code.push(';');
                ends[to] += blanks + 1;
            }
        }
    }
    let mut inside = 0usize;
    let mut before = false;
    for (number, line) in found.iter_mut().enumerate() {
        let end = starts.get(number + 1).map_or(text.len(), |next| next - 1);
        let all = text[starts[number]..end].trim_start_matches('\u{FEFF}').trim_end();
        let blanks = all.chars().take_while(|c| c.is_whitespace()).count();
        if let Some(depth) = depths[number] {
            inside = depth + usize::from(line.code.ends_with('{'));
            line.indent = INDENT * depth;
        }
        if line.kept {
            // The first line begins where statements do, the others where their writer put them.
            line.code = if depths[number].is_some() { all.trim_start() } else { all }.to_owned();
            before = false;
            continue;
        }
        line.comment =
            text[ends[number].min(end).max(starts[number])..end].trim_start_matches('\u{FEFF}').trim().to_owned();
        if line.code.is_empty() && !line.comment.is_empty() {
            line.goes_on = before && blanks > INDENT * inside + INDENT;
            line.indent = INDENT * inside;
        }
        before = !line.comment.is_empty() && (line.goes_on || !line.code.is_empty());
    }
    found
}

/// Adds a statement to its line.
fn add(line: &mut Line, text: &str, statement: &[Token]) {
    let first = text_of(text, statement[0]);
    let alone = line.code.is_empty();
    if !alone {
        line.code.push(' ');
        (line.word, line.unit, line.equals) = (None, None, None);
    }
    let tight = tight_ranges(text, statement);
    for (at, token) in statement.iter().enumerate() {
        if at > 0 && blank(text, statement, at, tight[at] || tight[at - 1]) {
            line.code.push(' ');
        }
        // `time [ms]` is a setting, `time = ...` an equation.
        let unit_of_time = first == "time" && at == 1 && token.kind == TokenKind::Unit && statement.len() == 2;
        if alone && at == 1 && (SETTINGS.contains(&first) || unit_of_time) {
            line.word = Some(line.code.len());
        }
        let before_value = alone && line.equals.is_none() && DECLARATIONS.contains(&first);
        if before_value && token.kind == TokenKind::Unit && line.unit.is_none() {
            line.unit = Some(line.code.len());
        }
        if alone && token.kind == TokenKind::Equals && line.equals.is_none() {
            let group = match first {
                _ if DECLARATIONS.contains(&first) => Some(Group::Declarations),
                _ if is_keyword(first) => None,
                _ => Some(Group::Equations),
            };
            line.equals = group.map(|group| (group, line.code.len()));
        }
        line.code += text_of(text, *token);
    }
}

/// Which tokens are the `..` of the range of an index, which is written without blanks; those of values are wide.
fn tight_ranges(text: &str, statement: &[Token]) -> Vec<bool> {
    let mut depth = 0usize;
    let mut of_index = text_of(text, statement[0]) == "index";
    let tight = |token: &Token| {
        match (token.kind, text_of(text, *token)) {
            (TokenKind::Open, _) => depth += 1,
            (TokenKind::Close, _) => depth = depth.saturating_sub(1),
            (TokenKind::Word, "for") => of_index = true,
            (TokenKind::Word, "where") => of_index = false,
            (_, "..") => return of_index || depth > 0,
            _ => {}
        }
        false
    };
    statement.iter().map(tight).collect()
}

/// Whether there is a blank before a token that is not the first of its statement.
fn blank(text: &str, statement: &[Token], at: usize, tight: bool) -> bool {
    let (before, token) = (statement[at - 1], statement[at]);
    let (last, word) = (text_of(text, before), text_of(text, token));
    let operand = |token: Token| {
        matches!(
            token.kind,
            TokenKind::Number | TokenKind::Close | TokenKind::Unit | TokenKind::Text | TokenKind::Prime
        ) || (token.kind == TokenKind::Word && !(is_keyword(text_of(text, token)) && text_of(text, token) != "sum"))
    };
    // A sign without an operand before it belongs to what follows.
    let unary = |at: usize| {
        let sign = text_of(text, statement[at]);
        sign == "-" && (at == 0 || !operand(statement[at - 1]))
    };
    if tight || (before.kind == TokenKind::Sign && unary(at - 1)) {
        return false;
    }
    match (before.kind, token.kind) {
        (TokenKind::Open, _) | (_, TokenKind::Close | TokenKind::Prime) => false,
        (_, TokenKind::Dot) | (TokenKind::Dot, _) => false,
        (_, TokenKind::Sign) if matches!(word, "," | ";" | ":") => false,
        (TokenKind::Sign, _) if matches!(last, "," | ";" | ":") => true,
        // What binds its operands tightly is written so.
        (_, TokenKind::Sign) if matches!(word, "*" | "/" | "^") => false,
        (TokenKind::Sign, _) if matches!(last, "*" | "/" | "^") => false,
        // Behind a name a bracket holds indices or arguments.
        (TokenKind::Word, TokenKind::Open) if last == "mod" => at >= 2 && operand(statement[at - 2]),
        (TokenKind::Word, TokenKind::Open) => is_keyword(last) && last != "sum",
        (TokenKind::Close, TokenKind::Open) => false,
        _ => true,
    }
}

/// Makes a column of neighbouring lines equal: `column` tells the group of a line and where blanks go.
fn align(lines: &mut [Line], column: impl Fn(&Line) -> Option<(Group, usize)>) {
    let beside = |one: &Line, other: &Line| {
        let group = |line: &Line| line.equals.map(|(group, _)| group).or(line.word.map(|_| Group::Settings));
        !one.kept && !other.kept && one.indent == other.indent && group(one).is_some() && group(one) == group(other)
    };
    for run in lines.chunk_by_mut(beside) {
        let place = |line: &Line| column(line).filter(|_| !line.kept).map(|(_, at)| at);
        let width = |line: &Line| place(line).map(|at| line.code[..at].chars().count());
        let (least, most) = (run.iter().filter_map(width).min(), run.iter().filter_map(width).max());
        let Some((_, most)) = least.zip(most).filter(|(least, most)| most - least <= WIDEST) else { continue };
        for line in run {
            let Some((at, width)) = place(line).zip(width(line)) else { continue };
            let blanks = most - width;
            line.code.insert_str(at, &" ".repeat(blanks));
            if let Some((_, equals)) = line.equals.as_mut().filter(|(_, equals)| *equals > at) {
                *equals += blanks;
            }
        }
    }
}

/// Puts the comments behind neighbouring statements into one column.
fn align_comments(lines: &mut [Line]) {
    let width = |line: &Line| line.indent + line.code.chars().count();
    let beside = |line: &Line| !line.kept && (line.goes_on || !line.code.is_empty());
    for run in lines.chunk_by_mut(|one, other| beside(one) && beside(other)) {
        if !beside(&run[0]) {
            continue;
        }
        let commented = |line: &&Line| !line.goes_on && !line.comment.is_empty();
        let widths: Vec<usize> = run.iter().filter(commented).map(width).collect();
        let (least, most) = (widths.iter().min().copied().unwrap_or(0), widths.iter().max().copied().unwrap_or(0));
        let mut column = most + BEFORE_COMMENT;
        for line in run.iter_mut().filter(|line| !line.comment.is_empty()) {
            if line.goes_on {
                line.indent = column;
                continue;
            }
            if most - least > WIDEST {
                column = width(line) + BEFORE_COMMENT;
            }
            let blanks = column - width(line);
            line.code += &" ".repeat(blanks);
        }
    }
}

/// The lines, at most one empty one in a row, and none at either end.
fn written(lines: &[Line]) -> String {
    let mut text = String::new();
    let mut gap = false;
    for line in lines {
        let content = format!("{}{}", line.code, line.comment);
        if content.is_empty() {
            gap = !text.is_empty();
            continue;
        }
        if std::mem::take(&mut gap) {
            text.push('\n');
        }
        text += &" ".repeat(line.indent);
        text += content.trim_end();
        text.push('\n');
    }
    text
}
