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
            self.largest[value.index()] = self.largest[value.index()].max(number.abs());
        }
        let mut diverged = false;
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
            diverged |= write(&mut self.values, &mut self.largest, &chain.write, sum);
            if let Some(second) = &chain.second {
                diverged |= write(&mut self.values, &mut self.largest, second, sum);
            }
        }
        if diverged {
            let value =
                |write: &pe_ir::graph::Write| (!self.values[write.value.index()].is_finite()).then_some(write.value);
            let first = self.graph.chains.iter().flat_map(|chain| chain.writes()).find_map(value);
            return Err(Diverged { value: first.unwrap_or(ValueId(0)) });
        }
        for (state, next) in &self.graph.states {
            self.values[state.index()] = self.values[next.index()];
        }
        Ok(())
    }
}

/// Writes and tells whether the number is not finite.
fn write(values: &mut [f64], largest: &mut [f64], write: &WriteCode, sum: f64) -> bool {
    let weight = f64::from_bits(((1023 + i64::from(write.weight)) as u64) << 52);
    let number = values[write.base as usize] + weight * sum;
    values[write.value as usize] = number;
    let slot = &mut largest[write.value as usize];
    *slot = slot.max(number.abs());
    !number.is_finite()
}
