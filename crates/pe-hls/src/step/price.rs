//! What a polynomial costs as nested sums, counted without arranging them: whether an equation is shared is asked for every
//! equation and every reader, and only the number of products matters there.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use pe_ir::index::{at, number};
use pe_ir::model::Variable;

use super::polynomial::Polynomial;

/// Products of [`Nested::of`](super::polynomial::Nested::of) where all variables arrive alike.
pub fn products(polynomial: &Polynomial) -> usize {
    let mut variables: Vec<Variable> = polynomial.variables().collect();
    variables.sort_unstable();
    variables.dedup();
    let mut monomials = Monomials::default();
    for (monomial, _) in polynomial.terms() {
        // In the order of the variables, so that of equals the smallest is the first.
        let numbers = monomial.iter().map(|variable| variables.partition_point(|other| other < variable));
        monomials.push(numbers.map(number));
    }
    let mut counts = vec![0; variables.len()];
    monomials.products(&mut counts)
}

/// Products of variables, sorted, one after another.
#[derive(Default)]
struct Monomials {
    variables: Vec<u32>,
    ends: Vec<u32>,
}

impl Monomials {
    fn push(&mut self, monomial: impl Iterator<Item = u32>) {
        self.variables.extend(monomial);
        self.ends.push(number(self.variables.len()));
    }

    fn of(&self, place: usize) -> &[u32] {
        let start = place.checked_sub(1).map_or(0, |before| at(self.ends[before]));
        &self.variables[start..at(self.ends[place])]
    }

    /// Products of the sum of all; `counts` is zero for every variable, before and after.
    fn products(&self, counts: &mut [u32]) -> usize {
        let all = 0..self.ends.len();
        let linear = || all.clone().filter(|place| self.of(*place).len() == 1).count();
        let mut higher = all.clone().filter(|place| self.of(*place).len() > 1);
        match (higher.next(), higher.next()) {
            (None, _) => return linear(),
            // Alone it takes a product for each of its variables, but for one whose own term becomes a constant.
            (Some(only), None) if linear() == 0 => return self.of(only).len(),
            _ => {}
        }
        let mut entries: Vec<(u32, u32)> = Vec::with_capacity(self.variables.len());
        for place in all.clone() {
            let monomial = self.of(place);
            entries.extend(distinct(monomial).map(|variable| (variable, number(place))));
            if monomial.len() > 1 {
                distinct(monomial).for_each(|variable| counts[at(variable)] += 1);
            }
        }
        entries.sort_unstable();
        let of = |variable: u32| {
            let own = entries.partition_point(|(other, _)| *other < variable);
            entries[own..].iter().take_while(move |(other, _)| *other == variable).map(|(_, place)| at(*place))
        };
        let firsts = entries.chunk_by(|a, b| a.0 == b.0).map(|same| same[0].0);
        let counted = firsts.clone().filter(|variable| counts[at(*variable)] > 0);
        let mut frequent: BinaryHeap<(u32, Reverse<u32>)> =
            counted.map(|variable| (counts[at(variable)], Reverse(variable))).collect();
        let mut left = vec![true; self.ends.len()];
        let mut inner = Vec::new();
        let mut products = 0;
        while let Some((count, Reverse(variable))) = frequent.pop() {
            // What was counted earlier is no longer so.
            if count != counts[at(variable)] {
                continue;
            }
            let mut quotients = Monomials::default();
            for place in of(variable).filter(|place| std::mem::take(&mut left[*place])) {
                let monomial = self.of(place);
                let own = monomial.partition_point(|other| *other < variable);
                quotients.push(monomial[..own].iter().chain(&monomial[own + 1..]).copied());
                if monomial.len() > 1 {
                    for other in distinct(monomial) {
                        counts[at(other)] -= 1;
                        if counts[at(other)] > 0 {
                            frequent.push((counts[at(other)], Reverse(other)));
                        }
                    }
                }
            }
            products += 1;
            inner.push(quotients);
        }
        // All counts are zero again.
        products += left.iter().zip(all).filter(|(left, place)| **left && !self.of(*place).is_empty()).count();
        products + inner.iter().map(|quotients| quotients.products(counts)).sum::<usize>()
    }
}

/// The variables of a monomial, each once.
fn distinct(monomial: &[u32]) -> impl Iterator<Item = u32> {
    monomial.chunk_by(|a, b| a == b).map(|same| same[0])
}

#[cfg(test)]
mod tests {
    use pe_ir::index::StateId;
    use pe_ir::model::Expr;

    use super::*;
    use crate::step::arrival::Arrivals;
    use crate::step::polynomial::Nested;

    fn next(seed: &mut u64) -> usize {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 40) as usize
    }

    fn random(seed: &mut u64, variables: usize, terms: usize) -> Polynomial {
        let variable = |number: usize| Expr::Variable(Variable::State(StateId::at(number)));
        let mut sum = Vec::new();
        for _ in 0..terms {
            let factors = (0..next(seed) % 5).map(|_| variable(next(seed) % variables)).collect::<Vec<_>>();
            sum.push(Expr::product(factors.into_iter().chain([Expr::Constant(1.0 + next(seed) as f64)]).collect()));
        }
        Polynomial::expand(&Expr::Sum(sum), &|_| None).unwrap()
    }

    #[test]
    fn a_price_is_what_the_arranged_sum_costs() {
        let mut seed = 11;
        for case in 0..3000 {
            let (variables, terms) = (1 + next(&mut seed) % 12, next(&mut seed) % 40);
            let polynomial = random(&mut seed, variables, terms);
            let nested = Nested::of(&polynomial, &Arrivals::default());
            assert_eq!(products(&polynomial), nested.cost(), "{case}: {polynomial:?}");
        }
    }

    #[test]
    fn a_polynomial_in_the_place_of_a_variable_is_the_expanded_expression() {
        let mut seed = 12;
        for case in 0..500 {
            let (outer, own) = (random(&mut seed, 4, 6), random(&mut seed, 6, 3));
            let gone = Variable::State(StateId::new(0));
            let inline = |variable: Variable| (variable == gone).then_some(&own);
            let product = |monomial: &Vec<Variable>, coefficient: f64| {
                let factors = monomial.iter().map(|variable| Expr::Variable(*variable));
                Expr::Product(factors.chain([Expr::Constant(coefficient)]).collect())
            };
            let sum = Expr::Sum(outer.terms().map(|(monomial, number)| product(monomial, number)).collect());
            let expected = Polynomial::expand(&sum, &inline).unwrap();
            let found = outer.substituted(gone, &own).unwrap();
            let monomials = |of: &Polynomial| of.terms().map(|(monomial, _)| monomial.clone()).collect::<Vec<_>>();
            assert_eq!(monomials(&found), monomials(&expected), "{case}");
            for ((_, found), (_, expected)) in found.terms().zip(expected.terms()) {
                assert!((found - expected).abs() <= 1e-12 * expected.abs(), "{case}: {found} {expected}");
            }
        }
    }
}
