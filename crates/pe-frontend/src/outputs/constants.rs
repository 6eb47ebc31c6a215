//! Outputs that no equation defines: constants, parameters and the time.

use crate::equations::write::{Flat, Row};
use crate::evaluate::signals;
use crate::language::words::TIME;
use crate::names::table::{Kind, Names};
use pe_ir::index::number as number_of;
use pe_ir::model::{Expr, Variable};
use pe_ir::source::Span;
use std::collections::HashMap;

/// The equations of outputs that stand still, behind those of the spec.
pub(super) struct Constants<'f> {
    flat: &'f mut Flat,
    /// The equation of each element of a quantity that is one.
    places: HashMap<(usize, usize), u32>,
}

impl<'f> Constants<'f> {
    pub(super) fn new(flat: &'f mut Flat) -> Self {
        Constants { flat, places: HashMap::new() }
    }

    /// The variable that an existing element of a quantity is; a constant or parameter becomes an equation.
    pub(super) fn variable(&mut self, names: &Names, number: usize, offset: usize, span: Span) -> Variable {
        let quantity = &names.quantities[number];
        if !matches!(quantity.kind, Kind::Const | Kind::Param) {
            return quantity.variable(offset);
        }
        let place = *self.places.entry((number, offset)).or_insert_with(|| {
            // What is not known has been reported.
            let expr = Expr::Constant(quantity.values.get(offset).copied().unwrap_or(f64::NAN));
            self.flat.algebraics.push(Some(Row { quantity: number, offset, expr, range: None, span }));
            number_of(self.flat.algebraics.len()) - 1
        });
        Variable::Algebraic(place)
    }
}

/// Whether `time` is the time: unless the spec gives this name to something else.
pub(super) fn is_time(names: &Names) -> bool {
    names.find(TIME).is_none() && !names.is_poisoned(TIME)
}

/// The time as output.
pub(super) fn variable_of_time() -> (Variable, String) {
    (signals::TIME, TIME.to_owned())
}
