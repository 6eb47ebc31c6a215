//! Lower bounds of the period: what no mapping or schedule can beat.

use petgraph::algo::is_cyclic_directed;
use petgraph::graph::DiGraph;

use pe_ir::graph::{Role, StepGraph};
use pe_ir::word::Latency;

/// Lower bounds of the cycles per step, and which one binds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// Issue slots of all equations spread evenly over the PEs.
    pub throughput: u32,
    /// Issue slots of the largest equation, which one PE has to do.
    pub equation: u32,
    /// Result latency of all stages, if some state depends on itself.
    pub recurrence: u32,
    /// The pause point, which every round passes.
    pub round: u32,
}

impl Bound {
    /// Bounds of a step graph on a number of PEs.
    pub fn of(graph: &StepGraph, pes: u32, latency: Latency) -> Bound {
        let loads = graph.loads();
        let total: u64 = loads.iter().map(|load| u64::from(*load)).sum();
        let result = latency.write() + Latency::WRITE_TO_READ;
        Bound {
            throughput: total.div_ceil(u64::from(pes)) as u32,
            equation: loads.into_iter().max().unwrap_or(0),
            recurrence: if has_cycle(graph) { graph.stages * result } else { 0 },
            round: latency.pause() + 1,
        }
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

/// Whether some equation depends on itself, directly or through others.
fn has_cycle(graph: &StepGraph) -> bool {
    let own = graph.chains.iter().any(|chain| {
        graph.chain_terms(chain).iter().any(|term| {
            let operand = graph.value(term.operand);
            operand.equation == chain.equation && matches!(operand.role, Role::State(_) | Role::Stage(..))
        })
    });
    own || is_cyclic_directed(&DiGraph::<(), (), u32>::from_edges(graph.dependencies()))
}
