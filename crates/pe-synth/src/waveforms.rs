//! Outputs over time as value change dump (VCD), for waveform viewers.

use std::io::Write;

use vcd::{TimescaleUnit, VarType, Writer};

/// Units of time from coarse to fine, each with its power of ten.
const UNITS: [(TimescaleUnit, i32); 6] = [
    (TimescaleUnit::S, 0),
    (TimescaleUnit::MS, -3),
    (TimescaleUnit::US, -6),
    (TimescaleUnit::NS, -9),
    (TimescaleUnit::PS, -12),
    (TimescaleUnit::FS, -15),
];

/// The coarsest unit, with its multiple, that the step is a whole number of; femtoseconds if there is none. Coarser
/// than that only where the end of the trace would not fit the numbers of the format.
fn timescale(step: f64, rows: usize) -> (TimescaleUnit, u32, i32) {
    let scales = UNITS.iter().flat_map(|(unit, power)| [(100, 2), (10, 1), (1, 0)].map(|(n, p)| (*unit, n, power + p)));
    let fits = |power: i32| step * rows as f64 * libm::pow(10.0, f64::from(-power)) < 9.0e18;
    let whole = |power: i32| {
        let count = step * libm::pow(10.0, f64::from(-power));
        count > 0.5 && (count - libm::round(count)).abs() <= 4.0 * f64::EPSILON * count
    };
    let possible: Vec<_> = scales.filter(|(_, _, power)| fits(*power)).collect();
    let exact = possible.iter().find(|(_, _, power)| whole(*power));
    exact.or(possible.last()).copied().unwrap_or((TimescaleUnit::S, 1, 0))
}

/// A dump with one real-valued signal for each name; row `k` holds the values at time `k step`. What
/// is no finite number is left out.
///
/// # Errors
/// None of its own: those of writing into memory.
pub fn dump(model: &str, names: &[&str], step: f64, rows: &[Vec<f64>]) -> std::io::Result<Vec<u8>> {
    let (unit, multiple, power) = timescale(step, rows.len());
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes);
    writer.version(concat!("pe-synth ", env!("CARGO_PKG_VERSION")))?;
    writer.timescale(multiple, unit)?;
    writer.add_module(model)?;
    let mut codes = Vec::with_capacity(names.len());
    for name in names {
        codes.push(writer.add_var(VarType::Real, 64, name, None)?);
    }
    writer.upscope()?;
    writer.enddefinitions()?;
    let mut before = vec![f64::NAN; names.len()];
    for (index, row) in rows.iter().enumerate() {
        let ticks = index as f64 * step * libm::pow(10.0, f64::from(-power));
        writer.timestamp(libm::round(ticks) as u64)?;
        for ((number, last), code) in row.iter().zip(&mut before).zip(&codes) {
            if number != last && number.is_finite() {
                // The library writes all zeros of a small number, more digits than readers take.
                writeln!(writer.writer(), "r{number:e} {code}")?;
                *last = *number;
            }
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dump_can_be_read_back_with_names_times_and_values() {
        let rows = [vec![1.5, -2.0], vec![1.5, 1e-300], vec![0.1, 1e-300]];
        let bytes = dump("m", &["V[1]", "w[2,3]"], 250e-6, &rows).expect("written into memory");
        let mut parser = vcd::Parser::new(&bytes[..]);
        let header = parser.parse_header().expect("a header");
        assert_eq!(header.timescale, Some((10, TimescaleUnit::US)));
        let variables = ["V[1]", "w[2,3]"].map(|name| header.find_var(&["m", name]).expect(name).code);
        let (mut time, mut changes) = (0, Vec::new());
        for command in parser {
            match command.expect("a command") {
                vcd::Command::Timestamp(at) => time = at,
                vcd::Command::ChangeReal(code, value) => {
                    changes.push((time, variables.iter().position(|v| *v == code).expect("declared"), value));
                }
                _ => {}
            }
        }
        assert_eq!(changes, [(0, 0, 1.5), (0, 1, -2.0), (25, 1, 1e-300), (50, 0, 0.1)]);
    }

    #[test]
    fn the_time_unit_divides_the_step_or_is_the_finest() {
        let of = |step| timescale(step, 1000);
        assert_eq!(of(1.0), (TimescaleUnit::S, 1, 0));
        assert_eq!(of(5e-3), (TimescaleUnit::MS, 1, -3));
        assert_eq!(of(1e-4), (TimescaleUnit::US, 100, -4));
        assert_eq!(of(1.0 / 44100.0), (TimescaleUnit::FS, 1, -15));
        assert_eq!(timescale(1.0 / 3.0, 1_000_000).2, -13);
    }
}
