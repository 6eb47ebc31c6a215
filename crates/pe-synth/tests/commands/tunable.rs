//! Tunable parameters: what the map says, that a host changes them, and where they are refused.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use pe_map::Map;
use pe_sim::clocked::Clocked;
use pe_verify::folder::DesignFolder;
use serde_json::Value;

fn pe_synth(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().unwrap()
}

/// A spec in a folder of its own.
fn spec(test: &str, text: &str) -> PathBuf {
    let home = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("tunable_{test}"));
    fs::create_dir_all(&home).unwrap();
    let path = home.join("model.spec");
    fs::write(&path, text).unwrap();
    path
}

/// What `compile` says of a spec, and its folder.
fn compile(test: &str, text: &str, options: &str) -> (Output, PathBuf) {
    let path = spec(test, text);
    let folder = path.with_file_name("out");
    let mut arguments = vec!["compile", path.to_str().unwrap(), "--quiet", "--no-pictures"];
    arguments.extend(["-o", folder.to_str().unwrap()]);
    arguments.extend(options.split_whitespace());
    (pe_synth(&arguments), folder)
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A rate, a function of a parameter, a sampled block, an array.
const TUNED: &str = "\
model tuned
solver rk4
step 1 ms
span 200 ms
index i in 1..2
param rate [1/s] = 5 tunable in 1 .. 10
param gain[i] = i tunable in -2 .. 4
state x = 1
state y[i] = 0
x' = -rate*x
y[i]' = gain[i]*x - exp(-rate/5)*y[i]
every 10 ms {
  state u = 0
  next u = u/2 + rate*x
}
output x, y, u
";

#[test]
fn a_host_writes_parameters_as_it_writes_states() {
    let (output, folder) = compile("host", TUNED, "--pes 2 --host restart,states");
    assert!(output.status.success(), "{}", errors(&output));
    let map = Map::read(&fs::read_to_string(folder.join("tuned_map.json")).unwrap()).unwrap();
    let names: Vec<&str> = map.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    assert_eq!(names, ["rate", "gain[1]", "gain[2]"]);
    assert_eq!((map.parameters[0].range, map.parameters[0].unit.as_deref()), ([1.0, 10.0], Some("1/s")));
    let state = &map.states[map.parameters[0].state as usize];
    assert_eq!(state.name, "rate");
    assert_eq!(state.number(state.initial), 5.0);
    // The ends of the range have words.
    for value in [1.0, 10.0] {
        let word = state.word(value).unwrap();
        assert!(!word.clamped);
        assert_eq!(state.number(word.word), value);
    }
    // The network keeps a value for ever, and computes with it.
    let mut program = DesignFolder::open(&folder).unwrap().program;
    let number = program.states.iter().position(|state| state.name == "rate").unwrap();
    let id = program.states.ids().nth(number).unwrap();
    let register = program.states[id].clone();
    let word = state.word(8.0).unwrap().word;
    let format = program.format;
    register.set(&mut program.pes, &format, word);
    let mut network = Clocked::new(&program);
    (0..100).for_each(|_| network.step(&[], &mut |_| {}));
    assert_eq!(network.state(id), word);
    let x = map.outputs.iter().position(|output| output.name == "x").unwrap();
    let value = map.outputs[x].format.number(network.outputs()[x]);
    assert!((value - (-0.8f64).exp()).abs() < 1e-6, "{value}");
    let verified = pe_synth(&["verify", folder.to_str().unwrap(), "--engines", "ghdl", "--steps", "2"]);
    assert!(verified.status.success(), "{}", errors(&verified));
}

#[test]
fn formats_hold_the_ends_of_ranges_and_the_report_says_what_was_judged() {
    // With the values of the spec the states stay near 1; with the greatest one they reach 2.7e4.
    let text = "\
model growing
solver rk4
step 1 ms
span 1 s
param rate = 0.1 tunable in 0 .. 10.2
state x = 1
x' = rate*x
output x
";
    let (output, folder) = compile("ends", text, "--pes 1 --host states");
    assert!(output.status.success(), "{}", errors(&output));
    let report: Value = serde_json::from_str(&fs::read_to_string(folder.join("report.json")).unwrap()).unwrap();
    let parameters = &report["parameters"];
    assert_eq!(parameters["judged_at"], serde_json::json!(["rate = 0", "rate = 10.2"]), "{parameters}");
    let map = Map::read(&fs::read_to_string(folder.join("growing_map.json")).unwrap()).unwrap();
    let [_, most] = map.outputs[0].format.words();
    assert!(map.outputs[0].format.number(most) > (10.2f64).exp());
    // Errors are those of the worst end: a fixed step errs far more with the greatest rate.
    let alone = text.replace(" tunable in 0 .. 10.2", "").replace("0.1", "10.2");
    let (output, alone) = compile("alone", &alone, "--pes 1");
    assert!(output.status.success(), "{}", errors(&output));
    let alone: Value = serde_json::from_str(&fs::read_to_string(alone.join("report.json")).unwrap()).unwrap();
    let method = |report: &Value| report["error"]["method"].as_f64().unwrap();
    assert!(method(&report) >= 0.9 * method(&alone), "{} and {}", method(&report), method(&alone));
}

#[test]
fn what_is_fixed_before_the_run_cannot_be_tuned() {
    let parameter = "param k = 2 tunable in 1 .. 4\n";
    let model = |more: &str| {
        format!("model m\nsolver rk4\nstep 1 ms\nspan 10 ms\n{parameter}state x = 1\nx' = -k*x\n{more}output x\n")
    };
    let refused = [
        model("").replace("step 1 ms", "step k/2 ms"),
        model("").replace("span 10 ms", "span 5*k ms"),
        model("").replace("state x = 1", "state x = k"),
        model("").replace("state x = 1", "state x = 1 in -k .. k"),
        model("index i in 1..k\nstate y[i] = 0\ny[i]' = x\n"),
        model("input u = sine(k, 1 Hz)\nstate z = 0\nz' = u\n"),
        model("param twice = 2*k\nstate z = 0\nz' = twice*x\n"),
        model("k' = 1\n"),
    ];
    for text in refused {
        let (output, _) = compile("refused", &text, "--host states");
        let errors = errors(&output);
        assert_eq!(output.status.code(), Some(1), "{text}\n{errors}");
        assert!(errors.contains("a tunable parameter") && errors.contains('^'), "{text}\n{errors}");
        assert!(errors.contains("help: "), "{errors}");
    }
    let (output, _) = compile("no_range", &model("").replace(" in 1 .. 4", ""), "--host states");
    assert!(errors(&output).contains("`in`"), "{}", errors(&output));
    let (output, _) = compile("no_host", &model(""), "");
    assert!(errors(&output).contains("add `--host states`"), "{}", errors(&output));
    assert!(!output.status.success());
}

/// All words of a PE, or all that it imports, may be those of parameters.
#[test]
fn verify_does_not_wait_for_parameters_to_move() {
    for solver in ["euler", "heun3"] {
        let text = format!(
            "model still\nsolver {solver}\nstep 1 ms\nspan 50 ms\nparam k = 5 tunable in 1 .. 10\n\
             param c = 0.2 tunable in -1 .. 1\nstate x = 1\nstate y = 0\nx' = -k*x + c*y\ny' = x - y\noutput x, y\n"
        );
        let (output, folder) = compile(&format!("still_{solver}"), &text, "--pes 3 --host states");
        assert!(output.status.success(), "{}", errors(&output));
        let program = DesignFolder::open(&folder).unwrap().program;
        let tunable: Vec<&str> =
            program.states.iter().filter(|state| state.tunable).map(|state| state.name.as_str()).collect();
        assert_eq!(tunable, ["k", "c"]);
        let verified = pe_synth(&["verify", folder.to_str().unwrap(), "--engines", "ghdl,fast", "--steps", "2"]);
        assert!(verified.status.success(), "{solver}: {}", errors(&verified));
    }
}
