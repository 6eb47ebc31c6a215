//! Chains of lookups in place of chains that apply functions.

use std::collections::BTreeMap;

use crate::kinks::rounds;
use pe_ir::functions::{Functions, Lookup, Segments, Table};
use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, ChainId, EquationId, List};

use super::domain::{Domain, LARGEST_BASE, Map};
use super::fit::{Fit, Layout};
use super::quotients::Quotients;
use super::scaling::{ONE_OCTAVE, Scaling};
use super::share::Shared;
use super::uses::BIT;

/// Error of a rounded number from which on its table does not have its steps, each of which is 1.
const PART_OF_STEP: f64 = 0.25;

/// A function and its table.
pub(super) struct Planned<'a> {
    pub domain: Domain<'a>,
    pub fit: Fit,
    /// The functions that share it, by their numbers in the step without shapes.
    pub stands_for: Vec<u32>,
}

impl Planned<'_> {
    /// Its table, and those by which octaves are told apart.
    fn entries(&self, segments: Segments, shared: &Shared, is_divided: bool) -> Vec<Table> {
        let name = &self.domain.function.name;
        let table = |name: String, octaves: bool, columns: Vec<Vec<f64>>, error: f64| Table {
            name,
            octaves,
            columns,
            domain: (self.domain.low, self.domain.high),
            error,
            stands_for: self.stands_for.iter().map(|function| shared.function(*function).clone()).collect(),
        };
        let octaves = self.fit.shape.layout == Layout::Octaves;
        let whole = table(name.clone(), octaves, self.fit.columns.clone(), self.fit.error);
        let mut all = vec![whole];
        if let Some(scaling) = self.fit.shape.scaling {
            if is_divided {
                // The function itself is nowhere computed.
                all[0].name += ONE_OCTAVE;
                all[0].error = scaling.entry(1, self.fit.error);
            }
            all.push(table(format!("{name}: scales"), true, vec![scaling.scales(segments)], 0.0));
            let powers = scaling.powers(segments);
            all.extend(powers.map(|powers| table(format!("{name}: powers"), true, vec![powers], 0.0)));
        }
        all
    }
}

/// A table, and those that its argument goes through first.
pub(super) struct PlannedPart<'a> {
    pub clamps: Vec<Planned<'a>>,
    pub table: Planned<'a>,
    /// The argument of the function from which on that of the table is counted.
    pub origin: f64,
}

/// How a function of the step is computed: as the sum of its parts.
pub(super) struct Computed<'a> {
    /// Largest magnitude of the function.
    pub largest: f64,
    pub parts: Vec<PlannedPart<'a>>,
}

impl<'a> Computed<'a> {
    /// A function by one table.
    pub fn whole(table: Planned<'a>) -> Computed<'a> {
        Computed { largest: table.domain.largest, parts: vec![PlannedPart { clamps: Vec::new(), table, origin: 0.0 }] }
    }

    /// Whether it is by one octave of what falls as its argument grows: what divides.
    pub fn is_divisor(&self) -> bool {
        let [part] = &*self.parts else { return false };
        part.clamps.is_empty() && part.table.fit.shape.scaling.is_some_and(|scaling| scaling.is_divisor())
    }

    /// Number of parts.
    pub fn parts(&self) -> usize {
        self.parts.len()
    }

    fn tables(&self) -> impl Iterator<Item = &Planned<'a>> {
        self.parts.iter().flat_map(|part| part.clamps.iter().chain([&part.table]))
    }

    /// Products of a use, with those that the mean square of lost bits is as bad as.
    pub fn products(&self, lost: f64) -> f64 {
        let of = |planned: &Planned| {
            let missed = libm::log2(planned.fit.shape.excess);
            planned.fit.shape.products() as f64 * (1.0 + BIT * (lost + missed * missed))
        };
        self.tables().map(of).sum()
    }

    /// Words of its tables.
    pub fn words(&self, segments: Segments) -> usize {
        self.tables().map(|planned| planned.fit.shape.columns() << segments.index_bits).sum()
    }

    /// Tables stand for other functions, which are so far from it.
    pub fn stand_for(&mut self, functions: &[u32], apart: f64) {
        for PlannedPart { table, .. } in &mut self.parts {
            table.fit.error += apart;
            table.stands_for = functions.to_vec();
        }
    }

    /// Where the tables are worst, and their error there over the largest value, if that is above a part of it and above
    /// what arguments excuse by more than a factor.
    pub fn misses(&self, part: f64, excess: f64) -> Option<(f64, f64)> {
        let missing = self.parts.iter().filter(|PlannedPart { table, .. }| {
            // A slope in the place of steps is wrong, however small these are beside the largest value.
            let step = if rounds(&table.domain.function.body) { PART_OF_STEP } else { f64::INFINITY };
            table.fit.error > (part * self.largest).min(step) && table.fit.blurred_excess > excess
        });
        let worst = missing.max_by(|a, b| a.table.fit.error.total_cmp(&b.table.fit.error))?;
        Some((worst.origin + worst.table.fit.worst, worst.table.fit.error / self.largest))
    }
}

/// The step graph with the tables of its functions; for each chain that applies one, how it is computed, and what tables
/// stand for.
pub(super) fn expand(
    graph: &StepGraph,
    segments: Segments,
    (computed, computed_of): (&[Computed], &List<ChainId, Option<usize>>),
    (shared, kept): (&Shared, &[ValueId]),
) -> StepGraph {
    let quotients = Quotients::of(graph, (computed, computed_of), kept);
    let mut tables = Vec::new();
    // Of each part the numbers of its tables.
    let table_of: Vec<Vec<Vec<u32>>> = computed
        .iter()
        .enumerate()
        .map(|(of, computed)| {
            let parts = computed.parts.iter();
            parts
                .map(|part| {
                    let all = part.clamps.iter().chain([&part.table]);
                    all.map(|planned| {
                        let first = index::number(tables.len());
                        tables.extend(planned.entries(segments, shared, quotients.has(of)));
                        first
                    })
                    .collect()
                })
                .collect()
        })
        .collect();
    let serials = serials(graph);
    let functions = Functions { exact: Vec::new(), segments, tables, lookups: Vec::new() };
    let mut expansion = Expansion {
        graph: StepGraph {
            terms: Vec::with_capacity(graph.terms.len()),
            chains: List::with_capacity(graph.chains.len()),
            functions,
            ..graph.clone()
        },
        serials,
        divided: BTreeMap::new(),
    };
    for (chain, of) in graph.chains.iter().zip(computed_of) {
        match *of {
            None if quotients.copied(chain.write.value).is_some() => {}
            None => {
                let terms = graph.chain_terms(chain).iter().map(|term| expansion.divided(*term, &quotients)).collect();
                expansion.chain(chain.equation, terms, chain.write, chain.second);
            }
            Some(of) if quotients.has(of) => expansion.divisor(graph, chain, &computed[of], table_of[of][0][0], shared),
            Some(of) => expansion.function(graph, chain, (&computed[of], &table_of[of]), shared.of(chain.write.value)),
        }
    }
    expansion.graph
}

/// Last serial number of the inner values of each equation.
pub(super) fn serials(graph: &StepGraph) -> List<EquationId, u32> {
    let mut serials = List::filled(0, graph.equations.len());
    for value in &graph.values {
        if let Role::Inner(equation, serial) = value.role {
            let last: &mut u32 = &mut serials[equation];
            *last = serial.max(*last);
        }
    }
    serials
}

/// The affine argument of a function: the sum of its terms times a power of two, and a constant.
#[derive(Clone)]
struct Argument {
    terms: Vec<Term>,
    constant: f64,
    weight: i32,
}

impl Argument {
    fn of(graph: &StepGraph, chain: &Chain) -> Argument {
        let constant = chain.write.base.map_or(0.0, |base| match graph.value(base).role {
            Role::Constant(number) => number,
            _ => unreachable!("the argument of a function has a constant base"),
        });
        Argument { terms: graph.chain_terms(chain).to_vec(), constant, weight: chain.write.weight }
    }
}

/// The value of a function in one octave, what brings it to that of the argument, and the distance that tells which that
/// is.
struct Octave {
    value: ValueId,
    factor: ValueId,
    z: ValueId,
}

/// The term of a chain that is its base alone.
fn nothing(operand: ValueId) -> Term {
    Term::new(operand, Factor::Coefficient(0.0))
}

struct Expansion {
    graph: StepGraph,
    /// Last serial number of the inner values of each equation.
    serials: List<EquationId, u32>,
    /// By value of a function of which only quotients are computed what these are made of.
    divided: BTreeMap<ValueId, Divisor>,
}

/// What a quotient by the argument of a function is made of, in the equation that looks it up.
#[derive(Clone, Copy)]
struct Divisor {
    equation: EquationId,
    /// The factor of the octave, and the value in the octave.
    factors: [ValueId; 2],
    weight: i32,
}

impl Expansion {
    /// The chains of a function, in place of one that applies it.
    fn function(
        &mut self,
        graph: &StepGraph,
        chain: &Chain,
        (computed, tables): (&Computed, &[Vec<u32>]),
        of: Option<u32>,
    ) {
        let argument = Argument::of(graph, chain);
        let alone = computed.parts.len() == 1;
        let mut sum = Vec::new();
        for (part, tables) in computed.parts.iter().zip(tables) {
            let mut argument = argument.clone();
            for (clamp, table) in part.clamps.iter().zip(tables) {
                let clamped = self.inner(chain.equation, false);
                self.lookup(chain.equation, &argument, &clamp.fit, (*table, None), clamped);
                let terms = vec![Term::new(clamped, Factor::Coefficient(1.0))];
                argument = Argument { terms, constant: 0.0, weight: 0 };
            }
            let result = if alone { chain.write.value } else { self.inner(chain.equation, false) };
            let function = of.and_then(|of| part.table.stands_for.iter().position(|known| *known == of));
            let table = (tables[part.clamps.len()], function.map(index::number));
            self.lookup(chain.equation, &argument, &part.table.fit, table, result);
            sum.push(Term::new(result, Factor::Coefficient(1.0)));
        }
        if !alone {
            self.chain(chain.equation, sum, Write { value: chain.write.value, base: None, weight: 0 }, None);
        }
    }

    /// The chains of a lookup whose result is a value.
    fn lookup(
        &mut self,
        equation: EquationId,
        argument: &Argument,
        fit: &Fit,
        (table, function): (u32, Option<u32>),
        result: ValueId,
    ) {
        let Some(scaling) = fit.shape.scaling else {
            let z = self.argument(equation, argument, fit.shape.map);
            self.polynomial(equation, z, fit, (table, function), result);
            return;
        };
        let Octave { value, factor, z } = self.octave(equation, argument, fit, (table, function), scaling, false);
        if scaling.is_logarithm() {
            let powers = self.looked_up(z, table + 2, function);
            self.write(equation, Term::new(value, Factor::Coefficient(1.0)), result, (powers, 0));
            return;
        }
        let beside = scaling.beside();
        let base = (beside != 0.0).then(|| self.value(Role::Constant(beside), equation, false));
        let terms = vec![Term::new(value, Factor::Value(factor))];
        self.chain(equation, terms, Write { value: result, base, weight: scaling.weight() }, None);
    }

    /// A function of which only quotients are computed, as far as these have it in common.
    fn divisor(&mut self, graph: &StepGraph, chain: &Chain, computed: &Computed, table: u32, shared: &Shared) {
        let planned = &computed.parts[0].table;
        let scaling = planned.fit.shape.scaling.expect("a divisor is by one octave");
        let of = shared.of(chain.write.value);
        let function = of.and_then(|of| planned.stands_for.iter().position(|known| *known == of)).map(index::number);
        let (equation, argument) = (chain.equation, Argument::of(graph, chain));
        let Octave { value, factor, .. } =
            self.octave(equation, &argument, &planned.fit, (table, function), scaling, true);
        let divisor = Divisor { equation, factors: [factor, value], weight: scaling.weight() };
        self.divided.insert(chain.write.value, divisor);
    }

    /// A term, or, if it is a product with a function of which only quotients are computed, the quotient.
    fn divided(&mut self, term: Term, quotients: &Quotients) -> Term {
        let Factor::Value(factor) = term.factor else { return term };
        let Some((of, times)) = quotients.copied(factor) else { return term };
        let Divisor { equation, factors: [power, value], weight } = self.divided[&of];
        let shifted = self.inner(equation, false);
        let product = |operand: ValueId, factor: ValueId| vec![Term::new(operand, Factor::Value(factor))];
        self.chain(equation, product(term.operand, power), Write { value: shifted, base: None, weight: 0 }, None);
        let quotient = self.inner(equation, false);
        self.chain(equation, product(shifted, value), Write { value: quotient, base: None, weight }, None);
        Term::new(quotient, Factor::Coefficient(times))
    }

    /// The value of a function in the octave that its table has, for the coefficient port if that `is_factor`.
    fn octave(
        &mut self,
        equation: EquationId,
        argument: &Argument,
        fit: &Fit,
        (table, function): (u32, Option<u32>),
        scaling: Scaling,
        is_factor: bool,
    ) -> Octave {
        // The octave of the argument gives what brings it to that of the table, and the value back.
        let z = self.argument(equation, argument, scaling.distance);
        let mut factor = self.inner(equation, true);
        let scales = self.looked_up(z, table + 1, function);
        self.write(equation, nothing(z), factor, (scales, 0));
        let local = self.inner(equation, false);
        let (whole, rest) = scaling.centre();
        let one = self.value(Role::Constant(1.0), equation, false);
        let terms = vec![Term::new(one, Factor::Coefficient(whole)), Term::new(z, Factor::Value(factor))];
        let base = Some(self.value(Role::Constant(rest), equation, false));
        self.chain(equation, terms, Write { value: local, base, weight: 0 }, None);
        let value = self.inner(equation, is_factor);
        self.polynomial(equation, local, fit, (table, function), value);
        if !scaling.is_reciprocal() && !scaling.is_logarithm() {
            factor = self.inner(equation, true);
            let powers = self.looked_up(z, table + 2, function);
            self.write(equation, nothing(z), factor, (powers, 0));
        }
        Octave { value, factor, z }
    }

    /// Another lookup at an argument.
    fn looked_up(&mut self, argument: ValueId, table: u32, function: Option<u32>) -> u32 {
        self.graph.functions.lookups.push(Lookup { argument, table, function });
        index::number(self.graph.functions.lookups.len()) - 1
    }

    /// The chains of a table at its mapped argument.
    fn polynomial(
        &mut self,
        equation: EquationId,
        z: ValueId,
        fit: &Fit,
        (table, function): (u32, Option<u32>),
        result: ValueId,
    ) {
        let lookup = self.looked_up(z, table, function);
        let last = fit.columns.len() as u8 - 1;
        if fit.shape.degree == 0 {
            self.write(equation, nothing(z), result, (lookup, last));
            return;
        }
        // The columns in their order: local coordinate, its scale with octaves, coefficients.
        let u = self.inner(equation, false);
        let mut column = 1;
        let term = match fit.shape.layout {
            Layout::Uniform => {
                let scale = libm::scalbn(1.0, self.graph.functions.segments.index_bits as i32);
                Term::new(z, Factor::Coefficient(scale))
            }
            Layout::Octaves => {
                let scale = self.inner(equation, true);
                self.write(equation, nothing(z), scale, (lookup, column));
                column += 1;
                Term::new(z, Factor::Value(scale))
            }
        };
        self.write(equation, term, u, (lookup, 0));
        // Of the segment alone: it does not wait for the local coordinate.
        let mut factor = self.inner(equation, true);
        self.write(equation, nothing(z), factor, (lookup, column));
        for column in column + 1..last {
            let next = self.inner(equation, true);
            self.write(equation, Term::new(u, Factor::Value(factor)), next, (lookup, column));
            factor = next;
        }
        self.write(equation, Term::new(u, Factor::Value(factor)), result, (lookup, last));
    }

    /// The chain of the argument, mapped to -1 .. 1.
    fn argument(&mut self, equation: EquationId, argument: &Argument, map: Map) -> ValueId {
        let z = self.inner(equation, false);
        let terms = argument.terms.iter().map(|term| match term.factor {
            Factor::Coefficient(coefficient) => Term { factor: Factor::Coefficient(coefficient * map.slope), ..*term },
            Factor::Value(_) => unreachable!("the argument of a function is affine"),
        });
        let mut terms: Vec<Term> = terms.collect();
        let mut constant = argument.constant * map.slope + map.offset;
        if constant.abs() >= LARGEST_BASE {
            // The base has the argument's format, -1 .. 1. A whole number is a product, exact whatever the port.
            let one = self.value(Role::Constant(1.0), equation, false);
            terms.push(Term::new(one, Factor::Coefficient(libm::round(constant))));
            constant -= libm::round(constant);
        }
        let base = (constant != 0.0).then(|| self.value(Role::Constant(constant), equation, false));
        self.chain(equation, terms, Write { value: z, base, weight: argument.weight }, None);
        z
    }

    /// A chain of one term whose base is a column.
    fn write(&mut self, equation: EquationId, term: Term, value: ValueId, (lookup, column): (u32, u8)) {
        let factor = self.graph.value(value).factor;
        let base = Some(self.value(Role::Column(lookup, column), equation, factor));
        self.chain(equation, vec![term], Write { value, base, weight: 0 }, None);
    }

    fn inner(&mut self, equation: EquationId, factor: bool) -> ValueId {
        let serial = &mut self.serials[equation];
        *serial += 1;
        let role = Role::Inner(equation, *serial);
        self.value(role, equation, factor)
    }

    fn value(&mut self, role: Role, equation: EquationId, factor: bool) -> ValueId {
        self.graph.values.push(Value { role, equation: Some(equation), factor });
        ValueId::at(self.graph.values.len() - 1)
    }

    fn chain(&mut self, equation: EquationId, terms: Vec<Term>, write: Write, second: Option<Write>) {
        let start = index::number(self.graph.terms.len());
        self.graph.terms.extend(terms);
        let terms = start..self.graph.terms.len() as u32;
        self.graph.chains.push(Chain { equation, terms, interim: None, write, second, function: None });
    }
}
