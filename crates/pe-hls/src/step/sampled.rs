//! The step of a model with sampled parts.
//!
//! A step begins with the samples that are due: all sampled states take their next values, computed from everything as
//! it was before. The rest of the step is that of the continuous part by its method, in any form, for which sampled
//! states are inputs. A state with a period of several steps adds its change times a tick in every step ([`ticked`], or
//! `tick*(next - state)`); the tick of a rate is an input of the step graph, exactly 1 or 0 ([`Model::ticks`]).

use std::collections::{BTreeMap, HashMap};

use petgraph::algo::tarjan_scc;
use petgraph::graph::{DiGraph, NodeIndex};

use pe_ir::codes;
use pe_ir::graph::{Role, StageForm, StepGraph, Value, ValueId};
use pe_ir::index::{self, EquationId, List, StateId, at};
use pe_ir::model::{Expr, Model, Rate, Variable};
use pe_ir::source::Diagnostic;

use super::append;
use super::arrival::Arrivals;
use super::builder::push;
use super::forms::StepOptions;
use super::plan::{Plan, Point, of, times};
use super::planned::{self, can_overwrite};
use super::prune::prune;
use super::ticked;
use crate::pairs;

/// Number of the point before a sample, in names of algebraic variables.
const BEFORE: u8 = 0;

/// Steps from one sample to the next, at most: VHDL's naturals count no further.
const MOST_STEPS: u64 = i32::MAX as u64;

/// Builds the step graph of a model with sampled parts; `continuous_part` builds that of the rest.
///
/// # Errors
/// Those of the continuous part, `E0801` for a sampled equation that expands to too many products, `E0805` for a form
/// that was asked for, `E0807` for a period that is no whole number of steps.
pub fn build(
    model: &Model,
    options: &StepOptions,
    continuous_part: fn(&Model, &StepOptions) -> Result<StepGraph, Vec<Diagnostic>>,
) -> Result<StepGraph, Vec<Diagnostic>> {
    check(model)?;
    let ticking = model.with_ticks();
    let continuous = model.continuous_states();
    if continuous == 0 {
        // Its one form depends on the equations: with ticks or without them it may be another.
        let form = options.form.filter(|form| !matches!(form, StageForm::Method | StageForm::Euler));
        let graph = planned::build(samples(&ticking, false), &StepOptions { form, ..*options })?;
        return Ok(StepGraph { stages: 1, ..graph });
    }
    // Stages beside sampled parts are not shared.
    let rest = continuous_part(&model.continuous(), &StepOptions { sums: false, ..*options })?;
    let mut first = planned::chains(&samples(&ticking, false), options, &Arrivals::default())?.0.graph;
    if !rest.swaps() && !can_overwrite(&first) {
        first = planned::chains(&samples(&ticking, true), options, &Arrivals::default())?.0.graph;
    }
    let mut graph = joined(first, rest, continuous);
    for (index, output) in model.outputs.iter().enumerate() {
        if let Variable::State(state) = output.variable {
            graph.outputs[index] = graph.states[state].1;
        }
    }
    let mut graph = prune(graph);
    graph.pre_adder = options.pre_adder && pairs::worthwhile(&graph);
    Ok(graph)
}

/// Whether every period is a whole number of steps.
fn check(model: &Model) -> Result<(), Vec<Diagnostic>> {
    if let (Some(rate), false) = (model.rates.first(), model.phases.is_empty()) {
        let message = "a model with sampled parts has a list of steps";
        let help = "take a single step that divides every period";
        return Err(vec![Diagnostic::error(codes::UNSUITABLE_PERIOD, rate.span, message).with_help(help)]);
    }
    if let Some((rate, steps)) = model.ticks().find(|(_, steps)| *steps > MOST_STEPS) {
        let Rate { period, span } = model.rates[at(rate)];
        let message = format!("a period of {period} s is {steps} steps; a tick counts {MOST_STEPS} at most");
        let help = "take a longer step, or a shorter period";
        return Err(vec![Diagnostic::error(codes::UNSUITABLE_PERIOD, span, message).with_help(help)]);
    }
    let Some((Rate { period, span }, suitable)) = model.unsuitable_rate() else { return Ok(()) };
    let message = format!(
        "a period of {period} s is {:.6} steps of {} s; it must be a whole number",
        period / model.step,
        model.step
    );
    let help = match suitable {
        Some(step) => format!("take a step that divides all periods, for example `--step {step:e}`"),
        None => "choose periods that have a common divisor, and a step that divides it".to_owned(),
    };
    Err(vec![Diagnostic::error(codes::UNSUITABLE_PERIOD, span, message).with_help(help)])
}

/// The chains that compute what sampled states are after the samples. With `apart`, those that are sampled in every
/// step and read one another in a circle are computed apart and moved into place afterwards.
fn samples(model: &Model, apart: bool) -> Plan<'_> {
    let mut plan = Plan::new(model);
    let before = model.states.ids().map(Variable::State).collect();
    let mut point = Point::new(before, BEFORE);
    let sampled = model.states.ids().skip(model.continuous_states());
    let ticks: BTreeMap<u32, u32> = model.ticks().map(|(rate, _)| rate).zip(tick_inputs(model)).collect();
    let circles = circles(model);
    for (rate, tick) in &ticks {
        // States that only read themselves change by as little as their change is rounded to.
        let coupled = circles.iter().zip(&model.states).any(|(size, state)| *size > 1 && state.rate == Some(*rate));
        if coupled {
            ticked::ends(&mut plan, *rate, Variable::Input(*tick));
        }
    }
    let rest: Vec<StateId> = sampled.filter(|index| plan.ends[*index].is_none()).collect();
    let readers = rest.iter().map(|index| &model.states[*index].derivative);
    plan.algebraics(&mut point, readers, false);
    let mut moved = Vec::new();
    for index in rest {
        let state = &model.states[index];
        let own = Variable::State(index);
        let next = state.derivative.renamed(&|variable| point.variable(variable));
        let change = || Expr::sum(vec![next.clone(), times(-1.0, own)]);
        match state.rate.and_then(|rate| ticks.get(&rate)) {
            Some(tick) => {
                plan.end(index, Some(own), Expr::product(vec![of(Variable::Input(*tick)), change()]));
            }
            None if apart && circles[index.index()] > 0 => {
                moved.push((index, plan.added(index, format!("{}.change", state.name), own, change())));
            }
            None if circles[index.index()] > 0 => {
                plan.end(index, Some(own), change());
            }
            None => {
                plan.end(index, None, next);
            }
        }
    }
    for (number, next) in moved {
        plan.end(number, Some(next), Expr::Constant(0.0));
    }
    plan
}

/// Numbers of the inputs that ticks are.
fn tick_inputs(model: &Model) -> impl Iterator<Item = u32> {
    let all = index::number(model.inputs.len());
    all - index::number(model.ticks().count())..all
}

/// For each state how many sampled states read one another in the circle that it is part of; 0 for those that take no
/// part in what they become. The others are written as what they were plus a change, so that rounding is not lost but
/// carried on to the next sample: a filter comes to rest (`docs/decisions/0031-sampled-parts.md`).
fn circles(model: &Model) -> Vec<usize> {
    let mut sizes = vec![0; model.states.len()];
    for circle in coupled(model) {
        circle.iter().for_each(|state| sizes[*state] = circle.len());
    }
    sizes
}

/// The sampled states that take part in what they become, those together that read one another in a circle.
pub fn coupled(model: &Model) -> Vec<Vec<usize>> {
    let states = model.states.len();
    let first = model.continuous_states();
    let mut reads = DiGraph::<(), ()>::with_capacity(states + model.algebraics.len(), 0);
    (0..states + model.algebraics.len()).for_each(|_| _ = reads.add_node(()));
    let mut arcs = |from: usize, expr: &Expr| {
        expr.each_variable(&mut |variable| {
            let to = match variable {
                Variable::State(state) if state.index() >= first => state.index(),
                Variable::Algebraic(algebraic) => states + at(algebraic),
                _ => return,
            };
            reads.add_edge(NodeIndex::new(from), NodeIndex::new(to), ());
        });
    };
    model.states.iter().enumerate().skip(first).for_each(|(index, state)| arcs(index, &state.derivative));
    model.algebraics.iter().enumerate().for_each(|(index, algebraic)| arcs(states + index, &algebraic.expr));
    let recursive = |circle: &Vec<NodeIndex>| circle.len() > 1 || reads.contains_edge(circle[0], circle[0]);
    let states_of = |circle: Vec<NodeIndex>| {
        let mut of: Vec<usize> = circle.iter().map(|node| node.index()).filter(|node| *node < states).collect();
        of.sort_unstable();
        of
    };
    tarjan_scc(&reads).into_iter().filter(recursive).map(states_of).collect()
}

/// The chains of the samples, then those of the continuous part, whose last inputs are the sampled states.
fn joined(first: StepGraph, rest: StepGraph, continuous: usize) -> StepGraph {
    let mut graph = first;
    let sampled = graph.states.len() - continuous;
    let inputs = rest.inputs.len() - sampled;
    let states = index::number(graph.states.len());
    let auxiliaries = index::number(graph.names.auxiliaries.len());
    // Names of equations are distinct, and none of the rest is lost: only an input that is an output has none here.
    let known: HashMap<String, EquationId> =
        graph.equations.numbered().map(|(number, equation)| (equation.name.clone(), number)).collect();
    let equations: List<EquationId, EquationId> = rest
        .equations
        .iter()
        .map(|equation| known.get(&equation.name).copied().unwrap_or_else(|| graph.equations.push(equation.clone())))
        .collect();
    let owner = |value: &Value| value.equation.map(|equation| equations[equation]);
    let state = |state: StateId| if state.index() < continuous { state } else { state.behind(index::number(sampled)) };
    let memories: Vec<(ValueId, ValueId)> = rest
        .states
        .numbered()
        .skip(continuous)
        .map(|(memory, (start, _))| {
            let number = state(memory);
            let owner = owner(rest.value(*start));
            (push(&mut graph, Role::State(number), owner, false), push(&mut graph, Role::Next(number), owner, false))
        })
        .collect();
    graph.states.extend(memories);
    graph.initial.extend(rest.initial.iter().skip(continuous).copied());
    graph.names.states.extend(rest.names.states.iter().skip(continuous).cloned());
    graph.names.auxiliaries.extend_from_slice(&rest.names.auxiliaries);
    debug_assert_eq!(at(states), continuous + sampled);
    let values: Vec<ValueId> = rest
        .values
        .iter()
        .map(|value| {
            let role = match value.role {
                Role::State(number) => return graph.states[state(number)].0,
                Role::Next(number) => return graph.states[state(number)].1,
                Role::Input(number) => {
                    return match at(number).checked_sub(inputs) {
                        None => graph.inputs[at(number)],
                        Some(held) => graph.states[StateId::at(continuous + held)].1,
                    };
                }
                Role::Auxiliary(number) => Role::Auxiliary(auxiliaries + number),
                Role::Inner(number, serial) => Role::Inner(equations[number], serial),
                Role::Partial(number, serial) => Role::Partial(equations[number], serial),
                role => role,
            };
            push(&mut graph, role, owner(value), value.factor)
        })
        .collect();
    let id = |value: ValueId| values[value.index()];
    append::chains(&mut graph, &rest, &values, &equations);
    graph.outputs = rest.outputs.iter().copied().map(id).collect();
    (graph.form, graph.stages, graph.forms) = (rest.form, rest.stages, rest.forms);
    graph
}
