//! The mapping problem in flat arrays, and its views as petgraph graphs.

use pe_ir::graph::{FixedPoint, Role, StepGraph, Term};
use pe_ir::index::{EquationId, List, PeId, at, number};
use pe_ir::mapping::{Mapping, MappingCost};
use pe_ir::program::LinkSource;
use petgraph::graph::DiGraph;

use super::alike::Alike;

/// What the mapper knows of a step graph: loads, dependencies and reads of external inputs.
///
/// The dependencies are stored undirected, once per pair of equations, as [`Neighbour`]s. External inputs are further
/// nodes behind the equations; the mapper gives each a place of its own outside the network, so that the same counts
/// serve links between PEs and input ports.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Problem {
    loads: Vec<u32>,
    inputs: u32,
    /// Start of each equation's part of `neighbours`; one more than there are equations.
    offsets: Vec<u32>,
    neighbours: Vec<Neighbour>,
    alike: Alike,
}

/// A node next to an equation, and whether the equation reads it, is read by it, or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Neighbour(u32);

impl Neighbour {
    const READ: u32 = 1;
    const READER: u32 = 2;

    /// Index of an equation, or number of equations + index of an input.
    pub(super) fn node(self) -> usize {
        at(self.0 >> 2)
    }

    /// 1 if the equation reads the node, else 0.
    pub(super) fn reads(self) -> u32 {
        self.0 & 1
    }

    /// 1 if the node reads the equation, else 0.
    pub(super) fn is_reader(self) -> u32 {
        self.0 >> 1 & 1
    }
}

impl Problem {
    /// The problem of a step graph.
    pub fn of(graph: &StepGraph) -> Problem {
        let mut input_reads = Vec::new();
        for chain in &graph.chains {
            for operand in graph.chain_terms(chain).iter().flat_map(Term::operands) {
                if let Role::Input(input) = graph.value(operand).role {
                    input_reads.push((input, chain.equation.number()));
                }
            }
        }
        let arcs = graph.dependencies().into_iter().map(|(read, reader)| (read.number(), reader.number()));
        Problem::new(graph.loads().into_vec(), &arcs.collect::<Vec<_>>(), &input_reads)
    }

    /// The problem of a step graph whose operands with equal coefficients are paired as far as a mapping allows;
    /// `optimistic` is the graph with all pairs.
    pub fn with_pairs(graph: &StepGraph, fixed: &FixedPoint, optimistic: &StepGraph) -> Problem {
        Problem { alike: Alike::of(graph, fixed), ..Problem::of(optimistic) }
    }

    /// The problem with these loads, arcs `(read equation, reader)` and pairs `(input, reader)`; repeats are allowed.
    ///
    /// # Panics
    /// If an index is out of range or there are 2^30 nodes or more.
    pub fn new(loads: Vec<u32>, arcs: &[(u32, u32)], input_reads: &[(u32, u32)]) -> Problem {
        let equations = number(loads.len());
        let inputs = input_reads.iter().map(|&(input, _)| input + 1).max().unwrap_or(0);
        assert!(equations + inputs < 1 << 30, "too many equations");
        let mut sides: Vec<(u32, u32)> = Vec::with_capacity(2 * arcs.len() + input_reads.len());
        for &(read, reader) in arcs.iter().filter(|(read, reader)| read != reader) {
            assert!(read < equations && reader < equations, "arc out of range");
            sides.push((reader, read << 2 | Neighbour::READ));
            sides.push((read, reader << 2 | Neighbour::READER));
        }
        for &(input, reader) in input_reads {
            assert!(reader < equations, "reader of an input out of range");
            sides.push((reader, (equations + input) << 2 | Neighbour::READ));
        }
        sides.sort_unstable();
        let mut offsets = vec![0; loads.len() + 1];
        let mut neighbours: Vec<Neighbour> = Vec::with_capacity(sides.len());
        let mut last = (u32::MAX, u32::MAX);
        for (equation, packed) in sides {
            if last == (equation, packed >> 2) {
                let merged = neighbours.last_mut().expect("a neighbour before its repetition");
                merged.0 |= packed;
            } else {
                neighbours.push(Neighbour(packed));
                last = (equation, packed >> 2);
            }
            offsets[at(equation) + 1] = number(neighbours.len());
        }
        for equation in 0..loads.len() {
            offsets[equation + 1] = offsets[equation + 1].max(offsets[equation]);
        }
        Problem { loads, inputs, offsets, neighbours, alike: Alike::default() }
    }

    /// Number of equations.
    pub fn equations(&self) -> u32 {
        number(self.loads.len())
    }

    /// Issue slots of each equation; if operands are paired, with all pairs that some mapping allows.
    pub fn loads(&self) -> &[u32] {
        &self.loads
    }

    /// Number of external inputs, up to the last one read.
    pub fn inputs(&self) -> u32 {
        self.inputs
    }

    /// Operands with equal coefficients.
    pub(super) fn alike(&self) -> &Alike {
        &self.alike
    }

    /// Whether issue slots depend on the mapping.
    pub fn has_pairs(&self) -> bool {
        !self.alike.is_empty()
    }

    /// Issue slots of all equations; if operands are paired, with all pairs that some mapping allows.
    pub fn total_load(&self) -> u64 {
        self.loads.iter().map(|&load| u64::from(load)).sum()
    }

    /// Nodes next to an equation, by rising index, so that inputs come last.
    pub(super) fn neighbours(&self, equation: usize) -> &[Neighbour] {
        &self.neighbours[at(self.offsets[equation])..self.offsets[equation + 1] as usize]
    }

    /// Equations next to an equation.
    pub(super) fn adjacent(&self, equation: usize) -> impl DoubleEndedIterator<Item = usize> + '_ {
        self.neighbours(equation).iter().map(|neighbour| neighbour.node()).filter(|&node| node < self.loads.len())
    }

    /// The dependencies between some equations, all of them with a load of 1, in the order given.
    pub(super) fn part(&self, equations: &[usize]) -> Problem {
        let mut index_of = vec![u32::MAX; self.loads.len()];
        equations.iter().enumerate().for_each(|(index, equation)| index_of[*equation] = number(index));
        let mut arcs = Vec::new();
        for (index, equation) in equations.iter().enumerate() {
            for neighbour in self.neighbours(*equation).iter().filter(|neighbour| neighbour.reads() == 1) {
                if let Some(read) = index_of.get(neighbour.node()).filter(|read| **read != u32::MAX) {
                    arcs.push((*read, number(index)));
                }
            }
        }
        Problem::new(vec![1; equations.len()], &arcs, &[])
    }

    /// What each PE of a mapping reads, as sorted pairs (PE, what it reads).
    pub(super) fn sources(&self, mapping: &Mapping) -> Vec<(PeId, LinkSource)> {
        let mut sources: Vec<(PeId, LinkSource)> = Vec::new();
        for (equation, &pe) in mapping.pe_of.iter().enumerate() {
            for neighbour in self.neighbours(equation).iter().filter(|neighbour| neighbour.reads() == 1) {
                let node = neighbour.node();
                let source = match node.checked_sub(self.loads.len()) {
                    Some(input) => LinkSource::Input(number(input)),
                    None => LinkSource::Pe(mapping.pe_of[EquationId::at(node)]),
                };
                if source != LinkSource::Pe(pe) {
                    sources.push((pe, source));
                }
            }
        }
        sources.sort_unstable();
        sources.dedup();
        sources
    }

    /// The cost of a mapping, computed from nothing.
    pub fn cost(&self, mapping: &Mapping) -> MappingCost {
        let mut loads = List::filled(0, at(mapping.pes));
        let place_of: Vec<u32> = mapping.pe_of.iter().map(|pe| pe.number()).collect();
        let own = self.alike.own(&place_of);
        for (equation, (&pe, &load)) in mapping.pe_of.iter().zip(&self.loads).enumerate() {
            loads[pe] += load + self.alike.missed(equation, &own);
        }
        let sources = self.sources(mapping);
        let degrees = sources.chunk_by(|left, right| left.0 == right.0).map(<[_]>::len);
        let max_in_degree = number(degrees.max().unwrap_or(0));
        let between_pes = sources.iter().filter_map(|&(pe, source)| Some((pe, source.pe()?)));
        let mut pairs: Vec<(PeId, PeId)> = between_pes.map(|(pe, source)| (pe.min(source), pe.max(source))).collect();
        pairs.sort_unstable();
        pairs.dedup();
        MappingCost { max_load: loads.into_iter().max().unwrap_or(0), connections: number(pairs.len()), max_in_degree }
    }

    /// The ODE-dependency graph: equations weighted by load, arcs from the read equation to its reader.
    pub fn ode_graph(&self) -> DiGraph<u32, ()> {
        let mut graph = DiGraph::with_capacity(self.loads.len(), self.neighbours.len());
        let nodes: Vec<_> = self.loads.iter().map(|&load| graph.add_node(load)).collect();
        for (equation, &reader) in nodes.iter().enumerate() {
            for neighbour in self.neighbours(equation).iter().filter(|neighbour| neighbour.reads() == 1) {
                if let Some(&read) = nodes.get(neighbour.node()) {
                    graph.add_edge(read, reader, ());
                }
            }
        }
        graph
    }

    /// The PE-dependency graph of a mapping: PEs weighted by load, links by the number of dependencies they carry.
    pub fn pe_graph(&self, mapping: &Mapping) -> DiGraph<u32, u32> {
        let mut graph = DiGraph::new();
        let nodes: List<PeId, _> = (0..mapping.pes).map(|_| graph.add_node(0)).collect();
        let mut arcs = Vec::new();
        for (equation, &pe) in mapping.pe_of.iter().enumerate() {
            graph[nodes[pe]] += self.loads[equation];
            for neighbour in self.neighbours(equation).iter().filter(|neighbour| neighbour.reads() == 1) {
                match mapping.pe_of.get(neighbour.node()) {
                    Some(&source) if source != pe => arcs.push((source, pe)),
                    _ => {}
                }
            }
        }
        arcs.sort_unstable();
        for link in arcs.chunk_by(|left, right| left == right) {
            let (source, reader) = link[0];
            graph.add_edge(nodes[source], nodes[reader], number(link.len()));
        }
        graph
    }
}
