//! The units that have names, and their prefixes.

use crate::nearest::suggestion;
use crate::units::dimension::{Dimension, WHOLE};

/// A named unit: its name, factor, powers of m kg s A K mol cd, and whether prefixes go before it.
type Named = (&'static str, f64, [i32; 7], bool);

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Standard gravity, the density of water at 4 degrees and of mercury at 0 degrees fix the units of columns.
const NAMED: [Named; 60] = [
    ("m", 1.0, [1, 0, 0, 0, 0, 0, 0], true),
    ("g", 1e-3, [0, 1, 0, 0, 0, 0, 0], true),
    ("s", 1.0, [0, 0, 1, 0, 0, 0, 0], true),
    ("A", 1.0, [0, 0, 0, 1, 0, 0, 0], true),
    ("K", 1.0, [0, 0, 0, 0, 1, 0, 0], true),
    ("mol", 1.0, [0, 0, 0, 0, 0, 1, 0], true),
    ("cd", 1.0, [0, 0, 0, 0, 0, 0, 1], true),
    ("rad", 1.0, [0; 7], true),
    ("deg", DEGREE, [0; 7], false),
    ("\u{b0}", DEGREE, [0; 7], false),
    ("rev", 360.0 * DEGREE, [0; 7], false),
    ("turn", 360.0 * DEGREE, [0; 7], false),
    ("%", 1e-2, [0; 7], false),
    ("percent", 1e-2, [0; 7], false),
    ("ppm", 1e-6, [0; 7], false),
    ("Hz", 1.0, [0, 0, -1, 0, 0, 0, 0], true),
    ("Bq", 1.0, [0, 0, -1, 0, 0, 0, 0], true),
    ("rpm", 6.0 * DEGREE, [0, 0, -1, 0, 0, 0, 0], false),
    ("bpm", 1.0 / 60.0, [0, 0, -1, 0, 0, 0, 0], false),
    ("min", 60.0, [0, 0, 1, 0, 0, 0, 0], false),
    ("h", 3600.0, [0, 0, 1, 0, 0, 0, 0], false),
    ("d", 86400.0, [0, 0, 1, 0, 0, 0, 0], false),
    ("N", 1.0, [1, 1, -2, 0, 0, 0, 0], true),
    ("dyn", 1e-5, [1, 1, -2, 0, 0, 0, 0], false),
    ("J", 1.0, [2, 1, -2, 0, 0, 0, 0], true),
    ("erg", 1e-7, [2, 1, -2, 0, 0, 0, 0], false),
    ("cal", 4.184, [2, 1, -2, 0, 0, 0, 0], true),
    ("eV", 1.602_176_634e-19, [2, 1, -2, 0, 0, 0, 0], true),
    ("W", 1.0, [2, 1, -3, 0, 0, 0, 0], true),
    ("Pa", 1.0, [-1, 1, -2, 0, 0, 0, 0], true),
    ("bar", 1e5, [-1, 1, -2, 0, 0, 0, 0], true),
    ("atm", 101_325.0, [-1, 1, -2, 0, 0, 0, 0], false),
    ("mmHg", 133.322_387_415, [-1, 1, -2, 0, 0, 0, 0], false),
    ("Torr", 101_325.0 / 760.0, [-1, 1, -2, 0, 0, 0, 0], true),
    ("cmH2O", 98.0665, [-1, 1, -2, 0, 0, 0, 0], false),
    ("mmH2O", 9.80665, [-1, 1, -2, 0, 0, 0, 0], false),
    ("psi", 6_894.757_293_168, [-1, 1, -2, 0, 0, 0, 0], false),
    ("P", 0.1, [-1, 1, -1, 0, 0, 0, 0], true),
    ("L", 1e-3, [3, 0, 0, 0, 0, 0, 0], true),
    ("l", 1e-3, [3, 0, 0, 0, 0, 0, 0], true),
    ("C", 1.0, [0, 0, 1, 1, 0, 0, 0], true),
    ("V", 1.0, [2, 1, -3, -1, 0, 0, 0], true),
    ("F", 1.0, [-2, -1, 4, 2, 0, 0, 0], true),
    ("Ohm", 1.0, [2, 1, -3, -2, 0, 0, 0], true),
    ("ohm", 1.0, [2, 1, -3, -2, 0, 0, 0], true),
    ("\u{3a9}", 1.0, [2, 1, -3, -2, 0, 0, 0], true),
    ("S", 1.0, [-2, -1, 3, 2, 0, 0, 0], true),
    ("H", 1.0, [2, 1, -2, -2, 0, 0, 0], true),
    ("Wb", 1.0, [2, 1, -2, -1, 0, 0, 0], true),
    ("T", 1.0, [0, 1, -2, -1, 0, 0, 0], true),
    ("M", 1e3, [-3, 0, 0, 0, 0, 1, 0], true),
    ("t", 1e3, [0, 1, 0, 0, 0, 0, 0], false),
    ("lb", 0.453_592_37, [0, 1, 0, 0, 0, 0, 0], false),
    ("in", 0.0254, [1, 0, 0, 0, 0, 0, 0], false),
    ("ft", 0.3048, [1, 0, 0, 0, 0, 0, 0], false),
    ("mi", 1_609.344, [1, 0, 0, 0, 0, 0, 0], false),
    ("lbf", 4.448_221_615_260_5, [1, 1, -2, 0, 0, 0, 0], false),
    ("gal", 3.785_411_784e-3, [3, 0, 0, 0, 0, 0, 0], false),
    ("au", 1.495_978_707e11, [1, 0, 0, 0, 0, 0, 0], false),
    ("a", 31_557_600.0, [0, 0, 1, 0, 0, 0, 0], false),
];

const PREFIXES: [(&str, f64); 16] = [
    ("da", 1e1),
    ("h", 1e2),
    ("k", 1e3),
    ("M", 1e6),
    ("G", 1e9),
    ("T", 1e12),
    ("P", 1e15),
    ("d", 1e-1),
    ("c", 1e-2),
    ("m", 1e-3),
    ("u", 1e-6),
    ("\u{b5}", 1e-6),
    ("\u{3bc}", 1e-6),
    ("n", 1e-9),
    ("p", 1e-12),
    ("f", 1e-15),
];

/// The unit of this name, with or without a prefix; a name of its own goes before a prefix (`min`, `Pa`, `cd`).
pub(crate) fn find(word: &str) -> Option<Dimension> {
    let unit = |named: &Named, prefix: f64| Dimension {
        exponents: named.2.map(|power| power * WHOLE),
        factor: named.1 * prefix,
    };
    let named = |name: &str| NAMED.iter().find(|named| named.0 == name);
    named(word).map(|named| unit(named, 1.0)).or_else(|| {
        PREFIXES.iter().find_map(|(prefix, factor)| {
            let named = named(word.strip_prefix(prefix)?).filter(|named| named.3)?;
            Some(unit(named, *factor))
        })
    })
}

/// The names of all units, without prefixes.
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    NAMED.iter().map(|named| named.0)
}

/// Advice for a word that is no unit.
pub(super) fn suggest(word: &str) -> Option<String> {
    if ["degC", "degF", "\u{b0}C", "\u{b0}F", "celsius"].contains(&word) {
        return Some("scales with an offset are not supported; use `K`".to_owned());
    }
    suggestion(word, NAMED.iter().map(|named| named.0))
}
