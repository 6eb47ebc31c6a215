//! Angles: whether a step follows them, and what functions of them reach whatever a run does.

use std::collections::{HashMap, HashSet};

use pe_ir::codes;
use pe_ir::graph::{Factor, Role, StepGraph, ValueId};
use pe_ir::index::{self, StateId};
use pe_ir::mechanism::of_point;
use pe_ir::model::{Model, Variable};
use pe_ir::source::Diagnostic;
use pe_ir::turns::{HALF, LONGEST_MOVE, REACH};

/// Points at which a function of an angle is looked at.
const PROBES: i32 = 512;

/// Variables of a model by their names: where linear systems are eliminated, those of the step have other numbers, and the
/// implicit step of a mechanism evaluates them at points of its own.
struct Numbers<'a> {
    model: &'a Model,
    algebraics: HashMap<&'a str, u32>,
    angles: HashSet<&'a str>,
}

impl Numbers<'_> {
    fn of(model: &Model) -> Numbers<'_> {
        let names = (0..).zip(&model.algebraics).map(|(number, algebraic)| (algebraic.name.as_str(), number));
        let angles = model.states.iter().filter(|state| state.angle).map(|state| state.name.as_str());
        Numbers { model, algebraics: names.collect(), angles: angles.collect() }
    }

    /// The number in the model of an algebraic variable of the step, or of what it is at a point.
    fn find(&self, graph: &StepGraph, algebraic: u32) -> Option<u32> {
        let name = graph.names.algebraics[index::at(algebraic)].as_str();
        let own = self.algebraics.get(name);
        own.or_else(|| self.algebraics.get(of_point(name)?)).copied()
    }

    /// Number of turns that an algebraic variable of the step reaches, if it is an angle or a sum of angles.
    fn turns(&self, graph: &StepGraph, algebraic: u32) -> Option<f64> {
        if let Some(number) = self.find(graph, algebraic) {
            return self.model.turns_of_sum(number);
        }
        let own = of_point(&graph.names.algebraics[index::at(algebraic)])?;
        self.angles.contains(own).then_some(REACH)
    }
}

/// Whether no angle moves so far in a step that it cannot be told from which side it came. `largest` are the magnitudes of
/// the values of a run.
pub(crate) fn followed(model: &Model, graph: &StepGraph, largest: &[f64]) -> Result<(), Vec<Diagnostic>> {
    let mut findings = Vec::new();
    for (state, (start, end)) in model.states.iter().zip(&graph.states).filter(|(state, _)| state.angle) {
        let moved = largest[start.index()].max(largest[end.index()]) - HALF;
        if moved > LONGEST_MOVE {
            let message = format!(
                "`{}` moves by more than {LONGEST_MOVE} turns in a step of {:e} s: whole turns cannot be told",
                state.name, model.step
            );
            let help = format!("take a shorter step, for example `--step {:.1e}`", 0.2 * model.step / moved);
            findings.push(Diagnostic::error(codes::ANGLE_TOO_FAST, state.span, message).with_help(help));
        }
    }
    if findings.is_empty() { Ok(()) } else { Err(findings) }
}

/// Widens the arguments of functions of angles to what these may be, whatever the run does.
pub(crate) fn include_arguments(model: &Model, graph: &StepGraph, arguments: &mut [(f64, f64)]) {
    if !model.has_angles() {
        return;
    }
    let producers = graph.producers();
    let numbers = Numbers::of(model);
    let of_state = |state: StateId| model.states.find(state).is_some_and(|state| state.angle).then_some(REACH);
    let angle = |value: ValueId| match graph.value(value).role {
        Role::State(state) | Role::Stage(state, _) | Role::Next(state) => of_state(state),
        Role::Algebraic(algebraic, _) => numbers.turns(graph, algebraic),
        // What is added to an angle is one.
        _ => producers[value.index()].and_then(|chain| {
            let base = graph.chains[chain].writes().find(|write| write.value == value)?.base?;
            match graph.value(base).role {
                Role::State(state) => of_state(state),
                _ => None,
            }
        }),
    };
    for chain in graph.chains.iter().filter(|chain| chain.function.is_some()) {
        let reach = graph.chain_terms(chain).iter().map(|term| match term.factor {
            Factor::Coefficient(factor) if term.partner.is_none() => Some(factor.abs() * angle(term.operand)?),
            _ => None,
        });
        let Some(reach) = reach.sum::<Option<f64>>().filter(|_| chain.write.weight == 0) else { continue };
        let base = chain.write.base.map_or(Some(0.0), |base| match graph.value(base).role {
            Role::Constant(number) => Some(number),
            _ => angle(base).map(|_| 0.0),
        });
        let Some(base) = base else { continue };
        let own = &mut arguments[chain.write.value.index()];
        *own = (own.0.min(base - reach), own.1.max(base + reach));
    }
}

/// The algebraic values that are angles or sums of angles, each with the number of turns that it reaches.
pub(crate) fn sums(model: &Model, graph: &StepGraph) -> Vec<(ValueId, f64)> {
    if !model.has_angles() {
        return Vec::new();
    }
    let numbers = Numbers::of(model);
    let values = graph.values.iter().enumerate().filter_map(|(value, own)| match own.role {
        Role::Algebraic(algebraic, _) => Some((ValueId::at(value), numbers.turns(graph, algebraic)?)),
        _ => None,
    });
    values.collect()
}

/// The values that are functions of an angle alone, each with the largest magnitude that it has for any angle.
pub(crate) fn functions(model: &Model, graph: &StepGraph) -> Vec<(ValueId, f64)> {
    if !model.has_angles() {
        return Vec::new();
    }
    let numbers = Numbers::of(model);
    let reach = |variable: Variable| match variable {
        Variable::State(state) => model.states.find(state).is_some_and(|state| state.angle).then_some(REACH),
        Variable::Algebraic(algebraic) => model.turns_of_sum(algebraic),
        Variable::Input(_) => None,
    };
    let largest: HashMap<u32, f64> = (0..)
        .zip(&model.algebraics)
        .filter(|(_, algebraic)| !algebraic.expr.is_polynomial())
        .filter_map(|(number, algebraic)| {
            let (mut read, mut others) = (None, false);
            algebraic.expr.each_variable(&mut |variable| {
                others |= read.is_some_and(|read| read != variable);
                read = Some(variable);
            });
            let reach = reach(read.filter(|_| !others)?)?;
            let at = |probe: i32| algebraic.expr.evaluate(&|_| reach * f64::from(probe) / f64::from(PROBES)).abs();
            Some((number, (-PROBES..=PROBES).map(at).filter(|value| value.is_finite()).fold(0.0, f64::max)))
        })
        .collect();
    let values = graph.values.iter().enumerate().filter_map(|(value, own)| match own.role {
        Role::Algebraic(algebraic, _) => Some((ValueId::at(value), *largest.get(&numbers.find(graph, algebraic)?)?)),
        _ => None,
    });
    values.collect()
}
