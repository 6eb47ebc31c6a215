//! Binds the names of an expression and checks what is number and what is condition.
//!
//! Every function returns `None` after it has reported an error, and goes on with the other parts first so that all
//! errors of an expression are found in one run.

use crate::bind::rows::Within;
use crate::bind::{data, matrix, samples};
use crate::bound::{Body, BoundRange, Condition, DEEPEST_BODY, MOST_NESTED_CALLS, Node, NodeKind, SumOver, depth};
use crate::language::functions::{self, FUNCTIONS};
use crate::language::habits;
use crate::language::measures::unit_scale;
use crate::language::waveforms::{Argument, SAMPLES, WAVEFORMS, check_count};
use crate::language::words::{OF_ARRAYS, TIME};
use crate::names::table::{Kind, Names, Symbol};
use crate::nearest::suggestion;
use crate::report::Report;
use crate::syntax::ast::{Binder, Comparison, Expr, ExprKind, Name, Reference, Spec};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};
use std::rc::Rc;
use std::sync::Arc;

mod past;
mod rows;

/// What an expression may read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reads {
    /// Only `const`: what index ranges, and so the sizes of arrays, depend on.
    Consts,
    /// `const` and `param`.
    Constants,
    /// `const`, `param`, the time and signals.
    Signals,
    /// Everything.
    Variables,
}

impl Reads {
    /// Its place among the bound bodies of a function.
    fn place(self) -> usize {
        match self {
            Reads::Consts => 0,
            Reads::Constants => 1,
            Reads::Signals => 2,
            Reads::Variables => 3,
        }
    }
}

/// Binds expressions within a scope of indices.
pub(crate) struct Resolver<'r, 'a> {
    names: &'r mut Names<'a>,
    report: &'r mut Report,
    /// Names of the indices in the frame, outermost first.
    pub(crate) scope: Vec<&'a str>,
    reads: Reads,
    spec: &'a Spec,
    /// The quantity whose element is being defined; its subscripts are the outermost indices of the frame.
    pub(crate) owner: Option<usize>,
    /// Functions whose bodies are being bound, the innermost last.
    calling: Vec<usize>,
    /// Sums over rows that the expression stands in, the innermost last.
    rows: Vec<Within<'a>>,
}

impl<'r, 'a> Resolver<'r, 'a> {
    /// A resolver without indices in scope.
    pub(crate) fn new(spec: &'a Spec, names: &'r mut Names<'a>, report: &'r mut Report, reads: Reads) -> Self {
        let (scope, calling, rows) = (Vec::new(), Vec::new(), Vec::new());
        Resolver { names, report, scope, reads, spec, owner: None, calling, rows }
    }
}

impl<'a> Resolver<'_, 'a> {
    /// Binds a number.
    pub(crate) fn number(&mut self, expr: &'a Expr) -> Option<Node> {
        let kind = match &expr.kind {
            ExprKind::Number(value) | ExprKind::Measured(value, _) => NodeKind::Number(*value),
            ExprKind::Reference(reference) => self.reference(reference)?,
            ExprKind::Sum(terms) => {
                let bound = terms.iter().map(|(sign, term)| self.number(term).map(|term| (*sign, term)));
                NodeKind::Sum(all(bound)?)
            }
            ExprKind::Product(first, rest) => {
                let first = self.number(first);
                let rest = all(rest.iter().map(|(factor, operand)| self.number(operand).map(|node| (*factor, node))));
                NodeKind::Product(Box::new(first?), rest?)
            }
            ExprKind::Power(base, exponent) => {
                let (base, exponent) = (self.number(base), self.number(exponent));
                NodeKind::Power(Box::new(base?), Box::new(exponent?))
            }
            ExprKind::Negate(operand) => NodeKind::Negate(Box::new(self.number(operand)?)),
            ExprKind::If { condition, yes, no } => {
                let (condition, yes, no) = (self.condition(condition), self.number(yes), self.number(no));
                NodeKind::If(Box::new(condition?), Box::new(yes?), Box::new(no?))
            }
            ExprKind::SumOver { binder, condition, body } => self.sum_over(binder, condition.as_deref(), body)?,
            ExprKind::Data { path, column } => {
                data::values(self.spec, self.names, self.owner, (path, column), self.report)?
            }
            ExprKind::Samples { path, column, interpolation } => {
                self.check_signal(SAMPLES, expr.span)?;
                let samples = samples::samples(self.spec, (path, column), interpolation, self.names.time, self.report)?;
                NodeKind::Samples(Arc::new(samples))
            }
            ExprKind::Matrix(rows) => {
                // The cells are looked at in any case: what is wrong in them is wrong.
                let cells = all(rows.iter().flatten().map(|cell| self.number(cell)));
                matrix::cells(self.names, self.owner, rows, cells, expr.span, self.report)?
            }
            ExprKind::Call { function, arguments, units } => self.call(function, (arguments, units), expr.span)?,
            ExprKind::Delayed { of, argument, unit } => self.delayed(of, argument, unit.as_ref(), expr.span)?,
            ExprKind::Solved { matrix, right, subscripts } => {
                let subscripts = all(subscripts.iter().map(|subscript| self.number(subscript)));
                let matrix = self.names.quantity(&matrix.text)?;
                let right = self.names.quantity(&right.text)?;
                [matrix, right].into_iter().for_each(|number| self.names.quantities[number].used = true);
                NodeKind::Solved(matrix, right, subscripts?)
            }
            ExprKind::Compare(..) | ExprKind::Logical(..) | ExprKind::Not(_) => {
                let message = "a number is needed here, this is a condition";
                self.report.push(
                    Diagnostic::error(codes::NUMBER_OR_CONDITION, expr.span, message)
                        .with_help("turn it into a number with `if condition then 1 else 0`"),
                );
                return None;
            }
        };
        Some(Node { kind, span: expr.span })
    }

    /// Binds a condition.
    pub(crate) fn condition(&mut self, expr: &'a Expr) -> Option<Condition> {
        match &expr.kind {
            ExprKind::Compare(comparison @ (Comparison::Equal | Comparison::NotEqual), left, right)
                if is_condition(left) && is_condition(right) =>
            {
                let (one, other) = (self.condition(left).map(Box::new), self.condition(right).map(Box::new));
                Some(Condition::Same { one: one?, other: other?, negated: *comparison == Comparison::NotEqual })
            }
            ExprKind::Compare(comparison, left, right) => {
                if matches!(left.kind, ExprKind::Compare(..)) {
                    let message = "comparisons cannot be chained";
                    let help = "compare twice and join with `and`: `1 < b and b < 5`";
                    self.report.push(Diagnostic::error(codes::NUMBER_OR_CONDITION, expr.span, message).with_help(help));
                    return None;
                }
                let (left, right) = (self.number(left), self.number(right));
                Some(Condition::Compare(*comparison, left?, right?))
            }
            ExprKind::Logical(connective, operands) => {
                let bound = all(operands.iter().map(|operand| self.condition(operand)));
                Some(Condition::Logical(*connective, bound?))
            }
            ExprKind::Not(operand) => Some(Condition::Not(Box::new(self.condition(operand)?))),
            _ => {
                let message = "a condition is needed here, this is a number";
                self.report.push(
                    Diagnostic::error(codes::NUMBER_OR_CONDITION, expr.span, message)
                        .with_help("compare it with something, for example `... != 0`"),
                );
                None
            }
        }
    }

    /// Binds the range of an index: its own one, or the default one of its name.
    pub(crate) fn range(&mut self, binder: &'a Binder) -> Option<BoundRange> {
        if let Some(range) = &binder.range {
            self.names.check_index_name(&binder.name, self.report);
            let (low, high) = (self.number(&range.low), self.number(&range.high));
            return Some(BoundRange::Own(low?, high?));
        }
        match self.names.find(&binder.name.text) {
            Some(Symbol::Index(number)) => {
                self.names.indices[number].used = true;
                Some(BoundRange::Index(number))
            }
            _ if self.names.is_poisoned(&binder.name.text) => None,
            _ => {
                let name = &binder.name;
                let known = self.names.indices.iter().map(|index| index.name.text.as_str());
                let help = suggestion(&name.text, known).unwrap_or_else(|| {
                    let text = &name.text;
                    format!("define it with `index {text} in 1..n`, or give it a range here; a unit needs a blank before its bracket")
                });
                let message = format!("unknown index `{}`", name.text);
                self.report.push(Diagnostic::error(codes::UNKNOWN_NAME, name.span, message).with_help(help));
                None
            }
        }
    }

    fn sum_over(&mut self, binder: &'a Binder, condition: Option<&'a Expr>, body: &'a Expr) -> Option<NodeKind> {
        if self.scope.contains(&binder.name.text.as_str()) {
            let message = format!("index `{}` already has a value here", binder.name.text);
            self.report.push(
                Diagnostic::error(codes::DUPLICATE, binder.name.span, message)
                    .with_help("sum over an index of another name"),
            );
        }
        if let Some(path) = &binder.rows {
            return self.sum_over_rows((&binder.name, path), condition, body);
        }
        let range = self.range(binder);
        self.scope.push(&binder.name.text);
        let condition = condition.map(|condition| self.condition(condition));
        let body = self.number(body);
        self.scope.pop();
        let condition = match condition {
            Some(condition) => Some(condition?),
            None => None,
        };
        Some(NodeKind::SumOver(Box::new(SumOver { range: range?, condition, body: body? })))
    }

    fn call(
        &mut self,
        name: &'a Name,
        (arguments, units): (&'a [Expr], &'a [(usize, Name)]),
        span: Span,
    ) -> Option<NodeKind> {
        if let Some(number) = WAVEFORMS.iter().position(|(word, ..)| *word == name.text) {
            return self.signal(number, (arguments, units), span);
        }
        for (_, unit) in units {
            let message = format!("`{}` follows an argument of `{}`, which takes plain numbers", unit.text, name.text);
            self.report.push(
                Diagnostic::error(codes::UNKNOWN_UNIT, unit.span, message)
                    .with_help("only arguments of signals take units; a product needs its sign"),
            );
        }
        if let Some(help) = self.habit(name, arguments) {
            let error = Diagnostic::error(codes::UNKNOWN_FUNCTION, name.span, unknown_function(&name.text));
            self.report.push(error.with_help(help));
            return None;
        }
        let bound = all(arguments.iter().map(|argument| self.number(argument)));
        if let Some(number) = self.names.function_numbers.get(name.text.as_str()).copied() {
            return self.inline(number, bound, arguments.len(), span);
        }
        let Some(function) = functions::find(&name.text) else {
            if self.names.is_poisoned(&name.text) {
                return None;
            }
            if OF_ARRAYS.iter().any(|(word, _)| *word == name.text) {
                // In all other places it has been written out.
                let message = format!("`{}` cannot be used here: only scalars are known", name.text);
                self.report.push(Diagnostic::error(codes::WRONG_KIND, span, message));
                return None;
            }
            let error = Diagnostic::error(codes::UNKNOWN_FUNCTION, name.span, unknown_function(&name.text));
            let help = self.other_function(name, arguments);
            self.report.push(Diagnostic { help, ..error });
            return None;
        };
        let (fewest, most) = function.arguments;
        if arguments.len() < fewest || arguments.len() > most {
            let wanted = if fewest == most { fewest.to_string() } else { format!("at least {fewest}") };
            let message = format!("`{}` takes {wanted} argument(s), found {}", function.name, arguments.len());
            self.report.push(Diagnostic::error(codes::ARGUMENT_COUNT, span, message));
            return None;
        }
        Some(NodeKind::Call(function, bound?))
    }

    /// How a call of another language is written here; what is wrong with its arguments is reported.
    fn habit(&mut self, name: &Name, arguments: &'a [Expr]) -> Option<String> {
        if functions::find(&name.text).is_some() || self.names.is_poisoned(&name.text) {
            return None;
        }
        let quantity = self.names.quantity(&name.text).is_some();
        if quantity || self.names.function(&name.text).is_some() {
            let time = |argument: &Expr| match &argument.kind {
                ExprKind::Reference(reference) => ["t", TIME].contains(&reference.name.text.as_str()),
                _ => false,
            };
            let present = quantity && matches!(arguments, [argument] if time(argument));
            return present.then(|| format!("write `{}` alone: every quantity is that of the present time", name.text));
        }
        let help = habits::function(&name.text)?;
        for argument in arguments {
            match argument.kind {
                ExprKind::Compare(..) | ExprKind::Logical(..) | ExprKind::Not(_) => _ = self.condition(argument),
                _ => _ = self.number(argument),
            }
        }
        Some(help.to_owned())
    }

    /// What to write in place of a function that does not exist: the nearest one that takes as many arguments.
    fn other_function(&self, name: &Name, arguments: &[Expr]) -> Option<String> {
        if self.names.quantity(&name.text).is_some() {
            return Some(format!("subscripts need brackets, products a sign: `{0}[...]`, `{0}*(...)`", name.text));
        }
        let count = arguments.len();
        let built_in =
            FUNCTIONS.iter().filter(|function| (function.arguments.0..=function.arguments.1).contains(&count));
        let own = self.names.functions.iter().filter(|function| function.parameters.len() == count);
        let signals = WAVEFORMS.iter().filter(|(_, meanings, needed)| {
            self.reads != Reads::Constants && (*needed..=meanings.len()).contains(&count)
        });
        let of_arrays = OF_ARRAYS.iter().filter(|(_, taken)| *taken == count);
        let known = built_in
            .map(|function| function.name)
            .chain(of_arrays.map(|(word, _)| *word))
            .chain(own.map(|function| function.name.text.as_str()))
            .chain(signals.map(|(word, ..)| *word));
        suggestion(&name.text, known)
    }

    fn reference(&mut self, reference: &'a Reference) -> Option<NodeKind> {
        let name = &reference.name;
        if let Some(cell) = self.cell(reference) {
            return cell;
        }
        let subscripts = all(reference.subscripts.iter().map(|subscript| self.number(subscript)));
        // The innermost index wins; equal names have been reported.
        let index = self.scope.iter().rposition(|index| *index == name.text);
        let symbol = self.names.find(&name.text);
        let predefined = match symbol {
            Some(Symbol::Predefined(value)) => Some(NodeKind::Number(value)),
            _ => None,
        };
        let number = index.map(NodeKind::Index).or_else(|| self.argument(name)).or(predefined);
        if let Some(number) = number {
            if !reference.subscripts.is_empty() {
                let message = format!("`{}` is a number and takes no subscripts", name.text);
                self.report.push(Diagnostic::error(codes::SUBSCRIPT_COUNT, reference.span, message));
                return None;
            }
            return Some(number);
        }
        match symbol {
            Some(Symbol::Quantity(number)) => {
                self.names.quantities[number].used = true;
                self.check_kind(number, name)?;
                self.check_rank(number, reference)?;
                Some(NodeKind::Element(number, subscripts?))
            }
            None if name.text == TIME && !self.names.is_poisoned(TIME) => {
                self.check_signal(TIME, name.span)?;
                if !reference.subscripts.is_empty() {
                    let message = "`time` is a number and takes no subscripts";
                    self.report.push(Diagnostic::error(codes::SUBSCRIPT_COUNT, reference.span, message));
                    return None;
                }
                Some(NodeKind::Time)
            }
            _ if self.names.is_poisoned(&name.text) => None,
            Some(Symbol::Index(number)) => {
                self.names.indices[number].used = true;
                self.report.push(Names::unbound_index(name));
                None
            }
            Some(Symbol::Predefined(_)) | None => {
                self.report.push(self.names.unknown(name, &self.scope));
                None
            }
        }
    }

    /// The argument of the innermost function that a name stands for.
    fn argument(&self, name: &Name) -> Option<NodeKind> {
        let function = &self.names.functions[*self.calling.last()?];
        function.parameters.iter().position(|parameter| parameter.text == name.text).map(NodeKind::Argument)
    }

    /// A call of a function of the spec.
    fn inline(&mut self, number: usize, arguments: Option<Vec<Node>>, found: usize, span: Span) -> Option<NodeKind> {
        let function = &self.names.functions[number];
        let (name, wanted) = (function.name, function.parameters.len());
        if found != wanted {
            let message = format!("`{}` takes {wanted} argument(s), found {found}", name.text);
            let error = Diagnostic::error(codes::ARGUMENT_COUNT, span, message);
            self.report.push(error.with_label(name.span, "defined here"));
            return None;
        }
        let body = self.body(number, span)?;
        Some(NodeKind::Inline(arguments?, body))
    }

    /// The bound body of a function; it is bound once for each kind of place.
    pub(crate) fn body(&mut self, number: usize, span: Span) -> Option<Rc<Body>> {
        let place = self.reads.place();
        if let Some(known) = &self.names.functions[number].bound[place] {
            return known.clone();
        }
        if let Some(first) = self.calling.iter().position(|calling| *calling == number) {
            let cycle = self.calling[first..].iter().chain([&number]);
            let cycle: Vec<String> =
                cycle.map(|function| format!("`{}`", self.names.functions[*function].name.text)).collect();
            let message = format!("the function calls itself: {}", cycle.join(" calls "));
            let error = Diagnostic::error(codes::RECURSION, span, message);
            let name = self.names.functions[number].name;
            self.report.push(error.with_label(name.span, "defined here"));
            return None;
        }
        let too_deep = |name: &Name| {
            let message = format!("`{}` calls functions that call functions, too deep", name.text);
            Diagnostic::error(codes::TOO_DEEP, name.span, message)
                .with_help("give intermediate values names of their own, as algebraic equations")
        };
        let (name, tree) = (self.names.functions[number].name, self.names.functions[number].body);
        if self.calling.len() >= MOST_NESTED_CALLS {
            self.report.push(too_deep(name));
            return None;
        }
        // A body knows its arguments and what is defined for the whole spec, but no index and no element.
        let (scope, owner) = (std::mem::take(&mut self.scope), self.owner.take());
        let rows = std::mem::take(&mut self.rows);
        self.calling.push(number);
        let node = self.number(tree);
        self.calling.pop();
        (self.scope, self.owner, self.rows) = (scope, owner, rows);
        let body = node.map(|node| Body { depth: depth(&node), node }).filter(|body| {
            let fits = body.depth <= DEEPEST_BODY;
            if !fits {
                self.report.push(too_deep(name));
            }
            fits
        });
        let body = body.map(Rc::new);
        self.names.functions[number].bound[place] = Some(body.clone());
        body
    }

    /// Binds a signal.
    fn signal(
        &mut self,
        number: usize,
        (arguments, units): (&'a [Expr], &'a [(usize, Name)]),
        span: Span,
    ) -> Option<NodeKind> {
        let (word, meanings, _) = WAVEFORMS[number];
        self.check_signal(word, span)?;
        check_count(number, arguments.len(), span).map_err(|error| self.report.push(error)).ok()?;
        let reads = self.reads;
        let mut bound = Vec::with_capacity(arguments.len());
        for (at, (argument, (meaning, kind))) in arguments.iter().zip(meanings).enumerate() {
            let unit = units.iter().find(|(of, _)| *of == at).map(|(_, unit)| unit);
            let scale = unit_scale(unit, kind.units(), meaning, kind.unstated(self.names.time))
                .map_err(|error| self.report.push(error));
            self.reads = if *kind == Argument::Modulation { Reads::Signals } else { Reads::Constants };
            let value = self.number(argument);
            bound.extend(value.zip(scale.ok()));
        }
        self.reads = reads;
        (bound.len() == arguments.len()).then_some(NodeKind::Signal(number, bound))
    }

    /// Reports a signal where none can be read.
    fn check_signal(&mut self, word: &str, span: Span) -> Option<()> {
        if matches!(self.reads, Reads::Variables | Reads::Signals) {
            return Some(());
        }
        let message = format!("`{word}` changes over time and cannot be read here");
        let help = "signals are allowed on the right-hand side of equations and inputs";
        self.report.push(Diagnostic::error(codes::SIGNAL_PLACE, span, message).with_help(help));
        None
    }

    /// Reports a quantity that an expression of this place cannot read.
    fn check_kind(&mut self, number: usize, name: &Name) -> Option<()> {
        let quantity = &self.names.quantities[number];
        let allowed = match self.reads {
            Reads::Consts => quantity.kind == Kind::Const,
            Reads::Constants | Reads::Signals => matches!(quantity.kind, Kind::Const | Kind::Param),
            Reads::Variables => true,
        };
        if allowed {
            return Some(());
        }
        let message = format!("`{}` is {} and cannot be read here", name.text, quantity.describe());
        let help = match self.reads {
            _ if quantity.tunable => {
                "what is fixed before the run cannot read what a host changes; leave `tunable` out of the declaration"
            }
            Reads::Consts => "constants and index ranges can only read constants defined with `const`",
            Reads::Signals => {
                "write the signal itself in place of the name, such as `0.5 + 0.4*sine(1, 50 Hz)`: only signals, `time`, \
                 constants and parameters can be read here"
            }
            _ => "a value fixed before time zero can only read constants and parameters",
        };
        let error = Diagnostic::error(codes::WRONG_KIND, name.span, message);
        self.report.push(error.with_label(quantity.name.span, "defined here").with_help(help));
        None
    }

    /// Reports a wrong number of subscripts.
    pub(crate) fn check_rank(&mut self, number: usize, reference: &Reference) -> Option<()> {
        let quantity = &self.names.quantities[number];
        let (found, wanted) = (reference.subscripts.len(), quantity.rank);
        if found == wanted {
            return Some(());
        }
        let name = &quantity.name.text;
        let message = match wanted {
            0 => format!("`{name}` is a scalar, found {found} subscript(s)"),
            _ => format!("`{name}` has {wanted} subscript(s), found {found}"),
        };
        let error = Diagnostic::error(codes::SUBSCRIPT_COUNT, reference.span, message)
            .with_label(quantity.name.span, "defined here");
        self.report.push(match quantity.unit {
            Some(unit) if wanted == 0 => error
                .with_help(format!("`[{}]` was read as a unit; indices follow the name without a blank", unit.text)),
            _ => error,
        });
        None
    }
}

/// The message for a function that does not exist.
pub(crate) fn unknown_function(name: &str) -> String {
    format!("unknown function `{name}`")
}

/// Whether an expression is a condition and no number.
fn is_condition(expr: &Expr) -> bool {
    matches!(expr.kind, ExprKind::Compare(..) | ExprKind::Logical(..) | ExprKind::Not(_))
}

/// All items, or `None` if one is missing; unlike `collect` it visits all of them.
fn all<T>(items: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
    let mut complete = true;
    let items: Vec<T> = items
        .filter_map(|item| {
            complete &= item.is_some();
            item
        })
        .collect();
    complete.then_some(items)
}
