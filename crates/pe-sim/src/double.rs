//! The step graph in double precision.

use pe_ir::graph::{Factor, FixedPoint, Role, StepGraph, ValueId};

use crate::code::{Code, WriteCode};

/// A value stopped being a finite number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Diverged {
    /// The first value that did.
    pub value: ValueId,
}

/// A run in double precision.
pub struct DoubleRun<'a> {
    graph: &'a StepGraph,
    code: Code,
    coefficients: Vec<f64>,
    /// Current numbers, one slot per value and a zero.
    values: Vec<f64>,
    largest: Vec<f64>,
}

impl<'a> DoubleRun<'a> {
    /// Starts a run from the initial values.
    pub fn new(graph: &'a StepGraph) -> Self {
        let exact = |term: usize| match graph.terms[term].factor {
            Factor::Coefficient(c) => c,
            Factor::Value(_) => 0.0,
        };
        Self::with_coefficients(graph, exact)
    }

    /// Starts a run with the coefficients as the hardware has them, rounded to their port.
    pub fn quantised(graph: &'a StepGraph, fixed: &FixedPoint) -> Self {
        let mut coefficients = vec![0.0; graph.terms.len()];
        for (index, chain) in graph.chains.iter().enumerate() {
            for term in chain.terms.clone() {
                coefficients[term as usize] = fixed.coefficient_value(graph, index, term as usize);
            }
        }
        Self::with_coefficients(graph, |term| coefficients[term])
    }

    fn with_coefficients(graph: &'a StepGraph, coefficient: impl Fn(usize) -> f64) -> Self {
        let code = Code::new(graph);
        let coefficients = code.terms.iter().map(|term| coefficient(*term as usize)).collect();
        let mut values = vec![0.0; graph.values.len() + 1];
        for (slot, value) in values.iter_mut().zip(&graph.values) {
            if let Role::Constant(number) = value.role {
                *slot = number;
            }
        }
        let mut run = DoubleRun { graph, code, coefficients, largest: vec![0.0; values.len()], values };
        for (index, initial) in graph.initial.iter().enumerate() {
            run.set_state(index, *initial);
        }
        run
    }

    /// Sets a state.
    pub fn set_state(&mut self, index: usize, number: f64) {
        let slot = self.graph.states[index].0.index();
        self.values[slot] = number;
        self.largest[slot] = self.largest[slot].max(number.abs());
    }

    /// A state at the start of the next step.
    pub fn state(&self, index: usize) -> f64 {
        self.values[self.graph.states[index].0.index()]
    }

    /// A value by its index: of the latest step, but for states, which are those of the next.
    pub fn value(&self, index: usize) -> f64 {
        self.values[index]
    }

    /// A published output after a step.
    pub fn output(&self, index: usize) -> f64 {
        self.values[self.graph.outputs[index].index()]
    }

    /// Largest magnitude of each value so far.
    pub fn largest(&self) -> &[f64] {
        &self.largest[..self.graph.values.len()]
    }

    /// Advances by one step with the inputs held.
    ///
    /// # Errors
    /// [`Diverged`] if a value is no longer finite.
    pub fn step(&mut self, inputs: &[f64]) -> Result<(), Diverged> {
        for (value, number) in self.graph.inputs.iter().zip(inputs) {
            self.values[value.index()] = *number;
        }
        for chain in &self.code.chains {
            let mut sum = 0.0;
            let products = chain.coefficients.start as usize..chain.coefficients.end as usize;
            for (operand, coefficient) in self.code.operands[products.clone()].iter().zip(&self.coefficients[products])
            {
                sum += self.values[*operand as usize] * coefficient;
            }
            for index in chain.factors.start as usize..chain.factors.end as usize {
                let factor = self.values[self.code.factors[index] as usize];
                sum += self.values[self.code.operands[index] as usize] * factor;
            }
            write(&mut self.values, &chain.write, sum);
            if let Some(second) = &chain.second {
                write(&mut self.values, second, sum);
            }
        }
        if !self.note_largest() {
            let finite = |write: &pe_ir::graph::Write| self.values[write.value.index()].is_finite();
            let mut writes = self.graph.chains.iter().flat_map(|chain| chain.writes());
            let first = writes.find(|write| !finite(write)).expect("a value is not finite");
            return Err(Diverged { value: first.value });
        }
        for (state, next) in &self.graph.states {
            self.values[state.index()] = self.values[next.index()];
        }
        Ok(())
    }

    /// Updates the largest magnitudes; false if some value is not finite. One pass over all values after the step is
    /// several times faster than a check at every write.
    fn note_largest(&mut self) -> bool {
        let mut finite = true;
        for (largest, value) in self.largest.iter_mut().zip(&self.values) {
            let magnitude = value.abs();
            finite &= magnitude < f64::INFINITY;
            *largest = if magnitude > *largest { magnitude } else { *largest };
        }
        finite
    }
}

fn write(values: &mut [f64], write: &WriteCode, sum: f64) {
    let weight = f64::from_bits(((1023 + i64::from(write.weight)) as u64) << 52);
    values[write.value as usize] = values[write.base as usize] + weight * sum;
}
