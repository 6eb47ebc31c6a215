//! Values from the command line: constants, parameters, initial values, or single elements of them.

use crate::names::table::{Kind, Names, Quantity, Symbol};
use crate::nearest::suggestion;
use crate::outputs::item::{extents, parse};
use crate::report::Report;
use pe_ir::codes;
use pe_ir::source::Diagnostic;

/// What the command line says about one quantity.
#[derive(Clone, Debug, Default)]
pub(crate) struct Set {
    /// Value of all elements.
    pub(crate) whole: Option<f64>,
    /// Subscripts and values of single elements.
    elements: Vec<(Vec<i64>, f64)>,
}

/// Checks the names that are set; gives the values by quantity. Of several for one element the last counts.
pub(crate) fn check(names: &Names, overrides: &[(String, f64)], report: &mut Report) -> Vec<Set> {
    let mut sets = vec![Set::default(); names.quantities.len()];
    for (text, value) in overrides {
        let Some(item) = parse(text) else {
            let error = Diagnostic::global(codes::OVERRIDE, format!("`{text:.100}` names nothing that can be set"));
            report.push(error.with_help("name a constant, a parameter, a state or an element: `--set 'R[3]=2'`"));
            continue;
        };
        match settable(names, &item.name, *value) {
            Ok(Some(number)) => match item.subscripts {
                Some(subscripts) => sets[number].elements.push((subscripts, *value)),
                None => sets[number] = Set { whole: Some(*value), elements: Vec::new() },
            },
            Ok(None) => {}
            Err(problem) => report.push(problem),
        }
    }
    sets
}

/// The quantity of a name that can be set, `None` if nothing is known of it for another reason.
fn settable(names: &Names, name: &str, value: f64) -> Result<Option<usize>, Diagnostic> {
    let kinds = |kind: Kind| matches!(kind, Kind::Const | Kind::Param | Kind::State);
    match names.written(name) {
        Some(Symbol::Quantity(number)) if kinds(names.quantities[number].kind) => {
            if value.is_finite() {
                return Ok(Some(number));
            }
            let message = format!("`{name}` cannot be set to {value}");
            Err(Diagnostic::global(codes::OVERRIDE, message).with_help("give a finite number"))
        }
        Some(Symbol::Quantity(number)) => {
            let quantity = &names.quantities[number];
            let message = format!("`{name}` is {} and cannot be set", quantity.kind.describe());
            let error = Diagnostic::error(codes::OVERRIDE, quantity.name.span, message);
            Err(error.with_help("constants, parameters and initial values of states can be set from outside"))
        }
        Some(Symbol::Index(number)) => {
            let message = format!("`{name}` is an index and cannot be set");
            let error = Diagnostic::error(codes::OVERRIDE, names.indices[number].name.span, message);
            Err(error.with_help("set the constant that its range depends on"))
        }
        _ if names.is_poisoned(name) => Ok(None),
        Some(Symbol::Predefined(_)) => {
            Err(Diagnostic::global(codes::OVERRIDE, format!("`{name}` is predefined and cannot be set")))
        }
        None => {
            let known = names.quantities.iter().filter(|quantity| kinds(quantity.kind));
            let message = format!("no constant, parameter or state `{name}` to set");
            let help = suggestion(name, known.map(|quantity| quantity.name.text.as_str()));
            Err(Diagnostic { help, ..Diagnostic::global(codes::OVERRIDE, message) })
        }
    }
}

/// Offsets and values of the elements of a quantity that are set one by one; the last one of several counts.
pub(crate) fn elements(quantity: &Quantity, set: &Set, report: &mut Report) -> Vec<(usize, f64)> {
    if quantity.broken {
        return Vec::new();
    }
    let mut elements = Vec::with_capacity(set.elements.len());
    for (subscripts, value) in &set.elements {
        let found = (subscripts.len() == quantity.rank).then(|| quantity.offset(subscripts).ok()).flatten();
        match found {
            Some(offset) => elements.push((offset, *value)),
            None => {
                let message = format!("`{}` does not exist and cannot be set", quantity.element_name(subscripts));
                let error = Diagnostic::error(codes::OVERRIDE, quantity.name.span, message);
                report.push(Diagnostic { help: extents(quantity), ..error });
            }
        }
    }
    elements
}
