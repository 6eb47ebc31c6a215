//! Sampled blocks: their periods, and the states that hold what they compute.
//!
//! An algebraic quantity of a block is computed where a sample is taken. Whoever reads it elsewhere reads a state that
//! takes its value then and holds it, which comes into being here.

use crate::defined::SIGNALS;
use crate::elaborate::Elaborator;
use crate::equations::{Flat, Row};
use crate::names::Kind;
use pe_ir::model::{Expr, Output, Rate, Variable};

/// What is added to the flat states.
pub(crate) struct Sampled {
    /// For each algebraic element the state that holds it, if there is one.
    pub(crate) holders: Vec<Option<u32>>,
}

impl Elaborator<'_> {
    /// The rates of all blocks; `None` after an error.
    pub(crate) fn rates(&mut self) -> Option<Vec<Rate>> {
        let spec = self.spec;
        let mut rates = Vec::with_capacity(spec.blocks.len());
        for block in &spec.blocks {
            let period = block.period.as_ref().and_then(|period| self.time(period, "period"));
            rates.extend(period.map(|period| Rate { period, span: block.span }));
        }
        (rates.len() == spec.blocks.len()).then_some(rates)
    }

    /// Puts states that hold in the place of what blocks compute, wherever it is read outside of its block.
    pub(crate) fn sample(&mut self, flat: &mut Flat, outputs: &mut [Output]) -> Sampled {
        let mut sampled = Sampled { holders: vec![None; flat.algebraics.len()] };
        if self.spec.blocks.is_empty() {
            return sampled;
        }
        let blocks: Vec<Option<usize>> = {
            let block = |row: &Option<Row>| row.as_ref().and_then(|row| self.names.quantities[row.quantity].block);
            flat.algebraics.iter().map(block).collect()
        };
        let mut held: Vec<u32> = Vec::new();
        let first = flat.states.len() as u32;
        let mut elsewhere = |variable: Variable, reader: Option<usize>| match variable {
            Variable::Algebraic(number)
                if number < SIGNALS && blocks[number as usize].is_some_and(|block| reader != Some(block)) =>
            {
                let holder = sampled.holders[number as usize].get_or_insert_with(|| {
                    held.push(number);
                    first + held.len() as u32 - 1
                });
                Variable::State(*holder)
            }
            other => other,
        };
        for row in flat.states.iter_mut().chain(&mut flat.algebraics).flatten() {
            let reader = self.names.quantities[row.quantity].block;
            row.expr.each_variable_mut(&mut |variable| *variable = elsewhere(*variable, reader));
        }
        for output in outputs {
            output.variable = elsewhere(output.variable, None);
        }
        for number in held {
            let row = flat.algebraics[number as usize].as_ref().expect("it is read");
            let expr = Expr::Variable(Variable::Algebraic(number));
            flat.states.push(Some(Row { expr, ..*row }));
        }
        sampled
    }

    /// Whether a row among the states holds an algebraic quantity.
    pub(crate) fn holds(&self, row: &Row) -> bool {
        self.names.quantities[row.quantity].kind == Kind::Algebraic
    }
}
