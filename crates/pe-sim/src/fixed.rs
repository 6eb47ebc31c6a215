//! The step graph in fixed point: bit for bit what the hardware computes, without its timing.

use pe_ir::graph::{Chain, FixedPoint, Role, StepGraph, ValueId};
use pe_ir::index::{ChainId, List, StateId, at};
use pe_ir::pasts::Pasts;
use pe_ir::word::WordFormat;

use crate::rows::Kept;
use crate::slots::Slots;
use crate::tape::Tape;
use crate::words::{self, Port, Words};

/// A run in fixed point.
pub struct FixedRun<'a> {
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    slots: Slots,
    state: Ports,
    /// Words of long rows of the past.
    past: Kept<i64>,
    /// Of each state the word that stands for zero, and what a unit stands for; their words come first.
    units: Vec<(i64, f64)>,
    /// The same of each output, with its slot.
    outputs: Vec<(u32, i64, f64)>,
    /// Whether each state is in a ring.
    rings: List<StateId, bool>,
}

/// Words and the tape, as wide as the multiplier's ports need.
enum Ports {
    Short(Words<i32>, Tape<i32>),
    Long(Words<i64>, Tape<i64>),
}

/// Applies the same expression to either width.
macro_rules! on_words {
    ($state:expr, $words:ident => $result:expr) => {
        match $state {
            Ports::Short($words, _) => $result,
            Ports::Long($words, _) => $result,
        }
    };
}

impl<'a> FixedRun<'a> {
    /// Starts a run from the initial values.
    pub fn new(graph: &'a StepGraph, fixed: &'a FixedPoint) -> Self {
        FixedRun::with_room(graph, fixed, 0)
    }

    /// The same with words and ports that have `room` bits more at the top: nothing saturates that is not as far beyond its
    /// range, and all is rounded at the same LSB. Arguments of tables still choose among the segments that there are.
    pub(crate) fn with_room(graph: &'a StepGraph, fixed: &'a FixedPoint, room: u32) -> Self {
        let kind = |value: ValueId| 2 * fixed.exponents[value.index()] + i32::from(graph.value(value).factor);
        let copies = |index: ChainId, chain: &Chain| {
            let (from, to) = (graph.chain_terms(chain)[0].operand, chain.write.value);
            let alike = fixed.exponents[from.index()] == fixed.exponents[to.index()];
            let is_one = fixed.coefficient_value(graph, index, at(chain.terms.start)) == 1.0;
            alike && is_one && !graph.value(to).factor && !graph.value(from).factor
        };
        let slots = Slots::new(graph, kind, copies);
        let state = if fixed.format.data_bits.max(fixed.format.coefficient_bits) + room <= 32 {
            let (words, tape) = prepare(graph, fixed, &slots, room);
            Ports::Short(words, tape)
        } else {
            let (words, tape) = prepare(graph, fixed, &slots, room);
            Ports::Long(words, tape)
        };
        let unit = |id: ValueId| (fixed.offset(graph.value(id)), libm::scalbn(1.0, fixed.exponents[id.index()]));
        let units = graph.states.iter().map(|(state, _)| unit(*state)).collect();
        let output = |id: &ValueId| {
            let (zero, unit) = unit(*id);
            (slots.of(*id), zero, unit)
        };
        let outputs = graph.outputs.iter().map(output).collect();
        let pasts = Pasts::of(graph);
        let rings = graph.states.ids().map(|state| pasts.find(state).is_some()).collect();
        let past = slots.rows().kept(0);
        let mut run = FixedRun { graph, fixed, slots, state, past, units, outputs, rings };
        for (index, initial) in graph.initial.numbered() {
            let id = graph.states[index].0;
            let saturated = run.take_state(index, *initial);
            let slot = at(run.slots.of(id));
            on_words!(&mut run.state, words => words.saturations[slot] += u64::from(saturated));
        }
        run
    }

    fn set(&mut self, id: ValueId, word: i64) {
        let slot = at(self.slots.of(id));
        on_words!(&mut self.state, words => words.set(slot, word));
        self.past.set(self.slots.rows(), slot, word);
    }

    /// Puts a number in the place of a state's.
    pub fn set_state(&mut self, index: StateId, number: f64) {
        self.take_state(index, number);
    }

    /// The same; whether it saturated.
    fn take_state(&mut self, index: StateId, number: f64) -> bool {
        let id = self.graph.states[index].0;
        let (exponent, format) = (self.fixed.exponents[id.index()], &self.fixed.format);
        let (word, saturated) = format.encode(number, exponent, format.data_offset());
        // Rings keep operands.
        let in_ring = self.rings[index];
        self.set(id, if in_ring { format.operand_word(format.data_operand(word)) } else { word });
        saturated
    }

    /// The input port's word for a number: `storage_bits` wide, rounded; the flag tells whether it saturated.
    pub fn encode_input(&self, index: usize, number: f64) -> (i64, bool) {
        let id = self.graph.inputs[index];
        encode_port(&self.fixed.format, self.fixed.exponents[id.index()], number)
    }

    /// The number a state stands for at the start of the next step.
    pub fn state(&self, index: StateId) -> f64 {
        self.number(self.graph.states[index].0)
    }

    /// The numbers that all states stand for at the start of the next step, those of the model first.
    pub fn states(&self) -> impl Iterator<Item = f64> {
        let words = on_words!(&self.state, words => &words.words);
        let word = |slot: usize| self.past.number(self.slots.rows(), slot, words);
        self.units.iter().enumerate().map(move |(slot, (zero, unit))| (word(slot) - zero) as f64 * unit)
    }

    /// The number a published output stands for.
    pub fn output(&self, index: usize) -> f64 {
        let (slot, zero, unit) = self.outputs[index];
        let word = on_words!(&self.state, words => words.words[at(slot)]);
        (word - zero) as f64 * unit
    }

    /// Stored word of a value.
    pub fn word(&self, id: ValueId) -> i64 {
        let words = on_words!(&self.state, words => &words.words);
        self.past.number(self.slots.rows(), at(self.slots.of(id)), words)
    }

    /// How often each value saturated so far.
    pub fn saturations(&self) -> Vec<u64> {
        on_words!(&self.state, words => self.slots.in_graph_order(&words.saturations))
    }

    /// Raises `peaks`, one for each slot, to the words of the latest step and of the states after it; a negative word counts
    /// as the positive one that needs as many bits.
    pub(crate) fn raise(&self, peaks: &mut Vec<i64>) {
        let words = on_words!(&self.state, words => &words.words);
        peaks.resize(words.len(), 0);
        for (peak, word) in peaks.iter_mut().zip(words) {
            *peak = (*peak).max(word ^ (word >> (i64::BITS - 1)));
        }
    }

    /// The largest words of all values, in the order of the graph, from those of all slots.
    pub(crate) fn largest_in_graph_order(&self, mut peaks: Vec<i64>) -> Vec<i64> {
        self.slots.rows().spread(&mut peaks);
        self.slots.in_graph_order(&peaks)
    }

    /// The number that a value stands for: of the latest step, but for states, which are those of the next.
    pub fn number(&self, id: ValueId) -> f64 {
        let offset = self.fixed.offset(self.graph.value(id));
        self.fixed.format.decode(self.word(id), self.fixed.exponents[id.index()], offset)
    }

    /// Advances by one step. `inputs` are port words; returns whether a value saturated.
    pub fn step(&mut self, inputs: &[i64]) -> bool {
        let format = self.fixed.format;
        for (value, word) in self.graph.inputs.iter().zip(inputs) {
            self.set(*value, format.input_operand(*word) << format.data_drop());
        }
        match &mut self.state {
            Ports::Short(words, tape) => step(words, tape, &format, (&self.slots, &mut self.past)),
            Ports::Long(words, tape) => step(words, tape, &format, (&self.slots, &mut self.past)),
        }
    }
}

fn prepare<P: Port>(graph: &StepGraph, fixed: &FixedPoint, slots: &Slots, room: u32) -> (Words<P>, Tape<P>) {
    // Either factor of a product may use the room.
    let tiles = slots.arrange(
        graph,
        |index, _| words::class(&fixed.format, u32::from(fixed.accumulator_bits[index]) + 2 * room, false),
        |term| P::of(fixed.coefficients[term]),
        |index, position, _| i32::from(fixed.shifts[index][position]),
    );
    let has_factors = graph.values.iter().any(|value| value.factor);
    let mut words = Words::new(fixed.format, slots.count(), has_factors).with_room(room);
    words.set(at(slots.zero()), fixed.format.data_offset());
    for (index, value) in graph.values.iter().enumerate() {
        let id = ValueId::at(index);
        if let Role::Constant(_) = value.role {
            words.set(at(slots.of(id)), fixed.constant_word(graph, id));
        }
    }
    for (value, segment, slot) in slots.column_entries(graph) {
        words.set(at(slot), fixed.column_word(graph, value, segment));
    }
    (words, Tape::new(tiles))
}

fn step<P: Port>(
    words: &mut Words<P>,
    tape: &Tape<P>,
    format: &WordFormat,
    (slots, past): (&Slots, &mut Kept<i64>),
) -> bool {
    let saturated = words.run(tape, &[], &mut []);
    past.advance(slots.rows(), &words.words, |word| format.operand_word(format.data_operand(word)));
    slots.copy(&mut words.words);
    slots.copy(&mut words.data);
    past.show(slots.rows(), |slot, word| words.set(slot, word));
    saturated
}

/// The `storage_bits` word of an input or output port for a number.
pub fn encode_port(format: &WordFormat, exponent: i32, number: f64) -> (i64, bool) {
    let port = WordFormat { guard_bits: 0, ..*format };
    port.encode(number, exponent + format.guard_bits as i32, 0)
}
