//! Options that mean the same in every command.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use pe_hls::step::StepOptions;
use pe_ir::codes;
use pe_ir::graph::StageForm;
use pe_ir::model::{Model, Solver, step_count_problem};
use pe_ir::source::{Diagnostic, Sources};
use pe_ir::word::{Pipeline, WordFormat};
use pe_target::devices::{self, DEVICES, Device};

use crate::conserved::Conserved;
use crate::early::{self, Early};
use crate::failure::{Failure, MessageFormat};
use crate::feedback::{Feedback, VISIBLE_BITS};
use crate::files::{self, ModelFolder};
use crate::pipeline::{MappingOptions, StageLoop};

/// What is computed: the model, and what it is judged over.
#[derive(Args, Clone, Debug)]
pub struct ModelOptions {
    /// Model specification
    pub spec: PathBuf,
    /// Time over which ranges and errors are judged, in place of the spec's
    #[arg(long, value_name = "T", value_parser = duration, help_heading = "Model")]
    pub span: Option<f64>,
    /// Sets a constant, a parameter or an initial value, or one element (`R[3]=2`); may be repeated
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment, help_heading = "Model")]
    pub set: Vec<(String, f64)>,
    /// Outputs in place of the spec's: scalars, elements, whole arrays; may be repeated
    #[arg(long, value_name = "NAME[,NAME...]", help_heading = "Model")]
    pub observe: Vec<String>,
    /// What inputs are between two samples if the spec does not say: hold or linear
    #[arg(long, value_name = "MODE", value_parser = between)]
    pub inputs: Option<pe_ir::model::Interpolation>,

    /// How strictly units are checked, in place of the spec's: strict, warn or off
    #[arg(long, value_name = "MODE", value_parser = units)]
    pub units: Option<pe_frontend::Units>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Mapping")]
    pub seed: u64,
    /// Whether ranges are proven beside being measured
    #[arg(long, value_enum, default_value_t, help_heading = "Numbers")]
    pub proof: ProofMode,
    /// Bits by which formats may become wider where that proves all ranges
    #[arg(long, value_name = "BITS", default_value_t = 6, value_parser = clap::value_parser!(i32).range(0..=16), help_heading = "Numbers")]
    pub widen: i32,
    /// Lets a refusal through as a warning; may be repeated
    #[arg(long, value_name = "CODE", value_parser = PossibleValuesParser::new(codes::PERMITTABLE), help_heading = "Diagnostics")]
    pub allow: Vec<String>,
    /// Form of errors and warnings on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    pub message_format: MessageFormat,
}

/// What is proven about a design.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ProofMode {
    /// Nothing: every PE saturates
    Off,
    /// That values stay in range; PEs of which that is proven do not saturate
    #[default]
    Ranges,
}

/// What the total error is asked about beside the states.
#[derive(Args, Clone, Debug, Default)]
pub struct ConservedOptions {
    /// Outputs that shall stay constant, such as an energy: their drift is reported
    #[arg(long, value_name = "NAME[,NAME...]", value_delimiter = ',', help_heading = "Output")]
    pub conserved: Vec<String>,
}

impl ConservedOptions {
    /// The quantities of a model.
    ///
    /// # Errors
    /// If a name is no output.
    pub fn of(&self, model: &Model) -> Result<Vec<Conserved>, Failure> {
        Conserved::named(model, &self.conserved).map_err(|name| {
            Failure::Usage(format!("`--conserved {name}`: `{name}` is no output of the model; name it in `output`"))
        })
    }
}

/// How it is computed: a point of the design space.
#[derive(Args, Clone, Copy, Debug, PartialEq)]
pub struct DesignPoint {
    /// Numerical method, in place of the spec's
    #[arg(long, value_parser = solver(), help_heading = "Model")]
    pub solver: Option<Solver>,
    /// Step, in place of the spec's, for example `1e-4` or `100us`
    #[arg(long, value_name = "T", value_parser = duration, help_heading = "Model")]
    pub step: Option<f64>,
    /// Other steps for the beginning, in place of the spec's, each with the time until which it is taken: implicit solvers
    #[arg(long, value_name = "T@UNTIL,...", value_parser = early::parse, help_heading = "Model")]
    pub early_steps: Option<Early>,
    /// Bits of a stored word, without its guard bits
    #[arg(long, value_name = "BITS", default_value_t = 32, value_parser = storage(), help_heading = "Numbers")]
    pub storage: u32,
    /// Multiplier: bits of its data port x bits of its coefficient port
    /// [default: 32x32; 35x35 for sampled feedback that may ring]
    #[arg(long, value_name = "AxB", value_parser = multiplier, help_heading = "Numbers")]
    pub multiplier: Option<(u32, u32)>,
    /// Registers that an operation passes: few, or more for a faster clock on devices without registers in their blocks
    #[arg(long, default_value = "short", value_parser = pipeline(), help_heading = "Hardware")]
    pub pipeline: Pipeline,
    /// Products that a coefficient takes: with two, a port of 18 bits computes with about 35
    #[arg(long, value_enum, default_value_t, help_heading = "Numbers")]
    pub coefficients: Coefficients,
    /// Form of the step of a model that is affine in its states
    #[arg(long, value_enum, default_value_t, help_heading = "Mapping")]
    pub form: FormChoice,
    /// Number of processing elements; all of them are used [default: one for every 200 issue slots]
    #[arg(long, value_name = "N", help_heading = "Mapping")]
    pub pes: Option<u32>,
}

/// How coefficients are rounded, as the command line has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Coefficients {
    /// A product each, rounded to the coefficient port
    #[default]
    OneSlot,
    /// A second product with what the port does not see, where that can be seen in the result
    TwoSlot,
    /// Two slots if they at least halve the word-length error
    Auto,
}

impl Coefficients {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Coefficients::OneSlot => "one-slot",
            Coefficients::TwoSlot => "two-slot",
            Coefficients::Auto => "auto",
        }
    }
}

/// The form of a step, as the command line has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum FormChoice {
    /// The one that is estimated to take the fewest cycles
    #[default]
    Auto,
    /// Increments that are summed up beside the state
    Increments,
    /// Increments of one scale in a running sum: stages that are the same sums
    Sums,
    /// Horner's rule: as many stages as the method has
    Horner,
    /// Real factors of the method's polynomial: half the stages, denser equations
    Factors,
    /// The method's polynomial as one matrix: one stage, the densest equations
    Full,
}

impl FormChoice {
    /// The form that was chosen, if any.
    pub fn form(self) -> Option<StageForm> {
        match self {
            FormChoice::Auto => None,
            FormChoice::Increments => Some(StageForm::Increments),
            FormChoice::Sums => Some(StageForm::Sums),
            FormChoice::Horner => Some(StageForm::Horner),
            FormChoice::Factors => Some(StageForm::Factors),
            FormChoice::Full => Some(StageForm::Full),
        }
    }

    /// The choice of a form among others; `Auto` for forms that are the only one of a model.
    pub fn of(form: StageForm) -> FormChoice {
        FormChoice::value_variants().iter().copied().find(|choice| choice.form() == Some(form)).unwrap_or_default()
    }
}

/// A model with the texts it comes from.
#[derive(Clone)]
pub struct LoadedModel {
    /// The model, with the command line's span, and solver and step of a design point.
    pub model: Model,
    /// The spec and the files it names.
    pub sources: Sources,
}

impl ModelOptions {
    /// The model of a design point.
    pub fn load(&self, point: &DesignPoint) -> Result<LoadedModel, Failure> {
        let mut loaded = self.read()?;
        point.apply(&mut loaded.model)?;
        Ok(loaded)
    }

    /// Reads and elaborates the spec; prints its warnings. Solver and step are the spec's.
    pub fn read(&self) -> Result<LoadedModel, Failure> {
        let mut sources = files::main_file(&self.spec)?;
        let loader = ModelFolder::of(&self.spec);
        let overrides = pe_frontend::Overrides {
            set: self.set.clone(),
            observe: self.observe.clone(),
            units: self.units,
            inputs: self.inputs,
        };
        let (mut model, warnings) = match pe_frontend::compile(&mut sources, &loader, &overrides) {
            Ok(result) => result,
            Err(findings) => return Err(Failure::Spec(findings, sources)),
        };
        crate::failure::print_findings(&warnings, &sources, self.message_format);
        model.span = self.span.unwrap_or(model.span);
        Ok(LoadedModel { model: pe_hls::lift::lift(model), sources })
    }

    /// Turns allowed errors into warnings; what remains is a failure.
    pub fn permit(&self, findings: Vec<Diagnostic>) -> Result<Vec<Diagnostic>, Vec<Diagnostic>> {
        if findings.iter().all(|finding| self.allow.iter().any(|code| code == finding.code)) {
            Ok(findings.into_iter().map(Diagnostic::into_warning).collect())
        } else {
            Err(findings)
        }
    }
}

impl DesignPoint {
    /// Puts solver and step in place of the model's.
    ///
    /// # Errors
    /// If the span is shorter than the step, or takes more steps than can be run.
    pub fn apply(&self, model: &mut Model) -> Result<(), Failure> {
        model.solver = self.solver.unwrap_or(model.solver);
        model.set_step(self.step.unwrap_or(model.step));
        if let Some(early) = &self.early_steps {
            early.apply(model)?;
        }
        step_count_problem(model.step, model.span).map_or(Ok(()), |problem| Err(Failure::Usage(problem)))
    }

    /// What is asked of the form of the step.
    pub fn step_options(&self, mapping: &MappingOptions) -> StepOptions {
        let MappingOptions { max_in_degree, no_pre_adder, stage_loop, .. } = *mapping;
        StepOptions {
            form: self.form.form(),
            pes: self.pes,
            max_in_degree,
            pre_adder: !no_pre_adder,
            sums: self.coefficients == Coefficients::OneSlot,
            rounds: stage_loop != StageLoop::Off,
        }
    }

    /// Bits of the multiplier's ports.
    pub fn ports(&self, model: &Model) -> (u32, u32) {
        self.multiplier.unwrap_or_else(|| default_ports(model, self.storage))
    }

    /// Word widths.
    pub fn format(&self, model: &Model) -> Result<WordFormat, Failure> {
        let (data_bits, coefficient_bits) = self.ports(model);
        let format = WordFormat::new(self.storage, data_bits, coefficient_bits).with_pipeline(self.pipeline);
        let widest = data_bits.max(coefficient_bits);
        if widest > format.word_bits() {
            let message = format!(
                "a {data_bits}x{coefficient_bits} multiplier reads more bits than a word of {} + {} has",
                self.storage, format.guard_bits
            );
            return Err(Failure::Usage(message));
        }
        Ok(Feedback::of(model).map_or(format, |feedback| format.with_hidden(feedback.hidden_bits)))
    }
}

/// Bits of both ports of the multiplier unless the user says otherwise, and the most that four blocks make.
const PORT_BITS: u32 = 32;
const WIDEST_PORT: u32 = 35;

/// Ports of the multiplier unless the user says otherwise: where sampled states may ring they see some bits below those that
/// are stored.
pub fn default_ports(model: &Model, storage: u32) -> (u32, u32) {
    let rings = Feedback::of(model).is_some_and(|feedback| feedback.rings);
    let bits = if rings { (storage + VISIBLE_BITS).clamp(PORT_BITS, WIDEST_PORT) } else { PORT_BITS };
    (bits, bits)
}

/// Parses the name of a numerical method.
pub fn solver() -> impl TypedValueParser<Value = Solver> {
    let values = Solver::ALL.map(|solver| PossibleValue::new(solver.name()).help(solver.title()));
    let known = |name: String| Solver::ALL.into_iter().find(|solver| solver.name() == name).expect("a possible value");
    PossibleValuesParser::new(values).map(known)
}

/// Parses the name of a pipeline.
pub fn pipeline() -> impl TypedValueParser<Value = Pipeline> {
    let values = Pipeline::ALL.map(|pipeline| PossibleValue::new(pipeline.name()));
    let known = |name: String| Pipeline::ALL.into_iter().find(|pipeline| pipeline.name() == name);
    PossibleValuesParser::new(values).map(move |name| known(name).expect("a possible value"))
}

/// Parses the name of a device.
pub fn device() -> impl TypedValueParser<Value = &'static Device> {
    let values = DEVICES.iter().map(|device| PossibleValue::new(device.name).help(device.vendor));
    PossibleValuesParser::new(values).map(|name| devices::named(&name).expect("a possible value"))
}

/// Bits of a stored word, at most.
pub const MOST_STORAGE: u32 = 48;

/// Parses bits of a stored word.
pub fn storage() -> impl TypedValueParser<Value = u32> {
    clap::value_parser!(u32).range(12..=i64::from(MOST_STORAGE))
}

/// Parses what inputs are between two samples.
fn between(text: &str) -> Result<pe_ir::model::Interpolation, String> {
    match text {
        "hold" => Ok(pe_ir::model::Interpolation::Hold),
        "linear" => Ok(pe_ir::model::Interpolation::Linear),
        _ => Err("expected hold or linear".to_owned()),
    }
}

/// Parses a way to check units.
fn units(text: &str) -> Result<pe_frontend::Units, String> {
    let found = pe_frontend::Units::ALL.into_iter().find(|(word, _)| *word == text);
    found.map(|(_, units)| units).ok_or_else(|| "expected strict, warn or off".to_owned())
}

/// Parses a time: a number with an optional unit.
pub fn duration(text: &str) -> Result<f64, String> {
    let text = text.trim();
    // Divisors, for a quotient of two exact numbers is the nearest one: 100us is 1e-4.
    let units = [("ns", 1e9), ("us", 1e6), ("ms", 1e3), ("s", 1.0)];
    let (number, divisor) = units
        .iter()
        .find_map(|(unit, divisor)| text.strip_suffix(unit).map(|number| (number.trim_end(), *divisor)))
        .unwrap_or((text, 1.0));
    let quotient = |(a, b): (&str, &str)| Some(a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?);
    let value = number.split_once('/').map_or_else(|| number.parse().ok(), quotient);
    match value.map(|value| value / divisor) {
        Some(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a positive time such as 1e-4, 100us or 1/44100".into()),
    }
}

/// Parses the widths of a multiplier's ports.
pub fn multiplier(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('x').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    match parsed {
        Some((data, coefficient)) if (9..=35).contains(&data) && (9..=35).contains(&coefficient) => {
            Ok((data, coefficient))
        }
        _ => Err("expected AxB with 9 to 35 bits each, for example 25x18".into()),
    }
}

fn assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let value: f64 = value.trim().parse().map_err(|_| format!("`{value}` is not a number"))?;
    if !value.is_finite() {
        return Err(format!("`{name}` must be finite"));
    }
    Ok((name.trim().to_owned(), value))
}
