//! VHDL files as the library `vhdl_lang` parses them, with places in [`Sources`].

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Sources, Span};
use vhdl_lang::ast::{AnyDesignUnit, DesignFile};
use vhdl_lang::{Position, Source, SrcPos, Token, TokenSpan, VHDLParser, VHDLStandard};

/// Most bytes of a file.
const LARGEST: usize = 16 << 20;

/// Most brackets within each other: the parser calls itself for each.
const DEEPEST: usize = 200;

/// A file that a user gives.
#[derive(Clone, Debug)]
pub struct Given {
    /// Path as the user wrote it.
    pub name: String,
    /// Content: UTF-8, or else Latin-1.
    pub content: Vec<u8>,
}

impl Given {
    /// The content as text.
    pub fn text(&self) -> String {
        let latin_1 = |bytes: &[u8]| bytes.iter().map(|byte| char::from(*byte)).collect();
        String::from_utf8(self.content.clone()).unwrap_or_else(|_| latin_1(&self.content))
    }
}

/// A file of which the syntax is known.
pub struct Parsed {
    /// Its bytes in the sources.
    span: Span,
    /// Offset of each line in the sources.
    lines: Vec<usize>,
    file: DesignFile,
}

/// Takes a file into the sources and parses it.
pub fn parsed(given: &Given, sources: &mut Sources, findings: &mut Vec<Diagnostic>) -> Option<Parsed> {
    let text = given.text();
    let span = sources.add(&given.name, &text);
    if given.content.len() > LARGEST {
        let message = format!("`{}` has {} bytes, more than {LARGEST}", given.name, given.content.len());
        let help = "give the file with the entity and those that it needs, not a netlist";
        findings.push(Diagnostic::error(codes::VHDL_LIMITS, Span { end: span.start, ..span }, message).with_help(help));
        return None;
    }
    if let Some(at) = too_deep(&text) {
        let at = span.range().start + at;
        let message = format!("more than {DEEPEST} brackets within each other");
        let finding = Diagnostic::error(codes::VHDL_LIMITS, Span::of(at, at + 1), message);
        findings.push(finding.with_help("split the expression"));
        return None;
    }
    let breaks = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at + 1);
    let lines = std::iter::once(0).chain(breaks).map(|at| span.range().start + at).collect();
    let source = Source::inline(Path::new(&given.name), &latin_1(&text));
    let mut said = Vec::new();
    let parse = || VHDLParser::new(VHDLStandard::VHDL2008).parse_design_source(&source, &mut said);
    let Ok(file) = catch_unwind(AssertUnwindSafe(parse)) else {
        let message = format!("the parser gives up on `{}`", given.name);
        findings.push(Diagnostic::error(codes::VHDL_SYNTAX, Span { end: span.start, ..span }, message));
        return None;
    };
    let parsed = Parsed { span, lines, file };
    for fault in said {
        let place = parsed.place(sources.text(), &fault.pos);
        let finding =
            Diagnostic::error(codes::VHDL_SYNTAX, place, format!("not VHDL-2008: {}", lowered(&fault.message)));
        findings.push(finding.with_help("`ghdl -s --std=08 FILE` checks the syntax of a file"));
    }
    Some(parsed)
}

/// The same text with a Latin-1 character in place of every other: the parser knows no others, and comments may have them.
fn latin_1(text: &str) -> String {
    let known = |c: char| if u32::from(c) < 256 { c.to_string() } else { "?".repeat(c.len_utf16()) };
    if text.is_ascii() { text.to_owned() } else { text.chars().map(known).collect() }
}

/// Where brackets are too deep within each other, comments and texts left aside.
fn too_deep(text: &str) -> Option<usize> {
    let bytes = text.as_bytes();
    let (mut depth, mut at) = (0_usize, 0);
    while at < bytes.len() {
        let rest = &bytes[at..];
        let length = |end: Option<usize>| end.map_or(rest.len(), |end| end + 1);
        at += match rest {
            [b'-', b'-', ..] => length(rest.iter().position(|byte| *byte == b'\n')),
            [b'/', b'*', ..] => length(rest.windows(2).position(|pair| pair == b"*/")),
            [quote @ (b'"' | b'\\'), tail @ ..] => {
                1 + tail.iter().position(|b| b == quote || *b == b'\n').map_or(tail.len(), |end| end + 1)
            }
            [b'\'', _, b'\'', ..] => 3,
            _ => 1,
        };
        match rest[0] {
            b'(' => depth += 1,
            b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > DEEPEST {
            return Some(at - 1);
        }
    }
    None
}

/// A message of the parser in the style of ours.
fn lowered(message: &str) -> String {
    let mut characters = message.trim_end_matches('.').chars();
    let first = characters.next().map(|c| c.to_lowercase().to_string()).unwrap_or_default();
    (first + characters.as_str()).replace('\'', "`")
}

impl Parsed {
    /// Its bytes in the sources.
    pub fn span(&self) -> Span {
        self.span
    }

    /// Its design units, each with its tokens.
    pub fn units(&self) -> impl Iterator<Item = (&Vec<Token>, &AnyDesignUnit)> {
        self.file.design_units.iter().map(|(tokens, unit)| (tokens, unit))
    }

    /// Place of tokens of a unit.
    #[expect(clippy::ptr_arg, reason = "the library gives access to tokens in a `Vec` only")]
    pub fn span_of(&self, text: &str, tokens: &Vec<Token>, span: TokenSpan) -> Span {
        self.place(text, &span.pos(tokens))
    }

    fn place(&self, text: &str, place: &SrcPos) -> Span {
        let [start, end] = [place.range.start, place.range.end].map(|position| self.offset(text, position));
        Span::of(start, end.max(start))
    }

    /// The parser counts lines, and units of UTF-16 in a line.
    fn offset(&self, text: &str, position: Position) -> usize {
        let line = usize::try_from(position.line).unwrap_or(usize::MAX);
        let end = self.span.range().end;
        let Some(start) = self.lines.get(line) else { return end };
        let mut left = usize::try_from(position.character).unwrap_or(usize::MAX);
        let mut at = *start;
        for character in text[at..end].chars() {
            if left == 0 || character == '\n' {
                break;
            }
            left = left.saturating_sub(character.len_utf16());
            at += character.len_utf8();
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_the_text() {
        let text = "-- \u{2192} \u{1f600} \u{b5}\nentity e is\nend entity; entity \u{e9} s is";
        let given = Given { name: "a.vhd".into(), content: text.into() };
        let (mut sources, mut findings) = (Sources::new("b", "x"), Vec::new());
        let parsed = parsed(&given, &mut sources, &mut findings).unwrap();
        assert_eq!(parsed.units().count(), 1);
        let [finding, ..] = &findings[..] else { panic!("it is wrong") };
        let place = sources.position(finding.span.unwrap().start);
        assert_eq!((place.file, place.line, &sources.text()[finding.span.unwrap().range()]), ("a.vhd", 3, "\u{e9}"));
    }

    #[test]
    fn deep_brackets_are_noticed_outside_of_comments_and_texts() {
        assert_eq!(too_deep(&"(".repeat(DEEPEST)), None);
        assert_eq!(too_deep(&"(".repeat(DEEPEST + 1)), Some(DEEPEST));
        let all = "(".repeat(2 * DEEPEST);
        for text in
            [format!("-- {all}"), format!("\"{all}\""), format!("/* {all} */ ("), "()".repeat(999), "'('".repeat(999)]
        {
            assert_eq!(too_deep(&text), None, "{text}");
        }
    }
}
