//! Linear systems: matrices and right-hand sides by the elements that exist, each made once.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::evaluate::evaluator::element;
use crate::fault::Fault;
use crate::names::table::{Names, nth};
use pe_ir::index::number;
use pe_ir::model::{Entry, Expr, Matrix, Right, Solution};
use pe_ir::source::Span;

/// The linear systems of a spec so far.
#[derive(Debug, Default)]
pub(crate) struct Systems {
    matrices: BTreeMap<usize, Arc<Matrix>>,
    /// By the quantities of matrix and right-hand side, and the column of the latter.
    rights: BTreeMap<(usize, usize, Option<i64>), Arc<Right>>,
}

impl Systems {
    /// The element of a solution with these subscripts: the row, and of a right-hand side with several columns which.
    pub(crate) fn solution(
        &mut self,
        names: &Names,
        matrix: usize,
        right: usize,
        subscripts: &[i64],
        span: Span,
    ) -> Result<Expr, Fault> {
        let quantity = &names.quantities[matrix];
        if quantity.broken || names.quantities[right].broken {
            return Err(Fault::Silent);
        }
        let [rows, columns] = quantity.dimensions[..] else { return Err(Fault::Silent) };
        let (row, column) = (subscripts[0], subscripts.get(1).copied());
        let size = usize::try_from(rows.high - rows.low + 1).unwrap_or(0);
        let known = self.matrices.get(&matrix).cloned();
        let known_right = self.rights.get(&(matrix, right, column)).cloned();
        let matrix_of = match known {
            Some(known) => known,
            None => {
                let mut entries = Vec::new();
                for place in 0..size * size {
                    let (row, column) = (place / size, place % size);
                    let value = element(names, matrix, &[nth(rows.low, row), nth(columns.low, column)], span)?;
                    if value != Expr::Constant(0.0) {
                        entries.push(Entry { row: number(row), column: number(column), value });
                    }
                }
                let made = Arc::new(Matrix {
                    number: number(self.matrices.len()),
                    name: quantity.name.text.clone(),
                    symmetric: quantity.matrix == Some(true),
                    size: number(size),
                    first: (rows.low, columns.low),
                    entries,
                });
                self.matrices.insert(matrix, Arc::clone(&made));
                made
            }
        };
        let right_of = match known_right {
            Some(known) => known,
            None => {
                let values = (0..size).map(|place| {
                    let place = nth(rows.low, place);
                    let subscripts: Vec<i64> = std::iter::once(place).chain(column).collect();
                    element(names, right, &subscripts, span)
                });
                let values = values.collect::<Result<Vec<Expr>, Fault>>()?;
                let made = Arc::new(Right { number: number(self.rights.len()), values });
                self.rights.insert((matrix, right, column), Arc::clone(&made));
                made
            }
        };
        let row = u32::try_from(row - columns.low).map_err(|_| Fault::Silent)?;
        Ok(Expr::Solution(Box::new(Solution { matrix: matrix_of, right: right_of, row })))
    }
}
