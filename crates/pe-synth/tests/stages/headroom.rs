//! The table of variables beside their number formats.

use crate::support::models::{Compiled, compile};
use pe_flow::variables::{self, variables};
use pe_ir::graph::Role;
use pe_ir::index::StateId;
use pe_sim::double::DoubleRun;

#[test]
fn every_variable_is_measured_against_its_format() {
    let Compiled { loaded, design } = compile("lung", &["--pes", "3", "--span", "2s"]);
    let model = &loaded.model;
    let variables = variables(model, &design.graph, &design.judged);
    let names: Vec<&str> = variables.iter().map(|variable| variable.name.as_str()).collect();
    assert_eq!(names, ["F", "p", "V[1]", "V[2]", "P[1]", "P[2]", "Q[1]", "Q[2]", "p_vent"]);
    // The largest magnitude of a state, found by another run; the measured one has the stages in between as well.
    let mut run = DoubleRun::new(&design.graph);
    let mut largest = vec![0.0f64; model.states.len()];
    for step in 0..model.steps() {
        run.step(&model.sample_inputs(step as f64 * model.step)).expect("a stable model");
        largest.iter_mut().enumerate().for_each(|(state, most)| *most = most.max(run.state(StateId::at(state)).abs()));
    }
    for (index, variable) in variables.iter().take(model.states.len()).enumerate() {
        assert!(variable.largest >= largest[index] && variable.largest < 1.5 * largest[index], "{}", variable.name);
        let exponent = design.judged.fixed.exponents[design.graph.states[StateId::at(index)].0.index()];
        assert_eq!(variable.limit, (2f64.powi(39) - 1.0) * 2f64.powi(exponent), "{}", variable.name);
        assert!(matches!(design.graph.value(design.graph.states[StateId::at(index)].0).role, Role::State(_)));
        // The margin of the formats is 1.2.
        assert!(variable.headroom() > 0.26 && variable.word_length.is_some_and(|error| error < 1e-6));
    }
    let table = variables::table(&variables);
    assert_eq!(table.lines().count(), 1 + variables.len());
    let complete = variables::complete(&variables);
    assert!(complete.iter().zip(&names).all(|(row, name)| row["name"] == **name) && complete.len() == names.len());
    let (few, all) = (variables::ranges(&variables, false), variables::ranges(&variables, true));
    assert!(few.ends_with("  3 more with more headroom; `--all` shows them\n") && few.lines().count() == 8, "{few}");
    assert!(names.iter().all(|name| all.contains(name)) && all.lines().count() == 1 + names.len(), "{all}");
    let listed = variables::report(&variables);
    let bits: Vec<f64> = listed.iter().map(|row| row.bits).collect();
    assert!(bits.is_sorted() && bits.len() == variables.len().min(10));
    assert_eq!(listed[0].bits, variables.iter().map(variables::Variable::headroom).fold(f64::INFINITY, f64::min));
}
