//! Balances a mapping under the products that remain with its pairs.
//!
//! The annealer assumes all pairs that some mapping could allow. Which ones a mapping does allow depends on where the
//! neighbours of an equation are, so PEs of many imported neighbours end up with more products than it thought. Moves
//! of single equations to neighbouring PEs take from the PE with most products, as long as that helps: first to PEs with
//! operands of the same products, then to any that is connected, where small equations that are in no pair fill what is left.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::{EquationId, List, PeId, at};
use pe_ir::mapping::Mapping;

use crate::pairs;

/// Moves per PE, at most.
const MOVES: u32 = 8;

/// Mappings with equations moved until the PE with most products cannot be relieved by one more move: to PEs with operands
/// of the same products, and from there to connected ones.
pub fn even(graph: &StepGraph, fixed: &FixedPoint, mapping: &Mapping) -> [Mapping; 2] {
    let mut state = State::new(graph, fixed, mapping);
    [false, true].map(|connected| {
        for _ in 0..MOVES * mapping.pes {
            let Some((equation, to)) = state.best_move(connected) else { break };
            state.apply(equation, to);
        }
        Mapping { pes: mapping.pes, pe_of: state.pe_of.clone() }
    })
}

struct State {
    pe_of: List<EquationId, PeId>,
    members: List<PeId, Vec<EquationId>>,
    /// Products of each PE.
    loads: List<PeId, i64>,
    /// Products of each equation without pairs.
    single: List<EquationId, u32>,
    /// Classes of operands with equal coefficients in the chains of each equation, by the equations that compute them.
    classes: List<EquationId, Vec<Vec<EquationId>>>,
    /// Equations with a class in which an equation occurs.
    readers: List<EquationId, Vec<EquationId>>,
    /// Equations that an equation reads, or that read it.
    connected: List<EquationId, Vec<EquationId>>,
}

impl State {
    fn new(graph: &StepGraph, fixed: &FixedPoint, mapping: &Mapping) -> State {
        let equations = graph.equations.len();
        let mut state = State {
            pe_of: mapping.pe_of.clone(),
            members: List::filled(Vec::new(), at(mapping.pes)),
            loads: List::filled(0, at(mapping.pes)),
            single: graph.loads(),
            classes: List::filled(Vec::new(), equations),
            readers: List::filled(Vec::new(), equations),
            connected: List::filled(Vec::new(), equations),
        };
        for (read, reader) in graph.dependencies() {
            state.connected[read].push(reader);
            state.connected[reader].push(read);
        }
        for (index, chain) in graph.chains.numbered() {
            for members in pairs::classes(graph, fixed, index) {
                let source =
                    |term: &u32| graph.value(graph.terms[at(*term)].operand).equation.expect("inputs are in no class");
                let sources: Vec<EquationId> = members.iter().map(source).collect();
                sources.iter().for_each(|source| state.readers[*source].push(chain.equation));
                state.classes[chain.equation].push(sources);
            }
        }
        for readers in &mut state.readers {
            readers.sort_unstable();
            readers.dedup();
        }
        for equation in graph.equations.ids() {
            let pe = state.pe_of[equation];
            state.members[pe].push(equation);
            let load = state.load(equation, &|other| state.pe_of[other]);
            state.loads[pe] += i64::from(load);
        }
        state
    }

    /// Products of an equation where `pe_of` tells the places.
    fn load(&self, equation: EquationId, pe_of: &dyn Fn(EquationId) -> PeId) -> u32 {
        let here = pe_of(equation);
        let saved = |class: &Vec<EquationId>| {
            let own = class.iter().filter(|source| pe_of(**source) == here).count();
            let imported = class.len() - own;
            own.min(imported) + own.saturating_sub(imported) / 2
        };
        self.single[equation] - self.classes[equation].iter().map(saved).sum::<usize>() as u32
    }

    /// What a move changes in the loads.
    fn changes(&self, equation: EquationId, to: PeId) -> BTreeMap<PeId, i64> {
        let before = |other: EquationId| self.pe_of[other];
        let after = |other: EquationId| if other == equation { to } else { self.pe_of[other] };
        let mut changes = BTreeMap::new();
        let own = std::iter::once(&equation);
        for affected in own.chain(self.readers[equation].iter().filter(|reader| **reader != equation)) {
            *changes.entry(before(*affected)).or_default() -= i64::from(self.load(*affected, &before));
            *changes.entry(after(*affected)).or_default() += i64::from(self.load(*affected, &after));
        }
        changes
    }

    /// The move away from the PE with most products that leaves the smallest largest load among the PEs it touches,
    /// then the fewest products; `None` if none of them helps.
    fn best_move(&self, connected: bool) -> Option<(EquationId, PeId)> {
        let (worst, load) = self.loads.numbered().max_by_key(|(pe, load)| (**load, Reverse(*pe)))?;
        let members = &self.members[worst];
        if members.len() < 2 {
            return None;
        }
        let mut best: Option<((i64, i64), (EquationId, PeId))> = None;
        let places = |others: &mut dyn Iterator<Item = &EquationId>| {
            let mut places: Vec<PeId> = others.map(|other| self.pe_of[*other]).collect();
            places.sort_unstable();
            places.dedup();
            places
        };
        let around = places(&mut members.iter().filter(|_| connected).flat_map(|member| &self.connected[*member]));
        for equation in members {
            let near = || places(&mut self.classes[*equation].iter().flatten().chain(&self.readers[*equation]));
            let places = if connected { around.clone() } else { near() };
            for to in places.into_iter().filter(|to| *to != worst) {
                let changes = self.changes(*equation, to);
                let loads = changes.iter().map(|(pe, change)| self.loads[*pe] + change);
                let result = (loads.max().unwrap_or(0), changes.values().sum());
                if result.0 < *load && best.is_none_or(|best| result < best.0) {
                    best = Some((result, (*equation, to)));
                }
            }
        }
        best.map(|(_, chosen)| chosen)
    }

    fn apply(&mut self, equation: EquationId, to: PeId) {
        for (pe, change) in self.changes(equation, to) {
            self.loads[pe] += change;
        }
        let from = std::mem::replace(&mut self.pe_of[equation], to);
        self.members[from].retain(|member| *member != equation);
        self.members[to].push(equation);
    }
}
