//! Inputs: what steps do not see of their signals is part of the verdict.

use std::path::Path;
use std::process::Command;

use crate::support::bench::Folder;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;

/// What a command says: exit code, the key `error` of its result, codes of its messages.
struct Answer {
    exit: Option<i32>,
    error: Value,
    codes: Vec<String>,
}

fn codes_of(messages: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(messages).into_owned();
    let lines = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    lines.filter_map(|line| line["code"].as_str().map(str::to_owned)).collect()
}

fn check(folder: &Path, spec: &str) -> Answer {
    std::fs::write(folder.join("m.spec"), spec).expect("the spec can be written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.current_dir(folder).args(["check", "m.spec", "--message-format", "json"]).output();
    let output = output.expect("pe-synth starts");
    let result: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    Answer { exit: output.status.code(), error: result["error"].clone(), codes: codes_of(&output.stderr) }
}

fn compile(folder: &Path, spec: &str, options: &[&str]) -> Answer {
    std::fs::write(folder.join("m.spec"), spec).expect("the spec can be written");
    let allowed = ["E0903", "E0913", "E0914", "E0915"].map(|code| ["--allow", code]).concat();
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.current_dir(folder).args(["compile", "m.spec", "-o", "out", "--reference", "--message-format", "json"]);
    let output = command.args(allowed).args(options).output().expect("pe-synth starts");
    let report = std::fs::read_to_string(folder.join("out/report.json")).unwrap_or_default();
    let report: Value = serde_json::from_str(&report).unwrap_or(Value::Null);
    Answer { exit: output.status.code(), error: report["error"].clone(), codes: codes_of(&output.stderr) }
}

/// A first-order lag with a step of 1 ms.
fn lag(solver: &str, tau: &str, input: &str) -> String {
    format!(
        "model m\nsolver {solver}\nstep 1 ms\nspan 200 ms\ninput u = {input}\nstate x = 0\nx' = (u - x)/{tau}\noutput x\n"
    )
}

#[test]
fn what_steps_do_not_see_has_a_code_of_its_own() {
    let folder = Folder::new("unseen");
    let cases = [
        // Edges on steps are exact.
        ("0.01", "square(1, 50 Hz)", None),
        ("0.01", "pulse(1, 10 ms, 1 ms)", None),
        ("0.01", "square(1, 70 Hz)", Some("W0921")),
        ("0.001", "pulse(1, 10.2 ms, 9 s)", Some("E0913")),
        ("0.01", "sine(1, 1 kHz)", Some("E0914")),
        ("0.01", "sine(1, 1 kHz, 0, 1)", Some("E0914")),
        ("0.001", "sine(0.1, 1 kHz, 1, 1)", Some("W0922")),
        ("0.01", "pulse(1000, 10.2 ms, 0.5 ms)", Some("E0915")),
        ("0.01", "pulse(3, 10.2 ms, 0.5 ms, 1)", Some("W0923")),
        ("0.01", "pulse(0.3, 10.2 ms, 0.5 ms, 1)", None),
        ("0.01", "sine(1, 20 Hz)", Some("W0920")),
        ("0.01", "sine(1, 0.5 Hz)", None),
        // The mean of a ramp is that of its value half a step later.
        ("0.01", "ramp(0, 1, 0, 200 ms)", None),
    ];
    for (tau, input, wanted) in cases {
        let answer = check(&folder.0, &lag("rk4", tau, input));
        assert_eq!(answer.codes, wanted.into_iter().collect::<Vec<_>>(), "{input} with tau {tau}");
        let refused = wanted.is_some_and(|code| code.starts_with('E'));
        assert_eq!(answer.exit, Some(i32::from(refused)), "{input} with tau {tau}");
    }
    let exact = check(&folder.0, &lag("rk4", "0.01", "square(1, 50 Hz)"));
    assert_eq!(exact.error["input_hold"], 0.0);
}

/// Numbers of cases with a solver and two numbers from 0 to 1.
fn random_cases(seed: u64, count: usize) -> impl Iterator<Item = (usize, &'static str, f64, f64)> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut part = move || random.next_u64() as f64 / u64::MAX as f64;
    (0..count).map(move |case| (case, ["rk4", "heun", "rodas3", "ab3"][case / 4 % 4], part(), part()))
}

/// Asserts that the parts of the error come to nearly the true one; `label` is for messages.
fn assert_not_flattering(answer: &Answer, label: &str) {
    let number = |key: &str| answer.error[key].as_f64().unwrap_or_else(|| panic!("{label}: {key}: {:?}", answer.codes));
    let (stated, truth) = (number("input_hold") + number("method"), number("double"));
    println!("{label}: {stated:.1e}, truth {truth:.1e}");
    assert!(stated > 0.4 * truth - 1e-6, "{label}: {stated:e} is not {truth:e}");
    assert_eq!(answer.exit, Some(0), "{label}");
}

#[test]
fn the_stated_error_of_inputs_is_never_far_below_the_true_one() {
    let folder = Folder::new("stated");
    for (case, solver, first, second) in random_cases(14, 24) {
        let input = match case % 4 {
            0 => format!("pulse(1, {} ms, 9 s)", 20.0 * first),
            1 => format!("pulse({}, {} ms, {} ms)", 1.0 + 9.0 * second, 20.0 * first, 2.0 * second),
            2 => format!("square(1, {} Hz, 0, {})", 5.0 + 300.0 * first, 0.1 + 0.8 * second),
            _ => format!("sine(1, {} Hz, 0, {})", 5.0 + 300.0 * first, 6.0 * second),
        };
        let answer = compile(&folder.0, &lag(solver, "0.01", &input), &[]);
        assert_not_flattering(&answer, &format!("{solver}, {input}"));
    }
}

#[test]
fn the_stated_error_of_lines_and_played_signals_is_never_far_below_the_true_one() {
    let folder = Folder::new("stated_lines");
    for (case, solver, first, second) in random_cases(15, 20) {
        let signal = match case % 4 {
            0 => format!("pulse(1, {} ms, {} ms)", 20.0 * first, 1.0 + 20.0 * second),
            1 => format!("square(1, {} Hz, 0, {})", 5.0 + 60.0 * first, 0.1 + 0.8 * second),
            2 => format!("sine(1, {} Hz, 0, {})", 5.0 + 200.0 * first, 6.0 * second),
            _ => format!("pwm(-1, 1, {} Hz, 0.5 + 0.3*sine(1, 20 Hz))", 10.0 + 60.0 * first),
        };
        let mut spec = lag(solver, "0.01", &signal);
        let played = case % 4 != 2 && case % 8 < 4;
        spec = match played {
            true => spec.replace("input u = ", "u = "),
            false => spec.replace(&signal, &format!("{signal}, linear")),
        };
        if case % 8 == 1 {
            spec = spec.replace("x' = (u - x)", "x' = (u*(1 - 0.2*x) - x)");
        }
        let answer = compile(&folder.0, &spec, &[]);
        assert_not_flattering(&answer, &format!("{solver}, {signal}, played {played}"));
    }
}

#[test]
fn signals_add_scale_and_modulate() {
    let folder = Folder::new("made");
    let inputs = [
        ("25*pulse(1, 10 ms, 20 ms)*sine(1, 100 Hz)", None),
        ("chirp(0.5, 1 Hz, 20 Hz, 100 ms) + 0.1*exp(-time/0.05)", None),
        ("pwm(-1, 1, 50 Hz, 0.5 + 0.4*sine(1, 5 Hz))", Some("W0921")),
        ("max(sine(1, 5 Hz), 0)", None),
        ("0.5 - square(1, 50 Hz)", None),
    ];
    for (input, wanted) in inputs {
        let answer = compile(&folder.0, &lag("heun", "0.02", input), &["--step", "0.2e-3"]);
        let number =
            |key: &str| answer.error[key].as_f64().unwrap_or_else(|| panic!("{input}: {key}: {:?}", answer.codes));
        let codes = answer.codes.iter().filter(|code| *code == "W0921").count();
        assert_eq!(codes, usize::from(wanted.is_some() && number("input_hold") > 0.02), "{input}: {:?}", answer.codes);
        assert_not_flattering(&answer, input);
    }
}
