//! Turns a parse error of pest into a diagnostic in the words of the language.

use crate::syntax::grammar::Rule;
use crate::syntax::lexer::{SECTIONS, Token, TokenKind};
use crate::syntax::statements::{keyword_as_name, text_of};
use pe_ir::codes;
use pe_ir::index::number;
use pe_ir::source::{Diagnostic, Span};
use pest::error::{Error, ErrorVariant, InputLocation};

/// The diagnostic for a statement at `span` that pest refused.
pub(crate) fn describe(error: &Error<Rule>, text: &str, tokens: &[Token], span: Span) -> Diagnostic {
    let offset = match error.location {
        InputLocation::Pos(at) | InputLocation::Span((at, _)) => span.start + number(at),
    };
    let expected = match &error.variant {
        ErrorVariant::ParsingError { positives, .. } => expectations(positives),
        ErrorVariant::CustomError { .. } => Vec::new(),
    };
    // Pest stops before blanks and comments; the word after them is what the writer sees.
    let Some(found) = tokens.iter().find(|token| token.span.end > offset) else {
        let message = format!("the statement ends too early, expected {}", alternatives(&expected));
        let last = Span { start: span.end.saturating_sub(1).max(span.start), end: span.end };
        let last = if text.is_char_boundary(last.range().start) { last } else { span };
        return Diagnostic::error(codes::SYNTAX, last, message);
    };
    let word = text_of(text, *found);
    let wants_name = expected.contains(&"a name") || expected.contains(&"an expression");
    if wants_name && (SECTIONS.contains(&word) || word == "sum") {
        return keyword_as_name(word, found.span);
    }
    let shown = if word.chars().count() > 20 {
        format!("{}...", word.chars().take(20).collect::<String>())
    } else {
        word.to_owned()
    };
    let message = format!("expected {}, found `{shown}`", alternatives(&expected));
    let diagnostic = Diagnostic::error(codes::SYNTAX, found.span, message);
    match remedy(found, text, tokens, &expected) {
        Some(help) => diagnostic.with_help(help),
        None => diagnostic,
    }
}

/// What pest could have gone on with, in plain words, each once, in order of first mention.
fn expectations(rules: &[Rule]) -> Vec<&'static str> {
    let mut words = Vec::new();
    for rule in rules {
        let word = in_words(*rule);
        if !words.contains(&word) {
            words.push(word);
        }
    }
    // A place that takes an expression takes each of its beginnings; naming them all hides the message.
    if words.contains(&"an expression") {
        words.retain(|word| !matches!(*word, "a name" | "`-`" | "`not`" | "`if`" | "`sum`"));
    }
    words
}

fn in_words(rule: Rule) -> &'static str {
    match rule {
        Rule::EOI => "the end of the statement",
        Rule::name | Rule::declared | Rule::binder | Rule::binding | Rule::reference | Rule::output_item => "a name",
        Rule::expr
        | Rule::number
        | Rule::call
        | Rule::data
        | Rule::matrix
        | Rule::row
        | Rule::data_word
        | Rule::samples
        | Rule::samples_word
        | Rule::function
        | Rule::conditional
        | Rule::sum
        | Rule::measure
        | Rule::range => "an expression",
        Rule::add
        | Rule::subtract
        | Rule::multiply
        | Rule::divide
        | Rule::power
        | Rule::kw_div
        | Rule::kw_mod
        | Rule::equal
        | Rule::not_equal
        | Rule::less
        | Rule::less_equal
        | Rule::greater
        | Rule::greater_equal
        | Rule::kw_and
        | Rule::kw_or => "an operator",
        Rule::negate => "`-`",
        Rule::kw_not => "`not`",
        Rule::equals => "`=`",
        Rule::block_start => "`{`",
        Rule::block_end => "`}`",
        Rule::prime => "`'`",
        Rule::unit | Rule::unit_text => "a unit in brackets",
        Rule::unit_name => "a unit",
        Rule::dimensions | Rule::subscripts => "indices in brackets",
        Rule::text | Rule::text_body => "a text in quotes",
        Rule::kw_if => "`if`",
        Rule::kw_sum => "`sum`",
        Rule::kw_then => "`then`",
        Rule::kw_else => "`else`",
        Rule::kw_tunable | Rule::tunable => "`tunable`",
        Rule::kw_symmetric | Rule::symmetric => "`symmetric`",
        Rule::kw_in | Rule::within => "`in`",
        Rule::kw_for | Rule::for_clause => "`for`",
        Rule::kw_where | Rule::where_clause => "`where`",
        _ => "something else",
    }
}

fn alternatives(words: &[&str]) -> String {
    match words {
        [] => "something else".to_owned(),
        [word] => (*word).to_owned(),
        [first @ .., last] => format!("{} or {last}", first.join(", ")),
    }
}

/// Advice for slips that the grammar makes likely.
fn remedy(found: &Token, text: &str, tokens: &[Token], expected: &[&str]) -> Option<&'static str> {
    let operator = expected.contains(&"an operator");
    let after_number = tokens.iter().any(|token| token.kind == TokenKind::Number && token.span.end == found.span.start);
    let place = tokens.iter().position(|token| token.span == found.span);
    let before = place.and_then(|place| tokens.get(place.checked_sub(1)?));
    let after = place.and_then(|place| tokens.get(place + 1));
    Some(match found.kind {
        TokenKind::Open if before.is_some_and(|token| token.kind == TokenKind::Prime) => {
            "indices come before the prime: `x[i]' = ...`"
        }
        TokenKind::Number
            if after.is_some_and(|token| ["..", "]"].contains(&text_of(text, *token))) && expected == ["a name"] =>
        {
            "an index has a name: `state x[i in 1..3] = 0`"
        }
        TokenKind::Word if text_of(text, *found) == "for" => {
            "there are no loops: `x[i]' = ...` holds for all of its indices, `x[i]' = ... for i in 2..3` for some"
        }
        TokenKind::Brace => {
            "group with parentheses `( )`, indices with brackets `[ ]`; a block begins with `every 1 ms {`"
        }
        TokenKind::Word if operator && after_number => "a product needs its sign: `2*x`",
        TokenKind::Equals if operator => "`=` defines, `==` compares",
        TokenKind::Prime => {
            "a derivative can only be alone on the left of `=`; to read it elsewhere, name its right-hand side"
        }
        TokenKind::Unit if operator && !expected.contains(&"indices in brackets") => {
            "a unit follows the name in its declaration: `state V [L] = 0`"
        }
        TokenKind::Unit => "a bracket after a blank holds a unit; indices follow the name directly, as in `V[b]`",
        TokenKind::Sign if text_of(text, *found) == "*" => "a power is written `x^2`",
        _ => return None,
    })
}
