//! Routes of values over several PEs, where PEs have fewer input ports than places that they read.
//!
//! Each PE gets ports for the places that it reads most of, and one for the PE before it in a ring, so that every value can
//! reach every PE. What a PE reads of others comes by PEs on the way, which copy it: on each such PE a relay, an equation
//! whose chains have one product with the coefficient 1, exact in every format. Routes change no result. A copy costs an
//! issue slot, and its readers wait for a chain more. All readers of a value share the PEs on its way, and busy PEs are
//! avoided.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use pe_ir::graph::{Role, StepGraph, ValueId};
use pe_ir::index::{EquationId, List, PeId, at, number};
use pe_ir::mapping::Mapping;
use pe_ir::program::LinkSource;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::relay::{Copies, Relayed};

/// A step graph with relays on the way of values, and the PEs of all its equations.
#[derive(Clone, Debug)]
pub struct Routed {
    /// The graph.
    pub relayed: Relayed,
    /// The mapping, with relays behind the equations that were there before.
    pub mapping: Mapping,
}

/// What the names of relays have between that of an equation and the number of their PE, from 1.
const INFIX: &str = ".hop";

/// Whether an equation of this name is a relay on the way of values.
pub fn is_hop(name: &str) -> bool {
    name.rsplit_once(INFIX).is_some_and(|(_, number)| number.parse::<u32>().is_ok())
}

/// The graph with routes that need at most so many input ports on each PE. None if there are fewer ports than a ring of the
/// PEs and the external inputs take.
pub fn route(graph: &StepGraph, mapping: &Mapping, ports: u32) -> Option<Routed> {
    let signals = signals(graph, mapping);
    let topology = Topology::of(&signals, mapping.pes, ports)?;
    let mut ways = Ways::new(&topology, graph, mapping);
    let parents = ways.of_all(&signals)?;

    let mut copies = Copies::of(graph);
    let mut routed = mapping.clone();
    let mut relays: List<PeId, Option<EquationId>> = List::filled(None, at(mapping.pes));
    let of_value: BTreeMap<ValueId, usize> = (0..)
        .zip(&signals)
        .flat_map(|(place, signal)| signal.values.iter().map(move |value| (*value, place)))
        .collect();
    for chain in &graph.chains {
        let reader = mapping.pe_of[chain.equation];
        for term in at(chain.terms.start)..chain.terms.end as usize {
            let original = graph.terms[term].operand;
            let Some(place) = of_value.get(&original).copied() else { continue };
            let (source, parents) = (signals[place].source, &parents[place]);
            if source == LinkSource::Pe(reader) {
                continue;
            }
            // From the reader back to where the value comes from; the copies are then made in the other direction.
            let mut hops = Vec::new();
            let mut from = parents[reader].expect("every reader has a route");
            while let (LinkSource::Pe(pe), true) = (from, from != source) {
                hops.push(pe);
                from = parents[pe].expect("PEs on the way have one");
            }
            let mut copy = original;
            for pe in hops.into_iter().rev() {
                let named = graph.equation_of(original).unwrap_or(&graph.equations[chain.equation]);
                let relay = *relays[pe].get_or_insert_with(|| {
                    routed.pe_of.push(pe);
                    copies.relay(named, INFIX, pe.number() + 1)
                });
                copy = copies.copy(original, copy, relay, pe.number() + 1);
            }
            if copy != original {
                copies.read(term, copy);
            }
        }
    }
    Some(Routed { relayed: copies.woven(), mapping: routed })
}

/// Values that come from one place and are read by the same PEs.
#[derive(Debug)]
struct Signal {
    source: LinkSource,
    readers: Vec<PeId>,
    values: Vec<ValueId>,
}

/// All values that are read on other PEs than that where they are.
fn signals(graph: &StepGraph, mapping: &Mapping) -> Vec<Signal> {
    let mut reads: Vec<(ValueId, PeId)> = Vec::new();
    for chain in &graph.chains {
        let reader = mapping.pe_of[chain.equation];
        let operands = graph.chain_terms(chain).iter().map(|term| term.operand);
        reads.extend(operands.filter_map(|value| {
            let source = source(graph, mapping, value)?;
            (source != LinkSource::Pe(reader)).then_some((value, reader))
        }));
    }
    reads.sort_unstable();
    reads.dedup();
    let mut alike: BTreeMap<(LinkSource, Vec<PeId>), Vec<ValueId>> = BTreeMap::new();
    for reads in reads.chunk_by(|left, right| left.0 == right.0) {
        let value = reads[0].0;
        let source = source(graph, mapping, value).expect("it is read elsewhere");
        alike.entry((source, reads.iter().map(|read| read.1).collect())).or_default().push(value);
    }
    alike.into_iter().map(|((source, readers), values)| Signal { source, readers, values }).collect()
}

/// Where a value comes from; none of constants, which are wherever they are read.
fn source(graph: &StepGraph, mapping: &Mapping, value: ValueId) -> Option<LinkSource> {
    let value = graph.value(value);
    match value.role {
        Role::Input(input) => Some(LinkSource::Input(input)),
        _ => value.equation.map(|equation| LinkSource::Pe(mapping.pe_of[equation])),
    }
}

/// Which places each PE has a port for.
#[derive(Debug)]
struct Topology {
    /// The PEs that have a port for a place.
    readers: BTreeMap<LinkSource, Vec<PeId>>,
}

impl Topology {
    fn of(signals: &[Signal], pes: u32, ports: u32) -> Option<Topology> {
        let mut weights: BTreeMap<(PeId, LinkSource), u64> = BTreeMap::new();
        for signal in signals {
            for reader in &signal.readers {
                *weights.entry((*reader, signal.source)).or_default() += signal.values.len() as u64;
            }
        }
        let mut of_pe: List<PeId, Vec<LinkSource>> = List::filled(Vec::new(), at(pes));
        let fits = |sources: &Vec<LinkSource>| sources.len() < at(ports);
        for (before, pe) in ring(&weights, pes) {
            of_pe[pe].push(LinkSource::Pe(before));
        }
        // Each input enters at the PE that has most ports left, among its readers if possible.
        let inputs: Vec<LinkSource> = signals.iter().map(|signal| signal.source).collect();
        let mut inputs: Vec<LinkSource> = inputs.into_iter().filter(|source| source.pe().is_none()).collect();
        inputs.dedup();
        for input in inputs {
            let free = PeId::all(pes).filter(|pe| fits(&of_pe[*pe]));
            let entry = free.min_by_key(|pe| (!weights.contains_key(&(*pe, input)), of_pe[*pe].len(), *pe))?;
            of_pe[entry].push(input);
        }
        if of_pe.iter().any(|sources| sources.len() > at(ports)) {
            return None;
        }
        // Among equals in an order without a pattern: if all PEs had ports for the same few, ways would be long.
        let mut shuffled: Vec<(&(PeId, LinkSource), &u64)> = weights.iter().collect();
        shuffled.shuffle(&mut ChaCha8Rng::seed_from_u64(u64::from(pes)));
        shuffled.sort_by_key(|(_, weight)| Reverse(**weight));
        for (&(pe, source), _) in shuffled {
            let sources = &mut of_pe[pe];
            if fits(sources) && !sources.contains(&source) {
                sources.push(source);
            }
        }
        let mut readers: BTreeMap<LinkSource, Vec<PeId>> = BTreeMap::new();
        for (pe, sources) in of_pe.numbered() {
            for source in sources {
                readers.entry(*source).or_default().push(pe);
            }
        }
        Some(Topology { readers })
    }

    fn readers(&self, source: LinkSource) -> &[PeId] {
        self.readers.get(&source).map_or(&[], Vec::as_slice)
    }
}

/// Pairs of neighbours on a ring of all PEs, each next to one that reads much of it where there is one left.
fn ring(weights: &BTreeMap<(PeId, LinkSource), u64>, pes: u32) -> Vec<(PeId, PeId)> {
    if pes < 2 {
        return Vec::new();
    }
    let mut free: Vec<PeId> = PeId::all(pes).skip(1).collect();
    let (mut last, mut pairs) = (PeId::new(0), Vec::new());
    while !free.is_empty() {
        let weight = |pe: &PeId| weights.get(&(*pe, LinkSource::Pe(last))).copied().unwrap_or(0);
        let place =
            (0..free.len()).min_by_key(|place| (Reverse(weight(&free[*place])), free[*place])).expect("not empty");
        let next = free.remove(place);
        pairs.push((last, next));
        last = next;
    }
    pairs.push((last, PeId::new(0)));
    pairs
}

/// Cost of a copy on a PE of average load, and of the next PE.
const COPY: u64 = 16;
const HOP: u64 = 4;
/// What load above the average adds to the cost of a copy: this times its part of the average, and no more than that.
const BUSY: u64 = 2000;
const MOST: u64 = 512;

/// How often routes are found anew, at most.
const ANEW: usize = 6;

/// For each PE on the way of a signal the place that the signal comes from.
type Parents = List<PeId, Option<LinkSource>>;

/// Finds routes, one signal after the other.
struct Ways<'a> {
    topology: &'a Topology,
    loads: List<PeId, u64>,
    total: u64,
}

impl<'a> Ways<'a> {
    fn new(topology: &'a Topology, graph: &StepGraph, mapping: &Mapping) -> Self {
        let mut loads = List::filled(0, at(mapping.pes));
        for (equation, load) in graph.loads().numbered() {
            loads[mapping.pe_of[equation]] += u64::from(*load);
        }
        let total = loads.iter().sum();
        Ways { topology, loads, total }
    }

    /// Routes of all signals. The first ones are found in ignorance of the others, so each is found anew when all are
    /// known, as long as that leaves fewer copies.
    fn of_all(&mut self, signals: &[Signal]) -> Option<Vec<Parents>> {
        let mut best: Vec<Parents> = signals.iter().map(|signal| self.of_signal(signal)).collect::<Option<_>>()?;
        let mut fewest = self.total;
        let mut all = best.clone();
        for _ in 0..ANEW {
            for (signal, parents) in signals.iter().zip(&mut all) {
                self.forget(signal, parents);
                *parents = self.of_signal(signal)?;
            }
            if self.total >= fewest {
                break;
            }
            fewest = self.total;
            best.clone_from(&all);
        }
        Some(best)
    }

    /// Takes back the copies of a signal.
    fn forget(&mut self, signal: &Signal, parents: &Parents) {
        let before = parents.iter().flatten().filter(|from| **from != signal.source);
        let mut copying: Vec<PeId> = before.filter_map(|from| from.pe()).collect();
        copying.sort_unstable();
        copying.dedup();
        let copies = signal.values.len() as u64;
        copying.iter().for_each(|pe| self.loads[*pe] -= copies);
        self.total -= copies * copying.len() as u64;
    }

    /// For each PE that reads or copies a signal the place that it comes from; none if a reader cannot be reached.
    fn of_signal(&mut self, signal: &Signal) -> Option<Parents> {
        let pes = self.loads.len();
        let mut parents: Parents = List::filled(None, pes);
        let mut copies = List::filled(false, pes);
        let mut left: List<PeId, bool> = List::filled(false, pes);
        signal.readers.iter().for_each(|reader| left[*reader] = true);
        let mut missing = signal.readers.len();
        for reader in self.topology.readers(signal.source) {
            if std::mem::take(&mut left[*reader]) {
                parents[*reader] = Some(signal.source);
                missing -= 1;
            }
        }
        while missing > 0 {
            let (reader, from) = self.nearest(signal, &parents, &copies, &left)?;
            let (mut pe, mut parent) = (reader, from[reader]);
            while parents[pe].is_none() {
                let place = parent.expect("it was reached");
                parents[pe] = Some(place);
                missing -= usize::from(std::mem::take(&mut left[pe]));
                let Some(before) = place.pe().filter(|_| place != signal.source) else { break };
                if !std::mem::replace(&mut copies[before], true) {
                    self.loads[before] += signal.values.len() as u64;
                    self.total += signal.values.len() as u64;
                }
                (pe, parent) = (before, from[before]);
            }
        }
        Some(parents)
    }

    /// The reader that is cheapest to reach from where a signal is, and the way to each PE that is as near.
    fn nearest(
        &self,
        signal: &Signal,
        parents: &Parents,
        copies: &List<PeId, bool>,
        left: &List<PeId, bool>,
    ) -> Option<(PeId, List<PeId, Option<LinkSource>>)> {
        let mut from: List<PeId, Option<LinkSource>> = List::filled(None, left.len());
        let mut costs: List<PeId, u64> = List::filled(u64::MAX, left.len());
        let mut heap = BinaryHeap::new();
        let mut extend = |heap: &mut BinaryHeap<_>, place: LinkSource, cost: u64| {
            for pe in self.topology.readers(place) {
                if cost < costs[*pe] && signal.source != LinkSource::Pe(*pe) {
                    costs[*pe] = cost;
                    from[*pe] = Some(place);
                    heap.push(Reverse((cost, *pe)));
                }
            }
        };
        extend(&mut heap, signal.source, HOP);
        for pe in (0..number(left.len())).map(PeId::new).filter(|pe| parents[*pe].is_some()) {
            heap.push(Reverse((depth(pe, signal, parents) * HOP, pe)));
        }
        let mut done = List::filled(false, left.len());
        while let Some(Reverse((cost, pe))) = heap.pop() {
            if left[pe] {
                return Some((pe, from));
            }
            if !std::mem::replace(&mut done[pe], true) {
                let copy = if copies[pe] { 0 } else { self.copy(pe, signal) };
                extend(&mut heap, LinkSource::Pe(pe), cost + copy + HOP);
            }
        }
        None
    }

    /// What a copy of a signal costs on a PE.
    fn copy(&self, pe: PeId, signal: &Signal) -> u64 {
        let average = (self.total / self.loads.len() as u64).max(1);
        let above = (self.loads[pe] + signal.values.len() as u64).saturating_sub(average);
        COPY + (BUSY * above / average).min(MOST)
    }
}

/// Links from the source of a signal to a PE that it reaches.
fn depth(pe: PeId, signal: &Signal, parents: &Parents) -> u64 {
    let before = |pe: &PeId| parents[*pe].filter(|from| *from != signal.source).and_then(LinkSource::pe);
    std::iter::successors(Some(pe), before).count() as u64
}
