//! Outputs named on the command line, in place of the spec's.

use crate::elaborate::Elaborator;
use crate::evaluate::Fault;
use crate::names::{Kind, PREDEFINED, Quantity, Symbol};
use crate::nearest::suggestion;
use pe_ir::codes;
use pe_ir::model::Output;
use pe_ir::source::Diagnostic;
use std::collections::HashSet;

/// An item of a list such as `V[3], w[1,2], p`.
pub(crate) struct Item<'t> {
    pub(crate) name: &'t str,
    /// `None` for a scalar or a whole array.
    pub(crate) subscripts: Option<Vec<i64>>,
}

impl Elaborator<'_> {
    /// The elements that the lists name, in order of mention; an element counts once.
    pub(crate) fn observed(&mut self, lists: &[String]) -> Vec<Output> {
        let mut outputs = Vec::new();
        let mut taken = HashSet::new();
        for text in lists.iter().flat_map(|list| split(list)) {
            let found = parse(text).ok_or_else(|| {
                Diagnostic::global(codes::OVERRIDE, format!("`{text}` names nothing that can be observed"))
                    .with_help("name scalars, elements or whole arrays: `--observe 'p,V[3],w[1,2]'`")
            });
            match found.and_then(|item| self.observed_elements(&item)) {
                Ok((number, offsets)) => {
                    for offset in offsets {
                        let quantity = &self.names.quantities[number];
                        let (variable, name) = (quantity.variable(offset), quantity.name_at(offset));
                        if taken.insert(variable) {
                            outputs.push(Output { name, variable, span: quantity.name.span });
                        }
                    }
                }
                Err(problem) => self.report.push(problem),
            }
        }
        if outputs.is_empty() && !self.report.failed() && self.spec.broken.is_empty() {
            self.report.push(Diagnostic::global(codes::NO_OUTPUT, "`--observe` names no element"));
        }
        outputs
    }

    /// Number of the quantity and offsets of its elements; none for what a reported error keeps from being known.
    fn observed_elements(&self, item: &Item) -> Result<(usize, Vec<usize>), Diagnostic> {
        let Item { name, subscripts } = item;
        let number = match self.names.find(name) {
            _ if self.names.is_poisoned(name) => return Ok((0, Vec::new())),
            Some(Symbol::Quantity(number)) => number,
            None if !PREDEFINED.iter().any(|(word, _)| word == name) => {
                let known = self.names.quantities.iter().filter(|quantity| quantity.kind.varies());
                let error = Diagnostic::global(codes::UNKNOWN_NAME, format!("unknown name `{name}` to observe"));
                return Err(Diagnostic { help: suggestion(name, known.map(|q| q.name.text.as_str())), ..error });
            }
            Some(Symbol::Index(_)) | None => {
                let message = format!("`{name}` does not change over time and cannot be observed");
                return Err(Diagnostic::global(codes::WRONG_KIND, message));
            }
        };
        let quantity = &self.names.quantities[number];
        if !quantity.kind.varies() {
            let message = format!("`{name}` is {} and cannot be observed", quantity.kind.describe());
            return Err(Diagnostic::error(codes::WRONG_KIND, quantity.name.span, message)
                .with_help("states, inputs and algebraic quantities can be observed"));
        }
        if quantity.broken {
            return Ok((number, Vec::new()));
        }
        let Some(subscripts) = subscripts else {
            let exists = |offset: &usize| quantity.exists(*offset);
            return Ok((number, (0..quantity.length).filter(exists).collect()));
        };
        if subscripts.len() != quantity.rank {
            let message = format!("`{name}` has {} subscripts, not {}", quantity.rank, subscripts.len());
            return Err(Diagnostic::error(codes::SUBSCRIPT_COUNT, quantity.name.span, message));
        }
        match self.existing(number, subscripts, quantity.name.span) {
            Ok(offset) => Ok((number, vec![offset])),
            // The finding's place is the definition; a label there would say it twice.
            Err(Fault::Report(problem)) => Err(Diagnostic { labels: Vec::new(), help: extents(quantity), ..*problem }),
            Err(_) => Ok((number, Vec::new())),
        }
    }
}

/// The subscripts that an array has, as help; gaps in an algebraic quantity follow no range.
pub(crate) fn extents(quantity: &Quantity) -> Option<String> {
    if quantity.kind == Kind::Algebraic || quantity.rank == 0 {
        return None;
    }
    let ranges = quantity.dimensions.iter().map(|dimension| format!("{}..{}", dimension.low, dimension.high));
    let ranges = ranges.collect::<Vec<String>>().join(", ");
    Some(format!("subscripts of `{}` are in {ranges}", quantity.name.text))
}

/// The items of a list: commas within brackets do not part them.
fn split(list: &str) -> Vec<&str> {
    let mut depth = 0i32;
    let parts = list.split(|letter| {
        depth += i32::from(letter == '[') - i32::from(letter == ']');
        letter == ',' && depth == 0
    });
    parts.map(str::trim).collect()
}

/// Name and subscripts of an item, `None` if it is written otherwise.
pub(crate) fn parse(text: &str) -> Option<Item<'_>> {
    let (name, subscripts) = match text.split_once('[') {
        None => (text, None),
        Some((name, rest)) => {
            let inner = rest.strip_suffix(']')?;
            let numbers = inner.split(',').map(|number| number.trim().parse().ok());
            (name.trim_end(), Some(numbers.collect::<Option<Vec<i64>>>()?))
        }
    };
    let plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
    (!name.is_empty() && name.chars().all(plain)).then_some(Item { name, subscripts })
}
