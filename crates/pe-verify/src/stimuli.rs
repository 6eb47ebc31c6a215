//! Starts that are made for the hardware, not for the model: random words in place of states and inputs, so that all
//! of it moves, and words at the ends of their formats, so that it saturates.
//!
//! Several candidates are tried in the simulator, and the one that has most at work that was not before is taken.

use pe_ir::program::Program;
use pe_sim::clocked::Clocked;
use pe_sim::coverage::Coverage;
use pe_sim::trace::TraceLine;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::engines::Run;

/// What the simulator knows of a run.
pub struct Observed {
    /// What engines must print.
    pub run: Run,
    /// What was at work.
    pub coverage: Coverage,
    /// The control word that raised the overflow flag.
    pub overflow_cycle: Option<u64>,
    /// Whether a sum of two operands wrapped.
    pub wrapped: bool,
    /// Whether a word was out of range of which that was proven impossible.
    pub escaped: bool,
}

/// Runs a program clock by clock; the last line of the stimulus stays.
pub fn observe(program: &Program, stimulus: &[Vec<i64>], steps: u64) -> Observed {
    let mut network = Clocked::new(program);
    let mut run = Run::default();
    let mask = u64::MAX >> (64 - program.format.storage_bits);
    let idle = vec![0; program.inputs.len()];
    for step in 0..steps {
        let inputs = stimulus.get(step as usize).or(stimulus.last()).unwrap_or(&idle);
        network.step(inputs, &mut |line: TraceLine| run.trace.push(line));
        let outputs = network.outputs().into_iter().enumerate();
        run.outputs.extend(outputs.map(|(index, word)| (step, index, word as u64 & mask)));
    }
    run.trace.sort_unstable();
    let (flags, overflow_cycle) = (network.flags(), network.overflow_cycle());
    run.overflow = overflow_cycle.is_some();
    run.flags = Some(flags);
    run.clocks = if steps < 2 { 0 } else { u64::from(program.period) };
    let (wrapped, escaped) = (network.wrapped(), network.escaped());
    Observed { run, coverage: network.coverage(), overflow_cycle, wrapped, escaped }
}

/// Words to begin with and inputs of every step.
pub struct Candidate {
    /// The program with other words of the states.
    pub program: Program,
    /// Port words of every step.
    pub stimulus: Vec<Vec<i64>>,
}

/// Control words of all PEs that candidates may cost together in the simulator.
const BUDGET: u64 = 6_000_000;

/// Candidates, at most, unless there are so many PEs that each has its own.
const CANDIDATES: u64 = 32;

/// Further candidates of a saturation, with the design's own words: where ranges are proven, all others may leave them.
const OWN_WORDS: u64 = 2;

/// What a start is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Everything changes in every step.
    Motion,
    /// Sums and inputs are beyond their formats.
    Saturation,
}

impl Purpose {
    /// What is at work that a start of this purpose is for.
    fn score(self, coverage: &Coverage) -> u64 {
        match self {
            Purpose::Motion => coverage.count(),
            Purpose::Saturation => coverage.flags(),
        }
    }
}

/// The candidate with most at work beside `seen`, if any has more.
pub fn choose(program: &Program, purpose: Purpose, steps: u64, seen: &Coverage) -> Option<Candidate> {
    let cost = (program.pes.len() as u64 * u64::from(program.period) * steps).max(1);
    let mut best = (purpose.score(seen), None);
    let most = CANDIDATES.max(2 * program.pes.len() as u64 + 2);
    let made = (BUDGET / cost).clamp(2, most);
    let own_words = if purpose == Purpose::Saturation { OWN_WORDS } else { 0 };
    for number in 0..made + own_words {
        let candidate = candidate(program, purpose, steps, number, number >= made);
        let observed = observe(&candidate.program, &candidate.stimulus, steps);
        if observed.escaped {
            // No run of the design gets there, so PEs that do not saturate need not stand it.
            continue;
        }
        let mut coverage = seen.clone();
        coverage.add(&observed.coverage);
        if purpose.score(&coverage) > best.0 {
            best = (purpose.score(&coverage), Some(candidate));
        }
    }
    best.1
}

/// Scales of random words as shifts. Products of large ones saturate, small ones get lost.
const SCALES: [u32; 8] = [2, 1, 4, 3, 8, 6, 12, 0];

fn candidate(program: &Program, purpose: Purpose, steps: u64, number: u64, own_words: bool) -> Candidate {
    let saturation = purpose == Purpose::Saturation;
    let mut random = ChaCha8Rng::seed_from_u64(number << 1 | u64::from(saturation));
    let format = program.format;
    let mut program = program.clone();
    let pes = program.pes.len() as u64;
    if !own_words {
        // All states at their limits, or, so that one PE's flag rises alone, those of a PE.
        let at_limits = (number / 2).checked_sub(1).map(|pe| (pe % pes) as u32);
        for state in program.states.clone() {
            let limited = saturation && at_limits.is_none_or(|pe| pe == state.own.0);
            let scale = if saturation { 6 } else { SCALES[number as usize % SCALES.len()] };
            state.set(&mut program.pes, &format, word(limited, format.word_bits(), scale, &mut random));
        }
    }
    // Inputs are at their limits in every other one of those.
    let limited = saturation && (own_words || number.is_multiple_of(2));
    let ports = program.ports().count();
    let line = |random: &mut ChaCha8Rng| (0..ports).map(|_| word(limited, format.storage_bits, 1, random)).collect();
    Candidate { program, stimulus: (0..steps).map(|_| line(&mut random)).collect() }
}

/// A random word of so many bits, two's complement: at or near the limits, or so much smaller.
fn word(limited: bool, bits: u32, scale: u32, random: &mut impl Rng) -> i64 {
    let (least, most) = (-(1i64 << (bits - 1)), (1i64 << (bits - 1)) - 1);
    let near: i64 = random.random_range(0..1 << (bits / 3));
    if !limited {
        let scale = scale.min(bits - 2);
        return random.random_range(least >> scale..=most >> scale);
    }
    match random.random_range(0..5) {
        0 => least,
        1 => most,
        2 => least + near,
        3 => most - near,
        _ => random.random_range(least..=most),
    }
}
