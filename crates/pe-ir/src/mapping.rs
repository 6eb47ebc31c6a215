//! The mapping of equations to PEs.

use crate::index::{EquationId, List, PeId};

/// For each equation of a step graph its PE.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    /// Number of PEs.
    pub pes: u32,
    /// PE of each equation.
    pub pe_of: List<EquationId, PeId>,
}

/// What a mapping costs, as the annealer sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MappingCost {
    /// Issue slots of the most loaded PE.
    pub max_load: u32,
    /// Pairs of PEs joined by at least one link in either direction.
    pub connections: u32,
    /// Largest number of input ports of a PE, external inputs included.
    pub max_in_degree: u32,
}
