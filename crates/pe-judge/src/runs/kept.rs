//! A run in double precision that is kept, to be compared with again.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pe_sim::compared::Rows;

use super::lockstep::Plan;

/// Room for the numbers of runs that are kept, for all of them together.
pub struct Room {
    left: AtomicU64,
}

impl Room {
    /// For so many numbers.
    pub fn new(numbers: u64) -> Arc<Room> {
        Arc::new(Room { left: AtomicU64::new(numbers) })
    }

    /// Takes some of it, if there is as much.
    fn take(self: &Arc<Room>, numbers: u64) -> Option<Taken> {
        let taken =
            self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(numbers)).is_ok();
        taken.then(|| Taken { room: Arc::clone(self), numbers })
    }
}

/// A part of a room; it is given back in the end.
struct Taken {
    room: Arc<Room>,
    numbers: u64,
}

impl Drop for Taken {
    fn drop(&mut self) {
        self.room.left.fetch_add(self.numbers, Ordering::Relaxed);
    }
}

/// Rows of states and outputs of all steps, block by block.
#[derive(Clone)]
pub struct Kept {
    pub(super) blocks: Vec<Arc<Rows>>,
    _taken: Option<Arc<Taken>>,
}

impl Kept {
    /// Rows that take no room from others.
    pub(super) fn of(blocks: Vec<Arc<Rows>>) -> Kept {
        Kept { blocks, _taken: None }
    }
}

/// Keeps the rows of a run while it is made, if there is room for them.
pub(super) struct Keeping {
    rows: Rows,
    /// Blocks so far; none if nothing is kept.
    blocks: Option<(Vec<Arc<Rows>>, Taken)>,
    /// Steps of a block, and of the run.
    block: u64,
    steps: u64,
}

impl Keeping {
    /// Of a run of the plan's steps with so many numbers each.
    pub fn new(plan: &Plan, width: usize, room: &Arc<Room>) -> Keeping {
        let taken = room.take(plan.steps.saturating_mul(width as u64));
        Keeping {
            rows: Rows::new(width),
            blocks: taken.map(|taken| (Vec::new(), taken)),
            block: plan.block(),
            steps: plan.steps,
        }
    }

    /// Keeps nothing if that is so.
    pub fn stop_if(&mut self, stop: bool) {
        self.blocks = self.blocks.take().filter(|_| !stop);
    }

    /// The row after so many steps.
    pub fn add<I: Iterator<Item = f64>>(&mut self, done: u64, row: impl FnOnce() -> I) {
        let Some((blocks, _)) = &mut self.blocks else { return };
        self.rows.add(row());
        if done.is_multiple_of(self.block) || done == self.steps {
            blocks.push(Arc::new(self.rows.take()));
        }
    }

    /// All rows, if they were kept.
    pub fn kept(self) -> Option<Kept> {
        self.blocks.map(|(blocks, taken)| Kept { blocks, _taken: Some(Arc::new(taken)) })
    }
}
