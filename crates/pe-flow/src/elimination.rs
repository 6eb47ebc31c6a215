//! The order in which the linear systems of a model are eliminated, found by trial
//! ([0067](../../../docs/decisions/0067-linear-systems.md)).
//!
//! The orders that are estimated to be short are built. Those whose quick mapping is nearly as fast as that of the fastest
//! are run in fixed point. The fewest cycles win, where each bit of accuracy beyond the best order's counts as some more.

use pe_hls::mapping::{self, MapOptions, Problem, default_pes};
use pe_hls::schedule;
use pe_hls::step::{self, Order};
use pe_ir::graph::StepGraph;
use pe_ir::word::Latency;
use pe_judge::DesignPoint;

use crate::failure::Failure;
use crate::pipeline;
use crate::settings::{MappingOptions, Settings};
use crate::spec::LoadedModel;
use crate::watch::Stopwatch;

/// Orders that are built, at most, and how much longer they may be estimated to take than the shortest.
const BUILT: usize = 4;
const LONGER: f64 = 1.5;

/// Cycles beyond the fewest with which an order is run, as a part of them.
const SLOWER: f64 = 1.3;

/// What a lost bit of the word-length error counts, as a part of the cycles.
const BIT: f64 = 0.05;

/// Tries of the quick mappings.
const TRIES: u64 = 2_000;

/// An order that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The order.
    pub order: Order,
    /// Cycles per step of a quick mapping.
    pub cycles: u32,
    /// Word-length error; none if the runs were refused, or it was too slow to be run.
    pub word_length: Option<f64>,
    /// Whether it was taken.
    pub taken: bool,
}

/// The options with an order for the linear systems of a model, and what was tried to find it: nothing where there is
/// none, or the order is given.
///
/// # Errors
/// Those of the stages up to the formats, if no order gets there.
pub fn settled(
    loaded: &LoadedModel,
    settings: &Settings,
    point: &DesignPoint,
    watch: &mut Stopwatch,
) -> Result<(MappingOptions, Vec<Trial>), Failure> {
    let asked = settings.mapping.clone();
    let built = loaded.stages.as_ref().is_some_and(|stages| stages.graph.is_some());
    if asked.elimination.is_some() || built {
        return Ok((asked, Vec::new()));
    }
    let orders = step::orders(&loaded.model);
    let Some((_, shortest)) = orders.first().copied() else { return Ok((asked, Vec::new())) };
    let near = orders.into_iter().filter(|(_, words)| *words as f64 <= LONGER * shortest as f64).take(BUILT);
    let near: Vec<Order> = near.map(|(order, _)| order).collect();
    if let [only] = near[..] {
        return Ok((MappingOptions { elimination: Some(only), ..asked }, Vec::new()));
    }
    let mut inner = Stopwatch::silent();
    let trials = watch.absorbing(
        "elimination",
        &mut inner,
        |inner| tried(loaded, settings, point, &near, inner),
        |trials| match trials {
            Ok(trials) => trials
                .iter()
                .find(|trial| trial.taken)
                .map_or_else(String::new, |trial| format!("order `{}`, {} tried", trial.order.name(), trials.len())),
            Err(_) => "refused".to_owned(),
        },
    )?;
    let taken = trials.iter().find(|trial| trial.taken).map(|trial| trial.order);
    Ok((MappingOptions { elimination: taken, ..asked }, trials))
}

fn tried(
    loaded: &LoadedModel,
    settings: &Settings,
    point: &DesignPoint,
    orders: &[Order],
    watch: &mut Stopwatch,
) -> Result<Vec<Trial>, Failure> {
    let (mut built, mut refused) = (Vec::new(), None);
    for order in orders.iter().copied() {
        let options = MappingOptions { elimination: Some(order), ..settings.mapping.clone() };
        match pipeline::step(loaded, point, &options, watch) {
            Ok(graph) => {
                let cycles = quick(loaded, &graph, point, settings, watch)?;
                built.push((order, graph, cycles));
            }
            Err(failure) => refused = refused.or(Some(failure)),
        }
    }
    let fewest = built.iter().map(|(.., cycles)| *cycles).min().unwrap_or(u32::MAX);
    let mut trials = Vec::with_capacity(built.len());
    for (order, graph, cycles) in built {
        let mut trial = Trial { order, cycles, word_length: None, taken: false };
        if f64::from(cycles) <= SLOWER * f64::from(fewest) {
            let judged = pipeline::run(loaded, graph, watch)
                .and_then(|stepped| pipeline::formats(loaded, &settings.criteria, point, &stepped, None, watch));
            match judged {
                Ok((_, judged)) => trial.word_length = Some(judged.errors.word_length),
                Err(failure) => refused = refused.or(Some(failure)),
            }
        }
        trials.push(trial);
    }
    let least = trials.iter().filter_map(|trial| trial.word_length).fold(f64::INFINITY, f64::min);
    let price = |trial: &Trial| {
        let lost = if least > 0.0 { trial.word_length.map(|error| libm::log2(error / least)) } else { Some(0.0) };
        lost.map(|lost| f64::from(trial.cycles) * (1.0 + BIT * lost))
    };
    let prices = trials.iter().map(price);
    let best = prices.enumerate().filter_map(|(index, price)| Some((index, price?))).min_by(|a, b| a.1.total_cmp(&b.1));
    match (best, refused) {
        (Some((index, _)), _) => trials[index].taken = true,
        (None, Some(failure)) => return Err(failure),
        (None, None) => {}
    }
    Ok(trials)
}

/// Cycles per step of a step that is mapped with few tries.
fn quick(
    loaded: &LoadedModel,
    graph: &StepGraph,
    point: &DesignPoint,
    settings: &Settings,
    watch: &mut Stopwatch,
) -> Result<u32, Failure> {
    let latency = Latency::of(&point.format(&loaded.model).map_err(Failure::Usage)?);
    let problem = Problem::of(graph);
    let pes = point.pes.unwrap_or_else(|| default_pes(graph, latency)).min(problem.equations());
    let max_in_degree = u32::MAX;
    let options = MapOptions { pes, seed: settings.seed, tries: TRIES, max_in_degree };
    let candidates = watch.part("map", || mapping::map(&problem, &options)).unwrap_or_default();
    let drafts = || candidates.iter().map(|candidate| schedule::draft(graph, &candidate.mapping, latency).period).min();
    Ok(watch.part("schedule", drafts).unwrap_or(u32::MAX))
}
