//! The passes that find index ranges and sizes of arrays, from constants.

use crate::bind::resolver::Reads;
use crate::context::Context;
use crate::names::table::{Index, Kind};
use crate::syntax::ast::StatementKind;
use pe_ir::index::number as number_of;

/// Fills in the ranges of `index` statements.
pub(crate) fn index_ranges(context: &mut Context) {
    for statement in &context.spec.statements {
        let StatementKind::Index(binders) = &statement.kind else { continue };
        for binder in binders {
            let Some(range) = context.range_of(binder, Reads::Consts) else { continue };
            // Of two definitions the first counts; the second has been reported.
            let own = |index: &&mut Index| index.name.span == binder.name.span;
            if let Some(index) = context.names.indices.iter_mut().find(own) {
                index.range = Some(range);
            }
        }
    }
}

/// Fills in the sizes of the declared arrays, and the numbers of their first elements.
pub(crate) fn extents(context: &mut Context) {
    let (mut states, mut inputs) = (0, 0);
    for number in 0..context.names.quantities.len() {
        let quantity = &context.names.quantities[number];
        let (kind, binders, name) = (quantity.kind, quantity.binders, quantity.name);
        let undeclared = kind == Kind::Algebraic && quantity.matrix.is_none();
        if kind == Kind::Const || undeclared {
            continue;
        }
        let mut extents = Vec::with_capacity(binders.len());
        for binder in binders {
            extents.extend(context.range_of(binder, Reads::Consts));
        }
        let quantity = &mut context.names.quantities[number];
        quantity.set_extents(&extents);
        let length = quantity.length;
        let complete = extents.len() == binders.len();
        // Its elements are counted with those of other algebraic quantities.
        let counted = kind != Kind::Algebraic;
        if !complete || counted && !context.elements.take(length, &name.text, name.span, &mut context.report) {
            quantity.broken = true;
            quantity.length = 0;
            continue;
        }
        let next = match kind {
            Kind::State => &mut states,
            Kind::Input => &mut inputs,
            Kind::Const | Kind::Param | Kind::Algebraic => continue,
        };
        quantity.base = *next;
        *next += number_of(length);
    }
}
