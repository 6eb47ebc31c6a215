//! Sweeps: the same bytes however they are computed, failures as rows, and rows that can be computed alone.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::support::bench::Folder;
use crate::support::models::spec;
use serde_json::Value;

/// A sweep of a small model into a folder.
fn sweep(spec: &Path, target: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("explore").arg(spec).arg("-o").arg(target).args(options);
    command
}

fn run(command: &mut Command) -> Output {
    command.output().expect("pe-synth starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn succeeded(command: &mut Command) -> Output {
    let output = run(command);
    assert!(output.status.success(), "{}", stderr(&output));
    output
}

fn points(target: &Path) -> Value {
    let text = fs::read_to_string(target.join("points.json")).expect("the sweep wrote its points");
    serde_json::from_str(&text).expect("points are JSON")
}

fn rows(target: &Path) -> Vec<Value> {
    points(target)["points"].as_array().expect("a list").clone()
}

const FILES: [&str; 5] = ["error_time.svg", "index.html", "points.csv", "points.json", "size_speed.svg"];

fn assert_same(a: &Path, b: &Path) {
    let mut names: Vec<_> = fs::read_dir(b).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, FILES);
    for file in FILES {
        assert!(fs::read(a.join(file)).unwrap() == fs::read(b.join(file)).unwrap(), "{file} differs");
    }
}

/// Lists that span 24 points of the lung, a few of which fail.
const LUNG: [&str; 10] = [
    "--pes",
    "2,4,100",
    "--step",
    "100us,50us",
    "--solver",
    "euler,rk4",
    "--multiplier",
    "25x18,32x32",
    "--span",
    "40ms",
];

#[test]
fn the_result_does_not_depend_on_the_number_of_jobs() {
    let folder = Folder::new("jobs");
    let targets = ["1", "2", "7"].map(|jobs| {
        let target = folder.0.join(jobs);
        succeeded(sweep(&spec("weibel5"), &target, &LUNG).args(["--jobs", jobs]));
        target
    });
    assert_eq!(rows(&targets[0]).len(), 24);
    assert_same(&targets[0], &targets[1]);
    assert_same(&targets[0], &targets[2]);
}

#[test]
fn an_interrupted_sweep_goes_on_to_the_same_bytes() {
    let folder = Folder::new("interrupted_sweep");
    let whole = folder.0.join("whole");
    let clock = Instant::now();
    succeeded(sweep(&spec("weibel5"), &whole, &LUNG).args(["--jobs", "1"]));
    let duration = clock.elapsed();
    let target = folder.0.join("parts");
    let mut interrupted = 0;
    // At several moments, for how far a sweep has come by then is up to the machine.
    for share in [50, 30, 70, 40, 60, 20, 80] {
        let _ = fs::remove_dir_all(&target);
        let mut command = sweep(&spec("weibel5"), &target, &LUNG);
        let mut child =
            command.args(["--jobs", "1"]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("pe-synth starts");
        std::thread::sleep(duration * share / 100);
        // The process may have ended already; then there is no one to signal.
        let _ = Command::new("kill").arg("-INT").arg(child.id().to_string()).stderr(Stdio::null()).status();
        let status = child.wait().expect("pe-synth ends");
        if status.code() != Some(130) || !target.exists() {
            continue;
        }
        let part = points(&target);
        let done = part["points"].as_array().unwrap().len();
        assert!(part["complete"] == false && done > 0 && done < 24, "{done} points");
        succeeded(sweep(&spec("weibel5"), &target, &LUNG).arg("--resume"));
        assert_same(&whole, &target);
        interrupted += 1;
        if interrupted == 2 {
            return;
        }
    }
    assert!(interrupted > 0, "no sweep was interrupted in {duration:?}");
}

#[test]
fn resume_takes_points_from_the_file_and_refuses_another_model_version_or_option() {
    let folder = Folder::new("resume");
    let model = folder.0.join("m.spec");
    let text = fs::read_to_string(spec("lotka_volterra")).unwrap();
    fs::write(&model, &text).unwrap();
    let target = folder.0.join("out");
    let options = ["--pes", "1,2", "--multiplier", "32x32", "--solver", "rk4", "--span", "1s"];
    succeeded(&mut sweep(&model, &target, &options));

    // A figure that no computation gives shows where it comes from; the rows left out are computed again.
    let mut stored = points(&target);
    let row = stored["points"][0].as_object_mut().unwrap();
    row.remove("sha256");
    row.insert("connections".into(), 77.into());
    stored["points"][0] = pe_synth::explore::seal::sealed(row.clone());
    let kept = stored["points"].as_array().unwrap()[..2].to_vec();
    let total = stored["points_total"].clone();
    stored["points"] = kept.into();
    fs::write(target.join("points.json"), format!("{stored:#}")).unwrap();
    let output = succeeded(sweep(&model, &target, &options).arg("--resume"));
    assert!(stderr(&output).contains("2 done before"), "{}", stderr(&output));
    let resumed = rows(&target);
    assert_eq!(resumed[0]["connections"], 77);
    assert_eq!(Value::from(resumed.len()), total);

    // More points are welcome, fewer would lose some.
    let more = ["--pes", "1,2", "--multiplier", "32x32,25x18", "--solver", "rk4", "--span", "1s", "--resume"];
    succeeded(&mut sweep(&model, &target, &more));
    assert_eq!(rows(&target).len(), 2 * resumed.len());
    let before = fs::read(target.join("points.json")).unwrap();
    let refused = |command: &mut Command, reason: &str| {
        let output = run(command);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains(reason), "{}", stderr(&output));
        assert!(before == fs::read(target.join("points.json")).unwrap(), "the result was touched");
    };
    refused(sweep(&model, &target, &options).arg("--resume"), "lacks a point");
    refused(sweep(&model, &target, &more).args(["--seed", "2"]), "the options differ");
    fs::write(&model, text.replacen("state", "param unused_one = 1\nstate", 1)).unwrap();
    refused(&mut sweep(&model, &target, &more), "the model differs");
    fs::write(&model, &text).unwrap();
    let old = String::from_utf8(before.clone()).unwrap().replace("pe-synth 0.", "pe-synth 9.");
    fs::write(target.join("points.json"), &old).unwrap();
    let output = run(&mut sweep(&model, &target, &more));
    assert!(output.status.code() == Some(2) && stderr(&output).contains("the version differs"), "{}", stderr(&output));
}

/// Runs the command of a row as a user would, in the folder of the spec, and compares its figures with the row's.
fn assert_reproduced(row: &Value, folder: &Path, of_spec: &Path) {
    let command = row["command"].as_str().expect("a command");
    let binaries = Path::new(env!("CARGO_BIN_EXE_pe-synth")).parent().unwrap();
    let path = format!("{}:{}", binaries.display(), std::env::var("PATH").unwrap());
    let target = folder.join("alone");
    let _ = fs::remove_dir_all(&target);
    let output = Command::new("sh")
        .arg("-c")
        .arg(format!("{command} -o {}", target.display()))
        .env("PATH", path)
        .current_dir(of_spec)
        .output()
        .expect("a shell");
    if row["status"] == "failed" {
        assert_eq!(output.status.code().map(Value::from), Some(row["exit_code"].clone()), "{command}");
        let sought = [&row["code"], &row["message"]].map(|text| text.as_str().unwrap_or("").to_owned());
        for text in sought {
            assert!(stderr(&output).contains(&text), "{command}: `{text}` is not in {}", stderr(&output));
        }
        return;
    }
    assert!(output.status.success(), "{command}: {}", stderr(&output));
    let report: Value = serde_json::from_str(&fs::read_to_string(target.join("report.json")).unwrap()).unwrap();
    let mut compared = 0;
    for (key, value) in row.as_object().unwrap() {
        if let Some(alone) = report.get(key).filter(|_| key != "command") {
            assert_eq!(alone, value, "{command}: {key}");
            compared += 1;
        }
    }
    assert!(compared >= 18, "only {compared} figures compared");
    assert!(row["error"]["total"].is_number(), "{command}: no total error");
}

#[test]
fn the_command_of_a_row_gives_the_figures_of_the_row() {
    let folder = Folder::new("alone");
    // A name that a shell would take apart.
    let model = PathBuf::from("it's <b>&amp; $HOME.spec");
    fs::copy(spec("lutchen_breathing"), folder.0.join(&model)).unwrap();
    let target = folder.0.join("sweep");
    let options = ["--pes", "3", "--step", "2ms,1/2000", "--solver", "euler,rk4", "--multiplier", "25x18,32x32"];
    let mut command = sweep(&model, Path::new("sweep"), &options);
    succeeded(
        command
            .args(["--span", "200ms", "--clock", "100", "--tries", "3000", "--seed", "5", "--max-error", "any"])
            .current_dir(&folder.0),
    );
    let rows = rows(&target);
    assert_eq!(rows.len(), 8);
    // Whatever points have in common, each is as if it were alone.
    for row in &rows {
        assert_reproduced(row, &folder.0, &folder.0);
    }
    let page = fs::read_to_string(target.join("index.html")).unwrap();
    assert!(page.contains("\\u003cb>&amp; $HOME") && !page.contains("<b>"), "names are data only");
    for foreign in ["<script src", "src=", "href=\"http", "url("] {
        assert!(!page.contains(foreign), "the page needs {foreign}");
    }
}

#[test]
fn points_that_fail_are_rows_with_their_reason() {
    let folder = Folder::new("failing");
    let target = folder.0.join("out");
    let options =
        ["--pes", "1,3", "--step", "1ms,1s", "--solver", "euler", "--multiplier", "25x18", "--storage", "12,32"];
    let model = spec("van_der_pol");
    succeeded(sweep(&model, &target, &options).args(["--span", "20s", "--max-error", "any"]));
    let rows = rows(&target);
    let of = |step: f64, storage: u32, pes: u32| {
        let found = rows
            .iter()
            .find(|row| row["step_s"] == step && row["word"]["storage_bits"] == storage && row["pes"] == pes);
        found.unwrap_or_else(|| panic!("no row for {step} {storage} {pes}"))
    };
    assert_eq!(of(1e-3, 32, 1)["status"], "compiled");
    for storage in [12, 32] {
        let row = of(1.0, storage, 1);
        assert_eq!(row["status"], "failed");
    }
    assert_eq!(of(1.0, 32, 1)["code"], "E0901", "a step of a second diverges");
    let narrow = of(1e-3, 12, 1);
    assert!(narrow["code"].is_null() && narrow["message"].as_str().unwrap().contains("reads more bits"), "{narrow}");
    let many = of(1e-3, 32, 3);
    assert!(many["message"].as_str().unwrap().contains("use at most 2"), "{many}");
    let van_der_pol = spec("van_der_pol");
    // `compile` takes as many PEs as there are equations where a sweep refuses more.
    for row in [of(1.0, 32, 1), narrow] {
        assert_reproduced(row, &folder.0, van_der_pol.parent().expect("a folder"));
    }
    let table = fs::read_to_string(target.join("points.csv")).unwrap();
    assert_eq!(table.lines().filter(|line| line.contains(",failed,")).count(), 7);

    // Without any point that works the sweep fails, and its rows say why.
    let output =
        run(&mut sweep(&model, &target, &["--pes", "3", "--step", "1ms", "--solver", "euler", "--span", "1s"]));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert_eq!(points(&target)["complete"], true);
}

#[test]
fn sampled_parts_are_judged_in_every_word() {
    let folder = Folder::new("filters");
    let swept = |name: &str, states: &str, words: &str| {
        let model = folder.0.join(format!("{name}.spec"));
        let head = format!("model {name}\nsolver euler\nstep 1 ms\nspan 200 ms\ninput x = pulse(1, 0, 10 ms)");
        let text = format!("{head}\nevery 1 ms {{\nstate m1 = 0\nstate m2 = 0\n{states}\n}}\noutput m1\n");
        fs::write(&model, text).unwrap();
        let target = folder.0.join(name);
        let options = ["--pes", "1", "--step", "1ms", "--solver", "euler", "--storage", "32", "--multiplier", words];
        succeeded(&mut sweep(&model, &target, &options));
        rows(&target)
    };
    let resonator = swept("resonator", "next m1 = 1.9*m1 + m2 + 0.01*x\nnext m2 = -0.999998*m1", "25x18,25x25");
    assert_eq!(resonator[0]["code"], "E0908", "its poles are rounded to the unit circle: {resonator:?}");
    assert_eq!(resonator[1]["status"], "compiled", "{resonator:?}");
    let section = "next m1 = -0.1593397720677305*x + 1.6566468384753021*(0.1*x + m1) + m2
next m2 = 0.1*x - 0.8475628573300946*(0.1*x + m1)";
    let section = swept("section", section, "25x18,35x35");
    let rings = |row: &Value| row["warnings"].as_array().is_some_and(|codes| codes.contains(&"W0915".into()));
    assert_eq!([&section[0], &section[1]].map(rings), [true, false], "{section:?}");
    for row in resonator.iter().chain(&section) {
        assert_reproduced(row, &folder.0, &folder.0);
    }
}

#[test]
fn a_run_that_explodes_but_stays_finite_has_no_format() {
    let folder = Folder::new("exploding");
    let target = folder.0.join("out");
    let options = ["--pes", "1", "--step", "1s", "--span", "2s", "--jobs", "2", "--max-error", "any"];
    let output = run(&mut sweep(&spec("lorenz"), &target, &options));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(!stderr(&output).contains("panicked"), "{}", stderr(&output));
    for row in rows(&target) {
        let code = row["code"].as_str().unwrap_or("none");
        assert!(["E0802", "E0901", "E0903"].contains(&code), "{row}");
    }
}

#[test]
fn a_folder_of_somebody_else_is_not_replaced_by_a_sweep() {
    let folder = Folder::new("foreign_sweep");
    fs::write(folder.0.join("thesis.txt"), "irreplaceable").unwrap();
    let clock = Instant::now();
    let output = run(&mut sweep(&spec("weibel11"), &folder.0, &[]));
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(clock.elapsed() < Duration::from_secs(20), "the refusal came late");
    assert_eq!(fs::read_to_string(folder.0.join("thesis.txt")).unwrap(), "irreplaceable");
}

#[test]
fn with_a_largest_error_the_cheapest_point_is_named() {
    let folder = Folder::new("explore_choice");
    let target = folder.0.join("out");
    let options = ["--pes", "1,2", "--solver", "heun,rk4", "--multiplier", "25x18,32x32", "--span", "5s"];
    let output = succeeded(sweep(&spec("van_der_pol"), &target, &options).args(["--max-error", "1e-4"]));
    assert!(String::from_utf8_lossy(&output.stdout).contains("<- chosen"), "{output:?}");
    let rows = rows(&target);
    let chosen = &rows[points(&target)["chosen"].as_u64().expect("a choice") as usize];
    let number = |row: &Value, pointer: &str| row.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::INFINITY);
    let time = |row: &Value| number(row, "/time_per_simulated_second_ms");
    assert!(number(chosen, "/error/total") <= 1e-4);
    let met = rows.iter().filter(|row| number(row, "/error/total") <= 1e-4);
    assert!(met.clone().count() > 1 && met.clone().all(|row| time(chosen) <= 1.021 * time(row)));
}

#[test]
fn steps_are_whole_parts_of_the_time_between_outputs() {
    let folder = Folder::new("explore_sample");
    let target = folder.0.join("out");
    let options = ["--sample", "250us", "--pes", "1", "--solver", "euler", "--multiplier", "25x18", "--span", "30ms"];
    succeeded(&mut sweep(&spec("rc_ladder"), &target, &options));
    let rows = rows(&target);
    assert_eq!(rows.len(), 3);
    for row in &rows {
        let parts = 250e-6 / row["step_s"].as_f64().expect("a step");
        assert!(parts >= 1.0 && (parts - parts.round()).abs() < 1e-6, "{row}");
        assert!(!row["command"].as_str().expect("a command").contains("--sample"), "the step says it all");
    }
    let output = run(sweep(&spec("rc_ladder"), &target, &options).args(["--step", "100us"]));
    assert!(output.status.code() == Some(2) && stderr(&output).contains("--sample"), "{}", stderr(&output));
}
