//! Mapping of equations to PEs.
//!
//! Goes in: loads and dependencies of the equations ([`Problem`]) and a number of PEs. Comes out: mappings that use
//! every PE, annealed from several starts, the best one first. What counts is the largest load of a PE (the cycles of
//! a step, as transfers overlap with computation) times the number of connections, the objective of Huang, Vahid and
//! Givargis, "Automatic Synthesis of Physical System Differential Equation Models to a Custom Network of General
//! Processing Elements on FPGAs", ACM TECS 13(2), article 23 (2013), doi 10.1145/2514641.2514650, section 5.2;
//! in-degrees above the limit count before either.
//!
//! Their annealer begins at a random mapping. That start is kept; beside it stand starts found from the structure of
//! the dependency graph (runs of linear orders, recursive bisection), which already have few connections on chains,
//! grids and trees and need only little annealing.

mod alike;
mod anneal;
mod blocks;
mod cost;
mod gather;
#[cfg(test)]
mod grids;
mod links;
mod neighbours;
mod orders;
mod problem;
mod random;
mod regions;
mod sets;
mod starts;
mod tiles;
mod wires;

use std::fmt;

use pe_ir::graph::StepGraph;
use pe_ir::index::{EquationId, List, PeId, number};
use pe_ir::mapping::{Mapping, MappingCost};
use pe_ir::word::Latency;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::schedule::Bound;
use anneal::{Plan, anneal, rank};
pub use gather::{TABLES, TEAMS, Tables, gathered, in_teams};
pub use problem::Problem;
pub use wires::{WireLength, wire_length};

/// What to map to, and how long to try.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MapOptions {
    /// Number of PEs; every one gets an equation.
    pub pes: u32,
    /// Seed of the random numbers; the same seed gives the same mappings.
    pub seed: u64,
    /// Moves tried over all starts.
    pub tries: u64,
    /// Largest number of input ports of a PE: other PEs and external inputs that it reads.
    pub max_in_degree: u32,
}

impl MapOptions {
    /// Largest in-degree unless told otherwise, that of the PEs of Huang, Vahid and Givargis.
    pub const DEFAULT_MAX_IN_DEGREE: u32 = 15;

    /// A budget that takes about a second for 5,000 equations and several for 100,000.
    pub fn default_tries(equations: u32) -> u64 {
        let equations = u64::from(equations);
        (20_000 + 1_000 * equations).min(4_000_000 + 60 * equations)
    }
}

/// Words of a step per PE that the default number of PEs aims at: small designs stay small, large ones fit a large
/// device.
const DEFAULT_WORDS_PER_PE: u64 = 200;

/// Part of the words of a step, in percent, that PEs fill at least where states cannot follow from states any faster.
const FILLED: u64 = 80;

/// The default number of PEs: one for so many words, but only as many as make a step shorter.
pub fn default_pes(graph: &StepGraph, latency: Latency) -> u32 {
    let words: u64 = graph.loads().iter().map(|load| u64::from(*load)).sum();
    let by_words = words.div_ceil(DEFAULT_WORDS_PER_PE).clamp(1, graph.equations.len() as u64) as u32;
    let useful = match Bound::of(graph, by_words, latency).recurrence {
        0 => u64::from(by_words),
        cycles => (words * 100).div_ceil(u64::from(cycles) * FILLED),
    };
    useful.clamp(1, u64::from(by_words)) as u32
}

/// A mapping and where it comes from.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The mapping.
    pub mapping: Mapping,
    /// Its cost.
    pub cost: MappingCost,
    /// Name of its start.
    pub start: &'static str,
    /// Cost of its start before annealing.
    pub start_cost: MappingCost,
}

/// Why there is no mapping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapError {
    /// The number of PEs is 0 or larger than the number of equations.
    Pes {
        /// The number of PEs.
        pes: u32,
        /// The number of equations.
        equations: u32,
    },
    /// No mapping was found whose in-degrees are all within the limit.
    InDegree {
        /// A PE above the limit in the best mapping.
        pe: PeId,
        /// The equation on it that reads from most places; an index into the step graph's equations.
        equation: EquationId,
        /// Its in-degree.
        degree: u32,
        /// The limit.
        limit: u32,
    },
}

impl fmt::Display for MapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            MapError::Pes { pes: 0, .. } => write!(f, "cannot map to 0 PEs; use at least 1"),
            MapError::Pes { pes, equations } => {
                write!(f, "cannot map {equations} equations to {pes} PEs; use at most {equations}")
            }
            MapError::InDegree { pe, equation, degree, limit } => write!(
                f,
                "PE {pe}, which holds equation {equation}, needs {degree} input ports and may have {limit}; \
                 use fewer PEs or raise the limit"
            ),
        }
    }
}

impl std::error::Error for MapError {}

/// Name of the start that is random.
pub const RANDOM: &str = "random";
/// Name of the random start after more annealing, with regions cut anew.
pub const REGIONS: &str = "regions";
/// Stream of the random numbers of its annealing.
const REGIONS_STREAM: u64 = 2;
/// Name of the mapping that a step was cut for.
pub const GRID: &str = "grid";
/// Name of the start of a mapping that is given.
pub const GIVEN: &str = "given";

/// Temperature and weight of the harmonic sum at the beginning: from a random start, and from one with structure.
const RANDOM_BEGIN: (f64, f64) = (1.0, 1.0);
const STRUCTURED_BEGIN: (f64, f64) = (0.3, 0.1);
/// Load above the mean that is no overload until the annealer tightens the cap: 1 / 64 of the mean.
const SLACK: u64 = 64;

/// Maps the equations to PEs: one candidate per distinct start, the best first, and one from the random start with
/// regions cut anew. The candidate from the random start is always among them.
///
/// A quarter of the tries goes to the random start, another is shared by the others, and the rest goes to the best
/// mapping that annealing has made better than its start; the others are starts that seem to be at an optimum already.
/// Region moves get as much as the random start on top.
///
/// # Errors
/// No mapping has the number of PEs, or none has in-degrees within the limit.
pub fn map(problem: &Problem, options: &MapOptions) -> Result<Vec<Candidate>, MapError> {
    within(problem, options, annealed(problem, options)?)
}

/// Mappings whose in-degrees are within the limit.
///
/// # Errors
/// Those of the best one are not.
pub fn within(problem: &Problem, options: &MapOptions, candidates: Vec<Candidate>) -> Result<Vec<Candidate>, MapError> {
    match candidates[0].cost.max_in_degree > options.max_in_degree {
        true => Err(in_degree_error(problem, &candidates[0].mapping, options.max_in_degree)),
        false => Ok(candidates),
    }
}

/// The mappings of [`map`], whether or not their in-degrees are within the limit.
///
/// # Errors
/// No mapping has the number of PEs.
pub fn annealed(problem: &Problem, options: &MapOptions) -> Result<Vec<Candidate>, MapError> {
    let &MapOptions { pes, max_in_degree, tries, .. } = options;
    if pes == 0 || pes > problem.equations() {
        return Err(MapError::Pes { pes, equations: problem.equations() });
    }
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let packed = starts::packed_load(problem, pes);
    let mean = problem.total_load() / u64::from(pes);
    let loose = packed.max((mean + mean / SLACK) as u32);
    let plan = |tries, (hot, spread)| Plan { tries, hot, spread, caps: (loose, packed), max_in_degree, regions: false };

    let random = starts::random(problem, pes, options.seed);
    let structured = starts::structured(problem, pes);
    let share = tries / 4 / structured.len() as u64;
    let plans = std::iter::once(plan(tries / 4, RANDOM_BEGIN)).chain(std::iter::repeat(plan(share, STRUCTURED_BEGIN)));
    let mut candidates: Vec<Candidate> = std::iter::once((RANDOM, random))
        .chain(structured)
        .zip(plans)
        .map(|((start, begin), plan)| {
            let (mapping, cost) = anneal(problem, &begin, &plan, None, &mut rng);
            Candidate { mapping, cost, start, start_cost: problem.cost(&begin) }
        })
        .collect();
    candidates.sort_by_key(|candidate| rank(&candidate.cost, max_in_degree));
    if let Some(finalist) = candidates.iter_mut().find(|candidate| candidate.cost != candidate.start_cost) {
        let plan = plan(tries / 2, STRUCTURED_BEGIN);
        (finalist.mapping, finalist.cost) = anneal(problem, &finalist.mapping, &plan, None, &mut rng);
    }
    if pes > 1 {
        let random = candidates.iter().find(|candidate| candidate.start == RANDOM).expect("annealed above");
        let plan = Plan { regions: true, ..plan(tries / 4, RANDOM_BEGIN) };
        // Random numbers of its own: the other candidates do not depend on it.
        rng.set_stream(REGIONS_STREAM);
        let (mapping, cost) = anneal(problem, &random.mapping, &plan, None, &mut rng);
        candidates.push(Candidate { mapping, cost, start: REGIONS, start_cost: random.start_cost });
    }
    candidates.sort_by_key(|candidate| rank(&candidate.cost, max_in_degree));
    Ok(candidates)
}

/// The candidate of a mapping that is given, which is not changed.
///
/// # Errors
/// Some PE has more input ports than the limit.
pub fn given(problem: &Problem, mapping: &Mapping, max_in_degree: u32) -> Result<Candidate, MapError> {
    let cost = problem.cost(mapping);
    if cost.max_in_degree > max_in_degree {
        return Err(in_degree_error(problem, mapping, max_in_degree));
    }
    Ok(Candidate { mapping: mapping.clone(), cost, start: GIVEN, start_cost: cost })
}

/// The mapping of a step that was cut to suit one: that of the places that its equations have, if all have one and no PE is
/// without.
pub fn placed(graph: &StepGraph) -> Option<Mapping> {
    let pe_of: Option<List<EquationId, PeId>> = graph.equations.iter().map(|equation| equation.place).collect();
    let pe_of = pe_of?;
    let mut used: Vec<PeId> = pe_of.iter().copied().collect();
    used.sort_unstable();
    used.dedup();
    let pes = number(used.len());
    (used.last().map(|last| last.index() + 1) == Some(used.len())).then_some(Mapping { pes, pe_of })
}

/// The error about the PE of a mapping with the largest in-degree.
fn in_degree_error(problem: &Problem, mapping: &Mapping, limit: u32) -> MapError {
    let sources = problem.sources(mapping);
    let worst = sources.chunk_by(|left, right| left.0 == right.0).max_by_key(|sources| sources.len());
    let (pe, degree) = worst.map_or((PeId::new(0), 0), |sources| (sources[0].0, number(sources.len())));
    let reads = |equation: &EquationId| {
        problem.neighbours(equation.index()).iter().filter(|neighbour| neighbour.reads() == 1).count()
    };
    let equations = mapping.pe_of.ids().filter(|&equation| mapping.pe_of[equation] == pe);
    let equation = equations.max_by_key(reads).unwrap_or(EquationId::new(0));
    MapError::InDegree { pe, equation, degree, limit }
}
