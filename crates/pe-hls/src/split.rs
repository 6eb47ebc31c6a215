//! Splits equations that are too heavy for one PE into partial sums, which are equations of their own.
//!
//! A chain that reads many values of other equations hands runs of its products to new equations and reads their
//! results with the coefficient 1. What it reads of its own equation stays, and so does the base word with its guard
//! bits. The chains of all stages are cut alike, so an equation and its partial sums look the same in every stage.
//! Where too many partial sums remain, they are split again: sums become trees.

use std::collections::HashMap;

use pe_ir::graph::{Chain, Equation, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{ChainId, EquationId, List, number};
use pe_ir::word::Latency;

use crate::schedule::Bound;

/// Equations that read more others than this many times the limit of input ports are split on networks in which they
/// could read from more PEs than the limit: their operands cannot all be close.
const HUB: u32 = 2;

/// A partial sum has at least so many products, or adding it would cost more than it takes away.
const SHORTEST: u32 = 4;

/// Levels of a tree of partial sums; each has at least [`SHORTEST`] times fewer sums than the one below.
const LEVELS: usize = 12;

/// Splits what is heavier than a balanced PE where that lowers the bound of the cycles, and what reads from too many
/// places; none if nothing is.
pub fn split(graph: &StepGraph, pes: u32, max_in_degree: u32, latency: Latency) -> Option<StepGraph> {
    let loads = graph.loads();
    let total: u64 = loads.iter().map(|load| u64::from(*load)).sum();
    let balanced = total.div_ceil(u64::from(pes.max(1))).min(u64::from(u32::MAX)) as u32;
    let ports = max_in_degree.max(SHORTEST);
    let tabled = tabled(graph);
    let heavy = pes > 1 && loads.iter().zip(&tabled).any(|(load, tabled)| *load > balanced && !tabled);
    // Whether an equation, or the one that it is a part of, reads from too many places.
    let mut hubs = List::filled(false, loads.len());
    if pes > ports + 1 && loads.iter().any(|load| *load > HUB * ports) {
        hubs = sources(graph).into_iter().map(|count| count > HUB * ports).collect();
    }
    let hub = hubs.contains(&true);
    if !heavy && !hub {
        return None;
    }
    let mut names = Names::default();
    let mut done: Option<StepGraph> = None;
    for _ in 0..LEVELS {
        let current = done.as_ref().unwrap_or(graph);
        let (loads, sources, mains) = (current.loads(), sources(current), main_chains(current));
        let length = |equation: EquationId| {
            if tabled.find(equation).copied().unwrap_or(false) {
                return None;
            }
            let heavy = pes > 1 && loads[equation] > balanced;
            let by_load = heavy.then(|| balanced / (2 * mains[equation].max(1)));
            let by_ports = (hubs[equation] && sources[equation] > ports).then_some(ports * 2 / 3);
            Some(by_load.into_iter().chain(by_ports).min()?.max(SHORTEST))
        };
        let lengths = loads.ids().map(length).collect();
        let mut splitter = Splitter::new(current.clone(), lengths, &mut names);
        if !splitter.run() {
            break;
        }
        let inherited: Vec<bool> = splitter.parents.iter().map(|parent| hubs[*parent]).collect();
        hubs.extend(inherited);
        done = Some(splitter.finish());
    }
    let bound = |graph: &StepGraph| Bound::of(graph, pes, latency).binding().0;
    done.filter(|split| hub || bound(split) < bound(graph))
}

/// Equations with lookups, which stay whole: only the PE that computes the argument of a table can look it up.
pub(crate) fn tabled(graph: &StepGraph) -> List<EquationId, bool> {
    let mut tabled = List::filled(false, graph.equations.len());
    for lookup in &graph.functions.lookups {
        tabled[graph.value(lookup.argument).equation.expect("arguments of tables are computed")] = true;
    }
    tabled
}

/// For each equation the number of others and inputs that it reads.
pub(crate) fn sources(graph: &StepGraph) -> List<EquationId, u32> {
    let mut counts = List::filled(0, graph.equations.len());
    for (_, reader) in graph.dependencies() {
        counts[reader] += 1;
    }
    counts
}

/// For each equation the number of its chains that are no inner sums.
fn main_chains(graph: &StepGraph) -> List<EquationId, u32> {
    let mut counts = List::filled(0, graph.equations.len());
    for chain in graph.chains.iter().filter(|chain| !is_inner(graph, chain)) {
        counts[chain.equation] += 1;
    }
    counts
}

fn is_inner(graph: &StepGraph, chain: &Chain) -> bool {
    matches!(graph.value(chain.write.value).role, Role::Inner(..))
}

/// Numbers of what was named so far, by equation: parts, and partial sums.
#[derive(Default)]
struct Names {
    parts: HashMap<EquationId, u32>,
    sums: HashMap<EquationId, u32>,
}

/// One level of splitting.
struct Splitter<'n> {
    graph: StepGraph,
    /// Products of a partial sum, for each equation that is split.
    lengths: List<EquationId, Option<u32>>,
    producers: Vec<Option<ChainId>>,
    /// Terms of each chain as they will be.
    terms: List<ChainId, Vec<Term>>,
    /// Partial sums that each chain reads, to be computed before it.
    before: List<ChainId, Vec<(Chain, Vec<Term>)>>,
    /// Equations of the partial sums of main chains, by equation and position.
    partials: HashMap<(EquationId, usize), EquationId>,
    /// For each new equation the one that it is a part of.
    parents: Vec<EquationId>,
    names: &'n mut Names,
    /// Chains that moved to a new equation.
    moved: List<ChainId, bool>,
}

impl<'n> Splitter<'n> {
    fn new(graph: StepGraph, lengths: List<EquationId, Option<u32>>, names: &'n mut Names) -> Splitter<'n> {
        let terms = graph.chains.iter().map(|chain| graph.chain_terms(chain).to_vec()).collect();
        Splitter {
            producers: graph.producers(),
            terms,
            before: List::filled(Vec::new(), graph.chains.len()),
            partials: HashMap::new(),
            parents: Vec::new(),
            names,
            moved: List::filled(false, graph.chains.len()),
            lengths,
            graph,
        }
    }

    /// Splits all chains that are to be split; whether there was one. Chains come before the inner sums that they read.
    fn run(&mut self) -> bool {
        for chain in self.graph.chains.ids().rev() {
            let length = self.lengths.find(self.graph.chains[chain].equation).copied().flatten();
            if let (Some(length), false) = (length, self.moved[chain]) {
                self.split(chain, length);
            }
        }
        !self.parents.is_empty()
    }

    /// Cuts the terms of a chain that may leave its equation into partial sums, if that gives more than one.
    fn split(&mut self, chain: ChainId, length: u32) {
        let equation = self.graph.chains[chain].equation;
        let stays = |term: &Term| self.graph.value(term.operand).equation == Some(equation);
        let (mut home, away): (Vec<Term>, Vec<Term>) = self.terms[chain].iter().partition(|term| stays(term));
        let costs: Vec<u32> = away.iter().map(|term| self.cost(term)).collect();
        let total: u32 = costs.iter().sum();
        let count = total.div_ceil(length).min(number(away.len()));
        if count < 2 || (number(away.len())) < 2 * SHORTEST {
            return;
        }
        let main = !is_inner(&self.graph, &self.graph.chains[chain]);
        let mut pieces: Vec<Vec<Term>> = vec![Vec::new()];
        let mut done = 0;
        for (term, cost) in away.into_iter().zip(costs) {
            let cut = u64::from(total) * pieces.len() as u64 / u64::from(count);
            if u64::from(done) >= cut {
                pieces.push(Vec::new());
            }
            pieces.last_mut().expect("one from the start").push(term);
            done += cost;
        }
        for (position, piece) in pieces.into_iter().enumerate() {
            let partial = match (main, self.partials.get(&(equation, position))) {
                (true, Some(known)) => *known,
                _ => self.new_equation(equation, main.then_some(position)),
            };
            for term in &piece {
                if let Factor::Value(factor) = term.factor {
                    self.move_inner(factor, partial);
                }
            }
            let serial = self.names.sums.entry(equation).or_default();
            *serial += 1;
            let role = Role::Partial(equation, *serial);
            let value = ValueId::at(self.graph.values.len());
            self.graph.values.push(Value { role, equation: Some(partial), factor: false });
            let write = Write { value, base: None, weight: 0 };
            self.before[chain].push((
                Chain { equation: partial, terms: 0..0, interim: None, write, second: None, function: None },
                piece,
            ));
            home.push(Term::new(value, Factor::Coefficient(1.0)));
        }
        self.terms[chain] = home;
    }

    /// Products of a term, those of its inner sums included.
    fn cost(&self, term: &Term) -> u32 {
        let Factor::Value(factor) = term.factor else { return 1 };
        match self.producers[factor.index()] {
            None => 1,
            Some(chain) => 1 + self.terms[chain].iter().map(|term| self.cost(term)).sum::<u32>(),
        }
    }

    fn new_equation(&mut self, equation: EquationId, position: Option<usize>) -> EquationId {
        let Equation { name, span, .. } = self.graph.equations[equation].clone();
        let part = self.names.parts.entry(equation).or_default();
        *part += 1;
        let partial = self.graph.equations.push(Equation { name: format!("{name}.part{part}"), span, place: None });
        self.parents.push(equation);
        if let Some(position) = position {
            self.partials.insert((equation, position), partial);
        }
        partial
    }

    /// Gives a factor to another equation, with the chain that computes it and all that is private to that.
    fn move_inner(&mut self, factor: ValueId, equation: EquationId) {
        self.graph.values[factor.index()].equation = Some(equation);
        let Some(chain) = self.producers[factor.index()] else { return };
        self.moved[chain] = true;
        let from = std::mem::replace(&mut self.graph.chains[chain].equation, equation);
        let bases: Vec<ValueId> = self.graph.chains[chain].writes().filter_map(|write| write.base).collect();
        for base in bases {
            self.graph.values[base.index()].equation = Some(equation);
        }
        for term in self.terms[chain].clone() {
            let operand = self.graph.value(term.operand);
            if operand.equation == Some(from) && matches!(operand.role, Role::Constant(_)) {
                self.graph.values[term.operand.index()].equation = Some(equation);
            }
            if let Factor::Value(inner) = term.factor {
                self.move_inner(inner, equation);
            }
        }
    }

    /// The graph with its chains in a new order: partial sums before the chain that reads them.
    fn finish(self) -> StepGraph {
        let Splitter { mut graph, terms: all, before, .. } = self;
        let (mut chains, mut terms) = (List::new(), Vec::new());
        let mut add = |chain: Chain, own: Vec<Term>| {
            let first = number(terms.len());
            terms.extend(own);
            chains.push(Chain { terms: first..terms.len() as u32, ..chain });
        };
        for ((chain, own), before) in graph.chains.iter().zip(all).zip(before) {
            before.into_iter().for_each(|(partial, own)| add(partial, own));
            add(chain.clone(), own);
        }
        graph.chains = chains;
        graph.terms = terms;
        graph
    }
}
