//! Reactions, and what they make of species.

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::source::Diagnostic;
use roxmltree::Node;

use super::fast::Fast;
use super::{Reader, flag, unknown_id};
use crate::expr::Expr;
use crate::model::{Kind, Quantity};
use crate::xml::{child, listed, span};

impl<'a> Reader<'a, '_> {
    /// Takes in the ids of reactions and of what stands in them.
    pub(super) fn declare_reactions(&mut self) {
        for reaction in listed(self.node, "listOfReactions") {
            self.declare(reaction, "Reactions");
            for (_, reference) in references(reaction) {
                let Some(id) = reference.attribute("id") else { continue };
                let is_needed = self.named.contains(id) || self.varies(id) || self.initial.contains_key(id);
                if is_needed || matches!(reference.attribute("constant"), Some("false")) {
                    self.declare(reference, "Reactions");
                }
            }
        }
    }

    /// Reads kinetic laws, and notes for each species what reactions add to it.
    pub(super) fn reactions(&mut self) {
        for reaction in listed(self.node, "listOfReactions") {
            let Some(index) = reaction.attribute("id").and_then(|id| self.core.ids.get(id)).copied() else { continue };
            if self.model.quantities[index].span != span(reaction) {
                continue;
            }
            match child(reaction, "kineticLaw").filter(|law| child(*law, "math").is_some()) {
                Some(law) => {
                    self.model.quantities[index].equation = span(law);
                    let locals = self.locals(law, index);
                    let rate = self.reader_for(law, Some(&locals), |reader, math| reader.number(math));
                    self.model.quantities[index].kind = Kind::Algebraic(rate);
                }
                None => {
                    let id = &self.model.quantities[index].id;
                    let finding =
                        Diagnostic::error(codes::IMPORT_NO_VALUE, span(reaction), format!("`{id}` has no kinetic law"));
                    self.findings.push(finding.with_help("give it a `<kineticLaw>` with `<math>`"));
                }
            }
            let mut fast = flag(reaction, "fast", false).then(|| Fast::new(reaction, index));
            for (is_reactant, reference) in references(reaction) {
                self.flow((index, fast.as_mut()), is_reactant, reference);
            }
            self.fast.extend(fast);
        }
    }

    /// Parameters of a kinetic law.
    fn locals(&mut self, law: Node<'a, 'a>, reaction: usize) -> HashMap<String, usize> {
        let mut locals = HashMap::new();
        let nodes = listed(law, "listOfParameters").into_iter().chain(listed(law, "listOfLocalParameters"));
        for node in nodes {
            let Some(id) = node.attribute("id") else { continue };
            let base = &self.model.quantities[reaction];
            let mut quantity = Quantity::new(format!("{}_{id}", base.id), base.group, span(node));
            quantity.label = node.attribute("name").unwrap_or("").to_owned();
            quantity.unit = node.attribute("units").and_then(|unit| self.unit(unit));
            if let Some(value) = self.attribute(node, "value") {
                quantity.kind = Kind::Constant(value);
            }
            let index = self.model.add(quantity);
            if locals.insert(id.to_owned(), index).is_some() {
                let message = format!("the id `{}` is there twice", id.escape_debug());
                self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span(node), message));
            }
        }
        locals
    }

    /// Adds what a reaction, which may be a fast one, does to one of its species.
    fn flow(&mut self, (reaction, fast): (usize, Option<&mut Fast<'a>>), is_reactant: bool, reference: Node<'a, 'a>) {
        let stoichiometry = self.stoichiometry(reference);
        let name = reference.attribute("species").unwrap_or("");
        let Some(species) = self.core.ids.get(name).copied().filter(|index| self.species.contains_key(index)) else {
            self.findings.push(unknown_id(reference, name));
            return;
        };
        if !self.is_reacting(species) {
            return;
        }
        let factor = self.conversion(species);
        let converted = |flow: Expr| match factor {
            Some(factor) => factor.times(flow),
            None => flow,
        };
        match (fast, self.species.get_mut(&species)) {
            (Some(fast), _) => fast.change(species, is_reactant, converted(stoichiometry)),
            (None, Some(species)) => {
                species.flows.push((is_reactant, converted(stoichiometry.times(Expr::Name(reaction)))));
            }
            (None, None) => {}
        }
    }

    /// How many of a species a reaction takes or makes.
    fn stoichiometry(&mut self, reference: Node<'a, 'a>) -> Expr {
        let declared = reference.attribute("id").and_then(|id| self.core.ids.get(id)).copied();
        let declared = declared.filter(|index| self.model.quantities[*index].span == span(reference));
        let mut written = self.attribute(reference, "stoichiometry");
        if self.old {
            written = match child(reference, "stoichiometryMath") {
                Some(math) => Some(self.reader_for(math, None, |reader, math| reader.number(math))),
                None => written.or(Some(Expr::number(1.0))),
            };
        }
        match (declared, written) {
            (Some(index), written) => {
                let start = self.start(index).or(written);
                let kind = match (self.ruled(index, start), self.old) {
                    (Kind::Constant(value), true) => Kind::Algebraic(value),
                    (kind, _) => kind,
                };
                self.model.quantities[index].kind = kind;
                Expr::Name(index)
            }
            (None, Some(value)) => value,
            (None, None) => {
                self.findings.push(
                    Diagnostic::error(codes::IMPORT_NO_VALUE, span(reference), "the stoichiometry is not stated")
                        .with_help("add the attribute `stoichiometry`"),
                );
                Expr::number(1.0)
            }
        }
    }
}

/// Reactants, with `true`, and products of a reaction.
pub(super) fn references<'a>(reaction: Node<'a, 'a>) -> Vec<(bool, Node<'a, 'a>)> {
    let reactants = listed(reaction, "listOfReactants").into_iter().map(|node| (true, node));
    let products = listed(reaction, "listOfProducts").into_iter().map(|node| (false, node));
    reactants.chain(products).filter(|(_, node)| node.tag_name().name() == "speciesReference").collect()
}
