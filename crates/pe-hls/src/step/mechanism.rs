//! The trapezoidal rule for a mechanism: closures hold at the end of the step (index 3, augmented Lagrangian), two Newton
//! iterations, and projections of velocities and accelerations onto what the closures allow.
//!
//! Accelerations and multipliers are kept from step to step in the measure of angles: `a = h^2/4 q''`, `m = h^2/4 lambda`.
//! With `T = M + b transpose(J) J` at the point of an iteration:
//!
//! ```text
//! q1 = q + h w + 2 a      w1 = w + 4 a/h            T1 d1 = h^2/4 f1 - M1 a  - transpose(J1)(m + b gap1)
//! q2 = q1 + d1            w2 = w1 + 2 d1/h          T2 d2 = h^2/4 f2 - M2 a2 - transpose(J2)(m + 2 b gap2)
//! w' = w3 - T2 \ b transpose(J2)(J2 w3 + drift2)   w3 = w2 + 2 d2/h
//! a' = a3 - T2 \ b transpose(J2)(J2 a3 + h^2/4 bend(q2, w'))        a3 = a2 + d2, a2 = a + d1
//! q' = q2 + d2            m' = m + 2 b gap2
//! ```
//!
//! All is evaluated at the end of the step, signals of the model and interpolated inputs as well, so that closures may move by
//! themselves; inputs that are held are what they are at its beginning.
//!
//! Coordinates that are angles count turns: what is added to them is divided by a turn in radians.
//!
//! The projections share the elimination of the second iteration. The tangent leaves out how forces depend on positions
//! and velocities: that slows the convergence and does not change what it converges to. The step is written as Euler's
//! step of another model, `x' = change/h`, which adds each change to its state without a loss.

use std::collections::BTreeMap;
use std::sync::Arc;

use pe_ir::index::{StateId, at, number};
use pe_ir::mechanism::{Mechanism, POINTS};
use pe_ir::model::{Algebraic, Entry, Expr, Matrix, Model, Right, Solution, Solver, State, Variable};
use pe_ir::motion::{Motion, Source};
use pe_ir::source::Diagnostic;

use super::method::unsuitable;

/// The model whose step by Euler's method is the step of the mechanism. Its states are those of the model, with
/// accelerations and multipliers behind them; its algebraic equations those of the model, with those of the step behind
/// them.
///
/// # Errors
/// `E0806` for a model that has more than a mechanism.
pub fn step_of(model: &Model, mechanism: &Mechanism) -> Result<Model, Vec<Diagnostic>> {
    check(model, mechanism)?;
    let mut written = Model { solver: Solver::Euler, mechanism: None, ..model.clone() };
    drop_unread(&mut written);
    let systems = written.algebraics.iter().filter_map(|algebraic| match &algebraic.expr {
        Expr::Solution(solution) => Some(solution.matrix.number.max(solution.right.number) + 1),
        _ => None,
    });
    let systems = systems.max().unwrap_or(0);
    let writer = Writer { given: model, mechanism, written, systems };
    Ok(writer.step())
}

fn check(model: &Model, mechanism: &Mechanism) -> Result<(), Vec<Diagnostic>> {
    let is_part = |state: StateId| mechanism.pairs.iter().any(|(q, w)| *q == state || *w == state);
    let help = "take `rk4`, or write the rest as inputs";
    let refused = |reason: String| Err(unsuitable(model, &reason, help));
    if !model.rates.is_empty() {
        return refused("the step of a mechanism takes no sampled parts".to_owned());
    }
    if !model.phases.is_empty() {
        return Err(unsuitable(model, "the step of a mechanism takes no list of steps", "take a single step"));
    }
    for (number, state) in model.states.numbered() {
        let still = state.derivative.as_constant() == Some(0.0);
        if !(is_part(number) || still || state.motion.is_some()) {
            return refused(format!("`{}` is no part of the mechanism", state.name));
        }
        if state.motion.is_some() && at_end(model, number).is_none() {
            return refused(format!("what `{}` is at the end of a step is known there only", state.name));
        }
    }
    if let Some(name) = sampled(model, mechanism) {
        let reason = format!("closures read `{name}`, which the network knows at samples only");
        return Err(unsuitable(model, &reason, "take `rk4`, or write what moves closures as a function of `time`"));
    }
    Ok(())
}

/// What a state that stands for a signal is at the end of the step; none if no equation of its start says so.
fn at_end(model: &Model, state: StateId) -> Option<Expr> {
    let of = |state: StateId| Expr::Variable(Variable::State(state));
    let turned = |rate: f64, other: StateId| {
        let (half, whole) = (libm::sin(rate * model.step / 2.0), libm::sin(rate * model.step));
        sum(vec![of(state), times(-2.0 * half * half, &of(state)), times(whole, &of(other))])
    };
    match model.states[state].motion? {
        Motion::Clock => {
            let rate = model.states[state].derivative.as_constant()?;
            Some(sum(vec![of(state), Expr::Constant(rate * model.step)]))
        }
        Motion::Sine(rate) => Some(turned(rate, state.behind(1))),
        Motion::Cosine(rate) => Some(turned(-rate, StateId::new(state.number() - 1))),
        Motion::Line(Source::Input(input)) => Some(Expr::Variable(Variable::Input(input))),
        Motion::Line(Source::Signal(_)) => Some(of(state.behind(2))),
        Motion::Held(_) | Motion::Before(_) | Motion::After(_) => Some(of(state)),
        Motion::SweptSine(_) | Motion::SweptCosine(_) | Motion::Delayed(_) | Motion::Along(..) => None,
    }
}

/// An input or a signal that is played, which closures read.
fn sampled<'m>(model: &'m Model, mechanism: &Mechanism) -> Option<&'m str> {
    let levers = mechanism.jacobian.iter().map(|entry| &entry.value);
    let parts = levers.chain(&mechanism.gaps).chain(&mechanism.bends).chain(&mechanism.drifts);
    let mut read = Vec::new();
    parts.for_each(|part| part.each_variable(&mut |variable| read.push(variable)));
    let needed = model.needed(read.iter().copied());
    for (algebraic, _) in model.algebraics.iter().zip(needed).filter(|(_, needed)| *needed) {
        algebraic.expr.each_variable(&mut |variable| read.push(variable));
    }
    read.into_iter().find_map(|variable| match variable {
        Variable::Input(input) => Some(model.inputs[at(input)].name.as_str()),
        Variable::State(state) => {
            let state = &model.states[state];
            state.motion.is_some_and(|motion| motion.source().is_some()).then_some(state.name.as_str())
        }
        Variable::Algebraic(_) => None,
    })
}

/// Equations that no output reads become zeros, which nothing reads: the numbers of all others stay what they are.
fn drop_unread(model: &mut Model) {
    let needed = model.needed(model.outputs.iter().map(|output| output.variable));
    for (algebraic, _) in model.algebraics.iter_mut().zip(needed).filter(|(_, needed)| !needed) {
        algebraic.expr = Expr::Constant(0.0);
    }
}

/// Coordinates and velocities at which parts of the mechanism are evaluated, and the equations of the model there.
struct Point {
    states: BTreeMap<StateId, Expr>,
    known: BTreeMap<u32, Expr>,
    name: &'static str,
}

/// The parts of a mechanism at a point.
struct Parts {
    mass: Vec<Entry>,
    jacobian: Vec<Entry>,
    forces: Vec<Expr>,
    gaps: Vec<Expr>,
}

struct Writer<'m> {
    given: &'m Model,
    mechanism: &'m Mechanism,
    written: Model,
    /// Numbers of matrices and right-hand sides so far.
    systems: u32,
}

fn sum(members: Vec<Expr>) -> Expr {
    Expr::sum(members)
}

fn times(factor: f64, expr: &Expr) -> Expr {
    Expr::product(vec![Expr::Constant(factor), expr.clone()])
}

fn product(one: &Expr, other: &Expr) -> Expr {
    Expr::product(vec![one.clone(), other.clone()])
}

/// The row `row` of a matrix times a vector, as terms of a sum.
fn row_times(entries: &[Entry], row: usize, vector: &[Expr]) -> Vec<Expr> {
    let own = entries.iter().filter(|entry| at(entry.row) == row);
    own.map(|entry| product(&entry.value, &vector[at(entry.column)])).collect()
}

/// The same for the transposed matrix.
fn column_times(entries: &[Entry], column: usize, vector: &[Expr]) -> Vec<Expr> {
    let own = entries.iter().filter(|entry| at(entry.column) == column);
    own.map(|entry| product(&entry.value, &vector[at(entry.row)])).collect()
}

impl Writer<'_> {
    fn define(&mut self, name: String, expr: Expr, kept: bool) -> Expr {
        if matches!(expr, Expr::Constant(_) | Expr::Variable(_)) {
            return expr;
        }
        let name = self.written.free_name(name);
        let span = self.mechanism.span;
        self.written.algebraics.push(Algebraic { name, unit: None, expr, range: None, kept, angle: false, span });
        Expr::Variable(Variable::Algebraic(number(self.written.algebraics.len()) - 1))
    }

    /// One quantity per coordinate, named after its state.
    fn each(&mut self, velocities: bool, what: &str, exprs: Vec<Expr>) -> Vec<Expr> {
        let states = self.mechanism.pairs.iter().map(|pair| if velocities { pair.1 } else { pair.0 });
        let names: Vec<String> = states.map(|state| format!("{}.{what}", self.given.states[state].name)).collect();
        names.into_iter().zip(exprs).map(|(name, expr)| self.define(name, expr, true)).collect()
    }

    fn closing(&mut self, what: &str, exprs: Vec<Expr>) -> Vec<Expr> {
        exprs
            .into_iter()
            .enumerate()
            .map(|(row, expr)| self.define(format!("closure{row}.{what}"), expr, true))
            .collect()
    }

    /// A part of the mechanism at a point, with the equations that it reads.
    fn at(&mut self, point: &mut Point, part: &Expr) -> Expr {
        let mut read = Vec::new();
        part.each_variable(&mut |variable| read.push(variable));
        let needed = self.given.needed(read);
        for index in (0..needed.len()).filter(|index| needed[*index]) {
            if !point.known.contains_key(&number(index)) {
                let given = &self.given.algebraics[index];
                let (name, kept) = (format!("{}.{}", given.name, point.name), given.kept);
                let expr = point.substituted(&given.expr);
                let known = self.define(name, expr, kept);
                point.known.insert(number(index), known);
            }
        }
        point.substituted(part)
    }

    fn parts(&mut self, point: &mut Point) -> Parts {
        let mechanism = self.mechanism;
        let mut entries = |entries: &[Entry]| -> Vec<Entry> {
            entries.iter().map(|entry| Entry { value: self.at(point, &entry.value), ..*entry }).collect()
        };
        let (mass, jacobian) = (entries(&mechanism.mass), entries(&mechanism.jacobian));
        let forces = mechanism.forces.iter().map(|force| self.at(point, force)).collect();
        let gaps = mechanism.gaps.iter().map(|gap| self.at(point, gap)).collect();
        Parts { mass, jacobian, forces, gaps }
    }

    /// The matrix `M + b transpose(J) J` at a point.
    fn matrix(&mut self, parts: &Parts, name: &str) -> Arc<Matrix> {
        let size = self.mechanism.pairs.len();
        let mut below: BTreeMap<(usize, usize), Vec<Expr>> = BTreeMap::new();
        for entry in parts.mass.iter().filter(|entry| entry.row >= entry.column) {
            below.entry((at(entry.row), at(entry.column))).or_default().push(entry.value.clone());
        }
        for one in &parts.jacobian {
            for other in parts.jacobian.iter().filter(|other| other.row == one.row && other.column <= one.column) {
                let stiff = times(self.mechanism.penalty, &product(&one.value, &other.value));
                below.entry((at(one.column), at(other.column))).or_default().push(stiff);
            }
        }
        let mut entries = BTreeMap::new();
        for ((row, column), terms) in below {
            let value = self.define(format!("{name}[{row},{column}]"), sum(terms), false);
            entries.insert((row, column), value.clone());
            entries.insert((column, row), value);
        }
        let entry =
            |((row, column), value): ((usize, usize), Expr)| Entry { row: number(row), column: number(column), value };
        self.systems += 1;
        Arc::new(Matrix {
            number: self.systems - 1,
            name: name.to_owned(),
            symmetric: true,
            size: number(size),
            first: (0, 0),
            entries: entries.into_iter().map(entry).collect(),
        })
    }

    fn solve(&mut self, matrix: &Arc<Matrix>, right: Vec<Expr>, what: &str) -> Vec<Expr> {
        let right = self.each(true, &format!("{what}.right"), right);
        self.systems += 1;
        let right = Arc::new(Right { number: self.systems - 1, values: right });
        let solution = |row| Solution { matrix: Arc::clone(matrix), right: Arc::clone(&right), row: number(row) };
        let all = (0..right.values.len()).map(|row| Expr::Solution(Box::new(solution(row)))).collect();
        self.each(true, what, all)
    }

    /// The correction of an iteration.
    fn iteration(
        &mut self,
        matrix: &Arc<Matrix>,
        parts: &Parts,
        a: &[Expr],
        lagging: &[Expr],
        what: &str,
    ) -> Vec<Expr> {
        let part = self.given.step * self.given.step / 4.0;
        let right = (0..a.len()).map(|row| {
            let mut terms = vec![times(part, &parts.forces[row])];
            terms.extend(row_times(&parts.mass, row, a).iter().map(|term| times(-1.0, term)));
            terms.extend(column_times(&parts.jacobian, row, lagging).iter().map(|term| times(-1.0, term)));
            sum(terms)
        });
        let right = right.collect();
        self.solve(matrix, right, what)
    }

    /// What is taken from velocities or accelerations so that closures do not move: `open` is how much they do.
    fn projection(&mut self, matrix: &Arc<Matrix>, jacobian: &[Entry], open: &[Expr], what: &str) -> Vec<Expr> {
        let penalty = self.mechanism.penalty;
        let right = (0..self.mechanism.pairs.len())
            .map(|row| sum(column_times(jacobian, row, open).iter().map(|term| times(penalty, term)).collect()));
        let right = right.collect();
        self.solve(matrix, right, what)
    }

    fn step(mut self) -> Model {
        let (h, penalty) = (self.given.step, self.mechanism.penalty);
        let (part, size) = (h * h / 4.0, self.mechanism.pairs.len());
        let starts = self.accelerations();
        let (first, count) = (self.written.states.len(), size + self.mechanism.gaps.len());
        let memory = |place: usize| Expr::Variable(Variable::State(StateId::at(first + place)));
        let a: Vec<Expr> = (0..size).map(memory).collect();
        let m: Vec<Expr> = (size..count).map(memory).collect();
        let of = |state: StateId| Expr::Variable(Variable::State(state));
        let (q, w): (Vec<Expr>, Vec<Expr>) = self.mechanism.pairs.iter().map(|pair| (of(pair.0), of(pair.1))).unzip();
        let signals = self.signals();
        let added = |one: &[Expr], factor: f64, other: &[Expr]| -> Vec<Expr> {
            one.iter().zip(other).map(|(one, other)| sum(vec![one.clone(), times(factor, other)])).collect()
        };

        // Coordinates in their own units, which are turns of angles.
        let units: Vec<f64> = self.mechanism.pairs.iter().map(|pair| 1.0 / self.given.radians(pair.0)).collect();
        let along = |one: &[Expr], factor: f64, other: &[Expr]| -> Vec<Expr> {
            let rows = one.iter().zip(other).zip(&units);
            rows.map(|((one, other), unit)| sum(vec![one.clone(), times(unit * factor, other)])).collect()
        };
        let [ahead, nearer, end] = POINTS;

        let forward = along(&along(&q, h, &w), 2.0, &a);
        let q1 = self.each(false, ahead, forward);
        let w1 = self.each(true, ahead, added(&w, 4.0 / h, &a));
        let mut point = self.point(&signals, &q1, &w1, ahead);
        let parts = self.parts(&mut point);
        let matrix = self.matrix(&parts, ahead);
        let lagging = self.closing(ahead, added(&m, penalty, &parts.gaps));
        let d1 = self.iteration(&matrix, &parts, &a, &lagging, "first");

        let q2 = self.each(false, nearer, along(&q1, 1.0, &d1));
        let w2 = self.each(true, nearer, added(&w1, 2.0 / h, &d1));
        let a2 = self.each(true, "acceleration.nearer", added(&a, 1.0, &d1));
        let mut point = self.point(&signals, &q2, &w2, nearer);
        let parts = self.parts(&mut point);
        let matrix = self.matrix(&parts, nearer);
        let lagging = self.closing(nearer, added(&m, 2.0 * penalty, &parts.gaps));
        let d2 = self.iteration(&matrix, &parts, &a2, &lagging, "second");

        let w3 = self.each(true, "free", added(&w2, 2.0 / h, &d2));
        let a3 = self.each(true, "acceleration.free", added(&a2, 1.0, &d2));
        let rows = 0..self.mechanism.gaps.len();
        let drifts = self.mechanism.drifts.iter().map(|drift| self.at(&mut point, drift)).collect::<Vec<_>>();
        let open = rows.clone().map(|row| {
            let terms = row_times(&parts.jacobian, row, &w3);
            sum(terms.into_iter().chain(drifts.get(row).cloned()).collect())
        });
        let open = open.collect();
        let open = self.closing("opening", open);
        let lost = self.projection(&matrix, &parts.jacobian, &open, "projected");
        let ends = self.each(true, end, added(&w3, -1.0, &lost));
        let mut point = self.point(&signals, &q2, &ends, end);
        let bends: Vec<Expr> = self.mechanism.bends.iter().map(|bend| self.at(&mut point, bend)).collect();
        let bent = rows.map(|row| {
            let mut terms = row_times(&parts.jacobian, row, &a3);
            terms.push(times(part, &bends[row]));
            sum(terms)
        });
        let bent = bent.collect();
        let bent = self.closing("bending", bent);
        let slowed = self.projection(&matrix, &parts.jacobian, &bent, "acceleration.projected");

        let mechanism = self.mechanism;
        let change = |terms: &[(f64, &Expr)]| sum(terms.iter().map(|(factor, expr)| times(factor / h, expr)).collect());
        for (place, (coordinate, velocity)) in mechanism.pairs.iter().enumerate() {
            let (a, d1, d2) = (&a[place], &d1[place], &d2[place]);
            let (states, unit) = (&mut self.written.states, units[place]);
            states[*coordinate].derivative = change(&[(unit * h, &w[place]), (unit * 2.0, a), (unit, d1), (unit, d2)]);
            states[*velocity].derivative = change(&[(4.0 / h, a), (2.0 / h, d1), (2.0 / h, d2), (-1.0, &lost[place])]);
            let derivative = change(&[(1.0, d1), (1.0, d2), (-1.0, &slowed[place])]);
            let name = format!("{}.acceleration", self.given.states[*velocity].name);
            let name = self.written.free_name(name);
            self.written.states.push(State {
                initial: part * starts[place],
                span: mechanism.span,
                ..State::new(name, derivative)
            });
        }
        for (row, gap) in parts.gaps.iter().enumerate() {
            let name = self.written.free_name(format!("closure{row}.force"));
            let derivative = change(&[(2.0 * penalty, gap)]);
            self.written.states.push(State { span: mechanism.span, ..State::new(name, derivative) });
        }
        self.written
    }

    /// States that stand for signals, at the end of the step.
    fn signals(&mut self) -> BTreeMap<StateId, Expr> {
        let given = self.given;
        let moving =
            given.states.numbered().filter_map(|(number, state)| Some((number, state, at_end(given, number)?)));
        moving.map(|(number, state, end)| (number, self.define(format!("{}.ahead", state.name), end, false))).collect()
    }

    fn point(
        &self,
        signals: &BTreeMap<StateId, Expr>,
        coordinates: &[Expr],
        velocities: &[Expr],
        name: &'static str,
    ) -> Point {
        let pairs = self.mechanism.pairs.iter().zip(coordinates.iter().zip(velocities));
        let mut states = signals.clone();
        states.extend(pairs.flat_map(|(pair, (q, w))| [(pair.0, q.clone()), (pair.1, w.clone())]));
        Point { states, known: BTreeMap::new(), name }
    }

    /// Accelerations at time zero, by the model's own equations.
    fn accelerations(&self) -> Vec<f64> {
        let model = self.given;
        let inputs = model.sample_inputs(0.0);
        let mut algebraics: Vec<f64> = Vec::with_capacity(model.algebraics.len());
        let value = |variable: Variable, known: &[f64]| match variable {
            Variable::State(state) => model.states[state].initial,
            Variable::Input(input) => inputs[at(input)],
            Variable::Algebraic(algebraic) => known[at(algebraic)],
        };
        for algebraic in &model.algebraics {
            let next = algebraic.expr.evaluate(&|variable| value(variable, &algebraics));
            algebraics.push(next);
        }
        let derivative =
            |state: StateId| model.states[state].derivative.evaluate(&|variable| value(variable, &algebraics));
        self.mechanism.pairs.iter().map(|pair| derivative(pair.1)).collect()
    }
}

impl Point {
    fn substituted(&self, expr: &Expr) -> Expr {
        expr.substituted(&|variable| match variable {
            Variable::State(state) => self.states.get(&state).cloned().unwrap_or(Expr::Variable(variable)),
            Variable::Algebraic(algebraic) => self.known[&algebraic].clone(),
            input @ Variable::Input(_) => Expr::Variable(input),
        })
    }
}
