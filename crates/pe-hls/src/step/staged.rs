//! Explicit Runge-Kutta methods with as many stages as their order, and forms of affine models.

use std::collections::{BTreeMap, HashMap};

use pe_ir::graph::{Role, StageForm, StepGraph, ValueId};
use pe_ir::index::{self, StateId, at};
use pe_ir::model::{Algebraic, Model, Solver, Variable};
use pe_ir::motion::Motion;
use pe_ir::source::Diagnostic;

use super::arrival::{Arrivals, soonest};
use super::builder::{Builder, Operands, close, mark, stages};
use super::forms::{self, StepOptions};
use super::polynomial::{Nested, NestedFactor};
use super::prune::prune;
use super::sharing::{self, Expanded};
use super::{method, motion};
use crate::pairs;

/// Products that a table is taken to cost in estimates.
const TABLE_PRODUCTS: u32 = 7;

/// Builds the step graph of a model without sampled parts, in the form that is asked for or suits best.
///
/// # Errors
/// Those of [`super::build_with`].
pub fn build(model: &Model, options: &StepOptions) -> Result<StepGraph, Vec<Diagnostic>> {
    let expanded = sharing::expand_keeping(model, options.longest_sum, &|index| model.algebraics[index].kept)?;
    let variables = || {
        let states = model.states.ids().map(|state| (Variable::State(state), Role::State(state)));
        let algebraics = (0..index::number(model.algebraics.len()))
            .map(|algebraic| (Variable::Algebraic(algebraic), Role::Algebraic(algebraic, 1)));
        states.chain(algebraics).collect()
    };
    let build = |arrivals: &Arrivals| arranged(model, &expanded, arrivals, options);
    // The accuracy of an elimination depends on the order of its products.
    if model.algebraics.iter().any(|algebraic| algebraic.kept) {
        return build(&Arrivals::default());
    }
    soonest(options, variables, build)
}

/// The step graph of expanded equations, whose products take variables that arrive so.
fn arranged(
    model: &Model,
    expanded: &Expanded,
    arrivals: &Arrivals,
    options: &StepOptions,
) -> Result<StepGraph, Vec<Diagnostic>> {
    let derivatives: Vec<Nested> = expanded.derivatives.iter().map(|sum| Nested::of(sum, arrivals)).collect();
    let nested = |(polynomial, algebraic): (&_, &Algebraic)| match algebraic.kept {
        true => Nested::last_first(polynomial),
        false => Nested::of(polynomial, arrivals),
    };
    let algebraics: Vec<Nested> = expanded.algebraics.iter().zip(&model.algebraics).map(nested).collect();
    let used = shared_by_derivatives(expanded);
    let moves_along = model.states.iter().any(|state| matches!(state.motion, Some(Motion::Along(..))));
    let plain = match model.solver {
        Solver::Euler => StageForm::Euler,
        Solver::Exact => StageForm::Full,
        // What moves along is known at the times of stages only.
        _ if is_affine(expanded) && !moves_along => StageForm::Horner,
        _ => StageForm::Increments,
    };
    let slots = |nested: &Nested| index::number(nested.cost()) + u32::from(nested.constant != 0.0);
    let table = |index: usize| if expanded.functions[index].is_some() { TABLE_PRODUCTS } else { 0 };
    let shared = algebraics.iter().enumerate().filter(|(index, _)| used[*index]);
    let shared = shared.map(|(index, nested)| index::number(nested.cost().max(1)) + table(index));
    let slots: Vec<u32> = derivatives.iter().map(slots).chain(shared).collect();
    let mut written = vec![forms::plain_cost(plain, model.solver.stages(), &slots, options.pes)];
    let looks_up = expanded.functions.iter().any(Option::is_some);
    if plain == StageForm::Increments
        && options.sums
        && !looks_up
        && !model.has_signals()
        && matches!(model.solver, Solver::Heun | Solver::Rk4)
    {
        let pairs: Vec<u32> = derivatives.iter().map(pairs_of).collect();
        let counted = options.pre_adder && pairs::are_worthwhile(pairs.iter().sum(), slots.iter().sum());
        let outer = |(nested, pairs): (&Nested, &u32)| {
            let terms = index::number(nested.products.len()) + u32::from(nested.constant != 0.0);
            terms - if counted { *pairs } else { 0 }
        };
        let outer: Vec<u32> = derivatives.iter().zip(&pairs).map(outer).collect();
        written.push(forms::sums_cost(model.solver, &slots, &outer, options.pes));
    }
    let (form, costs) = match model.solver {
        Solver::Exact => forms::single(model, method::exponential(model, expanded)?, options)?,
        _ => forms::choose(model, expanded, &written, options)?,
    };
    let mut builder = Builder::new(model, form.cost);
    builder.graph.forms = costs;
    let mut current: Vec<ValueId> = builder.graph.states.iter().map(|(state, _)| *state).collect();
    let parts = if form.cost.form == StageForm::Increments { motion::abscissae(model.solver) } else { &[] };
    let moved = motion::chains(&mut builder, model, parts);
    let rests = |index: usize| model.states[StateId::at(index)].motion.is_some_and(Motion::rests);
    let swept = |index: usize| model.states[StateId::at(index)].motion.is_some_and(Motion::is_swept);
    for (number, rows) in (1..).zip(&form.stages) {
        let last = number == form.stages.len() as u8;
        let row = |index: usize| match moved.get(&(1f64.to_bits(), StateId::at(index))).filter(|_| last) {
            Some(end) => *end,
            None if rests(index) => current[index],
            None => builder.row(index, (number, last), rows, &current),
        };
        current = (0..rows.len()).map(row).collect();
    }
    let written = if form.stages.is_empty() { stages(model.solver, form.cost.form, model.step) } else { Vec::new() };
    for stage in written {
        let mut operands = Operands { states: &current, algebraics: HashMap::new() };
        for (index, nested) in algebraics.iter().enumerate().filter(|(index, _)| used[*index]) {
            builder.algebraic(index, stage.number, (nested, &expanded.functions[index]), &mut operands);
        }
        let next: Vec<ValueId> = (0..derivatives.len())
            .map(|index| {
                if !stage.last && rests(index) {
                    return current[index];
                }
                if !stage.last && swept(index) {
                    return builder.derivative(index, &stage, &derivatives[index], &operands);
                }
                let part = if stage.last { Some(&1.0) } else { parts.get(usize::from(stage.number) - 1) };
                match part.and_then(|part| moved.get(&(part.to_bits(), StateId::at(index)))) {
                    Some(value) => *value,
                    None => builder.derivative(index, &stage, &derivatives[index], &operands),
                }
            })
            .collect();
        current = next;
    }
    builder.outputs(model, expanded, &algebraics, &current);
    let mut graph = prune(builder.graph);
    graph.pre_adder = options.pre_adder && pairs::worthwhile(&graph);
    Ok(graph)
}

/// Products of an outer sum that pairs of operands with equal coefficients may save.
fn pairs_of(nested: &Nested) -> u32 {
    let mut classes: BTreeMap<u64, u32> = BTreeMap::new();
    for (variable, factor) in &nested.products {
        if let (Variable::State(_) | Variable::Algebraic(_), NestedFactor::Coefficient(coefficient)) =
            (variable, factor)
        {
            *classes.entry(coefficient.to_bits()).or_default() += 1;
        }
    }
    classes.into_values().map(|operands| operands / 2).sum()
}

/// The degree that stands for that of a function.
const NOT_AFFINE: usize = 2;

/// Whether every derivative is affine in the states when the inputs are held: then Horner's form equals RK4.
fn is_affine(expanded: &Expanded) -> bool {
    let mut degrees: Vec<usize> = Vec::with_capacity(expanded.algebraics.len());
    let degree = |polynomial: &super::polynomial::Polynomial, degrees: &[usize]| {
        let of_variable = |variable: &Variable| match variable {
            Variable::State(_) => 1,
            Variable::Input(_) => 0,
            Variable::Algebraic(a) => degrees[at(*a)],
        };
        polynomial.terms().map(|(monomial, _)| monomial.iter().map(of_variable).sum()).max().unwrap_or(0)
    };
    for (polynomial, function) in expanded.algebraics.iter().zip(&expanded.functions) {
        let own = if function.is_some() { NOT_AFFINE } else { degree(polynomial, &degrees) };
        degrees.push(own);
    }
    expanded.derivatives.iter().all(|polynomial| degree(polynomial, &degrees) <= 1)
}

/// Shared algebraic equations that some derivative reads, directly or through others.
fn shared_by_derivatives(expanded: &Expanded) -> Vec<bool> {
    let mut used = vec![false; expanded.algebraics.len()];
    mark(expanded.derivatives.iter().flat_map(|polynomial| polynomial.variables()), &mut used);
    close(expanded, &mut used);
    used
}
