//! Events.

use roxmltree::Node;

use super::{Reader, flag, unknown_id};
use crate::expr::Expr;
use crate::model::Event;
use crate::xml::{child, listed, span};

impl<'a> Reader<'a, '_> {
    pub(super) fn events(&mut self) {
        for node in listed(self.node, "listOfEvents") {
            // Without a condition an event never comes.
            let Some(trigger) = child(node, "trigger").filter(|trigger| child(*trigger, "math").is_some()) else {
                continue;
            };
            let condition = self.reader_for(trigger, None, |reader, math| reader.condition(math));
            let delay = self.part(node, "delay");
            let priority = self.part(node, "priority");
            let mut assignments = Vec::new();
            for assignment in listed(node, "listOfEventAssignments") {
                if child(assignment, "math").is_none() {
                    continue;
                }
                let value = self.math(assignment);
                let target = assignment.attribute("variable").unwrap_or("");
                match self.core.ids.get(target).copied() {
                    Some(index) => assignments.push(self.assigned(index, value)),
                    None => self.findings.push(unknown_id(assignment, target)),
                }
            }
            let early_values = flag(node, "useValuesFromTriggerTime", true);
            let assignments = self.with_equilibria(assignments, (node, early_values && delay.is_some()));
            self.model.events.push(Event {
                id: node.attribute("id").unwrap_or("").to_owned(),
                trigger: condition,
                held_before: flag(trigger, "initialValue", true),
                persistent: flag(trigger, "persistent", true),
                early_values,
                delay,
                priority,
                assignments,
                span: span(node),
            });
        }
    }

    fn part(&mut self, event: Node<'a, 'a>, name: &str) -> Option<Expr> {
        let node = child(event, name).filter(|node| child(*node, "math").is_some())?;
        Some(self.math(node))
    }
}
