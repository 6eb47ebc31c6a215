//! Motion with constraints: `w' = constrained(M, f, J, gap, bend, penalty, rate, drift)` is written as the equations that hold
//! for every method, and what it is made of is kept for methods that treat constraints themselves.
//!
//! ```text
//! T = M + penalty*transpose(J)*J          v = bend + 2*rate*(J*w + drift) + rate^2*gap
//! a = solve(T, f - p)                     p = penalty*(transpose(J)*v)
//! w' = solve(T, M*a - p)
//! ```

use std::collections::BTreeMap;

use crate::language::words::{CONSTRAINED, SOLVE, TRANSPOSE};
use crate::names::table::Names;
use crate::report::Report;
use crate::syntax::ast::{
    Broken, Declared, Equation, Expr, ExprKind, Factor, LeftSide, Name, Reference, Sign, Spec, Statement, StatementKind,
};
use pe_ir::codes;
use pe_ir::index::{StateId, number};
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Entry, Expr as Value, Variable};
use pe_ir::source::{Diagnostic, Span};

use super::write::Flat;

/// Arguments: mass, forces, Jacobian, closures, bends, penalty, rate, and the drifts of closures that move by themselves.
pub(crate) const ARGUMENTS: usize = 7;

/// The names that the equation of a mechanism gives.
#[derive(Clone, Debug)]
pub(crate) struct Constrained {
    /// Velocities.
    target: String,
    /// Mass matrix, forces, Jacobian, closures and bends.
    parts: [Name; 5],
    /// Drifts.
    drift: Option<Name>,
    /// The parameter that the penalty has become.
    penalty: String,
    span: Span,
}

/// A spec in which the equation of a mechanism is written out, and what it names; none if there is no such equation.
pub(crate) fn write_out(spec: &Spec, report: &mut Report) -> Option<(Spec, Option<Constrained>)> {
    let is_one = |statement: &&Statement| matches!(called(statement), Some(..));
    let first = spec.statements.iter().find(is_one)?;
    let mut written = spec.emptied();
    let mut found = None;
    for statement in &spec.statements {
        let Some((equation, arguments)) = called(statement) else {
            written.statements.push(statement.clone());
            continue;
        };
        let lost = || Broken { section: String::new(), names: vec![equation.target.name.text.clone()] };
        match whole(equation, arguments, statement)
            .and_then(|parts| mass_of(spec, &parts.0[0]).map(|mass| (parts, mass)))
        {
            Ok(_) if !std::ptr::eq(first, statement) => {
                let message = "a model has one mechanism";
                let error = Diagnostic::error(codes::UNSUITABLE_MECHANISM, statement.span, message);
                report.push(
                    error.with_label(first.span, "the first one").with_help("put all coordinates into one array"),
                );
                written.broken.push(lost());
            }
            Ok((parts, mass)) => {
                found = Some(equations(&mut written, statement, equation, arguments, parts, mass));
            }
            Err(error) => {
                report.push(*error);
                written.broken.push(lost());
            }
        }
    }
    Some((written, found))
}

/// The equation of a statement whose right-hand side is a call of the function.
fn called(statement: &Statement) -> Option<(&Equation, &[Expr])> {
    let StatementKind::Equation(equation) = &statement.kind else { return None };
    match &equation.value.kind {
        ExprKind::Call { function, arguments, .. } if function.text == CONSTRAINED => Some((equation, arguments)),
        _ => None,
    }
}

/// The arrays that an equation names: those that every mechanism has, and drifts.
type Arrays = ([Name; 5], Option<Name>);

/// The arrays that an equation names.
fn whole(equation: &Equation, arguments: &[Expr], statement: &Statement) -> Result<Arrays, Box<Diagnostic>> {
    let fault = |span, message: String| {
        let help = "write `w' = constrained(M, f, J, gap, bend, penalty, rate)` with names of whole arrays";
        Box::new(Diagnostic::error(codes::UNSUITABLE_MECHANISM, span, message).with_help(help))
    };
    let plain = equation.side == LeftSide::Derivative
        && equation.target.subscripts.is_empty()
        && equation.ranges.is_empty()
        && equation.condition.is_none()
        && statement.block.is_none();
    if !plain {
        return Err(fault(
            statement.span,
            format!("`{CONSTRAINED}` gives the derivative of a whole array, outside of blocks"),
        ));
    }
    if !(ARGUMENTS..=ARGUMENTS + 1).contains(&arguments.len()) {
        return Err(fault(
            equation.value.span,
            format!("`{CONSTRAINED}` takes {ARGUMENTS} or {} arguments, found {}", ARGUMENTS + 1, arguments.len()),
        ));
    }
    let mut names = Vec::new();
    for argument in arguments[..5].iter().chain(&arguments[ARGUMENTS..]) {
        match &argument.kind {
            ExprKind::Reference(reference) if reference.subscripts.is_empty() => names.push(reference.name.clone()),
            _ => return Err(fault(argument.span, "this is no name of an array".to_owned())),
        }
    }
    let drift = (names.len() > 5).then(|| names.remove(5));
    Ok((names.try_into().expect("five were looked at"), drift))
}

/// The declaration of the mass matrix.
fn mass_of<'s>(spec: &'s Spec, mass: &Name) -> Result<&'s Declared, Box<Diagnostic>> {
    let declared = spec.statements.iter().find_map(|statement| match &statement.kind {
        StatementKind::Matrix { declared, symmetric: true } if declared.name.text == mass.text => Some(declared),
        _ => None,
    });
    declared.ok_or_else(|| {
        let message = format!("the mass matrix `{}` is no declared symmetric matrix", mass.text);
        let help = format!("declare it, `matrix {}[i, j] symmetric`, and give its entries equations", mass.text);
        Box::new(Diagnostic::error(codes::UNSUITABLE_MECHANISM, mass.span, message).with_help(help))
    })
}

/// Adds the equations that a statement stands for.
fn equations(
    spec: &mut Spec,
    statement: &Statement,
    equation: &Equation,
    arguments: &[Expr],
    (parts, drift): Arrays,
    mass: &Declared,
) -> Constrained {
    let span = equation.value.span;
    let target = equation.target.name.text.clone();
    let own = |what: &str| Name { text: format!("{target}.{what}"), span };
    let of = |name: &Name| {
        let name = Name { span, ..name.clone() };
        Expr { kind: ExprKind::Reference(Reference { name, subscripts: Vec::new(), span }), span }
    };
    let product = |first: Expr, rest: Vec<Expr>| {
        let rest = rest.into_iter().map(|operand| (Factor::Multiply, operand)).collect();
        Expr { kind: ExprKind::Product(Box::new(first), rest), span }
    };
    let sum = |terms: Vec<(Sign, Expr)>| Expr { kind: ExprKind::Sum(terms), span };
    let call = |function: &str, arguments| {
        let function = Name { text: function.to_owned(), span };
        Expr { kind: ExprKind::Call { function, arguments, units: Vec::new() }, span }
    };
    let two = || Expr { kind: ExprKind::Number(2.0), span };
    let [m, f, j, gap, bend] = &parts;
    let [matrix, closing, push, first, penalty, rate] =
        ["matrix", "closing", "push", "unaugmented", "penalty", "rate"].map(own);
    let mut push_kind = |kind| {
        spec.statements.push(Statement { kind, block: None, span: statement.span, files: Vec::new() });
    };
    let scalar = |name: &Name| Declared { name: name.clone(), dimensions: Vec::new(), unit: None };
    push_kind(StatementKind::Param { declared: scalar(&penalty), value: arguments[5].clone() });
    push_kind(StatementKind::Param { declared: scalar(&rate), value: arguments[6].clone() });
    let declared = Declared { name: matrix.clone(), dimensions: mass.dimensions.clone(), unit: None };
    push_kind(StatementKind::Matrix { declared, symmetric: true });
    let mut define = |name: &Name, side, value| {
        let target = Reference { name: name.clone(), subscripts: Vec::new(), span };
        let (ranges, within, unit, condition) = (Vec::new(), None, None, None);
        push_kind(StatementKind::Equation(Equation { target, side, unit, value, within, ranges, condition }));
    };
    let transposed = || call(TRANSPOSE, vec![of(j)]);
    let stiff = product(of(&penalty), vec![transposed(), of(j)]);
    define(&matrix, LeftSide::Algebraic, sum(vec![(Sign::Plus, of(m)), (Sign::Plus, stiff)]));
    let opening = product(of(j), vec![of(&equation.target.name)]);
    let opening = match &drift {
        Some(drift) => sum(vec![(Sign::Plus, opening), (Sign::Plus, of(drift))]),
        None => opening,
    };
    let moving = product(two(), vec![of(&rate), opening]);
    let squared = product(of(&rate), vec![of(&rate), of(gap)]);
    let closes = sum(vec![(Sign::Plus, of(bend)), (Sign::Plus, moving), (Sign::Plus, squared)]);
    define(&closing, LeftSide::Algebraic, closes);
    let pushes = product(of(&penalty), vec![product(transposed(), vec![of(&closing)])]);
    define(&push, LeftSide::Algebraic, pushes);
    let without = |term: Expr| sum(vec![(Sign::Plus, term), (Sign::Minus, of(&push))]);
    define(&first, LeftSide::Algebraic, call(SOLVE, vec![of(&matrix), without(of(f))]));
    let again = call(SOLVE, vec![of(&matrix), without(product(of(m), vec![of(&first)]))]);
    define(&equation.target.name, LeftSide::Derivative, again);
    Constrained { target, penalty: penalty.text, parts, drift, span: statement.span }
}

/// The mechanism in variables as they were written out; `numbers` are the elements that are numbers.
pub(crate) fn mechanism(
    constrained: &Constrained,
    names: &Names,
    flat: &Flat,
    numbers: &BTreeMap<u32, f64>,
    report: &mut Report,
) -> Option<Mechanism> {
    let quantity = |name: &str| names.quantity(name).map(|number| &names.quantities[number]);
    let Constrained { target, parts, drift, penalty, span } = constrained;
    let velocities = quantity(target)?;
    let penalty = *quantity(penalty)?.values.first()?;
    let mut fault = |span, message: String, help: &str| {
        report.push(Diagnostic::error(codes::UNSUITABLE_MECHANISM, span, message).with_help(help));
        None
    };
    if !(penalty > 0.0 && penalty.is_finite()) {
        return fault(*span, format!("the penalty is {penalty}"), "it must be positive: try 400");
    }
    // The coordinate of a velocity is the state whose derivative it is.
    let mut pairs = Vec::new();
    for offset in 0..velocities.length {
        let velocity = StateId::new(velocities.base + number(offset));
        let reads = Value::Variable(Variable::State(velocity));
        let is_coordinate = |row: &Option<super::write::Row>| row.as_ref().is_some_and(|row| row.expr == reads);
        match flat.states.iter().position(is_coordinate) {
            Some(coordinate) => pairs.push((StateId::at(coordinate), velocity)),
            None => {
                let message = format!("no state has `{}` as its derivative", velocities.name_at(offset));
                return fault(*span, message, "add the equations of the coordinates, `q' = w`");
            }
        }
    }
    let value = |element: u32| {
        let row = flat.algebraics.get(pe_ir::index::at(element)).is_some_and(Option::is_some);
        let known = numbers.get(&element).map(|number| Value::Constant(*number));
        known.or_else(|| row.then_some(Value::Variable(Variable::Algebraic(element))))
    };
    let entries = |name: &Name| -> Option<Vec<Entry>> {
        let matrix = quantity(&name.text).filter(|matrix| matrix.dimensions.len() == 2)?;
        let columns = matrix.dimensions[0].stride;
        let mut entries = Vec::new();
        for offset in 0..matrix.length {
            let (row, column) = (offset / columns, offset % columns);
            let across = matrix.matrix == Some(true);
            let own = value(matrix.base + number(offset));
            let own = own.or_else(|| across.then(|| value(matrix.base + number(column * columns + row))).flatten());
            let own = own.filter(|value| *value != Value::Constant(0.0));
            entries.extend(own.map(|value| Entry { row: number(row), column: number(column), value }));
        }
        Some(entries)
    };
    let vector = |name: &Name, length: usize| -> Option<Vec<Value>> {
        let vector = quantity(&name.text).filter(|vector| vector.dimensions.len() == 1 && vector.length == length)?;
        (0..length).map(|offset| value(vector.base + number(offset))).collect()
    };
    let [m, f, j, gap, bend] = parts;
    let closures = quantity(&gap.text).map_or(0, |gap| gap.length);
    let made = (|| {
        let (mass, jacobian) = (entries(m)?, entries(j)?);
        let (forces, gaps, bends) = (vector(f, pairs.len())?, vector(gap, closures)?, vector(bend, closures)?);
        let drifts = match drift {
            Some(drift) => vector(drift, closures)?,
            None => Vec::new(),
        };
        Some(Mechanism { pairs, mass, forces, jacobian, gaps, bends, drifts, penalty, span: *span })
    })();
    if made.is_none() {
        let message = "forces, closures, bends and drifts are not algebraic quantities with all elements".to_owned();
        return fault(*span, message, "give each element of `f`, `gap`, `bend` and `drift` an equation; `0` will do");
    }
    made
}
