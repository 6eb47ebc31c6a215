//! The pass that writes angles out: in the model they are states that count turns, and what equations read of them are
//! sines, cosines and principal values of sums of them.
//!
//! An expression is either a plain number or an angle: a sum of whole multiples of angles, and the rest, which is plain. An
//! angle times a number that is not whole would jump where a turn is dropped, so it is no number.

use crate::report::Report;
use pe_ir::codes;
use pe_ir::index::{StateId, at, number};
use pe_ir::model::{Algebraic, Expr, Function, Model, State, Variable};
use pe_ir::source::{Diagnostic, Span};
use pe_ir::turns::{self, MOST_MULTIPLES, RADIANS, REACH};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Part of a multiple that may be missing for it to count as whole: what rounding makes of a turn and back.
const ROUNDING: f64 = 1e-12;

/// The range of a principal value.
const PRINCIPAL: (f64, f64) = (-0.5 * RADIANS, 0.5 * RADIANS);

/// Writes out the angles of a model; none if one is used as a number.
pub(crate) fn write_out(mut model: Model, report: &mut Report) -> Option<Model> {
    let wrapped = model.algebraics.iter().any(|own| wraps(&own.expr))
        || model.states.iter().flat_map(State::equations).any(wraps);
    if !model.has_angles() && !wrapped {
        return Some(model);
    }
    let outputs: Vec<Variable> = model.outputs.iter().map(|output| output.variable).collect();
    let mut writer = Writer {
        angles: model.states.iter().map(|state| state.angle).collect(),
        names: model.states.iter().map(|state| state.name.clone()).collect(),
        numbers: Vec::new(),
        algebraics: Vec::new(),
        sums: BTreeMap::new(),
        span: Span::default(),
        wrong: Vec::new(),
    };
    for (index, algebraic) in std::mem::take(&mut model.algebraics).into_iter().enumerate() {
        writer.algebraic(algebraic, outputs.contains(&Variable::Algebraic(number(index))));
    }
    let mut equations = Vec::with_capacity(model.states.len());
    for state in &model.states {
        writer.span = state.span;
        let derivative = writer.plain(&state.derivative);
        let derivative = if state.angle { Expr::scaled(1.0 / RADIANS, derivative) } else { derivative };
        equations.push((derivative, state.jump.as_ref().map(|jump| writer.plain(jump))));
    }
    for (state, equations) in model.states.iter_mut().zip(equations) {
        (state.derivative, state.jump) = equations;
    }
    for output in &mut model.outputs {
        match output.variable {
            Variable::Algebraic(algebraic) => output.variable = writer.numbers[at(algebraic)].variable(),
            Variable::State(state) if writer.angles[state.index()] => {
                let own = &model.states[state];
                let (name, unit, range) = (own.name.clone(), own.unit.clone(), Some(PRINCIPAL));
                let expr = writer.principal(&Angle::of(state));
                output.variable =
                    writer.push(Algebraic { name, unit, expr, range, kept: false, angle: true, span: own.span });
            }
            _ => {}
        }
    }
    if let Some(mechanism) = &mut model.mechanism {
        Arc::make_mut(mechanism).each_variable_mut(&mut |variable| {
            if let Variable::Algebraic(algebraic) = variable
                && let Place::Plain(plain) = writer.numbers[at(*algebraic)]
            {
                *algebraic = plain;
            }
        });
    }
    let failed = !writer.wrong.is_empty();
    writer.wrong.into_iter().for_each(|finding| report.push(finding));
    model.algebraics = writer.algebraics;
    for state in model.states.iter_mut().filter(|state| state.angle) {
        state.name += ".turns";
        state.unit = Some("turn".to_owned());
        state.initial = turns::principal(state.initial / RADIANS, 1.0);
        state.range = Some((-REACH, REACH));
    }
    model.share_systems();
    (!failed).then_some(model)
}

/// Whether an expression has a principal value in it.
fn wraps(expr: &Expr) -> bool {
    match expr {
        Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => false,
        Expr::Sum(members) | Expr::Product(members) => members.iter().any(wraps),
        Expr::Apply(Function::Wrap, _) => true,
        Expr::Power(base, _) | Expr::Apply(_, base) => wraps(base),
        Expr::Select(select) => [&select.condition, &select.yes, &select.no].into_iter().any(wraps),
    }
}

/// An angle in radians: multiples of states that are angles, and a plain rest.
#[derive(Clone, Debug)]
struct Angle {
    multiples: BTreeMap<StateId, f64>,
    rest: Expr,
}

impl Angle {
    fn of(state: StateId) -> Angle {
        Angle { multiples: BTreeMap::from([(state, 1.0)]), rest: Expr::Constant(0.0) }
    }

    fn scaled(self, factor: f64) -> Angle {
        let multiples = self.multiples.into_iter().map(|(state, multiple)| (state, factor * multiple)).collect();
        Angle { multiples, rest: Expr::scaled(factor, self.rest) }
    }

    /// Its multiples, if they are whole; those that cancel are gone.
    fn whole(&self) -> Option<BTreeMap<StateId, i64>> {
        let mut whole = BTreeMap::new();
        for (state, multiple) in &self.multiples {
            let nearest = libm::round(*multiple);
            if (multiple - nearest).abs() > ROUNDING * nearest.abs().max(1.0) || nearest.abs() > MOST_MULTIPLES as f64 {
                return None;
            }
            if nearest != 0.0 {
                whole.insert(*state, nearest as i64);
            }
        }
        (whole.values().map(|multiple| multiple.abs()).sum::<i64>() <= MOST_MULTIPLES).then_some(whole)
    }
}

/// What an expression is.
enum Value {
    Plain(Expr),
    Angle(Angle),
}

/// What an algebraic equation of the spec has become.
#[derive(Clone, Debug)]
enum Place {
    Plain(u32),
    /// An angle, put in place where it is read; with its number if it is an output.
    Angle(Angle, Option<u32>),
}

impl Place {
    /// The variable that an output shows.
    fn variable(&self) -> Variable {
        match self {
            Place::Plain(number) | Place::Angle(_, Some(number)) => Variable::Algebraic(*number),
            Place::Angle(_, None) => unreachable!("outputs are kept"),
        }
    }
}

struct Writer {
    /// For each state whether it is an angle, and its name in the spec.
    angles: Vec<bool>,
    names: Vec<String>,
    /// What the algebraic equations of the spec so far have become.
    numbers: Vec<Place>,
    /// The equations of the model so far.
    algebraics: Vec<Algebraic>,
    /// Sums of several angles, in turns, that have an equation.
    sums: BTreeMap<Vec<(StateId, i64)>, u32>,
    /// The equation that is being written.
    span: Span,
    wrong: Vec<Diagnostic>,
}

impl Writer {
    fn push(&mut self, algebraic: Algebraic) -> Variable {
        self.algebraics.push(algebraic);
        Variable::Algebraic(number(self.algebraics.len()) - 1)
    }

    fn algebraic(&mut self, algebraic: Algebraic, is_output: bool) {
        self.span = algebraic.span;
        let place = match self.value(&algebraic.expr) {
            Value::Plain(expr) => {
                self.push(Algebraic { expr, ..algebraic });
                Place::Plain(number(self.algebraics.len()) - 1)
            }
            Value::Angle(angle) => {
                let own = is_output.then(|| {
                    let expr = self.principal(&angle);
                    self.push(Algebraic { expr, angle: true, range: Some(PRINCIPAL), ..algebraic });
                    number(self.algebraics.len()) - 1
                });
                Place::Angle(angle, own)
            }
        };
        self.numbers.push(place);
    }

    /// An angle where a number is asked for.
    fn misused(&mut self, angle: &Angle, why: &str, help: String) -> Expr {
        let name = angle.multiples.keys().next().map_or("", |state| &self.names[state.index()]);
        let message = format!("`{name}` is an angle, {why}");
        self.wrong.push(Diagnostic::error(codes::ANGLE_AS_NUMBER, self.span, message).with_help(help));
        Expr::Constant(0.0)
    }

    /// An expression that has to be a number.
    fn plain(&mut self, expr: &Expr) -> Expr {
        match self.value(expr) {
            Value::Plain(expr) => expr,
            Value::Angle(angle) => {
                let name = angle.multiples.keys().next().map_or("x", |state| &self.names[state.index()]);
                let help = format!(
                    "equations read it by `sin`, `cos` and `wrap`: `wrap({name})` is its value from -pi to pi, which jumps there"
                );
                self.misused(&angle, "which is the same a turn further, and stands here as a number", help)
            }
        }
    }

    fn value(&mut self, expr: &Expr) -> Value {
        match expr {
            Expr::Constant(_) => Value::Plain(expr.clone()),
            Expr::Variable(Variable::State(state)) if self.angles.get(state.index()) == Some(&true) => {
                Value::Angle(Angle::of(*state))
            }
            Expr::Variable(Variable::Algebraic(algebraic)) => match &self.numbers[at(*algebraic)] {
                Place::Plain(number) => Value::Plain(Expr::Variable(Variable::Algebraic(*number))),
                Place::Angle(angle, _) => Value::Angle(angle.clone()),
            },
            Expr::Variable(_) => Value::Plain(expr.clone()),
            Expr::Sum(members) => self.sum(members),
            Expr::Product(members) => self.product(members),
            Expr::Power(base, exponent) => Value::Plain(Expr::power(self.plain(base), *exponent)),
            Expr::Apply(function @ (Function::Sin | Function::Cos), argument) => match self.value(argument) {
                Value::Plain(argument) => Value::Plain(Expr::Apply(*function, Box::new(argument))),
                Value::Angle(angle) => Value::Plain(self.periodic(*function, &angle)),
            },
            Expr::Apply(Function::Wrap, argument) => match self.value(argument) {
                Value::Plain(_) => {
                    let message = "`wrap` is asked for the principal value of what is no angle";
                    let help = "declare the variable as an `angle` in place of a `state`";
                    let finding = Diagnostic::error(codes::ANGLE_AS_NUMBER, self.span, message);
                    self.wrong.push(finding.with_help(help));
                    Value::Plain(Expr::Constant(0.0))
                }
                Value::Angle(angle) => {
                    let principal = self.principal(&angle.scaled(RADIANS));
                    Value::Plain(Expr::scaled(1.0 / RADIANS, principal))
                }
            },
            Expr::Apply(function, argument) => Value::Plain(Expr::Apply(*function, Box::new(self.plain(argument)))),
            Expr::Select(select) => {
                let mut select = select.clone();
                for part in [&mut select.condition, &mut select.yes, &mut select.no] {
                    *part = self.plain(part);
                }
                Value::Plain(Expr::Select(select))
            }
            Expr::Solution(_) => {
                let mut read = Vec::new();
                expr.each_variable(&mut |variable| read.push(variable));
                for variable in read {
                    self.plain(&Expr::Variable(variable));
                }
                let numbers = &self.numbers;
                Value::Plain(expr.renamed(&|variable| match variable {
                    Variable::Algebraic(algebraic) => match numbers[at(algebraic)] {
                        Place::Plain(number) => Variable::Algebraic(number),
                        Place::Angle(..) => variable,
                    },
                    variable => variable,
                }))
            }
        }
    }

    fn sum(&mut self, members: &[Expr]) -> Value {
        let mut all: Option<BTreeMap<StateId, f64>> = None;
        let mut rest = Vec::with_capacity(members.len());
        for member in members {
            match self.value(member) {
                Value::Plain(expr) => rest.push(expr),
                Value::Angle(angle) => {
                    let all = all.get_or_insert_default();
                    for (state, multiple) in angle.multiples {
                        *all.entry(state).or_default() += multiple;
                    }
                    rest.push(angle.rest);
                }
            }
        }
        let rest = Expr::sum(rest);
        match all {
            None => Value::Plain(rest),
            Some(multiples) => Value::Angle(Angle { multiples, rest }),
        }
    }

    /// A number times an angle is an angle; anything else times an angle is asked for as a number.
    fn product(&mut self, members: &[Expr]) -> Value {
        let values: Vec<Value> = members.iter().map(|member| self.value(member)).collect();
        let constant = |value: &Value| match value {
            Value::Plain(expr) => expr.as_constant(),
            Value::Angle(_) => None,
        };
        let factor: f64 = values.iter().filter_map(constant).product();
        let mut others: Vec<Value> = values.into_iter().filter(|value| constant(value).is_none()).collect();
        if let [Value::Angle(_)] = others[..]
            && let Some(Value::Angle(angle)) = others.pop()
        {
            return Value::Angle(angle.scaled(factor));
        }
        let mut factors = vec![Expr::Constant(factor)];
        for other in others {
            factors.push(match other {
                Value::Plain(expr) => expr,
                Value::Angle(angle) => {
                    let help = "`wrap(x)` is its value from -pi to pi, which jumps there; `sin(x)` does not jump";
                    self.misused(&angle, "which is the same a turn further, and is multiplied here", help.to_owned())
                }
            });
        }
        Value::Plain(Expr::product(factors))
    }

    /// The sum of an angle's states in turns: a variable, and what it is multiplied by. None if multiples are not whole.
    fn turns(&mut self, angle: &Angle) -> Option<(Expr, f64)> {
        let Some(whole) = angle.whole() else {
            let why = "and part of it, or more than eight times it, jumps where a turn is dropped";
            let help = format!(
                "angles add up in whole multiples, at most {MOST_MULTIPLES} in all; integrate the other angle as a state of its own"
            );
            self.misused(angle, why, help);
            return None;
        };
        let all: Vec<(StateId, i64)> = whole.into_iter().collect();
        match all[..] {
            [] => return Some((Expr::Constant(0.0), 1.0)),
            [(state, multiple)] => return Some((Expr::Variable(Variable::State(state)), multiple as f64)),
            _ => {}
        }
        if let Some(known) = self.sums.get(&all) {
            return Some((Expr::Variable(Variable::Algebraic(*known)), 1.0));
        }
        let term = |(state, multiple): &(StateId, i64)| {
            Expr::scaled(*multiple as f64, Expr::Variable(Variable::State(*state)))
        };
        let expr = Expr::sum(all.iter().map(term).collect());
        let mut name = String::new();
        for (state, multiple) in &all {
            let sign = if *multiple < 0 { "-" } else { "+" };
            name += if name.is_empty() && *multiple > 0 { "" } else { sign };
            if multiple.abs() > 1 {
                name += &format!("{}*", multiple.abs());
            }
            name += &self.names[state.index()];
        }
        name += ".turns";
        let reach = REACH * all.iter().map(|(_, multiple)| multiple.abs()).sum::<i64>() as f64;
        let (unit, range) = (Some("turn".to_owned()), Some((-reach, reach)));
        let variable = self.push(Algebraic { name, unit, expr, range, kept: false, angle: false, span: self.span });
        self.sums.insert(all, number(self.algebraics.len()) - 1);
        Some((Expr::Variable(variable), 1.0))
    }

    /// Sine or cosine of an angle. A rest that varies is taken apart by the addition theorems, so that the arguments of
    /// functions of angles are known whatever a run does.
    fn periodic(&mut self, function: Function, angle: &Angle) -> Expr {
        let Some((turns, multiple)) = self.turns(angle) else { return Expr::Constant(0.0) };
        let whole = Expr::scaled(multiple * RADIANS, turns);
        let apply = |function, argument: &Expr| match argument.as_constant() {
            Some(number) => Expr::Constant(Function::evaluate(function, number)),
            None => Expr::Apply(function, Box::new(argument.clone())),
        };
        let rest = &angle.rest;
        if rest.as_constant().is_some() || whole.as_constant().is_some() {
            return apply(function, &Expr::sum(vec![whole, rest.clone()]));
        }
        let [sine, cosine] = [Function::Sin, Function::Cos].map(|function| apply(function, &whole));
        let [rest_sine, rest_cosine] = [Function::Sin, Function::Cos].map(|function| apply(function, rest));
        match function {
            Function::Sin => {
                Expr::sum(vec![Expr::product(vec![sine, rest_cosine]), Expr::product(vec![cosine, rest_sine])])
            }
            _ => {
                let second = Expr::product(vec![Expr::Constant(-1.0), sine, rest_sine]);
                Expr::sum(vec![Expr::product(vec![cosine, rest_cosine]), second])
            }
        }
    }

    /// The principal value of an angle in radians.
    fn principal(&mut self, angle: &Angle) -> Expr {
        let Some((turns, multiple)) = self.turns(angle) else { return Expr::Constant(0.0) };
        let Some(rest) = angle.rest.as_constant() else {
            let help = "give the whole sum an `angle` of its own, or wrap the angles alone".to_owned();
            return self.misused(angle, "whose principal value is asked for together with a variable", help);
        };
        let argument = Expr::sum(vec![Expr::scaled(multiple, turns), Expr::Constant(rest / RADIANS)]);
        match argument.as_constant() {
            Some(number) => Expr::Constant(turns::principal(number, 1.0) * RADIANS),
            None => Expr::scaled(RADIANS, Expr::Apply(Function::Wrap, Box::new(argument))),
        }
    }
}
