//! The step graph of a model: selects how it is built.

use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Diagnostic;

use super::elimination::system;
use super::forms::StepOptions;
use super::{jumps, mechanism, method, past, planned, played, sampled, staged, turns};

/// Builds the step graph of a model with its own solver and step, in the form with the fewest products.
///
/// # Errors
/// `E0801` for an equation that expands to too many products.
pub fn build(model: &Model) -> Result<StepGraph, Vec<Diagnostic>> {
    build_with(model, &StepOptions::default())
}

/// Builds the step graph of a model with its own solver and step, in the form that is asked for or suits best.
/// The model is lifted (see [`crate::lift`]).
///
/// # Errors
/// `E0801` for an equation that expands to too many products, `E0805` for a form that the model does not have, `E0806`
/// for a solver that does not suit it, `E0821` and `E0822` for linear systems that have no solution or no pivots, `E0930` for a
/// delay that is no whole number of steps.
pub fn build_with(model: &Model, options: &StepOptions) -> Result<StepGraph, Vec<Diagnostic>> {
    let mut played = None;
    if model.has_played() {
        played::check(model)?;
        played.insert(model.clone()).retime();
    }
    let model = played.as_ref().unwrap_or(model);
    if let (Solver::Trapezoidal, Some(constrained)) = (model.solver, &model.mechanism) {
        return build_with(&mechanism::step_of(model, constrained)?, options);
    }
    if system::has_systems(model) {
        let eliminated = system::eliminate(model, options.order, options.scheme)?;
        let graph = build_with(&eliminated.model, options)?;
        return Ok(eliminated.named(model, graph));
    }
    if model.has_jumps() {
        jumps::check(model)?;
    }
    let past;
    let mut model = model;
    if model.delays().next().is_some() {
        past = past::write_out(model, options.longest_past)?;
        model = &past;
    }
    if model.has_jumps() {
        return jumps::build(model, options, build_with);
    }
    if !model.rates.is_empty() {
        return sampled::build(model, options, build_with);
    }
    // Running sums would add the turns that a step drops to what its stages read.
    let options = &StepOptions { sums: options.sums && !model.has_angles(), ..*options };
    let graph = match method::plan(model, options.order)? {
        Some(plan) => planned::build(plan, options)?,
        None => staged::build(model, options)?,
    };
    Ok(turns::drop_turns(model, graph))
}
