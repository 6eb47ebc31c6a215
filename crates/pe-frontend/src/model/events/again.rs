//! What an event sets off, and events that are due more than once in an instant.

use std::collections::{BTreeMap, BTreeSet};

use super::{Present, Writer, minus, not, of};
use pe_ir::model::{Expr, Variable};

/// How often an event is due once more before it comes, at most.
const MOST_AGAIN: usize = 4;

/// Events that change what a condition reads, at most, for its event to be due more than once: each place for it to be is written
/// out behind all of them.
const MOST_SOURCES: usize = 16;

impl Writer<'_> {
    /// The events whose conditions read what an event changes.
    pub(super) fn watching(&self, event: usize, watchers: &BTreeMap<u32, Vec<usize>>) -> BTreeSet<usize> {
        let targets = self.events[event].assignments.iter().map(|(state, _)| state);
        targets.filter_map(|state| watchers.get(state)).flatten().copied().collect()
    }

    /// How often an event may be due once more before it comes.
    pub(super) fn places(&self, event: usize, watchers: &BTreeMap<u32, Vec<usize>>) -> usize {
        let sources = (0..self.events.len()).filter(|other| self.watching(*other, watchers).contains(&event)).count();
        // Passes over a pool are as many as events that come once.
        if sources > MOST_SOURCES || self.searched.contains(&event) { 0 } else { MOST_AGAIN }
    }

    /// Looks at the conditions that read what an event has changed, and returns the events that this may set off. One that
    /// may come no more does so in the next step.
    pub(super) fn look_again(
        &mut self,
        event: usize,
        watchers: &BTreeMap<u32, Vec<usize>>,
        all: &mut [Present],
        may_come: &dyn Fn(usize) -> bool,
    ) -> Vec<usize> {
        let events = self.events;
        let mut set_off = Vec::new();
        for other in self.watching(event, watchers) {
            let present = &mut all[other];
            let trigger = self.expr(event, &events[other].trigger);
            let trigger = self.quantity(other, "again", trigger);
            let rose = std::mem::replace(&mut present.trigger, trigger);
            let manner = events[other].manner;
            let waits = events[other].delay.is_some();
            if present.open && !manner.cancelled {
                // It became true without setting the event off, and is false in the next step, where it would be seen.
                let lost = Expr::product(vec![of(rose), not(present.before), not(trigger)]);
                let lost = self.flag(other, "lost", lost);
                self.lose(other, lost);
            }
            if manner.cancelled
                && let Some(due) = present.due
            {
                present.due = Some(self.flag(other, "due", Expr::product(vec![of(due), of(trigger)])));
            }
            present.looks += 1;
            let falls = Expr::product(vec![of(trigger), of(present.before)]);
            present.open = other == event || waits || !may_come(other);
            if present.open {
                present.before = self.flag(other, "before", falls);
                continue;
            }
            let newly = self.flag(other, "newly", Expr::product(vec![of(trigger), not(present.before)]));
            present.before = trigger;
            self.set_off(other, newly, present);
            set_off.push(other);
        }
        set_off
    }

    /// Lets an event be due where a variable is 1, once more if it is already.
    fn set_off(&mut self, event: usize, newly: Variable, present: &mut Present) {
        let values = self.values(event);
        let enters = |writer: &mut Self, enters: Expr, kept: &mut [Variable]| {
            for (value, kept) in values.iter().zip(kept) {
                let change = Expr::product(vec![enters.clone(), Expr::sum(vec![of(*value), minus(of(*kept))])]);
                *kept = writer.quantity(event, "value", Expr::sum(vec![of(*kept), change]));
            }
        };
        let Some(due) = present.due else {
            enters(self, of(newly), &mut present.frozen);
            (present.due, present.looks) = (Some(newly), 0);
            return;
        };
        let both = Expr::product(vec![of(due), of(newly)]);
        // Between two times at which it becomes true a condition is found false; what is cancelled is due no more then.
        let times = present.looks / 2;
        if times == 0 || self.events[event].manner.cancelled {
            enters(self, of(newly), &mut present.frozen);
            present.due = Some(self.flag(event, "due", Expr::sum(vec![of(due), of(newly), minus(both)])));
            return;
        }
        self.repeated.insert(event);
        let mut more = self.flag(event, "more", both);
        let first = Expr::sum(vec![of(newly), minus(of(more))]);
        enters(self, first.clone(), &mut present.frozen);
        present.due = Some(self.flag(event, "due", Expr::sum(vec![of(due), first])));
        for (due, frozen) in &mut present.again {
            let next = self.flag(event, "more", Expr::product(vec![of(more), of(*due)]));
            let here = Expr::sum(vec![of(more), minus(of(next))]);
            enters(self, here.clone(), frozen);
            *due = self.flag(event, "due", Expr::sum(vec![of(*due), here]));
            more = next;
        }
        if present.again.len() < times.min(present.places) {
            present.again.push((more, values));
        } else if present.again.len() < times {
            self.lose(event, more);
        }
    }
}
