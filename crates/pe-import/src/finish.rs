//! What all formats have in common after reading: what never changes becomes a parameter, initial values read
//! parameters only, and what a spec cannot hold is found.

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

use crate::expr::{Callee, Expr, Relation};
use crate::model::{Kind, Model, Quantity};
use crate::pulses;

/// Deepest expression that is written; the language takes 200 brackets.
const DEEPEST: usize = 150;

/// Equations within one another, at most, that stand for what a quantity was.
const MOST_EQUATIONS: usize = 40;

/// Prepares a model for writing; findings if it cannot be written.
pub(crate) fn finish(model: &mut Model, findings: &mut Vec<Diagnostic>) {
    missing(model, findings);
    extents(model, findings);
    if findings.is_empty() {
        promote(model);
        pasts(model, findings);
        let still: Vec<bool> =
            model.quantities.iter().map(|quantity| matches!(quantity.kind, Kind::Constant(_))).collect();
        for expr in model.quantities.iter_mut().flat_map(|quantity| quantity.kind.expressions_mut()) {
            *expr = pulses::recognised(expr, &|quantity| still[quantity]);
        }
        initial_values(model);
        keep_equations(model);
        same_kind(model);
        loops(model, findings);
    }
    events(model, findings);
}

/// Finds what a spec cannot say of events, and drops those that change nothing.
pub(crate) fn events(model: &mut Model, findings: &mut Vec<Diagnostic>) {
    model.events.retain(|event| !event.assignments.is_empty());
    for event in &model.events {
        let mut refuse = |what: &str, help: &str| {
            let message = format!("event {}cannot be expressed: {what}", quoted(&event.id));
            findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, event.span, message).with_help(help));
        };
        for (target, _) in &event.assignments {
            if !matches!(model.quantities[*target].kind, Kind::State { .. }) {
                let what = format!("it changes `{}`, which an equation determines", model.quantities[*target].id);
                refuse(&what, "let it change what the equation reads");
            }
        }
    }
}

/// What never changes was always the same. What follows the time followed it before the beginning, too, so its equation
/// stands for what it was; all else was as it is at the beginning. Delays are known.
fn pasts(model: &mut Model, findings: &mut Vec<Diagnostic>) {
    let still: Vec<bool> = model.quantities.iter().map(|quantity| matches!(quantity.kind, Kind::Constant(_))).collect();
    let equations: Vec<Option<Expr>> = (model.quantities.iter())
        .map(|quantity| match &quantity.kind {
            Kind::Algebraic(expr) => Some(expr.clone()),
            _ => None,
        })
        .collect();
    let timed = |expr: &Expr| {
        let mut reads_time = false;
        expr.each(&mut |part| reads_time |= matches!(part, Expr::Time | Expr::Pulse(_)));
        reads_time
    };
    let of_equations = |(index, expr): (usize, &Option<Expr>)| expr.as_ref().is_some_and(timed).then_some(index);
    let of_starts = |(index, quantity): (usize, &Quantity)| match &quantity.kind {
        Kind::State { initial, .. } | Kind::Constant(initial) => timed(initial).then_some(index),
        _ => None,
    };
    let mut readers: Vec<Vec<usize>> = vec![Vec::new(); equations.len()];
    for (index, expr) in equations.iter().enumerate().filter_map(|(index, expr)| Some((index, expr.as_ref()?))) {
        reads_now(expr).into_iter().for_each(|read| readers[read].push(index));
    }
    let clocked = spread(equations.iter().enumerate().filter_map(of_equations).collect(), &readers);
    let begun = spread(model.quantities.iter().enumerate().filter_map(of_starts).collect(), &readers);
    let past = Past { still, clocked, begun, equations };
    let mut simpler = |expr: &mut Expr, span: Span| {
        let mut refused = None;
        *expr = past.resolved(expr, &mut refused);
        if let Some((message, help)) = refused {
            findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span, message).with_help(help));
        }
    };
    for quantity in &mut model.quantities {
        let span = quantity.equation;
        quantity.kind.expressions_mut().into_iter().for_each(|expr| simpler(expr, span));
    }
    for event in &mut model.events {
        let span = event.span;
        event.expressions_mut().for_each(|expr| simpler(expr, span));
    }
}

/// What expressions of the past are made of.
struct Past {
    still: Vec<bool>,
    /// What follows the time by equations.
    clocked: Vec<bool>,
    /// What depends on initial values that follow the time, which have a past of their own.
    begun: Vec<bool>,
    /// Equations of all quantities that have one.
    equations: Vec<Option<Expr>>,
}

/// Why an expression of the past cannot be expressed, and what helps.
type Refused = Option<(&'static str, &'static str)>;

impl Past {
    /// The same with all that was some time ago as a spec can say it.
    fn resolved(&self, expr: &Expr, refused: &mut Refused) -> Expr {
        expr.map(&mut |leaf| {
            let Expr::Call(Callee::Past, members) = leaf else { return None };
            let delay = &members[1];
            if delay.literal() == Some(0.0) {
                return Some(members[0].clone());
            }
            delay.each(&mut |part| {
                if matches!(part, Expr::Name(read) if !self.still[*read]) || *part == Expr::Time {
                    *refused = Some((
                        "a delay that changes cannot be expressed",
                        "give it a delay that is a number or a parameter",
                    ));
                }
            });
            Some(self.ago(&members[0], delay, MOST_EQUATIONS, refused))
        })
    }

    /// What an expression was.
    fn ago(&self, expr: &Expr, delay: &Expr, left: usize, refused: &mut Refused) -> Expr {
        if left == 0 {
            *refused = Some((
                "the past of equations that read their own past and the time cannot be expressed",
                "give it a rate",
            ));
            return expr.clone();
        }
        expr.map(&mut |leaf| {
            Some(match leaf {
                Expr::Name(of) if self.begun[*of] => {
                    *refused = Some((
                        "the past of what follows the time before the beginning alone cannot be expressed",
                        "give it an initial value that is a number",
                    ));
                    leaf.clone()
                }
                Expr::Name(of) if self.still[*of] => leaf.clone(),
                Expr::Name(of) => match self.equations[*of].as_ref().filter(|_| self.clocked[*of]) {
                    Some(equation) => self.ago(equation, delay, left - 1, refused),
                    None => Expr::Call(Callee::Past, vec![leaf.clone(), delay.clone()]),
                },
                Expr::Time => Expr::sum([(false, Expr::Time), (true, delay.clone())]),
                Expr::Pulse(pulse) => {
                    let [height, start, width, period] = &**pulse;
                    let start = Expr::sum([(false, start.clone()), (false, delay.clone())]);
                    Expr::Pulse(Box::new([height.clone(), start, width.clone(), period.clone()]))
                }
                Expr::Call(Callee::Past, members) => {
                    let both = Expr::sum([(false, members[1].clone()), (false, delay.clone())]);
                    self.ago(&members[0], &both, left - 1, refused)
                }
                _ => return None,
            })
        })
    }
}

fn quoted(id: &str) -> String {
    if id.is_empty() { String::new() } else { format!("`{id}` ") }
}

/// Names of quantities that an expression reads.
fn reads(expr: &Expr) -> Vec<usize> {
    let mut found = Vec::new();
    expr.each(&mut |part| {
        if let Expr::Name(quantity) = part {
            found.push(*quantity);
        }
    });
    found
}

fn missing(model: &Model, findings: &mut Vec<Diagnostic>) {
    let mut needed: HashMap<usize, Span> = HashMap::new();
    for (_, quantity) in &model.outputs {
        needed.entry(*quantity).or_insert(model.quantities[*quantity].span);
    }
    for quantity in &model.quantities {
        for read in quantity.kind.expressions().into_iter().flat_map(reads) {
            needed.entry(read).or_insert(quantity.equation);
        }
    }
    for one in &model.events {
        for read in one.expressions().flat_map(reads) {
            needed.entry(read).or_insert(one.span);
        }
    }
    for (index, quantity) in model.quantities.iter().enumerate() {
        if quantity.kind == Kind::Missing
            && let Some(reader) = needed.get(&index)
        {
            let finding =
                Diagnostic::error(codes::IMPORT_NO_VALUE, quantity.span, format!("`{}` has no value", quantity.id));
            let finding =
                if *reader == quantity.span { finding } else { finding.with_label(*reader, "it is read here") };
            findings.push(finding.with_help("give it a value in the model file"));
        }
    }
}

fn extents(model: &Model, findings: &mut Vec<Diagnostic>) {
    let bodies = model.functions.iter().map(|function| (&function.body, function.span, &function.id));
    let equations = model.quantities.iter().flat_map(|quantity| {
        quantity.kind.expressions().into_iter().map(|expr| (expr, quantity.equation, &quantity.id))
    });
    for (expr, span, id) in equations.chain(bodies) {
        if expr.extent().0 > DEEPEST {
            let message = format!("the expression of `{id}` is nested more than {DEEPEST} deep");
            findings.push(Diagnostic::error(codes::IMPORT_LIMIT, span, message));
        }
    }
}

/// Names of quantities that an expression reads at the same time.
fn reads_now(expr: &Expr) -> Vec<usize> {
    let present = expr.map(&mut |part| matches!(part, Expr::Call(Callee::Past, _)).then_some(Expr::Pi));
    reads(&present)
}

/// Finds quantities that need themselves: at one time, or at the beginning.
fn loops(model: &Model, findings: &mut Vec<Diagnostic>) {
    let now = |kind: &Kind| match kind {
        Kind::Constant(expr) | Kind::Algebraic(expr) => reads_now(expr),
        _ => Vec::new(),
    };
    // 0 not seen, 1 on the path, 2 done.
    let mut marks = vec![0u8; model.quantities.len()];
    for start in 0..marks.len() {
        if marks[start] != 0 {
            continue;
        }
        marks[start] = 1;
        let mut path = vec![(start, now(&model.quantities[start].kind))];
        while let Some((index, left)) = path.last_mut() {
            let Some(next) = left.pop() else {
                marks[*index] = 2;
                path.pop();
                continue;
            };
            match marks[next] {
                0 => {
                    marks[next] = 1;
                    path.push((next, now(&model.quantities[next].kind)));
                }
                1 => {
                    let from = path.iter().position(|(index, _)| *index == next).unwrap_or(0);
                    let chain: Vec<String> =
                        path[from..].iter().map(|(index, _)| format!("`{}`", model.quantities[*index].id)).collect();
                    let message = format!("{} needs its own value: {}", chain[0], chain.join(" reads "));
                    let span = model.quantities[next].equation;
                    findings.push(
                        Diagnostic::error(codes::IMPORT_LOOP, span, message)
                            .with_help("solve the equations for it by hand, or give it a rate"),
                    );
                }
                _ => {}
            }
        }
    }
}

/// Algebraic quantities that read nothing that moves become constants.
fn promote(model: &mut Model) {
    let mut readers: Vec<Vec<usize>> = vec![Vec::new(); model.quantities.len()];
    let mut moving = Vec::new();
    for (index, quantity) in model.quantities.iter().enumerate() {
        match &quantity.kind {
            Kind::State { .. } => moving.push(index),
            Kind::Algebraic(expr) => {
                let mut clocked = false;
                expr.each(&mut |part| clocked |= matches!(part, Expr::Time | Expr::Pulse(_)));
                if clocked {
                    moving.push(index);
                }
                reads(expr).into_iter().for_each(|read| readers[read].push(index));
            }
            _ => {}
        }
    }
    let mut moves = spread(moving, &readers);
    // An array is a parameter as a whole, or not.
    let mut array_moves = vec![false; model.arrays.len()];
    let arrays: Vec<Option<usize>> =
        model.quantities.iter().map(|quantity| quantity.element.as_ref().map(|(array, _)| *array)).collect();
    (0..moves.len())
        .filter(|index| moves[*index])
        .filter_map(|index| arrays[index])
        .for_each(|array| array_moves[array] = true);
    (0..moves.len()).for_each(|index| moves[index] |= arrays[index].is_some_and(|array| array_moves[array]));
    for (index, quantity) in model.quantities.iter_mut().enumerate() {
        if !moves[index]
            && let Kind::Algebraic(expr) = &quantity.kind
        {
            quantity.kind = Kind::Constant(expr.clone());
        }
    }
}

fn spread(mut from: Vec<usize>, readers: &[Vec<usize>]) -> Vec<bool> {
    let mut marked = vec![false; readers.len()];
    from.iter().for_each(|index| marked[*index] = true);
    while let Some(index) = from.pop() {
        for reader in &readers[index] {
            if !marked[*reader] {
                marked[*reader] = true;
                from.push(*reader);
            }
        }
    }
    marked
}

/// Initial values and constants that read what moves get parameters for its values at the beginning.
fn initial_values(model: &mut Model) {
    let moves: Vec<bool> = model
        .quantities
        .iter()
        .map(|quantity| matches!(quantity.kind, Kind::State { .. } | Kind::Algebraic(_)))
        .collect();
    let mut at_start: HashMap<usize, usize> = HashMap::new();
    let mut todo: Vec<usize> = (0..model.quantities.len()).collect();
    let mut next = 0;
    while next < todo.len() {
        let index = todo[next];
        next += 1;
        let expr = match &model.quantities[index].kind {
            Kind::Constant(expr) | Kind::State { initial: expr, .. } => expr.clone(),
            _ => continue,
        };
        let mut changed = false;
        let started = expr.map(&mut |leaf| {
            // Before the beginning all is as it is then.
            let start = match if let Expr::Call(Callee::Past, members) = leaf { &members[0] } else { leaf } {
                Expr::Time => Expr::number(0.0),
                Expr::Pulse(pulse) => {
                    let [height, start, width, _] = &**pulse;
                    let begun = Expr::compare(Relation::LessEqual, start.clone(), Expr::number(0.0));
                    let lasts = Expr::compare(Relation::Greater, width.clone(), Expr::number(0.0));
                    Expr::choice(vec![(Expr::all(vec![begun, lasts]), height.clone())], Expr::number(0.0))
                }
                Expr::Name(read) if moves.get(*read) == Some(&true) => {
                    let twin = *at_start.entry(*read).or_insert_with(|| {
                        let of = &model.quantities[*read];
                        let value = match &of.kind {
                            Kind::State { initial, .. } => initial.clone(),
                            Kind::Algebraic(expr) => expr.clone(),
                            _ => Expr::number(0.0),
                        };
                        let kind = Kind::Constant(value);
                        let short = if of.short.is_empty() { String::new() } else { format!("{}_0", of.short) };
                        let twin = Quantity {
                            id: format!("{}_0", of.id),
                            short,
                            kind,
                            label: "at the beginning".to_owned(),
                            element: None,
                            ..of.clone()
                        };
                        todo.push(model.quantities.len());
                        model.quantities.push(twin);
                        model.quantities.len() - 1
                    });
                    Expr::Name(twin)
                }
                _ => return None,
            };
            changed = true;
            Some(start)
        });
        if changed && let Kind::Constant(expr) | Kind::State { initial: expr, .. } = &mut model.quantities[index].kind {
            *expr = started;
        }
    }
    let twins: Vec<(usize, usize)> = (0..moves.len()).filter_map(|of| Some((of, *at_start.get(&of)?))).collect();
    for (of, twin) in twins {
        if let Kind::State { initial, .. } = &mut model.quantities[of].kind {
            *initial = Expr::Name(twin);
        }
    }
}

/// Elements of arrays that are not all of one kind stand alone.
fn same_kind(model: &mut Model) {
    let mut kinds = vec![None; model.arrays.len()];
    let mut differ = vec![false; model.arrays.len()];
    let elements = |quantity: &Quantity| quantity.element.as_ref().map(|(array, _)| *array);
    for (array, quantity) in model.quantities.iter().filter_map(|quantity| Some((elements(quantity)?, quantity))) {
        let own = std::mem::discriminant(&quantity.kind);
        differ[array] |= *kinds[array].get_or_insert(own) != own;
    }
    for quantity in &mut model.quantities {
        if elements(quantity).is_some_and(|array| differ[array]) {
            quantity.element = None;
        }
    }
}

/// A spec has an equation: where nothing moves, the outputs are equations, with all that reads them.
fn keep_equations(model: &mut Model) {
    if model.quantities.iter().any(|quantity| !matches!(quantity.kind, Kind::Missing | Kind::Constant(_))) {
        return;
    }
    let mut readers: Vec<Vec<usize>> = vec![Vec::new(); model.quantities.len()];
    for (index, quantity) in model.quantities.iter().enumerate() {
        quantity.kind.expressions().into_iter().flat_map(reads).for_each(|read| readers[read].push(index));
    }
    let kept = spread(model.outputs.iter().map(|(_, output)| *output).collect(), &readers);
    for (quantity, _) in model.quantities.iter_mut().zip(kept).filter(|(_, kept)| *kept) {
        if let Kind::Constant(expr) = &quantity.kind {
            quantity.kind = Kind::Algebraic(expr.clone());
        }
    }
}
