//! Specs that tests write, run step by step in double precision.

use pe_frontend::{NoFiles, Overrides};
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::source::Sources;
use pe_sim::double::DoubleRun;

/// The model of a spec.
pub fn compiled(text: &str) -> Model {
    let mut sources = Sources::new("written.spec", text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    let (model, _) = compiled.unwrap_or_else(|findings| panic!("{findings:#?}\n{text}"));
    pe_hls::lift::lift(model)
}

/// Its step, which checkers and texts take.
pub fn graph_of(model: &Model) -> StepGraph {
    let graph = pe_hls::step::build(model).unwrap_or_else(|findings| panic!("{findings:#?}"));
    assert!(pe_ir::verify::step::check(&graph).is_empty());
    let text = graph.to_string();
    assert_eq!(text.parse::<StepGraph>().unwrap().to_string(), text);
    let text = model.to_string();
    assert_eq!(text.parse::<Model>().unwrap().to_string(), text);
    graph
}

/// The states of a model after each step, in double precision; the first row is the beginning.
pub fn rows(model: &Model) -> Vec<Vec<f64>> {
    let graph = graph_of(model);
    let mut run = DoubleRun::new(&graph);
    let mut rows = vec![model.states.iter().map(|state| state.initial).collect::<Vec<f64>>()];
    for step in 0..model.steps() {
        run.step(&model.sample_inputs(model.time(step, 0.0))).expect("it is finite");
        rows.push(run.states().take(model.states.len()).collect());
    }
    rows
}

/// A number between 0 and 1.
pub fn next(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 33) as f64 / f64::from(1u32 << 31)
}
