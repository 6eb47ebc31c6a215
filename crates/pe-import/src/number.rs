//! Numbers as they were written.

use crate::expr::Expr;

/// The literal of a number: with its text, where the language can hold it; `None` if the text is no finite number.
pub fn literal(text: &str) -> Option<Expr> {
    let text = text.trim();
    let plain = text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    let value: f64 = text.parse().ok().filter(|value: &f64| plain && value.is_finite())?;
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let number = Expr::Number(
        value.abs(),
        Some(digits.to_owned()).filter(|digits| is_literal(digits)).or_else(|| mended(digits)),
    );
    Some(if negative && value != 0.0 { number.negated() } else { number })
}

/// The literal `mantissa * 10^exponent` of two texts.
pub fn with_exponent(mantissa: &str, exponent: &str) -> Option<Expr> {
    let (mantissa, exponent) = (mantissa.trim(), exponent.trim());
    let power: i64 = exponent.trim_start_matches('+').parse().ok()?;
    literal(&if power == 0 { mantissa.to_owned() } else { format!("{mantissa}e{power}") })
}

/// Whether the language reads the text as one number.
fn is_literal(text: &str) -> bool {
    let (mantissa, exponent) = match text.find(['e', 'E']) {
        Some(at) => (&text[..at], Some(text[at + 1..].trim_start_matches(['+', '-']))),
        None => (text, None),
    };
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let mantissa = match mantissa.split_once('.') {
        Some((whole, part)) => digits(whole) && digits(part),
        None => digits(mantissa),
    };
    mantissa && exponent.is_none_or(digits) && text.len() <= 60
}

/// `.5` and `5.` with the digit that the language wants.
fn mended(text: &str) -> Option<String> {
    let (mantissa, exponent) = text.split_at(text.find(['e', 'E']).unwrap_or(text.len()));
    let (whole, part) = mantissa.split_once('.')?;
    let digit = |text: &str| if text.is_empty() { "0".to_owned() } else { text.to_owned() };
    Some(format!("{}.{}{exponent}", digit(whole), digit(part))).filter(|text| is_literal(text))
}

/// A number without a text of its own, as short as it reads back to the same bits.
pub fn shown(value: f64) -> String {
    if value == value.trunc() && value.abs() < 1e7 {
        format!("{value}")
    } else if (1e-4..1e7).contains(&value.abs()) {
        format!("{value:?}")
    } else {
        format!("{value:e}")
    }
}
