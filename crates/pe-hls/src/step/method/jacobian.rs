//! The Jacobian of the right-hand side as expressions of a plan.

use std::collections::{BTreeMap, BTreeSet};

use pe_ir::index::{List, StateId, at, number};
use pe_ir::model::{Expr, Variable};
use pe_ir::motion::Motion;

use crate::step::plan::{Plan, Point, of};

/// Entries of a row by column.
pub type Row = BTreeMap<StateId, Expr>;

/// For each state the derivatives of its right-hand side by the states, at a point whose slopes have been asked for.
/// Algebraic variables are differentiated by the chain rule; what is no number and read more than once has a name.
pub fn jacobian(plan: &mut Plan, point: &Point) -> List<StateId, Row> {
    let model = plan.model;
    let mut algebraics: Vec<Row> = Vec::with_capacity(model.algebraics.len());
    for (index, algebraic) in model.algebraics.iter().enumerate() {
        // Only outputs need the others.
        let row = match point.has(number(index)) {
            true => gradient(plan, point, &algebraic.expr, &algebraics),
            false => Row::new(),
        };
        let row = named(plan, &algebraic.name, row);
        algebraics.push(row);
    }
    model.states.iter().map(|state| gradient(plan, point, &state.derivative, &algebraics)).collect()
}

/// Gives names to entries that are neither numbers nor variables.
fn named(plan: &mut Plan, name: &str, row: Row) -> Row {
    let entry = |(column, expr): (StateId, Expr)| {
        let state = &plan.model.states[column].name;
        let expr = match expr {
            Expr::Constant(_) | Expr::Variable(_) => expr,
            expr => of(plan.auxiliary(column, format!("{name}.by({state})"), expr, false)),
        };
        (column, expr)
    };
    row.into_iter().map(entry).collect()
}

/// Total derivatives of an expression of the model by the states.
fn gradient(plan: &mut Plan, point: &Point, expr: &Expr, algebraics: &[Row]) -> Row {
    let model = plan.model;
    let mut terms: BTreeMap<StateId, Vec<Expr>> = BTreeMap::new();
    let members = match expr {
        Expr::Sum(members) => members.as_slice(),
        expr => std::slice::from_ref(expr),
    };
    for member in members {
        let mut variables = BTreeSet::new();
        member.each_variable(&mut |variable| {
            variables.insert(variable);
        });
        for variable in variables {
            let partial = member.derivative(variable).renamed(&|variable| point.variable(variable));
            match (variable, partial) {
                (_, Expr::Constant(0.0)) | (Variable::Input(_), _) => {}
                // What rests over the step moves nothing.
                (Variable::State(state), _) if model.states[state].motion.is_some_and(Motion::rests) => {}
                (Variable::State(state), partial) => {
                    let partial = of_function(plan, state, partial);
                    terms.entry(state).or_default().push(partial);
                }
                (Variable::Algebraic(inner), partial) => {
                    let inner = &algebraics[at(inner)];
                    let Some(owner) = inner.keys().next() else { continue };
                    let partial = of_function(plan, *owner, partial);
                    for (state, factor) in inner {
                        terms.entry(*state).or_default().push(Expr::product(vec![partial.clone(), factor.clone()]));
                    }
                }
            }
        }
    }
    let sums = terms.into_iter().map(|(state, terms)| (state, Expr::sum(terms)));
    sums.filter(|(_, sum)| *sum != Expr::Constant(0.0)).collect()
}

/// An expression that may stand in a product: functions get equations of their own.
fn of_function(plan: &mut Plan, owner: StateId, expr: Expr) -> Expr {
    if expr.is_polynomial() {
        return expr;
    }
    let name = format!("{}.derivative{}", plan.model.states[owner].name, plan.auxiliaries.len());
    of(plan.auxiliary(owner, name, expr, true))
}
