//! Checks the units of a spec, statement by statement and not element by element.
//!
//! A number written out has whatever unit its place asks for in a sum, and none in a product. A quantity without a unit
//! takes that of its definition.

use crate::arrays::algebra::visit;
use crate::bind::rows;
use crate::bound::MOST_NESTED_CALLS;
use crate::equations::events::priority;
use crate::language::functions;
use crate::language::measures::TIMES;
use crate::language::waveforms::{Argument, WAVEFORMS};
use crate::language::words::TIME;
use crate::names::table::{Kind, Names, Symbol};
use crate::report::Report;
use crate::syntax::ast::{Equation, Expr, ExprKind, Factor, LeftSide, Name, Range, Reference, Spec, StatementKind};
use crate::syntax::delay;
use crate::units::dimension::{Dimension, Units, shown_factor};
use crate::units::parse::{parse, place};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// Functions whose value has the unit of their arguments.
const SAME: [&str; 7] = ["floor", "ceil", "round", "abs", "min", "max", "mod"];

/// What to do about units of different dimensions.
const DIMENSION_HELP: &str = "check the equation; a number has the unit that is written behind it, as in `0.02 [mM]`";

/// Bodies of functions that are looked into; each call looks again, for its arguments have units of their own.
const MOST_CALLS: usize = 20_000;

/// What is known of the unit of an expression.
#[derive(Clone, Copy, Debug)]
enum Unit {
    /// A number written out, or made of such.
    Number,
    /// Something without a unit that may have any.
    Unknown,
    Known(Dimension),
}

use Unit::{Known, Number, Unknown};

/// A unit and the place that it comes from.
type Side = (Unit, Span);

/// What names mean inside of a function.
#[derive(Clone, Copy)]
struct Scope<'s> {
    parameters: &'s [(&'s str, Unit)],
    /// Whether findings are told, or the unit alone is wanted.
    told: bool,
    /// Functions that called one another to get here.
    depth: usize,
}

/// The top level of a statement.
const TOLD: Scope = Scope { parameters: &[], told: true, depth: 0 };

struct Checker<'c, 'a> {
    spec: &'a Spec,
    names: &'c mut Names<'a>,
    report: &'c mut Report,
    strict: bool,
    /// Unit of each quantity; `None` until known.
    units: Vec<Option<Unit>>,
    /// Units that the spec names, to show others by.
    named: Vec<(&'a str, Dimension)>,
    /// Calls of functions that may still be looked into.
    calls: usize,
    /// Sums over rows of data files that an expression stands in: the name of a row, and the file.
    rows: Vec<(&'a str, &'a Name)>,
}

/// Checks all units. An algebraic quantity takes the first unit that is written at one of its equations.
pub(crate) fn check<'a>(spec: &'a Spec, names: &mut Names<'a>, report: &mut Report, mode: Units) {
    if mode == Units::Off {
        return;
    }
    let units = vec![None; names.quantities.len()];
    let strict = mode == Units::Strict;
    let mut checker =
        Checker { spec, names, report, strict, units, named: Vec::new(), calls: MOST_CALLS, rows: Vec::new() };
    checker.declared();
    // A spec without any unit is a system of numbers, its time is one, too.
    if checker.named.is_empty() && !spec.measured && !rows_have_units(spec) {
        return;
    }
    checker.infer();
    checker.statements();
}

/// Whether an equation sums over rows of a file whose header names a unit.
fn rows_have_units(spec: &Spec) -> bool {
    let mut found = false;
    let mut look = |part: &Expr| {
        if let ExprKind::SumOver { binder, .. } = &part.kind {
            let table = binder.rows.as_ref().and_then(|path| spec.table(path));
            found |= table.is_some_and(|table| table.columns.iter().any(|column| column.unit.is_some()));
        }
    };
    for statement in &spec.statements {
        if let StatementKind::Equation(equation) = &statement.kind {
            visit(&equation.value, &mut look);
        }
    }
    found
}

impl<'a> Checker<'_, 'a> {
    /// Reads the units that are written.
    fn declared(&mut self) {
        for number in 0..self.units.len() {
            let Some(unit) = self.names.quantities[number].unit else { continue };
            self.units[number] = Some(self.read(unit));
        }
        // An algebraic quantity may have its unit at several of its equations.
        for statement in &self.spec.statements {
            let StatementKind::Equation(Equation { target, unit: Some(unit), .. }) = &statement.kind else { continue };
            let Some(number) = self.names.quantity(&target.name.text) else { continue };
            let first = self.names.quantities[number].unit;
            match (self.units[number], first) {
                (None, _) => {
                    self.units[number] = Some(self.read(unit));
                    self.names.quantities[number].unit = Some(unit);
                }
                (Some(known), Some(first)) if first.span != unit.span => {
                    let again = self.read(unit);
                    self.same((known, first.span), (again, unit.span), TOLD);
                }
                _ => {}
            }
        }
    }

    fn read(&mut self, unit: &'a Name) -> Unit {
        self.text(&unit.text, unit.span)
    }

    /// Reads a unit that stands at a place, or in the header cell there.
    fn text(&mut self, text: &'a str, at: Span) -> Unit {
        match parse(text) {
            Ok(dimension) => {
                if !self.named.iter().any(|(_, known)| known.is(dimension)) {
                    self.named.push((text, dimension));
                }
                Known(dimension)
            }
            Err(error) => {
                let (code, span) = (
                    if self.strict { codes::UNKNOWN_UNIT } else { codes::UNREAD_UNIT },
                    if at.length() == text.len() { place(&error, at) } else { at },
                );
                let finding = Diagnostic { help: error.help, ..Diagnostic::error(code, span, error.message) };
                self.tell(finding);
                Unknown
            }
        }
    }

    fn tell(&mut self, finding: Diagnostic) {
        self.report.push(if self.strict { finding } else { finding.into_warning() });
    }

    /// Gives quantities without a unit that of their definition, in the order in which they read one another.
    fn infer(&mut self) {
        let mut definitions: Vec<Option<&'a Expr>> = vec![None; self.units.len()];
        for statement in &self.spec.statements {
            let (name, value) = match &statement.kind {
                StatementKind::Const { name, value } => (name, value),
                StatementKind::Param { declared, value } => (&declared.name, value),
                StatementKind::Equation(equation) if equation.side == LeftSide::Algebraic => {
                    (&equation.target.name, &equation.value)
                }
                _ => continue,
            };
            if let Some(number) = self.names.quantity(&name.text) {
                let kind = self.names.quantities[number].kind;
                let defines = matches!(kind, Kind::Const | Kind::Param | Kind::Algebraic);
                definitions[number] = definitions[number].or(defines.then_some(value));
            }
        }
        let mut begun = vec![false; self.units.len()];
        for first in 0..self.units.len() {
            let mut waiting = vec![first];
            while let Some(number) = waiting.last().copied() {
                let definition = definitions[number];
                if self.units[number].is_some() {
                    waiting.pop();
                } else if !std::mem::replace(&mut begun[number], true) {
                    // Quantities that wait for each other, as in a recursion over indices, stay open.
                    let mut read = |name: &Name| {
                        if let Some(other) = self.names.quantity(&name.text)
                            && !begun[other]
                        {
                            waiting.push(other);
                        }
                    };
                    definition.into_iter().for_each(|value| each_name(value, &mut read));
                } else {
                    let unit = definition.map_or(Number, |value| self.unit(value, Scope { told: false, ..TOLD }).0);
                    let constant = matches!(self.names.quantities[number].kind, Kind::Const | Kind::Param);
                    let open = match (self.strict, constant) {
                        (true, true) => Number,
                        (true, false) => Known(Dimension::ONE),
                        (false, _) => Unknown,
                    };
                    self.units[number] = Some(if matches!(unit, Number) { open } else { unit });
                    waiting.pop();
                }
            }
        }
    }

    fn statements(&mut self) {
        let mut compared = None;
        for statement in &self.spec.statements {
            match &statement.kind {
                StatementKind::Const { value, .. } => _ = self.unit(value, TOLD),
                StatementKind::Param { declared, value } => {
                    let own = self.own(&declared.name);
                    let value = self.unit(value, TOLD);
                    self.same(own, value, TOLD);
                }
                StatementKind::State { declared, initial, within, .. } => {
                    let own = self.own(&declared.name);
                    let initial = self.unit(initial, TOLD);
                    self.same(own, initial, TOLD);
                    self.range(own, within.as_ref());
                }
                StatementKind::Input { declared, signal, within, .. } => {
                    let own = self.own(&declared.name);
                    let signal = self.unit(signal, TOLD);
                    self.same(own, signal, TOLD);
                    self.range(own, within.as_ref());
                }
                StatementKind::Equation(equation) => self.equation(equation),
                StatementKind::When(when) => {
                    self.unit(&when.trigger, TOLD);
                    when.assignments.iter().for_each(|assignment| self.equation(assignment));
                    if let Some(side) = priority(when).map(|own| self.unit(own, TOLD)) {
                        self.same(*compared.get_or_insert(side), side, TOLD);
                        compared = compared.filter(|(unit, _)| matches!(unit, Known(_)));
                    }
                }
                _ => {}
            }
        }
    }

    fn equation(&mut self, equation: &'a Equation) {
        let (unit, span) = self.own(&equation.target.name);
        let own = match unit {
            Known(unit) if equation.side == LeftSide::Derivative => {
                (unit.times(self.time(), -1).map_or(Unknown, Known), equation.target.span)
            }
            unit => (unit, span),
        };
        let value = self.unit(&equation.value, TOLD);
        let counts_in = match (unit, value.0) {
            (Known(unit), Known(value)) if equation.side == LeftSide::Derivative => {
                let of = |(name, _): &(&'static str, f64)| parse(name).ok().and_then(|time| unit.times(time, -1));
                TIMES.iter().find(|time| of(time).is_some_and(|rate| rate.is(value))).map(|(name, _)| *name)
            }
            _ => None,
        };
        let help = counts_in.map(|name| {
            format!("numbers are not converted; if the model counts time in {name}, say so: `time [{name}]`")
        });
        self.same_or(own, value, TOLD, help);
        self.range(own, equation.within.as_ref());
        if let Some(condition) = &equation.condition {
            self.unit(condition, TOLD);
        }
    }

    fn range(&mut self, own: Side, within: Option<&'a Range>) {
        for bound in within.into_iter().flat_map(|range| [&range.low, &range.high]) {
            let bound = self.unit(bound, TOLD);
            self.same(own, bound, TOLD);
        }
    }

    /// The unit of a signal in an expression: that of its values.
    fn waveform(
        &mut self,
        kinds: &[(&str, Argument)],
        (arguments, units): (&'a [Expr], &'a [(usize, Name)]),
        scope: Scope,
    ) -> Unit {
        let kind = |at: usize| kinds.get(at).map_or(Argument::Value, |(_, kind)| *kind);
        for (at, argument) in arguments.iter().enumerate().filter(|(at, _)| kind(*at) != Argument::Value) {
            let value = self.unit(argument, scope);
            self.same((wanted(kind(at), self.time(), units.iter().any(|(of, _)| *of == at)), value.1), value, scope);
        }
        let values = arguments.iter().enumerate().filter(|(at, _)| kind(*at) == Argument::Value);
        self.all_same(values.map(|(_, argument)| argument), scope)
    }

    /// The unit of a quantity, and the place where it is written, or the quantity defined.
    fn own(&self, name: &Name) -> Side {
        let Some(number) = self.names.quantity(&name.text) else {
            return (Unknown, name.span);
        };
        let quantity = &self.names.quantities[number];
        (self.units[number].unwrap_or(Unknown), quantity.unit.map_or(quantity.name.span, |unit| unit.span))
    }

    /// The unit of an expression; conditions have none.
    fn unit(&mut self, expr: &'a Expr, scope: Scope) -> Side {
        let span = expr.span;
        let unit = match &expr.kind {
            ExprKind::Number(_) => Number,
            ExprKind::Measured(_, unit) => self.read(unit),
            ExprKind::Reference(reference) => self.reference(reference, scope),
            ExprKind::Sum(terms) => self.all_same(terms.iter().map(|(_, term)| term), scope),
            ExprKind::Product(first, rest) => self.product(first, rest, scope),
            ExprKind::Power(base, exponent) => {
                let base = self.unit(base, scope);
                let plain = self.unit(exponent, scope);
                self.plain(plain, scope);
                match (base.0, literal(exponent)) {
                    (Known(unit), Some(power)) => unit.power(power).map_or(Unknown, Known),
                    (Known(unit), None) if unit.is(Dimension::ONE) => base.0,
                    (Known(_), None) => Unknown,
                    (unit, _) => unit,
                }
            }
            ExprKind::Negate(operand) => self.unit(operand, scope).0,
            ExprKind::If { condition, yes, no } => {
                self.unit(condition, scope);
                self.all_same([&**yes, no], scope)
            }
            ExprKind::SumOver { binder, condition, body } => {
                self.rows.extend(binder.rows.as_ref().map(|path| (binder.name.text.as_str(), path)));
                condition.iter().for_each(|condition| _ = self.unit(condition, scope));
                let unit = self.unit(body, scope).0;
                binder.rows.iter().for_each(|_| _ = self.rows.pop());
                unit
            }
            ExprKind::Call { function, arguments, units } => self.call(function, (arguments, units), span, scope),
            ExprKind::Delayed { of, argument, .. } if self.names.function(&of.name.text).is_some() => {
                self.call(&of.name, (std::slice::from_ref(&**argument), &[]), span, scope)
            }
            ExprKind::Delayed { of, argument, unit } => {
                let delay = delay::terms(argument).unwrap_or_default();
                let delay = (self.all_same(delay.iter().map(|(_, term)| term), scope), argument.span);
                self.same((wanted(Argument::Time, self.time(), unit.is_some()), delay.1), delay, scope);
                self.reference(of, scope)
            }
            ExprKind::Matrix(rows) => self.all_same(rows.iter().flatten(), scope),
            ExprKind::Solved { matrix, right, .. } => match (self.own(right).0, self.own(matrix).0) {
                (Known(right), Known(matrix)) => right.times(matrix, -1).map_or(Unknown, Known),
                (Known(right), Number) => Known(right),
                (Number, Known(matrix)) => Dimension::ONE.times(matrix, -1).map_or(Unknown, Known),
                (Number, Number) => Number,
                _ => Unknown,
            },
            ExprKind::Data { path, column } | ExprKind::Samples { path, column, .. } => self.data(path, &column.text).0,
            ExprKind::Compare(_, left, right) => {
                self.all_same([&**left, right], scope);
                Number
            }
            ExprKind::Logical(_, operands) => {
                operands.iter().for_each(|operand| _ = self.unit(operand, scope));
                Number
            }
            ExprKind::Not(operand) => {
                self.unit(operand, scope);
                Number
            }
        };
        (unit, span)
    }

    fn reference(&mut self, reference: &'a Reference, scope: Scope) -> Unit {
        let name = reference.name.text.as_str();
        let cell = |(row, path): &(&str, &'a Name)| Some((*path, rows::column(name, row)?));
        if let Some((path, column)) = self.rows.iter().rev().find_map(cell) {
            return self.data(path, column).0;
        }
        if let Some((_, unit)) = scope.parameters.iter().find(|(parameter, _)| *parameter == name) {
            return *unit;
        }
        match self.names.find(name) {
            Some(Symbol::Quantity(number)) => self.units[number].unwrap_or(Unknown),
            None if name == TIME => Known(self.time()),
            // What nobody knows may have any unit.
            None if self.names.is_poisoned(name) => Unknown,
            None if self.report.tells(codes::UNKNOWN_NAME, reference.name.span) => Unknown,
            // Indices and what is predefined are numbers.
            Some(Symbol::Index(_) | Symbol::Predefined(_)) | None => Number,
        }
    }

    fn product(&mut self, first: &'a Expr, rest: &'a [(Factor, Expr)], scope: Scope) -> Unit {
        let mut unit = self.unit(first, scope).0;
        for (factor, operand) in rest {
            let operand = self.unit(operand, scope).0;
            let sign = if *factor == Factor::Divide { -1 } else { 1 };
            unit = match (unit, operand) {
                _ if matches!(factor, Factor::IntegerDivide | Factor::Modulo) => Number,
                (Unknown, _) | (_, Unknown) => Unknown,
                (Number, Number) => Number,
                (Known(unit), Number) => Known(unit),
                (Number, Known(unit)) => Dimension::ONE.times(unit, sign).map_or(Unknown, Known),
                (Known(one), Known(other)) => one.times(other, sign).map_or(Unknown, Known),
            };
        }
        unit
    }

    fn call(
        &mut self,
        function: &'a Name,
        (arguments, units): (&'a [Expr], &'a [(usize, Name)]),
        span: Span,
        scope: Scope,
    ) -> Unit {
        let name = function.text.as_str();
        if let Some((_, kinds, _)) = WAVEFORMS.iter().find(|(word, ..)| *word == name) {
            return self.waveform(kinds, (arguments, units), scope);
        }
        if let Some(defined) = self.names.function(name) {
            let (parameters, body) = (defined.parameters, defined.body);
            let units: Vec<(&str, Unit)> = parameters
                .iter()
                .zip(arguments)
                .map(|(parameter, argument)| (parameter.text.as_str(), self.unit(argument, scope).0))
                .collect();
            let Some(left) = self.calls.checked_sub(1).filter(|_| scope.depth < MOST_NESTED_CALLS) else {
                return Unknown;
            };
            self.calls = left;
            let before = self.report.count();
            let unit = self.unit(body, Scope { parameters: &units, told: scope.told, depth: scope.depth + 1 }).0;
            self.report.label_from(before, span, "called from here");
            return unit;
        }
        if name == "quotient" {
            self.all_same(arguments, scope);
            return Number;
        }
        if SAME.contains(&name) {
            return self.all_same(arguments, scope);
        }
        let units: Vec<Side> = arguments.iter().map(|argument| self.unit(argument, scope)).collect();
        match (name, units.as_slice()) {
            ("sqrt", [(Known(unit), _)]) => unit.power(0.5).map_or(Unknown, Known),
            ("sqrt", [(unit, _)]) => *unit,
            ("sign", _) => Number,
            _ if functions::find(name).is_some() => {
                units.into_iter().for_each(|side| self.plain(side, scope));
                Number
            }
            _ => Unknown,
        }
    }

    /// The unit in the header of a column.
    fn data(&mut self, path: &'a Name, column: &str) -> Side {
        let Some(table) = self.spec.table(path) else { return (Unknown, path.span) };
        let Some(number) = table.find(column) else { return (Unknown, path.span) };
        let column = &table.columns[number];
        let Some(text) = column.unit.as_deref() else { return (Number, path.span) };
        (self.text(text, column.place), column.place)
    }

    /// Checks that a number without unit stands here.
    fn plain(&mut self, side: Side, scope: Scope) {
        self.same((Known(Dimension::ONE), side.1), side, scope);
    }

    fn all_same(&mut self, members: impl IntoIterator<Item = &'a Expr>, scope: Scope) -> Unit {
        let mut all: Option<Side> = None;
        for member in members {
            let side = self.unit(member, scope);
            all = Some(match all {
                None => side,
                Some(before) => {
                    self.same(before, side, scope);
                    // The first known unit speaks for all; something unknown may be anything.
                    match (before.0, side.0) {
                        (Known(_), _) | (Unknown, Number) => before,
                        _ => side,
                    }
                }
            });
        }
        all.map_or(Number, |(unit, _)| unit)
    }

    /// The unit in which the spec counts time.
    fn time(&self) -> Dimension {
        parse(self.names.time.name).unwrap_or(Dimension::SECOND)
    }

    /// Reports two units that ought to be the same.
    fn same(&mut self, one: Side, other: Side, scope: Scope) {
        self.same_or(one, other, scope, None);
    }

    /// The same, with advice of the caller's.
    fn same_or(&mut self, one: Side, other: Side, scope: Scope, advice: Option<String>) {
        let ((Known(first), first_place), (Known(second), second_place)) = (one, other) else { return };
        if !scope.told || first.is(second) {
            return;
        }
        let code = if self.strict { codes::UNIT_ERROR } else { codes::UNIT_MISMATCH };
        let (first_text, second_text) = (self.shown(first), self.shown(second));
        let alone = first_place == second_place;
        let finding = if first.measures_the_same(second) {
            let ratio = shown_factor(second.factor / first.factor);
            let differ = format!("[{first_text}] and [{second_text}] differ by a factor");
            let message = format!("{differ}: 1 {second_text} is {ratio} {first_text}");
            let help = format!(
                "numbers are not converted; multiply by a parameter, for example `param k [{first_text}/({second_text})] = {ratio}`"
            );
            Diagnostic::error(code, second_place, message).with_help(advice.unwrap_or(help))
        } else if alone {
            let message = format!("[{first_text}] is needed here, this is [{second_text}]");
            Diagnostic::error(code, second_place, message).with_help(DIMENSION_HELP)
        } else {
            let message = format!("units do not agree: [{first_text}] and [{second_text}]");
            Diagnostic::error(code, second_place, message).with_help(DIMENSION_HELP)
        };
        let finding = if alone { finding } else { finding.with_label(first_place, format!("[{first_text}]")) };
        self.tell(finding.with_label(second_place, format!("[{second_text}]")));
    }

    /// A unit as the spec would write it.
    fn shown(&self, unit: Dimension) -> String {
        let named = |wanted: Dimension| self.named.iter().find(|(_, known)| known.is(wanted)).map(|(text, _)| *text);
        if unit.is(Dimension::ONE) {
            return "1".to_owned();
        }
        if let Some(text) = named(unit) {
            return text.to_owned();
        }
        // A derivative: the unit of its variable over that of time.
        let time = self.names.time.name;
        match unit.times(self.time(), 1).and_then(named) {
            Some(text) if text.contains('/') => format!("({text})/{time}"),
            Some(text) => format!("{text}/{time}"),
            None => unit.to_string(),
        }
    }
}

/// The unit that an argument of a signal must have which is no value. A unit written behind it is that of the number.
fn wanted(kind: Argument, time: Dimension, written: bool) -> Unit {
    match kind {
        Argument::Time if !written => Known(time),
        Argument::Frequency if !written => Dimension::ONE.times(time, -1).map_or(Unknown, Known),
        _ => Known(Dimension::ONE),
    }
}

/// The value of an exponent that is written out.
fn literal(expr: &Expr) -> Option<f64> {
    match &expr.kind {
        ExprKind::Number(value) => Some(*value),
        ExprKind::Negate(operand) => literal(operand).map(|value| -value),
        ExprKind::Product(first, rest) => match rest.as_slice() {
            [(Factor::Divide, second)] => Some(literal(first)? / literal(second)?),
            _ => None,
        },
        _ => None,
    }
}

/// Visits the names that an expression reads, subscripts and conditions aside.
fn each_name<'a>(expr: &'a Expr, action: &mut impl FnMut(&'a Name)) {
    match &expr.kind {
        ExprKind::Number(_)
        | ExprKind::Measured(..)
        | ExprKind::Data { .. }
        | ExprKind::Samples { .. }
        | ExprKind::Compare(..)
        | ExprKind::Logical(..)
        | ExprKind::Not(_) => {}
        ExprKind::Reference(reference) => action(&reference.name),
        ExprKind::Sum(terms) => terms.iter().for_each(|(_, term)| each_name(term, action)),
        ExprKind::Product(first, rest) => {
            each_name(first, action);
            rest.iter().for_each(|(_, operand)| each_name(operand, action));
        }
        ExprKind::Power(base, _) | ExprKind::Negate(base) | ExprKind::SumOver { body: base, .. } => {
            each_name(base, action)
        }
        ExprKind::If { yes, no, .. } => {
            each_name(yes, action);
            each_name(no, action);
        }
        ExprKind::Matrix(rows) => rows.iter().flatten().for_each(|cell| each_name(cell, action)),
        ExprKind::Solved { matrix, right, .. } => [matrix, right].into_iter().for_each(action),
        ExprKind::Call { arguments, .. } => arguments.iter().for_each(|argument| each_name(argument, action)),
        ExprKind::Delayed { of, .. } => action(&of.name),
    }
}
