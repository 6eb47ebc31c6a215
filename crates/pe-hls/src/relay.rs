//! Relays: equations that copy values of others, and those of hubs, values of very high fan-out.
//!
//! Where several hubs are on several PEs, nearly every PE has a connection to each of these. A relay gathers them: it
//! copies all that its readers read of any hub, so each of them needs a connection to the relay alone. A copy is a
//! chain of one product with the coefficient 1, which is exact in every format, so relays change no result. They cost
//! an issue slot per copy, and readers wait for a chain more.

use std::collections::BTreeMap;
use std::sync::Arc;

use pe_ir::graph::{Chain, Equation, Factor, FixedPoint, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, ChainId, EquationId, List, at};

/// A hub is read by more equations than this many times the limit of input ports, and by more than there are PEs.
const HUB: u32 = 2;

/// A step graph with relays.
#[derive(Clone, Debug)]
pub struct Relayed {
    /// The graph: equations and values of the relays come after all others.
    pub graph: Arc<StepGraph>,
    /// For each value of a relay the one that it is a copy of.
    pub copied: Vec<ValueId>,
    /// For each chain the one that it was without relays; none of those that copy.
    origins: List<ChainId, Option<ChainId>>,
}

/// The graph with so many relays, each for as many readers of hubs as the others; none where there are no two hubs, or so
/// few PEs that each may read all others.
pub fn relay(graph: &StepGraph, pes: u32, max_in_degree: u32, relays: u32) -> Option<Relayed> {
    let (hubs, readers) = hubs(graph, pes, max_in_degree)?;
    let mut relay_of: List<EquationId, Option<u32>> = List::filled(None, graph.equations.len());
    for (position, reader) in (0u64..).zip(&readers) {
        relay_of[*reader] = Some((position * u64::from(relays) / readers.len() as u64) as u32);
    }
    let named = &graph.equations[hubs.ids().find(|equation| hubs[*equation]).expect("two at least")];
    let mut copies = Copies::of(graph);
    let equations: Vec<EquationId> = (1..=relays).map(|number| copies.relay(named, INFIX, number)).collect();
    for chain in &graph.chains {
        let Some(relay) = relay_of[chain.equation] else { continue };
        for term in at(chain.terms.start)..chain.terms.end as usize {
            let original = graph.terms[term].operand;
            if graph.value(original).equation.is_some_and(|equation| hubs[equation]) {
                let copy = copies.copy(original, original, equations[at(relay)], relay + 1);
                copies.read(term, copy);
            }
        }
    }
    Some(copies.woven())
}

/// A step graph while relays are added to it.
pub(crate) struct Copies<'a> {
    graph: &'a StepGraph,
    relayed: StepGraph,
    copied: Vec<ValueId>,
    /// For each value and relay that copies it what the copy is made of, and the copy.
    made: BTreeMap<(ValueId, u32), (ValueId, ValueId)>,
}

impl<'a> Copies<'a> {
    /// The graph as it is.
    pub(crate) fn of(graph: &'a StepGraph) -> Self {
        Copies { graph, relayed: graph.clone(), copied: Vec::new(), made: BTreeMap::new() }
    }

    /// Adds a relay, named after an equation.
    pub(crate) fn relay(&mut self, named: &Equation, infix: &str, number: u32) -> EquationId {
        let name = format!("{}{infix}{number}", named.name);
        self.relayed.equations.push(Equation { name, span: named.span, place: None })
    }

    /// The copy that a relay of this number makes of `original` by reading `source`, which is that value or another copy of
    /// it, made before.
    pub(crate) fn copy(&mut self, original: ValueId, source: ValueId, relay: EquationId, number: u32) -> ValueId {
        let (_, copy) = *self.made.entry((original, number)).or_insert_with(|| {
            let role = Role::Relayed(original, number);
            self.relayed.values.push(Value { role, equation: Some(relay), factor: false });
            self.copied.push(original);
            (source, ValueId::at(self.relayed.values.len() - 1))
        });
        copy
    }

    /// Lets a term read a copy.
    pub(crate) fn read(&mut self, term: usize, copy: ValueId) {
        self.relayed.terms[term].operand = copy;
    }

    /// The graph with the chains that copy a value behind the one that computes it, or in front of all.
    pub(crate) fn woven(self) -> Relayed {
        let Copies { graph, mut relayed, copied, made } = self;
        let (mut chains, mut terms, mut origins) = (List::new(), Vec::new(), List::new());
        let mut add = |chain: Chain, own: &[Term], origin: Option<ChainId>| {
            let first = index::number(terms.len());
            terms.extend_from_slice(own);
            chains.push(Chain { terms: first..terms.len() as u32, ..chain });
            origins.push(origin);
        };
        // A copy comes after the one that it is made of.
        let copies_of = |value: ValueId| {
            let mut copies: Vec<(ValueId, ValueId)> =
                made.range((value, 0)..=(value, u32::MAX)).map(|(_, copy)| *copy).collect();
            copies.sort_unstable_by_key(|(_, copy)| *copy);
            copies
        };
        let copy = |source: ValueId, value: ValueId| {
            let write = Write { value, base: None, weight: 0 };
            let equation = relayed.value(value).equation.expect("of a relay");
            let chain = Chain { equation, terms: 0..0, interim: None, write, second: None, function: None };
            (chain, [Term::new(source, Factor::Coefficient(1.0))])
        };
        let producers = graph.producers();
        let mut originals: Vec<ValueId> = made.keys().map(|(original, _)| *original).collect();
        originals.dedup();
        for original in originals.into_iter().filter(|original| producers[original.index()].is_none()) {
            for (source, value) in copies_of(original) {
                let (chain, own) = copy(source, value);
                add(chain, &own, None);
            }
        }
        for (index, chain) in relayed.chains.numbered() {
            add(chain.clone(), relayed.chain_terms(chain), Some(index));
            for (source, value) in chain.writes().flat_map(|write| copies_of(write.value)) {
                let (chain, own) = copy(source, value);
                add(chain, &own, None);
            }
        }
        (relayed.chains, relayed.terms) = (chains, terms);
        Relayed { graph: Arc::new(relayed), copied, origins }
    }
}

/// What the names of relays have between that of a hub and their number.
const INFIX: &str = ".relay";

/// Whether an equation of this name is a relay.
pub fn is_relay(name: &str) -> bool {
    name.rsplit_once(INFIX).is_some_and(|(_, number)| number.parse::<u32>().is_ok())
}

/// Which equations are hubs, and the others that read one; none if there are no two hubs.
fn hubs(graph: &StepGraph, pes: u32, max_in_degree: u32) -> Option<(List<EquationId, bool>, Vec<EquationId>)> {
    if pes <= max_in_degree + 1 {
        return None;
    }
    let arcs = graph.dependencies();
    let mut readers = List::filled(0, graph.equations.len());
    arcs.iter().for_each(|(read, _)| readers[*read] += 1);
    let hubs: List<EquationId, bool> =
        readers.into_iter().map(|count: u32| count > pes.max(HUB * max_in_degree)).collect();
    if hubs.iter().filter(|hub| **hub).count() < 2 {
        return None;
    }
    let is_reader = |(read, reader): &&(EquationId, EquationId)| hubs[*read] && !hubs[*reader];
    let mut readers: Vec<EquationId> = arcs.iter().filter(is_reader).map(|(_, reader)| *reader).collect();
    readers.sort_unstable();
    readers.dedup();
    Some((hubs, readers))
}

impl Relayed {
    /// What each value had, with what each copy has from its original.
    pub fn extended<T: Copy>(&self, of_values: &[T]) -> Vec<T> {
        of_values.iter().copied().chain(self.copied.iter().map(|original| of_values[original.index()])).collect()
    }

    /// The numbers of the graph without relays, and those of the copies, which have the formats of their originals.
    /// None if words are so wide against the multiplier that a product with 1 is coarser than the word.
    pub fn fixed(&self, graph: &StepGraph, fixed: &FixedPoint) -> Option<FixedPoint> {
        let format = fixed.format;
        // The finest point on which the port holds a 1, and the bits of a product with it.
        let one = format.coefficient_bits - 2;
        let shift = u8::try_from((one + format.left_shift()).checked_sub(format.data_drop())?).ok()?;
        let bits = (format.data_bits + one + 1) as u8;
        let mut extended = FixedPoint {
            format,
            exponents: self.extended(&fixed.exponents),
            half_scale: self.extended(&fixed.half_scale),
            coefficients: Vec::with_capacity(self.graph.terms.len()),
            products: List::with_capacity(self.graph.chains.len()),
            shifts: List::with_capacity(self.graph.chains.len()),
            accumulator_bits: List::with_capacity(self.graph.chains.len()),
        };
        for (chain, origin) in self.graph.chains.iter().zip(&self.origins) {
            if let Some(origin) = *origin {
                let terms = graph.chains[origin].terms.clone();
                extended.coefficients.extend_from_slice(&fixed.coefficients[at(terms.start)..terms.end as usize]);
                extended.products.push(fixed.products[origin]);
                extended.shifts.push(fixed.shifts[origin]);
                extended.accumulator_bits.push(fixed.accumulator_bits[origin]);
            } else {
                let source = self.graph.chain_terms(chain)[0].operand;
                let operand = extended.exponents[source.index()] + format.data_drop() as i32;
                extended.coefficients.push(1 << one);
                extended.products.push(operand - one as i32);
                extended.shifts.push([shift, 0, 0]);
                extended.accumulator_bits.push(bits);
            }
        }
        Some(extended)
    }
}
