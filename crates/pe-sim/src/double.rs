//! The step graph in double precision.

use std::ops::Range;

use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StepGraph, ValueId};
use pe_ir::index::{self, StateId, at};

use crate::functions::FunctionRun;
use crate::lanes::{self, DoubleSums, Gathered};
use crate::rows::Kept;
use crate::slots::Slots;
use crate::tape::{Group, Part, Tape};
use crate::tiles::{LANES, Lookups, Place, Shared, Tile, Tiles};

/// A value stopped being a finite number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diverged {
    /// The first value that did.
    pub value: ValueId,
    /// The argument for which a function has no value, if that is the reason: the function in [`Functions::exact`],
    /// and the argument.
    ///
    /// [`Functions::exact`]: pe_ir::functions::Functions::exact
    pub outside: Option<(u32, f64)>,
}

/// A run in double precision.
pub struct DoubleRun<'a> {
    graph: &'a StepGraph,
    slots: Slots,
    tape: Tape<f64>,
    /// Current numbers, a slot per value and a zero.
    values: Vec<f64>,
    /// Those of long rows of the past.
    past: Kept<f64>,
    largest: Vec<f64>,
    functions: FunctionRun,
    /// Where the states are among the values.
    states: Range<usize>,
    /// What no chain writes, but for rows of the past.
    given: Vec<Range<usize>>,
    /// What tiles of many lanes need; it is away while they run.
    room: Option<Box<Room>>,
}

/// Room for the sums of a tile of many lanes, and for what they are made of.
struct Room {
    gathered: Gathered<f64>,
    sums: DoubleSums,
    bases: [f64; LANES],
    results: [f64; LANES],
}

impl<'a> DoubleRun<'a> {
    /// Starts a run from the initial values.
    pub fn new(graph: &'a StepGraph) -> Self {
        let exact = |term: usize| match graph.terms[term].factor {
            Factor::Coefficient(c) => c,
            Factor::Value(_) => 0.0,
        };
        Self::with_coefficients(graph, exact)
    }

    /// Starts a run with the coefficients as the hardware has them, rounded to their port.
    pub fn quantised(graph: &'a StepGraph, fixed: &FixedPoint) -> Self {
        let mut coefficients = vec![0.0; graph.terms.len()];
        for (index, chain) in graph.chains.numbered() {
            for term in chain.terms.clone() {
                coefficients[at(term)] = fixed.coefficient_value(graph, index, at(term));
            }
        }
        Self::with_coefficients(graph, |term| coefficients[term])
    }

    fn with_coefficients(graph: &'a StepGraph, coefficient: impl Fn(usize) -> f64) -> Self {
        let is_one = |term: u32| coefficient(at(term)) == 1.0;
        let slots = Slots::new(graph, |_| 0, |_, chain| is_one(chain.terms.start));
        let functions = FunctionRun::new(graph, slots.count());
        let class = |_, chain: &Chain| FunctionRun::class(chain);
        let tiles = slots.arrange(graph, class, &coefficient, |_, _, write| write.weight);
        let tape = Tape::new(tiles);
        let mut values = vec![0.0; slots.count()];
        for (slot, number) in constants(graph, &slots) {
            values[at(slot)] = number;
        }
        let largest = vec![0.0; values.len()];
        let states = slots.states(graph);
        let (past, given) = (slots.rows().kept(0.0), slots.rows().others(slots.given));
        let room = Room {
            gathered: Gathered::new(),
            sums: DoubleSums([0.0; LANES]),
            bases: [0.0; LANES],
            results: [0.0; LANES],
        };
        let room = Some(Box::new(room));
        let mut run = DoubleRun { graph, slots, tape, values, past, largest, functions, states, given, room };
        for (index, initial) in graph.initial.numbered() {
            run.set_state(index, *initial);
        }
        run
    }

    /// Sets a state.
    pub fn set_state(&mut self, index: StateId, number: f64) {
        let slot = at(self.slots.of(self.graph.states[index].0));
        self.values[slot] = number;
        self.past.set(self.slots.rows(), slot, number);
        self.largest[slot] = self.largest[slot].max(number.abs());
    }

    /// A state at the start of the next step.
    pub fn state(&self, index: StateId) -> f64 {
        self.number(self.graph.states[index].0)
    }

    /// All states at the start of the next step, those of the model first.
    pub fn states(&self) -> impl ExactSizeIterator<Item = f64> {
        self.states.clone().map(|slot| self.past.number(self.slots.rows(), slot, &self.values))
    }

    /// A value by its index: of the latest step, but for states, which are those of the next.
    pub fn value(&self, index: usize) -> f64 {
        self.number(ValueId::at(index))
    }

    /// A published output after a step.
    pub fn output(&self, index: usize) -> f64 {
        self.number(self.graph.outputs[index])
    }

    fn number(&self, value: ValueId) -> f64 {
        self.past.number(self.slots.rows(), at(self.slots.of(value)), &self.values)
    }

    /// Largest magnitude of each value so far; of the past of a value at least that of the value.
    pub fn largest(&self) -> Vec<f64> {
        let mut largest = self.largest.clone();
        self.slots.rows().spread(&mut largest);
        self.slots.in_graph_order(&largest)
    }

    /// By value, smallest and largest argument so far of the exact function that computes it; an empty range if none does.
    pub fn arguments(&self) -> Vec<(f64, f64)> {
        (0..self.graph.values.len()).map(|value| self.argument(ValueId::at(value))).collect()
    }

    /// The same of one value.
    pub fn argument(&self, value: ValueId) -> (f64, f64) {
        self.functions.argument(self.slots.of(value))
    }

    /// Values whose functions took a limit where they are 0/0, so far, with the first argument of each.
    pub fn limits(&self) -> impl Iterator<Item = (ValueId, f64)> {
        let computed = self.graph.chains.iter().filter(|chain| chain.function.is_some()).map(|chain| chain.write.value);
        let limits = &self.functions.limits;
        let all = computed.take(if limits.is_empty() { 0 } else { usize::MAX });
        all.filter_map(|value| {
            let slot = self.slots.of(value);
            limits.iter().find(|(of, _)| *of == slot).map(|(_, argument)| (value, *argument))
        })
    }

    /// Advances by one step with the inputs held.
    ///
    /// # Errors
    /// [`Diverged`] if a value is no longer finite.
    pub fn step(&mut self, inputs: &[f64]) -> Result<(), Diverged> {
        for (value, number) in self.graph.inputs.iter().zip(inputs) {
            self.values[at(self.slots.of(*value))] = *number;
        }
        let mut finite = true;
        for given in &self.given {
            finite &= note_largest(&mut self.largest[given.clone()], &self.values[given.clone()]);
        }
        finite &= run_tape(self);
        if !finite {
            let written = self.graph.chains.iter().flat_map(|chain| chain.writes()).map(|write| write.value);
            let given = self.graph.inputs.iter().copied().chain(self.graph.states.iter().map(|(state, _)| *state));
            let first = written.chain(given).find(|value| !self.number(*value).is_finite());
            let value = first.expect("a value is not finite");
            let outside = self.functions.outside.filter(|(slot, ..)| *slot == self.slots.of(value));
            return Err(Diverged { value, outside: outside.map(|(_, function, argument)| (function, argument)) });
        }
        self.slots.take_over(&mut self.values, &mut self.past);
        Ok(())
    }

    /// Runs all chains; false if a value is not finite.
    #[inline(always)]
    fn run_tape(&mut self) -> bool {
        let mut finite = true;
        let mut room = self.room.take().expect("it is always put back");
        let DoubleRun { tape, values, largest, functions, .. } = self;
        for part in &tape.parts {
            match part {
                Part::Groups(groups) => finite &= run_groups(tape, groups, values, largest, functions),
                Part::Tile(index) => {
                    let tile = &tape.tiles.tiles[at(*index)];
                    match tile.lookups {
                        Some(lookups) => look_up(&tape.tiles, at(tile.lanes), lookups, values),
                        None => finite &= run_tile((&tape.tiles, tile), values, largest, functions, &mut room),
                    }
                }
            }
        }
        self.room = Some(room);
        finite
    }
}

/// Chains of narrow tiles, one after another; false if a value is not finite. In a function of its own, where sums stay in
/// registers.
#[inline(never)]
fn run_groups(
    tape: &Tape<f64>,
    groups: &Range<u32>,
    values: &mut [f64],
    largest: &mut [f64],
    functions: &mut FunctionRun,
) -> bool {
    let mut finite = true;
    for group in tape.groups(groups) {
        finite &= match group.class {
            0 => run_chains(tape, group, values, largest, |_, _| {}),
            class => run_functions(tape, group, values, largest, (functions, class)),
        };
    }
    finite
}

/// Chains whose sums a function is applied to.
#[inline(never)]
fn run_functions(
    tape: &Tape<f64>,
    group: &Group,
    values: &mut [f64],
    largest: &mut [f64],
    (functions, class): (&mut FunctionRun, u32),
) -> bool {
    run_chains(tape, group, values, largest, |result, target| {
        functions.apply(class, std::slice::from_mut(result), |_| target);
    })
}

#[inline(always)]
fn run_chains(
    tape: &Tape<f64>,
    group: &Group,
    values: &mut [f64],
    largest: &mut [f64],
    mut apply: impl FnMut(&mut f64, u32),
) -> bool {
    let largest = &mut largest[..values.len()];
    let mut finite = true;
    for chain in tape.chains(group) {
        let mut sum = 0.0;
        for (operand, coefficient) in chain.products {
            sum += values[at(*operand)] * coefficient;
        }
        for (operand, factor) in chain.factors {
            sum += values[at(*operand)] * values[at(*factor)];
        }
        for write in chain.writes {
            let target = at(write.target);
            let mut result = values[at(write.base)] + power_of_two(write.shift) * sum;
            apply(&mut result, write.target);
            values[target] = result;
            let magnitude = result.abs();
            finite &= magnitude < f64::INFINITY;
            largest[target] = if magnitude > largest[target] { magnitude } else { largest[target] };
        }
    }
    finite
}

/// A tile of many lanes; false if a value is not finite.
#[inline(always)]
fn run_tile(
    (tiles, tile): (&Tiles<f64>, &Tile),
    values: &mut [f64],
    largest: &mut [f64],
    functions: &mut FunctionRun,
    room: &mut Room,
) -> bool {
    let lanes = at(tile.lanes);
    let mut finite = true;
    let Room { gathered, sums, bases, results } = room;
    sums.0[..lanes].fill(0.0);
    lanes::accumulate((tiles, tile), (values, values), gathered, sums);
    for writes in &tiles.writes[at(tile.writes.start)..tile.writes.end as usize] {
        let bases = lanes::values(writes.bases, lanes, values, &tiles.slots, bases);
        let results = &mut results[..lanes];
        match writes.shifts {
            Shared::Same(weight) => {
                let weight = power_of_two(weight);
                for ((result, base), sum) in results.iter_mut().zip(bases).zip(&sums.0) {
                    *result = base + weight * sum;
                }
            }
            Shared::Each(start) => {
                let weights = &tiles.shifts[at(start)..][..lanes];
                for (((result, base), sum), weight) in results.iter_mut().zip(bases).zip(&sums.0).zip(weights) {
                    *result = base + power_of_two(*weight) * sum;
                }
            }
        }
        if tile.class != 0 {
            functions.apply(tile.class, results, |lane| index::number(tiles.slot(writes.targets, lane)));
        }
        lanes::store(writes.targets, results, values, &tiles.slots);
        finite &= match writes.targets {
            Place::Row(start) => note_largest(&mut largest[at(start)..][..lanes], results),
            Place::Same(slot) => note_largest(&mut largest[at(slot)..][..1], results),
            Place::Each(start) => {
                let slots = &tiles.slots[at(start)..][..lanes];
                slots.iter().zip(results).fold(true, |finite, (slot, result)| {
                    finite & note_largest(&mut largest[at(*slot)..][..1], std::slice::from_ref(result))
                })
            }
        };
    }
    finite
}

/// Lookups in the place of sums. Segments are kept as numbers.
fn look_up(tiles: &Tiles<f64>, lanes: usize, lookups: Lookups, values: &mut [f64]) {
    for lane in 0..lanes {
        let (target, number) = match lookups {
            Lookups::Segments { targets, arguments, octaves } => {
                let argument = values[tiles.slot(arguments, lane)];
                (targets, tiles.columns.segments.index_of(argument, octaves) as f64)
            }
            Lookups::Choices { targets, segments, among } => {
                let segment = values[tiles.slot(segments, lane)] as usize;
                (targets, values[tiles.choice(among, lane, segment)])
            }
        };
        values[tiles.slot(target, lane)] = number;
    }
}

/// [`DoubleRun::run_tape`] with the widest vectors that this processor has: they round like single numbers, so nothing
/// depends on it.
#[multiversion::multiversion(targets = "simd")]
fn run_tape(run: &mut DoubleRun<'_>) -> bool {
    run.run_tape()
}

/// Updates the largest magnitudes; false if some value is not finite.
#[inline(always)]
fn note_largest(largest: &mut [f64], values: &[f64]) -> bool {
    let mut finite = true;
    for (largest, value) in largest.iter_mut().zip(values) {
        let magnitude = value.abs();
        finite &= magnitude < f64::INFINITY;
        *largest = if magnitude > *largest { magnitude } else { *largest };
    }
    finite
}

/// Numbers that are the same in all steps, each with its slot: constants, and the entries of tables.
pub(crate) fn constants<'a>(graph: &'a StepGraph, slots: &'a Slots) -> impl Iterator<Item = (u32, f64)> + 'a {
    let constants = graph.values.iter().enumerate().filter_map(|(index, value)| match value.role {
        Role::Constant(number) => Some((slots.of(ValueId::at(index)), number)),
        _ => None,
    });
    let entries = slots.column_entries(graph).filter_map(|(value, segment, slot)| match graph.value(value).role {
        Role::Column(lookup, column) => {
            let table = graph.functions.lookups[at(lookup)].table;
            Some((slot, graph.functions.tables[at(table)].columns[usize::from(column)][segment]))
        }
        _ => None,
    });
    constants.chain(entries)
}

/// 2 to the power of `exponent`.
#[inline(always)]
pub(crate) fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((1023 + i64::from(exponent)) as u64) << 52)
}
