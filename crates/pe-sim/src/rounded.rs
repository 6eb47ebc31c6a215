//! The step graph in double precision with coefficients that are rounded in several ways, side by side: what is computed next
//! is chosen once for all of them.

use std::ops::Range;

use pe_ir::graph::{Chain, Factor, FixedPoint, StepGraph};
use pe_ir::index::at;

use crate::double::{constants, power_of_two};
use crate::functions::FunctionRun;
use crate::rows::Kept;
use crate::slots::Slots;
use crate::tape::{Group, Part, Tape};
use crate::tiles::{Lookups, Tiles};

/// Runs in double precision with the coefficients that the hardware would have in `N` roundings. Each gives the numbers that
/// [`crate::double::DoubleRun::quantised`] gives.
pub struct RoundedRuns<'a, const N: usize> {
    graph: &'a StepGraph,
    slots: Slots,
    tape: Tape<[f64; N]>,
    /// Current numbers, a slot per value and a zero.
    values: Vec<[f64; N]>,
    /// Those of long rows of the past.
    past: Kept<[f64; N]>,
    functions: FunctionRun,
    /// Where the states are among the values.
    states: Range<usize>,
}

impl<'a, const N: usize> RoundedRuns<'a, N> {
    /// Starts runs from the initial values.
    pub fn new(graph: &'a StepGraph, roundings: [&FixedPoint; N]) -> Self {
        let mut coefficients = vec![[0.0; N]; graph.terms.len()];
        for (index, chain) in graph.chains.numbered() {
            for term in
                chain.terms.clone().filter(|term| matches!(graph.terms[at(*term)].factor, Factor::Coefficient(_)))
            {
                coefficients[at(term)] = roundings.map(|fixed| fixed.coefficient_value(graph, index, at(term)));
            }
        }
        let are_one = |_, chain: &Chain| coefficients[at(chain.terms.start)] == [1.0; N];
        let slots = Slots::new(graph, |_| 0, are_one);
        let functions = FunctionRun::new(graph, slots.count());
        let class = |_, chain: &_| FunctionRun::class(chain);
        let tiles = slots.arrange(graph, class, |term| coefficients[term], |_, _, write| write.weight);
        let mut values = vec![[0.0; N]; slots.count()];
        for (slot, number) in constants(graph, &slots) {
            values[at(slot)] = [number; N];
        }
        let mut past = slots.rows().kept([0.0; N]);
        for (index, initial) in graph.initial.numbered() {
            let slot = at(slots.of(graph.states[index].0));
            values[slot] = [*initial; N];
            past.set(slots.rows(), slot, values[slot]);
        }
        let states = slots.states(graph);
        RoundedRuns { graph, slots, tape: Tape::of_chains(tiles), values, past, functions, states }
    }

    /// States of a run at the start of the next step, those of the model first.
    pub fn states(&self, run: usize) -> impl Iterator<Item = f64> {
        self.states.clone().map(move |slot| self.past.number(self.slots.rows(), slot, &self.values)[run])
    }

    /// Advances by one step with the inputs held; whether all values are finite.
    pub fn step(&mut self, inputs: &[f64]) -> bool {
        for (value, number) in self.graph.inputs.iter().zip(inputs) {
            self.values[at(self.slots.of(*value))] = [*number; N];
        }
        let finite = run_tape(&self.tape, &mut self.values, &mut self.functions);
        self.slots.take_over(&mut self.values, &mut self.past);
        finite
    }
}

/// Runs all chains; false if a value is not finite.
fn run_tape<const N: usize>(tape: &Tape<[f64; N]>, values: &mut [[f64; N]], functions: &mut FunctionRun) -> bool {
    let mut finite = true;
    for part in &tape.parts {
        match part {
            Part::Groups(groups) => finite &= run_groups(tape, groups, values, functions),
            Part::Tile(index) => {
                let tile = &tape.tiles.tiles[at(*index)];
                let lookups = tile.lookups.expect("all sums are listed as chains");
                (0..at(tile.lanes)).for_each(|lane| look_up(&tape.tiles, lane, lookups, values));
            }
        }
    }
    finite
}

/// Chains of the list, with the widest vectors that this processor has; false if a value is not finite.
#[multiversion::multiversion(targets = "simd")]
fn run_groups<const N: usize>(
    tape: &Tape<[f64; N]>,
    groups: &Range<u32>,
    values: &mut [[f64; N]],
    functions: &mut FunctionRun,
) -> bool {
    let mut finite = true;
    for group in tape.groups(groups) {
        finite &= match group.class {
            0 => run_chains(tape, group, values, |_, _| {}),
            class => run_functions(tape, group, values, (functions, class)),
        };
    }
    finite
}

/// Chains whose sums a function is applied to.
#[inline(never)]
fn run_functions<const N: usize>(
    tape: &Tape<[f64; N]>,
    group: &Group,
    values: &mut [[f64; N]],
    (functions, class): (&mut FunctionRun, u32),
) -> bool {
    run_chains(tape, group, values, |results, target| functions.apply(class, results, |_| target))
}

#[inline(always)]
fn run_chains<const N: usize>(
    tape: &Tape<[f64; N]>,
    group: &Group,
    values: &mut [[f64; N]],
    mut apply: impl FnMut(&mut [f64; N], u32),
) -> bool {
    let mut finite = true;
    for chain in tape.chains(group) {
        let mut sum = [0.0; N];
        for (operand, coefficients) in chain.products {
            let operands = values[at(*operand)];
            (0..N).for_each(|run| sum[run] += operands[run] * coefficients[run]);
        }
        for (operand, factor) in chain.factors {
            let (operands, factors) = (values[at(*operand)], values[at(*factor)]);
            (0..N).for_each(|run| sum[run] += operands[run] * factors[run]);
        }
        for write in chain.writes {
            let (mut results, weight) = (values[at(write.base)], power_of_two(write.shift));
            (0..N).for_each(|run| results[run] += weight * sum[run]);
            apply(&mut results, write.target);
            results.iter().for_each(|result| finite &= result.abs() < f64::INFINITY);
            values[at(write.target)] = results;
        }
    }
    finite
}

/// A lookup of all runs. Segments are kept as numbers.
fn look_up<const N: usize>(tiles: &Tiles<[f64; N]>, lane: usize, lookups: Lookups, values: &mut [[f64; N]]) {
    let (target, numbers) = match lookups {
        Lookups::Segments { targets, arguments, octaves } => {
            let arguments = values[tiles.slot(arguments, lane)];
            (targets, arguments.map(|argument| tiles.columns.segments.index_of(argument, octaves) as f64))
        }
        Lookups::Choices { targets, segments, among } => {
            let segments = values[tiles.slot(segments, lane)];
            let of = |run: usize| values[tiles.choice(among, lane, segments[run] as usize)][run];
            (targets, std::array::from_fn(of))
        }
    };
    values[tiles.slot(target, lane)] = numbers;
}
