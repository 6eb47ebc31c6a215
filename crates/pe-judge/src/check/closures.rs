//! Closures of a mechanism at a place, with what their coordinates move them by.

use nalgebra::{DMatrix, DVector};
use pe_ir::index::{StateId, at};
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Entry, Expr, Model};
use pe_ir::place::Place;

/// A mechanism that is evaluated.
pub(super) struct Closures<'m> {
    /// The model without the equations that nothing here reads.
    model: Model,
    mechanism: &'m Mechanism,
}

/// Parts of a mechanism at a place.
pub(super) struct Numbers {
    /// The mass matrix, and the derivatives of the closures, a row for each.
    pub masses: DMatrix<f64>,
    pub levers: DMatrix<f64>,
    pub gaps: DVector<f64>,
}

impl<'m> Closures<'m> {
    pub fn of(model: &Model, mechanism: &'m Mechanism) -> Closures<'m> {
        let mut read = Vec::new();
        let entries = mechanism.mass.iter().chain(&mechanism.jacobian).map(|entry| &entry.value);
        entries.chain(&mechanism.gaps).for_each(|part| part.each_variable(&mut |variable| read.push(variable)));
        let needed = model.needed(read);
        let mut reduced = model.clone();
        for (algebraic, _) in reduced.algebraics.iter_mut().zip(needed).filter(|(_, needed)| !needed) {
            algebraic.expr = Expr::Constant(0.0);
        }
        Closures { model: reduced, mechanism }
    }

    pub fn at(&self, states: &[f64], time: f64) -> Numbers {
        let inputs = self.model.sample_inputs(time);
        let place = Place::new(&self.model, states, &inputs);
        let number = |part: &Expr| part.evaluate(&|variable| place.number(variable));
        let (size, rows) = (self.mechanism.pairs.len(), self.mechanism.gaps.len());
        let dense = |entries: &[Entry], rows: usize| {
            let mut numbers = DMatrix::<f64>::zeros(rows, size);
            entries.iter().for_each(|entry| numbers[(at(entry.row), at(entry.column))] = number(&entry.value));
            numbers
        };
        Numbers {
            masses: dense(&self.mechanism.mass, size),
            levers: dense(&self.mechanism.jacobian, rows),
            gaps: DVector::from_iterator(rows, self.mechanism.gaps.iter().map(number)),
        }
    }

    /// How far a coordinate is from where it is in other states, in the unit of the spec.
    pub fn apart(&self, coordinate: StateId, there: &[f64], from: &[f64]) -> f64 {
        (there[coordinate.index()] - from[coordinate.index()]) * self.model.radians(coordinate)
    }

    /// Moves a coordinate by so much, in the unit of the spec; how much of its own size that is, or of a unit's if it is less.
    pub fn shift(&self, states: &mut [f64], coordinate: StateId, by: f64) -> f64 {
        let by = by / self.model.radians(coordinate);
        let own = &mut states[coordinate.index()];
        let part = by.abs() / own.abs().max(1.0);
        *own += by;
        part
    }
}
