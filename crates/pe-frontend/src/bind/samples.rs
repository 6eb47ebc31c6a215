//! Sampled signals from data files: `samples("breath.csv", "p", linear)`.

use crate::bind::data::{find_column, numbers};
use crate::language::measures::{TIMES, TimeUnit, scaled, unit_scale};
use crate::language::waveforms::between;
use crate::report::Report;
use crate::syntax::ast::{Name, Spec};
use pe_ir::codes;
use pe_ir::model::Samples;
use pe_ir::source::Diagnostic;

/// The signal in a column of a data file, over its first column, the times.
pub(crate) fn samples(
    spec: &Spec,
    (path, column): (&Name, &Name),
    interpolation: &Name,
    time: TimeUnit,
    report: &mut Report,
) -> Option<Samples> {
    let interpolation = between(interpolation).map_err(|error| report.push(error)).ok()?;
    let table = spec.table(path)?;
    let number = find_column(table, column, report)?;
    let unit = &table.columns[0].unit;
    let unit = unit.as_ref().map(|unit| Name { text: unit.clone(), span: table.columns[0].place });
    let scale = unit_scale(unit.as_ref(), &TIMES, "times in the first column", time.seconds);
    let scale = scale.map_err(|error| report.push(error)).ok()?;
    let times = numbers(table, 0, report)?;
    let values = numbers(table, number, report)?;
    if times.is_empty() {
        let place = table.columns[number].place;
        report.push(Diagnostic::error(codes::BAD_TABLE, place, "the file holds no samples"));
        return None;
    }
    let times: Vec<f64> = times.into_iter().map(|time| scaled(time, scale)).collect();
    if let Some(at) = times.windows(2).position(|pair| pair[0] >= pair[1]) {
        let place = |row: usize| table.cells[row * table.columns.len()].place;
        let error = Diagnostic::error(codes::BAD_TABLE, place(at + 1), "this time is not later than the one before");
        report.push(error.with_label(place(at), "the one before").with_help("sort the rows by time, each once"));
        return None;
    }
    Samples::new(times, values, interpolation)
}
