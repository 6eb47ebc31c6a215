//! Sums over nearly everything, on a grid of PEs.
//!
//! Where most equations read most others, every PE would need a port for every other one, or values would travel over PEs
//! that copy them, and wait for long sums there. On a grid no value travels far: PEs form groups of so many members. The
//! members of a group read the values of one another, and each adds up the products of these values for the rows of its
//! fellow members in all groups. Such partial sums then go from group to group, each member handing its own to the member
//! of the same number in the next group, which begins its sum with it, until they are home. Levels say which group is the
//! next one: groups are numbered by digits, one for each level, and a sum settles the digits of its home one after the
//! other, in one hop where PEs have ports for all groups that differ in that digit, or round a ring.
//!
//! Goes in: a step graph and a number of PEs with so many ports. Comes out: a graph in which the sums are cut so, with the
//! PE of each equation as a start for the mapping. Results are the same but for the rounding of partial sums.

use std::collections::{BTreeMap, VecDeque};

use pe_ir::graph::{Chain, Equation, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{EquationId, List, PeId, at, number};
use pe_ir::mapping::{Mapping, MappingCost};
use pe_ir::word::Latency;

use crate::mapping::{Problem, placed};
use crate::schedule::draft;
use crate::split::{sources, tabled};

/// Shapes that are made and scheduled, at most.
const SCHEDULED: usize = 8;

/// Shapes that are made, at most: inputs and equations that are no rows may take more ports than there are.
const MADE: usize = 40;

/// A step on a grid.
#[derive(Clone, Debug)]
pub struct OnGrid {
    /// The graph; all its equations have a place.
    pub graph: StepGraph,
    /// Their places.
    pub mapping: Mapping,
    /// The cost of that.
    pub cost: MappingCost,
    /// Cycles per step of a first schedule.
    pub period: u32,
}

/// The step on the grid that takes the fewest cycles; none if most products are not in sums that read more than a PE has
/// ports, or no grid does with so many.
pub fn grid(graph: &StepGraph, pes: u32, ports: u32, latency: Latency) -> Option<OnGrid> {
    let rows = rows(graph, pes, ports)?;
    let (homes, inputs) = (homes(graph, &rows, pes), inputs(graph, &rows));
    let ground = Ground { graph, rows, homes, inputs };
    let work = Work::of(graph, &ground.rows);
    let mut shapes = shapes(pes, ports, number(ground.inputs.len()));
    shapes.sort_by_cached_key(|shape| (shape.estimate(&work, latency), shape.ports(), shape.clone()));
    let made = shapes.iter().take(MADE).filter_map(|shape| {
        let graph = shape.applied(&ground);
        let mapping = placed(&graph)?;
        let cost = Problem::of(&graph).cost(&mapping);
        (cost.max_in_degree <= ports).then_some((graph, mapping, cost))
    });
    let scheduled = made.take(SCHEDULED).map(|(graph, mapping, cost)| {
        let period = draft(&graph, &mapping, latency).period;
        OnGrid { graph, mapping, cost, period }
    });
    scheduled.min_by_key(|on_grid| (on_grid.period, on_grid.cost.connections))
}

/// Equations that read more others than PEs have ports, if they have at least half of the products.
fn rows(graph: &StepGraph, pes: u32, ports: u32) -> Option<Vec<EquationId>> {
    let (loads, sources, tabled) = (graph.loads(), sources(graph), tabled(graph));
    let is_row = |equation: &EquationId| sources[*equation] > ports && !tabled[*equation];
    let rows: Vec<EquationId> = loads.ids().filter(is_row).collect();
    let of = |equations: &mut dyn Iterator<Item = EquationId>| -> u64 {
        equations.map(|equation| u64::from(loads[equation])).sum()
    };
    let dense = 2 * of(&mut rows.iter().copied()) >= of(&mut loads.ids());
    (pes > ports && rows.len() > 1 && dense).then_some(rows)
}

/// What all shapes are cut from.
struct Ground<'a> {
    graph: &'a StepGraph,
    rows: Vec<EquationId>,
    /// The PE of each equation.
    homes: List<EquationId, PeId>,
    /// The inputs that rows read, each with the first row that does.
    inputs: BTreeMap<u32, EquationId>,
}

/// What there is to compute.
struct Work {
    /// Products of the step.
    products: u64,
    /// Chains of rows.
    chains: u64,
    /// Number of rows.
    rows: usize,
}

impl Work {
    fn of(graph: &StepGraph, rows: &[EquationId]) -> Work {
        let of_rows = graph.chains.iter().filter(|chain| rows.binary_search(&chain.equation).is_ok());
        let products = graph.loads().iter().map(|load| u64::from(*load)).sum();
        Work { products, chains: of_rows.count() as u64, rows: rows.len() }
    }
}

/// A digit of the numbers of groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Level {
    /// How many values it has.
    size: u32,
    /// Whether sums go round a ring, by one port, or in one hop, by a port for each other value.
    ring: bool,
}

impl Level {
    fn ports(self) -> u32 {
        if self.ring { 1 } else { self.size - 1 }
    }

    fn hops(self) -> u32 {
        if self.ring { self.size - 1 } else { 1 }
    }
}

/// How PEs form groups.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Shape {
    /// PEs of a group.
    members: u32,
    /// Digits of the numbers of groups, in the order in which sums settle them.
    levels: Vec<Level>,
    /// External inputs that rows read.
    inputs: u32,
    /// Whether every row reads them itself, and no group does for others.
    inputs_at_home: bool,
}

/// All shapes of so many PEs that do with so many ports, for rows that read so many inputs.
fn shapes(pes: u32, ports: u32, inputs: u32) -> Vec<Shape> {
    let mut shapes = Vec::new();
    let ways: &[bool] = if inputs > 0 { &[false, true] } else { &[false] };
    let members = (1..pes).filter(|members| pes.is_multiple_of(*members));
    for (members, inputs_at_home) in members.flat_map(|members| ways.iter().map(move |way| (members, *way))) {
        let mut open = vec![(Shape { members, levels: Vec::new(), inputs, inputs_at_home }, pes / members)];
        while let Some((shape, left)) = open.pop() {
            if shape.ports() > ports {
                continue;
            }
            if left == 1 {
                shapes.push(shape);
                continue;
            }
            for size in (2..=left).filter(|size| left.is_multiple_of(*size)) {
                for ring in [false, true].into_iter().filter(|ring| !ring || size > 2) {
                    let mut longer = shape.clone();
                    longer.levels.push(Level { size, ring });
                    open.push((longer, left / size));
                }
            }
        }
    }
    shapes
}

impl Shape {
    fn groups(&self) -> u32 {
        self.levels.iter().map(|level| level.size).product()
    }

    fn pes(&self) -> u32 {
        self.members * self.groups()
    }

    /// Ports of a PE: for its fellow members, for the groups from which sums come, and for inputs.
    fn ports(&self) -> u32 {
        let inputs = if self.inputs_at_home { self.inputs } else { 0 };
        self.members - 1 + self.levels.iter().map(|level| level.ports()).sum::<u32>() + inputs
    }

    /// Cycles of a step, about: what PEs issue, or what the longest way takes, and a part of it for what they wait.
    fn estimate(&self, work: &Work, latency: Latency) -> u64 {
        let &Work { products, chains, rows } = work;
        let stages = (chains / rows as u64).max(1);
        // The largest parts are those of the most rows, and of the most of what these read.
        let largest = |of: u32| (rows.div_ceil(at(of)) * at(of)) as f64 / rows as f64;
        let products = (products as f64 * largest(self.groups()) * largest(self.members)) as u64;
        let apart = if self.inputs_at_home { 0 } else { chains * u64::from(self.inputs) / u64::from(self.members) };
        let issued = (products + chains * u64::from(self.groups() - 1)).div_ceil(u64::from(self.pes())) + apart;
        let hops: u32 = self.levels.iter().map(|level| level.hops()).sum();
        let hop = u64::from(latency.write() + Latency::SEND_TO_RECEIVE + Latency::WRITE_TO_READ);
        let chain = rows.div_ceil(at(self.groups())) as u64;
        let way = stages * (chain + u64::from(hops + 1) * hop);
        8 * issued.max(way) + way
    }

    /// The group to which a sum that is at home elsewhere goes on.
    fn next(&self, group: u32, home: u32) -> u32 {
        let mut weight = 1;
        for level in &self.levels {
            let (here, there) = (group / weight % level.size, home / weight % level.size);
            if here != there {
                let to = if level.ring { (here + 1) % level.size } else { there };
                return group - here * weight + to * weight;
            }
            weight *= level.size;
        }
        home
    }

    /// The group of a PE.
    fn group(&self, pe: PeId) -> u32 {
        pe.number() / self.members
    }

    /// The graph with the sums of rows cut as this shape has it.
    fn applied(&self, ground: &Ground) -> StepGraph {
        let Ground { graph, rows, homes, inputs } = ground;
        let mut cut = Cut {
            shape: self,
            inputs: inputs.iter().map(|(input, row)| (*input, self.group(homes[*row]))).collect(),
            graph: StepGraph::clone(graph),
            parts: BTreeMap::new(),
            serials: BTreeMap::new(),
            chains: List::new(),
            terms: Vec::new(),
        };
        for (equation, home) in cut.graph.equations.iter_mut().zip(homes) {
            equation.place = Some(*home);
        }
        for chain in &graph.chains {
            let terms = graph.chain_terms(chain);
            match rows.binary_search(&chain.equation) {
                Ok(_) => cut.row(chain, terms, homes),
                Err(_) => cut.add(chain.clone(), terms),
            }
        }
        let Cut { graph, chains, terms, .. } = cut;
        StepGraph { chains, terms, ..graph }
    }
}

/// The PE of each equation: rows are dealt evenly, and others are where a row, or what goes with one, is that they read or
/// that reads them.
fn homes(graph: &StepGraph, rows: &[EquationId], pes: u32) -> List<EquationId, PeId> {
    let dealt = |index: usize, of: usize| PeId::at(index * at(pes) / of);
    let mut homes: List<EquationId, Option<PeId>> = List::filled(None, graph.equations.len());
    for (index, row) in rows.iter().enumerate() {
        homes[*row] = Some(dealt(index, rows.len()));
    }
    let mut reads: List<EquationId, Vec<EquationId>> = List::filled(Vec::new(), graph.equations.len());
    let mut readers = reads.clone();
    for (read, reader) in graph.dependencies() {
        reads[reader].push(read);
        readers[read].push(reader);
    }
    // What an equation reads comes first: a function of a state goes with the state, not with one of its many readers.
    let mut to_readers: VecDeque<EquationId> = rows.iter().copied().collect();
    let mut to_reads = to_readers.clone();
    loop {
        let next = to_readers.pop_front().map(|settled| (settled, &readers[settled]));
        let next = next.or_else(|| to_reads.pop_front().map(|settled| (settled, &reads[settled])));
        let Some((settled, beside)) = next else { break };
        for other in beside {
            if homes[*other].is_none() {
                homes[*other] = homes[settled];
                to_readers.push_back(*other);
                to_reads.push_back(*other);
            }
        }
    }
    let left: Vec<EquationId> = homes.ids().filter(|equation| homes[*equation].is_none()).collect();
    for (index, equation) in left.iter().enumerate() {
        homes[*equation] = Some(dealt(index, left.len()));
    }
    homes.into_iter().map(|home| home.expect("all are settled")).collect()
}

/// The inputs that rows read, each with the first row that does.
fn inputs(graph: &StepGraph, rows: &[EquationId]) -> BTreeMap<u32, EquationId> {
    let mut inputs = BTreeMap::new();
    for chain in graph.chains.iter().filter(|chain| rows.binary_search(&chain.equation).is_ok()) {
        for term in graph.chain_terms(chain) {
            if let Role::Input(input) = graph.value(term.operand).role {
                inputs.entry(input).or_insert(chain.equation);
            }
        }
    }
    inputs
}

/// Rows under the knife.
struct Cut<'a> {
    shape: &'a Shape,
    /// The group that reads each input, unless all do.
    inputs: BTreeMap<u32, u32>,
    graph: StepGraph,
    /// The equation for the part of a row that a group computes.
    parts: BTreeMap<(EquationId, u32), EquationId>,
    /// Partial sums of each row so far.
    serials: BTreeMap<EquationId, u32>,
    chains: List<pe_ir::index::ChainId, Chain>,
    terms: Vec<Term>,
}

impl Cut<'_> {
    fn add(&mut self, chain: Chain, terms: &[Term]) {
        let first = number(self.terms.len());
        self.terms.extend_from_slice(terms);
        self.chains.push(Chain { terms: first..number(self.terms.len()), ..chain });
    }

    /// Cuts a chain of a row: each group adds its products to what other groups hand on.
    fn row(&mut self, chain: &Chain, terms: &[Term], homes: &List<EquationId, PeId>) {
        let row = chain.equation;
        let home = self.shape.group(homes[row]);
        let mut sums: BTreeMap<u32, Vec<Term>> = BTreeMap::new();
        for term in terms {
            let value = self.graph.value(term.operand);
            let group = match (value.role, value.equation) {
                _ if matches!(term.factor, Factor::Value(_)) => home,
                (Role::Input(_), _) if self.shape.inputs_at_home => home,
                (Role::Input(input), _) => self.inputs[&input],
                (_, Some(equation)) => homes.find(equation).map_or(home, |pe| self.shape.group(*pe)),
                (_, None) => home,
            };
            sums.entry(group).or_default().push(*term);
        }
        // Groups on the way, which those that are farthest from home come before.
        let mut distances: BTreeMap<u32, u32> = BTreeMap::new();
        for group in sums.keys() {
            let way: Vec<u32> =
                std::iter::successors(Some(*group), |group| (*group != home).then(|| self.shape.next(*group, home)))
                    .collect();
            distances.extend(way.iter().rev().zip(0u32..).map(|(group, distance)| (*group, distance)));
        }
        let mut order: Vec<(u32, u32)> = distances.into_iter().map(|(group, distance)| (distance, group)).collect();
        order.sort_unstable_by(|one, other| other.cmp(one));
        for (_, group) in order.into_iter().filter(|(_, group)| *group != home) {
            let value = self.part(row, group, homes);
            let equation = self.graph.value(value).equation.expect("of a part");
            let write = Write { value, base: None, weight: 0 };
            let part = Chain { equation, terms: 0..0, interim: None, write, second: None, function: None };
            let own = sums.remove(&group).unwrap_or_default();
            self.add(part, &own);
            let sum = Term::new(value, Factor::Coefficient(1.0));
            sums.entry(self.shape.next(group, home)).or_default().push(sum);
        }
        let own = sums.remove(&home).unwrap_or_default();
        self.add(chain.clone(), &own);
    }

    /// A new partial sum of a row that a group computes.
    fn part(&mut self, row: EquationId, group: u32, homes: &List<EquationId, PeId>) -> ValueId {
        let graph = &mut self.graph;
        let serial = self.serials.entry(row).or_default();
        *serial += 1;
        let known = self.parts.get(&(row, group)).copied();
        let equation = known.unwrap_or_else(|| {
            let member = homes[row].number() % self.shape.members;
            let Equation { name, span, .. } = &graph.equations[row];
            let parts = self.parts.range((row, 0)..=(row, u32::MAX)).count();
            let name = format!("{name}.part{}", parts + 1);
            let place = Some(PeId::new(group * self.shape.members + member));
            let part = Equation { name, span: *span, place };
            graph.equations.push(part)
        });
        self.parts.insert((row, group), equation);
        let value = ValueId::at(graph.values.len());
        graph.values.push(Value { role: Role::Partial(row, *serial), equation: Some(equation), factor: false });
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_come_home_by_the_ports_that_there_are() {
        for (pes, ports) in [(12, 5), (16, 6), (36, 8), (96, 8), (64, 15), (7, 3), (97, 8)] {
            let inputs = shapes(pes, ports, 2);
            assert!(inputs.iter().all(|shape| shape.ports() <= ports));
            assert_eq!(inputs.iter().filter(|shape| shape.inputs_at_home).count(), shapes(pes, ports - 2, 0).len());
            let shapes = shapes(pes, ports, 0);
            assert!(!shapes.is_empty(), "a ring of all always does");
            for shape in shapes {
                assert_eq!(shape.pes(), pes);
                assert!(shape.ports() <= ports);
                let hops: u32 = shape.levels.iter().map(|level| level.hops()).sum();
                let mut before: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
                for home in 0..shape.groups() {
                    for from in 0..shape.groups() {
                        let way = std::iter::successors(Some(from), |group| {
                            (*group != home).then(|| shape.next(*group, home))
                        });
                        let way: Vec<u32> = way.take(1 + at(hops)).collect();
                        assert_eq!(way.last(), Some(&home), "{shape:?} from {from}");
                        for pair in way.windows(2) {
                            before.entry(pair[1]).or_default().push(pair[0]);
                        }
                    }
                }
                for groups in before.values_mut() {
                    groups.sort_unstable();
                    groups.dedup();
                    assert_eq!(groups.len() + at(shape.members) - 1, at(shape.ports()), "{shape:?}");
                }
            }
        }
    }
}
