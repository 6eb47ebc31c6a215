//! Steps that are examined besides the evenly spaced samples: the first ones, and those after a jump.

use std::collections::BTreeSet;

use pe_ir::model::Model;

/// Jumps that are looked at, at most: the first ones, and as many evenly spread over the others.
const FIRST_JUMPS: usize = 40;
const OTHER_JUMPS: usize = 40;

/// Breakpoints of a signal that are known, at most.
const BREAKPOINTS: usize = 1_000_000;

/// Numbers of steps done at which a run is looked at, ascending: densely after the beginning and after each jump of an
/// input, a sampled part or the step, ever less so until `apart` steps later, where samples do as well.
pub(super) fn steps(model: &Model, apart: u64) -> Vec<u64> {
    let whole = model.steps();
    let mut looks = BTreeSet::new();
    for jump in std::iter::once(0).chain(thinned(jumps(model))) {
        let mut after = 1;
        while after <= apart.max(4) && jump + after <= whole {
            looks.insert(jump + after);
            // 1, 2, 3, 4, 6, 8, 12, 16, 24, ...
            after = if after < 4 {
                after + 1
            } else if after.is_power_of_two() {
                after + after / 2
            } else {
                after / 3 * 4
            };
        }
        looks.insert(jump);
    }
    looks.remove(&0);
    looks.into_iter().collect()
}

/// The first steps that begin at or after a jump, ascending.
fn jumps(model: &Model) -> Vec<u64> {
    let breakpoints = model.waveforms().flat_map(|signal| signal.breakpoints(model.span).take(BREAKPOINTS));
    let phases = model.phases.iter().map(|phase| phase.until);
    let at = breakpoints.chain(phases).map(|time| step_at(model, time));
    let samples = model.ticks().flat_map(|(_, steps)| (1..).map(move |sample| sample * steps).take(BREAKPOINTS));
    let whole = model.steps();
    let jumps: BTreeSet<u64> = at.chain(samples).filter(|jump| (1..whole).contains(jump)).collect();
    jumps.into_iter().collect()
}

fn thinned(jumps: Vec<u64>) -> Vec<u64> {
    if jumps.len() <= FIRST_JUMPS + OTHER_JUMPS {
        return jumps;
    }
    let (first, others) = jumps.split_at(FIRST_JUMPS);
    let spread = (0..OTHER_JUMPS).map(|place| others[place * (others.len() - 1) / (OTHER_JUMPS - 1)]);
    first.iter().copied().chain(spread).collect()
}

/// The first step that begins at a time or later; times of steps and jumps are rounded numbers.
fn step_at(model: &Model, time: f64) -> u64 {
    let (mut low, mut high) = (0, model.steps());
    while low < high {
        let middle = low + (high - low) / 2;
        match model.time(middle, 1e-6) < time {
            true => low = middle + 1,
            false => high = middle,
        }
    }
    low
}
