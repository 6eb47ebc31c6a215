//! Units of CellML: their words in the language, and factors between them.

use std::collections::HashMap;

use roxmltree::Node;

use crate::xml::elements;

/// Base units: m, kg, s, A, K, mol, cd.
type Dimension = [i32; 7];

/// A unit as a multiple of base units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Size {
    pub factor: f64,
    /// Exponents of base units, in hundredths.
    pub dimension: Dimension,
}

/// Definitions of deeper chains are not followed.
const DEEPEST: usize = 30;

/// Units that have a name of their own: the word of the language, factor, exponents of base units.
const KNOWN: [(&str, &str, f64, Dimension); 32] = [
    ("ampere", "A", 1.0, [0, 0, 0, 1, 0, 0, 0]),
    ("becquerel", "Bq", 1.0, [0, 0, -1, 0, 0, 0, 0]),
    ("candela", "cd", 1.0, [0, 0, 0, 0, 0, 0, 1]),
    ("coulomb", "C", 1.0, [0, 0, 1, 1, 0, 0, 0]),
    ("dimensionless", "", 1.0, [0; 7]),
    ("farad", "F", 1.0, [-2, -1, 4, 2, 0, 0, 0]),
    ("gram", "g", 1e-3, [0, 1, 0, 0, 0, 0, 0]),
    ("henry", "H", 1.0, [2, 1, -2, -2, 0, 0, 0]),
    ("hertz", "Hz", 1.0, [0, 0, -1, 0, 0, 0, 0]),
    ("joule", "J", 1.0, [2, 1, -2, 0, 0, 0, 0]),
    ("katal", "", 1.0, [0, 0, -1, 0, 0, 1, 0]),
    ("kelvin", "K", 1.0, [0, 0, 0, 0, 1, 0, 0]),
    ("kilogram", "kg", 1.0, [0, 1, 0, 0, 0, 0, 0]),
    ("liter", "L", 1e-3, [3, 0, 0, 0, 0, 0, 0]),
    ("litre", "L", 1e-3, [3, 0, 0, 0, 0, 0, 0]),
    ("lumen", "", 1.0, [0, 0, 0, 0, 0, 0, 1]),
    ("lux", "", 1.0, [-2, 0, 0, 0, 0, 0, 1]),
    ("meter", "m", 1.0, [1, 0, 0, 0, 0, 0, 0]),
    ("metre", "m", 1.0, [1, 0, 0, 0, 0, 0, 0]),
    ("mole", "mol", 1.0, [0, 0, 0, 0, 0, 1, 0]),
    ("newton", "N", 1.0, [1, 1, -2, 0, 0, 0, 0]),
    ("ohm", "Ohm", 1.0, [2, 1, -3, -2, 0, 0, 0]),
    ("pascal", "Pa", 1.0, [-1, 1, -2, 0, 0, 0, 0]),
    ("radian", "", 1.0, [0; 7]),
    ("second", "s", 1.0, [0, 0, 1, 0, 0, 0, 0]),
    ("siemens", "S", 1.0, [-2, -1, 3, 2, 0, 0, 0]),
    ("sievert", "", 1.0, [2, 0, -2, 0, 0, 0, 0]),
    ("steradian", "", 1.0, [0; 7]),
    ("tesla", "T", 1.0, [0, 1, -2, -1, 0, 0, 0]),
    ("volt", "V", 1.0, [2, 1, -3, -1, 0, 0, 0]),
    ("watt", "W", 1.0, [2, 1, -3, 0, 0, 0, 0]),
    ("weber", "Wb", 1.0, [2, 1, -2, -1, 0, 0, 0]),
];

/// Prefixes: name, letter, power of ten.
const PREFIXES: [(&str, &str, i32); 16] = [
    ("tera", "T", 12),
    ("giga", "G", 9),
    ("mega", "M", 6),
    ("kilo", "k", 3),
    ("hecto", "h", 2),
    ("deca", "da", 1),
    ("deka", "da", 1),
    ("deci", "d", -1),
    ("centi", "c", -2),
    ("milli", "m", -3),
    ("micro", "u", -6),
    ("nano", "n", -9),
    ("pico", "p", -12),
    ("femto", "f", -15),
    ("atto", "", -18),
    ("zepto", "", -21),
];

/// One `<unit>` of a definition.
struct Part {
    of: String,
    power: i32,
    multiplier: f64,
    exponent: f64,
}

/// Definitions of a model.
pub(super) struct Units {
    definitions: HashMap<String, Option<Vec<Part>>>,
}

impl Units {
    /// Those of the model and of its components.
    pub fn of(root: Node) -> Units {
        let nodes = root.descendants().filter(|node| node.is_element() && node.tag_name().name() == "units");
        let named = nodes.filter_map(|node| Some((node.attribute("name")?.to_owned(), parts(node))));
        Units { definitions: named.collect() }
    }

    /// The unit as a multiple of base units, if it is known.
    pub fn size(&self, name: &str) -> Option<Size> {
        self.sized(name, 0)
    }

    fn sized(&self, name: &str, depth: usize) -> Option<Size> {
        if let Some(definition) = self.definitions.get(name).filter(|_| depth < DEEPEST) {
            let mut size = Size { factor: 1.0, dimension: [0; 7] };
            for part in definition.as_ref()? {
                let inner = self.sized(&part.of, depth + 1)?;
                let one = part.multiplier * format!("1e{}", part.power).parse::<f64>().ok()? * inner.factor;
                size.factor *= if part.exponent == 1.0 { one } else { one.powf_exact(part.exponent)? };
                for (sum, exponent) in size.dimension.iter_mut().zip(inner.dimension) {
                    *sum += (f64::from(exponent) * part.exponent) as i32;
                }
            }
            return Some(size);
        }
        let (_, _, factor, dimension) = KNOWN.iter().find(|(known, ..)| *known == name)?;
        Some(Size { factor: *factor, dimension: dimension.map(|exponent| exponent * 100) })
    }

    /// The unit in the terms of the language; `None` for none and for those it has no word for.
    pub fn word(&self, name: &str) -> Option<String> {
        self.worded(name, 0).filter(|word| !word.is_empty())
    }

    fn worded(&self, name: &str, depth: usize) -> Option<String> {
        let Some(definition) = self.definitions.get(name).filter(|_| depth < DEEPEST) else {
            let (_, word, _, dimension) = KNOWN.iter().find(|(known, ..)| *known == name)?;
            return (!word.is_empty() || *dimension == [0; 7]).then(|| (*word).to_owned());
        };
        let (mut above, mut below) = (Vec::new(), Vec::new());
        for part in definition.as_ref()? {
            let inner = self.worded(&part.of, depth + 1)?;
            let letter = match part.power {
                0 => "",
                power => PREFIXES.iter().find(|(_, letter, of)| *of == power && !letter.is_empty())?.1,
            };
            let is_plain = inner.bytes().all(|byte| byte.is_ascii_alphabetic());
            let takes_prefix = KNOWN.iter().any(|(_, word, ..)| *word == inner) && inner != "kg" && !inner.is_empty();
            if part.multiplier != 1.0
                || !letter.is_empty() && !takes_prefix
                || part.exponent != f64::trunc(part.exponent)
            {
                return None;
            }
            if inner.is_empty() {
                continue;
            }
            let word = if is_plain { format!("{letter}{inner}") } else { format!("({inner})") };
            let size = part.exponent.abs();
            let power = if size == 1.0 { word } else { format!("{word}^{size}") };
            if part.exponent > 0.0 { above.push(power) } else { below.push(power) }
        }
        // A definition of one part needs no brackets of its own.
        if let ([one], []) = (&above[..], &below[..]) {
            return Some(one.strip_prefix('(').and_then(|one| one.strip_suffix(')')).unwrap_or(one).to_owned());
        }
        let over = match below.len() {
            0 => String::new(),
            1 => format!("/{}", below[0]),
            _ => format!("/({})", below.join("*")),
        };
        Some(if above.is_empty() && !over.is_empty() { format!("1{over}") } else { above.join("*") + &over })
    }
}

/// Powers with whole exponents, by products.
trait Powers {
    fn powf_exact(self, exponent: f64) -> Option<f64>;
}

impl Powers for f64 {
    fn powf_exact(self, exponent: f64) -> Option<f64> {
        let whole = exponent == f64::trunc(exponent) && exponent.abs() <= 20.0;
        let product = (0..exponent.abs() as u32).fold(1.0, |product, _| product * self);
        whole.then(|| if exponent < 0.0 { 1.0 / product } else { product })
    }
}

/// The parts of a definition; none if it is a base unit of its own or has an offset.
fn parts(node: Node) -> Option<Vec<Part>> {
    if node.attribute("base_units") == Some("yes") {
        return None;
    }
    let parts = elements(node).filter(|part| part.tag_name().name() == "unit").map(|part| {
        let number =
            |name: &str, default: f64| part.attribute(name).map_or(Some(default), |text| text.trim().parse().ok());
        if number("offset", 0.0)? != 0.0 {
            return None;
        }
        let prefix = part.attribute("prefix").unwrap_or("0").trim();
        let power = match PREFIXES.iter().find(|(name, ..)| *name == prefix) {
            Some((_, _, power)) => *power,
            None => prefix.parse().ok().filter(|power: &i32| power.abs() <= 30)?,
        };
        Some(Part {
            of: part.attribute("units")?.to_owned(),
            power,
            multiplier: number("multiplier", 1.0)?,
            exponent: number("exponent", 1.0)?,
        })
    });
    parts.collect()
}
