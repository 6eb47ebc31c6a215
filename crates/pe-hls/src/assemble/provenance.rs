//! Which numbers the coefficients of control words stand for.

use pe_ir::graph::{Factor, StepGraph};
use pe_ir::index::{List, PeId, at};
use pe_ir::mapping::Mapping;
use pe_ir::schedule::Schedule;

/// For each PE and control word the coefficient as the step graph has it, before it was rounded to a word; none where a
/// word multiplies nothing, or two stored words. `schedule` is that of the whole step.
pub fn coefficients(graph: &StepGraph, mapping: &Mapping, schedule: &Schedule) -> List<PeId, Vec<Option<f64>>> {
    let mut words = List::filled(vec![None; at(schedule.period)], at(mapping.pes));
    for (chain, start) in graph.chains.iter().zip(&schedule.starts) {
        let pe = &mut words[mapping.pe_of[chain.equation]];
        for (time, position) in (*start..).zip(chain.terms.clone()) {
            let term = &graph.terms[at(schedule.order[at(position)])];
            if let Factor::Coefficient(number) = term.factor {
                pe[at(time % schedule.period)] = Some(number);
            }
        }
    }
    words
}
