//! Turns a parse error of pest into a diagnostic in the words of the language.

use crate::syntax::ast::MANNERS;
use crate::syntax::grammar::Rule;
use crate::syntax::lexer::{SECTIONS, Token, TokenKind};
use crate::syntax::statements::{keyword_as_name, text_of};
use crate::units::parse::parse;
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
        let next = tokens.iter().find(|token| token.span.start >= found.span.end);
        return keyword_as_name(word, found.span, next.is_some_and(|next| text_of(text, *next) == "("));
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
        | Rule::measured
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
        Rule::kw_after | Rule::after => "`after`",
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

/// What stands around the place where a statement is not understood.
struct Slip<'t> {
    text: &'t str,
    tokens: &'t [Token],
    place: usize,
    expected: &'t [&'t str],
}

impl Slip<'_> {
    fn word(&self) -> &str {
        text_of(self.text, self.tokens[self.place])
    }

    /// The words before, the nearest first, and those after.
    fn before(&self) -> impl Iterator<Item = &Token> {
        self.tokens[..self.place].iter().rev()
    }

    fn after(&self) -> Option<&Token> {
        self.tokens.get(self.place + 1)
    }

    fn wants(&self, what: &str) -> bool {
        self.expected.contains(&what)
    }

    /// Whether the word stands inside of brackets.
    fn bracketed(&self) -> bool {
        let depth = self.before().map(|token| match token.kind {
            TokenKind::Open => -1,
            TokenKind::Close => 1,
            _ => 0,
        });
        depth
            .scan(0, |sum, step: i32| {
                Some({
                    *sum += step;
                    *sum
                })
            })
            .any(|sum| sum < 0)
    }
}

/// Advice for slips that the grammar makes likely.
fn remedy(found: &Token, text: &str, tokens: &[Token], expected: &[&str]) -> Option<String> {
    let place = tokens.iter().position(|token| token.span == found.span)?;
    let slip = Slip { text, tokens, place, expected };
    habit(&slip).or_else(|| slip_of_signs(&slip).map(str::to_owned))
}

/// Advice for what other languages write.
fn habit(slip: &Slip) -> Option<String> {
    let word = slip.word();
    let kind_before = slip.before().next().map(|token| token.kind);
    let first = slip.tokens.first().map_or("", |token| text_of(slip.text, *token));
    let after_number = kind_before == Some(TokenKind::Number);
    let choice = slip.tokens.iter().any(|token| text_of(slip.text, *token) == "if");
    let help = match (slip.tokens[slip.place].kind, word) {
        (TokenKind::Prime, _) if kind_before == Some(TokenKind::Prime) => {
            let name = slip.before().nth(1).map_or("x", |token| text_of(slip.text, *token));
            return Some(format!(
                "equations are of first order: `state v = 0`, then `{name}' = v` and `v' = ...` for the second derivative"
            ));
        }
        (TokenKind::Text, file) if slip.wants("an expression") => {
            return Some(format!("a column of a data file is read by `samples({file}, \"column\", linear)`"));
        }
        (TokenKind::Number, _) | (_, "+" | "-" | "*" | "/" | "^" | "(") if first == "output" && !slip.bracketed() => {
            "an output is a name: write `y = 2*x` and `output y`"
        }
        (TokenKind::Sign, "==") if slip.wants("`=`") => "an equation has one `=`",
        (TokenKind::Sign, ":" | "+" | "-" | "*" | "/" | "<") if slip.wants("`=`") => {
            "an equation is written with `=` alone"
        }
        (TokenKind::Equals | TokenKind::Sign, "=" | ":")
            if matches!(first, "model" | "solver" | "step" | "span" | "units" | "output" | "include")
                && slip.place == 1 =>
        {
            return Some(format!("`{first}` takes no `{word}`: what it is follows after a blank"));
        }
        (TokenKind::Equals, _)
            if matches!(first, "index" | "for" | "sum") || slip.wants("`in`") && slip.bracketed() =>
        {
            "an index runs through a range: `i in 1..5`"
        }
        (TokenKind::Sign, ":") if slip.bracketed() => "a range is written `1..5`",
        (TokenKind::Sign, ",") if choice && slip.wants("an operator") => "write `if c then a else b`",
        (TokenKind::Sign, ",") if after_number && slip.after().is_some_and(|token| token.kind == TokenKind::Number) => {
            "the mark of decimals is a point: `0.5`"
        }
        (TokenKind::Word, "if") if slip.wants("an operator") => "write `if c then a else b`",
        (TokenKind::Word, "end" | "endif" | "elif" | "elseif") if choice => {
            "write `if c then a else if d then b else e`, without a word at its end"
        }
        (TokenKind::Word, "after") if first == "when" => {
            "a delay stands behind the condition: `when x > 1 after 3 ms, priority 2 {`"
        }
        (TokenKind::Word, word) if first == "when" && MANNERS.iter().any(|(manner, _)| *manner == word) => {
            return Some(format!("a comma stands before it: `when x > 1, {word} {{`"));
        }
        (TokenKind::Word, word) if after_number && slip.wants("an operator") && word.starts_with('_') => {
            "digits stand in one group: `1000`"
        }
        (TokenKind::Word, word) if after_number && slip.wants("an operator") => {
            return Some(after_a_number(slip, word));
        }
        (TokenKind::Number, _)
            if slip.wants("an operator")
                && slip.bracketed()
                && matches!(kind_before, Some(TokenKind::Number | TokenKind::Close)) =>
        {
            "the cells of a table are parted by commas: `[1, 2; 3, 4]`"
        }
        (TokenKind::Open, "(") if slip.wants("an operator") => "a product needs its sign: `a*(b + c)`",
        (TokenKind::Open, "(") if matches!(first, "state" | "param" | "input") && slip.wants("`=`") => {
            "indices stand in brackets, `state x[i in 1..3] = 0`; a value follows `=`"
        }
        (TokenKind::Close, ")") if slip.before().nth(2).is_some_and(|token| text_of(slip.text, *token) == "sum") => {
            "a sum names its index: `sum(i: x[i])`"
        }
        _ => return None,
    };
    Some(help.to_owned())
}

/// Advice for a name behind a number: a unit, or a factor.
fn after_a_number(slip: &Slip, word: &str) -> String {
    let number = slip.before().next().map_or("", |token| text_of(slip.text, *token));
    match parse(word) {
        Ok(_) => format!(
            "a unit stands in a bracket after a blank: `{number} [{word}]`; a product needs its sign: `{number}*{word}`"
        ),
        Err(_) => format!("a product needs its sign: `{number}*{word}`"),
    }
}

/// Advice for signs in the wrong place.
fn slip_of_signs(slip: &Slip) -> Option<&'static str> {
    let Slip { text, expected, .. } = *slip;
    let operator = slip.wants("an operator");
    Some(match slip.tokens[slip.place].kind {
        TokenKind::Open if slip.before().next().is_some_and(|token| token.kind == TokenKind::Prime) => {
            "indices come before the prime: `x[i]' = ...`"
        }
        TokenKind::Number
            if slip.after().is_some_and(|token| ["..", "]"].contains(&text_of(text, *token)))
                && expected == ["a name"] =>
        {
            "an index has a name: `state x[i in 1..3] = 0`"
        }
        TokenKind::Word if slip.word() == "for" => {
            "there are no loops: `x[i]' = ...` holds for all of its indices, `x[i]' = ... for i in 2..3` for some"
        }
        TokenKind::Brace => {
            "group with parentheses `( )`, indices with brackets `[ ]`; a block begins with `every 1 ms {`"
        }
        TokenKind::Equals if operator => "`=` defines, `==` compares",
        TokenKind::Prime => {
            "a derivative can only be alone on the left of `=`; to read it elsewhere, name its right-hand side"
        }
        TokenKind::Unit if operator && !expected.contains(&"indices in brackets") => {
            "a unit follows the name in its declaration, `state V [L] = 0`, or a number, `5 [L]`"
        }
        TokenKind::Unit => "a bracket after a blank holds a unit; indices follow the name directly, as in `V[b]`",
        TokenKind::Sign if slip.word() == "*" => "a power is written `x^2`",
        _ => return None,
    })
}
