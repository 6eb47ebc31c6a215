//! The total error as `compile --reference` reports it.

use std::process::Command;

use crate::support::bench::Folder;
use crate::support::models::spec;
use serde_json::Value;

/// Runs `compile --reference` and gives the key `error` of the report and standard error.
fn error_of(spec: &std::path::Path, target: &std::path::Path, options: &[&str]) -> (Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("compile").arg(spec).arg("-o").arg(target).arg("--reference").args(options);
    let output = command.output().expect("pe-synth starts");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    let report = std::fs::read_to_string(target.join("report.json")).expect("a report is written");
    let report: Value = serde_json::from_str(&report).expect("it is JSON");
    (report["error"].clone(), text)
}

#[test]
fn the_total_error_is_near_the_sum_of_its_parts() {
    let folder = Folder::new("total_error");
    // Word length dominates, then the method, then the held inputs, then a method whose order holds for inputs.
    let cases: [(&str, &[&str]); 4] = [
        ("harmonic_oscillator", &["--multiplier", "18x18"]),
        ("lorenz", &["--span", "2s", "--solver", "euler", "--step", "200us"]),
        ("weibel5", &["--span", "100ms"]),
        ("weibel5", &["--span", "100ms", "--solver", "ab2"]),
    ];
    for (model, options) in cases {
        let (error, _) = error_of(&spec(model), &folder.0.join(options.concat()), options);
        let part = |key: &str| error[key].as_f64().unwrap_or_else(|| panic!("{model}: {key} in {error}"));
        let parts = ["word_length", "method", "input_hold"].map(part);
        let (sum, largest) = (parts.iter().sum::<f64>(), parts.iter().copied().fold(0.0, f64::max));
        let total = part("total");
        assert!(total < 1.5 * sum && total > 0.3 * largest, "{model}: {error}");
        assert!(part("reference_uncertainty") < 1e-3 * total && part("total_at_end") <= total, "{model}: {error}");
    }
}

#[test]
fn a_model_whose_solution_ends_is_written_without_a_total_error_and_with_a_warning() {
    let folder = Folder::new("no_reference");
    let path = folder.0.join("m.spec");
    let text = "model m\nsolver rk4\nstep 10 ms\nspan 1.01 s\nstate x = 1\nx' = x^2\noutput x\n";
    std::fs::write(&path, text).expect("the spec can be written");
    let (error, messages) = error_of(&path, &folder.0.join("out"), &["--allow", "E0903", "--allow", "E0907"]);
    assert!(messages.contains("W0904") && messages.contains("t = 1.0000"), "{messages}");
    let reason = error["total_reason"].as_str().expect("a reason");
    assert!(error["total"].is_null() && reason.contains("too small"), "{error}");
}
