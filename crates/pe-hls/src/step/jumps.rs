//! The step of a model with events: what the method makes of a step, then the jumps at its end.
//!
//! The step of the model without jumps is built in any form. What states are at its end has another name in it, and
//! chains behind it add the jumps. They read states and algebraic variables as they are there; what is published is computed from
//! states behind the jumps (`docs/decisions/0088-events.md`).

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::graph::{Role, StageForm, StepGraph, Value, ValueId};
use pe_ir::index::{self, EquationId, List, StateId, at};
use pe_ir::model::{Expr, Model, Output, Select, Solver, Variable};
use pe_ir::motion::Motion;
use pe_ir::source::Diagnostic;

use super::append;
use super::arrival::Arrivals;
use super::builder::Builder;
use super::forms::StepOptions;
use super::plan::{Plan, Point};
use super::planned::{self, can_overwrite};
use super::prune::prune;
use super::still;
use crate::kinks::affine;
use crate::pairs;

/// Number of the point before jumps, in names of algebraic variables.
const BEFORE: u8 = u8::MAX - 1;

/// Part of a step by which times may be off a step for being rounded numbers.
const TIME_SLACK: f64 = 1e-6;

/// Steps of a delay, at most.
const MOST_STEPS: f64 = 1_048_576.0;

/// Builds the step graph of a model with jumps; `smooth` builds that of the model without them.
///
/// # Errors
/// Those of the rest, `E0801` for a jump that expands to too many products.
pub fn build(
    model: &Model,
    options: &StepOptions,
    smooth: fn(&Model, &StepOptions) -> Result<StepGraph, Vec<Diagnostic>>,
) -> Result<StepGraph, Vec<Diagnostic>> {
    let mut without = model.without_jumps();
    let first = StateId::new(0);
    let output = Output {
        name: model.states[first].name.clone(),
        variable: Variable::State(first),
        span: model.states[first].span,
    };
    without.outputs = vec![output];
    // Stages that share sums would carry a jump into the next step.
    let rest = smooth(&without, &StepOptions { sums: false, ..*options })?;
    let timed = on_steps(model);
    let (jumps, outputs) = chains(&timed, options)?;
    let mut graph = still::leave_out(joined(model, rest, (jumps, outputs)));
    if !graph.swaps() && !can_overwrite(&graph) {
        (graph.form, graph.stages) = (StageForm::Euler, 1);
    }
    let mut graph = prune(graph);
    graph.pre_adder = options.pre_adder && pairs::worthwhile(&graph);
    Ok(graph)
}

/// A method that keeps slopes of earlier steps would go on with those from before an event, and delays count steps.
///
/// # Errors
/// `E0806` for such a method, `E0412` for a delay that is no whole number of steps.
pub fn check(model: &Model) -> Result<(), Vec<Diagnostic>> {
    let jumping = model.states.iter().find(|state| state.jump.is_some());
    let keeps = matches!(model.solver, Solver::Ab2 | Solver::Ab3 | Solver::Ab4);
    match jumping.filter(|_| keeps) {
        None => whole_delays(model),
        Some(state) => {
            let message = format!(
                "`{}` keeps slopes of earlier steps, which are none of what an event makes",
                model.solver.name()
            );
            let help = "take a method that begins anew with every step, such as `solver rk4`";
            Err(vec![Diagnostic::error(codes::UNSUITABLE_SOLVER, state.span, message).with_help(help)])
        }
    }
}

fn whole_delays(model: &Model) -> Result<(), Vec<Diagnostic>> {
    let mut findings: Vec<Diagnostic> = Vec::new();
    for (state, seconds) in model.waits() {
        let steps = seconds / model.step;
        let whole = libm::round(steps);
        let span = model.states[state].span;
        // An event has several places to wait in.
        let is_told = findings.iter().any(|finding| finding.span == Some(span));
        if is_told || (0.0..=MOST_STEPS).contains(&whole) && (steps - whole).abs() <= TIME_SLACK * whole.max(1.0) {
            continue;
        }
        let message =
            format!("a delay of {seconds} s is {steps} steps; it must be a whole number, at most {MOST_STEPS}");
        let help = match model.suitable_step(model.step) {
            Some(step) if step < model.step => {
                format!("take a step that divides all delays, for example `--step {step:e}`")
            }
            _ => "take a step of which the delay is a multiple".to_owned(),
        };
        findings.push(Diagnostic::error(codes::EVENT_DELAY, span, message).with_help(help));
    }
    if findings.is_empty() { Ok(()) } else { Err(findings) }
}

/// How much a variable grows in a step, if it is the time in some unit.
fn per_step(model: &Model, variable: Variable) -> Option<f64> {
    match variable {
        Variable::State(state) if model.states[state].motion == Some(Motion::Clock) => {
            Some(model.states[state].derivative.as_constant()? * model.step)
        }
        Variable::Algebraic(number) => {
            let expr = &model.algebraics[at(number)].expr;
            let mut read = None;
            expr.each_variable(&mut |variable| read = Some(variable));
            let (slope, offset) = affine(expr)?;
            (offset == 0.0).then_some(slope * per_step(model, read?)?)
        }
        _ => None,
    }
}

/// The model whose jumps compare times between two steps wherever they would compare them at one: there the rounding of the
/// time would decide. What becomes true behind a time, as `time > 1` does, does so at that time. Choices that derivatives or
/// outputs read stay as they are.
fn on_steps(model: &Model) -> Model {
    let mut timed = model.clone();
    let mut seen = vec![false; model.algebraics.len()];
    let mut waiting: Vec<Variable> = model.outputs.iter().map(|output| output.variable).collect();
    model.states.iter().for_each(|state| state.derivative.each_variable(&mut |read| waiting.push(read)));
    while let Some(variable) = waiting.pop() {
        if let Variable::Algebraic(number) = variable
            && !std::mem::replace(&mut seen[at(number)], true)
        {
            model.algebraics[at(number)].expr.each_variable(&mut |read| waiting.push(read));
        }
    }
    for (algebraic, _) in timed.algebraics.iter_mut().zip(seen).filter(|(_, seen)| !seen) {
        if let Some(expr) = between(model, &algebraic.expr) {
            algebraic.expr = expr;
        }
    }
    timed
}

/// An equation in which times at steps are between steps, if it is a choice by them.
fn between(model: &Model, expr: &Expr) -> Option<Expr> {
    let Expr::Select(select) = expr else { return None };
    let Select { condition, yes, no } = &**select;
    let (yes_timed, no_timed) = (between(model, yes), between(model, no));
    let mut read = None;
    condition.each_variable(&mut |variable| read = Some(variable));
    let shift =
        affine(condition).zip(read.and_then(|read| per_step(model, read))).and_then(|((slope, offset), grows)| {
            let in_step = slope * grows;
            let place = -offset / in_step;
            let slack = TIME_SLACK * (1.0 + place.abs() * 1e-9);
            ((place - libm::round(place)).abs() < slack).then_some(0.5 * in_step)
        });
    if yes_timed.is_none() && no_timed.is_none() && shift.is_none() {
        return None;
    }
    let condition = Expr::sum(vec![condition.clone(), Expr::Constant(shift.unwrap_or(0.0))]);
    let (yes, no) = (yes_timed.unwrap_or_else(|| yes.clone()), no_timed.unwrap_or_else(|| no.clone()));
    Some(Expr::Select(Box::new(Select { condition, yes, no })))
}

/// The new value of a state whose old one goes with the jump.
fn anew(jump: &Expr, own: Variable) -> Option<Expr> {
    let Expr::Sum(members) = jump else { return None };
    let gone = Expr::scaled(-1.0, Expr::Variable(own));
    let place = members.iter().position(|member| *member == gone)?;
    let mut rest = members.clone();
    rest.remove(place);
    Some(Expr::sum(rest))
}

/// The chains of the jumps, and what is published behind them. States at the start of a step stand for those before jumps.
fn chains(model: &Model, options: &StepOptions) -> Result<(StepGraph, Vec<ValueId>), Vec<Diagnostic>> {
    let mut plan = Plan::new(model);
    let mut point = Point::new(model.states.ids().map(Variable::State).collect(), BEFORE);
    let jumps: Vec<Option<Expr>> = model.states.iter().map(|state| state.jump_of(model.step)).collect();
    plan.algebraics(&mut point, jumps.iter().flatten(), false);
    let mut ends = Vec::new();
    for (state, jump) in model.states.ids().zip(&jumps) {
        ends.push(match jump {
            None => Variable::State(state),
            Some(jump) => {
                let jump = jump.renamed(&|variable| point.variable(variable));
                let own = Variable::State(state);
                match anew(&jump, own) {
                    Some(value) => plan.end(state, None, value),
                    None => plan.end(state, Some(own), jump),
                }
            }
        });
    }
    let mut behind = Point::new(ends, u8::MAX);
    let wanted: Vec<Expr> = model.outputs.iter().map(|output| Expr::Variable(output.variable)).collect();
    plan.algebraics(&mut behind, wanted.iter(), true);
    let (mut builder, algebraics) = planned::chains(&plan, options, &Arrivals::default())?;
    let mut outputs = Vec::new();
    for (number, output) in model.outputs.iter().enumerate() {
        outputs.push(match behind.variable(output.variable) {
            Variable::State(state) => builder.graph.states[state].0,
            Variable::Input(input) => builder.published_input(number, output, input),
            Variable::Algebraic(equation) => algebraics[&equation],
        });
    }
    let Builder { graph, .. } = builder;
    Ok((graph, outputs))
}

/// The step without jumps, then the chains of the jumps.
fn joined(model: &Model, rest: StepGraph, (jumps, outputs): (StepGraph, Vec<ValueId>)) -> StepGraph {
    let mut graph = rest;
    let before: List<StateId, ValueId> =
        graph.states.iter().take(model.states.len()).map(|(_, next)| *next).collect::<Vec<_>>().into();
    for (state, own) in model.states.numbered().filter(|(_, own)| own.jump.is_some()) {
        let equation = graph.value(graph.states[state].0).equation;
        if graph.value(before[state]).role == Role::Next(state) {
            graph.names.auxiliaries.push(format!("{}.before", own.name));
            let role = Role::Auxiliary(index::number(graph.names.auxiliaries.len()) - 1);
            graph.values[before[state].index()].role = role;
        }
        graph.values.push(Value { role: Role::Next(state), equation, factor: false });
        graph.states[state].1 = ValueId::at(graph.values.len() - 1);
    }
    let known: HashMap<String, EquationId> =
        graph.equations.numbered().map(|(number, equation)| (equation.name.clone(), number)).collect();
    let equations: List<EquationId, EquationId> = jumps
        .equations
        .iter()
        .map(|equation| known.get(&equation.name).copied().unwrap_or_else(|| graph.equations.push(equation.clone())))
        .collect();
    let auxiliaries = index::number(graph.names.auxiliaries.len());
    let inner =
        graph.values.iter().map(|value| if let Role::Inner(_, serial) = value.role { serial + 1 } else { 0 }).max();
    let inner = inner.unwrap_or(0);
    graph.names.auxiliaries.extend_from_slice(&jumps.names.auxiliaries);
    let values: Vec<ValueId> = jumps
        .values
        .iter()
        .map(|value| {
            let role = match value.role {
                Role::State(state) => return before[state],
                Role::Next(state) => {
                    return if model.states[state].jump.is_some() { graph.states[state].1 } else { before[state] };
                }
                Role::Input(input) => return graph.inputs[at(input)],
                Role::Auxiliary(number) => Role::Auxiliary(auxiliaries + number),
                Role::Inner(number, serial) => Role::Inner(equations[number], inner + serial),
                role => role,
            };
            let equation = value.equation.map(|equation| equations[equation]);
            graph.values.push(Value { role, equation, factor: value.factor });
            ValueId::at(graph.values.len() - 1)
        })
        .collect();
    let id = |value: ValueId| values[value.index()];
    append::chains(&mut graph, &jumps, &values, &equations);
    graph.outputs = outputs
        .into_iter()
        .map(|value| match jumps.values[value.index()].role {
            Role::State(state) => graph.states[state].1,
            _ => id(value),
        })
        .collect();
    graph.names.outputs = model.outputs.iter().map(|output| output.name.clone()).collect();
    graph
}
