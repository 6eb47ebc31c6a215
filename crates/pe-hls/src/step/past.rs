//! The past of quantities in the step: words that move on by one place with every step.
//!
//! What a quantity was so many steps ago is a state that takes, at the end of a step, the word of the step behind it; the first
//! word of such a row takes the quantity itself. All of them stand still within a step, and jump at its end
//! (`docs/decisions/0107-delays.md`). Methods that look into the step find there what the quantity was within a step of its own,
//! from that step alone: what it was at the beginning of it, at its end and, for methods of third and fourth order, in its
//! middle. So a bend or a jump between two steps never reaches beyond one.

use std::collections::{BTreeMap, HashSet};

use pe_ir::codes;
use pe_ir::index::{self, StateId, at};
use pe_ir::model::{Algebraic, Expr, Model, Solver, State, Variable};
use pe_ir::motion::Motion;
use pe_ir::place::Place;
use pe_ir::source::{Diagnostic, Span};

/// Part of a step by which a delay may be off a whole number of steps for being a rounded number.
const TIME_SLACK: f64 = 1e-6;

/// How a method sees within a step what a quantity was.
#[derive(Clone, Copy, PartialEq)]
enum Course {
    /// As it was at the beginning of the step: the method looks nowhere else, or is of first order.
    Rests,
    /// Along a straight line, by its derivative.
    Line,
    /// At the times of the stages, along a straight line.
    Straight,
    /// The same along a parabola.
    Parabola,
}

fn course(solver: Solver) -> Course {
    match solver {
        Solver::Euler
        | Solver::SymplecticEuler
        | Solver::Leapfrog
        | Solver::Ab2
        | Solver::Ab3
        | Solver::Ab4
        | Solver::RushLarsen => Course::Rests,
        Solver::Heun => Course::Straight,
        Solver::Heun3 | Solver::Rk4 => Course::Parabola,
        Solver::Rkc5
        | Solver::Rkc10
        | Solver::ImplicitEuler
        | Solver::Trapezoidal
        | Solver::Ros2
        | Solver::Rodas3
        | Solver::Exact => Course::Line,
    }
}

/// Where in a step something was so.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Side {
    /// The end of a step, as the method leaves it.
    Before,
    /// The beginning of the next one, behind jumps.
    Behind,
    /// The middle of a step.
    Middle,
}

impl Side {
    /// What words of it are called.
    fn word(self) -> &'static str {
        match self {
            Side::Before => "end",
            Side::Behind => "past",
            Side::Middle => "middle",
        }
    }
}

/// The model whose delays are words that move on.
///
/// # Errors
/// `E0930` for a delay that is no whole number of steps, or more than `most`.
pub fn write_out(model: &Model, most: u32) -> Result<Model, Vec<Diagnostic>> {
    let mut delays: BTreeMap<StateId, Delay> = BTreeMap::new();
    for (state, steps) in steps(model, f64::from(most))? {
        if let Expr::Variable(of) = model.states[state].derivative {
            delays.insert(state, Delay { of, steps });
        }
    }
    let states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let inputs = model.sample_inputs(0.0);
    let named = model.states.iter().map(|state| &state.name).chain(model.inputs.iter().map(|input| &input.name));
    let mut writer = Writer {
        written: model.clone(),
        model,
        course: course(model.solver),
        zero: Place::new(model, &states, &inputs),
        names: named.chain(model.algebraics.iter().map(|own| &own.name)).cloned().collect(),
        quantity: model.states.iter().map(|state| state.quantity + 1).max().unwrap_or(0),
        held: known(model, |variable| match variable {
            Variable::State(state) => is_held(&model.states[state]),
            _ => true,
        }),
        ahead: known(model, |variable| match variable {
            Variable::State(state) => is_ahead(&model.states[state]),
            _ => false,
        }),
        steady: known(model, |variable| match variable {
            Variable::State(state) => model.states[state].jump.is_none(),
            _ => true,
        }),
        delays: delays.clone(),
        standing: BTreeMap::new(),
        rows: BTreeMap::new(),
        twins: BTreeMap::new(),
    };
    for (state, Delay { of, steps }) in &delays {
        if writer.course == Course::Rests || writer.is_held(*of) || writer.is_ahead(*of) {
            writer.standing.insert((*of, *steps), *state);
        }
    }
    delays.into_iter().for_each(|(state, delay)| writer.follow(state, delay));
    Ok(writer.written)
}

/// The steps of all delays, or a finding for each that is no whole number of them.
fn steps(model: &Model, most: f64) -> Result<BTreeMap<StateId, usize>, Vec<Diagnostic>> {
    let (mut all, mut findings, mut common) = (BTreeMap::new(), Vec::new(), None);
    for (state, seconds) in model.delays() {
        if let Some(whole) = whole(seconds, model.step, most) {
            all.insert(state, whole as usize);
            continue;
        }
        let steps = seconds / model.step;
        let must = match libm::round(steps) > most {
            true => format!("{most} are kept at most"),
            false => "it must be a whole number".to_owned(),
        };
        let message = format!("a delay of {seconds} s is {steps:.6} steps of {} s; {must}", model.step);
        let help = match *common.get_or_insert_with(|| common_step(model, most)) {
            Some(step) => format!("take a step that divides all delays, for example `--step {step:e}`"),
            None => format!("no step divides all delays into at most {most}: change one of them"),
        };
        findings.push(Diagnostic::error(codes::DELAY_STEPS, model.states[state].span, message).with_help(help));
    }
    if findings.is_empty() { Ok(all) } else { Err(findings) }
}

/// How many steps a delay has, if that is a whole number of which all can be kept.
fn whole(seconds: f64, step: f64, most: f64) -> Option<f64> {
    let steps = seconds / step;
    let whole = libm::round(steps);
    ((1.0..=most).contains(&whole) && (steps - whole).abs() <= TIME_SLACK * whole).then_some(whole)
}

/// The step nearest to that of the model which divides all delays; a shorter one if there is one.
fn common_step(model: &Model, most: f64) -> Option<f64> {
    let delays: Vec<f64> = model.delays().map(|(_, seconds)| seconds).collect();
    let shortest = delays.iter().copied().fold(f64::INFINITY, f64::min);
    let divides = |count: &f64| delays.iter().all(|delay| whole(*delay, shortest / count, most).is_some());
    let begin = libm::ceil(shortest / model.step).clamp(1.0, most);
    let shorter = (begin as u64..=most as u64).map(|count| count as f64).find(divides);
    let found = shorter.or_else(|| (1..begin as u64).rev().map(|count| count as f64).find(divides));
    found.map(|count| shortest / count)
}

/// Whether a state is the same all over a step, and at its end.
fn is_held(state: &State) -> bool {
    state.motion.is_none() && state.derivative == Expr::Constant(0.0)
}

/// Whether a state is the same all over a step, at whose end it is already what it is in the next.
fn is_ahead(state: &State) -> bool {
    state.motion.is_some_and(Motion::rests)
}

/// For each algebraic variable whether something holds for all states and inputs that it reads.
fn known(model: &Model, holds: impl Fn(Variable) -> bool) -> Vec<bool> {
    let mut known: Vec<bool> = Vec::with_capacity(model.algebraics.len());
    for algebraic in &model.algebraics {
        let mut all = true;
        algebraic.expr.each_variable(&mut |variable| {
            all &= match variable {
                Variable::Algebraic(read) => known[at(read)],
                other => holds(other),
            }
        });
        known.push(all);
    }
    known
}

/// A delay: what a state follows, and so many steps behind.
#[derive(Clone, Copy)]
struct Delay {
    of: Variable,
    steps: usize,
}

struct Writer<'a> {
    written: Model,
    /// The model with its delays.
    model: &'a Model,
    course: Course,
    /// Time zero.
    zero: Place<'a>,
    /// Names that are taken, and the number of the next quantity.
    names: HashSet<String>,
    quantity: u32,
    /// Algebraic variables that are the same all over a step and at its end, those that are then what they are in the next, and
    /// those that do not jump between two.
    held: Vec<bool>,
    ahead: Vec<bool>,
    steady: Vec<bool>,
    delays: BTreeMap<StateId, Delay>,
    /// Delayed quantities that stand still over a step, by what they are of and the steps of their delays.
    standing: BTreeMap<(Variable, usize), StateId>,
    /// Words, the latest first, by what they are of and where in steps it was so.
    rows: BTreeMap<(Variable, Side), Vec<StateId>>,
    /// What stands for variables on a side.
    twins: BTreeMap<(Variable, Side), Variable>,
}

fn of(variable: Variable) -> Expr {
    Expr::Variable(variable)
}

fn word(state: StateId) -> Expr {
    of(Variable::State(state))
}

fn minus(expr: Expr) -> Expr {
    Expr::scaled(-1.0, expr)
}

impl Writer<'_> {
    /// Lets a state be what a variable was.
    fn follow(&mut self, state: StateId, delay: Delay) {
        let next = self.next(delay);
        let own = &mut self.written.states[state];
        (own.derivative, own.motion) = (Expr::Constant(0.0), None);
        own.jump = Some(Expr::sum(vec![of(next), minus(word(state))]));
        if self.course == Course::Rests || self.is_held(delay.of) || self.is_ahead(delay.of) {
            return;
        }
        let after = self.row(delay.of, Side::Before, delay.steps);
        match self.course {
            Course::Rests => {}
            Course::Line => {
                let name = format!("{}.before", self.written.states[state].name);
                let initial = self.model.states[state].initial;
                let before = self.word(name, self.model.states[state].span, (of(next), initial));
                let change = Expr::sum(vec![word(after), minus(word(before))]);
                self.written.states[state].derivative = Expr::scaled(1.0 / self.model.step, change);
            }
            Course::Straight => self.written.states[state].motion = Some(Motion::Along(after, None)),
            Course::Parabola => {
                let middle = self.row(delay.of, Side::Middle, delay.steps);
                self.written.states[state].motion = Some(Motion::Along(after, Some(middle)));
            }
        }
    }

    /// What a delayed variable is in the next step, as things stand at the end of this one.
    fn next(&mut self, Delay { of, steps }: Delay) -> Variable {
        match (self.is_held(of), steps) {
            // What is held over a step was so from its beginning on.
            (true, 1) => of,
            (true, _) => Variable::State(self.row(of, Side::Before, steps - 1)),
            (false, _) => Variable::State(self.row(of, Side::Behind, steps)),
        }
    }

    /// The word that holds what a variable was so many steps ago; the first one holds it as it is.
    fn row(&mut self, variable: Variable, side: Side, place: usize) -> StateId {
        let side = if side == Side::Before && self.is_steady(variable) { Side::Behind } else { side };
        while self.rows.get(&(variable, side)).map_or(0, Vec::len) < place {
            let last = self.rows.get(&(variable, side)).and_then(|row| row.last().copied());
            let number = self.rows.get(&(variable, side)).map_or(0, Vec::len) + 1;
            // A delayed quantity that stands still over the step is a word itself.
            let steps = if self.is_held(variable) { number } else { number - 1 };
            let own = self.standing.get(&(variable, steps)).filter(|_| side != Side::Middle).copied();
            let word = own.unwrap_or_else(|| {
                let source = last.map_or_else(|| self.at_end(variable, side), Variable::State);
                let name = format!("{}.{}{number}", self.name(variable), side.word());
                self.word(name, self.place(variable), (of(source), self.zero.number(variable)))
            });
            self.rows.entry((variable, side)).or_default().push(word);
        }
        self.rows[&(variable, side)][place - 1]
    }

    /// A state that takes something at the end of each step, and begins with a number.
    fn word(&mut self, name: String, span: Span, (source, initial): (Expr, f64)) -> StateId {
        let name = self.free_name(name);
        let quantity = self.quantity;
        self.quantity += 1;
        let own = StateId::at(self.written.states.len());
        let jump = Some(Expr::sum(vec![source, minus(word(own))]));
        self.written.states.push(State { quantity, span, initial, jump, ..State::new(name, Expr::Constant(0.0)) })
    }

    fn free_name(&mut self, mut name: String) -> String {
        while !self.names.insert(name.clone()) {
            name.push('_');
        }
        name
    }

    fn name(&self, variable: Variable) -> &str {
        match variable {
            Variable::State(state) => &self.model.states[state].name,
            Variable::Input(input) => &self.model.inputs[at(input)].name,
            Variable::Algebraic(algebraic) => &self.model.algebraics[at(algebraic)].name,
        }
    }

    fn place(&self, variable: Variable) -> Span {
        match variable {
            Variable::State(state) => self.model.states[state].span,
            Variable::Input(input) => self.model.inputs[at(input)].span,
            Variable::Algebraic(algebraic) => self.model.algebraics[at(algebraic)].span,
        }
    }

    fn is_held(&self, variable: Variable) -> bool {
        match variable {
            Variable::Input(_) => true,
            Variable::State(state) => is_held(&self.model.states[state]),
            Variable::Algebraic(algebraic) => self.held[at(algebraic)],
        }
    }

    fn is_ahead(&self, variable: Variable) -> bool {
        match variable {
            Variable::Input(_) => false,
            Variable::State(state) => is_ahead(&self.model.states[state]),
            Variable::Algebraic(algebraic) => self.ahead[at(algebraic)],
        }
    }

    /// Whether a variable is at the beginning of a step what it was at the end of the one before.
    fn is_steady(&self, variable: Variable) -> bool {
        match variable {
            Variable::Input(_) => true,
            Variable::State(state) => self.model.states[state].jump.is_none(),
            Variable::Algebraic(algebraic) => self.steady[at(algebraic)],
        }
    }

    /// What stands at the end of a step for a variable on a side.
    fn at_end(&mut self, variable: Variable, side: Side) -> Variable {
        if side == Side::Before || matches!(variable, Variable::Input(_)) {
            return variable;
        }
        if let Some(known) = self.twins.get(&(variable, side)) {
            return *known;
        }
        let twin = match (variable, side) {
            (Variable::Algebraic(algebraic), _) => {
                let expr = &self.model.algebraics[at(algebraic)].expr;
                let moved = self.expr(expr, side);
                if moved == *expr { variable } else { self.quantity(variable, side, moved) }
            }
            (Variable::State(state), Side::Middle) => self.middle(state),
            (Variable::State(state), _) => match self.delays.get(&state).copied() {
                Some(delay) => self.next(delay),
                None => match self.model.states[state].jump_of(self.model.step) {
                    Some(jump) => self.quantity(variable, side, Expr::sum(vec![of(variable), jump])),
                    None => variable,
                },
            },
            (Variable::Input(_), _) => variable,
        };
        self.twins.insert((variable, side), twin);
        twin
    }

    fn expr(&mut self, expr: &Expr, side: Side) -> Expr {
        let mut read = Vec::new();
        expr.each_variable(&mut |variable| read.push(variable));
        read.sort_unstable();
        read.dedup();
        let stand: BTreeMap<Variable, Variable> =
            read.into_iter().map(|variable| (variable, self.at_end(variable, side))).collect();
        expr.renamed(&|variable| stand[&variable])
    }

    /// A state in the middle of the step that ends: on the cubic through both ends that has the derivatives there.
    fn middle(&mut self, state: StateId) -> Variable {
        let own = &self.model.states[state];
        let variable = Variable::State(state);
        if let Some(Delay { of, steps }) = self.delays.get(&state).copied() {
            return match self.is_held(of) || self.is_ahead(of) {
                true => variable,
                false => Variable::State(self.row(of, Side::Middle, steps)),
            };
        }
        let behind = self.at_end(variable, Side::Behind);
        let start = self.word(format!("{}.start", own.name), own.span, (of(behind), own.initial));
        if is_held(own) || is_ahead(own) {
            return Variable::State(start);
        }
        let mut terms = vec![Expr::scaled(0.5, word(start)), Expr::scaled(0.5, of(variable))];
        if !matches!(own.motion, Some(Motion::Line(_))) {
            let slope = self.expr(&own.derivative, Side::Behind);
            let initial = own.derivative.evaluate(&|variable| self.zero.number(variable));
            let before = self.word(format!("{}.slope", own.name), own.span, (slope, initial));
            let bulge = self.model.step / 8.0;
            terms.extend([Expr::scaled(bulge, word(before)), Expr::scaled(-bulge, own.derivative.clone())]);
        }
        self.quantity(variable, Side::Middle, Expr::sum(terms))
    }

    /// An algebraic variable that stands for a variable on a side.
    fn quantity(&mut self, variable: Variable, side: Side, expr: Expr) -> Variable {
        let what = if side == Side::Middle { "halfway" } else { "behind" };
        let name = self.free_name(format!("{}.{what}", self.name(variable)));
        let span = self.place(variable);
        let algebraic = Algebraic { name, unit: None, expr, range: None, kept: false, angle: false, span };
        self.written.algebraics.push(algebraic);
        Variable::Algebraic(index::number(self.written.algebraics.len()) - 1)
    }
}
