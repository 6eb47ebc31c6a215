//! Starts that are made for the hardware, not for the model: random words in place of states and inputs, so that all
//! of it moves, and words at the ends of their formats, so that it saturates. Words of memories may be others than any state
//! has: the hardware has to do with them what the datasheet says, and so each place where a word saturates comes first.
//!
//! Several candidates are tried in the simulator, and the one that has most at work that was not before is taken.

use std::sync::Arc;

use pe_ir::index::PeId;
use pe_ir::program::Program;
use pe_sim::clocked::{Clocked, Control};
use pe_sim::coverage::{Coverage, flags_of};
use pe_sim::trace::TraceLine;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::engines::{Run, played};
use crate::pace::{Effort, Efforts};

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
    observe_controlled(&Control::of(program), program, stimulus, steps)
}

/// The same of one of many programs that differ in images alone.
pub(crate) fn observe_controlled(
    control: &Arc<Control>,
    program: &Program,
    stimulus: &[Vec<i64>],
    steps: u64,
) -> Observed {
    let mut network = Clocked::controlled(Arc::clone(control), program);
    let mut run = Run::default();
    for (step, inputs) in (0..steps).zip(played(program, stimulus)) {
        network.step(&inputs, &mut |line: TraceLine| run.trace.push(line));
        run.publish(program, step, &network.outputs());
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

/// Further candidates of a saturation, each aimed at a place that was not seen to saturate.
const AIMED: u64 = 1024;

/// Distances from a limit that are tried for each of these, at most, what that takes in runs of a saturation, and the steps of
/// each.
const LOOKS: usize = 250;
const AIMING: u64 = 5;
const BRIEF: u64 = 2;

/// Further candidates of a saturation, with the design's own words: where ranges are proven, all others may leave them.
const OWN_WORDS: u64 = 2;

/// Further ones whose states are anywhere in their formats: results that nothing takes are too large before others are.
const ANYWHERE: u64 = 48;

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
            // A result that nothing takes is worth less than any flag.
            Purpose::Saturation => coverage.flags() << 32 | coverage.unsent(),
        }
    }
}

/// Numbers of candidates of a purpose: made for a design of so many control words a run, of its own words, and anywhere.
fn candidates(program: &Program, purpose: Purpose, cost: u64) -> (u64, u64, u64) {
    let most = CANDIDATES.max(2 * program.pes.len() as u64 + 2);
    let made = (BUDGET / cost).clamp(2, most);
    match purpose {
        Purpose::Motion => (made, 0, 0),
        Purpose::Saturation => (made, OWN_WORDS, (BUDGET / cost).min(ANYWHERE)),
    }
}

/// Control words of all PEs that a candidate runs.
fn cost(program: &Program, steps: u64) -> u64 {
    (program.pes.len() as u64 * u64::from(program.period) * steps).max(1)
}

/// Aimed candidates of a search in which no other one sets a flag.
fn aimed(cost: u64) -> u64 {
    (BUDGET / (AIMING * cost)).clamp(2, AIMED)
}

/// What searches take.
pub fn effort(program: &Program, purpose: Purpose, steps: u64) -> Efforts {
    let cost = cost(program, steps);
    let (made, own_words, anywhere) = candidates(program, purpose, cost);
    let sought = purpose == Purpose::Saturation && !unseen(program, &Coverage::none(program)).is_empty();
    let found = made + own_words + anywhere;
    let [found, nothing] = [found, found + if sought { AIMING * aimed(cost) } else { 0 }];
    let of = |runs: u64| Effort { runs, words: runs * cost };
    Efforts { found: of(found), nothing: of(nothing) }
}

/// The candidate with most at work beside `seen`, if any has more. Starts are aimed if no other sets a flag in a new way.
pub fn choose(program: &Program, purpose: Purpose, steps: u64, seen: &Coverage) -> Option<Candidate> {
    let (cost, control) = (cost(program, steps), Control::of(program));
    let scored = |candidate: Candidate| {
        let observed = observe_controlled(&control, &candidate.program, &candidate.stimulus, steps);
        // No run of the design gets there, so PEs that do not saturate need not stand it.
        let coverage = Some(observed.coverage).filter(|_| !observed.escaped)?;
        let mut sum = seen.clone();
        sum.add(&coverage);
        Some((purpose.score(&sum), sum.flags(), candidate))
    };
    let (made, own_words, anywhere) = candidates(program, purpose, cost);
    let mut best: Option<(u64, u64, Candidate)> = None;
    for number in 0..made + own_words + anywhere {
        let candidate = match number.checked_sub(made + own_words) {
            Some(number) => spread(program, steps, number),
            None => candidate(program, purpose, steps, number, number >= made),
        };
        let Some(scored) = scored(candidate) else { continue };
        if scored.0 > best.as_ref().map_or(purpose.score(seen), |best| best.0) {
            best = Some(scored);
        }
    }
    let flags = seen.flags();
    if purpose == Purpose::Saturation && best.as_ref().is_none_or(|best| best.1 == flags) {
        let places = unseen(program, seen);
        let count = if places.is_empty() { 0 } else { aimed(cost) };
        let mut aimed = (0..count)
            .filter_map(|number| scored(aimed_at(program, &control, &places, steps, AIMED * flags + number, seen)));
        best = aimed.find(|scored| scored.1 > flags).or(best);
    }
    best.map(|best| best.2)
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
        let at_limits = (number / 2).checked_sub(1).map(|pe| PeId::new((pe % pes) as u32));
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

/// States and inputs anywhere in their formats, or in halves or quarters of them.
pub(crate) fn spread(program: &Program, steps: u64, number: u64) -> Candidate {
    let mut random = ChaCha8Rng::seed_from_u64(number << 2 | 3);
    let format = program.format;
    let mut program = program.clone();
    for state in program.states.clone() {
        let scale = random.random_range(0..3);
        state.set(&mut program.pes, &format, word(false, format.word_bits(), scale, &mut random));
    }
    let scale = random.random_range(0..3);
    let ports = program.ports().count();
    let line = |random: &mut ChaCha8Rng| (0..ports).map(|_| word(false, format.storage_bits, scale, random)).collect();
    Candidate { program, stimulus: (0..steps).map(|_| line(&mut random)).collect() }
}

/// Places of which it was not seen that a word saturates there, and that this alone sets a flag or clamps an output: PE, and
/// the control word whose base is added.
fn unseen(program: &Program, seen: &Coverage) -> Vec<(PeId, usize)> {
    let period = program.period as usize;
    let scaled = |word: usize| (word + period - program.latency().scale_to_write() as usize) % period;
    let mut places = Vec::new();
    for (index, _) in program.pes.numbered().filter(|(_, pe)| !pe.features.proven) {
        let flagged = &seen.pes[index].flagged;
        let causes = flags_of(program, index);
        places.extend(causes.iter().filter(|(_, cause)| !flagged[*cause]).map(|(word, _)| (index, scaled(*word))));
    }
    let outputs = program.outputs.iter().zip(&seen.shown_clamped).filter(|(output, seen)| !output.proven && !**seen);
    places.extend(outputs.map(|(output, _)| (output.pe, scaled(output.word as usize))));
    places
}

/// Like the others, but quiet, with a base at a limit where it is added at one of the places, or at a distance at which another
/// place is the first one that saturates; operands are at their limits where no base is added.
fn aimed_at(
    program: &Program,
    control: &Arc<Control>,
    places: &[(PeId, usize)],
    steps: u64,
    number: u64,
    seen: &Coverage,
) -> Candidate {
    let mut random = ChaCha8Rng::seed_from_u64(number << 2 | 2);
    let format = program.format;
    let mut program = program.clone();
    // Where all is small, places differ by what they round.
    let smallest = format.data_bits - 2;
    let least = if random.random() { 0 } else { smallest - smallest / 4 };
    let scale = random.random_range(least..smallest);
    for state in program.states.clone() {
        let scale = if random.random_range(0..4) > 0 { scale } else { random.random_range(0..smallest) };
        state.set(&mut program.pes, &format, word(false, format.word_bits(), scale, &mut random));
    }
    let (index, at) = places[number as usize % places.len()];
    // What is added there may have been written in the same step.
    let states: Vec<u16> = program.states.iter().filter(|s| s.own.0 == index).map(|s| s.own.1).collect();
    let pe = &mut program.pes[index];
    // What a state is multiplied as need not be what is added to.
    if random.random_range(0..2) == 0 {
        for own in &mut pe.own_image {
            *own = word(random.random_range(0..8) == 0, format.data_bits, scale, &mut random);
        }
    }
    if random.random_range(0..4) == 0 {
        for operand in &mut pe.imported_image {
            *operand = word(random.random_range(0..8) == 0, format.data_bits, scale, &mut random);
        }
    }
    let base = match pe.words[at].base {
        Some(_) if !states.is_empty() && random.random_range(0..4) > 0 => {
            Some(pe.features.state_base(states[random.random_range(0..states.len())]))
        }
        base => base.map(usize::from),
    };
    if base.is_none() {
        pe.own_image.iter_mut().for_each(|own| *own = word(true, format.data_bits, 0, &mut random));
    }
    let limited = random.random_range(0..8) == 0;
    let ports = program.ports().count();
    let line =
        |random: &mut ChaCha8Rng| (0..ports).map(|_| word(limited, format.storage_bits, scale, random)).collect();
    let stimulus = (0..steps).map(|_| line(&mut random)).collect();
    let mut candidate = Candidate { program, stimulus };
    if let Some(base) = base {
        let below = random.random();
        let set = |candidate: &mut Candidate, distance: i64| {
            let word = if below { format.min_word() + distance } else { format.max_word() - distance };
            candidate.program.pes[index].base_image[base] = word;
        };
        let flags = seen.flags();
        let found = changes(format.max_word(), |distance| {
            set(&mut candidate, distance);
            let observed = observe_controlled(control, &candidate.program, &candidate.stimulus, steps.min(BRIEF));
            let mut sum = seen.clone();
            sum.add(&observed.coverage);
            (observed.overflow_cycle, sum.flags() > flags && !observed.escaped)
        });
        set(&mut candidate, found.unwrap_or(0));
    }
    candidate
}

/// The first distance at which what is seen is wanted, of those around which it changes.
fn changes<T: PartialEq + Copy>(most: i64, mut look: impl FnMut(i64) -> (T, bool)) -> Option<i64> {
    let ((least_seen, wanted), (most_seen, most_wanted)) = (look(0), look(most));
    if wanted || most_wanted {
        return Some(if wanted { 0 } else { most });
    }
    let mut between = vec![((0, least_seen), (most, most_seen))];
    for _ in 0..LOOKS {
        let (near, far) = between.pop()?;
        if far.0 - near.0 < 2 || near.1 == far.1 {
            continue;
        }
        // First its magnitude is looked for.
        let middle = if far.0 / 32 > near.0 { far.0 / 32 } else { near.0 + (far.0 - near.0) / 2 };
        let (now, wanted) = look(middle);
        if wanted {
            return Some(middle);
        }
        between.extend([((middle, now), far), (near, (middle, now))]);
    }
    None
}

/// Input words as a stimulus file has them: padded, for VHDL reads no others.
pub fn lines(program: &Program, stimulus: &[Vec<i64>]) -> String {
    let bits = program.format.storage_bits;
    let digits = bits.div_ceil(4) as usize;
    let word = |word: &i64| format!("{:0digits$x}", *word as u64 & (u64::MAX >> (64 - bits)));
    let line = |words: &Vec<i64>| words.iter().map(word).collect::<Vec<_>>().join(" ") + "\n";
    stimulus.iter().map(line).collect()
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
