//! The shipped models against what is kept of them in `models/NAME/golden`, and the comparison itself against injected
//! differences.
//!
//! `UPDATE_GOLDEN=1 cargo test -p pe-synth --test commands golden` keeps what is there now: a change of cycles, size,
//! error or bits of a shipped model is a visible decision.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};

/// Models with a golden folder: those that compile in a moment.
const MODELS: [&str; 21] = [
    "atrial3",
    "cortex",
    "harmonic_oscillator",
    "hodgkin_huxley",
    "kepler",
    "lorenz",
    "lotka_volterra",
    "lung",
    "lutchen20",
    "lutchen_breathing",
    "mapk_cascade",
    "motor_pid",
    "pendulum",
    "pump_station",
    "rc_ladder",
    "van_der_pol",
    "ventilator",
    "ventricle",
    "wave6",
    "wave_fdtd",
    "weibel5",
];

/// Options of a model whose golden folder is made for the first time: few PEs, and a span that takes no second.
fn first_options(model: &str) -> Vec<&'static str> {
    let span = match model {
        "harmonic_oscillator" | "lorenz" => "500ms",
        "kepler" | "lotka_volterra" | "pendulum" | "van_der_pol" => "2s",
        "cortex" | "lutchen_breathing" => "100ms",
        "mapk_cascade" => "60s",
        "ventilator" => "6s",
        "ventricle" => "100us",
        "wave6" | "wave_fdtd" => "2ms",
        _ => "20ms",
    };
    let others: &[&str] = match model {
        "cortex" => &["--judge", "events"],
        "ventricle" => &["--set", "n=2"],
        _ => &[],
    };
    let pes = if model == "ventricle" { "8" } else { "2" };
    [&["--pes", pes, "--span", span], others].concat()
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn pe_synth(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pe-synth")).current_dir(root()).args(words).output().unwrap()
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// A folder of this test's own, empty at first.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("golden").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn the_shipped_models_are_what_they_were() {
    let update = std::env::var_os("UPDATE_GOLDEN").is_some();
    let home = folder("shipped");
    let mut changed = Vec::new();
    for model in MODELS {
        let golden = root().join("models").join(model).join("golden");
        let design = home.join(model);
        let spec = format!("models/{model}/{model}.spec");
        let command = match fs::read_to_string(golden.join("report.json")) {
            Ok(report) => serde_json::from_str::<Value>(&report).unwrap()["command"].as_str().unwrap().to_owned(),
            Err(_) if update => {
                format!("pe-synth compile {spec} {}", first_options(model).join(" "))
            }
            Err(error) => panic!("{}: {error}", golden.display()),
        };
        let words: Vec<&str> = command.split(' ').skip(1).chain(["-o", path(&design)]).collect();
        let output = pe_synth(&words);
        assert!(output.status.success(), "{command}: {}", text(&output));
        if update {
            let output = pe_synth(&["golden", path(&design), "-o", path(&golden)]);
            assert!(output.status.success(), "{model}: {}", text(&output));
        }
        let output = pe_synth(&["diff", path(&golden), path(&design), "--tolerance", "lut=0,ff=0,error=0.1%"]);
        if !output.status.success() {
            changed.push(format!("{model}\n{}", text(&output)));
        }
        for entry in fs::read_dir(&golden).unwrap() {
            let size = entry.unwrap().metadata().unwrap().len();
            assert!(size < 20_000, "{model}: a golden file of {size} bytes");
        }
    }
    let advice = "If that is meant, keep it: UPDATE_GOLDEN=1 cargo test -p pe-synth --test commands golden";
    assert!(changed.is_empty(), "{}\n{advice}", changed.join("\n"));
}

#[test]
fn every_golden_folder_is_compared() {
    for entry in fs::read_dir(root().join("models")).unwrap() {
        let folder = entry.unwrap().path();
        let name = folder.file_name().unwrap().to_str().unwrap().to_owned();
        assert_eq!(folder.join("golden").is_dir(), MODELS.contains(&name.as_str()), "{name}");
    }
}

/// A compiled design, its golden folder, and room for damaged copies of it.
struct Bench {
    home: PathBuf,
}

impl Bench {
    fn new(name: &str) -> Bench {
        let home = folder(name);
        let (design, golden) = (home.join("design"), home.join("golden"));
        let spec = "models/rc_ladder/rc_ladder.spec";
        let output = pe_synth(&["compile", spec, "--pes", "2", "--span", "5ms", "-q", "-o", path(&design)]);
        assert!(output.status.success(), "{}", text(&output));
        let output = pe_synth(&["golden", path(&design), "-o", path(&golden)]);
        assert!(output.status.success(), "{}", text(&output));
        Bench { home }
    }

    /// Compares a copy of the design after `spoil` with the golden folder.
    fn diff(&self, options: &[&str], spoil: impl Fn(&mut Value)) -> Output {
        self.diff_files(options, |copy| {
            let file = copy.join("report.json");
            let mut report = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
            spoil(&mut report);
            fs::write(&file, format!("{report:#}")).unwrap();
        })
    }

    fn diff_files(&self, options: &[&str], spoil: impl Fn(&Path)) -> Output {
        let copy = self.home.join("copy");
        let _ = fs::remove_dir_all(&copy);
        fs::create_dir(&copy).unwrap();
        for file in ["report.json", "rc_ladder_trace.txt", "rc_ladder_outputs.txt"] {
            fs::copy(self.home.join("design").join(file), copy.join(file)).unwrap();
        }
        spoil(&copy);
        let golden = self.home.join("golden");
        let words: Vec<&str> = ["diff", path(&golden), path(&copy)].iter().chain(options).copied().collect();
        pe_synth(&words)
    }
}

/// Multiplies a number of a report.
fn scale(report: &mut Value, pointer: &str, factor: f64) {
    let slot = report.pointer_mut(pointer).unwrap();
    *slot = json!(slot.as_f64().unwrap() * factor);
}

#[test]
fn injected_differences_are_found_and_tolerances_hold() {
    let bench = Bench::new("injected");
    let code = |output: &Output| output.status.code().unwrap();
    let equal = bench.diff(&[], |_| {});
    assert_eq!(code(&equal), 0, "{}", text(&equal));
    assert!(!text(&equal).contains("BEYOND"));

    let slower =
        |report: &mut Value| report["cycles_per_step"] = json!(report["cycles_per_step"].as_u64().unwrap() + 1);
    let output = bench.diff(&[], slower);
    let shown = text(&output);
    assert_eq!(code(&output), 4);
    let row = shown.lines().find(|line| line.starts_with("cycles per step")).expect("a row");
    assert!(row.contains("BEYOND") && row.contains('%'), "{row}");
    assert!(shown.contains("error: changed beyond the tolerance: cycles per step\n"), "{shown}");
    assert_eq!(code(&bench.diff(&["--tolerance", "cycles=1"], slower)), 0);
    assert_eq!(code(&bench.diff(&["--tolerance", "cycles=any"], slower)), 0);
    assert_eq!(code(&bench.diff(&["--tolerance", "cycles=1", "--tolerance", "cycles=0"], slower)), 4);

    let cases: [(&str, f64, i32); 9] = [
        ("/area/lut", 1.019, 0),
        ("/area/lut", 1.021, 4),
        ("/area/lut", 0.97, 4),
        ("/error/word_length", 1.09, 0),
        ("/error/word_length", 1.2, 4),
        ("/error/method", 0.5, 4),
        ("/area/dsp", 2.0, 4),
        ("/writes_per_step", 1.5, 4),
        ("/step_s", 2.0, 4),
    ];
    for (pointer, factor, expected) in cases {
        let output = bench.diff(&[], |report| scale(report, pointer, factor));
        assert_eq!(code(&output), expected, "{pointer} x {factor}: {}", text(&output));
    }
    let output = bench.diff(&[], |report| scale(report, "/area/lut", 1.01));
    assert!(text(&output).lines().any(|line| line.starts_with("LUT") && line.ends_with("within")), "{}", text(&output));
}

#[test]
fn changed_bits_are_shown_with_step_and_output() {
    let bench = Bench::new("bits");
    let spoil_trace = |copy: &Path| {
        let file = copy.join("rc_ladder_trace.txt");
        let trace = fs::read_to_string(&file).unwrap();
        fs::write(&file, trace.replacen('a', "b", 1)).unwrap();
    };
    let output = bench.diff_files(&[], spoil_trace);
    assert_eq!(output.status.code(), Some(4));
    assert!(text(&output).contains("changed beyond the tolerance: trace SHA-256\n"), "{}", text(&output));
    assert_eq!(bench.diff_files(&["--tolerance", "trace=any"], spoil_trace).status.code(), Some(0));

    let output = bench.diff_files(&[], |copy| {
        let file = copy.join("rc_ladder_outputs.txt");
        let outputs: Vec<String> = fs::read_to_string(&file).unwrap().lines().map(str::to_owned).collect();
        let spoilt: Vec<String> = outputs
            .iter()
            .map(|line| if line.starts_with("3 1 ") { "3 1 dead".to_owned() } else { line.clone() })
            .collect();
        assert_ne!(outputs, spoilt);
        fs::write(&file, spoilt.join("\n")).unwrap();
    });
    assert_eq!(output.status.code(), Some(4));
    assert!(text(&output).contains("`U[10]` = dead in step 3"), "{}", text(&output));
}

#[test]
fn unknown_keys_are_ignored_and_missing_figures_are_not() {
    let bench = Bench::new("keys");
    let output = bench.diff(&[], |report| report["brand_new"] = json!({"figure": 1}));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let output = bench.diff(&[], |report| {
        report["error"].as_object_mut().unwrap().remove("method");
    });
    assert_eq!(output.status.code(), Some(4), "{}", text(&output));
    let output = bench.diff(&[], |report| report["error"]["total"] = json!(1e-6));
    assert_eq!(output.status.code(), Some(0), "a figure that the golden folder lacks: {}", text(&output));
    assert!(text(&output).lines().any(|line| line.starts_with("total error") && line.ends_with("new")));
}

#[test]
fn the_result_can_be_read_by_a_program() {
    let bench = Bench::new("json");
    let output = bench.diff(&["--message-format", "json"], |report| scale(report, "/area/lut", 1.5));
    assert_eq!(output.status.code(), Some(4));
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["beyond"], 1);
    let rows = result["figures"].as_array().unwrap();
    let lut = rows.iter().find(|row| row["figure"] == "LUT").unwrap();
    assert_eq!(
        (&lut["verdict"], &lut["tolerance"], &lut["change"]),
        (&json!("beyond"), &json!("2 %"), &json!("+50.00 %"))
    );
    let _: Value = serde_json::from_slice(&output.stderr).expect("the error, too");
}

#[test]
fn what_is_no_design_is_refused() {
    let bench = Bench::new("refused");
    let design = bench.home.join("design");
    let empty = folder("empty");
    let foreign = empty.join("report.json");
    let report = design.join("report.json");
    let code = |words: &[&str]| pe_synth(words).status.code().unwrap();
    assert_eq!(code(&["diff", path(&empty), path(&design)]), 3, "no report");
    fs::write(&foreign, "{\"model\": \"rc_ladder\"}").unwrap();
    assert_eq!(code(&["diff", path(&foreign), path(&design)]), 3, "no report of ours");
    fs::write(&foreign, "{\"generator\": \"pe-synth 0.1.0\"").unwrap();
    assert_eq!(code(&["diff", path(&foreign), path(&design)]), 3, "a damaged report");
    fs::write(&foreign, "{\"generator\": \"pe-synth 0.1.0\"}").unwrap();
    assert_eq!(code(&["diff", path(&foreign), path(&design)]), 4, "nothing was compared");
    assert_eq!(code(&["diff", path(&report), path(&report), "--tolerance", "speed=1"]), 2);
    assert_eq!(code(&["diff", path(&report), path(&report)]), 0, "reports alone");
    assert_eq!(code(&["golden", path(&report), "-o", path(&empty.join("new"))]), 3, "a report has no trace");
    assert!(!empty.join("new").exists());
    fs::write(empty.join("report.json"), "mine").unwrap();
    assert_eq!(code(&["golden", path(&design), "-o", path(&empty)]), 3, "a folder of somebody else");
    assert_eq!(fs::read_to_string(empty.join("report.json")).unwrap(), "mine");
}

#[test]
fn the_script_for_the_user_s_integration_recompiles_compares_and_simulates() {
    let home = folder("script");
    let golden = home.join("designs/oscillator/golden");
    let run = |options: &[&str]| {
        Command::new(root().join("docs/ci/pe-synth.sh"))
            .current_dir(&home)
            .env("PE_SYNTH", env!("CARGO_BIN_EXE_pe-synth"))
            .env("TOLERANCE", "cycles=0,lut=2%,error=10%")
            .args(options)
            .arg("designs/oscillator/golden/")
            .output()
            .unwrap()
    };
    let spec = home.join("designs/oscillator/oscillator.spec");
    fs::create_dir_all(&golden).unwrap();
    let model = fs::read_to_string(root().join("models/harmonic_oscillator/harmonic_oscillator.spec")).unwrap();
    fs::write(&spec, &model).unwrap();
    let compile = |target: &str| {
        let words =
            ["compile", "designs/oscillator/oscillator.spec", "--span", "100ms", "--pes", "2", "-q", "-o", target];
        let command = Command::new(env!("CARGO_BIN_EXE_pe-synth")).current_dir(&home).args(words).output().unwrap();
        assert!(command.status.success(), "{}", text(&command));
    };
    compile("first");
    let output = pe_synth(&["golden", path(&home.join("first")), "-o", path(&golden)]);
    assert!(output.status.success(), "{}", text(&output));

    let output = run(&[]);
    assert!(output.status.success(), "{}", text(&output));
    assert!(
        text(&output).contains("GHDL = simulator from the beginning")
            && text(&output).contains("1 designs as expected")
    );

    // Another initial value keeps the structure and changes the bits.
    let changed = model.replacen("= 1", "= 0.75", 1);
    assert_ne!(changed, model);
    fs::write(&spec, changed).unwrap();
    let output = run(&[]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("BEYOND") && text(&output).contains("1 of 1 failed"), "{}", text(&output));
    assert!(run(&["--update"]).status.success());
    assert!(run(&[]).status.success());
}
