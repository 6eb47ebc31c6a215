//! Sampled parts in fixed point: poles that rounding moves, and states that do not come to rest.

use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;

use super::observed::{self, StepGrowth};
use super::rest::{self, Rest};
use super::trusted::Trusted;
use crate::runs::Judged;

/// Part of its distance from the unit circle that a pole has to keep when coefficients are rounded.
const POLE_MARGIN: f64 = 0.9;

/// Distance from the unit circle at which a pole is on it.
const UNIT_CIRCLE: f64 = 1e-9;

/// What the runs over the span do not show of a model's sampled parts, without what would mend it.
pub fn findings(model: &Model, graph: &StepGraph, judged: &Judged) -> Vec<Diagnostic> {
    if model.rates.is_empty() {
        return Vec::new();
    }
    let trusted = Trusted::of(model, Some((graph, judged)));
    let growth = observed::step_growth(model, graph, &judged.fixed, &trusted);
    let rest = rest::rest(model, graph, judged);
    poles(model, growth.as_ref()).into_iter().chain(ringing(model, rest.as_ref())).collect()
}

/// Poles that lie outside of the unit circle, or that rounding moves there.
pub(super) fn poles(model: &Model, growth: Option<&StepGrowth>) -> Option<Diagnostic> {
    let (rate, growth) = (model.rates.first()?, growth?);
    let steps = match growth.steps {
        1 => "a step".to_owned(),
        steps => format!("{steps} steps"),
    };
    // Of a loop that is not linear this is said of small disturbances there, and of nothing else.
    let (what, locally) = match growth.linearised {
        Some(time) => (format!("linearised at t = {time:.3e} s, "), ", locally"),
        None => (String::new(), ""),
    };
    let steps = format!("{steps}{locally}");
    let help = "take a wider coefficient port, the second number in `--multiplier AxB`, or sections of second order";
    if growth.exact() > 1.0 + UNIT_CIRCLE {
        let message = format!("{what}a pole lies outside of the unit circle: |z| = {:.9} over {steps}", growth.exact());
        let help = match growth.linearised {
            Some(_) => {
                "small disturbances grow there; limits, dead zones and other times may keep the run bounded all the same: look \
                 at its outputs, then at gains and period"
            }
            None => "the sampled loop is unstable: check its gains and its period",
        };
        return Some(Diagnostic::error(codes::POLE, rate.span, message).with_help(help).into_warning());
    }
    let (exact, rounded) = growth.moved_pole()?;
    let values = format!("|z| = {rounded:.9}, not {exact:.9}, over {steps}");
    if rounded >= 1.0 {
        let message = format!("{what}rounded coefficients move a pole to the unit circle or beyond: {values}");
        return Some(Diagnostic::error(codes::POLE_MOVED, rate.span, message).with_help(help));
    }
    if 1.0 - rounded >= POLE_MARGIN * (1.0 - exact) {
        return None;
    }
    let message = format!("{what}rounded coefficients move a pole towards the unit circle: {values}");
    Some(Diagnostic::error(codes::POLE, rate.span, message).with_help(help).into_warning())
}

/// A sampled part that does not come to rest without inputs.
pub(super) fn ringing(model: &Model, rest: Option<&Rest>) -> Option<Diagnostic> {
    let Some(Rest::Ringing(ringing)) = rest else { return None };
    let state = &model.states[ringing.state];
    let how = match ringing.period {
        Some(1) => "stands still at".to_owned(),
        Some(period) => format!("repeats every {period} steps with"),
        None => "goes on with".to_owned(),
    };
    let message = format!("without inputs `{}` does not come to rest: it {how} up to {} LSB", state.name, ringing.lsb);
    let help = "take a wider multiplier, or write the section in another form; see the guide on sampled parts";
    Some(Diagnostic::error(codes::RINGING, state.span, message).with_help(help).into_warning())
}
