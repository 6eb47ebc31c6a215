//! Heavy equations split into partial sums: the same numbers, spread over more PEs.

use crate::support::flow::{Flow, Placement, format};
use pe_hls::schedule::Bound;
use pe_hls::split::split;
use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Sources;
use pe_ir::word::{Latency, Pipeline};
use pe_sim::double::DoubleRun;

const LATENCY: Latency = Latency { multiplier: 1, pipeline: Pipeline::Short };
const LIMIT: u32 = 15;

/// Cells that all follow a mean, which sums products of all of them.
const HUB: &str = "
model hub
solver rk4
step 1 ms
span 100 ms
const n = 120
index i in 1..n
state m = 0.1
state x[i] = i/n
m' = -0.3*m + 0.02*sum(j in 1..n: x[j]*(1 - m*x[j])) + 0.1
x[i]' = 2*(m - x[i]) - 0.1*x[i]
output m, x[1]
";

/// Every state reads every other.
const DENSE: &str = "
model dense
solver heun
step 1 ms
span 100 ms
const n = 70
index i in 1..n
state x[i] = sin(i)
x[i]' = -3*x[i] + sum(j in 1..n: 0.03*cos(i*j)*x[j])
output x[1], x[n]
";

struct NoFiles;

impl pe_frontend::Loader for NoFiles {
    fn load(&self, _: &str) -> Result<Vec<u8>, pe_frontend::LoadError> {
        Err(pe_frontend::LoadError::Missing)
    }
}

pub(super) fn model(text: &str) -> Model {
    let mut sources = Sources::new("test.spec", text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &pe_frontend::Overrides::default());
    compiled.unwrap_or_else(|findings| panic!("{findings:?}")).0
}

/// States after some steps in double precision.
fn states(graph: &StepGraph) -> Vec<f64> {
    let mut run = DoubleRun::new(graph);
    (0..20).for_each(|_| run.step(&[]).expect("finite"));
    (0..graph.states.len()).map(|state| run.state(StateId::at(state))).collect()
}

#[test]
fn a_split_model_computes_the_same() {
    for (text, pes) in [(HUB, 2), (HUB, 8), (HUB, 60), (DENSE, 20), (DENSE, 70)] {
        let graph = pe_hls::step::build(&model(text)).expect("a step graph");
        let parts = split(&graph, pes, LIMIT, LATENCY);
        if pes > 2 {
            assert!(parts.is_some(), "nothing is split for {pes} PEs");
        }
        let parts = parts.unwrap_or_else(|| graph.clone());
        for (whole, part) in states(&graph).into_iter().zip(states(&parts)) {
            assert!((whole - part).abs() < 1e-12, "{whole} {part} on {pes} PEs");
        }
    }
}

#[test]
fn a_long_sum_no_longer_limits_the_step() {
    let graph = pe_hls::step::build(&model(HUB)).expect("a step graph");
    let bound = |graph: &StepGraph| Bound::of(graph, 40, LATENCY).binding().0;
    let parts = split(&graph, 40, LIMIT, LATENCY).expect("split");
    assert!(3 * bound(&parts) < bound(&graph), "{} {}", bound(&parts), bound(&graph));
    assert!(parts.equations.iter().any(|equation| equation.name.starts_with("m.part")));
}

#[test]
fn what_is_balanced_stays_whole() {
    let graph = pe_hls::step::build(&model(DENSE)).expect("a step graph");
    assert!(split(&graph, 14, LIMIT, LATENCY).is_none());
    let hub = pe_hls::step::build(&model(HUB)).expect("a step graph");
    assert!(split(&hub, 1, LIMIT, LATENCY).is_none());
}

#[test]
fn a_split_model_passes_every_checker() {
    for (text, pes, placement) in [(HUB, 12, Placement::Annealed), (HUB, 30, Placement::Scattered)] {
        let flow = Flow::of(format!("on {pes} PEs"), model(text), pes, format(32, 25, 18), placement);
        assert!(flow.graph.equations.len() > flow.model.states.len(), "{} is not split", flow.label);
    }
}
