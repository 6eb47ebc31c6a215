//! Algebraic rules: each is solved for one quantity that may change and that nothing else determines.

use pe_ir::codes;
use pe_ir::source::Diagnostic;
use roxmltree::Node;

use super::{Reader, flag};
use crate::expr::Expr;
use crate::model::Kind;
use crate::solve::{matched, reads, replaced, solved};
use crate::xml::{child, listed, span};

/// Equations that are put in place, one within the other, in search of a quantity.
const DEEPEST: usize = 20;

impl<'a> Reader<'a, '_> {
    /// Gives the quantities that algebraic rules determine their equations, after all else is read.
    pub(super) fn algebraic_rules(&mut self) {
        let rules = listed(self.node, "listOfRules").into_iter();
        let rules: Vec<Node> =
            rules.filter(|rule| rule.tag_name().name() == "algebraicRule" && child(*rule, "math").is_some()).collect();
        if rules.is_empty() {
            return;
        }
        let free = self.undetermined();
        let mut equations: Vec<Expr> = rules.iter().map(|rule| self.math(*rule)).collect();
        let candidates: Vec<Vec<usize>> =
            equations.iter_mut().map(|equation| self.candidates(equation, &free)).collect();
        let determined = matched(&candidates);
        for (number, rule) in rules.iter().enumerate() {
            let solution =
                determined[number].and_then(|of| Some((of, solved(&equations[number], of, &self.model.functions)?)));
            let Some((of, solution)) = solution else {
                let (message, help) = match determined[number] {
                    Some(of) => (
                        format!("an algebraic rule cannot be solved for `{}`", self.model.quantities[of].id),
                        "solve it by hand, and write that as an assignment rule",
                    ),
                    None => (
                        "an algebraic rule has no quantity that it could determine".to_owned(),
                        "a quantity that it reads must not be constant, nor have another rule, nor be changed by reactions",
                    ),
                };
                self.findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(*rule), message).with_help(help));
                continue;
            };
            // Later rules do not read it, so that no two need each other.
            for later in &mut equations[number + 1..] {
                *later = replaced(later, of, &solution);
            }
            self.model.quantities[of].equation = span(*rule);
            self.determine(of, solution);
        }
    }

    /// Quantities that may change and have neither a rule nor reactions.
    fn undetermined(&self) -> Vec<usize> {
        let lists = ["listOfCompartments", "listOfParameters", "listOfSpecies", "listOfReactions"];
        let mut found = Vec::new();
        for (list, node) in
            lists.iter().flat_map(|list| listed(self.node, list).into_iter().map(move |node| (*list, node)))
        {
            let references =
                || super::reactions::references(node).into_iter().map(|(_, reference)| reference).collect();
            let nodes: Vec<Node> = if list == "listOfReactions" { references() } else { vec![node] };
            for node in nodes {
                let Some(index) = node.attribute("id").and_then(|id| self.core.ids.get(id)).copied() else { continue };
                let constant = match list {
                    "listOfSpecies" => false,
                    "listOfReactions" => !self.old,
                    _ => self.old,
                };
                let may_change = !flag(node, "constant", constant) && !self.varies(&self.model.quantities[index].id);
                let held = self.held(index);
                let is_free = matches!(self.model.quantities[held].kind, Kind::Constant(_) | Kind::Missing);
                if may_change && is_free && !found.contains(&index) {
                    found.push(index);
                }
            }
        }
        found
    }

    /// The free quantities that an equation reads; where there are none, equations of quantities that it reads are put in
    /// their place.
    fn candidates(&self, equation: &mut Expr, free: &[usize]) -> Vec<usize> {
        for _ in 0..DEEPEST {
            let found: Vec<usize> = free.iter().copied().filter(|of| reads(equation, *of)).collect();
            if !found.is_empty() {
                return found;
            }
            let mut changed = false;
            let put_in = equation.map(&mut |leaf| match leaf {
                Expr::Name(name) => match self.model.quantities.get(*name).map(|quantity| &quantity.kind) {
                    Some(Kind::Algebraic(expr)) => {
                        changed = true;
                        Some(expr.clone())
                    }
                    _ => None,
                },
                _ => None,
            });
            if !changed {
                break;
            }
            *equation = put_in;
        }
        Vec::new()
    }
}
