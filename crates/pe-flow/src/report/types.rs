//! The report as a type: what `report.json` holds, key by key.
//!
//! Fields are named as keys; `docs/report.md` says what they mean, and the schema in `docs/report.schema.json` is
//! generated from these types. A field that is `None` and marked so is missing in the file; others are null.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::counted::Events;
use super::errors::{Chosen, DeviceFit, Errors, Stability};
use super::mechanism::Mechanism;
use super::network::{Limiting, Start, WireLength};
use super::systems::{Elimination, EliminationTrial, Pivot};
use super::values::nullable;

/// `report.json`.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Report {
    /// `pe-synth` and its version.
    pub generator: String,
    /// Name of the model.
    pub model: String,
    /// Differential equations.
    pub odes: usize,
    /// Figures that differ from point to point of a sweep.
    #[serde(flatten)]
    pub figures: Figures,
    /// Whether the number of PEs was chosen by the compiler.
    pub pes_default: bool,
    /// Forms of the step that were compared.
    pub forms: Vec<Form>,
    /// Steps for the beginning of the run.
    pub early_steps: Vec<EarlyStep>,
    /// Products that add two operands in the pre-adder.
    pub pairs: Pairs,
    /// The PE that limits the step.
    pub bottleneck: Limiting,
    /// Lengths of the connections.
    pub wire_length: WireLength,
    /// Memory writes of all PEs in a step.
    pub writes_per_step: u64,
    /// Programs that differ in more than coefficients.
    pub distinct_programs: usize,
    /// Mappings that were scheduled, the chosen one first.
    pub starts: Vec<Start>,
    /// Relays in the chosen step; only where relays were tried.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relays: Option<u32>,
    /// Copies in a step that carry values over other PEs; only where values travel so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hops: Option<u32>,
    /// Control words of a PE.
    pub instruction_words_max: usize,
    /// Own and imported words of the PE that has most.
    pub data_words_max: u32,
    /// The smallest pivot of an implicit method.
    pub smallest_pivot: Option<Pivot>,
    /// How well closures are kept; only for models that state a mechanism.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mechanism: Option<Mechanism>,
    /// Events of the runs; only with `--judge events`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub events: Option<Events>,
    /// Matrices of linear systems; only for models that have some.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub eliminations: Vec<Elimination>,
    /// Orders of elimination that were tried; missing where none was.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub elimination_trials: Vec<EliminationTrial>,
    /// The variables that come closest to the limits of their formats.
    pub headroom: Vec<Headroom>,
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Whether outputs are ports or in memories; missing of few ones that nobody asked about.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outputs_in: Option<OutputsIn>,
    /// Tunable parameters; missing where there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters: Option<Parameters>,
    /// Quantities that no output needs.
    pub left_out: Vec<String>,
    /// What is kept of the model, and why.
    pub kept: Vec<Kept>,
    /// Which hardware the PEs have, and why.
    pub features: Features,
    /// Rates of sampled blocks; only for models with sampled blocks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rates: Option<Vec<SampleRate>>,
    /// Proof of ranges; missing where no proof was requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ranges: Option<Ranges>,
    /// Function tables.
    pub functions: Vec<FunctionTable>,
    /// The check of the step; null for large models.
    pub stability: Option<Stability>,
    /// Why there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stability_reason: Option<String>,
    /// The size beside a device; only with one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceFit>,
    /// How the design was chosen; only where it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub choice: Option<Chosen>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The command that writes this report.
    pub command: String,
    /// SHA-256 of every file beside the report.
    #[serde(default)]
    pub files: BTreeMap<String, String>,
}

/// Figures of a design that differ from point to point of a sweep.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Figures {
    /// Size of the network.
    pub pes: usize,
    /// Numerical method.
    pub solver: String,
    /// Form of the step.
    pub stage_form: String,
    /// Step in seconds.
    pub step_s: f64,
    /// Time over which ranges and errors were judged, in seconds.
    pub span_s: f64,
    /// Clocks between two `done_o` in free run.
    pub cycles_per_step: u32,
    /// Products per step.
    pub macs_per_step: u64,
    /// The largest lower bound of the cycles per step.
    pub bound_cycles: u32,
    /// Which bound that is.
    pub bound_binds: String,
    /// Pairs of PEs joined by a link.
    pub connections: usize,
    /// Largest number of input ports of a PE.
    pub max_in_degree: usize,
    /// Words that arrive at another PE in a step.
    pub transfers_per_step: usize,
    /// Word widths.
    pub word: Word,
    /// Size of the network.
    pub area: Area,
    /// The clock.
    pub clock: Clock,
    /// Milliseconds that the network takes per simulated second.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub time_per_simulated_second_ms: f64,
    /// Errors of the design.
    pub error: Errors,
    /// Fixed-point runs that saturated and were repeated with wider ranges.
    pub widenings: usize,
}

/// A form of the step, and its estimated cost.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Form {
    /// Its name.
    pub form: String,
    /// Stages.
    pub stages: u32,
    /// Products per step.
    pub products: u64,
    /// Products of its largest equation.
    pub largest: u32,
    /// Input ports of a PE.
    pub ports: u32,
    /// Estimated cycles per step.
    pub cycles: u64,
}

/// Steps for the beginning of a run.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct EarlyStep {
    /// Time until which the step is taken, in seconds.
    pub until_s: f64,
    /// The step in seconds.
    pub step_s: f64,
}

/// Products that add two operands with equal coefficients in the pre-adder.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Pairs {
    /// In a step.
    pub per_step: u64,
    /// Values that a PE sends to itself for them.
    pub sent_home: u64,
    /// Products that another mapping could save.
    pub missed: u64,
    /// Why there are none.
    pub left_out: Option<String>,
}

/// Word widths.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Word {
    /// Stored word without guard bits.
    pub storage_bits: u32,
    /// Low bits that only additions see.
    pub guard_bits: u32,
    /// Data port of the multiplier.
    pub data_bits: u32,
    /// Coefficient port of the multiplier.
    pub coefficient_bits: u32,
    /// `data_bits` under its former name.
    pub mul_a_bits: u32,
    /// `coefficient_bits` under its former name.
    pub mul_b_bits: u32,
    /// Multiplier blocks of 25 x 18 bits that one product takes.
    pub dsp_per_pe: u32,
    /// Issue slots of a coefficient.
    pub coefficient_slots: u32,
    /// Where the rounding errors of coefficients are made to cancel.
    pub rounding: String,
    /// Pipeline: `short` or `deep`.
    pub pipeline: String,
}

/// Cells of the network for a family of devices.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Cells {
    /// The family.
    pub family: String,
    /// LUTs.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub lut: f64,
    /// Possible deviation of that number, to either side.
    pub lut_error: f64,
    /// Flip-flops.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub ff: f64,
    /// Possible deviation of that number, to either side.
    pub ff_error: f64,
    /// Multiplier blocks.
    pub dsp: u32,
    /// Block RAMs of 18 kbit.
    pub bram18: u32,
}

/// Size of a network.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Area {
    /// For its family.
    #[serde(flatten)]
    pub cells: Cells,
    /// `measured` or `estimated`.
    pub basis: String,
    /// PEs with a measured shape.
    pub measured_pes: u32,
    /// Breakdown by parts of the network.
    pub split: AreaSplit,
    /// For each family that networks were measured on.
    pub families: Vec<Cells>,
}

/// Breakdown of a network by parts.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct AreaSplit {
    /// PEs with their data memories and function tables; measured ones with their programs.
    pub pes: AreaPart,
    /// Of these the function tables.
    pub function_tables: AreaPart,
    /// Program ROMs, and memories of coefficients that nothing writes.
    pub programs: AreaPart,
    /// Inputs, ticks and outputs.
    pub inputs_outputs: LogicPart,
    /// Of these the inputs and ticks.
    pub inputs: LogicPart,
    /// Of these the outputs.
    pub outputs: LogicPart,
    /// The sequencer and what joins the sticky flags.
    pub sequencer: LogicPart,
    /// What reads and replaces states for a host, in PEs and beside them; in networks with ports for that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host: Option<HostPart>,
}

/// Parameters that a host may change at run time.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Parameters {
    /// Each with its value in the spec and its range.
    pub tunable: Vec<TunableParameter>,
    /// Values with which the design was judged beside those of the spec: formats hold them, and word-length, coefficient,
    /// method, input-hold and function errors are the worst of all.
    pub judged_at: Vec<String>,
}

/// A tunable parameter.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct TunableParameter {
    /// Name, with indices.
    pub name: String,
    /// Value in the spec.
    pub value: f64,
    /// Stated range.
    pub range: [f64; 2],
}

/// Whether outputs are ports or in memories, and why.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct OutputsIn {
    /// `ports` or `memory`.
    pub kind: String,
    /// Why.
    pub reason: String,
    /// Look-up tables of the whole network with ports, multiplier blocks and block RAMs counted in; null where it was not
    /// estimated.
    pub ports_lut: Option<f64>,
    /// The same with memories.
    pub memory_lut: Option<f64>,
}

/// LUTs, flip-flops and block RAMs of what reads and replaces states.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct HostPart {
    /// LUTs.
    pub lut: f64,
    /// Flip-flops.
    pub ff: f64,
    /// Block RAMs of 18 kbit.
    pub bram18: u32,
}

/// LUTs and block RAMs of a part.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct AreaPart {
    /// LUTs.
    pub lut: f64,
    /// Block RAMs of 18 kbit.
    pub bram18: u32,
}

/// LUTs and flip-flops of a part without memories.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct LogicPart {
    /// LUTs.
    pub lut: f64,
    /// Flip-flops.
    pub ff: f64,
    /// Block RAMs of 18 kbit, of outputs in memories.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bram18: Option<u32>,
}

/// The clock of a design.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Clock {
    /// Frequency.
    pub mhz: f64,
    /// `given`, `estimated` or `assumed`.
    pub basis: String,
    /// Possible deviation of an estimate; only for estimates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_mhz: Option<f64>,
}

/// A variable that comes close to the limit of its format.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Headroom {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: String,
    /// Bits between its largest magnitude and the limit.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub bits: f64,
    /// Its largest magnitude.
    pub largest: f64,
    /// The limit of its format.
    pub limit: f64,
}

/// What is kept of a quantity of the model.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Kept {
    /// Its name.
    pub name: String,
    /// `state`, `signal`, `algebraic`, `input` or `left out`.
    pub kind: String,
    /// Elements that are kept.
    pub kept: usize,
    /// Of these, algebraic ones that are computed within each equation that reads them.
    pub put_in_place: usize,
    /// Elements that are left out.
    pub left_out: usize,
    /// Why.
    pub because: String,
    /// The names from an element to its output.
    pub chain: Vec<String>,
}

/// Hardware features, and why they exist.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Features {
    /// Of the PEs.
    pub pe: Vec<Feature>,
    /// Fields of the control words.
    pub control_word: Vec<Field>,
    /// Program memories.
    pub program: Folds,
}

/// Sizes, and how many PEs have each.
pub type Histogram = BTreeMap<u32, usize>;

/// A feature of PEs.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Feature {
    /// Its name.
    pub feature: String,
    /// PEs with it.
    pub with: usize,
    /// PEs without.
    pub without: usize,
    /// Its sizes.
    pub sizes: Histogram,
    /// What needs it.
    pub because: String,
    /// PEs proven not to need it; only for saturation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub provable: Option<usize>,
}

/// A field of control words.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Field {
    /// Its name.
    pub field: String,
    /// PEs with it.
    pub with: usize,
    /// PEs without.
    pub without: usize,
    /// Its widths.
    pub bits: Histogram,
}

/// Program memories.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Folds {
    /// Rounds of a step.
    pub rounds: u32,
    /// Control words of a round.
    pub round_words: u32,
    /// Bits that PEs store for each word of a round.
    pub loop_bits: Histogram,
    /// Bits that they store for each word of a step.
    pub stream_bits: Histogram,
    /// Variants in place of those; only if there are some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variants: Option<Histogram>,
}

/// A rate of sampled blocks.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct SampleRate {
    /// Seconds between samples.
    pub period_s: f64,
    /// Steps between samples.
    pub steps: u64,
    /// States of this rate.
    pub states: usize,
}

/// Proof of ranges.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Ranges {
    /// Number of states by certainty of their ranges.
    pub states: Certainties,
    /// PEs that write proven words only.
    pub pes_without_saturation: usize,
    /// Bits by which formats were widened for the proof.
    pub widened_bits: i32,
    /// The word-length error without that, where it was measured.
    pub word_length_before: Option<f64>,
    /// Why there is no bound at all; the keys below are missing then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Whether the proof also holds after the span.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub for_ever: Option<bool>,
    /// The norm that bounds the effect of rounding.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub norm: Option<String>,
    /// The largest factor by which a step multiplies it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub growth: Option<f64>,
    /// Largest deviation of a value by rounding, relative to the largest word.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rounding: Option<f64>,
    /// Further bits by which formats would have to be widened.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing_bits: Option<i32>,
}

/// Number of states by how certain it is that they stay in range.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Certainties {
    /// Proven.
    pub proven: usize,
    /// Measured, with the margin of formats.
    pub probable: usize,
    /// Measured, with less.
    pub unknown: usize,
}

/// A table of a function.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct FunctionTable {
    /// The function, with `x` for its argument.
    pub name: String,
    /// Least argument.
    pub low: f64,
    /// Largest argument.
    pub high: f64,
    /// `uniform` or `octaves`.
    pub layout: String,
    /// Segments.
    pub segments: usize,
    /// Degree of the polynomials.
    pub degree: usize,
    /// Words of all columns.
    pub words: usize,
    /// Lookups per step.
    pub lookups: u64,
    /// Products of a lookup.
    #[serde(default)]
    pub products: u64,
    /// Functions that share it, which differ by constants; none if it is that of one function as it is.
    #[serde(default)]
    pub shared_by: usize,
    /// Up to eight of these functions.
    #[serde(default)]
    pub stands_for: Vec<ScaledFunction>,
    /// Equations that look it up, up to eight of them.
    #[serde(default)]
    pub equations: Vec<String>,
    /// Largest error of approximation.
    pub bound: f64,
    /// The same in units of the lowest bit of the result that a data port sees.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub bound_lsb: f64,
}

/// A function that a table stands for: `factor` times that of the table, of `slope` times the argument and `offset`, and
/// what is beside that.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct ScaledFunction {
    /// The function, with `x` for its argument.
    pub name: String,
    /// What the argument is multiplied by.
    pub slope: f64,
    /// What is added to it then.
    pub offset: f64,
    /// What the value is multiplied by.
    pub factor: f64,
    /// What the argument is multiplied by that is added to it then.
    pub beside_slope: f64,
    /// A number that is added to it.
    pub beside_offset: f64,
}
