//! Runs with coefficients rounded in several ways, side by side, are the runs one by one.

use crate::support::Family;
use crate::support::flow::{Flow, Placement, format};
use pe_hls::rounding::{self, Aim, Moments, Sampling};
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_sim::double::DoubleRun;
use pe_sim::rounded::RoundedRuns;

const STEPS: u64 = 60;

fn moments(model: &Model, graph: &StepGraph) -> Moments {
    let (mut sampling, mut run) = (Sampling::new(graph), DoubleRun::new(graph));
    for step in 0..8 {
        run.step(&model.sample_inputs(model.time(step, 0.0))).expect("a stable model");
        sampling.add(|value| run.value(value));
    }
    sampling.moments()
}

/// Both roundings of a design, side by side and one by one; the number of states that differ between the roundings.
fn compared(flow: &Flow) -> usize {
    let Flow { model, graph, fixed, label, .. } = flow;
    let moments = moments(model, graph);
    let roundings: [FixedPoint; 2] = [Aim::Chain, Aim::Step].map(|aim| {
        let mut fixed = fixed.clone();
        rounding::improve(graph, &mut fixed, &moments, aim);
        fixed
    });
    // One that explodes in the middle of the span.
    let mut wild = roundings[1].clone();
    wild.coefficients.iter_mut().for_each(|coefficient| *coefficient *= 1 << 12);
    let mut differing = 0;
    for other in [&roundings[1], &wild] {
        let both = [&roundings[0], other];
        let mut runs = RoundedRuns::new(graph, both);
        let mut alone = both.map(|fixed| DoubleRun::quantised(graph, fixed));
        for step in 0..STEPS {
            let inputs = model.sample_inputs(model.time(step, 0.0));
            let finite = alone.each_mut().map(|run| run.step(&inputs).is_ok());
            assert_eq!(runs.step(&inputs), finite == [true, true], "{label}, step {step}");
            if finite != [true, true] {
                break;
            }
            for (run, alone) in alone.iter().enumerate() {
                let states: Vec<u64> = runs.states(run).map(f64::to_bits).collect();
                let should: Vec<u64> =
                    (0..graph.states.len()).map(|state| alone.state(StateId::at(state)).to_bits()).collect();
                assert_eq!(states, should, "{label}, step {step}, rounding {run}");
            }
        }
        differing += runs.states(0).zip(runs.states(1)).filter(|(one, other)| one != other).count();
    }
    differing
}

#[test]
fn runs_side_by_side_are_those_one_by_one() {
    let mut differing = 0;
    for (seed, solver) in (0..).zip(Solver::RUNGE_KUTTA) {
        for family in [Family::Polynomial, Family::OneProduct, Family::Stencil, Family::Affine] {
            for (seed, size) in [(2 * seed, (9, 2)), (2 * seed + 1, (40, 3))] {
                let word = format(32, 25, 18);
                differing += compared(&Flow::random(family, size, solver, word, Placement::Scattered, seed));
            }
        }
        differing += compared(&Flow::tabled((10, 3), solver, format(32, 25, 18), Placement::Scattered, seed));
    }
    assert!(differing > 100, "{differing} states differ");
}
