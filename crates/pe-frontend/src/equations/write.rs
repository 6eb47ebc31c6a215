//! The pass that writes out the equations: which element each one defines first, then the right-hand sides.

use crate::bind::resolver::Reads;
use crate::bound::Node;
use crate::context::{BoundBounds, Context};
use crate::equations::pattern::{Pattern, Seen, bind, check_plain_subscripts, names_in};
use crate::fault::{Fault, fault};
use crate::language::habits::derivative_names;
use crate::names::table::{Kind, MOST_DIMENSIONS, NO_EQUATION, Names, Quantity, Symbol};
use crate::nearest::suggestion;
use crate::syntax::ast::{Equation, LeftSide, Statement, StatementKind};
use pe_ir::codes;
use pe_ir::index::{at, number as number_of};
use pe_ir::model::Expr;
use pe_ir::source::{Diagnostic, Span};

/// Elements without equation that are named in a message.
const SHOWN_ELEMENTS: usize = 3;

/// A flat equation.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) quantity: usize,
    pub(crate) offset: usize,
    pub(crate) expr: Expr,
    /// Stated range of an algebraic quantity.
    pub(crate) range: Option<(f64, f64)>,
    /// The equation in the spec.
    pub(crate) span: Span,
}

/// The flat equations; variables are numbered as the rows stand in the lists.
#[derive(Default, Debug)]
pub(crate) struct Flat {
    /// One per state, in declaration order.
    pub(crate) states: Vec<Option<Row>>,
    /// One per element of the box around each algebraic quantity, `None` where no equation defines it.
    pub(crate) algebraics: Vec<Option<Row>>,
}

/// A bound equation and the elements it defines.
struct BoundEquation<'a> {
    pattern: Pattern<'a>,
    body: Option<Node>,
    within: BoundBounds,
    span: Span,
    target: Span,
    /// Combination of index values and offset of each element.
    instances: Vec<(usize, usize)>,
}

impl BoundEquation<'_> {
    /// Reports the fault of an element unless it has been, and says whether to go on with the next one.
    fn tell(&self, context: &mut Context, seen: &mut Seen, fault: Fault) -> bool {
        let (new, go_on) = seen.judge(&fault);
        if new {
            let frame = context.evaluator.frame.clone();
            context.report.settle::<()>(Err(fault), |error| self.pattern.explain(error, self.target, &frame));
        }
        go_on
    }
}

/// All flat equations.
pub(crate) fn write_out(context: &mut Context) -> Flat {
    let (mut equations, mut lost) = (Vec::new(), Vec::new());
    for statement in &context.spec.statements {
        let StatementKind::Equation(equation) = &statement.kind else { continue };
        match bind_left_side(context, equation, statement) {
            Some(bound) => equations.push((bound, equation)),
            None => lost.push(equation),
        }
    }
    size_algebraics(context, &equations);
    prepare_definitions(&mut context.names);
    for number in 0..equations.len() {
        let (done, rest) = equations.split_at_mut(number);
        if let Some((bound, equation)) = rest.first_mut() {
            define(context, number, bound, equation, done);
        }
    }
    context.evaluator.left_sides_known = true;
    check_all_defined(context);
    for (bound, equation) in &mut equations {
        let mut resolver = context.resolver(Reads::Variables);
        resolver.scope = bound.pattern.indices.clone();
        bound.body = resolver.number(&equation.value);
        bound.within = bind_stated(context, equation, &bound.pattern.indices);
    }
    for equation in lost {
        bind_lost(context, equation);
    }
    right_sides(context, equations.into_iter().map(|(bound, _)| bound))
}

/// Finds the errors on the right-hand side of an equation whose left-hand side has one. Every name in the brackets
/// on the left counts as an index, so that nothing is reported that only follows from the error there.
fn bind_lost<'a>(context: &mut Context<'a>, equation: &'a Equation) {
    let named = equation.target.subscripts.iter().flat_map(names_in);
    let scope = named.chain(equation.ranges.iter().map(|binder| binder.name.text.as_str())).collect();
    let mut resolver = context.resolver(Reads::Variables);
    resolver.scope = scope;
    resolver.number(&equation.value);
}

/// Checks what an equation defines, and binds its left-hand side.
fn bind_left_side<'a>(
    context: &mut Context<'a>,
    equation: &'a Equation,
    statement: &Statement,
) -> Option<BoundEquation<'a>> {
    let name = &equation.target.name;
    let number = match context.names.find(&name.text) {
        Some(Symbol::Quantity(number)) => number,
        _ if context.names.is_poisoned(&name.text) => return None,
        Some(Symbol::Index(_)) => {
            let message = format!("`{}` is an index and has no equation", name.text);
            context.report.push(Diagnostic::error(codes::BAD_LEFT_SIDE, name.span, message));
            return None;
        }
        Some(Symbol::Predefined(_)) => {
            let message = format!("`{}` is predefined and has no equation", name.text);
            context.report.push(Diagnostic::error(codes::BAD_LEFT_SIDE, name.span, message));
            return None;
        }
        None => {
            let states = context.names.quantities.iter().filter(|quantity| quantity.kind == Kind::State);
            let help = suggestion(&name.text, states.map(|state| state.name.text.as_str()))
                .unwrap_or_else(|| format!("declare it: `state {} = 0`", name.text));
            let message = format!("`{}` is not declared as a state", name.text);
            context.report.push(Diagnostic::error(codes::BAD_LEFT_SIDE, name.span, message).with_help(help));
            return None;
        }
    };
    let quantity = &mut context.names.quantities[number];
    let is_own = quantity.name.span == name.span;
    let help = match (quantity.kind, equation.side) {
        _ if quantity.tunable && !is_own => Some("a host gives its value, and until then its declaration".to_owned()),
        _ if quantity.kind.has_equations() && quantity.block != statement.block => {
            Some(wrong_block(quantity, equation.side, statement.block))
        }
        (Kind::State, LeftSide::Derivative) if quantity.block.is_none() => None,
        (Kind::State, LeftSide::Next) if quantity.block.is_some() => None,
        (Kind::Algebraic, LeftSide::Algebraic) => None,
        (Kind::State, _) if quantity.block.is_some() => {
            Some(format!("its equation gives its next value: `next {} = ...`", name.text))
        }
        (Kind::State, _) => Some(format!("its equation gives the derivative: `{}' = ...`", name.text)),
        (Kind::Algebraic, LeftSide::Derivative) => {
            Some(format!("declare it as a state, or drop the mark: `{} = ...`", name.text))
        }
        (Kind::Algebraic, LeftSide::Next) => {
            Some(format!("declare it as a state in this block, or drop `next`: `{} = ...`", name.text))
        }
        (Kind::Const | Kind::Param, _) => Some("its value is given in its declaration".to_owned()),
        (Kind::Input, _) => Some("its signal is given in its declaration".to_owned()),
    };
    if let Some(help) = help {
        let sampled = if quantity.block.is_some() { ", sampled in a block" } else { "" };
        let message = format!("`{}` is {}{sampled}", name.text, quantity.describe());
        let error = Diagnostic::error(codes::BAD_LEFT_SIDE, name.span, message);
        context.report.push(error.with_label(quantity.name.span, "defined here").with_help(help));
        return None;
    }
    let pattern = if check_plain_subscripts(&context.names, &equation.target, &equation.ranges, &mut context.report) {
        bind(context, number, &equation.target, &equation.ranges, equation.condition.as_ref())
    } else {
        None
    };
    if pattern.is_none() {
        // Which elements it was to define is not known: nothing is said about missing ones.
        context.names.quantities[number].broken = true;
    }
    Some(BoundEquation {
        pattern: pattern?,
        body: None,
        within: None,
        span: statement.span,
        target: equation.target.span,
        instances: Vec::new(),
    })
}

/// Binds the stated range of an algebraic quantity, whose indices these are.
fn bind_stated<'a>(context: &mut Context<'a>, equation: &'a Equation, indices: &[&'a str]) -> BoundBounds {
    let within = equation.within.as_ref()?;
    if equation.side == LeftSide::Derivative {
        let message = "a derivative cannot have a stated range";
        let help = "state the range of the variable itself, in its declaration";
        context.report.push(Diagnostic::error(codes::BAD_LEFT_SIDE, within.span, message).with_help(help));
        return None;
    }
    let mut resolver = context.resolver(Reads::Constants);
    resolver.scope = indices.to_vec();
    let (low, high) = (resolver.number(&within.low), resolver.number(&within.high));
    Some((low?, high?))
}

/// Extents of algebraic quantities: the box around all left-hand sides.
fn size_algebraics(context: &mut Context, equations: &[(BoundEquation, &Equation)]) {
    let mut boxes: Vec<Option<Vec<(i64, i64)>>> = vec![None; context.names.quantities.len()];
    for (equation, _) in equations {
        let number = equation.pattern.quantity;
        if context.names.quantities[number].kind != Kind::Algebraic || equation.pattern.combinations() == 0 {
            continue;
        }
        let Some(reach) = equation.pattern.reach(context) else {
            context.names.quantities[number].broken = true;
            continue;
        };
        boxes[number] = Some(match boxes[number].take() {
            None => reach,
            Some(known) => known.iter().zip(&reach).map(|(a, b)| (a.0.min(b.0), a.1.max(b.1))).collect(),
        });
    }
    let mut base = 0;
    for (number, extents) in boxes.iter().enumerate() {
        if context.names.quantities[number].kind != Kind::Algebraic {
            continue;
        }
        let rank = context.names.quantities[number].rank;
        if rank > MOST_DIMENSIONS {
            let name = context.names.quantities[number].name;
            let message = format!("`{}` has {rank} subscripts; the most allowed is {MOST_DIMENSIONS}", name.text);
            context.report.push(Diagnostic::error(codes::SUBSCRIPT_COUNT, name.span, message));
            context.names.quantities[number].broken = true;
        }
        let nothing = vec![(1, 0); rank];
        let quantity = &mut context.names.quantities[number];
        // A matrix has those of its declaration.
        if quantity.matrix.is_none() {
            quantity.set_extents(extents.as_ref().unwrap_or(&nothing));
        }
        let (length, name) = (quantity.length, quantity.name);
        if context.names.quantities[number].broken
            || !context.elements.take(length, &name.text, name.span, &mut context.report)
        {
            context.names.quantities[number].broken = true;
            context.names.quantities[number].length = 0;
            continue;
        }
        context.names.quantities[number].base = base;
        base += number_of(length);
    }
}

fn prepare_definitions(names: &mut Names) {
    for quantity in &mut names.quantities {
        if matches!(quantity.kind, Kind::State | Kind::Algebraic) {
            quantity.defined_by = vec![NO_EQUATION; quantity.length];
        }
    }
}

/// Finds the elements that an equation defines.
fn define(
    context: &mut Context,
    number: usize,
    bound: &mut BoundEquation,
    equation: &Equation,
    earlier: &[(BoundEquation, &Equation)],
) {
    let combinations = bound.pattern.combinations();
    let name = &equation.target.name;
    // Ranges may be larger than the array if `where` cuts them down, but not without limit.
    let spare = context.elements.left.saturating_add(context.names.quantities[bound.pattern.quantity].length);
    if combinations > spare {
        context.elements.take(combinations, &name.text, bound.target, &mut context.report);
        context.names.quantities[bound.pattern.quantity].broken = true;
        return;
    }
    if let Some((low, high)) = bound.pattern.ranges.iter().find(|(low, high)| low > high) {
        let message = format!("the equation stands for no element: `{low}..{high}` is empty");
        let help = "check the range, or leave the equation out";
        let warning = Diagnostic::error(codes::EMPTY_RANGE, bound.target, message).with_help(help).into_warning();
        context.report.push(warning);
    }
    let mut seen = Seen::default();
    for combination in 0..combinations {
        bound.pattern.set_frame(combination, &mut context.evaluator.frame);
        let result = bound.pattern.subscripts(context);
        let quantity = &context.names.quantities[bound.pattern.quantity];
        let offset = result.and_then(|subscripts| match subscripts {
            None => Ok(None),
            // The reason why a broken quantity has no elements has been reported.
            Some(_) if quantity.defined_by.is_empty() && quantity.broken => Err(Fault::Silent),
            Some(values) => quantity.offset(&values).map(Some).map_err(|_| {
                let message = format!("`{}` does not exist", quantity.element_name(&values));
                let error = Diagnostic::error(codes::OUT_OF_RANGE, bound.target, message);
                fault(error.with_label(quantity.name.span, "defined here"))
            }),
        });
        match offset {
            Ok(None) => {}
            Ok(Some(offset)) => {
                let quantity = &mut context.names.quantities[bound.pattern.quantity];
                let other = quantity.defined_by[offset];
                if other == NO_EQUATION {
                    quantity.defined_by[offset] = number_of(number);
                    bound.instances.push((combination, offset));
                } else {
                    let element = quantity.name_at(offset);
                    let first = earlier.get(at(other)).map_or(bound.target, |(other, _)| other.target);
                    let message = format!("`{element}` has two equations");
                    let error = Diagnostic::error(codes::DEFINED_TWICE, bound.target, message)
                        .with_label(first, "the first one")
                        .with_help("restrict one of them with `where`");
                    let error = bound.pattern.explain(error, bound.target, &context.evaluator.frame);
                    let fault = fault(error);
                    let (new, go_on) = seen.judge(&fault);
                    if new {
                        context.report.settle::<()>(Err(fault), |error| error);
                    }
                    if !go_on {
                        break;
                    }
                }
            }
            Err(fault) => {
                context.names.quantities[bound.pattern.quantity].broken = true;
                if !bound.tell(context, &mut seen, fault) {
                    break;
                }
            }
        }
    }
}

/// Reports states without equation.
fn check_all_defined(context: &mut Context) {
    let declares_state = context.names.quantities.iter().any(|quantity| quantity.kind == Kind::State)
        || context.spec.broken.iter().any(|broken| broken.section == "state");
    let equations = context.names.quantities.iter().any(|quantity| quantity.kind.has_equations());
    if !declares_state && !equations && context.spec.blocks.is_empty() && context.spec.broken.is_empty() {
        let help = "declare a state, for example `state x = 0`, and give it an equation `x' = ...`";
        context.report.push(Diagnostic::global(codes::NO_STATE, "the spec has no equation").with_help(help));
    }
    for quantity in &context.names.quantities {
        if quantity.kind != Kind::State || quantity.broken || context.names.is_poisoned(&quantity.name.text) {
            continue;
        }
        let missing = quantity.defined_by.iter().enumerate().filter(|(_, equation)| **equation == NO_EQUATION);
        let shown: Vec<String> =
            missing.clone().take(SHOWN_ELEMENTS).map(|(offset, _)| format!("`{}`", quantity.name_at(offset))).collect();
        if shown.is_empty() {
            continue;
        }
        let more = missing.count() - shown.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let (what, example) = match quantity.block {
            None => ("the derivative", format!("add an equation, for example `{}' = 0`", quantity.name_at(0))),
            Some(_) => {
                let name = quantity.name_at(0);
                ("the next value", format!("add an equation to its block, for example `next {name} = {name}`"))
            }
        };
        let message = format!("no equation for {what} of {}{more}", shown.join(", "));
        let error = Diagnostic::error(codes::NO_EQUATION, quantity.name.span, message);
        let algebraic = |name: &String| {
            let other = &context.names.quantities[context.names.quantity(name)?];
            (other.kind == Kind::Algebraic).then_some(other.name)
        };
        let name = &quantity.name.text;
        let meant = quantity.block.is_none().then(|| derivative_names(name).iter().find_map(algebraic)).flatten();
        context.report.push(match meant {
            Some(meant) => error
                .with_label(meant.span, "an algebraic quantity of its own")
                .with_help(format!("if `{}` is to be the derivative: that is written `{name}' = ...`", meant.text)),
            None => error.with_help(example),
        });
    }
}

/// Evaluates the right-hand sides of all elements.
fn right_sides<'a>(context: &mut Context<'a>, equations: impl Iterator<Item = BoundEquation<'a>>) -> Flat {
    let total =
        |kind: Kind| context.names.quantities.iter().filter(|q| q.kind == kind).map(|q| q.defined_by.len()).sum();
    let mut flat = Flat::default();
    flat.states.resize_with(total(Kind::State), || None);
    flat.algebraics.resize_with(total(Kind::Algebraic), || None);
    for equation in equations {
        let Some(body) = &equation.body else { continue };
        let mut seen = Seen::default();
        let (kind, base, moves) = {
            let quantity = &context.names.quantities[equation.pattern.quantity];
            (quantity.kind, at(quantity.base), quantity.kind == Kind::State && quantity.block.is_none())
        };
        let per_second = if moves { context.names.time.per_second() } else { 1.0 };
        for (combination, offset) in &equation.instances {
            if context.report.is_exhausted() {
                return flat;
            }
            equation.pattern.set_frame(*combination, &mut context.evaluator.frame);
            let range = context.bounds(&equation.within);
            match range.and_then(|range| Ok((context.evaluator.expr(&context.names, body)?, range))) {
                Ok((expr, range)) => {
                    let quantity = equation.pattern.quantity;
                    let expr = faster(expr, per_second);
                    let row = Row { quantity, offset: *offset, expr, range, span: equation.span };
                    let rows = if kind == Kind::State { &mut flat.states } else { &mut flat.algebraics };
                    rows[base + offset] = Some(row);
                }
                Err(fault) => {
                    if !equation.tell(context, &mut seen, fault) {
                        break;
                    }
                }
            }
        }
    }
    flat
}

/// A rate of change, counted in a unit of which so many are a second, per second: sums term by term, as they would be
/// written.
fn faster(expr: Expr, per_second: f64) -> Expr {
    match expr {
        expr if per_second == 1.0 => expr,
        Expr::Sum(terms) => Expr::sum(terms.into_iter().map(|term| Expr::scaled(per_second, term)).collect()),
        expr => Expr::scaled(per_second, expr),
    }
}

/// Looks at the functions that nothing calls: what is wrong with them is wrong.
pub(crate) fn check_unused_functions(context: &mut Context) {
    for number in 0..context.names.functions.len() {
        if context.names.functions[number].bound.iter().all(Option::is_none) {
            context.resolver(Reads::Variables).body(number, Span::default());
        }
    }
}

/// What to do about an equation that stands in another block than what it defines, or outside of all.
fn wrong_block(quantity: &Quantity, side: LeftSide, block: Option<usize>) -> String {
    let name = &quantity.name.text;
    match (quantity.kind, quantity.block, block) {
        (Kind::State, None, _) if side == LeftSide::Derivative => {
            format!("it is continuous: write `{name}' = ...` outside blocks")
        }
        (Kind::State, None, _) => {
            format!("it is continuous, by `{name}' = ...`; declare a sampled state in the block")
        }
        (Kind::State, Some(_), _) => "it is sampled: its equation belongs in the block that declares it".to_owned(),
        _ => "all its equations must be in one block, or outside all blocks".to_owned(),
    }
}
