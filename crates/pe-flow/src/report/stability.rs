//! The check of the step as the report has it.

use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity};
use pe_judge::check::{Accuracy, Check, Rest as AtRest, Ringing, SAFE, TRIED_STATES};

use super::errors::{Amplification, Chaos, CheckedPivot, DeadBand, LimitedBy, Rest, Stability};

/// Findings of states that are listed.
const LISTED: usize = 10;

/// Digits that figures from eigenvalues keep in reports: the last ones depend on the order of sums.
const DIGITS: usize = 4;

/// The verdict in a word: `fine`, `warning` or `refused`.
pub fn verdict(findings: &[Diagnostic]) -> &'static str {
    match findings.iter().map(|finding| finding.severity).max() {
        None => "fine",
        Some(Severity::Warning) => "warning",
        Some(Severity::Error) => "refused",
    }
}

/// A figure with a few digits; none if it is not finite.
fn few(number: f64) -> Option<f64> {
    let text = format!("{number:.*e}", DIGITS - 1);
    let rounded = if number == 0.0 { 0.0 } else { text.parse().unwrap_or(number) };
    number.is_finite().then_some(rounded)
}

/// A growth of one step: as many digits as do not depend on the order of sums.
fn steady(number: f64) -> f64 {
    libm::round(number * 1e9) / 1e9
}

impl Stability {
    /// The check of a model's step.
    pub fn of(model: &Model, check: &Check) -> Stability {
        let prediction = &check.prediction;
        let limit = prediction.limit.as_ref();
        let reason = |missing: bool, reason: &str| missing.then(|| reason.to_owned());
        let dead = check.dead_bands.iter().take(LISTED).map(|dead| DeadBand {
            state: model.states[dead.state].name.clone(),
            time_s: dead.time,
            part: few(dead.part),
            loss: few(dead.loss),
        });
        let accuracy = check.accuracy.as_ref();
        Stability {
            verdict: verdict(&check.findings).to_owned(),
            codes: check.findings.iter().map(|finding| finding.code.to_owned()).collect(),
            predicted_step_s: limit.and_then(|limit| few(limit.step)),
            go_step_s: limit.and_then(|limit| few(SAFE * limit.step)),
            basis: prediction.basis.name().to_owned(),
            points: prediction.points,
            trajectory: if check.own_trajectory { "run" } else { "reference" }.to_owned(),
            limited_by: limit.map(|limit| LimitedBy {
                state: model.states[limit.state].name.clone(),
                time_s: limit.time,
                eigenvalue: [few(limit.eigenvalue.0), few(limit.eigenvalue.1)],
            }),
            found_step_s: check.found.and_then(|found| few(found.stable)),
            found_unstable_step_s: check.found.and_then(|found| found.unstable).and_then(few),
            found_over_s: check.found.and_then(|found| few(found.span)),
            eigenvalue_bound: few(prediction.bound),
            fastest_decay: few(prediction.fastest),
            stiffness: few(prediction.fastest * model.span),
            growth_log: few(prediction.growth),
            amplification: check.growth.as_ref().map(|growth| Amplification {
                exact: steady(growth.exact()),
                rounded: steady(growth.rounded()),
                steps: growth.steps,
                basis: if growth.all { "all eigenvalues" } else { "outer eigenvalues, estimated" }.to_owned(),
            }),
            smallest_pivot: check
                .pivot
                .as_ref()
                .map(|pivot| CheckedPivot { state: pivot.state.clone(), magnitude: few(pivot.magnitude) }),
            dead_bands: dead.collect(),
            chaos: check.chaos.map(|chaos| Chaos { rate: few(chaos.rate), divergence_s: few(chaos.divergence) }),
            accuracy_step_s: accuracy.map(|Accuracy { step, .. }| few(*step)),
            accuracy_error: accuracy.map(|Accuracy { error, .. }| few(*error)),
            accuracy_tried: accuracy.map(|Accuracy { tried, .. }| *tried),
            stiffness_ratio: accuracy.map(|_| check.stiffness_ratio.and_then(few)),
            rest: check.rest.as_ref().map(|rest| at_rest(model, rest)),
            rest_reason: match &check.rest {
                Some(AtRest::NotTried(reason)) => Some((*reason).to_owned()),
                _ => None,
            },
            predicted_step_reason: reason(limit.is_none(), "no damped mode of the model limits this method"),
            smallest_pivot_reason: reason(
                check.pivot.is_none(),
                "the method has no pivot that varies, or the runs were refused",
            ),
            amplification_reason: reason(
                check.growth.is_none(),
                match check.swing {
                    Some(_) => "of the step of a mechanism differences are followed along the run",
                    None => "only for refused steps and large nonlinear models",
                },
            ),
            chaos_reason: reason(
                check.chaos.is_none(),
                "only `check` looks for chaos, and reports it only where it finds it",
            ),
            found_step_reason: reason(check.found.is_none(), not_found(model)),
        }
    }
}

fn at_rest(model: &Model, rest: &AtRest) -> Option<Rest> {
    match rest {
        AtRest::Zero => Some(Rest { lsb: 0, period_steps: None, state: None }),
        AtRest::Ringing(Ringing { state, lsb, period }) => {
            Some(Rest { lsb: *lsb, period_steps: Some(*period), state: Some(model.states[*state].name.clone()) })
        }
        AtRest::NotTried(_) => None,
    }
}

/// Why there is no limit by trial.
pub fn not_found(model: &Model) -> &'static str {
    if model.states.len() > TRIED_STATES {
        "trials are for models of up to 10000 states"
    } else {
        "no trial was stable, or each would take too long"
    }
}
