//! Lower bounds of the period (the initiation interval), which no mapping or schedule can beat.

use pe_ir::graph::{Chain, StepGraph};
use pe_ir::index::List;
use pe_ir::word::Latency;

use super::recurrence::recurrence;

/// Lower bounds of the cycles per step, and which one binds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// Control words of all equations spread evenly over the PEs.
    pub throughput: u32,
    /// Control words of the largest equation, which one PE has to do.
    pub equation: u32,
    /// How fast states can follow from states: the longest way round through products and latencies; 0 if another
    /// bound is larger for certain.
    pub recurrence: u32,
    /// The pause point, which every round passes.
    pub round: u32,
}

impl Bound {
    /// Bounds of a step graph on a number of PEs.
    pub fn of(graph: &StepGraph, pes: u32, latency: Latency) -> Bound {
        let (total, equation) = words(graph, latency);
        let throughput = total.div_ceil(u64::from(pes)) as u32;
        let round = latency.pause() + 1;
        let known = throughput.max(equation).max(round);
        Bound { throughput, equation, recurrence: recurrence(graph, latency, known), round }
    }

    /// The largest bound and its name.
    pub fn binding(&self) -> (u32, &'static str) {
        let bounds = [
            (self.throughput, "products over PEs"),
            (self.equation, "largest equation"),
            (self.recurrence, "latency of the stages"),
            (self.round, "shortest round"),
        ];
        bounds.into_iter().rev().max_by_key(|(cycles, _)| *cycles).expect("four bounds")
    }
}

/// Control words that chains need at least, from the numbers of their operands and those of the words for which their
/// sums stay in the hold register.
///
/// A chain takes its last operand as many words after the chain before it on its PE as it has operands, and no fewer
/// than the sum of that one stays in the hold register. So both numbers are paired, round the period of each PE, and
/// the larger one of each pair counts: least if the two are paired in the order of their size.
pub(super) fn words_of(mut operands: Vec<u32>, mut held: Vec<u32>) -> u64 {
    operands.sort_unstable();
    held.sort_unstable();
    operands.iter().zip(&held).map(|(operands, held)| u64::from(*operands.max(held))).sum()
}

/// Control words that all equations need on any number of PEs, and those that the largest equation needs, whose chains
/// others may come between.
fn words(graph: &StepGraph, latency: Latency) -> (u64, u32) {
    let operands: Vec<u32> = graph.chains.iter().map(Chain::len).collect();
    let held: Vec<u32> = graph.chains.iter().map(|chain| chain.held(latency)).collect();
    let mut equations = List::filled((0, 0), graph.equations.len());
    for ((chain, operands), held) in graph.chains.iter().zip(&operands).zip(&held) {
        let of: &mut (u32, u32) = &mut equations[chain.equation];
        *of = (of.0 + operands, of.1 + held);
    }
    let largest = equations.iter().map(|(operands, held)| *operands.max(held)).max().unwrap_or(0);
    (words_of(operands, held), largest)
}

#[cfg(test)]
mod tests {
    use pe_ir::graph::Write;

    use super::super::recurrence::tests::{LATENCY, graph};
    use super::*;

    #[test]
    fn a_second_write_hides_behind_the_operands_of_another_chain() {
        let mut graph = graph(&[&[0], &[0, 0, 0]], &[]);
        assert_eq!(words(&graph, LATENCY), (4, 3));
        let twice = |write: &Write| Some(Write { value: write.value, base: None, weight: 0 });
        for chain in graph.chains.iter_mut() {
            chain.second = twice(&chain.write);
        }
        // Three words for the operands, and two in which the sum before them is written.
        assert_eq!(words(&graph, LATENCY), (5, 3));
        graph.chains.iter_mut().last().expect("two chains").second = None;
        assert_eq!(words(&graph, LATENCY), (4, 3));
    }
}
