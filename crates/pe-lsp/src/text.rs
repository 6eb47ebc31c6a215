//! Places in a text as the protocol counts them: lines, and UTF-16 code units within a line.

use gen_lsp_types::{Position, Range, TextDocumentContentChangeEvent};

/// Where the lines of a text begin. `\n`, `\r\n` and `\r` end a line.
#[derive(Clone, Debug)]
pub(crate) struct Lines(Vec<usize>);

impl Lines {
    pub(crate) fn of(text: &str) -> Lines {
        let bytes = text.as_bytes();
        let ends = |at: usize| bytes[at] == b'\n' || (bytes[at] == b'\r' && bytes.get(at + 1) != Some(&b'\n'));
        Lines(std::iter::once(0).chain((0..bytes.len()).filter(|at| ends(*at)).map(|at| at + 1)).collect())
    }

    /// The position of an offset; one inside of a character is that of the character, one behind the text its end.
    pub(crate) fn position(&self, text: &str, offset: usize) -> Position {
        let mut end = offset.min(text.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let line = self.0.partition_point(|start| *start <= end) - 1;
        let units = text[self.0[line]..end].chars().map(char::len_utf16).sum();
        Position { line: number(line), character: number(units) }
    }

    /// The offset of a position; beyond the end of a line or of the text it is that end.
    pub(crate) fn offset(&self, text: &str, position: Position) -> usize {
        let line = usize::try_from(position.line).unwrap_or(usize::MAX);
        let Some(start) = self.0.get(line).copied() else { return text.len() };
        let end = self.0.get(line + 1).copied().unwrap_or(text.len());
        let content = text[start..end].trim_end_matches(['\n', '\r']);
        let mut units = 0;
        for (at, letter) in content.char_indices() {
            if units >= position.character {
                return start + at;
            }
            units += number(letter.len_utf16());
        }
        start + content.len()
    }

    pub(crate) fn range(&self, text: &str, range: std::ops::Range<usize>) -> Range {
        Range { start: self.position(text, range.start), end: self.position(text, range.end) }
    }
}

fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// The text after a change in the editor.
pub(crate) fn changed(text: &str, change: TextDocumentContentChangeEvent) -> String {
    match change {
        TextDocumentContentChangeEvent::TextDocumentContentChangeWholeDocument(whole) => whole.text,
        TextDocumentContentChangeEvent::TextDocumentContentChangePartial(part) => {
            let lines = Lines::of(text);
            let (one, other) = (lines.offset(text, part.range.start), lines.offset(text, part.range.end));
            [&text[..one.min(other)], &part.text, &text[one.max(other)..]].concat()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_utf16_units_and_all_line_ends() {
        let text = "a\u{1d465}b\r\n\u{e9}\tc\rd\n";
        let lines = Lines::of(text);
        let places: Vec<(u32, u32)> = [0, 1, 5, 6, 8, 10, 11, 13, 14, 99]
            .into_iter()
            .map(|offset| lines.position(text, offset))
            .map(|position| (position.line, position.character))
            .collect();
        assert_eq!(places, [(0, 0), (0, 1), (0, 3), (0, 4), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (3, 0)]);
        for offset in (0..=text.len()).filter(|offset| text.is_char_boundary(*offset)) {
            // Between `\r` and `\n` no cursor stands.
            if offset != 7 {
                assert_eq!(lines.offset(text, lines.position(text, offset)), offset);
            }
        }
    }

    #[test]
    fn positions_beyond_the_text_are_its_ends() {
        let text = "ab\r\nc";
        let lines = Lines::of(text);
        let offset = |line, character| lines.offset(text, Position { line, character });
        assert_eq!([offset(0, 99), offset(1, 99), offset(9, 0), offset(u32::MAX, u32::MAX)], [2, 5, 5, 5]);
        // The second half of a pair of units is taken for the place behind it.
        assert_eq!(Lines::of("\u{1d465}x").offset("\u{1d465}x", Position { line: 0, character: 1 }), 4);
    }
}
