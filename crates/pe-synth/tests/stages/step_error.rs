//! One step in fixed point against the same step in double precision: the difference is explained by rounding alone.
//!
//! The bound is derived per model: half an LSB wherever a word or an operand is rounded, and what each coefficient
//! lost to its port, carried through all chains of the step.

use crate::support::flow::{FORMATS, Flow, Placement, format};
use crate::support::{FAMILIES, Family};
use pe_hls::rounding::{self, Aim, Sampling};
use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StageForm, StepGraph, ValueId};
use pe_ir::index::{ChainId, StateId};
use pe_ir::model::Solver;
use pe_ir::word::WordFormat;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;

/// Steps of each run.
const STEPS: u64 = 12;

fn flows() -> impl Iterator<Item = Flow> {
    FAMILIES.into_iter().flat_map(|family| {
        Solver::RUNGE_KUTTA.into_iter().flat_map(move |solver| {
            FORMATS
                .into_iter()
                .map(move |format| Flow::random(family, (7, 2), solver, format, Placement::Scattered, 82))
        })
    })
}

/// `number * 2^exponent`.
fn scaled(number: f64, exponent: i32) -> f64 {
    number * 2f64.powi(exponent)
}

#[test]
fn the_formats_put_every_sum_on_the_point_of_its_result() {
    // The shifts are what a run believes in; here they follow from the binary points of operands and results.
    let mut checked = 0;
    for Flow { label, graph, fixed, .. } in flows() {
        let exponent = |id: ValueId| fixed.exponents[id.index()];
        let WordFormat { data_bits, coefficient_bits, .. } = fixed.format;
        // Words beyond the width of products plus two take their sums shifted to the left.
        let lift = (fixed.format.word_bits() as i32 + 2 - (data_bits + coefficient_bits) as i32).max(0);
        for (index, chain) in graph.chains.numbered() {
            for term in graph.chain_terms(chain) {
                if let Factor::Value(factor) = term.factor {
                    let data = exponent(term.operand) + fixed.format.data_drop() as i32;
                    let second = exponent(factor) + fixed.format.factor_drop() as i32;
                    assert_eq!(data + second, fixed.products[index], "{label}: chain {index}");
                }
            }
            for (write, shift) in chain.writes().zip(fixed.shifts[index]) {
                let point = fixed.products[index] + write.weight + i32::from(shift) - lift;
                assert_eq!(point, exponent(write.value), "{label}: `{}`", graph.value_name(write.value));
                assert!(write.base.is_none_or(|base| exponent(base) == point), "{label}: chain {index}, base");
                checked += 1;
            }
        }
    }
    println!("{checked} writes on their point");
    assert!(checked > 1_000);
}

/// A step and what is known of its errors.
struct Bound<'a> {
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    /// Numbers in double precision: states at the start of the step, everything else at its end.
    numbers: Vec<f64>,
    /// How far each value of the step can be from its number.
    bounds: Vec<f64>,
}

impl<'a> Bound<'a> {
    /// Before any chain has run: states and inputs are exact, constants rounded.
    fn new(graph: &'a StepGraph, fixed: &'a FixedPoint, numbers: Vec<f64>) -> Self {
        let of_value = |(value, exponent): (&pe_ir::graph::Value, &i32)| match value.role {
            Role::Constant(_) => scaled(0.5, *exponent),
            _ => 0.0,
        };
        let bounds = graph.values.iter().zip(&fixed.exponents).map(of_value).collect();
        Bound { graph, fixed, numbers, bounds }
    }

    /// Carries the errors through a chain.
    fn advance(&mut self, index: ChainId, chain: &Chain) {
        let sum: f64 = chain.terms.clone().map(|term| self.product(index, term as usize)).sum();
        for write in chain.writes() {
            let base = write.base.map_or(0.0, |base| self.bounds[base.index()]);
            let half = scaled(0.5, self.fixed.exponents[write.value.index()]);
            self.bounds[write.value.index()] = base + scaled(sum, write.weight) + half;
        }
    }

    /// How far a product can be from its number.
    fn product(&self, chain: ChainId, term: usize) -> f64 {
        let operand = self.graph.terms[term].operand.index();
        let lsb = scaled(1.0, self.fixed.exponents[operand] + self.fixed.format.data_drop() as i32);
        let (x, dx) = (self.numbers[operand].abs(), self.bounds[operand] + 0.5 * lsb);
        let (y, dy) = match self.graph.terms[term].factor {
            Factor::Coefficient(exact) => {
                let lost = (self.fixed.coefficient_value(self.graph, chain, term) - exact).abs();
                let reach = (rounding::REACH as f64 + 0.5) * scaled(1.0, self.fixed.products[chain]) / lsb;
                assert!(lost <= reach * (1.0 + 1e-9), "coefficient {exact:e} is off by {lost:e}");
                (exact.abs(), lost)
            }
            Factor::Value(factor) => {
                let lsb = scaled(1.0, self.fixed.exponents[factor.index()] + self.fixed.format.factor_drop() as i32);
                (self.numbers[factor.index()].abs(), self.bounds[factor.index()] + 0.5 * lsb)
            }
        };
        x * dy + y * dx + dx * dy
    }
}

#[test]
fn a_step_stays_within_the_bound_of_its_roundings() {
    let (mut checked, mut used) = (0u64, 0.0f64);
    for flow in flows() {
        let mut run = FixedRun::new(&flow.graph, &flow.fixed);
        for step in 0..STEPS {
            used = used.max(check_step(&flow, &mut run, step));
            checked += flow.graph.states.len() as u64;
        }
    }
    println!("{checked} states within the bound of their roundings, at most {:.0} % of it used", 100.0 * used);
    assert!(used > 0.01, "the bound says nothing");
}

/// Advances a run by a step; returns the largest share of the bound that a state's error takes.
fn check_step(flow: &Flow, run: &mut FixedRun, step: u64) -> f64 {
    let (graph, fixed) = (&flow.graph, &flow.fixed);
    // The double run starts from the very numbers that the words stand for.
    let mut double = DoubleRun::new(graph);
    let before: Vec<f64> = (0..graph.states.len()).map(|index| run.state(StateId::at(index))).collect();
    before.iter().enumerate().for_each(|(index, number)| double.set_state(StateId::at(index), *number));
    let ports = flow.inputs(run, step);
    run.step(&ports);
    let input = |id: &ValueId| scaled(run.word(*id) as f64, fixed.exponents[id.index()]);
    double.step(&graph.inputs.iter().map(input).collect::<Vec<f64>>()).expect("the model is stable");
    let number = |id: usize| match graph.values[id].role {
        Role::State(state) => before[state.index()],
        _ => double.value(id),
    };
    let mut bound = Bound::new(graph, fixed, (0..graph.values.len()).map(number).collect());
    for (index, chain) in graph.chains.numbered() {
        bound.advance(index, chain);
    }
    let mut used = 0.0f64;
    for (state, (_, next)) in graph.states.iter().enumerate() {
        let error = (run.state(StateId::at(state)) - double.state(StateId::at(state))).abs();
        // Double precision rounds as well, by far less.
        let limit = bound.bounds[next.index()] + double.state(StateId::at(state)).abs() * 1e-13;
        assert!(error <= limit, "{}, step {step}, state {state}: off by {error:e}, bound {limit:e}", flow.label);
        used = used.max(error / limit);
    }
    used
}

/// Root mean square over the states of what quantised coefficients change in the increments of a step, relative to the
/// largest increment.
fn increment_error(graph: &StepGraph, fixed: &FixedPoint, inputs: &[f64]) -> f64 {
    let after = |mut run: DoubleRun| -> Vec<f64> {
        run.step(inputs).unwrap();
        (0..graph.states.len()).map(|state| run.state(StateId::at(state))).collect()
    };
    let before = DoubleRun::new(graph);
    let exact = after(DoubleRun::new(graph));
    let quantised = after(DoubleRun::quantised(graph, fixed));
    let largest =
        exact.iter().enumerate().map(|(s, end)| (end - before.state(StateId::at(s))).abs()).fold(0.0, f64::max);
    let squares: f64 = exact.iter().zip(&quantised).map(|(a, b)| ((a - b) / largest).powi(2)).sum();
    (squares / exact.len() as f64).sqrt()
}

#[test]
fn roundings_of_the_last_stage_make_good_what_earlier_stages_rounded_away() {
    let (mut chain, mut step, mut compared) = (0.0, 0.0, 0);
    for family in [Family::Polynomial, Family::OneProduct, Family::Stencil] {
        for solver in [Solver::Heun, Solver::Heun3, Solver::Rk4] {
            for seed in 80..90 {
                let size = (9, 2);
                let Flow { model, graph, fixed, label, .. } =
                    Flow::random(family, size, solver, format(32, 25, 18), Placement::Scattered, seed);
                if graph.form != StageForm::Increments {
                    continue;
                }
                let inputs = model.sample_inputs(0.0);
                let mut sampling = Sampling::new(&graph);
                let mut run = DoubleRun::new(&graph);
                for _ in 0..STEPS {
                    run.step(&inputs).unwrap();
                    sampling.add(|value| run.value(value));
                }
                let moments = sampling.moments();
                let error = |aim| {
                    let mut fixed = fixed.clone();
                    rounding::improve(&graph, &mut fixed, &moments, aim);
                    increment_error(&graph, &fixed, &inputs)
                };
                let errors = (error(Aim::Chain), error(Aim::Step));
                assert!(errors.0.is_finite() && errors.1.is_finite(), "{label}: {errors:?}");
                chain += errors.0.ln();
                step += errors.1.ln();
                compared += 1;
            }
        }
    }
    let gain = ((chain - step) / f64::from(compared)).exp();
    println!("{compared} models, geometric mean of the gains {gain:.2}");
    assert!(compared > 50 && gain > 1.25, "{compared} models, {gain}");
}
