//! The key `stability` of reports.

use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity};
use pe_judge::check::{Accuracy, Check, Rest, Ringing, SAFE, TRIED_STATES};
use serde_json::{Value, json};

/// Findings of states that are listed.
const LISTED: usize = 10;

/// Digits that figures from eigenvalues keep in reports: the last ones depend on the order of sums.
const DIGITS: i32 = 4;

/// The verdict in a word: `fine`, `warning` or `refused`.
pub fn verdict(findings: &[Diagnostic]) -> &'static str {
    match findings.iter().map(|finding| finding.severity).max() {
        None => "fine",
        Some(Severity::Warning) => "warning",
        Some(Severity::Error) => "refused",
    }
}

/// A figure with a few digits.
fn few(number: f64) -> Value {
    if number == 0.0 || !number.is_finite() {
        return json!(if number.is_finite() { Some(0.0) } else { None });
    }
    let text = format!("{number:.*e}", DIGITS as usize - 1);
    json!(text.parse::<f64>().unwrap_or(number))
}

/// A growth of one step: as many digits as do not depend on the order of sums.
fn steady(number: f64) -> f64 {
    libm::round(number * 1e9) / 1e9
}

/// The key `stability` of reports.
pub fn report(model: &Model, check: &Check) -> Value {
    let prediction = &check.prediction;
    let limited_by = prediction.limit.as_ref().map(|limit| {
        json!({"state": model.states[limit.state].name, "time_s": limit.time,
               "eigenvalue": [few(limit.eigenvalue.0), few(limit.eigenvalue.1)]})
    });
    let mut value = json!({
        "verdict": verdict(&check.findings),
        "codes": check.findings.iter().map(|finding| finding.code).collect::<Vec<_>>(),
        "predicted_step_s": prediction.limit.as_ref().map(|limit| few(limit.step)),
        "go_step_s": prediction.limit.as_ref().map(|limit| few(SAFE * limit.step)),
        "basis": prediction.basis.name(),
        "points": prediction.points,
        "trajectory": if check.own_trajectory { "run" } else { "reference" },
        "limited_by": limited_by,
        "found_step_s": check.found.map(|found| few(found.stable)),
        "found_unstable_step_s": check.found.and_then(|found| found.unstable).map(few),
        "found_over_s": check.found.map(|found| few(found.span)),
        "eigenvalue_bound": few(prediction.bound),
        "fastest_decay": few(prediction.fastest),
        "stiffness": few(prediction.fastest * model.span),
        "growth_log": few(prediction.growth),
        "amplification": check.growth.as_ref().map(|growth| {
            json!({"exact": steady(growth.exact()), "rounded": steady(growth.rounded()), "steps": growth.steps,
                   "basis": if growth.all { "all eigenvalues" } else { "outer eigenvalues, estimated" }})
        }),
        "smallest_pivot": check.pivot.as_ref().map(|pivot| json!({"state": pivot.state, "magnitude": few(pivot.magnitude)})),
        "dead_bands": check.dead_bands.iter().take(LISTED).map(|dead| {
            json!({"state": model.states[dead.state].name, "time_s": dead.time, "part": few(dead.part), "loss": few(dead.loss)})
        }).collect::<Vec<_>>(),
        "chaos": check.chaos.map(|chaos| json!({"rate": few(chaos.rate), "divergence_s": few(chaos.divergence)})),
    });
    if let Some(Accuracy { step, error, tried }) = check.accuracy {
        value["accuracy_step_s"] = few(step);
        value["accuracy_error"] = few(error);
        value["accuracy_tried"] = json!(tried);
        value["stiffness_ratio"] = check.stiffness_ratio.map_or(Value::Null, few);
    }
    if prediction.limit.is_none() {
        value["predicted_step_reason"] = json!("no damped mode of the model limits this method");
    }
    if check.pivot.is_none() {
        value["smallest_pivot_reason"] = json!("the method has no pivot that varies, or the runs were refused");
    }
    match &check.rest {
        None => {}
        Some(Rest::Zero) => value["rest"] = json!({"lsb": 0}),
        Some(Rest::Ringing(Ringing { state, lsb, period })) => {
            value["rest"] = json!({"lsb": lsb, "period_steps": period, "state": model.states[*state].name});
        }
        Some(Rest::NotTried(reason)) => {
            value["rest"] = Value::Null;
            value["rest_reason"] = json!(reason);
        }
    }
    if check.growth.is_none() {
        value["amplification_reason"] = json!("only of refused steps, and of large models that are not linear");
    }
    if check.chaos.is_none() {
        value["chaos_reason"] = json!("only `check` looks for it, and only where it is");
    }
    if check.found.is_none() {
        value["found_step_reason"] = json!(not_found(model));
    }
    value
}

/// Why there is no limit by trial.
pub fn not_found(model: &Model) -> &'static str {
    if model.states.len() > TRIED_STATES {
        "trials are for models of up to 10000 states"
    } else {
        "no trial was stable, or each would take too long"
    }
}
