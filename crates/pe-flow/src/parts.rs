//! Steps whose parts are alike: one program for the parts of a PE, where that is cheaper.

use std::sync::Arc;

use pe_hls::mapping;
use pe_hls::rounds::Rounds;
use pe_hls::schedule::Bound;
use pe_ir::graph::StepGraph;
use pe_ir::source::Diagnostic;
use pe_ir::word::{Latency, WordFormat};
use pe_judge::runs::Judged;
use pe_judge::{Coefficients, DesignPoint};

use crate::assembled::{cost, leave_out_proven};
use crate::candidates::{self, Candidates, Network};
use crate::design::{Design, StartResult};
use crate::known::Known;
use crate::selection::{self, Price};
use crate::settings::{MappingOptions, StageLoop};
use crate::spec::LoadedModel;
use crate::watch::Stopwatch;

/// Words of a PE's program from which on another number of blocks may do.
const LONG: u64 = 1024;

/// Products of a step without tables from which on it is large enough for such programs.
const MANY: u64 = 8192;

/// Whether parts that are alike may be looked for.
fn are_allowed(loaded: &LoadedModel, graph: &StepGraph, point: &DesignPoint, options: &MappingOptions) -> bool {
    // Coefficients in two slots are other terms.
    let fits = point.coefficients == Coefficients::OneSlot && loaded.stages.is_none() && options.mapping.is_none();
    options.stage_loop != StageLoop::Off && fits && pe_hls::parts::may_have(graph)
}

/// Whether functions that are the same but for indices shall share tables, so that parts are alike: the same for any number of PEs.
pub fn share_tables(loaded: &LoadedModel, graph: &StepGraph, point: &DesignPoint, options: &MappingOptions) -> bool {
    let is_large = options.stage_loop == StageLoop::On || graph.macs() >= MANY;
    is_large && are_allowed(loaded, graph, point, options)
}

/// The step with its parts arranged alike, if it has any, and its programs may be worth it.
pub fn arranged(
    loaded: &LoadedModel,
    graph: &StepGraph,
    point: &DesignPoint,
    options: &MappingOptions,
    (pes, format): (Option<u32>, WordFormat),
) -> Option<StepGraph> {
    if !are_allowed(loaded, graph, point, options) {
        return None;
    }
    let pes = pes.unwrap_or_else(|| mapping::default_pes(graph, Latency::of(&format)));
    let words = graph.loads().iter().map(|load| u64::from(*load)).sum::<u64>();
    let is_long = options.stage_loop == StageLoop::On || words / u64::from(pes.max(1)) >= LONG;
    is_long.then(|| pe_hls::parts::arranged(graph, pes)).flatten()
}

/// Keeps the items whose index is to be kept.
fn retain<T>(items: &mut Vec<T>, keep: &mut impl FnMut(usize) -> bool) {
    let mut index = 0..;
    items.retain(|_| index.next().is_some_and(&mut *keep));
}

/// Designs the network of a step whose rounds are parts, with warnings about it; not checked. Of the best mapping, and of the
/// best one in which equations with the same tables are together, the one whose program is cheaper. None if there is no mapping
/// without copies of values, or if memories would be beyond what there is.
pub fn implement(
    loaded: &LoadedModel,
    (graph, judged): (&Arc<StepGraph>, &Arc<Judged>),
    rounds: &Rounds,
    network: &Network,
    options: &MappingOptions,
    known: &Known,
    watch: &mut Stopwatch,
) -> Option<(Design, Vec<Diagnostic>)> {
    let latency = Latency::of(&judged.fixed.format);
    let price = Price::of(&judged.fixed.format);
    let part = Arc::new(StepGraph::clone(&rounds.graph));
    let numbers = rounds.formats_of_part(&judged.fixed);
    // As many as the whole step asks for, unless a part has fewer equations.
    let default_pes = network.pes.is_none();
    let pes = network.pes.or_else(|| Some(mapping::default_pes(graph, latency)));
    let network = &Network { pes, ..network.clone() };
    let mapped = watch.stage(
        "map",
        || Candidates::of(&part, &numbers, network, options, known),
        |candidates| match candidates {
            Ok(candidates) => format!("one of {} parts, {}", rounds.count, candidates.figure(false)),
            Err(_) => "impossible".to_owned(),
        },
    );
    let Candidates { alternatives, mut candidates, mut of, mut blocks, gathered, .. } = mapped.ok()?;
    // Copies of values are in no round.
    let copies: Vec<bool> = of.iter().map(|of| alternatives[*of].copies()).collect();
    let mut keep = |index: usize| !copies[index];
    retain(&mut candidates, &mut keep);
    retain(&mut of, &mut keep);
    retain(&mut blocks, &mut keep);
    let plain = candidates.len() - gathered;
    if candidates.is_empty() {
        return None;
    }
    let graphs: Vec<&StepGraph> = candidates.iter().map(|_| &*part).collect();
    let schedules = watch.stage_saying(
        "schedule",
        |say| selection::all_schedules(&graphs, &candidates, (plain, gathered), (latency, price), known, say),
        |schedules: &Vec<_>| selection::shortest(schedules),
    );
    let mut order = selection::order(&candidates, &schedules, &blocks, (plain, gathered), price);
    let best = |is_gathered: bool| order.iter().position(|index| (*index >= plain) == is_gathered);
    // What tables and words of the program take together is known of programs only.
    let places: Vec<usize> = [best(false), best(true)].into_iter().flatten().collect();
    let programs = watch.stage(
        "assemble",
        || {
            let of = |place: &usize| {
                let (taken, round) = (&candidates[order[*place]], &schedules[order[*place]]);
                let mapping = rounds.spread(&taken.mapping);
                let assembled =
                    pe_hls::assemble::assemble_rounds(&loaded.model, graph, &judged.fixed, &mapping, rounds, round);
                let mut program = assembled.ok()?;
                leave_out_proven(&mut program, judged, graph, &mapping);
                Some((*place, mapping, program))
            };
            let programs = places.iter().filter_map(of);
            programs.min_by(|(_, _, one), (_, _, other)| cost(one).total_cmp(&cost(other)))
        },
        |cheapest| match cheapest {
            Some((_, _, program)) => format!("{} PEs, {} rounds of parts", program.pes.len(), program.rounds),
            None => "refused".to_owned(),
        },
    );
    let (place, mapping, program) = programs?;
    order[..=place].rotate_right(1);
    let starts: Vec<StartResult> = (order.iter())
        .map(|index| StartResult::of(&candidates[*index], schedules[*index].period * rounds.count))
        .collect();
    let (taken, round) = (&candidates[order[0]], &schedules[order[0]]);
    let told = candidates::other_than_asked(network, options, &alternatives[of[order[0]]], taken);
    let problem = mapping::Problem::of(graph);
    let design = Design {
        bound: Bound::of(graph, mapping.pes, latency),
        wires: mapping::wire_length(&problem, &mapping),
        cost: problem.cost(&mapping),
        default_pes,
        graph: Arc::clone(graph),
        optimistic: Arc::clone(graph),
        judged: Arc::clone(judged),
        paired: None,
        flat: None,
        schedule: rounds.unroll(graph, round),
        mapping,
        program,
        starts,
        trials: Vec::new(),
    };
    Some((design, told))
}
