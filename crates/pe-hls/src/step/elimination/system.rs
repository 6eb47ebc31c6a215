//! The linear systems of a model as equations of the model.
//!
//! Each matrix is eliminated once, in front of the first solution that needs it; its right-hand sides follow. Afterwards
//! no equation is an element of a solution, so that all methods take the model as any other.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use petgraph::algo::maximum_matching;
use petgraph::graph::{NodeIndex, UnGraph};

use pe_ir::codes;
use pe_ir::graph::{Elimination, Pivot, Role, StepGraph};
use pe_ir::index::{at, number};
use pe_ir::model::{Algebraic, Expr, Function, Matrix, Model, Solution, Variable};
use pe_ir::source::{Diagnostic, Span};

use super::order::{Order, Pattern};
use super::scheme::Scheme;
use super::{Factors, Obstacle, Row, Sink, factor, largest, pattern};

/// A model whose linear systems are equations.
pub struct Eliminated {
    /// The model.
    pub model: Model,
    /// For each of its algebraic equations the number of the variable in the step: those of the given model keep theirs,
    /// the others follow.
    numbers: Vec<u32>,
    /// Names of the others.
    names: Vec<String>,
    /// How its matrices were eliminated; pivots by their equations in `model`.
    eliminations: Vec<Elimination>,
}

/// Entries right of a pivot up to which their products are computed while its reciprocal is looked up: a product more for
/// each pair of them, and a product less between one pivot and the next.
pub(super) const MOST_AHEAD: usize = 4;

/// Whether a model has linear systems.
pub fn has_systems(model: &Model) -> bool {
    model.algebraics.iter().any(|algebraic| matches!(algebraic.expr, Expr::Solution(_)))
}

/// The orders that differ from one another for the linear systems of a model, each with the words of a step that it takes,
/// roughly, the fewest first; none if there is no system.
pub fn orders(model: &Model) -> Vec<(Order, u64)> {
    let mut seen = BTreeSet::new();
    let systems = model.algebraics.iter().filter_map(|algebraic| match &algebraic.expr {
        Expr::Solution(solution) => Some(&*solution.matrix),
        _ => None,
    });
    let patterns: Vec<Pattern> = systems
        .filter(|matrix| seen.insert(matrix.number))
        .filter_map(|matrix| {
            let mut rows = vec![Row::new(); at(matrix.size)];
            for entry in matrix.entries.iter().filter(|entry| entry.value != Expr::Constant(0.0)) {
                rows[at(entry.row)].insert(at(entry.column), entry.value.clone());
            }
            let taken = transversal(matrix, &pattern(&rows), Span::default()).ok()?;
            let rows: Vec<Row> = taken.into_iter().map(|row| rows[row].clone()).collect();
            Some(pattern(&rows))
        })
        .collect();
    let mut found: Vec<(Order, u64)> = Vec::new();
    let mut known = BTreeSet::new();
    for order in if patterns.is_empty() { &[][..] } else { &Order::ALL } {
        let all: Option<Vec<Vec<usize>>> = patterns.iter().map(|pattern| pattern.order(*order)).collect();
        let Some(all) = all.filter(|all| known.insert(all.clone())) else { continue };
        let words = patterns.iter().zip(&all).filter_map(|(pattern, rows)| pattern.estimate(rows));
        found.push((*order, words.map(|estimate| estimate.words).sum()));
    }
    found.sort_by_key(|(_, words)| *words);
    found
}

/// The schemes that differ for the linear systems of a model; none if there is no system.
pub fn schemes(model: &Model) -> &'static [Scheme] {
    let mut matrices = model.algebraics.iter().filter_map(|algebraic| match &algebraic.expr {
        Expr::Solution(solution) => Some(solution.matrix.symmetric),
        _ => None,
    });
    match matrices.next() {
        None => &[],
        Some(first) if first || matrices.any(|symmetric| symmetric) => &Scheme::ALL,
        Some(_) => &[Scheme::Ahead, Scheme::Plain],
    }
}

/// The model with all its symmetric matrices general; none if it has no such matrix.
pub fn general(model: &Model) -> Option<Model> {
    let mut general = model.clone();
    let mut known: BTreeMap<u32, Arc<Matrix>> = BTreeMap::new();
    for algebraic in &mut general.algebraics {
        if let Expr::Solution(solution) = &mut algebraic.expr {
            let own = &solution.matrix;
            let matrix = known.entry(own.number).or_insert_with(|| match own.symmetric {
                true => Arc::new(Matrix { symmetric: false, ..(**own).clone() }),
                false => Arc::clone(own),
            });
            solution.matrix = Arc::clone(matrix);
        }
    }
    let symmetric = |algebraic: &Algebraic| matches!(&algebraic.expr, Expr::Solution(own) if own.matrix.symmetric);
    model.algebraics.iter().any(symmetric).then_some(general)
}

/// Eliminates the linear systems of a model.
///
/// # Errors
/// `E0821`, `E0822` for matrices without pivots, `E0601` for one that fills in beyond a limit.
pub fn eliminate(model: &Model, order: Order, scheme: Scheme) -> Result<Eliminated, Vec<Diagnostic>> {
    eliminated(model, order, scheme).map_err(|findings| {
        let help = |finding: Diagnostic| match finding.code {
            codes::NO_PIVOT => finding.with_help(pivots_by(model, scheme)),
            _ => finding,
        };
        findings.into_iter().map(help).collect()
    })
}

/// What gives all rows their pivots, as far as it was tried.
fn pivots_by(model: &Model, scheme: Scheme) -> String {
    if let Some(order) = Order::ALL.into_iter().find(|order| eliminated(model, *order, scheme).is_ok()) {
        return format!("`--elimination {}` finds a pivot for each row (tried)", order.name());
    }
    if general(model).is_some_and(|general| eliminated(&general, Order::default(), scheme).is_ok()) {
        return "declare the matrix without `symmetric`: rows are exchanged then, and each has a pivot (tried)"
            .to_owned();
    }
    "the matrix is singular, whatever the order: look for rows that repeat others".to_owned()
}

fn eliminated(model: &Model, order: Order, scheme: Scheme) -> Result<Eliminated, Vec<Diagnostic>> {
    let mut eliminator = Eliminator {
        given: model,
        model: Model { algebraics: Vec::new(), ..model.clone() },
        numbers: Vec::new(),
        places: vec![None; model.algebraics.len()],
        names: Vec::new(),
        eliminations: Vec::new(),
        matrices: BTreeMap::new(),
        elements: elements(model),
        order,
        scheme,
    };
    let mut errors = Vec::new();
    let mut refused = BTreeSet::new();
    for (index, algebraic) in (0..).zip(&model.algebraics) {
        match &algebraic.expr {
            Expr::Solution(solution) if refused.contains(&solution.matrix.number) => {}
            Expr::Solution(solution) => {
                if let Err(error) = eliminator.solution(solution, algebraic.span) {
                    refused.insert(solution.matrix.number);
                    errors.push(error);
                }
            }
            expr if errors.is_empty() => {
                let expr = eliminator.renamed(expr);
                eliminator.push(Some(index), Algebraic { expr, ..algebraic.clone() });
            }
            _ => {}
        }
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let mut states = std::mem::take(&mut eliminator.model.states);
    for state in &mut states {
        state.equations_mut().for_each(|expr| *expr = eliminator.renamed(expr));
    }
    let mut outputs = std::mem::take(&mut eliminator.model.outputs);
    outputs.iter_mut().for_each(|output| output.variable = eliminator.variable(output.variable));
    let Eliminator { model: eliminated, mut numbers, names, eliminations, .. } = eliminator;
    let given = model.algebraics.len();
    let gone: Vec<usize> = names
        .iter()
        .scan(0, |gone, name| {
            *gone += usize::from(name.is_none());
            Some(*gone)
        })
        .collect();
    for own in numbers.iter_mut().filter(|own| at(**own) >= given) {
        *own -= gone[at(*own) - given] as u32;
    }
    let names = names.into_iter().flatten().collect();
    Ok(Eliminated { model: Model { states, outputs, ..eliminated }, numbers, names, eliminations })
}

impl Eliminated {
    /// A step of the model with the names and numbers of the one that was given.
    pub fn named(&self, given: &Model, mut graph: StepGraph) -> StepGraph {
        for value in &mut graph.values {
            if let Role::Algebraic(algebraic, _) = &mut value.role {
                *algebraic = self.numbers[at(*algebraic)];
            }
        }
        let own = given.algebraics.iter().map(|algebraic| algebraic.name.clone());
        graph.names.algebraics = own.chain(self.names.iter().cloned()).collect();
        graph.eliminations.clone_from(&self.eliminations);
        for elimination in &mut graph.eliminations {
            for pivot in &mut elimination.pivots {
                if let Pivot::Varying { reciprocal, .. } = pivot {
                    *reciprocal = self.numbers[at(*reciprocal)];
                }
            }
        }
        graph
    }
}

/// A matrix that has been eliminated.
struct Done {
    factors: Factors,
    /// For each row of the elimination the row of the matrix: that which has its pivot in this column.
    rows: Vec<usize>,
    prefix: String,
    first: i64,
}

struct Eliminator<'m> {
    given: &'m Model,
    model: Model,
    numbers: Vec<u32>,
    /// For each algebraic variable of the given model what stands for it.
    places: Vec<Option<Variable>>,
    /// Names of the others; none of those that turned out to be in the given model.
    names: Vec<Option<String>>,
    eliminations: Vec<Elimination>,
    matrices: BTreeMap<u32, Done>,
    elements: Elements,
    order: Order,
    scheme: Scheme,
}

/// For each right-hand side the elements of its solution that the model has: rows, and numbers of their equations.
type Elements = BTreeMap<u32, Vec<(usize, u32)>>;

fn elements(model: &Model) -> Elements {
    let mut elements = Elements::new();
    for (index, algebraic) in (0..).zip(&model.algebraics) {
        if let Expr::Solution(solution) = &algebraic.expr {
            elements.entry(solution.right.number).or_default().push((at(solution.row), index));
        }
    }
    elements
}

impl Eliminator<'_> {
    /// Adds an equation; `given` is its number in the given model, if it is there.
    fn push(&mut self, given: Option<u32>, algebraic: Algebraic) -> Variable {
        let variable = Variable::Algebraic(number(self.model.algebraics.len()));
        match given {
            Some(given) => {
                self.places[at(given)] = Some(variable);
                self.numbers.push(given);
            }
            None => {
                self.numbers.push(number(self.given.algebraics.len() + self.names.len()));
                self.names.push(Some(algebraic.name.clone()));
            }
        }
        self.model.algebraics.push(algebraic);
        variable
    }

    /// Whether an equation is one of the given model.
    fn is_given(&self, own: u32) -> bool {
        at(self.numbers[at(own)]) < self.given.algebraics.len()
    }

    /// Makes an equation that of an algebraic variable of the given model.
    fn claim(&mut self, own: u32, given: u32) {
        let hidden = at(self.numbers[at(own)]) - self.given.algebraics.len();
        self.names[hidden] = None;
        self.numbers[at(own)] = given;
        self.places[at(given)] = Some(Variable::Algebraic(own));
        let equation = &mut self.model.algebraics[at(own)];
        let expr = std::mem::replace(&mut equation.expr, Expr::Constant(0.0));
        *equation = Algebraic { expr, kept: true, ..self.given.algebraics[at(given)].clone() };
    }

    fn variable(&self, variable: Variable) -> Variable {
        match variable {
            Variable::Algebraic(algebraic) => self.places[at(algebraic)].expect("it is read behind its equation"),
            variable => variable,
        }
    }

    fn renamed(&self, expr: &Expr) -> Expr {
        expr.renamed(&|variable| self.variable(variable))
    }

    /// The equations of all elements of a solution that the model has, unless they are there.
    fn solution(&mut self, solution: &Solution, span: Span) -> Result<(), Diagnostic> {
        // The first element brings all others.
        let Some(wanted) = self.elements.remove(&solution.right.number) else { return Ok(()) };
        let given = self.given;
        let known = match self.matrices.remove(&solution.matrix.number) {
            Some(known) => known,
            None => self.factored(&solution.matrix, span)?,
        };
        let right = known.rows.iter().map(|row| self.renamed(&solution.right.values[*row])).collect();
        let name = format!("solution{}", solution.right.number);
        let first = self.model.algebraics.len();
        let mut sink = Rows { eliminator: self, prefix: &known.prefix, first: known.first, span, pivots: Vec::new() };
        let found = known.factors.solve(&mut sink, right, &name);
        for (row, index) in wanted {
            let algebraic = &given.algebraics[at(index)];
            match found[row] {
                Expr::Variable(Variable::Algebraic(own)) if at(own) >= first && !self.is_given(own) => {
                    self.claim(own, index);
                }
                ref expr => _ = self.push(Some(index), Algebraic { expr: expr.clone(), ..algebraic.clone() }),
            }
        }
        self.matrices.insert(solution.matrix.number, known);
        Ok(())
    }

    fn factored(&mut self, matrix: &Matrix, span: Span) -> Result<Done, Diagnostic> {
        let size = at(matrix.size);
        let mut given = vec![Row::new(); size];
        for entry in matrix.entries.iter().filter(|entry| entry.value != Expr::Constant(0.0)) {
            given[at(entry.row)].insert(at(entry.column), self.renamed(&entry.value));
        }
        let rows = transversal(matrix, &pattern(&given), span)?;
        let taken: Vec<Row> = rows.iter().map(|row| given[*row].clone()).collect();
        let places = pattern(&taken);
        let order = places.order(self.order).or_else(|| places.order(Order::Fill));
        let order = order.ok_or_else(|| no_pivots(matrix, span))?;
        let estimate = places.estimate(&order).ok_or_else(|| no_pivots(matrix, span))?;
        let (prefix, first) = (matrix.name.clone(), matrix.first.1);
        let mut sink = Rows { eliminator: self, prefix: &prefix, first, span, pivots: Vec::new() };
        let factors = factor(&mut sink, taken, matrix.symmetric, order);
        let pivots = sink.pivots;
        let factors = factors.map_err(|obstacle| match obstacle {
            Obstacle::Singular(row) => {
                let message = format!(
                    "the matrix `{}` has no pivot in column {}: what is left of it there is zero",
                    matrix.name,
                    first + row as i64
                );
                Diagnostic::error(codes::NO_PIVOT, span, message)
            }
            Obstacle::Large => {
                let message = format!("the matrix `{}` fills in beyond {} entries", matrix.name, largest());
                Diagnostic::error(codes::TOO_MANY_ELEMENTS, span, message)
                    .with_help("split the system into smaller ones")
            }
        })?;
        self.eliminations.push(Elimination {
            name: matrix.name.clone(),
            order: self.order.name().to_owned(),
            scheme: self.scheme.name().to_owned(),
            size: matrix.size,
            symmetric: matrix.symmetric,
            entries: number(matrix.entries.len()),
            fill: estimate.fill as u32,
            depth: estimate.depth as u32,
            pivots,
        });
        Ok(Done { factors, rows, prefix, first })
    }
}

/// The equations of a matrix in a model.
struct Rows<'e, 'm> {
    eliminator: &'e mut Eliminator<'m>,
    prefix: &'e str,
    first: i64,
    span: Span,
    pivots: Vec<Pivot>,
}

impl Rows<'_, '_> {
    fn push(&mut self, name: String, expr: Expr) -> Expr {
        let algebraic = Algebraic { name, unit: None, expr, range: None, kept: true, angle: false, span: self.span };
        Expr::Variable(self.eliminator.push(None, algebraic))
    }
}

impl Sink for Rows<'_, '_> {
    fn row_name(&self, row: usize) -> String {
        format!("{}[{}]", self.prefix, self.first + row as i64)
    }

    fn quantity(&mut self, _: usize, name: &dyn Fn() -> String, expr: Expr) -> Expr {
        let scaled = |members: &[Expr]| matches!(members, [Expr::Constant(_), Expr::Variable(_)]);
        match expr {
            Expr::Constant(_) | Expr::Variable(_) => expr,
            Expr::Product(members) if scaled(&members) => Expr::Product(members),
            expr => self.push(name(), expr),
        }
    }

    fn reciprocal(&mut self, row: usize, pivot: Expr, root: bool) -> Expr {
        let name = self.row_name(row);
        let divisor = match pivot {
            Expr::Variable(_) => pivot,
            pivot => self.push(format!("{name}.divisor"), pivot),
        };
        let function = if root { Function::RealPower(-0.5) } else { Function::Reciprocal };
        let reciprocal = self.push(format!("{name}.pivot"), Expr::Apply(function, Box::new(divisor)));
        if let Expr::Variable(Variable::Algebraic(reciprocal)) = reciprocal {
            self.pivots.push(Pivot::Varying { reciprocal, range: None });
        }
        reciprocal
    }

    fn constant_pivot(&mut self, _: usize, number: f64) {
        self.pivots.push(Pivot::Number(number));
    }

    fn is_short(&self) -> bool {
        true
    }

    fn multiplies_ahead(&self, entries: usize) -> bool {
        self.eliminator.scheme == Scheme::Ahead && entries <= MOST_AHEAD
    }

    fn scheme(&self) -> Scheme {
        self.eliminator.scheme
    }
}

/// For each column a row that has an entry there, every row once: the rows as they are wherever that is possible.
///
/// # Errors
/// `E0821` if there is none.
fn transversal(matrix: &Matrix, places: &Pattern, span: Span) -> Result<Vec<usize>, Diagnostic> {
    let size = places.size();
    let natural: Vec<usize> = (0..size).collect();
    if matrix.symmetric && places.order(Order::Fill).is_some() || natural.iter().all(|row| places.has(*row, *row)) {
        return Ok(natural);
    }
    let mut graph = UnGraph::<(), ()>::with_capacity(2 * size, places.entries());
    (0..2 * size).for_each(|_| _ = graph.add_node(()));
    for (row, column) in places.all() {
        graph.add_edge(NodeIndex::new(row), NodeIndex::new(size + column), ());
    }
    let matching = maximum_matching(&graph);
    let row_of = |column: usize| matching.mate(NodeIndex::new(size + column)).map(|row| row.index());
    let rows: Option<Vec<usize>> = (0..size).map(row_of).collect();
    match rows {
        Some(_) if matrix.symmetric => Err(no_pivots(matrix, span)),
        Some(rows) => Ok(rows),
        None => {
            let free: Vec<usize> = (0..size).filter(|column| row_of(*column).is_none()).collect();
            let (rows, columns) =
                deficient(places, &free, &|row| matching.mate(NodeIndex::new(row)).map(|c| c.index() - size));
            Err(singular(matrix, &rows, &columns, span))
        }
    }
}

/// Columns that have entries in fewer rows than they are, and these rows (Dulmage and Mendelsohn 1958): what alternating
/// paths reach from columns without a row.
fn deficient(
    places: &Pattern,
    free: &[usize],
    column_of: &dyn Fn(usize) -> Option<usize>,
) -> (BTreeSet<usize>, BTreeSet<usize>) {
    let mut columns: BTreeSet<usize> = free.iter().copied().take(1).collect();
    let mut rows = BTreeSet::new();
    let mut open: Vec<usize> = columns.iter().copied().collect();
    while let Some(column) = open.pop() {
        for (row, _) in places.all().filter(|(_, other)| *other == column) {
            if rows.insert(row)
                && let Some(next) = column_of(row).filter(|next| columns.insert(*next))
            {
                open.push(next);
            }
        }
    }
    (rows, columns)
}

/// Rows and columns that a message lists.
const SHOWN: usize = 6;

fn listed(first: i64, members: &BTreeSet<usize>) -> String {
    let mut shown: Vec<String> = members.iter().take(SHOWN).map(|at| (first + *at as i64).to_string()).collect();
    if members.len() > SHOWN {
        shown.push(format!("and {} more", members.len() - SHOWN));
    }
    shown.join(", ")
}

fn singular(matrix: &Matrix, rows: &BTreeSet<usize>, columns: &BTreeSet<usize>, span: Span) -> Diagnostic {
    let columns_text = listed(matrix.first.1, columns);
    let message = if rows.is_empty() {
        format!("the matrix `{}` is singular: column {columns_text} is zero", matrix.name)
    } else {
        format!(
            "the matrix `{}` is singular: its columns {columns_text} have entries in the rows {} alone",
            matrix.name,
            listed(matrix.first.0, rows)
        )
    };
    let help =
        "an equation is missing, or an unknown too much: look for entries of these columns that no equation defines";
    Diagnostic::error(codes::SINGULAR_MATRIX, span, message).with_help(help)
}

fn no_pivots(matrix: &Matrix, span: Span) -> Diagnostic {
    let message =
        format!("no order gives each row of the symmetric matrix `{}` a pivot: its diagonal stays zero", matrix.name);
    Diagnostic::error(codes::NO_PIVOT, span, message)
}
