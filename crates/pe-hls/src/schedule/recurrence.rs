//! The recurrence bound of the period: how fast steps can follow one another on any number of PEs.
//!
//! A step takes the times at which the states are there to those of the next step. What it does to them is a function
//! `F` that rises with its arguments and commutes with adding a number to all of them, so a loop of period `T` has
//! times `x` with `F(x) <= x + T`. Then `T` is at least the growth of any set `S` of states on its own:
//!
//! ```text
//! T >= min over S of (F^c(x)_i - x_i) / c,   for every x that is minus infinity outside S
//! ```
//!
//! (Collatz and Wielandt for such functions: Gaubert and Gunawardena 2004, doi 10.1090/S0002-9947-04-03470-1). The
//! function counts, for each chain, its operands one per word, the latency to every reader on the same PE, and that
//! the chains of the inner sums of a nested product share one PE with the chain that reads them.

use pe_ir::graph::{Factor, Role, StepGraph, ValueId};
use pe_ir::index::{ChainId, List};
use pe_ir::word::Latency;

/// A time that is always past.
const PAST: i64 = i64::MIN / 4;
/// Steps until the times grow regularly.
const SETTLING: usize = 8;
/// Results that wait for one another in a table that is taken for a function.
const TABLE: i64 = 6;
/// Steps over which growth is measured, `c` of the formula: growth need not be the same in every step.
const WINDOW: usize = 4;

/// The largest growth per step that is proved; 0 if no state depends on itself, or if it cannot exceed `known`.
pub(super) fn recurrence(graph: &StepGraph, latency: Latency, known: u32) -> u32 {
    let mut step = Step::new(graph, latency);
    let mut times = vec![0; graph.states.len()];
    step.advance(&mut times);
    // The growth from equal times is the largest there can be.
    if times.iter().copied().max().unwrap_or(PAST) <= i64::from(known) {
        return 0;
    }
    for _ in 1..SETTLING {
        step.advance(&mut times);
    }
    let mut after = times.clone();
    (0..WINDOW).for_each(|_| step.advance(&mut after));
    let growth = |state: usize| after[state] - times[state];
    let Some(last) = (0..times.len()).max_by_key(|&state| after[state]) else { return 0 };
    let fastest = (0..times.len()).map(growth).max().unwrap_or(0);
    let everything = vec![true; times.len()];
    let fast: Vec<bool> = (0..times.len()).map(|state| growth(state) == fastest).collect();
    let alone: Vec<bool> = (0..times.len()).map(|state| state == last).collect();
    let proved = [everything, fast, alone].iter().map(|set| step.growth(&times, set)).max().unwrap_or(0);
    u32::try_from(proved.max(0)).unwrap_or(u32::MAX)
}

/// When each value can be read, in a step that others came before; what nothing waits for is long past.
pub fn arrivals(graph: &StepGraph, latency: Latency) -> Vec<i64> {
    let mut step = Step::new(graph, latency);
    let mut times = vec![0; graph.states.len()];
    (0..SETTLING).for_each(|_| step.advance(&mut times));
    step.ready
}

/// The function `F`.
struct Step<'a> {
    graph: &'a StepGraph,
    latency: Latency,
    producers: Vec<Option<ChainId>>,
    /// When each value can be read.
    ready: Vec<i64>,
    /// When each chain can issue its first operand.
    starts: List<ChainId, i64>,
}

impl<'a> Step<'a> {
    fn new(graph: &'a StepGraph, latency: Latency) -> Step<'a> {
        let (values, chains) = (graph.values.len(), graph.chains.len());
        Step {
            graph,
            latency,
            producers: graph.producers(),
            ready: vec![PAST; values],
            starts: List::filled(PAST, chains),
        }
    }

    /// The growth of a set of states per step, rounded up, as the module's formula has it.
    fn growth(&mut self, times: &[i64], set: &[bool]) -> i64 {
        let start: Vec<i64> = times.iter().zip(set).map(|(time, within)| if *within { *time } else { PAST }).collect();
        let mut end = start.clone();
        (0..WINDOW).for_each(|_| self.advance(&mut end));
        let growths = (0..set.len()).filter(|&state| set[state]).map(|state| end[state] - start[state]);
        let window = WINDOW as i64;
        growths.min().map_or(0, |growth| (growth + window - 1).div_euclid(window))
    }

    /// Takes the times of the states to those of the next step.
    fn advance(&mut self, times: &mut [i64]) {
        let graph = self.graph;
        self.ready.fill(PAST);
        for ((state, _), time) in graph.states.iter().zip(times.iter()) {
            self.ready[state.index()] = *time;
        }
        let mut operands: Vec<i64> = Vec::new();
        for (index, chain) in graph.chains.numbered() {
            operands.clear();
            for term in graph.chain_terms(chain) {
                let factor = match term.factor {
                    Factor::Value(value) => self.ready[value.index()],
                    Factor::Coefficient(_) => PAST,
                };
                operands.push(self.ready[term.operand.index()].max(factor));
            }
            operands.sort_unstable();
            let begin = operands.iter().enumerate().map(|(position, ready)| ready - position as i64).max();
            let count = i64::from(chain.len());
            let mut last = begin.unwrap_or(PAST).max(PAST) + count - 1;
            for (delay, write) in chain.delayed(self.latency) {
                if let Some(base) = write.base.filter(|base| chain.interim.is_none_or(|interim| interim.value != *base))
                {
                    let (awaited, lag) = match graph.lookup(base) {
                        Some((_, lookup)) => (lookup.argument, Latency::INDEX_TO_SCALE),
                        None => (base, 0),
                    };
                    last = last.max(
                        self.ready[awaited.index()] + i64::from(lag)
                            - i64::from(self.latency.scale())
                            - i64::from(delay),
                    );
                }
            }
            last = last.max(self.inner_sums(index));
            self.starts[index] = last - (count - 1);
            let result = i64::from(self.latency.write() + Latency::WRITE_TO_READ);
            let function = if chain.function.is_some() { TABLE * result } else { 0 };
            for (delay, write) in chain.delayed(self.latency) {
                let read = result + i64::from(delay) + function;
                self.ready[write.value.index()] = if last < PAST / 2 { PAST } else { last + read };
            }
        }
        for ((_, next), time) in graph.states.iter().zip(times.iter_mut()) {
            *time = self.ready[next.index()];
        }
    }

    /// The earliest last operand of a chain whose inner sums are computed one after the other by its own PE.
    fn inner_sums(&self, chain: ChainId) -> i64 {
        let mut sums: Vec<ChainId> = Vec::new();
        self.collect(chain, &mut sums);
        if sums.len() < 2 {
            return PAST;
        }
        sums.sort_unstable();
        sums.dedup();
        sums.sort_unstable_by_key(|&sum| std::cmp::Reverse(self.starts[sum]));
        let result = i64::from(self.latency.write() + Latency::WRITE_TO_READ);
        let mut slots = 0;
        let ends = sums.iter().map(|&sum| {
            slots += i64::from(self.graph.chains[sum].len());
            self.starts[sum] + slots - 1 + result
        });
        ends.max().unwrap_or(PAST)
    }

    /// Appends the chains of a chain's inner sums, and of theirs.
    fn collect(&self, chain: ChainId, sums: &mut Vec<ChainId>) {
        let is_inner = |value: &ValueId| matches!(self.graph.value(*value).role, Role::Inner(..));
        for term in self.graph.chain_terms(&self.graph.chains[chain]) {
            if let Factor::Value(value) = term.factor
                && is_inner(&value)
            {
                let producer = self.producers[value.index()].expect("a chain computes each inner factor");
                sums.push(producer);
                self.collect(producer, sums);
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use pe_ir::graph::{Chain, Equation, Names, StageForm, Term, Value, Write};
    use pe_ir::index::{EquationId, StateId};
    use pe_ir::source::Span;
    use pe_ir::word::Pipeline;

    use super::*;

    pub const LATENCY: Latency = Latency { multiplier: 1, pipeline: Pipeline::Short };
    const RESULT: u32 = 7;

    /// An Euler step: per state the values its chain reads, each an index; inner sums are `(state, operands)`, values
    /// behind those of the states.
    pub fn graph(states: &[&[u32]], inner: &[(u32, &[u32])]) -> StepGraph {
        let count = states.len() as u32;
        let value = |role, equation, factor| Value { role, equation, factor };
        let start =
            (0..count).map(|state| value(Role::State(StateId::new(state)), Some(EquationId::new(state)), false));
        let next = (0..count).map(|state| value(Role::Next(StateId::new(state)), Some(EquationId::new(state)), false));
        let of_inner = |(serial, sum): (usize, &(u32, &[u32]))| {
            let equation = EquationId::new(sum.0);
            value(Role::Inner(equation, serial as u32), Some(equation), true)
        };
        let sums = inner.iter().enumerate().map(of_inner);
        let values: Vec<Value> = start.chain(next).chain(sums).collect();
        let (mut chains, mut terms) = (List::new(), Vec::new());
        let mut chain = |equation: u32, products: Vec<Term>, written: u32, base: Option<u32>| {
            let first = terms.len() as u32;
            terms.extend(products);
            let write = Write { value: ValueId::new(written), base: base.map(ValueId::new), weight: 0 };
            chains.push(Chain {
                equation: EquationId::new(equation),
                terms: first..terms.len() as u32,
                interim: None,
                write,
                second: None,
                function: None,
            });
        };
        let plain = |operand: &u32| Term::new(ValueId::new(*operand), Factor::Coefficient(0.5));
        for (serial, (state, operands)) in inner.iter().enumerate() {
            chain(*state, operands.iter().map(plain).collect(), 2 * count + serial as u32, None);
        }
        for (state, operands) in states.iter().enumerate() {
            let own = inner.iter().enumerate().filter(|(_, sum)| sum.0 == state as u32);
            let factor = |(serial, _)| Factor::Value(ValueId::new(2 * count + serial as u32));
            let nested = own.map(factor).map(|factor| Term::new(ValueId::new(state as u32), factor));
            let products = operands.iter().map(plain).chain(nested).collect();
            chain(state as u32, products, count + state as u32, Some(state as u32));
        }
        let equation = |state: u32| Equation { name: format!("x{state}"), span: Span::default(), place: None };
        StepGraph {
            form: StageForm::Euler,
            stages: 1,
            forms: Vec::new(),
            pre_adder: false,
            step: 1.0,
            equations: (0..count).map(equation).collect(),
            values,
            chains,
            terms,
            states: (0..count).map(|state| (ValueId::new(state), ValueId::new(count + state))).collect(),
            initial: vec![0.0; count as usize].into(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            functions: pe_ir::functions::Functions::default(),
            constant_pivot: None,
            eliminations: Vec::new(),
            names: Names::default(),
            parts: Default::default(),
        }
    }

    fn bound(states: &[&[u32]], inner: &[(u32, &[u32])]) -> u32 {
        recurrence(&graph(states, inner), LATENCY, 0)
    }

    #[test]
    fn a_state_that_reads_itself_waits_for_its_result() {
        assert_eq!(bound(&[&[0]], &[]), RESULT);
        // Two states that arrive at once are read one after the other.
        assert_eq!(bound(&[&[0, 1], &[0, 1]], &[]), RESULT + 1);
    }

    #[test]
    fn only_the_base_of_a_running_sum_recurs() {
        // State 1 sums up state 0, which reads itself: the slower of the two counts.
        assert_eq!(bound(&[&[0], &[0]], &[]), RESULT);
        assert_eq!(bound(&[&[1], &[1]], &[]), RESULT);
    }

    #[test]
    fn inner_sums_share_a_pe() {
        assert_eq!(bound(&[&[]], &[(0, &[0])]), 2 * RESULT);
        // Two sums of two products: the second ends three words after the first begins, and two products remain.
        assert_eq!(bound(&[&[]], &[(0, &[0, 0]), (0, &[0, 0])]), 3 + 2 * RESULT);
    }

    #[test]
    fn what_cannot_bind_is_not_computed() {
        assert_eq!(recurrence(&graph(&[&[0]], &[]), LATENCY, RESULT), 0);
    }
}
