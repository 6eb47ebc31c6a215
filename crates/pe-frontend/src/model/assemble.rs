//! The pass that leaves out what no output depends on and puts the model together with dense numbers.

use crate::declare::initial::{Driven, Initial};
use crate::declare::settings::Header;
use crate::declare::times::Times;
use crate::equations::events::{FlatEvent, changing};
use crate::equations::write::{Flat, Row};
use crate::evaluate::signals::{CLOCK, SIGNALS, Signals, TIME};
use crate::language::words;
use crate::model::{angles, consistent, delays, events};
use crate::names::table::{Kind, Names, Quantity};
use crate::report::Report;
use pe_ir::codes;
use pe_ir::index::{StateId, at, number as number_of};
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Algebraic, Expr, Input, Interpolation, Model, Output, Rate, State, Variable};
use pe_ir::motion::Motion;
use pe_ir::source::Diagnostic;

use std::sync::Arc;

/// Marks a variable that is left out.
const LEFT_OUT: u32 = u32::MAX;

/// The pieces of a model, numbered as they were written out.
pub(crate) struct Parts {
    pub(crate) header: Header,
    pub(crate) times: Times,
    pub(crate) flat: Flat,
    pub(crate) events: Vec<FlatEvent>,
    /// For each algebraic element the state that holds it between samples, if there is one.
    pub(crate) holders: Vec<Option<u32>>,
    /// Rates of the blocks.
    pub(crate) rates: Vec<Rate>,
    /// Algebraic equations in dependency order.
    pub(crate) order: Vec<u32>,
    pub(crate) initials: Vec<Initial>,
    pub(crate) inputs: Vec<Driven>,
    pub(crate) outputs: Vec<Output>,
    /// What the accelerations are made of, if motion is constrained.
    pub(crate) mechanism: Option<Mechanism>,
    /// Whether the outputs come from the command line: then leaving out is what was asked for.
    pub(crate) observed: bool,
}

/// New numbers of the variables, [`LEFT_OUT`] for those that are gone.
struct Numbers {
    states: Vec<u32>,
    inputs: Vec<u32>,
    algebraics: Vec<u32>,
    /// States that stand for signals, then the time.
    signals: Vec<u32>,
}

impl Numbers {
    fn of(&mut self, variable: Variable) -> &mut u32 {
        match variable {
            TIME => self.signals.last_mut().expect("time has a place"),
            Variable::State(i) if i.number() >= SIGNALS => &mut self.signals[at(i.number() - SIGNALS)],
            Variable::State(i) => &mut self.states[i.index()],
            Variable::Input(i) => &mut self.inputs[at(i)],
            Variable::Algebraic(i) => &mut self.algebraics[at(i)],
        }
    }

    fn renumber(&mut self, expr: &mut Expr) {
        expr.each_variable_mut(&mut |variable| *variable = self.renumbered(*variable));
    }

    fn renumbered(&mut self, variable: Variable) -> Variable {
        let number = *self.of(variable);
        match variable {
            Variable::State(_) => Variable::State(StateId::new(number)),
            Variable::Input(_) => Variable::Input(number),
            Variable::Algebraic(_) => Variable::Algebraic(number),
        }
    }
}

/// The model of what the outputs depend on.
pub(crate) fn assemble(mut parts: Parts, names: &Names, mut signals: Signals, report: &mut Report) -> Option<Model> {
    draw_lines(&mut parts, &mut signals);
    let mut numbers = needed(&parts, &signals);
    let left_out = left_out(names, &parts, &numbers, report);
    let blocks: Vec<Option<usize>> = {
        let block = |row: &Option<Row>| row.as_ref().and_then(|row| names.quantities[row.quantity].block);
        parts.flat.states.iter().map(block).collect()
    };
    let times = number_of(signals.time_equations(0, "").len());
    number_all(&mut numbers, &blocks, &parts.order, (signals.states(), times));
    let (rates, rate_of) = rates_in_use(&parts.rates, &numbers.states, &blocks);
    let inputs = inputs_in_use(names, &parts.inputs, &numbers);
    let input_names: Vec<String> = inputs.iter().map(|input| input.name.clone()).collect();
    let (played, places) = signals.played(|place| numbers.signals[place] != LEFT_OUT);

    let mut states =
        declared_states(names, &mut parts, &mut numbers, |state| blocks[state].map(|block| rate_of[block]));
    let quantities = number_of(names.quantities.len());
    let first_delay = signals.first_delay();
    for place in (0..signals.states()).filter(|place| numbers.signals[*place] != LEFT_OUT).collect::<Vec<_>>() {
        let mut state = signals.state(
            place,
            numbers.signals[place],
            quantities + number_of(place),
            (&numbers.inputs, &input_names),
            (&places, &numbers.signals),
        );
        if matches!(state.motion, Some(Motion::Delayed(_))) {
            numbers.renumber(&mut state.derivative);
        }
        states.push(state);
    }
    states.sort_by_key(|state| state.rate.is_some());

    let algebraics = algebraics(names, &mut parts, &mut numbers, &signals);
    let Parts { header, times, outputs, mut mechanism, events: mut all, .. } = parts;
    if let Some(mechanism) = &mut mechanism {
        mechanism.each_variable_mut(&mut |variable| *variable = numbers.renumbered(*variable));
        let renumbered = |state: StateId| StateId::new(numbers.states[state.index()]);
        mechanism.pairs.iter_mut().for_each(|pair| *pair = (renumbered(pair.0), renumbered(pair.1)));
    }
    all.retain(|event| event.assignments.iter().any(|(state, _)| numbers.states[at(*state)] != LEFT_OUT));
    for event in &mut all {
        event.assignments.retain(|(state, _)| numbers.states[at(*state)] != LEFT_OUT);
        event.expressions_mut().for_each(|expr| numbers.renumber(expr));
        event.assignments.iter_mut().for_each(|(state, _)| *state = numbers.states[at(*state)]);
    }
    let outputs =
        outputs.into_iter().map(|output| Output { variable: numbers.renumbered(output.variable), ..output }).collect();
    let Header { name, title, solver } = header;
    let Times { step, phases, span } = times;
    let mut model = Model {
        name,
        title,
        solver,
        step,
        phases,
        span,
        states: states.into(),
        rates,
        algebraics,
        inputs,
        signals: played,
        mechanism: mechanism.map(Arc::new),
        outputs,
        left_out,
    };
    model.share_systems();
    model.add_step_ratio();
    model.set_step(step);
    consistent::settle(&mut model, names, report)?;
    let solved = |algebraic: &Algebraic| matches!(algebraic.expr, Expr::Solution(_));
    if let Some(event) = all.first().filter(|_| model.algebraics.iter().any(solved)) {
        let message = "a model with linear systems has no events";
        let help = "write the solution as equations";
        report.push(Diagnostic::error(codes::EVENT_MODEL, event.span, message).with_help(help));
        return None;
    }
    if let Some(place) = first_delay {
        delays::suits(&model, place, report)?;
    }
    delays::name(&mut model);
    events::suits(&model, &all, report)?;
    events::write_out(&mut model, &all);
    delays::begin(&mut model);
    angles::write_out(model, report)
}

/// Numbers what is kept in the order of the lists: states and inputs as declared, but states that stand for signals
/// and then sampled ones last; the time, then algebraic equations as computed.
fn number_all(numbers: &mut Numbers, blocks: &[Option<usize>], order: &[u32], (signals, times): (usize, u32)) {
    let (continuous, discrete): (Vec<_>, Vec<_>) =
        numbers.states.iter_mut().zip(blocks).partition(|(_, block)| block.is_none());
    let (signals, time) = numbers.signals.split_at_mut(signals);
    let discrete = discrete.into_iter().map(|(entry, _)| entry);
    number(continuous.into_iter().map(|(entry, _)| entry).chain(signals).chain(discrete));
    number(numbers.inputs.iter_mut());
    let kept = |entry: &u32| *entry != LEFT_OUT;
    let mut next = 0;
    for entry in time.iter_mut().filter(|entry| kept(entry)) {
        next += times;
        *entry = next - 1;
    }
    for equation in order {
        let entry = &mut numbers.algebraics[at(*equation)];
        if kept(entry) {
            *entry = next;
            next += 1;
        }
    }
}

/// The declared states and those that hold algebraic quantities, which come behind them.
fn declared_states(
    names: &Names,
    parts: &mut Parts,
    numbers: &mut Numbers,
    rate: impl Fn(usize) -> Option<u32>,
) -> Vec<State> {
    let mut states = Vec::new();
    let quantity_numbers = state_numbers(names);
    let initials = std::mem::take(&mut parts.initials);
    let initials = initials.into_iter().map(Some).chain(std::iter::repeat_with(|| None));
    for (state, (row, initial)) in std::mem::take(&mut parts.flat.states).into_iter().zip(initials).enumerate() {
        let Some(mut row) = row.filter(|_| numbers.states[state] != LEFT_OUT) else { continue };
        numbers.renumber(&mut row.expr);
        let quantity = &names.quantities[row.quantity];
        let Initial { value, range } = initial.unwrap_or(Initial { value: 0.0, range: row.range });
        states.push(State {
            name: quantity.name_at(row.offset),
            quantity: quantity_numbers[row.quantity],
            initial: value,
            range,
            tunable: quantity.tunable,
            angle: quantity.angle,
            unit: unit(quantity),
            derivative: row.expr,
            jump: None,
            wait: None,
            rate: rate(state),
            motion: None,
            span: row.span,
        });
    }
    states
}

/// The time, if it is read, and the algebraic equations in the order in which they are computed.
fn algebraics(names: &Names, parts: &mut Parts, numbers: &mut Numbers, signals: &Signals) -> Vec<Algebraic> {
    let mut algebraics = Vec::new();
    if numbers.signals[signals.states()] != LEFT_OUT {
        let own = names.find(words::TIME).is_some();
        algebraics.extend(signals.time_equations(numbers.signals[0], if own { "time_" } else { "time" }));
    }
    for equation in &parts.order {
        let kept = numbers.algebraics[at(*equation)] != LEFT_OUT;
        let Some(mut row) = parts.flat.algebraics[at(*equation)].take().filter(|_| kept) else { continue };
        numbers.renumber(&mut row.expr);
        let quantity = &names.quantities[row.quantity];
        let name = quantity.name_at(row.offset);
        let held = parts.holders[at(*equation)].is_some_and(|state| numbers.states[at(state)] != LEFT_OUT);
        algebraics.push(Algebraic {
            name: if held { format!("{name}.sample") } else { name },
            unit: unit(quantity),
            expr: row.expr,
            range: row.range,
            kept: false,
            angle: false,
            span: row.span,
        });
    }
    algebraics
}

/// Lets everyone read an interpolated input as the state that it is.
fn draw_lines(parts: &mut Parts, signals: &mut Signals) {
    let linear = (0..).zip(&parts.inputs).filter(|(_, driven)| driven.between == Interpolation::Linear);
    let lines: Vec<(u32, Variable)> = linear.map(|(input, driven)| (input, signals.line(input, driven.span))).collect();
    let line = |variable: &mut Variable| {
        if let Some((_, line)) = lines.iter().find(|(input, _)| Variable::Input(*input) == *variable) {
            *variable = *line;
        }
    };
    let rows = parts.flat.states.iter_mut().chain(&mut parts.flat.algebraics).flatten();
    rows.for_each(|row| row.expr.each_variable_mut(&mut |variable| line(variable)));
    signals.delays.iter_mut().for_each(|(of, _)| line(of));
    for event in &mut parts.events {
        event.expressions_mut().for_each(|expr| expr.each_variable_mut(&mut |variable| line(variable)));
    }
    parts.outputs.iter_mut().for_each(|output| line(&mut output.variable));
}

/// The inputs that are not left out.
fn inputs_in_use(names: &Names, driven: &[Driven], numbers: &Numbers) -> Vec<Input> {
    let mut inputs = Vec::new();
    for quantity in names.quantities.iter().filter(|quantity| quantity.kind == Kind::Input) {
        for offset in 0..quantity.length {
            let flat = at(quantity.base) + offset;
            let Some(driven) = driven.get(flat).filter(|_| numbers.inputs[flat] != LEFT_OUT) else { continue };
            inputs.push(Input {
                name: quantity.name_at(offset),
                unit: unit(quantity),
                waveform: driven.waveform.clone(),
                range: driven.range,
                between: driven.between,
                span: driven.span,
            });
        }
    }
    inputs
}

/// Marks whatever an output depends on with zero, everything else as left out.
fn needed(parts: &Parts, signals: &Signals) -> Numbers {
    let mut numbers = Numbers {
        states: vec![LEFT_OUT; parts.flat.states.len()],
        inputs: vec![LEFT_OUT; parts.inputs.len()],
        algebraics: vec![LEFT_OUT; parts.flat.algebraics.len()],
        signals: vec![LEFT_OUT; signals.states() + 1],
    };
    let mut waiting: Vec<Variable> = Vec::new();
    let mut need = |variable: Variable, waiting: &mut Vec<Variable>| {
        let entry = numbers.of(variable);
        if *entry == LEFT_OUT {
            *entry = 0;
            waiting.push(variable);
        }
    };
    for output in &parts.outputs {
        need(output.variable, &mut waiting);
    }
    if let Some(mechanism) = &parts.mechanism {
        mechanism.each_variable(&mut |variable| need(variable, &mut waiting));
        for (coordinate, velocity) in &mechanism.pairs {
            need(Variable::State(*coordinate), &mut waiting);
            need(Variable::State(*velocity), &mut waiting);
        }
    }
    let changing = changing(&parts.events, parts.flat.states.len());
    while let Some(variable) = waiting.pop() {
        if let Variable::State(state) = variable
            && let Some(events) = changing.get(state.index())
        {
            // All that the event reads, for what it changes beside this may set off others.
            for event in events.iter().map(|event| &parts.events[*event]) {
                event.expressions().for_each(|expr| expr.each_variable(&mut |read| need(read, &mut waiting)));
                let targets = event.assignments.iter().map(|(target, _)| Variable::State(StateId::new(*target)));
                targets.for_each(|target| need(target, &mut waiting));
            }
        }
        let is_signal = match variable {
            Variable::State(i) => i.number() >= SIGNALS,
            Variable::Algebraic(i) => i >= SIGNALS,
            Variable::Input(_) => false,
        };
        if is_signal {
            let reads = signals.reads(variable);
            reads.into_iter().for_each(|read| need(read, &mut waiting));
            continue;
        }
        let row = match variable {
            Variable::State(i) => &parts.flat.states[i.index()],
            Variable::Algebraic(i) => &parts.flat.algebraics[at(i)],
            Variable::Input(_) => continue,
        };
        if let Some(row) = row {
            row.expr.each_variable(&mut |read| need(read, &mut waiting));
        }
    }
    // A network without any state has nothing to do in a step: it counts its steps.
    if numbers.states.iter().chain(&numbers.signals[..signals.states()]).all(|number| *number == LEFT_OUT) {
        *numbers.of(CLOCK) = 0;
    }
    numbers
}

/// Names of what is left out in source order, with a warning for each quantity that is gone as a whole
/// although the spec alone says so.
fn left_out(names: &Names, parts: &Parts, numbers: &Numbers, report: &mut Report) -> Vec<String> {
    let mut gone: Vec<(u32, usize, usize)> = Vec::new();
    let mut kept = vec![0usize; names.quantities.len()];
    let mut sort = |row: &Row, number: u32| match number {
        LEFT_OUT => gone.push((row.span.start, row.quantity, row.offset)),
        _ => kept[row.quantity] += 1,
    };
    // What holds an algebraic quantity goes with it.
    let declared =
        |row: &Option<Row>| row.as_ref().is_some_and(|row| names.quantities[row.quantity].kind != Kind::Algebraic);
    let states = parts.flat.states.iter().zip(&numbers.states).filter(|(row, _)| declared(row));
    for (row, number) in states.chain(parts.flat.algebraics.iter().zip(&numbers.algebraics)) {
        if let Some(row) = row {
            sort(row, *number);
        }
    }
    for (number, quantity) in names.quantities.iter().enumerate().filter(|(_, q)| q.kind == Kind::Input) {
        for offset in 0..quantity.length {
            let flat = at(quantity.base) + offset;
            match (numbers.inputs.get(flat), parts.inputs.get(flat)) {
                (Some(&LEFT_OUT), Some(driven)) => gone.push((driven.span.start, number, offset)),
                _ => kept[number] += 1,
            }
        }
    }
    gone.sort_unstable();
    let mut warned = vec![parts.observed; names.quantities.len()];
    for (_, number, _) in &gone {
        let name = names.quantities[*number].name;
        if kept[*number] == 0 && !std::mem::replace(&mut warned[*number], true) {
            let message = format!("`{}` is left out: no output depends on it", name.text);
            report.push(Diagnostic::error(codes::LEFT_OUT, name.span, message).into_warning());
        }
    }
    gone.into_iter().map(|(_, number, offset)| names.quantities[number].name_at(offset)).collect()
}

/// The rates of blocks that compute something, and the number of each block's; equal ones are one.
fn rates_in_use(rates: &[Rate], states: &[u32], blocks: &[Option<usize>]) -> (Vec<Rate>, Vec<u32>) {
    let mut used: Vec<Rate> = Vec::new();
    let mut rate_of = vec![LEFT_OUT; rates.len()];
    for block in states.iter().zip(blocks).filter(|(number, _)| **number != LEFT_OUT).filter_map(|(_, block)| *block) {
        if rate_of[block] == LEFT_OUT {
            let known = used.iter().position(|rate| rate.period == rates[block].period);
            rate_of[block] = number_of(known.unwrap_or(used.len()));
            if known.is_none() {
                used.push(rates[block]);
            }
        }
    }
    (used, rate_of)
}

/// Running number of each state quantity among the states.
fn state_numbers(names: &Names) -> Vec<u32> {
    let mut next = 0;
    let mut numbers = Vec::with_capacity(names.quantities.len());
    for quantity in &names.quantities {
        numbers.push(next);
        next += u32::from(quantity.kind == Kind::State || quantity.block.is_some());
    }
    numbers
}

/// Gives dense numbers to what is kept.
fn number<'a>(entries: impl Iterator<Item = &'a mut u32>) {
    for (next, entry) in entries.filter(|entry| **entry != LEFT_OUT).enumerate() {
        *entry = number_of(next);
    }
}

fn unit(quantity: &Quantity) -> Option<String> {
    quantity.unit.map(|unit| unit.text.clone())
}
