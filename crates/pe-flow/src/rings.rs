//! A step whose long rows of past words are rings, with what the runs found about it.

use std::sync::Arc;

use pe_hls::rings::{Choice, Ringed, rings};
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_judge::proof;
use pe_judge::runs::Judged;

use crate::settings::MappingOptions;

/// The step with rings, and what the runs found, by its values; none if no row becomes one.
pub fn with_rings(
    model: &Model,
    graph: &StepGraph,
    judged: &Judged,
    options: &MappingOptions,
) -> Option<(Arc<StepGraph>, Arc<Judged>)> {
    // Parameters that a host writes are states, and states that it replaces are in no ring.
    let choice = if model.tunables().next().is_some() { Choice::Chains } else { options.rings };
    let ringed = rings(graph, &judged.fixed, choice)?;
    let largest = ringed.of_values(&judged.largest);
    let Ringed { graph, fixed, .. } = ringed;
    let mut judged = Judged { fixed, largest, ..Judged::clone(judged) };
    if let Some(proof) = &mut judged.proof {
        proof.enclosed = proof::enclose(&graph, &judged.fixed, model.steps());
    }
    Some((graph, Arc::new(judged)))
}
