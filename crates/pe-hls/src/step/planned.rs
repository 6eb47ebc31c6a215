//! Chains from the plan of a method's step.

use std::collections::HashMap;

use pe_ir::graph::{Factor, FormCost, Role, StageForm, StepGraph, Term, ValueId, Write};
use pe_ir::index::{self, ChainId, EquationId, List, StateId, at};
use pe_ir::model::{Algebraic, Model, Variable};
use pe_ir::source::Diagnostic;

use super::arrival::{Arrivals, soonest};
use super::builder::{Builder, Operands, of_state, push};
use super::forms::{self, StepOptions};
use super::plan::{Plan, Planned, Point};
use super::polynomial::Nested;
use super::prune::prune;
use super::sharing;
use crate::pairs;

/// The step graph of a plan.
///
/// # Errors
/// `E0801` for an equation that expands to too many products, `E0805` for a form that was asked for: a planned step has
/// only one.
pub fn build(mut plan: Plan, options: &StepOptions) -> Result<StepGraph, Vec<Diagnostic>> {
    let model = plan.model;
    let published = publish(&mut plan);
    let mut graph = ordered(&plan, &published, options)?;
    if !can_overwrite(&graph) {
        // Words in pairs, which no order of equations can spoil; there only states are operands and bases.
        if plan.put_bases_in_place() {
            graph = ordered(&plan, &published, options)?;
        }
        (graph.form, graph.stages) = (StageForm::Euler, 1);
    }
    forms::check_only(model, graph.form, options)?;
    graph.forms = vec![whole_cost(&graph, options)];
    graph.pre_adder = options.pre_adder && pairs::worthwhile(&graph);
    Ok(graph)
}

/// The step graph of a plan whose products take their variables in a good order.
fn ordered(plan: &Plan, published: &Point, options: &StepOptions) -> Result<StepGraph, Vec<Diagnostic>> {
    // Entries and solutions of an elimination are large at different times: there the order decides the accuracy.
    let kept = plan.model.algebraics.iter().any(|algebraic| algebraic.kept);
    if kept || plan.equations.iter().any(|planned| matches!(planned.role, Role::Pivot(..))) {
        return whole(plan, published, options, &Arrivals::default());
    }
    soonest(options, || variables(plan), |arrivals| whole(plan, published, options, arrivals))
}

/// The variables of a plan, with their roles.
fn variables(plan: &Plan) -> Vec<(Variable, Role)> {
    let states = plan.model.states.ids().map(|state| (Variable::State(state), Role::State(state)));
    let equations = plan.equations.iter().enumerate();
    let equations = equations.map(|(index, planned)| (Variable::Algebraic(index::number(index)), planned.role));
    states.chain(equations).collect()
}

/// The step graph of a plan with what it publishes.
fn whole(
    plan: &Plan,
    published: &Point,
    options: &StepOptions,
    arrivals: &Arrivals,
) -> Result<StepGraph, Vec<Diagnostic>> {
    let model = plan.model;
    let (mut builder, algebraics) = chains(plan, options, arrivals)?;
    let ends: Vec<ValueId> = builder.graph.states.iter().map(|(_, next)| *next).collect();
    for (index, output) in model.outputs.iter().enumerate() {
        let value = match output.variable {
            Variable::State(state) => ends[state.index()],
            Variable::Input(input) => builder.published_input(index, output, input),
            Variable::Algebraic(algebraic) => match published.variable(Variable::Algebraic(algebraic)) {
                Variable::Algebraic(equation) => algebraics[&equation],
                _ => unreachable!("equations define algebraic variables"),
            },
        };
        builder.graph.outputs.push(value);
    }
    Ok(prune(builder.graph))
}

/// The chains of a plan, with nothing published, and the value of each of its equations.
///
/// # Errors
/// `E0801` for an equation that expands to too many products.
pub(super) fn chains(
    plan: &Plan,
    options: &StepOptions,
    arrivals: &Arrivals,
) -> Result<(Builder, HashMap<u32, ValueId>), Vec<Diagnostic>> {
    let model = plan.model;
    let flat = flat(plan);
    let expanded = sharing::expand_keeping(&flat, options.longest_sum, &|index| plan.equations[index].keep)?;
    let cost = FormCost {
        form: StageForm::Method,
        stages: model.solver.stages(),
        products: 0,
        largest: 0,
        ports: 0,
        cycles: 0,
    };
    let mut builder = Builder::new(model, cost);
    memories(&mut builder, plan);
    builder.graph.names.auxiliaries = plan.auxiliaries.clone();
    builder.graph.constant_pivot = plan.constant_pivot;
    let states: Vec<ValueId> = builder.graph.states.iter().map(|(state, _)| *state).collect();
    let mut operands = Operands { states: &states, algebraics: HashMap::new() };
    let mut riders: Vec<Option<usize>> = vec![None; plan.equations.len()];
    for (index, planned) in plan.equations.iter().enumerate() {
        if let Some(leader) = planned.same_sum {
            riders[at(leader)] = Some(index);
        }
    }
    for index in (0..plan.equations.len()).filter(|index| expanded.shared[*index]) {
        if plan.equations[index].same_sum.is_none() {
            let nested = match plan.equations[index].role {
                Role::Algebraic(algebraic, _) if model.algebraics[at(algebraic)].kept => {
                    Nested::last_first(&expanded.algebraics[index])
                }
                _ => Nested::of(&expanded.algebraics[index], arrivals),
            };
            let rider = riders[index].map(|rider| (index::number(rider), &plan.equations[rider]));
            equation(&mut builder, plan, (index::number(index), rider), &nested, &mut operands);
            let function = expanded.functions[index].as_ref().map(|function| builder.function(function));
            builder.graph.chains.last_mut().expect("the chain of the equation").function = function;
        }
    }
    let algebraics = operands.algebraics;
    Ok((builder, algebraics))
}

/// Plans the outputs that are algebraic variables, at the end of the step.
fn publish(plan: &mut Plan) -> Point {
    let model = plan.model;
    let ends = plan.ends.iter().take(model.states.len()).map(|end| end.expect("every state has an end")).collect();
    let mut point = Point::new(ends, u8::MAX);
    let wanted: Vec<_> = model.outputs.iter().map(|output| pe_ir::model::Expr::Variable(output.variable)).collect();
    plan.algebraics(&mut point, wanted.iter(), true);
    point
}

/// The equations of a plan as the algebraic equations of a model without states.
fn flat(plan: &Plan) -> Model {
    let algebraic = |planned: &Planned| {
        let (name, span) = match (planned.role, planned.owner) {
            (Role::Algebraic(algebraic, _), _) => {
                let algebraic = &plan.model.algebraics[at(algebraic)];
                (algebraic.name.clone(), algebraic.span)
            }
            (_, Some(owner)) => {
                let state = &plan.model.states[owner];
                (state.name.clone(), state.span)
            }
            (_, None) => unreachable!("only algebraic variables have no owner"),
        };
        Algebraic { name, unit: None, expr: planned.sum.clone(), range: None, kept: false, angle: false, span }
    };
    let Model { ref name, solver, step, span, .. } = *plan.model;
    Model {
        algebraics: plan.equations.iter().map(algebraic).collect(),
        inputs: plan.model.inputs.clone(),
        ..Model::new(name, solver, step, span)
    }
}

/// Adds what the method keeps from step to step as states behind those of the model.
fn memories(builder: &mut Builder, plan: &Plan) {
    let graph = &mut builder.graph;
    for memory in &plan.memories {
        let index = StateId::at(graph.states.len());
        let start = push(graph, Role::State(index), of_state(memory.owner), false);
        let next = push(graph, Role::Next(index), of_state(memory.owner), false);
        graph.states.push((start, next));
        graph.initial.push(memory.initial);
        graph.names.states.push(memory.name.clone());
    }
}

/// Chain of an equation, and of the one that takes the same sum.
fn equation(
    builder: &mut Builder,
    plan: &Plan,
    (index, rider): (u32, Option<(u32, &Planned)>),
    nested: &Nested,
    operands: &mut Operands,
) {
    let planned = &plan.equations[at(index)];
    let number = match (planned.role, planned.owner) {
        (Role::Algebraic(algebraic, _), _) => EquationId::at(plan.model.states.len() + at(algebraic)),
        (_, owner) => of_state(owner.expect("of a state")),
    };
    let mut terms = builder.terms(number, nested, 1.0, operands);
    let value = match planned.role {
        Role::Next(state) => builder.graph.states[state].1,
        role => push(&mut builder.graph, role, number, false),
    };
    let mut base = planned.base.map(|base| match base {
        Variable::State(state) => operands.states[state.index()],
        Variable::Input(input) => builder.graph.inputs[at(input)],
        Variable::Algebraic(equation) => operands.algebraics[&equation],
    });
    // A constant is a base word where nothing else is, and no other value takes the same sum.
    if nested.constant != 0.0 && base.is_none() && rider.is_none() && !terms.is_empty() {
        base = Some(builder.constant(nested.constant, number, value));
    } else if nested.constant != 0.0 || terms.is_empty() {
        let one = push(&mut builder.graph, Role::Constant(1.0), number, false);
        terms.push(Term::new(one, Factor::Coefficient(nested.constant)));
    }
    let second = rider.map(|(rider, planned)| {
        let value = push(&mut builder.graph, planned.role, number, false);
        operands.algebraics.insert(rider, value);
        Write { value, base: None, weight: 0 }
    });
    builder.chain(number, terms, Write { value, base, weight: 0 }, second);
    operands.algebraics.insert(index, value);
}

/// Whether there is an order of chains in which all readers of a state's old word come before the write of the new one,
/// if the graph has it.
pub(super) fn can_overwrite(graph: &StepGraph) -> bool {
    let producers = graph.producers();
    let mut arcs: Vec<(ChainId, ChainId)> = Vec::new();
    for (index, chain) in graph.chains.numbered() {
        let mut visit = |value: ValueId| match graph.value(value).role {
            Role::State(state) => {
                let writer = producers[graph.states[state].1.index()];
                arcs.extend(writer.filter(|writer| *writer != index).map(|writer| (index, writer)));
            }
            _ => arcs.extend(producers[value.index()].map(|producer| (producer, index))),
        };
        for term in graph.chain_terms(chain) {
            visit(term.operand);
            if let Factor::Value(factor) = term.factor {
                visit(factor);
            }
        }
        chain.writes().filter_map(|write| write.base).for_each(visit);
    }
    arcs.sort_unstable();
    arcs.dedup();
    let mut waits = List::filled(0u32, graph.chains.len());
    arcs.iter().for_each(|(_, later)| waits[*later] += 1);
    let mut ready: Vec<ChainId> = graph.chains.ids().filter(|chain| waits[*chain] == 0).collect();
    let mut done = 0;
    while let Some(chain) = ready.pop() {
        done += 1;
        let first = arcs.partition_point(|(earlier, _)| *earlier < chain);
        for (_, later) in arcs[first..].iter().take_while(|(earlier, _)| *earlier == chain) {
            waits[*later] -= 1;
            if waits[*later] == 0 {
                ready.push(*later);
            }
        }
    }
    done == graph.chains.len()
}

/// The cost of a step as it stands.
fn whole_cost(graph: &StepGraph, options: &StepOptions) -> FormCost {
    let loads = graph.loads();
    let products = loads.iter().map(|load| u64::from(*load)).sum();
    let largest = loads.into_iter().max().unwrap_or(0);
    let cost = FormCost { form: graph.form, stages: graph.stages, products, largest, ports: 0, cycles: 0 };
    forms::with_cycles(cost, options.pes)
}
