//! The words of the language, for editors: what can be written where, with the arguments that it takes.

use crate::language::functions::FUNCTIONS;
use crate::language::measures::{FREQUENCIES, TIMES};
use crate::language::waveforms::{SAMPLES, WAVEFORMS};
use crate::language::words::{OF_ARRAYS, PREDEFINED, TIME};
use crate::report::Report;
use crate::syntax::lexer::{INNER_KEYWORDS, SECTIONS, TokenKind, is_keyword, tokenize};
use crate::units::dimension::Units;
use crate::units::known;
use pe_ir::source::Span;

/// Words that mean something in one place only and are names elsewhere.
pub const CONTEXTUAL: [&str; 7] = ["until", "tunable", "symmetric", "time", "after", "hold", "linear"];

/// Keywords that begin a statement.
pub fn statements() -> &'static [&'static str] {
    &SECTIONS
}

/// Keywords inside of statements.
pub fn keywords() -> &'static [&'static str] {
    &INNER_KEYWORDS
}

/// Whether a word is a name that a spec may define: letters, digits and `_`, no keyword and nothing of the language.
///
/// # Errors
/// Why it is not.
pub fn definable(word: &str) -> Result<(), String> {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
    if word.is_empty() || !word.chars().all(plain) || word.starts_with(|first: char| first.is_ascii_digit()) {
        return Err(
            "a name consists of the letters A to Z and a to z, digits and `_`, and does not begin with a digit"
                .to_owned(),
        );
    }
    let mut report = Report::default();
    tokenize(word, 0, &mut report);
    if let Some(problem) = report.finish().into_iter().next() {
        return Err(problem.message);
    }
    if is_keyword(word) {
        return Err(format!("`{word}` is a keyword"));
    }
    if constants().any(|known| known == word) || functions().any(|known| known.name == word) {
        return Err(format!("`{word}` is a word of the language"));
    }
    Ok(())
}

/// A function or signal of the language.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Call {
    /// Its name.
    pub name: &'static str,
    /// How it is called, `sine(amplitude, frequency, offset = .., phase = ..)` without what need not be there in `[..]`.
    pub signature: String,
    /// Whether it is a signal over time.
    pub signal: bool,
}

/// Functions and signals.
pub fn functions() -> impl Iterator<Item = Call> {
    let plain = FUNCTIONS.iter().map(|function| {
        let names: &[&str] = match function.arguments {
            (1, _) => &["x"],
            (2, 2) => &["a", "b"],
            _ => &["a", "b", ".."],
        };
        Call { name: function.name, signature: format!("{}({})", function.name, names.join(", ")), signal: false }
    });
    let arrays = OF_ARRAYS.iter().map(|(name, arguments)| {
        let names = match arguments {
            1 => "A",
            2 => "A, b",
            _ => "M, f, J, gap, bend, penalty, rate",
        };
        Call { name, signature: format!("{name}({names})"), signal: false }
    });
    let signals = WAVEFORMS.iter().map(|(name, arguments, needed)| {
        let needs: Vec<&str> = arguments[..*needed].iter().map(|(argument, _)| *argument).collect();
        let more: String = arguments[*needed..].iter().map(|(argument, _)| format!("[, {argument}]")).collect();
        Call { name, signature: format!("{name}({}{more})", needs.join(", ")), signal: true }
    });
    let files = [
        (SAMPLES, "samples(\"file.csv\", \"column\", linear)", true),
        ("data", "data(\"file.csv\", \"column\")", false),
        ("rows", "rows(\"file.csv\")", false),
    ];
    let files = files.map(|(name, signature, signal)| Call { name, signature: signature.to_owned(), signal });
    plain.chain(arrays).chain(signals).chain(files)
}

/// Numbers with a name, and the time.
pub fn constants() -> impl Iterator<Item = &'static str> {
    PREDEFINED.iter().map(|(name, _)| *name).chain([TIME])
}

/// Units of times and frequencies, which stand behind a number.
pub fn measures() -> impl Iterator<Item = &'static str> {
    TIMES.iter().chain(&FREQUENCIES).map(|(name, _)| *name)
}

/// Units that stand in brackets, without prefixes.
pub fn units() -> impl Iterator<Item = &'static str> {
    known::names()
}

/// How strictly units are checked: what stands behind `units`.
pub fn modes() -> impl Iterator<Item = &'static str> {
    Units::ALL.iter().map(|(name, _)| *name)
}

/// The kinds of words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordKind {
    /// A keyword.
    Keyword,
    /// A name.
    Name,
    /// A number.
    Number,
    /// Text in quotes.
    Text,
    /// A unit in brackets behind a blank.
    Unit,
    /// `//` and what follows on the line.
    Comment,
    /// An operator, bracket or other sign.
    Sign,
    /// What is no word of the language.
    Unknown,
}

/// A word and its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word {
    /// Its kind.
    pub kind: WordKind,
    /// Its place.
    pub span: Span,
}

/// The words of a text in order, comments among them, blanks and line ends not.
pub fn words(text: &str) -> Vec<Word> {
    let mut words = Vec::new();
    let mut done = 0;
    let comments = |words: &mut Vec<Word>, from: usize, to: usize| {
        let mut at = from;
        while let Some(start) = text[at..to].find("//").map(|found| at + found) {
            let end = text[start..to].find('\n').map_or(to, |found| start + found);
            words.push(Word { kind: WordKind::Comment, span: Span::of(start, end) });
            at = end;
        }
    };
    for token in tokenize(text, 0, &mut Report::default()) {
        let range = token.span.range();
        comments(&mut words, done, range.start);
        done = range.end;
        let kind = match token.kind {
            TokenKind::Newline => continue,
            TokenKind::Word if is_keyword(&text[range]) => WordKind::Keyword,
            TokenKind::Word => WordKind::Name,
            TokenKind::Number => WordKind::Number,
            TokenKind::Text => WordKind::Text,
            TokenKind::Unit => WordKind::Unit,
            TokenKind::Bad => WordKind::Unknown,
            TokenKind::Open
            | TokenKind::Close
            | TokenKind::Brace
            | TokenKind::Equals
            | TokenKind::Prime
            | TokenKind::Dot
            | TokenKind::Sign => WordKind::Sign,
        };
        words.push(Word { kind, span: token.span });
    }
    comments(&mut words, done, text.len());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_cover_the_text_and_tell_comments_from_signs() {
        let text = "a = 1/2 // half // of it\n// alone\nb [m] = \"x // y\"";
        let kinds: Vec<WordKind> = words(text).iter().map(|word| word.kind).collect();
        use WordKind::{Comment, Name, Number, Sign, Text, Unit};
        assert_eq!(kinds, [Name, Sign, Number, Sign, Number, Comment, Comment, Name, Unit, Sign, Text]);
        assert_eq!(&text[words(text)[5].span.range()], "// half // of it");
    }

    #[test]
    fn contextual_words_are_those_of_the_grammar() {
        let grammar = include_str!("../grammar/ode.pest");
        let known: Vec<&str> = grammar
            .lines()
            .filter_map(|line| line.strip_prefix("kw_"))
            .filter_map(|line| line.split('"').nth(1))
            .filter(|word| !is_keyword(word))
            .collect();
        assert_eq!(known, ["until", "tunable", "symmetric", "time", "after"]);
        assert_eq!(CONTEXTUAL[..5], known);
    }

    #[test]
    fn names_of_the_language_cannot_be_defined() {
        for word in ["", "2a", "a b", "\u{e9}", "state", "pi", "time", "sin", "sine", "solve", "data", "mod"] {
            assert!(definable(word).is_err(), "{word}");
        }
        assert!(definable(&"a".repeat(201)).is_err());
        for word in ["a", "_", "tunable", "x2", "stated", "hold"] {
            assert_eq!(definable(word), Ok(()));
        }
    }
}
