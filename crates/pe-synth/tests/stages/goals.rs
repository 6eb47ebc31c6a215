//! Goals of `compile --max-error`: designs that exist are found, and are as right as they are said to be.

use std::process::Command;

use crate::support::bench::Folder;
use crate::support::models::spec;
use serde_json::Value;

/// Runs `compile --max-error` and gives exit code, report, if there is one, and standard error.
fn compile(name: &str, model: &str, options: &[&str]) -> (Option<i32>, Option<Value>, String) {
    let folder = Folder::new(name);
    let target = folder.0.join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let validation = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/validation");
    let path = model.strip_prefix("validation/").map(|name| validation.join(format!("{name}.spec")));
    command
        .arg("compile")
        .arg(path.unwrap_or_else(|| spec(model)))
        .arg("-o")
        .arg(&target)
        .args(["--no-pictures", "-q"])
        .args(options);
    let output = command.output().expect("pe-synth starts");
    let report = std::fs::read_to_string(target.join("report.json")).ok();
    let report = report.map(|text| serde_json::from_str(&text).expect("it is JSON"));
    (output.status.code(), report, String::from_utf8_lossy(&output.stderr).into_owned())
}

/// The report of a design with a total error of at most 1e-4, that error, and standard error.
fn found(name: &str, model: &str, options: &[&str]) -> (Value, f64, String) {
    let (exit, report, messages) = compile(name, model, &[&["--max-error", "1e-4"], options].concat());
    assert_eq!(exit, Some(0), "{messages}");
    let report = report.expect("a report");
    let total = report["error"]["total"].as_f64().expect("a total error");
    assert!(total <= 1e-4, "{total}");
    (report, total, messages)
}

/// Whether a time is a whole number of steps.
fn divides(step: f64, time: f64) -> bool {
    let steps = time / step;
    (steps - steps.round()).abs() < 1e-6 * steps
}

#[test]
fn a_goal_that_takes_longer_words_is_met() {
    let (report, _, messages) = found("goal_words", "kepler", &["--set", "e=0.9", "--solver", "rk4"]);
    let step = report["step_s"].as_f64().expect("a step");
    assert!(divides(step, 20.0) && !messages.contains("W0910"), "{step} {messages}");
    assert!(report["word"]["storage_bits"].as_u64() > Some(32), "{}", report["word"]);
}

#[test]
fn steps_are_halved_until_the_longest_word_is_right_enough() {
    // With the largest steps that double precision allows, no word is; with half of them, not that of every method.
    let (exit, report, messages) = compile("goal_halved", "validation/fpu_chain", &["--max-error", "1e-3"]);
    assert_eq!(exit, Some(0), "{messages}");
    let report = report.expect("a report");
    assert!(report["error"]["total"].as_f64().is_some_and(|error| error <= 1e-3), "{}", report["error"]);
}

#[test]
fn the_step_of_a_goal_divides_span_and_time_between_outputs() {
    // Otherwise much larger steps would do.
    let options = ["--max-error", "1e-2", "--sample", "3ms", "--span", "300ms"];
    let (exit, report, messages) = compile("goal_sample", "rc_ladder", &options);
    assert_eq!(exit, Some(0), "{messages}");
    let step = report.expect("a report")["step_s"].as_f64().expect("a step");
    assert!(step <= 3e-3 * (1.0 + 1e-9) && divides(step, 3e-3) && divides(step, 0.3), "{step}");
    let (exit, ..) = compile("goal_no_sample", "rc_ladder", &["--sample", "3ms"]);
    assert_eq!(exit, Some(2), "without a goal nothing is chosen");
}

#[test]
fn a_refusal_says_what_came_closest_and_what_limits_it() {
    let given = ["--max-error", "1e-9", "--solver", "euler", "--step", "10ms"];
    let (exit, report, messages) = compile("goal_refused", "van_der_pol", &given);
    assert!(exit == Some(1) && report.is_none(), "{messages}");
    assert!(messages.contains("the best of") && messages.contains("method limits it"), "{messages}");
    let given = ["--max-error", "1e-7", "--storage", "18", "--multiplier", "18x18", "--span", "1s", "--solver", "rk4"];
    let (exit, _, messages) = compile("goal_short", "harmonic_oscillator", &given);
    assert!(exit == Some(1) && messages.contains("word limits it"), "{messages}");
}

#[test]
fn a_stiff_model_gets_a_list_of_steps_that_can_be_given_again() {
    let (report, total, _) = found("goal_list", "validation/robertson", &["--solver", "rodas3", "--span", "10s"]);
    let early = report["early_steps"].as_array().expect("a list");
    assert!(!early.is_empty(), "{report}");
    let number = |value: &Value| value.as_f64().expect("a number");
    let texts: Vec<String> =
        early.iter().map(|early| format!("{}@{}", number(&early["step_s"]), number(&early["until_s"]))).collect();
    let (step, early) = (number(&report["step_s"]).to_string(), texts.join(","));
    let word = &report["word"];
    let (storage, ports) = (word["storage_bits"].to_string(), format!("{}x{}", word["mul_a_bits"], word["mul_b_bits"]));
    let slots = if word["coefficient_slots"] == 2 { "two-slot" } else { "one-slot" };
    let given =
        ["--solver", "rodas3", "--span", "10s", "--step", &step, "--early-steps", &early, "--storage", &storage];
    let given =
        [&given[..], &["--multiplier", &ports, "--coefficients", slots, "--widen", "0", "--reference"]].concat();
    let (exit, again, messages) = compile("goal_list_again", "validation/robertson", &given);
    assert_eq!(exit, Some(0), "{messages}");
    let again = again.expect("a report")["error"]["total"].as_f64().expect("a total error");
    assert!((again - total).abs() <= 1e-6 * total, "{again} {total}");
    let (exit, _, messages) = compile("goal_list_wrong", "validation/robertson", &["--early-steps", "3ms@10ms"]);
    assert!(exit == Some(2) && messages.contains("--early-steps"), "{messages}");
}
