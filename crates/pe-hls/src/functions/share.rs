//! Functions of one shape that share a table: the step in which chains apply the shape to a scaled and shifted argument,
//! and what reads the value is multiplied by a factor.
//!
//! Factors are taken into the coefficients of what reads a value where these are numbers; elsewhere a product of its own
//! brings the value back. That a function is its shape is proven at points all over its arguments, to a part of what its
//! table may be wrong by. See `docs/decisions/0098-shapes.md`.

use std::collections::{BTreeMap, BTreeSet};

use pe_ir::functions::{ScalarFunction, Scaled};
use pe_ir::graph::{Chain, Factor, Role, StageForm, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, EquationId, List, at};
use pe_ir::word::WordFormat;

use super::shape::{Free, Shaped, shaped};

/// Points at which a function is compared with its shape.
const POINTS: u32 = 128;

/// Bits below half of the lowest one that a data port sees, to which a function is its shape.
const BITS: i32 = 6;

/// Functions of one shape.
pub(super) struct Family {
    shape: ScalarFunction,
    members: BTreeMap<usize, Member>,
}

/// `f(x) = factor*F(slope*x + offset) + beside.0*x + beside.1`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    slope: f64,
    offset: f64,
    factor: f64,
    beside: (f64, f64),
    /// Largest difference of both sides, over the factor.
    apart: f64,
}

/// Most times that the parts of a sum are larger than the sum.
const CANCELLED: f64 = 32.0;

/// A step in which some functions are applied as their shapes, and the arguments of these.
pub(super) struct Rewritten {
    pub graph: StepGraph,
    pub arguments: Vec<(f64, f64)>,
    pub shared: Shared,
}

/// What shapes stand for.
#[derive(Default)]
pub(super) struct Shared {
    /// By function of the step how far a shape is from what it stands for, in units of its own.
    apart: Vec<f64>,
    /// By number in the step without shapes what functions are of theirs.
    functions: BTreeMap<u32, Scaled>,
    /// The function that a value of a shape stands for.
    of: BTreeMap<ValueId, u32>,
}

impl Shared {
    /// How far a function is from what it stands for.
    pub fn apart(&self, function: usize) -> f64 {
        self.apart.get(function).copied().unwrap_or(0.0)
    }

    /// The function that a value of a shape stands for.
    pub fn of(&self, value: ValueId) -> Option<u32> {
        self.of.get(&value).copied()
    }

    /// What such a function is of its shape.
    pub fn function(&self, function: u32) -> &Scaled {
        &self.functions[&function]
    }
}

/// The families of at least two functions of a step. `arguments` are as in [`super::tabulate`].
pub(super) fn families(graph: &StepGraph, arguments: &[(f64, f64)], format: WordFormat) -> Vec<Family> {
    let exact = &graph.functions.exact;
    let mut ranges = vec![(f64::INFINITY, f64::NEG_INFINITY); exact.len()];
    for chain in &graph.chains {
        if let Some(function) = chain.function {
            let ((low, high), range) = (arguments[chain.write.value.index()], &mut ranges[at(function)]);
            *range = (range.0.min(low), range.1.max(high));
        }
    }
    let mut of_key: BTreeMap<String, Vec<(usize, Shaped)>> = BTreeMap::new();
    for (number, (function, range)) in exact.iter().zip(&ranges).enumerate() {
        if range.0 <= range.1
            && range.0.is_finite()
            && range.1.is_finite()
            && let Some(shaped) = shaped(function)
        {
            of_key.entry(shaped.key.clone()).or_default().push((number, shaped));
        }
    }
    let family = |alike: Vec<(usize, Shaped)>| {
        let body = alike.first().map(|(_, first)| first.body.clone())?;
        let name = body.text(&|_, _| "x".to_owned());
        let shape = ScalarFunction { name, body, variable: exact[alike[0].0].variable };
        let member = |(number, shaped): (usize, Shaped)| {
            Some((number, Member::proven(&exact[number], &shape, &shaped, ranges[number], format)?))
        };
        let members: BTreeMap<usize, Member> = alike.into_iter().filter_map(member).collect();
        (members.len() > 1).then_some(Family { shape, members })
    };
    of_key.into_values().filter(|alike| alike.len() > 1).filter_map(family).collect()
}

impl Member {
    /// A function as its shape, if that is proven for its arguments.
    pub(super) fn proven(
        function: &ScalarFunction,
        shape: &ScalarFunction,
        shaped: &Shaped,
        range: (f64, f64),
        format: WordFormat,
    ) -> Option<Member> {
        let Member { slope, offset, factor, beside, .. } = Member::chosen(shaped, range);
        // A short coefficient port would round the argument.
        let is_exact = libm::exp2(libm::round(libm::log2(slope.abs()))) == slope.abs();
        if format.coefficient_bits < format.data_bits && !is_exact {
            return None;
        }
        let point = |step: u32| range.0 + (range.1 - range.0) * (f64::from(step) / f64::from(POINTS));
        let (mut largest, mut parts, mut apart) = (0.0f64, 0.0f64, 0.0f64);
        for x in (0..=POINTS).map(point) {
            let (main, rest) = (factor * shape.evaluate(slope * x + offset), beside.0 * x + beside.1);
            let should = function.evaluate(x);
            let difference = (main + rest - should).abs();
            if !difference.is_finite() {
                return None;
            }
            (largest, parts, apart) = (largest.max(should.abs()), parts.max(main.abs()), apart.max(difference));
        }
        let proven = largest > 0.0 && apart <= libm::scalbn(largest, -(format.data_bits as i32) - BITS);
        let apart = apart / factor.abs();
        (proven && parts <= CANCELLED * largest).then_some(Member { slope, offset, factor, beside, apart })
    }

    /// What is free is chosen so that arguments of all members begin at 1 or 2, and exponentials end at 1.
    fn chosen(shaped: &Shaped, (low, high): (f64, f64)) -> Member {
        let Shaped { slope, offset, factor, beside, free, .. } = *shaped;
        let member = Member { slope, offset, factor, beside, apart: 0.0 };
        let ends = [low, high].map(|x| slope * x + offset);
        match free {
            Free::Scale(power) if ends[0] * ends[1] > 0.0 => {
                let near = ends[0].abs().min(ends[1].abs());
                let scale = libm::exp2(-libm::floor(libm::log2(near)));
                let factor = factor * libm::pow(scale, -power);
                Member { slope: slope * scale, offset: offset * scale, factor, ..member }
            }
            Free::Shift => {
                let most = ends[0].max(ends[1]);
                Member { offset: offset - most, factor: factor * libm::exp(most), ..member }
            }
            Free::Scale(_) | Free::Nothing => member,
        }
    }
}

/// The step with the functions of some families applied as their shapes. Values that are `kept` stay what they are.
pub(super) fn rewritten(
    graph: &StepGraph,
    arguments: &[(f64, f64)],
    families: &[&Family],
    kept: &[ValueId],
) -> Rewritten {
    let mut exact = graph.functions.exact.clone();
    let mut apart = vec![0.0f64; exact.len()];
    let mut members: BTreeMap<usize, (u32, Member)> = BTreeMap::new();
    for family in families {
        let shape = index::number(exact.len());
        exact.push(family.shape.clone());
        apart.push(family.members.values().fold(0.0, |most, member| most.max(member.apart)));
        members.extend(family.members.iter().map(|(function, member)| (*function, (shape, *member))));
    }
    let number = |(function, (_, member)): (&usize, &(u32, Member))| {
        let Member { slope, offset, factor, beside, .. } = *member;
        let name = graph.functions.exact[*function].name.clone();
        (index::number(*function), Scaled { name, slope, offset, factor, beside })
    };
    let mut shared = Shared { apart, functions: members.iter().map(number).collect(), of: BTreeMap::new() };
    let of = |chain: &Chain| chain.function.and_then(|function| members.get(&at(function)).copied());
    let scaled: BTreeMap<ValueId, Read> = scaled(graph, &of, kept);
    let mut serials = super::expand::serials(graph);
    let mut writer = Writer {
        graph: StepGraph {
            terms: Vec::with_capacity(graph.terms.len()),
            chains: List::with_capacity(graph.chains.len()),
            ..graph.clone()
        },
        arguments: arguments.to_vec(),
    };
    writer.graph.functions.exact = exact;
    for chain in &graph.chains {
        let (mut terms, mut added) = (Vec::with_capacity(chain.terms.len()), 0.0);
        for term in graph.chain_terms(chain) {
            match (term.factor, scaled.get(&term.operand)) {
                (Factor::Coefficient(coefficient), Some(read)) => {
                    terms.push(Term::new(term.operand, Factor::Coefficient(coefficient * read.factor)));
                    terms.extend(
                        read.beside
                            .iter()
                            .map(|(operand, by)| Term::new(*operand, Factor::Coefficient(coefficient * by))),
                    );
                    added += coefficient * read.added;
                }
                _ => terms.push(*term),
            }
        }
        let Some((shape, member)) = of(chain) else {
            let constant = own_constant(graph, chain).filter(|_| chain.function.is_some());
            let base = match constant {
                Some(constant) if added != 0.0 => {
                    let sum = constant + libm::scalbn(added, chain.write.weight);
                    Some(writer.value(Role::Constant(sum), chain.equation, false))
                }
                _ => {
                    writer.add(&mut terms, added, chain.equation);
                    chain.write.base
                }
            };
            writer.chain(Chain { write: Write { base, ..chain.write }, ..chain.clone() }, terms);
            continue;
        };
        let constant = own_constant(graph, chain).expect("the argument of a function has a constant base");
        let constant = constant + libm::scalbn(added, chain.write.weight);
        let argument = argument(&terms, chain.write.weight);
        for Term { factor, .. } in &mut terms {
            if let Factor::Coefficient(coefficient) = factor {
                *coefficient *= member.slope;
            }
        }
        let moved = member.slope * constant + member.offset;
        let base = (moved != 0.0).then(|| writer.value(Role::Constant(moved), chain.equation, false));
        let value = chain.write.value;
        let (low, high) = arguments[value.index()];
        let ends = [low, high].map(|x| member.slope * x + member.offset);
        let range = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let applied = Chain { function: Some(shape), ..chain.clone() };
        if scaled.contains_key(&value) {
            writer.arguments[value.index()] = range;
            shared.of.extend(chain.function.map(|function| (value, function)));
            writer.chain(Chain { write: Write { base, ..chain.write }, ..applied }, terms);
        } else {
            let serial = &mut serials[chain.equation];
            *serial += 1;
            let inner = writer.value(Role::Inner(chain.equation, *serial), chain.equation, false);
            writer.arguments[inner.index()] = range;
            shared.of.extend(chain.function.map(|function| (inner, function)));
            writer.chain(Chain { write: Write { value: inner, base, ..chain.write }, ..applied }, terms);
            let mut back = vec![Term::new(inner, Factor::Coefficient(member.factor))];
            let (slope, added) = member.beside;
            if slope != 0.0 {
                let beside = argument.iter().map(|(operand, by)| Term::new(*operand, Factor::Coefficient(slope * by)));
                back.extend(beside);
            }
            let added = slope * constant + added;
            let base = (added != 0.0).then(|| writer.value(Role::Constant(added), chain.equation, false));
            let write = Write { base, weight: 0, ..chain.write };
            writer.chain(Chain { function: None, write, ..chain.clone() }, back);
        }
    }
    Rewritten { graph: writer.graph, arguments: writer.arguments, shared }
}

/// The constant base of a chain that applies a function.
fn own_constant(graph: &StepGraph, chain: &Chain) -> Option<f64> {
    chain.write.base.map_or(Some(0.0), |base| match graph.value(base).role {
        Role::Constant(number) => Some(number),
        _ => None,
    })
}

/// The terms of an affine sum of such a weight: values and what they are multiplied by.
fn argument(terms: &[Term], weight: i32) -> Vec<(ValueId, f64)> {
    let term = |term: &Term| match term.factor {
        Factor::Coefficient(coefficient) => Some((term.operand, libm::scalbn(coefficient, weight))),
        Factor::Value(_) => None,
    };
    terms.iter().filter_map(term).collect()
}

/// What reads a value gets in its place: the value of the shape times a factor, other values and a number.
struct Read {
    factor: f64,
    beside: Vec<(ValueId, f64)>,
    added: f64,
}

/// Values whose factor is in the coefficients of all that reads them, with that factor: all values of an equation or none,
/// so that stages stay alike.
fn scaled(
    graph: &StepGraph,
    of: &impl Fn(&Chain) -> Option<(u32, Member)>,
    kept: &[ValueId],
) -> BTreeMap<ValueId, Read> {
    let mut whole: BTreeSet<ValueId> = kept.iter().chain(&graph.outputs).copied().collect();
    whole.extend(graph.states.iter().flat_map(|(start, end)| [*start, *end]));
    for chain in &graph.chains {
        for Term { operand, factor, .. } in graph.chain_terms(chain) {
            if let Factor::Value(factor) = factor {
                whole.extend([*operand, *factor]);
            }
        }
        whole.extend(chain.writes().filter_map(|write| write.base));
    }
    let applied = || graph.chains.iter().filter_map(|chain| Some((chain, of(chain)?.1)));
    let functions: BTreeSet<ValueId> = applied().map(|(chain, _)| chain.write.value).collect();
    // What a method overwrites in place may be gone where the value is read.
    let in_place = graph.form == StageForm::Method;
    let is_whole = |chain: &Chain| {
        let nested = |term: &Term| functions.contains(&term.operand);
        whole.contains(&chain.write.value)
            || chain.interim.is_some()
            || chain.second.is_some()
            || graph.chain_terms(chain).iter().any(nested)
            || (in_place && of(chain).is_some_and(|(_, member)| member.beside.0 != 0.0))
    };
    let unlike: BTreeSet<EquationId> =
        applied().filter(|(chain, _)| is_whole(chain)).map(|(chain, _)| chain.equation).collect();
    let alike = applied().filter(|(chain, _)| !unlike.contains(&chain.equation));
    let read = |(chain, member): (&Chain, Member)| {
        let (slope, added) = member.beside;
        let constant = own_constant(graph, chain).unwrap_or(0.0);
        let mut beside = argument(graph.chain_terms(chain), chain.write.weight);
        beside.iter_mut().for_each(|(_, by)| *by *= slope);
        beside.retain(|(_, by)| *by != 0.0);
        (chain.write.value, Read { factor: member.factor, beside, added: slope * constant + added })
    };
    alike.map(read).collect()
}

struct Writer {
    graph: StepGraph,
    arguments: Vec<(f64, f64)>,
}

impl Writer {
    fn value(&mut self, role: Role, equation: EquationId, factor: bool) -> ValueId {
        self.graph.values.push(Value { role, equation: Some(equation), factor });
        self.arguments.push((f64::INFINITY, f64::NEG_INFINITY));
        ValueId::at(self.graph.values.len() - 1)
    }

    /// A number as another term of a sum, or beside the one that is there.
    fn add(&mut self, terms: &mut Vec<Term>, number: f64, equation: EquationId) {
        if number == 0.0 {
            return;
        }
        let graph = &self.graph;
        let is_number = |term: &&mut Term| graph.value(term.operand).role == Role::Constant(1.0);
        match terms.iter_mut().find(is_number).map(|term| &mut term.factor) {
            Some(Factor::Coefficient(coefficient)) => *coefficient += number,
            _ => {
                let one = self.value(Role::Constant(1.0), equation, false);
                terms.push(Term::new(one, Factor::Coefficient(number)));
            }
        }
    }

    fn chain(&mut self, chain: Chain, terms: Vec<Term>) {
        let start = index::number(self.graph.terms.len());
        self.graph.terms.extend(terms);
        self.graph.chains.push(Chain { terms: start..index::number(self.graph.terms.len()), ..chain });
    }
}
