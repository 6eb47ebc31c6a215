//! Words of a spec, only as far as finding the ends of statements needs them; pest reads each statement in full.

use crate::report::Report;
use pe_ir::codes;
use pe_ir::index::at;
use pe_ir::source::{Diagnostic, Span};

/// Keywords that begin a statement.
pub(crate) const SECTIONS: [&str; 20] = [
    "model",
    "solver",
    "step",
    "span",
    "const",
    "index",
    "param",
    "input",
    "state",
    "output",
    "include",
    "function",
    "units",
    "every",
    "next",
    "matrix",
    "angle",
    "component",
    "instance",
    "when",
];

/// Keywords inside statements.
pub(crate) const INNER_KEYWORDS: [&str; 12] =
    ["if", "then", "else", "sum", "where", "for", "in", "and", "or", "not", "div", "mod"];

/// Names longer than this are taken for a broken file.
const LONGEST_NAME: usize = 200;

/// Whether a word is reserved.
pub(crate) fn is_keyword(word: &str) -> bool {
    SECTIONS.contains(&word) || INNER_KEYWORDS.contains(&word)
}

/// The kinds of words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TokenKind {
    /// Name or keyword.
    Word,
    /// Number.
    Number,
    /// Text in quotes.
    Text,
    /// Unit bracket: a bracket after a blank, up to its end.
    Unit,
    /// `(` or `[`.
    Open,
    /// `)` or `]`.
    Close,
    /// `{` or `}`.
    Brace,
    /// `=`.
    Equals,
    /// `'`.
    Prime,
    /// `.` between the name of an instance and one of its own.
    Dot,
    /// Any other sign: operators, comma, colon, range dots.
    Sign,
    /// End of a line.
    Newline,
    /// Something already reported; the statement around it is broken.
    Bad,
}

/// A word and its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Token {
    pub(crate) kind: TokenKind,
    pub(crate) span: Span,
}

/// Splits the text from an offset on into words and reports what is no word.
pub(crate) fn tokenize(text: &str, from: u32, report: &mut Report) -> Vec<Token> {
    let mut lexer = Lexer { text, at: at(from), depth: 0, in_event: false, tokens: Vec::new(), report };
    while lexer.at < text.len() {
        lexer.word();
    }
    lexer.tokens
}

struct Lexer<'a> {
    text: &'a str,
    at: usize,
    /// Open brackets; a `;` parts rows inside of them.
    depth: usize,
    /// Whether an event is open, whose assignments a `;` parts.
    in_event: bool,
    tokens: Vec<Token>,
    report: &'a mut Report,
}

impl Lexer<'_> {
    fn word(&mut self) {
        let rest = &self.text[self.at..];
        let Some(first) = rest.chars().next() else { return };
        let two = rest.get(..2).unwrap_or("");
        match first {
            ' ' | '\t' | '\r' | '\u{FEFF}' => self.at += first.len_utf8(),
            '\n' => self.push(TokenKind::Newline, 1),
            '/' if two == "//" => self.at += rest.find('\n').unwrap_or(rest.len()),
            'A'..='Z' | 'a'..='z' | '_' => self.name(rest),
            '0'..='9' => self.push(TokenKind::Number, number_length(rest)),
            '"' => self.quoted(rest),
            '[' if self.blank_before() && self.after_name() => self.unit(rest),
            '(' | '[' => {
                self.depth += 1;
                self.push(TokenKind::Open, 1);
            }
            ')' | ']' => {
                self.depth = self.depth.saturating_sub(1);
                self.push(TokenKind::Close, 1);
            }
            '{' | '}' => {
                self.in_event = first == '{' && self.after_when();
                self.push(TokenKind::Brace, 1);
            }
            '\'' => self.push(TokenKind::Prime, 1),
            _ if ["==", "!=", "<=", ">=", ".."].contains(&two) => self.push(TokenKind::Sign, 2),
            '.' if self.within_path(rest) => self.push(TokenKind::Dot, 1),
            '=' => self.push(TokenKind::Equals, 1),
            '+' | '-' | '*' | '/' | '^' | '<' | '>' | ',' | ':' => self.push(TokenKind::Sign, 1),
            ';' if self.depth > 0 || self.in_event => self.push(TokenKind::Sign, 1),
            _ => self.unexpected(first),
        }
    }

    fn push(&mut self, kind: TokenKind, length: usize) {
        let span = Span::of(self.at, self.at + length);
        self.tokens.push(Token { kind, span });
        self.at += length;
    }

    fn name(&mut self, rest: &str) {
        let length = rest.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count();
        if length <= LONGEST_NAME {
            return self.push(TokenKind::Word, length);
        }
        let message = format!("name of {length} characters; the longest allowed has {LONGEST_NAME}");
        self.bad(codes::BAD_LITERAL, length, message, None);
    }

    fn quoted(&mut self, rest: &str) {
        let end = rest[1..].find(['"', '\n']).map_or(rest.len(), |at| at + 1);
        if rest[end..].starts_with('"') {
            return self.push(TokenKind::Text, end + 1);
        }
        self.bad(codes::BRACKETS, end, "text has no closing quote on its line".to_owned(), None);
    }

    fn unit(&mut self, rest: &str) {
        let end = rest.find([']', '\n']).unwrap_or(rest.len());
        if rest[end..].starts_with(']') {
            return self.push(TokenKind::Unit, end + 1);
        }
        let help = "a bracket after a blank holds a unit; indices follow the name directly, as in `V[b]`";
        self.bad(codes::BRACKETS, end, "`[` is not closed on its line".to_owned(), Some(help));
    }

    /// Whether the statement here is the condition of an event.
    fn after_when(&self) -> bool {
        let goes_on = |token: &&Token| !matches!(token.kind, TokenKind::Newline | TokenKind::Brace);
        let first = self.tokens.iter().rev().take_while(goes_on).last();
        first.is_some_and(|first| &self.text[first.span.range()] == "when")
    }

    /// Whether a bracket here can hold the unit of a name; elsewhere it is a table of numbers.
    fn after_name(&self) -> bool {
        self.tokens.last().is_none_or(|last| {
            let word = &self.text[last.span.range()];
            match last.kind {
                TokenKind::Word => !INNER_KEYWORDS.contains(&word),
                TokenKind::Open | TokenKind::Equals | TokenKind::Sign => false,
                _ => true,
            }
        })
    }

    /// Whether a point here stands between two names, as in `cell[3].v`.
    fn within_path(&self, rest: &str) -> bool {
        let named = self.tokens.last().is_some_and(|last| {
            let word = &self.text[last.span.range()];
            last.span.range().end == self.at && (last.kind == TokenKind::Word && !is_keyword(word) || word == "]")
        });
        named && rest[1..].starts_with(|letter: char| letter.is_ascii_alphabetic() || letter == '_')
    }

    fn blank_before(&self) -> bool {
        self.text[..self.at].ends_with([' ', '\t', '\n', '\r'])
    }

    fn unexpected(&mut self, sign: char) {
        let shown = if sign.is_control() { sign.escape_default().to_string() } else { sign.to_string() };
        let next = self.text[self.at + sign.len_utf8()..].chars().next();
        let help = remedy(sign, next);
        // `&&` is one sign to its writer.
        let length = if next == Some(sign) { 2 * sign.len_utf8() } else { sign.len_utf8() };
        self.bad(codes::BAD_CHARACTER, length, format!("unexpected character `{shown}`"), help);
    }

    fn bad(&mut self, code: &'static str, length: usize, message: String, help: Option<&str>) {
        self.push(TokenKind::Bad, length);
        let span = Span::of(self.at - length, self.at);
        let error = Diagnostic::error(code, span, message);
        self.report.push(Diagnostic { help: help.map(str::to_owned), ..error });
    }
}

/// Length of the number at the start of `text`; `1..5` is a range, so a point needs a digit after it.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| bytes[from.min(bytes.len())..].iter().take_while(|b| b.is_ascii_digit()).count();
    let mut length = digits(0);
    if bytes.get(length) == Some(&b'.') && digits(length + 1) > 0 {
        length += 1 + digits(length + 1);
    }
    if matches!(bytes.get(length), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(length + 1), Some(b'+' | b'-')));
        if digits(length + 1 + sign) > 0 {
            length += 1 + sign + digits(length + 1 + sign);
        }
    }
    length
}

/// What the writer of a character most likely wanted.
fn remedy(sign: char, next: Option<char>) -> Option<&'static str> {
    Some(match sign {
        '#' => "comments begin with `//`",
        '%' => "comments begin with `//`; the remainder of integers is `a mod b`",
        '?' => "write `if c then a else b`",
        '~' if next == Some('=') => "write `!=`",
        '~' => "write `not`, or `=` for an equation",
        '\\' => "a linear system is solved by `x = solve(T, b)`",
        '$' | '@' | '`' => "names consist of the letters A to Z and a to z, digits and `_`",
        '.' if matches!(next, Some('*' | '/' | '^')) => {
            "element by element means with indices: `z[i] = a[i]*b[i]`; scalars have plain operators"
        }
        ';' => "a statement ends at the end of its line; no mark is needed",
        '!' => "write `not`, or `!=` for `not equal`",
        '&' => "write `and`",
        '|' => "write `or`; the absolute value is `abs(x)`",
        '.' => "a number needs digits on both sides of its point, a range is written `1..5`",
        '\u{2212}' | '\u{2013}' | '\u{2014}' => "write the minus sign as `-`",
        '\u{00D7}' | '\u{00B7}' | '\u{22C5}' => "write multiplication as `*`",
        '\u{00F7}' | '\u{2215}' => "write division as `/`",
        '\u{00B2}' | '\u{00B3}' | '\u{2070}'..='\u{209C}' => "write powers as `x^2`, and numbers in names as `x2`",
        '\u{221A}' => "write `sqrt(x)`",
        '\u{03C0}' => "write `pi`",
        '\u{201C}' | '\u{201D}' | '\u{201E}' => "write quotes as `\"`",
        '\u{2026}' => "a range is written `1..5`",
        '\u{2019}' | '\u{2032}' => "write the derivative mark as `'`",
        '\u{2264}' => "write `<=`",
        '\u{2265}' => "write `>=`",
        '\u{2260}' => "write `!=`",
        '\u{00A0}' => "this is a no-break space; use a plain one",
        sign if sign.is_alphabetic() => "names consist of the letters A to Z and a to z, digits and `_`",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(text: &str) -> Vec<TokenKind> {
        tokenize(text, 0, &mut Report::default()).iter().map(|token| token.kind).collect()
    }

    #[test]
    fn keywords_of_grammar_and_lexer_agree() {
        let grammar = include_str!("../../grammar/ode.pest");
        let rule = grammar.split("keyword = @{").nth(1).and_then(|rest| rest.split('}').next()).unwrap_or("");
        let words: Vec<&str> = rule.split('"').skip(1).step_by(2).collect();
        assert_eq!(words, [&SECTIONS[..], &INNER_KEYWORDS[..]].concat());
    }

    #[test]
    fn a_blank_makes_a_bracket_a_unit() {
        assert_eq!(kinds("V[b]"), [TokenKind::Word, TokenKind::Open, TokenKind::Word, TokenKind::Close]);
        assert_eq!(kinds("V [\u{3a9} m]"), [TokenKind::Word, TokenKind::Unit]);
    }

    #[test]
    fn characters_of_other_languages_have_a_remedy() {
        for (sign, next) in
            [('?', None), ('%', None), ('~', Some('=')), ('~', None), ('\\', None), ('.', Some('*')), ('\u{b2}', None)]
        {
            assert!(remedy(sign, next).is_some(), "{sign}");
        }
        assert_ne!(remedy('.', Some('*')), remedy('.', None));
    }

    #[test]
    fn numbers_end_before_range_dots_and_units() {
        let lengths = ["1..5", "0.25 Hz", "1e-3", "2e", "3.x", "1E5"].map(number_length);
        assert_eq!(lengths, [1, 4, 4, 1, 1, 3]);
    }
}
