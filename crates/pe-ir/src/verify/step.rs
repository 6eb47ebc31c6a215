//! Checks a step graph.
//!
//! Invariants:
//!
//! 1. Numbers of equations, values, functions and lookups exist, and names are there for what has one.
//! 2. Every chain has a term; terms of chains follow one another and are all of a chain's.
//! 3. Every value is written at most once, inputs, constants and columns never.
//! 4. A chain reads states, inputs, constants, and what chains before it write. Columns are bases only.
//! 5. What the coefficient port reads is read by nothing else, and in its own equation.
//! 6. What a state is at the end of the step, and what is published, is computed, or is a state, an input or a constant.
//! 7. Tables have as many entries in all columns as the step has segments.
//! 8. Every equation has a chain or a value.
//! 9. A state that takes what another one was leads to one that is computed. Neither is read as a base or a factor, and the end
//!    value of that one is read by nothing.

use crate::graph::{Chain, Factor, Pivot, Role, StepGraph, Term, ValueId};
use crate::index::{self, List, StateId, at};
use crate::model::Expr;

/// Returns what is wrong with a step graph; empty if nothing is.
pub fn check(graph: &StepGraph) -> Vec<String> {
    let mut checker = Checker { graph, violations: Vec::new() };
    checker.numbers();
    // What follows looks things up by these numbers.
    if checker.violations.is_empty() {
        checker.chains();
        checker.rings();
        checker.functions();
    }
    checker.violations
}

struct Checker<'a> {
    graph: &'a StepGraph,
    violations: Vec<String>,
}

impl Checker<'_> {
    fn require(&mut self, holds: bool, violation: impl FnOnce() -> String) {
        if !holds {
            self.violations.push(violation());
        }
    }

    fn numbers(&mut self) {
        let graph = self.graph;
        let names = &graph.names;
        let lists = [
            (graph.states.len() == names.states.len() && graph.states.len() == graph.initial.len(), "states"),
            (graph.inputs.len() == names.inputs.len(), "inputs"),
            (graph.outputs.len() == names.outputs.len(), "outputs"),
        ];
        for (fits, what) in lists {
            self.require(fits, || format!("it has not as many {what} as names of them"));
        }
        self.require(graph.step.is_finite() && graph.step > 0.0, || "its step is not positive".to_owned());
        self.require((1..=255).contains(&graph.stages), || format!("it has {} stages", graph.stages));
        self.require(!graph.chains.is_empty() && !graph.states.is_empty(), || "it computes no state".to_owned());
        self.require(graph.initial.iter().all(|number| number.is_finite()), || "a state has no start".to_owned());
        let pivot = graph
            .constant_pivot
            .is_none_or(|(state, magnitude)| graph.states.find(state).is_some() && magnitude.is_finite());
        self.require(pivot, || "its constant pivot is none".to_owned());
        let known = |pivot: &Pivot| match *pivot {
            Pivot::Number(number) => number.is_finite(),
            Pivot::Varying { reciprocal, .. } => at(reciprocal) < names.algebraics.len(),
        };
        let pivots = graph.eliminations.iter().all(|each| each.pivots.iter().all(known));
        self.require(pivots, || "a pivot of an elimination does not exist".to_owned());
        let value = |id: ValueId| id.index() < graph.values.len();
        let ends = graph.states.iter().flat_map(|(start, end)| [*start, *end]);
        let ports = graph.inputs.iter().chain(&graph.outputs).copied();
        let arguments = graph.functions.lookups.iter().map(|lookup| lookup.argument);
        self.require(ends.chain(ports).chain(arguments).all(value), || {
            "it names a value that does not exist".to_owned()
        });
        for (index, stored) in graph.values.iter().enumerate() {
            let known = self.role_exists(stored.role, index);
            self.require(known, || format!("value {index} is of something that does not exist"));
            let fits = match stored.equation {
                Some(equation) => graph.equations.find(equation).is_some(),
                None => matches!(stored.role, Role::Input(_)),
            };
            self.require(fits, || format!("value {index} is in no equation"));
        }
        let mut next = 0;
        for (index, chain) in graph.chains.numbered() {
            let terms = chain.terms.clone();
            self.require(terms.start == next && terms.end > next, || format!("chain {index} has no terms of its own"));
            next = terms.end;
            self.require(graph.equations.find(chain.equation).is_some(), || format!("chain {index} is in no equation"));
            let written = chain.writes().flat_map(|write| std::iter::once(write.value).chain(write.base)).all(value);
            self.require(written, || format!("chain {index} writes what does not exist"));
            let light = chain.writes().all(|write| write.weight.unsigned_abs() <= 2_000);
            self.require(light, || format!("chain {index} has a weight beyond all numbers"));
        }
        self.require(at(next) == graph.terms.len(), || "terms are in no chain".to_owned());
        for term in &graph.terms {
            let factor = match term.factor {
                Factor::Coefficient(coefficient) => coefficient.is_finite(),
                Factor::Value(factor) => value(factor),
            };
            self.require(factor && term.operands().all(value), || "a term reads what does not exist".to_owned());
        }
    }

    fn role_exists(&self, role: Role, index: usize) -> bool {
        let graph = self.graph;
        let state = |of: StateId| graph.states.find(of).is_some();
        match role {
            Role::State(of) | Role::Stage(of, _) | Role::Sum(of, _) | Role::Interim(of, _) | Role::Next(of) => {
                state(of)
            }
            Role::Pivot(of, _) => state(of),
            Role::Algebraic(of, _) => at(of) < graph.names.algebraics.len(),
            Role::Inner(of, _) | Role::Partial(of, _) => graph.equations.find(of).is_some(),
            Role::Relayed(of, _) => of.index() < index,
            Role::Input(of) => at(of) < graph.inputs.len(),
            Role::Constant(number) => number.is_finite(),
            Role::Published(of) => at(of) < graph.outputs.len(),
            Role::Auxiliary(of) => at(of) < graph.names.auxiliaries.len(),
            Role::Column(lookup, column) => graph.functions.lookups.get(at(lookup)).is_some_and(|lookup| {
                let table = graph.functions.tables.get(at(lookup.table));
                table.is_some_and(|table| usize::from(column) < table.columns.len())
            }),
        }
    }

    fn chains(&mut self) {
        let graph = self.graph;
        let name = |chain: &Chain| graph.value_name(chain.write.value);
        let mut written = vec![false; graph.values.len()];
        let mut is_start = vec![false; graph.values.len()];
        graph.states.iter().for_each(|(start, _)| is_start[start.index()] = true);
        let given = |id: ValueId| matches!(graph.value(id).role, Role::Input(_) | Role::Constant(_));
        for chain in &graph.chains {
            let readable = |id: ValueId| written[id.index()] || is_start[id.index()] || given(id);
            for term in graph.chain_terms(chain) {
                let operands = term.operands().all(|id| readable(id) && !graph.value(id).factor);
                let factor = match term.factor {
                    Factor::Coefficient(_) => true,
                    Factor::Value(id) => {
                        let value = graph.value(id);
                        readable(id) && value.factor && value.equation == Some(chain.equation) && term.partner.is_none()
                    }
                };
                self.require(operands && factor, || format!("the chain of `{}` reads what it cannot", name(chain)));
            }
            let mut ahead: Vec<ValueId> = Vec::new();
            for write in chain.writes() {
                let is_column = |id: ValueId| matches!(graph.value(id).role, Role::Column(..));
                let base = write.base.is_none_or(|id| readable(id) || is_column(id) || ahead.contains(&id));
                self.require(base, || format!("the chain of `{}` adds to what does not exist", name(chain)));
                let id = write.value;
                let is_new = !written[id.index()] && !ahead.contains(&id) && !given(id) && !is_column(id);
                self.require(is_new, || format!("`{}` is written twice, or cannot be written", graph.value_name(id)));
                ahead.push(id);
            }
            ahead.into_iter().for_each(|id| written[id.index()] = true);
        }
        let ends = graph.states.iter().map(|(_, end)| *end);
        for id in ends.chain(graph.outputs.iter().copied()) {
            let known = written[id.index()] || is_start[id.index()] || given(id);
            self.require(known, || format!("nothing writes `{}`", graph.value_name(id)));
        }
        for (input, value) in graph.inputs.iter().enumerate() {
            let fits = graph.value(*value).role == Role::Input(index::number(input));
            self.require(fits, || format!("input {input} is no value of an input"));
        }
    }

    fn rings(&mut self) {
        let graph = self.graph;
        let followed = |end: ValueId| match graph.value(end).role {
            Role::State(of) => Some(of),
            _ => None,
        };
        let mut in_ring = vec![false; graph.values.len()];
        let mut sound = List::filled(false, graph.states.len());
        for (state, (start, end)) in graph.states.numbered() {
            let mut way = vec![state];
            while let Some(before) = followed(graph.states[way[way.len() - 1]].1).filter(|before| !sound[*before]) {
                if way.len() > graph.states.len() {
                    self.require(false, || format!("`{}` follows itself", graph.value_name(*start)));
                    return;
                }
                way.push(before);
            }
            way.into_iter().for_each(|state| sound[state] = true);
            let Some(before) = followed(*end) else { continue };
            let (before, ring) = graph.states[before];
            (in_ring[start.index()], in_ring[before.index()]) = (true, true);
            if followed(ring).is_none() {
                in_ring[ring.index()] = true;
                self.require(matches!(graph.value(ring).role, Role::Next(_)), || {
                    format!("the ring of `{}` takes what no chain writes", graph.value_name(*start))
                });
            }
        }
        let operands = graph.terms.iter().flat_map(Term::operands);
        let ends = operands.filter(|id| matches!(graph.value(*id).role, Role::Next(_)));
        let bases = graph.chains.iter().flat_map(Chain::writes).filter_map(|write| write.base);
        let read = ends.chain(bases).chain(graph.outputs.iter().copied());
        let read = read.chain(graph.functions.lookups.iter().map(|lookup| lookup.argument));
        for id in read.filter(|id| in_ring[id.index()]) {
            self.require(false, || format!("`{}` is in a ring and read as something else", graph.value_name(id)));
        }
        for (id, value) in (0..).map(ValueId::new).zip(&graph.values).filter(|(id, _)| in_ring[id.index()]) {
            self.require(!value.factor, || format!("`{}` is in a ring and a factor", graph.value_name(id)));
        }
    }

    fn functions(&mut self) {
        let functions = &self.graph.functions;
        let segments = functions.segments;
        let fits = segments.index_bits < 16 && segments.octave_bits <= segments.index_bits && segments.octave_bits < 6;
        self.require(fits, || "segments have more than 15 bits".to_owned());
        for table in &functions.tables {
            let full = fits && table.columns.iter().all(|column| column.len() == segments.count());
            self.require(full && !table.columns.is_empty(), || {
                format!("table `{}` has not as many entries in each column as there are segments", table.name)
            });
            let scaled = table.stands_for.iter().all(|of| of.slope != 0.0 && of.factor != 0.0);
            self.require(scaled, || format!("table `{}` stands for a function without slope or factor", table.name));
        }
        for lookup in &functions.lookups {
            let table = functions.tables.get(at(lookup.table));
            let known = table.is_some_and(|table| match lookup.function {
                Some(function) => at(function) < table.stands_for.len(),
                None => table.stands_for.is_empty(),
            });
            self.require(known, || format!("a lookup reads table {}, but none of its functions", lookup.table));
        }
        for function in &functions.exact {
            let mut other = false;
            function.body.each_variable(&mut |variable| other |= variable != function.variable);
            self.require(!other && function.body != Expr::Sum(Vec::new()), || {
                format!("function `{}` reads another variable", function.name)
            });
        }
        for chain in &self.graph.chains {
            let known = chain.function.is_none_or(|function| at(function) < functions.exact.len());
            self.require(known, || "a chain applies a function that does not exist".to_owned());
        }
    }
}
