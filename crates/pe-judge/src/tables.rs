//! Function tables of a step: the run that finds their arguments, and their figures in the report.

use std::collections::BTreeSet;

use pe_hls::functions::Untabled;
use pe_ir::codes;
use pe_ir::graph::{Factor, Pivot, Role, StepGraph, Term, ValueId};
use pe_ir::index::{self, StateId};
use pe_ir::model::{Expr, Model, State, Variable};
use pe_ir::place::Place;
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;
use pe_sim::double::DoubleRun;

use crate::angles;
use crate::corners;
use crate::pivots;
use crate::progress::Progress;
use crate::runs::{self, Siblings};

/// Steps between two signs of life.
const STRIDE: u64 = 256;

/// Runs the exact functions over the span, and puts tables in their place for the arguments that they had.
///
/// # Errors
/// `E0824` a pivot of a linear system that comes close to zero, `E0901` non-finite, `E0904` a function outside its domain,
/// `E0916` one that is too steep for a table.
pub fn tabulate(
    model: &Model,
    graph: &StepGraph,
    format: WordFormat,
    progress: &dyn Progress,
) -> Result<StepGraph, Vec<Diagnostic>> {
    tabulated(model, graph, format, model.has_jumps(), progress)
}

/// The same, where functions that are the same but for indices shall share tables as far as they have values for all of their
/// arguments.
///
/// # Errors
/// Those of [`tabulate`].
pub fn tabulate_alike(
    model: &Model,
    graph: &StepGraph,
    format: WordFormat,
    progress: &dyn Progress,
) -> Result<StepGraph, Vec<Diagnostic>> {
    tabulated(model, graph, format, true, progress)
}

fn tabulated(
    model: &Model,
    graph: &StepGraph,
    format: WordFormat,
    alike: bool,
    progress: &dyn Progress,
) -> Result<StepGraph, Vec<Diagnostic>> {
    progress.set_length(model.steps());
    let mut run = DoubleRun::new(graph);
    for step in 0..model.steps() {
        let time = model.time(step, 0.0);
        run.step(&model.sample_inputs(time)).map_err(|diverged| vec![runs::non_finite(graph, diverged, time)])?;
        if step.is_multiple_of(STRIDE) {
            progress.advance(STRIDE);
        }
    }
    angles::followed(model, graph, &run.largest())?;
    let mut arguments = run.arguments();
    for corner in corners::corners(model) {
        let (other, of_corner) = (corner.model(model), corner.graph(graph));
        let mut run = DoubleRun::new(&of_corner);
        for step in 0..other.steps() {
            let time = other.time(step, 0.0);
            run.step(&other.sample_inputs(time))
                .map_err(|diverged| corner.named(vec![runs::non_finite(graph, diverged, time)]))?;
        }
        angles::followed(model, graph, &run.largest()).map_err(|findings| corner.named(findings))?;
        for (own, other) in arguments.iter_mut().zip(run.arguments()) {
            *own = (own.0.min(other.0), own.1.max(other.1));
        }
    }
    let eliminations = pivots::ranged(model, graph, &arguments)?;
    angles::include_arguments(model, graph, &mut arguments);
    let stated = with_stated(model, graph, &arguments, alike);
    // A function need not have a value wherever its argument may be expected.
    let kept = kept(model, graph);
    let beyond = stated.as_ref().and_then(|stated| pe_hls::functions::tabulate(graph, stated, format, &kept).ok());
    let tabled = match beyond {
        Some(tabled) => tabled,
        None => pe_hls::functions::tabulate(graph, &arguments, format, &kept).map_err(|untabled| {
            untabled.into_iter().map(|untabled| with_time(model, graph, untabled)).collect::<Vec<_>>()
        })?,
    };
    Ok(StepGraph { eliminations, ..tabled })
}

/// Values that formats, pivots or stated ranges know by what they are.
fn kept(model: &Model, graph: &StepGraph) -> Vec<ValueId> {
    let pivots = graph.eliminations.iter().flat_map(|elimination| &elimination.pivots);
    let reciprocals: BTreeSet<u32> = pivots
        .filter_map(|pivot| if let Pivot::Varying { reciprocal, .. } = pivot { Some(*reciprocal) } else { None })
        .collect();
    let with_range: BTreeSet<&str> =
        model.algebraics.iter().filter(|own| own.range.is_some()).map(|own| &*own.name).collect();
    let stated: BTreeSet<u32> = (0u32..)
        .zip(&graph.names.algebraics)
        .filter(|(_, name)| with_range.contains(&***name))
        .map(|(algebraic, _)| algebraic)
        .collect();
    let is_kept = |role: Role| match role {
        Role::Algebraic(own, _) => reciprocals.contains(&own) || stated.contains(&own),
        Role::Pivot(..) => true,
        _ => false,
    };
    let known = graph.values.iter().enumerate().filter(|(_, value)| is_kept(value.role));
    let of_angles = angles::functions(model, graph).into_iter().map(|(value, _)| value);
    known.map(|(value, _)| ValueId::at(value)).chain(of_angles).collect()
}

/// Part of their magnitude by which arguments go beyond those of the run where events may come earlier or later.
const BESIDE_EVENTS: f64 = 0.25;

/// The arguments with the stated ranges of variables that functions are applied to as they are, with what they may be
/// beside events, and, if `alike`, with those of elements of the same arrays; none if there are no such.
fn with_stated(model: &Model, graph: &StepGraph, arguments: &[(f64, f64)], alike: bool) -> Option<Vec<(f64, f64)>> {
    let mut all = arguments.to_vec();
    let left_at = runs::left_at(model, graph);
    if alike {
        Siblings::of(graph).share(&mut all, |one, other| (one.0.min(other.0), one.1.max(other.1)));
    }
    for chain in graph.chains.iter().filter(|chain| chain.function.is_some()) {
        let (low, high) = all[chain.write.value.index()];
        if model.has_jumps() && low < high {
            let beside = |end: f64| BESIDE_EVENTS * end.abs();
            all[chain.write.value.index()] = (low - beside(low), high + beside(high));
        }
        let [Term { operand, partner: None, factor: Factor::Coefficient(factor) }] = graph.chain_terms(chain) else {
            continue;
        };
        let range = match graph.value(*operand).role {
            Role::State(state) | Role::Stage(state, _) => model.states.find(state).and_then(|state| state.range),
            Role::Algebraic(algebraic, _) => {
                model.algebraics.get(index::at(algebraic)).and_then(|algebraic| algebraic.range)
            }
            Role::Input(input) => model.inputs.get(index::at(input)).and_then(|input| input.range),
            // Where a method leaves a state that then jumps.
            Role::Auxiliary(_) => left_at.get(operand).and_then(|state| model.states[*state].range),
            _ => None,
        };
        let Some((low, high)) = range.filter(|_| chain.write.base.is_none() && chain.write.weight == 0) else {
            continue;
        };
        let (one, other) = (factor * low, factor * high);
        let own = &mut all[chain.write.value.index()];
        *own = (own.0.min(one.min(other)), own.1.max(one.max(other)));
    }
    (all != arguments).then_some(all)
}

/// The finding with the time at which the arguments reach the place where the function has no bounds or no table, or pass it.
fn with_time(model: &Model, graph: &StepGraph, untabled: Untabled) -> Diagnostic {
    let Untabled { values, at, mut finding } = untabled;
    if let Some(state) = pivot_of(graph, values[0]).filter(|_| finding.code == codes::OUTSIDE_DOMAIN) {
        finding.code = codes::SMALL_PIVOT;
        finding.message = format!("the pivot of `{state}` passes zero: the matrix of the step is singular there");
        let help = "try half of the `--step`; where the model grows, its rate times the step must stay below 1";
        finding.help = Some(help.to_owned());
    }
    if let Some(pivot) = pivots::of_system(graph, values[0]).filter(|_| finding.code == codes::OUTSIDE_DOMAIN) {
        finding.code = codes::ZERO_PIVOT;
        finding.message = format!("the pivot of `{pivot}` passes zero");
        finding.help = Some(pivots::help_of_system(model, pivot));
    }
    let mut run = DoubleRun::new(graph);
    for step in 0..model.steps() {
        let time = model.time(step, 0.0);
        let before: Vec<f64> = (0..model.states.len()).map(|state| run.state(StateId::at(state))).collect();
        let inputs = model.sample_inputs(time);
        let finite = run.step(&inputs).is_ok();
        let ranges = values.iter().map(|value| run.argument(*value));
        let (low, high) = ranges.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).expect("a use has values");
        if low <= at && at <= high {
            let pivot = [codes::SMALL_PIVOT, codes::ZERO_PIVOT].contains(&finding.code);
            let what = if pivot { "it" } else { "x" };
            finding.message += &format!("; {what} gets there at t = {time:.6e} s");
            let after: Vec<f64> = (0..model.states.len()).map(|state| run.state(StateId::at(state))).collect();
            let named = graph.equation_of(values[0]).map(|equation| &equation.name);
            let named = named.and_then(|name| vanishing(model, name, (&before, &after), &inputs));
            if let Some(factor) = named.filter(|_| finding.code == codes::OUTSIDE_DOMAIN) {
                finding.message += &format!(", where `{factor}`, which it is multiplied by, is zero as well: 0/0");
                finding.code = codes::INDETERMINATE;
                let help = "take the limit of the quotient near there, as in `if abs(w) > 1e-3 then x/w else 1`; a function of one \
                            variable, such as `sin(x)/x`, takes its limit by itself";
                finding.help = Some(help.to_owned());
            }
            break;
        }
        if !finite {
            break;
        }
    }
    finding
}

/// The state whose pivot a value is the reciprocal of, if it is one.
fn pivot_of(graph: &StepGraph, value: ValueId) -> Option<&str> {
    match graph.value(value).role {
        Role::Pivot(state, _) => Some(&graph.names.states[state]),
        _ => None,
    }
}

/// The variable that is zero within a step, given by the states before and after it, and that an algebraic variable is
/// multiplied by.
fn vanishing(model: &Model, name: &str, (before, after): (&[f64], &[f64]), inputs: &[f64]) -> Option<String> {
    let number = model.algebraics.iter().position(|algebraic| algebraic.name == name)?;
    let singular = Expr::Variable(Variable::Algebraic(index::number(number)));
    let all = model.states.iter().flat_map(State::equations).chain(model.algebraics.iter().map(|own| &own.expr));
    let mut factors = Vec::new();
    all.for_each(|expr| beside(expr, &singular, &mut factors));
    let (one, other) = (Place::new(model, before, inputs), Place::new(model, after, inputs));
    let zero = |variable: &Variable| {
        let (one, other) = (one.number(*variable), other.number(*variable));
        // What is zero all the time does not become it.
        one.is_finite() && one != 0.0 && (one * other <= 0.0 || one.abs().min(other.abs()) <= 2.0 * (one - other).abs())
    };
    let found = factors.into_iter().find(zero)?;
    Some(match found {
        Variable::State(index) => model.states[index].name.clone(),
        Variable::Input(index) => model.inputs[index::at(index)].name.clone(),
        Variable::Algebraic(index) => model.algebraics[index::at(index)].name.clone(),
    })
}

/// Variables that are factors beside another one in some product.
fn beside(expr: &Expr, other: &Expr, found: &mut Vec<Variable>) {
    match expr {
        Expr::Product(members) => {
            if members.contains(other) {
                found.extend(members.iter().filter(|member| *member != other).filter_map(|member| match member {
                    Expr::Variable(variable) => Some(*variable),
                    _ => None,
                }));
            }
            members.iter().for_each(|member| beside(member, other, found));
        }
        Expr::Sum(members) => members.iter().for_each(|member| beside(member, other, found)),
        Expr::Power(base, _) | Expr::Apply(_, base) => beside(base, other, found),
        Expr::Select(select) => {
            [&select.condition, &select.yes, &select.no].into_iter().for_each(|part| beside(part, other, found));
        }
        Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => {}
    }
}

/// The tables of a step in a few words.
pub fn summary(graph: &StepGraph) -> String {
    let words: usize = graph.functions.tables.iter().flat_map(|table| &table.columns).map(Vec::len).sum();
    format!(
        "{} tables, {words} words, {} lookups per step",
        graph.functions.tables.len(),
        graph.functions.lookups.len()
    )
}
