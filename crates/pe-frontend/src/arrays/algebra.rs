//! Algebra of whole arrays: finds the shape of an expression that names vectors and matrices without subscripts, and
//! writes out each element as an expression of scalars.

use crate::language::words::{CONSTRAINED, DOT, SOLVE, TIME, TRANSPOSE};
use crate::names::table::{Names, Symbol};
use crate::report::Report;
use crate::syntax::ast::{Binder, Expr, ExprKind, Factor, Name, Range, Reference, Sign};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// Products of arrays inside of one another: each is a sum inside of the next, so work grows with their power.
const MOST_NESTED_PRODUCTS: usize = 8;

/// First and last subscript in each dimension; none for a scalar.
pub(crate) type Shape = Vec<(i64, i64)>;

/// An expression whose shape is known.
pub(crate) struct Shaped {
    form: Form,
    pub(crate) shape: Shape,
    pub(crate) span: Span,
    /// Whether a table in it belongs to the element that is being declared, so that it has no other elements.
    own: bool,
}

/// How the elements of an expression come from those of its parts.
enum Form {
    /// The same for all elements: a scalar, or a table in a declaration.
    Same(ExprKind),
    Whole(Name),
    Sum(Vec<(Sign, Shaped)>),
    /// Scalars and at most one array; the first is multiplied.
    Scaled(Vec<(Factor, Shaped)>),
    /// Sum over the last subscript of the first and the first one of the second.
    Contracted(Box<Shaped>, Box<Shaped>),
    Negate(Box<Shaped>),
    If(Box<Expr>, Box<Shaped>, Box<Shaped>),
    SumOver(Box<Binder>, Option<Box<Expr>>, Box<Shaped>),
    Transposed(Box<Shaped>),
    /// The solution of a linear system: matrix and right-hand side.
    Solved(Name, Box<Shaped>),
}

/// A vector or matrix that has to be defined before it can be read.
pub(crate) struct Hoisted {
    pub(crate) name: Name,
    /// The indices that its elements are written with.
    pub(crate) indices: Vec<Name>,
    pub(crate) shape: Shape,
    pub(crate) value: Expr,
}

/// Finds shapes within one statement.
pub(crate) struct Algebra<'r, 'a> {
    pub(crate) names: &'r Names<'a>,
    /// Shape of each quantity, `None` where an error keeps it from being known.
    pub(crate) shapes: &'r [Option<Shape>],
    pub(crate) report: &'r mut Report,
    /// Indices and arguments that have a value here.
    pub(crate) local: Vec<String>,
    /// Shape of the array that is being declared.
    pub(crate) own: Shape,
    /// Sums written so far; their indices are numbered.
    pub(crate) sums: usize,
    /// What the elements that were written read, in the order in which it is defined.
    pub(crate) hoisted: Vec<Hoisted>,
    /// Linear systems written before; they are numbered.
    pub(crate) systems: usize,
}

impl Algebra<'_, '_> {
    /// Replaces an expression that must be a scalar; `None` after an error.
    pub(crate) fn scalar(&mut self, expr: &Expr) -> Option<Expr> {
        let shaped = self.shaped(expr)?;
        if shaped.shape.is_empty() {
            return Some(self.element(&shaped, &[]));
        }
        let message = format!("a scalar is needed here, this is {}", described(&shaped.shape));
        let help = "name one element, as in `x[1]`, or write the equation for each element: `y[i] = ...`";
        self.report.push(Diagnostic::error(codes::SHAPES, shaped.span, message).with_help(help));
        None
    }

    /// Finds the shape of an expression; `None` after an error.
    pub(crate) fn shaped(&mut self, expr: &Expr) -> Option<Shaped> {
        match &expr.kind {
            ExprKind::Reference(reference) => self.reference(reference, expr.span),
            ExprKind::Sum(terms) => self.sum(terms, expr.span),
            ExprKind::Product(first, rest) => self.product(first, rest),
            ExprKind::Negate(operand) => {
                let operand = self.shaped(operand)?;
                let (shape, own) = (operand.shape.clone(), operand.own);
                Some(Shaped { form: Form::Negate(Box::new(operand)), shape, span: expr.span, own })
            }
            ExprKind::If { condition, yes, no } => self.branches(condition, yes, no, expr.span),
            ExprKind::SumOver { binder, condition, body } => {
                self.sum_over(binder, condition.as_deref(), body, expr.span)
            }
            ExprKind::Call { function, arguments, .. } => match (function.text.as_str(), arguments.as_slice()) {
                (DOT, [one, other]) => self.dot(one, other, expr.span),
                (TRANSPOSE, [matrix]) => self.transpose(matrix, expr.span),
                (SOLVE, [matrix, right]) => self.solve(matrix, right, expr.span),
                (CONSTRAINED, _) => {
                    let message = "`constrained` is the whole right-hand side of an equation";
                    let help = "write `w' = constrained(M, f, J, gap, bend, penalty, rate)`";
                    let error = Diagnostic::error(codes::UNSUITABLE_MECHANISM, expr.span, message);
                    self.report.push(error.with_help(help));
                    None
                }
                (DOT | TRANSPOSE | SOLVE, _) => {
                    let wanted = if function.text == TRANSPOSE { 1 } else { 2 };
                    let message = format!("`{}` takes {wanted} argument(s), found {}", function.text, arguments.len());
                    self.report.push(Diagnostic::error(codes::ARGUMENT_COUNT, expr.span, message));
                    None
                }
                _ => self.scalars(expr),
            },
            ExprKind::Data { .. } | ExprKind::Matrix(_) => {
                let table = self.scalars(expr)?;
                Some(Shaped { shape: self.own.clone(), own: true, ..table })
            }
            _ => self.scalars(expr),
        }
    }

    /// An expression whose parts are scalars.
    fn scalars(&mut self, expr: &Expr) -> Option<Shaped> {
        let kind = match &expr.kind {
            ExprKind::Power(base, exponent) => {
                let (base, exponent) = (self.scalar(base), self.scalar(exponent));
                ExprKind::Power(Box::new(base?), Box::new(exponent?))
            }
            ExprKind::Compare(comparison, left, right) => {
                let (left, right) = (self.scalar(left), self.scalar(right));
                ExprKind::Compare(*comparison, Box::new(left?), Box::new(right?))
            }
            ExprKind::Not(operand) => ExprKind::Not(Box::new(self.scalar(operand)?)),
            ExprKind::Logical(connective, operands) => ExprKind::Logical(*connective, self.list(operands)?),
            ExprKind::Call { function, arguments, units } => {
                ExprKind::Call { function: function.clone(), arguments: self.list(arguments)?, units: units.clone() }
            }
            ExprKind::Delayed { of, argument, unit } => {
                let of = Reference { subscripts: self.list(&of.subscripts)?, ..of.clone() };
                ExprKind::Delayed { of, argument: Box::new(self.scalar(argument)?), unit: unit.clone() }
            }
            ExprKind::Matrix(rows) => {
                ExprKind::Matrix(rows.iter().map(|row| self.list(row)).collect::<Option<Vec<_>>>()?)
            }
            other => other.clone(),
        };
        Some(Shaped { form: Form::Same(kind), shape: Shape::new(), span: expr.span, own: false })
    }

    fn list(&mut self, members: &[Expr]) -> Option<Vec<Expr>> {
        members.iter().map(|member| self.scalar(member)).collect()
    }

    fn reference(&mut self, reference: &Reference, span: Span) -> Option<Shaped> {
        let name = &reference.name;
        let same = |kind| Some(Shaped { form: Form::Same(kind), shape: Shape::new(), span, own: false });
        if !reference.subscripts.is_empty() {
            let subscripts = self.list(&reference.subscripts)?;
            return same(ExprKind::Reference(Reference { name: name.clone(), subscripts, span: reference.span }));
        }
        let scalar = ExprKind::Reference(reference.clone());
        if self.local.contains(&name.text) {
            return same(scalar);
        }
        match self.names.find(&name.text) {
            Some(Symbol::Predefined(_)) => same(scalar),
            Some(Symbol::Quantity(number)) => {
                let shape = self.shapes.get(number)?.clone()?;
                if shape.is_empty() {
                    return same(scalar);
                }
                Some(Shaped { form: Form::Whole(name.clone()), shape, span, own: false })
            }
            Some(Symbol::Index(_)) => {
                self.report.push(Names::unbound_index(name));
                None
            }
            None if name.text == TIME => same(scalar),
            None if self.names.is_poisoned(&name.text) => None,
            None => {
                let local: Vec<&str> = self.local.iter().map(String::as_str).collect();
                self.report.push(self.names.unknown(name, &local));
                None
            }
        }
    }

    fn sum(&mut self, terms: &[(Sign, Expr)], span: Span) -> Option<Shaped> {
        let found: Vec<_> = terms.iter().map(|(sign, term)| Some((*sign, self.shaped(term)?))).collect();
        let terms = found.into_iter().collect::<Option<Vec<_>>>()?;
        let (_, first) = terms.first()?;
        if let Some((_, other)) = terms.iter().find(|(_, term)| term.shape != first.shape) {
            return self.misfit(first, other, "added", each_element(first, other));
        }
        let (shape, own) = (first.shape.clone(), terms.iter().any(|(_, term)| term.own));
        Some(Shaped { form: Form::Sum(terms), shape, span, own })
    }

    fn branches(&mut self, condition: &Expr, yes: &Expr, no: &Expr, span: Span) -> Option<Shaped> {
        let (condition, yes, no) = (self.scalar(condition), self.shaped(yes), self.shaped(no));
        let (condition, yes, no) = (condition?, yes?, no?);
        if yes.shape != no.shape {
            return self.misfit(&yes, &no, "branches of one `if`", each_element(&yes, &no));
        }
        let (shape, own) = (yes.shape.clone(), yes.own || no.own);
        Some(Shaped { form: Form::If(Box::new(condition), Box::new(yes), Box::new(no)), shape, span, own })
    }

    fn sum_over(&mut self, binder: &Binder, condition: Option<&Expr>, body: &Expr, span: Span) -> Option<Shaped> {
        let mut binder = binder.clone();
        if let Some(range) = &mut binder.range {
            (range.low, range.high) = (self.scalar(&range.low)?, self.scalar(&range.high)?);
        }
        self.local.push(binder.name.text.clone());
        let condition = condition.map(|condition| self.scalar(condition).map(Box::new));
        let body = self.shaped(body);
        self.local.pop();
        let condition = match condition {
            Some(condition) => Some(condition?),
            None => None,
        };
        let body = body?;
        let (shape, own) = (body.shape.clone(), body.own);
        Some(Shaped { form: Form::SumOver(Box::new(binder), condition, Box::new(body)), shape, span, own })
    }

    /// A chain of factors, from left to right.
    fn product(&mut self, first: &Expr, rest: &[(Factor, Expr)]) -> Option<Shaped> {
        let first = self.shaped(first);
        let rest: Vec<_> = rest.iter().map(|(factor, operand)| Some((*factor, self.shaped(operand)?))).collect();
        let mut product = first?;
        for (factor, operand) in rest.into_iter().collect::<Option<Vec<_>>>()? {
            let span = Span { start: product.span.start, end: operand.span.end };
            let scales = operand.shape.is_empty() && matches!(factor, Factor::Multiply | Factor::Divide);
            if scales || product.shape.is_empty() && (factor == Factor::Multiply || operand.shape.is_empty()) {
                product = scaled(product, factor, operand, span);
            } else if factor == Factor::Multiply {
                product = self.contracted(product, operand, span)?;
            } else if operand.shape.is_empty() {
                let help = "integers are divided one by one: name the elements";
                return self.misfit(&product, &operand, "divided as integers", Some(help));
            } else {
                let help = "only a scalar divides; write the quotient of elements with an index: `z[i] = a[i]/b[i]`";
                return self.misfit(&product, &operand, "divided", Some(help));
            }
        }
        Some(product)
    }

    /// Product of two arrays.
    fn contracted(&mut self, one: Shaped, other: Shaped, span: Span) -> Option<Shaped> {
        let help = match (one.shape.as_slice(), other.shape.as_slice()) {
            ([_, inner], [outer] | [outer, _]) if inner == outer => {
                self.factors(&one, &other)?;
                let shape = one.shape.iter().take(1).chain(other.shape.iter().skip(1)).copied().collect();
                return Some(Shaped {
                    form: Form::Contracted(Box::new(one), Box::new(other)),
                    shape,
                    span,
                    own: false,
                });
            }
            ([_], [_]) => "`dot(a, b)` is the scalar product; products of elements need an index: `z[i] = a[i]*b[i]`",
            ([_], [_, _]) => "a vector is a column: write `transpose(A)*x`",
            ([_, _], [_] | [_, _]) => {
                "the second subscript of a matrix and the first one of what follows have one range"
            }
            _ => "products are made of vectors and matrices; name the elements of larger arrays",
        };
        self.misfit(&one, &other, "multiplied", Some(help))
    }

    fn dot(&mut self, one: &Expr, other: &Expr, span: Span) -> Option<Shaped> {
        let (one, other) = (self.shaped(one), self.shaped(other));
        let (one, other) = (one?, other?);
        if one.shape != other.shape || one.shape.len() != 1 {
            return self.misfit(&one, &other, "arguments of `dot`", Some("it takes two vectors over one range"));
        }
        self.factors(&one, &other)?;
        let form = Form::Contracted(Box::new(one), Box::new(other));
        Some(Shaped { form, shape: Shape::new(), span, own: false })
    }

    fn transpose(&mut self, matrix: &Expr, span: Span) -> Option<Shaped> {
        let matrix = self.shaped(matrix)?;
        let [rows, columns] = matrix.shape[..] else {
            let message = format!("`transpose` takes a matrix, this is {}", described(&matrix.shape));
            let help = "a vector is a column; the product of a row and a column is `dot(a, b)`";
            self.report.push(Diagnostic::error(codes::SHAPES, matrix.span, message).with_help(help));
            return None;
        };
        self.no_table(&matrix)?;
        let form = Form::Transposed(Box::new(matrix));
        Some(Shaped { form, shape: vec![columns, rows], span, own: false })
    }

    fn solve(&mut self, matrix: &Expr, right: &Expr, span: Span) -> Option<Shaped> {
        let right = self.shaped(right);
        let own = match &matrix.kind {
            ExprKind::Reference(reference) if reference.subscripts.is_empty() => {
                self.names.quantity(&reference.name.text).map(|number| (number, &reference.name))
            }
            _ => None,
        };
        let own = own.filter(|(number, _)| self.names.quantities[*number].matrix.is_some());
        let Some((number, name)) = own else {
            let message = "the first argument of `solve` is the name of a declared matrix";
            let help = "declare it, `matrix T[i, j] symmetric` or `matrix A[i, j]`, and give its entries equations";
            self.report.push(Diagnostic::error(codes::BAD_SYSTEM, matrix.span, message).with_help(help));
            return None;
        };
        let (right, shape) = (right?, self.shapes.get(number)?.clone()?);
        let [rows, columns] = shape[..] else { return None };
        let length = |(low, high): (i64, i64)| high - low;
        if length(rows) != length(columns) || (rows != columns && self.names.quantities[number].matrix == Some(true)) {
            let message = format!("`{}` is {}: it has not as many columns as rows", name.text, described(&shape));
            let help = "a system has as many unknowns as equations, and a symmetric matrix one range for both";
            self.report.push(Diagnostic::error(codes::BAD_SYSTEM, matrix.span, message).with_help(help));
            return None;
        }
        if !(1..=2).contains(&right.shape.len()) || right.shape[0] != rows {
            let (first, second) = (described(&shape), described(&right.shape));
            let help = "the right-hand side is a vector over the rows of the matrix, or a matrix with these rows";
            self.report.push(misfit(
                (matrix.span, &first),
                (right.span, &second),
                "matrix and right-hand side",
                Some(help),
            ));
            return None;
        }
        let shape = std::iter::once(columns).chain(right.shape.iter().skip(1).copied()).collect();
        Some(Shaped { form: Form::Solved(name.clone(), Box::new(right)), shape, span, own: false })
    }

    /// The element of a solution; `whole` if it is all that an equation defines.
    fn solved_element(
        &mut self,
        matrix: &Name,
        right: &Shaped,
        whole: &Shaped,
        subscripts: &[Expr],
        alone: bool,
    ) -> ExprKind {
        let span = whole.span;
        let right = match &right.form {
            Form::Whole(name) => name.clone(),
            _ => {
                let name = Name { text: format!("{}.right{}", matrix.text, self.systems + 1), span };
                self.hoist(name, &right.shape, span, |algebra, indices| algebra.element(right, indices))
            }
        };
        self.systems += 1;
        let solved = |subscripts: &[Expr]| ExprKind::Solved {
            matrix: Name { span, ..matrix.clone() },
            right: right.clone(),
            subscripts: subscripts.to_vec(),
        };
        if alone {
            return solved(subscripts);
        }
        let name = Name { text: format!("{}.solution{}", matrix.text, self.systems), span };
        let name = self.hoist(name, &whole.shape, span, |_, indices| Expr { kind: solved(indices), span });
        ExprKind::Reference(Reference { name, subscripts: subscripts.to_vec(), span })
    }

    /// Gives an array a name.
    fn hoist(
        &mut self,
        name: Name,
        shape: &[(i64, i64)],
        span: Span,
        value: impl FnOnce(&mut Self, &[Expr]) -> Expr,
    ) -> Name {
        let indices: Vec<Name> =
            (1..=shape.len()).map(|dimension| Name { text: format!("subscript {dimension}"), span }).collect();
        let subscripts: Vec<Expr> = indices.iter().map(index).collect();
        let value = value(self, &subscripts);
        self.hoisted.push(Hoisted { name: name.clone(), indices, shape: shape.to_vec(), value });
        name
    }

    /// The element of what an equation defines as a whole.
    pub(crate) fn defined_element(&mut self, shaped: &Shaped, subscripts: &[Expr]) -> Expr {
        match &shaped.form {
            Form::Solved(matrix, right) => {
                let kind = self.solved_element(matrix, right, shaped, subscripts, true);
                Expr { kind, span: shaped.span }
            }
            _ => self.element(shaped, subscripts),
        }
    }

    /// Reports what keeps two arrays that fit from being multiplied.
    fn factors(&mut self, one: &Shaped, other: &Shaped) -> Option<()> {
        self.no_table(one)?;
        self.no_table(other)?;
        if products(one).max(products(other)) < MOST_NESTED_PRODUCTS {
            return Some(());
        }
        let message = format!("more than {MOST_NESTED_PRODUCTS} products of arrays are nested");
        let help = "give intermediate products names of their own, as in `y = A*x`";
        self.report.push(Diagnostic::error(codes::TOO_DEEP, other.span, message).with_help(help));
        None
    }

    /// Reports a table where other elements than the declared one are needed.
    fn no_table(&mut self, array: &Shaped) -> Option<()> {
        if !array.own {
            return Some(());
        }
        let message = "a table cannot be a factor of a product of arrays";
        let help = "give it a name of its own: `param A[i, j] = [1, 2; 3, 4]`";
        self.report.push(Diagnostic::error(codes::WRONG_KIND, array.span, message).with_help(help));
        None
    }

    /// Reports two expressions that do not go together.
    fn misfit(&mut self, one: &Shaped, other: &Shaped, how: &str, help: Option<&str>) -> Option<Shaped> {
        let (first, second) = (described(&one.shape), described(&other.shape));
        self.report.push(misfit((one.span, &first), (other.span, &second), how, help));
        None
    }

    /// The element of an expression with these subscripts.
    pub(crate) fn element(&mut self, shaped: &Shaped, subscripts: &[Expr]) -> Expr {
        let subscripts = if shaped.shape.is_empty() { &[] } else { subscripts };
        let kind = match &shaped.form {
            Form::Same(kind) => kind.clone(),
            Form::Whole(name) => {
                let subscripts = subscripts.to_vec();
                ExprKind::Reference(Reference { name: name.clone(), subscripts, span: shaped.span })
            }
            Form::Sum(terms) => {
                ExprKind::Sum(terms.iter().map(|(sign, term)| (*sign, self.element(term, subscripts))).collect())
            }
            Form::Scaled(factors) => {
                let mut factors = factors.iter().map(|(factor, operand)| (*factor, self.element(operand, subscripts)));
                match factors.next() {
                    Some((_, first)) => ExprKind::Product(Box::new(first), factors.collect()),
                    None => ExprKind::Number(1.0),
                }
            }
            Form::Contracted(one, other) => self.contracted_element(one, other, subscripts, shaped.span),
            Form::Negate(operand) => ExprKind::Negate(Box::new(self.element(operand, subscripts))),
            Form::If(condition, yes, no) => ExprKind::If {
                condition: condition.clone(),
                yes: Box::new(self.element(yes, subscripts)),
                no: Box::new(self.element(no, subscripts)),
            },
            Form::SumOver(binder, condition, body) => ExprKind::SumOver {
                binder: binder.clone(),
                condition: condition.clone(),
                body: Box::new(self.element(body, subscripts)),
            },
            Form::Transposed(matrix) => {
                let swapped: Vec<Expr> = subscripts.iter().rev().cloned().collect();
                return self.element(matrix, &swapped);
            }
            Form::Solved(matrix, right) => self.solved_element(matrix, right, shaped, subscripts, false),
        };
        Expr { kind, span: shaped.span }
    }

    fn contracted_element(&mut self, one: &Shaped, other: &Shaped, subscripts: &[Expr], span: Span) -> ExprKind {
        self.sums += 1;
        // A blank keeps the name apart from those of the spec.
        let name = Name { text: format!("inner {}", self.sums), span };
        let inner = index(&name);
        let (left, right) = subscripts.split_at((one.shape.len() - 1).min(subscripts.len()));
        let left: Vec<Expr> = left.iter().chain([&inner]).cloned().collect();
        let right: Vec<Expr> = std::iter::once(&inner).chain(right).cloned().collect();
        let (first, second) = (self.element(one, &left), self.element(other, &right));
        let body = Expr { kind: ExprKind::Product(Box::new(first), vec![(Factor::Multiply, second)]), span };
        let range = other.shape.first().map(|ends| range(*ends, span));
        ExprKind::SumOver {
            binder: Box::new(Binder { name, range, rows: None }),
            condition: None,
            body: Box::new(body),
        }
    }
}

/// Products of arrays inside of one another.
fn products(shaped: &Shaped) -> usize {
    match &shaped.form {
        Form::Same(_) | Form::Whole(_) => 0,
        Form::Sum(terms) => terms.iter().map(|(_, term)| products(term)).max().unwrap_or(0),
        Form::Scaled(factors) => factors.iter().map(|(_, operand)| products(operand)).max().unwrap_or(0),
        Form::Contracted(one, other) => 1 + products(one).max(products(other)),
        Form::Solved(..) => 0,
        Form::Negate(operand) | Form::SumOver(_, _, operand) | Form::Transposed(operand) => products(operand),
        Form::If(_, yes, no) => products(yes).max(products(no)),
    }
}

/// A product and one more factor; at most one of the two is an array.
fn scaled(product: Shaped, factor: Factor, operand: Shaped, span: Span) -> Shaped {
    let shape = if product.shape.is_empty() { operand.shape.clone() } else { product.shape.clone() };
    let own = product.own || operand.own;
    let mut factors = match product.form {
        Form::Scaled(factors) => factors,
        _ => vec![(Factor::Multiply, product)],
    };
    factors.push((factor, operand));
    Shaped { form: Form::Scaled(factors), shape, span, own }
}

/// An index as an expression.
pub(crate) fn index(name: &Name) -> Expr {
    let reference = Reference { name: name.clone(), subscripts: Vec::new(), span: name.span };
    Expr { kind: ExprKind::Reference(reference), span: name.span }
}

/// A range of known ends.
pub(crate) fn range((low, high): (i64, i64), span: Span) -> Range {
    let end = |value: i64| Expr { kind: ExprKind::Number(value as f64), span };
    Range { low: end(low), high: end(high), span }
}

/// Two shapes that do not go together.
pub(crate) fn misfit(one: (Span, &str), other: (Span, &str), how: &str, help: Option<&str>) -> Diagnostic {
    let message = format!("shapes do not fit: {} and {}, {how}", one.1, other.1);
    let error =
        Diagnostic::error(codes::SHAPES, other.0, message).with_label(one.0, one.1).with_label(other.0, other.1);
    Diagnostic { help: help.map(str::to_owned), ..error }
}

/// Help where a scalar meets an array.
fn each_element(one: &Shaped, other: &Shaped) -> Option<&'static str> {
    let scalar = one.shape.is_empty() || other.shape.is_empty();
    scalar.then_some("a scalar is added to each element with an index: `y[i] = x[i] + s`")
}

/// A shape in words.
pub(crate) fn described(shape: &[(i64, i64)]) -> String {
    let ranges: Vec<String> = shape.iter().map(|(low, high)| format!("{low}..{high}")).collect();
    match ranges.len() {
        0 => "a scalar".to_owned(),
        1 => format!("a vector over {}", ranges[0]),
        2 => format!("a matrix over {}", ranges.join(", ")),
        _ => format!("an array over {}", ranges.join(", ")),
    }
}

/// Visits an expression and all its parts.
pub(crate) fn visit<'e>(expr: &'e Expr, action: &mut dyn FnMut(&'e Expr)) {
    action(expr);
    match &expr.kind {
        ExprKind::Number(_) | ExprKind::Measured(..) | ExprKind::Data { .. } | ExprKind::Samples { .. } => {}
        ExprKind::Reference(reference) => reference.subscripts.iter().for_each(|part| visit(part, action)),
        ExprKind::Sum(terms) => terms.iter().for_each(|(_, part)| visit(part, action)),
        ExprKind::Product(first, rest) => {
            visit(first, action);
            rest.iter().for_each(|(_, part)| visit(part, action));
        }
        ExprKind::Power(one, other) | ExprKind::Compare(_, one, other) => {
            visit(one, action);
            visit(other, action);
        }
        ExprKind::Negate(operand) | ExprKind::Not(operand) => visit(operand, action),
        ExprKind::If { condition, yes, no } => [condition, yes, no].into_iter().for_each(|part| visit(part, action)),
        ExprKind::SumOver { binder, condition, body } => {
            binder.range.iter().for_each(|range| [&range.low, &range.high].into_iter().for_each(|e| visit(e, action)));
            condition.iter().for_each(|part| visit(part, action));
            visit(body, action);
        }
        ExprKind::Call { arguments, .. } => arguments.iter().for_each(|part| visit(part, action)),
        ExprKind::Delayed { of, argument, .. } => {
            of.subscripts.iter().for_each(|part| visit(part, action));
            visit(argument, action);
        }
        ExprKind::Matrix(rows) => rows.iter().flatten().for_each(|part| visit(part, action)),
        ExprKind::Logical(_, operands) => operands.iter().for_each(|part| visit(part, action)),
        ExprKind::Solved { subscripts, .. } => subscripts.iter().for_each(|part| visit(part, action)),
    }
}
