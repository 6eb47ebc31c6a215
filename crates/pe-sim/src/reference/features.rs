//! Whether a model has features in time that an adaptive step can pass over.
//!
//! An error estimate sees what the states do, and what lies at the stages of a step. A narrow function of time, such as a
//! Gaussian late in the span, may lie between them all.

use pe_ir::index::at;
use pe_ir::model::{Expr, Model, Variable};

/// Whether a function is applied to, or a choice made by, what depends on time alone or on inputs.
pub(super) fn of_time(model: &Model) -> bool {
    let mut timed = Timed { model, algebraics: Vec::new() };
    for algebraic in &model.algebraics {
        let depends = timed.depends(&algebraic.expr);
        timed.algebraics.push(depends);
    }
    let derivatives = model.states.iter().map(|state| &state.derivative);
    model.algebraics.iter().map(|algebraic| &algebraic.expr).chain(derivatives).any(|expr| timed.shaped(expr))
}

struct Timed<'a> {
    model: &'a Model,
    /// Whether each algebraic variable so far depends on time.
    algebraics: Vec<bool>,
}

impl Timed<'_> {
    fn is_timed(&self, variable: Variable) -> bool {
        match variable {
            Variable::Input(_) => true,
            Variable::Algebraic(index) => self.algebraics.get(at(index)).is_some_and(|timed| *timed),
            Variable::State(index) => {
                let state = &self.model.states[index];
                // A state that nothing but numbers moves is a clock.
                state.motion.is_some() || (state.rate.is_none() && state.derivative.as_constant().is_some())
            }
        }
    }

    fn depends(&self, expr: &Expr) -> bool {
        let mut depends = false;
        expr.each_variable(&mut |variable| depends |= self.is_timed(variable));
        depends
    }

    /// Whether a part of an expression is a function of time, or a choice by it.
    fn shaped(&self, expr: &Expr) -> bool {
        match expr {
            Expr::Constant(_) | Expr::Variable(_) => false,
            // Where a matrix of time is nearly singular, its solution may be as narrow as any function.
            Expr::Solution(solution) => solution.matrix.entries.iter().any(|entry| self.depends(&entry.value)),
            Expr::Sum(members) | Expr::Product(members) => members.iter().any(|member| self.shaped(member)),
            Expr::Power(base, _) => self.shaped(base),
            Expr::Apply(_, argument) => self.depends(argument) || self.shaped(argument),
            Expr::Select(select) => {
                self.depends(&select.condition)
                    || [&select.condition, &select.yes, &select.no].into_iter().any(|part| self.shaped(part))
            }
        }
    }
}
