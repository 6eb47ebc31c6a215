//! Parses parts of a design point.

use pe_ir::word::MultiplierPorts;

/// Units of time: how many of them a number of seconds is divided by or multiplied with. A quotient of two exact numbers
/// is the nearest one, so 100us is 1e-4.
const TIMES: [(&str, f64, f64); 6] =
    [("ns", 1e9, 1.0), ("us", 1e6, 1.0), ("ms", 1e3, 1.0), ("min", 1.0, 60.0), ("h", 1.0, 3600.0), ("s", 1.0, 1.0)];

/// Parses a time: a number with an optional unit.
pub fn duration(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (number, divisor, factor) = TIMES
        .iter()
        .find_map(|(unit, divisor, factor)| Some((text.strip_suffix(unit)?.trim_end(), *divisor, *factor)))
        .unwrap_or((text, 1.0, 1.0));
    let quotient = |(a, b): (&str, &str)| Some(a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?);
    let value = number.split_once('/').map_or_else(|| number.parse().ok(), quotient);
    match value.map(|value| value / divisor * factor) {
        Some(value) if value.is_finite() && value > 0.0 => Ok(value),
        Some(value) if value <= 0.0 => Err("a time must be positive, such as 1e-4, 100us or 1/44100".into()),
        _ => {
            Err("expected a positive time such as 1e-4, 100us, 2min or 1/44100; units are ns, us, ms, s, min and h"
                .into())
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_the_units_of_specs() {
        let texts = ["100us", "1 ms", "1/44100 s", "2min", "0.5h", "3", "1ns"];
        let seconds = [1e-4, 1e-3, 1.0 / 44100.0, 120.0, 1800.0, 3.0, 1e-9];
        assert_eq!(texts.map(|text| duration(text).unwrap()), seconds);
        for text in ["-1ms", "0", "1 m", "min", "1d", "nan", "inf", "1/0", ""] {
            assert!(duration(text).is_err(), "{text}");
        }
        assert!(duration("-1ms").is_err_and(|reason| reason.contains("must be positive")));
    }
}
