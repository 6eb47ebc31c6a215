//! Coefficients in two issue slots, where a design point requests them: the runs they need before the step graph is
//! final.

use pe_hls::two_slots;
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;

use crate::point::Coefficients;
use crate::progress::silent;
use crate::runs::Exact;

/// Part of the word-length error that two slots may leave for [`Coefficients::Auto`] to take them.
const WORTH: f64 = 0.5;

/// The step graph with coefficients in two slots, and its run in double precision; none if one slot is to be taken.
/// `exact` is the run of `graph`.
///
/// # Errors
/// Those of the runs.
pub fn refine(
    model: &Model,
    graph: &StepGraph,
    exact: &Exact,
    format: WordFormat,
    coefficients: Coefficients,
) -> Result<Option<(StepGraph, Exact)>, Vec<Diagnostic>> {
    if coefficients == Coefficients::OneSlot {
        return Ok(None);
    }
    let settled = exact.settle(model, graph, format)?;
    let Some(split) = two_slots::split(graph, settled.fixed()) else { return Ok(None) };
    let split_exact = Exact::run(model, &split, silent())?;
    if coefficients == Coefficients::Auto {
        let fine = split_exact.settle(model, &split, format)?;
        if fine.word_length() > WORTH * settled.word_length() {
            return Ok(None);
        }
    }
    Ok(Some((split, split_exact)))
}
