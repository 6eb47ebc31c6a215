//! Which variable of a product is copied to the coefficient port.
//!
//! The data port takes one variable of a product, the coefficient port a copy of the rest, which has to be computed
//! first. So a copy of what arrives early costs a word, and one of what arrives late costs a word and the latency of a
//! result. When variables arrive depends on the order in which products take them, so a few orders are tried.

use std::collections::{BTreeMap, HashMap};

use pe_ir::graph::{Factor, Role, StepGraph};
use pe_ir::model::Variable;
use pe_ir::source::Diagnostic;
use pe_ir::word::{Latency, Pipeline};

use super::forms::StepOptions;
use crate::mapping::default_pes;
use crate::schedule::{Bound, arrivals};

/// Orders that are tried from each first one; later ones repeat what was tried.
const TRIALS: usize = 3;

/// The latency that orders are judged by, so that a step is the same for all words.
const LATENCY: Latency = Latency { multiplier: 3, pipeline: Pipeline::Short };

/// The words in which variables arrive; those that are not known come first.
#[derive(Clone, Debug, Default)]
pub struct Arrivals(BTreeMap<Variable, i64>);

impl Arrivals {
    /// The word of a variable.
    pub fn of(&self, variable: Variable) -> i64 {
        self.0.get(&variable).copied().unwrap_or(i64::MIN)
    }
}

/// The step with the lowest bound among those that `build` makes of a few arrivals, unless products on the PEs bind
/// anyway. `variables` are the roles of the variables that products take.
///
/// # Errors
/// Those of `build`.
pub fn soonest(
    options: &StepOptions,
    variables: impl Fn() -> Vec<(Variable, Role)>,
    build: impl Fn(&Arrivals) -> Result<StepGraph, Vec<Diagnostic>>,
) -> Result<StepGraph, Vec<Diagnostic>> {
    let mut best = build(&Arrivals::default())?;
    if !best.terms.iter().any(|term| matches!(term.factor, Factor::Value(_))) {
        return Ok(best);
    }
    let pes = options.pes.unwrap_or_else(|| default_pes(&best, LATENCY));
    let bound = Bound::of(&best, pes, LATENCY);
    if bound.recurrence == 0 {
        return Ok(best);
    }
    let words = |bound: Bound| (bound.binding().0, bound.throughput);
    let mut fewest = words(bound);
    let variables = variables();
    let listed = Arrivals(variables.iter().map(|(variable, _)| *variable).zip(0..).collect());
    for first in [arrived(&best, &variables), listed] {
        let mut arrivals = first;
        for _ in 0..TRIALS {
            let graph = build(&arrivals)?;
            let words = words(Bound::of(&graph, pes, LATENCY));
            arrivals = arrived(&graph, &variables);
            if words < fewest {
                (best, fewest) = (graph, words);
            }
        }
    }
    Ok(best)
}

/// When variables arrive in a step.
fn arrived(graph: &StepGraph, variables: &[(Variable, Role)]) -> Arrivals {
    let words: HashMap<_, i64> = (graph.values.iter().zip(arrivals(graph, LATENCY)))
        .filter_map(|(value, word)| Some((key(value.role)?, word)))
        .collect();
    Arrivals(variables.iter().filter_map(|(variable, role)| Some((*variable, *words.get(&key(*role)?)?))).collect())
}

/// What tells the values apart that variables stand for.
fn key(role: Role) -> Option<(u8, u32, u8)> {
    match role {
        Role::State(state) => Some((0, state.number(), 0)),
        Role::Stage(state, stage) => Some((1, state.number(), stage)),
        Role::Next(state) => Some((2, state.number(), 0)),
        Role::Algebraic(algebraic, stage) => Some((3, algebraic, stage)),
        Role::Auxiliary(auxiliary) => Some((4, auxiliary, 0)),
        Role::Pivot(state, matrix) => Some((5, state.number(), matrix)),
        _ => None,
    }
}
