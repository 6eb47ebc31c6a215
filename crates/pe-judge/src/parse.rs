//! Parses parts of a design point.

use pe_ir::word::MultiplierPorts;
/// Parses a time: a number with an optional unit.
pub fn duration(text: &str) -> Result<f64, String> {
    let text = text.trim();
    // Divisors, for a quotient of two exact numbers is the nearest one: 100us is 1e-4.
    let units = [("ns", 1e9), ("us", 1e6), ("ms", 1e3), ("s", 1.0)];
    let (number, divisor) = units
        .iter()
        .find_map(|(unit, divisor)| text.strip_suffix(unit).map(|number| (number.trim_end(), *divisor)))
        .unwrap_or((text, 1.0));
    let quotient = |(a, b): (&str, &str)| Some(a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?);
    let value = number.split_once('/').map_or_else(|| number.parse().ok(), quotient);
    match value.map(|value| value / divisor) {
        Some(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a positive time such as 1e-4, 100us or 1/44100".into()),
    }
}

/// Parses the widths of a multiplier's ports.
pub fn multiplier(text: &str) -> Result<MultiplierPorts, String> {
    let parsed = text.split_once('x').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    match parsed {
        Some((data, coefficient)) if (9..=35).contains(&data) && (9..=35).contains(&coefficient) => {
            Ok(MultiplierPorts::new(data, coefficient))
        }
        _ => Err("expected AxB, the bits of data and coefficient port, 9 to 35 each, for example 25x18".into()),
    }
}
