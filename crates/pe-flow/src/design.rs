//! Everything that is decided about a model.

use std::sync::Arc;

use pe_hls::mapping::{Candidate, WireLength};
use pe_hls::pairs::Paired;
use pe_hls::schedule::Bound;
use pe_ir::graph::StepGraph;
use pe_ir::mapping::{Mapping, MappingCost};
use pe_ir::program::Program;
use pe_ir::schedule::Schedule;
use pe_judge::runs::Judged;

use crate::elimination::Trial;

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
    /// Copies in a step that carry values over other PEs.
    pub hops: u32,
}

impl StartResult {
    /// That of a candidate without copies whose schedule takes so many cycles.
    pub fn of(candidate: &Candidate, period: u32) -> StartResult {
        let Candidate { start, start_cost: before, cost: after, .. } = *candidate;
        StartResult { start, before, after, period, relays: 0, hops: 0 }
    }
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
    pub optimistic: Arc<StepGraph>,
    /// The step with the pairs that the mapping allows, if there are any.
    pub paired: Option<Paired>,
    /// Its schedule.
    pub schedule: Schedule,
    /// The schedule before stages that are alike became rounds, where they did.
    pub flat: Option<Schedule>,
    /// Lower bounds.
    pub bound: Bound,
    /// The program.
    pub program: Program,
    /// All starts, the one that was taken first.
    pub starts: Vec<StartResult>,
    /// Whether the number of PEs is the default.
    pub default_pes: bool,
    /// Orders of elimination that were tried.
    pub trials: Vec<Trial>,
}

impl Design {
    /// The step as it is issued: a term per product.
    pub fn issued(&self) -> &StepGraph {
        self.paired.as_ref().map_or(&self.graph, |paired| &paired.graph)
    }
}
