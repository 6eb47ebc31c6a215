//! Sweeps that do not do all the work: points that are too wrong, and sweeps that have a time.

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

fn rows(target: &Path) -> Vec<Value> {
    stored(target, "points.json")["points"].as_array().expect("a list").clone()
}

/// The error that a row says its run was ended by.
fn at_least(row: &Value) -> f64 {
    let message = row["message"].as_str().expect("a message");
    let number = message.split(' ').find_map(|word| word.parse::<f64>().ok());
    number.unwrap_or_else(|| panic!("no number in `{message}`"))
}

#[test]
fn points_that_are_too_wrong_are_those_that_would_be_and_all_others_stay_as_they_are() {
    let folder = Folder::new("ended_early");
    // Methods that are too wrong from the first steps on, later, and not at all; words that are.
    let options = ["--pes", "1", "--solver", "euler,heun,rk4", "--step", "100ms,20ms,5ms", "--span", "10s"];
    let words = ["--multiplier", "18x18,32x32", "--storage", "18,32", "--tries", "200"];
    let mut ended = 0;
    for model in ["van_der_pol", "lotka_volterra"] {
        let [whole, part] = ["whole", "part"].map(|name| folder.0.join(format!("{model}_{name}")));
        let options = [&options[..], &words].concat();
        let output = pe_synth("explore", &spec(model), &whole, &[&options[..], &["--max-error", "any"]].concat());
        assert!(output.status.success(), "{}", told(&output));
        for limit in ["1e-2", "0.1"] {
            let output = pe_synth("explore", &spec(model), &part, &[&options[..], &["--max-error", limit]].concat());
            assert!(output.status.success(), "{}", told(&output));
            let (whole, part) = (rows(&whole), rows(&part));
            assert_eq!(whole.len(), part.len());
            for (mut whole, mut part) in whole.into_iter().zip(part) {
                if part["exit_code"] == 0 {
                    ended += 1;
                    // One that would be refused after a longer run may be ended by its error before.
                    if let Some(total) = whole["error"]["total"].as_f64() {
                        assert!(total > limit.parse().unwrap(), "{part} against {total}");
                        assert!(at_least(&part) <= 1.06 * total, "{part} against {total}");
                    }
                    continue;
                }
                for row in [&mut whole, &mut part] {
                    let row = row.as_object_mut().expect("a row");
                    row.retain(|key, _| !["fronts", "sha256"].contains(&key.as_str()));
                }
                assert_eq!(whole, part);
            }
        }
    }
    assert!(ended > 10, "only {ended} points were too wrong");
}

#[test]
fn a_sweep_that_had_too_little_time_says_so_and_goes_on_to_the_same_bytes() {
    let folder = Folder::new("within");
    let model = spec("weibel5");
    let options = ["--pes", "2,4,8", "--solver", "heun,rk4", "--step", "20us,10us", "--jobs", "1"];
    let [whole, part] = ["whole", "part"].map(|name| folder.0.join(name));
    let clock = std::time::Instant::now();
    let output = pe_synth("explore", &model, &whole, &options);
    assert!(output.status.success(), "{}", told(&output));
    let seconds = clock.elapsed().as_secs_f64();
    let mut tried = 0;
    // How far a sweep gets is up to the machine.
    for share in [0.6, 0.4, 0.8, 0.2] {
        let _ = fs::remove_dir_all(&part);
        let within = format!("{:.2}s", share * seconds);
        let output = pe_synth("explore", &model, &part, &[&options[..], &["--within", &within]].concat());
        if !part.exists() || stored(&part, "points.json")["complete"] == true {
            continue;
        }
        assert!(told(&output).contains("in the time of `--within`"), "{}", told(&output));
        let page = fs::read_to_string(part.join("index.html")).expect("a page");
        assert!(page.contains("stopped by `--within`") && page.contains("differs from run to run"));
        let output = pe_synth("explore", &model, &part, &[&options[..], &["--resume"]].concat());
        assert!(output.status.success(), "{}", told(&output));
        for file in ["points.json", "points.csv", "index.html", "size_speed.svg", "error_time.svg"] {
            assert!(fs::read(whole.join(file)).unwrap() == fs::read(part.join(file)).unwrap(), "{file} differs");
        }
        tried += 1;
        break;
    }
    assert!(tried > 0, "no sweep was stopped in {seconds} s");

    // A time in which nothing gets done leaves nothing.
    let nothing = folder.0.join("nothing");
    for command in ["explore", "accuracy"] {
        let output = pe_synth(command, &model, &nothing, &["--within", "1ns"]);
        assert!(output.status.code() == Some(1) && !nothing.exists(), "{}", told(&output));
        assert!(told(&output).contains("no point was done in the time of `--within`"), "{}", told(&output));
    }
}
