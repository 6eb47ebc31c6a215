//! The pass that collects the names that a spec defines.

use crate::language::functions;
use crate::language::waveforms::{SAMPLES, WAVEFORMS};
use crate::language::words::{OF_ARRAYS, predefined};
use crate::names::table::{Defined, Index, Kind, MOST_DIMENSIONS, Names, Quantity, Symbol};
use crate::report::Report;
use crate::syntax::ast::{Binder, Expr as Tree, LeftSide, Name, Sort, Spec, StatementKind};
use pe_ir::codes;
use pe_ir::source::Diagnostic;

/// Collects the names that a spec defines.
pub(crate) fn collect<'a>(spec: &'a Spec, report: &mut Report) -> Names<'a> {
    let names = Names { missing: spec.names_missing, ..Names::default() };
    let mut all = Collector { names, report };
    all.names.poisoned.extend(spec.broken.iter().flat_map(|broken| broken.names.iter().map(String::as_str)));
    for statement in &spec.statements {
        match &statement.kind {
            StatementKind::Const { name, .. } => all.declare(name, Kind::Const, None, &[]),
            StatementKind::Param { declared: d, .. } => {
                all.declare(&d.name, Kind::Param, d.unit.as_ref(), &d.dimensions);
            }
            StatementKind::Input { declared: d, .. } => {
                all.declare(&d.name, Kind::Input, d.unit.as_ref(), &d.dimensions);
            }
            StatementKind::State { declared: d, sort, .. } => {
                all.declare(&d.name, Kind::State, d.unit.as_ref(), &d.dimensions);
                if let Some(quantity) = all.names.quantities.last_mut().filter(|q| q.name.span == d.name.span) {
                    quantity.block = statement.block;
                    quantity.tunable = *sort == Sort::Tunable;
                    quantity.angle = *sort == Sort::Angle;
                }
            }
            StatementKind::Matrix { declared: d, symmetric } => {
                all.declare(&d.name, Kind::Algebraic, d.unit.as_ref(), &d.dimensions);
                if d.dimensions.len() != 2 {
                    let message = format!("`{}` has {} dimensions; a matrix has two", d.name.text, d.dimensions.len());
                    all.report.push(Diagnostic::error(codes::SUBSCRIPT_COUNT, d.name.span, message));
                }
                if let Some(quantity) = all.names.quantities.last_mut().filter(|q| q.name.span == d.name.span) {
                    quantity.block = statement.block;
                    quantity.matrix = Some(*symmetric);
                    quantity.broken |= d.dimensions.len() != 2;
                }
            }
            StatementKind::Index(binders) => {
                for binder in binders {
                    if all.is_free(&binder.name) {
                        all.names.symbols.insert(&binder.name.text, Symbol::Index(all.names.indices.len()));
                        all.names.indices.push(Index {
                            name: &binder.name,
                            range: None,
                            used: spec.of_instances.contains(&binder.name.text),
                        });
                    }
                }
            }
            StatementKind::Function { name, parameters, body } => {
                all.define_function(name, parameters, body);
            }
            _ => {}
        }
    }
    // Equations in a second pass, so that they may stand before declarations.
    for statement in &spec.statements {
        let StatementKind::Equation(equation) = &statement.kind else { continue };
        let name = &equation.target.name;
        if equation.side == LeftSide::Algebraic && all.names.find(&name.text).is_none() {
            all.add(name, Kind::Algebraic, equation.unit.as_ref(), &[]);
            if let Some(quantity) = all.names.quantities.last_mut() {
                quantity.rank = equation.target.subscripts.len();
                quantity.block = statement.block;
            }
        }
    }
    all.shadowed_dimensions();
    all.names
}

struct Collector<'r, 'a> {
    names: Names<'a>,
    report: &'r mut Report,
}

impl<'a> Collector<'_, 'a> {
    fn declare(&mut self, name: &'a Name, kind: Kind, unit: Option<&'a Name>, binders: &'a [Binder]) {
        if self.is_free(name) {
            self.add(name, kind, unit, binders);
        }
        if binders.len() > MOST_DIMENSIONS {
            let message =
                format!("`{}` has {} dimensions; the most allowed is {MOST_DIMENSIONS}", name.text, binders.len());
            self.report.push(Diagnostic::error(codes::SUBSCRIPT_COUNT, name.span, message));
        }
    }

    fn add(&mut self, name: &'a Name, kind: Kind, unit: Option<&'a Name>, binders: &'a [Binder]) {
        self.names.symbols.insert(&name.text, Symbol::Quantity(self.names.quantities.len()));
        self.names.quantities.push(Quantity {
            name,
            kind,
            unit,
            block: None,
            tunable: false,
            angle: false,
            matrix: None,
            rank: binders.len(),
            binders,
            dimensions: Vec::new(),
            length: 0,
            base: 0,
            values: Vec::new(),
            defined_by: Vec::new(),
            broken: self.names.poisoned.contains(name.text.as_str()),
            used: false,
        });
    }

    /// Whether a name can be defined here; reports it if not.
    fn is_free(&mut self, name: &Name) -> bool {
        if predefined(&name.text).is_some() {
            let message = format!("`{}` is predefined and cannot be defined again", name.text);
            self.report.push(Diagnostic::error(codes::DUPLICATE, name.span, message));
            return false;
        }
        let Some(earlier) = self.names.definition(&name.text) else { return true };
        let message = format!("`{}` is defined twice", name.text);
        self.report
            .push(Diagnostic::error(codes::DUPLICATE, name.span, message).with_label(earlier, "first defined here"));
        false
    }

    /// Reports arrays whose dimensions share an index name, or take the name of something else.
    fn shadowed_dimensions(&mut self) {
        for quantity in &self.names.quantities {
            for (at, binder) in quantity.binders.iter().enumerate() {
                if quantity.binders[..at].iter().any(|earlier| earlier.name.text == binder.name.text) {
                    let message =
                        format!("index `{}` is used for two dimensions of `{}`", binder.name.text, quantity.name.text);
                    self.report.push(
                        Diagnostic::error(codes::DUPLICATE, binder.name.span, message)
                            .with_help("define a second index over the same range"),
                    );
                }
                if binder.range.is_some() {
                    self.names.check_index_name(&binder.name, self.report);
                }
            }
        }
    }

    /// Takes in a function.
    fn define_function(&mut self, name: &'a Name, parameters: &'a [Name], body: &'a Tree) {
        for (at, parameter) in parameters.iter().enumerate() {
            if let Some(first) = parameters[..at].iter().find(|first| first.text == parameter.text) {
                let message = format!("two arguments `{}`", parameter.text);
                let error = Diagnostic::error(codes::DUPLICATE, parameter.span, message);
                self.report.push(error.with_label(first.span, "the first one"));
            }
            if predefined(&parameter.text).is_some() {
                let message = format!("`{}` is predefined and cannot be an argument", parameter.text);
                self.report.push(Diagnostic::error(codes::DUPLICATE, parameter.span, message));
            }
        }
        let of_arrays = OF_ARRAYS.iter().any(|(word, _)| *word == name.text);
        let waveform =
            WAVEFORMS.iter().any(|(word, ..)| *word == name.text) || name.text == SAMPLES || name.text == "data";
        if waveform || of_arrays || functions::find(&name.text).is_some() {
            let message = format!("`{}` is a function of the language", name.text);
            self.report.push(Diagnostic::error(codes::DUPLICATE, name.span, message).with_help("choose another name"));
        } else if let Some(first) = self.names.function(&name.text) {
            let message = format!("the function `{}` is defined twice", name.text);
            let error = Diagnostic::error(codes::DUPLICATE, name.span, message);
            self.report.push(error.with_label(first.name.span, "first defined here"));
        } else {
            self.names.function_numbers.insert(&name.text, self.names.functions.len());
            self.names.functions.push(Defined { name, parameters, body, bound: [None, None, None, None] });
        }
    }
}
