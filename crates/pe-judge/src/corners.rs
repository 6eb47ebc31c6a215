//! Where a model with tunable parameters is judged beside its own values: at the ends of their ranges.

use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::{Model, State};
use pe_ir::source::Diagnostic;

/// Values of tunable parameters that a model is judged with.
#[derive(Clone, Debug, PartialEq)]
pub struct Corner {
    /// For messages: `k = 10`.
    pub name: String,
    values: Vec<(StateId, f64)>,
}

/// One end of a range.
type End = fn((f64, f64)) -> f64;

/// The ends of each parameter, of an array all elements together, while the others have their own values; and of all of
/// them. None that are the values of the spec.
pub fn corners(model: &Model) -> Vec<Corner> {
    let mut groups: Vec<(String, Vec<StateId>)> = Vec::new();
    let mut last = None;
    for (id, state) in model.states.numbered().filter(|(_, state)| state.tunable) {
        if last.replace(state.quantity) != Some(state.quantity) {
            groups.push((state.name.split('[').next().unwrap_or_default().to_owned(), Vec::new()));
        }
        groups.last_mut().expect("a group was begun").1.push(id);
    }
    let ends: [(End, &str); 2] = [(|range| range.0, "least"), (|range| range.1, "greatest")];
    let mut corners: Vec<Corner> = Vec::new();
    let mut add = |name: String, members: &[StateId], end: End| {
        let value = |id: &StateId| Some((*id, end(model.states[*id].range?)));
        let values: Vec<(StateId, f64)> = members.iter().filter_map(value).collect();
        let is_new = values.iter().any(|(id, value)| model.states[*id].initial != *value);
        if is_new && corners.iter().all(|corner| corner.values != values) {
            corners.push(Corner { name, values });
        }
    };
    for (name, members) in &groups {
        for (end, word) in ends {
            let name = match members[..] {
                [only] if model.states[only].name == *name => {
                    format!("{name} = {}", model.states[only].range.map_or(0.0, end))
                }
                _ => format!("{name} at its {word} values"),
            };
            add(name, members, end);
        }
    }
    if groups.len() > 1 {
        let all: Vec<StateId> = groups.iter().flat_map(|(_, members)| members.iter().copied()).collect();
        for (end, word) in ends {
            add(format!("all tunable parameters at their {word} values"), &all, end);
        }
    }
    corners
}

impl Corner {
    /// Findings that say where.
    pub fn named(&self, findings: Vec<Diagnostic>) -> Vec<Diagnostic> {
        let named = |finding: Diagnostic| Diagnostic {
            message: format!("{}; with {}, an end of a tunable parameter's range", finding.message, self.name),
            ..finding
        };
        findings.into_iter().map(named).collect()
    }

    /// The model with these values.
    pub fn model(&self, model: &Model) -> Model {
        let mut model = model.clone();
        for (id, value) in &self.values {
            let state = &mut model.states[*id];
            *state = State { initial: *value, ..state.clone() };
        }
        model
    }

    /// The step with them.
    pub fn graph(&self, graph: &StepGraph) -> StepGraph {
        let mut graph = graph.clone();
        self.values.iter().for_each(|(id, value)| graph.initial[*id] = *value);
        graph
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pe_ir::model::{Expr, Solver};

    fn parameter(name: &str, quantity: u32, initial: f64, range: (f64, f64)) -> State {
        State { quantity, initial, range: Some(range), tunable: true, ..State::new(name, Expr::Constant(0.0)) }
    }

    #[test]
    fn arrays_are_one_and_the_values_of_the_spec_are_no_corner() {
        let mut model = Model::new("m", Solver::Rk4, 1.0, 1.0);
        model.states.push(State::new("x", Expr::Constant(0.0)));
        model.states.push(parameter("k", 1, 1.0, (1.0, 10.0)));
        model.states.push(parameter("r[1]", 2, 3.0, (2.0, 4.0)));
        model.states.push(parameter("r[2]", 2, 3.0, (2.0, 5.0)));
        let corners = corners(&model);
        let names: Vec<&str> = corners.iter().map(|corner| corner.name.as_str()).collect();
        let all = ["all tunable parameters at their least values", "all tunable parameters at their greatest values"];
        assert_eq!(names, ["k = 10", "r at its least values", "r at its greatest values", all[0], all[1]]);
        let last = corners[4].model(&model);
        let values: Vec<f64> = last.states.iter().map(|state| state.initial).collect();
        assert_eq!(values, [0.0, 10.0, 4.0, 5.0]);
    }
}
