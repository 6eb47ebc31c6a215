//! Options that mean the same in every command.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::explore::cluster::{Cluster, Scheduler};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser};
use pe_flow::accuracy::wanted::{Figure, Goals};
use pe_flow::failure::Failure;
use pe_flow::pipeline::{self, Design};
use pe_flow::settings::{MappingOptions, Settings, StageLoop};
use pe_flow::spec::{self, LoadedModel};
use pe_flow::stages::Stages;
use pe_flow::watch::{Listener, Stopwatch};
use pe_hls::rings;
use pe_hls::step::{Order, Scheme};
use pe_hls::two_slots;
use pe_ir::codes;
use pe_ir::model::{Interpolation, Model, Solver};
use pe_ir::text::Stage;
use pe_ir::word::{MultiplierPorts, Pipeline};
use pe_judge::conserved::Conserved;
use pe_judge::early::{self, Early};
use pe_judge::parse::{duration, multiplier};
use pe_judge::{Coefficients, Criteria, DesignPoint, FormChoice, JudgedBy, MOST_STORAGE, ProofMode};
use pe_target::clock::ClockSource;
use pe_target::devices::{self, DEVICES, Device};
use pe_verify::engines::Engine;

use crate::messages::MessageFormat;
use crate::progress;

/// What is computed: the model, and what it is judged over.
#[derive(Args, Clone, Debug)]
pub struct ModelArgs {
    /// Model specification; `-` reads it from standard input
    #[arg(required_unless_present = "from", conflicts_with = "from")]
    pub spec: Option<PathBuf>,
    /// The text of the spec, where a program has it; files that it names are read from the folder of `spec`.
    #[arg(skip)]
    pub text: Option<String>,
    /// Continues from the text of a compiler stage printed by `dump` instead of a spec: `compile` and `dump` from any
    /// stage, other commands from a model
    #[arg(long, value_name = "FILE", conflicts_with_all = ["set", "observe", "inputs", "units"], help_heading = "Model")]
    pub from: Option<PathBuf>,
    /// Time over which ranges and errors are judged; overrides the spec
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = duration, help_heading = "Model")]
    pub span: Option<f64>,
    /// Sets a constant, a parameter or an initial value, or one element (`R[3]=2`); may be repeated
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment, help_heading = "Model")]
    pub set: Vec<(String, f64)>,
    /// Outputs: scalars, elements, whole arrays; overrides the spec; may be repeated
    #[arg(long, value_name = "NAME[,NAME...]", help_heading = "Model")]
    pub observe: Vec<String>,
    /// Inputs between two samples, unless the spec says: hold or linear
    #[arg(long, value_name = "MODE", value_parser = between, help_heading = "Model")]
    pub inputs: Option<Interpolation>,

    /// How strictly units are checked: strict, warn or off; overrides the spec
    #[arg(long, value_name = "MODE", value_parser = units, help_heading = "Model")]
    pub units: Option<pe_frontend::Units>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Mapping")]
    pub seed: u64,
    /// Whether ranges are proven in addition to being measured
    #[arg(long, default_value = "ranges", value_parser = proof(), help_heading = "Numbers")]
    pub proof: ProofMode,
    /// Most bits by which formats may be widened to prove all ranges
    #[arg(long, value_name = "BITS", default_value_t = Criteria::WIDEN, value_parser = clap::value_parser!(i32).range(0..=16), help_heading = "Numbers")]
    pub widen: i32,
    /// What the runs of a design are compared by
    #[arg(long, value_name = "WHAT", default_value = "trajectories", value_parser = judged_by(), help_heading = "Numbers")]
    pub judge: JudgedBy,
    /// Turns a refusal into a warning; may be repeated
    #[arg(long, value_name = "CODE", value_parser = PossibleValuesParser::new(codes::PERMITTABLE), help_heading = "Diagnostics")]
    pub allow: Vec<String>,
    /// Format of errors and warnings on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    pub message_format: MessageFormat,
}

/// Quantities whose error is reported besides that of the states.
#[derive(Args, Clone, Debug, Default)]
pub struct ConservedArgs {
    /// Outputs that should stay constant, such as an energy: their drift is reported
    #[arg(long, value_name = "NAME[,NAME...]", value_delimiter = ',', help_heading = "Output")]
    pub conserved: Vec<String>,
}

impl ConservedArgs {
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
pub struct PointArgs {
    /// Numerical method; overrides the spec
    #[arg(long, value_parser = solver(), help_heading = "Model")]
    pub solver: Option<Solver>,
    /// Step, for example `1e-4` or `100us`; overrides the spec
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = duration, help_heading = "Model")]
    pub step: Option<f64>,
    /// Other steps for the beginning, each with the time at which it ends, for implicit solvers; overrides the spec
    #[arg(long, value_name = "T@UNTIL,...", allow_hyphen_values = true, value_parser = early::parse, help_heading = "Model")]
    pub early_steps: Option<Early>,
    /// Bits of a stored word, without its guard bits
    #[arg(long, value_name = "BITS", default_value_t = 32, value_parser = storage(), help_heading = "Numbers")]
    pub storage: u32,
    /// Multiplier: bits of the data port x bits of the coefficient port
    /// [default: 32x32; 35x35 for sampled feedback that may ring]
    #[arg(long, value_name = "AxB", value_parser = multiplier, help_heading = "Numbers")]
    pub multiplier: Option<MultiplierPorts>,
    /// Pipeline of the PEs: short, or deep for a faster clock on devices without registers in their blocks
    #[arg(long, default_value = "short", value_parser = pipeline(), help_heading = "Hardware")]
    pub pipeline: Pipeline,
    /// Issue slots per coefficient: with two, a coefficient port of 18 bits computes with about 35
    #[arg(long, default_value = "one-slot", value_parser = coefficients(), help_heading = "Numbers")]
    pub coefficients: Coefficients,
    /// Form of the step of a model that is affine in its states
    #[arg(long, default_value = "auto", value_parser = form(), help_heading = "Mapping")]
    pub form: FormChoice,
    /// Number of processing elements; all of them are used [default: one for every 200 words of a step, as far as more PEs make it shorter]
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = count, help_heading = "Mapping")]
    pub pes: Option<u32>,
}

/// What is asked of the mapping.
#[derive(Args, Clone, Debug)]
pub struct MappingArgs {
    /// Reads the PE of each equation from a file, in the form that `dump --stage mapping` prints
    #[arg(long, value_name = "FILE", help_heading = "Mapping")]
    pub mapping: Option<PathBuf>,
    /// Annealing budget in moves tried [default: grows with the number of equations]
    #[arg(long, value_name = "N", help_heading = "Mapping")]
    pub tries: Option<u64>,
    /// Most input ports a PE may have [default: 15, or more if no mapping does with 15]
    #[arg(long, value_name = "N", help_heading = "Mapping")]
    pub max_in_degree: Option<u32>,
    /// Does not use the pre-adder for operands with equal coefficients
    #[arg(long, help_heading = "Mapping")]
    pub no_pre_adder: bool,
    /// One round of control words for all stages of a step
    #[arg(long = "loop", value_name = "MODE", default_value = "auto", value_parser = stage_loop(), help_heading = "Mapping")]
    pub stage_loop: StageLoop,
    /// The order in which matrices are eliminated; by default that of a trial for linear systems, and the one that fills in
    /// least for implicit solvers
    #[arg(long, value_name = "ORDER", value_parser = order(), help_heading = "Mapping")]
    pub elimination: Option<Order>,
    /// How symmetric matrices of linear systems are eliminated; by default what a trial finds
    #[arg(long, value_name = "SCHEME", value_parser = scheme(), help_heading = "Mapping")]
    pub factors: Option<Scheme>,
}

/// All options that say what a design is, for programs that compile one beside the commands: the design point, how it
/// is mapped, the model. Commands put their own options between these.
#[derive(Clone, Debug, Parser)]
pub struct DesignArgs {
    /// The design point.
    #[command(flatten)]
    pub point: PointArgs,
    /// How it is mapped.
    #[command(flatten)]
    pub mapping: MappingArgs,
    /// The model.
    #[command(flatten)]
    pub model: ModelArgs,
}

impl DesignArgs {
    /// The model of the design point.
    ///
    /// # Errors
    /// Those of the spec, and steps that the model cannot be run with.
    pub fn load(&self) -> Result<LoadedModel, Failure> {
        self.model.load(&self.point.point(), &progress::listener(true, self.model.message_format))
    }

    /// Compiles that model.
    ///
    /// # Errors
    /// Those of the stages.
    pub fn design(&self, loaded: &LoadedModel, watch: &mut Stopwatch) -> Result<Design, Failure> {
        pipeline::design(loaded, &self.model.settings(&self.mapping), &self.point.point(), watch)
    }
}

/// The clock that speeds are told for.
#[derive(Args, Clone, Copy, Debug)]
pub struct ClockArgs {
    /// Clock for the speed [default: an estimate for some devices, else 150, marked as assumed]
    #[arg(long, value_name = "MHZ", allow_hyphen_values = true, value_parser = positive, help_heading = "Output")]
    pub clock: Option<f64>,
    /// Estimates the clock for this device, if networks were measured on its family; `compile` compares the size with
    /// it
    #[arg(long, value_name = "NAME", value_parser = device(), ignore_case = true, help_heading = "Output")]
    pub device: Option<&'static Device>,
}

/// What designs are wanted to be beside a total error.
#[derive(Args, Clone, Copy, Debug)]
pub struct GoalArgs {
    /// Keeps designs that are at least so many times as fast as real time at their clock
    #[arg(long, value_name = "X", allow_hyphen_values = true, value_parser = positive, help_heading = "Goals")]
    pub realtime: Option<f64>,
    /// Keeps designs that fit the device of `--device`
    #[arg(long, requires = "device", help_heading = "Goals")]
    pub fit: bool,
    /// What is to be small among the designs that keep all limits [default: time]
    #[arg(long, value_name = "FIGURE", value_parser = figure(), help_heading = "Goals")]
    pub minimise: Option<Figure>,
}

impl GoalArgs {
    /// The goals with a limit of the total error, if any was given.
    pub fn goals(&self, max_error: Option<f64>, clock: ClockArgs) -> Option<Goals> {
        let GoalArgs { realtime, fit, minimise } = *self;
        let given = max_error.is_some() || realtime.is_some() || fit || minimise.is_some();
        let fit = clock.device.filter(|_| fit);
        given.then_some(Goals { max_error, realtime, fit, minimise: minimise.unwrap_or_default() })
    }
}

/// What sweeps over points take beside the points.
#[derive(Args, Clone, Debug)]
pub struct SweepArgs {
    /// How points are mapped.
    #[command(flatten)]
    pub mapping: MappingArgs,
    /// Output folder; replaced if pe-synth wrote it [default: out/MODEL_COMMAND]
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    pub output: Option<PathBuf>,
    /// The clock.
    #[command(flatten)]
    pub clock: ClockArgs,
    /// Points compiled at the same time; the result does not depend on it [default: one per core]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), help_heading = "Output")]
    pub jobs: Option<u16>,
    /// Stops after this time with the best points that were found, the cheapest to compute first; the one option with
    /// which the result may differ from run to run
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = duration, help_heading = "Output")]
    pub within: Option<f64>,
    /// Folder of points that several sweeps share: what it has is not computed again
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    pub store: Option<PathBuf>,
    /// Computes the K-th of N parts of the points for the store alone, and writes no page; the same command without it puts
    /// the parts together
    #[arg(long, value_name = "K/N", value_parser = shard, requires = "store", help_heading = "Output")]
    pub shard: Option<(u32, u32)>,
    /// Computes the points as jobs of a cluster whose machines see the store and this folder
    #[arg(long, value_enum, value_name = "SCHEDULER", requires = "store", conflicts_with_all = ["shard", "within"], help_heading = "Output")]
    pub cluster: Option<Scheduler>,
    /// Jobs that `--cluster` submits at once
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=10_000), requires = "cluster", help_heading = "Output")]
    pub parts: u32,
}

impl SweepArgs {
    /// Where points are computed, if not here.
    pub fn cluster(&self) -> Option<Cluster> {
        let Scheduler::Slurm = self.cluster?;
        Some(Cluster { parts: self.parts, store: self.store.clone()? })
    }
}

/// Parses a part of several.
fn shard(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('/').and_then(|(part, parts)| Some((part.parse().ok()?, parts.parse().ok()?)));
    let (part, parts) = parsed.ok_or("expected K/N, such as 1/4")?;
    if (1..=parts).contains(&part) { Ok((part, parts)) } else { Err(format!("there are parts 1 to {parts}")) }
}

impl ClockArgs {
    /// Where the clock comes from.
    pub fn source(self) -> ClockSource {
        ClockSource { given: self.clock, device: self.device }
    }
}

impl ModelArgs {
    /// The model of a design point; warnings of the spec go to the listener.
    ///
    /// # Errors
    /// Those of the spec, and steps that the model cannot be run with.
    pub fn load(&self, point: &DesignPoint, told: &dyn Listener) -> Result<LoadedModel, Failure> {
        let mut loaded = self.read(told)?;
        point.apply(&mut loaded.model).map_err(Failure::Usage)?;
        Ok(loaded)
    }

    /// The same, or what the text of any stage has decided.
    ///
    /// # Errors
    /// Those of the text, and options that come too late.
    pub fn load_stages(
        &self,
        point: &DesignPoint,
        mapping: &MappingOptions,
        told: &dyn Listener,
    ) -> Result<LoadedModel, Failure> {
        let Some(path) = &self.from else { return self.load(point, told) };
        let mut loaded = spec::load_stages(path)?;
        let longer = self.span.is_some_and(|span| span > loaded.model.span);
        let conflict = loaded.stages.as_ref().and_then(|stages| conflict(stages, point, mapping, longer));
        if let Some(conflict) = conflict {
            return Err(Failure::Usage(conflict));
        }
        loaded.model.span = self.span.unwrap_or(loaded.model.span);
        point.apply(&mut loaded.model).map_err(Failure::Usage)?;
        Ok(loaded)
    }

    /// Reads and elaborates the spec; its warnings go to the listener. Solver and step are the spec's.
    ///
    /// # Errors
    /// Those of the spec.
    pub fn read(&self, told: &dyn Listener) -> Result<LoadedModel, Failure> {
        let overrides = pe_frontend::Overrides {
            set: self.set.clone(),
            observe: self.observe.clone(),
            units: self.units,
            inputs: self.inputs,
        };
        let (mut loaded, warnings) = match (&self.from, &self.spec, &self.text) {
            (Some(path), ..) => (model_of(path)?, Vec::new()),
            (None, Some(spec), Some(text)) => spec::load_text(spec, text, &overrides)?,
            (None, Some(spec), None) => spec::load(spec, &overrides)?,
            (None, None, _) => return Err(Failure::Usage("give a spec, or `--from FILE`".to_owned())),
        };
        told.warn(&warnings, &loaded.sources);
        loaded.model.span = self.span.unwrap_or(loaded.model.span);
        Ok(loaded)
    }

    /// A model that was loaded, with another penalty of its mechanism, which is the parameter `name`.
    pub fn with_penalty(
        &self,
        loaded: &LoadedModel,
        point: &DesignPoint,
        name: &str,
        penalty: f64,
    ) -> Option<LoadedModel> {
        if loaded.model.solver == Solver::Trapezoidal {
            let mut other = loaded.clone();
            Arc::make_mut(other.model.mechanism.as_mut()?).penalty = penalty;
            return Some(other);
        }
        let set = self.set.iter().cloned().chain([(name.to_owned(), penalty)]).collect();
        ModelArgs { set, ..self.clone() }.load(point, Stopwatch::silent().listener()).ok()
    }

    /// By what its designs are judged.
    pub fn criteria(&self) -> Criteria {
        Criteria { by: self.judge, proof: self.proof, widen: self.widen, allow: self.allow.clone() }
    }

    /// What all its designs have in common.
    pub fn settings(&self, mapping: &MappingArgs) -> Settings {
        Settings { criteria: self.criteria(), mapping: mapping.options(), seed: self.seed }
    }
}

/// An option that asks for what a text of stages has decided already, in words. `span` says whether a longer span is
/// asked for than the model of the text has.
fn conflict(stages: &Stages, point: &DesignPoint, mapping: &MappingOptions, span: bool) -> Option<String> {
    let decided = |option: &str, stage: Stage| {
        Some(format!("`{option}` comes too late: the text continues to `{}`, which has decided it", stage.name()))
    };
    if let Some(graph) = &stages.graph {
        let asked = [
            // Tables are those of the arguments and signals over the span.
            (span, "--span"),
            (mapping.no_pre_adder && graph.pre_adder, "--no-pre-adder"),
            (point.solver.is_some(), "--solver"),
            (point.step.is_some(), "--step"),
            (point.early_steps.is_some(), "--early-steps"),
            (point.form != FormChoice::Auto, "--form"),
            (mapping.elimination.is_some(), "--elimination"),
            (mapping.factors.is_some(), "--factors"),
        ];
        if let Some((_, option)) = asked.into_iter().find(|(asked, _)| *asked) {
            return decided(option, Stage::Step);
        }
    }
    let fixed = stages.fixed.as_ref()?;
    let (format, default) = (&fixed.format, DesignPoint::default());
    let ports = format.multiplier();
    let one_slot = stages.graph.as_ref().is_some_and(|graph| !two_slots::used(graph));
    let has_rounds = stages.program.as_ref().is_some_and(|program| program.rounds > 1);
    if has_rounds && mapping.stage_loop == StageLoop::Off {
        return decided("--loop", Stage::Program);
    }
    let asked = [
        (point.coefficients != default.coefficients && one_slot, "--coefficients"),
        (point.storage != default.storage && point.storage != format.storage_bits, "--storage"),
        (point.multiplier.is_some_and(|asked| asked != ports), "--multiplier"),
        (point.pipeline != default.pipeline && point.pipeline != format.pipeline, "--pipeline"),
    ];
    asked.into_iter().find(|(asked, _)| *asked).and_then(|(_, option)| decided(option, Stage::Fixed))
}

/// The model of a text that goes on to nothing else.
fn model_of(path: &Path) -> Result<LoadedModel, Failure> {
    let loaded = spec::load_stages(path)?;
    match loaded.stages.as_ref().map(|stages| stages.last) {
        Some(Stage::Model) | None => Ok(LoadedModel { stages: None, ..loaded }),
        Some(last) => Err(Failure::Usage(format!(
            "{} continues to `{}`; only `compile` and `dump` accept that, other commands need a model",
            path.display(),
            last.name()
        ))),
    }
}

impl PointArgs {
    /// The point.
    pub fn point(&self) -> DesignPoint {
        let PointArgs { solver, step, early_steps, storage, multiplier, pipeline, coefficients, form, pes } = *self;
        DesignPoint { solver, step, early_steps, storage, multiplier, pipeline, coefficients, form, pes }
    }
}

impl MappingArgs {
    /// What is asked of the mapping.
    pub fn options(&self) -> MappingOptions {
        let MappingArgs { mapping, tries, max_in_degree, no_pre_adder, stage_loop, elimination, factors } =
            self.clone();
        let rings = rings::Choice::default();
        MappingOptions { mapping, tries, max_in_degree, no_pre_adder, stage_loop, elimination, factors, rings }
    }
}

/// A choice of the command line: its name, and a line of help if it has one.
fn choice<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
    help: Option<fn(T) -> &'static str>,
) -> impl TypedValueParser<Value = T> {
    let value = move |one: &T| match help {
        Some(help) => PossibleValue::new(name(*one)).help(help(*one)),
        None => PossibleValue::new(name(*one)),
    };
    let known = move |given: String| *all.iter().find(|one| name(**one) == given).expect("a possible value");
    PossibleValuesParser::new(all.iter().map(value)).map(known)
}

/// Parses the name of a numerical method.
pub fn solver() -> impl TypedValueParser<Value = Solver> {
    choice(&Solver::ALL, Solver::name, Some(Solver::title))
}

/// Parses the name of a pipeline.
pub fn pipeline() -> impl TypedValueParser<Value = Pipeline> {
    choice(&Pipeline::ALL, Pipeline::name, None)
}

/// Parses the form of a step.
pub fn form() -> impl TypedValueParser<Value = FormChoice> {
    choice(&FormChoice::ALL, FormChoice::name, Some(FormChoice::title))
}

/// Parses how coefficients are rounded.
pub fn coefficients() -> impl TypedValueParser<Value = Coefficients> {
    choice(&Coefficients::ALL, Coefficients::name, Some(Coefficients::title))
}

/// Parses the name of an engine.
pub fn engine() -> impl TypedValueParser<Value = Engine> {
    choice(&Engine::ALL, Engine::option, Some(Engine::title))
}

fn proof() -> impl TypedValueParser<Value = ProofMode> {
    choice(&ProofMode::ALL, ProofMode::name, Some(ProofMode::title))
}

fn judged_by() -> impl TypedValueParser<Value = JudgedBy> {
    choice(&JudgedBy::ALL, JudgedBy::name, Some(JudgedBy::title))
}

fn order() -> impl TypedValueParser<Value = Order> {
    choice(&Order::ALL, Order::name, Some(Order::title))
}

fn scheme() -> impl TypedValueParser<Value = Scheme> {
    choice(&Scheme::ALL, Scheme::name, Some(Scheme::title))
}

fn stage_loop() -> impl TypedValueParser<Value = StageLoop> {
    choice(&StageLoop::ALL, StageLoop::name, Some(StageLoop::title))
}

/// Parses the figure that is to be small.
fn figure() -> impl TypedValueParser<Value = Figure> {
    choice(&Figure::ALL, Figure::name, Some(Figure::title))
}

/// Parses the name of a device.
pub fn device() -> impl TypedValueParser<Value = &'static Device> {
    let values = DEVICES.iter().map(|device| PossibleValue::new(device.name).help(device.vendor));
    PossibleValuesParser::new(values).map(|name| devices::named(&name).expect("a possible value"))
}

/// Parses bits of a stored word.
pub fn storage() -> impl TypedValueParser<Value = u32> {
    clap::value_parser!(u32).range(12..=i64::from(MOST_STORAGE))
}

/// Parses what inputs are between two samples.
fn between(text: &str) -> Result<Interpolation, String> {
    match text {
        "hold" => Ok(Interpolation::Hold),
        "linear" => Ok(Interpolation::Linear),
        _ => Err("expected hold or linear".to_owned()),
    }
}

/// Parses a way to check units.
fn units(text: &str) -> Result<pe_frontend::Units, String> {
    let found = pe_frontend::Units::ALL.into_iter().find(|(word, _)| *word == text);
    found.map(|(_, units)| units).ok_or_else(|| "expected strict, warn or off".to_owned())
}

fn assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let value: f64 = value.trim().parse().map_err(|_| format!("`{value}` is not a number"))?;
    if !value.is_finite() {
        return Err(format!("`{name}` must be finite"));
    }
    Ok((name.trim().to_owned(), value))
}

/// A number of things, at least one.
///
/// # Errors
/// What it has to be.
pub fn count(text: &str) -> Result<u32, String> {
    let count = text.parse().ok().filter(|count| *count > 0);
    count.ok_or_else(|| "expected a count: a whole number from 1 on".to_owned())
}

/// Parses a positive number.
pub fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|number: &f64| number.is_finite() && *number > 0.0)
        .ok_or("expected a positive number".into())
}
