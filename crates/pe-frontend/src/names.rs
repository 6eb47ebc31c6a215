//! The names of a spec: what each one stands for, where it is defined, and what is known of it so far.

use crate::ast::{Binder, LeftSide, Name, Spec, StatementKind};
use crate::inline::Defined;
use crate::nearest::suggestion;
use crate::report::Report;
use pe_ir::codes;
use pe_ir::model::Variable;
use pe_ir::source::{Diagnostic, Span};
use std::collections::{HashMap, HashSet};

/// Names that the language defines itself.
pub(crate) const PREDEFINED: [(&str, f64); 1] = [("pi", std::f64::consts::PI)];

/// The time in seconds, unless the spec gives this name to something else.
pub(crate) const TIME: &str = "time";

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

    /// Whether it changes over time.
    pub(crate) fn varies(self) -> bool {
        matches!(self, Kind::Input | Kind::State | Kind::Algebraic)
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
    /// Number of subscripts.
    pub(crate) rank: usize,
    /// Declared indices; empty for algebraic quantities.
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
    /// Name of the element with these subscripts.
    pub(crate) fn element_name(&self, subscripts: &[i64]) -> String {
        if subscripts.is_empty() {
            return self.name.text.clone();
        }
        let list: Vec<String> = subscripts.iter().map(i64::to_string).collect();
        format!("{}[{}]", self.name.text, list.join(","))
    }

    /// Subscripts of the element at this offset.
    pub(crate) fn subscripts(&self, mut offset: usize) -> Vec<i64> {
        let mut subscripts = Vec::with_capacity(self.rank);
        for dimension in &self.dimensions {
            // A stride of zero belongs to an empty array, which has no offsets.
            let stride = dimension.stride.max(1);
            subscripts.push(dimension.low + (offset / stride) as i64);
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
        let flat = self.base + offset as u32;
        match self.kind {
            Kind::State => Variable::State(flat),
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
            offset += (subscript - dimension.low) as usize * dimension.stride;
        }
        Ok(offset)
    }

    /// Sets the extents. The length of an array too large to exist is `usize::MAX`.
    pub(crate) fn set_extents(&mut self, extents: &[(i64, i64)]) {
        let count = |(low, high): &(i64, i64)| high.saturating_sub(*low).saturating_add(1).max(0) as usize;
        let mut length = 1usize;
        let mut dimensions = Vec::with_capacity(extents.len());
        for extent in extents.iter().rev() {
            dimensions.push(Dimension { low: extent.0, high: extent.1, stride: length });
            length = length.saturating_mul(count(extent));
        }
        dimensions.reverse();
        self.dimensions = dimensions;
        self.length = length;
    }
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

/// All names of a spec.
#[derive(Debug, Default)]
pub(crate) struct Names<'a> {
    symbols: HashMap<&'a str, Symbol>,
    /// In source order; algebraic quantities after the declared ones.
    pub(crate) quantities: Vec<Quantity<'a>>,
    /// In source order.
    pub(crate) indices: Vec<Index<'a>>,
    /// In source order.
    pub(crate) functions: Vec<Defined<'a>>,
    pub(crate) function_numbers: HashMap<&'a str, usize>,
    /// Names that broken statements may define; nothing is said about them.
    poisoned: HashSet<&'a str>,
    /// Whether a file is missing that may define any name.
    missing: bool,
}

impl<'a> Names<'a> {
    /// Collects the names that a spec defines.
    pub(crate) fn collect(spec: &'a Spec, report: &mut Report) -> Self {
        let mut names = Names { missing: spec.names_missing, ..Names::default() };
        names.poisoned.extend(spec.broken.iter().flat_map(|broken| broken.names.iter().map(String::as_str)));
        for statement in &spec.statements {
            match &statement.kind {
                StatementKind::Const { name, .. } => names.declare(name, Kind::Const, None, &[], report),
                StatementKind::Param { declared: d, .. } => {
                    names.declare(&d.name, Kind::Param, d.unit.as_ref(), &d.dimensions, report);
                }
                StatementKind::Input { declared: d, .. } => {
                    names.declare(&d.name, Kind::Input, d.unit.as_ref(), &d.dimensions, report);
                }
                StatementKind::State { declared: d, .. } => {
                    names.declare(&d.name, Kind::State, d.unit.as_ref(), &d.dimensions, report);
                    if let Some(quantity) = names.quantities.last_mut().filter(|q| q.name.span == d.name.span) {
                        quantity.block = statement.block;
                    }
                }
                StatementKind::Index(binders) => {
                    for binder in binders {
                        if names.is_free(&binder.name, report) {
                            names.symbols.insert(&binder.name.text, Symbol::Index(names.indices.len()));
                            names.indices.push(Index { name: &binder.name, range: None, used: false });
                        }
                    }
                }
                StatementKind::Function { name, parameters, body } => {
                    names.define_function(name, parameters, body, report);
                }
                _ => {}
            }
        }
        // Equations in a second pass, so that they may stand before declarations.
        for statement in &spec.statements {
            let StatementKind::Equation(equation) = &statement.kind else { continue };
            let name = &equation.target.name;
            let predefined = PREDEFINED.iter().any(|(word, _)| *word == name.text);
            if equation.side == LeftSide::Algebraic && !predefined && !names.symbols.contains_key(name.text.as_str()) {
                names.add(name, Kind::Algebraic, equation.unit.as_ref(), &[]);
                if let Some(quantity) = names.quantities.last_mut() {
                    quantity.rank = equation.target.subscripts.len();
                    quantity.block = statement.block;
                }
            }
        }
        names.shadowed_dimensions(report);
        names
    }

    fn declare(
        &mut self,
        name: &'a Name,
        kind: Kind,
        unit: Option<&'a Name>,
        binders: &'a [Binder],
        report: &mut Report,
    ) {
        if self.is_free(name, report) {
            self.add(name, kind, unit, binders);
        }
        if binders.len() > MOST_DIMENSIONS {
            let message =
                format!("`{}` has {} dimensions; the most allowed is {MOST_DIMENSIONS}", name.text, binders.len());
            report.push(Diagnostic::error(codes::SUBSCRIPT_COUNT, name.span, message));
        }
    }

    fn add(&mut self, name: &'a Name, kind: Kind, unit: Option<&'a Name>, binders: &'a [Binder]) {
        self.symbols.insert(&name.text, Symbol::Quantity(self.quantities.len()));
        self.quantities.push(Quantity {
            name,
            kind,
            unit,
            block: None,
            rank: binders.len(),
            binders,
            dimensions: Vec::new(),
            length: 0,
            base: 0,
            values: Vec::new(),
            defined_by: Vec::new(),
            broken: self.poisoned.contains(name.text.as_str()),
            used: false,
        });
    }

    /// Whether a name can be defined here; reports it if not.
    fn is_free(&self, name: &Name, report: &mut Report) -> bool {
        if PREDEFINED.iter().any(|(word, _)| *word == name.text) {
            let message = format!("`{}` is predefined and cannot be defined again", name.text);
            report.push(Diagnostic::error(codes::DUPLICATE, name.span, message));
            return false;
        }
        let Some(earlier) = self.definition(&name.text) else { return true };
        let message = format!("`{}` is defined twice", name.text);
        report.push(Diagnostic::error(codes::DUPLICATE, name.span, message).with_label(earlier, "first defined here"));
        false
    }

    /// Reports arrays whose dimensions share an index name, or take the name of something else.
    fn shadowed_dimensions(&self, report: &mut Report) {
        for quantity in &self.quantities {
            for (at, binder) in quantity.binders.iter().enumerate() {
                if quantity.binders[..at].iter().any(|earlier| earlier.name.text == binder.name.text) {
                    let message =
                        format!("index `{}` stands for two dimensions of `{}`", binder.name.text, quantity.name.text);
                    report.push(
                        Diagnostic::error(codes::DUPLICATE, binder.name.span, message)
                            .with_help("define a second index over the same range"),
                    );
                }
                if binder.range.is_some() {
                    self.check_index_name(&binder.name, report);
                }
            }
        }
    }

    /// Reports an index bound on the spot that takes the name of something other than an index.
    pub(crate) fn check_index_name(&self, name: &Name, report: &mut Report) {
        let predefined = PREDEFINED.iter().any(|(word, _)| *word == name.text);
        let quantity = matches!(self.find(&name.text), Some(Symbol::Quantity(_)));
        if predefined || quantity {
            let error =
                Diagnostic::error(codes::DUPLICATE, name.span, format!("`{}` is no free index name", name.text));
            report.push(match self.definition(&name.text) {
                Some(span) => error.with_label(span, "defined here"),
                None => error.with_help(format!("`{}` is predefined", name.text)),
            });
        }
    }

    /// What a name stands for.
    pub(crate) fn find(&self, name: &str) -> Option<Symbol> {
        self.symbols.get(name).copied()
    }

    /// Where a name is defined.
    pub(crate) fn definition(&self, name: &str) -> Option<Span> {
        self.find(name).map(|symbol| match symbol {
            Symbol::Quantity(number) => self.quantities[number].name.span,
            Symbol::Index(number) => self.indices[number].name.span,
        })
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
            time.then(|| "if it is to be the time in seconds: that is `time`".to_owned())
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
