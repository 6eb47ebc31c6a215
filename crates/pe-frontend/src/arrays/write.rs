//! Statements that name whole arrays, `x' = A*x + B*u`: before anything else is done they are written with subscripts,
//! so that no later pass sees them. A spec without such statements stays as it is.

use crate::arrays::algebra::{Algebra, Hoisted, Shape, described, index, misfit, range, visit};
use crate::context::Context;
use crate::declare::sizes::{extents, index_ranges};
use crate::declare::{constants, overrides};
use crate::equations::pattern::{bind, names_in};
use crate::language::words::OF_ARRAYS;
use crate::limits::Limits;
use crate::names::collect::collect;
use crate::names::table::{Kind, Names};
use crate::report::Report;
use crate::syntax::ast::{
    Binder, Broken, Declared, Equation, Expr, ExprKind, LeftSide, Measure, Name, Range, Reference, Spec, Statement,
    StatementKind,
};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// A spec with subscripts in the places of whole arrays.
pub(crate) struct Written {
    pub(crate) spec: Spec,
    /// First statement that is missing in it.
    lost: Option<Span>,
}

impl Written {
    /// What to say if nothing else was: a shape that follows from nothing that could be computed.
    pub(crate) fn unexplained(&self) -> Option<Diagnostic> {
        let message = "the shapes of the arrays in this statement cannot be determined";
        let help = "write it with indices: `y[i] = ...`";
        self.lost.map(|span| Diagnostic::error(codes::SHAPES, span, message).with_help(help))
    }
}

/// Writes out whole arrays, whose sizes it finds on a copy of all names; `None` if there is nothing to do. What is
/// wrong with sizes is reported by the passes that compute them for good.
pub(crate) fn write_out(
    spec: &Spec,
    overrides: &[(String, f64)],
    limits: &Limits,
    report: &mut Report,
) -> Option<Written> {
    let mut unheard = Report::default();
    let names = collect(spec, &mut unheard);
    let declared = |name: &Name| names.quantity(&name.text).is_some_and(|number| names.quantities[number].rank > 0);
    if !spec.statements.iter().any(|statement| concerns_arrays(&statement.kind, declared)) {
        return None;
    }
    let overrides = overrides::check(&names, overrides, &mut unheard);
    let mut sizes = Context::new(spec, names, limits, unheard);
    constants::compute(&mut sizes, Kind::Const, &overrides);
    index_ranges(&mut sizes);
    extents(&mut sizes);
    let mut shapes: Vec<Option<Shape>> = sizes
        .names
        .quantities
        .iter()
        .map(|quantity| match quantity.rank {
            0 => Some(Shape::new()),
            _ if quantity.broken || (quantity.kind == Kind::Algebraic && quantity.matrix.is_none()) => None,
            _ => Some(quantity.dimensions.iter().map(|dimension| (dimension.low, dimension.high)).collect()),
        })
        .collect();
    // Ranges of equations may read parameters.
    constants::compute(&mut sizes, Kind::Param, &overrides);
    boxes(&mut sizes, &mut shapes);
    shapes_of_definitions(spec, &sizes.names, &mut shapes, report);
    let mut written = Written { spec: spec.emptied(), lost: None };
    let mut systems = 0;
    for statement in &spec.statements {
        let mut copy = statement.clone();
        let mut writer = Writer { names: &sizes.names, shapes: &shapes, report, hoisted: Vec::new(), systems };
        let done = writer.statement(&mut copy.kind);
        let hoisted = writer.hoisted;
        systems = writer.systems;
        if done.is_some() {
            let define = |hoisted| Statement { kind: definition(hoisted), files: Vec::new(), ..copy };
            written.spec.statements.extend(hoisted.into_iter().map(define));
            written.spec.statements.push(copy);
        } else {
            written.lost = written.lost.or(Some(statement.span));
            written.spec.broken.push(missing(&statement.kind));
        }
    }
    Some(written)
}

/// What a statement that could not be written out may define.
fn missing(statement: &StatementKind) -> Broken {
    let (section, names) = match statement {
        StatementKind::Param { declared, .. } => ("param", vec![declared.name.text.clone()]),
        StatementKind::Input { declared, .. } => ("input", vec![declared.name.text.clone()]),
        StatementKind::State { declared, .. } => ("state", vec![declared.name.text.clone()]),
        StatementKind::Matrix { declared, .. } => ("matrix", vec![declared.name.text.clone()]),
        StatementKind::Equation(equation) => ("", vec![equation.target.name.text.clone()]),
        StatementKind::Function { name, .. } => ("function", vec![name.text.clone()]),
        StatementKind::Step(..) => ("step", Vec::new()),
        StatementKind::Span(_) => ("span", Vec::new()),
        _ => ("", Vec::new()),
    };
    Broken { section: section.to_owned(), names }
}

/// Whether a statement uses a function of arrays, or names without subscripts what `array` tells to be one.
fn concerns_arrays(statement: &StatementKind, array: impl Fn(&Name) -> bool) -> bool {
    let mut found = match statement {
        StatementKind::Equation(Equation { target, .. }) => target.subscripts.is_empty() && array(&target.name),
        _ => false,
    };
    for expr in expressions(statement) {
        visit(expr, &mut |part| {
            found |= match &part.kind {
                ExprKind::Reference(reference) => reference.subscripts.is_empty() && array(&reference.name),
                ExprKind::Call { function, .. } => is_of_arrays(function),
                _ => false,
            }
        });
    }
    found
}

fn is_of_arrays(function: &Name) -> bool {
    OF_ARRAYS.iter().any(|(word, _)| *word == function.text)
}

/// The expressions of a statement that may name arrays.
fn expressions(statement: &StatementKind) -> Vec<&Expr> {
    let mut all = Vec::new();
    let mut range = None;
    match statement {
        StatementKind::Param { value, .. } => all.push(value),
        StatementKind::State { initial, within, .. } => {
            all.push(initial);
            range = within.as_ref();
        }
        StatementKind::Input { signal, within, .. } => {
            all.push(signal);
            range = within.as_ref();
        }
        StatementKind::Equation(equation) => {
            all.push(&equation.value);
            all.extend(&equation.condition);
            range = equation.within.as_ref();
        }
        StatementKind::Function { body, .. } => all.push(body),
        StatementKind::Step(last, early) => {
            all.push(&last.value);
            all.extend(early.iter().flat_map(|(step, until)| [&step.value, &until.value]));
        }
        StatementKind::Span(Measure { value, .. }) | StatementKind::Every(Measure { value, .. }) => all.push(value),
        _ => {}
    }
    all.extend(range.into_iter().flat_map(|range| [&range.low, &range.high]));
    all
}

/// Shapes of algebraic arrays whose equations have subscripts: the box around all left-hand sides.
fn boxes(sizes: &mut Context, shapes: &mut [Option<Shape>]) {
    for statement in &sizes.spec.statements {
        let StatementKind::Equation(equation) = &statement.kind else { continue };
        let Some(number) = sizes.names.quantity(&equation.target.name.text) else { continue };
        let quantity = &sizes.names.quantities[number];
        let declared = quantity.kind != Kind::Algebraic || quantity.matrix.is_some();
        if declared || quantity.rank == 0 || equation.target.subscripts.is_empty() {
            continue;
        }
        let pattern = bind(sizes, number, &equation.target, &equation.ranges, None);
        let Some(reach) = pattern.and_then(|pattern| pattern.reach(sizes)) else { continue };
        shapes[number] = Some(match shapes[number].take() {
            None => reach,
            Some(known) => known.iter().zip(&reach).map(|(a, b)| (a.0.min(b.0), a.1.max(b.1))).collect(),
        });
    }
}

/// Shapes of algebraic quantities that are defined as a whole: those of their right-hand sides, in the order in which
/// they read one another.
fn shapes_of_definitions(spec: &Spec, names: &Names, shapes: &mut [Option<Shape>], report: &mut Report) {
    let mut definitions: Vec<Option<&Equation>> = vec![None; shapes.len()];
    for statement in &spec.statements {
        let StatementKind::Equation(equation) = &statement.kind else { continue };
        let Some(number) = names.quantity(&equation.target.name.text) else { continue };
        let quantity = &names.quantities[number];
        if quantity.kind == Kind::Algebraic && quantity.rank == 0 && equation.target.subscripts.is_empty() {
            definitions[number] = definitions[number].or(Some(equation));
        }
    }
    let (mut begun, mut done) = (vec![false; shapes.len()], vec![false; shapes.len()]);
    // Quantities that wait for each other are taken for scalars, as nearly all are; if one is none, that is an error.
    let mut assumed = vec![false; shapes.len()];
    for first in 0..shapes.len() {
        let mut waiting = vec![first];
        while let Some(number) = waiting.last().copied() {
            let Some(definition) = definitions[number].filter(|_| !done[number]) else {
                waiting.pop();
                continue;
            };
            let again = std::mem::replace(&mut begun[number], true);
            visit(&definition.value, &mut |part| {
                let ExprKind::Reference(reference) = &part.kind else { return };
                let Some(other) = names.quantity(&reference.name.text) else { return };
                let open = definitions[other].is_some() && !done[other];
                if open && again {
                    assumed[other] = true;
                } else if open && !begun[other] {
                    waiting.push(other);
                }
            });
            if again {
                // What is wrong is said when the equation is written out.
                let mut unheard = Report::default();
                let mut algebra = algebra(names, shapes, &mut unheard, &[]);
                let shape = algebra.shaped(&definition.value).map(|shaped| shaped.shape);
                shapes[number] = shape;
                done[number] = true;
                waiting.pop();
            }
        }
    }
    for (number, definition) in definitions.iter().enumerate() {
        let Some(definition) = definition.filter(|_| assumed[number]) else { continue };
        if shapes[number].as_ref().is_none_or(|shape| !shape.is_empty()) {
            let name = &definition.target.name;
            let message = format!("the shape of `{}` depends on itself", name.text);
            let help = format!("write its equation with indices: `{}[i] = ...`", name.text);
            report.push(Diagnostic::error(codes::SHAPES, name.span, message).with_help(help));
            shapes[number] = None;
        }
    }
}

fn algebra<'r, 'a>(
    names: &'r Names<'a>,
    shapes: &'r [Option<Shape>],
    report: &'r mut Report,
    local: &[Name],
) -> Algebra<'r, 'a> {
    let local = local.iter().map(|name| name.text.clone()).collect();
    Algebra { names, shapes, report, local, own: Shape::new(), sums: 0, hoisted: Vec::new(), systems: 0 }
}

/// Writes out statements; each function returns `None` after an error.
struct Writer<'r, 'a> {
    names: &'r Names<'a>,
    shapes: &'r [Option<Shape>],
    report: &'r mut Report,
    /// What the statement reads, to be defined in front of it.
    hoisted: Vec<Hoisted>,
    /// Linear systems so far.
    systems: usize,
}

impl<'a> Writer<'_, 'a> {
    fn statement(&mut self, statement: &mut StatementKind) -> Option<()> {
        if !self.concerns(statement) {
            return Some(());
        }
        match statement {
            StatementKind::Param { declared, value } => self.element(declared, value),
            StatementKind::State { declared, initial, within, .. } => {
                self.element(declared, initial)?;
                self.ends(within, &names_of(&declared.dimensions))
            }
            StatementKind::Input { declared, signal, within, .. } => {
                match &mut signal.kind {
                    // Of a lone call arguments may be arrays.
                    ExprKind::Call { function, arguments, .. } if !is_of_arrays(function) => {
                        arguments.iter_mut().try_for_each(|argument| self.element(declared, argument))?;
                    }
                    _ => self.element(declared, signal)?,
                }
                self.ends(within, &names_of(&declared.dimensions))
            }
            StatementKind::Equation(equation) => self.equation(equation),
            StatementKind::Function { parameters, body, .. } => self.scalar(body, parameters),
            StatementKind::Step(last, early) => {
                let early = early.iter_mut().flat_map(|(step, until)| [step, until]);
                early.chain([last]).try_for_each(|measure| self.scalar(&mut measure.value, &[]))
            }
            StatementKind::Span(measure) | StatementKind::Every(measure) => self.scalar(&mut measure.value, &[]),
            _ => Some(()),
        }
    }

    /// Whether shapes matter to a statement: one of scalars stays as it is.
    fn concerns(&self, statement: &StatementKind) -> bool {
        concerns_arrays(statement, |name| {
            let number = self.names.quantity(&name.text);
            number.is_some_and(|number| self.shapes[number].as_ref().is_none_or(|shape| !shape.is_empty()))
        })
    }

    /// The value of an element of a declared quantity, whose dimensions name the subscripts.
    fn element(&mut self, declared: &Declared, value: &mut Expr) -> Option<()> {
        let number = self.names.quantity(&declared.name.text)?;
        let own = self.shapes[number].clone()?;
        let mut algebra = algebra(self.names, self.shapes, self.report, &names_of(&declared.dimensions));
        algebra.own.clone_from(&own);
        let shaped = algebra.shaped(value)?;
        if !shaped.shape.is_empty() && shaped.shape != own {
            let (wanted, found) = (described(&own), described(&shaped.shape));
            let (name, place) = (declared.name.span, shaped.span);
            self.report.push(misfit((name, &wanted), (place, &found), "declared and given", None));
            return None;
        }
        let subscripts: Vec<Expr> = declared.dimensions.iter().map(|binder| index(&binder.name)).collect();
        *value = algebra.element(&shaped, &subscripts);
        let hoisted = algebra.hoisted;
        self.refuse(&hoisted)
    }

    fn equation(&mut self, equation: &mut Equation) -> Option<()> {
        let name = equation.target.name.clone();
        let shape = match self.names.quantity(&name.text) {
            Some(number) if equation.target.subscripts.is_empty() => self.shapes[number].clone(),
            _ => Some(Shape::new()),
        };
        let mut local = names_of(&equation.ranges);
        for subscript in &equation.target.subscripts {
            // Whatever is no index is no free name either.
            let named = names_in(subscript).into_iter().filter(|name| self.names.quantity(name).is_none());
            local.extend(named.map(|text| Name { text: text.to_owned(), span: subscript.span }));
        }
        if let Some(condition) = &mut equation.condition {
            self.scalar(condition, &local)?;
        }
        self.ends(&mut equation.within, &local)?;
        let mut algebra = algebra(self.names, self.shapes, self.report, &local);
        algebra.systems = self.systems;
        let shaped = algebra.shaped(&equation.value)?;
        let shape = shape?;
        if shape != shaped.shape {
            let (left, right) = (described(&shape), described(&shaped.shape));
            let (before, mark) = match equation.side {
                LeftSide::Derivative => ("", "'"),
                LeftSide::Next => ("next ", ""),
                LeftSide::Algebraic => ("", ""),
            };
            let help = if shape.is_empty() && !equation.target.subscripts.is_empty() {
                Some(format!(
                    "name elements on the right, or the whole array on the left: `{before}{}{mark} = ...`",
                    name.text
                ))
            } else {
                let scalar = shaped.shape.is_empty();
                scalar.then(|| format!("write the equation for each element: `{before}{}[i]{mark} = ...`", name.text))
            };
            let how = "the two sides of an equation";
            let error = misfit((equation.target.span, &left), (shaped.span, &right), how, help.as_deref());
            self.report.push(error);
            return None;
        }
        // Blanks keep these names apart from those of the spec.
        let indices: Vec<Name> = (1..=shape.len())
            .map(|dimension| Name { text: format!("subscript {dimension}"), span: equation.target.span })
            .collect();
        let subscripts: Vec<Expr> = indices.iter().map(index).collect();
        let whole = equation.side == LeftSide::Algebraic && equation.condition.is_none() && !shape.is_empty();
        equation.value = match whole {
            true => algebra.defined_element(&shaped, &subscripts),
            false => algebra.element(&shaped, &subscripts),
        };
        self.systems = algebra.systems;
        let hoisted = std::mem::take(&mut algebra.hoisted);
        self.stands_alone(&hoisted, &local)?;
        self.hoisted = hoisted;
        equation.target.subscripts.extend(subscripts);
        let all = indices.into_iter().zip(&shape);
        equation.ranges.extend(all.map(|(name, ends)| Binder {
            range: Some(range(*ends, name.span)),
            rows: None,
            name,
        }));
        Some(())
    }

    /// Reports a right-hand side of a linear system that reads what has a value in its equation alone.
    fn stands_alone(&mut self, hoisted: &[Hoisted], local: &[Name]) -> Option<()> {
        for hoisted in hoisted {
            let mut inner = None;
            visit(&hoisted.value, &mut |part| {
                if let ExprKind::Reference(reference) = &part.kind
                    && local.iter().any(|name| name.text == reference.name.text)
                {
                    inner = inner.or(Some(&reference.name));
                }
            });
            if let Some(name) = inner {
                let message = format!("the right-hand side of this system depends on the index `{}`", name.text);
                let help = "give the right-hand sides a name, as the columns of a matrix, and solve for all of them at once: `X = solve(T, B)`";
                self.report.push(Diagnostic::error(codes::BAD_SYSTEM, name.span, message).with_help(help));
                return None;
            }
        }
        Some(())
    }

    fn ends(&mut self, within: &mut Option<Range>, local: &[Name]) -> Option<()> {
        if let Some(range) = within {
            self.scalar(&mut range.low, local)?;
            self.scalar(&mut range.high, local)?;
        }
        Some(())
    }

    fn scalar(&mut self, expr: &mut Expr, local: &[Name]) -> Option<()> {
        let mut algebra = algebra(self.names, self.shapes, self.report, local);
        *expr = algebra.scalar(expr)?;
        let hoisted = algebra.hoisted;
        self.refuse(&hoisted)
    }

    /// Reports a linear system outside of equations.
    fn refuse(&mut self, hoisted: &[Hoisted]) -> Option<()> {
        let Some(first) = hoisted.first() else { return Some(()) };
        let message = "`solve` stands in right-hand sides of equations";
        let help = "define what it gives as an algebraic quantity: `x = solve(T, b)`";
        self.report.push(Diagnostic::error(codes::BAD_SYSTEM, first.name.span, message).with_help(help));
        None
    }
}

/// The equation of an array that a statement reads.
fn definition(hoisted: Hoisted) -> StatementKind {
    let Hoisted { name, indices, shape, value } = hoisted;
    let span = name.span;
    let subscripts = indices.iter().map(index).collect();
    let all = indices.into_iter().zip(&shape);
    StatementKind::Equation(Equation {
        target: Reference { name, subscripts, span },
        side: LeftSide::Algebraic,
        unit: None,
        value,
        within: None,
        ranges: all.map(|(name, ends)| Binder { range: Some(range(*ends, span)), rows: None, name }).collect(),
        condition: None,
    })
}

fn names_of(binders: &[Binder]) -> Vec<Name> {
    binders.iter().map(|binder| binder.name.clone()).collect()
}
