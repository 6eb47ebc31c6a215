//! States that stand for signals of the model ([`Motion`]): what they are at the end of a step, and within it.
//!
//! A clock adds a number. Sine and cosine turn by the angle of a step in three shears, `c1 = c - tan(a/2) s`,
//! `s+ = s + sin(a) c1`, `c+ = c1 - tan(a/2) s+`: each is undone by its own opposite, whatever its coefficient is rounded
//! to, so that the amplitude neither grows nor decays, and no word is overwritten before it is read
//! (`docs/decisions/0043-signals-of-the-model.md`).

use std::collections::BTreeMap;

use pe_ir::graph::{Factor, Role, Term, ValueId, Write};
use pe_ir::index::{self, StateId, at};
use pe_ir::model::{Expr, Model, Solver};
use pe_ir::motion::{Motion, Source};

use super::builder::{Builder, of_state, push};
use super::played;

/// The shears of a rotation by an angle: of the cosine, of the sine.
fn shears(angle: f64) -> (f64, f64) {
    (-libm::tan(angle / 2.0), libm::sin(angle))
}

/// The ratios of a list of steps, each once.
fn ratios(model: &Model) -> Vec<f64> {
    let mut ratios: Vec<f64> = model.phases.iter().map(|phase| phase.ratio).chain([1.0]).collect();
    ratios.sort_unstable_by(f64::total_cmp);
    ratios.dedup();
    ratios
}

/// A number that depends on the length of the step: with a list of steps the polynomial of their ratio through the
/// numbers of all of them.
pub(super) fn of_step(model: &Model, number: impl Fn(f64) -> f64) -> Expr {
    let Some(ratio) = model.step_ratio() else { return Expr::Constant(number(model.step)) };
    let places = ratios(model);
    // Newton's divided differences, nested: few ratios, exact at each of them.
    let mut differences: Vec<f64> = places.iter().map(|ratio| number(model.step / ratio)).collect();
    for order in 1..places.len() {
        for index in (order..places.len()).rev() {
            differences[index] =
                (differences[index] - differences[index - 1]) / (places[index] - places[index - order]);
        }
    }
    let mut nested = Expr::Constant(0.0);
    for (place, difference) in places.iter().zip(&differences).rev() {
        let distance = Expr::sum(vec![Expr::Variable(ratio), Expr::Constant(-place)]);
        nested = Expr::sum(vec![Expr::Constant(*difference), Expr::product(vec![distance, nested])]);
    }
    nested
}

/// The shears of a rotation in a step, as [`of_step`].
pub(super) fn shears_of_step(model: &Model, rate: f64) -> (Expr, Expr) {
    (of_step(model, |step| shears(rate * step).0), of_step(model, |step| shears(rate * step).1))
}

/// Parts of the step at which the stages of a method that follow its first one read, if they are what the derivatives are
/// evaluated at.
pub(super) fn abscissae(solver: Solver) -> &'static [f64] {
    match solver {
        Solver::Heun => &[1.0],
        Solver::Heun3 => &[1.0 / 3.0, 2.0 / 3.0],
        Solver::Rk4 => &[0.5, 0.5, 1.0],
        _ => &[],
    }
}

/// What states that stand for signals are at parts of the step: bits of the part, state.
pub(super) type Moved = BTreeMap<(u64, StateId), ValueId>;

/// Chains of what all states that stand for signals are at the end of the step, and at some parts of it.
pub(super) fn chains(builder: &mut Builder, model: &Model, parts: &[f64]) -> Moved {
    let mut moved = Moved::new();
    if model.has_played() {
        played::play(builder, model);
    }
    for (index, state) in model.states.numbered() {
        let Some(motion) = state.motion else { continue };
        match (motion, &state.derivative) {
            (Motion::Clock, Expr::Constant(rate)) => {
                let end = builder.graph.states[index].1;
                clock(builder, index, rate * model.step, end);
            }
            (Motion::Sine(rate), _) => rotation(builder, index, rate * model.step),
            (Motion::Along(after, _), _) => {
                let (after, end) = (builder.graph.states[after].0, builder.graph.states[index].1);
                let terms = vec![Term::new(after, Factor::Coefficient(1.0))];
                builder.chain(of_state(index), terms, Write { value: end, base: None, weight: 0 }, None);
            }
            _ => {}
        }
        moved.insert((1f64.to_bits(), index), builder.graph.states[index].1);
    }
    for (number, part) in (2u8..).zip(parts) {
        for (index, state) in model.states.numbered() {
            if state.motion.is_some_and(Motion::is_swept) {
                continue;
            }
            let (Some(motion), false) = (state.motion, moved.contains_key(&(part.to_bits(), index))) else { continue };
            if motion.rests() {
                moved.insert((part.to_bits(), index), builder.graph.states[index].0);
                continue;
            }
            if let (Motion::Along(_, Some(middle)), 0.5) = (motion, *part) {
                moved.insert((part.to_bits(), index), builder.graph.states[middle].0);
                continue;
            }
            builder.graph.names.auxiliaries.push(format!("{}.stage{number}", state.name));
            let role = Role::Auxiliary(index::number(builder.graph.names.auxiliaries.len()) - 1);
            let value = push(&mut builder.graph, role, of_state(index), false);
            match (motion, &state.derivative) {
                (Motion::Clock, Expr::Constant(rate)) => clock(builder, index, part * rate * model.step, value),
                (Motion::Sine(rate), _) => turned(builder, index, index.behind(1), part * rate * model.step, value),
                (Motion::Cosine(rate), _) => {
                    turned(builder, index, StateId::new(index.number() - 1), -part * rate * model.step, value)
                }
                (Motion::Line(source), _) => line(builder, index, source, *part, value),
                (Motion::Along(after, middle), _) => along(builder, index, (middle, after), *part, value),
                _ => unreachable!("the derivative of a clock is a number"),
            }
            moved.insert((part.to_bits(), index), value);
        }
    }
    moved
}

/// `value := state + count`.
fn clock(builder: &mut Builder, index: StateId, count: f64, value: ValueId) {
    let one = push(&mut builder.graph, Role::Constant(1.0), of_state(index), false);
    let terms = vec![Term::new(one, Factor::Coefficient(count))];
    let base = Some(builder.graph.states[index].0);
    builder.chain(of_state(index), terms, Write { value, base, weight: 0 }, None);
}

/// `value := state + part (after - before)`.
fn line(builder: &mut Builder, index: StateId, source: Source, part: f64, value: ValueId) {
    let (start, before) = (builder.graph.states[index].0, builder.graph.states[index.behind(1)].0);
    let after = match source {
        Source::Input(input) => builder.graph.inputs[at(input)],
        Source::Signal(_) => builder.graph.states[index.behind(2)].0,
    };
    let terms = vec![Term::new(after, Factor::Coefficient(part)), Term::new(before, Factor::Coefficient(-part))];
    builder.chain(of_state(index), terms, Write { value, base: Some(start), weight: 0 }, None);
}

/// `value := state + part (after - state)`, or on the parabola through the middle.
fn along(
    builder: &mut Builder,
    index: StateId,
    (middle, after): (Option<StateId>, StateId),
    part: f64,
    value: ValueId,
) {
    let start = builder.graph.states[index].0;
    let word = |state: StateId, factor: f64| Term::new(builder.graph.states[state].0, Factor::Coefficient(factor));
    let terms = match middle {
        None => vec![word(after, part), word(index, -part)],
        Some(middle) => vec![
            word(middle, 4.0 * part * (1.0 - part)),
            word(after, part * (2.0 * part - 1.0)),
            word(index, (1.0 - part) * (1.0 - 2.0 * part) - 1.0),
        ],
    };
    builder.chain(of_state(index), terms, Write { value, base: Some(start), weight: 0 }, None);
}

/// `value := state + (cos(angle) - 1) state + sin(angle) other`.
fn turned(builder: &mut Builder, index: StateId, other: StateId, angle: f64, value: ValueId) {
    let (start, other) = (builder.graph.states[index].0, builder.graph.states[other].0);
    let half = libm::sin(angle / 2.0);
    let terms = vec![
        Term::new(start, Factor::Coefficient(-2.0 * half * half)),
        Term::new(other, Factor::Coefficient(libm::sin(angle))),
    ];
    builder.chain(of_state(index), terms, Write { value, base: Some(start), weight: 0 }, None);
}

/// The ends of a sine and of the cosine behind it.
fn rotation(builder: &mut Builder, sine: StateId, angle: f64) {
    let cosine = sine.behind(1);
    let (of_cosine, of_sine) = shears(angle);
    let ((s, s_end), (c, c_end)) = (builder.graph.states[sine], builder.graph.states[cosine]);
    let name = format!("{}.sheared", builder.graph.names.states[cosine]);
    builder.graph.names.auxiliaries.push(name);
    let role = Role::Auxiliary(index::number(builder.graph.names.auxiliaries.len()) - 1);
    let sheared = push(&mut builder.graph, role, of_state(cosine), false);
    // Where words come in pairs only states are operands and bases.
    let apart = builder.graph.swaps();
    let mut shear = |equation: StateId, operands: &[ValueId], factor: f64, base: ValueId, value: ValueId| {
        let terms = operands.iter().map(|operand| Term::new(*operand, Factor::Coefficient(factor))).collect();
        builder.chain(of_state(equation), terms, Write { value, base: Some(base), weight: 0 }, None);
    };
    shear(cosine, &[s], of_cosine, c, sheared);
    shear(sine, &[sheared], of_sine, s, s_end);
    match apart {
        false => shear(cosine, &[s_end], of_cosine, sheared, c_end),
        true => shear(cosine, &[s, s_end], of_cosine, c, c_end),
    }
}
