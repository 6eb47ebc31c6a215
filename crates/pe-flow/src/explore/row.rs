//! The outcome of a design point.

use pe_ir::memory::BLOCK_LUTS;
use pe_ir::model::Solver;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::failure::Failure;
use crate::report::Figures;
use pe_judge::DesignPoint;
use pe_target::area::DSP_LUTS;

/// Points shown beside the chosen one.
pub const RUNNERS_UP: usize = 4;

/// A design point of a sweep with its result.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The point.
    pub point: DesignPoint,
    /// The command that compiles it alone.
    pub command: String,
    /// What became of it.
    pub outcome: Outcome,
}

/// What became of a point.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Its figures and the codes of its warnings.
    Compiled(Box<Compiled>),
    /// Why there is no design.
    Failed(Reason),
}

impl Outcome {
    /// The columns of a table: status, codes of warnings, code and message of the failure.
    pub fn columns(&self) -> [String; 4] {
        match self {
            Outcome::Compiled(compiled) => {
                ["compiled".to_owned(), compiled.warnings.join(" "), String::new(), String::new()]
            }
            Outcome::Failed(Reason { code, message, .. }) => {
                ["failed".to_owned(), String::new(), code.clone().unwrap_or_default(), message.clone()]
            }
        }
    }
}

/// A compiled point.
#[derive(Clone, Debug, PartialEq)]
pub struct Compiled {
    /// What `report.json` says of it, and differs from point to point.
    pub figures: Figures,
    /// Codes of the warnings.
    pub warnings: Vec<String>,
}

/// Why a point failed.
#[derive(Clone, Debug, PartialEq)]
pub struct Reason {
    /// Diagnostic code; options that do not go together have none.
    pub code: Option<String>,
    /// Message.
    pub message: String,
    /// Exit code of the point's command.
    pub exit_code: u8,
    /// Total error of a point that is wrong by more than was asked for, and that of its run in double precision.
    pub beyond: Option<(f64, f64)>,
}

impl Reason {
    /// A total error that exceeds the goal; `double` is that of the run in double precision.
    pub fn beyond(error: f64, double: f64) -> Reason {
        let message = format!("total error {error:.1e} exceeds the goal");
        Reason { code: None, message, exit_code: 0, beyond: Some((error, double)) }
    }

    /// A total error that exceeded the goal before the run was over: after so many seconds it was as large as that.
    pub fn at_least(error: f64, time: f64) -> Reason {
        let message = format!("total error exceeds the goal: {error:.1e} by t = {time:.3e} s, where the run was ended");
        Reason { code: None, message, exit_code: 0, beyond: None }
    }

    /// Whether there would be a design, but a more wrong one than was asked for.
    pub fn is_beyond(&self) -> bool {
        self.exit_code == 0
    }

    /// The reason that a failure gives.
    pub fn of(failure: &Failure) -> Reason {
        let finding = failure.finding();
        let message = finding.map(|finding| &*finding.message).or(failure.text()).unwrap_or_default().to_owned();
        Reason {
            code: finding.map(|finding| finding.code.to_owned()),
            message,
            exit_code: failure.code(),
            beyond: None,
        }
    }
}

impl Figures {
    /// Size in LUTs, DSP blocks and block RAM counted as LUTs.
    pub fn equivalent_lut(&self) -> f64 {
        let cells = &self.area.cells;
        cells.lut + DSP_LUTS * f64::from(cells.dsp) + BLOCK_LUTS * f64::from(cells.bram18)
    }

    /// Milliseconds of run time per simulated second.
    pub fn time_ms(&self) -> f64 {
        self.time_per_simulated_second_ms
    }

    /// Error against the library reference.
    pub fn total_error(&self) -> Option<f64> {
        self.error.total
    }
}

impl Row {
    /// A row of tests: some point with such a size, time and error.
    #[cfg(test)]
    pub(crate) fn compiled(lut: f64, time_ms: f64, total: Option<f64>) -> Row {
        use crate::report::errors::OfTotal;

        let mut figures = Figures { time_per_simulated_second_ms: time_ms, ..Figures::default() };
        (figures.area.cells.lut, figures.error.total) = (lut, total);
        figures.error.of_total = total.map(|double| Box::new(OfTotal { double, ..Default::default() }));
        let compiled = Compiled { figures, warnings: Vec::new() };
        Row { point: DesignPoint::default(), command: String::new(), outcome: Outcome::Compiled(Box::new(compiled)) }
    }

    /// The figures of a compiled point.
    pub fn figures(&self) -> Option<&Figures> {
        match &self.outcome {
            Outcome::Compiled(compiled) => Some(&compiled.figures),
            Outcome::Failed(_) => None,
        }
    }

    /// The row as it is stored.
    pub fn to_json(&self) -> Map<String, Value> {
        let mut map = Map::new();
        map.insert("command".into(), json!(self.command));
        match &self.outcome {
            Outcome::Compiled(compiled) => {
                let Compiled { figures, warnings } = &**compiled;
                let Ok(Value::Object(keys)) = serde_json::to_value(figures) else { unreachable!("a structure") };
                map.extend(keys);
                map.insert("status".into(), json!("compiled"));
                map.insert("warnings".into(), json!(warnings));
                map.insert("equivalent_lut".into(), json!(figures.equivalent_lut()));
            }
            Outcome::Failed(reason) => {
                let ports = self.point.multiplier;
                let (data, coefficient) = ports.map(|ports| (ports.data_bits, ports.coefficient_bits)).unzip();
                map.insert("pes".into(), json!(self.point.pes));
                map.insert("solver".into(), json!(self.point.solver.map(Solver::name)));
                map.insert("step_s".into(), json!(self.point.step));
                let word = json!({
                    "storage_bits": self.point.storage,
                    "data_bits": data,
                    "coefficient_bits": coefficient,
                    "mul_a_bits": data,
                    "mul_b_bits": coefficient,
                });
                map.insert("word".into(), word);
                map.insert("status".into(), json!("failed"));
                map.insert("code".into(), json!(reason.code));
                map.insert("message".into(), json!(reason.message));
                map.insert("exit_code".into(), json!(reason.exit_code));
                if let Some((total, double)) = reason.beyond {
                    map.insert("error".into(), json!({"total": total, "double": double}));
                }
            }
        }
        map
    }

    /// Reads the outcome of a stored row; none if it is not whole.
    pub fn outcome_from_json(row: &Value) -> Option<Outcome> {
        let text = |key: &str| Some(row.get(key)?.as_str()?.to_owned());
        match row.get("status")?.as_str()? {
            "compiled" => {
                let warnings = row.get("warnings")?.as_array()?.iter();
                let warnings = warnings.map(|code| code.as_str().map(str::to_owned)).collect::<Option<_>>()?;
                let figures = Figures::deserialize(row).ok()?;
                Some(Outcome::Compiled(Box::new(Compiled { figures, warnings })))
            }
            "failed" => {
                let exit_code = u8::try_from(row.get("exit_code")?.as_u64()?).ok()?;
                // What is no number, because it is infinite, is stored as null.
                let beyond = row.get("error").filter(|error| error.get("double").is_some()).map(|error| {
                    let number = |key: &str| error.get(key).and_then(Value::as_f64).unwrap_or(f64::INFINITY);
                    (number("total"), number("double"))
                });
                Some(Outcome::Failed(Reason { code: text("code"), message: text("message")?, exit_code, beyond }))
            }
            _ => None,
        }
    }
}

/// The multiplier as on the command line.
pub fn multiplier(point: &DesignPoint) -> String {
    point.multiplier.map_or(String::new(), |ports| ports.to_string())
}

/// The step with a unit; behind it those for the beginning.
pub fn step(point: &DesignPoint) -> String {
    let early = point.early_steps.iter().flat_map(|early| early.list());
    let early: Vec<String> = early.map(|(step, until)| format!("{} until {}", time(*step), time(*until))).collect();
    let last = time(point.step.unwrap_or(f64::NAN));
    if early.is_empty() { last } else { format!("{}, then {last}", early.join(", then ")) }
}

/// A time with a unit.
fn time(seconds: f64) -> String {
    let units = [(1.0, "s"), (1e-3, "ms"), (1e-6, "us")];
    let (scale, unit) = units.into_iter().find(|(scale, _)| seconds >= *scale).unwrap_or((1e-9, "ns"));
    let rounded: f64 = format!("{:.3e}", seconds / scale).parse().unwrap_or(seconds);
    format!("{rounded} {unit}")
}
