//! Items of a text, one line each, and their fields.

use std::fmt::Display;
use std::ops::Range;
use std::str::FromStr;

use crate::index;
use crate::source::Span;

use super::writer::plain_length;
use super::{TextError, is_blank};

/// The lines of a section that say something.
#[derive(Clone, Debug)]
pub struct Lines<'a> {
    text: &'a str,
    rest: Range<usize>,
}

impl<'a> Lines<'a> {
    pub(super) fn new(text: &'a str, rest: Range<usize>) -> Lines<'a> {
        Lines { text, rest }
    }

    /// An error behind the last line.
    pub fn error(&self, message: impl Into<String>) -> TextError {
        TextError::at(self.text, self.rest.end..self.rest.end, message.into())
    }

    /// The next line, if it begins with a word.
    pub fn next_if(&mut self, word: &str) -> Option<Line<'a>> {
        let mut ahead = self.clone();
        let mut line = ahead.next()?;
        if line.take_word(word) {
            *self = ahead;
            return Some(line);
        }
        None
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        while !self.rest.is_empty() {
            let start = self.rest.start;
            let rest = &self.text[self.rest.clone()];
            let length = rest.find('\n').map_or(rest.len(), |end| end + 1);
            self.rest.start += length;
            let line = &rest[..length];
            if !is_blank(line) {
                let from = start + (line.len() - line.trim_start().len());
                let end = start + line.trim_end().len();
                return Some(Line { text: self.text, begin: from, at: from, last: from..from, end });
            }
        }
        None
    }
}

/// A line whose fields are read one after the other.
#[derive(Clone, Debug)]
pub struct Line<'a> {
    text: &'a str,
    begin: usize,
    at: usize,
    /// What was read last.
    last: Range<usize>,
    end: usize,
}

impl<'a> Line<'a> {
    /// Its bytes without blanks around them.
    pub fn span(&self) -> Span {
        Span { start: index::number(self.begin), end: index::number(self.end) }
    }

    /// The bytes of the field that was read last.
    pub fn last(&self) -> Span {
        Span { start: index::number(self.last.start), end: index::number(self.last.end) }
    }

    /// What is not read yet, without blanks in front.
    pub fn rest(&mut self) -> &'a str {
        let rest = &self.text[self.at..self.end];
        self.at += rest.len() - rest.trim_start().len();
        &self.text[self.at..self.end]
    }

    /// Whether all fields are read.
    pub fn is_done(&mut self) -> bool {
        self.rest().is_empty()
    }

    fn take(&mut self, length: usize) -> &'a str {
        let range = self.at..self.at + length;
        self.last = range.clone();
        self.at = range.end;
        &self.text[range]
    }

    /// Something else was expected at the next field.
    pub fn expected(&mut self, what: impl Display) -> TextError {
        let rest = self.rest();
        let length = match plain_length(rest) {
            0 => rest.find(char::is_whitespace).unwrap_or(rest.len()),
            length => length,
        };
        let found = if length == 0 { "the end of the line".to_owned() } else { format!("`{}`", &rest[..length]) };
        TextError::at(self.text, self.at..self.at + length, format!("expected {what}, found {found}"))
    }

    /// An error about the field that was read last.
    pub fn error(&self, message: impl Into<String>) -> TextError {
        TextError::at(self.text, self.last.clone(), message.into())
    }

    /// An error about a field that was read before.
    pub fn error_at(&self, span: Span, message: impl Into<String>) -> TextError {
        TextError::at(self.text, index::at(span.start)..span.end as usize, message.into())
    }

    /// Reads a word if it is next.
    pub fn take_word(&mut self, word: &str) -> bool {
        let rest = self.rest();
        let next = rest.strip_prefix(word).is_some_and(|after| {
            !after.starts_with(|letter: char| letter.is_ascii_alphanumeric() || "_.~[".contains(letter))
        });
        if next {
            self.take(word.len());
        }
        next
    }

    /// Reads a sign if it is next.
    pub fn take_sign(&mut self, sign: &str) -> bool {
        let next = self.rest().starts_with(sign);
        if next {
            self.take(sign.len());
        }
        next
    }

    /// # Errors
    /// Another word is next.
    pub fn word(&mut self, word: &str) -> Result<(), TextError> {
        if self.take_word(word) { Ok(()) } else { Err(self.expected(format!("`{word}`"))) }
    }

    /// # Errors
    /// Another sign is next.
    pub fn sign(&mut self, sign: &str) -> Result<(), TextError> {
        if self.take_sign(sign) { Ok(()) } else { Err(self.expected(format!("`{sign}`"))) }
    }

    /// # Errors
    /// The line goes on.
    pub fn done(&mut self) -> Result<(), TextError> {
        if self.is_done() { Ok(()) } else { Err(self.expected("the end of the line")) }
    }

    /// One of some words, as its place among them.
    ///
    /// # Errors
    /// Another word is next.
    pub fn one_of(&mut self, words: &[&str]) -> Result<usize, TextError> {
        match words.iter().position(|word| self.take_word(word)) {
            Some(index) => Ok(index),
            None => Err(self.expected(format!("one of {}", words.join(", ")))),
        }
    }

    /// A name, with or without quotes. `what` says of what.
    ///
    /// # Errors
    /// There is none, or its quotes do not end.
    pub fn name(&mut self, what: &str) -> Result<String, TextError> {
        let rest = self.rest();
        if rest.starts_with('"') {
            return self.quoted();
        }
        match plain_length(rest) {
            0 => Err(self.expected(what)),
            length => Ok(self.take(length).to_owned()),
        }
    }

    /// Whether the next field is a name.
    pub fn has_name(&mut self) -> bool {
        let rest = self.rest();
        rest.starts_with('"') || plain_length(rest) > 0
    }

    /// A text in quotes.
    ///
    /// # Errors
    /// There is none, or its quotes do not end.
    pub fn quoted(&mut self) -> Result<String, TextError> {
        let rest = self.rest();
        if !rest.starts_with('"') {
            return Err(self.expected("a text in quotes"));
        }
        let mut text = String::new();
        let mut letters = rest.char_indices().skip(1);
        while let Some((at, letter)) = letters.next() {
            match letter {
                '"' => {
                    self.take(at + 1);
                    return Ok(text);
                }
                '\\' => match letters.next() {
                    Some((_, 'n')) => text.push('\n'),
                    Some((_, letter @ ('"' | '\\'))) => text.push(letter),
                    Some((at, 'u')) => {
                        let hex = rest[at + 1..].strip_prefix('{').and_then(|rest| rest.split_once('}'));
                        let letter = hex.and_then(|(hex, _)| char::from_u32(u32::from_str_radix(hex, 16).ok()?));
                        match hex.zip(letter) {
                            Some(((hex, _), letter)) => {
                                text.push(letter);
                                (0..hex.len() + 2).for_each(|_| _ = letters.next());
                            }
                            None => return Err(self.expected("`\\u{...}` with the number of a character in quotes")),
                        }
                    }
                    _ => return Err(self.expected("`\\\"`, `\\\\`, `\\n` or `\\u{...}` where quotes have a `\\`")),
                },
                letter => text.push(letter),
            }
        }
        self.take(rest.len());
        Err(self.error("quotes that do not end"))
    }

    /// Letters up to the next blank.
    pub fn field(&mut self) -> Option<&'a str> {
        let rest = self.rest();
        let length = rest.find(char::is_whitespace).unwrap_or(rest.len());
        (length > 0).then(|| self.take(length))
    }

    /// All that is not read yet.
    pub fn take_rest(&mut self) -> &'a str {
        let length = self.rest().len();
        self.take(length)
    }

    /// The digits of a number without sign at the beginning of the rest, with point and exponent.
    fn digits(&mut self) -> usize {
        let rest = self.rest().as_bytes();
        let digits = |from: usize| rest[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
        let mut length = digits(0);
        if length == 0 {
            return 0;
        }
        if rest.get(length) == Some(&b'.') {
            length += 1 + digits(length + 1);
        }
        if matches!(rest.get(length), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(rest.get(length + 1), Some(b'-' | b'+')));
            let exponent = digits(length + 1 + sign);
            if exponent > 0 {
                length += 1 + sign + exponent;
            }
        }
        length
    }

    /// Whether a number without sign is next.
    pub fn has_digits(&mut self) -> bool {
        self.digits() > 0
    }

    /// A finite number without sign.
    ///
    /// # Errors
    /// There is none.
    pub fn magnitude(&mut self) -> Result<f64, TextError> {
        let length = self.digits();
        if length == 0 {
            return Err(self.expected("a number"));
        }
        let number = self.take(length).parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.error("a number too large for double precision"))
    }

    /// A finite number.
    ///
    /// # Errors
    /// There is none.
    pub fn number(&mut self) -> Result<f64, TextError> {
        if self.take_sign("-") {
            let begin = self.last.start;
            let magnitude = self.magnitude()?;
            self.last.start = begin;
            return Ok(-magnitude);
        }
        self.magnitude()
    }

    /// A number that may be infinite.
    ///
    /// # Errors
    /// There is none.
    pub fn any_number(&mut self) -> Result<f64, TextError> {
        if self.take_word("inf") {
            return Ok(f64::INFINITY);
        }
        if self.take_sign("-inf") {
            return Ok(f64::NEG_INFINITY);
        }
        self.number()
    }

    /// A whole number of a type's range.
    ///
    /// # Errors
    /// There is none.
    pub fn integer<T: FromStr>(&mut self) -> Result<T, TextError> {
        let rest = self.rest();
        let sign = usize::from(rest.starts_with('-'));
        let length = sign + rest[sign..].bytes().take_while(u8::is_ascii_digit).count();
        match rest[..length].parse() {
            Ok(number) => {
                self.take(length);
                Ok(number)
            }
            Err(_) => Err(self.expected("a whole number in range")),
        }
    }

    /// A word, and a whole number behind it.
    ///
    /// # Errors
    /// One of them is not there.
    pub fn keyed<T: FromStr>(&mut self, word: &str) -> Result<T, TextError> {
        self.word(word)?;
        self.integer()
    }

    /// A word, and a finite number behind it.
    ///
    /// # Errors
    /// One of them is not there.
    pub fn keyed_number(&mut self, word: &str) -> Result<f64, TextError> {
        self.word(word)?;
        self.number()
    }
}
