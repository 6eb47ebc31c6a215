//! The order in which the events of one instant come.
//!
//! The next one is always that of the highest priority among those that are due. Where priorities are numbers the order is
//! known here. Where one changes, it is found while events come: in each of several passes over a pool of events, an event comes
//! where no other one that is due goes before it.

use std::collections::{BTreeMap, BTreeSet};

use super::{Present, Writer, minus, not, of};
use crate::equations::events::FlatEvent;
use crate::report::Report;
use pe_ir::codes;
use pe_ir::index::at;
use pe_ir::model::{Expr, Model, Select, Variable};
use pe_ir::source::Diagnostic;

/// How often an event comes in one instant, at most, where events set one another off in a circle.
const MOST_ROUNDS: usize = 3;

/// Events of a pool, at most: each comes in as many passes as there are others, and is compared with all of them in each.
const MOST_IN_POOL: usize = 8;

/// Passes more than events, where these set one another off.
const MORE_PASSES: usize = 2;

/// Whether the order of events takes no more passes to find than there may be.
pub(crate) fn suits(model: &Model, events: &[FlatEvent], report: &mut Report) -> Option<()> {
    if !events.iter().any(changes) {
        return Some(());
    }
    let pools = pools(&Writer::new(&mut model.clone(), events));
    let Some(large) = pools.iter().find(|pool| pool.len() > MOST_IN_POOL) else { return Some(()) };
    let changing = large.iter().map(|event| &events[*event]).find(|event| changes(event))?;
    let message = format!(
        "the priority changes, and orders {} events that depend on one another: at most {MOST_IN_POOL} are possible",
        large.len()
    );
    let help = "give events constant priorities, or let fewer of them read what others change";
    report.push(Diagnostic::error(codes::EVENT_ORDER, changing.span, message).with_help(help));
    None
}

/// Whether the priority of an event is no number.
fn changes(event: &FlatEvent) -> bool {
    event.priority.as_ref().is_some_and(|priority| priority.as_constant().is_none())
}

/// Groups of events whose order is found while they come: a priority of each changes, and no event outside of a group reads what one
/// inside changes, or changes what it reads.
pub(super) fn pools(writer: &Writer) -> Vec<Vec<usize>> {
    if !writer.events.iter().any(changes) {
        return Vec::new();
    }
    let mut groups: Vec<usize> = (0..writer.events.len()).collect();
    let mut touching: BTreeMap<u32, (bool, Vec<usize>)> = BTreeMap::new();
    for (event, own) in writer.events.iter().enumerate() {
        let (reads, writes) = writer.touched(own);
        for (states, changes) in [(reads, false), (writes, true)] {
            for state in states {
                let entry = touching.entry(state).or_default();
                entry.0 |= changes;
                entry.1.push(event);
            }
        }
    }
    for (is_changed, events) in touching.into_values() {
        for pair in events.windows(2).filter(|_| is_changed) {
            let (one, other) = (root(&groups, pair[0]), root(&groups, pair[1]));
            groups[one.max(other)] = one.min(other);
        }
    }
    let mut members: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    (0..groups.len()).for_each(|event| members.entry(root(&groups, event)).or_default().push(event));
    let is_pool = |group: &Vec<usize>| group.len() > 1 && group.iter().any(|event| changes(&writer.events[*event]));
    members.into_values().filter(is_pool).collect()
}

fn root(groups: &[usize], event: usize) -> usize {
    let mut own = event;
    while groups[own] != own {
        own = groups[own];
    }
    own
}

impl Writer<'_> {
    /// The states that an event reads, and those that it changes.
    fn touched(&self, event: &FlatEvent) -> (Vec<u32>, Vec<u32>) {
        let mut reads: Vec<u32> = event.expressions().flat_map(|expr| self.states_read(expr)).collect();
        let mut writes: Vec<u32> = event.assignments.iter().map(|(state, _)| *state).collect();
        if event.manner.refine {
            let readers = writes.iter().flat_map(|state| &self.readers[at(*state)]);
            let readers: Vec<u32> = readers.copied().collect();
            writes.extend(readers);
            reads.extend(writes.iter().flat_map(|state| &self.read_by[at(*state)]));
        }
        (reads, writes)
    }

    /// Lets events come whose priorities are numbers: the next one is that of the highest priority, then of the earliest round, then of the
    /// spec's order. A round ends where an event is set off that stands before the one that did.
    pub(super) fn by_rank(&mut self, events: &[usize], watchers: &BTreeMap<u32, Vec<usize>>, all: &mut [Present]) {
        // One that changes and is in no pool orders nothing.
        let priority = |event: &usize| {
            let priority = self.events[*event].priority.as_ref();
            priority.and_then(Expr::as_constant).unwrap_or(f64::NEG_INFINITY)
        };
        let mut order: Vec<(f64, usize)> = events.iter().map(|event| (priority(event), *event)).collect();
        order.sort_by(|one, other| other.0.total_cmp(&one.0));
        // For each event the place of its priority among all, and its own.
        let mut places = vec![(0, 0); self.events.len()];
        let mut rank = 0;
        for (place, (priority, event)) in order.iter().enumerate() {
            if place > 0 && order[place - 1].0.total_cmp(priority).is_ne() {
                rank += 1;
            }
            places[*event] = (rank, place);
        }
        let key = |event: usize, round: usize| (places[event].0, round, places[event].1, event);
        let mut waiting: BTreeSet<(usize, usize, usize, usize)> = BTreeSet::new();
        let mut rounds = vec![1; self.events.len()];
        let mut left = vec![MOST_ROUNDS; self.events.len()];
        waiting.extend(events.iter().filter(|event| all[**event].due.is_some()).map(|event| key(*event, 1)));
        while let Some((_, round, place, event)) = waiting.pop_first() {
            let due = all[event].due.take().expect("it waits");
            left[event] -= 1;
            self.come(event, due, false, &all[event].frozen);
            if !all[event].again.is_empty() {
                let (due, frozen) = all[event].again.remove(0);
                (all[event].due, all[event].frozen) = (Some(due), frozen);
                left[event] += 1;
                waiting.insert(key(event, round));
            }
            for other in self.look_again(event, watchers, all, &|other| round < MOST_ROUNDS && left[other] > 0) {
                if waiting.contains(&key(other, rounds[other])) {
                    continue;
                }
                rounds[other] = if places[other].1 > place { round } else { round + 1 };
                waiting.insert(key(other, rounds[other]));
            }
        }
    }

    /// Lets the events of a pool come. Each pass brings at least one of those that are due, so the last of as many passes as there are
    /// events brings what is left; where events set one another off something may still be left, and is looked at in the next step.
    pub(super) fn by_search(&mut self, pool: &[usize], watchers: &BTreeMap<u32, Vec<usize>>, all: &mut [Present]) {
        let waits = |event: usize| self.events[event].delay.is_some();
        let sets_off = |event: &usize| {
            let watching = self.watching(*event, watchers);
            watching.into_iter().any(|other| other != *event && !waits(other))
        };
        let open = pool.iter().any(sets_off);
        let passes = if open { pool.len() + MORE_PASSES } else { pool.len() };
        for pass in 1..=passes {
            let last = pass == passes;
            for event in pool {
                let Some(due) = all[*event].due else { continue };
                let comes = if last && !open { due } else { self.first(*event, due, pool, all) };
                // What stands before others alone is what it is without them.
                let left = (comes != due).then(|| Expr::sum(vec![of(due), minus(of(comes))]));
                all[*event].due = left.map(|left| self.flag(*event, "due", left));
                self.come(*event, comes, comes != due, &all[*event].frozen);
                self.look_again(*event, watchers, all, &|_| !last);
            }
        }
        for event in pool {
            let Some(left) = all[*event].due.take() else { continue };
            if self.events[*event].delay.is_some() {
                self.lose(*event, left);
                continue;
            }
            // It comes in the next step if its condition holds then, and must not be lost if not.
            let Present { trigger, before, .. } = all[*event];
            all[*event].before = self.flag(*event, "before", Expr::product(vec![of(before), not(left)]));
            let lost = self.flag(*event, "lost", Expr::product(vec![of(left), not(trigger)]));
            self.lose(*event, lost);
        }
    }

    /// Where an event comes that is due: 1 where no other one goes before it.
    fn first(&mut self, event: usize, due: Variable, pool: &[usize], all: &[Present]) -> Variable {
        let mut comes = due;
        for other in pool.iter().filter(|other| **other != event) {
            let Some(waits) = all[*other].due else { continue };
            let Some(before) = self.goes_before(*other, event) else { continue };
            let stops = self.flag(event, "behind", Expr::product(vec![of(waits), before]));
            let free = Expr::product(vec![of(comes), not(stops)]);
            comes = self.flag(event, "first", free);
        }
        comes
    }

    /// 1 where an event goes before another one if both are due; none if it never does.
    fn goes_before(&mut self, event: usize, other: usize) -> Option<Expr> {
        // Of equal priorities the first one of the spec goes before the other.
        let (early, later) = (event.min(other), event.max(other));
        let swapped = match (&self.events[early].priority, &self.events[later].priority) {
            (None, Some(_)) => Expr::Constant(1.0),
            (_, None) => Expr::Constant(0.0),
            (Some(early_one), Some(later_one)) => {
                let (early_one, later_one) = (early_one.clone(), later_one.clone());
                let margin = [self.expr(later, &later_one), minus(self.expr(early, &early_one))];
                let condition = Expr::sum(margin.to_vec());
                match condition.as_constant() {
                    Some(margin) => Expr::Constant(if margin > 0.0 { 1.0 } else { 0.0 }),
                    None => of(self.compared((event, other), condition)),
                }
            }
        };
        let goes = if event == later { swapped } else { Expr::sum(vec![Expr::Constant(1.0), minus(swapped)]) };
        (goes != Expr::Constant(0.0)).then_some(goes)
    }

    /// 1 where an expression is above zero; one quantity for all that ask for the same.
    fn compared(&mut self, (event, other): (usize, usize), condition: Expr) -> Variable {
        let pair = (event.min(other), event.max(other));
        if let Some((known, variable)) = self.compared.get(&pair)
            && *known == condition
        {
            return *variable;
        }
        let select = Select { condition: condition.clone(), yes: Expr::Constant(1.0), no: Expr::Constant(0.0) };
        let variable = self.quantity(pair.1, "higher", Expr::Select(Box::new(select)));
        self.compared.insert(pair, (condition, variable));
        variable
    }
}
