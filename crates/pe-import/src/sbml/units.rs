//! Units of SBML in the terms of the language.

use std::collections::HashMap;

use roxmltree::Node;

use super::Reader;
use crate::xml::listed;

/// Unit definitions by id; `None` if the language has no word for one.
pub(super) fn definitions(model: Node) -> HashMap<String, Option<String>> {
    let nodes = listed(model, "listOfUnitDefinitions");
    nodes.into_iter().filter_map(|node| Some((node.attribute("id")?.to_owned(), definition(node)))).collect()
}

impl Reader<'_, '_> {
    /// A unit that an attribute names.
    pub(super) fn unit(&self, name: &str) -> Option<String> {
        if let Some(definition) = self.units.get(name) {
            return definition.clone();
        }
        match name {
            "substance" => Some("mol".to_owned()),
            "volume" => Some("L".to_owned()),
            "area" => Some("m^2".to_owned()),
            "length" => Some("m".to_owned()),
            "time" => Some("s".to_owned()),
            kind => base(kind).filter(|unit| !unit.is_empty()).map(str::to_owned),
        }
    }

    /// The unit of a species: of an amount, or of an amount in a compartment.
    pub(super) fn species_unit(&self, node: Node, compartment: Node, amount: bool) -> Option<String> {
        let substance = node.attribute("substanceUnits").or_else(|| self.node.attribute("substanceUnits"));
        let substance = substance.or(if self.old { Some("substance") } else { None })?;
        let substance = self.unit(substance)?;
        if amount {
            return Some(substance);
        }
        let (usual, of_model) = match compartment.attribute("spatialDimensions").unwrap_or("3") {
            "3" => ("volume", "volumeUnits"),
            "2" => ("area", "areaUnits"),
            _ => ("length", "lengthUnits"),
        };
        let volume = compartment.attribute("units").or_else(|| self.node.attribute(of_model));
        let volume = self.unit(volume.or(if self.old { Some(usual) } else { None })?)?;
        Some(format!("{substance}/{}", if volume.contains(['*', '/']) { format!("({volume})") } else { volume }))
    }
}

/// The word of a unit without a factor; empty for none.
fn base(kind: &str) -> Option<&'static str> {
    Some(match kind {
        "ampere" => "A",
        "becquerel" => "Bq",
        "candela" => "cd",
        "coulomb" => "C",
        "dimensionless" | "item" | "radian" | "steradian" => "",
        "farad" => "F",
        "gram" => "g",
        "henry" => "H",
        "hertz" => "Hz",
        "joule" => "J",
        "kelvin" => "K",
        "kilogram" => "kg",
        "liter" | "litre" => "L",
        "meter" | "metre" => "m",
        "mole" => "mol",
        "newton" => "N",
        "ohm" => "Ohm",
        "pascal" => "Pa",
        "second" => "s",
        "siemens" => "S",
        "tesla" => "T",
        "volt" => "V",
        "watt" => "W",
        "weber" => "Wb",
        _ => return None,
    })
}

/// `<unitDefinition>` as a product of powers.
fn definition(node: Node) -> Option<String> {
    let (mut above, mut below) = (Vec::new(), Vec::new());
    for unit in listed(node, "listOfUnits") {
        let number =
            |name: &str, default: f64| unit.attribute(name).map_or(Some(default), |text| text.trim().parse().ok());
        let (exponent, scale, multiplier) =
            (number("exponent", 1.0)?, number("scale", 0.0)?, number("multiplier", 1.0)?);
        let name = base(unit.attribute("kind")?)?;
        if exponent != f64::trunc(exponent) || !(-9.0..=9.0).contains(&exponent) {
            return None;
        }
        let word = prefixed(name, scale, multiplier)?;
        if word.is_empty() || exponent == 0.0 {
            continue;
        }
        let size = exponent.abs();
        let power = if size == 1.0 { word } else { format!("{word}^{size}") };
        if exponent > 0.0 { above.push(power) } else { below.push(power) }
    }
    let over = match below.len() {
        0 => String::new(),
        1 => format!("/{}", below[0]),
        _ => format!("/({})", below.join("*")),
    };
    match (above.is_empty(), over.is_empty()) {
        (true, true) => None,
        (true, false) => Some(format!("1{over}")),
        (false, _) => Some(above.join("*") + &over),
    }
}

/// A word with the prefix of its scale, if the language has it.
fn prefixed(name: &str, scale: f64, multiplier: f64) -> Option<String> {
    match (name, multiplier) {
        ("s", 60.0) if scale == 0.0 => return Some("min".to_owned()),
        ("s", 3600.0) if scale == 0.0 => return Some("h".to_owned()),
        ("s", 86400.0) if scale == 0.0 => return Some("d".to_owned()),
        _ => {}
    }
    // A multiplier that is a power of ten is a scale, too.
    let power = (-30..=30).find(|power| multiplier == format!("1e{power}").parse::<f64>().unwrap_or(0.0))?;
    let prefix = match scale as i32 + power {
        -15 => "f",
        -12 => "p",
        -9 => "n",
        -6 => "u",
        -3 => "m",
        -2 => "c",
        -1 => "d",
        0 => "",
        3 => "k",
        6 => "M",
        9 => "G",
        12 => "T",
        _ => return None,
    };
    match (name, prefix) {
        ("", "") => Some(String::new()),
        ("", _) => None,
        ("kg", "") => Some("kg".to_owned()),
        ("kg", _) => None,
        _ => Some(format!("{prefix}{name}")),
    }
}
