//! States that stand for what a quantity was some time ago: which models may have them, their names, and what they begin with.

use crate::report::Report;
use pe_ir::codes;
use pe_ir::index::{StateId, at};
use pe_ir::model::{Expr, Model, Variable};
use pe_ir::motion::Motion;
use pe_ir::place::Place;
use pe_ir::source::{Diagnostic, Span};

/// Whether a model may have delays: it has one step, and no parts of other kinds.
pub(crate) fn suits(model: &Model, place: Span, report: &mut Report) -> Option<()> {
    let (message, help) = if !model.phases.is_empty() {
        ("a model with a list of steps has no delays", "take a single step")
    } else if !model.rates.is_empty() {
        ("a model with sampled parts has no delays", "keep the past in states of a block: `next before = x`")
    } else if model.mechanism.is_some() {
        ("a mechanism has no delays", "write the accelerations as equations")
    } else {
        return Some(());
    };
    report.push(Diagnostic::error(codes::DELAY_MODEL, place, message).with_help(help));
    None
}

/// The states that stand for the past, each with its delay.
fn delayed(model: &Model) -> Vec<(StateId, f64)> {
    let delay = |state: &StateId| match model.states[*state].motion {
        Some(Motion::Delayed(seconds)) => Some((*state, seconds)),
        _ => None,
    };
    model.states.ids().filter_map(|state| delay(&state)).collect()
}

/// Names them after what they are of, `x(t-0.02)`, and gives them its unit.
pub(crate) fn name(model: &mut Model) {
    for (state, seconds) in delayed(model) {
        let Expr::Variable(of) = model.states[state].derivative else { continue };
        let (name, unit) = match of {
            Variable::State(of) => (&model.states[of].name, &model.states[of].unit),
            Variable::Input(of) => (&model.inputs[at(of)].name, &model.inputs[at(of)].unit),
            Variable::Algebraic(of) => (&model.algebraics[at(of)].name, &model.algebraics[at(of)].unit),
        };
        let (name, unit) = (format!("{name}(t-{seconds})"), unit.clone());
        (model.states[state].name, model.states[state].unit) = (name, unit);
    }
}

/// Before time zero everything was as it is at time zero. What is delayed twice takes two rounds to find.
pub(crate) fn begin(model: &mut Model) {
    let delayed = delayed(model);
    let inputs = model.sample_inputs(0.0);
    for _ in 0..=delayed.len() {
        let states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
        let place = Place::new(model, &states, &inputs);
        let was = |state: StateId| model.states[state].derivative.evaluate(&|variable| place.number(variable));
        let found: Vec<f64> = delayed.iter().map(|(state, _)| was(*state)).collect();
        let mut changes = false;
        for ((state, _), number) in delayed.iter().zip(found) {
            changes |= std::mem::replace(&mut model.states[*state].initial, number) != number;
        }
        if !changes {
            break;
        }
    }
}
