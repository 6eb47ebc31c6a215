//! The passes that find out what the entries of matrices are: numbers, and what stands on both sides of a diagonal.

use std::collections::{BTreeMap, BTreeSet};

use crate::equations::write::{Flat, Row};
use crate::evaluate::signals::SIGNALS;
use crate::names::table::Names;
use crate::report::Report;
use pe_ir::codes;
use pe_ir::index::{at, number};
use pe_ir::model::{Entry, Expr, Function, Matrix, Output, Right, Select, Solution, Variable};
use pe_ir::source::Diagnostic;
use std::sync::Arc;

/// Places at which two entries are compared.
const PLACES: u64 = 8;

/// Part of the terms that entries are made of by which these may differ for being rounded, and that by which what they
/// are made of may be wrong.
const ROUNDED: f64 = 1e-9;
const WRONG: f64 = 1e-14;

/// The algebraic variables that are elements of matrices.
fn elements(names: &Names) -> BTreeSet<u32> {
    let matrices = names.quantities.iter().filter(|quantity| quantity.matrix.is_some() && !quantity.broken);
    matrices.flat_map(|quantity| quantity.base..quantity.base + number(quantity.length)).collect()
}

/// Puts the numbers that elements of matrices are in their place, wherever these are read, so that zeros cost nothing;
/// gives these numbers.
pub(crate) fn fold(flat: &mut Flat, outputs: &[Output], names: &Names) -> BTreeMap<u32, f64> {
    let elements = elements(names);
    let mut known: BTreeMap<u32, f64> = BTreeMap::new();
    if elements.is_empty() {
        return known;
    }
    loop {
        let before = known.len();
        for element in &elements {
            let Some(Some(row)) = flat.algebraics.get(at(*element)) else { continue };
            if !known.contains_key(element)
                && let Expr::Constant(value) = folded(&row.expr, &known)
            {
                known.insert(*element, value);
            }
        }
        if known.len() == before {
            break;
        }
    }
    for row in flat.states.iter_mut().chain(&mut flat.algebraics).flatten() {
        let mut reads = false;
        row.expr.each_variable(&mut |variable| {
            reads |= matches!(variable, Variable::Algebraic(element) if known.contains_key(&element));
        });
        if reads {
            row.expr = folded(&row.expr, &known);
        }
    }
    let published: BTreeSet<u32> = outputs.iter().filter_map(|output| element_of(output.variable)).collect();
    for element in known.keys().filter(|element| !published.contains(element)) {
        flat.algebraics[at(*element)] = None;
    }
    known
}

fn element_of(variable: Variable) -> Option<u32> {
    match variable {
        Variable::Algebraic(element) if element < SIGNALS => Some(element),
        _ => None,
    }
}

/// An expression with numbers in the place of some algebraic variables.
fn folded(expr: &Expr, known: &BTreeMap<u32, f64>) -> Expr {
    let again = |expr: &Expr| folded(expr, known);
    match expr {
        Expr::Constant(_) => expr.clone(),
        Expr::Variable(variable) => {
            let value = element_of(*variable).and_then(|element| known.get(&element));
            value.map_or_else(|| expr.clone(), |value| Expr::Constant(*value))
        }
        Expr::Sum(members) => Expr::sum(members.iter().map(again).collect()),
        Expr::Product(members) => Expr::product(members.iter().map(again).collect()),
        Expr::Power(base, exponent) => Expr::power(again(base), *exponent),
        Expr::Apply(function, argument) => match again(argument) {
            Expr::Constant(value) if function.evaluate(value).is_finite() => Expr::Constant(function.evaluate(value)),
            argument => Expr::Apply(*function, Box::new(argument)),
        },
        Expr::Select(select) => match again(&select.condition) {
            Expr::Constant(condition) => again(if condition > 0.0 { &select.yes } else { &select.no }),
            condition => Expr::Select(Box::new(Select { condition, yes: again(&select.yes), no: again(&select.no) })),
        },
        Expr::Solution(solution) => {
            let Solution { matrix, right, row } = &**solution;
            let entry = |entry: &Entry| Entry { value: again(&entry.value), ..*entry };
            let entries = matrix.entries.iter().map(entry).filter(|entry| entry.value != Expr::Constant(0.0)).collect();
            let matrix = Matrix { entries, name: matrix.name.clone(), ..**matrix };
            let right = Right { values: right.values.iter().map(again).collect(), ..**right };
            Expr::Solution(Box::new(Solution { matrix: Arc::new(matrix), right: Arc::new(right), row: *row }))
        }
    }
}

/// Checks that matrices which are declared symmetric are; their upper triangles then are their lower ones. Whether
/// anything has changed. In: an order in which algebraic equations can be computed, and the elements that are numbers.
pub(crate) fn mirror(
    flat: &mut Flat,
    (order, numbers): (&[u32], &BTreeMap<u32, f64>),
    outputs: &[Output],
    names: &Names,
    report: &mut Report,
) -> bool {
    let mut places: Option<Vec<Vec<Valued>>> = None;
    let mut mirrored: BTreeMap<u32, u32> = BTreeMap::new();
    let mut same_numbers: BTreeMap<u32, f64> = BTreeMap::new();
    for quantity in names.quantities.iter().filter(|quantity| quantity.matrix == Some(true) && !quantity.broken) {
        let mut told = false;
        for offset in 0..quantity.length {
            let subscripts = quantity.subscripts(offset);
            let Ok(across) = quantity.offset(&[subscripts[1], subscripts[0]]) else { continue };
            if offset <= across {
                continue;
            }
            let (lower, upper) = (quantity.base + number(offset), quantity.base + number(across));
            let both = (quantity.exists(offset), quantity.exists(across));
            if both != (true, true) {
                continue;
            }
            let row = |element: u32| flat.algebraics[at(element)].as_ref();
            let same = match (row(lower), row(upper)) {
                (None, None) if numbers.get(&lower) == numbers.get(&upper) => continue,
                (Some(one), Some(other)) if one.expr == other.expr => true,
                _ => {
                    let places =
                        places.get_or_insert_with(|| (0..PLACES).map(|place| evaluated(flat, order, place)).collect());
                    let value = |place: &[Valued], element: u32| {
                        numbers.get(&element).map_or(place[at(element)], |number| Valued::of(*number))
                    };
                    let both = places.iter().map(|place| (value(place, lower), value(place, upper)));
                    let mut both = both.filter(|(one, other)| one.is_number() && other.is_number()).peekable();
                    both.peek().is_some() && both.all(|(one, other)| one.agrees(other))
                }
            };
            if same {
                match (numbers.get(&lower), numbers.get(&upper)) {
                    (None, None) => _ = mirrored.insert(upper, lower),
                    (Some(known), None) => _ = same_numbers.insert(upper, *known),
                    (None, Some(known)) => _ = same_numbers.insert(lower, *known),
                    (Some(_), Some(_)) => {}
                }
                continue;
            }
            if !std::mem::replace(&mut told, true) {
                let (one, other) = (quantity.name_at(offset), quantity.name_at(across));
                let message = format!(
                    "`{}` is declared symmetric, but `{one}` and `{other}` are defined differently",
                    quantity.name.text
                );
                let mut error = Diagnostic::error(codes::NOT_SYMMETRIC, quantity.name.span, message)
                    .with_help("define one of the two triangles alone, or leave `symmetric` out");
                for element in [lower, upper] {
                    let span = row(element).map(|row| row.span);
                    error = span.into_iter().fold(error, |error, span| error.with_label(span, "defined here"));
                }
                report.push(error);
            }
        }
    }
    if mirrored.is_empty() && same_numbers.is_empty() {
        return false;
    }
    let read = |variable: &mut Variable| {
        if let Some(lower) = element_of(*variable).and_then(|upper| mirrored.get(&upper)) {
            *variable = Variable::Algebraic(*lower);
        }
    };
    let rows = flat.states.iter_mut().chain(&mut flat.algebraics).flatten();
    rows.for_each(|row: &mut Row| {
        row.expr.each_variable_mut(&mut |variable| read(variable));
        if !same_numbers.is_empty() {
            row.expr = folded(&row.expr, &same_numbers);
        }
    });
    let published: BTreeSet<u32> = outputs.iter().filter_map(|output| element_of(output.variable)).collect();
    for gone in mirrored.keys().chain(same_numbers.keys()).filter(|gone| !published.contains(gone)) {
        flat.algebraics[at(*gone)] = None;
    }
    true
}

/// A value, and the magnitude of the terms that it is made of: where they cancel, it tells how much rounding leaves.
#[derive(Clone, Copy, Debug)]
struct Valued {
    value: f64,
    terms: f64,
}

impl Valued {
    fn of(value: f64) -> Valued {
        Valued { value, terms: value.abs() }
    }

    fn is_number(self) -> bool {
        self.value.is_finite() && self.terms.is_finite()
    }

    /// Whether two values are the same but for rounding.
    fn agrees(self, other: Valued) -> bool {
        (self.value - other.value).abs() <= ROUNDED * self.terms.max(other.terms)
    }

    fn applied(self, function: &impl Fn(f64) -> f64) -> Valued {
        let value = function(self.value);
        let moved = (function(self.value + WRONG * self.terms) - value).abs();
        Valued { value, terms: value.abs().max(moved / ROUNDED) }
    }

    /// The value of an expression. What jumps or bends is taken for a smooth function, so that entries which differ
    /// behind a bend differ everywhere.
    fn evaluated(expr: &Expr, variable: &impl Fn(Variable) -> Valued) -> Valued {
        let again = |expr: &Expr| Valued::evaluated(expr, variable);
        match expr {
            Expr::Constant(number) => Valued::of(*number),
            Expr::Variable(name) => variable(*name),
            Expr::Sum(members) => members.iter().map(again).fold(Valued::of(0.0), |sum, member| Valued {
                value: sum.value + member.value,
                terms: sum.terms + member.terms,
            }),
            Expr::Product(members) => members.iter().map(again).fold(Valued::of(1.0), |product, member| Valued {
                value: product.value * member.value,
                terms: product.terms * member.terms,
            }),
            Expr::Power(base, exponent) => {
                let (base, exponent) = (again(base), f64::from(*exponent));
                Valued { value: libm::pow(base.value, exponent), terms: libm::pow(base.terms, exponent) }
            }
            Expr::Apply(Function::Abs, argument) => again(argument).applied(&|x| libm::log(libm::cosh(x))),
            Expr::Apply(Function::Sign, argument) => again(argument).applied(&libm::tanh),
            Expr::Apply(Function::Floor, argument) => again(argument).applied(&|x| x - 0.1 * libm::sin(x)),
            Expr::Apply(function, argument) => again(argument).applied(&|x| function.evaluate(x)),
            Expr::Select(select) => {
                let part = again(&select.condition).applied(&|x| 0.5 + libm::atan(x) / 4.0);
                let (yes, no) = (again(&select.yes), again(&select.no));
                Valued {
                    value: part.value * yes.value + (1.0 - part.value) * no.value,
                    terms: part.terms * yes.terms + (1.0 + part.terms) * no.terms,
                }
            }
            Expr::Solution(_) => unreachable!("it is the whole of an equation"),
        }
    }
}

/// The algebraic variables where all that they depend on has arbitrary values; solutions of systems have such, too.
fn evaluated(flat: &Flat, order: &[u32], place: u64) -> Vec<Valued> {
    let arbitrary = |kind: u64, number: u32| {
        // Half of the places are in the domain of roots and logarithms.
        let mixed = (place << 40 | kind << 34 | u64::from(number)).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let part = ((mixed ^ mixed >> 32) >> 11) as f64 / (1u64 << 53) as f64;
        Valued::of(if place.is_multiple_of(2) { 0.2 + part } else { 4.0 * part - 2.0 })
    };
    let mut values = vec![Valued::of(0.0); flat.algebraics.len()];
    for equation in order {
        let Some(row) = &flat.algebraics[at(*equation)] else { continue };
        values[at(*equation)] = match &row.expr {
            Expr::Solution(_) => arbitrary(3, *equation),
            expr => Valued::evaluated(expr, &|variable| match variable {
                Variable::State(state) => arbitrary(0, state.number()),
                Variable::Input(input) => arbitrary(1, input),
                Variable::Algebraic(algebraic) if algebraic < SIGNALS => values[at(algebraic)],
                Variable::Algebraic(signal) => arbitrary(2, signal),
            }),
        };
    }
    values
}
