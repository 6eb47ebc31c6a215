//! Polynomials over model variables, and their arrangement as nested sums of products.

use std::collections::BTreeMap;

use pe_ir::model::{Expr, Variable};

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
            Expr::Apply(..) | Expr::Select(_) => unreachable!("functions are algebraic equations of their own"),
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
    pub fn of(polynomial: &Polynomial) -> Nested {
        let mut rest = polynomial.terms.clone();
        let mut nested = Nested { constant: rest.remove(&Vec::new()).unwrap_or(0.0), products: Vec::new() };
        while let Some(variable) = most_frequent(&rest) {
            let mut inner = Polynomial::default();
            rest.retain(|monomial, coefficient| {
                let Ok(position) = monomial.binary_search(&variable) else { return true };
                let mut quotient = monomial.clone();
                quotient.remove(position);
                inner.add(quotient, *coefficient);
                false
            });
            nested.products.push((variable, NestedFactor::Inner(Box::new(Nested::of(&inner)))));
        }
        for (monomial, coefficient) in rest {
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

/// The variable in most nonlinear monomials, the smallest of equals; `None` if all are linear.
fn most_frequent(terms: &BTreeMap<Monomial, f64>) -> Option<Variable> {
    let mut counts: BTreeMap<Variable, usize> = BTreeMap::new();
    for monomial in terms.keys().filter(|monomial| monomial.len() > 1) {
        let mut last = None;
        for variable in monomial {
            if last != Some(variable) {
                *counts.entry(*variable).or_default() += 1;
            }
            last = Some(variable);
        }
    }
    counts.into_iter().max_by(|a, b| a.1.cmp(&b.1).then(b.0.cmp(&a.0))).map(|(variable, _)| variable)
}

#[cfg(test)]
mod tests {
    use pe_ir::index::StateId;

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
        assert_eq!(Nested::of(&expand(&cubic)).cost(), 3);
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
        let costs: Vec<usize> = rows.iter().map(|row| Nested::of(&expand(row)).cost()).collect();
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
