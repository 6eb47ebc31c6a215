//! The keys `error`, `stability`, `device` and `choice` of the report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::{Unbounded, nullable, present};

/// How wrong a design is: parts of the error relative to the scales of states, and the total where it is known.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Errors {
    /// State with the largest word-length error.
    pub worst_state: String,
    /// Fixed point against the reference solution; null where that is not known.
    pub total: Option<f64>,
    /// Why the total error is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total_reason: Option<String>,
    /// Of the method.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub method: f64,
    /// Of the word length.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub word_length: f64,
    /// Of rounded coefficients.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub coefficient: f64,
    /// Of the word length at the end of the span.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub word_length_at_end: f64,
    /// Of rounded coefficients at the end of the span.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub coefficient_at_end: f64,
    /// Of tables; null without functions.
    pub function: Option<f64>,
    /// Why there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub function_reason: Option<String>,
    /// Of inputs that are held or interpolated.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub input_hold: f64,
    /// Steps of the span.
    pub steps: u64,
    /// Evenly spread times of which pictures and norms are made.
    pub samples: usize,
    /// Word-length errors of the first outputs.
    pub outputs: Vec<OutputError>,
    /// What comes with a total error.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub of_total: Option<Box<OfTotal>>,
    /// `total` relative to the largest magnitude up to the step in question; only where that is much more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total_to_date: Option<Unbounded>,
    /// `method` relative to the largest magnitude up to the step in question; only where that is much more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub method_to_date: Option<Unbounded>,
    /// `word_length` relative to the largest magnitude up to the step in question; only where that is much more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub word_length_to_date: Option<Unbounded>,
    /// `coefficient` relative to the largest magnitude up to the step in question; only where that is much more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coefficient_to_date: Option<Unbounded>,
    /// `function` relative to the largest magnitude up to the step in question; only where that is much more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub function_to_date: Option<Unbounded>,
    /// `input_hold` relative to the largest magnitude up to the step in question; only where that is much more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_hold_to_date: Option<Unbounded>,
}

/// Word-length error of an output.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct OutputError {
    /// The output.
    pub name: String,
    /// Largest difference over largest magnitude.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub word_length: f64,
}

/// What comes with a total error.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct OfTotal {
    /// State with the largest total error.
    pub total_worst_state: String,
    /// Part of the total error that was added for steps between the times of the reference.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub total_between_times: f64,
    /// Times at which the reference was compared.
    pub total_times: usize,
    /// At the end of the span.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub total_at_end: f64,
    /// State with the largest error there.
    pub total_at_end_worst_state: String,
    /// L2 norm of the deviation over that of the solution.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub total_l2: f64,
    /// Significant correct digits at the end.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub digits_at_end: f64,
    /// The run in double precision against the reference.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub double: f64,
    /// The same at the end of the span.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub double_at_end: f64,
    /// First sample at which a state is wrong by a tenth of its scale, in seconds.
    pub diverged_s: Option<f64>,
    /// The period of the first output that oscillates.
    pub period: Option<Period>,
    /// Drift of conserved quantities.
    pub conserved: Vec<Drift>,
    /// Tolerance of the reference solution.
    pub reference_tolerance: f64,
    /// How much it moves with a larger tolerance.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub reference_uncertainty: f64,
    /// The method that found it.
    pub reference_method: String,
    /// Another method, if that found a solution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_second_method: Option<String>,
    /// Largest difference of the two solutions.
    pub reference_agreement: Option<f64>,
    /// Why there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_agreement_reason: Option<String>,
    /// First sample at which they are apart, in seconds.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub reference_apart_s: Option<Option<f64>>,
}

/// The period of an oscillation.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Period {
    /// The state that oscillates.
    pub state: String,
    /// Mean period of the solution.
    pub seconds: f64,
    /// Relative error of the run's, `inf` if it does not oscillate.
    pub error: Unbounded,
}

/// Drift of a conserved quantity.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Drift {
    /// The quantity.
    pub name: String,
    /// Largest deviation from its initial value, relative to it.
    pub drift: Unbounded,
}

/// The check of the step.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Stability {
    /// `fine`, `warning` or `refused`.
    pub verdict: String,
    /// Codes of the findings.
    pub codes: Vec<String>,
    /// Largest stable step by eigenvalues, in seconds.
    pub predicted_step_s: Option<f64>,
    /// The part of it that is safe, in seconds.
    pub go_step_s: Option<f64>,
    /// What the prediction rests on.
    pub basis: String,
    /// Times at which the model was linearised.
    pub points: usize,
    /// `run` or `reference`.
    pub trajectory: String,
    /// The eigenvalue behind the limit.
    pub limited_by: Option<LimitedBy>,
    /// Largest step that trials found stable, in seconds.
    pub found_step_s: Option<f64>,
    /// The next one, which was not.
    pub found_unstable_step_s: Option<f64>,
    /// Time over which trials ran, in seconds.
    pub found_over_s: Option<f64>,
    /// Bound of all eigenvalues in 1/s.
    pub eigenvalue_bound: Option<f64>,
    /// Largest real part of those that decay, in 1/s.
    pub fastest_decay: Option<f64>,
    /// Fastest decay times span.
    pub stiffness: Option<f64>,
    /// Natural logarithm of what the method makes of undamped modes over the span.
    pub growth_log: Option<f64>,
    /// Largest eigenvalue of one step.
    pub amplification: Option<Amplification>,
    /// The smallest pivot.
    pub smallest_pivot: Option<CheckedPivot>,
    /// States that lose increments.
    pub dead_bands: Vec<DeadBand>,
    /// How errors grow.
    pub chaos: Option<Chaos>,
    /// Step for the accuracy asked for, in seconds; `check` only.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub accuracy_step_s: Option<Option<f64>>,
    /// Its method error.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub accuracy_error: Option<Option<f64>>,
    /// Whether it was tried.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accuracy_tried: Option<bool>,
    /// The step that accuracy alone would allow, over the stable one.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub stiffness_ratio: Option<Option<f64>>,
    /// How sampled parts come to rest; only of models with some.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub rest: Option<Option<Rest>>,
    /// Why zero is not to be expected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest_reason: Option<String>,
    /// Why there is no predicted step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predicted_step_reason: Option<String>,
    /// Why there is no pivot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smallest_pivot_reason: Option<String>,
    /// Why there is no amplification.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amplification_reason: Option<String>,
    /// Why there is no chaos.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chaos_reason: Option<String>,
    /// Why there is no step by trial.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found_step_reason: Option<String>,
}

/// The eigenvalue that limits the step.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct LimitedBy {
    /// The state that grows.
    pub state: String,
    /// When, in seconds.
    pub time_s: f64,
    /// Real and imaginary part in 1/s.
    pub eigenvalue: [Option<f64>; 2],
}

/// Largest eigenvalue of one step.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Amplification {
    /// With exact coefficients.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub exact: f64,
    /// With rounded ones.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>")]
    pub rounded: f64,
    /// Steps until samples repeat.
    pub steps: u64,
    /// What it rests on.
    pub basis: String,
}

/// The smallest pivot, to a few digits.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct CheckedPivot {
    /// The state.
    pub state: String,
    /// Its magnitude.
    pub magnitude: Option<f64>,
}

/// A state that loses increments.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct DeadBand {
    /// The state.
    pub state: String,
    /// When, in seconds.
    pub time_s: f64,
    /// Part of the run below one LSB.
    pub part: Option<f64>,
    /// Relative loss.
    pub loss: Option<f64>,
}

/// How errors of a chaotic model grow.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Chaos {
    /// Rate in 1/s.
    pub rate: Option<f64>,
    /// Time at which one LSB is felt, in seconds.
    pub divergence_s: Option<f64>,
}

/// Sampled states long after all inputs are zero.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Rest {
    /// Largest magnitude in LSB.
    pub lsb: i64,
    /// Steps after which words repeat.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub period_steps: Option<Option<u64>>,
    /// The state.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state: Option<String>,
}

/// A design held against a device.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct DeviceFit {
    /// Part.
    pub name: String,
    /// Maker.
    pub vendor: String,
    /// Data sheet.
    pub source: String,
    /// Whether there is enough of everything.
    pub fits: bool,
    /// Resources of which there is not.
    pub exceeded: Vec<String>,
    /// PEs of the mean size that there is room for.
    pub fitting_pes: u64,
    /// Family.
    pub family: String,
    /// Inputs of its LUTs.
    pub lut_inputs: u32,
    /// LUTs.
    pub lut: Use,
    /// Flip-flops.
    pub ff: Use,
    /// Multiplier blocks.
    pub dsp: Use,
    /// Block RAMs of 18 kbit.
    pub bram18: Use,
}

/// What a design takes of a resource.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Use {
    /// Needed.
    pub used: u64,
    /// There.
    pub available: u64,
    /// Quotient.
    pub share: f64,
}

/// How `--max-error` chose a design.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Chosen {
    /// Largest total error.
    pub max_error: f64,
    /// Simulated time over run time that was asked for, at least.
    pub realtime: Option<f64>,
    /// The device that had to be large enough.
    pub fits: Option<String>,
    /// The figure that was to be small.
    pub minimise: String,
    /// The limit that costs the most.
    pub binding: Option<String>,
    /// Points that would be better and miss a limit, and what they would take.
    pub misses: Vec<String>,
    /// Points that were tried.
    pub tried: usize,
    /// Points that were right enough.
    pub met: usize,
    /// Points before the one that was taken whose designs missed the goal.
    pub unconfirmed: usize,
    /// The next ones by run time.
    pub runners_up: Vec<RunnerUp>,
}

/// A point that was not chosen.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct RunnerUp {
    /// Numerical method.
    pub solver: Option<String>,
    /// Step in seconds.
    pub step_s: Option<f64>,
    /// Steps for the beginning, as the option has them.
    pub early_steps: Option<String>,
    /// Bits of a stored word.
    pub storage_bits: u32,
    /// Multiplier.
    pub multiplier: String,
    /// Products of a coefficient.
    pub coefficients: String,
    /// Total error.
    pub total_error: Option<f64>,
    /// Run time for the span, in seconds.
    pub seconds: Option<f64>,
    /// Size.
    pub equivalent_lut: Option<f64>,
}

impl Errors {
    /// Why there is no total error where nobody asked for it.
    pub const NOT_ASKED: &str = "no reference solution was asked for with --reference";
}
