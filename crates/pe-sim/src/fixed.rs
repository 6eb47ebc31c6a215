//! The step graph in fixed point: bit for bit what the hardware computes, without its timing.

use pe_ir::graph::{FixedPoint, Role, StepGraph, ValueId};
use pe_ir::word::{WordFormat, round_shift};

use crate::code::{Code, WriteCode};

/// A run in fixed point.
pub struct FixedRun<'a> {
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    code: Code,
    coefficients: Vec<i64>,
    /// For each chain of the code its shifts, and whether its sum needs more than 64 bits.
    writes: Vec<([u8; 2], bool)>,
    /// Stored words, one slot per value and the rounding offset as the missing base.
    words: Vec<i64>,
    saturations: Vec<u64>,
}

impl<'a> FixedRun<'a> {
    /// Starts a run from the initial values.
    pub fn new(graph: &'a StepGraph, fixed: &'a FixedPoint) -> Self {
        let code = Code::new(graph);
        let coefficients = code.terms.iter().map(|term| fixed.coefficients[*term as usize]).collect();
        let mut words = vec![0; graph.values.len() + 1];
        words[code.zero as usize] = fixed.format.data_offset();
        for (index, value) in graph.values.iter().enumerate() {
            if let Role::Constant(_) = value.role {
                words[index] = fixed.constant_word(graph, ValueId(index as u32));
            }
        }
        let of_chain = |chain: &crate::code::ChainCode| {
            let index = chain.index as usize;
            (fixed.shifts[index], fixed.accumulator_bits[index] > 64)
        };
        let writes = code.chains.iter().map(of_chain).collect();
        let mut run = FixedRun { graph, fixed, code, coefficients, writes, saturations: vec![0; words.len()], words };
        for (index, initial) in graph.initial.iter().enumerate() {
            let id = graph.states[index].0;
            let (word, saturated) =
                fixed.format.encode(*initial, fixed.exponents[id.index()], fixed.format.data_offset());
            run.words[id.index()] = word;
            run.saturations[id.index()] += u64::from(saturated);
        }
        run
    }

    /// The input port's word for a number: `storage_bits` wide, rounded; the flag tells whether it saturated.
    pub fn encode_input(&self, index: usize, number: f64) -> (i64, bool) {
        let id = self.graph.inputs[index];
        encode_port(&self.fixed.format, self.fixed.exponents[id.index()], number)
    }

    /// The number a state stands for at the start of the next step.
    pub fn state(&self, index: usize) -> f64 {
        self.number(self.graph.states[index].0)
    }

    /// The number a published output stands for.
    pub fn output(&self, index: usize) -> f64 {
        self.number(self.graph.outputs[index])
    }

    /// Stored word of a value.
    pub fn word(&self, id: ValueId) -> i64 {
        self.words[id.index()]
    }

    /// How often each value saturated so far.
    pub fn saturations(&self) -> &[u64] {
        &self.saturations[..self.graph.values.len()]
    }

    fn number(&self, id: ValueId) -> f64 {
        let offset = self.fixed.offset(self.graph.value(id));
        self.fixed.format.decode(self.words[id.index()], self.fixed.exponents[id.index()], offset)
    }

    /// Advances by one step. `inputs` are port words; returns whether a value saturated.
    pub fn step(&mut self, inputs: &[i64]) -> bool {
        let format = self.fixed.format;
        let (data_drop, factor_drop, lift) = (format.data_drop(), format.factor_drop(), format.lift());
        for (value, word) in self.graph.inputs.iter().zip(inputs) {
            self.words[value.index()] = format.input_operand(*word) << data_drop;
        }
        let mut saturated = false;
        for (chain, (shifts, wide)) in self.code.chains.iter().zip(&self.writes) {
            let products = chain.coefficients.start as usize..chain.coefficients.end as usize;
            let factors = chain.factors.start as usize..chain.factors.end as usize;
            let rounded = if *wide {
                let mut sum = 0i128;
                for i in products.start..factors.end {
                    let second = match self.code.factors[i] {
                        slot if slot == self.code.zero => self.coefficients[i],
                        slot => self.words[slot as usize] >> factor_drop,
                    };
                    sum += i128::from(self.words[self.code.operands[i] as usize] >> data_drop) * i128::from(second);
                }
                shifts.map(|shift| round_shift_wide(sum << lift, u32::from(shift)))
            } else {
                let mut sum = 0i64;
                let operands = &self.code.operands[products.clone()];
                for (operand, coefficient) in operands.iter().zip(&self.coefficients[products]) {
                    sum += (self.words[*operand as usize] >> data_drop) * coefficient;
                }
                for i in factors {
                    let factor = self.words[self.code.factors[i] as usize] >> factor_drop;
                    sum += (self.words[self.code.operands[i] as usize] >> data_drop) * factor;
                }
                shifts.map(|shift| round_shift(sum << lift, u32::from(shift)))
            };
            saturated |= write(&mut self.words, &mut self.saturations, &format, &chain.write, rounded[0]);
            if let Some(second) = &chain.second {
                saturated |= write(&mut self.words, &mut self.saturations, &format, second, rounded[1]);
            }
        }
        for (state, next) in &self.graph.states {
            self.words[state.index()] = self.words[next.index()];
        }
        saturated
    }
}

/// The `storage_bits` word of an input or output port for a number.
pub fn encode_port(format: &WordFormat, exponent: i32, number: f64) -> (i64, bool) {
    let port = WordFormat { guard_bits: 0, ..*format };
    port.encode(number, exponent + format.guard_bits as i32, 0)
}

/// Sums of more than 64 bits fit 64 once they are shifted: the formats keep what a write adds near its range.
fn round_shift_wide(sum: i128, shift: u32) -> i64 {
    let rounded = if shift == 0 { sum } else { ((sum >> (shift - 1)) + 1) >> 1 };
    rounded.clamp(i128::from(i64::MIN / 2), i128::from(i64::MAX / 2)) as i64
}

fn write(words: &mut [i64], saturations: &mut [u64], format: &WordFormat, write: &WriteCode, rounded: i64) -> bool {
    let (word, saturated) = format.add(words[write.base as usize], rounded);
    words[write.value as usize] = word;
    saturations[write.value as usize] += u64::from(saturated);
    saturated
}
