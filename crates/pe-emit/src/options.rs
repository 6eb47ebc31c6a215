//! What the files of a design tell beside its program.

use std::collections::BTreeMap;

use pe_map::{Between, Meaning};

use crate::names::comment_text;
use pe_ir::index::{List, PeId};

/// What the files tell about their origin, and what the test benches run.
#[derive(Clone, Debug, Default)]
pub struct EmitOptions {
    /// Command for the `Regenerate:` line of the headers.
    pub command: String,
    /// Name of the spec.
    pub spec: String,
    /// Version of the tool.
    pub version: String,
    /// Files that the spec was read from, each with the SHA-256 of its content in hex.
    pub files: Vec<(String, String)>,
    /// What the words of the program come from.
    pub provenance: Provenance,
    /// What the ports and the step stand for.
    pub interface: Interface,
    /// Words of each input port in each step; runs that last longer repeat the last step's.
    pub stimulus: Vec<Vec<i64>>,
    /// Whether there is a C header for the reference as a library.
    pub c_header: bool,
    /// Steps that the test benches run unless told otherwise.
    pub default_steps: u32,
}

/// What the words of a program come from, by PE; comments show it and nothing else does. What is missing is not shown.
#[derive(Clone, Debug, Default)]
pub struct Provenance {
    /// The statements of the spec that the equations of each PE come from, with their places.
    pub statements: List<PeId, Vec<String>>,
    /// The coefficient of each control word before it was rounded to a word.
    pub coefficients: List<PeId, Vec<Option<f64>>>,
}

/// What the map of a design tells beside its program.
#[derive(Clone, Debug, Default)]
pub struct Interface {
    /// Step in seconds, after the early ones.
    pub step: f64,
    /// Shorter steps at the beginning: the time at which each ends, and its length, in seconds.
    pub early_steps: Vec<(f64, f64)>,
    /// The input ports.
    pub inputs: Vec<Driven>,
    /// Tunable parameters.
    pub parameters: Vec<Tunable>,
    /// Numbers of the outputs in the initial state, with all inputs 0, by name; of those that have one.
    pub initial: BTreeMap<String, f64>,
}

/// A tunable parameter.
#[derive(Clone, Debug)]
pub struct Tunable {
    /// Name, which is that of its state.
    pub name: String,
    /// Unit in the spec.
    pub unit: Option<String>,
    /// Value in the spec.
    pub value: f64,
    /// Range that the spec states.
    pub range: [f64; 2],
}

/// What an input port stands for.
#[derive(Clone, Debug)]
pub struct Driven {
    /// A quantity of the model, or the step ratio.
    pub meaning: Meaning,
    /// Range that the spec states.
    pub range: Option<[f64; 2]>,
    /// What is given for the time between two steps.
    pub between: Between,
}

/// Lines that open every generated file.
pub(crate) struct Header {
    pub(crate) version: String,
    pub(crate) spec: String,
    pub(crate) command: String,
    /// Name and hash of each file that was read.
    pub(crate) files: Vec<String>,
}

impl Header {
    pub(crate) fn of(options: &EmitOptions) -> Header {
        let file = |(name, hash): &(String, String)| format!("{}, SHA-256 {hash}", comment_text(name));
        Header {
            version: comment_text(&options.version),
            spec: comment_text(&options.spec),
            command: comment_text(&options.command),
            files: options.files.iter().map(file).collect(),
        }
    }
}
