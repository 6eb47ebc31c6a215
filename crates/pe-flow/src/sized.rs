//! The step as it suits a number of PEs.

use pe_hls::mapping::default_pes;
use pe_hls::shorten::shorten;
use pe_ir::graph::StepGraph;
use pe_ir::word::{Latency, WordFormat};

use crate::elimination::has_varying_pivots;
use crate::settings::MappingOptions;

/// Input ports for which equations are split at least: values may take routes over other PEs, and PEs may have more ports.
const ROUTED: u32 = 24;

/// The graph for a number of PEs, or the default number: with its heavy equations split, and with shorter evaluation of tables
/// where latency binds; none if it fits as it is. Where pivots vary much, tables stay as they are: their last bits count.
pub fn for_pes(graph: &StepGraph, pes: Option<u32>, options: &MappingOptions, format: WordFormat) -> Option<StepGraph> {
    let latency = Latency::of(&format);
    let pes = pes.unwrap_or_else(|| default_pes(graph, latency));
    // What has too many products holds up copies, and what has too few costs sums.
    let ports = options.ports().max(ROUTED);
    let split = pe_hls::split::split(graph, pes, ports, latency);
    match has_varying_pivots(graph) {
        true => split,
        false => shorten(split.as_ref().unwrap_or(graph), pes, latency).or(split),
    }
}
