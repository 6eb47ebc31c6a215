//! Turns the syntax tree into a flat model, in steps that each need only what the steps before have found.
//!
//! Constants come first, then index ranges (so the sizes of arrays are known), parameters, values fixed before time
//! zero, equations, outputs. A quantity whose definition has an error is marked broken; whoever reads it stays
//! silent, so that each mistake is reported once.

use crate::Overrides;
use crate::arrays::{self, Written};
use crate::ast::{Binder, Declared, Expr as Tree, Name, Spec, StatementKind};
use crate::bound::{BoundRange, Node};
use crate::evaluate::{Evaluator, Fault, Purpose};
use crate::names::{Index, Kind, Names, Symbol};
use crate::prune::Parts;
use crate::report::Report;
use crate::resolve::{Reads, Resolver};
use crate::settings::Settings;
use pe_ir::codes;
use pe_ir::model::{Interpolation, Model};
use pe_ir::source::{Diagnostic, Span};

/// How large a model may become before it is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Elements of all parameters, inputs, states and algebraic quantities together.
    pub elements: usize,
    /// Expressions evaluated for all elements together.
    pub evaluations: u64,
    /// Variables read by all flat equations together.
    pub reads: u64,
}

impl Default for Limits {
    /// Five million elements, about ten seconds of work, about three gigabytes of equations.
    fn default() -> Self {
        Limits { elements: 5_000_000, evaluations: 500_000_000, reads: 50_000_000 }
    }
}

/// Builds the flat model of a spec.
///
/// The model is there exactly if neither the syntax tree nor the elaboration has an error.
pub fn elaborate(spec: &Spec, overrides: &Overrides) -> (Option<Model>, Vec<Diagnostic>) {
    elaborate_within(spec, overrides, &Limits::default())
}

/// [`elaborate`] with limits of the caller's.
pub fn elaborate_within(spec: &Spec, overrides: &Overrides, limits: &Limits) -> (Option<Model>, Vec<Diagnostic>) {
    let mut report = Report::default();
    let mut sizes = Elaborator::new(spec, limits, Report::default());
    let written = arrays::write_out(&mut sizes, &overrides.set, &mut report);
    let mut elaborator = Elaborator::new(written.as_ref().map_or(spec, |written| &written.spec), limits, report);
    let model = elaborator.run(overrides);
    if model.is_none() && !elaborator.report.failed() && spec.broken.is_empty() {
        let unexplained = written.as_ref().and_then(Written::unexplained);
        unexplained.into_iter().for_each(|error| elaborator.report.push(error));
    }
    (model, elaborator.report.finish())
}

/// The state that the steps share.
pub(crate) struct Elaborator<'a> {
    pub(crate) spec: &'a Spec,
    pub(crate) names: Names<'a>,
    pub(crate) report: Report,
    pub(crate) evaluator: Evaluator,
    /// Elements that may still be created.
    pub(crate) elements_left: usize,
    /// What inputs are between two samples if the spec does not say.
    pub(crate) between: Option<Interpolation>,
    /// Whether the work limit has been reported; it concerns every later expression.
    out_of_work: bool,
}

impl<'a> Elaborator<'a> {
    fn new(spec: &'a Spec, limits: &Limits, mut report: Report) -> Self {
        let names = Names::collect(spec, &mut report);
        Elaborator {
            spec,
            names,
            report,
            evaluator: Evaluator::new(limits.evaluations, limits.reads),
            elements_left: limits.elements,
            between: None,
            out_of_work: false,
        }
    }

    fn run(&mut self, overrides: &Overrides) -> Option<Model> {
        let settings = Settings::collect(self.spec, &mut self.report);
        let (observe, units) = (&overrides.observe, overrides.units);
        self.between = overrides.inputs;
        let overrides = self.check_overrides(&overrides.set);
        self.constants(Kind::Const, &overrides);
        self.index_ranges();
        self.extents();
        self.constants(Kind::Param, &overrides);
        let times = self.times(&settings);
        self.evaluator.span = times.as_ref().map_or(1.0, |times| times.span);
        let initials = self.initial_values(&overrides);
        let inputs = self.inputs();
        let rates = self.rates();
        let mut flat = self.equations();
        let mut outputs = self.outputs(observe);
        let sampled = self.sample(&mut flat, &mut outputs);
        let order = self.dependency_order(&flat);
        self.check_functions();
        self.check_units(units.or(settings.units).unwrap_or_default());
        if self.report.failed() || !self.spec.broken.is_empty() {
            return None;
        }
        self.unused_names();
        let parts = Parts {
            flat,
            sampled,
            rates: rates?,
            order: order?,
            initials,
            inputs,
            outputs,
            observed: !observe.is_empty(),
        };
        self.assemble(settings.header(times?)?, parts)
    }

    /// A resolver without indices in scope.
    pub(crate) fn resolver(&mut self, reads: Reads) -> Resolver<'_, 'a> {
        Resolver {
            names: &mut self.names,
            report: &mut self.report,
            scope: Vec::new(),
            reads,
            spec: self.spec,
            owner: None,
            calling: Vec::new(),
        }
    }

    /// Binds an expression in which the dimensions of a declaration have values.
    pub(crate) fn bind_element(&mut self, expr: &'a Tree, declared: &'a Declared, reads: Reads) -> Option<Node> {
        let owner = match self.names.find(&declared.name.text) {
            Some(Symbol::Quantity(number)) if self.names.quantities[number].name.span == declared.name.span => number,
            // Defined twice; the first definition counts.
            _ => return None,
        };
        let mut resolver = self.resolver(reads);
        resolver.owner = Some(owner);
        resolver.scope = declared.dimensions.iter().map(|binder| binder.name.text.as_str()).collect();
        resolver.number(expr)
    }

    /// Binds and evaluates a constant outside of any index.
    pub(crate) fn constant(&mut self, expr: &'a Tree) -> Option<f64> {
        let node = self.resolver(Reads::Constants).number(expr)?;
        self.evaluator.frame.clear();
        let value = self.evaluator.number(&self.names, &node, Purpose::Constant);
        self.settle(value, |diagnostic| diagnostic)
    }

    /// Binds and evaluates the range of an index.
    pub(crate) fn binder_range(&mut self, binder: &'a Binder, reads: Reads) -> Option<(i64, i64)> {
        let range = self.resolver(reads).range(binder)?;
        self.known_range(&range)
    }

    fn known_range(&mut self, range: &BoundRange) -> Option<(i64, i64)> {
        self.evaluator.frame.clear();
        let range = self.evaluator.range(&self.names, range);
        self.settle(range, |diagnostic| diagnostic)
    }

    /// The value of a result; its fault is reported after `dress` has told more about its place.
    pub(crate) fn settle<T>(
        &mut self,
        result: Result<T, Fault>,
        dress: impl FnOnce(Diagnostic) -> Diagnostic,
    ) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(Fault::Report(diagnostic)) => {
                let about_work = diagnostic.code == codes::TOO_MUCH_WORK;
                if !(about_work && std::mem::replace(&mut self.out_of_work, about_work)) {
                    self.report.push(dress(*diagnostic));
                }
                None
            }
            // Only constants wait for one another, and what has no value by now has been reported.
            Err(Fault::Silent | Fault::Missing(..)) => None,
        }
    }

    /// Whether the work limit has been met, after which evaluating on is pointless.
    pub(crate) fn is_exhausted(&self) -> bool {
        self.out_of_work
    }

    /// Takes `count` elements from the limit, or reports that there are too many.
    pub(crate) fn take_elements(&mut self, count: usize, what: &str, span: Span) -> bool {
        if let Some(left) = self.elements_left.checked_sub(count) {
            self.elements_left = left;
            return true;
        }
        let message =
            format!("`{what}` has {} elements; together with those before it the model is too large", shown(count));
        self.report.push(
            Diagnostic::error(codes::TOO_MANY_ELEMENTS, span, message).with_help("look at the ranges of its indices"),
        );
        false
    }

    /// Index ranges of `index` statements.
    pub(crate) fn index_ranges(&mut self) {
        for statement in &self.spec.statements {
            let StatementKind::Index(binders) = &statement.kind else { continue };
            for binder in binders {
                let Some(range) = self.binder_range(binder, Reads::Consts) else { continue };
                // Of two definitions the first counts; the second has been reported.
                let own = |index: &&mut Index| index.name.span == binder.name.span;
                if let Some(index) = self.names.indices.iter_mut().find(own) {
                    index.range = Some(range);
                }
            }
        }
    }

    /// Sizes of the declared arrays, and the numbers of their first elements.
    pub(crate) fn extents(&mut self) {
        let (mut states, mut inputs) = (0, 0);
        for number in 0..self.names.quantities.len() {
            let quantity = &self.names.quantities[number];
            let (kind, binders, name) = (quantity.kind, quantity.binders, quantity.name);
            if matches!(kind, Kind::Const | Kind::Algebraic) {
                continue;
            }
            let mut extents = Vec::with_capacity(binders.len());
            for binder in binders {
                extents.extend(self.binder_range(binder, Reads::Consts));
            }
            let complete = extents.len() == binders.len();
            let quantity = &mut self.names.quantities[number];
            quantity.set_extents(&extents);
            let length = quantity.length;
            if !complete || !self.take_elements(length, &name.text, name.span) {
                let quantity = &mut self.names.quantities[number];
                quantity.broken = true;
                quantity.length = 0;
                continue;
            }
            let quantity = &mut self.names.quantities[number];
            match kind {
                Kind::State => {
                    quantity.base = states;
                    states += length as u32;
                }
                Kind::Input => {
                    quantity.base = inputs;
                    inputs += length as u32;
                }
                Kind::Const | Kind::Param | Kind::Algebraic => {}
            }
        }
    }

    /// Warns about constants, parameters and indices that nothing reads.
    fn unused_names(&mut self) {
        let quantities = self.names.quantities.iter().filter(|quantity| !quantity.used);
        let constants = quantities.filter(|quantity| matches!(quantity.kind, Kind::Const | Kind::Param));
        let indices = self.names.indices.iter().filter(|index| !index.used).map(|index| index.name);
        let unused: Vec<&Name> = constants.map(|quantity| quantity.name).chain(indices).collect();
        for name in unused.into_iter().filter(|name| !name.text.starts_with('_')) {
            let message = format!("`{}` is never used", name.text);
            self.report.push(Diagnostic::error(codes::UNUSED, name.span, message).into_warning());
        }
    }
}

/// A count for messages; astronomically large ones are not counted out.
fn shown(count: usize) -> String {
    if count == usize::MAX { "more than 10^18".to_owned() } else { count.to_string() }
}
