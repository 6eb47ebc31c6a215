//! Expressions over the variables of a flat model: evaluation, what they read, and their derivatives.

use crate::index::{StateId, at};
use crate::solution::Solution;

/// A variable of the flat model: indices into the states, inputs and algebraic variables of a [`crate::model::Model`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Variable {
    /// A state variable.
    State(StateId),
    /// An external input.
    Input(u32),
    /// The left-hand side of an algebraic equation.
    Algebraic(u32),
}

/// A right-hand side over the flat variables; constants are already folded.
#[derive(Clone, Debug, PartialEq)]
pub enum Expr {
    /// A finite number.
    Constant(f64),
    /// A variable.
    Variable(Variable),
    /// Sum of all members.
    Sum(Vec<Expr>),
    /// Product of all members.
    Product(Vec<Expr>),
    /// Integer power, exponent at least 2.
    Power(Box<Expr>, u32),
    /// An elementary function of an expression.
    Apply(Function, Box<Expr>),
    /// A choice between two expressions.
    Select(Box<Select>),
    /// An element of the solution of a linear system; it is the whole of an algebraic equation.
    Solution(Box<Solution>),
}

/// `if condition > 0 then yes else no`; only the branch taken is evaluated.
#[derive(Clone, Debug, PartialEq)]
pub struct Select {
    /// What is compared with zero.
    pub condition: Expr,
    /// Value if the condition is above zero.
    pub yes: Expr,
    /// Value otherwise.
    pub no: Expr,
}

/// An elementary function of one real variable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Function {
    /// `1/x`.
    Reciprocal,
    /// `x^p` for an exponent that is no integer above 1; of negative `x` only for integers.
    RealPower(f64),
    /// Square root.
    Sqrt,
    /// Exponential function.
    Exp,
    /// Natural logarithm.
    Log,
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Inverse sine.
    Asin,
    /// Inverse cosine.
    Acos,
    /// Inverse tangent.
    Atan,
    /// Hyperbolic sine.
    Sinh,
    /// Hyperbolic cosine.
    Cosh,
    /// Hyperbolic tangent.
    Tanh,
    /// Magnitude.
    Abs,
    /// -1, 0 or 1.
    Sign,
    /// The largest whole number that is not above it.
    Floor,
    /// A number of turns without the whole ones: from -1/2 to 1/2, the upper end excluded.
    Wrap,
}

impl Function {
    /// Functions that stand in front of their argument and have a name of their own.
    pub const NAMED: [Function; 16] = [
        Function::Sqrt,
        Function::Exp,
        Function::Log,
        Function::Sin,
        Function::Cos,
        Function::Tan,
        Function::Asin,
        Function::Acos,
        Function::Atan,
        Function::Sinh,
        Function::Cosh,
        Function::Tanh,
        Function::Abs,
        Function::Sign,
        Function::Floor,
        Function::Wrap,
    ];

    /// The value at `x`; not finite where the function is not defined.
    pub fn evaluate(self, x: f64) -> f64 {
        match self {
            Function::Reciprocal => 1.0 / x,
            Function::RealPower(exponent) => libm::pow(x, exponent),
            Function::Sqrt => libm::sqrt(x),
            Function::Exp => libm::exp(x),
            Function::Log => libm::log(x),
            Function::Sin => libm::sin(x),
            Function::Cos => libm::cos(x),
            Function::Tan => libm::tan(x),
            Function::Asin => libm::asin(x),
            Function::Acos => libm::acos(x),
            Function::Atan => libm::atan(x),
            Function::Sinh => libm::sinh(x),
            Function::Cosh => libm::cosh(x),
            Function::Tanh => libm::tanh(x),
            Function::Abs => x.abs(),
            Function::Sign if x == 0.0 => 0.0,
            Function::Sign => x.signum(),
            Function::Floor => libm::floor(x),
            Function::Wrap => x - libm::floor(x + 0.5),
        }
    }

    /// The name that specs and messages have for it.
    pub fn name(self) -> &'static str {
        match self {
            Function::Reciprocal => "1/",
            Function::RealPower(_) => "^",
            Function::Sqrt => "sqrt",
            Function::Exp => "exp",
            Function::Log => "log",
            Function::Sin => "sin",
            Function::Cos => "cos",
            Function::Tan => "tan",
            Function::Asin => "asin",
            Function::Acos => "acos",
            Function::Atan => "atan",
            Function::Sinh => "sinh",
            Function::Cosh => "cosh",
            Function::Tanh => "tanh",
            Function::Abs => "abs",
            Function::Sign => "sign",
            Function::Floor => "floor",
            Function::Wrap => "wrap",
        }
    }

    /// The derivative of the function at `x`.
    fn derivative(self, x: &Expr) -> Expr {
        let apply = |function| Expr::Apply(function, Box::new(x.clone()));
        let one_plus =
            |factor: f64| Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(factor, Expr::power(x.clone(), 2))]);
        let reciprocal = |expr| Expr::Apply(Function::Reciprocal, Box::new(expr));
        match self {
            Function::Reciprocal => Expr::scaled(-1.0, Expr::power(apply(Function::Reciprocal), 2)),
            Function::RealPower(exponent) => Expr::scaled(exponent, apply(Function::RealPower(exponent - 1.0))),
            Function::Sqrt => Expr::scaled(0.5, apply(Function::RealPower(-0.5))),
            Function::Exp => apply(Function::Exp),
            Function::Log => apply(Function::Reciprocal),
            Function::Sin => apply(Function::Cos),
            Function::Cos => Expr::scaled(-1.0, apply(Function::Sin)),
            Function::Tan => Expr::sum(vec![Expr::Constant(1.0), Expr::power(apply(Function::Tan), 2)]),
            Function::Asin => Expr::Apply(Function::RealPower(-0.5), Box::new(one_plus(-1.0))),
            Function::Acos => Expr::scaled(-1.0, Expr::Apply(Function::RealPower(-0.5), Box::new(one_plus(-1.0)))),
            Function::Atan => reciprocal(one_plus(1.0)),
            Function::Sinh => apply(Function::Cosh),
            Function::Cosh => apply(Function::Sinh),
            Function::Tanh => {
                Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, Expr::power(apply(Function::Tanh), 2))])
            }
            Function::Abs => apply(Function::Sign),
            Function::Sign | Function::Floor => Expr::Constant(0.0),
            Function::Wrap => Expr::Constant(1.0),
        }
    }
}

impl Expr {
    /// A sum, with constants folded, zeros dropped and inner sums taken in.
    pub fn sum(members: Vec<Expr>) -> Expr {
        let (mut terms, mut constant) = (Vec::with_capacity(members.len()), 0.0);
        for member in members {
            match member {
                Expr::Constant(number) => constant += number,
                Expr::Sum(inner) => {
                    for term in inner {
                        match term {
                            Expr::Constant(number) => constant += number,
                            term => terms.push(term),
                        }
                    }
                }
                term => terms.push(term),
            }
        }
        if constant != 0.0 || terms.is_empty() {
            terms.push(Expr::Constant(constant));
        }
        if terms.len() == 1 { terms.remove(0) } else { Expr::Sum(terms) }
    }

    /// A product, with constants folded and inner products taken in; zero if a factor is.
    pub fn product(members: Vec<Expr>) -> Expr {
        let (mut factors, mut constant) = (Vec::with_capacity(members.len()), 1.0);
        for member in members {
            match member {
                Expr::Constant(number) => constant *= number,
                Expr::Product(inner) => {
                    for factor in inner {
                        match factor {
                            Expr::Constant(number) => constant *= number,
                            factor => factors.push(factor),
                        }
                    }
                }
                factor => factors.push(factor),
            }
        }
        if constant == 0.0 || factors.is_empty() {
            return Expr::Constant(constant);
        }
        if constant != 1.0 {
            factors.insert(0, Expr::Constant(constant));
        }
        if factors.len() == 1 { factors.remove(0) } else { Expr::Product(factors) }
    }

    /// A number times an expression.
    pub fn scaled(factor: f64, expr: Expr) -> Expr {
        Expr::product(vec![Expr::Constant(factor), expr])
    }

    /// An integer power.
    pub fn power(base: Expr, exponent: u32) -> Expr {
        match (base, exponent) {
            (_, 0) => Expr::Constant(1.0),
            (base, 1) => base,
            (Expr::Constant(number), _) => Expr::Constant(libm::pow(number, f64::from(exponent))),
            (base, _) => Expr::Power(Box::new(base), exponent),
        }
    }

    /// The value for given values of the variables; not finite where the expression is not defined.
    pub fn evaluate(&self, variable: &impl Fn(Variable) -> f64) -> f64 {
        match self {
            Expr::Constant(number) => *number,
            Expr::Variable(name) => variable(*name),
            Expr::Sum(members) => members.iter().map(|member| member.evaluate(variable)).sum(),
            Expr::Product(members) => members.iter().map(|member| member.evaluate(variable)).product(),
            Expr::Power(base, exponent) => libm::pow(base.evaluate(variable), f64::from(*exponent)),
            Expr::Apply(function, argument) => function.evaluate(argument.evaluate(variable)),
            Expr::Select(select) if select.condition.evaluate(variable) > 0.0 => select.yes.evaluate(variable),
            Expr::Select(select) => select.no.evaluate(variable),
            Expr::Solution(solution) => solution.all(variable)[at(solution.row)],
        }
    }

    /// The number, if it is one.
    pub fn as_constant(&self) -> Option<f64> {
        match self {
            Expr::Constant(number) => Some(*number),
            _ => None,
        }
    }

    /// Whether it has bends or jumps: choices, magnitudes or signs.
    pub fn has_bends(&self) -> bool {
        match self {
            Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => false,
            Expr::Sum(members) | Expr::Product(members) => members.iter().any(Expr::has_bends),
            Expr::Apply(Function::Abs | Function::Sign | Function::Floor | Function::Wrap, _) | Expr::Select(_) => true,
            Expr::Power(base, _) | Expr::Apply(_, base) => base.has_bends(),
        }
    }

    /// Visits every occurrence of a variable.
    pub fn each_variable(&self, visit: &mut impl FnMut(Variable)) {
        match self {
            Expr::Constant(_) => {}
            Expr::Variable(variable) => visit(*variable),
            Expr::Sum(members) | Expr::Product(members) => {
                members.iter().for_each(|member| member.each_variable(visit));
            }
            Expr::Power(base, _) | Expr::Apply(_, base) => base.each_variable(visit),
            Expr::Select(select) => {
                [&select.condition, &select.yes, &select.no].into_iter().for_each(|part| part.each_variable(visit));
            }
            Expr::Solution(solution) => solution.each_variable(visit),
        }
    }

    /// Visits all variables, which may become others.
    pub fn each_variable_mut(&mut self, visit: &mut impl FnMut(&mut Variable)) {
        match self {
            Expr::Constant(_) => {}
            Expr::Variable(variable) => visit(variable),
            Expr::Sum(members) | Expr::Product(members) => {
                members.iter_mut().for_each(|member| member.each_variable_mut(visit));
            }
            Expr::Power(base, _) | Expr::Apply(_, base) => base.each_variable_mut(visit),
            Expr::Select(select) => {
                let Select { condition, yes, no } = &mut **select;
                [condition, yes, no].into_iter().for_each(|part| part.each_variable_mut(visit));
            }
            Expr::Solution(solution) => solution.each_variable_mut(visit),
        }
    }

    /// The expression with another one in place of each variable; nothing is folded.
    pub fn substituted(&self, variable: &impl Fn(Variable) -> Expr) -> Expr {
        let again = |expr: &Expr| expr.substituted(variable);
        match self {
            Expr::Constant(number) => Expr::Constant(*number),
            Expr::Variable(name) => variable(*name),
            Expr::Sum(members) => Expr::Sum(members.iter().map(again).collect()),
            Expr::Product(members) => Expr::Product(members.iter().map(again).collect()),
            Expr::Power(base, exponent) => Expr::Power(Box::new(again(base)), *exponent),
            Expr::Apply(function, argument) => Expr::Apply(*function, Box::new(again(argument))),
            Expr::Select(select) => {
                let [condition, yes, no] = [&select.condition, &select.yes, &select.no].map(again);
                Expr::Select(Box::new(Select { condition, yes, no }))
            }
            Expr::Solution(solution) => Expr::Solution(Box::new(solution.substituted(&again))),
        }
    }

    /// How tightly the text of the expression binds: 0 for sums, 1 for products, 2 for powers, 4 for all else.
    pub fn rank(&self) -> u32 {
        match self {
            Expr::Constant(number) if *number < 0.0 => 1,
            Expr::Sum(_) => 0,
            Expr::Product(_) | Expr::Apply(Function::Reciprocal, _) => 1,
            Expr::Power(..) | Expr::Apply(Function::RealPower(_), _) => 2,
            Expr::Constant(_) | Expr::Variable(_) | Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => 4,
        }
    }

    /// The expression as a spec would have it, without blanks. `variable` gives the text of a variable where what binds
    /// less tightly than a rank takes parentheses: 1 for members of a sum, 2 for factors, 3 for bases.
    pub fn text(&self, variable: &impl Fn(Variable, u32) -> String) -> String {
        self.text_within(variable, 0)
    }

    /// The same, in parentheses if it binds less tightly than a rank.
    fn text_within(&self, variable: &impl Fn(Variable, u32) -> String, rank: u32) -> String {
        let at = |expr: &Expr, rank| expr.text_within(variable, rank);
        let text = match self {
            Expr::Constant(number) => number_text(*number),
            Expr::Variable(name) => variable(*name, rank),
            Expr::Sum(members) => {
                let mut text = String::new();
                // `1-x` is easier to read than `-x+1`.
                let last_first = members.iter().skip(members.len() - 1).filter(|_| at(&members[0], 1).starts_with('-'));
                let rest = members.len() - last_first.clone().count();
                for member in last_first.chain(&members[..rest]) {
                    let member = at(member, 1);
                    if !text.is_empty() && !member.starts_with('-') {
                        text.push('+');
                    }
                    text += &member;
                }
                text
            }
            Expr::Product(members) => match members.as_slice() {
                [Expr::Constant(-1.0), rest @ ..] if !rest.is_empty() => {
                    format!("-{}", at(&Expr::product(rest.to_vec()), 2))
                }
                members => {
                    let mut text = String::new();
                    for member in members {
                        match member {
                            Expr::Apply(Function::Reciprocal, divisor) if !text.is_empty() => {
                                text += &format!("/{}", at(divisor, 3));
                            }
                            member => {
                                let sign = if text.is_empty() { "" } else { "*" };
                                text += &format!("{sign}{}", at(member, if text.is_empty() { 1 } else { 2 }));
                            }
                        }
                    }
                    text
                }
            },
            Expr::Power(base, exponent) => format!("{}^{exponent}", at(base, 3)),
            Expr::Apply(Function::Reciprocal, divisor) => format!("1/{}", at(divisor, 3)),
            Expr::Apply(Function::RealPower(exponent), base) => {
                format!("{}^{}", at(base, 3), Expr::Constant(*exponent).text_within(variable, 3))
            }
            Expr::Apply(function, argument) => format!("{}({})", function.name(), at(argument, 0)),
            Expr::Select(select) => {
                let Select { condition, yes, no } = &**select;
                format!("if({}>0:{}:{})", at(condition, 0), at(yes, 0), at(no, 0))
            }
            Expr::Solution(solution) => {
                let Solution { matrix, right, row } = &**solution;
                format!("solve({},{})[{row}]", matrix.name, right.number)
            }
        };
        if self.rank() < rank { format!("({text})") } else { text }
    }

    /// The same expression of other variables.
    pub fn renamed(&self, name: &impl Fn(Variable) -> Variable) -> Expr {
        self.substituted(&|variable| Expr::Variable(name(variable)))
    }

    /// Whether it is made of sums, products and integer powers alone.
    pub fn is_polynomial(&self) -> bool {
        match self {
            Expr::Constant(_) | Expr::Variable(_) => true,
            Expr::Sum(members) | Expr::Product(members) => members.iter().all(Expr::is_polynomial),
            Expr::Power(base, _) => base.is_polynomial(),
            Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => false,
        }
    }

    /// The partial derivative with respect to a variable; other variables are held. At a jump or a kink the derivative
    /// of the branch that is taken.
    pub fn derivative(&self, of: Variable) -> Expr {
        match self {
            Expr::Constant(_) => Expr::Constant(0.0),
            Expr::Variable(variable) => Expr::Constant(if *variable == of { 1.0 } else { 0.0 }),
            Expr::Sum(members) => Expr::sum(members.iter().map(|member| member.derivative(of)).collect()),
            Expr::Product(members) => {
                let with = |index: usize| {
                    let factor = |(at, member): (usize, &Expr)| {
                        if at == index { member.derivative(of) } else { member.clone() }
                    };
                    Expr::product(members.iter().enumerate().map(factor).collect())
                };
                Expr::sum((0..members.len()).map(with).collect())
            }
            Expr::Power(base, exponent) => {
                let outer = Expr::scaled(f64::from(*exponent), Expr::power((**base).clone(), exponent - 1));
                Expr::product(vec![outer, base.derivative(of)])
            }
            Expr::Apply(function, argument) => match argument.derivative(of) {
                Expr::Constant(0.0) => Expr::Constant(0.0),
                inner => Expr::product(vec![function.derivative(argument), inner]),
            },
            Expr::Select(select) => {
                let (yes, no) = (select.yes.derivative(of), select.no.derivative(of));
                if yes == no {
                    return yes;
                }
                Expr::Select(Box::new(Select { condition: select.condition.clone(), yes, no }))
            }
            Expr::Solution(_) => unreachable!("linear systems are eliminated before anything is differentiated"),
        }
    }
}

/// A number in its shorter form.
fn number_text(number: f64) -> String {
    let magnitude = number.abs();
    if number == 0.0 || (1e-4..1e6).contains(&magnitude) { number.to_string() } else { format!("{number:e}") }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// One of each.
    pub(crate) fn functions() -> Vec<Function> {
        [Function::Reciprocal, Function::RealPower(-1.5)].into_iter().chain(Function::NAMED).collect()
    }

    const X: Variable = Variable::State(StateId::new(0));

    fn x() -> Expr {
        Expr::Variable(X)
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for function in functions() {
            // f(x)^2 * x / 2, so that chain and product rule take part.
            let applied = Expr::Apply(function, Box::new(Expr::scaled(0.5, x())));
            let expr = Expr::product(vec![Expr::power(applied, 2), x()]);
            let derivative = expr.derivative(X);
            for at in [0.3, 0.7, 1.1] {
                let value = |x: f64| expr.evaluate(&|_| x);
                let difference = (value(at + 1e-6) - value(at - 1e-6)) / 2e-6;
                let exact = derivative.evaluate(&|_| at);
                assert!((exact - difference).abs() < 1e-7 * (1.0 + exact.abs()), "{function:?} at {at}: {exact}");
            }
        }
    }

    #[test]
    fn a_choice_takes_no_branch_above_zero_only() {
        let select = Select { condition: x(), yes: Expr::Apply(Function::Log, Box::new(x())), no: Expr::Constant(7.0) };
        let expr = Expr::Select(Box::new(select));
        assert_eq!([-1.0, 0.0, 1.0].map(|at| expr.evaluate(&|_| at)), [7.0, 7.0, 0.0]);
    }

    #[test]
    fn the_derivative_of_what_does_not_read_the_variable_is_zero() {
        let other = Expr::Apply(Function::Exp, Box::new(Expr::Variable(Variable::Input(0))));
        assert_eq!(other.derivative(X), Expr::Constant(0.0));
    }
}
