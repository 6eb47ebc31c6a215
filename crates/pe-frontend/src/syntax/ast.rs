//! The syntax tree: what the spec says, statement by statement, before any name is looked up.
//!
//! Chains of one operator are lists, not nested pairs: a sum of a hundred thousand terms is as deep as one of two, so
//! every later pass may recurse. The depth that remains is bounded by the nesting limit of the splitter.

use crate::syntax::tables::Table;
use pe_ir::source::Span;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A spec, included files among it.
#[derive(Debug, Default)]
pub struct Spec {
    /// Statements without syntax errors, in source order.
    pub statements: Vec<Statement>,
    /// Statements with syntax errors, as far as they could be made out.
    pub broken: Vec<Broken>,
    /// The sampled blocks, in source order.
    pub blocks: Vec<Block>,
    /// The components, in source order.
    pub components: Vec<Component>,
    /// Indices that arrays of instances have.
    pub(crate) of_instances: BTreeSet<String>,
    /// Whether a file could not be read, so that any name may be defined in it.
    pub names_missing: bool,
    /// Whether a number has a unit behind it.
    pub measured: bool,
    /// Places that name files, each with the file, in the order in which they were met.
    pub files: Vec<(Span, Span)>,
    /// The data files.
    pub(crate) tables: Vec<Arc<Table>>,
    /// Number of the table that a path stands for, by the place of the path; none for a file that could not be read.
    pub(crate) table_at: BTreeMap<Span, usize>,
}

impl Spec {
    /// The same spec without its statements and components, for a pass that writes them anew.
    pub(crate) fn emptied(&self) -> Spec {
        Spec {
            statements: Vec::with_capacity(self.statements.len()),
            broken: self.broken.clone(),
            blocks: self.blocks.clone(),
            components: Vec::new(),
            of_instances: self.of_instances.clone(),
            names_missing: self.names_missing,
            measured: self.measured,
            files: self.files.clone(),
            tables: self.tables.clone(),
            table_at: self.table_at.clone(),
        }
    }

    /// The data file that a path names, `None` if it could not be read.
    pub(crate) fn table(&self, path: &Name) -> Option<&Table> {
        self.table_at.get(&path.span).map(|number| &*self.tables[*number])
    }
}

/// What is known of a statement that could not be parsed, or whose data file could not be read; keeps one mistake from
/// being reported many times.
#[derive(Clone, Debug, Default)]
pub struct Broken {
    /// The keyword it begins with, empty for an equation.
    pub section: String,
    /// Names that it may define.
    pub names: Vec<String>,
}

/// A name and its place.
#[derive(Clone, Debug)]
pub struct Name {
    /// The identifier.
    pub text: String,
    /// Its place.
    pub span: Span,
}

/// A block `every PERIOD { ... }`.
#[derive(Clone, Debug)]
pub struct Block {
    /// Time from one sample to the next; none after an error there.
    pub period: Option<Measure>,
    /// `every PERIOD {`.
    pub span: Span,
}

/// A component: `component NAME(p [unit] = expr, ...) { ... }`.
#[derive(Clone, Debug)]
pub struct Component {
    /// Its name.
    pub name: Name,
    /// What its instances may or must be told.
    pub parameters: Vec<Parameter>,
    /// Its statements; blocks are numbered in [`Component::blocks`].
    pub statements: Vec<Statement>,
    /// Its sampled blocks.
    pub blocks: Vec<Block>,
    /// `component NAME(...) {`.
    pub span: Span,
    /// All of it, up to its `}`.
    pub extent: Span,
    /// Whether a statement of it has an error.
    pub broken: bool,
}

/// A parameter of a component.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Its name.
    pub name: Name,
    /// Text in the unit bracket.
    pub unit: Option<Name>,
    /// Its value where an instance says nothing.
    pub value: Option<Expr>,
}

/// A statement and its place, comments excluded at both ends.
#[derive(Clone, Debug)]
pub struct Statement {
    /// What it says.
    pub kind: StatementKind,
    /// The sampled block that it stands in, in [`Spec::blocks`].
    pub block: Option<usize>,
    /// First to last character.
    pub span: Span,
    /// Paths of the data files that it names, each with the place of its quotes.
    pub files: Vec<Name>,
}

/// The kinds of statements.
#[derive(Clone, Debug)]
pub enum StatementKind {
    /// `model NAME "title"`.
    Model {
        /// Identifier of the model.
        name: Name,
        /// Free text, empty if not given.
        title: String,
    },
    /// `solver NAME`.
    Solver(Name),
    /// `step 100 us`, with steps for the beginning of the run, each with the time until which it is taken, in front.
    Step(Measure, Vec<(Measure, Measure)>),
    /// `span 2 s`.
    Span(Measure),
    /// `const NAME = expr`.
    Const {
        /// The constant.
        name: Name,
        /// Its value.
        value: Expr,
    },
    /// `index i in 1..80, j in 1..80`; every binder has a range.
    Index(Vec<Binder>),
    /// `param R[b] [unit] = expr`.
    Param {
        /// Name, dimensions, unit.
        declared: Declared,
        /// Value of an element.
        value: Expr,
    },
    /// `param k [unit] = expr tunable in lo .. hi`. The reader writes it out as a state that stands still, so no pass meets
    /// it.
    Tunable {
        /// Name, dimensions, unit.
        declared: Declared,
        /// Value of an element at time zero.
        value: Expr,
        /// Range of the values that it may be given.
        within: Range,
    },
    /// `input u [unit] = signal in lo .. hi`.
    Input {
        /// Name, dimensions, unit.
        declared: Declared,
        /// The signal over time.
        signal: Expr,
        /// What it is between two samples, `hold` or `linear`.
        between: Option<Name>,
        /// Stated range.
        within: Option<Range>,
    },
    /// `state V[b] [unit] = expr in lo .. hi`, or `angle x [unit] = expr`.
    State {
        /// Name, dimensions, unit.
        declared: Declared,
        /// Value at time zero.
        initial: Expr,
        /// Stated range.
        within: Option<Range>,
        /// What is special about it.
        sort: Sort,
    },
    /// `matrix T[i, j] [unit] symmetric`.
    Matrix {
        /// Name, dimensions, unit.
        declared: Declared,
        /// Whether it equals its transpose.
        symmetric: bool,
    },
    /// `V[b]' = expr where condition`.
    Equation(Equation),
    /// `output V[1], w`.
    Output(Vec<OutputItem>),
    /// `function f(x, y) = expr`.
    Function {
        /// Its name.
        name: Name,
        /// Names of its arguments.
        parameters: Vec<Name>,
        /// Its value.
        body: Expr,
    },
    /// `units strict`.
    Units(Name),
    /// The unit in which the model counts time.
    Time(Name),
    /// `every 1 ms {`.
    Every(Measure),
    /// `when v >= 30 { v = -65 }`; the assignments follow as equations until the reader puts them in.
    When(When),
    /// `}`.
    End,
    /// `component NAME(...) {`. The reader takes it, so no pass meets it.
    Component {
        /// The component.
        name: Name,
        /// What instances tell it.
        parameters: Vec<Parameter>,
    },
    /// `instance cell[k] = NAME(p = expr, ...)`.
    Instance {
        /// Name and dimensions.
        declared: Declared,
        /// The component.
        component: Name,
        /// What it is told.
        arguments: Vec<(Name, Expr)>,
    },
    /// `input u [unit]` of a component: what instances connect.
    Connector {
        /// Name, dimensions, unit.
        declared: Declared,
        /// Stated range.
        within: Option<Range>,
    },
    /// `include "lib/gates.spec"`: the path as written, with the place of its quotes.
    Include(Name),
}

/// What is special about a declared state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sort {
    /// Nothing.
    Plain,
    /// It is a tunable parameter.
    Tunable,
    /// It is an angle, which is the same a turn further.
    Angle,
}

/// A declared name with its dimensions and unit.
#[derive(Clone, Debug)]
pub struct Declared {
    /// The name.
    pub name: Name,
    /// One index per dimension, with a range of its own or that of the `index` statement.
    pub dimensions: Vec<Binder>,
    /// Text in the unit bracket.
    pub unit: Option<Name>,
}

/// An index and, where it is given on the spot, its range.
#[derive(Clone, Debug)]
pub struct Binder {
    /// The index.
    pub name: Name,
    /// Its range, `None` for the default range.
    pub range: Option<Range>,
    /// The data file whose rows it stands for, in a sum.
    pub rows: Option<Name>,
}

/// `low..high`, both ends included.
#[derive(Clone, Debug)]
pub struct Range {
    /// First value.
    pub low: Expr,
    /// Last value.
    pub high: Expr,
    /// The place of both.
    pub span: Span,
}

/// A number with an optional unit of time or frequency.
#[derive(Clone, Debug)]
pub struct Measure {
    /// The number.
    pub value: Expr,
    /// The unit as written.
    pub unit: Option<Name>,
}

/// What the left-hand side of an equation stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeftSide {
    /// `V' = ...`: the derivative of a state.
    Derivative,
    /// `next m = ...`: the value that a sampled state takes.
    Next,
    /// `P = ...`: an algebraic quantity.
    Algebraic,
}

/// The words that say how an event comes, with whether a number follows.
pub(crate) const MANNERS: [(&str, bool); 5] =
    [("refine", false), ("frozen", false), ("cancelled", false), ("initially", false), ("priority", true)];

/// An event.
#[derive(Clone, Debug)]
pub struct When {
    /// 1 where the condition holds, and 0 elsewhere.
    pub trigger: Expr,
    /// Ranges given with `for`.
    pub ranges: Vec<Binder>,
    /// Time from the condition to the assignments.
    pub after: Option<Measure>,
    /// The words that say how it comes, each with its number if it has one.
    pub manners: Vec<(Name, Option<Expr>)>,
    /// What it assigns.
    pub assignments: Vec<Equation>,
}

/// An equation.
#[derive(Clone, Debug)]
pub struct Equation {
    /// The left-hand side without the prime.
    pub target: Reference,
    /// What the left-hand side stands for.
    pub side: LeftSide,
    /// Unit of an algebraic quantity.
    pub unit: Option<Name>,
    /// The right-hand side.
    pub value: Expr,
    /// Stated range of an algebraic quantity.
    pub within: Option<Range>,
    /// Ranges given with `for`.
    pub ranges: Vec<Binder>,
    /// Condition given with `where`.
    pub condition: Option<Expr>,
}

/// One item of an `output` statement.
#[derive(Clone, Debug)]
pub struct OutputItem {
    /// Element, elements, or whole array.
    pub target: Reference,
    /// Ranges given with `for`.
    pub ranges: Vec<Binder>,
    /// Condition given with `where`.
    pub condition: Option<Expr>,
}

/// A name with subscripts.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The name.
    pub name: Name,
    /// Subscripts, empty for a scalar or a whole array.
    pub subscripts: Vec<Expr>,
    /// Name and subscripts.
    pub span: Span,
}

/// An expression and its place.
#[derive(Clone, Debug)]
pub struct Expr {
    /// What it is.
    pub kind: ExprKind,
    /// First to last character, enclosing parentheses excluded.
    pub span: Span,
}

/// The kinds of expressions.
#[derive(Clone, Debug)]
pub enum ExprKind {
    /// A literal.
    Number(f64),
    /// A literal with a unit behind it, `0.02 [mM]`.
    Measured(f64, Name),
    /// A name with or without subscripts.
    Reference(Reference),
    /// Terms with their signs, at least two.
    Sum(Vec<(Sign, Expr)>),
    /// First factor, then operators and operands from left to right.
    Product(Box<Expr>, Vec<(Factor, Expr)>),
    /// `base ^ exponent`.
    Power(Box<Expr>, Box<Expr>),
    /// `-operand`.
    Negate(Box<Expr>),
    /// `if condition then yes else no`.
    If {
        /// Decides.
        condition: Box<Expr>,
        /// Value where the condition holds.
        yes: Box<Expr>,
        /// Value elsewhere.
        no: Box<Expr>,
    },
    /// `sum(k in a..b where condition: body)`, or over the rows of a data file.
    SumOver {
        /// The index.
        binder: Box<Binder>,
        /// Restricts the index values.
        condition: Option<Box<Expr>>,
        /// Summed up.
        body: Box<Expr>,
    },
    /// `function(arguments)`.
    Call {
        /// The function.
        function: Name,
        /// Arguments in order.
        arguments: Vec<Expr>,
        /// Units behind arguments, by the numbers of these; signals alone may have them.
        units: Vec<(usize, Name)>,
    },
    /// `x(t - 20 ms)`: what a quantity was some time ago. A function of the spec may have the name, too.
    Delayed {
        /// The quantity.
        of: Reference,
        /// `t - 20`: the time, and what is taken from it.
        argument: Box<Expr>,
        /// Unit behind it.
        unit: Option<Name>,
    },
    /// `data("airways.csv", "R")`.
    Data {
        /// Path of the data file.
        path: Name,
        /// Name of the column.
        column: Name,
    },
    /// `samples("breath.csv", "p", linear)`.
    Samples {
        /// Path of the data file.
        path: Name,
        /// Name of the column.
        column: Name,
        /// `linear` or `hold`.
        interpolation: Name,
    },
    /// `[1, 2; 3, 4]`, row by row.
    Matrix(Vec<Vec<Expr>>),
    /// An element of `solve(matrix, right)`; made where whole arrays are written out.
    Solved {
        /// The matrix.
        matrix: Name,
        /// The right-hand side, an array.
        right: Name,
        /// Subscripts of the element.
        subscripts: Vec<Expr>,
    },
    /// `left < right` and its like.
    Compare(Comparison, Box<Expr>, Box<Expr>),
    /// Conditions joined by one operator, at least two.
    Logical(Connective, Vec<Expr>),
    /// `not operand`.
    Not(Box<Expr>),
}

/// The sign of a term.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// Added.
    Plus,
    /// Subtracted.
    Minus,
}

/// An operator of multiplication rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Factor {
    /// `*`.
    Multiply,
    /// `/`.
    Divide,
    /// `div`, integer quotient rounded down.
    IntegerDivide,
    /// `mod`, remainder of `div`.
    Modulo,
}

/// A comparison operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    /// `==`.
    Equal,
    /// `!=`.
    NotEqual,
    /// `<`.
    Less,
    /// `<=`.
    LessEqual,
    /// `>`.
    Greater,
    /// `>=`.
    GreaterEqual,
}

impl Comparison {
    /// Whether it holds between two numbers.
    pub fn holds(self, left: f64, right: f64) -> bool {
        match self {
            Comparison::Equal => left == right,
            Comparison::NotEqual => left != right,
            Comparison::Less => left < right,
            Comparison::LessEqual => left <= right,
            Comparison::Greater => left > right,
            Comparison::GreaterEqual => left >= right,
        }
    }
}

/// A logical operator that joins conditions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Connective {
    /// `and`.
    And,
    /// `or`.
    Or,
}
