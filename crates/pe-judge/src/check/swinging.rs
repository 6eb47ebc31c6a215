//! Whether the implicit step of a mechanism swings itself up: whether differences grow along its run that do not grow in the
//! mechanism itself.
//!
//! A mechanism that nothing damps multiplies differences, beside singular positions by much, so that the eigenvalues of one step
//! say nothing. What counts is the product of all steps along the run. It is followed on small differences, which are scaled back
//! again and again, and held against that of a firm step: half as long, with a hundred times the penalty. What grows by more than
//! there, from any time on, is no motion of the mechanism.

use std::sync::Arc;

use pe_hls::step::{StepOptions, build_with};
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;

use super::observed;
use super::question::rounded;
use super::trusted::Trusted;

/// Differences that are followed, and their size in parts of the largest magnitudes.
const DIFFERENCES: usize = 2;
const SIZE: f64 = 1e-6;

/// Times at which they are looked at.
const LOOKS: u64 = 400;

/// Products that all runs may take; what takes more is followed over the first part of the span.
const PRODUCTS: u64 = 400_000_000;

/// Runs of a step in which differences are followed, in steps of the model: its own, and two firm ones.
const PARTS: u64 = 3 * (1 + DIFFERENCES as u64);

/// Natural logarithm of the growth beyond that of the mechanism from which on a step swings itself up.
pub const GROWN: f64 = 7.0;

/// Error of the run from which on a step that swings itself up is refused.
const SPOILT: f64 = 0.05;

/// What the penalty is multiplied by, and what the step is divided by, of a step that has a firm hold of its closures.
const FIRM: f64 = 100.0;
const SHORTER: f64 = 2.0;

/// Penalties that are tried, in times of the one that is too small, and parts of the step.
const FACTORS: [f64; 3] = [10.0, 100.0, 1000.0];
const HALVES: [f64; 2] = [2.0, 4.0];

/// How much more differences grow in the steps of a mechanism than in the mechanism.
#[derive(Clone, Debug, PartialEq)]
pub struct Swing {
    /// Natural logarithm of the growth beyond that of the mechanism, over the time in which it is largest.
    pub beyond: f64,
    /// When that time begins, in seconds.
    pub from: f64,
    /// When it ends.
    pub until: f64,
    /// Natural logarithm of the largest growth from the start.
    pub largest: f64,
    /// The same with the firm step.
    pub firm: f64,
    /// The state that differs most at the end of that time.
    pub state: StateId,
}

impl Swing {
    /// When differences of which state grow by how much.
    fn words(&self, model: &Model) -> String {
        format!(
            "from t = {:.3e} s to {:.3e} s differences of `{}` grow {} beyond those of the mechanism",
            self.from,
            self.until,
            model.states[self.state].name,
            super::findings::factor(self.beyond)
        )
    }
}

/// What differences come to along a run: at each look the natural logarithm of their growth, and the state that differs most.
struct Course {
    logs: Vec<f64>,
    states: Vec<StateId>,
}

impl Course {
    /// Follows differences along the run of a step, with `every` steps from look to look; none where it is not finite.
    fn of<'g>(
        model: &Model,
        new: &dyn Fn() -> DoubleRun<'g>,
        scales: &[f64],
        every: u64,
        looks: u64,
    ) -> Option<Course> {
        let mut base = new();
        let mut moved: Vec<DoubleRun> = (0..DIFFERENCES).map(|_| new()).collect();
        for (number, run) in moved.iter_mut().enumerate() {
            for (state, scale) in scales.iter().enumerate() {
                let state = StateId::at(state);
                run.set_state(state, base.state(state) + SIZE * scale * direction(number, state.index()));
            }
        }
        let mut logs = [0.0; DIFFERENCES];
        let mut course = Course { logs: Vec::new(), states: Vec::new() };
        let mut before: Vec<f64> = moved.iter().map(|run| apart(model, &base, run, scales).0).collect();
        for look in 0..looks {
            for step in look * every..(look + 1) * every {
                let inputs = model.sample_inputs(model.time(step, 0.0));
                base.step(&inputs).ok()?;
                for run in &mut moved {
                    run.step(&inputs).ok()?;
                }
            }
            let mut worst = (f64::NEG_INFINITY, StateId::new(0));
            for (run, (log, before)) in moved.iter_mut().zip(logs.iter_mut().zip(&mut before)) {
                let (size, state) = apart(model, &base, run, scales);
                *log += libm::log((size / *before).max(f64::MIN_POSITIVE));
                if *log > worst.0 {
                    worst = (*log, state);
                }
                // So small that it stays a difference, and larger than rounding.
                let part = SIZE / size.max(f64::MIN_POSITIVE);
                for state in (0..base.states().len()).map(StateId::at) {
                    let own = base.state(state);
                    run.set_state(state, own + part * model.difference(state, run.state(state), own));
                }
                *before = apart(model, &base, run, scales).0;
            }
            if !worst.0.is_finite() {
                return None;
            }
            course.logs.push(worst.0);
            course.states.push(worst.1);
        }
        Some(course)
    }
}

/// A direction in which all states differ.
fn direction(number: usize, state: usize) -> f64 {
    libm::cos((2 * number + 1) as f64 * (1.0 + state as f64))
}

/// The largest difference of two runs, in parts of magnitudes, and its state.
fn apart(model: &Model, one: &DoubleRun, other: &DoubleRun, scales: &[f64]) -> (f64, StateId) {
    let part = |(state, scale): (usize, &f64)| {
        let state = StateId::at(state);
        (model.difference(state, one.state(state), other.state(state)).abs() / scale, state)
    };
    let none = (0.0, StateId::new(0));
    scales
        .iter()
        .enumerate()
        .map(part)
        .fold(none, |most, own| if own.0 > most.0 || own.0.is_nan() { own } else { most })
}

/// Steps of the mechanism that others are held against.
struct Firm {
    course: Course,
    /// Steps from look to look, and looks.
    every: u64,
    looks: u64,
}

impl Firm {
    fn of(model: &Model, macs: u64, scales: &[f64]) -> Option<Firm> {
        let steps = model.steps().min(PRODUCTS / (PARTS * macs.max(1)));
        let every = steps.div_ceil(LOOKS).max(1);
        let looks = steps / every;
        let firm = other(model, FIRM, SHORTER);
        let graph = build_with(&firm, &StepOptions::default()).ok()?;
        let course = Course::of(&firm, &|| DoubleRun::new(&graph), scales, SHORTER as u64 * every, looks)?;
        Some(Firm { course, every, looks })
    }

    /// How much more differences grow in a run of a step, of which `parts` make a step of the model.
    fn beside<'g>(
        &self,
        (model, own): (&Model, &Model),
        new: &dyn Fn() -> DoubleRun<'g>,
        scales: &[f64],
        parts: u64,
    ) -> Option<Swing> {
        let course = Course::of(own, new, scales, parts * self.every, self.looks)?;
        let time = |look: usize| model.time((look as u64 + 1) * self.every, 0.0);
        let mut swing = Swing { beyond: 0.0, from: 0.0, until: 0.0, largest: 0.0, firm: 0.0, state: StateId::new(0) };
        let (mut least, mut since) = (f64::INFINITY, 0);
        for (look, (own, firm)) in course.logs.iter().zip(&self.course.logs).enumerate() {
            (swing.largest, swing.firm) = (swing.largest.max(*own), swing.firm.max(*firm));
            least = least.min(own - firm);
            let beyond = own - firm - least;
            if beyond < 1.0 {
                since = look;
            }
            if beyond > swing.beyond {
                swing = Swing { beyond, from: time(since), until: time(look), state: course.states[look], ..swing };
            }
        }
        Some(swing)
    }
}

/// A mechanism with times the penalty, and a part of the step.
fn other(model: &Model, penalty: f64, part: f64) -> Model {
    let mut other = model.in_steps_of(model.step / part);
    if let Some(mechanism) = &mut other.mechanism {
        Arc::make_mut(mechanism).penalty *= penalty;
    }
    other
}

/// How much more differences grow in the implicit step of a mechanism than in the mechanism; none for other steps, and where
/// that cannot be told.
pub fn swing(model: &Model, graph: &StepGraph, fixed: &FixedPoint, scales: &[f64]) -> Option<Swing> {
    let firm = firm(model, graph, scales)?;
    firm.beside((model, model), &|| DoubleRun::quantised(graph, fixed), scales, 1)
}

fn firm(model: &Model, graph: &StepGraph, scales: &[f64]) -> Option<Firm> {
    let implicit = model.mechanism.is_some() && model.solver == Solver::Trapezoidal;
    if implicit { Firm::of(model, graph.macs(), scales) } else { None }
}

/// In words, when a step that is refused for what it comes to swings itself up, in double precision; none if it does not.
pub fn swings(model: &Model) -> Option<String> {
    let graph = build_with(model, &StepOptions::default()).ok()?;
    let scales = observed::scales(&Trusted::of(model, None));
    let swing = firm(model, &graph, &scales)?.beside((model, model), &|| DoubleRun::new(&graph), &scales, 1)?;
    (swing.beyond > GROWN).then(|| swing.words(model))
}

/// A step that swings itself up, with the penalty or the step that does not: refused where the run shows it.
pub(super) fn finding(
    model: &Model,
    graph: &StepGraph,
    swing: Option<&Swing>,
    scales: &[f64],
    worst: f64,
) -> Option<Diagnostic> {
    let swing = swing.filter(|swing| swing.beyond > GROWN)?;
    let mechanism = model.mechanism.as_deref()?;
    let message = format!("the step of the mechanism swings itself up: {}", swing.words(model));
    let firm = firm(model, graph, scales)?;
    let holds = |penalty: f64, part: f64| {
        let other = other(model, penalty, part);
        let graph = build_with(&other, &StepOptions::default()).ok()?;
        let swing = firm.beside((model, &other), &|| DoubleRun::new(&graph), scales, part as u64)?;
        (swing.beyond <= GROWN).then_some(())
    };
    let penalty = FACTORS.into_iter().find(|factor| holds(*factor, 1.0).is_some());
    let name = &model.states[mechanism.pairs[0].1].name;
    let name = name.split('[').next().unwrap_or(name);
    let (code, help) = match (penalty, HALVES.into_iter().find(|part| penalty.is_none() && holds(1.0, *part).is_some()))
    {
        (Some(factor), _) => {
            (codes::PENALTY_SMALL, format!("`--set {name}.penalty={}` does not (tried)", factor * mechanism.penalty))
        }
        (None, Some(part)) => {
            (codes::STEP_TOO_LARGE, format!("`--step {:e}` does not (tried)", rounded(model.step / part)))
        }
        (None, None) => {
            (codes::STEP_TOO_LARGE, format!("take a larger penalty than {} and a smaller `--step`", mechanism.penalty))
        }
    };
    let finding = |code| Diagnostic::error(code, mechanism.span, message).with_help(help);
    Some(if worst > SPOILT { finding(code) } else { finding(codes::METHOD_GROWTH).into_warning() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn next(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 33) as f64 / f64::from(1u32 << 31)
    }

    fn model(text: &str) -> Model {
        let mut sources = pe_ir::source::Sources::new("m.spec", text);
        let compiled = pe_frontend::compile(&mut sources, &pe_frontend::NoFiles, &pe_frontend::Overrides::default());
        pe_hls::lift::lift(compiled.unwrap_or_else(|found| panic!("{found:#?}\n{text}")).0)
    }

    /// A bead on a curve, whose closure has a lever that falls on its way; the least that the penalty holds it with, against
    /// its mass.
    fn bead(seed: &mut u64) -> (String, f64) {
        let (fall, mass, speed) = (2.5 * next(seed), 0.3 + next(seed), 0.5 + next(seed));
        let penalty = libm::pow(10.0, 4.0 * next(seed));
        let text = format!(
            "model bead\nsolver trapezoidal\nstep 1 ms\nspan 2 s\nindex i in 1..2, j in 1..2, r in 1..1\nparam k = {fall}\n\
             state q[i] = 0\nstate w[i] = {speed}\nmatrix M[i, j] symmetric\nmatrix J[r, i]\nM[i, i] = {mass}\n\
             f[i] = if i == 1 then 0 else 9.81*{mass}\nlever = exp(-k*q[1])\ncurve = sin(q[1])\nslope = cos(q[1])\n\
             gap[r] = lever*(q[2] - curve)\n\
             J[r, i] = if i == 1 then -k*lever*(q[2] - curve) - lever*slope else lever\n\
             bend[r] = lever*(curve*w[1]^2 - 2*k*w[1]*(w[2] - slope*w[1]) + k^2*w[1]^2*(q[2] - curve))\n\
             q' = w\nw' = constrained(M, f, J, gap, bend, {penalty}, 100)\noutput q, w\n"
        );
        (text, penalty / mass)
    }

    /// A chain of masses on rods, from rest to the side.
    fn chain(size: usize, seed: &mut u64) -> String {
        let step = [1, 2, 4][(3.0 * next(seed)) as usize];
        let mut text = format!(
            "model chain\nsolver trapezoidal\nstep {step} ms\nspan 1 s\nindex i in 1..{size}, j in 1..{size}, r in 1..{size}\n\
             index x in 1..2*{size}, y in 1..2*{size}\nparam l[r] = 0.5 + 0.{}*r\nstate q[x] = if x mod 2 == 1 then sum(r where r <= \
             (x + 1) div 2: l[r]) else 0\nstate w[x] = 0\nmatrix M[x, y] symmetric\nmatrix J[r, x]\nM[x, x] = {}\n\
             f[x] = if x mod 2 == 0 then -9.81 else 0\n",
            (9.0 * next(seed)) as u32,
            0.5 + next(seed)
        );
        for rod in 1..=size {
            let along = |of: char, axis: usize| match rod {
                1 => format!("{of}[{axis}]"),
                _ => format!("({of}[{}] - {of}[{}])", 2 * rod - 2 + axis, 2 * rod - 4 + axis),
            };
            let (x, y, u, v) = (along('q', 1), along('q', 2), along('w', 1), along('w', 2));
            text += &format!(
                "gap[{rod}] = ({x}^2 + {y}^2 - l[{rod}]^2)/(2*l[{rod}])\nbend[{rod}] = ({u}^2 + {v}^2)/l[{rod}]\n"
            );
            text += &format!("J[{rod}, {}] = {x}/l[{rod}]\nJ[{rod}, {}] = {y}/l[{rod}]\n", 2 * rod - 1, 2 * rod);
            if rod > 1 {
                text +=
                    &format!("J[{rod}, {}] = -{x}/l[{rod}]\nJ[{rod}, {}] = -{y}/l[{rod}]\n", 2 * rod - 3, 2 * rod - 2);
            }
        }
        text + "q' = w\nw' = constrained(M, f, J, gap, bend, 400, 100)\noutput q, w\n"
    }

    /// Growth beyond the mechanism's, and the largest distance of the run from that of the firm step.
    fn judged(model: &Model) -> Option<(Swing, f64)> {
        let graph = pe_hls::step::build(model).expect("a step");
        let scales = vec![1.0; model.states.len()];
        let firm = other(model, FIRM, SHORTER);
        let firm = pe_hls::step::build(&firm).expect("a step");
        let (mut run, mut beside, mut away) = (DoubleRun::new(&graph), DoubleRun::new(&firm), 0.0f64);
        for _ in 0..model.steps() {
            run.step(&[]).ok()?;
            beside.step(&[]).ok()?;
            beside.step(&[]).ok()?;
            let numbers = run.states().zip(beside.states()).take(model.states.len());
            away = numbers.map(|(one, other)| (one - other).abs()).fold(away, f64::max);
        }
        let firm = super::firm(model, &graph, &scales)?;
        Some((firm.beside((model, model), &|| DoubleRun::new(&graph), &scales, 1)?, away))
    }

    #[test]
    fn a_step_that_swings_itself_up_on_the_way_is_found_and_no_other() {
        let mut seed = 3;
        let (mut found, mut held) = (0, 0);
        for case in 0..60 {
            let (text, hold) = bead(&mut seed);
            let model = model(&text);
            let Some((swing, away)) = judged(&model) else { continue };
            println!("{case}: hold {hold:.1e}, beyond {:.2}, away {away:.1e}", swing.beyond);
            if away > 0.3 {
                assert!(swing.beyond > GROWN, "{case}: away {away:e}, {swing:?}\n{text}");
            }
            if swing.beyond > GROWN {
                assert!(away > 1e-3, "{case}: away {away:e}, {swing:?}\n{text}");
            }
            found += u32::from(swing.beyond > GROWN);
            held += u32::from(swing.beyond < 1.0);
        }
        println!("{found} found, {held} held");
        assert!(found >= 5 && held >= 10, "{found} {held}");
    }

    #[test]
    fn chains_that_multiply_differences_do_not_swing_themselves_up() {
        let mut seed = 5;
        for case in 0..12 {
            let model = model(&chain(1 + case % 3, &mut seed));
            let Some((swing, _)) = judged(&model) else { panic!("{case}") };
            println!("{case}: {swing:?}");
            assert!(swing.beyond < 0.5 * GROWN, "{case}: {swing:?}");
        }
    }
}
