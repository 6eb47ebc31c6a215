//! The step as it suits a number of PEs.

use pe_hls::grid::{OnGrid, grid};
use pe_hls::mapping::{self, Candidate, MapOptions, Problem, default_pes};
use pe_hls::route::route;
use pe_hls::schedule::{Bound, draft};
use pe_hls::shorten::shorten;
use pe_ir::graph::StepGraph;
use pe_ir::word::{Latency, WordFormat};

use crate::elimination::has_varying_pivots;
use crate::mapping_file::MappingFile;
use crate::selection::Price;
use crate::settings::MappingOptions;

/// Input ports for which equations are split at least: values may take routes over other PEs, and PEs may have more ports.
const ROUTED: u32 = 24;

/// Seed of the mappings with which a step on a grid is compared.
const SEED: u64 = 1;

/// The graph for a number of PEs, or the default number: with its heavy equations split, or its sums cut to suit a grid of
/// PEs where that takes less time, and with shorter evaluation of tables where latency binds; none if it fits as it is. Where
/// pivots vary much, tables stay as they are: their last bits count. A mapping that is given decides about the grid.
pub fn for_pes(
    graph: &StepGraph,
    pes: Option<u32>,
    given: Option<&MappingFile>,
    options: &MappingOptions,
    format: WordFormat,
) -> Option<StepGraph> {
    let latency = Latency::of(&format);
    let pes = pes.unwrap_or_else(|| default_pes(graph, latency));
    // What has too many products holds up copies, and what has too few costs sums.
    let ports = options.ports().max(ROUTED);
    let split = pe_hls::split::split(graph, pes, ports, latency);
    let fits = |on_grid: &OnGrid| given.is_none_or(|file| file.mapping(&on_grid.graph).is_ok());
    let on_grid = grid(graph, pes, options.ports(), latency).filter(fits);
    let on_grid = on_grid
        .filter(|on_grid| given.is_some() || !faster(split.as_ref().unwrap_or(graph), on_grid, pes, options, format));
    let sized = on_grid.map(|on_grid| on_grid.graph).or(split);
    match has_varying_pivots(graph) {
        true => sized,
        false => shorten(sized.as_ref().unwrap_or(graph), pes, latency).or(sized),
    }
}

/// Whether a step without a grid takes less time than one on a grid: its bound must be less, and a mapping of it, with
/// routes where there are not ports enough.
fn faster(graph: &StepGraph, on_grid: &OnGrid, pes: u32, options: &MappingOptions, format: WordFormat) -> bool {
    let (latency, price) = (Latency::of(&format), Price::of(&format));
    let OnGrid { mapping, cost, period, .. } = on_grid;
    let start = mapping::GRID;
    let on_grid = Candidate { mapping: mapping.clone(), cost: *cost, start, start_cost: *cost };
    let to_beat = price.time(*period, &on_grid);
    if f64::from(Bound::of(graph, pes, latency).binding().0) >= to_beat {
        return false;
    }
    let problem = Problem::of(graph);
    let tries = options.tries.unwrap_or_else(|| MapOptions::default_tries(problem.equations()));
    let annealed = [options.ports(), MappingOptions::MOST_PORTS].into_iter().flat_map(|max_in_degree| {
        mapping::annealed(&problem, &MapOptions { pes, seed: SEED, tries, max_in_degree }).unwrap_or_default()
    });
    annealed.into_iter().any(|candidate| {
        let direct = candidate.cost.max_in_degree <= options.most_ports();
        let direct = direct.then(|| price.time(draft(graph, &candidate.mapping, latency).period, &candidate));
        let routed = || {
            let routed = route(graph, &candidate.mapping, options.ports())?;
            let graph = &routed.relayed.graph;
            let cost = Problem::of(graph).cost(&routed.mapping);
            let period = draft(graph, &routed.mapping, latency).period;
            Some(price.time(period, &Candidate { mapping: routed.mapping, cost, ..candidate.clone() }))
        };
        let too_many = candidate.cost.max_in_degree > options.ports();
        let routed = if too_many { routed() } else { None };
        direct.into_iter().chain(routed).any(|time| time < to_beat)
    })
}
