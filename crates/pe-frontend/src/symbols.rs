//! The names of a spec with all their places, for tools that show and change it: what each stands for, where it is
//! defined and read, and from where it can be seen.
//!
//! Works on the syntax tree alone, so it also serves specs that are wrong. Its rules of scope are those of
//! [`crate::bind`]: an index of a sum or of `for` and an argument hide what the whole spec defines.

use crate::language::words::predefined;
use crate::syntax::ast::{
    Binder, Component, Declared, Equation, Expr, ExprKind, LeftSide, Measure, Name, Range, Reference, Sort, Spec,
    Statement, StatementKind,
};
use crate::syntax::delay;
use pe_ir::index::number;
use pe_ir::source::Span;
use std::collections::BTreeMap;

/// What a name stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SymbolKind {
    /// `const`.
    Const,
    /// `param`.
    Param,
    /// `param ... tunable`.
    Tunable,
    /// `input`.
    Input,
    /// `state`.
    State,
    /// `angle`.
    Angle,
    /// `matrix`.
    Matrix,
    /// What an equation defines.
    Algebraic,
    /// `index`, or an index with a range on the spot.
    Index,
    /// `function`.
    Function,
    /// Argument of a function.
    Argument,
    /// `component`.
    Component,
    /// `instance`.
    Instance,
}

impl SymbolKind {
    /// The kind in words.
    pub fn describe(self) -> &'static str {
        match self {
            SymbolKind::Const => "constant",
            SymbolKind::Param => "parameter",
            SymbolKind::Tunable => "tunable parameter",
            SymbolKind::Input => "input",
            SymbolKind::State => "state variable",
            SymbolKind::Angle => "angle",
            SymbolKind::Matrix => "matrix",
            SymbolKind::Algebraic => "algebraic quantity",
            SymbolKind::Index => "index",
            SymbolKind::Function => "function",
            SymbolKind::Argument => "argument",
            SymbolKind::Component => "component",
            SymbolKind::Instance => "instance",
        }
    }
}

/// A defined name.
#[derive(Clone, Debug, PartialEq)]
pub struct Symbol {
    /// The name.
    pub name: String,
    /// What it stands for.
    pub kind: SymbolKind,
    /// The name where it is defined.
    pub place: Span,
    /// The statement that defines it.
    pub statement: Span,
    /// Where alone it can be seen; everywhere if there is none. An index on the spot is also seen in equations of its
    /// array.
    pub scope: Option<Span>,
    /// Unit as written.
    pub unit: Option<String>,
    /// Names of its indices or arguments.
    pub arguments: Vec<String>,
    /// Whether the spec defines the name a second time.
    pub repeated: bool,
}

/// What happens to a name at one of its places.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// It is declared.
    Declared,
    /// An equation gives it its value or derivative.
    Written,
    /// It is read.
    Read,
}

/// A place of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Occurrence {
    /// The name there.
    pub span: Span,
    /// Number among [`Symbols::all`].
    pub symbol: usize,
    /// What happens to it.
    pub role: Role,
    /// The statement around it.
    pub statement: Span,
}

/// The names of a spec.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Symbols {
    /// Definitions: components, those of the whole spec in source order, then the others.
    pub all: Vec<Symbol>,
    /// All places of names that are defined, in source order.
    pub occurrences: Vec<Occurrence>,
}

impl Symbols {
    /// The names of a spec.
    pub fn of(spec: &Spec) -> Symbols {
        let mut collector = Collector::default();
        for component in &spec.components {
            collector.statement = component.span;
            collector.component(component);
        }
        collector.declarations(&spec.statements);
        collector.all_uses(&spec.statements);
        spec.components.iter().for_each(|component| collector.within(component));
        let mut symbols = collector.symbols;
        symbols.occurrences.sort_unstable();
        symbols.occurrences.dedup_by_key(|occurrence| (occurrence.span, occurrence.symbol));
        symbols
    }

    /// The name at an offset, or that ends there.
    pub fn at(&self, offset: u32) -> Option<&Occurrence> {
        let end = self.occurrences.partition_point(|occurrence| occurrence.span.start <= offset);
        self.occurrences[..end].last().filter(|occurrence| offset <= occurrence.span.end)
    }

    /// The places of a name.
    pub fn places(&self, symbol: usize) -> impl Iterator<Item = &Occurrence> {
        self.occurrences.iter().filter(move |occurrence| occurrence.symbol == symbol)
    }

    /// What can be seen from an offset.
    pub fn visible(&self, offset: u32) -> impl Iterator<Item = &Symbol> {
        self.all.iter().filter(move |symbol| symbol.scope.is_none_or(|span| (span.start..=span.end).contains(&offset)))
    }
}

#[derive(Default)]
struct Collector<'a> {
    symbols: Symbols,
    /// Quantities and indices of the whole spec.
    names: BTreeMap<&'a str, usize>,
    functions: BTreeMap<&'a str, usize>,
    /// Indices with a range on the spot and arguments, by their places.
    local: BTreeMap<Span, usize>,
    /// Dimensions of arrays.
    dimensions: BTreeMap<&'a str, &'a [Binder]>,
    /// Indices and arguments that have a value here, the innermost last.
    scope: Vec<(&'a str, usize)>,
    components: BTreeMap<&'a str, usize>,
    /// The component that is looked at: what it defines is seen there only.
    open: Option<Span>,
    /// The statement that is looked at.
    statement: Span,
}

impl<'a> Collector<'a> {
    fn all_uses(&mut self, statements: &'a [Statement]) {
        for statement in statements {
            self.statement = statement.span;
            self.uses(&statement.kind);
            self.scope.clear();
        }
    }

    /// The name of a component; all are known before any statement.
    fn component(&mut self, component: &'a Component) {
        let name = &component.name;
        if let Some(first) = self.components.get(name.text.as_str()).copied() {
            self.symbols.all[first].repeated = true;
            return self.occurs(name, first, Role::Declared);
        }
        let arguments = component.parameters.iter().map(|parameter| parameter.name.text.clone()).collect();
        let number = self.add(name, SymbolKind::Component, None, arguments);
        self.components.insert(&name.text, number);
    }

    /// What a component defines and reads: its own names hide those of the spec.
    fn within(&mut self, component: &'a Component) {
        let (names, dimensions) = (std::mem::take(&mut self.names), std::mem::take(&mut self.dimensions));
        self.open = Some(component.extent);
        self.statement = component.span;
        for parameter in &component.parameters {
            self.define(&parameter.name, SymbolKind::Param, parameter.unit.as_ref(), &[]);
        }
        self.declarations(&component.statements);
        for (name, number) in &names {
            self.names.entry(name).or_insert(*number);
        }
        for (name, binders) in &dimensions {
            self.dimensions.entry(name).or_insert(binders);
        }
        self.statement = component.span;
        component.parameters.iter().filter_map(|parameter| parameter.value.as_ref()).for_each(|value| self.expr(value));
        self.all_uses(&component.statements);
        (self.names, self.dimensions, self.open) = (names, dimensions, None);
    }

    /// Takes in what statements define, in the order in which the front end does: the first definition counts.
    fn declarations(&mut self, statements: &'a [Statement]) {
        for statement in statements {
            self.statement = statement.span;
            match &statement.kind {
                StatementKind::Const { name, .. } => self.define(name, SymbolKind::Const, None, &[]),
                StatementKind::Param { declared, .. } => self.declare(declared, SymbolKind::Param),
                StatementKind::Tunable { declared, .. } => self.declare(declared, SymbolKind::Tunable),
                StatementKind::Input { declared, .. } => self.declare(declared, SymbolKind::Input),
                StatementKind::State { declared, sort, .. } => {
                    let kind = match sort {
                        Sort::Plain => SymbolKind::State,
                        Sort::Tunable => SymbolKind::Tunable,
                        Sort::Angle => SymbolKind::Angle,
                    };
                    self.declare(declared, kind);
                }
                StatementKind::Matrix { declared, .. } => self.declare(declared, SymbolKind::Matrix),
                StatementKind::Connector { declared, .. } => self.declare(declared, SymbolKind::Input),
                StatementKind::Instance { declared, .. } => self.declare(declared, SymbolKind::Instance),
                StatementKind::Index(binders) => {
                    binders.iter().for_each(|binder| self.define(&binder.name, SymbolKind::Index, None, &[]));
                }
                StatementKind::Function { name, parameters, .. } => self.function(name, parameters),
                _ => {}
            }
        }
        for statement in statements {
            let StatementKind::Equation(equation) = &statement.kind else { continue };
            self.statement = statement.span;
            let name = &equation.target.name;
            if equation.side == LeftSide::Algebraic && !self.names.contains_key(name.text.as_str()) {
                self.define(name, SymbolKind::Algebraic, equation.unit.as_ref(), &[]);
            }
        }
        for statement in statements {
            self.statement = statement.span;
            let binders: &[Binder] = match &statement.kind {
                StatementKind::Param { declared, .. }
                | StatementKind::Tunable { declared, .. }
                | StatementKind::Input { declared, .. }
                | StatementKind::State { declared, .. }
                | StatementKind::Matrix { declared, .. }
                | StatementKind::Connector { declared, .. }
                | StatementKind::Instance { declared, .. } => &declared.dimensions,
                StatementKind::Function { parameters, .. } => {
                    parameters.iter().for_each(|parameter| _ = self.local(parameter, SymbolKind::Argument));
                    &[]
                }
                _ => &[],
            };
            binders.iter().filter(|binder| binder.range.is_some()).for_each(|binder| {
                self.local(&binder.name, SymbolKind::Index);
            });
        }
    }

    fn declare(&mut self, declared: &'a Declared, kind: SymbolKind) {
        self.define(&declared.name, kind, declared.unit.as_ref(), &declared.dimensions);
    }

    fn define(&mut self, name: &'a Name, kind: SymbolKind, unit: Option<&Name>, dimensions: &'a [Binder]) {
        if predefined(&name.text).is_some() {
            return;
        }
        if let Some(first) = self.names.get(name.text.as_str()).copied() {
            self.symbols.all[first].repeated = true;
            return self.occurs(name, first, Role::Declared);
        }
        let arguments = dimensions.iter().map(|binder| binder.name.text.clone()).collect();
        let number = self.add(name, kind, self.open, arguments);
        self.symbols.all[number].unit = unit.map(|unit| unit.text.clone());
        self.names.insert(&name.text, number);
        self.dimensions.insert(&name.text, dimensions);
    }

    fn function(&mut self, name: &'a Name, parameters: &'a [Name]) {
        if let Some(first) = self.functions.get(name.text.as_str()).copied() {
            self.symbols.all[first].repeated = true;
            return self.occurs(name, first, Role::Declared);
        }
        let arguments = parameters.iter().map(|parameter| parameter.text.clone()).collect();
        let number = self.add(name, SymbolKind::Function, None, arguments);
        self.functions.insert(&name.text, number);
    }

    /// A name that is seen in this statement only.
    fn local(&mut self, name: &'a Name, kind: SymbolKind) -> usize {
        if let Some(known) = self.local.get(&name.span) {
            return *known;
        }
        let number = self.add(name, kind, Some(self.statement), Vec::new());
        self.local.insert(name.span, number);
        number
    }

    fn add(&mut self, name: &Name, kind: SymbolKind, scope: Option<Span>, arguments: Vec<String>) -> usize {
        let number = self.symbols.all.len();
        self.symbols.all.push(Symbol {
            name: name.text.clone(),
            kind,
            place: name.span,
            statement: self.statement,
            scope,
            unit: None,
            arguments,
            repeated: false,
        });
        self.occurs(name, number, Role::Declared);
        number
    }

    fn occurs(&mut self, name: &Name, symbol: usize, role: Role) {
        self.symbols.occurrences.push(Occurrence { span: name.span, symbol, role, statement: self.statement });
    }

    /// Takes in what a statement reads and writes.
    fn uses(&mut self, kind: &'a StatementKind) {
        match kind {
            StatementKind::Const { value, .. } => self.expr(value),
            StatementKind::Index(binders) => binders.iter().for_each(|binder| self.range(binder.range.as_ref())),
            StatementKind::Param { declared, value } => self.declared(declared, value, None),
            StatementKind::Tunable { declared, value, within } => self.declared(declared, value, Some(within)),
            StatementKind::Input { declared, signal, within, .. } => self.declared(declared, signal, within.as_ref()),
            StatementKind::State { declared, initial, within, .. } => {
                self.declared(declared, initial, within.as_ref());
            }
            StatementKind::Matrix { declared, .. } => self.binders(&declared.dimensions),
            StatementKind::Equation(equation) => self.equation(equation),
            StatementKind::When(when) => {
                self.expr(&when.trigger);
                when.ranges.iter().for_each(|binder| self.range(binder.range.as_ref()));
                when.after.iter().for_each(|after| self.measure(after));
                when.manners.iter().filter_map(|(_, number)| number.as_ref()).for_each(|number| self.expr(number));
                when.assignments.iter().for_each(|assignment| self.equation(assignment));
            }
            StatementKind::Output(items) => {
                for item in items {
                    self.left_side(&item.target, &item.ranges, Role::Read);
                    item.condition.iter().for_each(|condition| self.expr(condition));
                    self.scope.clear();
                }
            }
            StatementKind::Function { parameters, body, .. } => {
                for parameter in parameters {
                    let number = self.local(parameter, SymbolKind::Argument);
                    self.scope.push((&parameter.text, number));
                }
                self.expr(body);
            }
            StatementKind::Step(step, early) => {
                early.iter().for_each(|(step, until)| [step, until].into_iter().for_each(|time| self.measure(time)));
                self.measure(step);
            }
            StatementKind::Span(time) | StatementKind::Every(time) => self.measure(time),
            StatementKind::Model { .. }
            | StatementKind::Solver(_)
            | StatementKind::Units(_)
            | StatementKind::Time(_)
            | StatementKind::End
            | StatementKind::Component { .. }
            | StatementKind::Include(_) => {}
            StatementKind::Connector { declared, within } => {
                self.binders(&declared.dimensions);
                self.range(within.as_ref());
            }
            StatementKind::Instance { declared, component, arguments } => {
                let number = self.components.get(component.text.as_str()).copied();
                number.into_iter().for_each(|number| self.occurs(component, number, Role::Read));
                self.binders(&declared.dimensions);
                arguments.iter().for_each(|(_, value)| self.expr(value));
            }
        }
    }

    fn measure(&mut self, measure: &'a Measure) {
        self.expr(&measure.value);
    }

    fn declared(&mut self, declared: &'a Declared, value: &'a Expr, within: Option<&'a Range>) {
        self.binders(&declared.dimensions);
        self.expr(value);
        self.range(within);
    }

    /// Gives the indices of dimensions a value.
    fn binders(&mut self, binders: &'a [Binder]) {
        binders.iter().for_each(|binder| self.range(binder.range.as_ref()));
        binders.iter().for_each(|binder| self.bind(binder));
    }

    /// Gives an index a value: one of its own, or that of the whole spec.
    fn bind(&mut self, binder: &'a Binder) {
        let name = &binder.name;
        let number = match &binder.range {
            Some(_) => Some(self.local(name, SymbolKind::Index)),
            None => {
                let index = self.index(&name.text);
                index.into_iter().for_each(|number| self.occurs(name, number, Role::Read));
                index
            }
        };
        self.scope.extend(number.map(|number| (name.text.as_str(), number)));
    }

    /// The index that the whole spec knows by this name.
    fn index(&self, name: &str) -> Option<usize> {
        self.names.get(name).copied().filter(|number| self.symbols.all[*number].kind == SymbolKind::Index)
    }

    fn equation(&mut self, equation: &'a Equation) {
        let target = &equation.target.name;
        // What a tunable parameter is written out as stands at the place of its declaration.
        if self.names.get(target.text.as_str()).is_some_and(|number| {
            let symbol = &self.symbols.all[*number];
            symbol.place == target.span && symbol.kind == SymbolKind::Tunable
        }) {
            return;
        }
        self.left_side(&equation.target, &equation.ranges, Role::Written);
        self.expr(&equation.value);
        self.range(equation.within.as_ref());
        equation.condition.iter().for_each(|condition| self.expr(condition));
    }

    /// Elements that an equation defines or an output shows, and the indices that have a value there.
    fn left_side(&mut self, target: &'a Reference, ranges: &'a [Binder], role: Role) {
        self.binders(ranges);
        let dimensions = self.dimensions.get(target.name.text.as_str()).copied().unwrap_or_default();
        for (subscript, binder) in target.subscripts.iter().zip(dimensions) {
            let ExprKind::Reference(Reference { name, subscripts, .. }) = &subscript.kind else { continue };
            let free = !self.names.contains_key(name.text.as_str()) && self.in_scope(&name.text).is_none();
            if free && subscripts.is_empty() && name.text == binder.name.text {
                let own = self.local.get(&binder.name.span).copied();
                self.scope.extend(own.map(|number| (name.text.as_str(), number)));
            }
        }
        if target.name.text.contains('.') {
            self.read(&target.name);
        } else if let Some(number) = self.names.get(target.name.text.as_str()).copied() {
            self.occurs(&target.name, number, role);
        }
        target.subscripts.iter().for_each(|subscript| self.expr(subscript));
    }

    fn range(&mut self, range: Option<&'a Range>) {
        range.into_iter().flat_map(|range| [&range.low, &range.high]).for_each(|bound| self.expr(bound));
    }

    fn in_scope(&self, name: &str) -> Option<usize> {
        self.scope.iter().rev().find(|(known, _)| *known == name).map(|(_, number)| *number)
    }

    fn read(&mut self, name: &Name) {
        // Of `cell[3].v` the spec itself knows the instance.
        if let Some(end) = name.text.find(['.', '[']) {
            let instance = self.names.get(&name.text[..end]).copied();
            let span = Span { end: name.span.start + number(end), ..name.span };
            let name = Name { text: name.text[..end].to_owned(), span };
            return instance.into_iter().for_each(|instance| self.occurs(&name, instance, Role::Read));
        }
        let number = self.in_scope(&name.text).or_else(|| self.names.get(name.text.as_str()).copied());
        number.into_iter().for_each(|number| self.occurs(name, number, Role::Read));
    }

    fn expr(&mut self, expr: &'a Expr) {
        match &expr.kind {
            ExprKind::Number(_) | ExprKind::Measured(..) | ExprKind::Data { .. } | ExprKind::Samples { .. } => {}
            ExprKind::Reference(reference) => {
                self.read(&reference.name);
                reference.subscripts.iter().for_each(|subscript| self.expr(subscript));
            }
            ExprKind::Sum(terms) => terms.iter().for_each(|(_, term)| self.expr(term)),
            ExprKind::Product(first, rest) => {
                self.expr(first);
                rest.iter().for_each(|(_, factor)| self.expr(factor));
            }
            ExprKind::Negate(operand) | ExprKind::Not(operand) => self.expr(operand),
            ExprKind::Power(one, other) | ExprKind::Compare(_, one, other) => {
                self.expr(one);
                self.expr(other);
            }
            ExprKind::Logical(_, operands) => operands.iter().for_each(|operand| self.expr(operand)),
            ExprKind::If { condition, yes, no } => {
                [condition, yes, no].into_iter().for_each(|part| self.expr(part));
            }
            ExprKind::SumOver { binder, condition, body } => {
                self.range(binder.range.as_ref());
                let outside = self.scope.len();
                self.bind(binder);
                condition.iter().for_each(|condition| self.expr(condition));
                self.expr(body);
                self.scope.truncate(outside);
            }
            ExprKind::Call { function, arguments, .. } => {
                if let Some(number) = self.functions.get(function.text.as_str()).copied() {
                    self.occurs(function, number, Role::Read);
                }
                arguments.iter().for_each(|argument| self.expr(argument));
            }
            ExprKind::Delayed { of, argument, .. } => match self.functions.get(of.name.text.as_str()).copied() {
                Some(number) => {
                    self.occurs(&of.name, number, Role::Read);
                    self.expr(argument);
                }
                None => {
                    self.read(&of.name);
                    of.subscripts.iter().for_each(|subscript| self.expr(subscript));
                    delay::terms(argument).into_iter().flatten().for_each(|(_, term)| self.expr(term));
                }
            },
            ExprKind::Matrix(rows) => rows.iter().flatten().for_each(|cell| self.expr(cell)),
            // Made of statements that were written out; no text has it.
            ExprKind::Solved { .. } => {}
        }
    }
}
