//! The step of a method as equations, before they are chains.
//!
//! Each equation of a plan defines a variable: a state in an intermediate stage or at the end of the step, an algebraic
//! variable in some stage, or a quantity of the method. Equations read states at the start of the step, inputs, and
//! variables of earlier equations, under the name [`Variable::Algebraic`] with the number of the equation.

use std::collections::BTreeMap;

use pe_ir::graph::Role;
use pe_ir::index::{self, List, StateId, at};
use pe_ir::model::{Expr, Model, Variable};
use pe_ir::motion::Motion;

use super::elimination::order::Order;
use super::motion;
use super::played::{self, Score};

/// `variable := base + sum`.
#[derive(Clone, Debug)]
pub struct Planned {
    /// What it is. Indices of auxiliaries are those of [`Plan::auxiliaries`], indices of algebraic variables the model's.
    pub role: Role,
    /// The state on whose PE it is computed; none for the model's algebraic variables, which are units of their own.
    pub owner: Option<StateId>,
    /// What the sum is added to without a loss, in the same number format.
    pub base: Option<Variable>,
    /// The sum.
    pub sum: Expr,
    /// The equation whose sum is taken in place of an own one.
    pub same_sum: Option<u32>,
    /// Whether it has to be computed; otherwise it may be put in place where it is read.
    pub keep: bool,
}

/// A number that the method keeps from step to step beside the states, such as a slope of the step before.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    /// The state that it belongs to.
    pub owner: StateId,
    /// Name.
    pub name: String,
    /// Value at time zero.
    pub initial: f64,
}

/// Equations of a step.
pub struct Plan<'m> {
    /// The model.
    pub model: &'m Model,
    /// Equations, each reading only earlier ones.
    pub equations: Vec<Planned>,
    /// Names of quantities of the method.
    pub auxiliaries: Vec<String>,
    /// Numbers kept from step to step; they count as states behind those of the model.
    pub memories: Vec<Memory>,
    /// For each state and memory its value at the end of the step.
    pub ends: List<StateId, Option<Variable>>,
    /// The pivot of least magnitude among those that are numbers: its state and the magnitude.
    pub constant_pivot: Option<(StateId, f64)>,
    /// The order in which matrices are eliminated.
    pub order: Order,
}

/// States at some point of a step, and the algebraic variables there.
#[derive(Clone, Debug)]
pub struct Point {
    /// For each state of the model the variable that stands for it.
    pub states: Vec<Variable>,
    algebraics: BTreeMap<u32, Variable>,
    stage: u8,
}

impl Point {
    /// The point with these states; `stage` numbers it in names.
    pub fn new(states: Vec<Variable>, stage: u8) -> Point {
        Point { states, algebraics: BTreeMap::new(), stage }
    }

    /// Whether an algebraic variable has been asked for.
    pub fn has(&self, algebraic: u32) -> bool {
        self.algebraics.contains_key(&algebraic)
    }

    /// What stands for a variable of the model here; its algebraic variables must have been asked for.
    pub fn variable(&self, variable: Variable) -> Variable {
        match variable {
            Variable::State(state) => self.states[state.index()],
            Variable::Algebraic(algebraic) => self.algebraics[&algebraic],
            input @ Variable::Input(_) => input,
        }
    }
}

impl<'m> Plan<'m> {
    /// A plan without equations.
    pub fn new(model: &'m Model) -> Plan<'m> {
        let ends = List::filled(None, model.states.len());
        Plan {
            model,
            equations: Vec::new(),
            auxiliaries: Vec::new(),
            memories: Vec::new(),
            ends,
            constant_pivot: None,
            order: Order::default(),
        }
    }

    /// The start of the step.
    pub fn start(&self) -> Point {
        Point::new(self.model.states.ids().map(Variable::State).collect(), 1)
    }

    /// The derivatives of some states at a point.
    pub fn slopes(&mut self, point: &mut Point, states: &[StateId]) -> Vec<Expr> {
        let model = self.model;
        let derivative = |state: &StateId| &model.states[*state].derivative;
        self.algebraics(point, states.iter().map(derivative), false);
        states.iter().map(|state| derivative(state).renamed(&|variable| point.variable(variable))).collect()
    }

    /// Plans the algebraic variables that expressions of the model read at a point.
    pub fn algebraics<'e>(&mut self, point: &mut Point, readers: impl Iterator<Item = &'e Expr>, keep: bool) {
        let model = self.model;
        let mut needed = vec![false; model.algebraics.len()];
        let mark = |expr: &Expr, needed: &mut Vec<bool>| {
            expr.each_variable(&mut |variable| {
                if let Variable::Algebraic(algebraic) = variable {
                    needed[at(algebraic)] = true;
                }
            });
        };
        readers.for_each(|expr| mark(expr, &mut needed));
        let asked = needed.clone();
        for index in (0..needed.len()).rev().filter(|index| !point.algebraics.contains_key(&index::number(*index))) {
            if needed[index] {
                mark(&model.algebraics[index].expr, &mut needed);
            }
        }
        for index in (0..needed.len()).filter(|index| needed[*index]) {
            let algebraic = index::number(index);
            if !point.algebraics.contains_key(&algebraic) {
                let sum = model.algebraics[index].expr.renamed(&|variable| point.variable(variable));
                let role = Role::Algebraic(algebraic, point.stage);
                let keep = (keep && asked[index]) || model.algebraics[index].kept;
                let variable = self.add(Planned { role, owner: None, base: None, sum, same_sum: None, keep });
                point.algebraics.insert(algebraic, variable);
            }
        }
    }

    /// A state in an intermediate stage.
    pub fn stage(&mut self, state: StateId, number: u8, base: Variable, sum: Expr) -> Variable {
        if self.model.states[state].motion.is_some_and(Motion::rests) {
            return Variable::State(state);
        }
        let role = Role::Stage(state, number);
        self.add(Planned { role, owner: Some(state), base: Some(base), sum, same_sum: None, keep: true })
    }

    /// A quantity of the method that is computed on the PE of a state. Without `keep` it may be put in place.
    pub fn auxiliary(&mut self, owner: StateId, name: String, sum: Expr, keep: bool) -> Variable {
        let role = self.auxiliary_role(name);
        self.add(Planned { role, owner: Some(owner), base: None, sum, same_sum: None, keep })
    }

    /// The same, added to a base.
    pub fn added(&mut self, owner: StateId, name: String, base: Variable, sum: Expr) -> Variable {
        let role = self.auxiliary_role(name);
        self.add(Planned { role, owner: Some(owner), base: Some(base), sum, same_sum: None, keep: true })
    }

    /// A quantity of the method: the sum of an earlier equation without that equation's base.
    pub fn increment_of(&mut self, equation: Variable, owner: StateId, name: String) -> Variable {
        let Variable::Algebraic(number) = equation else { unreachable!("only equations have a sum") };
        let role = self.auxiliary_role(name);
        let sum = Expr::Constant(0.0);
        self.add(Planned { role, owner: Some(owner), base: None, sum, same_sum: Some(number), keep: true })
    }

    /// Takes note of a pivot that is a number.
    pub fn note_pivot(&mut self, state: StateId, number: f64) {
        if self.constant_pivot.is_none_or(|(_, least)| number.abs() < least) {
            self.constant_pivot = Some((state, number.abs()));
        }
    }

    /// The reciprocal of a pivot in the row of a state of a matrix.
    pub fn pivot(&mut self, state: StateId, matrix: u8, sum: Expr) -> Variable {
        let role = Role::Pivot(state, matrix);
        self.add(Planned { role, owner: Some(state), base: None, sum, same_sum: None, keep: true })
    }

    /// A number kept from step to step; the variable is its value at the start of the step.
    pub fn memory(&mut self, owner: StateId, name: String, initial: f64) -> Variable {
        self.memories.push(Memory { owner, name, initial });
        Variable::State(self.ends.push(None))
    }

    /// The end value of a state or memory. That of a state that stands for a signal is exact, whatever is given.
    pub fn end(&mut self, state: StateId, base: Option<Variable>, sum: Expr) -> Variable {
        match self.model.states.find(state).and_then(|state| state.motion) {
            None | Some(Motion::Along(..)) => self.ending(state, base, sum),
            Some(motion) => self.moved(state, motion),
        }
    }

    /// The end value of a state that stands for a signal.
    fn moved(&mut self, state: StateId, motion: Motion) -> Variable {
        if let Some(end) = self.ends[state] {
            return end;
        }
        let model = self.model;
        if motion.source().is_some() || motion.is_swept() {
            played::play(self, model);
            return self.ends[state].expect("it was played");
        }
        let (sine, rate) = match motion {
            Motion::Clock => {
                let slope = model.states[state].derivative.as_constant().unwrap_or(0.0);
                return self.ending(state, Some(Variable::State(state)), motion::of_step(model, |step| slope * step));
            }
            Motion::Sine(rate) => (state, rate),
            Motion::Cosine(rate) => (StateId::new(state.number() - 1), rate),
            _ => unreachable!("all others have a source"),
        };
        let cosine = sine.behind(1);
        let (of_cosine, of_sine) = motion::shears_of_step(model, rate);
        let name = format!("{}.sheared", model.states[cosine].name);
        let first = Expr::product(vec![of_cosine.clone(), of(Variable::State(sine))]);
        let sheared = self.added(cosine, name, Variable::State(cosine), first);
        let second = Expr::product(vec![of_sine, of(sheared)]);
        let sine_end = self.ending(sine, Some(Variable::State(sine)), second);
        let cosine_end = self.ending(cosine, Some(sheared), Expr::product(vec![of_cosine, of(sine_end)]));
        if state == sine { sine_end } else { cosine_end }
    }

    fn ending(&mut self, state: StateId, base: Option<Variable>, sum: Expr) -> Variable {
        let states = self.model.states.len();
        let owner = state.index().checked_sub(states).map_or(state, |memory| self.memories[memory].owner);
        let role = Role::Next(state);
        let end = self.add(Planned { role, owner: Some(owner), base, sum, same_sum: None, keep: true });
        self.ends[state] = Some(end);
        end
    }

    /// Adds sums to a state where they are added to a quantity of the method that is itself a sum added to that state;
    /// whether there was any.
    pub fn put_bases_in_place(&mut self) -> bool {
        let mut found = false;
        for index in 0..self.equations.len() {
            let Some(Variable::Algebraic(base)) = self.equations[index].base else { continue };
            let Planned { role, base, sum, .. } = self.equations[at(base)].clone();
            if matches!((role, base), (Role::Auxiliary(_), Some(Variable::State(_)))) {
                let own = std::mem::replace(&mut self.equations[index].sum, Expr::Constant(0.0));
                self.equations[index].sum = Expr::sum(vec![sum, own]);
                self.equations[index].base = base;
                found = true;
            }
        }
        found
    }

    /// The sum of what a score tells.
    fn scored(terms: &[(f64, Variable)], constant: f64) -> Expr {
        let terms = terms.iter().map(|(factor, variable)| times(*factor, *variable));
        Expr::sum(terms.chain(Some(Expr::Constant(constant)).filter(|_| constant != 0.0)).collect())
    }

    fn auxiliary_role(&mut self, name: String) -> Role {
        self.auxiliaries.push(name);
        Role::Auxiliary(index::number(self.auxiliaries.len()) - 1)
    }

    fn add(&mut self, equation: Planned) -> Variable {
        self.equations.push(equation);
        Variable::Algebraic(index::number(self.equations.len()) - 1)
    }
}

impl Score for Plan<'_> {
    type Value = Variable;

    fn memory(&mut self, owner: StateId, name: String, initial: f64) -> Variable {
        Plan::memory(self, owner, name, initial)
    }

    fn keep(&mut self, _: StateId, memory: Variable, terms: &[(f64, Variable)], constant: f64) {
        let Variable::State(number) = memory else { unreachable!("memories are states") };
        self.ending(number, Some(memory), Plan::scored(terms, constant));
    }

    fn sum(&mut self, owner: StateId, name: String, terms: &[(f64, Variable)], constant: f64) -> Variable {
        self.auxiliary(owner, name, Plan::scored(terms, constant), true)
    }

    fn function(&mut self, owner: StateId, name: String, argument: Variable, body: Expr) -> Variable {
        self.auxiliary(owner, name, body.substituted(&|_| of(argument)), true)
    }

    fn end(&mut self, state: StateId, terms: &[(f64, Variable)], constant: f64) {
        self.ending(state, None, Plan::scored(terms, constant));
    }

    fn start(&mut self, variable: Variable) -> Variable {
        variable
    }
}

/// A variable as an expression.
pub fn of(variable: Variable) -> Expr {
    Expr::Variable(variable)
}

/// A number times a variable.
pub fn times(factor: f64, variable: Variable) -> Expr {
    Expr::scaled(factor, of(variable))
}
