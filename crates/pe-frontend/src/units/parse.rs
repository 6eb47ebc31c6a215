//! Reads the text of a unit.

use crate::units::dimension::Dimension;
use crate::units::known::{find, suggest};
use pe_ir::index::number;
use pe_ir::source::Span;

/// Why a text is no unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct UnitError {
    /// The bytes of the text that are wrong.
    pub(crate) start: usize,
    pub(crate) end: usize,
    pub(crate) message: String,
    pub(crate) help: Option<String>,
}

/// Most characters of a unit that are looked at.
const LONGEST: usize = 200;

/// Deepest nesting of brackets in a unit.
const DEEPEST: usize = 20;

/// Reads a unit: names with powers, joined by `*` and `/`, and brackets; `1` is a number.
pub(crate) fn parse(text: &str) -> Result<Dimension, UnitError> {
    let mut parser = Parser { text, at: 0, depth: 0 };
    if text.len() > LONGEST {
        return Err(parser.error(0, text.len(), format!("a unit of more than {LONGEST} bytes")));
    }
    let unit = parser.product()?;
    parser.blanks();
    if parser.at < text.len() {
        let end = parser.at + parser.rest().chars().next().map_or(1, char::len_utf8);
        let error = parser.error(parser.at, end, "a unit is not understood from here on".to_owned());
        let help = Some("write products and powers with their signs, as in `kg*m/s^2`".to_owned());
        return Err(UnitError { help, ..error });
    }
    Ok(unit)
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl<'a> Parser<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn blanks(&mut self) {
        self.at = self.text.len() - self.rest().trim_start().len();
    }

    fn take(&mut self, sign: char) -> bool {
        self.blanks();
        let found = self.rest().starts_with(sign);
        self.at += if found { sign.len_utf8() } else { 0 };
        found
    }

    fn error(&self, start: usize, end: usize, message: String) -> UnitError {
        UnitError { start, end, message, help: None }
    }

    fn product(&mut self) -> Result<Dimension, UnitError> {
        let mut unit = self.power()?;
        loop {
            let start = self.at;
            let sign = match () {
                () if self.take('*') || self.take('\u{b7}') => 1,
                () if self.take('/') => -1,
                () => return Ok(unit),
            };
            let factor = self.power()?;
            let joined = unit.times(factor, sign);
            unit = joined.ok_or_else(|| self.error(start, self.at, "a unit out of range".to_owned()))?;
        }
    }

    fn power(&mut self) -> Result<Dimension, UnitError> {
        let start = self.at;
        let unit = self.atom()?;
        if !self.take('^') {
            return Ok(unit);
        }
        let from = self.at;
        let bracket = self.take('(');
        let text = self.rest();
        let length = text.find(|c: char| !(c.is_ascii_digit() || "+-./".contains(c))).unwrap_or(text.len());
        // Without brackets a `/` divides by the next unit.
        let length = if bracket { length } else { text[..length].find('/').unwrap_or(length) };
        let number = &text[..length];
        self.at += length;
        let closed = !bracket || self.take(')');
        let value = match number.split_once('/') {
            Some((a, b)) => a.parse::<f64>().ok().zip(b.parse::<f64>().ok()).map(|(a, b)| a / b),
            None => number.parse().ok(),
        };
        let power = value.filter(|_| closed).and_then(|value| unit.power(value));
        power.ok_or_else(|| UnitError {
            help: Some("powers are numbers: `m^2`, `s^-1`, `Hz^(1/2)`".to_owned()),
            ..self.error(from.min(self.at), self.at.max(start), "no power of a unit".to_owned())
        })
    }

    fn atom(&mut self) -> Result<Dimension, UnitError> {
        if self.take('(') {
            self.depth += 1;
            if self.depth > DEEPEST {
                return Err(self.error(self.at - 1, self.at, "brackets nested too deeply".to_owned()));
            }
            let unit = self.product()?;
            self.depth -= 1;
            if !self.take(')') {
                return Err(self.error(self.at, self.text.len().max(self.at), "`)` is missing".to_owned()));
            }
            return Ok(unit);
        }
        self.blanks();
        let rest = self.rest();
        if rest.starts_with('1') && !rest[1..].starts_with(|c: char| c.is_ascii_digit()) {
            self.at += 1;
            return Ok(Dimension::ONE);
        }
        let name = |c: char| c.is_alphabetic() || "_%\u{b0}\u{b5}\u{3a9}".contains(c) || c.is_ascii_digit();
        let length = rest.find(|c: char| !name(c)).unwrap_or(rest.len());
        let (start, word) = (self.at, &rest[..length]);
        if word.is_empty() || word.starts_with(|c: char| c.is_ascii_digit()) {
            let end = start + rest.chars().next().map_or(0, char::len_utf8).max(length);
            return Err(self.error(start, end, "a unit is missing here".to_owned()));
        }
        self.at += length;
        find(word).ok_or_else(|| UnitError {
            help: suggest(word),
            ..self.error(start, self.at, format!("unknown unit `{word:.40}`"))
        })
    }
}

/// The place of an error in a unit that stands at `place`.
pub(crate) fn place(error: &UnitError, place: Span) -> Span {
    let end = place.end.min(place.start + number(error.end));
    Span { start: end.min(place.start + number(error.start)), end }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(text: &str) -> Dimension {
        parse(text).unwrap_or_else(|error| panic!("{text}: {error:?}"))
    }

    #[test]
    fn different_words_for_one_unit_agree() {
        for (one, other) in [
            ("N", "kg*m/s^2"),
            ("mL", "cm^3"),
            ("Pa", "N/m^2"),
            ("V", "J/C"),
            ("Ohm", "V/A"),
            ("\u{3a9}", "ohm"),
            ("S", "1/Ohm"),
            ("F", "A*s/V"),
            ("H", "V*s/A"),
            ("mM", "mol/m^3"),
            ("Hz", "s^-1"),
            ("uF", "\u{b5}F"),
            ("cmH2O*s/L", "cmH2O/(L/s)"),
            ("Hz^(1/2)*Hz^0.5", "Hz"),
        ] {
            assert!(unit(one).is(unit(other)), "{one} {other}");
        }
    }

    #[test]
    fn sizes_of_one_measure_are_told_apart() {
        let ratio = |one: &str, other: &str| {
            assert!(unit(one).measures_the_same(unit(other)) && !unit(one).is(unit(other)), "{one} {other}");
            unit(one).factor / unit(other).factor
        };
        let near = |value: f64, wanted: f64| assert!((value / wanted - 1.0).abs() < 1e-6, "{value} {wanted}");
        near(ratio("L", "mL"), 1000.0);
        near(ratio("cmH2O", "Pa"), 98.0665);
        near(ratio("mmHg", "Pa"), 133.322_387);
        near(ratio("bar", "kPa"), 100.0);
        near(ratio("rpm", "rad/s"), 0.104_719_76);
        near(ratio("deg", "rad"), 0.017_453_293);
        near(ratio("h", "min"), 60.0);
        near(ratio("nS", "pS"), 1000.0);
        near(ratio("%", "1"), 0.01);
    }

    #[test]
    fn what_is_no_unit_is_shown() {
        let error = |text: &str| {
            let error = parse(text).expect_err(text);
            (text[error.start..error.end].to_owned(), error.help)
        };
        assert_eq!(error("L/breath").0, "breath");
        assert_eq!(error("cmh2o"), ("cmh2o".to_owned(), Some("did you mean `cmH2O`?".to_owned())));
        assert_eq!(error("kg m").0, "m");
        for text in ["", "*", "m^", "m^x", "(m", "m)", "m//s", "m^1e9", "2*m", "m^99999", "((((((((((((((((((((((m"] {
            error(text);
        }
        error(&"(".repeat(10_000));
        error(&format!("{}m", "m*".repeat(99)).replace('m', "m^90"));
    }

    #[test]
    fn units_are_shown_in_base_units_where_they_have_no_name() {
        assert_eq!(unit("kg*m^2/(s^3*A)").to_string(), "m^2*kg/(s^3*A)");
        assert_eq!(unit("mL/s").to_string(), "1e-6 m^3/s");
        assert_eq!(unit("deg").to_string(), "0.01745329 1");
        assert_eq!(unit("1/s").to_string(), "1/s");
    }
}
