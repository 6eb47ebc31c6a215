//! Error against run time: the same bytes however it is computed, rows that can be computed alone, and a choice that
//! meets its goal.

use std::collections::HashSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::support::bench::Folder;
use crate::support::models::spec;
use serde_json::Value;

fn pe_synth(command: &str, spec: &Path, target: &Path, options: &[&str]) -> Output {
    let mut process = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    process.arg(command).arg(spec).arg("-o").arg(target).args(options);
    process.output().expect("pe-synth starts")
}

fn succeeded(output: Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn json(target: &Path, file: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(target.join(file)).expect("a file")).expect("JSON")
}

/// The lines of `accuracy.csv` as pairs of heading and field.
fn table(target: &Path) -> Vec<Vec<(String, String)>> {
    let mut reader = csv::Reader::from_path(target.join("accuracy.csv")).expect("a table");
    let head: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let rows = reader.records().map(|record| {
        head.iter().cloned().zip(record.unwrap().iter().map(str::to_owned).collect::<Vec<_>>()).collect()
    });
    rows.collect()
}

fn field<'a>(row: &'a [(String, String)], name: &str) -> &'a str {
    &row.iter().find(|(head, _)| head == name).unwrap_or_else(|| panic!("no column {name}")).1
}

const FILES: [&str; 5] = ["accuracy.csv", "accuracy.json", "index.html", "work-precision.png", "work-precision.svg"];

/// Lists that span twelve points of the oscillator, of which the explicit Euler method spoils some.
const LISTS: [&str; 8] =
    ["--solver", "euler,rk4", "--step", "1,20ms,10ms", "--multiplier", "18x18,32x32", "--span", "20s"];

#[test]
fn the_result_does_not_depend_on_the_number_of_jobs() {
    let folder = Folder::new("accuracy_jobs");
    let model = spec("van_der_pol");
    let targets = ["1", "3"].map(|jobs| {
        let target = folder.0.join(jobs);
        succeeded(pe_synth("accuracy", &model, &target, &[&LISTS[..], &["--jobs", jobs]].concat()));
        target
    });
    let mut names: Vec<_> = fs::read_dir(&targets[0]).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, FILES);
    for file in FILES {
        assert!(fs::read(targets[0].join(file)).unwrap() == fs::read(targets[1].join(file)).unwrap(), "{file} differs");
    }
}

#[test]
fn a_row_of_the_table_can_be_run_again_and_a_point_that_fails_is_infinitely_wrong() {
    let folder = Folder::new("accuracy_rows");
    let (model, target) = (spec("van_der_pol"), folder.0.join("out"));
    let text = succeeded(pe_synth("accuracy", &model, &target, &LISTS));
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    let rows = table(&target);
    assert_eq!(rows.len(), 12);
    let (mut compiled, mut failed) = (0, 0);
    for row in &rows {
        if field(row, "status") == "failed" {
            failed += 1;
            assert_eq!(field(row, "error_total"), "inf");
            assert!(!field(row, "message").is_empty() && ["1e0", "2e-2"].contains(&field(row, "step_s")), "{row:?}");
            continue;
        }
        compiled += 1;
        if compiled % 3 != 1 {
            continue;
        }
        let words: Vec<&str> = field(row, "command").split(' ').collect();
        let alone = folder.0.join(format!("alone{compiled}"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        command.args(&words[1..]).arg("-o").arg(&alone).current_dir(model.parent().expect("a folder"));
        succeeded(command.output().expect("pe-synth starts"));
        let report = json(&alone, "report.json");
        let pairs = [
            ("cycles_per_step", "/cycles_per_step"),
            ("products_per_step", "/macs_per_step"),
            ("error_total", "/error/total"),
            ("error_total_at_end", "/error/total_at_end"),
            ("error_l2", "/error/total_l2"),
            ("error_double", "/error/double"),
            ("error_method", "/error/method"),
            ("error_word_length", "/error/word_length"),
            ("error_coefficient_at_end", "/error/coefficient_at_end"),
            ("period_error", "/error/period/error"),
            ("lut", "/area/lut"),
        ];
        for (column, pointer) in pairs {
            let alone = report.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("no {pointer}"));
            assert_eq!(field(row, column).parse::<f64>().unwrap(), alone, "{column}");
        }
        let number = |column: &str| field(row, column).parse::<f64>().unwrap();
        let seconds = number("cycles_per_step") * number("steps") / (number("clock_mhz") * 1e6);
        assert!((number("seconds") / seconds - 1.0).abs() < 1e-12);
        // The parts make the whole: method and word length cannot be far from it in sum.
        let parts = number("error_double") + number("error_word_length");
        assert!(number("error_total") <= 1.01 * parts, "{row:?}");
        // The limit cycle has a period of 7.09 s for mu = 1.5 (Strogatz's tables give 6.66 at 1 and 7.63 at 2).
        assert!((6.66..7.63).contains(&number("period_s")), "{row:?}");
    }
    assert!(compiled >= 6 && failed >= 2, "{compiled} compiled, {failed} failed");
    let stored = json(&target, "accuracy.json");
    assert_eq!(stored["reference_vouched"], true);
    assert!(stored["points"].as_array().unwrap().iter().any(|point| point["error"]["total"] == "inf"));
}

/// Each method finds events in steps of its own, so solutions are compared where its runs are; proposed steps divide delays.
#[test]
fn points_of_models_with_events_and_delays_are_compared_at_their_own_times() {
    let folder = Folder::new("accuracy_events");
    let path = folder.0.join("m.spec");
    let text = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nstate x = 0\nstate y = 0\nx' = 1 - x\n\
        y' = x(t - 5 ms) - 0.2*y\nwhen x > 0.5 after 3 ms { y = 1 }\noutput x, y\n";
    fs::write(&path, text).expect("the spec can be written");
    let target = folder.0.join("out");
    succeeded(pe_synth("accuracy", &path, &target, &["--multiplier", "32x32"]));
    let rows = table(&target);
    let solvers: HashSet<&str> = rows.iter().map(|row| field(row, "solver")).collect();
    assert!(rows.len() >= 20 && solvers.len() >= 8, "{} points of {solvers:?}", rows.len());
    for (number, row) in rows.iter().enumerate() {
        assert_eq!(field(row, "status"), "compiled", "{row:?}");
        if number % 7 == 3 {
            let alone = folder.0.join(format!("alone{number}"));
            let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
            command.args(field(row, "command").split(' ').skip(1)).arg("-o").arg(&alone).current_dir(&folder.0);
            succeeded(command.output().expect("pe-synth starts"));
            let total = json(&alone, "report.json").pointer("/error/total").and_then(Value::as_f64);
            assert_eq!(field(row, "error_total").parse::<f64>().ok(), total, "{row:?}");
        }
    }
}

#[test]
fn conserved_quantities_drift_less_with_a_method_of_higher_order() {
    let folder = Folder::new("accuracy_conserved");
    let path = folder.0.join("m.spec");
    let text = "model m\nsolver rk4\nstep 10 ms\nspan 10 s\nstate x = 1\nstate v = 0\nstate a = 1\nstate b = 0\n\
        x' = v\nv' = -x\na' = b - 2*a\nb' = 2*a - b\nE = (x^2 + v^2)/2\noutput x, E, a, b\n";
    fs::write(&path, text).expect("the spec can be written");
    let target = folder.0.join("out");
    let options = ["--solver", "heun,rk4", "--step", "20ms", "--multiplier", "32x32", "--conserved", "E"];
    succeeded(pe_synth("accuracy", &path, &target, &options));
    let rows = table(&target);
    let drift = |row: &[(String, String)]| -> Vec<f64> {
        field(row, "drift").split("; ").map(|number| number.parse().unwrap()).collect()
    };
    assert_eq!(field(&rows[0], "conserved"), "E; a + b");
    // Heun's method multiplies the energy by 1 + h^4/4 in each step of x'' = -x.
    let expected = libm::pow(1.0 + libm::pow(0.02, 4.0) / 4.0, 500.0) - 1.0;
    let (heun, rk4) = (drift(&rows[0]), drift(&rows[1]));
    assert!((heun[0] / expected - 1.0).abs() < 0.02, "{heun:?}, expected {expected}");
    assert!(rk4[0] < 0.01 * heun[0] && heun[1] < 1e-8, "{heun:?} {rk4:?}");
}

#[test]
fn the_cheapest_point_meets_the_goal_and_compile_builds_it() {
    let folder = Folder::new("accuracy_goal");
    let (model, target) = (spec("van_der_pol"), folder.0.join("out"));
    let text = succeeded(pe_synth("accuracy", &model, &target, &["--max-error", "1e-3", "--span", "10s"]));
    assert!(text.contains("cheapest of the"), "{text}");
    let rows = table(&target);
    let number = |row: &[(String, String)], column: &str| field(row, column).parse::<f64>().unwrap_or(f64::INFINITY);
    let chosen = rows.iter().find(|row| field(row, "chosen") == "1").expect("a choice");
    assert!(number(chosen, "error_total") <= 1e-3);
    for row in &rows {
        let met = number(row, "error_total") <= 1e-3;
        assert!(!met || 1.021 * number(row, "seconds") >= number(chosen, "seconds"), "{row:?}");
    }
    let output = pe_synth("accuracy", &model, &folder.0.join("none"), &["--max-error", "1e-15", "--span", "2s"]);
    assert_eq!(output.status.code(), Some(1));

    let built = folder.0.join("built");
    let text = succeeded(pe_synth("compile", &model, &built, &["--max-error", "1e-3", "--span", "10s"]));
    assert!(text.contains("chosen"), "{text}");
    let report = json(&built, "report.json");
    assert_eq!(report["solver"], field(chosen, "solver"));
    assert_eq!(report["step_s"].as_f64(), Some(number(chosen, "step_s")));
    assert_eq!(report["word"]["storage_bits"].as_f64(), Some(number(chosen, "storage_bits")));
    assert_eq!(report["error"]["total"].as_f64(), Some(number(chosen, "error_total")));
    assert!(!report["choice"]["runners_up"].as_array().unwrap().is_empty());
}
