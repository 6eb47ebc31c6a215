//! Rings: long rows of words that move on with every step, each taking what the one before it was, become one word that is
//! written and a ring of past ones.
//!
//! A row is a state whose chain copies a value as it is, and states whose chains copy that one or one another. Those that follow
//! lose their chains: at the end of the step they are what the others were at its beginning, which the hardware does by counting
//! steps ([`pe_ir::pasts`]). Stored words stay what they were, bit for bit. A row remains what it is where that is cheaper. Rings
//! stand where they are read; where many equations read few words of a row, its own PE copies these words for them.

use std::collections::BTreeMap;
use std::sync::Arc;

use pe_ir::graph::{Chain, Equation, Factor, FixedPoint, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, ChainId, EquationId, List, StateId, at};
use pe_ir::pasts::Pasts;
use pe_ir::program::index_bits;

/// Which rows become rings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// None.
    Chains,
    /// Those that are cheaper as rings.
    #[default]
    ByCost,
    /// All that can, read where they are needed.
    Rings,
    /// All that can, with copies of what is read.
    Copies,
}

/// Words of memory that a product is worth: its control word, and its share of the cycles.
const PRODUCT: u64 = 16;

/// What a ring is worth beside its words: bits of control words, sums of addresses.
const RING: u64 = 8 * PRODUCT;

/// Most bits that count the words of a ring.
const MOST_BITS: u32 = 15;

/// A step graph with rings.
pub struct Ringed {
    /// The graph.
    pub graph: Arc<StepGraph>,
    /// Its numbers.
    pub fixed: FixedPoint,
    /// For each value the one that it was, or is a copy of.
    origins: Vec<ValueId>,
}

impl Ringed {
    /// What each value had.
    pub fn of_values<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.origins.iter().map(|origin| values[origin.index()]).collect()
    }
}

/// The graph with rings; none if no row becomes one.
pub fn rings(graph: &StepGraph, fixed: &FixedPoint, choice: Choice) -> Option<Ringed> {
    if choice == Choice::Chains || !Pasts::of(graph).is_empty() {
        return None;
    }
    let rows = Rows::of(graph, fixed);
    let readers = rows.readers(graph);
    let mut plan = Plan::default();
    for row in rows.rows.iter().filter(|row| row.len() > 1) {
        let oldest = row.iter().map(|member| rows.age[*member]).max().unwrap_or(0);
        let bits = index_bits(oldest + 1);
        if bits > MOST_BITS {
            continue;
        }
        let read: Vec<StateId> = row.iter().copied().filter(|member| !readers[*member].is_empty()).collect();
        let mut equations: Vec<EquationId> = read.iter().flat_map(|member| readers[*member].iter().copied()).collect();
        equations.sort_unstable();
        equations.dedup();
        let words = 1u64 << bits;
        let chains = PRODUCT * (row.len() as u64 - 1);
        // A copy that is swapped with each step has no place beside half a memory.
        let fits = !graph.swaps() || bits < MOST_BITS;
        let copies = one(fixed).filter(|_| fits).map(|_| RING + PRODUCT * read.len() as u64 + words);
        let direct = RING + words * (1 + equations.len() as u64);
        let (ring, copies) = match (choice, copies) {
            (Choice::Copies, copies) => (true, copies.is_some()),
            (Choice::Rings, _) => (true, false),
            (_, Some(copies)) => (direct.min(copies) < chains, copies < direct),
            (_, None) => (direct < chains, false),
        };
        // What nothing follows is copied already, from one step to the next.
        let last = |member: &StateId| copies && rows.ends[*member] && !readers[*member].is_empty();
        let (ends, members): (Vec<StateId>, Vec<StateId>) = row.iter().copied().partition(last);
        if ring && members.len() > 1 {
            plan.copied.extend(read.into_iter().filter(|member| copies && !last(member)));
            plan.rows.push((members, ends));
        }
    }
    (!plan.rows.is_empty()).then(|| plan.carried_out(graph, fixed, &rows))
}

/// The finest form of a 1 on the coefficient port, and the shift and the accumulator bits of a copy; none if a product with it is
/// coarser than a word.
fn one(fixed: &FixedPoint) -> Option<(u32, u8, u8)> {
    let format = &fixed.format;
    let one = format.coefficient_bits - 2;
    let shift = u8::try_from((one + format.left_shift()).checked_sub(format.data_drop())?).ok()?;
    Some((one, shift, (format.data_bits + one + 1) as u8))
}

/// Rows of words that move on.
struct Rows {
    /// What each state takes at the end of the step, if that is all that its chain does.
    takes: List<StateId, Option<(ChainId, ValueId)>>,
    /// Members of each row, the head first, each behind the one that it follows.
    rows: Vec<Vec<StateId>>,
    /// Steps since what a member holds was written.
    age: List<StateId, u32>,
    /// Whether no state follows.
    ends: List<StateId, bool>,
}

impl Rows {
    fn of(graph: &StepGraph, fixed: &FixedPoint) -> Rows {
        let producers = graph.producers();
        let own = read_otherwise(graph);
        let moved = |state: StateId| {
            let (start, end) = graph.states[state];
            let index = producers[end.index()]?;
            let chain = &graph.chains[index];
            let [term] = graph.chain_terms(chain) else { return None };
            let alone = chain.interim.is_none() && chain.second.is_none() && chain.function.is_none();
            let copies = chain.write.base.is_none()
                && chain.write.weight == 0
                && term.partner.is_none()
                && term.factor == Factor::Coefficient(1.0)
                && fixed.coefficient_value(graph, index, at(chain.terms.start)) == 1.0;
            let alike = fixed.exponents[term.operand.index()] == fixed.exponents[start.index()];
            let free = !own[start.index()] && !own[end.index()] && term.operand != start;
            (alone && copies && alike && free).then_some((index, term.operand))
        };
        let takes: List<StateId, Option<(ChainId, ValueId)>> = graph.states.ids().map(moved).collect();
        let follows = |state: StateId| match graph.value(takes[state]?.1).role {
            Role::State(other) => takes[other].is_some().then_some(other),
            _ => None,
        };
        let mut followers: List<StateId, Vec<StateId>> = List::filled(Vec::new(), graph.states.len());
        for state in graph.states.ids() {
            if let Some(other) = follows(state) {
                followers[other].push(state);
            }
        }
        let ends = followers.iter().map(Vec::is_empty).collect();
        let mut rows = Rows { rows: Vec::new(), age: List::filled(0, graph.states.len()), takes, ends };
        let heads = graph.states.ids().filter(|state| rows.takes[*state].is_some());
        let heads: Vec<StateId> = heads
            .filter(|state| match graph.value(rows.takes[*state].expect("filtered above").1).role {
                Role::State(other) => rows.takes[other].is_none(),
                _ => true,
            })
            .collect();
        // States that follow one another in a circle are behind no head.
        for head in heads {
            rows.age[head] = 1;
            let (mut row, mut next) = (vec![head], 0);
            while next < row.len() {
                let member = row[next];
                for follower in &followers[member] {
                    rows.age[*follower] = rows.age[member] + 1;
                    row.push(*follower);
                }
                next += 1;
            }
            rows.rows.push(row);
        }
        rows
    }

    /// For each member the equations that read it, but for those that only move it on.
    fn readers(&self, graph: &StepGraph) -> List<StateId, Vec<EquationId>> {
        let mut readers: List<StateId, Vec<EquationId>> = List::filled(Vec::new(), graph.states.len());
        for (index, chain) in graph.chains.numbered() {
            let moves = match graph.value(chain.write.value).role {
                Role::Next(state) => self.age[state] > 1 && self.takes[state].is_some_and(|(own, _)| own == index),
                _ => false,
            };
            for operand in graph.chain_terms(chain).iter().flat_map(Term::operands).filter(|_| !moves) {
                if let Role::State(state) = graph.value(operand).role
                    && self.age[state] > 0
                {
                    readers[state].push(chain.equation);
                }
            }
        }
        readers
    }
}

/// For each value whether it is a base, a factor, an argument or an output, or, of an end value, an operand: what rings cannot be.
fn read_otherwise(graph: &StepGraph) -> Vec<bool> {
    let mut read: Vec<bool> = graph.values.iter().map(|value| value.factor).collect();
    let bases = graph.chains.iter().flat_map(Chain::writes).filter_map(|write| write.base);
    let arguments = graph.functions.lookups.iter().map(|lookup| lookup.argument);
    let operands = graph.terms.iter().flat_map(Term::operands);
    let ends = operands.filter(|operand| matches!(graph.value(*operand).role, Role::Next(_)));
    let factors = graph.terms.iter().filter_map(|term| match term.factor {
        Factor::Value(value) => Some(value),
        Factor::Coefficient(_) => None,
    });
    let all = bases.chain(arguments).chain(ends).chain(factors).chain(graph.outputs.iter().copied());
    all.for_each(|value| read[value.index()] = true);
    read
}

/// Which rows become rings, and which of their members are copied for those that read them.
#[derive(Default)]
struct Plan {
    /// Members that stay in a ring, the head first, and those that remain copies of them.
    rows: Vec<(Vec<StateId>, Vec<StateId>)>,
    copied: Vec<StateId>,
}

impl Plan {
    fn carried_out(self, graph: &StepGraph, fixed: &FixedPoint, rows: &Rows) -> Ringed {
        let mut ringed = graph.clone();
        let (mut gone_chain, mut gone_value) =
            (List::filled(false, graph.chains.len()), vec![false; graph.values.len()]);
        for (row, ends) in &self.rows {
            let home = graph.value(graph.states[row[0]].0).equation;
            for member in ends {
                let ((start, end), (chain, _)) = (graph.states[*member], rows.takes[*member].expect("they are copies"));
                ringed.values[start.index()].equation = home;
                ringed.values[end.index()].equation = home;
                ringed.chains[chain].equation = home.expect("that of the row");
            }
            for member in &row[1..] {
                let (chain, followed) = rows.takes[*member].expect("members of rows are copies");
                let (start, end) = graph.states[*member];
                (gone_chain[chain], gone_value[end.index()]) = (true, true);
                ringed.states[*member].1 = followed;
                ringed.values[start.index()].equation = home;
            }
        }
        let mut copies: BTreeMap<ValueId, ValueId> = BTreeMap::new();
        for state in &self.copied {
            let start = graph.states[*state].0;
            let equation = ringed.value(start).equation;
            ringed.values.push(Value { role: Role::Relayed(start, 0), equation, factor: false });
            copies.insert(start, ValueId::at(ringed.values.len() - 1));
        }
        let copied = self.copied.iter().map(|state| graph.states[*state].0).collect();
        Woven { graph, fixed, ringed, copies, copied, gone_chain, gone_value }.ringed()
    }
}

/// A graph whose rings are known, with values, chains and equations that are to go.
struct Woven<'a> {
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    ringed: StepGraph,
    /// For each value that is copied its copy.
    copies: BTreeMap<ValueId, ValueId>,
    /// Values that are copied, in the order of the copies, which come behind all values.
    copied: Vec<ValueId>,
    gone_chain: List<ChainId, bool>,
    gone_value: Vec<bool>,
}

impl Woven<'_> {
    /// The graph with its members numbered densely in the old order: copies come in front of all other chains.
    fn ringed(mut self) -> Ringed {
        self.gone_value.resize(self.ringed.values.len(), false);
        let mut values: Vec<Option<ValueId>> = Vec::with_capacity(self.ringed.values.len());
        let mut origins: Vec<ValueId> = Vec::new();
        for (index, gone) in self.gone_value.iter().enumerate() {
            values.push((!gone).then(|| ValueId::at(origins.len())));
            if !gone {
                let copied = index.checked_sub(self.graph.values.len()).map(|copy| self.copied[copy]);
                origins.push(copied.unwrap_or(ValueId::at(index)));
            }
        }
        let value = |id: ValueId| values[id.index()].expect("nothing reads what goes");
        let mut owned = List::filled(false, self.graph.equations.len());
        for (of, _) in self.ringed.values.iter().zip(&self.gone_value).filter(|(_, gone)| !**gone) {
            of.equation.into_iter().for_each(|equation| owned[equation] = true);
        }
        let chains = self.ringed.chains.numbered().filter(|(index, _)| !self.gone_chain[*index]);
        chains.for_each(|(_, chain)| owned[chain.equation] = true);
        let mut equations: List<EquationId, Option<EquationId>> = List::new();
        let mut kept: List<EquationId, Equation> = List::new();
        for (index, equation) in self.graph.equations.numbered() {
            let number = owned[index].then(|| kept.push(equation.clone()));
            equations.push(number);
        }
        let equation = |id: EquationId| equations[id].expect("it has a chain or a value");
        let mut out = Out {
            chains: List::new(),
            terms: Vec::new(),
            fixed: FixedPoint {
                format: self.fixed.format,
                exponents: origins.iter().map(|origin| self.fixed.exponents[origin.index()]).collect(),
                half_scale: origins.iter().map(|origin| self.fixed.half_scale[origin.index()]).collect(),
                coefficients: Vec::new(),
                products: List::new(),
                shifts: List::new(),
                accumulator_bits: List::new(),
            },
        };
        for (copied, copy) in &self.copies {
            self.add_copy(*copied, *copy, &mut out);
        }
        for (index, chain) in self.ringed.chains.numbered().filter(|(index, _)| !self.gone_chain[*index]) {
            self.add(index, chain, &mut out);
        }
        for chain in &mut out.chains {
            let write = |write: Write| Write { value: value(write.value), base: write.base.map(value), ..write };
            chain.equation = equation(chain.equation);
            chain.interim = chain.interim.map(write);
            chain.write = write(chain.write);
            chain.second = chain.second.map(write);
        }
        for term in &mut out.terms {
            term.operand = value(term.operand);
            term.partner = term.partner.map(value);
            if let Factor::Value(factor) = &mut term.factor {
                *factor = value(*factor);
            }
        }
        let renumbered = |of: &Value| {
            let role = match of.role {
                Role::Inner(id, serial) => Role::Inner(equation(id), serial),
                Role::Partial(id, serial) => Role::Partial(equation(id), serial),
                Role::Relayed(id, relay) => Role::Relayed(value(id), relay),
                role => role,
            };
            Value { role, equation: of.equation.map(equation), ..*of }
        };
        let all = self.ringed.values.iter().zip(&self.gone_value).filter(|(_, gone)| !**gone);
        let mut functions = self.ringed.functions.clone();
        functions.lookups.iter_mut().for_each(|lookup| lookup.argument = value(lookup.argument));
        let graph = StepGraph {
            values: all.map(|(of, _)| renumbered(of)).collect(),
            equations: kept,
            chains: out.chains,
            terms: out.terms,
            states: self.ringed.states.iter().map(|(start, end)| (value(*start), value(*end))).collect(),
            inputs: self.ringed.inputs.iter().copied().map(value).collect(),
            outputs: self.ringed.outputs.iter().copied().map(value).collect(),
            functions,
            ..self.ringed.clone()
        };
        Ringed { graph: Arc::new(graph), fixed: out.fixed, origins }
    }

    fn add_copy(&self, copied: ValueId, copy: ValueId, out: &mut Out) {
        let (one, shift, bits) = one(self.fixed).expect("looked at for the plan");
        let start = index::number(out.terms.len());
        out.terms.push(Term::new(copied, Factor::Coefficient(1.0)));
        let write = Write { value: copy, base: None, weight: 0 };
        let equation = self.ringed.value(copy).equation.expect("that of the row");
        let terms = start..start + 1;
        out.chains.push(Chain { equation, terms, interim: None, write, second: None, function: None });
        let operand = self.fixed.exponents[copied.index()] + self.fixed.format.data_drop() as i32;
        out.fixed.coefficients.push(1 << one);
        out.fixed.products.push(operand - one as i32);
        out.fixed.shifts.push([shift, 0, 0]);
        out.fixed.accumulator_bits.push(bits);
    }

    fn add(&self, index: ChainId, chain: &Chain, out: &mut Out) {
        let start = index::number(out.terms.len());
        let read = |id: ValueId| self.copies.get(&id).copied().unwrap_or(id);
        for term in self.graph.chain_terms(chain) {
            out.terms.push(Term { operand: read(term.operand), partner: term.partner.map(read), ..*term });
        }
        out.chains.push(Chain { terms: start..index::number(out.terms.len()), ..chain.clone() });
        let terms = at(chain.terms.start)..chain.terms.end as usize;
        out.fixed.coefficients.extend_from_slice(&self.fixed.coefficients[terms]);
        out.fixed.products.push(self.fixed.products[index]);
        out.fixed.shifts.push(self.fixed.shifts[index]);
        out.fixed.accumulator_bits.push(self.fixed.accumulator_bits[index]);
    }
}

/// Chains with their numbers.
struct Out {
    chains: List<ChainId, Chain>,
    terms: Vec<Term>,
    fixed: FixedPoint,
}
