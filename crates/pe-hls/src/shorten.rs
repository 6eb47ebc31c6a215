//! Evaluates polynomials of tables in fewer results that wait for one another, where latency binds
//! ([0094](../../../docs/decisions/0094-latency-of-tables.md)).
//!
//! Horner's rule has a product of the local coordinate u for each degree, each waiting for the one before. With the square of
//! u, two coefficients are taken at a time, in chains of two products:
//!
//! ```text
//! g = c[k] + c[k+1] u + (next g) u^2,   k = 0, 2, 4 ...
//! ```
//!
//! Odd coefficients, u for the coefficient port, and the square of u wait for no g. So degree 3 waits for two results in
//! place of three, 4 for three in place of four, 5 for three in place of five, 6 for four in place of six; each lookup takes
//! half as many words more.

use pe_ir::functions::Table;
use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, ChainId, EquationId, List, at};
use pe_ir::word::Latency;

use crate::schedule::Bound;

/// Lowest degree for which fewer results wait for one another.
const LEAST_DEGREE: usize = 3;

/// The bound with shorter tables over that without, from which on the words that they take are not worth it.
const GAIN: f64 = 0.98;

/// Tables that are tried without one by one, at most.
const TRIED: usize = 32;

/// The step with shorter evaluation of those tables that the bound on a number of PEs depends on; none if it gets hardly
/// lower.
pub fn shorten(graph: &StepGraph, pes: u32, latency: Latency) -> Option<StepGraph> {
    if !graph.functions.tables.iter().any(|table| degree(table) >= LEAST_DEGREE) {
        return None;
    }
    let before = Bound::of(graph, pes, latency);
    if before.recurrence < before.binding().0 {
        return None;
    }
    let bound = |graph: &StepGraph| Bound::of(graph, pes, latency).binding().0;
    let lookups = Lookups::of(graph);
    let mut taken: Vec<bool> = (0..graph.functions.tables.len()).map(|table| lookups.has(graph, table)).collect();
    let mut best = lookups.rewritten(graph, &taken);
    let fewest = bound(&best);
    if f64::from(fewest) > GAIN * f64::from(before.binding().0) {
        return None;
    }
    let tables: Vec<usize> = (0..taken.len()).filter(|table| taken[*table]).collect();
    for table in tables.into_iter().take(TRIED) {
        taken[table] = false;
        let without = lookups.rewritten(graph, &taken);
        if bound(&without) <= fewest {
            best = without;
        } else {
            taken[table] = true;
        }
    }
    Some(best)
}

/// Columns in front of the coefficients: the local coordinate's and, with octaves, its scale.
fn head(table: &Table) -> usize {
    1 + usize::from(table.octaves)
}

fn degree(table: &Table) -> usize {
    table.columns.len().saturating_sub(head(table) + 1)
}

/// The chains by which lookups are evaluated.
struct Lookups {
    /// By lookup the chains whose bases are its columns, in their order; none where they are not those of Horner's rule.
    chains: Vec<Option<Vec<ChainId>>>,
}

impl Lookups {
    fn of(graph: &StepGraph) -> Lookups {
        let mut found: Vec<Vec<Option<ChainId>>> = (graph.functions.lookups.iter())
            .map(|lookup| vec![None; graph.functions.tables[at(lookup.table)].columns.len()])
            .collect();
        let mut twice = vec![false; found.len()];
        for (id, chain) in graph.chains.numbered() {
            for base in chain.writes().filter_map(|write| write.base) {
                if let Role::Column(lookup, column) = graph.value(base).role {
                    twice[at(lookup)] |= found[at(lookup)][usize::from(column)].replace(id).is_some();
                }
            }
        }
        let complete = |(found, twice): (Vec<Option<ChainId>>, bool)| {
            let chains: Vec<ChainId> = found.into_iter().collect::<Option<_>>()?;
            (!twice && is_horner(graph, &chains)).then_some(chains)
        };
        Lookups { chains: found.into_iter().zip(twice).map(complete).collect() }
    }

    /// Whether lookups of a table can be shortened, which has the degree for it.
    fn has(&self, graph: &StepGraph, table: usize) -> bool {
        let all = graph.functions.lookups.iter().zip(&self.chains);
        let mut of_table = all.filter(|(lookup, _)| at(lookup.table) == table);
        degree(&graph.functions.tables[table]) >= LEAST_DEGREE && of_table.any(|(_, chains)| chains.is_some())
    }

    /// The step with shorter evaluation of some tables.
    fn rewritten(&self, graph: &StepGraph, tables: &[bool]) -> StepGraph {
        // By chain the lookup that ends with it, and whether it is left out.
        let mut ends: List<ChainId, Option<usize>> = List::filled(None, graph.chains.len());
        let mut replaced = List::filled(false, graph.chains.len());
        for (index, (lookup, chains)) in graph.functions.lookups.iter().zip(&self.chains).enumerate() {
            let Some(chains) = chains.as_ref().filter(|_| tables[at(lookup.table)]) else { continue };
            let coefficients = &chains[head(&graph.functions.tables[at(lookup.table)])..];
            coefficients.iter().for_each(|chain| replaced[*chain] = true);
            ends[chains[chains.len() - 1]] = Some(index);
        }
        let mut writer = Writer::new(graph);
        for (id, chain) in graph.chains.numbered() {
            if let Some(lookup) = ends[id] {
                let chains = self.chains[lookup].as_ref().expect("it was found");
                let table = &graph.functions.tables[at(graph.functions.lookups[lookup].table)];
                writer.squares(graph, chains, head(table));
            } else if !replaced[id] {
                writer.push(chain.clone(), graph.chain_terms(chain).to_vec());
            }
        }
        writer.graph
    }
}

/// Whether chains are those of a lookup: each of one term and one write, each coefficient's but the first multiplying the
/// local coordinate with what the one before it gives.
fn is_horner(graph: &StepGraph, chains: &[ChainId]) -> bool {
    let Some(Role::Column(lookup, _)) = graph.chains[chains[0]].write.base.map(|base| graph.value(base).role) else {
        return false;
    };
    let table = &graph.functions.tables[at(graph.functions.lookups[at(lookup)].table)];
    let (head, local) = (head(table), graph.chains[chains[0]].write.value);
    let plain = |id: &ChainId| {
        let chain = &graph.chains[*id];
        chain.len() == 1 && chain.second.is_none() && chain.interim.is_none() && chain.write.weight == 0
    };
    let mut steps = chains.get(head..).unwrap_or_default().windows(2);
    chains.iter().all(plain)
        && steps.all(|step| {
            let [term] = graph.chain_terms(&graph.chains[step[1]]) else { return false };
            *term == Term::new(local, Factor::Value(graph.chains[step[0]].write.value))
        })
}

/// A step graph that is written anew.
struct Writer {
    graph: StepGraph,
    /// Last serial number of the inner values of each equation.
    serials: List<EquationId, u32>,
}

impl Writer {
    fn new(graph: &StepGraph) -> Writer {
        let mut serials = List::filled(0, graph.equations.len());
        for value in &graph.values {
            if let Role::Inner(equation, serial) = value.role {
                let last: &mut u32 = &mut serials[equation];
                *last = serial.max(*last);
            }
        }
        let (terms, chains) = (Vec::with_capacity(graph.terms.len()), List::with_capacity(graph.chains.len()));
        Writer { graph: StepGraph { terms, chains, ..graph.clone() }, serials }
    }

    fn push(&mut self, chain: Chain, terms: Vec<Term>) {
        let start = index::number(self.graph.terms.len());
        self.graph.terms.extend(terms);
        self.graph.chains.push(Chain { terms: start..self.graph.terms.len() as u32, ..chain });
    }

    /// A chain of an equation that writes one value.
    fn write(&mut self, equation: EquationId, terms: Vec<Term>, value: ValueId, base: Option<ValueId>) {
        let write = Write { value, base, weight: 0 };
        self.push(Chain { equation, terms: 0..0, interim: None, write, second: None, function: None }, terms);
    }

    fn value(&mut self, role: Role, equation: EquationId, factor: bool) -> ValueId {
        self.graph.values.push(Value { role, equation: Some(equation), factor });
        ValueId::at(self.graph.values.len() - 1)
    }

    fn inner(&mut self, equation: EquationId, factor: bool) -> ValueId {
        self.serials[equation] += 1;
        let role = Role::Inner(equation, self.serials[equation]);
        self.value(role, equation, factor)
    }

    /// A lookup with the square of its local coordinate. The values of the chains that are left out are used again.
    fn squares(&mut self, graph: &StepGraph, chains: &[ChainId], head: usize) {
        let local = &graph.chains[chains[0]];
        let (equation, u) = (local.equation, local.write.value);
        let base = |column: usize| graph.chains[chains[column]].write.base;
        let value = |column: usize| graph.chains[chains[column]].write.value;
        let nothing = graph.chain_terms(&graph.chains[chains[head]]).to_vec();
        let copy = self.inner(equation, true);
        let centre = base(0).map(|centre| self.value(graph.value(centre).role, equation, true));
        self.write(equation, graph.chain_terms(local).to_vec(), copy, centre);
        let square = self.inner(equation, false);
        self.write(equation, vec![Term::new(u, Factor::Value(copy))], square, None);
        // Columns of coefficients, highest degree first; odd degrees and the highest one are read as they are.
        let last = chains.len() - 1;
        let degree = |column: usize| last - column;
        let mut odd = None;
        let mut sum = None;
        for column in head..=last {
            if column == head || degree(column) % 2 == 1 {
                self.write(equation, nothing.clone(), value(column), base(column));
                match degree(column) % 2 {
                    1 => odd = Some(value(column)),
                    _ => sum = Some(value(column)),
                }
                continue;
            }
            let of_sum = sum.map(|sum| Term::new(square, Factor::Value(sum)));
            let terms = odd.map(|odd| Term::new(u, Factor::Value(odd))).into_iter().chain(of_sum).collect();
            self.write(equation, terms, value(column), base(column));
            sum = Some(value(column));
        }
    }
}
