//! A step that is affine in states and inputs, as sums of integers.

use crate::graph::{Chain, Factor, FixedPoint, Role, StepGraph, ValueId};
use crate::index::{ChainId, at};

/// Half the distance between neighbouring numbers near one.
pub(super) const UNIT: f64 = f64::EPSILON / 2.0;

/// An upper bound of what was computed with so many roundings, all of numbers that are not negative.
pub(super) fn up(computed: f64, roundings: usize) -> f64 {
    computed * (1.0 + 2.0 * (roundings as f64 + 2.0) * UNIT) + f64::MIN_POSITIVE
}

/// `number(target) := number(base) + scale * sum`.
#[derive(Clone, Copy)]
pub(super) struct Store {
    pub target: ValueId,
    pub base: Option<ValueId>,
    /// A power of two.
    pub scale: f64,
    /// Most by which rounding moves the number.
    pub rounding: f64,
}

/// The sum of a chain, in its terms and its writes.
pub(super) struct Sum {
    pub terms: std::ops::Range<usize>,
    pub stores: std::ops::Range<usize>,
}

/// The step in units of the LSB of each value. The *number* of a word is the word less its rounding offset; an operand
/// is the number of its word moved by at most `seen`.
pub(super) struct System {
    pub sums: Vec<Sum>,
    /// Operand and coefficient; exact.
    pub terms: Vec<(ValueId, f64)>,
    pub stores: Vec<Store>,
    /// Number of values.
    pub values: usize,
    /// Values of the states at the start and at the end of the step.
    pub states: Vec<(ValueId, ValueId)>,
    /// For each state its initial number, rounded to a double.
    pub initial: Vec<f64>,
    pub inputs: Vec<ValueId>,
    /// Constants and their numbers.
    pub constants: Vec<(u32, f64)>,
    /// Largest magnitude that an input port can show.
    pub input: f64,
    /// Most by which the data port's view of a word differs from the word's number.
    pub seen: f64,
}

/// Magnitudes of a row: state, coefficient, and what it would be if no contributions cancelled.
pub(super) type Row = Vec<(u32, f64, f64)>;

impl System {
    /// `None` if the step multiplies two values, looks functions up, or adds to an input.
    pub fn of(graph: &StepGraph, fixed: &FixedPoint) -> Option<System> {
        let format = &fixed.format;
        let mut system = System {
            sums: Vec::with_capacity(graph.chains.len()),
            terms: Vec::with_capacity(graph.terms.len()),
            stores: Vec::with_capacity(graph.chains.len()),
            values: graph.values.len(),
            states: graph.states.to_vec(),
            initial: Vec::new(),
            inputs: graph.inputs.clone(),
            constants: Vec::new(),
            input: libm::scalbn(1.0, format.word_bits() as i32 - 1),
            seen: format.data_offset() as f64,
        };
        if graph.values.iter().any(|value| value.factor || matches!(value.role, Role::Column(..))) {
            return None;
        }
        for (index, chain) in graph.chains.numbered() {
            system.add(graph, fixed, index, chain)?;
        }
        for (initial, (start, _)) in graph.initial.iter().zip(&graph.states) {
            let (word, _) = format.encode(*initial, fixed.exponents[start.index()], format.data_offset());
            system.initial.push((word - format.data_offset()) as f64);
        }
        for (index, value) in (0..).zip(&graph.values) {
            if let Role::Constant(_) = value.role {
                let word = fixed.constant_word(graph, ValueId::new(index));
                system.constants.push((index, (word - format.data_offset()) as f64));
            }
        }
        Some(system)
    }

    fn add(&mut self, graph: &StepGraph, fixed: &FixedPoint, index: ChainId, chain: &Chain) -> Option<()> {
        if chain.function.is_some() {
            return None;
        }
        let (terms, stores) = (self.terms.len(), self.stores.len());
        for term in chain.terms.clone() {
            let Factor::Coefficient(_) = graph.terms[at(term)].factor else { return None };
            // A pair has one coefficient for two operands.
            for operand in graph.terms[at(term)].operands() {
                self.terms.push((operand, fixed.coefficients[at(term)] as f64));
            }
        }
        let (left, drop) = (fixed.format.left_shift() as i32, fixed.format.data_drop() as i32);
        for (write, shift) in chain.writes().zip(fixed.shifts[index]) {
            if write.base.is_some_and(|base| matches!(graph.value(base).role, Role::Input(_))) {
                return None;
            }
            let shift = left - i32::from(shift);
            self.stores.push(Store {
                target: write.value,
                base: write.base,
                // Terms count in units of the words' LSB, of which the port drops some bits.
                scale: libm::scalbn(1.0, shift - drop),
                rounding: if shift < 0 { 0.5 } else { 0.0 },
            });
        }
        self.sums.push(Sum { terms: terms..self.terms.len(), stores: stores..self.stores.len() });
        Some(())
    }

    /// Bounds of the errors of all values in a step, from those of the states at its start: what reads them passes them
    /// on by the magnitudes of its coefficients. With `rounds` the words round as well. Magnitudes of the values in
    /// `moved`, if given, add what double precision rounds in a run of such values.
    pub fn errors(&self, states: &[f64], rounds: bool, moved: Option<&[f64]>) -> Vec<f64> {
        let mut errors = vec![0.0; self.values];
        for ((start, _), error) in self.states.iter().zip(states) {
            errors[start.index()] = *error;
        }
        let seen = if rounds { self.seen } else { 0.0 };
        for sum in &self.sums {
            let terms = &self.terms[sum.terms.clone()];
            let (mut error, mut size) = (0.0, 0.0);
            for (operand, coefficient) in terms {
                error += coefficient.abs() * (errors[operand.index()] + seen);
                size += moved.map_or(0.0, |moved| coefficient.abs() * moved[operand.index()]);
            }
            for store in &self.stores[sum.stores.clone()] {
                let base = |of: &[f64]| store.base.map_or(0.0, |base| of[base.index()]);
                let magnitude = moved.map_or(0.0, &base) + store.scale * size;
                let arithmetic = 2.0 * (terms.len() as f64 + 3.0) * UNIT * magnitude;
                let rounding = if rounds { store.rounding } else { 0.0 };
                errors[store.target.index()] =
                    up(base(&errors) + store.scale * error + rounding + arithmetic, terms.len() + 6);
            }
        }
        errors
    }

    /// For each value whether it comes from no write of a value for which `leaves` is true, in this step or an earlier one.
    pub fn untouched(&self, leaves: impl Fn(ValueId) -> bool) -> Vec<bool> {
        let mut stays = vec![true; self.values];
        for store in &self.stores {
            stays[store.target.index()] &= !leaves(store.target);
        }
        // Values that leave their words touch what reads them, and not themselves.
        let mut untouched = vec![true; self.values];
        loop {
            let mut settled = true;
            let mut set = |untouched: &mut Vec<bool>, value: ValueId, now: bool| {
                settled &= now == untouched[value.index()];
                untouched[value.index()] = now;
            };
            for sum in &self.sums {
                let passes = |untouched: &[bool], value: ValueId| untouched[value.index()] && stays[value.index()];
                let terms = self.terms[sum.terms.clone()].iter().all(|(operand, _)| passes(&untouched, *operand));
                for store in &self.stores[sum.stores.clone()] {
                    let now = terms && store.base.is_none_or(|base| passes(&untouched, base));
                    set(&mut untouched, store.target, now);
                }
            }
            for (start, end) in &self.states {
                let now = untouched[end.index()] && stays[end.index()];
                set(&mut untouched, *start, now);
            }
            if settled {
                return untouched;
            }
        }
    }

    /// What the errors of a step are for the states at its end.
    pub fn at_end(&self, of_values: &[f64]) -> Vec<f64> {
        self.states.iter().map(|(_, end)| of_values[end.index()]).collect()
    }

    /// The states at the end of a step as sums over the states at its start, and the most roundings on the way to one.
    /// `None` if there are more than `limit` entries.
    pub fn rows(&self, limit: usize) -> Option<(Vec<Row>, usize)> {
        let mut rows: Vec<Row> = vec![Row::new(); self.values];
        let mut roundings = vec![0usize; self.values];
        for (state, (start, _)) in (0..).zip(&self.states) {
            rows[start.index()] = vec![(state, 1.0, 1.0)];
        }
        let mut scratch = vec![(0.0f64, 0.0f64); self.states.len()];
        let mut touched: Vec<u32> = Vec::new();
        let mut entries = 0;
        for sum in &self.sums {
            let mut deepest = 0;
            for (operand, coefficient) in &self.terms[sum.terms.clone()] {
                deepest = deepest.max(roundings[operand.index()]);
                for (state, number, magnitude) in &rows[operand.index()] {
                    let slot = &mut scratch[at(*state)];
                    if slot.1 == 0.0 {
                        touched.push(*state);
                    }
                    slot.0 += coefficient * number;
                    slot.1 += coefficient.abs() * magnitude;
                }
            }
            touched.sort_unstable();
            touched.dedup();
            let count = self.terms[sum.terms.clone()].len() + 2;
            for store in &self.stores[sum.stores.clone()] {
                let base = store.base.map_or(&[][..], |base| &rows[base.index()]);
                let row = merged(base, &touched, &scratch, store.scale);
                let before = store.base.map_or(0, |base| roundings[base.index()]);
                roundings[store.target.index()] = deepest.max(before) + count;
                entries += row.len();
                rows[store.target.index()] = row;
            }
            touched.drain(..).for_each(|state| scratch[at(state)] = (0.0, 0.0));
            if entries > limit {
                return None;
            }
        }
        let of_states = self.states.iter().map(|(_, end)| rows[end.index()].clone()).collect();
        Some((of_states, self.states.iter().map(|(_, end)| roundings[end.index()]).max().unwrap_or(0)))
    }
}

/// `base + scale * scratch`, in the order of the states.
fn merged(base: &[(u32, f64, f64)], touched: &[u32], scratch: &[(f64, f64)], scale: f64) -> Row {
    let mut row = Row::with_capacity(base.len() + touched.len());
    let mut base = base.iter().peekable();
    for state in touched {
        while let Some(entry) = base.next_if(|(of, ..)| of < state) {
            row.push(*entry);
        }
        let (number, magnitude) = scratch[at(*state)];
        let (mut number, mut magnitude) = (scale * number, scale * magnitude);
        if let Some((_, added, size)) = base.next_if(|(of, ..)| of == state) {
            (number, magnitude) = (number + added, magnitude + size);
        }
        row.push((*state, number, magnitude));
    }
    row.extend(base);
    row
}
