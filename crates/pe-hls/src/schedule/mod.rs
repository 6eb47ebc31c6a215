//! Schedules chains and transfers, all PEs at once, and overlaps successive steps (software pipelining).
//!
//! A list scheduler places chains in time order, the one with the longest way to the end of the step first. Transfers
//! cost no issue slot: a value is sent as it is written and received by its own write port. The step then becomes a
//! loop of the smallest period at which the next step finds every state in place; a few repetitions feed the times
//! at which the states arrive back into the placement.

mod bound;
mod list;
mod period;
mod problem;
mod recurrence;

use pe_ir::graph::StepGraph;
use pe_ir::index::number;
use pe_ir::mapping::Mapping;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

pub use bound::Bound;
pub use problem::Problem;
pub use recurrence::arrivals;

/// Repetitions of the placement; more brought nothing on any of the shipped models.
const REPETITIONS: usize = 6;

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
        let mut release = vec![0; self.slots];
        let mut best: Option<Schedule> = None;
        let bound = self.load_bound();
        for repetition in 0..repetitions {
            let placement = list::place(self, &release);
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
