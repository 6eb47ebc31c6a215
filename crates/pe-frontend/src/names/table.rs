//! The table of names: what each one stands for, where it is defined, and what is known of it so far.
//!
//! A name is found by its text once, when an expression is bound; from then on it is a [`Symbol`].

use crate::bound::Body;
use crate::language::measures::TimeUnit;
use crate::language::words::{PREDEFINED, predefined};
use crate::nearest::suggestion;
use crate::report::Report;
use crate::syntax::ast::{Binder, Expr as Tree, Name};
use pe_ir::index::{StateId, number};
use pe_ir::model::Variable;
use pe_ir::source::{Diagnostic, Span};
use pe_ir::{codes, element};
use std::collections::{HashMap, HashSet};
use std::rc::Rc;

/// Most dimensions an array can have.
pub(crate) const MOST_DIMENSIONS: usize = 8;

/// Marks an element that no equation defines.
pub(crate) const NO_EQUATION: u32 = u32::MAX;

/// What a name stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Symbol {
    /// Number in [`Names::quantities`].
    Quantity(usize),
    /// Number in [`Names::indices`].
    Index(usize),
    /// A number of the language.
    Predefined(f64),
}

/// The kinds of quantities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Const,
    Param,
    Input,
    State,
    Algebraic,
}

impl Kind {
    /// With article, for messages.
    pub(crate) fn describe(self) -> &'static str {
        match self {
            Kind::Const => "a constant",
            Kind::Param => "a parameter",
            Kind::Input => "an input",
            Kind::State => "a state variable",
            Kind::Algebraic => "an algebraic quantity",
        }
    }

    /// Whether equations define it.
    pub(crate) fn has_equations(self) -> bool {
        matches!(self, Kind::State | Kind::Algebraic)
    }
}

/// One dimension of an array.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dimension {
    /// First subscript.
    pub(crate) low: i64,
    /// Last subscript.
    pub(crate) high: i64,
    /// Distance of neighbours in this dimension.
    pub(crate) stride: usize,
}

/// A named scalar or array. Elements are numbered row by row, the last subscript fastest.
#[derive(Debug)]
pub(crate) struct Quantity<'a> {
    pub(crate) name: &'a Name,
    pub(crate) kind: Kind,
    pub(crate) unit: Option<&'a Name>,
    /// The sampled block in which a state is declared or an algebraic quantity defined.
    pub(crate) block: Option<usize>,
    /// Whether a state is a tunable parameter.
    pub(crate) tunable: bool,
    /// Whether a state is an angle.
    pub(crate) angle: bool,
    /// Of a declared matrix whether it is symmetric. Its elements without an equation are zero.
    pub(crate) matrix: Option<bool>,
    /// Number of subscripts.
    pub(crate) rank: usize,
    /// Declared indices; empty for algebraic quantities that are no matrices.
    pub(crate) binders: &'a [Binder],
    /// Extents, known once the index ranges are.
    pub(crate) dimensions: Vec<Dimension>,
    /// Number of elements; for algebraic quantities that of the box around them.
    pub(crate) length: usize,
    /// Number of the first element among those of its kind.
    pub(crate) base: u32,
    /// Values of constants and parameters, NaN until computed.
    pub(crate) values: Vec<f64>,
    /// Number of the equation that defines each element of a state or algebraic quantity.
    pub(crate) defined_by: Vec<u32>,
    /// An error keeps its elements from being known; whoever reads them stays silent.
    pub(crate) broken: bool,
    /// Whether anything reads it.
    pub(crate) used: bool,
}

impl Quantity<'_> {
    /// What it is, with article, for messages.
    pub(crate) fn describe(&self) -> &'static str {
        match self.matrix {
            Some(_) => "a matrix",
            None if self.tunable => "a tunable parameter",
            None if self.angle => "an angle",
            None => self.kind.describe(),
        }
    }

    /// Name of the element with these subscripts.
    pub(crate) fn element_name(&self, subscripts: &[i64]) -> String {
        element::name(&self.name.text, subscripts)
    }

    /// Subscripts of the element at this offset.
    pub(crate) fn subscripts(&self, mut offset: usize) -> Vec<i64> {
        let mut subscripts = Vec::with_capacity(self.rank);
        for dimension in &self.dimensions {
            // A stride of zero belongs to an empty array, which has no offsets.
            let stride = dimension.stride.max(1);
            subscripts.push(nth(dimension.low, offset / stride));
            offset %= stride;
        }
        subscripts
    }

    /// Name of the element at this offset.
    pub(crate) fn name_at(&self, offset: usize) -> String {
        self.element_name(&self.subscripts(offset))
    }

    /// Whether the element at this offset exists: algebraic quantities may have gaps.
    pub(crate) fn exists(&self, offset: usize) -> bool {
        self.kind != Kind::Algebraic || self.defined_by[offset] != NO_EQUATION
    }

    /// The variable that the element at this offset of a quantity that changes over time is.
    pub(crate) fn variable(&self, offset: usize) -> Variable {
        let flat = self.base + number(offset);
        match self.kind {
            Kind::State => Variable::State(StateId::new(flat)),
            Kind::Input => Variable::Input(flat),
            _ => Variable::Algebraic(flat),
        }
    }

    /// Offset of the element with these subscripts, or the first dimension that they miss.
    pub(crate) fn offset(&self, subscripts: &[i64]) -> Result<usize, usize> {
        let mut offset = 0;
        for (at, (dimension, subscript)) in self.dimensions.iter().zip(subscripts).enumerate() {
            if *subscript < dimension.low || *subscript > dimension.high {
                return Err(at);
            }
            offset += usize::try_from(subscript - dimension.low).map_err(|_| at)? * dimension.stride;
        }
        Ok(offset)
    }

    /// Sets the extents. The length of an array too large to exist is `usize::MAX`.
    pub(crate) fn set_extents(&mut self, extents: &[(i64, i64)]) {
        let mut length = 1usize;
        let mut dimensions = Vec::with_capacity(extents.len());
        for extent in extents.iter().rev() {
            dimensions.push(Dimension { low: extent.0, high: extent.1, stride: length });
            length = length.saturating_mul(count(*extent));
        }
        dimensions.reverse();
        self.dimensions = dimensions;
        self.length = length;
    }
}

/// Number of integers in a range, zero if its end lies before its beginning.
pub(crate) fn count((low, high): (i64, i64)) -> usize {
    usize::try_from(high.saturating_sub(low).saturating_add(1)).unwrap_or(0)
}

/// The integer at a place of a range that begins with `low`.
pub(crate) fn nth(low: i64, place: usize) -> i64 {
    low.saturating_add(i64::try_from(place).unwrap_or(i64::MAX))
}

/// An index with a default range.
#[derive(Debug)]
pub(crate) struct Index<'a> {
    pub(crate) name: &'a Name,
    /// First and last value, `None` until known or after an error.
    pub(crate) range: Option<(i64, i64)>,
    /// Whether anything uses it.
    pub(crate) used: bool,
}

/// A function of the spec.
#[derive(Debug)]
pub(crate) struct Defined<'a> {
    pub(crate) name: &'a Name,
    pub(crate) parameters: &'a [Name],
    pub(crate) body: &'a Tree,
    /// The bound body for each kind of place that it was bound for; `None` inside after an error.
    pub(crate) bound: [Option<Option<Rc<Body>>>; 4],
}

/// All names of a spec.
#[derive(Debug, Default)]
pub(crate) struct Names<'a> {
    pub(super) symbols: HashMap<&'a str, Symbol>,
    /// The unit in which the spec counts time.
    pub(crate) time: TimeUnit,
    /// In source order; algebraic quantities after the declared ones.
    pub(crate) quantities: Vec<Quantity<'a>>,
    /// In source order.
    pub(crate) indices: Vec<Index<'a>>,
    /// In source order.
    pub(crate) functions: Vec<Defined<'a>>,
    pub(crate) function_numbers: HashMap<&'a str, usize>,
    /// Names that broken statements may define; nothing is said about them.
    pub(super) poisoned: HashSet<&'a str>,
    /// Whether a file is missing that may define any name.
    pub(super) missing: bool,
}

impl<'a> Names<'a> {
    /// Reports an index bound on the spot that takes the name of something other than an index.
    pub(crate) fn check_index_name(&self, name: &Name, report: &mut Report) {
        if matches!(self.find(&name.text), Some(Symbol::Quantity(_) | Symbol::Predefined(_))) {
            let error =
                Diagnostic::error(codes::DUPLICATE, name.span, format!("`{}` is not a free index name", name.text));
            report.push(match self.definition(&name.text) {
                Some(span) => error.with_label(span, "defined here"),
                None => error.with_help(format!("`{}` is predefined", name.text)),
            });
        }
    }

    /// What a name stands for.
    pub(crate) fn find(&self, name: &str) -> Option<Symbol> {
        predefined(name).map(Symbol::Predefined).or_else(|| self.symbols.get(name).copied())
    }

    /// The quantity that a name stands for.
    pub(crate) fn quantity(&self, name: &str) -> Option<usize> {
        match self.find(name) {
            Some(Symbol::Quantity(number)) => Some(number),
            _ => None,
        }
    }

    /// What a name of the command line stands for: `cell.v` is the array of all instances.
    pub(crate) fn written(&self, name: &str) -> Option<Symbol> {
        let array = |quantity: &&Quantity| element::bare(&quantity.name.text) == name;
        self.find(name).or_else(|| {
            let array = self.quantities.iter().filter(|_| name.contains('.')).find(array)?;
            self.find(&array.name.text)
        })
    }

    /// The function of this name.
    pub(crate) fn function(&self, name: &str) -> Option<&Defined<'a>> {
        self.function_numbers.get(name).map(|number| &self.functions[*number])
    }

    /// Where the spec defines a name.
    pub(crate) fn definition(&self, name: &str) -> Option<Span> {
        match self.find(name)? {
            Symbol::Quantity(number) => Some(self.quantities[number].name.span),
            Symbol::Index(number) => Some(self.indices[number].name.span),
            Symbol::Predefined(_) => None,
        }
    }

    /// Whether a broken statement or a missing file may define this name.
    pub(crate) fn is_poisoned(&self, name: &str) -> bool {
        self.missing || self.poisoned.contains(name)
    }

    /// An error for a name that is not defined, with the nearest of `local` and all defined names.
    pub(crate) fn unknown(&self, name: &Name, local: &[&str]) -> Diagnostic {
        let error = Diagnostic::error(codes::UNKNOWN_NAME, name.span, format!("unknown name `{}`", name.text));
        let known = local.iter().copied().chain(self.all()).chain(PREDEFINED.iter().map(|(word, _)| *word));
        let help = suggestion(&name.text, known).or_else(|| {
            let time = matches!(name.text.as_str(), "t" | "T");
            time.then(|| "if it is to be the time: that is `time`".to_owned())
        });
        Diagnostic { help, ..error }
    }

    /// An error for an index that stands for no number.
    pub(crate) fn unbound_index(name: &Name) -> Diagnostic {
        let text = &name.text;
        let help =
            format!("only indices on the left-hand side have a value; sum over `{text}` with `sum({text}: ...)`");
        Diagnostic::error(codes::UNBOUND_INDEX, name.span, format!("index `{text}` has no value here")).with_help(help)
    }

    /// All defined names in source order, quantities before indices.
    fn all(&self) -> impl Iterator<Item = &str> {
        let quantities = self.quantities.iter().map(|quantity| quantity.name.text.as_str());
        quantities.chain(self.indices.iter().map(|index| index.name.text.as_str()))
    }
}
