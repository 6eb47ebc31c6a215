//! How signals are played, written down as chains: the [`Score`] of explicit Runge-Kutta methods.

use pe_ir::graph::{Factor, Role, Term, ValueId, Write};
use pe_ir::index::{StateId, at, number};
use pe_ir::model::{Expr, Variable};

use super::builder::{Builder, of_state, push};
use super::played::Score;

impl Score for Builder {
    type Value = ValueId;

    fn memory(&mut self, owner: StateId, name: String, initial: f64) -> ValueId {
        let graph = &mut self.graph;
        let index = StateId::at(graph.states.len());
        let start = push(graph, Role::State(index), of_state(owner), false);
        let next = push(graph, Role::Next(index), of_state(owner), false);
        graph.states.push((start, next));
        graph.initial.push(initial);
        graph.names.states.push(name);
        start
    }

    fn keep(&mut self, owner: StateId, memory: ValueId, terms: &[(f64, ValueId)], constant: f64) {
        let next = self.graph.states.iter().find(|(start, _)| *start == memory).expect("a memory").1;
        self.scored(owner, terms, constant, next, Some(memory));
    }

    fn sum(&mut self, owner: StateId, name: String, terms: &[(f64, ValueId)], constant: f64) -> ValueId {
        self.graph.names.auxiliaries.push(name);
        let role = Role::Auxiliary(number(self.graph.names.auxiliaries.len()) - 1);
        let value = push(&mut self.graph, role, of_state(owner), false);
        self.scored(owner, terms, constant, value, None);
        value
    }

    fn function(&mut self, owner: StateId, name: String, argument: ValueId, body: Expr) -> ValueId {
        let value = Score::sum(self, owner, name, &[(1.0, argument)], 0.0);
        let function = Builder::function(self, &body);
        self.graph.chains.last_mut().expect("the chain of the sum").function = Some(function);
        value
    }

    fn end(&mut self, state: StateId, terms: &[(f64, ValueId)], constant: f64) {
        let next = self.graph.states[state].1;
        self.scored(state, terms, constant, next, None);
    }

    fn start(&mut self, variable: Variable) -> ValueId {
        match variable {
            Variable::Input(input) => self.graph.inputs[at(input)],
            Variable::State(state) => self.graph.states[state].0,
            Variable::Algebraic(_) => unreachable!("scores begin with states and inputs"),
        }
    }
}

impl Builder {
    /// The chain `value := base + terms + constant`.
    fn scored(
        &mut self,
        owner: StateId,
        terms: &[(f64, ValueId)],
        constant: f64,
        value: ValueId,
        mut base: Option<ValueId>,
    ) {
        let equation = of_state(owner);
        let factor = |(factor, operand): &(f64, ValueId)| Term::new(*operand, Factor::Coefficient(*factor));
        let mut terms: Vec<Term> = terms.iter().map(factor).collect();
        if constant != 0.0 && base.is_none() && !terms.is_empty() {
            base = Some(self.constant(constant, equation, value));
        } else if constant != 0.0 {
            let one = push(&mut self.graph, Role::Constant(1.0), equation, false);
            terms.push(Term::new(one, Factor::Coefficient(constant)));
        }
        self.chain(equation, terms, Write { value, base, weight: 0 }, None);
    }
}
