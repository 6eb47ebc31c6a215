//! The figures of a compiled design that are compared over time: read from a folder that `compile` or `golden` wrote,
//! or from a report alone.
//!
//! Only the figures named here count. Other keys of a report are ignored, so that a newer version may add some.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use pe_flow::failure::Failure;

/// A figure of the report and the group by which its tolerance is named.
pub struct Figure {
    /// Name for people.
    pub name: &'static str,
    /// JSON pointer into the report.
    pub key: &'static str,
    /// Name of the tolerance.
    pub group: &'static str,
}

const fn figure(name: &'static str, key: &'static str, group: &'static str) -> Figure {
    Figure { name, key, group }
}

/// Group of the figures that tell which design it is: where one differs, the others compare different things.
pub const SETUP: &str = "setup";

/// Group of what the first steps compute, bit for bit.
pub const TRACE: &str = "trace";

/// All figures in the order in which they are shown.
pub const FIGURES: &[Figure] = &[
    figure("model", "/model", SETUP),
    figure("solver", "/solver", SETUP),
    figure("stage form", "/stage_form", SETUP),
    figure("step in s", "/step_s", SETUP),
    figure("span in s", "/span_s", SETUP),
    figure("PEs", "/pes", SETUP),
    figure("storage bits", "/word/storage_bits", SETUP),
    figure("guard bits", "/word/guard_bits", SETUP),
    figure("data port bits", "/word/mul_a_bits", SETUP),
    figure("coefficient port bits", "/word/mul_b_bits", SETUP),
    figure("seed", "/seed", SETUP),
    figure("outputs", "/outputs", SETUP),
    figure("ODEs", "/odes", "odes"),
    figure("cycles per step", "/cycles_per_step", "cycles"),
    figure("products per step", "/macs_per_step", "products"),
    figure("memory writes per step", "/writes_per_step", "writes"),
    figure("transfers per step", "/transfers_per_step", "transfers"),
    figure("connections", "/connections", "connections"),
    figure("ports of a PE", "/max_in_degree", "ports"),
    figure("data words of a PE", "/data_words_max", "words"),
    figure("LUT", "/area/lut", "lut"),
    figure("flip-flops", "/area/ff", "ff"),
    figure("DSP", "/area/dsp", "dsp"),
    figure("BRAM18", "/area/bram18", "bram18"),
    figure("word-length error", "/error/word_length", "error"),
    figure("coefficient error", "/error/coefficient", "error"),
    figure("method error", "/error/method", "error"),
    figure("input-hold error", "/error/input_hold", "error"),
    figure("total error", "/error/total", "error"),
    figure("trace lines", "/trace/lines", TRACE),
    figure("trace SHA-256", "/trace/sha256", TRACE),
];

/// What is known of a design.
pub struct Record {
    /// The report; with `trace` if there is one.
    pub report: Value,
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
        let mut report: Value = serde_json::from_str(&text).map_err(|error| Failure::file("read", &file, error))?;
        if !report["generator"].as_str().is_some_and(|generator| generator.starts_with("pe-synth ")) {
            return Err(Failure::file("read", &file, "it is no report of pe-synth"));
        }
        let mut outputs = None;
        if is_folder {
            let of_kind = |kind: &str| file_of_kind(path, kind);
            if let Some(trace) = of_kind("_trace.txt")? {
                let mut digest = String::new();
                for byte in Sha256::digest(trace.as_bytes()) {
                    let _ = write!(digest, "{byte:02x}");
                }
                report["trace"] = serde_json::json!({"lines": trace.lines().count(), "sha256": digest});
            }
            outputs = of_kind("_outputs.txt")?;
        }
        Ok(Record { report, outputs })
    }

    /// A figure, if the report has it.
    pub fn figure(&self, figure: &Figure) -> Option<&Value> {
        self.report.pointer(figure.key).filter(|value| !value.is_null())
    }

    /// The report without what is not compared; with the command, so that it can be given again.
    pub fn reduced(&self) -> Value {
        let mut reduced = Map::new();
        for key in ["generator", "command"] {
            reduced.insert(key.to_owned(), self.report[key].clone());
        }
        for figure in FIGURES {
            let Some(value) = self.figure(figure) else { continue };
            let mut keys = figure.key.split('/').skip(1);
            match (keys.next(), keys.next()) {
                (Some(outer), Some(inner)) => {
                    let object = reduced.entry(outer).or_insert_with(|| Value::Object(Map::new()));
                    object[inner] = value.clone();
                }
                (Some(key), None) => {
                    reduced.insert(key.to_owned(), value.clone());
                }
                (None, _) => {}
            }
        }
        Value::Object(reduced)
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
