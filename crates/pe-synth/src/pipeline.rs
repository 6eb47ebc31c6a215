//! The way from model to program, stage after stage.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use pe_hls::assemble::TooLarge;
use pe_hls::mapping::{self, MapError, WireLength};
use pe_hls::pairs::{self, Paired};
use pe_hls::rounds::Rounds;
use pe_hls::schedule::Bound;
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::mapping::{Mapping, MappingCost};
use pe_ir::model::Model;
use pe_ir::program::Program;
use pe_ir::schedule::Schedule;
use pe_ir::source::Diagnostic;
use pe_ir::verify;
use pe_ir::word::{Latency, WordFormat};

use crate::contest;
use crate::entrants::{self, Entrants};
use crate::failure::{Failure, print_findings};
use crate::mapping_file::MappingFile;
use crate::options::{Coefficients, DesignPoint, LoadedModel, ModelOptions, ProofMode};
use crate::proof;
use crate::runs::{self, Judged};
use crate::slots;
use crate::tables;
use pe_target::area::{self, Family};

/// Issue slots per PE that the default number of PEs aims at: small designs stay small, large ones fit a large device.
const DEFAULT_SLOTS_PER_PE: u64 = 200;

/// Stages that take as long as the span is.
const RUNS: [&str; 7] = ["choose", "functions", "slots", "runs", "ranges", "stability", "reference"];

/// Time between two pictures of the spinner of a stage.
const SPINNER_TICK: Duration = Duration::from_millis(200);

/// Rounds that the program checker runs: the first fills the pipeline, the second and third see both parities.
const CHECKED_ROUNDS: u32 = 3;

/// Options of the mapping.
#[derive(clap::Args, Clone, Debug)]
pub struct MappingOptions {
    /// Takes the PE of each equation from a file, as `dump --stage mapping` prints it
    #[arg(long, value_name = "FILE", help_heading = "Mapping")]
    pub mapping: Option<PathBuf>,
    /// Annealing budget in tries [default: grows with the number of equations]
    #[arg(long, value_name = "N", help_heading = "Mapping")]
    pub tries: Option<u64>,
    /// Most input ports a PE may have
    #[arg(long, value_name = "N", default_value_t = 15, help_heading = "Mapping")]
    pub max_in_degree: u32,
    /// Never adds operands with equal coefficients in front of the multiplier
    #[arg(long, help_heading = "Mapping")]
    pub no_pre_adder: bool,
    /// One round of control words for all stages of a step
    #[arg(long = "loop", value_name = "MODE", value_enum, default_value = "auto", help_heading = "Mapping")]
    pub stage_loop: StageLoop,
}

impl MappingOptions {
    /// The mapping file and the number of PEs: those of the file, or those asked for.
    ///
    /// # Errors
    /// Those of the file, and of another number of PEs beside it.
    pub fn given(&self, pes: Option<u32>) -> Result<(Option<MappingFile>, Option<u32>), Failure> {
        let Some(path) = &self.mapping else { return Ok((None, pes)) };
        let file = MappingFile::read(path)?;
        match pes.filter(|pes| *pes != file.pes()) {
            None => {
                let pes = Some(file.pes());
                Ok((Some(file), pes))
            }
            Some(pes) => Err(Failure::Usage(format!(
                "{} maps to {} PEs, and `--pes` asks for {pes}; leave `--pes` out",
                path.display(),
                file.pes()
            ))),
        }
    }

    /// Refuses a mapping file where designs of several kinds are made.
    ///
    /// # Errors
    /// There is one.
    pub fn of_many(&self) -> Result<(), Failure> {
        match self.mapping {
            None => Ok(()),
            Some(_) => Err(Failure::Usage(
                "each design of a sweep has a mapping of its own; give `--mapping` to a `compile` of one design"
                    .to_owned(),
            )),
        }
    }
}

/// Whether stages that are alike share their control words.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageLoop {
    /// Where area times cycles gets smaller
    Auto,
    /// Wherever the stages are alike
    On,
    /// Never
    Off,
}

/// What annealing made of one start.
#[derive(Clone, Debug)]
pub struct StartResult {
    /// Name of the start.
    pub start: &'static str,
    /// Before annealing.
    pub before: MappingCost,
    /// After annealing.
    pub after: MappingCost,
    /// Cycles per step of its schedule.
    pub period: u32,
    /// Relays of hubs in the step that was mapped.
    pub relays: u32,
}

/// Everything that was decided about a model.
pub struct Design {
    /// Step graph; designs that differ in PEs only share it.
    pub graph: Arc<StepGraph>,
    /// Formats, errors, checkpoint; shared likewise.
    pub judged: Arc<Judged>,
    /// The mapping that was taken.
    pub mapping: Mapping,
    /// Its cost.
    pub cost: MappingCost,
    /// Lengths of its connections on a square.
    pub wires: WireLength,
    /// The step with all pairs that some mapping could allow; the step graph if there are none.
    pub hoped: Arc<StepGraph>,
    /// The step with the pairs that the mapping allows, if there are any.
    pub paired: Option<Paired>,
    /// Its schedule.
    pub schedule: Schedule,
    /// Lower bounds.
    pub bound: Bound,
    /// The program.
    pub program: Program,
    /// All starts, the one that was taken first.
    pub starts: Vec<StartResult>,
    /// Whether the number of PEs is the default.
    pub default_pes: bool,
}

/// What a stage took.
pub struct StageTime {
    /// The stage.
    pub stage: &'static str,
    /// Seconds.
    pub seconds: f64,
    /// Seconds of processor time, where the system tells: on a loaded machine the fairer figure.
    pub processor_seconds: Option<f64>,
}

/// Times of each stage, in order.
pub struct Stopwatch {
    /// Stages done.
    pub stages: Vec<StageTime>,
    start: Instant,
    quiet: bool,
}

impl Stopwatch {
    /// A stopwatch; unless `quiet` every stage is reported on standard error as it ends.
    pub fn new(quiet: bool) -> Self {
        Stopwatch { stages: Vec::new(), start: Instant::now(), quiet }
    }

    /// Seconds since the beginning, without those of stages that run over the span.
    pub fn seconds_without_runs(&self) -> f64 {
        self.start.elapsed().as_secs_f64() - self.runs().map(|time| time.seconds).sum::<f64>()
    }

    /// The same in processor time, where the system tells.
    pub fn processor_seconds_without_runs(&self) -> Option<f64> {
        let runs: Option<f64> = self.runs().map(|time| time.processor_seconds).sum();
        processor_seconds().zip(runs).map(|(all, runs)| all - runs)
    }

    fn runs(&self) -> impl Iterator<Item = &StageTime> {
        self.stages.iter().filter(|time| RUNS.contains(&time.stage))
    }

    /// A bar for a long stage; invisible when quiet or when standard error is no terminal.
    pub fn progress_bar(&self, stage: &'static str) -> ProgressBar {
        if self.quiet {
            return ProgressBar::hidden();
        }
        let style = ProgressStyle::with_template("{msg:>10}  {bar:40} {percent:>3} %, {eta} left");
        let bar = ProgressBar::no_length().with_style(style.expect("a valid template")).with_message(stage);
        bar.with_finish(ProgressFinish::AndClear)
    }

    /// What tells that a stage is at work; invisible like the bar.
    fn spinner(&self, stage: &'static str) -> ProgressBar {
        let spinner = if self.quiet { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        if spinner.is_hidden() {
            return spinner;
        }
        let style = ProgressStyle::with_template("{prefix:>10}  {spinner} {elapsed}  {msg}").expect("a valid template");
        let spinner = spinner.with_style(style).with_prefix(stage);
        spinner.enable_steady_tick(SPINNER_TICK);
        spinner
    }

    /// Times a stage and shows that it is at work; `figure` says in a few words what came out of it.
    pub fn stage<T>(&mut self, name: &'static str, work: impl FnOnce() -> T, figure: impl FnOnce(&T) -> String) -> T {
        self.stage_saying(name, |_| work(), figure)
    }

    /// The same of a long stage that can say what it is at.
    pub fn stage_saying<T>(
        &mut self,
        name: &'static str,
        work: impl FnOnce(&dyn Fn(String)) -> T,
        figure: impl FnOnce(&T) -> String,
    ) -> T {
        let spinner = self.spinner(name);
        let work = || {
            let result = work(&|text| spinner.set_message(text));
            spinner.finish_and_clear();
            result
        };
        self.timed(name, work, figure)
    }

    /// Times a stage that shows its progress itself.
    pub fn timed<T>(&mut self, name: &'static str, work: impl FnOnce() -> T, figure: impl FnOnce(&T) -> String) -> T {
        let result = self.part(name, work);
        if !self.quiet {
            let seconds = self.stages.iter().find(|time| time.stage == name).map_or(0.0, |time| time.seconds);
            crate::console::err(&format!("{name:>10}  {}  ({seconds:.2} s)\n", figure(&result)));
        }
        result
    }

    /// Times a part of a stage that goes on after another one; nothing is reported yet.
    fn part<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let (clock, processor) = (Instant::now(), processor_seconds());
        let result = work();
        let seconds = clock.elapsed().as_secs_f64();
        let processor_seconds = processor_seconds().zip(processor).map(|(after, before)| after - before);
        match self.stages.iter_mut().find(|time| time.stage == name) {
            Some(time) => {
                time.seconds += seconds;
                time.processor_seconds = time.processor_seconds.zip(processor_seconds).map(|(all, more)| all + more);
            }
            None => self.stages.push(StageTime { stage: name, seconds, processor_seconds }),
        }
        result
    }
}

/// Processor time of this process so far, all threads together, where the system tells.
pub fn processor_seconds() -> Option<f64> {
    #[cfg(target_os = "linux")]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Some(time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9)
    }
    #[cfg(not(target_os = "linux"))]
    None
}

/// Processor time of this thread so far in seconds, which other work on the machine does not lengthen; where the system does
/// not tell, time since the first question.
pub fn thread_seconds() -> f64 {
    #[cfg(target_os = "linux")]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(target_os = "linux"))]
    {
        static FIRST: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
        FIRST.elapsed().as_secs_f64()
    }
}

impl Design {
    /// The step as it is issued: a term per product.
    pub fn issued(&self) -> &StepGraph {
        self.paired.as_ref().map_or(&self.graph, |paired| &paired.graph)
    }
}

/// Designs the hardware of a model.
pub fn design(
    loaded: &LoadedModel,
    options: &ModelOptions,
    point: &DesignPoint,
    mapping_options: &MappingOptions,
    watch: &mut Stopwatch,
) -> Result<Design, Failure> {
    let format = point.format(&loaded.model)?;
    let (file, pes) = mapping_options.given(point.pes)?;
    let graph = build(loaded, point, mapping_options, watch)?;
    let graph = split(&graph, pes, mapping_options, format).unwrap_or(graph);
    let given = file.map(|file| entrants::given(&file, &graph, mapping_options.max_in_degree)).transpose()?;
    let graph = match point.coefficients {
        Coefficients::OneSlot => graph,
        _ => two_slots(loaded, graph, format, point.coefficients, watch)?,
    };
    let graph = Arc::new(graph);
    let progress = watch.progress_bar("runs");
    let refused = |findings| Failure::Spec(findings, loaded.sources.clone());
    let exact = watch.part("runs", || runs::Exact::run(&loaded.model, &graph, progress)).map_err(refused)?;
    let proposal = match options.proof {
        ProofMode::Off => None,
        ProofMode::Ranges => watch.stage(
            "ranges",
            || exact.propose(&loaded.model, &graph, format, options),
            |proposal| proposal.as_ref().map_or("no formats".to_owned(), |proposal| proposal.figure(&graph)),
        ),
    };
    let judged = watch
        .timed(
            "runs",
            || exact.judge(&loaded.model, &graph, format, options, proposal.as_ref()),
            |judged| runs_figure(judged.as_ref()),
        )
        .map_err(refused)?;
    print_findings(&judged.warnings, &loaded.sources, options.message_format);
    let network = Network { pes, seed: options.seed, given };
    implement(loaded, &graph, &Arc::new(judged), network, mapping_options, watch)
}

/// What the PEs of a design are to be.
#[derive(Clone, Debug)]
pub struct Network {
    /// Their number, unless the default is wanted.
    pub pes: Option<u32>,
    /// Seed of the annealer.
    pub seed: u64,
    /// The mapping that the user gives, and the number of relays in it.
    pub given: Option<(Mapping, u32)>,
}

/// Designs the network for a step graph whose formats are known. The design's step may have relays beside it.
pub fn implement(
    loaded: &LoadedModel,
    graph: &Arc<StepGraph>,
    judged: &Arc<Judged>,
    network: Network,
    mapping_options: &MappingOptions,
    watch: &mut Stopwatch,
) -> Result<Design, Failure> {
    let latency = Latency::of(&judged.fixed.format);
    let mapped = watch.stage(
        "map",
        || Entrants::of(graph, &judged.fixed, &network, mapping_options),
        |entrants| match entrants {
            Ok(entrants) => entrants.figure(network.given.is_some()),
            Err(_) => "impossible".to_owned(),
        },
    );
    let Entrants { variants, candidates, of, plain, .. } = mapped.map_err(|error| map_failure(error, graph, loaded))?;
    let taken_pes = candidates[0].mapping.pes;
    let variant = |index: usize| &variants[of[index]];
    let pairs: Vec<Option<Paired>> = (candidates.iter().zip(&of))
        .map(|(candidate, of)| pairs::pair(&variants[*of].graph, &variants[*of].fixed, &candidate.mapping))
        .collect();
    let graphs: Vec<&StepGraph> = (pairs.iter().zip(&of))
        .map(|(paired, of)| paired.as_ref().map_or(&*variants[*of].graph, |paired| &paired.graph))
        .collect();
    let schedules: Vec<Schedule> = watch.stage_saying(
        "schedule",
        |say| {
            // Relays have no say in how well the others are scheduled.
            let (graphs, more_graphs) = graphs.split_at(plain);
            let (candidates, more) = candidates.split_at(plain);
            let mut all = contest::schedules(graphs, candidates, latency, mapping_options.max_in_degree, say);
            all.extend(contest::schedules(more_graphs, more, latency, mapping_options.max_in_degree, say));
            all
        },
        |schedules: &Vec<Schedule>| {
            format!("{} cycles per step", schedules.iter().map(|s| s.period).min().unwrap_or(0))
        },
    );
    let order = contest::rank(&candidates, &schedules, mapping_options.max_in_degree, plain);
    let starts: Vec<StartResult> = order
        .iter()
        .map(|index| StartResult {
            start: candidates[*index].start,
            before: candidates[*index].start_cost,
            after: candidates[*index].cost,
            period: schedules[*index].period,
            relays: variant(*index).relays,
        })
        .collect();
    let taken = order[0];
    let variant = variant(taken);
    let schedule = schedules.into_iter().nth(taken).expect("ranked above");
    let candidate = candidates.into_iter().nth(taken).expect("ranked above");
    let paired = pairs.into_iter().nth(taken).expect("ranked above");
    let (issued, numbers) =
        paired.as_ref().map_or((&*variant.graph, &*variant.fixed), |paired| (&paired.graph, &paired.fixed));
    let assembled = watch.stage(
        "assemble",
        || assemble(&loaded.model, issued, numbers, &candidate.mapping, schedule, mapping_options.stage_loop),
        |assembled| match assembled {
            Ok((_, program)) => {
                let looped = if program.rounds > 1 { format!(", {} rounds", program.rounds) } else { String::new() };
                format!("{} PEs, {} writes per step{looped}", program.pes.len(), program.writes_per_step())
            }
            Err(_) => "refused".to_owned(),
        },
    );
    let (schedule, mut program) = assembled.map_err(|limit| Failure::Usage(limit.to_string()))?;
    let mut judged = variant.judged(judged);
    if let Some(proof) = judged.proof.as_ref().filter(|_| variant.relays > 0) {
        // What relays write is proven as well.
        let enclosed = proof::enclose(&variant.graph, &judged.fixed, loaded.model.steps());
        judged = Arc::new(Judged { proof: Some(proof::Proof { enclosed, ..proof.clone() }), ..Judged::clone(&judged) });
    }
    if let Some(proof) = &judged.proof {
        proof.leave_out(&mut program, issued, &candidate.mapping);
    }
    let design = Design {
        bound: Bound::of(&variant.hoped, taken_pes, latency),
        wires: mapping::wire_length(&variant.problem, &candidate.mapping),
        mapping: candidate.mapping,
        cost: candidate.cost,
        default_pes: network.pes.is_none(),
        graph: Arc::clone(&variant.graph),
        hoped: Arc::clone(&variant.hoped),
        judged,
        paired,
        schedule,
        program,
        starts,
    };
    let figure = |_: &_| "mapping, schedule, program".to_owned();
    watch.stage_saying("check", |say| check(&design, latency, mapping_options, say), figure)?;
    Ok(design)
}

/// Assembles the schedule, or one of rounds that are alike, whichever takes the smaller product of area and cycles.
fn assemble(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    mapping: &Mapping,
    schedule: Schedule,
    stage_loop: StageLoop,
) -> Result<(Schedule, Program), TooLarge> {
    let flat = pe_hls::assemble::assemble(model, graph, fixed, mapping, &schedule)?;
    if stage_loop == StageLoop::Off {
        return Ok((schedule, flat));
    }
    let Some(rounds) = Rounds::of(graph, fixed) else { return Ok((schedule, flat)) };
    let round = pe_hls::schedule::schedule(&rounds.graph, mapping, Latency::of(&fixed.format));
    let cost =
        |program: &Program| area::estimate(program, Family::default()).equivalent_luts() * f64::from(program.period);
    match (pe_hls::assemble::assemble_rounds(model, graph, fixed, mapping, &rounds, &round), stage_loop) {
        (Ok(looped), StageLoop::Auto) if cost(&looped) >= cost(&flat) => Ok((schedule, flat)),
        (Ok(looped), _) => Ok((rounds.unroll(graph, &round), looped)),
        (Err(_), StageLoop::Auto) => Ok((schedule, flat)),
        (Err(limit), _) => Err(limit),
    }
}

/// Builds the step graph; functions of variables are tables in it, for the arguments that they have over the span.
pub fn build(
    loaded: &LoadedModel,
    point: &DesignPoint,
    mapping_options: &MappingOptions,
    watch: &mut Stopwatch,
) -> Result<StepGraph, Failure> {
    let options = point.step_options(mapping_options);
    let graph = watch.stage(
        "step",
        || pe_hls::step::build_with(&loaded.model, &options),
        |graph| match graph {
            Ok(graph) => format!("{:?} form, {} products per step", graph.form, graph.macs()),
            Err(_) => "refused".to_owned(),
        },
    );
    let graph = graph.map_err(|findings| Failure::Spec(findings, loaded.sources.clone()))?;
    if graph.functions.exact.is_empty() {
        return Ok(graph);
    }
    let (format, progress) = (point.format(&loaded.model)?, watch.progress_bar("functions"));
    let tabulated = watch.timed(
        "functions",
        || tables::tabulate(&loaded.model, &graph, format, &progress),
        |graph| graph.as_ref().map_or_else(|_| "refused".to_owned(), tables::summary),
    );
    tabulated.map_err(|findings| Failure::Spec(findings, loaded.sources.clone()))
}

/// Puts coefficients in two slots.
fn two_slots(
    loaded: &LoadedModel,
    graph: StepGraph,
    format: WordFormat,
    coefficients: Coefficients,
    watch: &mut Stopwatch,
) -> Result<StepGraph, Failure> {
    let products = graph.macs();
    let refined = watch.stage(
        "slots",
        || {
            let exact = runs::Exact::run(&loaded.model, &graph, ProgressBar::hidden())?;
            slots::refine(&loaded.model, &graph, &exact, format, coefficients)
        },
        |refined| match refined {
            Ok(Some((split, _))) => format!("two for coefficients, {} products per step", split.macs()),
            Ok(None) => format!("one for coefficients, {products} products per step"),
            Err(_) => "refused".to_owned(),
        },
    );
    let refined = refined.map_err(|findings| Failure::Spec(findings, loaded.sources.clone()))?;
    Ok(refined.map_or(graph, |(split, _)| split))
}

fn runs_figure(judged: Result<&Judged, &Vec<Diagnostic>>) -> String {
    match judged {
        Ok(judged) => {
            format!("word-length error {:.1e}, method error {:.1e}", judged.errors.word_length, judged.errors.method)
        }
        Err(_) => "refused".to_owned(),
    }
}

/// The graph with its heavy equations split for a number of PEs, or the default number; none if it fits as it is.
pub fn split(graph: &StepGraph, pes: Option<u32>, options: &MappingOptions, format: WordFormat) -> Option<StepGraph> {
    let pes = pes.unwrap_or_else(|| default_pes(graph));
    pe_hls::split::split(graph, pes, options.max_in_degree, Latency::of(&format))
}

/// The default number of PEs.
pub fn default_pes(graph: &StepGraph) -> u32 {
    let slots: u64 = graph.loads().iter().map(|load| u64::from(*load)).sum();
    slots.div_ceil(DEFAULT_SLOTS_PER_PE).clamp(1, graph.equations.len() as u64) as u32
}

/// A mapping error as the user gets it.
fn map_failure(error: MapError, graph: &StepGraph, loaded: &LoadedModel) -> Failure {
    match error {
        MapError::Pes { .. } => Failure::Usage(error.to_string()),
        MapError::InDegree { pe, equation, degree, limit } => {
            let equation = &graph.equations[equation as usize];
            let message = format!("PE {pe}, which computes `{}`, needs {degree} input ports of {limit}", equation.name);
            let finding = Diagnostic::error(codes::IN_DEGREE, equation.span, message)
                .with_help("use fewer PEs with `--pes`, or allow more ports with `--max-in-degree`");
            Failure::Spec(vec![finding], loaded.sources.clone())
        }
    }
}

/// Proves mapping, schedule and program with the independent checkers.
fn check(design: &Design, latency: Latency, options: &MappingOptions, say: &dyn Fn(String)) -> Result<(), Failure> {
    let Design { graph, hoped, judged, mapping, schedule, program, cost, .. } = design;
    say("mapping".to_owned());
    let mut violations = verify::mapping::check(hoped, mapping, cost, options.max_in_degree);
    say("schedule".to_owned());
    violations.extend(verify::schedule::check(design.issued(), mapping, schedule, latency));
    say("program".to_owned());
    // Pairs are proved to be the products of the step graph without pairs.
    violations.extend(verify::program::check(program, graph, &judged.fixed, CHECKED_ROUNDS));
    let proof = judged.proof.as_ref().and_then(|proof| proof.enclosed.as_ref());
    match proof {
        Some(enclosed) => violations.extend(verify::ranges::check(program, design.issued(), &enclosed.enclosure)),
        None => debug_assert!(program.pes.iter().all(|pe| !pe.features.proven)),
    }
    match violations.first() {
        None => Ok(()),
        Some(first) => Err(Failure::Internal(format!("{} violations, first: {first}", violations.len()))),
    }
}

/// Stimulus of a run: the words of the input ports in each step.
pub fn stimulus(model: &Model, design: &Design, from: u64, steps: u64) -> Vec<Vec<i64>> {
    let run = pe_sim::fixed::FixedRun::new(&design.graph, &design.judged.fixed);
    let words = |step| {
        let mut words = runs::port_words(model, &run, step);
        words.truncate(model.inputs.len());
        words
    };
    (from..from + steps).map(words).collect()
}

/// Word widths as the report names them.
pub fn multiplier_name(format: &WordFormat) -> String {
    format!("{}x{}", format.data_bits, format.coefficient_bits)
}
