//! The figures of a compiled design that are compared over time: read from a folder that `compile` or `golden` wrote,
//! or from a report alone.
//!
//! Only the figures named here count. Other keys of a report are ignored, so that a newer version may add some.

use std::fs;
use std::path::Path;

use pe_flow::report::compared::{Compared, Parts, Trace, Word};
use pe_map::sha256;
use serde::Serialize;
use serde_json::{Number, Value, json};

use pe_flow::failure::Failure;

/// A figure of the report and the group by which its tolerance is named.
pub struct Figure {
    /// Name for people.
    pub name: &'static str,
    /// Name of the tolerance.
    pub group: &'static str,
    /// Its value, if the report has it.
    pub value: fn(&Compared) -> Option<Value>,
}

const fn figure(name: &'static str, group: &'static str, value: fn(&Compared) -> Option<Value>) -> Figure {
    Figure { name, group, value }
}

fn some<T: Serialize>(field: &Option<T>) -> Option<Value> {
    field.as_ref().map(|field| json!(field)).filter(|value| !value.is_null())
}

fn word(report: &Compared, field: fn(&Word) -> &Option<Number>) -> Option<Value> {
    report.word.as_ref().and_then(|word| some(field(word)))
}

fn part(report: &Compared, field: fn(&Parts) -> &Option<f64>) -> Option<Value> {
    report.error.as_ref().and_then(|error| some(field(error)))
}

/// Group of the figures that tell which design it is: where one differs, the others compare different things.
pub const SETUP: &str = "setup";

/// Group of what the first steps compute, bit for bit.
pub const TRACE: &str = "trace";

/// All figures in the order in which they are shown.
pub const FIGURES: &[Figure] = &[
    figure("model", SETUP, |report| some(&report.model)),
    figure("solver", SETUP, |report| some(&report.solver)),
    figure("stage form", SETUP, |report| some(&report.stage_form)),
    figure("step in s", SETUP, |report| some(&report.step_s)),
    figure("span in s", SETUP, |report| some(&report.span_s)),
    figure("PEs", SETUP, |report| some(&report.pes)),
    figure("storage bits", SETUP, |report| word(report, |word| &word.storage_bits)),
    figure("guard bits", SETUP, |report| word(report, |word| &word.guard_bits)),
    figure("data port bits", SETUP, |report| word(report, |word| &word.mul_a_bits)),
    figure("coefficient port bits", SETUP, |report| word(report, |word| &word.mul_b_bits)),
    figure("seed", SETUP, |report| some(&report.seed)),
    figure("outputs", SETUP, |report| some(&report.outputs)),
    figure("ODEs", "odes", |report| some(&report.odes)),
    figure("cycles per step", "cycles", |report| some(&report.cycles_per_step)),
    figure("products per step", "products", |report| some(&report.macs_per_step)),
    figure("memory writes per step", "writes", |report| some(&report.writes_per_step)),
    figure("transfers per step", "transfers", |report| some(&report.transfers_per_step)),
    figure("connections", "connections", |report| some(&report.connections)),
    figure("ports of a PE", "ports", |report| some(&report.max_in_degree)),
    figure("data words of a PE", "words", |report| some(&report.data_words_max)),
    figure("LUT", "lut", |report| report.area.as_ref().and_then(|area| some(&area.lut))),
    figure("flip-flops", "ff", |report| report.area.as_ref().and_then(|area| some(&area.ff))),
    figure("DSP", "dsp", |report| report.area.as_ref().and_then(|area| some(&area.dsp))),
    figure("BRAM18", "bram18", |report| report.area.as_ref().and_then(|area| some(&area.bram18))),
    figure("word-length error", "error", |report| part(report, |error| &error.word_length)),
    figure("coefficient error", "error", |report| part(report, |error| &error.coefficient)),
    figure("method error", "error", |report| part(report, |error| &error.method)),
    figure("input-hold error", "error", |report| part(report, |error| &error.input_hold)),
    figure("total error", "error", |report| part(report, |error| &error.total)),
    figure("trace lines", TRACE, |report| report.trace.as_ref().map(|trace| json!(trace.lines))),
    figure("trace SHA-256", TRACE, |report| report.trace.as_ref().map(|trace| json!(trace.sha256))),
];

/// What is known of a design.
pub struct Record {
    /// The report; with a trace if there is one.
    pub report: Compared,
    /// Output words of the first steps, `step output word` per line.
    pub outputs: Option<String>,
}

impl Record {
    /// Reads a folder or a report.
    ///
    /// # Errors
    /// If there is no report, or it is none of ours.
    pub fn read(path: &Path) -> Result<Record, Failure> {
        let is_folder = path.is_dir();
        let file = if is_folder { path.join("report.json") } else { path.to_owned() };
        let text = fs::read_to_string(&file).map_err(|error| Failure::file("read", &file, error))?;
        let mut report: Compared = serde_json::from_str(&text).map_err(|error| Failure::file("read", &file, error))?;
        if !report.generator.starts_with("pe-synth ") {
            return Err(Failure::file("read", &file, "it is no report of pe-synth"));
        }
        let mut outputs = None;
        if is_folder {
            let of_kind = |kind: &str| file_of_kind(path, kind);
            if let Some(trace) = of_kind("_trace.txt")? {
                report.trace = Some(Trace { lines: trace.lines().count() as u64, sha256: sha256(trace.as_bytes()) });
            }
            outputs = of_kind("_outputs.txt")?;
        }
        Ok(Record { report, outputs })
    }

    /// A figure, if the report has it.
    pub fn figure(&self, figure: &Figure) -> Option<Value> {
        (figure.value)(&self.report)
    }

    /// The report without what is not compared; with the command, so that it can be given again.
    pub fn reduced(&self) -> Value {
        json!(self.report)
    }
}

/// Text of the one file of a folder whose name ends so.
fn file_of_kind(folder: &Path, ending: &str) -> Result<Option<String>, Failure> {
    let entries = fs::read_dir(folder).map_err(|error| Failure::file("read", folder, error))?;
    let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.retain(|path| path.to_string_lossy().ends_with(ending));
    paths.sort();
    let Some(path) = paths.first() else { return Ok(None) };
    fs::read_to_string(path).map(Some).map_err(|error| Failure::file("read", path, error))
}
