//! Solver stages as chains.

use std::collections::HashMap;

use pe_ir::functions::{Functions, ScalarFunction};
use pe_ir::graph::{Chain, Equation, Factor, FormCost, Names, Role, StageForm, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, EquationId, List, StateId, at};
use pe_ir::model::{Expr, Model, Output, Solver, Variable};

use super::polynomial::{Nested, NestedFactor};
use super::rows::Rows;
use super::sharing::Expanded;

/// One stage of a solver: where its chains read, how they are scaled, and what they write.
pub(super) struct Stage {
    /// Number of the stage, from 1.
    pub number: u8,
    /// Factor of the right-hand side.
    factor: f64,
    /// Whether this is the last stage, which writes the next state.
    pub last: bool,
    /// Weight of the increment in the running sum (binary logarithm); `None` if the form keeps no sum.
    sum_weight: Option<i32>,
    /// Factor of the running sum in the chain of the last stage.
    sum_factor: Option<f64>,
    /// Weight of the increment in what the next stage reads (binary logarithm).
    weight: i32,
    /// The same of a first part of it, which is added before.
    interim: Option<i32>,
}

impl Stage {
    /// A stage that adds one increment to the state.
    fn new(number: u8, factor: f64, last: bool) -> Stage {
        Stage { number, factor, last, sum_weight: None, sum_factor: None, weight: 0, interim: None }
    }
}

/// The stages of a solver in a form, for step `h`.
///
/// Horner: `y + h f(y + h/2 f(y + h/3 f(..)))`. For an affine `f` every Runge-Kutta method with as many stages as its
/// order is this polynomial in the Jacobian.
pub(super) fn stages(solver: Solver, form: StageForm, h: f64) -> Vec<Stage> {
    match form {
        StageForm::Increments => increments(solver, h),
        StageForm::Sums => sums(solver, h),
        _ => {
            let count = solver.stages() as u8;
            let factor = |number: u8| h / f64::from(count + 1 - number);
            (1..=count).map(|number| Stage::new(number, factor(number), number == count)).collect()
        }
    }
}

/// Explicit Runge-Kutta methods, rearranged so that only increments are multiplied.
///
/// - Heun: `d2 = h f(y)`, `y+ = y + d2/2 + h/2 f(y + d2)`.
/// - Heun's third order: `d2 = h/3 f(y)`, `d3 = 2h/3 f(y + d2)`, `y+ = y + 3/4 d2 + 3h/4 f(y + d3)`.
/// - Classic RK4: `d2 = h/2 f(y)`, `d3 = h/2 f(y + d2)`, `d4 = h f(y + d3)`,
///   `y+ = y + (d2 + 2 d3 + d4)/3 + h/6 f(y + d4)`.
fn increments(solver: Solver, h: f64) -> Vec<Stage> {
    let inner = |number, factor, sum_weight| Stage { sum_weight, ..Stage::new(number, factor, false) };
    let last = |number, factor, sum_factor| Stage { sum_factor, ..Stage::new(number, factor, true) };
    match solver {
        Solver::Euler => vec![last(1, h, None)],
        Solver::Heun => vec![inner(1, h, Some(0)), last(2, h / 2.0, Some(0.5))],
        Solver::Heun3 => {
            vec![inner(1, h / 3.0, Some(0)), inner(2, 2.0 * h / 3.0, None), last(3, 0.75 * h, Some(0.75))]
        }
        Solver::Rk4 => vec![
            inner(1, h / 2.0, Some(0)),
            inner(2, h / 2.0, Some(1)),
            inner(3, h, Some(0)),
            last(4, h / 6.0, Some(1.0 / 3.0)),
        ],
        _ => unreachable!("the step of {} is planned", solver.name()),
    }
}

/// Explicit Runge-Kutta methods whose stages differ in powers of two only, once three times an increment is added in two
/// parts. `s` is the running sum, which the state is in.
///
/// - Heun: `k = h/2 f(y)`, `s = y + k`; `k = h/2 f(y + 2 k)`, `y+ = s + k`.
/// - Classic RK4, `k = h/6 f(..)` in each stage: `s = y + k` and `y + k + 2 k`; `s + 2 k` and `y + k + 2 k`; `s + 2 k` and
///   `y + 2 k + 4 k`; `y+ = s + k/2 + k/2`.
fn sums(solver: Solver, h: f64) -> Vec<Stage> {
    let stage = |number, factor, sum_weight: Option<i32>, interim, weight| Stage {
        sum_weight,
        weight,
        interim,
        ..Stage::new(number, factor, sum_weight.is_none())
    };
    match solver {
        Solver::Heun => vec![stage(1, h / 2.0, Some(0), None, 1), stage(2, h / 2.0, None, None, 0)],
        Solver::Rk4 => vec![
            stage(1, h / 6.0, Some(0), Some(0), 1),
            stage(2, h / 6.0, Some(1), Some(0), 1),
            stage(3, h / 6.0, Some(1), Some(1), 2),
            stage(4, h / 6.0, None, Some(-1), -1),
        ],
        _ => unreachable!("{} has no stages that are alike", solver.name()),
    }
}

/// Marks algebraic variables.
pub(super) fn mark(variables: impl Iterator<Item = Variable>, used: &mut [bool]) {
    for variable in variables {
        if let Variable::Algebraic(a) = variable {
            used[at(a)] = true;
        }
    }
}

/// Adds what the marked equations read. Algebraic equations read only earlier ones, so one backward pass suffices.
pub(super) fn close(expanded: &Expanded, used: &mut [bool]) {
    for index in (0..used.len()).rev() {
        if used[index] {
            mark(expanded.algebraics[index].variables(), used);
        }
    }
}

/// The values that stand for variables in a stage.
pub(super) struct Operands<'a> {
    pub states: &'a [ValueId],
    pub algebraics: HashMap<u32, ValueId>,
}

pub(super) struct Builder {
    pub graph: StepGraph,
    /// Equation of each algebraic variable that has one.
    algebraic_equations: HashMap<usize, EquationId>,
    /// Number of inner sums of each equation so far.
    inner_serials: HashMap<EquationId, u32>,
    /// Latest running sum of each state's increments.
    sums: Vec<Option<ValueId>>,
    /// Numbers of the functions so far.
    functions: HashMap<String, u32>,
}

impl Builder {
    pub(super) fn new(model: &Model, cost: FormCost) -> Builder {
        let mut graph = StepGraph {
            form: cost.form,
            stages: cost.stages,
            forms: Vec::new(),
            pre_adder: false,
            step: model.step,
            equations: List::new(),
            values: Vec::new(),
            chains: List::new(),
            terms: Vec::new(),
            states: List::new(),
            initial: model.states.iter().map(|state| state.initial).collect(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            functions: Functions::default(),
            constant_pivot: None,
            eliminations: Vec::new(),
            names: Names::of(model),
            parts: Default::default(),
        };
        for (index, state) in model.states.iter().enumerate() {
            let number = StateId::at(index);
            let equation = graph.equations.push(Equation { name: state.name.clone(), span: state.span, place: None });
            let start = push(&mut graph, Role::State(number), equation, false);
            let next = push(&mut graph, Role::Next(number), equation, false);
            graph.states.push((start, next));
        }
        for index in 0..model.inputs.len() {
            let value = push(&mut graph, Role::Input(index::number(index)), None, false);
            graph.inputs.push(value);
        }
        for (index, algebraic) in model.algebraics.iter().enumerate() {
            // Unused ones go again when the graph is pruned.
            graph.equations.push(Equation { name: algebraic.name.clone(), span: algebraic.span, place: None });
            debug_assert_eq!(graph.equations.len(), model.states.len() + index + 1);
        }
        let states = model.states.len();
        let algebraic_equations = (0..model.algebraics.len()).map(|a| (a, EquationId::at(states + a))).collect();
        Builder {
            graph,
            algebraic_equations,
            inner_serials: HashMap::new(),
            sums: vec![None; states],
            functions: HashMap::new(),
        }
    }

    /// Chain of an algebraic equation in one stage.
    pub(super) fn algebraic(
        &mut self,
        index: usize,
        stage: u8,
        (nested, function): (&Nested, &Option<Expr>),
        operands: &mut Operands,
    ) {
        let equation = self.algebraic_equations[&index];
        let value = push(&mut self.graph, Role::Algebraic(index::number(index), stage), equation, false);
        self.sum(equation, nested, value, operands);
        let function = function.as_ref().map(|function| self.function(function));
        self.graph.chains.last_mut().expect("the chain of the equation").function = function;
        operands.algebraics.insert(index::number(index), value);
    }

    /// The number of a function among those of the graph; equal ones of different variables are one.
    pub(super) fn function(&mut self, function: &Expr) -> u32 {
        let variable = Variable::State(StateId::new(0));
        let body = function.substituted(&|_| Expr::Variable(variable));
        let next = index::number(self.graph.functions.exact.len());
        let number = *self.functions.entry(format!("{body:?}")).or_insert(next);
        if number == next {
            let name = body.text(&|_, _| "x".to_owned());
            self.graph.functions.exact.push(ScalarFunction { name, body, variable });
        }
        number
    }

    /// Chain of a derivative equation in one stage; returns the value that the next stage reads.
    pub(super) fn derivative(&mut self, index: usize, stage: &Stage, nested: &Nested, operands: &Operands) -> ValueId {
        let (state, equation) = (StateId::at(index), of_state(StateId::at(index)));
        let (start, next) = self.graph.states[state];
        let mut terms = self.terms(equation, nested, stage.factor, operands);
        if nested.constant != 0.0 {
            let one = push(&mut self.graph, Role::Constant(1.0), equation, false);
            terms.push(Term::new(one, Factor::Coefficient(nested.constant * stage.factor)));
        }
        let previous_sum = self.sums[index];
        if let (Some(factor), Some(sum)) = (stage.sum_factor, previous_sum) {
            terms.push(Term::new(sum, Factor::Coefficient(factor)));
        }
        if terms.is_empty() {
            terms.push(Term::new(start, Factor::Coefficient(0.0)));
        }
        let value = if stage.last {
            next
        } else {
            push(&mut self.graph, Role::Stage(state, stage.number + 1), equation, false)
        };
        // The state is in the running sum, or beside it.
        let within = self.graph.form == StageForm::Sums;
        let mut base = if within && stage.last { previous_sum } else { Some(start) };
        let second = stage.sum_weight.map(|weight| {
            let sum = push(&mut self.graph, Role::Sum(state, stage.number + 1), equation, false);
            self.sums[index] = Some(sum);
            Write { value: sum, base: previous_sum.or(within.then_some(start)), weight }
        });
        let interim = stage.interim.map(|weight| {
            let value = push(&mut self.graph, Role::Interim(state, stage.number + 1), equation, false);
            Write { value, base: base.replace(value), weight }
        });
        self.chain(equation, terms, Write { value, base, weight: stage.weight }, second);
        self.graph.chains.last_mut().expect("the chain of the equation").interim = interim;
        value
    }

    /// Chain of a state in a stage that multiplies the `current` states by a matrix and adds the product to them;
    /// returns the value that the next stage reads.
    pub(super) fn row(
        &mut self,
        index: usize,
        (number, last): (u8, bool),
        rows: &Rows,
        current: &[ValueId],
    ) -> ValueId {
        let (state, equation) = (StateId::at(index), of_state(StateId::at(index)));
        let mut terms = Vec::with_capacity(rows.row(index).len().max(1));
        for (column, coefficient) in rows.row(index) {
            let column = at(column);
            let operand = match (current.get(column), column.checked_sub(current.len())) {
                (Some(state), _) => *state,
                (None, Some(input)) if input < self.graph.inputs.len() => self.graph.inputs[input],
                _ => push(&mut self.graph, Role::Constant(1.0), equation, false),
            };
            terms.push(Term::new(operand, Factor::Coefficient(coefficient)));
        }
        if terms.is_empty() {
            terms.push(Term::new(current[index], Factor::Coefficient(0.0)));
        }
        let value = if last {
            self.graph.states[state].1
        } else {
            push(&mut self.graph, Role::Stage(state, number + 1), equation, false)
        };
        self.chain(equation, terms, Write { value, base: Some(current[index]), weight: 0 }, None);
        value
    }

    /// Values to publish at the end of the step, computed from the next states where they are not states.
    pub(super) fn outputs(&mut self, model: &Model, expanded: &Expanded, algebraics: &[Nested], states: &[ValueId]) {
        let mut wanted = vec![false; algebraics.len()];
        mark(model.outputs.iter().map(|output| output.variable), &mut wanted);
        let mut used = wanted.clone();
        close(expanded, &mut used);
        let published = u8::MAX;
        let mut operands = Operands { states, algebraics: HashMap::new() };
        for (index, nested) in algebraics.iter().enumerate() {
            if used[index] && (wanted[index] || expanded.shared[index]) {
                self.algebraic(index, published, (nested, &expanded.functions[index]), &mut operands);
            }
        }
        for (index, output) in model.outputs.iter().enumerate() {
            let value = match output.variable {
                Variable::State(s) => states[s.index()],
                Variable::Algebraic(a) => operands.algebraics[&a],
                Variable::Input(i) => self.published_input(index, output, i),
            };
            self.graph.outputs.push(value);
        }
    }

    /// The value to publish of an output that is an input.
    pub(super) fn published_input(&mut self, index: usize, output: &Output, input: u32) -> ValueId {
        let equation =
            self.graph.equations.push(Equation { name: output.name.clone(), span: output.span, place: None });
        let value = push(&mut self.graph, Role::Published(index::number(index)), equation, false);
        let operand = self.graph.inputs[at(input)];
        let terms = vec![Term::new(operand, Factor::Coefficient(1.0))];
        self.chain(equation, terms, Write { value, base: None, weight: 0 }, None);
        value
    }

    /// Chain `value := constant + products`.
    fn sum(&mut self, equation: EquationId, nested: &Nested, value: ValueId, operands: &Operands) {
        let mut terms = self.terms(equation, nested, 1.0, operands);
        let mut base = None;
        if terms.is_empty() {
            let one = push(&mut self.graph, Role::Constant(1.0), equation, false);
            terms.push(Term::new(one, Factor::Coefficient(nested.constant)));
        } else if nested.constant != 0.0 {
            base = Some(self.constant(nested.constant, equation, value));
        }
        self.chain(equation, terms, Write { value, base, weight: 0 }, None);
    }

    /// A base constant; it takes the role of port of the value it is the base of.
    pub(super) fn constant(&mut self, number: f64, equation: EquationId, destination: ValueId) -> ValueId {
        let factor = self.graph.value(destination).factor;
        push(&mut self.graph, Role::Constant(number), equation, factor)
    }

    /// The products of a nested sum, times `scale`; inner sums get chains of their own.
    pub(super) fn terms(
        &mut self,
        equation: EquationId,
        nested: &Nested,
        scale: f64,
        operands: &Operands,
    ) -> Vec<Term> {
        let mut terms = Vec::with_capacity(nested.products.len() + 2);
        for (variable, factor) in &nested.products {
            let operand = match variable {
                Variable::State(s) => operands.states[s.index()],
                Variable::Input(i) => self.graph.inputs[at(*i)],
                Variable::Algebraic(a) => operands.algebraics[a],
            };
            let factor = match factor {
                NestedFactor::Coefficient(c) => Factor::Coefficient(c * scale),
                NestedFactor::Inner(inner) => Factor::Value(self.inner(equation, inner, scale, operands)),
            };
            terms.push(Term::new(operand, factor));
        }
        terms
    }

    fn inner(&mut self, equation: EquationId, nested: &Nested, scale: f64, operands: &Operands) -> ValueId {
        let terms = self.terms(equation, nested, scale, operands);
        let serial = self.inner_serials.entry(equation).or_default();
        *serial += 1;
        let role = Role::Inner(equation, *serial);
        let value = push(&mut self.graph, role, equation, true);
        // A factor always has a base constant: it carries the rounding offset of the coefficient port.
        let base = Some(self.constant(nested.constant * scale, equation, value));
        self.chain(equation, terms, Write { value, base, weight: 0 }, None);
        value
    }

    pub(super) fn chain(&mut self, equation: EquationId, terms: Vec<Term>, write: Write, second: Option<Write>) {
        let start = index::number(self.graph.terms.len());
        self.graph.terms.extend(terms);
        let terms = start..self.graph.terms.len() as u32;
        self.graph.chains.push(Chain { equation, terms, interim: None, write, second, function: None });
    }
}

/// The equation of a state of the model: they come first, in the model's order.
pub(super) fn of_state(state: StateId) -> EquationId {
    EquationId::new(state.number())
}

pub(super) fn push(
    graph: &mut StepGraph,
    role: Role,
    equation: impl Into<Option<EquationId>>,
    factor: bool,
) -> ValueId {
    let equation = equation.into();
    graph.values.push(Value { role, equation, factor });
    ValueId::at(graph.values.len() - 1)
}
