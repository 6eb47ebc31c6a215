//! The model's equations as a flat list of sums of products, evaluated in the order of the model.

use std::cell::RefCell;
use std::ops::Range;

use differential_equations::linalg::Matrix;
use differential_equations::ode::ODE;
use nalgebra::{DMatrix, DVector};
use pe_ir::index::{self, StateId};
use pe_ir::model::{Expr, Input, Model, Rate, Solution, Variable};
use pe_ir::motion::Motion;

use super::history::History;
use super::states::States;
use super::waiting::{Jumped, Waiting};
use crate::linear::Linearised;

/// A product of a number and variables: its factors are slots.
struct Term {
    coefficient: f64,
    factors: Range<u32>,
}

/// A sum of products, stored in a slot.
struct Sum {
    slot: u32,
    terms: Range<u32>,
    /// What is stored in its place, if it is no polynomial: an expression over the variables.
    exact: Option<Expr>,
}

/// All equations of a model, those of sampled states among them. Slots hold the states, the inputs, the algebraic quantities, then intermediate results.
pub(super) struct Equations<'a> {
    model: &'a Model,
    inputs: &'a [Input],
    states: u32,
    /// Number of states that are not sampled.
    continuous: usize,
    /// States that follow signals.
    played: Vec<StateId>,
    /// States that are what a quantity was, in the order of the history.
    delayed: Vec<StateId>,
    pub history: RefCell<History>,
    pub waiting: RefCell<Waiting>,
    sums: Vec<Sum>,
    terms: Vec<Term>,
    factors: Vec<u32>,
    /// Slot of each state's derivative, or next value.
    derivatives: Vec<u32>,
    /// Slot of what each state that jumps jumps by.
    jumps: Vec<(StateId, u32)>,
    slots: RefCell<Vec<f64>>,
}

impl<'a> Equations<'a> {
    pub fn new(model: &'a Model) -> Self {
        let (states, inputs) = (index::number(model.states.len()), index::number(model.inputs.len()));
        let mut builder = Builder {
            states,
            inputs,
            next: states + inputs + index::number(model.algebraics.len()),
            sums: Vec::new(),
            terms: Vec::new(),
            factors: Vec::new(),
        };
        for (index, algebraic) in model.algebraics.iter().enumerate() {
            let slot = builder.slot(Variable::Algebraic(index::number(index)));
            builder.store(slot, &algebraic.expr);
        }
        let derivatives = model.states.iter().map(|state| builder.fresh(&state.derivative)).collect();
        let jumping = model.states.numbered().filter_map(|(state, own)| Some((state, own.jump_of(model.step)?)));
        let jumps = jumping.map(|(state, jump)| (state, builder.fresh(&jump))).collect();
        let slots = RefCell::new(vec![0.0; index::at(builder.next)]);
        let Builder { sums, terms, factors, .. } = builder;
        let continuous = model.continuous_states();
        let inputs = &model.inputs;
        let follows = |state: &StateId| model.states[*state].motion.is_some_and(|motion| motion.source().is_some());
        let played = model.states.ids().filter(follows).collect();
        let (delayed, delays): (Vec<StateId>, Vec<f64>) = model.delays().unzip();
        let before = delayed.iter().map(|state| model.states[*state].initial).collect();
        let history = RefCell::new(History::new(delays, before));
        Equations {
            model,
            inputs,
            states,
            continuous,
            played,
            delayed,
            history,
            waiting: RefCell::new(Waiting::of(model)),
            sums,
            terms,
            factors,
            derivatives,
            jumps,
            slots,
        }
    }

    /// The derivatives at `time` on the pieces that signals follow at `within`.
    fn evaluate(&self, states: &[f64], (within, time): (f64, f64), derivatives: &mut [f64]) {
        let input = |input: &Input| input.waveform.piece(within, time);
        let slots = &mut *self.slots.borrow_mut();
        slots[..states.len()].copy_from_slice(states);
        for state in &self.played {
            slots[state.index()] = self.model.signal_at(*state, within, time).unwrap_or_default();
        }
        let history = self.history.borrow();
        for (number, state) in self.delayed.iter().enumerate() {
            slots[state.index()] = history.value(number, time);
        }
        drop(history);
        for (slot, declared) in slots[states.len()..].iter_mut().zip(self.inputs) {
            *slot = input(declared);
        }
        // The solution of the system that was solved last, by its right-hand side.
        let mut solved: Option<(u32, Vec<f64>)> = None;
        for sum in &self.sums {
            if let Some(expr) = &sum.exact {
                let number = |variable| slots[index::at(slot(variable, self.states, index::number(self.inputs.len())))];
                let value = match expr {
                    Expr::Solution(solution) => {
                        let right = solution.right.number;
                        let known = solved.take().filter(|(number, _)| *number == right);
                        let (_, all) = known.unwrap_or_else(|| (right, by_library(solution, &number)));
                        let value = all[index::at(solution.row)];
                        solved = Some((right, all));
                        value
                    }
                    expr => expr.evaluate(&number),
                };
                slots[index::at(sum.slot)] = value;
                continue;
            }
            slots[index::at(sum.slot)] =
                self.sum(&self.terms[index::at(sum.terms.start)..index::at(sum.terms.end)], slots);
        }
        for (derivative, slot) in derivatives.iter_mut().zip(&self.derivatives) {
            *derivative = slots[index::at(*slot)];
        }
        self.played.iter().for_each(|state| derivatives[state.index()] = 0.0);
    }
}

impl Equations<'_> {
    /// What the quantities are at a time that are read later.
    pub fn followed(&self, states: &States, (within, time): (f64, f64)) -> Vec<f64> {
        let mut derivatives = vec![0.0; states.0.len()];
        self.evaluate(&states.0, (within, time), &mut derivatives);
        self.delayed.iter().map(|state| derivatives[state.index()]).collect()
    }

    /// A sum of products, in a function of its own, where it stays in a register.
    #[inline(never)]
    fn sum(&self, terms: &[Term], slots: &[f64]) -> f64 {
        let at = |slot: &u32| slots[index::at(*slot)];
        let product = |term: &Term| {
            let factors = &self.factors[index::at(term.factors.start)..index::at(term.factors.end)];
            match factors {
                [one] => term.coefficient * at(one),
                [one, other] => term.coefficient * at(one) * at(other),
                all => all.iter().fold(term.coefficient, |product, slot| product * at(slot)),
            }
        };
        terms.iter().fold(0.0, |total, term| total + product(term))
    }

    /// What the states are behind the jumps that are due at a time, if any is.
    pub fn jumped(&self, states: &States, (within, time): (f64, f64)) -> Option<Jumped> {
        // A time that a rounded number has missed has come.
        const SLACK: f64 = 1e-6;
        let model = self.model;
        let waiting = self.waiting.borrow();
        let mut near = states.0.clone();
        waiting.show(&mut near, time);
        for (state, own) in model.states.numbered().filter(|(_, own)| own.motion == Some(Motion::Clock)) {
            near[state.index()] += SLACK * model.step * own.derivative.as_constant().unwrap_or(0.0);
        }
        let mut derivatives = vec![0.0; near.len()];
        self.evaluate(&near, (within, time), &mut derivatives);
        let slots = self.slots.borrow();
        let jumps = self.jumps.iter().map(|(state, slot)| (*state, slots[index::at(*slot)]));
        let due: Vec<(StateId, f64)> = jumps.filter(|(_, jump)| *jump != 0.0).collect();
        waiting.behind(states, &near, &due)
    }
}

/// Collects the lists.
struct Builder {
    states: u32,
    inputs: u32,
    next: u32,
    sums: Vec<Sum>,
    terms: Vec<Term>,
    factors: Vec<u32>,
}

impl Builder {
    /// Computes an expression into a slot of its own.
    fn fresh(&mut self, expr: &Expr) -> u32 {
        let slot = self.next;
        self.next += 1;
        self.store(slot, expr);
        slot
    }

    fn store(&mut self, slot: u32, expr: &Expr) {
        if matches!(expr, Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_)) {
            self.sums.push(Sum { slot, terms: 0..0, exact: Some(expr.clone()) });
            return;
        }
        // Operands come first, for they may need sums of their own.
        let members = if let Expr::Sum(members) = expr { members } else { std::slice::from_ref(expr) };
        let products: Vec<(f64, Vec<u32>)> = members
            .iter()
            .map(|member| {
                let (mut coefficient, mut factors) = (1.0, Vec::new());
                self.multiply(member, &mut coefficient, &mut factors);
                (coefficient, factors)
            })
            .collect();
        let first = index::number(self.terms.len());
        for (coefficient, factors) in products {
            let start = index::number(self.factors.len());
            self.factors.extend(factors);
            self.terms.push(Term { coefficient, factors: start..self.factors.len() as u32 });
        }
        self.sums.push(Sum { slot, terms: first..self.terms.len() as u32, exact: None });
    }

    /// Multiplies a product by an expression.
    fn multiply(&mut self, expr: &Expr, coefficient: &mut f64, factors: &mut Vec<u32>) {
        match expr {
            Expr::Constant(number) => *coefficient *= number,
            Expr::Variable(variable) => factors.push(self.slot(*variable)),
            Expr::Sum(_) | Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => factors.push(self.fresh(expr)),
            Expr::Product(members) => members.iter().for_each(|member| self.multiply(member, coefficient, factors)),
            Expr::Power(base, exponent) => {
                let base = if let Expr::Variable(variable) = **base { self.slot(variable) } else { self.fresh(base) };
                factors.extend(std::iter::repeat_n(base, index::at(*exponent)));
            }
        }
    }

    fn slot(&self, variable: Variable) -> u32 {
        slot(variable, self.states, self.inputs)
    }
}

/// The solution of a linear system, with complete pivoting; not finite where its matrix is singular.
fn by_library(solution: &Solution, number: &impl Fn(Variable) -> f64) -> Vec<f64> {
    let size = index::at(solution.matrix.size);
    let matrix = DMatrix::from_row_slice(size, size, &solution.matrix.numbers(number));
    let right = DVector::from_vec(solution.right.numbers(number));
    let solved = matrix.full_piv_lu().solve(&right);
    solved.map_or_else(|| vec![f64::NAN; size], |solved| solved.as_slice().to_vec())
}

/// Slot of a variable of a model with so many states and inputs.
fn slot(variable: Variable, states: u32, inputs: u32) -> u32 {
    match variable {
        Variable::State(index) => index.number(),
        Variable::Input(index) => states + index,
        Variable::Algebraic(index) => states + inputs + index,
    }
}

/// Whether a rate takes a sample at a time, which may be off for being a rounded number.
fn is_sample(rate: &Rate, time: f64) -> bool {
    const PART: f64 = 1e-9;
    let periods = time / rate.period;
    (periods - libm::round(periods)).abs() <= PART * periods.abs()
}

/// The equations between two neighbouring breakpoints of the signals.
pub(super) struct Piece<'a> {
    pub from: f64,
    pub to: f64,
    pub equations: &'a Equations<'a>,
}

impl Piece<'_> {
    /// Takes the samples that are due at the beginning of the piece.
    pub fn sample(&self, states: &mut States) {
        let model = self.equations.model;
        let due: Vec<bool> = model.rates.iter().map(|rate| is_sample(rate, self.from)).collect();
        if !due.contains(&true) {
            return;
        }
        let mut next = states.0.clone();
        self.equations.evaluate(&states.0, (self.middle(), self.from), &mut next);
        let sampled = model.states.iter().zip(next).zip(&mut states.0).skip(self.equations.continuous);
        for ((state, next), number) in sampled {
            if state.rate.is_some_and(|rate| due[index::at(rate)]) {
                *number = next;
            }
        }
    }

    /// What the states are behind the jumps that are due at a time, if any is.
    pub fn jumped(&self, time: f64, states: &States) -> Option<Jumped> {
        self.equations.jumped(states, (self.middle(), time))
    }

    /// What the quantities are at a time that are read later.
    pub fn followed(&self, time: f64, states: &States) -> Vec<f64> {
        self.equations.followed(states, (self.middle(), time))
    }

    fn middle(&self) -> f64 {
        0.5 * (self.from + self.to)
    }

    /// A state at a time of the piece: as it was integrated, or what the signal is that it follows.
    pub fn state(&self, state: StateId, time: f64, states: &States) -> f64 {
        if let Some(number) = self.equations.delayed.iter().position(|delayed| *delayed == state) {
            return self.equations.history.borrow().value(number, time);
        }
        if let Some(left) = self.equations.waiting.borrow().left(state, time) {
            return left;
        }
        let followed = self.equations.model.signal_at(state, self.middle(), time);
        followed.unwrap_or(states.0[state.index()])
    }

    /// Whether all derivatives are finite.
    pub fn is_finite(&self, time: f64, states: &States) -> bool {
        let mut derivatives = states.clone();
        self.diff(time, states, &mut derivatives);
        derivatives.0.iter().all(|derivative| derivative.is_finite())
    }
}

impl ODE<f64, States> for Piece<'_> {
    fn diff(&self, time: f64, states: &States, derivatives: &mut States) {
        self.equations.evaluate(&states.0, (self.middle(), time), &mut derivatives.0);
        derivatives.0[self.equations.continuous..].fill(0.0);
        self.equations.delayed.iter().for_each(|state| derivatives.0[state.index()] = 0.0);
    }

    fn jacobian(&self, time: f64, states: &States, jacobian: &mut Matrix<f64>) {
        let model = self.equations.model;
        let inputs: Vec<f64> = model.inputs.iter().map(|input| input.waveform.piece(self.middle(), time)).collect();
        let at: Vec<f64> = self.equations.model.states.ids().map(|state| self.state(state, time, states)).collect();
        let columns = Linearised::with_signals(model, &at, &inputs).dense();
        let count = states.0.len();
        for (index, number) in columns.into_iter().enumerate() {
            jacobian[(index % count, index / count)] = number;
        }
    }
}
