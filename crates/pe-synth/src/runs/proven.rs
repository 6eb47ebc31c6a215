//! Formats in which no value can leave its word, where a bit or two make the proof.

use pe_ir::graph::{Chain, StepGraph, ValueId};
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;

use crate::options::ModelOptions;
use crate::proof::{self, Enclosed, Proof};

use super::{Comparison, Exact, Judged};

/// Formats that are tried: a wider one rounds more, which may ask for another bit.
const TRIES: usize = 4;

/// Most by which wider formats may multiply the word-length error: what two bits cost where rounding is all of it. An
/// error that is small anyway may grow up to [`HARMLESS`].
const ERROR_GROWTH: f64 = 4.0;

/// Word-length error below which wider formats are always worth a proof.
const HARMLESS: f64 = 1e-6;

/// Proves ranges over the span; formats become wider by as many bits as the options allow, if that proves all of them and
/// the word-length error stays near what it was.
///
/// # Errors
/// Those of the runs with other formats.
pub fn prove(
    judged: Judged,
    (exact, comparison): (&Exact, &Comparison),
    model: &Model,
    graph: &StepGraph,
    options: &ModelOptions,
) -> Result<Judged, Vec<Diagnostic>> {
    let word_length = judged.errors.word_length;
    let enclosed = proof::enclose(graph, &judged.fixed, model.steps());
    let as_found = |mut judged: Judged, enclosed| {
        judged.proof = Some(Proof { enclosed, widened: 0, word_length });
        Ok(judged)
    };
    let Some(first) = &enclosed else { return as_found(judged, enclosed) };
    let missing = most_missing(graph, first);
    if missing == 0 || missing > options.widen {
        return as_found(judged, enclosed);
    }
    // The same pairs of operands, or none, as before.
    let alone = StepGraph { pre_adder: judged.fixed.headroom.contains(&true), ..graph.clone() };
    let mut ranges = exact.ranges.clone();
    let mut latest = enclosed.clone();
    for _ in 0..TRIES {
        let Some(found) = &latest else { break };
        for value in written(graph) {
            ranges.widened[value.index()] += found.enclosure.missing(value);
        }
        let widened = ranges.widened.iter().copied().max().unwrap_or(0);
        if widened > options.widen {
            break;
        }
        let Ok(settled) = exact.widened(model, &alone, judged.fixed.format, ranges.clone(), None) else { break };
        latest = proof::enclose(graph, settled.fixed(), model.steps());
        if settled.word_length() > HARMLESS.max(ERROR_GROWTH * word_length) {
            break;
        }
        if latest.as_ref().is_some_and(|found| most_missing(graph, found) == 0) {
            let wider = exact.conclude(model, graph, Ok(settled), Ok(comparison.clone()), options)?;
            return Ok(Judged { proof: Some(Proof { enclosed: latest, widened, word_length }), ..wider });
        }
    }
    as_found(judged, enclosed)
}

/// Values that chains write.
fn written(graph: &StepGraph) -> impl Iterator<Item = ValueId> {
    graph.chains.iter().flat_map(Chain::writes).map(|write| write.value)
}

/// The most bits that a format is too narrow by.
fn most_missing(graph: &StepGraph, enclosed: &Enclosed) -> i32 {
    written(graph).map(|value| enclosed.enclosure.missing(value)).max().unwrap_or(0)
}
