//! Lower bounds of the period (the initiation interval), which no mapping or schedule can beat.

use pe_ir::graph::StepGraph;
use pe_ir::word::Latency;

use super::recurrence::recurrence;

/// Lower bounds of the cycles per step, and which one binds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// Issue slots of all equations spread evenly over the PEs.
    pub throughput: u32,
    /// Issue slots of the largest equation, which one PE has to do.
    pub equation: u32,
    /// How fast states can follow from states: the longest way round through products and latencies; 0 if another
    /// bound is larger for certain.
    pub recurrence: u32,
    /// The pause point, which every round passes.
    pub round: u32,
}

impl Bound {
    /// Bounds of a step graph on a number of PEs.
    pub fn of(graph: &StepGraph, pes: u32, latency: Latency) -> Bound {
        let loads = graph.loads();
        let total: u64 = loads.iter().map(|load| u64::from(*load)).sum();
        let throughput = total.div_ceil(u64::from(pes)) as u32;
        let equation = loads.into_iter().max().unwrap_or(0);
        let round = latency.pause() + 1;
        let known = throughput.max(equation).max(round);
        Bound { throughput, equation, recurrence: recurrence(graph, latency, known), round }
    }

    /// The largest bound and its name.
    pub fn binding(&self) -> (u32, &'static str) {
        let bounds = [
            (self.throughput, "products over PEs"),
            (self.equation, "largest equation"),
            (self.recurrence, "latency of the stages"),
            (self.round, "shortest round"),
        ];
        bounds.into_iter().rev().max_by_key(|(cycles, _)| *cycles).expect("four bounds")
    }
}
