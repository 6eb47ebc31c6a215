//! The command line as a user meets it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

/// A folder of this test's own, empty at first.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cli").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn model(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").join(name).join(format!("{name}.spec"))
}

fn pe_synth() -> Command {
    Command::new(env!("CARGO_BIN_EXE_pe-synth"))
}

fn compile(spec: &Path, target: &Path, options: &[&str]) -> Output {
    pe_synth().arg("compile").arg(spec).arg("-o").arg(target).args(options).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Compiles a spec that must be refused; nothing may be left beside it.
fn refused(name: &str, text: &str, options: &[&str]) -> String {
    let home = folder(name);
    let spec = home.join("m.spec");
    fs::write(&spec, text).unwrap();
    let output = compile(&spec, &home.join("out"), options);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let left: Vec<_> = fs::read_dir(&home).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["m.spec"], "something was written");
    stderr(&output)
}

const HEAD: &str = "solver rk4\nstep 1 ms\nspan 1 s\n";

#[test]
fn the_same_command_writes_the_same_bytes() {
    let home = folder("same");
    let folders = ["a", "b"].map(|name| home.join(name));
    for target in &folders {
        let output = compile(&model("weibel5"), target, &["--pes", "7", "--multiplier", "25x18", "--span", "50ms"]);
        assert!(output.status.success(), "{}", stderr(&output));
    }
    let mut names: Vec<_> = fs::read_dir(&folders[0]).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert!(names.len() > 12, "{names:?}");
    for name in names.iter().filter(|name| *name != "report-timing.json" && *name != "hdl") {
        let [a, b] = folders.each_ref().map(|folder| fs::read(folder.join(name)).unwrap());
        assert!(a == b, "{} differs", name.to_string_lossy());
    }
}

#[test]
fn no_output_holds_an_absolute_path() {
    let home = folder("absolute");
    let spec = model("lorenz");
    let options = ["--span=100ms", "--quiet", "--jobs", "1"];
    for (command, points) in [
        ("compile", &["--pes", "1"][..]),
        ("explore", &["--pes", "1", "--storage", "32", "--solver", "rk4"]),
        ("accuracy", &["--storage", "32", "--solver", "rk4"]),
    ] {
        let options = if command == "compile" { &options[..2] } else { &options };
        let target = home.join(command);
        let output =
            pe_synth().arg(command).arg(&spec).args(options).args(points).arg("-o").arg(&target).output().unwrap();
        assert!(output.status.success(), "{command}: {}", stderr(&output));
    }
    let root = spec.canonicalize().unwrap();
    let places =
        [home.to_str().unwrap(), spec.parent().unwrap().to_str().unwrap(), root.parent().unwrap().to_str().unwrap()];
    let (mut folders, mut read) = (vec![home.clone()], 0);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = String::from_utf8_lossy(&fs::read(&path).unwrap()).into_owned();
            let held = places.iter().find(|place| text.contains(**place));
            assert_eq!(held, None, "{}", path.display());
            read += 1;
        }
    }
    assert!(read > 20, "{read} files");
}

#[test]
fn the_report_has_every_promised_key() {
    let home = folder("report");
    let output = compile(&model("lorenz"), &home.join("out"), &["--span", "1s"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let read = |name: &str| -> Value {
        serde_json::from_str(&fs::read_to_string(home.join("out").join(name)).unwrap()).unwrap()
    };
    let report = read("report.json");
    for path in [
        "model",
        "odes",
        "pes",
        "solver",
        "step_s",
        "cycles_per_step",
        "macs_per_step",
        "bound_cycles",
        "connections",
        "max_in_degree",
        "transfers_per_step",
        "distinct_programs",
        "word/storage_bits",
        "word/mul_a_bits",
        "word/mul_b_bits",
        "word/dsp_per_pe",
        "instruction_words_max",
        "data_words_max",
        "area/lut",
        "area/ff",
        "area/dsp",
        "area/bram18",
        "area/basis",
        "clock/mhz",
        "clock/basis",
        "time_per_simulated_second_ms",
        "error/worst_state",
        "error/total",
        "error/method",
        "error/word_length",
        "error/coefficient",
        "error/function",
        "error/input_hold",
        "left_out",
        "seed",
        "command",
    ] {
        assert!(report.pointer(&format!("/{path}")).is_some(), "report.json lacks {path}");
    }
    let timing = read("report-timing.json");
    assert!(timing["seconds"]["map"].is_number() && timing["peak_memory_mb"].is_number());
    // The whole command takes at least what its stages take that do not run over the span.
    let stages = timing["processor_seconds"].as_object().expect("one for each stage");
    let rest =
        stages.iter().filter(|(stage, _)| !["runs", "ranges", "stability", "reference"].contains(&stage.as_str()));
    let sum: f64 = rest.filter_map(|(_, time)| time.as_f64()).sum();
    assert!(sum > 0.0 && timing["processor_seconds_without_runs"].as_f64() >= Some(sum), "{timing}");
}

#[test]
fn wrong_options_exit_with_2() {
    let target = folder("options").join("out");
    let cases: [&[&str]; 5] =
        [&["--bogus"], &["--multiplier", "40x3"], &["--step", "-1"], &["--pes", "0"], &["--set", "rho"]];
    for options in cases {
        let output = compile(&model("lorenz"), &target, options);
        assert_eq!(output.status.code(), Some(2), "{options:?}: {}", stderr(&output));
        assert!(!target.exists());
    }
}

#[test]
fn a_broken_spec_shows_every_error_with_place_and_caret() {
    let text = format!("model m \"broken\"\n{HEAD}state x = 1\nstate y = 0\nx' = y + z\ny' = -x[1/2]\noutput x, q\n");
    let errors = refused("broken", &text, &[]);
    for part in ["error[E0201]: unknown name `z`", "m.spec:7:10", "^", "error[E0207]", "unknown name `q`"] {
        assert!(errors.contains(part), "no {part} in:\n{errors}");
    }
}

#[test]
fn messages_as_json_are_one_object_per_line() {
    let text = format!("model m \"broken\"\n{HEAD}state x = 1\nx' = y + z\noutput x\n");
    let errors = refused("json", &text, &["--message-format", "json"]);
    let findings: Vec<Value> = errors.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    assert_eq!(findings.len(), 2);
    assert_eq!(findings[0]["code"], "E0201");
    assert_eq!(findings[0]["place"]["line"], 6);
}

#[test]
fn a_run_that_turns_non_finite_is_refused_with_state_and_time() {
    let blow_up = format!("model m \"x = 1/(1 - t)\"\n{HEAD}span 2 s\nstate x = 1\nx' = x^2\noutput x\n");
    let errors = refused("blow_up", &blow_up.replacen("span 1 s\n", "", 1), &[]);
    assert!(errors.contains("E0906") && errors.contains("`x`") && errors.contains("t = 1.0"), "{errors}");
    let stiff = format!("model m \"step beyond stability\"\n{HEAD}state fast = 1\nfast' = -1e6*fast\noutput fast\n");
    let errors = refused("stiff", &stiff, &[]);
    assert!(errors.contains("E0901") && errors.contains("`fast`") && errors.contains("works (tried)"), "{errors}");
}

#[test]
fn a_list_of_steps_compiles_and_its_input_is_kept_for_the_solver() {
    let home = folder("step_list");
    let text = "model m\nsolver rodas3\nstep 1 ms until 20 ms, then 10 ms\nspan 200 ms\nstate x = 1\n\
                x' = -5*x^2\noutput x\n";
    fs::write(home.join("m.spec"), text).unwrap();
    let output = compile(&home.join("m.spec"), &home.join("out"), &["--no-pictures"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let report = fs::read_to_string(home.join("out/report.json")).unwrap();
    assert!(report.contains("`step_ratio` is read by the solver's own equations"), "{report}");
}

#[test]
fn a_step_that_is_too_large_is_refused_unless_allowed() {
    let text = format!(
        "model m \"eight steps in a period\"\n{HEAD}state x = 1\nstate v = 0\nx' = 785*v\nv' = -785*x\noutput x\n"
    );
    let text = text.replace("solver rk4", "solver euler").replace("span 1 s", "span 20 ms");
    assert!(refused("large_step", &text, &[]).contains("E0903"));
    let home = folder("large_step_allowed");
    fs::write(home.join("m.spec"), text).unwrap();
    let output = compile(&home.join("m.spec"), &home.join("out"), &["--allow", "E0903"]);
    assert!(output.status.success() && stderr(&output).contains("warning[E0903]"), "{}", stderr(&output));
}

#[test]
fn a_folder_of_somebody_else_is_not_replaced() {
    let target = folder("foreign");
    fs::write(target.join("thesis.txt"), "irreplaceable").unwrap();
    let output = compile(&model("lorenz"), &target, &["--span", "1s"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert_eq!(fs::read_to_string(target.join("thesis.txt")).unwrap(), "irreplaceable");
}

#[test]
fn an_own_folder_is_replaced_as_a_whole() {
    let target = folder("own").join("out");
    for name in ["lorenz", "van_der_pol"] {
        let output = compile(&model(name), &target, &["--span", "1s"]);
        assert!(output.status.success(), "{}", stderr(&output));
    }
    assert!(target.join("van_der_pol.vhd").exists() && !target.join("lorenz.vhd").exists());
}

#[test]
fn files_that_cannot_be_read_exit_with_3() {
    let home = folder("unreadable");
    assert_eq!(compile(&home.join("missing.spec"), &home.join("out"), &[]).status.code(), Some(3));
}

#[test]
fn files_that_a_spec_names_are_read_from_its_folder_only() {
    let home = folder("included");
    fs::create_dir_all(home.join("model/lib")).unwrap();
    let spec = home.join("model/m.spec");
    let text = "model m\nsolver rk4\nstep 1 ms\nspan 20 ms\nstate x = k\nx' = -x\noutput x\ninclude \"lib/k.spec\"";
    fs::write(&spec, text).unwrap();
    let codes = |content: &str| {
        fs::write(home.join("model/lib/k.spec"), content).unwrap();
        let output = compile(&spec, &home.join("out"), &["--pes", "1", "--message-format", "json"]);
        (output.status.code(), stderr(&output))
    };
    assert_eq!(codes("param k = 1").0, Some(0));
    let (code, errors) = codes("// \nparam k = 1e");
    assert!(code == Some(1) && errors.contains("lib/k.spec\",\"line\":2"), "{errors}");

    fs::write(home.join("outside.spec"), "param k = 1").unwrap();
    fs::remove_file(home.join("model/lib/k.spec")).unwrap();
    std::os::unix::fs::symlink(home.join("outside.spec"), home.join("model/lib/k.spec")).unwrap();
    let refused = |what: &str| {
        let output = compile(&spec, &home.join("out"), &["--pes", "1"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(what), "{}", stderr(&output));
    };
    refused("error[E0110]");
    fs::remove_file(home.join("model/lib/k.spec")).unwrap();
    refused("error[E0111]");
    fs::create_dir(home.join("model/lib/k.spec")).unwrap();
    refused("error[E0111]");
    fs::write(&spec, [0x0a, 0xff]).unwrap();
    refused("m.spec:2:1");
    fs::File::create(&spec).unwrap().set_len(20 << 20).unwrap();
    refused("error[E0105]");
}

#[test]
fn verify_without_its_tools_names_the_package_and_exits_with_5() {
    let home = folder("no_ghdl");
    let target = home.join("out");
    let empty = home.join("bin");
    fs::create_dir(&empty).unwrap();
    // Compiling needs no other program at all.
    let output = pe_synth()
        .arg("compile")
        .arg(model("lorenz"))
        .args(["--span", "1s", "-o"])
        .arg(&target)
        .env("PATH", &empty)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    // rustc stays, for the Rust reference runs before GHDL.
    let rustc = Command::new("sh").args(["-c", "command -v rustc"]).output().unwrap();
    let rustc = PathBuf::from(String::from_utf8(rustc.stdout).unwrap().trim());
    let cc = Command::new("sh").args(["-c", "command -v cc"]).output().unwrap();
    let cc = PathBuf::from(String::from_utf8(cc.stdout).unwrap().trim());
    std::os::unix::fs::symlink(&rustc, empty.join("rustc")).unwrap();
    let output = pe_synth().arg("verify").arg(&target).env("PATH", &empty).output().unwrap();
    assert_eq!(output.status.code(), Some(5), "{}", stderr(&output));
    assert!(stderr(&output).contains("apt-get install gcc"), "{}", stderr(&output));
    std::os::unix::fs::symlink(&cc, empty.join("cc")).unwrap();
    for tool in ["ld", "as"] {
        let _ = std::os::unix::fs::symlink(Path::new("/usr/bin").join(tool), empty.join(tool));
    }
    let output = pe_synth().arg("verify").arg(&target).env("PATH", &empty).output().unwrap();
    assert_eq!(output.status.code(), Some(5), "{}", stderr(&output));
    assert!(stderr(&output).contains("apt-get install ghdl"), "{}", stderr(&output));
    // Asked for alone, the reference needs no GHDL.
    let verify = ["verify", "--engines", "reference", "--steps", "5"];
    let output = pe_synth().args(verify).arg(&target).env("PATH", &empty).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.matches("Rust reference = simulator").count() >= 3, "{text}");
    assert!(text.contains("coverage"), "{text}");
}

#[test]
fn a_closed_pipe_ends_the_output_quietly() {
    let spec = model("weibel5");
    let mut child = pe_synth()
        .args(["dump", "--stage", "step"])
        .arg(spec)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(!stderr(&output).contains("panicked"), "{}", stderr(&output));
}

#[test]
fn a_killed_compilation_leaves_no_folder() {
    let home = folder("killed");
    let target = home.join("out");
    let mut child = pe_synth()
        .arg("compile")
        .arg(model("weibel11"))
        .arg("-o")
        .arg(&target)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(700));
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!target.exists());
}

#[test]
fn every_stage_can_be_dumped() {
    for stage in ["model", "step", "fixed", "ode-graph", "pe-graph", "mapping", "schedule", "program"] {
        let output =
            pe_synth().args(["dump", "--stage", stage, "--span", "1s"]).arg(model("lotka_volterra")).output().unwrap();
        assert!(output.status.success() && !output.stdout.is_empty(), "{stage}: {}", stderr(&output));
    }
}

/// Names that mean something in VHDL, Rust, C++ or the generated files, differ in case only, or collide when cut.
const HOSTILE_NAMES: [&str; 32] = [
    "signal",
    "Signal",
    "SIGNAL",
    "entity",
    "process",
    "type",
    "fn",
    "self",
    "Self",
    "crate",
    "unsafe",
    "async",
    "main",
    "clk",
    "clk_i",
    "step_i",
    "done_o",
    "overflow",
    "link_0",
    "word_0",
    "PE0_PROGRAM",
    "program",
    "std_logic",
    "con",
    "__x__",
    "_",
    "_lead",
    "trail_",
    "a__b",
    "a_b",
    "NaN",
    "end",
];

#[test]
fn hostile_names_survive_into_verified_hardware() {
    let home = folder("hostile");
    let long = ["x", "X", "y"].map(|first| format!("{first}{}", "q".repeat(198)));
    let names: Vec<&str> = HOSTILE_NAMES.iter().copied().chain(long.iter().map(String::as_str)).collect();
    let title = "-- */ <script>alert(1)</script> & ]]> { {{x}} ${y} %s \\n \u{b5}\u{3a9} \u{202E} -->";
    let mut text = format!("model Process \"{title}\"\n{HEAD}input wait = sine(1, 10 Hz)\n").replace("1 s", "50 ms");
    for (at, name) in names.iter().enumerate() {
        let source = if at == 0 { "wait" } else { names[at - 1] };
        text += &format!("state {name} = 1/{}\n{name}' = {source} - {name}\n", at + 1);
    }
    text += &format!("sum_ = clk + self\noutput {}, wait, sum_\n", names.join(", "));
    // Neither the spec's name nor the folder's can be quoted everywhere they go.
    let spec = home.join("a b\"; -- <x> $(id) `x` \\ \u{e9}.spec");
    fs::write(&spec, text).unwrap();
    let target = home.join("o u$t\"\n--");
    let output = compile(&spec, &target, &["--pes", "3"]);
    assert!(output.status.success(), "{}", stderr(&output));
    for file in ["process_x.vhd", "process_x_reference.rs", "process_x_verilator.cpp"] {
        let text = fs::read_to_string(target.join(file)).unwrap();
        assert!(text.is_ascii() && text.lines().nth(1).unwrap().contains("Regenerate:"), "{file}: {text:.300}");
    }
    for picture in fs::read_dir(&target).unwrap().map(|entry| entry.unwrap().path()) {
        if picture.extension().is_some_and(|ending| ending == "svg" || ending == "html") {
            let text = fs::read_to_string(&picture).unwrap();
            assert!(!text.contains("<script>alert") && !text.contains('\u{202E}'), "{}", picture.display());
        }
    }
    let output = pe_synth().arg("verify").arg(&target).args(["--steps", "2"]).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn help_is_a_page_with_commands_examples_exit_codes_and_documents() {
    let page = |arguments: &[&str]| {
        let output = pe_synth().args(arguments).output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{arguments:?}: {}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let help = page(&["--help"]);
    for part in ["equations", "Commands:\n", "Examples:\n", "Exit codes:\n", "  70  internal error", "docs/guide.md"] {
        assert!(help.contains(part), "no {part} in\n{help}");
    }
    let commands = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    // Descriptions that go on in the next line are indented further.
    let lines = commands.lines().filter(|line| !line.starts_with("   "));
    let names: Vec<&str> = lines.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.len() > 7, "{names:?}");
    let manual = page(&["man"]);
    for name in names.into_iter().filter(|name| *name != "help") {
        let help = page(&[name, "--help"]);
        assert!(help.contains("Examples:\n  pe-synth ") && help.lines().all(|line| line.len() <= 110), "{help}");
        assert!(manual.contains(&format!("PE\\-SYNTH {}\"", name.to_uppercase())), "{name} is not in\n{manual}");
        // Commands that take one design point show their groups in the same order.
        if !["compile", "sim", "dump"].contains(&name) {
            continue;
        }
        let order = ["Arguments:", "Model:", "Numbers:", "Mapping:", "Output:", "Diagnostics:", "Examples:"];
        let places: Vec<usize> = order.iter().filter_map(|heading| help.find(&format!("\n{heading}\n"))).collect();
        assert!(places.is_sorted() && places.len() == order.len(), "{help}");
    }
    for shell in ["bash", "zsh", "fish"] {
        let script = page(&["completions", shell]);
        assert!(script.contains("max-in-degree") && script.contains("pe-synth"), "{shell}: {script}");
    }
}

#[test]
fn errors_of_every_kind_are_json_if_asked_for() {
    let home = folder("json_kinds");
    let kind = |arguments: &[&str], code: i32| {
        let output = pe_synth().args(arguments).args(["--message-format", "json"]).current_dir(&home).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr(&output));
        let text = stderr(&output);
        let object: Value = serde_json::from_str(text.trim_end()).unwrap_or_else(|_| panic!("{text}"));
        let keys = ["severity", "kind", "code", "message", "file", "place", "labels", "help"];
        assert!(keys.iter().all(|key| object.get(key).is_some()) && object["message"].is_string(), "{object}");
        object["kind"].as_str().unwrap().to_owned()
    };
    fs::write(home.join("m.spec"), "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nstate x = 1\nx' = -x\noutput x\n")
        .unwrap();
    assert_eq!(kind(&["compile", "m.spec", "--pess", "3"], 2), "usage");
    assert_eq!(kind(&["compile", "m.spec", "--allow", "E0201"], 2), "usage");
    assert_eq!(kind(&["compile", "m.spec", "--span", "1us"], 2), "usage");
    assert_eq!(kind(&["compile", "m.spec", "--set", "k=3"], 1), "model");
    assert_eq!(kind(&["compile", "none.spec"], 3), "file");
    assert_eq!(kind(&["verify", "none"], 3), "file");
    assert_eq!(kind(&["explain", "E9999"], 2), "usage");
}

#[test]
fn a_closed_standard_error_does_not_stop_a_compilation() {
    let home = folder("closed_stderr");
    let mut command = pe_synth();
    command.arg("compile").arg(model("harmonic_oscillator")).args(["--span", "50ms", "-o"]).arg(home.join("out"));
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stderr.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(home.join("out/report.json").exists());
}

#[test]
fn a_word_that_is_short_for_the_accuracy_is_warned_about() {
    let home = folder("short_word");
    let spec = home.join("m.spec");
    fs::write(&spec, format!("model m\n{HEAD}state x = 1 in -1e9 .. 1e9\nx' = -x\noutput x\n")).unwrap();
    let output = compile(&spec, &home.join("out"), &[]);
    assert!(output.status.code() == Some(1) && stderr(&output).contains("error[E0907]"), "{}", stderr(&output));
    let output = compile(&spec, &home.join("out"), &["--allow", "E0907"]);
    assert!(output.status.success() && stderr(&output).contains("warning[E0907]"), "{}", stderr(&output));
    fs::write(&spec, format!("model m\n{HEAD}state x = 1 in -3e8 .. 3e8\nx' = -x\noutput x\n")).unwrap();
    let output = compile(&spec, &home.join("out"), &[]);
    assert!(output.status.success() && stderr(&output).contains("warning[W0905]: word short"), "{}", stderr(&output));
    fs::write(&spec, format!("model m\n{HEAD}state x = 1 in -2 .. 2\nx' = -x\noutput x\n")).unwrap();
    let output = compile(&spec, &home.join("out"), &[]);
    assert!(output.status.success() && !stderr(&output).contains("warning"), "{}", stderr(&output));
}

#[test]
fn a_design_too_large_for_the_device_is_written_with_a_warning() {
    let home = folder("device");
    let of = |device: &str, target: &str| {
        let options = ["--pes", "60", "--span", "20ms", "--device", device];
        let output = compile(&model("weibel5"), &home.join(target), &options);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let report = fs::read_to_string(home.join(target).join("report.json")).unwrap();
        (serde_json::from_str::<Value>(&report).unwrap()["device"].clone(), stderr(&output))
    };
    let (small, warnings) = of("xc7z020", "small");
    assert!(warnings.contains("W0801") && warnings.contains("240 of 220 DSP"), "{warnings}");
    assert_eq!((&small["fits"], &small["exceeded"][0]), (&Value::Bool(false), &Value::from("dsp")));
    assert_eq!(small["fitting_pes"], 55, "{small}");
    let (large, warnings) = of("XCAU25P", "large");
    assert!(large["fits"] == true && !warnings.contains("W0801"), "{large} {warnings}");
}

#[test]
fn a_clock_is_given_estimated_or_assumed() {
    let home = folder("clock");
    let of = |target: &str, options: &[&str]| {
        let all = [&["--pes", "2", "--span", "20ms", "--pipeline", "deep", "--multiplier", "18x18"], options].concat();
        let output = compile(&model("weibel5"), &home.join(target), &all);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let report = fs::read_to_string(home.join(target).join("report.json")).unwrap();
        serde_json::from_str::<Value>(&report).unwrap()["clock"].clone()
    };
    let estimated = of("ecp5", &["--device", "LFE5UM-85F"]);
    assert_eq!(estimated["basis"], "estimated", "{estimated}");
    assert!(estimated["mhz"].as_f64() > Some(200.0) && estimated["error_mhz"].as_f64() > Some(0.0), "{estimated}");
    let given = of("given", &["--device", "LFE5UM-85F", "--clock", "100"]);
    assert_eq!(given, serde_json::json!({"mhz": 100.0, "basis": "given"}));
    let assumed = of("xilinx", &["--device", "XC7Z020"]);
    assert_eq!(assumed, serde_json::json!({"mhz": 150.0, "basis": "assumed"}));
}

#[test]
fn measured_pes_take_the_place_of_estimates() {
    let home = folder("area_from");
    let file = home.join("area.txt");
    let of = |target: &str, options: &[&str]| {
        let output =
            compile(&model("lutchen20"), &home.join(target), &[&["--pes", "2", "--span", "20ms"], options].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let report = fs::read_to_string(home.join(target).join("report.json")).unwrap();
        serde_json::from_str::<Value>(&report).unwrap()["area"].clone()
    };
    let estimated = of("estimated", &[]);
    assert!(estimated["basis"] == "estimated" && estimated["measured_pes"] == 0, "{estimated}");
    assert!(estimated["lut_error"].as_f64() > Some(0.0) && estimated["ff_error"].as_f64() > Some(0.0), "{estimated}");

    let shapes = fs::read_to_string(home.join("estimated/lutchen20_shapes.txt")).unwrap();
    let lines: Vec<String> = shapes.lines().map(|line| format!("{line} lut=5000 ff=7000 dsp=1 bram18=1\n")).collect();
    assert_eq!(lines.len(), 2, "{shapes}");
    let from = ["--area-from", file.to_str().unwrap()];
    fs::write(&file, lines.concat()).unwrap();
    let measured = of("measured", &from);
    assert!(measured["basis"] == "measured" && measured["measured_pes"] == 2, "{measured}");
    assert!(measured["lut"].as_f64() >= Some(10_000.0) && measured["lut_error"] == 0.0, "{measured}");
    fs::write(&file, &lines[0]).unwrap();
    let half = of("half", &from);
    assert!(half["basis"] == "estimated" && half["measured_pes"] == 1, "{half}");
    assert!(half["lut_error"].as_f64() < estimated["lut_error"].as_f64(), "{half}");

    fs::write(&file, format!("{}no shape\n", lines[0])).unwrap();
    let output = compile(&model("lutchen20"), &home.join("bad"), &from);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(stderr(&output).contains("area.txt:2: not a measured PE"), "{}", stderr(&output));
}
