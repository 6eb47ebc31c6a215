//! How the linear systems of a model are eliminated, found by trial
//! ([0067](../../../docs/decisions/0067-linear-systems.md), [0075](../../../docs/decisions/0075-roots-of-pivots.md)).
//!
//! The orders that are estimated to be short are built, in several schemes where pivots vary much. Those whose quick mapping
//! is nearly as fast as that of the fastest in their scheme are run in fixed point. The fewest cycles win, where each bit of
//! accuracy below the best one's counts as some more.

use pe_hls::mapping::{self, MapOptions, Problem, default_pes};
use pe_hls::schedule;
use pe_hls::step::{self, Order, Scheme};
use pe_ir::graph::{Pivot, StepGraph};
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

/// Orders that are built in other schemes, at most.
const SCHEMED: usize = 2;

/// What the largest value of a pivot is over its least where other schemes than the shortest are worth a trial.
const VARIES: f64 = 16.0;

/// Cycles beyond the fewest with which an order is run, as a part of them.
const SLOWER: f64 = 1.3;

/// What a lost bit of the states' word-length errors counts, their geometric mean, as a part of the cycles. The largest
/// error would not tell: it often is that of a state which hardly moves.
const BIT: f64 = 0.05;

/// Tries of the quick mappings.
const TRIES: u64 = 2_000;

/// An order and a scheme that were tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The order.
    pub order: Order,
    /// The scheme.
    pub scheme: Scheme,
    /// Cycles per step of a quick mapping.
    pub cycles: u32,
    /// Word-length error; none if the runs were refused, or it was too slow to be run.
    pub word_length: Option<f64>,
    /// Binary logarithm of the word-length errors' geometric mean over the states, if it was run.
    pub bits: Option<f64>,
    /// Whether it was taken.
    pub taken: bool,
}

/// The options with an order and a scheme for the linear systems of a model, and what was tried to find it: nothing where there is
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
    if built || (asked.elimination.is_some() && asked.factors.is_some()) {
        return Ok((asked, Vec::new()));
    }
    let orders = step::orders(&loaded.model);
    let Some((_, shortest)) = orders.first().copied() else { return Ok((asked, Vec::new())) };
    let near = orders.into_iter().filter(|(_, words)| *words as f64 <= LONGER * shortest as f64).take(BUILT);
    let near = asked.elimination.map_or_else(|| near.map(|(order, _)| order).collect(), |order| vec![order]);
    let schemes = asked.factors.map_or_else(|| step::schemes(&loaded.model).to_vec(), |scheme| vec![scheme]);
    if let ([order], [scheme]) = (&near[..], &schemes[..]) {
        return Ok((MappingOptions { elimination: Some(*order), factors: Some(*scheme), ..asked }, Vec::new()));
    }
    let mut inner = Stopwatch::silent();
    let trials = watch.absorbing(
        "elimination",
        &mut inner,
        |inner| tried(loaded, settings, point, (&near, &schemes), inner),
        |trials| match trials {
            Ok(trials) => trials.iter().find(|trial| trial.taken).map_or_else(String::new, |trial| {
                let (order, scheme) = (trial.order.name(), trial.scheme.name());
                format!("order `{order}`, scheme `{scheme}`, {} tried", trials.len())
            }),
            Err(_) => "refused".to_owned(),
        },
    )?;
    let taken = trials.iter().find(|trial| trial.taken);
    let (elimination, factors) = (taken.map(|trial| trial.order), taken.map(|trial| trial.scheme));
    Ok((MappingOptions { elimination, factors, ..asked }, trials))
}

fn tried(
    loaded: &LoadedModel,
    settings: &Settings,
    point: &DesignPoint,
    (orders, schemes): (&[Order], &[Scheme]),
    watch: &mut Stopwatch,
) -> Result<Vec<Trial>, Failure> {
    let mut refused = None;
    let mut all: Vec<(Trial, StepGraph)> = Vec::new();
    for (index, scheme) in schemes.iter().copied().enumerate() {
        // The first is the shortest.
        let mut orders = orders.to_vec();
        if index > 0 {
            if !all.is_empty() && !all.iter().any(|(_, graph)| has_varying_pivots(graph)) {
                break;
            }
            let cycles_of =
                |order: &Order| all.iter().find(|(trial, _)| trial.order == *order).map(|(trial, _)| trial.cycles);
            orders.sort_by_key(|order| cycles_of(order).unwrap_or(u32::MAX));
            orders.truncate(SCHEMED);
        }
        let mut built = Vec::new();
        for order in orders {
            let options =
                MappingOptions { elimination: Some(order), factors: Some(scheme), ..settings.mapping.clone() };
            match pipeline::step(loaded, point, &options, watch) {
                Ok(graph) => {
                    let cycles = quick(loaded, &graph, point, settings, watch)?;
                    built.push((Trial { order, scheme, cycles, word_length: None, bits: None, taken: false }, graph));
                }
                Err(failure) => refused = refused.or(Some(failure)),
            }
        }
        let fewest = built.iter().map(|(trial, _)| trial.cycles).min().unwrap_or(u32::MAX);
        for (mut trial, graph) in built {
            if f64::from(trial.cycles) <= SLOWER * f64::from(fewest) {
                let judged = pipeline::run(loaded, graph.clone(), watch)
                    .and_then(|stepped| pipeline::formatted(loaded, &settings.criteria, point, &stepped, watch));
                match judged {
                    Ok((_, judged)) => {
                        trial.word_length = Some(judged.errors.word_length);
                        trial.bits = Some(mean_bits(&judged.state_errors));
                    }
                    Err(failure) => refused = refused.or(Some(failure)),
                }
            }
            all.push((trial, graph));
        }
    }
    let mut trials: Vec<Trial> = all.into_iter().map(|(trial, _)| trial).collect();
    let least = trials.iter().filter_map(|trial| trial.bits).fold(f64::INFINITY, f64::min);
    let price = |trial: &Trial| Some(f64::from(trial.cycles) * (1.0 + BIT * (trial.bits? - least)));
    let prices = trials.iter().map(price);
    let best = prices.enumerate().filter_map(|(index, price)| Some((index, price?))).min_by(|a, b| a.1.total_cmp(&b.1));
    match (best, refused) {
        (Some((index, _)), _) => trials[index].taken = true,
        (None, Some(failure)) => return Err(failure),
        (None, None) => {}
    }
    Ok(trials)
}

/// Whether a pivot varies so much over the span that its scheme, and each rounding in front of it, decides the accuracy.
pub(crate) fn has_varying_pivots(graph: &StepGraph) -> bool {
    let varies = |pivot: &Pivot| match pivot {
        Pivot::Varying { range: Some((low, high)), .. } => {
            let (small, large) = (low.abs().min(high.abs()), low.abs().max(high.abs()));
            low * high <= 0.0 || large > VARIES * small
        }
        _ => false,
    };
    graph.eliminations.iter().any(|elimination| elimination.pivots.iter().any(varies))
}

/// Binary logarithm of the geometric mean of errors, each at least 2^-60.
fn mean_bits(errors: &[f64]) -> f64 {
    let sum: f64 = errors.iter().map(|error| libm::log2(error.max(libm::exp2(-60.0)))).sum();
    sum / errors.len().max(1) as f64
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
