//! The check in words and as JSON.

use pe_flow::report::{Stability, not_found, verdict};
use pe_ir::model::Model;
use pe_ir::source::Sources;
use pe_judge::check::stiffness::STIFF;
use pe_judge::check::{Accuracy, Check, SAFE, eigenvalue, factor};
use pe_judge::runs::Judged;
use serde_json::{Value, json};

use crate::render;

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
        "stability": Stability::of(model, check),
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
    if model.delays().next().is_some() {
        row("delays", "left out of these eigenvalues; the trial and `one step` have them".to_owned());
    }
    match check.found {
        Some(found) => {
            let end = found.unstable.map_or("no end found".to_owned(), |step| format!("{step:.3e} s is not"));
            row("found by trial", format!("{:.3e} s is stable, {end}; over {:.3e} s", found.stable, found.span));
        }
        None => row("found by trial", not_found(model).to_owned()),
    }
    let (ratio, stable) = (check.stiffness_ratio, check.stable);
    if let Some(Accuracy { step, error, tried }) = check.accuracy {
        let how = if tried { "" } else { ", by its order" };
        let words = match stable.filter(|_| ratio.is_some_and(|ratio| ratio > 1.0)) {
            Some(stable) => format!("> {stable:.3e} s (stability-limited); error {error:.1e} at {step:.3e}"),
            None => format!("{step:.3e} s has a method error of {error:.1e}{how}"),
        };
        row("accuracy step", words);
    }
    let stiff = match (ratio, stable.zip(check.accuracy)) {
        (Some(ratio), _) if ratio > STIFF => format!("; accuracy allows {ratio:.0} x: try implicit methods"),
        // Beyond the stable step the order of the method tells how far.
        (Some(ratio), _) if ratio > 1.0 => format!("; accuracy / stable step ~{ratio:.2}"),
        (Some(_), Some((stable, accuracy))) => format!("; accuracy / stable step {:.2}", accuracy.step / stable),
        _ => String::new(),
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
    if let Some(swing) = &check.swing {
        let (own, firm) = (factor(swing.largest), factor(swing.firm));
        row("differences", format!("grow {own} along the run, {firm} with a firm step"));
    }
    if let Some(chaos) = check.chaos {
        row(
            "chaos",
            format!(
                "errors grow by e every {:.2e} s; one LSB becomes visible at t = {:.3e} s",
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
