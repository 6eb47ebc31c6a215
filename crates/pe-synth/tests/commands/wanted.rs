//! Goals in any subset: what is chosen keeps all limits, nothing that was tried is better, and refusals say why.

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

fn told(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).concat()
}

fn stored(target: &Path, file: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(target.join(file)).expect("a file")).expect("JSON")
}

/// The device of these tests, with its LUTs, flip-flops, DSP blocks and block RAMs.
const DEVICE: &str = "GW2A-LV18";
const RESOURCES: [(&str, f64); 4] =
    [("/area/lut", 20_736.0), ("/area/ff", 15_552.0), ("/area/dsp", 48.0), ("/area/bram18", 46.0)];

/// Total error, times real time, part of the device, size of a report or a row; none of one that failed.
fn figures(of: &Value) -> Option<[f64; 4]> {
    let number = |pointer: &str| of.pointer(pointer).and_then(Value::as_f64);
    let part = RESOURCES.iter().map(|(key, all)| number(key).unwrap_or(f64::NAN) / all).fold(0.0, f64::max);
    let [lut, dsp, bram] = ["/area/lut", "/area/dsp", "/area/bram18"].map(|key| number(key).unwrap_or(f64::NAN));
    let size = lut + 250.0 * dsp + 180.0 * bram;
    Some([number("/error/total")?, 1e3 / number("/time_per_simulated_second_ms")?, part, size])
}

/// Goals as options, and whether figures keep their limits.
type Case = (&'static [&'static str], fn([f64; 4]) -> bool);

const CASES: [Case; 5] = [
    (&["--max-error", "1e-4", "--minimise", "area"], |[error, ..]| error <= 1e-4),
    (&["--realtime", "150000"], |[error, speed, ..]| error <= 1e-2 && speed >= 150_000.0),
    (&["--device", DEVICE, "--fit", "--minimise", "error"], |[error, _, part, _]| error <= 1e-2 && part <= 1.0),
    (&["--max-error", "1e-3", "--realtime", "1e5", "--device", DEVICE, "--fit"], |[error, speed, part, _]| {
        error <= 1e-3 && speed >= 1e5 && part <= 1.0
    }),
    (&["--realtime", "20000", "--minimise", "area"], |[error, speed, ..]| error <= 1e-2 && speed >= 20_000.0),
];

#[test]
fn what_compile_chooses_keeps_all_limits() {
    let folder = Folder::new("goals_compile");
    for (index, (options, keeps)) in CASES.into_iter().enumerate() {
        let target = folder.0.join(index.to_string());
        let options = [options, &["--span", "5s", "--no-pictures"]].concat();
        let output = pe_synth("compile", &spec("van_der_pol"), &target, &options);
        assert!(output.status.success(), "{options:?}: {}", told(&output));
        let report = stored(&target, "report.json");
        let found = figures(&report).expect("figures");
        assert!(keeps(found), "{options:?}: {found:?}");
        let choice = &report["choice"];
        assert!(choice["tried"].as_u64() >= choice["met"].as_u64(), "{choice}");
        let expected = options.iter().position(|word| *word == "--minimise").map_or("time", |place| options[place + 1]);
        assert_eq!(choice["minimise"], expected);
    }
}

#[test]
fn of_the_points_of_explore_the_best_that_keeps_all_limits_is_named() {
    let folder = Folder::new("goals_explore");
    let target = folder.0.join("out");
    let lists = ["--solver", "heun,rk4,ab4", "--step", "50ms,20ms,5ms", "--multiplier", "18x18,32x32", "--span", "5s"];
    for (options, keeps) in CASES {
        let output = pe_synth("explore", &spec("van_der_pol"), &target, &[&lists[..], options].concat());
        let whole = stored(&target, "points.json");
        let rows = whole["points"].as_array().expect("a list");
        let smaller = |of: [f64; 4]| match options.iter().position(|word| *word == "--minimise") {
            Some(place) if options[place + 1] == "area" => of[3],
            Some(_) => of[0],
            None => 1.0 / of[1],
        };
        let best = rows.iter().filter_map(figures).filter(|of| keeps(*of)).map(smaller).fold(f64::INFINITY, f64::min);
        if best.is_infinite() {
            assert!(output.status.code() == Some(1) && whole["chosen"].is_null(), "{}", told(&output));
            assert!(told(&output).contains("meets the goals"), "{}", told(&output));
            continue;
        }
        assert!(output.status.success(), "{}", told(&output));
        let chosen = &rows[whole["chosen"].as_u64().expect("a point") as usize];
        let found = figures(chosen).expect("figures");
        assert!(keeps(found) && smaller(found) <= 1.021 * best, "{options:?}: {found:?}, {best}");
        // What is told to miss a limit does, and would be better.
        for miss in whole["goals"]["misses"].as_array().into_iter().flatten() {
            let row = figures(&rows[miss["point"].as_u64().expect("a point") as usize]).expect("figures");
            assert!(!keeps(row) && smaller(row) < smaller(found), "{miss}");
        }
    }
}

#[test]
fn goals_that_nothing_meets_are_refused_with_what_is_out_of_reach() {
    let folder = Folder::new("goals_refused");
    let target = folder.0.join("out");
    let refused = |options: &[&str]| {
        let output = pe_synth("compile", &spec("van_der_pol"), &target, &[options, &["--span", "5s"]].concat());
        assert!(!target.exists(), "something was written");
        (output.status.code(), told(&output))
    };
    let (code, text) = refused(&["--max-error", "1e-3", "--realtime", "1e9"]);
    assert!(code == Some(1) && text.contains("real time is out of reach by a factor of"), "{text}");
    assert!(text.contains("times as fast") && !text.contains("the error is out of reach"), "{text}");
    assert!(text.contains("error[E0825]") && text.contains("help: "), "{text}");
    let (code, text) = refused(&["--max-error", "1e-6", "--realtime", "300000"]);
    assert!(code == Some(1) && text.contains("out of reach"), "{text}");
    for usage in [&["--fit"][..], &["--sample", "3ms"]] {
        assert_eq!(refused(usage).0, Some(2), "{usage:?}");
    }
}

#[test]
fn the_example_of_the_page_gives_the_code_and_so_does_a_sweep() {
    let section = pe_ir::codes::explain("E0825").expect("a section");
    let example = section.split("```text\npe-synth compile models/").nth(1).and_then(|rest| rest.lines().next());
    let mut words = example.expect("a command").split_whitespace();
    let file = words.next().expect("a spec").rsplit('/').next().expect("a name").trim_end_matches(".spec");
    let options: Vec<&str> = words.collect();
    let folder = Folder::new("goals_example");
    let target = folder.0.join("out");
    let output = pe_synth("compile", &spec(file), &target, &options);
    assert!(output.status.code() == Some(1) && told(&output).contains("error[E0825]"), "{}", told(&output));
    let few = ["--span", "1s", "--solver", "rk4", "--step", "10ms", "--pes", "1", "--multiplier", "25x18"];
    let output = pe_synth("explore", &spec(file), &target, &[&few[..], &["--realtime", "1e9"]].concat());
    let text = told(&output);
    assert!(
        output.status.code() == Some(1) && text.contains("error[E0825]") && text.contains("by a factor of"),
        "{text}"
    );
}
