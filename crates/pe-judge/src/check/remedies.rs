//! The cheapest change that works, found by trying changes from the cheapest on.

use pe_hls::formats::{self, Ranges};
use pe_hls::mapping::default_pes;
use pe_hls::schedule::Bound;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver, step_count_problem};
use pe_ir::word::{Latency, MultiplierPorts, WordFormat};

use super::observed;
use super::prediction::Prediction;
use super::question::{JUDGED_STATES, MATRIX_STATES, Question, SAFE, TRIED_STATES, rounded};
use super::rest::{self, Rest};
use super::trials::{Outcome, Trials};
use super::trusted::Trusted;
use crate::point::{DesignPoint, MOST_STORAGE};
use crate::progress::silent;
use crate::runs::{self, Aids, Exact, Judged};

/// Method error up to which a step is a remedy, and word-length error up to which a word is.
const METHOD_ERROR: f64 = 0.02;
const WORD_ERROR: f64 = 0.02;

/// Changes that are tried, at most.
const MOST_TRIALS: usize = 10;

/// Products that the trials of a model with more than [`JUDGED_STATES`] may take for each product of a step: a part of
/// what its mapping costs a compilation, which tries nothing then.
const MAPPING: u64 = 10_000;

/// Products of the runs over the span that a wider word may take to be tried.
const PRODUCTS: u64 = 300_000_000;

/// A change that was tried and works.
#[derive(Clone, Debug, PartialEq)]
pub struct Remedy {
    /// Options to add to the command.
    pub options: String,
    /// Bound of the cycles per step with it, before a mapping.
    pub cycles: u32,
    /// Cycles per second of the model, against those of the model as it is.
    pub cost: f64,
    /// Time over which it was tried, if that is not the whole span, in seconds.
    pub tried: Option<f64>,
}

impl Remedy {
    /// In words, as a help line.
    pub fn text(&self) -> String {
        let Remedy { options, cycles, cost, tried } = self;
        let tried = tried.map_or("tried".to_owned(), |span| format!("tried over the first {span:.1e} s"));
        format!("`{options}` works ({tried}): {cycles} cycles per step at least, {cost:.3} times the cycles per second")
    }
}

/// Lower bound of the cycles per step.
fn cycles(graph: &StepGraph, pes: Option<u32>, format: &WordFormat) -> u32 {
    let latency = Latency::of(format);
    let pes = pes.unwrap_or_else(|| default_pes(graph, latency));
    Bound::of(graph, pes, latency).binding().0
}

/// A method and step that may be tried.
#[derive(Clone, Copy, PartialEq)]
struct Candidate {
    /// Bound of the cycles per second of the model.
    cost: f64,
    /// Bound of the cycles per step.
    cycles: u32,
    /// Products per step.
    macs: u64,
    solver: Solver,
    /// In seconds.
    step: f64,
}

/// The cheapest method and step that is stable and accurate; one that is only stable unless that is not enough.
pub fn for_step(
    model: &Model,
    trials: &Trials,
    prediction: &Prediction,
    point: &DesignPoint,
    format: &WordFormat,
    accurate: bool,
) -> Option<Remedy> {
    if model.states.len() > TRIED_STATES {
        return None;
    }
    let mut candidates: Vec<Candidate> = Vec::new();
    let own = trials.trial(model.solver, model.step)?;
    let own_cost = f64::from(cycles(&own.graph, point.pes, format)) / model.step;
    // The methods without a limit on the negative real axis are those with a matrix.
    let has_matrix =
        |solver: Solver| solver.amplification(-100.0, 0.0) <= 1.0 && solver.largest_step(-1.0, 0.0).is_none();
    for solver in Solver::ALL {
        let products = own.graph.macs() * u64::from(solver.stages()) / u64::from(model.solver.stages());
        let judged = !accurate || trials.affords_error(products, model.step);
        // Of a mechanism they would eliminate a matrix within a matrix, which costs more than any step of its own.
        let costly = model.states.len() > MATRIX_STATES || model.mechanism.is_some();
        if solver != model.solver && (!judged || costly && has_matrix(solver)) {
            continue;
        }
        let Some(trial) = trials.trial(solver, model.step) else { continue };
        let (macs, cycles) = (trial.graph.macs(), cycles(&trial.graph, point.pes, format));
        let mut steps = vec![model.step, model.step / 2.0, model.step / 4.0, model.step / 8.0];
        if let Some((limit, ..)) = prediction.limit_of(solver) {
            let safe = SAFE * limit;
            steps.retain(|step| *step <= safe);
            steps.extend([safe, safe / 2.0, safe / 4.0].into_iter().filter(|step| *step < model.step));
        }
        let runs = |step: &f64| step_count_problem(*step, model.span).is_none();
        let other = |step: &f64| (solver, *step) != (model.solver, model.step);
        let suitable = |step: f64| model.suitable_step(rounded(step));
        let steps = steps.into_iter().filter_map(suitable).filter(other).filter(runs);
        candidates.extend(steps.map(|step| Candidate { cost: f64::from(cycles) / step, cycles, macs, solver, step }));
    }
    candidates.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    candidates.dedup();
    let mut left = match model.states.len() {
        0..=JUDGED_STATES => u64::MAX,
        _ => MAPPING * own.graph.macs(),
    };
    let mut stable_only = None;
    for Candidate { cost, cycles, macs, solver, step } in candidates.into_iter().take(MOST_TRIALS) {
        if accurate && !trials.affords_error(macs, step) {
            continue;
        }
        let Some(rest) = left.checked_sub(trials.products(macs, step)) else { continue };
        left = rest;
        if trials.run(solver, step) != Outcome::Stable {
            continue;
        }
        let mut options = Vec::new();
        if solver != model.solver {
            options.push(format!("--solver {}", solver.name()));
        }
        if step != model.step {
            options.push(format!("--step {step:e}"));
        }
        let remedy =
            Remedy { options: options.join(" "), cycles, cost: cost / own_cost, tried: trials.shortened(solver, step) };
        match trials.method_error(solver, step) {
            Some(error) if error <= METHOD_ERROR => return Some(remedy),
            _ if accurate => {}
            _ => stable_only = stable_only.or(Some(remedy)),
        }
    }
    stable_only
}

/// Multipliers that are tried where a word is too short, where rounding moves a pole, and where a sampled part rings.
const PORTS: [MultiplierPorts; 4] = [
    MultiplierPorts::new(25, 18),
    MultiplierPorts::new(25, 35),
    MultiplierPorts::new(32, 32),
    MultiplierPorts::new(35, 35),
];
const PORTS_OF_POLES: [MultiplierPorts; 6] = [
    MultiplierPorts::new(18, 25),
    MultiplierPorts::new(25, 18),
    MultiplierPorts::new(25, 25),
    MultiplierPorts::new(25, 35),
    MultiplierPorts::new(32, 32),
    MultiplierPorts::new(35, 35),
];
const PORTS_AT_REST: [MultiplierPorts; 2] = [MultiplierPorts::new(32, 32), MultiplierPorts::new(35, 35)];

/// A word that is wider than that of a question.
struct Wider {
    format: WordFormat,
    options: String,
}

impl Wider {
    /// Words with the ports of the question or one of others, and so many more bits of storage, the cheapest first.
    fn all(question: &Question, ports: &[MultiplierPorts], more: &[u32]) -> Vec<Wider> {
        let Question { point, .. } = *question;
        let model = question.model;
        let own = point.ports(model);
        let mut words: Vec<(u32, u32, MultiplierPorts, WordFormat)> = Vec::new();
        for multiplier in [own].into_iter().chain(ports.iter().copied()) {
            for storage in more.iter().map(|more| (point.storage + more).min(MOST_STORAGE)) {
                let narrower = !multiplier.hold(own);
                let same = (multiplier, storage) == (own, point.storage);
                let candidate = DesignPoint { multiplier: Some(multiplier), storage, ..*point };
                if let (false, false, Ok(format)) = (narrower, same, candidate.format(model)) {
                    words.push((format.dsp_per_pe(), storage, multiplier, format));
                }
            }
        }
        words.sort_by_key(|(blocks, storage, multiplier, _)| (*blocks, *storage, *multiplier));
        words.dedup_by_key(|(_, storage, multiplier, _)| (*storage, *multiplier));
        let wider = words.into_iter().map(|(_, storage, multiplier, format)| {
            let ports = (multiplier != own).then(|| format!("--multiplier {multiplier}"));
            let storage = (storage != point.storage).then(|| format!("--storage {storage}"));
            let options: Vec<String> = ports.into_iter().chain(storage).collect();
            Wider { format, options: options.join(" ") }
        });
        wider.collect()
    }

    fn remedy(self, question: &Question) -> Remedy {
        let Question { graph, point, .. } = question;
        let own = f64::from(cycles(graph, point.pes, &question.format));
        let cycles = cycles(graph, point.pes, &self.format);
        Remedy { options: self.options, cycles, cost: f64::from(cycles) / own, tried: None }
    }
}

/// The cheapest word that is long enough. Words share the run in double precision, and each ends where it is too short.
pub fn for_word(question: &Question) -> Option<Remedy> {
    let Question { model, graph, .. } = *question;
    if model.steps().saturating_mul(graph.macs()) > PRODUCTS {
        return None;
    }
    let exact = Exact::run(model, graph, silent()).ok()?;
    let works = |wider: &Wider| {
        let aids = Aids { most: Some(WORD_ERROR), ..Aids::default() };
        let settled = exact.settle_proven(model, graph, wider.format, None, aids);
        settled.is_ok_and(|settled| settled.word_length() <= WORD_ERROR)
    };
    let candidates = Wider::all(question, &PORTS, &[0, 4, 8]);
    candidates.into_iter().take(MOST_TRIALS).find(works).map(|wider| wider.remedy(question))
}

/// The cheapest multiplier that leaves all poles inside of the unit circle.
pub fn for_poles(question: &Question, trusted: &Trusted) -> Option<Remedy> {
    let Question { graph, criteria, .. } = *question;
    let model = question.model;
    if model.steps().saturating_mul(graph.macs()) > PRODUCTS {
        return None;
    }
    let candidates = Wider::all(question, &PORTS_OF_POLES, &[0]);
    let works = |wider: &Wider| {
        let judged = runs::judge(model, graph, wider.format, criteria, silent()).ok()?;
        let growth = observed::step_growth(model, graph, &judged.fixed, trusted)?;
        Some(growth.moved_pole().is_none_or(|(_, rounded)| rounded < 1.0))
    };
    candidates.into_iter().find(|wider| works(wider) == Some(true)).map(|wider| wider.remedy(question))
}

/// The cheapest word with which sampled parts come to rest.
pub fn for_rest(question: &Question, judged: &Judged) -> Option<Remedy> {
    let Question { graph, .. } = *question;
    let model = question.model;
    let ranges = Ranges { largest: judged.largest.clone(), widened: vec![0; graph.values.len()] };
    let candidates = Wider::all(question, &PORTS_AT_REST, &[0, 4, 8, 12]);
    let works = |wider: &Wider| {
        let fixed = formats::choose(graph, &ranges, wider.format);
        fixed.is_ok_and(|fixed| rest::settled(model, graph, &fixed, judged) == Ok(Rest::Zero))
    };
    candidates.into_iter().find(works).map(|wider| wider.remedy(question))
}
