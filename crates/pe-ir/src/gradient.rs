//! The gradient of an expression at a point, in one walk over it.

use crate::expr::{Expr, Function};
use crate::model::Variable;

impl Function {
    /// The slope at `x`; at a jump or a kink that of the branch that is taken, not finite where there is none.
    pub fn slope(self, x: f64) -> f64 {
        match self {
            Function::Reciprocal => -1.0 / (x * x),
            Function::RealPower(exponent) => exponent * libm::pow(x, exponent - 1.0),
            Function::Sqrt => 0.5 / libm::sqrt(x),
            Function::Exp => libm::exp(x),
            Function::Log => 1.0 / x,
            Function::Sin => libm::cos(x),
            Function::Cos => -libm::sin(x),
            Function::Tan => 1.0 + libm::tan(x) * libm::tan(x),
            Function::Asin => 1.0 / libm::sqrt(1.0 - x * x),
            Function::Acos => -1.0 / libm::sqrt(1.0 - x * x),
            Function::Atan => 1.0 / (1.0 + x * x),
            Function::Sinh => libm::cosh(x),
            Function::Cosh => libm::sinh(x),
            Function::Tanh => 1.0 - libm::tanh(x) * libm::tanh(x),
            Function::Abs => Function::Sign.evaluate(x),
            Function::Sign | Function::Floor => 0.0,
            Function::Wrap => 1.0,
        }
    }
}

impl Expr {
    /// Gives `add` every occurrence of a variable with `weight` times the partial derivative along it; the sum over the
    /// occurrences of a variable is [`Expr::derivative`] at that point, without an expression for it. Of a choice only
    /// the branch that is taken counts.
    pub fn gradient(
        &self,
        variable: &impl Fn(Variable) -> f64,
        weight: f64,
        add: &mut (impl FnMut(Variable, f64) + ?Sized),
    ) {
        match self {
            Expr::Constant(_) => {}
            Expr::Variable(name) => add(*name, weight),
            Expr::Sum(members) => members.iter().for_each(|member| member.gradient(variable, weight, add)),
            Expr::Product(members) => {
                // Products of what stands behind each member, so that no factor is ever divided out.
                let values: Vec<f64> = members.iter().map(|member| member.evaluate(variable)).collect();
                let mut behind = vec![1.0; members.len()];
                for index in (0..members.len().saturating_sub(1)).rev() {
                    behind[index] = behind[index + 1] * values[index + 1];
                }
                let mut before = weight;
                for (index, member) in members.iter().enumerate() {
                    member.gradient(variable, before * behind[index], add);
                    before *= values[index];
                }
            }
            Expr::Power(base, exponent) => {
                let power = libm::pow(base.evaluate(variable), f64::from(exponent - 1));
                base.gradient(variable, weight * f64::from(*exponent) * power, add);
            }
            Expr::Apply(function, argument) => {
                let slope = function.slope(argument.evaluate(variable));
                // Where a function is flat, what its argument does does not matter.
                if slope != 0.0 {
                    argument.gradient(variable, weight * slope, add);
                }
            }
            Expr::Select(select) if select.condition.evaluate(variable) > 0.0 => {
                select.yes.gradient(variable, weight, add);
            }
            Expr::Select(select) => select.no.gradient(variable, weight, add),
            Expr::Solution(solution) => {
                for (part, partial) in solution.partials(variable) {
                    part.gradient(variable, weight * partial, add);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::index::StateId;

    use super::*;
    use crate::expr::Select;
    use crate::expr::tests::functions;

    #[test]
    fn the_gradient_is_what_the_derivatives_say() {
        let [x, y] = [0, 1].map(|index| Expr::Variable(Variable::State(StateId::new(index))));
        let apply = |function, expr: &Expr| Expr::Apply(function, Box::new(expr.clone()));
        let choice = Select { condition: y.clone(), yes: Expr::power(x.clone(), 3), no: y.clone() };
        let mut exprs = vec![
            Expr::product(vec![x.clone(), y.clone(), x.clone(), Expr::Constant(3.0)]),
            Expr::power(Expr::sum(vec![x.clone(), Expr::product(vec![y.clone(), y.clone()])]), 4),
            Expr::Select(Box::new(choice)),
        ];
        for function in functions() {
            let inner = Expr::sum(vec![Expr::scaled(0.5, x.clone()), Expr::product(vec![x.clone(), y.clone()])]);
            exprs.push(Expr::product(vec![apply(function, &inner), y.clone()]));
        }
        for expr in exprs {
            for point in [[0.3, 0.8], [0.7, 0.2]] {
                let value = |variable| if variable == Variable::State(StateId::new(0)) { point[0] } else { point[1] };
                let mut sums = [0.0; 2];
                expr.gradient(&value, 2.0, &mut |variable, partial| {
                    sums[usize::from(variable == Variable::State(StateId::new(1)))] += partial;
                });
                for (index, sum) in sums.iter().enumerate() {
                    let exact = 2.0 * expr.derivative(Variable::State(StateId::at(index))).evaluate(&value);
                    assert!((sum - exact).abs() < 1e-12 * (1.0 + exact.abs()), "{expr:?} along {index}: {sum} {exact}");
                }
            }
        }
    }

    #[test]
    fn a_factor_of_zero_leaves_the_slope_of_the_others() {
        let [x, y] = [0, 1].map(|index| Expr::Variable(Variable::State(StateId::new(index))));
        let mut partials = Vec::new();
        Expr::product(vec![x, y]).gradient(&|_| 0.0, 1.0, &mut |_, partial| partials.push(partial));
        assert_eq!(partials, [0.0, 0.0]);
        let [x, y] = [0, 1].map(|index| Expr::Variable(Variable::State(StateId::new(index))));
        let value = |variable| if variable == Variable::State(StateId::new(0)) { 0.0 } else { 5.0 };
        let mut partials = Vec::new();
        Expr::product(vec![x, y]).gradient(&value, 1.0, &mut |_, partial| partials.push(partial));
        assert_eq!(partials, [5.0, 0.0]);
    }
}
