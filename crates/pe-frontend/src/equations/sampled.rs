//! The pass that holds what sampled blocks compute.
//!
//! An algebraic quantity of a block is computed where a sample is taken. Whoever reads it elsewhere reads a state that
//! takes its value then and holds it, which comes into being here.

use crate::equations::write::{Flat, Row};
use crate::evaluate::signals::SIGNALS;
use crate::names::table::Names;
use crate::syntax::ast::Spec;
use pe_ir::index::{StateId, at, number as number_of};
use pe_ir::model::{Expr, Output, Variable};

/// Puts states that hold in the place of what blocks compute, wherever it is read outside of its block; gives for each algebraic
/// element the state that holds it, if there is one.
pub(crate) fn hold(flat: &mut Flat, outputs: &mut [Output], spec: &Spec, names: &Names) -> Vec<Option<u32>> {
    let mut holders = vec![None; flat.algebraics.len()];
    if spec.blocks.is_empty() {
        return holders;
    }
    let blocks: Vec<Option<usize>> = {
        let block = |row: &Option<Row>| row.as_ref().and_then(|row| names.quantities[row.quantity].block);
        flat.algebraics.iter().map(block).collect()
    };
    let mut held: Vec<u32> = Vec::new();
    let first = number_of(flat.states.len());
    let mut elsewhere = |variable: Variable, reader: Option<usize>| match variable {
        Variable::Algebraic(number)
            if number < SIGNALS && blocks[at(number)].is_some_and(|block| reader != Some(block)) =>
        {
            let holder = holders[at(number)].get_or_insert_with(|| {
                held.push(number);
                first + number_of(held.len()) - 1
            });
            Variable::State(StateId::new(*holder))
        }
        other => other,
    };
    for row in flat.states.iter_mut().chain(&mut flat.algebraics).flatten() {
        let reader = names.quantities[row.quantity].block;
        row.expr.each_variable_mut(&mut |variable| *variable = elsewhere(*variable, reader));
    }
    for output in outputs {
        output.variable = elsewhere(output.variable, None);
    }
    for number in held {
        let row = flat.algebraics[at(number)].as_ref().expect("it is read");
        let expr = Expr::Variable(Variable::Algebraic(number));
        flat.states.push(Some(Row { expr, ..*row }));
    }
    holders
}
