//! Keys about the network: what limits its step, its connections, and the mappings that were scheduled.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The PE with most issue slots in use.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Limiting {
    /// Its index.
    pub pe: usize,
    /// Equations that are mapped to it.
    pub equations: usize,
    /// Names of the first ones.
    pub first_equations: Vec<String>,
    /// Clocks of its step with an operand.
    pub busy_cycles: u32,
    /// Clocks without one.
    pub idle_cycles: u32,
    /// What limits it.
    pub reason: String,
    /// Its input ports.
    pub ports: usize,
    /// Words that arrive at them in a step.
    pub arrivals: u32,
    /// Where most of them come from; missing if none arrive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub main_source: Option<MainSource>,
}

/// Where most words of a PE come from.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct MainSource {
    /// A PE or an input.
    pub from: String,
    /// Words in a step.
    pub words: u32,
}

/// Lengths of the connections with the PEs on a square, in grid steps.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct WireLength {
    /// Of all.
    pub total: u64,
    /// Of the longest.
    pub longest: u32,
}

/// A mapping that was scheduled.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Start {
    /// Initial mapping of the annealing.
    pub start: String,
    /// Cost before annealing.
    pub before: MappingCost,
    /// Cost after annealing.
    pub after: MappingCost,
    /// Clocks of its schedule.
    pub cycles_per_step: u32,
    /// Relays in the step that was mapped; only where relays were tried.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relays: Option<u32>,
    /// Copies in its step that carry values over other PEs; only where values travel so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hops: Option<u32>,
}

/// The cost of a mapping.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct MappingCost {
    /// Issue slots of the most loaded PE.
    pub max_load: u32,
    /// Pairs of PEs joined by a link.
    pub connections: u32,
    /// Input ports of the PE that has most.
    pub max_in_degree: u32,
}
