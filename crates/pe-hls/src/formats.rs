//! Chooses the number format of every value, coefficient and write.
//!
//! Each value has a binary point of its own; only that of the arguments of tables is given, as their upper bits count
//! segments. Within a chain all products share one (the *product point*), as fine as
//! the coefficient port and the accumulator allow; what remains per write is one right shift.

use pe_ir::codes;
use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StageForm, StepGraph, Term, ValueId};
use pe_ir::index::{ChainId, EquationId, List, at};
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;

use crate::alike::alike;
use crate::parts::Likes;
use crate::{pairs, rounding};

/// Head room of the measured ranges (Kum, Kang, Sung 2000 use the same idea; the figure is ours, see
/// `docs/decisions/0001-number-path.md`).
pub const RANGE_MARGIN: f64 = 1.2;

/// Accumulator bits that keep sums of coefficient products in a machine word of the reference and simulator. Formats
/// whose single products fit give up to three coefficient bits for it; wider ones are chosen for their accuracy.
const SOFT_ACCUMULATOR_LIMIT: u32 = 64;

/// A right shift never needs more: what lies further below the result's LSB cannot be seen in it.
const MAX_SHIFT: i32 = 40;

/// What is known about the values of a step graph.
#[derive(Clone, Debug)]
pub struct Ranges {
    /// Largest magnitude of each value over the runs.
    pub largest: Vec<f64>,
    /// Extra bits of each value's range, after a fixed-point run saturated there.
    pub widened: Vec<i32>,
}

impl Ranges {
    /// The same ranges, none smaller than what rounding may make of its value within a step: that of the words that it is
    /// computed from, each at the LSB of its own range. A sum of large terms that cancel has such a range.
    pub fn with_rounding(&self, graph: &StepGraph, format: WordFormat) -> Ranges {
        let full_scale = format.word_bits() as i32 - 1;
        let half_lsb = |largest: f64, dropped: u32| match largest > 0.0 {
            true => libm::scalbn(0.5, ceil_log2(RANGE_MARGIN * largest) - full_scale + dropped as i32),
            false => 0.0,
        };
        let entries = largest_entries(graph);
        let mut largest = self.largest.clone();
        for (largest, value) in largest.iter_mut().zip(&graph.values) {
            match value.role {
                Role::Constant(number) => *largest = number.abs(),
                Role::Column(lookup, column) => {
                    *largest = entries[at(graph.functions.lookups[at(lookup)].table)][usize::from(column)];
                }
                _ => {}
            }
        }
        let mut noise = vec![0.0; graph.values.len()];
        for chain in &graph.chains {
            let of_term = |term: &Term| {
                let operand = term.operand.index();
                let read = noise[operand] + half_lsb(largest[operand], format.data_drop());
                match term.factor {
                    Factor::Coefficient(c) => {
                        c.abs() * (read + libm::scalbn(largest[operand], -(format.coefficient_bits as i32)))
                    }
                    Factor::Value(factor) => {
                        let factor = factor.index();
                        let other = noise[factor] + half_lsb(largest[factor], format.factor_drop());
                        largest[factor] * read + largest[operand] * other
                    }
                }
            };
            let sum: f64 = graph.chain_terms(chain).iter().map(of_term).sum();
            for write in chain.writes() {
                let base = write.base.map_or(0.0, |base| noise[base.index()]);
                let value = write.value.index();
                noise[value] = base + libm::scalbn(sum, write.weight);
                largest[value] = largest[value].max(noise[value]);
            }
        }
        Ranges { largest, widened: self.widened.clone() }
    }
}

/// Chooses formats for the measured ranges.
///
/// # Errors
/// `E0802` if a chain has no product point (coefficients too large against the widths), naming its equation.
pub fn choose(graph: &StepGraph, ranges: &Ranges, format: WordFormat) -> Result<FixedPoint, Diagnostic> {
    let mut chooser = Chooser::new(graph, ranges, format);
    // Raising one exponent can ask for another; 64 rounds would move every point across the whole word.
    let mut restless = EquationId::new(0);
    for _ in 0..64 {
        let mut settled = true;
        for chain in graph.chains.ids().rev() {
            chooser.changed = false;
            chooser.settle(chain)?;
            if chooser.changed {
                (settled, restless) = (false, graph.chains[chain].equation);
            }
            if chooser.runaway {
                return Err(no_format(graph, restless));
            }
        }
        if settled {
            return Ok(chooser.finish());
        }
    }
    Err(no_format(graph, restless))
}

/// Exponents beyond this are not those of numbers: formats chase one another.
const LARGEST_EXPONENT: i32 = 10_000;

fn no_format(graph: &StepGraph, restless: EquationId) -> Diagnostic {
    let equation = &graph.equations[restless];
    let message = format!("no number format fits `{}`: one step changes it by more than it can hold", equation.name);
    Diagnostic::error(codes::NO_FORMAT, equation.span, message)
        .with_help("choose a smaller step; if the rates are far beyond those of the rest, check the units")
}

/// The coarsest product point so far of chains that are alike, by the chain of the first part.
struct Coarsest {
    likes: List<ChainId, ChainId>,
    product: List<ChainId, i32>,
}

struct Chooser<'a> {
    graph: &'a StepGraph,
    format: WordFormat,
    /// Group of each value: values added to one another share a format.
    group: Vec<u32>,
    /// Exponent of each group.
    exponent: Vec<i32>,
    /// For each group whether its exponent is given: full scale of a table's argument is 1.
    pinned: Vec<bool>,
    /// For each value whether it stays within half of full scale.
    half_scale: Vec<bool>,
    products: List<ChainId, i32>,
    /// What chains of parts have in common, if the step has parts that are alike.
    coarsest: Option<Coarsest>,
    /// For each chain of an intermediate stage the chain of the same equation's last stage; itself for others.
    last_stage: List<ChainId, ChainId>,
    changed: bool,
    /// Whether an exponent left what numbers have.
    runaway: bool,
}

impl<'a> Chooser<'a> {
    fn new(graph: &'a StepGraph, ranges: &Ranges, format: WordFormat) -> Self {
        let mut group = groups(graph);
        let mut largest = vec![0.0f64; graph.values.len()];
        let mut widened = vec![0; graph.values.len()];
        let entries = largest_entries(graph);
        for (index, group) in group.iter().enumerate() {
            let number = match graph.values[index].role {
                Role::Constant(number) => number.abs(),
                Role::Column(lookup, column) => {
                    entries[at(graph.functions.lookups[at(lookup)].table)][usize::from(column)]
                }
                _ => ranges.largest[index],
            };
            largest[at(*group)] = largest[at(*group)].max(number);
            widened[at(*group)] = widened[at(*group)].max(ranges.widened[index]);
        }
        let full_scale = format.word_bits() as i32 - 1;
        let exponent = |(largest, widened): (&f64, &i32)| {
            // A value that is always zero gets the finest format; the floor rule below raises it.
            let magnitude = if *largest > 0.0 { ceil_log2(RANGE_MARGIN * largest) } else { -200 };
            magnitude - full_scale + widened
        };
        let mut exponent: Vec<i32> = largest.iter().zip(&widened).map(exponent).collect();
        let mut pinned = vec![false; graph.values.len()];
        for lookup in &graph.functions.lookups {
            let group = at(group[lookup.argument.index()]);
            (pinned[group], exponent[group]) = (true, -full_scale);
        }
        let half_scale = if graph.pre_adder {
            share_points(graph, &mut group, &mut exponent, &pinned)
        } else {
            vec![false; graph.values.len()]
        };
        Chooser {
            graph,
            format,
            group,
            exponent,
            pinned,
            half_scale,
            products: List::filled(0, graph.chains.len()),
            coarsest: Likes::of(graph).map(|likes| Coarsest {
                likes: likes.chains.iter().map(|(_, like)| *like).collect(),
                product: List::filled(i32::MIN, graph.chains.len()),
            }),
            last_stage: last_stages(graph),
            changed: false,
            runaway: false,
        }
    }

    fn of(&self, id: ValueId) -> i32 {
        self.exponent[at(self.group[id.index()])]
    }

    fn operand_exponent(&self, term: &Term) -> i32 {
        self.of(term.operand) + self.format.data_drop() as i32
    }

    fn raise(&mut self, id: ValueId, exponent: i32) {
        let group = at(self.group[id.index()]);
        let slot = &mut self.exponent[group];
        if *slot < exponent && !self.pinned[group] {
            *slot = exponent;
            self.changed = true;
            self.runaway |= exponent > LARGEST_EXPONENT;
        }
    }

    /// Settles the product point of a chain and the exponents that it asks for.
    fn settle(&mut self, index: ChainId) -> Result<(), Diagnostic> {
        let chain = &self.graph.chains[index];
        self.floor(chain);
        let mut product = self.finest_product(chain);
        for write in chain.writes() {
            product = product.max(self.of(write.value) - write.weight - MAX_SHIFT);
        }
        // All stages of an equation share the product point of the last one where theirs is finer: the shifts of a PE
        // become fewer, and what the early stages lose counts little (`docs/decisions/0001-number-path.md`). The last
        // stage is settled first.
        let last = self.last_stage[index];
        if last != index {
            product = product.max(self.products[last]);
        }
        let narrow = self.format.data_bits + self.format.coefficient_bits <= SOFT_ACCUMULATOR_LIMIT;
        let limit = self.format.accumulator_limit();
        let soft = if narrow { SOFT_ACCUMULATOR_LIMIT.min(limit) } else { limit };
        let finest = product;
        while self.accumulator_bits(chain, product) > soft && product < finest + 3 && !has_factors(self.graph, chain) {
            product += 1;
        }
        while self.accumulator_bits(chain, product) > limit {
            product += 1;
            if product > finest + 40 {
                let name = &self.graph.equations[chain.equation].name;
                let message = format!("the products of `{name}` do not fit the accumulator");
                return Err(Diagnostic::error(codes::ACCUMULATOR, self.graph.equations[chain.equation].span, message)
                    .with_help("use a narrower `--multiplier`, which leaves room for more products of two variables"));
            }
        }
        if let Some(coarsest) = &mut self.coarsest {
            let of_parts = &mut coarsest.product[coarsest.likes[index]];
            product = product.max(*of_parts);
            self.changed |= *of_parts != product;
            *of_parts = product;
        }
        // A second factor of a product takes the format that puts the product on the chain's point.
        for term in self.graph.chain_terms(chain) {
            if let Factor::Value(factor) = term.factor {
                let exponent = product - self.operand_exponent(term) - self.format.factor_drop() as i32;
                self.raise(factor, exponent);
            }
        }
        for write in chain.writes() {
            let finest = product + write.weight - self.format.left_shift() as i32;
            self.raise(write.value, finest);
            if self.of(write.value) < finest {
                return Err(self.coarse_argument(chain));
            }
        }
        self.products[index] = product;
        Ok(())
    }

    /// The argument of a table has a given format; its sum may be too coarse for it.
    fn coarse_argument(&self, chain: &Chain) -> Diagnostic {
        let equation = &self.graph.equations[chain.equation];
        let message = format!("the argument of `{}` is too coarse for the range of its table", equation.name);
        Diagnostic::error(codes::NO_FORMAT, equation.span, message)
            .with_help("the variable behind the argument is far larger than its range: shift or scale it")
    }

    /// Floor rule: a sum spans at least four LSB of its coarsest operand, or noise alone would overflow it.
    fn floor(&mut self, chain: &Chain) {
        let noise = |term: &Term| match term.factor {
            Factor::Coefficient(c) if c != 0.0 => ceil_log2(c.abs()) + self.operand_exponent(term),
            Factor::Coefficient(_) => i32::MIN / 2,
            Factor::Value(_) => i32::MIN / 2,
        };
        let coarsest = self.graph.chain_terms(chain).iter().map(noise).max().unwrap_or(i32::MIN / 2);
        for write in chain.writes() {
            self.raise(write.value, coarsest + write.weight + 2 - (self.format.word_bits() as i32 - 1));
        }
    }

    /// The finest product point: every coefficient fits its port, and every stored factor its range.
    fn finest_product(&self, chain: &Chain) -> i32 {
        let coefficient_bits = self.format.coefficient_bits as i32;
        let of_term = |term: &Term| match term.factor {
            Factor::Coefficient(0.0) => i32::MIN / 2,
            Factor::Coefficient(c) => {
                let exponent = self.operand_exponent(term);
                let mut product = exponent + ceil_log2(c.abs()) - (coefficient_bits - 1);
                if quantise(c, exponent, product) >= 1i64 << (coefficient_bits - 1) {
                    product += 1;
                }
                product
            }
            Factor::Value(factor) => self.operand_exponent(term) + self.of(factor) + self.format.factor_drop() as i32,
        };
        let finest = self.graph.chain_terms(chain).iter().map(of_term).max().unwrap_or(0);
        if finest >= -100_000 {
            return finest;
        }
        // Zero has any point: one that no written value has to follow.
        chain.writes().map(|write| self.of(write.value) - write.weight).min().unwrap_or(0)
    }

    /// Bits that hold any sum of the chain, whatever its operands.
    fn accumulator_bits(&self, chain: &Chain, product: i32) -> u32 {
        let data = 1i128 << (self.format.data_bits - 1);
        let bound: i128 = self
            .graph
            .chain_terms(chain)
            .iter()
            .map(|term| match term.factor {
                // Joint rounding may move a coefficient away from its nearest value.
                Factor::Coefficient(c) => {
                    data * i128::from(quantise(c, self.operand_exponent(term), product) + rounding::REACH)
                }
                Factor::Value(_) => data << (self.format.coefficient_bits - 1),
            })
            .sum();
        // One bit for the sign, one value more for the rounding increment.
        (bound + 1).ilog2() + 2
    }

    fn finish(self) -> FixedPoint {
        let graph = self.graph;
        let mut coefficients = vec![0; graph.terms.len()];
        let mut shifts = List::with_capacity(graph.chains.len());
        let mut accumulator_bits = List::with_capacity(graph.chains.len());
        for (chain, product) in graph.chains.iter().zip(&self.products) {
            for position in chain.terms.clone() {
                let term = &graph.terms[at(position)];
                if let Factor::Coefficient(c) = term.factor {
                    let magnitude = quantise(c, self.operand_exponent(term), *product);
                    coefficients[at(position)] = if c < 0.0 { -magnitude } else { magnitude };
                }
            }
            let mut shift = [0; 3];
            for (write, slot) in chain.writes().zip(&mut shift) {
                let shift = self.of(write.value) - product - write.weight + self.format.left_shift() as i32;
                *slot = u8::try_from(shift).expect("settled by `settle`");
            }
            shifts.push(shift);
            accumulator_bits.push(self.accumulator_bits(chain, *product) as u8);
        }
        let exponents = self.group.iter().map(|group| self.exponent[at(*group)]).collect();
        FixedPoint {
            format: self.format,
            exponents,
            half_scale: self.half_scale,
            coefficients,
            products: self.products,
            shifts,
            accumulator_bits,
        }
    }
}

/// For each table and column the largest magnitude of its entries.
fn largest_entries(graph: &StepGraph) -> Vec<Vec<f64>> {
    let largest = |column: &Vec<f64>| column.iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()));
    graph.functions.tables.iter().map(|table| table.columns.iter().map(largest).collect()).collect()
}

/// For each chain that computes an intermediate stage of a state the chain of the state's last stage. Real factors are
/// equals: what the first of them loses the last one does not make small, so each keeps its own product point; so do the
/// stages of planned methods, which are not alike.
fn last_stages(graph: &StepGraph) -> List<ChainId, ChainId> {
    if graph.form == StageForm::Sums {
        return alike(graph);
    }
    let producers = graph.producers();
    let last = |(index, chain): (ChainId, &Chain)| match graph.value(chain.write.value).role {
        Role::Stage(state, _) if matches!(graph.form, StageForm::Horner | StageForm::Increments) => {
            // What stands for a signal ends without its stages, in front of them.
            producers[graph.states[state].1.index()].map_or(index, |last| last.max(index))
        }
        _ => index,
    };
    graph.chains.numbered().map(last).collect()
}

fn has_factors(graph: &StepGraph, chain: &Chain) -> bool {
    graph.chain_terms(chain).iter().any(|term| matches!(term.factor, Factor::Value(_)))
}

/// Magnitude of a coefficient in units of the product point, rounded to nearest.
fn quantise(coefficient: f64, operand_exponent: i32, product: i32) -> i64 {
    libm::round(libm::scalbn(coefficient.abs(), operand_exponent - product)) as i64
}

/// Smallest integer `n` with `x <= 2^n`, for positive finite `x`.
fn ceil_log2(x: f64) -> i32 {
    let (mantissa, exponent) = libm::frexp(x);
    if mantissa == 0.5 { exponent - 1 } else { exponent }
}

/// Most bits that a value may lose to share the binary point of those with the same coefficient.
const COMMON_POINT: i32 = 2;

/// An exponent below this is that of a value that is always zero.
const SILENT: i32 = -150;

/// Gives operands with equal coefficients one binary point at half of full scale, so that they may be added in front
/// of the multiplier, as long as none loses more than [`COMMON_POINT`] bits for the common point and none is `pinned`.
/// Returns which values are at half scale.
fn share_points(graph: &StepGraph, group: &mut [u32], exponent: &mut [i32], pinned: &[bool]) -> Vec<bool> {
    let mut parent: Vec<u32> = (0..group.len() as u32).collect();
    let lowest = |exponent: i32| if exponent < SILENT { i32::MAX } else { exponent };
    let mut low: Vec<i32> = exponent.iter().map(|exponent| lowest(*exponent)).collect();
    for chain in &graph.chains {
        for class in pairs::equal_coefficients(graph, chain) {
            let first = group[class[0].index()];
            for other in &class[1..] {
                let (a, b) = (find(&mut parent, first), find(&mut parent, group[other.index()]));
                let (a, b) = (a.min(b), a.max(b));
                let (bottom, top) = (low[at(a)].min(low[at(b)]), exponent[at(a)].max(exponent[at(b)]));
                let free = !pinned[at(a)] && !pinned[at(b)];
                if a != b && free && (bottom == i32::MAX || top - bottom <= COMMON_POINT) {
                    parent[at(b)] = a;
                    low[at(a)] = bottom;
                    exponent[at(a)] = top;
                }
            }
        }
    }
    for group in group.iter_mut() {
        *group = find(&mut parent, *group);
    }
    let mut shared = vec![false; group.len()];
    for chain in &graph.chains {
        for class in pairs::equal_coefficients(graph, chain) {
            let mut groups: Vec<u32> = class.iter().map(|operand| group[operand.index()]).collect();
            groups.sort_unstable();
            groups
                .chunk_by(|a, b| a == b)
                .filter(|same| same.len() > 1 && !pinned[at(same[0])])
                .for_each(|same| shared[at(same[0])] = true);
        }
    }
    for (exponent, _) in exponent.iter_mut().zip(&shared).filter(|(_, shared)| **shared) {
        *exponent += 1;
    }
    group.iter().map(|group| shared[at(*group)]).collect()
}

fn find(parent: &mut [u32], mut x: u32) -> u32 {
    while parent[at(x)] != x {
        parent[at(x)] = parent[at(parent[at(x)])];
        x = parent[at(x)];
    }
    x
}

/// Joins values that a write adds to one another, each state with its successor, and results of stages that are alike.
/// Returns a representative each.
fn groups(graph: &StepGraph) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..graph.values.len() as u32).collect();
    let mut join = |a: ValueId, b: ValueId| {
        let (a, b) = (find(&mut parent, a.number()), find(&mut parent, b.number()));
        parent[at(a.max(b))] = a.min(b);
    };
    for (state, next) in &graph.states {
        join(*state, *next);
    }
    for write in graph.chains.iter().flat_map(Chain::writes) {
        if let Some(base) = write.base {
            join(write.value, base);
        }
    }
    for (chain, like) in graph.chains.iter().zip(alike(graph)) {
        join(chain.write.value, graph.chains[like].write.value);
    }
    // Parts that are alike have one program, and so one format for each of their values.
    for (index, (_, like)) in Likes::of(graph).iter().flat_map(|likes| likes.values.iter().enumerate()) {
        join(ValueId::at(index), *like);
    }
    (0..graph.values.len() as u32).map(|index| find(&mut parent, index)).collect()
}
