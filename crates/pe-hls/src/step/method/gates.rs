//! Rush and Larsen's method: gates by the exponential of their own rate, all other states by Euler's method.
//!
//! Rush, Larsen, A practical algorithm for solving dynamic membrane equations, IEEE Trans. Biomed. Eng. 25 (1978). A
//! gate is a state `x' = a(V) - b(V) x` whose rates are functions of one other state. With `V` held over the step its
//! solution is `x+ = x + p(V) (a(V)/b(V) - x)`, `p = 1 - exp(-h b)`; both `p` and `p a/b` are functions of `V` alone.

use pe_ir::index::{List, StateId, at};
use pe_ir::model::{Expr, Function, Model, Select, Variable};
use pe_ir::source::Diagnostic;

use super::suit::unsuitable;
use crate::kinks::bends;
use crate::lift::MOST_KINKS;
use crate::step::plan::{Plan, of};

/// Parts of an expression with its algebraic variables put in, at most: rates are short.
const LONGEST: usize = 2_000;

/// The step of a model.
///
/// # Errors
/// `E0806` if no state is a gate.
pub fn plan(model: &Model) -> Result<Plan<'_>, Vec<Diagnostic>> {
    let gates: List<StateId, Option<Gate>> = model.states.ids().map(|state| Gate::of(model, state)).collect();
    if gates.iter().all(Option::is_none) {
        let reason = "no state is a gate, `x' = a(V)*(1 - x) - b(V)*x` or `(x_inf(V) - x)/tau(V)`";
        return Err(unsuitable(model, reason, "try `rk4`, or `rodas3` if the model is stiff"));
    }
    let mut plan = Plan::new(model);
    let mut start = plan.start();
    let others: Vec<StateId> = gates.ids().filter(|state| gates[*state].is_none()).collect();
    let mut slopes = plan.slopes(&mut start, &others).into_iter();
    for (state, gate) in model.states.ids().zip(gates) {
        let sum = match gate {
            None => Expr::scaled(model.step, slopes.next().expect("a slope for each state that is no gate")),
            Some(gate) => gate.increment(&mut plan, state),
        };
        plan.end(state, Some(Variable::State(state)), sum);
    }
    Ok(plan)
}

/// `x' = inflow - rate * x`.
struct Gate {
    inflow: Expr,
    rate: Expr,
}

impl Gate {
    fn of(model: &Model, state: StateId) -> Option<Gate> {
        let own = Variable::State(state);
        let mut parts = LONGEST;
        let whole = put_in(model, &model.states[state].derivative, &mut parts)?;
        let mut other = None;
        let mut alone = true;
        whole.each_variable(&mut |variable| {
            if variable != own {
                alone &= matches!(variable, Variable::State(_)) && other.is_none_or(|other| other == variable);
                other = Some(variable);
            }
        });
        let rate = Expr::scaled(-1.0, whole.derivative(own));
        let mut linear = rate != Expr::Constant(0.0);
        rate.each_variable(&mut |variable| linear &= variable != own);
        if !alone || !linear || other.is_none() || whole.is_polynomial() {
            return None;
        }
        let inflow = at_zero(&whole, own)?;
        // A table has room for one kink.
        let few = |expr: &Expr| bends(expr).is_some_and(|places| places.len() <= MOST_KINKS);
        few(&Expr::sum(vec![inflow.clone(), rate.clone()])).then_some(Gate { inflow, rate })
    }

    /// `p a/b - p x`.
    fn increment(self, plan: &mut Plan, state: StateId) -> Expr {
        let name = plan.model.states[state].name.clone();
        let decay = Expr::Apply(Function::Exp, Box::new(Expr::scaled(-plan.model.step, self.rate.clone())));
        let part = match &self.rate {
            Expr::Constant(rate) => Expr::Constant(-libm::expm1(-plan.model.step * rate)),
            _ => Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, decay)]),
        };
        let inverse = match self.rate {
            Expr::Constant(rate) => Expr::Constant(1.0 / rate),
            rate => Expr::Apply(Function::Reciprocal, Box::new(rate)),
        };
        let inflow = Expr::product(vec![self.inflow, inverse, part.clone()]);
        let mut simple = |expr: Expr, what: &str| match expr {
            Expr::Constant(_) => expr,
            expr => of(plan.auxiliary(state, format!("{name}.{what}"), expr, true)),
        };
        let (inflow, part) = (simple(inflow, "inflow"), simple(part, "part"));
        Expr::sum(vec![inflow, Expr::product(vec![Expr::Constant(-1.0), part, of(Variable::State(state))])])
    }
}

/// An expression with the algebraic variables that it reads put in their place; none if it gets too long.
fn put_in(model: &Model, expr: &Expr, parts: &mut usize) -> Option<Expr> {
    *parts = parts.checked_sub(1)?;
    let mut all =
        |members: &[Expr]| -> Option<Vec<Expr>> { members.iter().map(|member| put_in(model, member, parts)).collect() };
    Some(match expr {
        Expr::Variable(Variable::Algebraic(algebraic)) => put_in(model, &model.algebraics[at(*algebraic)].expr, parts)?,
        Expr::Constant(_) | Expr::Variable(_) => expr.clone(),
        Expr::Sum(members) => Expr::Sum(all(members)?),
        Expr::Product(members) => Expr::Product(all(members)?),
        Expr::Power(base, exponent) => Expr::Power(Box::new(put_in(model, base, parts)?), *exponent),
        Expr::Apply(function, argument) => Expr::Apply(*function, Box::new(put_in(model, argument, parts)?)),
        Expr::Select(select) => {
            let [condition, yes, no] =
                [&select.condition, &select.yes, &select.no].map(|part| put_in(model, part, parts));
            Expr::Select(Box::new(Select { condition: condition?, yes: yes?, no: no? }))
        }
        Expr::Solution(_) => return None,
    })
}

/// An expression that is affine in a variable, where this is zero; none where a choice depends on it.
fn at_zero(expr: &Expr, variable: Variable) -> Option<Expr> {
    let all = |members: &[Expr]| members.iter().map(|member| at_zero(member, variable)).collect::<Option<Vec<Expr>>>();
    Some(match expr {
        Expr::Variable(other) if *other == variable => Expr::Constant(0.0),
        Expr::Sum(members) => Expr::sum(all(members)?),
        Expr::Product(members) => Expr::product(all(members)?),
        Expr::Select(select) => {
            let mut reads = false;
            select.condition.each_variable(&mut |read| reads |= read == variable);
            if reads {
                return None;
            }
            let (yes, no) = (at_zero(&select.yes, variable)?, at_zero(&select.no, variable)?);
            Expr::Select(Box::new(Select { condition: select.condition.clone(), yes, no }))
        }
        expr => expr.clone(),
    })
}
