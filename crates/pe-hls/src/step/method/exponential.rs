//! The exact step of a linear model whose inputs are held: the exponential of its matrix.

use pe_ir::model::Model;
use pe_ir::source::Diagnostic;

use super::suit::unsuitable;
use crate::step::rows::Rows;
use crate::step::sharing::Expanded;

/// Entries of the matrix of a step, at most. The step of `n` states that all reach one another has `n^2`.
const LARGEST: usize = 1 << 20;

/// The matrix of an exact step, to be multiplied by states, inputs and one and added to the states.
///
/// # Errors
/// `E0806` if the model is not affine in states and inputs, or the matrix has too many entries.
pub fn exponential(model: &Model, expanded: &Expanded) -> Result<Rows, Vec<Diagnostic>> {
    let Some(rows) = Rows::of(expanded, model.inputs.len(), LARGEST) else {
        let reason = "its derivatives are not affine in states and inputs with constant coefficients";
        return Err(unsuitable(model, reason, "try `rk4`, or an implicit method if the model is stiff"));
    };
    rows.exponential(model.step, LARGEST).map_err(|_| {
        let reason = format!("the matrix of its step has more than {LARGEST} entries, or numbers that are not finite");
        unsuitable(model, &reason, "try `rk4`, or a shorter `--step`")
    })
}
