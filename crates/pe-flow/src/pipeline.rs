//! The flow from model to program, compiler stage by compiler stage: the one order of `compile`, of sweeps and of
//! goals.
//!
//! ```text
//! build       solver, step, form, order; with functions the ports    step graph
//! split       PEs, where equations are heavy                   step graph
//! run         as its step graph                                run in double precision
//! formats     multiplier, storage, coefficients                formats, judged
//! implement   PEs, mapping                                     design
//! ```
//!
//! In the middle is what decides a stage beside those before it. [`design`] does all of them for one point,
//! [`crate::explore::sweep`] for many, and keeps what these share.

use std::sync::Arc;

use pe_hls::mapping;
use pe_hls::pairs::{self, Paired};
use pe_hls::rounds::Rounds;
use pe_hls::schedule::Bound;
use pe_hls::step::StepOptions;
use pe_hls::sums;
use pe_ir::graph::StepGraph;
use pe_ir::index;
use pe_ir::model::Model;
use pe_ir::schedule::Schedule;
use pe_ir::source::Diagnostic;
use pe_ir::verify;
use pe_ir::word::{Latency, WordFormat};

use crate::assembled::{Assembled, assemble, cost, leave_out_proven};
use crate::candidates::{self, Candidates, Network};
pub use crate::design::{Design, StartResult};
use crate::elimination;
use crate::failure::Failure;
use crate::known::Known;
use crate::mapping_file::MappingFile;
use crate::parts;
use crate::rings;
use crate::selection::{self, Price};
use crate::settings::{MappingOptions, Settings, StageLoop, step_options};
use crate::sized;
use crate::spec::LoadedModel;
use crate::stages::{self, CHECKED_ROUNDS};
use crate::watch::Stopwatch;
use pe_judge::progress::silent;
use pe_judge::proof;
use pe_judge::runs::{self, Aids, Beyond, Comparison, Exact, Judged, Kept, Room, Unsettled};
use pe_judge::slots;
use pe_judge::tables;
use pe_judge::{Coefficients, Criteria, DesignPoint, ProofMode};

/// Designs the hardware of a model.
///
/// # Errors
/// Those of all stages.
pub fn design(
    loaded: &LoadedModel,
    settings: &Settings,
    point: &DesignPoint,
    watch: &mut Stopwatch,
) -> Result<Design, Failure> {
    let (mapping, trials) = elimination::settled(loaded, settings, point, watch)?;
    let settings = &Settings { mapping, ..settings.clone() };
    let Prepared { graph, judged, network } = prepare(loaded, settings, point, watch)?;
    let design = implement(loaded, &graph, &judged, network, &settings.mapping, &Known::default(), watch)?;
    Ok(Design { trials, ..design })
}

/// A step with its formats, and what its network is to be.
pub struct Prepared {
    /// The step.
    pub graph: Arc<StepGraph>,
    /// Formats, errors, checkpoint.
    pub judged: Arc<Judged>,
    /// What the network is to be.
    pub network: Network,
}

/// All that comes before the mapping: the step and its runs over the span.
///
/// # Errors
/// Those of the stages up to there, and of a mapping that the user gives.
pub fn prepare(
    loaded: &LoadedModel,
    settings: &Settings,
    point: &DesignPoint,
    watch: &mut Stopwatch,
) -> Result<Prepared, Failure> {
    let Settings { criteria, mapping: mapping_options, seed } = settings;
    let (file, pes) = given_mapping(loaded, mapping_options, point.pes)?;
    let graph = step_for(loaded, point, mapping_options, (file.as_ref(), pes), watch)?;
    let named = |graph: &StepGraph| -> Result<_, Failure> {
        file.as_ref().map(|file| candidates::given(file, graph, mapping_options.ports())).transpose()
    };
    let early = named(&graph);
    let stepped = run(loaded, graph, watch)?;
    let (graph, judged) = formatted(loaded, criteria, point, &stepped, watch)?;
    // Rings have fewer equations.
    let ringed = rings::with_rings(&loaded.model, &graph, &judged, mapping_options);
    let given = ringed.map_or(early, |(ringed, _)| named(&ringed))?;
    Ok(Prepared { graph, judged: Arc::new(judged), network: Network { pes, exact: false, seed: *seed, given } })
}

/// A step and its run in double precision: what designs that differ in their words share.
pub struct Stepped {
    /// The step.
    pub graph: Arc<StepGraph>,
    /// Its run.
    pub exact: Exact,
}

/// Runs a step in double precision.
///
/// # Errors
/// Those of the run.
pub fn run(loaded: &LoadedModel, graph: StepGraph, watch: &mut Stopwatch) -> Result<Stepped, Failure> {
    let progress = watch.progress("runs");
    let exact = watch.part("runs", || Exact::run(&loaded.model, &graph, progress));
    let exact = exact.map_err(|findings| Failure::Spec(findings, loaded.sources.clone()))?;
    Ok(Stepped { graph: Arc::new(graph), exact })
}

/// The same in silence, for as long as `goes_on` says so, kept where there is room, see [`Exact::run_while`].
///
/// # Errors
/// Those of the run.
pub fn run_while(
    loaded: &LoadedModel,
    graph: StepGraph,
    goes_on: &mut dyn FnMut(usize, &[f64]) -> bool,
    room: &Arc<Room>,
) -> Result<Option<Stepped>, Failure> {
    let exact = Exact::run_while(&loaded.model, &graph, silent(), goes_on, room);
    let exact = exact.map_err(|findings| Failure::Spec(findings, loaded.sources.clone()))?;
    Ok(exact.map(|exact| Stepped { graph: Arc::new(graph), exact }))
}

/// What designs with the same step share beside it.
#[derive(Clone, Copy)]
pub struct Compared<'a> {
    /// What runs in double precision say about the method, or why they are refused.
    pub comparison: &'a Result<Comparison, Vec<Diagnostic>>,
    /// The run of the step.
    pub kept: Option<&'a Kept>,
    /// Word-length error beyond which a run in fixed point ends.
    pub most: Option<f64>,
}

/// Why a step has no number formats.
pub enum Unformatted {
    /// They are refused.
    Failed(Failure),
    /// A run in fixed point ended early, see [`Compared::most`].
    Beyond(Beyond),
}

impl From<Failure> for Unformatted {
    fn from(failure: Failure) -> Unformatted {
        Unformatted::Failed(failure)
    }
}

/// Number formats of a step, and the errors of its runs in them; the runs that it needs share the machine.
///
/// # Errors
/// Those of the runs, and words that no hardware has.
pub fn formatted(
    loaded: &LoadedModel,
    criteria: &Criteria,
    point: &DesignPoint,
    stepped: &Stepped,
    watch: &mut Stopwatch,
) -> Result<(Arc<StepGraph>, Judged), Failure> {
    formats(loaded, criteria, point, stepped, None, watch).map_err(|unformatted| match unformatted {
        Unformatted::Failed(failure) => failure,
        Unformatted::Beyond(_) => unreachable!("no error is too large"),
    })
}

/// The same of the step that was run, or of that with coefficients in two slots, where `compared` is given if the step is
/// run in several formats.
///
/// # Errors
/// Those of [`formatted`], and runs that end early.
pub fn formats(
    loaded: &LoadedModel,
    criteria: &Criteria,
    point: &DesignPoint,
    stepped: &Stepped,
    compared: Option<Compared>,
    watch: &mut Stopwatch,
) -> Result<(Arc<StepGraph>, Judged), Unformatted> {
    let model = &loaded.model;
    let format = point.format(model).map_err(Failure::Usage)?;
    // Ranges are proven for runs from the initial states, not for what a host makes of them.
    let tunable = model.tunables().next().is_some();
    let criteria = &Criteria { proof: if tunable { ProofMode::Off } else { criteria.proof }, ..criteria.clone() };
    let refused = |findings| Failure::Spec(findings, loaded.sources.clone());
    if let Some(fixed) = loaded.stages.as_ref().and_then(|stages| stages.fixed.as_ref()) {
        let judge = || stepped.exact.judge_given(model, &stepped.graph, fixed, criteria);
        let judged = watch.timed("runs", judge, |judged| runs_figure(judged.as_ref().ok())).map_err(refused)?;
        watch.warn(&judged.warnings, &loaded.sources);
        return Ok((Arc::clone(&stepped.graph), judged));
    }
    // What was run for other words may have sums that are too long for these.
    let cut = sums::cut(&stepped.graph, &format).map(|graph| run(loaded, graph, watch)).transpose()?;
    let stepped = cut.as_ref().unwrap_or(stepped);
    let refined = match point.coefficients {
        Coefficients::OneSlot => None,
        Coefficients::TwoSlot | Coefficients::Auto => two_slots(loaded, stepped, format, point.coefficients, watch)?,
    };
    let other = cut.is_some() || refined.is_some();
    let Stepped { graph, exact } = refined.as_ref().unwrap_or(stepped);
    let proposal = match criteria.proof {
        ProofMode::Off => None,
        ProofMode::Ranges => watch.stage(
            "ranges",
            || exact.propose(model, graph, format, criteria),
            |proposal| proposal.as_ref().map_or("no formats".to_owned(), |proposal| proposal.figure(graph)),
        ),
    };
    let judge = || match compared {
        None => Ok(exact.judge(model, graph, format, criteria, proposal.as_ref())?),
        Some(compared) => {
            // Another step than the one that was run has another run.
            let kept = compared.kept.filter(|_| !other);
            let aids = Aids { kept, most: compared.most };
            let settled = exact.settle_proven(model, graph, format, proposal.as_ref(), aids)?;
            Ok(exact.conclude(model, graph, Ok(settled), compared.comparison.clone(), criteria)?)
        }
    };
    let judged = watch.timed("runs", judge, |judged| runs_figure(judged.as_ref().ok()));
    let judged = judged.map_err(|unsettled| match unsettled {
        Unsettled::Refused(findings) => Unformatted::Failed(refused(findings)),
        Unsettled::Beyond(beyond) => Unformatted::Beyond(beyond),
    })?;
    watch.warn(&judged.warnings, &loaded.sources);
    Ok((Arc::clone(graph), judged))
}

/// The mapping of the text that the model comes from, or that of the options; and the number of PEs.
fn given_mapping(
    loaded: &LoadedModel,
    options: &MappingOptions,
    pes: Option<u32>,
) -> Result<(Option<MappingFile>, Option<u32>), Failure> {
    let Some(file) = loaded.stages.as_ref().and_then(|stages| stages.mapping.as_ref()) else {
        return options.given(pes);
    };
    if options.mapping.is_some() || pes.is_some_and(|pes| pes != file.pes()) {
        let message = format!("the text has a mapping to {} PEs; leave `--mapping` and `--pes` out", file.pes());
        return Err(Failure::Usage(message));
    }
    Ok((Some(file.clone()), Some(file.pes())))
}

/// How often the default number of PEs is doubled for rings to find room.
const MORE_PES: u32 = 4;

/// Designs the network for a step graph whose formats are settled. Mappings and schedules that are known are not looked for
/// again. The design's step may have relays beside it, and rings in place of long rows of past words.
///
/// # Errors
/// Those of all stages.
pub fn implement(
    loaded: &LoadedModel,
    graph: &Arc<StepGraph>,
    judged: &Arc<Judged>,
    network: Network,
    mapping_options: &MappingOptions,
    known: &Known,
    watch: &mut Stopwatch,
) -> Result<Design, Failure> {
    let Some((of_rings, judged_rings)) = rings::with_rings(&loaded.model, graph, judged, mapping_options) else {
        return implement_step(loaded, graph, judged, network, mapping_options, known, watch);
    };
    let in_rings = |network: Network, watch: &mut Stopwatch| {
        implement_step(loaded, &of_rings, &judged_rings, network, mapping_options, known, watch)
    };
    match in_rings(network.clone(), watch) {
        // Rings take powers of two of words, for which the memories of so few PEs may be too small.
        Err(Failure::Usage(_)) if network.given.is_none() => {
            let least = mapping::default_pes(&of_rings, Latency::of(&judged.fixed.format));
            let most = index::number(of_rings.equations.len());
            let more =
                (1..=MORE_PES).map(|doubled| least << doubled).filter(|pes| network.pes.is_none() && *pes <= most);
            for pes in more {
                if let Ok(design) = in_rings(Network { pes: Some(pes), ..network.clone() }, watch) {
                    return Ok(Design { default_pes: true, ..design });
                }
            }
            implement_step(loaded, graph, judged, network, mapping_options, known, watch)
        }
        other => other,
    }
}

/// The same without rings that are not there yet: with one program for the parts of a step that are alike, where that is cheaper.
fn implement_step(
    loaded: &LoadedModel,
    graph: &Arc<StepGraph>,
    judged: &Arc<Judged>,
    network: Network,
    mapping_options: &MappingOptions,
    known: &Known,
    watch: &mut Stopwatch,
) -> Result<Design, Failure> {
    let asked = network.given.is_none() && mapping_options.stage_loop != StageLoop::Off;
    let rounds = asked.then(|| Rounds::of_parts(graph, &judged.fixed)).flatten();
    let whole = |network: Network, watch: &mut Stopwatch| {
        implement_whole(loaded, graph, judged, network, mapping_options, known, watch)
    };
    let taken = |(design, told): (Design, Vec<Diagnostic>), watch: &mut Stopwatch| {
        watch.warn(&told, &loaded.sources);
        let latency = Latency::of(&judged.fixed.format);
        let figure = |_: &_| "mapping, schedule, program".to_owned();
        watch.stage_saying("check", |say| check(&design, latency, mapping_options, say), figure)?;
        Ok(design)
    };
    let Some(rounds) = rounds else { return whole(network, watch).and_then(|whole| taken(whole, watch)) };
    let of_parts = parts::implement(loaded, (graph, judged), &rounds, &network, mapping_options, known, watch);
    let Some(of_parts) = of_parts else { return whole(network, watch).and_then(|whole| taken(whole, watch)) };
    if mapping_options.stage_loop != StageLoop::On
        && let Ok(whole) = whole(network, watch)
        && cost(&whole.0.program) <= cost(&of_parts.0.program)
    {
        return taken(whole, watch);
    }
    taken(of_parts, watch)
}

/// The same in one round, or in rounds of stages, with warnings about the network; not checked.
fn implement_whole(
    loaded: &LoadedModel,
    graph: &Arc<StepGraph>,
    judged: &Arc<Judged>,
    network: Network,
    mapping_options: &MappingOptions,
    known: &Known,
    watch: &mut Stopwatch,
) -> Result<(Design, Vec<Diagnostic>), Failure> {
    let latency = Latency::of(&judged.fixed.format);
    let mapped = watch.stage(
        "map",
        || Candidates::of(graph, &judged.fixed, &network, mapping_options, known),
        |candidates| match candidates {
            Ok(candidates) => candidates.figure(network.given.is_some()),
            Err(_) => "impossible".to_owned(),
        },
    );
    let mapped = mapped.map_err(|error| candidates::failure(error, graph, loaded))?;
    let price = Price::of(&judged.fixed.format);
    let Candidates { alternatives, candidates, of, plain, gathered, blocks, .. } = mapped;
    let taken_pes = candidates[0].mapping.pes;
    let alternative = |index: usize| &alternatives[of[index]];
    let pairs: Vec<Option<Paired>> = (candidates.iter().zip(&of))
        .map(|(candidate, of)| pairs::pair(&alternatives[*of].graph, &alternatives[*of].fixed, &candidate.mapping))
        .collect();
    let graphs: Vec<&StepGraph> = (pairs.iter().zip(&of))
        .map(|(paired, of)| paired.as_ref().map_or(&*alternatives[*of].graph, |paired| &paired.graph))
        .collect();
    let texts = loaded.stages.as_deref().map(|stages| (stages, &loaded.sources));
    let given = stages::schedule(texts, graphs[0], &candidates[0].mapping, latency)?;
    let schedules: Vec<Schedule> = watch.stage_saying(
        "schedule",
        |say| {
            if let Some(given) = given {
                return vec![given];
            }
            selection::all_schedules(&graphs, &candidates, (plain, gathered), (latency, price), known, say)
        },
        |schedules: &Vec<Schedule>| selection::shortest(schedules),
    );
    let order = selection::order(&candidates, &schedules, &blocks, (plain, gathered), price);
    let starts: Vec<StartResult> = order
        .iter()
        .map(|index| {
            let (relays, hops) = (alternative(*index).relays, alternative(*index).hops());
            StartResult { relays, hops, ..StartResult::of(&candidates[*index], schedules[*index].period) }
        })
        .collect();
    let taken = order[0];
    let alternative = alternative(taken);
    let told = candidates::other_than_asked(&network, mapping_options, alternative, &candidates[taken]);
    let schedule = schedules.into_iter().nth(taken).expect("ranked above");
    let candidate = candidates.into_iter().nth(taken).expect("ranked above");
    let paired = pairs.into_iter().nth(taken).expect("ranked above");
    let (issued, numbers) =
        paired.as_ref().map_or((&*alternative.graph, &*alternative.fixed), |paired| (&paired.graph, &paired.fixed));
    let mut judged = alternative.judged(judged);
    let given = stages::program(texts, &alternative.graph, &judged.fixed, &candidate.mapping)?;
    let assembled = watch.stage(
        "assemble",
        || match given {
            Some(given) => Ok(Assembled { schedule, flat: None, program: given }),
            None => assemble(&loaded.model, issued, numbers, &candidate.mapping, schedule, mapping_options.stage_loop),
        },
        |assembled| match assembled {
            Ok(Assembled { program, .. }) => {
                let looped = if program.rounds > 1 { format!(", {} rounds", program.rounds) } else { String::new() };
                format!("{} PEs, {} writes per step{looped}", program.pes.len(), program.writes_per_step())
            }
            Err(_) => "refused".to_owned(),
        },
    );
    let Assembled { schedule, flat, mut program } = assembled.map_err(|limit| Failure::Usage(limit.to_string()))?;
    if let Some(proof) = judged.proof.as_ref().filter(|_| alternative.copies()) {
        // What copies write is proven as well.
        let enclosed = proof::enclose(&alternative.graph, &judged.fixed, loaded.model.steps());
        judged = Arc::new(Judged { proof: Some(proof::Proof { enclosed, ..proof.clone() }), ..Judged::clone(&judged) });
    }
    leave_out_proven(&mut program, &judged, issued, &candidate.mapping);
    let design = Design {
        bound: Bound::of(&alternative.least, taken_pes, latency),
        wires: mapping::wire_length(&alternative.problem, &candidate.mapping),
        mapping: candidate.mapping,
        cost: candidate.cost,
        default_pes: network.pes.is_none(),
        graph: Arc::clone(&alternative.graph),
        optimistic: Arc::clone(&alternative.optimistic),
        judged,
        paired,
        flat,
        schedule,
        program,
        starts,
        trials: Vec::new(),
    };
    Ok((design, told))
}

/// The step graph that is mapped: built, and split for the number of PEs; or that of the text that the model comes
/// from.
///
/// # Errors
/// Those of the stages.
pub fn step(
    loaded: &LoadedModel,
    point: &DesignPoint,
    mapping_options: &MappingOptions,
    watch: &mut Stopwatch,
) -> Result<StepGraph, Failure> {
    let (file, pes) = given_mapping(loaded, mapping_options, point.pes)?;
    step_for(loaded, point, mapping_options, (file.as_ref(), pes), watch)
}

/// The same where the mapping file is read: it may be a pipe, which can be read once only.
fn step_for(
    loaded: &LoadedModel,
    point: &DesignPoint,
    mapping_options: &MappingOptions,
    (file, pes): (Option<&MappingFile>, Option<u32>),
    watch: &mut Stopwatch,
) -> Result<StepGraph, Failure> {
    let format = point.format(&loaded.model).map_err(Failure::Usage)?;
    // The form of the step depends on the number of PEs, which a mapping file may have.
    let graph = build(loaded, &DesignPoint { pes, ..*point }, mapping_options, watch)?;
    if loaded.stages.as_ref().is_some_and(|stages| stages.graph.is_some()) {
        return Ok(graph);
    }
    let graph = sized::for_pes(&graph, pes, file, mapping_options, format).unwrap_or(graph);
    let graph = sums::cut(&graph, &format).unwrap_or(graph);
    Ok(parts::arranged(loaded, &graph, point, mapping_options, (pes, format)).unwrap_or(graph))
}

/// Builds the step graph; functions of variables are tables in it, for the arguments that they have over the span.
pub fn build(
    loaded: &LoadedModel,
    point: &DesignPoint,
    mapping_options: &MappingOptions,
    watch: &mut Stopwatch,
) -> Result<StepGraph, Failure> {
    if let Some(graph) = loaded.stages.as_ref().and_then(|stages| stages.graph.as_ref()) {
        return Ok(StepGraph::clone(graph));
    }
    // A word that no hardware has is told where formats are made: other words of a sweep have the same step.
    let format = point.format(&loaded.model).map_err(Failure::Usage);
    let longest_sum = format.as_ref().map_or(u32::MAX, sums::most_products);
    let options = StepOptions { longest_sum, ..step_options(point, mapping_options) };
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
    let format = format?;
    let progress = watch.progress("functions");
    let tabulate = match parts::share_tables(loaded, &graph, point, mapping_options) {
        true => tables::tabulate_alike,
        false => tables::tabulate,
    };
    let tabulated = watch.timed(
        "functions",
        || tabulate(&loaded.model, &graph, format, &*progress),
        |graph| graph.as_ref().map_or_else(|_| "refused".to_owned(), tables::summary),
    );
    tabulated.map_err(|findings| Failure::Spec(findings, loaded.sources.clone()))
}

/// The step with coefficients in two slots, and its run; none if one slot is to be taken.
fn two_slots(
    loaded: &LoadedModel,
    stepped: &Stepped,
    format: WordFormat,
    coefficients: Coefficients,
    watch: &mut Stopwatch,
) -> Result<Option<Stepped>, Failure> {
    let Stepped { graph, exact } = stepped;
    let refined = watch.stage(
        "slots",
        || slots::refine(&loaded.model, graph, exact, format, coefficients),
        |refined| match refined {
            Ok(Some((split, _))) => format!("two for coefficients, {} products per step", split.macs()),
            Ok(None) => format!("one for coefficients, {} products per step", graph.macs()),
            Err(_) => "refused".to_owned(),
        },
    );
    let refined = refined.map_err(|findings| Failure::Spec(findings, loaded.sources.clone()))?;
    Ok(refined.map(|(split, exact)| Stepped { graph: Arc::new(split), exact }))
}

fn runs_figure(judged: Option<&Judged>) -> String {
    judged.map_or("refused".to_owned(), |Judged { errors, .. }| {
        format!("word-length error {:.1e}, method error {:.1e}", errors.word_length, errors.method)
    })
}

/// Proves mapping, schedule and program with the independent checkers.
fn check(design: &Design, latency: Latency, options: &MappingOptions, say: &dyn Fn(String)) -> Result<(), Failure> {
    let Design { graph, judged, mapping, schedule, program, cost, .. } = design;
    say("mapping".to_owned());
    let mut violations = verify::mapping::check(design.issued(), mapping, cost, options.most_ports());
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
    format.multiplier().to_string()
}
