//! Comments that look like the second half of `7 // 2`, the quotient of integers in Python.

use crate::report::Report;
use crate::syntax::lexer::{SECTIONS, Token, TokenKind, is_keyword, tokenize};
use crate::syntax::statements::text_of;
use crate::units::known;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};
use std::collections::BTreeSet;

/// Warns where a value ends in front of a comment that is nothing but numbers, names of the file and operators. A name
/// that is a unit as well is left alone: `c = 3 // s` is a remark.
pub(crate) fn warn(text: &str, statements: &[Vec<Token>], report: &mut Report) {
    let mut names = None;
    for statement in statements {
        let value = statement.iter().skip_while(|token| token.kind != TokenKind::Equals).skip(1);
        for token in value.filter(|token| ends_operand(text, **token)) {
            let rest = &text[token.span.range().end..];
            let blank = rest.len() - rest.trim_start_matches([' ', '\t']).len();
            let Some(comment) = rest[blank..].strip_prefix("//") else { continue };
            let comment = comment.lines().next().unwrap_or("");
            let names = names.get_or_insert_with(|| defined(text, statements));
            if is_divisor(comment, names) {
                let start = token.span.range().end + blank;
                let span = Span::of(start, start + 2 + comment.trim_end().len());
                let message = "this is a comment: nothing is divided here".to_owned();
                let help = "write `a/b`, or `a div b` for the quotient of integers; a remark needs a word of text";
                report.push(Diagnostic::error(codes::COMMENTED_QUOTIENT, span, message).with_help(help).into_warning());
            }
        }
    }
}

/// Whether a word can be the end of what is divided.
fn ends_operand(text: &str, token: Token) -> bool {
    match token.kind {
        TokenKind::Word => !is_keyword(text_of(text, token)),
        TokenKind::Number | TokenKind::Close => true,
        _ => false,
    }
}

/// Names that the statements define.
fn defined<'a>(text: &'a str, statements: &[Vec<Token>]) -> BTreeSet<&'a str> {
    let name = |statement: &Vec<Token>| {
        let mut words = statement.iter().map(|token| text_of(text, *token));
        let first = words.next()?;
        if SECTIONS.contains(&first) { words.next() } else { Some(first) }
    };
    statements.iter().filter_map(name).collect()
}

/// Whether a text is an expression of numbers, names and operators, and nothing else.
fn is_divisor(text: &str, names: &BTreeSet<&str>) -> bool {
    let (mut depth, mut after_operand) = (0usize, false);
    for token in tokenize(text, 0, &mut Report::default()) {
        let word = text_of(text, token);
        let fits = match token.kind {
            TokenKind::Number => !after_operand,
            TokenKind::Word => !after_operand && names.contains(word) && known::find(word).is_none(),
            TokenKind::Open => !after_operand && word == "(",
            TokenKind::Close => after_operand && depth > 0 && word == ")",
            TokenKind::Sign if matches!(word, "+" | "-") => true,
            TokenKind::Sign => after_operand && matches!(word, "*" | "/" | "^"),
            _ => false,
        };
        if !fits {
            return false;
        }
        match token.kind {
            TokenKind::Open => depth += 1,
            TokenKind::Close => depth -= 1,
            _ => {}
        }
        after_operand = !matches!(token.kind, TokenKind::Open | TokenKind::Sign);
    }
    after_operand && depth == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_divisor_is_an_expression_and_no_remark() {
        let names = BTreeSet::from(["n", "s", "rate"]);
        for text in [" 2", " n", "2*n + 1", " -(n - 1)", "1e3 ", " rate^2"] {
            assert!(is_divisor(text, &names), "{text}");
        }
        for text in
            ["", " ", " s", " 1/s", " m", " two", " 2 of them", " n (see below)", " 2,", " 1..3", " ---", "/ 2", " 2 ="]
        {
            assert!(!is_divisor(text, &names), "{text}");
        }
    }
}
