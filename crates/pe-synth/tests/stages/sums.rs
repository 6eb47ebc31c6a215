//! Sums of more products of two variables than the accumulator holds.

use crate::support::flow::{Flow, Placement, format};
use pe_ir::graph::{Factor, StepGraph};
use pe_ir::index::StateId;
use pe_ir::word::WordFormat;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::Machine;

use super::split::model;

/// A sum over `count` products of two variables, of magnitudes that differ by `ratio`, and, if `mixed`, as many
/// coefficients; in one equation, or in named parts of 14 products. Even counts are computed in four stages.
fn text(count: usize, ratio: f64, mixed: bool, parts: bool) -> String {
    let product = |k: usize| format!("{} {ratio:e}*x[{k}]*z[{k}]", if k.is_multiple_of(3) { "-" } else { "+" });
    let (mut named, mut sum) = (String::new(), String::new());
    for (part, first) in (1..=count).step_by(14).enumerate() {
        let products: String = (first..(first + 14).min(count + 1)).map(product).collect();
        if parts {
            named += &format!("p{part} = 0 {products}\n");
            sum += &format!(" + p{part}");
        } else {
            sum += &products;
        }
    }
    let solver = if count.is_multiple_of(2) { "rk4" } else { "euler" };
    let mixed = if mixed { " + sum(j in 1..n: 0.01*j*x[j])" } else { "" };
    format!(
        "model sums\nsolver {solver}\nstep 1 ms\nspan 40 ms\nconst n = {count}\nindex i in 1..n\n\
         state x[i] = {ratio:e}*sin(i)/2\nstate z[i] = cos(i)/{ratio:e}^2\nstate y = 0.1\n{named}\
         x[i]' = -x[i]\nz[i]' = -2*z[i]\ny' = -y {sum}{mixed}\noutput y\n"
    )
}

fn longest(graph: &StepGraph) -> usize {
    let products =
        |chain| graph.chain_terms(chain).iter().filter(|term| matches!(term.factor, Factor::Value(_))).count();
    graph.chains.iter().map(products).max().unwrap_or(0)
}

fn follows(count: usize, ratio: f64, format: WordFormat, (mixed, parts): (bool, bool), pes: u32) {
    let label = format!("{count} products, ratio {ratio:e}, {format:?}, mixed {mixed}, parts {parts}, {pes} PEs");
    let flow = Flow::of(label.clone(), model(&text(count, ratio, mixed, parts)), pes, format, Placement::Scattered);
    assert!(longest(&flow.graph) <= pe_hls::sums::most_products(&format) as usize, "{label}");
    let mut machine = Machine::new(&flow.program);
    let mut double = DoubleRun::new(&flow.graph);
    let mut run = FixedRun::new(&flow.graph, &flow.fixed);
    for step in 1..=20 {
        machine.step(&[], &mut |_| {});
        run.step(&[]);
        double.step(&[]).expect("finite");
        flow.assert_words(&machine, &run, &format!("step {step}"));
    }
    let y = flow.model.states.iter().position(|state| state.name == "y").expect("a state");
    let value = flow.graph.states[StateId::at(y)].0;
    let is = libm::scalbn(run.word(value) as f64, flow.fixed.exponents[value.index()]);
    let should = double.state(StateId::at(y));
    // Half a bit of the narrower port for each product, of their largest sum.
    let bits = format.data_bits.min(format.coefficient_bits) as i32;
    let allowed = 4.0 * count as f64 * libm::exp2(f64::from(1 - bits));
    assert!((is - should).abs() <= allowed, "{label}: {is} in place of {should}");
}

#[test]
fn sums_of_any_length_compile_and_are_right() {
    let formats = [format(32, 32, 32), format(32, 18, 18), format(32, 25, 18), format(40, 35, 35)];
    for (index, count) in [8, 31, 32, 33, 42, 63, 64, 100, 200].into_iter().enumerate() {
        for (other, words) in formats.into_iter().enumerate() {
            let ratio = [1.0, 1e4, 1e-4][(index + other) % 3];
            let shape = ((index + other) % 2 == 0, index % 2 == 0);
            follows(count, ratio, words, shape, 1 + (index + 2 * other) as u32 % 5);
        }
    }
}
