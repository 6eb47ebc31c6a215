//! The program of a schedule, as one round or as rounds that are alike.

use pe_hls::assemble::TooLarge;
use pe_hls::rounds::Rounds;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::mapping::Mapping;
use pe_ir::model::Model;
use pe_ir::program::Program;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;
use pe_judge::runs::Judged;
use pe_target::area::{self, Family};

use crate::settings::StageLoop;

/// A program and the schedule that it follows.
pub struct Assembled {
    /// The schedule.
    pub schedule: Schedule,
    /// The schedule before stages that are alike became rounds, where they did.
    pub flat: Option<Schedule>,
    /// The program.
    pub program: Program,
}

/// What a program costs: area in equivalent LUTs times cycles per step.
pub fn cost(program: &Program) -> f64 {
    area::estimate(program, Family::default()).equivalent_luts() * f64::from(program.period)
}

/// Leaves out of a program what its issued step is proven not to need.
pub fn leave_out_proven(program: &mut Program, judged: &Judged, issued: &StepGraph, mapping: &Mapping) {
    match &judged.proof {
        Some(proof) => proof.leave_out(program, issued, mapping),
        None => program.pes.iter_mut().for_each(|pe| pe.features.proven = false),
    }
}

/// Assembles the schedule, or one of rounds that are alike, whichever takes the smaller product of area and cycles.
///
/// # Errors
/// A PE needs more words or ports than there are.
pub fn assemble(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    mapping: &Mapping,
    schedule: Schedule,
    stage_loop: StageLoop,
) -> Result<Assembled, TooLarge> {
    let program = pe_hls::assemble::assemble(model, graph, fixed, mapping, &schedule)?;
    if stage_loop == StageLoop::Off {
        return Ok(Assembled { schedule, flat: None, program });
    }
    let Some(rounds) = Rounds::of(graph, fixed) else { return Ok(Assembled { schedule, flat: None, program }) };
    let round = pe_hls::schedule::schedule(&rounds.graph, mapping, Latency::of(&fixed.format));
    match pe_hls::assemble::assemble_rounds(model, graph, fixed, mapping, &rounds, &round) {
        Ok(looped) if stage_loop == StageLoop::On || cost(&looped) < cost(&program) => {
            Ok(Assembled { schedule: rounds.unroll(graph, &round), flat: Some(schedule), program: looped })
        }
        Err(limit) if stage_loop == StageLoop::On => Err(limit),
        _ => Ok(Assembled { schedule, flat: None, program }),
    }
}
