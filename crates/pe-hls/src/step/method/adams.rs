//! Adams-Bashforth methods: `y+ = y + h (b_1 f_n + b_2 f_{n-1} + ..)`.
//!
//! The slopes before the first step are those of the solution backwards in time, computed here with classic Runge-Kutta
//! in double precision. Inputs that jump later find slopes from before the jump: there the method loses its order for a
//! few steps.

use pe_ir::coefficients::adams;
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Model, State, Variable};
use pe_ir::place::Place;

use crate::step::plan::{Plan, times};

/// Substeps per step on the way backwards: their error lies far below that of the method.
const SUBSTEPS: u32 = 8;

/// The step of a model.
pub fn plan(model: &Model) -> Plan<'_> {
    let weights = adams(model.solver);
    let states: Vec<StateId> = model.states.ids().collect();
    let history = slopes_before(model, weights.len() - 1);
    let mut plan = Plan::new(model);
    let (signals, states): (Vec<StateId>, Vec<StateId>) =
        states.into_iter().partition(|state| is_known(&model.states[*state]));
    for state in signals {
        plan.end(state, Some(Variable::State(state)), Expr::Constant(0.0));
    }
    // Increments h f of the steps before, the latest first.
    let memories: Vec<Vec<Variable>> = states
        .iter()
        .map(|state| {
            let name = &model.states[*state].name;
            let memory = |(age, slopes): (usize, &Vec<f64>)| (format!("{name}.before{age}"), slopes[state.index()]);
            let memories: Vec<(String, f64)> = (1..).zip(&history).map(memory).collect();
            memories.into_iter().map(|(name, slope)| plan.memory(*state, name, model.step * slope)).collect()
        })
        .collect();
    let mut start = plan.start();
    let slopes = plan.slopes(&mut start, &states);
    for ((state, slope), memories) in states.iter().zip(slopes).zip(&memories) {
        let memory = |memory: &Variable| match memory {
            Variable::State(index) => *index,
            _ => unreachable!("memories are states"),
        };
        let latest = plan.end(memory(&memories[0]), None, Expr::scaled(model.step, slope));
        for pair in memories.windows(2) {
            plan.end(memory(&pair[1]), None, times(1.0, pair[0]));
        }
        let increments = std::iter::once(&latest).chain(memories).zip(weights);
        let sum = Expr::sum(increments.map(|(increment, weight)| times(*weight, *increment)).collect());
        plan.end(*state, Some(Variable::State(*state)), sum);
    }
    plan
}

/// Whether a state stands for a signal, or stands still.
fn is_known(state: &State) -> bool {
    state.motion.is_some() || state.derivative == Expr::Constant(0.0)
}

/// Derivatives of all states at the times `-h`, `-2h`, .., as many as asked for, with the inputs of time zero.
fn slopes_before(model: &Model, count: usize) -> Vec<Vec<f64>> {
    let inputs = model.sample_inputs(0.0);
    let slope = |states: &[f64]| Place::new(model, states, &inputs).derivatives();
    let h = -model.step / f64::from(SUBSTEPS);
    let moved = |states: &[f64], slope: &[f64], by: f64| -> Vec<f64> {
        states.iter().zip(slope).map(|(state, slope)| state + by * slope).collect()
    };
    let mut states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let mut slopes = Vec::with_capacity(count);
    for _ in 0..count {
        for _ in 0..SUBSTEPS {
            let a = slope(&states);
            let b = slope(&moved(&states, &a, h / 2.0));
            let c = slope(&moved(&states, &b, h / 2.0));
            let d = slope(&moved(&states, &c, h));
            let sum: Vec<f64> = (0..states.len()).map(|i| a[i] + 2.0 * (b[i] + c[i]) + d[i]).collect();
            states = moved(&states, &sum, h / 6.0);
        }
        slopes.push(slope(&states));
    }
    slopes
}
