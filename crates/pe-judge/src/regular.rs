//! What keeps the pivots of linear systems away from zero: changes of a model or its elimination, tried in double precision.

use std::collections::BTreeMap;
use std::sync::Arc;

use pe_hls::step::{StepOptions, build_with, general, orders};
use pe_ir::graph::{Pivot, Role, StepGraph};
use pe_ir::index::number;
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Entry, Expr, Model, Solver, Variable};
use pe_ir::place::Place;
use pe_sim::double::DoubleRun;

use crate::pivots::SMALLEST;

/// Products that a run may take.
const PRODUCTS: u64 = 200_000_000;

/// Masses that are tried, in parts of the largest one.
const MASSES: [f64; 3] = [0.01, 0.1, 1.0];

/// The least and the largest value of each pivot that varies, from the arguments of all functions.
pub(crate) fn ranges(graph: &StepGraph, arguments: &[(f64, f64)]) -> BTreeMap<u32, (f64, f64)> {
    let mut ranges: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    for (index, value) in graph.values.iter().enumerate() {
        let Role::Algebraic(own, _) = value.role else { continue };
        let (low, high) = arguments[index];
        if low <= high {
            let range = ranges.entry(own).or_insert((low, high));
            *range = (range.0.min(low), range.1.max(high));
        }
    }
    ranges
}

/// Whether a step comes to the end of its span with all pivots away from zero.
fn holds(model: &Model, options: &StepOptions) -> bool {
    let Ok(graph) = build_with(model, options) else { return false };
    if model.steps().saturating_mul(graph.macs()) > PRODUCTS {
        return false;
    }
    let mut run = DoubleRun::new(&graph);
    if !(0..model.steps()).all(|step| run.step(&model.sample_inputs(model.time(step, 0.0))).is_ok()) {
        return false;
    }
    let ranges = ranges(&graph, &run.arguments());
    let mut pivots = graph.eliminations.iter().flat_map(|elimination| &elimination.pivots);
    pivots.all(|pivot| match pivot {
        Pivot::Number(_) => true,
        Pivot::Varying { reciprocal, .. } => ranges.get(reciprocal).is_none_or(|(low, high)| {
            low * high > 0.0 && low.abs().min(high.abs()) >= SMALLEST * low.abs().max(high.abs())
        }),
    })
}

/// What helps where a pivot of a linear system comes to zero.
pub(crate) fn of_system(model: &Model) -> String {
    let order = orders(model).into_iter().map(|(order, _)| order);
    let mut order = order.filter(|order| holds(model, &StepOptions { order: *order, ..StepOptions::default() }));
    if let Some(order) = order.next() {
        return format!("`--elimination {}` keeps all pivots from zero (tried)", order.name());
    }
    if general(model).is_some_and(|general| holds(&general, &StepOptions::default())) {
        return "declared without `symmetric` it exchanges rows, and keeps all pivots from zero (tried)".to_owned();
    }
    "no order of the elimination keeps all pivots from zero (tried): look at the matrix there, which is all but singular".to_owned()
}

/// What helps where nothing holds a velocity of a mechanism, the one of this row.
pub(crate) fn of_mechanism(model: &Model, mechanism: &Mechanism, row: usize) -> String {
    let velocity = &model.states[mechanism.pairs[row].1].name;
    let what = format!("neither a mass nor a closure holds `{velocity}` there");
    let start: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let inputs = model.sample_inputs(0.0);
    let place = Place::new(model, &start, &inputs);
    let value = |variable: Variable| place.number(variable);
    let diagonal = mechanism.mass.iter().filter(|entry| entry.row == entry.column);
    let largest = diagonal.map(|entry| entry.value.evaluate(&value).abs()).fold(0.0, f64::max);
    let held = MASSES.into_iter().map(|part| rounded(part * largest)).find(|mass| {
        let mut other = mechanism.clone();
        other.mass.push(Entry { row: number(row), column: number(row), value: Expr::Constant(*mass) });
        let other = Model { solver: Solver::Trapezoidal, mechanism: Some(Arc::new(other)), ..model.clone() };
        holds(&other, &StepOptions::default())
    });
    let how = if model.solver == Solver::Trapezoidal { "tried" } else { "tried with `--solver trapezoidal`" };
    match held {
        Some(mass) => format!("{what}: a mass of {mass} more in its row of the mass matrix holds it ({how})"),
        None => format!("{what}: give it a mass, or a closure whose lever does not vanish"),
    }
}

/// A number of two digits that is near another one.
fn rounded(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}
