//! `pe-synth bench`: the native baseline computes what the compiler's own run computes.

use std::path::{Path, PathBuf};
use std::process::Command;

use pe_hls::step::{self, StepOptions};
use pe_ir::graph::StageForm;
use pe_ir::index::StateId;
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;
use pe_verify::native;
use serde_json::Value;

use crate::support::kept;

/// Steps of a comparison: odd, so that states end where those of the next step began.
const STEPS: u64 = 21;

/// Couplings without any order, products of states, and an input.
const IRREGULAR: &str = "\
model irregular
solver rk4
step 1 ms
span 1 s
const n = 260
index i in 1..n
input u = sine(1, 2 Hz)
state x[i] = cos(i)
x[i]' = -x[i]*(1 + 0.1*sin(i)) + 0.3*x[(i*i) mod n + 1]*x[(7*i) mod n + 1]
      + (if i mod 3 == 0 then 0.2*x[(11*i) mod n + 1] else u)
output x[1]
";

fn bench(path: Option<&Path>) -> Value {
    bench_of("van_der_pol", &["--pes", "2", "--span", "1s", "--steps", "1000"], path)
}

fn bench_of(model: &str, options: &[&str], path: Option<&Path>) -> Value {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../models/{model}/{model}.spec"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("bench").arg(spec).args(options).args(["--message-format", "json"]);
    if let Some(path) = path {
        command.env("PATH", path);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn native_code_computes_the_same_numbers_in_double_precision_and_near_ones_in_single() {
    let figures = bench(None);
    let runs = figures["computer"]["runs"].as_array().unwrap();
    let errors: Vec<f64> = runs.iter().map(|run| run["error"].as_f64().unwrap()).collect();
    assert!(errors[0] < 1e-13, "{figures}");
    assert!(errors[1] > 0.0 && errors[1] < 1e-3, "{figures}");
    assert!(runs.iter().all(|run| run["us_per_step"].as_f64().unwrap() > 0.0), "{figures}");
    assert_eq!(figures["hardware"]["clock"]["basis"], "assumed", "{figures}");
}

/// Tables of equal segments and of octaves, few lookups that are written out and many that are listed.
#[test]
fn native_code_looks_up_what_tables_hold() {
    let models = [
        ("hodgkin_huxley", &["--steps", "1001"][..]),
        ("ventilator", &["--steps", "101"]),
        ("ventricle", &["--set", "n=2", "--span", "25us", "--steps", "5", "--allow", "E0903"]),
    ];
    for (model, options) in kept(models, 2) {
        let figures = bench_of(model, options, None);
        let runs = figures["computer"]["runs"].as_array().unwrap();
        let double = runs.iter().filter(|run| run["precision"] == "double");
        assert!(double.clone().count() > 0, "{model}: {figures}");
        double.for_each(|run| assert!(run["error"].as_f64().unwrap() < 1e-10, "{model}: {run}"));
        assert!(runs.iter().all(|run| run["error"].as_f64().unwrap() < 1e-2), "{model}: {figures}");
    }
}

#[test]
fn without_a_compiler_the_loops_of_this_program_are_the_baseline_and_it_says_so() {
    let empty = std::env::temp_dir().join(format!("pe-synth-bench-test-{}", std::process::id()));
    std::fs::create_dir_all(&empty).unwrap();
    let figures = bench(Some(&empty));
    std::fs::remove_dir(&empty).unwrap();
    let kernel = figures["computer"]["kernel"].as_str().unwrap();
    assert!(kernel.contains("loops of this program") && kernel.contains("rustc"), "{kernel}");
    assert_eq!(figures["computer"]["runs"].as_array().unwrap().len(), 1);
}

/// The generated program of a spec against the run in double precision; the parts of its products that are in loops.
fn compare(name: &str, text: Option<&str>, form: Option<StageForm>) -> f64 {
    let models = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let path = models.join(format!("{name}/{name}.spec"));
    let text = text.map_or_else(|| std::fs::read_to_string(&path).unwrap(), str::to_owned);
    let (mut sources, _) = pe_frontend::main_file(name, text.as_bytes());
    let loader = pe_flow::spec::ModelFolder::of(&path);
    let overrides = pe_frontend::Overrides::default();
    let Ok((model, _)) = pe_frontend::compile(&mut sources, &loader, &overrides) else { panic!("{name}") };
    let model = pe_hls::lift::lift(model);
    let graph = step::build_with(&model, &StepOptions { form, ..StepOptions::default() }).unwrap();
    let inputs: Vec<Vec<f64>> = (0..STEPS).map(|step| model.sample_inputs(model.time(step, 0.0))).collect();
    let mut run = DoubleRun::new(&graph);
    inputs.iter().for_each(|inputs| run.step(inputs).unwrap());
    let mut reference = Trajectory::new(model.states.len());
    reference.push(|state| run.state(StateId::at(state)));
    let folder = std::env::temp_dir().join(format!("pe-synth-native-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let measurement = native::measure(&model, &graph, &inputs, &reference, (&folder, &[]));
    std::fs::remove_dir_all(&folder).unwrap();
    let measurement = measurement.unwrap_or_else(|failure| panic!("{name}: {failure:?}"));
    for run in &measurement.runs {
        let largest = if run.precision == "double" { 1e-13 } else { 1e-4 };
        assert!(run.error < largest, "{name}: {run:?}");
    }
    measurement.work.unwrap().in_loops as f64 / graph.macs() as f64
}

#[test]
fn trees_are_loops_over_levels() {
    assert!(compare("weibel11", None, Some(StageForm::Horner)) > 0.9);
}

#[test]
fn grids_are_loops_with_free_edges_and_cubic_terms_in_them() {
    assert!(compare("atrial15", None, None) > 1.0);
}

#[test]
fn what_has_no_structure_is_listed() {
    assert!(compare("irregular", Some(IRREGULAR), None) < 0.5);
}

#[test]
fn a_program_that_is_not_there_is_named() {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/van_der_pol/van_der_pol.spec");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("bench").arg(spec).args(["--pes", "2", "--span", "1s", "--steps", "10", "--against", "double=missing"]);
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && text.contains("missing"), "{text}");
}
