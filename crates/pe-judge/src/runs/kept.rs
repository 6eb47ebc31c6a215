//! A run in double precision that is kept, to be compared with again.

use std::sync::Arc;

use pe_sim::compared::Rows;

use super::lockstep::Plan;

/// Rows of states and outputs of all steps, block by block.
#[derive(Clone)]
pub struct Kept {
    pub(super) blocks: Vec<Arc<Rows>>,
}

/// Keeps the rows of a run while it is made, if they are not too many.
pub(super) struct Keeping {
    rows: Rows,
    /// Blocks so far; none if nothing is kept.
    blocks: Option<Vec<Arc<Rows>>>,
    /// Steps of a block, and of the run.
    block: u64,
    steps: u64,
}

impl Keeping {
    /// Of a run of the plan's steps with so many numbers each, and so many in all at most.
    pub fn new(plan: &Plan, width: usize, most: u64) -> Keeping {
        let small = plan.steps.saturating_mul(width as u64) <= most;
        Keeping { rows: Rows::new(width), blocks: small.then(Vec::new), block: plan.block(), steps: plan.steps }
    }

    /// Keeps nothing if that is so.
    pub fn stop_if(&mut self, stop: bool) {
        self.blocks = self.blocks.take().filter(|_| !stop);
    }

    /// The row after so many steps.
    pub fn add<I: Iterator<Item = f64>>(&mut self, done: u64, row: impl FnOnce() -> I) {
        let Some(blocks) = &mut self.blocks else { return };
        self.rows.add(row());
        if done.is_multiple_of(self.block) || done == self.steps {
            blocks.push(Arc::new(self.rows.take()));
        }
    }

    /// All rows, if they were kept.
    pub fn kept(self) -> Option<Kept> {
        self.blocks.map(|blocks| Kept { blocks })
    }
}
