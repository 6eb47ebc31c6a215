//! The network, control word by control word: registers and memories as the datasheet describes them.

use pe_ir::program::{Address, ControlWord, Layout, LinkSource, Multiplier, PeFeatures, Program};
use pe_ir::word::WordFormat;

use crate::trace::TraceLine;

/// Registers and memories of one PE.
struct Pe {
    /// Control words, decoded from their bits.
    words: Vec<ControlWord>,
    features: PeFeatures,
    ports: Vec<LinkSource>,
    own: Vec<i64>,
    base: Vec<i64>,
    coefficients: Vec<i64>,
    imported: Vec<i64>,
    /// Products on their way: the front one is accumulated next.
    products: std::collections::VecDeque<i128>,
    accumulator: i128,
    hold: i128,
    /// Base word and shift of the adder.
    scale: (i64, u32),
    sum: i128,
    /// Word of the write group and whether it saturated.
    result: (i64, bool),
    link: i64,
    overflow: bool,
}

/// The whole network.
pub struct Machine<'a> {
    program: &'a Program,
    pes: Vec<Pe>,
    inputs: Vec<i64>,
    input_overflow: bool,
    word: u32,
    cycle: u64,
    parity: bool,
    settle: bool,
    captured: Vec<i64>,
    outputs: Vec<i64>,
}

impl<'a> Machine<'a> {
    /// A network after configuration: the pipeline is filled up to the pause point.
    ///
    /// The control words pass through their bits, so that what runs is what the hardware's memory holds.
    pub fn new(program: &'a Program) -> Self {
        let bits: Vec<Vec<u128>> = program
            .pes
            .iter()
            .map(|pe| {
                let layout = Layout::new(&pe.features, &program.format);
                pe.words.iter().map(|word| layout.encode(word)).collect()
            })
            .collect();
        Self::with_bits(program, &bits)
    }

    /// A network that runs the given control-word bits in place of the program's own.
    pub fn with_bits(program: &'a Program, bits: &[Vec<u128>]) -> Self {
        let latency = program.latency();
        let pe = |(pe, bits): (&pe_ir::program::PeProgram, &Vec<u128>)| {
            let layout = Layout::new(&pe.features, &program.format);
            Pe {
                words: bits.iter().map(|bits| layout.decode(*bits)).collect(),
                features: pe.features.clone(),
                ports: pe.ports.clone(),
                own: pe.own_image.clone(),
                base: pe.base_image.clone(),
                coefficients: pe.coefficient_image.clone(),
                imported: pe.imported_image.clone(),
                products: std::iter::repeat_n(0, latency.accumulate() as usize).collect(),
                accumulator: 0,
                hold: 0,
                scale: (0, 0),
                sum: 0,
                result: (0, false),
                link: 0,
                overflow: false,
            }
        };
        let mut machine = Machine {
            program,
            pes: program.pes.iter().zip(bits).map(pe).collect(),
            inputs: vec![0; program.inputs.len()],
            input_overflow: false,
            word: 0,
            cycle: 0,
            parity: false,
            settle: true,
            captured: vec![0; program.outputs.len()],
            outputs: vec![0; program.outputs.len()],
        };
        for _ in 0..latency.pause() {
            machine.clock(&mut |_| {});
        }
        machine.settle = false;
        machine
    }

    /// Runs one step with the given input port words; every memory write goes to `trace`.
    pub fn step(&mut self, inputs: &[i64], trace: &mut impl FnMut(TraceLine)) {
        let pause = self.program.latency().pause();
        for (slot, word) in self.inputs.iter_mut().zip(inputs) {
            *slot = *word;
            let stored =
                (i128::from(*word) << self.program.format.guard_bits) + i128::from(self.program.format.data_offset());
            self.input_overflow |= stored > i128::from(self.program.format.max_word());
        }
        loop {
            self.clock(trace);
            if self.word == pause {
                break;
            }
        }
        self.outputs.clone_from(&self.captured);
    }

    /// Published outputs, port words.
    pub fn outputs(&self) -> &[i64] {
        &self.outputs
    }

    /// Whether the overflow output is set.
    pub fn overflow(&self) -> bool {
        self.input_overflow || self.pes.iter().any(|pe| pe.overflow)
    }

    /// Stored word of a state as the next step starts.
    pub fn state(&self, index: usize) -> i64 {
        let (pe, word) = self.program.states[index].own;
        let pe = &self.pes[pe as usize];
        pe.base[pe.features.base_word(word)]
    }

    /// Executes one control word in every PE.
    fn clock(&mut self, trace: &mut impl FnMut(TraceLine)) {
        let format = self.program.format;
        let links: Vec<i64> = self.pes.iter().map(|pe| pe.link).collect();
        let word_index = self.word as usize;
        for (index, pe) in self.pes.iter_mut().enumerate() {
            let word = pe.words[word_index];
            let own_depth = pe.own.len();
            let write = |address: u32, value: i64, bits: u32| TraceLine {
                cycle: self.cycle,
                pe: index as u32,
                address,
                value: value as u64 & (u64::MAX >> (64 - bits)),
            };
            // Reads come before the writes at the end of the word.
            let own_operand = word.own.map_or(0, |a| pe.own[physical(a, own_depth, self.parity)]);
            let imported_operand =
                word.imported.map_or(0, |a| pe.imported[physical(a, pe.imported.len(), self.parity)]);
            let second = match word.multiplier {
                Multiplier::Coefficient(value) => value,
                Multiplier::Stored(address) => pe.coefficients[usize::from(address)],
            };
            let base = match word.base {
                Some(word) => pe.base[usize::from(word)],
                None => format.data_offset(),
            };
            if let Some(target) = word.write.filter(|_| !self.settle) {
                // The swap bit turns the top bit of the own memory's address over, also in a wider write address.
                let slot = physical(target.address, own_depth, self.parity);
                if target.own {
                    pe.own[slot & (own_depth - 1)] = format.data_operand(pe.result.0);
                }
                if target.base {
                    let base = pe.features.base_word(target.address.word);
                    pe.base[base] = pe.result.0;
                }
                if target.factor {
                    let factor = pe.features.factor_word(target.address.word);
                    pe.coefficients[factor] = format.factor_operand(pe.result.0);
                }
                trace(write(slot as u32, pe.result.0, format.word_bits()));
            }
            if let Some((port, a)) = word.receive.filter(|_| !self.settle) {
                let value = match pe.ports[usize::from(port)] {
                    LinkSource::Pe(source) => links[source as usize],
                    LinkSource::Input(input) => format.input_operand(self.inputs[input as usize]),
                };
                let slot = physical(a, pe.imported.len(), self.parity);
                pe.imported[slot] = value;
                trace(write(pe.features.write_words() + slot as u32, value, format.data_bits));
            }
            // A value that is only sent must not saturate unseen either.
            pe.overflow |= pe.result.1 && !self.settle && (word.write.is_some() || word.send);
            if word.send {
                pe.link = format.data_operand(pe.result.0);
            }
            for (output, slot) in self.program.outputs.iter().zip(&mut self.captured) {
                if output.pe == index as u32 && output.word == self.word {
                    *slot = output_word(&format, pe.result.0);
                }
            }
            pe.result = saturate(&format, pe.sum);
            pe.sum = i128::from(pe.scale.0) + round(pe.hold << format.lift(), pe.scale.1);
            pe.scale = (base, pe.features.shifts.get(usize::from(word.shift)).copied().unwrap_or(0).into());
            let product = pe.products.pop_front().unwrap_or(0);
            if word.close {
                pe.hold = pe.accumulator;
                pe.accumulator = 0;
            }
            pe.accumulator = wrap(pe.accumulator + product, pe.features.accumulator_bits);
            pe.products.push_back(i128::from(own_operand + imported_operand) * i128::from(second));
        }
        self.cycle += 1;
        self.word += 1;
        if self.word == self.program.period {
            self.word = 0;
            self.parity = !self.parity;
        }
    }
}

/// Memory index of an address: the top bit of a swapping address is inverted in odd steps.
fn physical(address: Address, depth: usize, parity: bool) -> usize {
    let index = usize::from(address.word);
    if address.swap && parity { index ^ (depth / 2) } else { index }
}

/// The low `bits` of a sum as a signed number; the formats keep valid programs clear of it.
fn wrap(sum: i128, bits: u32) -> i128 {
    (sum << (128 - bits)) >> (128 - bits)
}

fn round(hold: i128, shift: u32) -> i128 {
    if shift == 0 { hold } else { ((hold >> (shift - 1)) + 1) >> 1 }
}

fn saturate(format: &WordFormat, sum: i128) -> (i64, bool) {
    if sum > i128::from(format.max_word()) {
        (format.ceiling(), true)
    } else if sum < i128::from(format.min_word()) {
        (format.min_word(), true)
    } else {
        (sum as i64, false)
    }
}

/// What an output port shows of a stored word.
pub fn output_word(format: &WordFormat, word: i64) -> i64 {
    let rounding = if format.guard_bits == 0 { 0 } else { 1 << (format.guard_bits - 1) };
    let rounded = (word - format.data_offset() + rounding) >> format.guard_bits;
    rounded.clamp(-(1 << (format.storage_bits - 1)), (1 << (format.storage_bits - 1)) - 1)
}
