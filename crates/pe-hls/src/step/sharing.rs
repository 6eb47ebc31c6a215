//! Which algebraic equations are computed once and shared, and which are inlined into every equation that reads them.

use std::collections::{BTreeMap, HashMap};

use pe_ir::codes;
use pe_ir::index::{at, number};
use pe_ir::model::{Expr, Model, Variable};
use pe_ir::source::Diagnostic;

use super::polynomial::{Polynomial, TooManyTerms};
use super::price;

/// Expanded equations of a model after the decision.
pub struct Expanded {
    /// Right-hand side of each state's derivative.
    pub derivatives: Vec<Polynomial>,
    /// Right-hand side of each algebraic equation; of a function its argument.
    pub algebraics: Vec<Polynomial>,
    /// The functions among the algebraic equations.
    pub functions: Vec<Option<Expr>>,
    /// Whether an algebraic variable is computed on its own; the others occur in no polynomial.
    pub shared: Vec<bool>,
}

/// The variable that a function reads.
fn only_variable(expr: &Expr) -> Variable {
    let mut only = None;
    expr.each_variable(&mut |variable| {
        assert!(only.is_none_or(|other| other == variable), "a function of several variables was not lifted");
        only = Some(variable);
    });
    only.expect("a function of a variable")
}

/// What the products of an equation are computed from: the polynomial that it is, or the argument of its function.
fn polynomial_of<'a>(
    expr: &Expr,
    inline: &impl Fn(Variable) -> Option<&'a Polynomial>,
) -> Result<Polynomial, TooManyTerms> {
    match expr.is_polynomial() {
        true => Polynomial::expand(expr, inline),
        false => Polynomial::expand(&Expr::Variable(only_variable(expr)), inline),
    }
}

/// Above this product of terms and readers inlining is not even priced: it would cost more than it could save.
const PRICING_LIMIT: usize = 4096;

/// Inlines an algebraic equation of a lifted model unless it is a function, sharing it costs fewer products, or a sum of
/// two of its products and more would get longer than `longest`; and but for those that are always computed on their own.
/// Ties are inlined: no transfer, no waiting.
///
/// # Errors
/// `E0801` for an equation with too many monomials.
pub fn expand_keeping(model: &Model, longest: u32, keep: &dyn Fn(usize) -> bool) -> Result<Expanded, Vec<Diagnostic>> {
    let readers = Readers::of(model);
    let mut algebraics: Vec<Polynomial> = Vec::with_capacity(model.algebraics.len());
    let mut shared = vec![false; model.algebraics.len()];
    let mut sums = Sums { longest: at(longest), inlined: BTreeMap::new() };
    let mut prices = Prices { model, readers: &readers, known: HashMap::new() };
    let mut errors = Vec::new();
    for (index, algebraic) in model.algebraics.iter().enumerate() {
        let polynomial = match polynomial_of(&algebraic.expr, &inlined(&algebraics, &shared)) {
            Ok(polynomial) => polynomial,
            Err(_) => {
                errors.push(too_many_terms(&algebraic.name, algebraic.span));
                Polynomial::default()
            }
        };
        algebraics.push(polynomial);
        shared[index] = true;
        if !keep(index) && !sums.lengthen(&algebraics[index], readers.of_algebraic(index)) {
            shared[index] = prices.sharing_pays(index, &algebraics, &shared);
        }
        if !shared[index] {
            sums.add(&algebraics[index], readers.of_algebraic(index));
        }
    }
    let mut derivatives = Vec::with_capacity(model.states.len());
    for state in &model.states {
        match Polynomial::expand(&state.derivative, &inlined(&algebraics, &shared)) {
            Ok(polynomial) => derivatives.push(polynomial),
            Err(_) => errors.push(too_many_terms(&state.name, state.span)),
        }
    }
    let function = |expr: &Expr| (!expr.is_polynomial()).then(|| expr.clone());
    let functions = model.algebraics.iter().map(|algebraic| function(&algebraic.expr)).collect();
    if errors.is_empty() { Ok(Expanded { derivatives, algebraics, functions, shared }) } else { Err(errors) }
}

fn inlined<'a>(algebraics: &'a [Polynomial], shared: &'a [bool]) -> impl Fn(Variable) -> Option<&'a Polynomial> {
    |variable| match variable {
        Variable::Algebraic(a) if !shared[at(a)] => algebraics.get(at(a)),
        _ => None,
    }
}

/// What readers are with all that was decided so far, and their products.
struct Prices<'m> {
    model: &'m Model,
    readers: &'m Readers,
    known: HashMap<Variable, (Polynomial, usize)>,
}

impl Prices<'_> {
    /// Whether an equation costs fewer products if it is shared than in all its readers. What is not shared becomes a part
    /// of these.
    fn sharing_pays(&mut self, index: usize, algebraics: &[Polynomial], shared: &[bool]) -> bool {
        let (own, readers) = (&algebraics[index], self.readers.of_algebraic(index));
        let read_by_function = || {
            readers.iter().any(|reader| match *reader {
                Variable::Algebraic(a) => !self.model.algebraics[at(a)].expr.is_polynomial(),
                _ => false,
            })
        };
        // The argument of a function is computed by a single chain.
        if !self.model.algebraics[index].expr.is_polynomial() || (own.degree() > 1 && read_by_function()) {
            return true;
        }
        if readers.len() < 2 && own.variables().count() <= own.len() {
            readers.iter().for_each(|reader| drop(self.known.remove(reader)));
            return false;
        }
        if own.len() > 2 && own.len() * readers.len() > PRICING_LIMIT {
            return true;
        }
        self.with_own(index, algebraics, shared).map(|inlined| self.known.extend(inlined)).is_none()
    }

    /// Readers with an equation inlined, if that costs no more products.
    fn with_own(
        &mut self,
        index: usize,
        algebraics: &[Polynomial],
        shared: &[bool],
    ) -> Option<Vec<(Variable, (Polynomial, usize))>> {
        let (own, readers) = (&algebraics[index], self.readers.of_algebraic(index));
        let mut share = price::products(own);
        for reader in readers {
            if !self.known.contains_key(reader) {
                let expr = match *reader {
                    Variable::State(s) => &self.model.states[s].derivative,
                    Variable::Algebraic(a) => &self.model.algebraics[at(a)].expr,
                    Variable::Input(_) => unreachable!("inputs read nothing"),
                };
                let polynomial = polynomial_of(expr, &inlined(algebraics, shared)).ok()?;
                let cost = price::products(&polynomial);
                self.known.insert(*reader, (polynomial, cost));
            }
            share += self.known[reader].1;
        }
        let mut with = Vec::with_capacity(readers.len());
        let mut inline = 0;
        for reader in readers {
            let polynomial = self.known[reader].0.substituted(Variable::Algebraic(number(index)), own).ok()?;
            let cost = price::products(&polynomial);
            inline += cost;
            if inline > share {
                return None;
            }
            with.push((*reader, (polynomial, cost)));
        }
        Some(with)
    }
}

/// How many products of variables were inlined where.
struct Sums {
    longest: usize,
    inlined: BTreeMap<Variable, usize>,
}

impl Sums {
    /// Products of two variables and more.
    fn products(own: &Polynomial) -> usize {
        own.terms().filter(|(monomial, _)| monomial.len() > 1).count()
    }

    /// Whether a reader would get a sum that is too long.
    fn lengthen(&self, own: &Polynomial, readers: &[Variable]) -> bool {
        let count = Sums::products(own);
        let of = |reader| self.inlined.get(reader).copied().unwrap_or(0);
        count > 1 && readers.iter().any(|reader| of(reader) > 0 && of(reader) + count > self.longest)
    }

    fn add(&mut self, own: &Polynomial, readers: &[Variable]) {
        let count = Sums::products(own);
        readers.iter().for_each(|reader| *self.inlined.entry(*reader).or_default() += count);
    }
}

/// For each algebraic variable the equations that read it, directly.
struct Readers {
    readers: HashMap<usize, Vec<Variable>>,
}

impl Readers {
    fn of(model: &Model) -> Readers {
        let mut readers: HashMap<usize, Vec<Variable>> = HashMap::new();
        let mut visit = |expr: &Expr, reader: Variable| {
            expr.each_variable(&mut |variable| {
                if let Variable::Algebraic(a) = variable {
                    let list = readers.entry(at(a)).or_default();
                    if list.last() != Some(&reader) {
                        list.push(reader);
                    }
                }
            });
        };
        for (index, algebraic) in model.algebraics.iter().enumerate() {
            visit(&algebraic.expr, Variable::Algebraic(number(index)));
        }
        for (index, state) in model.states.numbered() {
            visit(&state.derivative, Variable::State(index));
        }
        Readers { readers }
    }

    fn of_algebraic(&self, index: usize) -> &[Variable] {
        self.readers.get(&index).map_or(&[], Vec::as_slice)
    }
}

fn too_many_terms(name: &str, span: pe_ir::source::Span) -> Diagnostic {
    let message = format!("the equation of `{name}` expands to more than {} products", Polynomial::LIMIT);
    Diagnostic::error(codes::TOO_MANY_PRODUCTS, span, message)
        .with_help("give a part of it a name of its own as an algebraic equation")
}
