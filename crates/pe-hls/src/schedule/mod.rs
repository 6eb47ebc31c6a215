//! Schedules chains and transfers, all PEs at once, and overlaps successive steps (software pipelining).
//!
//! A list scheduler places chains in time order, the one with the longest way to the end of the step first. Transfers
//! cost no issue slot: a value is sent as it is written and received by its own write port. The step then becomes a
//! loop of the smallest period at which the next step finds every state in place; a few repetitions feed the times
//! at which the states arrive back into the placement.
//!
//! Where that leaves PEs waiting, parts of the step that do not wait for one another, such as cells that read their
//! neighbours as these were before the step, are also placed in turns: the first part is done everywhere before the last
//! one begins.

mod bound;
mod list;
mod period;
mod problem;
mod recurrence;
mod turns;

use pe_ir::graph::StepGraph;
use pe_ir::index::{List, number};
use pe_ir::mapping::Mapping;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

pub use bound::Bound;
use problem::CodeId;
pub use problem::Problem;
pub use recurrence::arrivals;

/// Repetitions of the placement; more brought nothing on any of the shipped models.
const REPETITIONS: usize = 6;

/// Part of the bound by which a schedule is longer that is worth another try, in turns.
const WAITING: u32 = 32;

/// Schedules a mapped step graph.
pub fn schedule(graph: &StepGraph, mapping: &Mapping, latency: Latency) -> Schedule {
    Problem::new(graph, mapping, latency).schedule()
}

/// A first schedule, in a fraction of the time; [`schedule`] finds one that is at least as short.
pub fn draft(graph: &StepGraph, mapping: &Mapping, latency: Latency) -> Schedule {
    Problem::new(graph, mapping, latency).draft()
}

impl Problem {
    /// The best schedule that can be found.
    pub fn schedule(&self) -> Schedule {
        self.repeated(REPETITIONS)
    }

    /// The first one, see [`draft`].
    pub fn draft(&self) -> Schedule {
        self.repeated(1)
    }

    fn repeated(&self, repetitions: usize) -> Schedule {
        let first = self.by(&self.chains.iter().map(|chain| chain.priority).collect(), repetitions);
        let bound = self.load_bound();
        let waits = first.period > bound + bound / WAITING;
        match waits.then(|| turns::priorities(self)).flatten() {
            Some(turns) => {
                let other = self.by(&turns, repetitions);
                if other.period < first.period { other } else { first }
            }
            None => first,
        }
    }

    fn by(&self, priorities: &List<CodeId, u32>, repetitions: usize) -> Schedule {
        let mut release = vec![0; self.slots];
        let mut best: Option<Schedule> = None;
        let bound = self.load_bound();
        for repetition in 0..repetitions {
            let placement = list::place(self, priorities, &release);
            let period = period::smallest(self, &placement);
            // Aim between the bound and what was reached: asking for the bound at once delays chains for nothing.
            let aim = bound.max(period.saturating_sub(1 + number(repetition)));
            release = period::releases(self, &placement, aim);
            let better = best.as_ref().is_none_or(|best| period < best.period);
            if better {
                best = Some(self.finish(placement, period));
            }
            if period <= bound {
                break;
            }
        }
        best.expect("at least one repetition")
    }
}
