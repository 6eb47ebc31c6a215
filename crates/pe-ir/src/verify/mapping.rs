//! Checks a mapping.
//!
//! Invariants:
//!
//! 1. Every equation has exactly one PE, and it exists.
//! 2. Every PE has at least one equation.
//! 3. The claimed largest load is that of the most loaded PE.
//! 4. The claimed connections are the pairs of PEs of which one reads the other.
//! 5. The claimed largest in-degree is the largest number of other PEs and external inputs that a PE reads.
//! 6. No in-degree exceeds the limit.

use std::collections::BTreeSet;

use crate::graph::{Role, StepGraph, Term};
use crate::index::{EquationId, List, PeId, at, number};
use crate::mapping::{Mapping, MappingCost};

/// What a mapping must be consistent with.
#[derive(Clone, Debug, Default)]
pub struct Facts {
    /// Issue slots of each equation.
    pub loads: List<EquationId, u32>,
    /// Pairs `(read equation, reader)`.
    pub dependencies: BTreeSet<(EquationId, EquationId)>,
    /// Pairs `(external input, reader)`.
    pub input_reads: BTreeSet<(u32, EquationId)>,
}

impl Facts {
    /// The facts of a step graph.
    pub fn of(graph: &StepGraph) -> Facts {
        let mut facts = Facts { loads: List::filled(0, graph.equations.len()), ..Facts::default() };
        let (mut dependencies, mut input_reads) = (Vec::new(), Vec::new());
        for chain in &graph.chains {
            let terms = graph.chain_terms(chain);
            let writes = 1 + u32::from(chain.second.is_some()) + u32::from(chain.interim.is_some());
            facts.loads[chain.equation] += writes.max(number(terms.len()));
            for operand in terms.iter().flat_map(Term::operands) {
                let operand = graph.value(operand);
                if let Role::Input(input) = operand.role {
                    input_reads.push((input, chain.equation));
                } else if let Some(read) = operand.equation.filter(|read| *read != chain.equation) {
                    dependencies.push((read, chain.equation));
                }
            }
        }
        facts.dependencies = set(dependencies);
        facts.input_reads = set(input_reads);
        facts
    }
}

/// A set made at once, which is many times faster than one by one.
fn set<T: Ord>(mut members: Vec<T>) -> BTreeSet<T> {
    members.sort_unstable();
    members.dedup();
    members.into_iter().collect()
}

/// Returns what is wrong with a mapping of a step graph; empty if nothing is.
pub fn check(graph: &StepGraph, mapping: &Mapping, claimed: &MappingCost, max_in_degree: u32) -> Vec<String> {
    check_facts(&Facts::of(graph), mapping, claimed, max_in_degree)
}

/// The same without a step graph.
pub fn check_facts(facts: &Facts, mapping: &Mapping, claimed: &MappingCost, max_in_degree: u32) -> Vec<String> {
    if mapping.pe_of.len() != facts.loads.len() {
        return vec![format!("{} equations have a PE, not {}", mapping.pe_of.len(), facts.loads.len())];
    }
    if let Some((equation, pe)) = mapping.pe_of.numbered().find(|(_, pe)| pe.number() >= mapping.pes) {
        return vec![format!("equation {equation} is on PE {pe} of {}", mapping.pes)];
    }
    let pe = |equation: EquationId| mapping.pe_of[equation];
    let mut violations = Vec::new();
    let used: BTreeSet<PeId> = mapping.pe_of.iter().copied().collect();
    violations
        .extend(PeId::all(mapping.pes).filter(|pe| !used.contains(pe)).map(|pe| format!("PE {pe} has no equation")));

    let mut loads = List::filled(0u64, at(mapping.pes));
    for (&pe, &load) in mapping.pe_of.iter().zip(&facts.loads) {
        loads[pe] += u64::from(load);
    }
    let max_load = loads.into_iter().max().unwrap_or(0);
    if max_load != u64::from(claimed.max_load) {
        violations.push(format!("largest load is {max_load}, not {}", claimed.max_load));
    }

    let between = facts.dependencies.iter().map(|&(read, reader)| (pe(read), pe(reader)));
    let links = set(between.filter(|(source, target)| source != target).collect());
    let connections = links.iter().filter(|&&(a, b)| a < b || !links.contains(&(b, a))).count();
    if connections != at(claimed.connections) {
        violations.push(format!("there are {connections} connections, not {}", claimed.connections));
    }

    let ports = set(facts.input_reads.iter().map(|&(input, reader)| (input, pe(reader))).collect());
    let mut degrees = List::filled(0u32, at(mapping.pes));
    for target in links.iter().map(|&(_, target)| target).chain(ports.iter().map(|&(_, target)| target)) {
        degrees[target] += 1;
    }
    let largest = degrees.iter().copied().max().unwrap_or(0);
    if largest != claimed.max_in_degree {
        violations.push(format!("largest in-degree is {largest}, not {}", claimed.max_in_degree));
    }
    for (pe, degree) in degrees.numbered().filter(|&(_, &degree)| degree > max_in_degree) {
        violations.push(format!("PE {pe} reads {degree} other PEs and inputs, more than {max_in_degree}"));
    }
    violations
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of six equations on three PEs; equation 0 reads an input.
    fn ring() -> (Facts, Mapping, MappingCost) {
        let facts = Facts {
            loads: vec![3, 1, 2, 2, 2, 1].into(),
            dependencies: (0..6)
                .map(|equation| (EquationId::new(equation), EquationId::new((equation + 1) % 6)))
                .collect(),
            input_reads: BTreeSet::from([(0, EquationId::new(0))]),
        };
        let mapping = Mapping { pes: 3, pe_of: [0, 0, 1, 1, 2, 2].map(PeId::new).to_vec().into() };
        (facts, mapping, MappingCost { max_load: 4, connections: 3, max_in_degree: 2 })
    }

    /// The violations after something has been broken.
    fn violations(break_it: impl Fn(&mut Mapping, &mut MappingCost, &mut u32)) -> Vec<String> {
        let (facts, mut mapping, mut cost) = ring();
        let mut limit = 2;
        break_it(&mut mapping, &mut cost, &mut limit);
        check_facts(&facts, &mapping, &cost, limit)
    }

    #[test]
    fn a_correct_mapping_passes() {
        assert_eq!(violations(|_, _, _| {}), [""; 0]);
    }

    #[test]
    fn every_equation_has_an_existing_pe() {
        let missing = violations(|mapping, _, _| mapping.pe_of.vec_mut().truncate(5));
        assert_eq!(missing, ["5 equations have a PE, not 6"]);
        let unknown = violations(|mapping, _, _| mapping.pe_of[EquationId::new(3)] = PeId::new(3));
        assert_eq!(unknown, ["equation 3 is on PE 3 of 3"]);
    }

    #[test]
    fn every_pe_has_an_equation() {
        let empty = violations(|mapping, _, _| mapping.pes = 4);
        assert_eq!(empty, ["PE 3 has no equation"]);
    }

    #[test]
    fn the_largest_load_is_as_claimed() {
        assert_eq!(violations(|_, cost, _| cost.max_load = 5), ["largest load is 4, not 5"]);
    }

    #[test]
    fn the_connections_are_as_claimed() {
        assert_eq!(violations(|_, cost, _| cost.connections = 2), ["there are 3 connections, not 2"]);
    }

    #[test]
    fn both_directions_are_one_connection() {
        let (mut facts, mapping, cost) = ring();
        facts.dependencies.insert((EquationId::new(2), EquationId::new(1)));
        assert_eq!(check_facts(&facts, &mapping, &MappingCost { max_in_degree: 3, ..cost }, 3), [""; 0]);
    }

    #[test]
    fn the_largest_in_degree_is_as_claimed() {
        assert_eq!(violations(|_, cost, _| cost.max_in_degree = 1), ["largest in-degree is 2, not 1"]);
    }

    #[test]
    fn no_in_degree_exceeds_the_limit() {
        assert_eq!(violations(|_, _, limit| *limit = 1), ["PE 0 reads 2 other PEs and inputs, more than 1"]);
    }
}
