//! Events, written out as what is added to states at the end of a step.
//!
//! An event has states of its own: whether its condition held before, and for a delay the steps that are left. All events of
//! one instant are written out one after the other in the order of their priorities, which `order` finds. What an event changes,
//! later ones read; conditions that read it are looked at again, and events that it sets off come in the same instant.

mod again;
mod order;
mod refined;

use std::collections::{BTreeMap, BTreeSet, HashSet};

pub(crate) use order::suits;

use crate::equations::events::{FlatEvent, margin};
use pe_ir::index::{StateId, at, number};
use pe_ir::model::{Algebraic, Expr, Model, Select, State, Variable};
use pe_ir::place::Place;
use refined::slope;

/// Delayed events of one kind that wait at the same time, at most.
const WAITING: usize = 4;

/// Adds events, whose variables are those of the model.
pub(crate) fn write_out(model: &mut Model, events: &[FlatEvent]) {
    if events.is_empty() {
        return;
    }
    let mut writer = Writer::new(model, events);
    writer.instant();
    writer.model.bound_waits();
    let jumps = std::mem::take(&mut writer.jumps);
    let late: Vec<Variable> = writer.late.values().copied().collect();
    for (state, terms) in jumps {
        model.states[StateId::new(state)].jump = Some(Expr::sum(terms));
    }
    begin(model, events, &late);
}

/// Far beyond the word of a state that must stay zero.
const LEAVES: f64 = 16.0;

/// What becomes of the events in one instant.
struct Writer<'a> {
    model: &'a mut Model,
    events: &'a [FlatEvent],
    /// Names that are taken, and the number of the next quantity.
    names: HashSet<String>,
    quantity: u32,
    /// States that each derivative reads, and states whose derivative reads each; empty if no event is refined.
    read_by: Vec<Vec<u32>>,
    readers: Vec<Vec<u32>>,
    /// What stands for states that events have changed so far.
    changed: BTreeMap<u32, Variable>,
    /// What is added to states so far.
    jumps: BTreeMap<u32, Vec<Expr>>,
    /// What stands for algebraic variables that read changed states.
    twins: BTreeMap<u32, Variable>,
    /// How late events are that are refined.
    late: BTreeMap<usize, Variable>,
    /// Events whose order is found while they come.
    searched: BTreeSet<usize>,
    /// Events that may be due more than once.
    repeated: BTreeSet<usize>,
    /// Which of two events goes before the other: what was compared last, and what tells.
    compared: BTreeMap<(usize, usize), (Expr, Variable)>,
    /// States that leave their words where an event finds no place.
    lost: BTreeMap<usize, u32>,
    /// States that are taken back to the time of an event while it comes, with the change.
    lent: Vec<(u32, Variable)>,
    serial: u32,
}

/// An event in the present instant.
struct Present {
    /// The state that tells whether the condition held before.
    held: u32,
    /// Whether the condition holds.
    trigger: Variable,
    /// Whether it did when it was looked at last.
    before: Variable,
    /// Whether it is due; none if it cannot be.
    due: Option<Variable>,
    /// New values, where they are those of the time of the condition.
    frozen: Vec<Variable>,
    /// Whether it is due once more behind that, twice more, and so on, each with its new values.
    again: Vec<(Variable, Vec<Variable>)>,
    /// How often its condition was looked at since it may have been due.
    looks: usize,
    /// How often it may be due once more.
    places: usize,
    /// Whether the condition may have become true without setting it off in this instant.
    open: bool,
}

fn of(variable: Variable) -> Expr {
    Expr::Variable(variable)
}

fn minus(expr: Expr) -> Expr {
    Expr::scaled(-1.0, expr)
}

fn not(variable: Variable) -> Expr {
    Expr::sum(vec![Expr::Constant(1.0), minus(of(variable))])
}

/// 1 if a number of steps is above a place, else 0.
fn above(variable: Variable, place: f64) -> Expr {
    let condition = Expr::sum(vec![of(variable), Expr::Constant(-place)]);
    Expr::Select(Box::new(Select { condition, yes: Expr::Constant(1.0), no: Expr::Constant(0.0) }))
}

impl<'a> Writer<'a> {
    fn new(model: &'a mut Model, events: &'a [FlatEvent]) -> Writer<'a> {
        let named = model.states.iter().map(|state| &state.name).chain(model.inputs.iter().map(|input| &input.name));
        let names = named.chain(model.algebraics.iter().map(|own| &own.name)).cloned().collect();
        let quantity = model.states.iter().map(|state| state.quantity + 1).max().unwrap_or(0);
        let mut writer = Writer {
            model,
            events,
            names,
            quantity,
            read_by: Vec::new(),
            readers: Vec::new(),
            changed: BTreeMap::new(),
            jumps: BTreeMap::new(),
            twins: BTreeMap::new(),
            late: BTreeMap::new(),
            searched: BTreeSet::new(),
            repeated: BTreeSet::new(),
            compared: BTreeMap::new(),
            lost: BTreeMap::new(),
            lent: Vec::new(),
            serial: 0,
        };
        if events.iter().any(|event| event.manner.refine) {
            let reads = |state: &State| writer.states_read(&slope(state));
            let read_by = writer.model.states.iter().map(reads).collect();
            writer.read_by = read_by;
            writer.readers = vec![Vec::new(); writer.read_by.len()];
            for (reader, reads) in (0..).zip(&writer.read_by) {
                reads.iter().for_each(|read| writer.readers[at(*read)].push(reader));
            }
        }
        writer
    }

    /// A name for something of an event.
    fn free_name(&mut self, event: usize, what: &str) -> String {
        let mut name = format!("{}.{what}", self.events[event].name);
        while !self.names.insert(name.clone()) {
            name.push('_');
        }
        name
    }

    fn state(&mut self, event: usize, what: &str, range: Option<(f64, f64)>) -> u32 {
        let quantity = self.quantity;
        self.quantity += 1;
        let name = self.free_name(event, what);
        let span = self.events[event].span;
        let state = State { quantity, span, range, ..State::new(name, Expr::Constant(0.0)) };
        self.model.states.push(state).number()
    }

    /// A quantity of an event.
    fn quantity(&mut self, event: usize, what: &str, expr: Expr) -> Variable {
        if let Expr::Variable(variable) = expr {
            return variable;
        }
        self.serial += 1;
        let name = self.free_name(event, &format!("{what}{}", self.serial));
        let span = self.events[event].span;
        // A choice is that of a condition.
        let range = matches!(expr, Expr::Select(_)).then_some((0.0, 1.0));
        self.model.algebraics.push(Algebraic { name, unit: None, expr, range, kept: false, angle: false, span });
        Variable::Algebraic(number(self.model.algebraics.len()) - 1)
    }

    /// A quantity that is 0 or 1. Where order is searched, and where an event may be due more than once, it is written out in many places
    /// and comes in few, so that runs tell little of what it may be.
    fn flag(&mut self, event: usize, what: &str, expr: Expr) -> Variable {
        if self.searched.contains(&event) || self.repeated.contains(&event) {
            self.within(event, what, expr, (0.0, 1.0))
        } else {
            self.quantity(event, what, expr)
        }
    }

    /// A quantity that may be anything within a range, whatever runs show.
    fn within(&mut self, event: usize, what: &str, expr: Expr, range: (f64, f64)) -> Variable {
        let own = self.quantity(event, what, expr);
        if let Variable::Algebraic(algebraic) = own {
            self.model.algebraics[at(algebraic)].range = Some(range);
        }
        own
    }

    /// What stands for a state behind a change, in the range that the state has.
    fn after(&mut self, event: usize, state: u32, expr: Expr) -> Variable {
        match self.model.states[StateId::new(state)].range {
            Some(range) => self.within(event, "after", expr, range),
            None => self.quantity(event, "after", expr),
        }
    }

    /// What stands for a variable behind all changes so far.
    fn present(&mut self, event: usize, variable: Variable) -> Variable {
        match variable {
            Variable::State(state) => self.changed.get(&state.number()).copied().unwrap_or(variable),
            Variable::Input(_) => variable,
            Variable::Algebraic(algebraic) => {
                if let Some(twin) = self.twins.get(&algebraic) {
                    return *twin;
                }
                if self.changed.is_empty() {
                    return variable;
                }
                let expr = self.model.algebraics[at(algebraic)].expr.clone();
                let moved = self.expr(event, &expr);
                let twin = if moved == expr { variable } else { self.quantity(event, "at", moved) };
                self.twins.insert(algebraic, twin);
                twin
            }
        }
    }

    fn expr(&mut self, event: usize, expr: &Expr) -> Expr {
        let mut stand = BTreeMap::new();
        let mut read = Vec::new();
        expr.each_variable(&mut |variable| read.push(variable));
        read.sort_unstable();
        read.dedup();
        for variable in read {
            let present = self.present(event, variable);
            stand.insert(variable, present);
        }
        expr.renamed(&|variable| stand[&variable])
    }

    /// States that a variable depends on at one time.
    fn states_read(&self, expr: &Expr) -> Vec<u32> {
        let mut states = Vec::new();
        let mut seen = BTreeSet::new();
        let mut waiting = Vec::new();
        expr.each_variable(&mut |variable| waiting.push(variable));
        while let Some(variable) = waiting.pop() {
            match variable {
                Variable::State(state) => states.push(state.number()),
                Variable::Input(_) => {}
                Variable::Algebraic(number) => {
                    if seen.insert(number) {
                        self.model.algebraics[at(number)].expr.each_variable(&mut |read| waiting.push(read));
                    }
                }
            }
        }
        states.sort_unstable();
        states.dedup();
        states
    }

    fn instant(&mut self) {
        let pools = order::pools(self);
        self.searched = pools.iter().flatten().copied().collect();
        let mut watchers: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (event, own) in self.events.iter().enumerate() {
            let reads = self.states_read(&own.trigger);
            reads.into_iter().for_each(|read| watchers.entry(read).or_default().push(event));
        }
        let held: Vec<u32> = (0..self.events.len()).map(|event| self.state(event, "held", Some((0.0, 1.0)))).collect();
        let mut all: Vec<Present> = Vec::new();
        for (event, held) in held.into_iter().enumerate() {
            let trigger = self.quantity(event, "condition", self.events[event].trigger.clone());
            let before = Variable::State(StateId::new(held));
            let newly = Expr::product(vec![of(trigger), not(before)]);
            let due = self.flag(event, "due", newly);
            if self.events[event].manner.refine && margin(&self.events[event].trigger).is_some() {
                let late = self.late(event, due);
                self.late.insert(event, late);
            }
            let frozen = self.values(event);
            let places = self.places(event, &watchers);
            let (again, looks, open) = (Vec::new(), 0, false);
            all.push(Present { held, trigger, before: trigger, due: Some(due), frozen, again, looks, places, open });
        }
        for (event, present) in all.iter_mut().enumerate() {
            if self.events[event].delay.is_some() {
                self.wait(event, present);
            }
        }
        let rest: Vec<usize> = (0..self.events.len()).filter(|event| !self.searched.contains(event)).collect();
        self.by_rank(&rest, &watchers, &mut all);
        for pool in &pools {
            self.by_search(pool, &watchers, &mut all);
        }
        for present in all {
            let own = Variable::State(StateId::new(present.held));
            self.jumps.entry(present.held).or_default().extend([of(present.before), minus(of(own))]);
        }
    }

    /// The new values of an event as things stand, for those who keep them.
    fn values(&mut self, event: usize) -> Vec<Variable> {
        let all = self.events;
        if !all[event].manner.frozen {
            return Vec::new();
        }
        let late = self.late.get(&event).copied();
        let kept = late.map(|_| (self.changed.clone(), self.jumps.clone(), self.twins.clone()));
        if let Some(late) = late {
            self.go_back(event, late);
        }
        let mut values = Vec::new();
        for (_, value) in &all[event].assignments {
            let value = self.expr(event, value);
            values.push(self.quantity(event, "value", value));
        }
        if let Some(kept) = kept {
            (self.changed, self.jumps, self.twins) = kept;
            self.lent.clear();
        }
        values
    }

    /// Lets an event come where a variable is 1; that is always one where it is due, unless it `waits` for others.
    fn come(&mut self, event: usize, due: Variable, waits: bool, frozen: &[Variable]) {
        let all = self.events;
        let mut late = self.late.get(&event).copied();
        if let Some(own) = late.filter(|_| waits) {
            let own = Expr::product(vec![of(due), of(own)]);
            late = Some(self.within(event, "late", own, (0.0, self.model.step)));
        }
        let bent = late.map(|late| self.go_back(event, late));
        let mut added = Vec::new();
        for (number, (state, value)) in all[event].assignments.iter().enumerate() {
            let value = match frozen.get(number) {
                Some(value) => of(*value),
                None => self.expr(event, value),
            };
            let own = self.present(event, Variable::State(StateId::new(*state)));
            let change = Expr::product(vec![of(due), Expr::sum(vec![value, minus(of(own))])]);
            added.push((*state, own, change));
        }
        for (state, own, change) in added {
            let change = self.quantity(event, "change", change);
            let after = self.after(event, state, Expr::sum(vec![of(own), of(change)]));
            self.changed.insert(state, after);
            self.jumps.entry(state).or_default().push(of(change));
        }
        self.twins.clear();
        if let (Some(late), Some(bent)) = (late, bent) {
            self.go_forward(event, late, &bent);
        }
    }

    /// What finds no place leaves the word of a state that must stay zero, so that it is never lost unseen.
    fn lose(&mut self, event: usize, what: Variable) {
        let lost = match self.lost.get(&event) {
            Some(lost) => *lost,
            None => self.state(event, "lost", Some((0.0, 0.0))),
        };
        self.lost.insert(event, lost);
        self.jumps.entry(lost).or_default().push(Expr::scaled(LEAVES, of(what)));
    }

    /// Lets an event wait for its delay, in the first free of several places.
    fn wait(&mut self, event: usize, present: &mut Present) {
        let manner = self.events[event].manner;
        let delay = self.events[event].delay.clone().expect("it waits");
        let after = self.events[event].after.unwrap_or(self.events[event].span);
        let computed = delay.as_constant().is_none();
        let mut delay = self.expr(event, &delay);
        if computed {
            let seconds = self.quantity(event, "delay", delay);
            let positive = self.quantity(event, "positive", above(seconds, 0.0));
            delay = Expr::product(vec![of(seconds), of(positive)]);
        }
        let (least, more) = if computed { (0.5 * State::LEAST_WAIT, 1.5 + State::LEAST_WAIT) } else { (0.5, 1.5) };
        let mut newly = present.due.take().expect("nothing has come so far");
        let mut due: Vec<Variable> = Vec::new();
        let mut frozen: Vec<Vec<Expr>> = vec![Vec::new(); present.frozen.len()];
        for place in 1..=WAITING {
            let left = self.state(event, &format!("left{place}_"), None);
            let own = Variable::State(StateId::new(left));
            let waits = self.quantity(event, "waits", above(own, least));
            let more = self.quantity(event, "more", above(own, more));
            let over = Expr::sum(vec![of(waits), minus(of(more))]);
            let mut over = self.quantity(event, "over", over);
            // A delay that is computed leaves a part of a step behind.
            let mut ends =
                if computed { Expr::sum(vec![of(more), Expr::product(vec![of(over), of(own)])]) } else { of(waits) };
            let rest = ends.clone();
            if manner.cancelled {
                // Off it is as soon as the condition does not hold.
                over = self.quantity(event, "over", Expr::product(vec![of(over), of(present.trigger)]));
                let off = Expr::product(vec![not(present.trigger), Expr::sum(vec![of(own), minus(rest)])]);
                ends = Expr::sum(vec![ends, off]);
            }
            due.push(over);
            // A place that is left in this step is free for what begins to wait in it.
            let takes = self.quantity(event, "takes", Expr::product(vec![of(newly), not(more)]));
            let jumps = self.jumps.entry(left).or_default();
            jumps.push(minus(ends));
            if computed {
                jumps.push(Expr::scaled(State::LEAST_WAIT, of(takes)));
            }
            let counter = &mut self.model.states[StateId::new(left)];
            (counter.wait, counter.span) = (Some(Expr::product(vec![of(takes), delay.clone()])), after);
            for (number, value) in present.frozen.clone().into_iter().enumerate() {
                let kept = self.state(event, &format!("value{place}_{}_", number + 1), None);
                let own = Variable::State(StateId::new(kept));
                frozen[number].push(Expr::product(vec![of(over), of(own)]));
                let change = Expr::product(vec![of(takes), Expr::sum(vec![of(value), minus(of(own))])]);
                self.jumps.entry(kept).or_default().push(change);
            }
            newly = self.flag(event, "newly", Expr::product(vec![of(newly), of(more)]));
        }
        self.lose(event, newly);
        // Delays that are computed may end together, which is once.
        for place in (1..WAITING).filter(|_| computed) {
            let sooner = Expr::sum(due[..place].iter().copied().map(of).collect());
            let both = self.flag(event, "both", Expr::product(vec![of(due[place]), sooner]));
            self.lose(event, both);
        }
        present.due = Some(self.flag(event, "due", Expr::sum(due.into_iter().map(of).collect())));
        let frozen: Vec<Variable> =
            frozen.into_iter().map(|terms| self.quantity(event, "value", Expr::sum(terms))).collect();
        present.frozen = frozen;
    }
}

/// Puts the states at what they are behind the events of time zero.
fn begin(model: &mut Model, events: &[FlatEvent], late: &[Variable]) {
    let inputs = model.sample_inputs(0.0);
    let mut states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let triggers: Vec<f64> = {
        let place = Place::new(model, &states, &inputs);
        events.iter().map(|event| event.trigger.evaluate(&|variable| place.number(variable))).collect()
    };
    // At time zero nothing is late.
    let mut early = model.clone();
    for late in late {
        if let Variable::Algebraic(algebraic) = late {
            early.algebraics[at(*algebraic)].expr = Expr::Constant(0.0);
        }
    }
    let first = model.states.iter().position(|state| state.name == format!("{}.held", events[0].name));
    for (number, _) in events.iter().enumerate().filter(|(_, event)| !event.manner.initially) {
        if let Some(first) = first {
            states[first + number] = triggers[number];
        }
    }
    let jumps = Place::new(&early, &states, &inputs).jumps();
    for ((state, number), jump) in model.states.iter_mut().zip(&states).zip(jumps) {
        state.initial = number + jump;
    }
}
