//! Methods for models of positions and velocities: bounded energy at one evaluation of the right-hand side per step.
//!
//! Hairer, Lubich, Wanner, Geometric Numerical Integration, sections I.1.2 and I.1.4. Which states are positions is found
//! from who reads whom: velocities read positions, positions read velocities.

use pe_ir::index::{at, number};
use pe_ir::model::{Expr, Model, Variable};
use pe_ir::source::Diagnostic;

use super::suit::unsuitable;
use crate::step::plan::{Plan, Point};

/// Velocities first, with the old positions; then positions, with the new velocities.
///
/// # Errors
/// `E0806` if there are no positions and velocities.
pub fn symplectic_euler(model: &Model) -> Result<Plan<'_>, Vec<Diagnostic>> {
    let parts = Parts::of(model)?;
    let mut plan = Plan::new(model);
    let mut point = plan.start();
    let velocities = moved(&mut plan, &mut point, &parts.velocities, model.step, Move::End);
    let mut point = after(point, &parts.velocities, &velocities, 2);
    moved(&mut plan, &mut point, &parts.positions, model.step, Move::End);
    Ok(plan)
}

/// Half a step of the positions, a step of the velocities, half a step of the positions. Inputs act on the velocities
/// in the middle of the step.
///
/// # Errors
/// `E0806` if a velocity reads a velocity or a position a position.
pub fn leapfrog(model: &Model) -> Result<Plan<'_>, Vec<Diagnostic>> {
    let parts = Parts::of(model)?;
    parts.check_separate(model)?;
    let mut plan = Plan::new(model);
    let mut point = plan.start();
    let middle = moved(&mut plan, &mut point, &parts.positions, model.step / 2.0, Move::Stage);
    let mut point = after(point, &parts.positions, &middle, 2);
    let velocities = moved(&mut plan, &mut point, &parts.velocities, model.step, Move::End);
    let mut point = after(point, &parts.velocities, &velocities, 3);
    moved(&mut plan, &mut point, &parts.positions, model.step / 2.0, Move::End);
    Ok(plan)
}

#[derive(Clone, Copy)]
enum Move {
    Stage,
    End,
}

/// Moves some states from a point on by their slopes there.
fn moved(plan: &mut Plan, point: &mut Point, states: &[u32], step: f64, to: Move) -> Vec<Variable> {
    let slopes = plan.slopes(point, states);
    let mut next = Vec::with_capacity(states.len());
    for (state, slope) in states.iter().zip(slopes) {
        let (base, sum) = (point.states[at(*state)], Expr::scaled(step, slope));
        next.push(match to {
            Move::Stage => plan.stage(*state, 2, base, sum),
            Move::End => plan.end(*state, Some(base), sum),
        });
    }
    next
}

/// The point at which some states have moved.
fn after(point: Point, states: &[u32], values: &[Variable], stage: u8) -> Point {
    let mut all = point.states;
    for (state, value) in states.iter().zip(values) {
        all[at(*state)] = *value;
    }
    Point::new(all, stage)
}

/// Positions and velocities.
#[derive(Debug)]
struct Parts {
    positions: Vec<u32>,
    velocities: Vec<u32>,
    /// For each state those that its derivative reads, ascending.
    reads: Vec<Vec<u32>>,
}

const NONE: u8 = u8::MAX;

impl Parts {
    fn of(model: &Model) -> Result<Parts, Vec<Diagnostic>> {
        let reads = reads(model);
        let position = two_coloured(model, &reads).or_else(|| followers(model, &reads)).ok_or_else(|| {
            let reason = "its states are not pairs of position and velocity";
            unsuitable(model, reason, "it needs pairs such as `x' = v`, `v' = f(x)`; try `rk4`")
        })?;
        let of_kind = |kind: bool| (0..).zip(&position).filter(move |(_, p)| **p == kind).map(|(state, _)| state);
        let (positions, velocities) = (of_kind(true).collect(), of_kind(false).collect());
        Ok(Parts { positions, velocities, reads })
    }

    /// Whether positions read velocities only, and velocities positions only.
    fn check_separate(&self, model: &Model) -> Result<(), Vec<Diagnostic>> {
        let name = |state: u32| &model.states[at(state)].name;
        for (part, what) in [(&self.positions, "position"), (&self.velocities, "velocity")] {
            for state in part {
                let other = self.reads[at(*state)].iter().find(|read| part.binary_search(read).is_ok());
                let Some(other) = other else { continue };
                let reason = format!("the {what} `{}` reads the {what} `{}`", name(*state), name(*other));
                let help = "try `symplectic_euler`, which takes damping at first order, or `rk4`";
                let mut findings = unsuitable(model, &reason, help);
                findings[0].span = Some(model.states[at(*state)].span);
                return Err(findings);
            }
        }
        Ok(())
    }
}

/// For each state those that its derivative reads, directly or through algebraic variables; ascending.
fn reads(model: &Model) -> Vec<Vec<u32>> {
    let mut algebraics: Vec<Vec<u32>> = Vec::with_capacity(model.algebraics.len());
    let of = |expr: &Expr, algebraics: &[Vec<u32>]| {
        let mut states = Vec::new();
        expr.each_variable(&mut |variable| match variable {
            Variable::State(state) => states.push(state),
            Variable::Algebraic(algebraic) => states.extend_from_slice(&algebraics[at(algebraic)]),
            Variable::Input(_) => {}
        });
        states.sort_unstable();
        states.dedup();
        states
    };
    for algebraic in &model.algebraics {
        algebraics.push(of(&algebraic.expr, &algebraics));
    }
    model.states.iter().map(|state| of(&state.derivative, &algebraics)).collect()
}

/// Whether the derivative of a state is nothing but another state times a number.
fn follows(model: &Model, reads: &[Vec<u32>], state: usize) -> bool {
    let plain = |expr: &Expr| matches!(expr, Expr::Constant(_) | Expr::Variable(Variable::State(_)));
    let single = match &model.states[state].derivative {
        Expr::Product(members) | Expr::Sum(members) => members.iter().all(plain),
        expr => plain(expr),
    };
    single && matches!(reads[state].as_slice(), [other] if at(*other) != state)
}

/// The positions if all states fall into two parts that read only one another, or themselves. The part with more states
/// that follow another one holds the positions; of equals the part of the first state.
fn two_coloured(model: &Model, reads: &[Vec<u32>]) -> Option<Vec<bool>> {
    let count = reads.len();
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (state, others) in reads.iter().enumerate() {
        for other in others.iter().filter(|other| at(**other) != state) {
            neighbours[state].push(*other);
            neighbours[at(*other)].push(number(state));
        }
    }
    let mut colour = vec![NONE; count];
    let mut positions = vec![false; count];
    for root in 0..count {
        if colour[root] != NONE {
            continue;
        }
        colour[root] = 0;
        let mut part = vec![root];
        let mut seen = 0;
        while let Some(state) = part.get(seen).copied() {
            seen += 1;
            for other in neighbours[state].iter().map(|other| at(*other)) {
                if colour[other] == NONE {
                    colour[other] = 1 - colour[state];
                    part.push(other);
                } else if colour[other] == colour[state] {
                    return None;
                }
            }
        }
        let mut following = [0usize; 2];
        for state in part.iter().filter(|state| follows(model, reads, **state)) {
            following[usize::from(colour[*state])] += 1;
        }
        let chosen = u8::from(following[1] > following[0]);
        part.iter().for_each(|state| positions[*state] = colour[*state] == chosen);
    }
    // A single part has nothing to alternate with.
    (positions.contains(&true) && positions.contains(&false)).then_some(positions)
}

/// The positions if some states follow velocities, `x' = v`, whatever the velocities read.
fn followers(model: &Model, reads: &[Vec<u32>]) -> Option<Vec<bool>> {
    let follows: Vec<bool> = (0..reads.len()).map(|state| follows(model, reads, state)).collect();
    let position = |state: usize| follows[state] && !follows[at(reads[state][0])];
    let positions: Vec<bool> = (0..reads.len()).map(position).collect();
    positions.contains(&true).then_some(positions)
}
