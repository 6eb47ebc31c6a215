//! Lifting: makes all equations of a model polynomial, except algebraic equations that are functions of one variable.
//!
//! Every largest part of an equation that reads one variable and is no polynomial becomes an algebraic equation of its
//! own, named after its text; equal parts share one. A function of several variables gets its argument as an equation
//! first. `if` on several variables becomes a step function times the difference of its branches. A function has at
//! most one kink or jump, for a table can hold it exactly only between two segments: where there are more, the parts
//! with a kink become functions of their own. Lifting a lifted model changes nothing.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use pe_ir::index;
use pe_ir::model::{Algebraic, Expr, Function, Model, Select, State, Variable};
use pe_ir::source::Span;

use crate::kinks::{affine, half_turns, root};

/// Most kinks and jumps of a function.
pub(crate) const MOST_KINKS: usize = 1;

/// Characters of an expression that its name keeps.
const LONGEST_NAME: usize = 60;

/// Lifts all functions of a model. Its algebraic equations get other numbers; all else stays as it is.
pub fn lift(model: Model) -> Model {
    let all = model.algebraics.iter().map(|algebraic| &algebraic.expr);
    if all.chain(model.states.iter().flat_map(State::equations)).all(Expr::is_polynomial) {
        return model;
    }
    let named = model.states.iter().map(|state| &state.name).chain(model.inputs.iter().map(|input| &input.name));
    let mut lifter = Lifter {
        numbers: Vec::with_capacity(model.algebraics.len()),
        algebraics: Vec::with_capacity(model.algebraics.len()),
        known: HashMap::new(),
        made: BTreeSet::new(),
        taken: named.chain(model.algebraics.iter().map(|algebraic| &algebraic.name)).cloned().collect(),
        span: Span::default(),
        model: &model,
    };
    for algebraic in &model.algebraics {
        lifter.span = algebraic.span;
        let part = lifter.part(&algebraic.expr);
        let number = index::number(lifter.algebraics.len());
        if !part.polynomial {
            lifter.known.entry(key(&part.expr)).or_insert(number);
        }
        lifter.numbers.push(number);
        lifter.algebraics.push(Algebraic { expr: part.expr, ..algebraic.clone() });
    }
    let mut equations = Vec::with_capacity(model.states.len());
    for state in &model.states {
        lifter.span = state.span;
        let equation = |expr: &Expr| {
            let part = lifter.part(expr);
            lifter.lifted(part)
        };
        equations.push(state.equations().map(equation).collect::<Vec<_>>());
    }
    let Lifter { numbers, algebraics, .. } = lifter;
    let mut model = Model { algebraics, ..model };
    for (state, equations) in model.states.iter_mut().zip(equations) {
        state.equations_mut().zip(equations).for_each(|(own, equation)| *own = equation);
    }
    let renumber = |variable: &mut Variable| {
        if let Variable::Algebraic(number) = variable {
            *number = numbers[index::at(*number)];
        }
    };
    model.outputs.iter_mut().for_each(|output| renumber(&mut output.variable));
    if let Some(mechanism) = &mut model.mechanism {
        Arc::make_mut(mechanism).each_variable_mut(&mut { renumber });
    }
    model.share_systems();
    model
}

/// What an expression reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reads {
    Nothing,
    One(Variable),
    Many,
}

impl Reads {
    pub(crate) fn with(self, other: Reads) -> Reads {
        match (self, other) {
            (Reads::Nothing, reads) | (reads, Reads::Nothing) => reads,
            (Reads::One(a), Reads::One(b)) if a == b => self,
            _ => Reads::Many,
        }
    }

    fn of(expr: &Expr) -> Reads {
        let mut reads = Reads::Nothing;
        expr.each_variable(&mut |variable| reads = reads.with(Reads::One(variable)));
        reads
    }
}

/// An expression over the variables of the lifted model: a polynomial, or a function of one variable.
#[derive(Clone, Debug)]
struct Part {
    expr: Expr,
    reads: Reads,
    polynomial: bool,
    /// Where it has a kink or jumps, in ascending order.
    kinks: Vec<f64>,
}

impl Part {
    fn polynomial(expr: Expr) -> Part {
        Part { reads: Reads::of(&expr), expr, polynomial: true, kinks: Vec::new() }
    }
}

/// The kinks of several parts.
fn all_kinks<'a>(parts: impl IntoIterator<Item = &'a Part>) -> Vec<f64> {
    let mut kinks: Vec<f64> = parts.into_iter().flat_map(|part| part.kinks.iter().copied()).collect();
    kinks.sort_unstable_by(f64::total_cmp);
    kinks.dedup();
    kinks
}

/// What tells equal expressions from others.
fn key(expr: &Expr) -> String {
    format!("{expr:?}")
}

struct Lifter<'a> {
    model: &'a Model,
    /// New numbers of the algebraic equations so far.
    numbers: Vec<u32>,
    algebraics: Vec<Algebraic>,
    /// Algebraic equations that are functions or arguments, by their expressions.
    known: HashMap<String, u32>,
    /// Those of them that are not in the spec.
    made: BTreeSet<u32>,
    /// Names in use.
    taken: BTreeSet<String>,
    /// The equation of the spec that is being lifted.
    span: Span,
}

impl Lifter<'_> {
    /// An expression of the model as a part.
    fn part(&mut self, expr: &Expr) -> Part {
        match expr {
            Expr::Constant(_) => Part::polynomial(expr.clone()),
            Expr::Variable(variable) => {
                let variable = self.renumbered(*variable);
                Part::polynomial(self.constant(variable).map_or(Expr::Variable(variable), Expr::Constant))
            }
            Expr::Sum(members) => {
                let parts = members.iter().map(|member| self.part(member)).collect();
                self.joined(parts, Expr::sum, false)
            }
            Expr::Product(members) => {
                let parts = members.iter().map(|member| self.part(member)).collect();
                self.joined(parts, Expr::product, true)
            }
            Expr::Power(base, exponent) => {
                let base = self.part(base);
                Part { expr: Expr::power(base.expr, *exponent), ..base }
            }
            Expr::Apply(function, argument) => {
                let part = match **argument {
                    Expr::Variable(variable) if self.has_no_value(*function, variable) => {
                        Part::polynomial(Expr::Variable(self.renumbered(variable)))
                    }
                    _ => self.part(argument),
                };
                self.apply(*function, part)
            }
            Expr::Select(select) => self.select(select),
            // The whole of an equation, of variables and numbers alone.
            Expr::Solution(_) => Part::polynomial(expr.renamed(&|variable| self.renumbered(variable))),
        }
    }

    fn renumbered(&self, variable: Variable) -> Variable {
        match variable {
            Variable::Algebraic(number) => Variable::Algebraic(self.numbers[index::at(number)]),
            variable => variable,
        }
    }

    /// The number that a variable always is, whatever happens in a run: an equation of parameters alone.
    fn constant(&self, variable: Variable) -> Option<f64> {
        match variable {
            Variable::Algebraic(number) => match self.algebraics.get(index::at(number))?.expr {
                Expr::Constant(number) => Some(number),
                _ => None,
            },
            Variable::State(_) | Variable::Input(_) => None,
        }
    }

    /// Whether a function has no value for a variable that is always the same number.
    fn has_no_value(&self, function: Function, variable: Variable) -> bool {
        self.constant(self.renumbered(variable)).is_some_and(|number| !function.evaluate(number).is_finite())
    }

    /// A sum or product of parts. If they read several variables, those of one variable stay together, of a product
    /// with the polynomials of that variable.
    fn joined(&mut self, mut parts: Vec<Part>, join: fn(Vec<Expr>) -> Expr, product: bool) -> Part {
        let reads = parts.iter().fold(Reads::Nothing, |reads, part| reads.with(part.reads));
        let polynomial = parts.iter().all(|part| part.polynomial);
        let kinks = all_kinks(&parts);
        if polynomial || (reads != Reads::Many && kinks.len() <= MOST_KINKS) {
            return Part { expr: join(parts.into_iter().map(|part| part.expr).collect()), reads, polynomial, kinks };
        }
        for part in parts.iter_mut().filter(|part| kinks.len() > MOST_KINKS && !part.kinks.is_empty()) {
            let lifted = self.lifted(part.clone());
            *part = Part::polynomial(lifted);
        }
        let functions = parts.iter().filter(|part| !part.polynomial);
        let mut groups: BTreeMap<Variable, Vec<Part>> = functions
            .filter_map(|part| if let Reads::One(variable) = part.reads { Some((variable, Vec::new())) } else { None })
            .collect();
        let mut members = Vec::new();
        for part in parts {
            let group = match part.reads {
                Reads::One(variable) if product || !part.polynomial => groups.get_mut(&variable),
                _ => None,
            };
            match group {
                Some(group) => group.push(part),
                None => members.push(part.expr),
            }
        }
        for (variable, group) in groups {
            let kinks = all_kinks(&group);
            let expr = join(group.into_iter().map(|part| part.expr).collect());
            let whole = Part { polynomial: false, expr, reads: Reads::One(variable), kinks };
            members.push(self.lifted(whole));
        }
        Part::polynomial(join(members))
    }

    fn apply(&mut self, function: Function, argument: Part) -> Part {
        let number = if let Expr::Constant(number) = argument.expr { Some(number) } else { None };
        if let Some(value) = number.map(|number| function.evaluate(number)).filter(|value| value.is_finite()) {
            return Part::polynomial(Expr::Constant(value));
        }
        if let Some(sign) = parity(function).filter(|_| begins_negative(&argument.expr)) {
            let part = self.apply(function, Part { expr: negated(&argument.expr), ..argument });
            return Part { expr: Expr::scaled(sign, part.expr), ..part };
        }
        // What has no value there is a variable, so that the run finds it and names it.
        let argument = if number.is_some() { Part::polynomial(self.named(argument)) } else { argument };
        let kinked = matches!(function, Function::Abs | Function::Sign | Function::Floor | Function::Wrap);
        // A table takes a jump with the value on its right, so what falls is an argument of its own.
        let falls = function == Function::Floor && affine(&argument.expr).is_some_and(|(slope, _)| slope < 0.0);
        let argument = if argument.reads == Reads::Many || falls || (kinked && affine(&argument.expr).is_none()) {
            Part::polynomial(self.named(argument))
        } else {
            argument
        };
        let mut kinks = argument.kinks;
        match function {
            Function::Wrap => kinks.extend(half_turns(&argument.expr)),
            _ if kinked => kinks.extend(root(&argument.expr)),
            _ => {}
        }
        let expr = Expr::Apply(function, Box::new(argument.expr));
        let part = Part { expr, reads: argument.reads, polynomial: false, kinks };
        // As many jumps as whole numbers are more than a table takes beside anything else.
        if function == Function::Floor { Part::polynomial(self.lifted(part)) } else { part }
    }

    fn select(&mut self, select: &Select) -> Part {
        let condition = self.part(&select.condition);
        if let Expr::Constant(number) = condition.expr {
            return self.part(if number > 0.0 { &select.yes } else { &select.no });
        }
        let lifted = condition.reads == Reads::Many;
        let condition = match affine(&condition.expr) {
            Some(_) if !lifted => condition,
            _ => Part::polynomial(self.named(condition)),
        };
        let kink = root(&condition.expr);
        if let Reads::One(variable) = condition.reads {
            // What the condition compares may stand in the branches as well, as in `if x > y then log(x - y) else 0`.
            let within = |branch: &Expr| match lifted {
                true => Reads::of(&replaced(branch, &select.condition, &Expr::Constant(0.0))) == Reads::Nothing,
                false => [Reads::Nothing, Reads::One(variable)].contains(&self.reads_renumbered(branch)),
            };
            if within(&select.yes) && within(&select.no) {
                let mut branch = |branch: &Expr| match lifted {
                    true => {
                        let place = Expr::Variable(variable);
                        self.kept(&replaced(branch, &select.condition, &place), variable)
                    }
                    false => self.part(branch),
                };
                let (yes, no) = (branch(&select.yes), branch(&select.no));
                let mut kinks = all_kinks([&yes, &no]);
                kinks.extend(kink.filter(|kink| !kinks.contains(kink)));
                kinks.sort_unstable_by(f64::total_cmp);
                let one = |part: &Part| [Reads::Nothing, Reads::One(variable)].contains(&part.reads);
                if one(&yes) && one(&no) && kinks.len() <= MOST_KINKS {
                    let choice = Select { condition: condition.expr, yes: yes.expr, no: no.expr };
                    let expr = Expr::Select(Box::new(choice));
                    return Part { expr, reads: Reads::One(variable), polynomial: false, kinks };
                }
                return self.blended(condition.expr, kink, yes, no);
            }
        }
        let step = self.step(condition.expr.clone(), kink);
        let yes = self.guarded(&select.yes, &step);
        let not = Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, step)]);
        let no = self.guarded(&select.no, &not);
        self.blended(condition.expr, kink, yes, no)
    }

    /// What an expression of the model reads, in the numbers of the lifted model.
    fn reads_renumbered(&self, expr: &Expr) -> Reads {
        let mut reads = Reads::Nothing;
        expr.each_variable(&mut |variable| {
            let variable = self.renumbered(variable);
            if self.constant(variable).is_none() {
                reads = reads.with(Reads::One(variable));
            }
        });
        reads
    }

    /// A part whose only variable has the number of the lifted model already.
    fn kept(&mut self, expr: &Expr, variable: Variable) -> Part {
        let Variable::Algebraic(number) = variable else { return self.part(expr) };
        let numbers = std::mem::replace(&mut self.numbers, (0..=number).collect());
        let part = self.part(expr);
        self.numbers = numbers;
        part
    }

    /// 1 where the condition is above zero, else 0.
    fn step(&mut self, condition: Expr, kink: Option<f64>) -> Expr {
        let reads = Reads::of(&condition);
        let choice = Select { condition, yes: Expr::Constant(1.0), no: Expr::Constant(0.0) };
        self.named(Part {
            expr: Expr::Select(Box::new(choice)),
            reads,
            polynomial: false,
            kinks: kink.into_iter().collect(),
        })
    }

    /// `no + step*(yes - no)`.
    fn blended(&mut self, condition: Expr, kink: Option<f64>, yes: Part, no: Part) -> Part {
        let step = self.step(condition, kink);
        let (yes, no) = (self.lifted(yes), self.lifted(no));
        let difference = Expr::sum(vec![yes, Expr::scaled(-1.0, no.clone())]);
        Part::polynomial(Expr::sum(vec![no, Expr::product(vec![step, difference])]))
    }

    /// A branch of a choice that is computed whether it is taken or not: where `taken` is 0, functions that are not
    /// defined everywhere get an argument for which they are.
    fn guarded(&mut self, branch: &Expr, taken: &Expr) -> Part {
        match branch {
            Expr::Sum(members) => {
                let parts = members.iter().map(|member| self.guarded(member, taken)).collect();
                self.joined(parts, Expr::sum, false)
            }
            Expr::Product(members) => {
                let parts = members.iter().map(|member| self.guarded(member, taken)).collect();
                self.joined(parts, Expr::product, true)
            }
            Expr::Power(base, exponent) => {
                let base = self.guarded(base, taken);
                Part { expr: Expr::power(base.expr, *exponent), ..base }
            }
            Expr::Apply(function, argument) => {
                let argument = self.guarded(argument, taken);
                let safe = match function {
                    Function::Reciprocal | Function::RealPower(_) | Function::Sqrt | Function::Log => 1.0,
                    Function::Asin | Function::Acos => 0.0,
                    _ => return self.apply(*function, argument),
                };
                let distance = Expr::sum(vec![self.lifted(argument), Expr::Constant(-safe)]);
                let moved = Expr::product(vec![taken.clone(), distance]);
                self.apply(*function, Part::polynomial(Expr::sum(vec![Expr::Constant(safe), moved])))
            }
            Expr::Select(_) | Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => self.part(branch),
        }
    }

    /// A part as a polynomial: functions become variables, their coefficients stay outside so that more are equal.
    fn lifted(&mut self, part: Part) -> Expr {
        if part.polynomial {
            return part.expr;
        }
        match &part.expr {
            Expr::Product(members) => match members[0] {
                Expr::Constant(coefficient) => {
                    let rest = Part { expr: Expr::product(members[1..].to_vec()), ..part };
                    Expr::scaled(coefficient, self.named(rest))
                }
                _ => self.named(part),
            },
            _ => self.named(part),
        }
    }

    /// The variable of the algebraic equation for a part.
    fn named(&mut self, part: Part) -> Expr {
        if let Expr::Variable(_) = part.expr {
            return part.expr;
        }
        let next = index::number(self.algebraics.len());
        let number = *self.known.entry(key(&part.expr)).or_insert(next);
        if number == next {
            let name = self.name(&part.expr);
            let Part { expr, .. } = part;
            self.made.insert(number);
            self.algebraics.push(Algebraic {
                name,
                unit: None,
                expr,
                range: None,
                kept: false,
                angle: false,
                span: self.span,
            });
        }
        Expr::Variable(Variable::Algebraic(number))
    }

    /// A name that no other variable has.
    fn name(&mut self, expr: &Expr) -> String {
        let mut text = expr.text(&|variable, rank| match variable {
            Variable::State(number) => self.model.states[number].name.clone(),
            Variable::Input(number) => self.model.inputs[index::at(number)].name.clone(),
            Variable::Algebraic(number) => {
                let Algebraic { name, expr, .. } = &self.algebraics[index::at(number)];
                // The name of what was lifted is its text.
                let loose = self.made.contains(&number) && expr.rank() < rank;
                if loose { format!("({name})") } else { name.clone() }
            }
        });
        if let Some((end, _)) = text.char_indices().nth(LONGEST_NAME) {
            text.truncate(end);
            text += "..";
        }
        let mut name = text.clone();
        let mut serial = 2;
        while !self.taken.insert(name.clone()) {
            name = format!("{text}~{serial}");
            serial += 1;
        }
        name
    }
}

/// What a function of a negated argument is over that of the argument itself: -1 of odd functions, 1 of even ones.
fn parity(function: Function) -> Option<f64> {
    match function {
        Function::Sin | Function::Tan | Function::Asin | Function::Atan | Function::Sinh | Function::Tanh => Some(-1.0),
        Function::Cos | Function::Cosh | Function::Abs => Some(1.0),
        _ => None,
    }
}

/// Whether the first coefficient of an expression is negative: either an expression or the negated one begins so.
fn begins_negative(expr: &Expr) -> bool {
    match expr {
        Expr::Product(members) => matches!(members[0], Expr::Constant(number) if number < 0.0),
        Expr::Sum(members) => members.iter().find(|member| member.as_constant().is_none()).is_some_and(begins_negative),
        _ => false,
    }
}

fn negated(expr: &Expr) -> Expr {
    match expr {
        Expr::Sum(members) => Expr::sum(members.iter().map(negated).collect()),
        expr => Expr::scaled(-1.0, expr.clone()),
    }
}

/// An expression with another one in place of all its occurrences.
fn replaced(expr: &Expr, this: &Expr, by: &Expr) -> Expr {
    let again = |expr: &Expr| replaced(expr, this, by);
    match expr {
        expr if expr == this => by.clone(),
        Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => expr.clone(),
        Expr::Sum(members) => Expr::Sum(members.iter().map(again).collect()),
        Expr::Product(members) => Expr::Product(members.iter().map(again).collect()),
        Expr::Power(base, exponent) => Expr::Power(Box::new(again(base)), *exponent),
        Expr::Apply(function, argument) => Expr::Apply(*function, Box::new(again(argument))),
        Expr::Select(select) => Expr::Select(Box::new(Select {
            condition: again(&select.condition),
            yes: again(&select.yes),
            no: again(&select.no),
        })),
    }
}
