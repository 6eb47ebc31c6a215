//! The text forms of all stages: exactly what was printed is read back, and damaged texts are refused with a place.

use std::path::{Path, PathBuf};

use pe_flow::spec::ModelFolder;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_ir::source::{Sources, Span};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// The specs of the validation set, and those of the shipped models that compile in a moment.
fn specs() -> Vec<PathBuf> {
    let large = ["lutchen4000", "wave80", "weibel11", "weibel11_pressure", "weibel11_square", "atrial15", "gray_scott"];
    let mut specs: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(models()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let spec = path.join(format!("{name}.spec"));
        if spec.exists() && !large.contains(&name.as_str()) {
            specs.push(spec);
        }
    }
    for entry in std::fs::read_dir(models().join("validation")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "spec") {
            specs.push(path);
        }
    }
    specs.sort();
    specs
}

fn load(spec: &Path) -> Model {
    let mut sources = Sources::new("m.spec", &std::fs::read_to_string(spec).unwrap());
    let (model, _) = pe_frontend::compile(&mut sources, &ModelFolder::of(spec), &pe_frontend::Overrides::default())
        .unwrap_or_else(|findings| panic!("{}: {findings:?}", spec.display()));
    pe_hls::lift::lift(model)
}

/// A model without places in its spec, in full.
fn bare(model: &Model) -> String {
    let mut model = model.clone();
    let none = Span::default();
    model.states.iter_mut().for_each(|state| state.span = none);
    model.algebraics.iter_mut().for_each(|algebraic| algebraic.span = none);
    model.inputs.iter_mut().for_each(|input| input.span = none);
    model.outputs.iter_mut().for_each(|output| output.span = none);
    model.signals.iter_mut().for_each(|signal| signal.span = none);
    model.rates.iter_mut().for_each(|rate| rate.span = none);
    format!("{model:?}")
}

fn bare_graph(graph: &StepGraph) -> String {
    let mut graph = graph.clone();
    graph.equations.iter_mut().for_each(|equation| equation.span = Span::default());
    format!("{graph:?}")
}

#[test]
fn models_and_steps_are_read_as_they_were_printed() {
    let mut failures = Vec::new();
    for spec in specs() {
        let model = load(&spec);
        let text = model.to_string();
        let name = spec.file_stem().unwrap().to_str().unwrap();
        match text.parse::<Model>() {
            Ok(read) if bare(&read) == bare(&model) => assert_eq!(read.to_string(), text, "{name}"),
            Ok(_) => failures.push(format!("{name}: another model")),
            Err(error) => {
                failures.push(format!("{name}: {error}\n  {}", text.lines().nth(error.line - 1).unwrap_or("")))
            }
        }
        let graph = match pe_hls::step::build(&model) {
            Ok(graph) => graph,
            Err(_) => continue,
        };
        check_step(name, &graph, &mut failures);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

fn check_step(name: &str, graph: &StepGraph, failures: &mut Vec<String>) {
    let text = graph.to_string();
    match text.parse::<StepGraph>() {
        Ok(read) if bare_graph(&read) == bare_graph(graph) => assert_eq!(read.to_string(), text, "{name}"),
        Ok(_) => failures.push(format!("{name}: another step")),
        Err(error) => failures.push(format!("{name}: {error}\n  {}", text.lines().nth(error.line - 1).unwrap_or(""))),
    }
}

#[test]
fn steps_of_every_method_are_read_as_they_were_printed() {
    let mut failures = Vec::new();
    for name in
        ["lotka_volterra", "harmonic_oscillator", "hodgkin_huxley", "pendulum", "motor_pid", "rc_ladder", "kepler"]
    {
        let model = load(&models().join(name).join(format!("{name}.spec")));
        for solver in Solver::ALL {
            if let Ok(graph) = pe_hls::step::build(&Model { solver, ..model.clone() }) {
                check_step(&format!("{name}, {}", solver.name()), &graph, &mut failures);
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
