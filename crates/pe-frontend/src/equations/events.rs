//! The pass that writes out events: for each element the condition as a number, and what becomes of which state.

use crate::bind::resolver::Reads;
use crate::bound::Node;
use crate::context::Context;
use crate::declare::times::Times;
use crate::equations::pattern::{Pattern, Seen, bind};
use crate::fault::{Fault, fault};
use crate::language::measures::{TIMES, scaled, unit_scale};
use crate::names::table::{Kind, Symbol};
use crate::syntax::ast::{Equation, Expr as Written, MANNERS, Measure, Name, StatementKind, When};
use pe_ir::codes;
use pe_ir::index::at;
use pe_ir::model::Expr;
use pe_ir::source::{Diagnostic, Span};

/// A flat event; variables are numbered as rows of flat equations.
#[derive(Clone, Debug)]
pub(crate) struct FlatEvent {
    /// Its name in messages and names of states.
    pub(crate) name: String,
    /// 1 where the condition holds, else 0.
    pub(crate) trigger: Expr,
    /// States, each with its new value.
    pub(crate) assignments: Vec<(u32, Expr)>,
    /// Time in seconds from the condition to the assignments.
    pub(crate) delay: Option<Expr>,
    /// Where its delay stands, if it has one.
    pub(crate) after: Option<Span>,
    /// Of several events at one time that of the highest comes first; without one, behind all that have one.
    pub(crate) priority: Option<Expr>,
    /// How it comes.
    pub(crate) manner: Manner,
    /// Where it stands.
    pub(crate) span: Span,
}

impl FlatEvent {
    /// The expressions that it reads variables in.
    pub(crate) fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let values = self.assignments.iter().map(|(_, value)| value);
        std::iter::once(&self.trigger).chain(&self.delay).chain(&self.priority).chain(values)
    }

    /// The same, to be changed.
    pub(crate) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expr> {
        let values = self.assignments.iter_mut().map(|(_, value)| value);
        std::iter::once(&mut self.trigger).chain(&mut self.delay).chain(&mut self.priority).chain(values)
    }
}

/// How an event comes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Manner {
    /// Whether the time of the event within the step is found.
    pub(crate) refine: bool,
    /// Whether new values are those of the time of the condition.
    pub(crate) frozen: bool,
    /// Whether the event is off if the condition holds no more when it comes.
    pub(crate) cancelled: bool,
    /// Whether the condition counts as false before time zero.
    pub(crate) initially: bool,
}

/// An assignment whose names are bound.
struct Bound<'a> {
    pattern: Pattern<'a>,
    value: Node,
    span: Span,
}

/// An event whose names are bound.
struct BoundEvent<'a> {
    trigger: Node,
    assignments: Vec<Bound<'a>>,
    delay: Option<Delay>,
    priority: Option<Node>,
}

/// What is above zero where a condition holds, if that is a single comparison.
pub(crate) fn margin(trigger: &Expr) -> Option<Expr> {
    let Expr::Select(select) = trigger else { return None };
    if select.condition.has_bends() {
        return None;
    }
    match (&select.yes, &select.no) {
        (Expr::Constant(1.0), Expr::Constant(0.0)) => Some(select.condition.clone()),
        (Expr::Constant(0.0), Expr::Constant(1.0)) => Some(Expr::scaled(-1.0, select.condition.clone())),
        _ => None,
    }
}

/// All flat events.
pub(crate) fn events(context: &mut Context, times: Option<&Times>) -> Vec<FlatEvent> {
    let mut events = Vec::new();
    let spec = context.spec;
    let statements = spec.statements.iter();
    let whens = statements.filter_map(|statement| match &statement.kind {
        StatementKind::When(when) => Some((when, statement.span)),
        _ => None,
    });
    for (number, (when, span)) in whens.enumerate() {
        if number == 0 && !suits(context, times, span) {
            return events;
        }
        let manner = manner(context, when);
        let assignments = assignments(context, when);
        let (Some(manner), Some(assignments)) = (manner, assignments) else { continue };
        let mut resolver = context.resolver(Reads::Variables);
        resolver.scope.clone_from(&assignments[0].pattern.indices);
        let Some(trigger) = resolver.number(&when.trigger) else { continue };
        let delay = match &when.after {
            Some(after) => match delay(context, after, &assignments[0]) {
                Some(delay) => Some(delay),
                None => continue,
            },
            None => None,
        };
        let priority = match priority(when) {
            Some(priority) => {
                let mut resolver = context.resolver(Reads::Variables);
                resolver.scope.clone_from(&assignments[0].pattern.indices);
                let Some(priority) = resolver.number(priority) else { continue };
                Some(priority)
            }
            None => None,
        };
        let bound = BoundEvent { trigger, assignments, delay, priority };
        write(context, &mut events, (number, span), &bound, manner);
    }
    events
}

/// Whether a model may have events: it has one step, and no sampled parts.
fn suits(context: &mut Context, times: Option<&Times>, span: Span) -> bool {
    let listed = times.is_some_and(|times| !times.phases.is_empty());
    let (message, help) = match context.spec.blocks.first() {
        Some(_) => {
            ("a model with sampled parts has no events", "write what is sampled as events, or the other way round")
        }
        None if listed => ("a model with a list of steps has no events", "take a single step"),
        None => return true,
    };
    context.report.push(Diagnostic::error(codes::EVENT_MODEL, span, message).with_help(help));
    false
}

fn manner(context: &mut Context, when: &When) -> Option<Manner> {
    let mut manner = Manner::default();
    let mut complete = true;
    for (name, number) in &when.manners {
        let known = MANNERS.iter().find(|(word, _)| *word == name.text);
        if known.is_none_or(|(_, has_number)| *has_number != number.is_some()) {
            complete = false;
            context.report.push(unknown(name));
            continue;
        }
        match name.text.as_str() {
            "refine" => manner.refine = true,
            "frozen" => manner.frozen = true,
            "cancelled" => manner.cancelled = true,
            "initially" => manner.initially = true,
            _ => {}
        }
    }
    complete.then_some(manner)
}

/// The priority of an event; of several the last one counts.
pub(crate) fn priority(when: &When) -> Option<&Written> {
    when.manners.iter().rev().find_map(|(_, number)| number.as_ref())
}

fn unknown(name: &Name) -> Diagnostic {
    let message = format!("`{}` does not say how an event comes", name.text);
    let help = "write `after 3 ms` behind the condition, then `, refine`, `, frozen`, `, cancelled`, `, initially` or `, priority 2`";
    Diagnostic::error(codes::SYNTAX, name.span, message).with_help(help)
}

/// A delay: its value in the unit of its measure, that unit in seconds, and its place.
struct Delay {
    value: Node,
    scale: f64,
    span: Span,
}

fn delay<'a>(context: &mut Context<'a>, after: &'a Measure, first: &Bound<'a>) -> Option<Delay> {
    let unstated = context.names.time.seconds;
    let scale =
        unit_scale(after.unit.as_ref(), &TIMES, "delay", unstated).map_err(|error| context.report.push(error)).ok();
    let mut resolver = context.resolver(Reads::Variables);
    resolver.scope.clone_from(&first.pattern.indices);
    let value = resolver.number(&after.value)?;
    Some(Delay { value, scale: scale?, span: after.value.span })
}

impl Delay {
    /// The delay of an element in seconds.
    fn seconds(&self, context: &mut Context) -> Result<Expr, Fault> {
        Ok(match context.evaluator.expr(&context.names, &self.value)? {
            Expr::Constant(value) => Expr::Constant(scaled(value, self.scale)),
            // A delay that is computed is rounded to steps, and is one at least.
            value => Expr::scaled(self.scale, value),
        })
    }
}

fn assignments<'a>(context: &mut Context<'a>, when: &'a When) -> Option<Vec<Bound<'a>>> {
    let mut all: Vec<Bound> = Vec::new();
    let mut complete = true;
    for assignment in &when.assignments {
        let Some(bound) = assignment_of(context, when, assignment) else {
            complete = false;
            continue;
        };
        if let Some(first) = all.first()
            && first.pattern.indices != bound.pattern.indices
        {
            let message = "all assignments of an event have the same indices";
            let help = "write an event for each, or the same indices in the brackets";
            let error = Diagnostic::error(codes::EVENT_TARGET, bound.span, message).with_help(help);
            context.report.push(error.with_label(first.span, "the first one"));
            complete = false;
        }
        all.push(bound);
    }
    complete.then_some(all)
}

fn assignment_of<'a>(context: &mut Context<'a>, when: &'a When, assignment: &'a Equation) -> Option<Bound<'a>> {
    let name = &assignment.target.name;
    let number = match context.names.find(&name.text) {
        Some(Symbol::Quantity(number)) => number,
        _ if context.names.is_poisoned(&name.text) => return None,
        _ => {
            let error = context.names.unknown(name, &[]);
            context.report.push(error);
            return None;
        }
    };
    let quantity = &context.names.quantities[number];
    if quantity.kind != Kind::State || quantity.tunable || quantity.angle {
        let message = format!("`{}` is {}, which no event changes", name.text, quantity.describe());
        let help = match quantity.kind {
            Kind::Const | Kind::Param => {
                format!("make it a state that stands still: `state {0} = ...`, `{0}' = 0`", name.text)
            }
            _ => "an event changes states, and all that reads them follows".to_owned(),
        };
        let error = Diagnostic::error(codes::EVENT_TARGET, name.span, message).with_help(help);
        context.report.push(error.with_label(quantity.name.span, "defined here"));
        return None;
    }
    let pattern = bind(context, number, &assignment.target, &when.ranges, None)?;
    let mut resolver = context.resolver(Reads::Variables);
    resolver.scope.clone_from(&pattern.indices);
    let value = resolver.number(&assignment.value)?;
    Some(Bound { pattern, value, span: assignment.target.span })
}

/// Writes out the elements of an event.
fn write(
    context: &mut Context,
    events: &mut Vec<FlatEvent>,
    (number, span): (usize, Span),
    bound: &BoundEvent,
    manner: Manner,
) {
    let first = &bound.assignments[0];
    let mut seen = Seen::default();
    for combination in 0..first.pattern.combinations() {
        if context.report.is_exhausted() {
            return;
        }
        first.pattern.set_frame(combination, &mut context.evaluator.frame);
        match element(context, bound, (manner, span)) {
            Ok(event) => {
                let frame: Vec<String> = context.evaluator.frame.iter().map(i64::to_string).collect();
                let element = if frame.is_empty() { String::new() } else { format!("[{}]", frame.join(",")) };
                events.push(FlatEvent { name: format!("event_{}{element}", number + 1), ..event });
            }
            Err(fault) => {
                let (new, go_on) = seen.judge(&fault);
                if new {
                    let frame = context.evaluator.frame.clone();
                    context.report.settle::<()>(Err(fault), |error| first.pattern.explain(error, first.span, &frame));
                }
                if !go_on {
                    return;
                }
            }
        }
    }
}

/// One element of an event, which has no name yet.
fn element(context: &mut Context, event: &BoundEvent, (manner, span): (Manner, Span)) -> Result<FlatEvent, Fault> {
    let trigger = context.evaluator.expr(&context.names, &event.trigger)?;
    let delay = event.delay.as_ref().map(|delay| delay.seconds(context)).transpose()?;
    let delay = delay.filter(|delay| *delay != Expr::Constant(0.0));
    let priority =
        event.priority.as_ref().map(|priority| context.evaluator.expr(&context.names, priority)).transpose()?;
    // A condition that is a number never becomes true.
    let is_open = trigger.as_constant().is_none() && margin(&trigger).is_none();
    if manner.refine && (delay.is_some() || is_open) {
        let message = match delay {
            Some(_) => "an event with a delay comes at the end of a step",
            None => "the time of a condition that is no single comparison is not found",
        };
        let help = "leave out `refine`, and take a smaller step";
        return Err(fault(Diagnostic::error(codes::EVENT_REFINE, span, message).with_help(help)));
    }
    let mut assignments: Vec<(u32, Expr)> = Vec::with_capacity(event.assignments.len());
    for bound in &event.assignments {
        let Some(subscripts) = bound.pattern.subscripts(context)? else { continue };
        let quantity = &context.names.quantities[bound.pattern.quantity];
        let offset = quantity.offset(&subscripts).map_err(|_| {
            let message = format!("`{}` does not exist", quantity.element_name(&subscripts));
            let error = Diagnostic::error(codes::OUT_OF_RANGE, bound.span, message);
            fault(error.with_label(quantity.name.span, "defined here"))
        })?;
        let state = quantity.base + u32::try_from(offset).unwrap_or(u32::MAX);
        if assignments.iter().any(|(known, _)| *known == state) {
            let message = format!("the event assigns `{}` twice", quantity.name_at(offset));
            return Err(fault(
                Diagnostic::error(codes::EVENT_TARGET, bound.span, message).with_help("leave one of them out"),
            ));
        }
        assignments.push((state, context.evaluator.expr(&context.names, &bound.value)?));
    }
    let after = event.delay.as_ref().map(|delay| delay.span);
    Ok(FlatEvent { name: String::new(), trigger, assignments, delay, after, priority, manner, span })
}

/// The states that events change, and what these events read, for those who number variables.
pub(crate) fn changing(events: &[FlatEvent], states: usize) -> Vec<Vec<usize>> {
    let mut of = vec![Vec::new(); states];
    for (number, event) in events.iter().enumerate() {
        for (state, _) in &event.assignments {
            of[at(*state)].push(number);
        }
    }
    of
}
