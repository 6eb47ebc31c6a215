//! Values of expressions of tensors, cell by cell, by the rules of DiffSL for indices, shapes and sums.

use std::collections::{HashMap, HashSet};

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

use super::parse::{Element, Node, NodeKind, Range};
use crate::expr::{Expr, Relation};
use crate::mathml::operation;

/// Cells of all values that are computed, and parts of expressions that are repeated, together.
pub(super) const MOST_CELLS: usize = 4_000_000;

/// Most points of an interpolated function.
const MOST_POINTS: usize = 100;

/// Functions, each with its name in MathML.
const FUNCTIONS: [(&str, &str, usize); 16] = [
    ("pow", "power", 2),
    ("min", "min", 2),
    ("max", "max", 2),
    ("sin", "sin", 1),
    ("cos", "cos", 1),
    ("tan", "tan", 1),
    ("exp", "exp", 1),
    ("log", "ln", 1),
    ("abs", "abs", 1),
    ("sinh", "sinh", 1),
    ("cosh", "cosh", 1),
    ("tanh", "tanh", 1),
    ("arcsinh", "arcsinh", 1),
    ("arccosh", "arccosh", 1),
    ("log10", "", 1),
    ("sqrt", "", 1),
];

/// A tensor that has a name, or a part of one: cells in row-major order, without entry where it is sparse.
#[derive(Clone)]
pub(super) struct Known {
    pub shape: Vec<usize>,
    pub cells: Vec<Expr>,
    /// Values of cells that are numbers.
    pub numbers: Vec<Option<f64>>,
}

/// A value over the indices of an element and those that it sums over; a length of 1 fits any.
struct Value {
    shape: Vec<usize>,
    cells: Vec<Expr>,
    numbers: Vec<Option<f64>>,
}

/// A part of a tensor: where it begins, its lengths, and its cells with their places.
pub(super) struct Block {
    pub start: Vec<usize>,
    pub shape: Vec<usize>,
    /// By their places within the block; those that are missing are zero.
    pub cells: Vec<(Vec<usize>, Expr, Option<f64>)>,
}

/// Evaluates expressions.
#[derive(Default)]
pub(super) struct Evaluator {
    pub known: HashMap<String, Known>,
    /// Names of tensors that could not be read.
    pub broken: HashSet<String>,
    /// Whether there are tensors whose names are not known.
    is_incomplete: bool,
    /// Whether one that could not be read was read.
    pub reads_broken: bool,
    spent: usize,
}

type Read<T> = Result<T, Diagnostic>;

fn wrong(span: Span, message: impl Into<String>) -> Diagnostic {
    Diagnostic::error(codes::IMPORT_MATH, span, message.into())
}

impl Evaluator {
    /// One that knows no tensor yet; `is_incomplete` says whether some could not be read.
    pub fn new(is_incomplete: bool) -> Evaluator {
        Evaluator { is_incomplete, ..Evaluator::default() }
    }

    /// What an element gives its tensor, of which `next` is the place behind the element before.
    pub fn block(&mut self, element: &Element, indices: &[char], next: &[usize]) -> Read<Block> {
        let mut axes = indices.to_vec();
        summed(&element.value, &mut axes);
        if axes.len() > indices.len() + 1 {
            let sums: Vec<String> = axes[indices.len()..].iter().map(|index| format!("`{index}`")).collect();
            let finding = wrong(element.value.span, format!("it sums over {} at once", sums.join(" and ")));
            return Err(finding.with_help("an element sums over one index: give the inner sum a tensor of its own"));
        }
        let mut value = self.value(&element.value, &axes)?;
        if axes.len() > indices.len() {
            value = contracted(value);
        }
        let rank = indices.len();
        let Some(place) = &element.place else {
            let cells = places(&value.shape).zip(value.cells).zip(value.numbers);
            let cells = cells.map(|((place, cell), number)| (place, cell, number)).collect();
            return Ok(Block { start: next.to_vec(), shape: value.shape, cells });
        };
        if place.len() != rank {
            let message = format!("{} numbers say where it stands in a tensor of {rank} dimensions", place.len());
            return Err(wrong(element.span, message));
        }
        self.placed(element, place, value)
    }

    /// The block of an element that says where it stands.
    fn placed(&mut self, element: &Element, place: &[Range], value: Value) -> Read<Block> {
        let span = element.span;
        let start: Vec<usize> = place.iter().map(|range| range.first).collect();
        let length = |range: &Range| match range.end {
            Some(end) => end.checked_sub(range.first).filter(|length| *length > 0),
            None => Some(1),
        };
        let shape: Option<Vec<usize>> = place.iter().map(length).collect();
        let shape = shape.ok_or_else(|| wrong(span, "a range ends before it begins, or is empty"))?;
        if place.iter().any(|range| range.diagonal) {
            let same = shape.windows(2).all(|pair| pair[0] == pair[1]);
            let long: Vec<usize> = value.shape.iter().copied().filter(|length| *length > 1).collect();
            if !same || !place.iter().all(|range| range.diagonal) || long.len() > 1 {
                return Err(wrong(
                    span,
                    "a diagonal has `..` in all dimensions, with one length, and a vector or scalar as value",
                ));
            }
            if long.first().is_some_and(|length| *length != shape[0]) {
                return Err(wrong(span, format!("the diagonal has {} cells, and its value {}", shape[0], long[0])));
            }
            self.spend(shape[0], span)?;
            let cell = |index: usize| if value.cells.len() == 1 { 0 } else { index };
            let cells = (0..shape[0])
                .map(|index| (vec![index; shape.len()], value.cells[cell(index)].clone(), value.numbers[cell(index)]));
            return Ok(Block { cells: cells.collect(), start, shape });
        }
        let value = self.stretched(value, &shape, span)?;
        let cells = places(&shape).zip(value.cells).zip(value.numbers);
        let cells = cells.map(|((place, cell), number)| (place, cell, number)).collect();
        Ok(Block { start, shape, cells })
    }

    fn spend(&mut self, cells: usize, span: Span) -> Read<()> {
        // It is told once.
        self.reads_broken |= self.spent > MOST_CELLS;
        self.spent = self.spent.saturating_add(cells);
        if self.spent <= MOST_CELLS {
            return Ok(());
        }
        Err(Diagnostic::error(
            codes::IMPORT_LIMIT,
            span,
            "the tensors of the file are too large when they are written out",
        ))
    }

    /// Takes a size in, before cells are made.
    fn room(&mut self, shape: &[usize], span: Span) -> Read<()> {
        let cells = shape.iter().try_fold(1usize, |cells, length| cells.checked_mul(*length));
        self.spend(cells.unwrap_or(usize::MAX), span)
    }

    /// A value with its cells repeated along dimensions in which it has one.
    fn stretched(&mut self, value: Value, shape: &[usize], span: Span) -> Read<Value> {
        if value.shape == shape {
            return Ok(value);
        }
        if !value.shape.iter().zip(shape).all(|(own, wanted)| own == wanted || *own == 1) {
            let message =
                format!("a value of {} does not fit where {} are needed", lengths(&value.shape), lengths(shape));
            return Err(wrong(span, message));
        }
        self.room(shape, span)?;
        let repeated = shape.iter().product::<usize>() / value.cells.len().max(1);
        let size = value.cells.iter().map(|cell| cell.extent().1).fold(0, usize::saturating_add);
        self.spend(size.saturating_mul(repeated), span)?;
        let sources: Vec<usize> = places(shape)
            .map(|place| {
                let own = place.iter().zip(&value.shape);
                own.fold(0, |at, (index, length)| at * length + if *length == 1 { 0 } else { *index })
            })
            .collect();
        Ok(Value {
            shape: shape.to_vec(),
            cells: sources.iter().map(|source| value.cells[*source].clone()).collect(),
            numbers: sources.iter().map(|source| value.numbers[*source]).collect(),
        })
    }

    fn value(&mut self, node: &Node, axes: &[char]) -> Read<Value> {
        match &node.kind {
            NodeKind::Number(literal) => {
                Ok(Value { shape: vec![1; axes.len()], cells: vec![literal.clone()], numbers: vec![literal.literal()] })
            }
            NodeKind::Negated(inner) => {
                let inner = self.value(inner, axes)?;
                Ok(inner.mapped(Expr::negated, |number| -number))
            }
            NodeKind::Chain(first, others) => {
                let is_sum = others.iter().all(|(sign, _)| "+-".contains(*sign));
                let mut left = self.value(first, axes)?;
                // Terms of a long sum or product are joined at once.
                let alone = |cells: &mut Vec<Expr>| cells.drain(..).map(|cell| vec![(false, cell)]).collect::<Vec<_>>();
                let mut members = alone(&mut left.cells);
                for (sign, other) in others {
                    let right = self.value(other, axes)?;
                    let shape = self.common(&[&left.shape, &right.shape], node.span)?;
                    if shape != left.shape {
                        left.cells = members.into_iter().map(|members| join(is_sum, members)).collect();
                        left = self.stretched(left, &shape, node.span)?;
                        members = alone(&mut left.cells);
                    }
                    let right = self.stretched(right, &shape, node.span)?;
                    self.room(&shape, node.span)?;
                    for (index, (cell, number)) in right.cells.into_iter().zip(right.numbers).enumerate() {
                        let is_zero =
                            |members: &[(bool, Expr)]| members.iter().any(|(_, own)| own.literal() == Some(0.0));
                        if *sign == '/' && cell.literal() == Some(0.0) && !is_zero(&members[index]) {
                            return Err(wrong(node.span, "it divides by zero"));
                        }
                        members[index].push((matches!(sign, '-' | '/'), cell));
                        left.numbers[index] = left.numbers[index].zip(number).map(|(a, b)| match sign {
                            '+' => a + b,
                            '-' => a - b,
                            '*' => a * b,
                            _ => a / b,
                        });
                    }
                }
                left.cells = members.into_iter().map(|members| join(is_sum, members)).collect();
                Ok(left)
            }
            NodeKind::Call(name, arguments) => self.call(name, arguments, axes, node.span),
            NodeKind::Name { name, indices, at } => self.name(name, indices, *at, axes, node.span),
        }
    }

    /// The shape that several have in common.
    fn common(&self, shapes: &[&Vec<usize>], span: Span) -> Read<Vec<usize>> {
        let mut common = shapes[0].clone();
        for shape in shapes {
            for (length, other) in common.iter_mut().zip(*shape) {
                if *length == 1 {
                    *length = *other;
                } else if *other != 1 && other != length {
                    let message =
                        format!("values of {} and {} do not fit together", lengths(shapes[0]), lengths(shape));
                    return Err(wrong(span, message));
                }
            }
        }
        Ok(common)
    }

    fn call(&mut self, name: &str, arguments: &[Node], axes: &[char], span: Span) -> Read<Value> {
        if name == "interp1d" {
            return self.interpolated(arguments, axes, span);
        }
        let takes = match name {
            "sigmoid" | "heaviside" => 1,
            "copysign" => 2,
            _ => FUNCTIONS.iter().find(|(known, ..)| *known == name).map_or(0, |(.., takes)| *takes),
        };
        if takes != arguments.len() {
            let known = if takes == 0 { "is not known".to_owned() } else { format!("takes {takes} arguments") };
            return Err(wrong(span, format!("the function `{name}` {known}")));
        }
        let values: Vec<Value> = arguments.iter().map(|argument| self.value(argument, axes)).collect::<Read<_>>()?;
        let shape = self.common(&values.iter().map(|value| &value.shape).collect::<Vec<_>>(), span)?;
        let mut values = values
            .into_iter()
            .map(|value| self.stretched(value, &shape, span).map(|value| value.cells.into_iter()))
            .collect::<Read<Vec<_>>>()?;
        let count = shape.iter().product();
        self.spend(count, span)?;
        let mut cells = Vec::with_capacity(count);
        for _ in 0..count {
            let arguments: Vec<Expr> = values.iter_mut().filter_map(Iterator::next).collect();
            cells.push(called(name, arguments).map_err(|problem| wrong(span, problem))?);
        }
        Ok(Value { shape, numbers: vec![None; cells.len()], cells })
    }

    /// A function that is linear between points, and the same beyond the first and the last.
    fn interpolated(&mut self, arguments: &[Node], axes: &[char], span: Span) -> Read<Value> {
        let [x, y, at] = arguments else { return Err(wrong(span, "the function `interp1d` takes 3 arguments")) };
        let mut points = Vec::new();
        for node in [x, y] {
            let mut own = Vec::new();
            summed(node, &mut own);
            let value = self.value(node, &own)?;
            let numbers: Option<Vec<f64>> = value.numbers.into_iter().collect();
            match numbers.filter(|_| own.len() == 1) {
                Some(numbers) => points.push(numbers),
                None => {
                    let finding = wrong(node.span, "points of `interp1d` are vectors of numbers");
                    return Err(finding.with_help("write the numbers into the tensor that gives the points"));
                }
            }
        }
        let (x, y) = (&points[0], &points[1]);
        if x.len() != y.len() || x.windows(2).any(|pair| pair[0] >= pair[1]) || x.is_empty() {
            return Err(wrong(span, "points of `interp1d` rise, and there are as many values as points"));
        }
        if x.len() > MOST_POINTS {
            let message = format!("it has {} points; at most {MOST_POINTS} can be written", x.len());
            return Err(Diagnostic::error(codes::IMPORT_LIMIT, span, message));
        }
        let at = self.value(at, axes)?;
        let size = at.cells.iter().map(|cell| cell.extent().1).fold(0, usize::saturating_add);
        self.spend(size.saturating_mul(2 * x.len()), span)?;
        let number = |value: f64| match value {
            value if value < 0.0 => Expr::number(-value).negated(),
            value => Expr::number(value),
        };
        Ok(at
            .mapped(
                |at| {
                    let mut pieces = vec![(Expr::compare(Relation::LessEqual, at.clone(), number(x[0])), number(y[0]))];
                    for index in 1..x.len() {
                        let slope = (y[index] - y[index - 1]) / (x[index] - x[index - 1]);
                        let beyond = Expr::sum([(false, at.clone()), (true, number(x[index - 1]))]);
                        let rise = Expr::number(slope.abs()).times(beyond);
                        let value = Expr::sum([(false, number(y[index - 1])), (slope < 0.0, rise)]);
                        pieces.push((Expr::compare(Relation::Less, at.clone(), number(x[index])), value));
                    }
                    Expr::choice(pieces, number(y[x.len() - 1]))
                },
                |_| f64::NAN,
            )
            .without_numbers())
    }

    fn name(
        &mut self,
        name: &str,
        indices: &[char],
        at: Option<(i64, Option<i64>)>,
        axes: &[char],
        span: Span,
    ) -> Read<Value> {
        let one = |cell: Expr, number: Option<f64>| Value {
            shape: vec![1; axes.len()],
            cells: vec![cell],
            numbers: vec![number],
        };
        if name == "t" && indices.is_empty() && at.is_none() {
            return Ok(one(Expr::Time, None));
        }
        if name == "N" && indices.is_empty() && at.is_none() {
            return Ok(one(Expr::number(0.0), Some(0.0)));
        }
        if self.broken.contains(name) || self.is_incomplete && !self.known.contains_key(name) {
            self.reads_broken = true;
            return Ok(one(Expr::number(1.0), None));
        }
        let Some(known) = self.known.get(name) else {
            let finding =
                Diagnostic::error(codes::IMPORT_UNKNOWN, span, format!("there is no `{name}` before this place"));
            return Err(finding.with_help("DiffSL defines tensors before it reads them"));
        };
        let (mut shape, mut cells, mut numbers) = (known.shape.clone(), None, None);
        if let Some((first, last)) = at {
            let count = known.cells.len();
            let end = last.unwrap_or(first.saturating_add(1));
            let range = usize::try_from(first).ok().zip(usize::try_from(end).ok());
            let range = range.filter(|(first, end)| first < end && *end <= count && shape.len() == 1);
            let Some((first, end)) = range else {
                return Err(wrong(span, format!("`{name}` has no such part: it has {}", lengths(&shape))));
            };
            if last.is_none() {
                return Ok(one(known.cells[first].clone(), known.numbers[first]));
            }
            shape = vec![end - first];
            cells = Some(known.cells[first..end].to_vec());
            numbers = Some(known.numbers[first..end].to_vec());
        }
        let twice = (1..indices.len()).any(|index| indices[..index].contains(&indices[index]));
        if indices.len() > shape.len() || twice || shape[indices.len()..].iter().any(|length| *length > 1) {
            let with = if indices.is_empty() { String::new() } else { "_".to_owned() };
            let with: String = with.chars().chain(indices.iter().copied()).collect();
            let message = format!("`{name}` has {}, and `{name}{with}` does not fit", lengths(&shape));
            let finding = wrong(span, message);
            return Err(finding.with_help("a name is followed by an index for each dimension, each once"));
        }
        shape.truncate(indices.len());
        let (cells, numbers) =
            (cells.unwrap_or_else(|| known.cells.clone()), numbers.unwrap_or_else(|| known.numbers.clone()));
        let size = cells.iter().map(|cell| cell.extent().1).fold(0, usize::saturating_add);
        self.spend(size, span)?;
        // In the order of the axes.
        let mut wide = vec![1; axes.len()];
        let of: Vec<usize> =
            indices.iter().map(|index| axes.iter().position(|axis| axis == index).unwrap_or(0)).collect();
        of.iter().zip(&shape).for_each(|(axis, length)| wide[*axis] = *length);
        let sources: Vec<usize> = places(&wide)
            .map(|place| of.iter().zip(&shape).fold(0, |at, (axis, length)| at * length + place[*axis]))
            .collect();
        Ok(Value {
            shape: wide,
            cells: sources.iter().map(|source| cells[*source].clone()).collect(),
            numbers: sources.iter().map(|source| numbers[*source]).collect(),
        })
    }
}

impl Value {
    fn mapped(self, expr: impl Fn(Expr) -> Expr, number: impl Fn(f64) -> f64) -> Value {
        Value {
            shape: self.shape,
            cells: self.cells.into_iter().map(expr).collect(),
            numbers: self.numbers.into_iter().map(|own| own.map(&number)).collect(),
        }
    }

    fn without_numbers(mut self) -> Value {
        self.numbers.fill(None);
        self
    }
}

fn join(is_sum: bool, members: Vec<(bool, Expr)>) -> Expr {
    if is_sum { Expr::sum(members) } else { Expr::product(members) }
}

fn called(name: &str, mut arguments: Vec<Expr>) -> Result<Expr, String> {
    match name {
        "log10" | "sqrt" => Ok(Expr::call(if name == "sqrt" { "sqrt" } else { "log10" }, arguments)),
        "sigmoid" => {
            let below = Expr::call("exp", vec![arguments.remove(0).negated()]);
            Ok(Expr::number(1.0).over(Expr::sum([(false, Expr::number(1.0)), (false, below)])))
        }
        "heaviside" => {
            let condition = Expr::compare(Relation::GreaterEqual, arguments.remove(0), Expr::number(0.0));
            Ok(condition.into_number())
        }
        "copysign" => {
            let size = Expr::call("abs", vec![arguments.remove(0)]);
            let below = Expr::compare(Relation::Less, arguments.remove(0), Expr::number(0.0));
            Ok(Expr::choice(vec![(below, size.clone().negated())], size))
        }
        _ => match FUNCTIONS.iter().find(|(known, ..)| *known == name) {
            Some((_, meaning, _)) => operation(meaning, arguments),
            None => Err(format!("the function `{name}` is not known")),
        },
    }
}

/// Adds the indices that an expression has and the list has not.
fn summed(node: &Node, axes: &mut Vec<char>) {
    match &node.kind {
        NodeKind::Number(_) => {}
        NodeKind::Negated(inner) => summed(inner, axes),
        NodeKind::Chain(first, others) => {
            summed(first, axes);
            others.iter().for_each(|(_, other)| summed(other, axes));
        }
        // The points of `interp1d` have an index of their own.
        NodeKind::Call(name, arguments) if name == "interp1d" => {
            arguments.iter().skip(2).for_each(|at| summed(at, axes))
        }
        NodeKind::Call(_, arguments) => arguments.iter().for_each(|argument| summed(argument, axes)),
        NodeKind::Name { at: Some((_, None)), .. } => {}
        NodeKind::Name { indices, .. } => {
            for index in indices {
                if !axes.contains(index) {
                    axes.push(*index);
                }
            }
        }
    }
}

/// The sum over the last dimension.
fn contracted(mut value: Value) -> Value {
    let length = value.shape.pop().unwrap_or(1);
    let cells = value.cells.chunks(length).map(|row| Expr::sum(row.iter().map(|cell| (false, cell.clone()))));
    let numbers = value.numbers.chunks(length).map(|row| row.iter().copied().sum());
    Value { cells: cells.collect(), numbers: numbers.collect(), shape: value.shape }
}

/// All places of a shape in row-major order.
pub(super) fn places(shape: &[usize]) -> impl Iterator<Item = Vec<usize>> {
    let shape = shape.to_vec();
    let count: usize = shape.iter().product();
    (0..count).map(move |index| {
        let mut left = index;
        let mut place = vec![0; shape.len()];
        for (at, length) in place.iter_mut().zip(&shape).rev() {
            *at = left % length;
            left /= length;
        }
        place
    })
}

/// A shape in words.
pub(super) fn lengths(shape: &[usize]) -> String {
    match shape {
        [] => "no dimensions".to_owned(),
        [length] => format!("{length} cells"),
        _ => shape.iter().map(usize::to_string).collect::<Vec<_>>().join(" x ") + " cells",
    }
}
