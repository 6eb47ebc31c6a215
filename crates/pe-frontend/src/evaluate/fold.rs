//! Builds sums and products with constants folded and nesting flattened, but nothing multiplied out.

use pe_ir::model::Expr;

/// A sum in the making.
#[derive(Default)]
pub(crate) struct SumBuilder {
    constant: f64,
    terms: Vec<Expr>,
}

impl SumBuilder {
    /// Adds or subtracts a term; sums inside it become part of this one.
    pub(crate) fn add(&mut self, term: Expr, negative: bool) {
        match term {
            Expr::Constant(value) => self.constant += if negative { -value } else { value },
            Expr::Sum(members) => members.into_iter().for_each(|member| self.add(member, negative)),
            Expr::Product(mut members) if is_negated_sum(&members) => {
                if let Some(sum) = members.pop() {
                    self.add(sum, !negative);
                }
            }
            term if negative => self.terms.push(negate(term)),
            term => self.terms.push(term),
        }
    }

    /// The sum. Its constant, which may have become infinite, stands last.
    pub(crate) fn finish(mut self) -> Expr {
        if self.terms.is_empty() {
            return Expr::Constant(self.constant);
        }
        if self.constant != 0.0 {
            self.terms.push(Expr::Constant(self.constant));
        }
        single_or(self.terms, Expr::Sum)
    }

    /// Whether the constant part is a number.
    pub(crate) fn is_finite(&self) -> bool {
        self.constant.is_finite()
    }
}

/// `-(a + b)`, which inside another sum is two terms.
fn is_negated_sum(members: &[Expr]) -> bool {
    matches!(members, [Expr::Constant(-1.0), Expr::Sum(_)])
}

/// A product in the making.
pub(crate) struct ProductBuilder {
    coefficient: f64,
    factors: Vec<Expr>,
}

impl ProductBuilder {
    /// A product that begins with `first`.
    pub(crate) fn new(first: Expr) -> Self {
        let mut product = ProductBuilder { coefficient: 1.0, factors: Vec::new() };
        product.multiply(first);
        product
    }

    /// Multiplies by a factor; products inside it become part of this one.
    pub(crate) fn multiply(&mut self, factor: Expr) {
        match factor {
            Expr::Constant(value) => self.coefficient *= value,
            Expr::Product(members) => members.into_iter().for_each(|member| self.multiply(member)),
            factor => self.factors.push(factor),
        }
    }

    /// Divides by a constant.
    pub(crate) fn divide(&mut self, divisor: f64) {
        self.coefficient /= divisor;
    }

    /// The value so far, if it is constant.
    pub(crate) fn constant(&self) -> Option<f64> {
        self.factors.is_empty().then_some(self.coefficient)
    }

    /// Replaces the value of a product that is constant so far.
    pub(crate) fn set_constant(&mut self, value: f64) {
        self.coefficient = value;
    }

    /// Whether the coefficient is a number.
    pub(crate) fn is_finite(&self) -> bool {
        self.coefficient.is_finite()
    }

    /// The product. Its coefficient stands first and is left out if it is one.
    pub(crate) fn finish(mut self) -> Expr {
        if self.coefficient == 0.0 || self.factors.is_empty() {
            // Adding zero turns -0 into 0.
            return Expr::Constant(self.coefficient + 0.0);
        }
        if self.coefficient != 1.0 {
            self.factors.insert(0, Expr::Constant(self.coefficient));
        }
        single_or(self.factors, Expr::Product)
    }
}

/// `-expr`, with the sign in the coefficient.
pub(crate) fn negate(expr: Expr) -> Expr {
    let mut product = ProductBuilder::new(expr);
    product.coefficient = -product.coefficient;
    product.finish()
}

/// The only member, or all of them under `join`.
fn single_or(mut members: Vec<Expr>, join: fn(Vec<Expr>) -> Expr) -> Expr {
    match members.pop() {
        Some(only) if members.is_empty() => only,
        Some(last) => {
            members.push(last);
            members.shrink_to_fit();
            join(members)
        }
        None => Expr::Constant(0.0),
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::index::StateId;

    use super::*;
    use pe_ir::model::Variable;

    fn x(number: u32) -> Expr {
        Expr::Variable(Variable::State(StateId::new(number)))
    }

    fn sum(terms: Vec<(Expr, bool)>) -> Expr {
        let mut builder = SumBuilder::default();
        terms.into_iter().for_each(|(term, negative)| builder.add(term, negative));
        builder.finish()
    }

    #[test]
    fn sums_are_flat_and_hold_one_constant() {
        let inner = sum(vec![(x(1), false), (Expr::Constant(2.0), false)]);
        let outer = sum(vec![(x(0), false), (Expr::Constant(3.0), false), (inner, true)]);
        let minus_x1 = Expr::Product(vec![Expr::Constant(-1.0), x(1)]);
        assert_eq!(outer, Expr::Sum(vec![x(0), minus_x1, Expr::Constant(1.0)]));
    }

    #[test]
    fn zero_terms_and_unit_factors_vanish() {
        assert_eq!(sum(vec![(x(0), false), (Expr::Constant(0.0), false)]), x(0));
        let mut product = ProductBuilder::new(Expr::Constant(2.0));
        product.multiply(x(0));
        product.divide(2.0);
        assert_eq!(product.finish(), x(0));
        let mut product = ProductBuilder::new(x(0));
        product.multiply(Expr::Constant(-0.0));
        assert_eq!(product.finish(), Expr::Constant(0.0));
    }

    #[test]
    fn a_negated_sum_stays_a_factor_but_joins_a_sum() {
        let inner = || sum(vec![(x(0), false), (x(1), true)]);
        assert_eq!(negate(inner()), Expr::Product(vec![Expr::Constant(-1.0), inner()]));
        assert_eq!(negate(negate(inner())), inner());
        let joined = sum(vec![(x(2), false), (negate(inner()), false)]);
        assert_eq!(joined, Expr::Sum(vec![x(2), negate(x(0)), x(1)]));
    }
}
