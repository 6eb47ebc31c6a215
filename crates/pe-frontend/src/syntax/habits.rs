//! Left-hand sides as other languages write them: `dx/dt = ...`, `der(x) = ...`, `x(0) = 1`.

use crate::syntax::lexer::{SECTIONS, Token, TokenKind};
use crate::syntax::statements::text_of;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// Functions that stand for a derivative with respect to time elsewhere.
const DERIVATIVES: [&str; 12] =
    ["der", "ddt", "diff", "D", "Dt", "d", "deriv", "derivative", "Derivative", "d_dt", "Differential", "rate"];

/// Names of the time in a denominator, after its `d`.
const TIMES: [&str; 3] = ["dt", "dtime", "dT"];

/// What a left-hand side stands for.
enum Meaning {
    /// The derivative of a quantity.
    Derivative,
    /// The value of a quantity at time zero.
    Initial,
    /// A quantity at the present time.
    Present,
}

/// The error for a left-hand side of another language; none for those of this one.
pub(crate) fn left_side(text: &str, statement: &[Token]) -> Option<Diagnostic> {
    let (name, meaning, end) = read(text, statement)?;
    let span = Span { start: statement.first()?.span.start, end };
    let (message, help) = match meaning {
        Meaning::Derivative => {
            ("a derivative is written with a prime".to_owned(), format!("a derivative is written `{name}' = ...`"))
        }
        Meaning::Initial => (
            format!("the initial value of `{name}` stands in its declaration"),
            format!("declare it as `state {name} = ...`"),
        ),
        Meaning::Present => (
            "the time is not written".to_owned(),
            format!(
                "every quantity is that of the present time: `{name} = ...`, and `{name}' = ...` for its derivative"
            ),
        ),
    };
    Some(Diagnostic::error(codes::SYNTAX, span, message).with_help(help))
}

/// The quantity that such a left-hand side defines.
pub(crate) fn defined<'t>(text: &'t str, statement: &[Token]) -> Option<&'t str> {
    read(text, statement).map(|(name, ..)| name)
}

/// Quantity, meaning and end of a left-hand side of another language.
fn read<'t>(text: &'t str, statement: &[Token]) -> Option<(&'t str, Meaning, u32)> {
    let words: Vec<&str> = statement.iter().map_while(|token| before_equals(text, *token)).collect();
    let end = statement.get(words.len().checked_sub(1)?)?.span.end;
    // What has no `=` is no equation, and statements that begin with a keyword have a meaning of their own.
    statement.get(words.len())?;
    if SECTIONS.contains(&words[0]) {
        return None;
    }
    let derivative = |name| Some((name, Meaning::Derivative, end));
    let time = |word: &str| TIMES.contains(&word);
    let subscripted = |words: &[&str]| matches!(words, [] | ["[", .., "]"]);
    match words.as_slice() {
        // `dx/dt`, `dx[i]/dt`
        [first, middle @ .., "/", last] if time(last) && subscripted(middle) && first.len() > 1 => {
            derivative(first.strip_prefix('d')?)
        }
        // `d(x)/dt`, `d(x[i])/dt`
        ["d", "(", name, middle @ .., ")", "/", last] if time(last) && subscripted(middle) => derivative(name),
        // `d/dt(x)`, `d/dt x`
        ["d", "/", first, "(", name, .., ")"] | ["d", "/", first, name, ..] if time(first) => derivative(name),
        // `der(x)`, `diff(x, t)`
        [function, "(", name, .., ")"] if DERIVATIVES.contains(function) => derivative(name),
        [name, "(", "0" | "0.0", ")"] => Some((name, Meaning::Initial, end)),
        [name, "(", "t" | "time", ")"] => Some((name, Meaning::Present, end)),
        [name, "'", "(", "t" | "time", ")"] | [name, "(", "t" | "time", ")", "'"] => derivative(name),
        _ => None,
    }
}

/// The text of a word on the left of `=`; none for that sign.
fn before_equals(text: &str, token: Token) -> Option<&str> {
    let word = text_of(text, token);
    (token.kind != TokenKind::Equals && word != "==").then_some(word)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Report;
    use crate::syntax::lexer::tokenize;

    fn meant(text: &str) -> Option<&str> {
        let tokens = tokenize(text, 0, &mut Report::default());
        defined(text, &tokens)
    }

    #[test]
    fn derivatives_of_other_languages_are_understood() {
        for left in [
            "dx/dt",
            "dx[i]/dt",
            "d(x)/dt",
            "d(x[1, 2])/dt",
            "d/dt(x)",
            "d/dt x",
            "der(x)",
            "der(x[i])",
            "diff(x, t)",
            "D(x)",
            "x'(t)",
            "x(t)'",
            "x(0)",
            "x(t)",
        ] {
            let text = format!("{left} = -x");
            assert_eq!(meant(&text), Some("x"), "{text}");
        }
    }

    #[test]
    fn left_sides_of_this_language_are_not_touched() {
        for text in
            ["x' = 1", "dx = 1", "x[i]' = 1", "next x = 1", "x [1/s] = 1", "param d [m/dt] = 1", "output x", "d = 1"]
        {
            assert_eq!(meant(text), None, "{text}");
        }
    }
}
