//! Sums over the rows of a data file, and the cells of these.

use super::Resolver;
use crate::bind::rows;
use crate::bound::{BoundRange, NodeKind, Rows, SumOver};
use crate::syntax::ast::{Expr, Name, Reference};
use pe_ir::codes;
use pe_ir::source::Diagnostic;

impl<'a> Resolver<'_, 'a> {
    /// A sum over the rows of a data file.
    pub(super) fn sum_over_rows(
        &mut self,
        (name, path): (&'a Name, &'a Name),
        condition: Option<&'a Expr>,
        body: &'a Expr,
    ) -> Option<NodeKind> {
        let table = self.spec.table(path)?;
        let chosen = condition.and_then(|condition| rows::chosen(condition, &name.text));
        let chosen = match chosen {
            Some((cell, number)) => {
                let cells = rows::cells(table, cell, &name.text, self.report)?;
                Some((rows::by_number(&cells), self.number(number)?))
            }
            None => None,
        };
        self.rows.push(rows::Within { name: &name.text, place: self.scope.len(), table });
        self.scope.push(&name.text);
        let condition = condition.map(|condition| self.condition(condition));
        let body = self.number(body);
        self.scope.pop();
        self.rows.pop();
        let condition = match condition {
            Some(condition) => Some(condition?),
            None => None,
        };
        let range = BoundRange::Rows(Rows { places: rows::places(table), chosen });
        Some(NodeKind::SumOver(Box::new(SumOver { range, condition, body: body? })))
    }

    /// A cell of the row that a sum is at, if a name is one; none of what is wrong.
    pub(super) fn cell(&mut self, reference: &Reference) -> Option<Option<NodeKind>> {
        let name = &reference.name;
        if self.rows.iter().any(|within| within.name == name.text) {
            let message =
                format!("`{0}` is a row of a data file; `{0}.NAME` is the number of a column in it", name.text);
            self.report.push(Diagnostic::error(codes::WRONG_KIND, name.span, message));
            return Some(None);
        }
        let within = *self.rows.iter().rev().find(|within| rows::column(&name.text, within.name).is_some())?;
        if !reference.subscripts.is_empty() {
            let message = format!("`{}` is a number and takes no subscripts", name.text);
            self.report.push(Diagnostic::error(codes::SUBSCRIPT_COUNT, reference.span, message));
            return Some(None);
        }
        let cells = rows::cells(within.table, name, within.name, self.report);
        Some(cells.map(|cells| NodeKind::Cell(within.place, cells)))
    }
}
