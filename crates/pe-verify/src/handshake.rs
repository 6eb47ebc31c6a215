//! Stimuli of the handshake, clock by clock, and the responses that the datasheet requires.

use std::collections::VecDeque;
use std::fmt::Write;

use pe_ir::program::Program;
use pe_ir::word::Pipeline;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::engines::Event;

/// How `ce_i` and `step_i` behave around one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Manner {
    /// Both stay 1: steps follow each other without a pause.
    Free,
    /// The clock enable has random gaps; there is one as the word at the pause point is fetched, and one behind the sample.
    Gaps,
    /// `step_i` is 1 for a single clock, some clocks after the pause point was reached.
    Pulse,
    /// `step_i` is 1 while the network is busy, and falls before the pause point.
    Early,
    /// `step_i` waits with the clock enable at 0, and both are random.
    Random,
}

/// One after the other, so that each meets each of its neighbours.
const MANNERS: [Manner; 7] =
    [Manner::Free, Manner::Free, Manner::Gaps, Manner::Early, Manner::Random, Manner::Pulse, Manner::Gaps];

/// Clocks that a test bench goes on after the last step is due: later it will not come.
const PATIENCE: usize = 16;

/// What a run does to the handshake, and the answers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Handshake {
    /// A hex digit per clock: 1 `ce_i`, 2 `step_i`, 4 the inputs are valid; lines of 64.
    pub control: String,
    /// Changes of `busy_o`, `done_o` and `overflow_o`.
    pub events: Vec<Event>,
    /// Clocks between the last two `done_o`; zero after a single step.
    pub clocks: u64,
    /// What was met.
    pub met: Met,
}

/// Situations of the handshake that a run has met: number of clocks or steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Met {
    /// Clocks with `ce_i` = 0 while control words are executed.
    pub frozen_busy: u64,
    /// Clocks with `ce_i` = 0 at the pause point while `step_i` is 1.
    pub frozen_waiting: u64,
    /// Clocks with `ce_i` = 0 while `done_o` is 1.
    pub frozen_done: u64,
    /// Clocks at the pause point with `step_i` = 0.
    pub waiting: u64,
    /// Clocks with `step_i` = 1 before the pause point after one with 0.
    pub early: u64,
    /// Steps that begin in the clock in which the pause point is reached.
    pub back_to_back: u64,
    /// Clocks in which inputs are garbage.
    pub garbage: u64,
}

impl Met {
    /// Adds what another run has met.
    pub fn add(&mut self, other: &Met) {
        let pairs = self.all_mut().into_iter().zip(other.all());
        pairs.for_each(|(to, (_, from))| *to += from);
    }

    fn all_mut(&mut self) -> [&mut u64; 7] {
        let Met { frozen_busy, frozen_waiting, frozen_done, waiting, early, back_to_back, garbage } = self;
        [frozen_busy, frozen_waiting, frozen_done, waiting, early, back_to_back, garbage]
    }

    /// The situations with their names.
    pub fn all(&self) -> [(&'static str, u64); 7] {
        [
            ("ce_i = 0 in a step", self.frozen_busy),
            ("ce_i = 0 as step_i waits", self.frozen_waiting),
            ("ce_i = 0 at done_o", self.frozen_done),
            ("step_i late", self.waiting),
            ("step_i early", self.early),
            ("steps back to back", self.back_to_back),
            ("garbage at inputs", self.garbage),
        ]
    }
}

/// Drives `steps` steps of a program, freely or, with the number of a run, held back as that run is, and tells what the
/// network does. `overflow` is the control word, counted from the first, that raises the overflow flag.
pub fn drive(program: &Program, steps: u64, overflow: Option<u64>, held: Option<u64>) -> Handshake {
    let mut random = held.map(ChaCha8Rng::seed_from_u64);
    // Short runs begin elsewhere in the list, so that all of them together meet all of it.
    let first = held.unwrap_or(0) * steps.min(MANNERS.len() as u64 - 1);
    let (period, pause) = (u64::from(program.period), u64::from(program.latency().pause()));
    let delay = if program.format.pipeline == Pipeline::Deep { 4 } else { 0 };
    let mut late: VecDeque<(Option<u64>, bool)> = vec![(None, false); delay].into();
    let mut handshake = Handshake::default();
    let mut digits = Vec::new();
    // Where outputs in memories are more than the clocks of a step, the network waits until they are read.
    let reading =
        program.output_memory().map_or(0, |memory| memory.places.len() as u64 + u64::from(memory.latency) + 8);
    let reading = if reading > period { reading } else { 0 };
    let mut unread = 0;
    // Registers of the sequencer, and of the flags behind it.
    let (mut fetched, mut waiting, mut done) = (0u64, false, false);
    let (mut flag, mut overflowed) = (false, false);
    let (mut told, mut shown) = (false, 4u8);
    let (mut waited, mut target, mut step_before, mut ce_before) = (0u64, 0u64, true, true);
    let (mut begun, mut finished, mut latest, mut clock) = (0u64, 0u64, 0u64, 0u64);
    loop {
        clock += 1;
        let manner = MANNERS[(first + begun) as usize % MANNERS.len()];
        let (ce, step) = match &mut random {
            Some(random) => choose(manner, random, (waiting, waited, target), pause_is_near(fetched, period, pause)),
            None => (true, true),
        };
        // What must happen once in a step and happens in each clock of a gap shows at these places only.
        let place = (fetched + period - pause) % period;
        let gap = manner == Manner::Gaps && held.is_some() && ce_before && !waiting && matches!(place, 0 | 2);
        let ce = ce && !gap && unread == 0;
        unread = u64::saturating_sub(unread, 1);
        ce_before = ce;
        // What is seen before the edge.
        let seen = u8::from(!waiting) << 2 | u8::from(done) << 1 | u8::from(overflowed);
        if seen != shown {
            handshake.events.push(Event { clock, pins: seen });
            shown = seen;
        }
        if done && !told {
            finished += 1;
            handshake.clocks = if finished < 2 { 0 } else { clock - latest };
            latest = clock;
            if finished == steps {
                break;
            }
            unread = reading;
        }
        told = done;
        // The edge.
        let fetch = ce && (step || !waiting);
        let sample = fetch && waiting;
        digits.push(u8::from(ce) | u8::from(step) << 1 | u8::from(sample) << 2);
        let met = &mut handshake.met;
        met.frozen_busy += u64::from(!ce && !waiting);
        met.frozen_waiting += u64::from(!ce && waiting && step);
        met.frozen_done += u64::from(!ce && done);
        met.waiting += u64::from(ce && waiting && !step);
        met.early += u64::from(ce && !waiting && step && !step_before);
        met.back_to_back += u64::from(sample && waited == 0);
        met.garbage += u64::from(!sample);
        step_before = step;
        let at_pause = fetched % period == pause;
        let mut executed = (fetch && fetched > 0).then(|| fetched - 1);
        let mut publish = fetch && at_pause && fetched > pause;
        if delay > 0 {
            late.push_back((executed, publish));
            (executed, publish) = late.pop_front().expect("as many as the delay");
            done = (done && !ce) || publish;
        } else if ce {
            done = publish;
        }
        overflowed = flag;
        flag |= overflow.is_some() && executed == overflow;
        waited = if waiting { waited + 1 } else { 0 };
        if fetch {
            begun += u64::from(waiting);
            waiting = at_pause;
            fetched += 1;
            if waiting {
                waited = 0;
                target = random.as_mut().map_or(0, |random| random.random_range(1..5));
            }
        }
    }
    digits.resize(digits.len() + PATIENCE, 3);
    for line in digits.chunks(64) {
        line.iter().for_each(|digit| write!(handshake.control, "{digit:x}").expect("memory takes the digit"));
        handshake.control.push('\n');
    }
    handshake
}

/// Whether the next words reach the pause point.
fn pause_is_near(fetched: u64, period: u64, pause: u64) -> bool {
    (pause + period - fetched % period) % period < 3
}

fn choose(
    manner: Manner,
    random: &mut impl Rng,
    (waiting, waited, target): (bool, u64, u64),
    near: bool,
) -> (bool, bool) {
    match manner {
        Manner::Free => (true, true),
        Manner::Gaps => (random.random_bool(0.75), true),
        Manner::Pulse => (true, waiting && waited >= target),
        Manner::Early if waiting => (true, waited >= target),
        Manner::Early => (true, !near && random.random_bool(0.5)),
        // A frozen clock with `step_i` at 1 must begin nothing.
        Manner::Random if waiting && waited < target => (waited % 2 == 1 && random.random_bool(0.5), waited % 2 == 0),
        Manner::Random if waiting => (random.random_bool(0.5), random.random_bool(0.5)),
        Manner::Random => (random.random_bool(0.85), random.random_bool(0.5)),
    }
}

/// The first difference between the answers of an engine and those of the datasheet.
pub fn difference(is: &[Event], should: &[Event]) -> Option<String> {
    let at = (0..is.len().max(should.len())).find(|at| is.get(*at) != should.get(*at))?;
    let pins = |event: &Event| {
        let pin = |bit: u8, name: &str| format!("{name} = {}", event.pins >> bit & 1);
        format!("{}, {}, {} from clock {} on", pin(2, "busy_o"), pin(1, "done_o"), pin(0, "overflow_o"), event.clock)
    };
    let told = |events: &[Event]| events.get(at).map_or("no further change".to_owned(), pins);
    Some(format!("handshake: {} instead of {}", told(is), told(should)))
}
