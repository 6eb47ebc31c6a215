//! Linearly implicit methods, and the trapezoidal rule with a fixed number of Newton iterations.
//!
//! All are written with the matrix `I - gamma h J` and unknowns in the units of the states, so that every number has the
//! range of a state. Inputs stand still within a step, so the step is that of an autonomous model.
//!
//! - `implicit_euler`: Rosenbrock's method of one stage, Hairer and Wanner, Solving Ordinary Differential Equations II,
//!   section IV.7.
//! - `ros2`: Verwer, Spee, Blom, Hundsdorfer, A second-order Rosenbrock method applied to photochemical dispersion
//!   problems, SIAM J. Sci. Comput. 20 (1999), with `gamma = 1 - 1/sqrt(2)`, which makes it L-stable.
//! - `rodas3`: Sandu, Verwer, Blom, Spee, Carmichael, Potra, Benchmarking stiff ODE solvers for atmospheric chemistry
//!   problems II, Atmospheric Environment 31 (1997); third order, stiffly accurate.

use pe_ir::coefficients::ROS2_GAMMA;
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Function, Model};
use pe_ir::source::Diagnostic;

use super::jacobian::jacobian;
use super::suit::unsuitable;
use crate::step::elimination::order::Order;
use crate::step::elimination::scheme::Scheme;
use crate::step::elimination::{self, Factors, Obstacle, Row, Sink};
use crate::step::plan::{Plan, Point, of};

/// Newton iterations of the trapezoidal rule. Each has a Jacobian of its own: with a frozen one Newton's iteration
/// diverges where the first step is large.
const ITERATIONS: u8 = 2;

fn states(model: &Model) -> Vec<StateId> {
    model.states.ids().collect()
}

/// Slopes of all states that several stages read, each computed once.
fn kept(plan: &mut Plan, slopes: Vec<Expr>) -> Vec<Expr> {
    let model = plan.model;
    let name = |state: StateId| format!("{}.slope", model.states[state].name);
    let mut keep = |(state, slope): (StateId, Expr)| match slope {
        Expr::Constant(0.0) => slope,
        slope => of(plan.auxiliary(state, name(state), slope, true)),
    };
    model.states.ids().zip(slopes).map(&mut keep).collect()
}

/// The matrix of a step, whose equations belong to a plan: a row belongs to its state, so that all its equations are
/// computed on one PE.
struct Rows<'p, 'm> {
    plan: &'p mut Plan<'m>,
    matrix: u8,
}

impl Sink for Rows<'_, '_> {
    fn row_name(&self, row: usize) -> String {
        self.plan.model.states[StateId::at(row)].name.clone()
    }

    fn quantity(&mut self, row: usize, name: &dyn Fn() -> String, expr: Expr) -> Expr {
        match expr {
            Expr::Constant(_) | Expr::Variable(_) => expr,
            expr => of(self.plan.auxiliary(StateId::at(row), name(), expr, true)),
        }
    }

    fn reciprocal(&mut self, row: usize, pivot: Expr, _root: bool) -> Expr {
        let state = StateId::at(row);
        let divisor = self.plan.auxiliary(state, format!("{}.divisor", self.row_name(row)), pivot, true);
        of(self.plan.pivot(state, self.matrix, Expr::Apply(Function::Reciprocal, Box::new(of(divisor)))))
    }

    fn constant_pivot(&mut self, row: usize, number: f64) {
        self.plan.note_pivot(StateId::at(row), number);
    }

    fn is_short(&self) -> bool {
        false
    }

    fn multiplies_ahead(&self, _: usize) -> bool {
        false
    }

    fn scheme(&self) -> Scheme {
        Scheme::Plain
    }
}

/// The matrix `r I - scale J` at a point whose slopes have been asked for, `r` the step ratio or 1, with its number in
/// the step.
struct Matrix {
    factors: Factors,
    number: u8,
    constant: bool,
}

impl Matrix {
    /// # Errors
    /// `E0806` if a pivot that is a number is zero, or the triangles have too many entries.
    fn at(plan: &mut Plan, point: &Point, scale: f64, number: u8) -> Result<Matrix, Vec<Diagnostic>> {
        let model = plan.model;
        let jacobian = jacobian(plan, point);
        let rows: Vec<Row> = (0..)
            .zip(jacobian)
            .map(|(index, row)| {
                let entry = |(column, expr): (StateId, Expr)| (column.index(), Expr::scaled(-scale, expr));
                let mut row: Row = row.into_iter().map(entry).collect();
                let diagonal = row.remove(&index).unwrap_or(Expr::Constant(0.0));
                let ratio = model.step_ratio().map_or(Expr::Constant(1.0), of);
                row.insert(index, Expr::sum(vec![ratio, diagonal]));
                row
            })
            .collect();
        let order = elimination::pattern(&rows).order(plan.order).unwrap_or_default();
        let factors = elimination::factor(&mut Rows { plan, matrix: number }, rows, false, order);
        let factors = factors.map_err(|obstacle| match obstacle {
            Obstacle::Singular(row) => {
                let reason = format!("the matrix of its step is singular at `{}`", model.states[StateId::at(row)].name);
                unsuitable(model, &reason, "try another `--step`")
            }
            Obstacle::Large => {
                let reason = format!("the matrix of its step fills in beyond {} entries", elimination::largest());
                unsuitable(model, &reason, "try an explicit solver, such as `rkc10`")
            }
        })?;
        Ok(Matrix { constant: factors.constant, factors, number })
    }

    /// The solution for a right-hand side, a number per state; `name` is what its parts are called.
    fn solve(&self, plan: &mut Plan, right: Vec<Expr>, name: &str) -> Vec<Expr> {
        self.factors.solve(&mut Rows { plan, matrix: self.number }, right, name)
    }
}

fn scaled(factor: f64, exprs: &[Expr]) -> Vec<Expr> {
    exprs.iter().map(|expr| Expr::scaled(factor, expr.clone())).collect()
}

/// Sums, state by state.
fn sums(parts: &[(f64, &[Expr])]) -> Vec<Expr> {
    let sum = |state: usize| {
        Expr::sum(parts.iter().map(|(factor, part)| Expr::scaled(*factor, part[state].clone())).collect())
    };
    (0..parts[0].1.len()).map(sum).collect()
}

/// What stages before carry over: times the step ratio, if there is a list of steps.
///
/// With the matrix `1/(g h) I - J` a Rosenbrock method has `h` in its diagonal and in what it carries over only. Times
/// `g H`, `H` the last step of the list, all other coefficients are those of `H`, and the diagonal is `r = H/h`.
fn carried(plan: &Plan, sum: Vec<Expr>) -> Vec<Expr> {
    let Some(ratio) = plan.model.step_ratio() else { return sum };
    sum.into_iter().map(|sum| Expr::product(vec![of(ratio), sum])).collect()
}

/// A point at which all states have moved from a point on.
fn moved(plan: &mut Plan, from: &Point, increments: Vec<Expr>, stage: u8) -> Point {
    let states = plan.model.states.ids().zip(increments);
    let states = states.map(|(state, sum)| plan.stage(state, stage, from.states[state.index()], sum)).collect();
    Point::new(states, stage)
}

fn end(plan: &mut Plan, from: &Point, increments: Vec<Expr>) {
    for (state, sum) in plan.model.states.ids().zip(increments) {
        plan.end(state, Some(from.states[state.index()]), sum);
    }
}

/// A plan with the point at which the step starts and the slopes there.
fn begun(model: &Model, order: Order) -> (Plan<'_>, Point, Vec<Expr>) {
    let mut plan = Plan { order, ..Plan::new(model) };
    let mut start = plan.start();
    let slopes = plan.slopes(&mut start, &states(model));
    (plan, start, slopes)
}

/// `(I - h J) u = h f(y)`, `y+ = y + u`.
pub fn implicit_euler(model: &Model, order: Order) -> Result<Plan<'_>, Vec<Diagnostic>> {
    let (mut plan, start, slopes) = begun(model, order);
    let matrix = Matrix::at(&mut plan, &start, model.step, 1)?;
    let u = matrix.solve(&mut plan, scaled(model.step, &slopes), "u");
    end(&mut plan, &start, u);
    Ok(plan)
}

/// `(I - g h J) u1 = h f(y)`, `(I - g h J) u2 = h f(y + u1) - 2 u1`, `y+ = y + 3/2 u1 + 1/2 u2`.
pub fn ros2(model: &Model, order: Order) -> Result<Plan<'_>, Vec<Diagnostic>> {
    let gamma = ROS2_GAMMA;
    let h = model.step;
    let states = states(model);
    let (mut plan, start, slopes) = begun(model, order);
    let matrix = Matrix::at(&mut plan, &start, gamma * h, 1)?;
    let u1 = matrix.solve(&mut plan, scaled(h, &slopes), "u1");
    let mut second = moved(&mut plan, &start, u1.clone(), 2);
    let slopes = plan.slopes(&mut second, &states);
    let before = carried(&plan, scaled(-2.0, &u1));
    let u2 = matrix.solve(&mut plan, sums(&[(h, &slopes), (1.0, &before)]), "u2");
    end(&mut plan, &start, sums(&[(1.5, &u1), (0.5, &u2)]));
    Ok(plan)
}

/// With `W = I - h J / 2`: `W u1 = h/2 f(y)`, `W u2 = h/2 f(y) + 2 u1`, `W u3 = h/2 f(y + 2 u1) + (u1 - u2)/2`,
/// `W u4 = h/2 f(y + 2 u1 + u3) + (u1 - u2)/2 - 4/3 u3`, `y+ = y + 2 u1 + u3 + u4`.
pub fn rodas3(model: &Model, order: Order) -> Result<Plan<'_>, Vec<Diagnostic>> {
    let half = model.step / 2.0;
    let states = states(model);
    let (mut plan, start, slopes) = begun(model, order);
    let first = kept(&mut plan, scaled(half, &slopes));
    let matrix = Matrix::at(&mut plan, &start, half, 1)?;
    let u1 = matrix.solve(&mut plan, first.clone(), "u1");
    let before = carried(&plan, scaled(2.0, &u1));
    let u2 = matrix.solve(&mut plan, sums(&[(1.0, &first), (1.0, &before)]), "u2");
    let mut third = moved(&mut plan, &start, scaled(2.0, &u1), 3);
    let slopes = plan.slopes(&mut third, &states);
    let before = carried(&plan, sums(&[(0.5, &u1), (-0.5, &u2)]));
    let u3 = matrix.solve(&mut plan, sums(&[(half, &slopes), (1.0, &before)]), "u3");
    let mut fourth = moved(&mut plan, &third, u3.clone(), 4);
    let slopes = plan.slopes(&mut fourth, &states);
    let before = carried(&plan, sums(&[(0.5, &u1), (-0.5, &u2), (-4.0 / 3.0, &u3)]));
    let right = sums(&[(half, &slopes), (1.0, &before)]);
    let u4 = matrix.solve(&mut plan, right, "u4");
    end(&mut plan, &fourth, u4);
    Ok(plan)
}

/// Newton's iteration for `d = h/2 (f(y) + f(y + d))`, from `d = 0`: `(I - h/2 J(y + d)) e = h/2 (f(y) + f(y + d)) - d`,
/// then `d + e` in place of `d`. A linear model is solved by the first iteration.
pub fn trapezoidal(model: &Model, order: Order) -> Result<Plan<'_>, Vec<Diagnostic>> {
    let half = model.step / 2.0;
    let states = states(model);
    let (mut plan, mut point, slopes) = begun(model, order);
    let matrix = Matrix::at(&mut plan, &point, half, 1)?;
    if matrix.constant {
        let e = matrix.solve(&mut plan, scaled(model.step, &slopes), "u");
        end(&mut plan, &point, e);
        return Ok(plan);
    }
    let first = kept(&mut plan, scaled(half, &slopes));
    // The sum of the corrections so far; increments are added to the last point, exactly.
    let mut moves = matrix.solve(&mut plan, scaled(2.0, &first), "u1");
    let mut total = moves.clone();
    for iteration in 2..=ITERATIONS {
        point = moved(&mut plan, &point, moves, iteration);
        let slopes = plan.slopes(&mut point, &states);
        let matrix = Matrix::at(&mut plan, &point, half, iteration)?;
        let before = carried(&plan, scaled(-1.0, &total));
        let right = sums(&[(1.0, &first), (half, &slopes), (1.0, &before)]);
        moves = matrix.solve(&mut plan, right, &format!("u{iteration}"));
        total = sums(&[(1.0, &total), (1.0, &moves)]);
    }
    end(&mut plan, &point, moves);
    Ok(plan)
}
