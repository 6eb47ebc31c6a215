//! Compares the fixed-point run of an imported model with results of another tool.

use std::path::Path;

use pe_flow::failure::Failure;
use pe_flow::pipeline;
use pe_flow::settings::Settings;
use pe_flow::spec::LoadedModel;
use pe_flow::watch::Stopwatch;
use pe_judge::{DesignPoint, runs};
use pe_sim::fixed::FixedRun;

/// Results of another tool: columns over time.
#[derive(Clone, Debug, Default)]
pub struct Results {
    /// Names of the columns after the time.
    pub names: Vec<String>,
    /// Times, ascending.
    pub times: Vec<f64>,
    /// A row for each time.
    pub rows: Vec<Vec<f64>>,
}

/// How a column agrees.
#[derive(Clone, Debug)]
pub struct Column {
    /// Its name in the results.
    pub name: String,
    /// The largest difference over its tolerance; infinite where there is no number.
    pub ratio: f64,
    /// That difference.
    pub difference: f64,
    /// The tolerance there.
    pub tolerance: f64,
    /// The time of it.
    pub time: f64,
}

impl Results {
    /// Reads CSV: a row of names, of which the first is the time, then numbers.
    ///
    /// # Errors
    /// The problem, with its line.
    pub fn read(path: &Path) -> Result<Results, Failure> {
        let problem = |text: String| Failure::file("read", path, text);
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_path(path)
            .map_err(|error| problem(error.to_string()))?;
        let names = reader.headers().map_err(|error| problem(error.to_string()))?;
        let names = names.iter().skip(1).map(str::to_owned).collect();
        let mut results = Results { names, ..Results::default() };
        for record in reader.records() {
            let record = record.map_err(|error| problem(error.to_string()))?;
            let line = record.position().map_or(0, csv::Position::line);
            let cells: Result<Vec<f64>, Failure> = record
                .iter()
                .map(|cell| {
                    cell.parse().map_err(|_| problem(format!("line {line}: `{}` is no number", cell.escape_debug())))
                })
                .collect();
            let cells = cells?;
            let time = cells.first().copied().unwrap_or(f64::NAN);
            if !time.is_finite() || results.times.last().is_some_and(|last| *last >= time) {
                return Err(problem(format!("line {line}: times must be numbers that ascend")));
            }
            results.times.push(time);
            results.rows.push(cells[1..].to_vec());
        }
        match results.times.len() {
            0 | 1 => Err(problem("it has no rows to compare".to_owned())),
            _ => Ok(results),
        }
    }

    /// The time between the first two rows.
    pub fn interval(&self) -> f64 {
        self.times[1] - self.times[0]
    }

    /// The time of the last row.
    pub fn end(&self) -> f64 {
        self.times[self.times.len() - 1]
    }
}

/// Runs a model in fixed point and compares it with results at their times, which are in units of so many `seconds`.
/// `columns` are names of results, each with that of an output; a difference may be `absolute` plus `relative` times the
/// result.
///
/// # Errors
/// Refusals of the compiler, columns that are not there, times between steps.
pub fn compare(
    loaded: &LoadedModel,
    point: &DesignPoint,
    results: &Results,
    columns: &[(String, String)],
    (absolute, relative): (f64, f64),
    seconds: f64,
) -> Result<Vec<Column>, Failure> {
    let model = &loaded.model;
    let mut pairs = Vec::new();
    for (name, output) in columns {
        let Some(output) = model.outputs.iter().position(|known| known.name == *output) else { continue };
        if let Some(column) = results.names.iter().position(|known| known == name) {
            pairs.push((column, output));
        }
    }
    if pairs.is_empty() {
        let wanted: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
        return Err(Failure::Mismatch(format!(
            "nothing was compared: the results have columns {}, the outputs are {}",
            results.names.join(", "),
            wanted.join(", ")
        )));
    }
    let prepared = pipeline::prepare(loaded, &Settings::default(), point, &mut Stopwatch::silent())?;
    let mut run = FixedRun::new(&prepared.graph, &prepared.judged.fixed);
    let mut found: Vec<Column> = pairs
        .iter()
        .map(|(column, _)| Column {
            name: results.names[*column].clone(),
            ratio: 0.0,
            difference: 0.0,
            tolerance: 0.0,
            time: 0.0,
        })
        .collect();
    let mut judge = |row: usize, value: &dyn Fn(usize) -> f64| {
        for (column, (cell, output)) in found.iter_mut().zip(&pairs) {
            let expected = results.rows[row].get(*cell).copied().unwrap_or(f64::NAN);
            let difference = (value(*output) - expected).abs();
            let tolerance = absolute + relative * expected.abs();
            let ratio = match difference {
                0.0 => 0.0,
                difference if difference.is_nan() => f64::INFINITY,
                difference => difference / tolerance,
            };
            if ratio > column.ratio {
                let (name, time) = (std::mem::take(&mut column.name), results.times[row]);
                *column = Column { name, ratio, difference, tolerance, time };
            }
        }
    };
    let mut row = results.times.partition_point(|time| *time < 0.0);
    if results.times.get(row) == Some(&0.0) {
        let first = model.initial_outputs(&model.sample_inputs(0.0));
        judge(row, &|output| first[output]);
        row += 1;
    }
    let steps = model.steps();
    for step in 0..steps {
        let Some(next) = results.times.get(row).map(|time| time * seconds) else { break };
        run.step(&runs::port_words(model, &run, step));
        let time = model.time(step + 1, 0.0);
        if next > time + 1e-4 * model.step {
            continue;
        }
        if (next - time).abs() > 1e-4 * model.step {
            return Err(Failure::Usage(format!(
                "the results have a row at {}, which lies between two steps; choose a `--step` that divides the time \
                 between rows",
                results.times[row]
            )));
        }
        judge(row, &|output| run.output(output));
        row += 1;
    }
    if row < results.times.len() {
        return Err(Failure::Usage(format!(
            "the results end at {}, the run at {}; choose a longer `--span`",
            results.end(),
            model.time(steps, 0.0) / seconds
        )));
    }
    Ok(found)
}

/// The comparison as a table.
pub fn table(columns: &[Column]) -> String {
    let mut text =
        String::from("| column | largest difference | tolerance | at | of tolerance | |\n|---|---|---|---|---|---|\n");
    for Column { name, ratio, difference, tolerance, time } in columns {
        let verdict = if *ratio <= 1.0 { "agrees" } else { "differs" };
        text += &format!("| {name} | {difference:.3e} | {tolerance:.3e} | {time} | {ratio:.3} | {verdict} |\n");
    }
    text
}
