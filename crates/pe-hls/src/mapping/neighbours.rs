//! Neighbours of a mapping: which equation might move where.
//!
//! The performance and the size neighbour are those of Huang, Vahid and Givargis (2013), doi 10.1145/2514641.2514650,
//! section 5.2.2; plain moves and swaps are added. An equation always moves to a PE that holds one of the equations
//! next to it, and never leaves a PE empty.

use pe_ir::index::at;
use rand_chacha::ChaCha8Rng;

use super::cost::State;
use super::random::below;

/// An equation and the PE it might move to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Move {
    pub(super) equation: usize,
    pub(super) to: usize,
}

/// Equations looked at before a neighbour is given up; bounds the effort at hubs and in the middle of PEs.
const LOOKS: usize = 8;

/// A random equation at the boundary of its PE, to the PE of an equation next to it.
pub(super) fn plain(state: &State, rng: &mut ChaCha8Rng) -> Option<Move> {
    across(state, at(*pick(state.boundary(), rng)?), rng)
}

/// A random equation of an overloaded PE, to the PE of an equation next to it.
pub(super) fn performance(state: &State, rng: &mut ChaCha8Rng) -> Option<Move> {
    let members = state.members(at(*pick(state.overloaded(), rng)?));
    let equation = around(members, rng).find(|&&equation| state.is_boundary(at(equation)))?;
    across(state, at(*equation), rng)
}

/// A random equation of an overloaded PE, to a PE that any equation of it is next to.
pub(super) fn level(state: &State, rng: &mut ChaCha8Rng) -> Option<Move> {
    let members = state.members(at(*pick(state.overloaded(), rng)?));
    let equation = at(*pick(members, rng)?);
    let other = around(members, rng).find(|&&other| state.is_boundary(at(other)))?;
    let to = across(state, at(*other), rng)?.to;
    state.may_move(equation, to).then_some(Move { equation, to })
}

/// To the PE of a random equation, the one of the equations next to it, on other PEs, that has the largest benefit:
/// load of its PE / dependencies between the two PEs.
pub(super) fn size(state: &State, rng: &mut ChaCha8Rng) -> Option<Move> {
    let centre = at(*pick(state.boundary(), rng)?);
    let to = state.pe(centre);
    let mut best: Option<(Move, u64, u64)> = None;
    for neighbour in around(state.problem.neighbours(centre), rng) {
        let equation = neighbour.node();
        if !state.may_move(equation, to) {
            continue;
        }
        let from = state.pe(equation);
        let (load, weight) = (u64::from(state.load(from)), u64::from(state.link(to, from).weight()));
        if best.is_none_or(|(_, best_load, best_weight)| load * best_weight > best_load * weight) {
            best = Some((Move { equation, to }, load, weight));
        }
    }
    best.map(|(candidate, _, _)| candidate)
}

/// An equation of the PE that a move filled, back to the PE that the move left. To be asked after the move.
pub(super) fn exchange(state: &State, from: usize, done: Move, rng: &mut ChaCha8Rng) -> Option<Move> {
    let equation = around(state.members(done.to), rng).map(|&equation| at(equation)).find(|&equation| {
        equation != done.equation
            && state.is_boundary(equation)
            && state.permits(equation, from)
            && state.problem.adjacent(equation).take(LOOKS).any(|next| state.pe(next) == from)
    })?;
    Some(Move { equation, to: from })
}

/// To the PE of one of the equations next to it that are elsewhere.
fn across(state: &State, equation: usize, rng: &mut ChaCha8Rng) -> Option<Move> {
    let places = around(state.problem.neighbours(equation), rng).map(|neighbour| neighbour.node());
    let node = places.into_iter().find(|&node| state.is_elsewhere(node, state.pe(equation)))?;
    let to = state.pe(node);
    state.may_move(equation, to).then_some(Move { equation, to })
}

/// A random element.
fn pick<'a, T>(list: &'a [T], rng: &mut ChaCha8Rng) -> Option<&'a T> {
    (!list.is_empty()).then(|| &list[below(rng, list.len())])
}

/// Some elements in a row, from a random one on and round the end.
fn around<'a, T>(list: &'a [T], rng: &mut ChaCha8Rng) -> impl Iterator<Item = &'a T> {
    let first = if list.is_empty() { 0 } else { below(rng, list.len()) };
    list[first..].iter().chain(&list[..first]).take(LOOKS)
}
