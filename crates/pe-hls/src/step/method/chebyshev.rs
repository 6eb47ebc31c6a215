//! Runge-Kutta-Chebyshev methods of second order.
//!
//! Sommeijer, Shampine, Verwer, RKC: an explicit solver for parabolic PDEs, J. Comput. Appl. Math. 88 (1997), equations
//! 2.1 to 2.7. The stages are written as increments `d_j = y_j - y`, so that only small numbers are
//! multiplied: `d_j = mu_j d_{j-1} + nu_j d_{j-2} + h (mu~_j f_{j-1} + gamma~_j f_0)`.

use pe_ir::coefficients::chebyshev;
use pe_ir::index::{StateId, at};
use pe_ir::model::{Expr, Model, Variable};

use crate::step::plan::{Plan, Point, of};

/// The step of a model.
pub fn plan(model: &Model) -> Plan<'_> {
    let states: Vec<StateId> = model.states.ids().collect();
    let mut plan = Plan::new(model);
    let mut point = plan.start();
    let mut first: Vec<Expr> = Vec::new();
    // Increments of the last stage but one and of the last.
    let mut before: Vec<Vec<Expr>> = Vec::new();
    let stages = chebyshev(at(model.solver.stages()));
    for (number, stage) in (2..).zip(&stages) {
        let slopes = plan.slopes(&mut point, &states);
        let last = usize::from(number) == stages.len() + 1;
        let (mut next, mut increments) = (Vec::new(), Vec::new());
        for (state, slope) in states.iter().zip(slopes) {
            let index = state.index();
            let name = &model.states[*state].name;
            let mut terms = Vec::new();
            if number == 2 {
                // The first slope is read by all stages.
                let slope = match Expr::scaled(model.step, slope) {
                    Expr::Constant(0.0) => Expr::Constant(0.0),
                    slope => of(plan.auxiliary(*state, format!("{name}.slope"), slope, true)),
                };
                terms.push(Expr::scaled(stage.slope, slope.clone()));
                first.push(slope);
            } else {
                terms.push(Expr::scaled(model.step * stage.slope, slope));
                terms.push(Expr::scaled(stage.first_slope, first[index].clone()));
            }
            for (increments, factor) in before.iter().rev().zip([stage.mu, stage.nu]) {
                terms.push(Expr::scaled(factor, increments[index].clone()));
            }
            let (base, sum) = (Variable::State(*state), Expr::sum(terms));
            if last {
                plan.end(*state, Some(base), sum);
                continue;
            }
            let value = plan.stage(*state, number, base, sum);
            // The first increment is a multiple of the first slope.
            increments.push(match number {
                _ if value == base => Expr::Constant(0.0),
                2 => Expr::scaled(stage.slope, first[index].clone()),
                _ => of(plan.increment_of(value, *state, format!("{name}.increment{number}"))),
            });
            next.push(value);
        }
        point = Point::new(next, number);
        before.push(increments);
        if before.len() > 2 {
            before.remove(0);
        }
    }
    plan
}
