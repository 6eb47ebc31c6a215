//! A mechanism: what an implicit step needs to know of a model whose motion is constrained.

use crate::expr::{Expr, Variable};
use crate::index::StateId;
use crate::solution::Entry;
use crate::source::Span;

/// Coordinates q and velocities w = q' with `M w' + transpose(J)*forces of constraints = f` and `gap(q) = 0`.
///
/// The model itself has accelerations as equations of its own, so that every method takes it; this says what they are
/// made of. Values are numbers or variables of the model.
#[derive(Clone, Debug)]
pub struct Mechanism {
    /// Coordinates, each with its velocity.
    pub pairs: Vec<(StateId, StateId)>,
    /// The mass matrix, both triangles.
    pub mass: Vec<Entry>,
    /// Forces, by coordinates.
    pub forces: Vec<Expr>,
    /// Derivatives of the closures (rows) by coordinates (columns).
    pub jacobian: Vec<Entry>,
    /// Closures: zero where the loops are closed.
    pub gaps: Vec<Expr>,
    /// What remains of the second derivatives of the closures by time if nothing accelerates.
    pub bends: Vec<Expr>,
    /// Derivatives of the closures by time where no coordinate moves; none if closures read coordinates alone.
    pub drifts: Vec<Expr>,
    /// Weight of the closures beside the mass matrix, `M + penalty*transpose(J)*J`.
    pub penalty: f64,
    /// Its equation in the spec.
    pub span: Span,
}

/// Points of the implicit step at which equations of the model are evaluated: what the names of these equations end in there.
pub const POINTS: [&str; 3] = ["ahead", "nearer", "end"];

/// The name in the model of what an equation of the implicit step is at one of its points.
pub fn of_point(name: &str) -> Option<&str> {
    let (own, point) = name.trim_end_matches('_').rsplit_once('.')?;
    POINTS.contains(&point).then_some(own)
}

impl Mechanism {
    fn parts_mut(&mut self) -> impl Iterator<Item = &mut Expr> {
        let entries = self.mass.iter_mut().chain(&mut self.jacobian).map(|entry| &mut entry.value);
        entries.chain(&mut self.forces).chain(&mut self.gaps).chain(&mut self.bends).chain(&mut self.drifts)
    }

    /// What it is made of.
    pub fn parts(&self) -> impl Iterator<Item = &Expr> {
        let entries = self.mass.iter().chain(&self.jacobian).map(|entry| &entry.value);
        entries.chain(&self.forces).chain(&self.gaps).chain(&self.bends).chain(&self.drifts)
    }

    /// Visits the variables that it is made of.
    pub fn each_variable(&self, visit: &mut impl FnMut(Variable)) {
        self.parts().for_each(|part| part.each_variable(visit));
    }

    /// The same, to be changed.
    pub fn each_variable_mut(&mut self, visit: &mut impl FnMut(&mut Variable)) {
        self.parts_mut().for_each(|part| part.each_variable_mut(visit));
    }
}
