//! The check in words and as JSON.

use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity, Sources};
use serde_json::{Value, json};

use super::findings::{eigenvalue, factor};
use super::remedies::SAFE;
use super::rest::{Rest, Ringing};
use super::stiffness::STIFF;
use super::trials::Accuracy;
use super::{Check, TRIED_STATES};
use crate::render;
use crate::runs::Judged;

/// Findings of states that are listed.
const LISTED: usize = 10;

/// Digits that figures from eigenvalues keep in reports: the last ones depend on the order of sums.
const DIGITS: i32 = 4;

/// The verdict in a word: `fine`, `warning` or `refused`.
fn verdict(findings: &[Diagnostic]) -> &'static str {
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
fn not_found(model: &Model) -> &'static str {
    if model.states.len() > TRIED_STATES {
        "trials are for models of up to 10000 states"
    } else {
        "no trial was stable, or each would take too long"
    }
}

/// The check as JSON: what `report` has, the errors of the runs and all findings.
pub fn json(model: &Model, check: &Check, judged: Option<&Judged>, asked_span: f64, sources: &Sources) -> Value {
    json!({
        "generator": concat!("pe-synth ", env!("CARGO_PKG_VERSION")),
        "model": model.name,
        "odes": model.odes(),
        "solver": model.solver.name(),
        "step_s": model.step,
        "span_s": asked_span,
        "judged_span_s": model.span,
        "verdict": verdict(&check.findings),
        "stability": report(model, check),
        "error": judged.map(|judged| {
            json!({"worst_state": model.states[judged.errors.worst_state].name, "word_length": judged.errors.word_length,
                   "coefficient": judged.errors.coefficient, "method": judged.errors.method,
                   "input_hold": judged.errors.input_hold})
        }),
        "findings": check.findings.iter().map(|finding| render::for_tools(finding, sources)).collect::<Vec<_>>(),
    })
}

/// The check in a line.
pub fn summary(model: &Model, check: &Check) -> String {
    let limit = match (check.found.filter(|found| found.unstable.is_some()), &check.prediction.limit) {
        (Some(found), _) => format!("stable up to {:.2e} s by trial", found.stable),
        (None, Some(limit)) => format!("stable up to {:.2e} s by {}", limit.step, check.prediction.basis.name()),
        (None, None) => format!("nothing limits {}", model.solver.name()),
    };
    format!("{}: step {:.2e} s, {limit}", verdict(&check.findings), model.step)
}

/// Rows of the result: name and text.
fn rows(model: &Model, check: &Check) -> Vec<(&'static str, String)> {
    let prediction = &check.prediction;
    let mut rows = Vec::new();
    let mut row = |name, text: String| rows.push((name, text));
    let points =
        if prediction.points == 1 { "the model is linear".to_owned() } else { format!("{} times", prediction.points) };
    match &prediction.limit {
        Some(limit) => {
            row("largest step", format!("{:.3e} s by {}, {points}", limit.step, prediction.basis.name()));
            row(
                "go / no-go",
                format!("{:.3e} s, {SAFE} of it; the step is {:.2} of it", SAFE * limit.step, model.step / limit.step),
            );
            row(
                "limited by",
                format!(
                    "`{}` at t = {:.3e} s: {}",
                    model.states[limit.state].name,
                    limit.time,
                    eigenvalue(limit.eigenvalue)
                ),
            );
        }
        None => row("largest step", format!("no damped mode limits {}", model.solver.name())),
    }
    match check.found {
        Some(found) => {
            let end = found.unstable.map_or("no end found".to_owned(), |step| format!("{step:.3e} s is not"));
            row("found by trial", format!("{:.3e} s is stable, {end}; over {:.3e} s", found.stable, found.span));
        }
        None => row("found by trial", not_found(model).to_owned()),
    }
    if let Some(Accuracy { step, error, tried }) = check.accuracy {
        let how = if tried { "" } else { ", by the order of the method" };
        row("accuracy step", format!("{step:.3e} s has a method error of {error:.1e}{how}"));
    }
    let ratio = check.stiffness_ratio;
    let stiff = match ratio {
        Some(ratio) if ratio > STIFF => format!("; accuracy allows {ratio:.0} x: try implicit methods"),
        Some(ratio) => format!("; accuracy step / stable step {ratio:.2}"),
        None => String::new(),
    };
    row("stiffness", format!("fastest decay x span {:.1e}{stiff}", prediction.fastest * model.span));
    if prediction.growth > 1e-3 {
        row("growth", format!("undamped modes grow {} over the span", factor(prediction.growth)));
    }
    if let Some(growth) = &check.growth {
        let grows = format!("grows {:.9}, rounded coefficients {:.9}", growth.exact(), growth.rounded());
        match growth.steps {
            1 => row("one step", grows),
            steps => {
                row("samples repeat", format!("after {steps} steps, which {}", grows.replacen("grows", "grow", 1)))
            }
        }
    }
    if let Some(chaos) = check.chaos {
        row(
            "chaos",
            format!(
                "errors grow by e every {:.2e} s; one LSB is felt at t = {:.3e} s",
                1.0 / chaos.rate,
                chaos.divergence
            ),
        );
    }
    rows
}

/// The whole check in words, 80 columns wide.
pub fn text(model: &Model, check: &Check, judged: Option<&Judged>, asked_span: f64) -> String {
    let mut text = format!(
        "{}: {}, {}, step {:e} s, span {asked_span} s\n",
        model.name,
        model.size(),
        model.solver.name(),
        model.step
    );
    let mut row = |name: &str, words: &str| text += &format!("  {name:<16} {words}\n");
    row("verdict", verdict(&check.findings));
    if model.span < asked_span {
        row("ran exactly", &format!("the first {:.3e} s, for the model is large", model.span));
    }
    rows(model, check).iter().for_each(|(name, words)| row(name, words));
    if let Some(judged) = judged {
        let errors = judged.errors;
        row("method error", &format!("{:.1e} (half-step estimate)", errors.method));
        if errors.input_hold > 0.0 {
            row("input hold", &format!("{:.1e}", errors.input_hold));
        }
        row("word length", &format!("{:.1e}, worst `{}`", errors.word_length, model.states[errors.worst_state].name));
    }
    text
}
