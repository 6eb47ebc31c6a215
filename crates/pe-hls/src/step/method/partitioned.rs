//! Methods for models of positions and velocities: bounded energy at one evaluation of the right-hand side per step.
//!
//! Hairer, Lubich, Wanner, Geometric Numerical Integration, sections I.1.2 and I.1.4. Which states are positions is found
//! from who reads whom: velocities read positions, positions read velocities.

use pe_ir::index::{List, StateId, at};
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
fn moved(plan: &mut Plan, point: &mut Point, states: &[StateId], step: f64, to: Move) -> Vec<Variable> {
    let slopes = plan.slopes(point, states);
    let mut next = Vec::with_capacity(states.len());
    for (state, slope) in states.iter().zip(slopes) {
        let (base, sum) = (point.states[state.index()], Expr::scaled(step, slope));
        next.push(match to {
            Move::Stage => plan.stage(*state, 2, base, sum),
            Move::End => plan.end(*state, Some(base), sum),
        });
    }
    next
}

/// The point at which some states have moved.
fn after(point: Point, states: &[StateId], values: &[Variable], stage: u8) -> Point {
    let mut all = point.states;
    for (state, value) in states.iter().zip(values) {
        all[state.index()] = *value;
    }
    Point::new(all, stage)
}

/// Positions and velocities.
#[derive(Debug)]
struct Parts {
    positions: Vec<StateId>,
    velocities: Vec<StateId>,
    /// For each state those that its derivative reads, ascending.
    reads: List<StateId, Vec<StateId>>,
}

const NONE: u8 = u8::MAX;

impl Parts {
    fn of(model: &Model) -> Result<Parts, Vec<Diagnostic>> {
        let reads = reads(model);
        let position = two_coloured(model, &reads).or_else(|| followers(model, &reads)).ok_or_else(|| {
            let reason = "its states are not pairs of position and velocity";
            unsuitable(model, reason, "it needs pairs such as `x' = v`, `v' = f(x)`; try `rk4`")
        })?;
        let of_kind = |kind: bool| position.numbered().filter(move |(_, p)| **p == kind).map(|(state, _)| state);
        let (positions, velocities) = (of_kind(true).collect(), of_kind(false).collect());
        Ok(Parts { positions, velocities, reads })
    }

    /// Whether positions read velocities only, and velocities positions only.
    fn check_separate(&self, model: &Model) -> Result<(), Vec<Diagnostic>> {
        let name = |state: StateId| &model.states[state].name;
        for (part, what) in [(&self.positions, "position"), (&self.velocities, "velocity")] {
            for state in part {
                let other = self.reads[*state].iter().find(|read| part.binary_search(read).is_ok());
                let Some(other) = other else { continue };
                let reason = format!("the {what} `{}` reads the {what} `{}`", name(*state), name(*other));
                let help = "try `symplectic_euler`, which takes damping at first order, or `rk4`";
                let mut findings = unsuitable(model, &reason, help);
                findings[0].span = Some(model.states[*state].span);
                return Err(findings);
            }
        }
        Ok(())
    }
}

/// For each state those that its derivative reads, directly or through algebraic variables; ascending.
fn reads(model: &Model) -> List<StateId, Vec<StateId>> {
    let mut algebraics: Vec<Vec<StateId>> = Vec::with_capacity(model.algebraics.len());
    let of = |expr: &Expr, algebraics: &[Vec<StateId>]| {
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
fn follows(model: &Model, reads: &List<StateId, Vec<StateId>>, state: StateId) -> bool {
    let plain = |expr: &Expr| matches!(expr, Expr::Constant(_) | Expr::Variable(Variable::State(_)));
    let single = match &model.states[state].derivative {
        Expr::Product(members) | Expr::Sum(members) => members.iter().all(plain),
        expr => plain(expr),
    };
    single && matches!(reads[state].as_slice(), [other] if *other != state)
}

/// The positions if all states fall into two parts that read only one another, or themselves. The part with more states
/// that follow another one holds the positions; of equals the part of the first state.
fn two_coloured(model: &Model, reads: &List<StateId, Vec<StateId>>) -> Option<List<StateId, bool>> {
    let count = reads.len();
    let mut neighbours: List<StateId, Vec<StateId>> = List::filled(Vec::new(), count);
    for (state, others) in reads.numbered() {
        for other in others.iter().filter(|other| **other != state) {
            neighbours[state].push(*other);
            neighbours[*other].push(state);
        }
    }
    let mut colour = List::filled(NONE, count);
    let mut positions = List::filled(false, count);
    for root in reads.ids() {
        if colour[root] != NONE {
            continue;
        }
        colour[root] = 0;
        let mut part = vec![root];
        let mut seen = 0;
        while let Some(state) = part.get(seen).copied() {
            seen += 1;
            for other in neighbours[state].iter().copied() {
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
fn followers(model: &Model, reads: &List<StateId, Vec<StateId>>) -> Option<List<StateId, bool>> {
    let follows: List<StateId, bool> = reads.ids().map(|state| follows(model, reads, state)).collect();
    let position = |state: StateId| follows[state] && !follows[reads[state][0]];
    let positions: List<StateId, bool> = reads.ids().map(position).collect();
    positions.contains(&true).then_some(positions)
}
