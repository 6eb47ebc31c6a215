//! What became of a design point.

use pe_ir::memory::BLOCK_LUTS;
use pe_ir::model::Solver;
use pe_ir::source::Severity;
use serde_json::{Map, Value, json};

use crate::failure::Failure;
use pe_judge::DesignPoint;
use pe_target::area::DSP_LUTS;

/// Keys of `report.json` that a row takes over; the others are the same for all points or belong to one design.
const KEPT: [&str; 18] = [
    "pes",
    "solver",
    "stage_form",
    "step_s",
    "span_s",
    "cycles_per_step",
    "macs_per_step",
    "bound_cycles",
    "bound_binds",
    "connections",
    "max_in_degree",
    "transfers_per_step",
    "word",
    "area",
    "clock",
    "time_per_simulated_second_ms",
    "error",
    "widenings",
];

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
    /// Its figures, under the keys of `report.json`, and the codes of its warnings.
    Compiled(Figures),
    /// Why there is no design.
    Failed(Reason),
}

/// Figures of a compiled point.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// Keys of `report.json` and their values.
    pub report: Map<String, Value>,
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
    /// A total error that is larger than was asked for; `double` is that of the run in double precision.
    pub fn beyond(error: f64, double: f64) -> Reason {
        let message = format!("total error {error:.1e} is larger than was asked for");
        Reason { code: None, message, exit_code: 0, beyond: Some((error, double)) }
    }

    /// The reason that a failure gives.
    pub fn of(failure: &Failure) -> Reason {
        let exit_code = failure.code();
        match failure {
            Failure::Spec(findings, _) => {
                let first = findings.iter().find(|finding| finding.severity == Severity::Error);
                let (code, message) = first
                    .map_or((None, String::new()), |finding| (Some(finding.code.to_owned()), finding.message.clone()));
                Reason { code, message, exit_code, beyond: None }
            }
            Failure::Fruitless(text)
            | Failure::Usage(text)
            | Failure::File(text)
            | Failure::Mismatch(text)
            | Failure::MissingTool(text)
            | Failure::Internal(text)
            | Failure::Interrupted(text) => Reason { code: None, message: text.clone(), exit_code, beyond: None },
        }
    }
}

impl Figures {
    /// The part of a report that differs from point to point.
    pub fn of(report: &Value, warnings: Vec<String>) -> Figures {
        let kept = KEPT.iter().filter_map(|key| Some(((*key).to_owned(), report.get(*key)?.clone())));
        Figures { report: kept.collect(), warnings }
    }

    /// A number, addressed as `area.lut`.
    pub fn number(&self, path: &str) -> Option<f64> {
        self.value(path)?.as_f64()
    }

    /// A value, addressed as `area.lut`; none if it is null.
    pub fn value(&self, path: &str) -> Option<&Value> {
        let mut keys = path.split('.');
        let first = self.report.get(keys.next()?)?;
        keys.try_fold(first, |value, key| value.get(key)).filter(|value| !value.is_null())
    }

    /// Milliseconds of run time per simulated second.
    pub fn time_ms(&self) -> f64 {
        self.number("time_per_simulated_second_ms").unwrap_or(f64::NAN)
    }

    /// Size in LUTs, DSP blocks and block RAM counted as LUTs.
    pub fn equivalent_lut(&self) -> f64 {
        let count = |key| self.number(key).unwrap_or(f64::NAN);
        count("area.lut") + DSP_LUTS * count("area.dsp") + BLOCK_LUTS * count("area.bram18")
    }

    /// Error against the library reference.
    pub fn total_error(&self) -> Option<f64> {
        self.number("error.total")
    }
}

impl Row {
    /// A row of tests: some point with these keys of a report.
    #[cfg(test)]
    pub(crate) fn compiled(report: &Value) -> Row {
        let point = DesignPoint::default();
        let report = report.as_object().expect("an object").clone();
        Row { point, command: String::new(), outcome: Outcome::Compiled(Figures { report, warnings: Vec::new() }) }
    }

    /// The figures of a compiled point.
    pub fn figures(&self) -> Option<&Figures> {
        match &self.outcome {
            Outcome::Compiled(figures) => Some(figures),
            Outcome::Failed(_) => None,
        }
    }

    /// The row as it is stored.
    pub fn to_json(&self) -> Map<String, Value> {
        let mut map = Map::new();
        map.insert("command".into(), json!(self.command));
        match &self.outcome {
            Outcome::Compiled(figures) => {
                map.extend(figures.report.clone());
                map.insert("status".into(), json!("compiled"));
                map.insert("warnings".into(), json!(figures.warnings));
                map.insert("equivalent_lut".into(), json!(figures.equivalent_lut()));
            }
            Outcome::Failed(reason) => {
                let (data, coefficient) = self.point.multiplier.unzip();
                map.insert("pes".into(), json!(self.point.pes));
                map.insert("solver".into(), json!(self.point.solver.map(Solver::name)));
                map.insert("step_s".into(), json!(self.point.step));
                let word = json!({"storage_bits": self.point.storage, "mul_a_bits": data, "mul_b_bits": coefficient});
                map.insert("word".into(), word);
                map.insert("status".into(), json!("failed"));
                map.insert("code".into(), json!(reason.code));
                map.insert("message".into(), json!(reason.message));
                map.insert("exit_code".into(), json!(reason.exit_code));
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
                let figures = Figures::of(row, warnings);
                (figures.report.len() == KEPT.len()).then_some(Outcome::Compiled(figures))
            }
            "failed" => {
                let exit_code = u8::try_from(row.get("exit_code")?.as_u64()?).ok()?;
                Some(Outcome::Failed(Reason { code: text("code"), message: text("message")?, exit_code, beyond: None }))
            }
            _ => None,
        }
    }
}

/// The multiplier as on the command line.
pub fn multiplier(point: &DesignPoint) -> String {
    point.multiplier.map_or(String::new(), |(data, coefficient)| format!("{data}x{coefficient}"))
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
