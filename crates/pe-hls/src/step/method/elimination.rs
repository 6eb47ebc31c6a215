//! Gaussian elimination of `I - c J` as equations of a plan.
//!
//! The order is fixed at compile time: always the diagonal entry next whose elimination can fill in least (Markowitz
//! 1957), without pivoting by size. A pivot takes one reciprocal; entries that are numbers are computed here. A row
//! belongs to its state, so that all its equations are computed on one PE.

use std::collections::{BTreeMap, BTreeSet};

use pe_ir::index::{List, StateId};
use pe_ir::model::{Expr, Function};
use pe_ir::source::Diagnostic;

use super::jacobian::Row;
use super::suit::unsuitable;
use crate::step::plan::{Plan, of};

/// Entries of both triangles, at most.
const LARGEST: usize = 1 << 22;

/// Both triangles of a matrix, ready to solve systems with it.
pub struct Factors {
    /// States in the order of their elimination.
    order: Vec<StateId>,
    /// For each state the multiples of earlier rows that were subtracted from its own.
    lower: List<StateId, Vec<(StateId, Expr)>>,
    /// For each state the entries right of its pivot.
    upper: List<StateId, Vec<(StateId, Expr)>>,
    /// Reciprocals of the pivots.
    reciprocals: List<StateId, Expr>,
    /// Whether all entries are numbers.
    pub constant: bool,
}

/// Factors `r I - scale J`, `r` the step ratio or 1, which is number `matrix` of the step.
///
/// # Errors
/// `E0806` if a pivot that is a number is zero, or the triangles have too many entries.
pub fn factor(
    plan: &mut Plan,
    jacobian: List<StateId, Row>,
    scale: f64,
    matrix: u8,
) -> Result<Factors, Vec<Diagnostic>> {
    let model = plan.model;
    let count = jacobian.len();
    let mut rows: List<StateId, Row> = List::with_capacity(count);
    let mut columns: List<StateId, BTreeSet<StateId>> = List::filled(BTreeSet::new(), count);
    for (index, row) in model.states.ids().zip(jacobian) {
        let mut row: Row = row.into_iter().map(|(column, expr)| (column, Expr::scaled(-scale, expr))).collect();
        let diagonal = row.remove(&index).unwrap_or(Expr::Constant(0.0));
        let ratio = model.step_ratio().map_or(Expr::Constant(1.0), of);
        row.insert(index, Expr::sum(vec![ratio, diagonal]));
        row.keys().for_each(|column| {
            columns[*column].insert(index);
        });
        rows.push(row);
    }
    let mut factors = Factors {
        order: Vec::with_capacity(count),
        lower: List::filled(Vec::new(), count),
        upper: List::filled(Vec::new(), count),
        reciprocals: List::filled(Expr::Constant(0.0), count),
        constant: rows.iter().flat_map(BTreeMap::values).all(|entry| entry.as_constant().is_some()),
    };
    let mut prices = List::filled(0, count);
    let mut queue: BTreeSet<(usize, StateId)> = BTreeSet::new();
    for state in rows.ids() {
        prices[state] = price(&rows[state], &columns[state]);
        queue.insert((prices[state], state));
    }
    let mut entries = 0;
    while let Some((_, state)) = queue.pop_first() {
        let mut row = std::mem::take(&mut rows[state]);
        let diagonal = row.remove(&state).expect("the identity is in the matrix");
        let name = &model.states[state].name;
        let reciprocal = match diagonal {
            Expr::Constant(number) if number == 0.0 || !number.is_finite() => {
                let reason = format!("the matrix of its step is singular at `{name}`");
                return Err(unsuitable(model, &reason, "try another `--step`"));
            }
            Expr::Constant(number) => {
                plan.note_pivot(state, number);
                Expr::Constant(1.0 / number)
            }
            expr => {
                let divisor = plan.auxiliary(state, format!("{name}.divisor"), expr, true);
                of(plan.pivot(state, matrix, Expr::Apply(Function::Reciprocal, Box::new(of(divisor)))))
            }
        };
        let upper: Vec<(StateId, Expr)> = row
            .into_iter()
            .map(|(column, expr)| {
                columns[column].remove(&state);
                let other = &model.states[column].name;
                (column, simple(plan, state, || format!("{name}.upper({other})"), expr))
            })
            .collect();
        let mut below = std::mem::take(&mut columns[state]);
        below.remove(&state);
        for other in below.iter().copied() {
            let own = &model.states[other].name;
            let entry = rows[other].remove(&state).expect("columns mirror rows");
            let multiple = Expr::product(vec![entry, reciprocal.clone()]);
            let multiple = simple(plan, other, || format!("{own}.lower({name})"), multiple);
            for (column, expr) in &upper {
                let product = Expr::product(vec![Expr::Constant(-1.0), multiple.clone(), expr.clone()]);
                let sum = match rows[other].remove(column) {
                    Some(entry) => Expr::sum(vec![entry, product]),
                    None => product,
                };
                rows[other].insert(*column, sum);
                columns[*column].insert(other);
            }
            factors.lower[other].push((state, multiple));
        }
        entries += upper.len() + 1;
        if entries > LARGEST {
            let reason = format!("the matrix of its step fills in beyond {LARGEST} entries");
            return Err(unsuitable(model, &reason, "try an explicit solver, such as `rkc10`"));
        }
        below.extend(upper.iter().map(|(column, _)| *column));
        factors.order.push(state);
        factors.upper[state] = upper;
        factors.reciprocals[state] = reciprocal;
        for state in below {
            queue.remove(&(prices[state], state));
            prices[state] = price(&rows[state], &columns[state]);
            queue.insert((prices[state], state));
        }
    }
    Ok(factors)
}

/// Entries that an elimination can fill in.
fn price(row: &Row, column: &BTreeSet<StateId>) -> usize {
    (row.len() - 1) * (column.len() - 1)
}

/// An expression that is a number or a variable: others get an equation of their own.
fn simple(plan: &mut Plan, owner: StateId, name: impl Fn() -> String, expr: Expr) -> Expr {
    match expr {
        Expr::Constant(_) | Expr::Variable(_) => expr,
        expr => of(plan.auxiliary(owner, name(), expr, true)),
    }
}

impl Factors {
    /// The solution for a right-hand side, a number per state; `name` is what its parts are called.
    pub fn solve(&self, plan: &mut Plan, right: Vec<Expr>, name: &str) -> Vec<Expr> {
        let model = plan.model;
        let mut reduced: List<StateId, Expr> = List::filled(Expr::Constant(0.0), right.len());
        let mut right: List<StateId, Option<Expr>> = right.into_iter().map(Some).collect();
        for state in &self.order {
            let index = *state;
            let mut terms = vec![right[index].take().expect("each state is eliminated once")];
            for (row, multiple) in &self.lower[index] {
                terms.push(Expr::product(vec![Expr::Constant(-1.0), multiple.clone(), reduced[*row].clone()]));
            }
            let own = &model.states[index].name;
            reduced[index] = simple(plan, *state, || format!("{own}.reduced.{name}"), Expr::sum(terms));
        }
        let mut solution: List<StateId, Expr> = List::filled(Expr::Constant(0.0), reduced.len());
        for state in self.order.iter().rev() {
            let index = *state;
            let mut terms = vec![reduced[index].clone()];
            for (column, entry) in &self.upper[index] {
                let product = vec![Expr::Constant(-1.0), entry.clone(), solution[*column].clone()];
                terms.push(Expr::product(product));
            }
            let own = &model.states[index].name;
            let reciprocal = &self.reciprocals[index];
            let expr = match (reciprocal, terms) {
                (Expr::Constant(1.0), terms) => Expr::sum(terms),
                (Expr::Constant(number), terms) => {
                    Expr::sum(terms.into_iter().map(|term| Expr::scaled(*number, term)).collect())
                }
                (reciprocal, terms) => Expr::product(vec![reciprocal.clone(), Expr::sum(terms)]),
            };
            solution[index] = simple(plan, *state, || format!("{own}.{name}"), expr);
        }
        solution.into_vec()
    }
}
