//! The figures of a report that are compared over time, whatever else it holds: those of another version, or of a
//! golden folder, may lack some.

use serde::{Deserialize, Serialize};
use serde_json::Number;

/// A report for comparison.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
pub struct Compared {
    /// `pe-synth` and its version.
    pub generator: String,
    /// The command that makes the design again.
    pub command: String,
    /// Name of the model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Numerical method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver: Option<String>,
    /// Form of the step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage_form: Option<String>,
    /// Step in seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_s: Option<f64>,
    /// Span in seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub span_s: Option<f64>,
    /// PEs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pes: Option<Number>,
    /// Word widths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub word: Option<Word>,
    /// Seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<Number>,
    /// Names of the outputs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outputs: Option<Vec<String>>,
    /// Differential equations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub odes: Option<Number>,
    /// Clocks of a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycles_per_step: Option<Number>,
    /// Products of a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub macs_per_step: Option<Number>,
    /// Memory writes of a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub writes_per_step: Option<Number>,
    /// Words that arrive at other PEs in a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfers_per_step: Option<Number>,
    /// Pairs of PEs joined by a link.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub connections: Option<Number>,
    /// Input ports of the PE that has most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_in_degree: Option<Number>,
    /// Data words of the PE that has most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data_words_max: Option<Number>,
    /// Cells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub area: Option<Cells>,
    /// Parts of the error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<Parts>,
    /// The trace beside the report.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trace: Option<Trace>,
}

/// Word widths in bits.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
pub struct Word {
    /// Stored word.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub storage_bits: Option<Number>,
    /// Guard bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard_bits: Option<Number>,
    /// Data port.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mul_a_bits: Option<Number>,
    /// Coefficient port.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mul_b_bits: Option<Number>,
}

/// Cells of the network.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
pub struct Cells {
    /// LUTs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lut: Option<f64>,
    /// Flip-flops.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ff: Option<f64>,
    /// Multiplier blocks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dsp: Option<Number>,
    /// Block RAMs of 18 kbit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bram18: Option<Number>,
}

/// Parts of the error, relative.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
pub struct Parts {
    /// Of the word length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub word_length: Option<f64>,
    /// Of rounded coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coefficient: Option<f64>,
    /// Of the method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub method: Option<f64>,
    /// Of held inputs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_hold: Option<f64>,
    /// All together, against the reference solution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total: Option<f64>,
}

/// A reference trace.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
pub struct Trace {
    /// Its lines.
    pub lines: u64,
    /// Its SHA-256.
    pub sha256: String,
}
