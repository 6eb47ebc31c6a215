//! Arithmetic with units.
//!
//! A unit is a product of powers of the SI base units with a factor, so `mL` and `cm^3` are the same unit, and `mL` and
//! `L` are not. Angles are numbers: `rad` is 1, `deg` is pi/180. Numbers of a spec are never converted.

use std::fmt;

/// How strictly units are checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Units {
    /// A quantity without a unit is a number, and a mismatch is an error.
    Strict,
    /// A quantity without a unit may have any, and a mismatch is a warning.
    #[default]
    Warn,
    /// Units are texts without a meaning.
    Off,
}

impl Units {
    /// All modes with their names in specs and on the command line.
    pub const ALL: [(&str, Units); 3] = [("strict", Units::Strict), ("warn", Units::Warn), ("off", Units::Off)];
}

/// Names of the base units, in the order of the exponents.
const BASES: [&str; 7] = ["m", "kg", "s", "A", "K", "mol", "cd"];

/// Exponents are counted in parts of this, so that square and cube roots have a unit.
pub(super) const WHOLE: i32 = 60;

/// Largest power of a base unit that is kept.
const LARGEST_EXPONENT: i32 = 100 * WHOLE;

/// Relative difference of factors that are taken for equal.
const TOLERANCE: f64 = 1e-9;

/// A known unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dimension {
    /// Powers of the base units, in parts of [`WHOLE`].
    pub(super) exponents: [i32; 7],
    /// How many base units it has.
    pub(super) factor: f64,
}

impl Dimension {
    /// A plain number.
    pub(crate) const ONE: Dimension = Dimension { exponents: [0; 7], factor: 1.0 };

    /// The second.
    pub(crate) const SECOND: Dimension = Dimension { exponents: [0, 0, WHOLE, 0, 0, 0, 0], factor: 1.0 };

    /// The product with another unit to the power `sign`, 1 or -1; `None` beyond all reason.
    pub(super) fn times(self, other: Dimension, sign: i32) -> Option<Dimension> {
        let mut exponents = self.exponents;
        for (exponent, more) in exponents.iter_mut().zip(other.exponents) {
            *exponent += sign * more;
        }
        let factor = if sign < 0 { self.factor / other.factor } else { self.factor * other.factor };
        Dimension { exponents, factor }.checked()
    }

    /// A power; `None` where it is no unit.
    pub(super) fn power(self, power: f64) -> Option<Dimension> {
        let mut exponents = self.exponents;
        for exponent in &mut exponents {
            let raised = f64::from(*exponent) * power;
            if (raised - libm::round(raised)).abs() > 1e-6 || raised.abs() > f64::from(LARGEST_EXPONENT) {
                return None;
            }
            // A few thousand at most: exact.
            *exponent = libm::round(raised) as i32;
        }
        Dimension { exponents, factor: libm::pow(self.factor, power) }.checked()
    }

    fn checked(self) -> Option<Dimension> {
        let sane = self.factor.is_finite() && self.factor > 0.0;
        (sane && self.exponents.iter().all(|exponent| exponent.abs() <= LARGEST_EXPONENT)).then_some(self)
    }

    /// Whether both measure the same, in whatever size.
    pub(super) fn measures_the_same(self, other: Dimension) -> bool {
        self.exponents == other.exponents
    }

    /// Whether both are the same unit.
    pub(super) fn is(self, other: Dimension) -> bool {
        self.measures_the_same(other) && (self.factor / other.factor - 1.0).abs() < TOLERANCE
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = |above: bool| {
            let powers = BASES
                .iter()
                .zip(self.exponents)
                .filter(move |(_, exponent)| (*exponent > 0) == above && *exponent != 0);
            let shown = powers.map(|(base, exponent)| match f64::from(exponent.abs()) / f64::from(WHOLE) {
                1.0 => (*base).to_owned(),
                power => format!("{base}^{power}"),
            });
            shown.collect::<Vec<_>>()
        };
        let (above, below) = (part(true), part(false));
        if (self.factor - 1.0).abs() > TOLERANCE {
            write!(f, "{} ", shown_factor(self.factor))?;
        }
        f.write_str(&if above.is_empty() { "1".to_owned() } else { above.join("*") })?;
        match below.len() {
            0 => Ok(()),
            1 => write!(f, "/{}", below[0]),
            _ => write!(f, "/({})", below.join("*")),
        }
    }
}

/// A factor with as many digits as tell units apart.
pub(crate) fn shown_factor(factor: f64) -> String {
    let rounded: f64 = format!("{factor:.6e}").parse().unwrap_or(factor);
    if (1e-3..1e5).contains(&rounded) { rounded.to_string() } else { format!("{rounded:e}") }
}
