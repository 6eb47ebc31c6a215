//! Function definitions.

use std::collections::{HashMap, HashSet};

use pe_ir::codes;
use pe_ir::source::Diagnostic;
use roxmltree::Node;

use super::scope::Known;
use super::{Named, Reader, below};
use crate::expr::Expr;
use crate::mathml;
use crate::model::Function;
use crate::xml::{child, elements, listed, span, text};

/// Calls that the language nests; what goes deeper is put in place.
const DEEPEST: usize = 15;

impl<'a> Reader<'a, '_> {
    /// Reads function definitions, each after those that it calls.
    pub(super) fn functions(&mut self) {
        let nodes: Vec<Node> = listed(self.node, "listOfFunctionDefinitions");
        let mut numbers: HashMap<&str, usize> = HashMap::new();
        for (number, node) in nodes.iter().enumerate() {
            if let Some(id) = node.attribute("id")
                && numbers.insert(id, number).is_some()
            {
                let message = format!("the id `{}` is there twice", id.escape_debug());
                self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span(*node), message));
            }
        }
        let calls: Vec<Vec<usize>> = nodes.iter().map(|node| called(*node, &numbers)).collect();
        let mut callers: Vec<Vec<usize>> = vec![Vec::new(); nodes.len()];
        let mut waits: Vec<usize> = calls.iter().map(Vec::len).collect();
        for (number, called) in calls.iter().enumerate() {
            called.iter().for_each(|called| callers[*called].push(number));
        }
        let mut ready: Vec<usize> = (0..nodes.len()).rev().filter(|number| waits[*number] == 0).collect();
        while let Some(number) = ready.pop() {
            self.function(nodes[number]);
            for caller in callers[number].iter().rev() {
                waits[*caller] -= 1;
                if waits[*caller] == 0 {
                    ready.push(*caller);
                }
            }
        }
        for (node, waits) in nodes.iter().zip(waits) {
            if waits > 0 {
                let message =
                    format!("the function `{}` calls itself", node.attribute("id").unwrap_or("").escape_debug());
                self.findings.push(Diagnostic::error(codes::IMPORT_LOOP, span(*node), message));
            }
        }
    }

    fn function(&mut self, node: Node<'a, 'a>) {
        let Some(id) = self.id(node) else { return };
        let Some(lambda) = below(node).find(|inner| inner.has_tag_name_of("lambda")) else {
            if child(node, "math").is_some() {
                self.findings.push(mathml::bad(node, "there is no `<lambda>` in it"));
            }
            return;
        };
        let arguments: Vec<String> = elements(lambda)
            .filter(|inner| inner.has_tag_name_of("bvar"))
            .map(|bound| child(bound, "ci").map_or_else(String::new, text))
            .collect();
        let Some(body) = elements(lambda).find(|inner| !inner.has_tag_name_of("bvar")) else {
            self.findings.push(mathml::bad(lambda, "the function has no value"));
            return;
        };
        let (read, level) = {
            let mut scope = self.core.scope(&self.model.quantities, &self.model.functions, None);
            scope.arguments = Some(arguments.clone());
            let mut reader = mathml::Reader { scope: &mut scope, findings: self.findings, parts: &mut self.parts };
            let read = reader.read(body);
            (read, scope.level)
        };
        // What a function of the language cannot be: a condition, of conditions, of the time.
        let mut is_special = false;
        read.each(&mut |part| is_special |= condition_argument(part) || *part == Expr::Time);
        let inline = read.is_condition()
            || arguments.is_empty()
            || level > DEEPEST
            || is_special
            || mathml::calls(&read, &["floor", "ceil"]);
        let number = self.model.functions.len();
        let inlined = inline.then(|| read.clone());
        self.core.functions.insert(id.clone(), Known { number, inlined, level });
        self.model.functions.push(Function { id, arguments, body: read.into_number(), span: span(node) });
    }
}

/// Whether a part takes an argument for a condition; the call decides whether that is a number.
fn condition_argument(part: &Expr) -> bool {
    let Expr::Compare(crate::expr::Relation::NotEqual, pair) = part else { return false };
    matches!(**pair, (Expr::Argument(_), Expr::Number(0.0, None)))
}

/// Functions that a definition calls, each once.
fn called(node: Node, numbers: &HashMap<&str, usize>) -> Vec<usize> {
    let mut seen = HashSet::new();
    let applied = node.descendants().filter(|inner| inner.has_tag_name_of("apply"));
    let names = applied.filter_map(|apply| elements(apply).next()).filter(|first| first.has_tag_name_of("ci"));
    names.filter_map(|name| numbers.get(text(name).as_str()).copied()).filter(|number| seen.insert(*number)).collect()
}
