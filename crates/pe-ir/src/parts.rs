//! Parts of a step that are alike, such as slabs of a tissue, and are computed in turns: a round of control words for each.

use crate::index::{EquationId, List};

/// Which equations of a step are alike.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    /// Parts of the step, of which each takes a round; 0 if it is in one piece.
    pub count: u32,
    /// For each equation of the step its part and the equation of the first part that it is like. Empty in the graph of a
    /// single part, whose states were written a round of all parts ago.
    pub of: List<EquationId, (u32, EquationId)>,
}

impl Parts {
    /// Whether the graph is that of one part of several.
    pub fn is_one_of_many(&self) -> bool {
        self.count > 1 && self.of.is_empty()
    }
}
