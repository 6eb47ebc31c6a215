//! The network, clock by clock: every register as the datasheet describes it, with nothing computed ahead.
//!
//! [`crate::machine`] runs what a step computes; this runs how. It is slower, and knows what the other does not: which
//! PE's flag is set when, sums of operands that wrapped, and what was at work ([`Coverage`]).

mod registers;

use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::Arc;

use pe_ir::index::{List, PeId, StateId, at, number};
use pe_ir::program::{ControlWord, FieldName, Fold, Layout, LinkSource, PeProgram, Program};
use pe_ir::word::Pipeline;

use crate::coverage::{Coverage, OPERANDS, alone, bit, takes, used_results};
use crate::trace::TraceLine;
use registers::{Clock, Registers};

/// What set a sticky flag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Causes {
    /// A word that was written or sent saturated.
    pub saturated: bool,
    /// An operand was too large for a sum of two.
    pub operand: bool,
    /// An input was too large for a data operand.
    pub input: bool,
}

/// What follows from the control words of a program alone: many runs with other images have it in common.
pub struct Control {
    words: List<PeId, Vec<ControlWord>>,
    used: List<PeId, Vec<bool>>,
    captures: BTreeMap<(PeId, usize), Vec<usize>>,
}

impl Control {
    /// That of a program. Control words pass through their bits.
    pub fn of(program: &Program) -> Arc<Control> {
        let decode = |pe: &PeProgram| -> Vec<ControlWord> {
            let (fold, layout) = (Fold::of(program, pe), Layout::new(&pe.features, &program.format));
            (0..program.period as usize).map(|k| layout.decode(fold.word(k))).collect()
        };
        let mut captures: BTreeMap<(PeId, usize), Vec<usize>> = BTreeMap::new();
        for (index, output) in program.outputs.iter().enumerate().filter(|(_, output)| output.place.is_none()) {
            captures.entry((output.pe, at(output.word))).or_default().push(index);
        }
        let words = program.pes.iter().map(decode).collect();
        Arc::new(Control { words, used: used_results(program), captures })
    }
}

/// The whole network; `P` is a reference to its program, or shares it.
pub struct Clocked<P> {
    program: P,
    control: Arc<Control>,
    pes: List<PeId, Registers>,
    links: List<PeId, i64>,
    inputs: Vec<i64>,
    captured: Vec<i64>,
    /// Words that each PE has shown in this step, for outputs in memories.
    shown: List<PeId, Vec<i64>>,
    word: usize,
    cycle: u64,
    odd: bool,
    /// Steps whose control words were all executed: rings move on behind the last word.
    turns: u64,
    settle: bool,
    steps: u64,
    overflow_cycle: Option<u64>,
    /// PEs, then inputs, that raised it in that cycle.
    raised_by: Vec<usize>,
    causes: Causes,
    wrapped: bool,
    escaped: bool,
    coverage: Coverage,
}

impl<P: Deref<Target = Program>> Clocked<P> {
    /// A network after configuration, at the pause point.
    pub fn new(program: P) -> Clocked<P> {
        Clocked::controlled(Control::of(&program), program)
    }

    /// The same, where what the control words say is known: `control` must be that of a program with the same ones, also
    /// in its outputs and features.
    pub fn controlled(control: Arc<Control>, program: P) -> Clocked<P> {
        let deep = program.format.pipeline == Pipeline::Deep;
        let pe = |pe: &PeProgram| Registers {
            own: pe.own_image.clone(),
            base_words: pe.base_image.clone(),
            coefficients: pe.coefficient_image.clone(),
            imported: pe.imported_image.clone(),
            indices: vec![0; at(pe.features.index_words)],
            products: vec![0; at(program.latency().product()) + 1],
            accumulator: 0,
            hold: 0,
            base: 0,
            shift: 0,
            addends: (0, 0),
            sum: 0,
            word: 0,
            exact: 0,
            sums: vec![0; at(program.period)],
            operands: vec![[0; 2]; at(program.period)],
            saturated: 0,
            index: 0,
            too_large: vec![false; if deep { 2 } else { 1 }],
            overflow: false,
            causes: [None; 2],
            unsent: BTreeMap::new(),
        };
        let pause = program.latency().pause();
        let mut network = Clocked {
            control,
            pes: program.pes.iter().map(pe).collect(),
            links: List::filled(0, program.pes.len()),
            inputs: vec![0; program.inputs.len()],
            captured: vec![0; program.outputs.len()],
            shown: program.pes.iter().map(|_| Vec::new()).collect(),
            word: 0,
            cycle: 0,
            odd: false,
            turns: 0,
            settle: true,
            steps: 0,
            overflow_cycle: None,
            raised_by: Vec::new(),
            causes: Causes::default(),
            wrapped: false,
            escaped: false,
            coverage: Coverage::none(&program),
            program,
        };
        (0..pause).for_each(|_| network.clock(&mut |_| {}));
        network.settle = false;
        network
    }

    /// Runs one step with the words of the input ports; every memory write goes to `trace`.
    pub fn step(&mut self, inputs: &[i64], trace: &mut impl FnMut(TraceLine)) {
        let first = self.cycle;
        self.clock(trace);
        self.sample(inputs, first);
        (1..self.program.period).for_each(|_| self.clock(trace));
        self.steps += 1;
        for (index, output) in self.program.outputs.iter().enumerate() {
            if let Some(place) = output.place {
                self.captured[index] = self.shown[output.pe][usize::from(place)];
            }
        }
        self.shown.iter_mut().for_each(Vec::clear);
        let mask = u64::MAX >> (64 - self.program.format.storage_bits);
        for (index, seen) in (0..).zip(&mut self.coverage.outputs) {
            let (word, clamped) = shown(&self.program, self.captured[index]);
            let word = word as u64;
            seen[0] |= word & mask;
            seen[1] |= !word & mask;
            self.coverage.shown_clamped[index] |= clamped;
            self.escaped |= clamped && self.program.outputs[index].proven;
        }
    }

    /// Published outputs, port words.
    pub fn outputs(&self) -> Vec<i64> {
        self.captured.iter().map(|word| shown(&self.program, *word).0).collect()
    }

    /// PEs whose sticky flag is set.
    pub fn flags(&self) -> Vec<PeId> {
        self.pes.numbered().filter(|(_, pe)| pe.overflow).map(|(index, _)| index).collect()
    }

    /// What set the flags.
    pub fn causes(&self) -> Causes {
        self.causes
    }

    /// Clears what set the flags, and that a number escaped.
    pub fn clear_causes(&mut self) {
        (self.causes, self.escaped) = (Causes::default(), false);
    }

    /// Stored word of a state as the next step starts.
    pub fn state(&self, index: StateId) -> i64 {
        let state = &self.program.states[index];
        let ((pe, word), features) = (state.own, &self.program.pes[state.own.0].features);
        match state.age {
            None => self.pes[pe].base_words[features.state_base(word)],
            Some(_) => {
                let operand = self.pes[pe].own[usize::from(state.own_word(features, self.turns))];
                self.program.format.operand_word(operand)
            }
        }
    }

    /// The control word, counted as in traces, with which the overflow flag rose.
    pub fn overflow_cycle(&self) -> Option<u64> {
        self.overflow_cycle
    }

    /// Sums from which the words at a PE's memories were made before they saturated, one for each control word of the
    /// last step.
    pub fn sums(&self, pe: PeId) -> &[i128] {
        &self.pes[pe].sums
    }

    /// Own and imported operand of a PE, 0 if there is none, one pair for each control word of the last step.
    pub fn operands(&self, pe: PeId) -> &[[i64; 2]] {
        &self.pes[pe].operands
    }

    /// Whether a sum of two operands wrapped: [`crate::machine`] knows such sums no longer.
    pub fn wrapped(&self) -> bool {
        self.wrapped
    }

    /// Whether a word of a PE that does not saturate was out of range, which was proven impossible of the design's
    /// runs.
    pub fn escaped(&self) -> bool {
        self.escaped
    }

    /// What was at work so far.
    pub fn coverage(&self) -> Coverage {
        let mut coverage = self.coverage.clone();
        let first = match self.raised_by[..] {
            [source] => Some(source),
            _ => None,
        };
        if let Some(source) = first {
            coverage.raised[source] = true;
        }
        // A flag is compared as the run ends, and that of the network in every clock.
        for ((index, pe), cover) in self.pes.numbered().zip(&mut coverage.pes) {
            let [began, all] = pe.causes;
            let seen = all.or(began.filter(|_| first == Some(index.index())));
            seen.into_iter().for_each(|cause| cover.flagged[cause] = true);
            let hidden = |cycle: u64| pe.overflow && self.overflow_cycle.is_some_and(|first| first <= cycle);
            pe.unsent.iter().filter(|(_, cycle)| !hidden(**cycle)).for_each(|(word, _)| cover.unsent[*word] = true);
        }
        coverage
    }

    /// A PE, or behind the PEs an input, sets its flag.
    fn flag(&mut self, cycle: u64, source: usize) {
        if *self.overflow_cycle.get_or_insert(cycle) == cycle {
            self.raised_by.push(source);
        }
    }

    /// Inputs load their operands at the end of the step's first word.
    fn sample(&mut self, words: &[i64], cycle: u64) {
        let format = &self.program.format;
        let mask = u64::MAX >> (64 - format.storage_bits);
        let mut flagged = Vec::new();
        for (index, word) in words.iter().enumerate().take(self.coverage.inputs.len()) {
            let stored = (i128::from(*word) << format.guard_bits) + i128::from(format.data_offset());
            let beyond = stored > i128::from(format.max_word());
            if beyond {
                flagged.push(self.pes.len() + index);
            }
            self.coverage.clamped[index] |= beyond;
            self.causes.input |= beyond;
            self.coverage.inputs[index][0] |= *word as u64 & mask;
            self.coverage.inputs[index][1] |= !*word as u64 & mask;
            self.inputs[index] = format.input_operand(*word);
        }
        for (number, (index, tick, one)) in self.program.ticks().enumerate() {
            let due = tick.is_due(self.steps);
            self.coverage.ticks[number][usize::from(due)] = true;
            self.inputs[at(index)] = if due { format.input_operand(one) } else { 0 };
        }
        flagged.into_iter().for_each(|source| self.flag(cycle, source));
    }

    /// Executes one control word in every PE.
    fn clock(&mut self, trace: &mut impl FnMut(TraceLine)) {
        let ends_step = self.program.ends_step(number(self.word));
        let links = self.links.clone();
        for pe in self.pes.ids() {
            if self.execute(pe, ends_step, &links, trace) {
                self.flag(self.cycle, pe.index());
            }
        }
        self.cycle += 1;
        self.word += 1;
        if number(self.word).is_multiple_of(self.program.round_words()) {
            self.odd = !self.odd;
        }
        if self.word == at(self.program.period) {
            self.word = 0;
            self.turns += 1;
        }
    }

    /// Executes the control word in one PE; whether it sets the PE's flag.
    fn execute(
        &mut self,
        index: PeId,
        ends_step: bool,
        links: &List<PeId, i64>,
        trace: &mut impl FnMut(TraceLine),
    ) -> bool {
        let (program, settle): (&Program, bool) = (&self.program, self.settle);
        let (format, features) = (&program.format, &program.pes[index].features);
        let control = &*self.control;
        let (word, used) = (&control.words[index][self.word], control.used[index][self.word]);
        let turn = (self.odd, self.turns);
        let clock = Clock { program, pe: index, word, used, turn, ends_step, cycle: self.cycle };
        let pe = &mut self.pes[index];
        let cover = &mut self.coverage.pes[index];
        let reads = pe.read(&clock);
        let mut fields = clock.reads_at_work(&reads, pe, cover);
        // The result that is at the memories now.
        let (result, saturated) = (pe.word, pe.saturated);
        pe.sums[self.word] = pe.exact;
        pe.operands[self.word] = [reads.own, reads.imported].map(|read| read.map_or(0, |(_, value)| value));
        pe.round(format, features);
        fields |= pe.accumulate(&clock, &reads, cover);
        let (too_large, joined_too_large) = pe.multiply(&clock, &reads);
        cover.too_large |= too_large && !settle;
        self.wrapped |= too_large;
        let mut flag = joined_too_large;
        if word.send {
            let operand = format.data_operand(result);
            if operand != self.links[index] {
                fields |= bit(FieldName::Send);
            }
            self.links[index] = operand;
        }
        if !settle {
            self.causes.operand |= joined_too_large;
            let taken = takes(word, features.base_last && !ends_step, joined_too_large);
            if saturated != 0 && (word.write.is_some() || word.write_index.is_some() || word.send) {
                flag = true;
                self.causes.saturated = true;
                cover.saturated[usize::from(saturated > 0)] = true;
            } else if saturated != 0 && features.send {
                pe.unsent.entry(self.word).or_insert(self.cycle);
            }
            if flag {
                pe.tell_cause(if saturated == 0 { Some(OPERANDS) } else { alone(taken) });
            }
            let source = |source: &LinkSource| match source {
                LinkSource::Pe(sender) => links[*sender],
                LinkSource::Input(input) => self.inputs[at(*input)],
            };
            fields |= pe.write(&clock, result, cover, trace);
            fields |= pe.receive(&clock, source, cover, trace);
            fields |= pe.write_index(&clock, result, cover);
            cover.fields[self.word] |= fields;
        }
        if let Some(outputs) = control.captures.get(&(index, self.word)) {
            outputs.iter().for_each(|output| self.captured[*output] = result);
        }
        // Bits of the control word decide, not what the outputs say of them.
        if word.show && !settle && (ends_step || !features.show_last) {
            self.shown[index].push(result);
            cover.fields[self.word] |= bit(FieldName::Show);
        }
        flag &= !settle;
        self.escaped |= flag && features.proven;
        pe.overflow |= flag;
        flag
    }
}

/// Port word of an output, and whether it is clamped.
fn shown(program: &Program, word: i64) -> (i64, bool) {
    let format = &program.format;
    let half = if format.guard_bits == 0 { 0 } else { 1 << (format.guard_bits - 1) };
    let largest = (1i64 << (format.storage_bits - 1)) - 1;
    let rounded = (word - format.data_offset() + half) >> format.guard_bits;
    (rounded.clamp(-largest - 1, largest), !(-largest - 1..=largest).contains(&rounded))
}
