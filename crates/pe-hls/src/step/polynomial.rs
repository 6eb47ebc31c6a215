//! Polynomials over model variables, and their arrangement as nested sums of products.

use std::collections::{BTreeMap, BTreeSet};

use pe_ir::index::StateId;
use pe_ir::model::{Expr, Variable};

use super::arrival::Arrivals;

/// Variables of a product, sorted, powers by repetition. Empty for the constant term.
pub type Monomial = Vec<Variable>;

/// A polynomial in canonical form: no zero coefficients, monomials sorted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Polynomial {
    terms: BTreeMap<Monomial, f64>,
}

/// Expansion gave up: more monomials than [`Polynomial::LIMIT`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooManyTerms;

impl Polynomial {
    /// Largest number of monomials of one equation; far above what a right-hand side written by hand can have.
    pub const LIMIT: usize = 20_000;

    /// Expands an expression. `inline` gives the polynomial to put in place of a variable, if any.
    ///
    /// # Errors
    /// [`TooManyTerms`] when the expansion has more than [`Self::LIMIT`] monomials.
    pub fn expand<'a>(
        expr: &Expr,
        inline: &impl Fn(Variable) -> Option<&'a Polynomial>,
    ) -> Result<Polynomial, TooManyTerms> {
        match expr {
            Expr::Constant(value) => Ok(Polynomial::constant(*value)),
            Expr::Variable(variable) => match inline(*variable) {
                Some(polynomial) => Ok(polynomial.clone()),
                None => Ok(Polynomial { terms: BTreeMap::from([(vec![*variable], 1.0)]) }),
            },
            Expr::Sum(members) => {
                let mut sum = Polynomial::default();
                for member in members {
                    for (monomial, coefficient) in Polynomial::expand(member, inline)?.terms {
                        sum.add(monomial, coefficient);
                    }
                    sum.check()?;
                }
                Ok(sum)
            }
            Expr::Product(members) => {
                let mut product = Polynomial::constant(1.0);
                for member in members {
                    product = product.times(&Polynomial::expand(member, inline)?)?;
                }
                Ok(product)
            }
            Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => {
                unreachable!("functions are algebraic equations of their own")
            }
            Expr::Power(base, exponent) => {
                let base = Polynomial::expand(base, inline)?;
                let mut product = Polynomial::constant(1.0);
                for _ in 0..*exponent {
                    product = product.times(&base)?;
                }
                Ok(product)
            }
        }
    }

    /// A constant polynomial.
    pub fn constant(value: f64) -> Polynomial {
        let mut polynomial = Polynomial::default();
        polynomial.add(Vec::new(), value);
        polynomial
    }

    /// Monomials with their coefficients.
    pub fn terms(&self) -> impl Iterator<Item = (&Monomial, f64)> {
        self.terms.iter().map(|(monomial, coefficient)| (monomial, *coefficient))
    }

    /// Most variables of a product.
    pub fn degree(&self) -> usize {
        self.terms.keys().map(Vec::len).max().unwrap_or(0)
    }

    /// Number of monomials.
    pub fn len(&self) -> usize {
        self.terms.len()
    }

    /// Variables that occur, with repetitions.
    pub fn variables(&self) -> impl Iterator<Item = Variable> {
        self.terms.keys().flatten().copied()
    }

    fn add(&mut self, monomial: Monomial, coefficient: f64) {
        if coefficient == 0.0 {
            return;
        }
        let sum = self.terms.entry(monomial).or_insert(0.0);
        *sum += coefficient;
        if *sum == 0.0 {
            self.terms.retain(|_, c| *c != 0.0);
        }
    }

    fn times(&self, other: &Polynomial) -> Result<Polynomial, TooManyTerms> {
        if self.len().saturating_mul(other.len()) > Self::LIMIT * 8 {
            return Err(TooManyTerms);
        }
        let mut product = Polynomial::default();
        for (a, x) in &self.terms {
            for (b, y) in &other.terms {
                let mut monomial = [a.as_slice(), b.as_slice()].concat();
                monomial.sort_unstable();
                product.add(monomial, x * y);
            }
        }
        product.check()?;
        Ok(product)
    }

    /// The polynomial with another one in the place of a variable.
    ///
    /// # Errors
    /// [`TooManyTerms`] when that has more than [`Self::LIMIT`] monomials.
    pub fn substituted(&self, variable: Variable, own: &Polynomial) -> Result<Polynomial, TooManyTerms> {
        let has = |monomial: &Monomial| monomial.binary_search(&variable).is_ok();
        let rest = self.terms.iter().filter(|(monomial, _)| !has(monomial));
        let mut sum = Polynomial { terms: rest.map(|(monomial, number)| (monomial.clone(), *number)).collect() };
        for (monomial, coefficient) in self.terms.iter().filter(|(monomial, _)| has(monomial)) {
            let (gone, left): (Monomial, Monomial) = monomial.iter().partition(|other| **other == variable);
            let mut product = Polynomial { terms: BTreeMap::from([(left, *coefficient)]) };
            for _ in gone {
                product = product.times(own)?;
            }
            product.terms.into_iter().for_each(|(monomial, coefficient)| sum.add(monomial, coefficient));
            sum.check()?;
        }
        Ok(sum)
    }

    fn check(&self) -> Result<(), TooManyTerms> {
        if self.len() > Self::LIMIT { Err(TooManyTerms) } else { Ok(()) }
    }
}

/// A polynomial as a sum of products of one variable and one factor, the way a chain computes it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Nested {
    /// The constant term.
    pub constant: f64,
    /// The products.
    pub products: Vec<(Variable, NestedFactor)>,
}

/// What a variable is multiplied by.
#[derive(Clone, Debug, PartialEq)]
pub enum NestedFactor {
    /// A number.
    Coefficient(f64),
    /// A sum with chain and value of its own.
    Inner(Box<Nested>),
}

impl Nested {
    /// Arranges a polynomial by greedy multivariate Horner: the variable that occurs in most nonlinear monomials is
    /// factored out, its linear term becoming the constant of the inner sum, until only linear monomials are left.
    /// Of variables in equally many monomials the one that arrives last is factored out first, for the rest is copied.
    pub fn of(polynomial: &Polynomial, arrivals: &Arrivals) -> Nested {
        Nested::arranged(polynomial, arrivals, false)
    }

    /// The same where of variables that occur equally often the last one counts most: what is computed last then waits for
    /// no factor.
    pub fn last_first(polynomial: &Polynomial) -> Nested {
        Nested::arranged(polynomial, &Arrivals::default(), true)
    }

    fn arranged(polynomial: &Polynomial, arrivals: &Arrivals, last_first: bool) -> Nested {
        let constant = polynomial.terms.get(&Vec::new()).copied().unwrap_or(0.0);
        let mut nested = Nested { constant, products: Vec::new() };
        let mut rest: Vec<Option<(&Monomial, f64)>> =
            polynomial.terms().filter(|(monomial, _)| !monomial.is_empty()).map(Some).collect();
        let mut frequent = Frequent::of(&rest, arrivals);
        while let Some(variable) = frequent.first(last_first) {
            let mut inner = Polynomial::default();
            for place in frequent.take(variable) {
                let Some((monomial, coefficient)) = rest[place].take() else { continue };
                frequent.remove(monomial);
                let mut quotient = monomial.clone();
                quotient.remove(monomial.binary_search(&variable).expect("the monomial has the variable"));
                inner.add(quotient, coefficient);
            }
            let inner = Nested::arranged(&inner, arrivals, last_first);
            nested.products.push((variable, NestedFactor::Inner(Box::new(inner))));
        }
        for (monomial, coefficient) in rest.into_iter().flatten() {
            nested.products.push((monomial[0], NestedFactor::Coefficient(coefficient)));
        }
        nested
    }

    /// Products needed to evaluate it.
    pub fn cost(&self) -> usize {
        let inner = |factor: &NestedFactor| match factor {
            NestedFactor::Coefficient(_) => 1,
            NestedFactor::Inner(nested) => 1 + nested.cost(),
        };
        self.products.iter().map(|(_, factor)| inner(factor)).sum()
    }
}

/// In how many nonlinear monomials each variable is, as monomials go.
struct Frequent<'a> {
    /// Places of the monomials of each variable, linear ones included, and the number of nonlinear ones that are left.
    of: BTreeMap<Variable, (Vec<usize>, usize)>,
    /// Variables by that number, if it is not zero, and by arrival.
    order: BTreeSet<(usize, i64, Variable)>,
    arrivals: &'a Arrivals,
}

impl<'a> Frequent<'a> {
    fn of(monomials: &[Option<(&Monomial, f64)>], arrivals: &'a Arrivals) -> Frequent<'a> {
        let mut of: BTreeMap<Variable, (Vec<usize>, usize)> = BTreeMap::new();
        for (place, (monomial, _)) in monomials.iter().flatten().enumerate() {
            for variable in distinct(monomial) {
                let (places, count) = of.entry(variable).or_default();
                places.push(place);
                *count += usize::from(monomial.len() > 1);
            }
        }
        let counted = of.iter().filter(|(_, (_, count))| *count > 0);
        let order = counted.map(|(variable, (_, count))| (*count, arrivals.of(*variable), *variable));
        let order = order.collect();
        Frequent { of, order, arrivals }
    }

    /// The variable in most nonlinear monomials, of equals the last one to arrive, of these the smallest or the largest;
    /// `None` if all are linear.
    fn first(&self, largest: bool) -> Option<Variable> {
        const SMALLEST: Variable = Variable::State(StateId::new(0));
        let (count, arrival, last) = *self.order.last()?;
        let first = || self.order.range((count, arrival, SMALLEST)..).next().map(|(.., variable)| *variable);
        if largest { Some(last) } else { first() }
    }

    /// The places of a variable's monomials, ascending.
    fn take(&mut self, variable: Variable) -> Vec<usize> {
        self.of.get_mut(&variable).map(|(places, _)| std::mem::take(places)).unwrap_or_default()
    }

    fn remove(&mut self, monomial: &Monomial) {
        if monomial.len() < 2 {
            return;
        }
        for variable in distinct(monomial) {
            let (_, count) = self.of.get_mut(&variable).expect("every variable is counted");
            let arrival = self.arrivals.of(variable);
            self.order.remove(&(*count, arrival, variable));
            *count -= 1;
            if *count > 0 {
                self.order.insert((*count, arrival, variable));
            }
        }
    }
}

/// The variables of a monomial, each once.
fn distinct(monomial: &Monomial) -> impl Iterator<Item = Variable> {
    monomial.chunk_by(|a, b| a == b).map(|same| same[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(i: u32) -> Expr {
        Expr::Variable(Variable::State(StateId::new(i)))
    }

    fn expand(expr: &Expr) -> Polynomial {
        Polynomial::expand(expr, &|_| None).unwrap()
    }

    #[test]
    fn a_cubic_of_one_variable_costs_three_products() {
        // k V (V - a)(V - 1), the membrane current of Nagumo's equation.
        let minus = |c: f64| Expr::Sum(vec![state(0), Expr::Constant(-c)]);
        let cubic = Expr::Product(vec![Expr::Constant(-8.0), state(0), minus(0.1), minus(1.0)]);
        assert_eq!(Nested::of(&expand(&cubic), &Arrivals::default()).cost(), 3);
    }

    #[test]
    fn lorenz_rows_cost_two_three_and_three_products() {
        let rows = [
            Expr::Sum(vec![
                Expr::Product(vec![Expr::Constant(10.0), state(1)]),
                Expr::Product(vec![Expr::Constant(-10.0), state(0)]),
            ]),
            Expr::Sum(vec![
                Expr::Product(vec![
                    state(0),
                    Expr::Sum(vec![Expr::Constant(28.0), Expr::Product(vec![Expr::Constant(-1.0), state(2)])]),
                ]),
                Expr::Product(vec![Expr::Constant(-1.0), state(1)]),
            ]),
            Expr::Sum(vec![
                Expr::Product(vec![state(0), state(1)]),
                Expr::Product(vec![Expr::Constant(-8.0 / 3.0), state(2)]),
            ]),
        ];
        let costs: Vec<usize> = rows.iter().map(|row| Nested::of(&expand(row), &Arrivals::default()).cost()).collect();
        assert_eq!(costs, [2, 3, 3]);
    }

    #[test]
    fn cancelling_terms_vanish() {
        let zero = Expr::Sum(vec![state(0), Expr::Product(vec![Expr::Constant(-1.0), state(0)])]);
        assert_eq!(expand(&zero).len(), 0);
    }

    #[test]
    fn an_exploding_power_is_refused() {
        let sum = Expr::Sum((0..40).map(state).collect());
        assert_eq!(Polynomial::expand(&Expr::Power(Box::new(sum), 12), &|_| None), Err(TooManyTerms));
    }
}
