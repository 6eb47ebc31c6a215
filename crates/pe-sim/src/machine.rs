//! The network, control word by control word: registers and memories as the datasheet describes them.
//!
//! A step does the same whatever the numbers, so its control words are followed once ([`crate::record`]) and what they
//! compute is run for each step, many sums at a time ([`crate::tiles`]).

use std::ops::Deref;

use pe_ir::index::{List, PeId, StateId, at, number};
use pe_ir::program::{ControlWord, Fold, Layout, Program};
use pe_ir::word::WordFormat;

use crate::clocked::Causes;
use crate::record::{Homes, KeptSums, Move, Moves, NULL, OFFSET, Recording, Stretch};
use crate::tape::Tape;
use crate::tiles::{self, Chain, Columns, Factor, Outcome, Term, Tiles, Write};
use crate::trace::{Checksums, MemoryWrite, TraceLine};
use crate::words::{Port, Words};

/// The whole network; `P` is a reference to its program, or shares it.
pub struct Machine<P> {
    program: P,
    homes: Homes,
    network: Network,
    causes: Causes,
    escaped: bool,
    /// Steps done.
    steps: u64,
    cycle: u64,
    parity: bool,
    outputs: Vec<i64>,
    checksums: Vec<u64>,
}

/// Words and steps, as wide as the multiplier's ports need.
enum Network {
    Short(Steps<i32>),
    Long(Steps<i64>),
}

/// Applies the same expression to either width.
macro_rules! on_steps {
    ($network:expr, $steps:ident => $result:expr) => {
        match $network {
            Network::Short($steps) => $result,
            Network::Long($steps) => $result,
        }
    };
}

impl<P: Deref<Target = Program>> Machine<P> {
    /// A network after configuration: the pipeline is filled up to the pause point.
    ///
    /// The control words pass through their bits, so that what runs is what the hardware's memory holds.
    pub fn new(program: P) -> Self {
        let bits: Vec<Vec<u128>> = program
            .pes
            .iter()
            .map(|pe| {
                let fold = Fold::of(&program, pe);
                (0..program.period as usize).map(|k| fold.word(k)).collect()
            })
            .collect();
        Self::with_bits(program, &bits)
    }

    /// A network that runs the given control-word bits in place of the program's own.
    pub fn with_bits(program: P, bits: &[Vec<u128>]) -> Self {
        let decode = |(pe, bits): (&pe_ir::program::PeProgram, &Vec<u128>)| {
            let layout = Layout::new(&pe.features, &program.format);
            bits.iter().map(|bits| layout.decode(*bits)).collect()
        };
        let words: List<PeId, Vec<ControlWord>> = program.pes.iter().zip(bits).map(decode).collect();
        let homes = Homes::new(&program);
        let network = if program.format.data_bits.max(program.format.coefficient_bits) <= 32 {
            Network::Short(Steps::new(&program, &words, &homes))
        } else {
            Network::Long(Steps::new(&program, &words, &homes))
        };
        Machine {
            homes,
            network,
            causes: Causes::default(),
            escaped: false,
            steps: 0,
            cycle: u64::from(program.latency().pause()),
            parity: false,
            outputs: vec![0; program.outputs.len()],
            checksums: vec![0; program.pes.len()],
            program,
        }
    }

    /// Runs one step with the words of the input ports, of which there may be more; every memory write goes to `trace`.
    pub fn step(&mut self, inputs: &[i64], trace: &mut impl FnMut(TraceLine)) {
        let format = self.program.format;
        let steps = self.steps;
        let ports = (0..).zip(inputs.iter().copied()).take(self.program.ports().count());
        let ticks = self.program.ticks();
        for (index, word) in ports.chain(ticks.map(|(index, tick, one)| (index, i64::from(tick.is_due(steps)) * one))) {
            let stored = (i128::from(word) << format.guard_bits) + i128::from(format.data_offset());
            self.causes.input |= stored > i128::from(format.max_word());
            let slot = self.homes.input(index);
            on_steps!(&mut self.network, steps => steps.words.set_operand(at(slot), format.input_operand(word)));
        }
        let step = (self.cycle, self.parity, self.steps, &mut self.checksums[..]);
        let causes = on_steps!(&mut self.network, steps => steps.run(&format, step, &mut self.outputs, trace));
        self.causes.saturated |= causes.saturated;
        self.causes.operand |= causes.operand;
        self.escaped |= on_steps!(&self.network, steps => steps.escaped);
        self.steps += 1;
        self.cycle += u64::from(self.program.period);
        // Roles of buffers change in every round.
        self.parity ^= self.program.rounds % 2 == 1;
    }

    /// Published outputs, port words.
    pub fn outputs(&self) -> &[i64] {
        &self.outputs
    }

    /// Whether the overflow output is set.
    pub fn overflow(&self) -> bool {
        let Causes { saturated, operand, input } = self.causes;
        saturated | operand | input
    }

    /// What set it.
    pub fn causes(&self) -> Causes {
        self.causes
    }

    /// Whether an operand was too large for a sum of two, or will be in the next step: from then on the hardware, whose
    /// sum wraps, computes something else. [`crate::clocked`] computes the same.
    pub fn parted(&self) -> bool {
        self.causes.operand || on_steps!(&self.network, steps => steps.too_large)
    }

    /// Begins anew with the images of another program, which has the same control words; nothing of the runs before stays.
    pub fn restart(&mut self, program: P) {
        on_steps!(&mut self.network, steps => steps.restart(&program, &self.homes));
        self.program = program;
        self.cycle = u64::from(self.program.latency().pause());
        (self.steps, self.parity) = (0, false);
        self.outputs.fill(0);
        self.checksums.fill(0);
        self.clear_flags();
    }

    /// Clears the overflow output, and that a number escaped.
    pub fn clear_flags(&mut self) {
        (self.causes, self.escaped) = (Causes::default(), false);
    }

    /// Whether a word of a PE that does not saturate was out of range, which was proven impossible: nothing that was
    /// computed since is what the hardware computes.
    pub fn escaped(&self) -> bool {
        self.escaped
    }

    /// Checksum of all memory writes of each PE so far; see [`Checksums`].
    pub fn checksums(&self) -> &[u64] {
        &self.checksums
    }

    /// Stored word of a state as the next step starts.
    pub fn state(&self, index: StateId) -> i64 {
        let state = &self.program.states[index];
        let (pe, word) = state.own;
        if state.age.is_some() {
            let slot = at(self.homes.own(pe, usize::from(word)));
            return self.program.format.operand_word(on_steps!(&self.network, steps => steps.operand(slot)));
        }
        let word = self.program.pes[pe].features.state_base(word);
        let slot = at(self.homes.base(pe, word));
        on_steps!(&self.network, steps => steps.words.words[slot])
    }
}

/// What the network computes, with all its words.
struct Steps<P> {
    words: Words<P>,
    /// Filling the pipeline.
    settling: Step<P>,
    /// Sums under way between two steps, and room for the next ones.
    kept: (Vec<i128>, Vec<i128>),
    /// Even steps and odd steps, one if the parity changes nothing.
    even: Step<P>,
    odd: Option<Step<P>>,
    /// Words on the move.
    moving: (Vec<i64>, Vec<P>),
    /// Whether operands of the last words were too large for their sum.
    too_large: bool,
    /// Whether a word of a PE that does not saturate was out of range.
    escaped: bool,
}

/// One step.
struct Step<P> {
    tape: Tape<P>,
    writes: Vec<MemoryWrite>,
    checksums: Checksums,
    outputs: Vec<(u32, bool)>,
    flagged: Vec<u32>,
    proven: Vec<u32>,
    paired: Vec<u32>,
    paired_last: Vec<u32>,
    moves: Moves,
}

impl<P: Port> Steps<P> {
    fn new(program: &Program, words: &List<PeId, Vec<ControlWord>>, homes: &Homes) -> Steps<P> {
        let pause = program.latency().pause();
        let mut kept = KeptSums::default();
        let settling = Stretch { program, words, from: 0, count: pause, parity: false, settle: true };
        let stepping = |parity| Stretch { from: pause, count: program.period, parity, settle: false, ..settling };
        let mut recordings =
            vec![Recording::new(&settling, homes, &mut kept), Recording::new(&stepping(false), homes, &mut kept)];
        if program.rounds % 2 == 1 && program.pes.iter().any(|pe| pe.features.swap) {
            recordings.push(Recording::new(&stepping(true), homes, &mut kept));
        }
        // Keeping a sum may need another one of the step before.
        let mut sum = 0;
        while sum < number(kept.sums.len()) {
            recordings.iter_mut().for_each(|recording| recording.keep(sum, &mut kept));
            sum += 1;
        }
        let needed = needed_homes(program, homes, &recordings);
        let slots = at(recordings.iter().map(|recording| recording.slots).max().unwrap_or(0));
        let has_factors = program.pes.iter().any(|pe| pe.features.factor);
        let mut steps = recordings.into_iter().map(|recording| Step::new(recording, program, homes, &needed));
        let (settling, even, odd) = (steps.next(), steps.next(), steps.next());
        let mut state = Steps {
            words: Words::new(program.format, slots, has_factors),
            settling: settling.expect("recorded above"),
            kept: (vec![0; kept.sums.len()], vec![0; kept.sums.len()]),
            even: even.expect("recorded above"),
            odd,
            moving: (Vec::new(), Vec::new()),
            too_large: false,
            escaped: false,
        };
        state.restart(program, homes);
        state
    }

    /// The data operand in a slot.
    fn operand(&self, slot: usize) -> i64 {
        self.words.data[slot].into()
    }

    /// Fills memories and pipeline from the program's images.
    fn restart(&mut self, program: &Program, homes: &Homes) {
        load(program, homes, &mut self.words);
        self.kept.0.fill(0);
        self.kept.1.fill(0);
        (self.too_large, self.escaped) = (false, false);
        let checksums = &mut vec![0; program.pes.len()];
        std::mem::swap(&mut self.settling, &mut self.even);
        self.run(&program.format, (0, false, 0, checksums), &mut vec![0; program.outputs.len()], &mut |_| {});
        std::mem::swap(&mut self.settling, &mut self.even);
    }

    /// Runs a step; what sets the overflow flag, inputs aside.
    fn run(
        &mut self,
        format: &WordFormat,
        (cycle, parity, number, checksums): (u64, bool, u64, &mut [u64]),
        outputs: &mut [i64],
        trace: &mut impl FnMut(TraceLine),
    ) -> Causes {
        let step = if parity { self.odd.as_ref().unwrap_or(&self.even) } else { &self.even };
        let words = &mut self.words;
        let mut causes = Causes::default();
        if words.run(&step.tape, &self.kept.0, &mut self.kept.1) {
            let saturated = |slots: &[u32]| slots.iter().any(|slot| words.saturations[at(*slot)] > 0);
            causes.saturated = saturated(&step.flagged);
            self.escaped |= saturated(&step.proven);
            words.saturations.fill(0);
        }
        // The hardware's sum of such operands wraps; here it does not, so from then on only the flag is that of the hardware.
        let half = 1 << (format.data_bits - 2);
        let too_large = |slots: &[u32]| slots.iter().any(|slot| !(-half..half).contains(&words.data[at(*slot)].into()));
        causes.operand = self.too_large | too_large(&step.paired);
        self.too_large = too_large(&step.paired_last);
        for write in &step.writes {
            let slot = at(write.slot);
            let (word, bits) = match write.own {
                true => (words.words[slot], format.word_bits()),
                false => (words.data[slot].into(), format.data_bits),
            };
            let value = word as u64 & (u64::MAX >> (64 - bits));
            let address = write.address_in(number);
            trace(TraceLine { cycle: cycle + u64::from(write.cycle), pe: write.pe, address, value });
        }
        step.checksums.advance((checksums, number), format, &words.words, &words.data);
        for (output, (slot, proven)) in outputs.iter_mut().zip(&step.outputs) {
            let (shown, clamped) = shown(format, words.words[at(*slot)]);
            *output = shown;
            self.escaped |= proven & clamped;
        }
        take_over(&step.moves.words, &mut words.words, &mut self.moving.0);
        take_over(&step.moves.operands, &mut words.data, &mut self.moving.1);
        take_over(&step.moves.factors, &mut words.factors, &mut self.moving.1);
        std::mem::swap(&mut self.kept.0, &mut self.kept.1);
        causes
    }
}

impl<P: Port> Step<P> {
    fn new(recording: Recording, program: &Program, homes: &Homes, needed: &[bool]) -> Step<P> {
        // What the step computes is renumbered so that tiles write rows.
        let order = tiles::rows(&recording.chains, &recording.terms, at(recording.slots), &recording.columns);
        let mut renumbered: Vec<u32> = (0..recording.slots).collect();
        order.iter().zip(homes.count..).for_each(|(slot, new)| renumbered[at(*slot)] = new);
        let slot = |slot: u32| renumbered[at(slot)];
        let term = |term: &Term<i64>| Term {
            operand: slot(term.operand),
            factor: match term.factor {
                Factor::Coefficient(coefficient) => Factor::Coefficient(P::of(coefficient)),
                Factor::Value(value) => Factor::Value(slot(value)),
            },
        };
        let write = |write: Write| Write { target: slot(write.target), base: slot(write.base), ..write };
        let chain = |chain: &Chain| Chain {
            outcome: match chain.outcome.clone() {
                Outcome::Words(first, others) => Outcome::Words(write(first), others.map(|other| other.map(write))),
                Outcome::Kept(index) => Outcome::Kept(index),
                Outcome::Segment { target, argument, octaves } => {
                    Outcome::Segment { target: slot(target), argument: slot(argument), octaves }
                }
                Outcome::Choice { target, segment, among } => {
                    Outcome::Choice { target: slot(target), segment: slot(segment), among }
                }
            },
            ..chain.clone()
        };
        let terms: Vec<Term<P>> = recording.terms.iter().map(term).collect();
        let chains: Vec<Chain> = recording.chains.iter().map(chain).collect();
        let choices = recording.columns.choices.iter().map(|choice| slot(*choice)).collect();
        let columns = Columns { choices, ..recording.columns };
        let mut moves = recording.moves(homes);
        for list in [&mut moves.words, &mut moves.operands, &mut moves.factors] {
            list.retain(|(_, to)| needed[at(*to)]);
            list.iter_mut().for_each(|(from, _)| *from = slot(*from));
        }
        let writes: Vec<MemoryWrite> =
            recording.writes.iter().map(|write| MemoryWrite { slot: slot(write.slot), ..*write }).collect();
        let slots = |mut named: Vec<u32>| {
            named.iter_mut().for_each(|name| *name = slot(*name));
            named.sort_unstable();
            named.dedup();
            named
        };
        Step {
            tape: Tape::new(Tiles::new(&chains, &terms, at(recording.slots), columns)),
            checksums: Checksums::new(&writes, program.pes.len()),
            writes,
            outputs: recording.outputs.iter().zip(&program.outputs).map(|(o, port)| (slot(*o), port.proven)).collect(),
            flagged: recording.flagged.iter().map(|flagged| slot(*flagged)).collect(),
            proven: recording.proven.iter().map(|proven| slot(*proven)).collect(),
            paired: slots(recording.paired),
            paired_last: slots(recording.paired_last),
            moves,
        }
    }
}

/// Moves values, all of which leave before the first one arrives.
fn take_over<T: Copy>(moves: &[Move], values: &mut [T], moving: &mut Vec<T>) {
    moving.clear();
    moving.extend(moves.iter().map(|(from, _)| values[at(*from)]));
    moves.iter().zip(moving).for_each(|((_, to), value)| values[at(*to)] = *value);
}

/// Homes that a step reads, or that anyone may look at: the states.
fn needed_homes(program: &Program, homes: &Homes, recordings: &[Recording]) -> Vec<bool> {
    let slots = recordings.iter().map(|recording| recording.slots).max().unwrap_or(0);
    let mut needed = vec![false; at(slots)];
    let mut need = |slot: u32| needed[at(slot)] = true;
    for recording in recordings {
        for term in &recording.terms {
            need(term.operand);
            if let Factor::Value(slot) = term.factor {
                need(slot);
            }
        }
        recording.chains.iter().flat_map(Chain::writes).for_each(|write| need(write.base));
        recording.chains.iter().filter_map(Chain::looked_at).for_each(&mut need);
        recording.columns.choices.iter().copied().for_each(&mut need);
        recording.writes.iter().for_each(|write| need(write.slot));
        recording.outputs.iter().copied().for_each(&mut need);
    }
    for state in &program.states {
        let (pe, word) = state.own;
        need(match state.age {
            None => homes.base(pe, program.pes[pe].features.state_base(word)),
            Some(_) => homes.own(pe, usize::from(word)),
        });
    }
    let moves = recordings.iter().map(|recording| recording.moves(homes));
    let moves: Vec<Move> = moves.flat_map(|moves| [moves.words, moves.operands, moves.factors].concat()).collect();
    loop {
        let mut more = false;
        for (from, to) in &moves {
            if needed[at(*to)] && !needed[at(*from)] {
                needed[at(*from)] = true;
                more = true;
            }
        }
        if !more {
            return needed;
        }
    }
}

/// Sets the words of the initial memory images, and all others to zero.
fn load<P: Port>(program: &Program, homes: &Homes, words: &mut Words<P>) {
    words.clear();
    words.set(at(NULL), 0);
    words.set(at(OFFSET), program.format.data_offset());
    for (index, pe) in program.pes.numbered() {
        for (address, operand) in pe.own_image.iter().enumerate() {
            words.set_operand(at(homes.own(index, address)), *operand);
        }
        for (address, word) in pe.base_image.iter().enumerate() {
            words.set(at(homes.base(index, address)), *word);
        }
        for (address, operand) in pe.coefficient_image.iter().enumerate() {
            words.set_factor(at(homes.coefficient(index, address)), *operand);
        }
        for (address, operand) in pe.imported_image.iter().enumerate() {
            words.set_operand(at(homes.imported(index, address)), *operand);
        }
    }
}

/// What an output port shows of a stored word.
pub fn output_word(format: &WordFormat, word: i64) -> i64 {
    shown(format, word).0
}

/// What an output port shows of a stored word, and whether it is clamped for that.
pub(crate) fn shown(format: &WordFormat, word: i64) -> (i64, bool) {
    let rounding = if format.guard_bits == 0 { 0 } else { 1 << (format.guard_bits - 1) };
    let rounded = (word - format.data_offset() + rounding) >> format.guard_bits;
    let shown = rounded.clamp(-(1 << (format.storage_bits - 1)), (1 << (format.storage_bits - 1)) - 1);
    (shown, shown != rounded)
}
