//! Numbers of values.

use crate::index::at;

/// Index into [`StepGraph::values`](crate::graph::StepGraph::values).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ValueId(pub u32);

impl ValueId {
    /// As an index.
    pub fn index(self) -> usize {
        at(self.0)
    }
}
