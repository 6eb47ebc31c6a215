//! Splits the text into statements and checks each one's brackets and nesting, so that one broken statement does not
//! hide the others and no input can make the recursive parser overflow its stack.

use crate::language::habits as words;
use crate::nearest::suggestion;
use crate::report::Report;
use crate::syntax::ast::Broken;
use crate::syntax::habits;
use crate::syntax::lexer::{SECTIONS, Token, TokenKind, is_keyword};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// Deepest nesting of brackets, `if`, signs and powers. Every later pass may recurse this deep.
const DEEPEST: usize = 200;

/// Cuts the words into statements, line ends removed.
pub(crate) fn split(text: &str, tokens: &[Token]) -> Vec<Vec<Token>> {
    let mut statements = Vec::new();
    let mut current: Vec<Token> = Vec::new();
    let (mut depth, mut slips) = (0usize, 0usize);
    // Whether the statements are those of an event, which a semicolon separates, too.
    let mut in_event = false;
    for (at, token) in tokens.iter().enumerate() {
        match token.kind {
            TokenKind::Newline => {
                let rest = &tokens[at + 1..];
                if let Some(last) = current.last()
                    && ends_here(text, *last, depth, rest)
                    && !(depth == 1 && names_another(text, &current, rest))
                {
                    statements.push(std::mem::take(&mut current));
                    (depth, slips) = (0, 0);
                }
                continue;
            }
            TokenKind::Open => depth += 1,
            TokenKind::Close => depth = depth.saturating_sub(1),
            TokenKind::Sign if in_event && depth == 0 && text_of(text, *token) == ";" => {
                if !current.is_empty() {
                    statements.push(std::mem::take(&mut current));
                }
                continue;
            }
            TokenKind::Brace => {
                // `{` ends the statement that begins a block, `}` is a statement of its own. Braces elsewhere are a slip
                // within their statement.
                let begins = text_of(text, *token) == "{";
                let first = current.first().map_or("", |first| text_of(text, *first));
                if begins && !matches!(first, "every" | "component" | "when") {
                    slips += 1;
                } else if !begins && slips > 0 {
                    slips -= 1;
                } else {
                    if !begins && !current.is_empty() {
                        statements.push(std::mem::take(&mut current));
                    }
                    current.push(*token);
                    statements.push(std::mem::take(&mut current));
                    in_event = begins && first == "when";
                    depth = 0;
                    continue;
                }
            }
            _ => {}
        }
        current.push(*token);
    }
    if !current.is_empty() {
        statements.push(current);
    }
    statements
}

/// Whether the statement whose last word is `last` ends at this line end.
fn ends_here(text: &str, last: Token, depth: usize, rest: &[Token]) -> bool {
    // Of several line ends in a row, the last one decides; that keeps the look-ahead short.
    let Some(next) = rest.first() else { return true };
    if next.kind == TokenKind::Newline {
        return false;
    }
    begins_statement(text, rest) || (depth == 0 && !asks_for_more(text, last) && !continues(text, *next))
}

/// Whether the list of what an instance is told, or of the parameters of a component, goes on in the next line.
fn names_another(text: &str, current: &[Token], rest: &[Token]) -> bool {
    let word = |token: Option<&Token>| token.map_or("", |token| text_of(text, *token));
    let named = |second: &Token| matches!(second.kind, TokenKind::Equals | TokenKind::Unit);
    matches!(word(current.first()), "instance" | "component")
        && matches!(word(current.last()), "(" | ",")
        && !SECTIONS.contains(&word(rest.first()))
        && rest.get(1).is_some_and(named)
}

/// Whether a line looks like the start of a statement whatever stands before it: a bracket left open on one line
/// must not swallow the rest of the file.
fn begins_statement(text: &str, line: &[Token]) -> bool {
    let Some(first) = line.first().filter(|token| token.kind == TokenKind::Word) else { return false };
    let word = text_of(text, *first);
    if is_keyword(word) {
        return SECTIONS.contains(&word);
    }
    let mut depth = 0usize;
    for pair in line.windows(2) {
        match pair[1].kind {
            TokenKind::Open => depth += 1,
            TokenKind::Close if depth > 0 => depth -= 1,
            TokenKind::Equals if depth == 0 => return true,
            TokenKind::Prime | TokenKind::Unit | TokenKind::Dot => {}
            TokenKind::Word if depth == 0 && pair[0].kind == TokenKind::Dot => {}
            TokenKind::Newline => return false,
            _ if depth == 0 => return false,
            _ => {}
        }
    }
    false
}

/// Whether a word at the end of a line says that the statement goes on.
fn asks_for_more(text: &str, token: Token) -> bool {
    match token.kind {
        TokenKind::Sign | TokenKind::Equals => true,
        TokenKind::Word => is_keyword(text_of(text, token)),
        _ => false,
    }
}

/// Whether a word at the start of a line says that it belongs to the line before.
fn continues(text: &str, token: Token) -> bool {
    match token.kind {
        TokenKind::Sign | TokenKind::Equals | TokenKind::Close => true,
        TokenKind::Word => {
            matches!(text_of(text, token), "and" | "or" | "div" | "mod" | "then" | "else" | "where" | "for" | "in")
        }
        _ => false,
    }
}

/// Checks a statement before it is parsed. On `false` an error has been reported and parsing it makes no sense.
pub(crate) fn check(text: &str, statement: &[Token], report: &mut Report) -> bool {
    if statement.iter().any(|token| token.kind == TokenKind::Bad) {
        return false;
    }
    let problem = habits::left_side(text, statement)
        .or_else(|| first_word(text, statement))
        .or_else(|| brackets(text, statement))
        .or_else(|| depth(text, statement));
    match problem {
        Some(problem) => {
            report.push(problem);
            false
        }
        None => true,
    }
}

/// A first word that begins no statement, or a keyword where a statement names something.
fn first_word(text: &str, statement: &[Token]) -> Option<Diagnostic> {
    let first = *statement.first()?;
    let word = text_of(text, first);
    let second = statement.get(1).copied();
    if SECTIONS.contains(&word) {
        let second = second?;
        let name = text_of(text, second);
        let names_something =
            !matches!(word, "solver" | "step" | "span" | "output" | "include" | "units" | "every" | "when");
        return (names_something && is_keyword(name)).then(|| keyword_as_name(name, second.span, false));
    }
    if first.kind != TokenKind::Word {
        return None;
    }
    if is_keyword(word) {
        let left_side =
            second.is_some_and(|t| matches!(t.kind, TokenKind::Equals | TokenKind::Prime) || text_of(text, t) == "[");
        return left_side.then(|| keyword_as_name(word, first.span, false));
    }
    // `ouput w`: two words in a row are no equation, and neither is one alone.
    let other = |second: &Token| matches!(second.kind, TokenKind::Word | TokenKind::Number | TokenKind::Text);
    second.is_none_or(|second| other(&second)).then_some(())?;
    let section = second.filter(|second| second.kind == TokenKind::Word).and_then(|_| suggestion(word, SECTIONS));
    let help = section.or_else(|| words::statement(word).map(str::to_owned))?;
    Some(Diagnostic::error(codes::SYNTAX, first.span, format!("no statement begins with `{word}`")).with_help(help))
}

/// The error for a keyword in the place of a name; `called` says that a bracket follows, as behind a function.
pub(crate) fn keyword_as_name(word: &str, span: Span, called: bool) -> Diagnostic {
    let help = match word {
        "step" if called => {
            "a signal that steps is `pulse(1, 0.5 s, 1e9 s)`, a pulse that outlasts the run; of a variable it is \
             `if x >= 0 then 1 else 0`"
                .to_owned()
        }
        _ => format!("choose another name, for example `{word}_`"),
    };
    Diagnostic::error(codes::KEYWORD_AS_NAME, span, format!("`{word}` is a keyword and cannot be a name"))
        .with_help(help)
}

/// A bracket without partner.
fn brackets(text: &str, statement: &[Token]) -> Option<Diagnostic> {
    let mut open: Vec<Token> = Vec::new();
    for token in statement {
        let sign = text_of(text, *token);
        if token.kind == TokenKind::Open {
            open.push(*token);
        } else if token.kind == TokenKind::Close {
            let Some(partner) = open.pop() else {
                return Some(Diagnostic::error(
                    codes::BRACKETS,
                    token.span,
                    format!("`{sign}` has no opening partner"),
                ));
            };
            let opening = text_of(text, partner);
            if (opening == "(") != (sign == ")") {
                let message = format!("`{opening}` is closed by `{sign}`");
                return Some(
                    Diagnostic::error(codes::BRACKETS, token.span, message).with_label(partner.span, "opened here"),
                );
            }
        }
    }
    let innermost = open.last()?;
    let message = format!("`{}` is not closed before the next statement", text_of(text, *innermost));
    Some(Diagnostic::error(codes::BRACKETS, innermost.span, message))
}

/// Nesting deeper than the limit. Counts whatever makes the parser recurse: brackets, `if`, and runs of prefix signs
/// and powers.
fn depth(text: &str, statement: &[Token]) -> Option<Diagnostic> {
    let mut outer: Vec<(usize, usize, bool)> = Vec::new();
    let (mut base, mut run) = (0usize, 0usize);
    // Whether the indices of a sum are being named: each is a sum inside the last one.
    let mut naming = false;
    let mut after_operand = false;
    for (at, token) in statement.iter().enumerate() {
        let word = text_of(text, *token);
        match token.kind {
            TokenKind::Open => {
                outer.push((base, run, naming));
                (base, run) = (base + run + 1, 0);
                naming = at > 0 && text_of(text, statement[at - 1]) == "sum";
                after_operand = false;
            }
            TokenKind::Close => {
                (base, run, naming) = outer.pop().unwrap_or_default();
                after_operand = true;
            }
            TokenKind::Sign if naming && word == "," => (base, run, after_operand) = (base + 1, 0, false),
            TokenKind::Sign if word == ":" => (naming, run, after_operand) = (false, 0, false),
            // Its branches reach as far as the bracket, so its level ends with the bracket, too.
            TokenKind::Word if word == "if" => (base, run, after_operand) = (base + run + 1, 0, false),
            TokenKind::Word if word == "not" => run += 1,
            TokenKind::Word if word == "sum" => {}
            TokenKind::Word if is_keyword(word) => (run, after_operand) = (0, false),
            TokenKind::Sign => {
                let nests = word == "^" || (word == "-" && !after_operand);
                run = if nests { run + 1 } else { 0 };
                after_operand = false;
            }
            _ => after_operand = true,
        }
        if base + run > DEEPEST {
            let message = format!("expression nested more than {DEEPEST} levels deep");
            return Some(
                Diagnostic::error(codes::TOO_DEEP, token.span, message)
                    .with_help("give parts of it names of their own, as algebraic equations or constants"),
            );
        }
    }
    None
}

/// What can be made out of a statement that does not parse.
pub(crate) fn salvage(text: &str, statement: &[Token]) -> Broken {
    let mut words = statement.iter().filter(|token| token.kind == TokenKind::Word).map(|token| text_of(text, *token));
    let first = words.next().unwrap_or("");
    if let Some(name) = habits::defined(text, statement) {
        return Broken { section: String::new(), names: vec![name.to_owned()] };
    }
    if !SECTIONS.contains(&first) {
        return Broken { section: String::new(), names: vec![first.to_owned()] };
    }
    // An `index` statement may define several names.
    let defined = if first == "index" { usize::MAX } else { 1 };
    Broken { section: first.to_owned(), names: words.take(defined).map(str::to_owned).collect() }
}

/// Source text of a word.
pub(crate) fn text_of(text: &str, token: Token) -> &str {
    text.get(token.span.range()).unwrap_or("")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::lexer::tokenize;

    fn statements(text: &str) -> Vec<String> {
        let tokens = tokenize(text, 0, &mut Report::default());
        let join = |words: &Vec<Token>| words.iter().map(|t| text_of(text, *t)).collect::<Vec<_>>().join(" ");
        split(text, &tokens).iter().map(join).collect()
    }

    #[test]
    fn a_line_is_a_statement() {
        assert_eq!(statements("step 1 s // note\n\nspan 2 s\n"), ["step 1 s", "span 2 s"]);
    }

    #[test]
    fn operators_and_open_brackets_carry_a_statement_over_line_ends() {
        assert_eq!(statements("a = 1 +\n 2"), ["a = 1 + 2"]);
        assert_eq!(statements("a = 1 // one\n // more\n + 2"), ["a = 1 + 2"]);
        assert_eq!(statements("a = (1\n\n2)"), ["a = ( 1 2 )"]);
        assert_eq!(statements("a = 1\nwhere b > 2"), ["a = 1 where b > 2"]);
        assert_eq!(statements("output a,\n b"), ["output a , b"]);
    }

    #[test]
    fn an_open_bracket_ends_at_the_next_statement() {
        assert_eq!(statements("a = (1 + 2\nb[1]' = 3\n"), ["a = ( 1 + 2", "b [ 1 ] ' = 3"]);
        assert_eq!(statements("a = f(1,\noutput a"), ["a = f ( 1 ,", "output a"]);
    }

    #[test]
    fn what_an_instance_is_told_may_stand_in_lines() {
        let told = "instance a = Cell(\n E = 1,\n\n drive [V] = f(2,\n3), b = 1)";
        assert_eq!(statements(told), ["instance a = Cell ( E = 1 , drive [V] = f ( 2 , 3 ) , b = 1 )"]);
        assert_eq!(statements("component A(p = 1,\n q [s] = 2) {\n}"), ["component A ( p = 1 , q [s] = 2 ) {", "}"]);
        assert_eq!(statements("instance a = Cell(E = 1,\nx' = 3"), ["instance a = Cell ( E = 1 ,", "x ' = 3"]);
        assert_eq!(statements("instance a = Cell(E = f(1,\nx = 3"), ["instance a = Cell ( E = f ( 1 ,", "x = 3"]);
        assert_eq!(statements("instance a = Cell(E = 1,\noutput a"), ["instance a = Cell ( E = 1 ,", "output a"]);
    }

    #[test]
    fn a_comparison_does_not_begin_a_statement() {
        assert_eq!(statements("a = (if\nb == 1 then 1 else 2)"), ["a = ( if b == 1 then 1 else 2 )"]);
    }
}
