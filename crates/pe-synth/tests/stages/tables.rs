//! Tables in the step graph's fixed-point run compute the functions that they were made of.

use std::collections::BTreeSet;

use crate::support::flow::{Flow, Placement, format};
use crate::support::tables::exact;
use pe_ir::graph::{Role, ValueId};
use pe_ir::model::Solver;

/// Steps of each run.
const STEPS: u64 = 40;

/// Largest difference to the function in units of its scale: what a polynomial of second degree misses over a
/// sixteenth of the range, third derivative 1.35, with room for words of 32 bits.
const APPROXIMATION: f64 = 6e-5;

#[test]
fn looked_up_polynomials_are_the_functions_they_were_made_of() {
    let mut compared = 0;
    let mut segments = BTreeSet::new();
    for (seed, solver) in (81..).zip(Solver::RUNGE_KUTTA) {
        let flow = Flow::tabled((10, 3), solver, format(32, 32, 32), Placement::Scattered, seed);
        let functions = &flow.graph.functions;
        let scale = functions.tables[0].columns[0].iter().fold(0.0f64, |most, entry| most.max(entry.abs()));
        let scale = scale.log2().ceil().exp2();
        // The value that adds the first column of each lookup is the result.
        let results: Vec<(ValueId, ValueId, bool)> = (0u32..)
            .zip(&functions.lookups)
            .map(|(number, lookup)| {
                let is_result = |base: Option<ValueId>| {
                    base.is_some_and(|base| flow.graph.value(base).role == Role::Column(number, 0))
                };
                let chain = flow.graph.chains.iter().find(|chain| is_result(chain.write.base)).expect("a result");
                (lookup.argument, chain.write.value, functions.tables[lookup.table as usize].octaves)
            })
            .collect();
        let (mut equal, mut octaves) = (0, 0);
        for steps in 1..=STEPS {
            let run = flow.fixed_run(steps);
            let number = |value: ValueId| {
                let (exponent, offset) = (flow.fixed.exponents[value.index()], flow.fixed.format.data_offset());
                flow.fixed.format.decode(run.word(value), exponent, offset)
            };
            for (argument, result, in_octaves) in &results {
                let z = number(*argument);
                let expected = exact(if *in_octaves { 2.0 * z - 1.0 } else { z }, scale);
                // Negative arguments of octaves are beyond the table.
                if *in_octaves && z < 0.0 {
                    continue;
                }
                let error = (number(*result) - expected).abs() / scale;
                assert!(error < APPROXIMATION, "{}: {error:e} at {z}", flow.label);
                segments.insert((*in_octaves, functions.segments.index_of(z, *in_octaves)));
                *(if *in_octaves { &mut octaves } else { &mut equal }) += 1;
            }
        }
        assert!(equal > 40 && octaves > 40, "{}: {equal}, {octaves}", flow.label);
        compared += equal + octaves;
    }
    assert!(segments.len() > 12, "{segments:?}");
    println!("{compared} results of lookups compared with the function");
}
