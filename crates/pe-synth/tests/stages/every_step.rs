//! Stated errors against the truth at every step: models with a known solution, computed here by matrix exponentials.
//!
//! All models are linear with an input that is constant in pieces, so that the truth is exact to rounding. They are made
//! to have their errors where evenly spread samples do not look: fast decays, first steps, jumps.

use std::fmt::Write;

use crate::support::bench::Folder;
use crate::support::models::{Compiled, compile_file};
use nalgebra::DMatrix;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_judge::runs;
use pe_judge::total::Reference;
use pe_sim::fixed::FixedRun;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Part of the truth that a statement may have at least.
const LEAST: f64 = 1.0 / 3.0;

/// `x' = a x + b u` from `start`.
struct Linear {
    a: DMatrix<f64>,
    b: Vec<f64>,
    start: Vec<f64>,
    /// The input, as written in a spec, and its value between two times that no jump lies between.
    signal: String,
    input: Box<dyn Fn(f64) -> f64>,
    /// Times at which the input jumps.
    jumps: Vec<f64>,
}

impl Linear {
    fn spec(&self, solver: &str, step: f64, span: f64) -> String {
        let count = self.start.len();
        let mut text =
            format!("model m\nsolver {solver}\nstep {step:e} s\nspan {span:e} s\ninput u = {}\n", self.signal);
        for (state, start) in self.start.iter().enumerate() {
            let _ = writeln!(text, "state x{state} = {start:e}");
        }
        for row in 0..count {
            let terms: Vec<String> =
                (0..count).map(|column| format!("({:e})*x{column}", self.a[(row, column)])).collect();
            let _ = writeln!(text, "x{row}' = {} + ({:e})*u", terms.join(" + "), self.b[row]);
        }
        let outputs: Vec<String> = (0..count).map(|state| format!("x{state}")).collect();
        text + &format!("output {}\n", outputs.join(", "))
    }

    /// The system with its input as a state that stays as it is.
    fn whole(&self) -> DMatrix<f64> {
        let count = self.start.len();
        DMatrix::from_fn(count + 1, count + 1, |row, column| match (row < count, column < count) {
            (true, true) => self.a[(row, column)],
            (true, false) => self.b[row],
            _ => 0.0,
        })
    }

    /// States after each step.
    fn solution(&self, model: &Model) -> Vec<Vec<f64>> {
        let (whole, count) = (self.whole(), self.start.len());
        let over_step = exponential(&(&whole * model.step));
        let mut states = DMatrix::from_fn(count + 1, 1, |row, _| self.start.get(row).copied().unwrap_or(0.0));
        let mut rows = Vec::new();
        for step in 0..model.steps() {
            let (mut time, end) = (step as f64 * model.step, (step + 1) as f64 * model.step);
            // A jump at the end of a step, to rounding, is one at the beginning of the next.
            let slack = 1e-9 * model.step;
            let inside: Vec<f64> =
                self.jumps.iter().copied().filter(|at| *at > time + slack && *at < end - slack).collect();
            for until in inside.iter().copied().chain([end]) {
                states[count] = (self.input)(f64::midpoint(time, until));
                states = match inside.is_empty() {
                    true => &over_step * states,
                    false => exponential(&(&whole * (until - time))) * states,
                };
                time = until;
            }
            rows.push(states.iter().take(count).copied().collect());
        }
        rows
    }
}

/// Scaled, a Taylor series, squared.
fn exponential(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let halvings = matrix.norm().max(1e-3).log2().ceil().max(0.0) as i32 + 4;
    let scaled = matrix * 2f64.powi(-halvings);
    let one = DMatrix::identity(matrix.nrows(), matrix.ncols());
    let mut sum = one.clone();
    for power in (1..=14).rev() {
        sum = &one + &scaled * sum / f64::from(power);
    }
    for _ in 0..halvings {
        sum = &sum * &sum;
    }
    sum
}

/// What is true and what is stated of the largest error, relative to the largest magnitude of a state.
#[derive(Debug)]
struct Errors {
    truth: f64,
    total: f64,
    /// The parts that need no reference, added up.
    parts: f64,
    to_date: (f64, f64),
}

fn errors(linear: &Linear, folder: &Folder, name: &str, (solver, step, span): (&str, f64, f64)) -> Errors {
    let path = folder.0.join(format!("{name}.spec"));
    std::fs::write(&path, linear.spec(solver, step, span)).expect("the spec can be written");
    let Compiled { loaded, design } = compile_file(&path, &["--allow", "E0903", "--allow", "E0913", "--pes", "1"]);
    let (model, judged) = (&loaded.model, &design.judged);
    let solution = linear.solution(model);
    let count = linear.start.len();
    let mut scales: Vec<f64> = linear.start.iter().map(|start| start.abs()).collect();
    let mut so_far = scales.clone();
    for row in &solution {
        scales.iter_mut().zip(row).for_each(|(scale, state)| *scale = scale.max(state.abs()));
    }
    // As is documented: all states here are of one quantity, and the smallest scale is a millionth of the largest.
    let largest = scales.iter().copied().fold(0.0, f64::max);
    scales.iter_mut().for_each(|scale| *scale = scale.max(1e-6 * largest));
    let mut run = FixedRun::new(&design.graph, &judged.fixed);
    let (mut truth, mut to_date) = (0.0f64, 0.0f64);
    for (step, row) in (0..).zip(&solution) {
        run.step(&runs::port_words(model, &run, step));
        for state in 0..count {
            let wrong = (run.state(StateId::at(state)) - row[state]).abs();
            so_far[state] = so_far[state].max(row[state].abs());
            truth = truth.max(wrong / scales[state]);
            to_date = to_date.max(wrong / so_far[state].max(1e-6 * scales[state]));
        }
    }
    let reference = Reference::solve(model, &judged.times, &judged.looks.times, &[], &*pe_judge::progress::silent())
        .expect("a reference");
    let total = reference.compare(model, judged);
    let parts = judged.errors.method + judged.errors.word_length + judged.errors.input_hold;
    Errors { truth, total: total.whole.error, parts, to_date: (to_date, total.to_date) }
}

/// A stable matrix: decays up to `fastest`, coupled, some of them in pairs that oscillate.
fn random(random: &mut ChaCha8Rng, count: usize, fastest: f64) -> DMatrix<f64> {
    let decay = |random: &mut ChaCha8Rng| fastest * 10f64.powf(random.random_range(-3.0..0.0));
    let mut a = DMatrix::zeros(count, count);
    for row in 0..count {
        a[(row, row)] = -decay(random);
        for column in 0..row {
            a[(row, column)] = 0.3 * a[(row, row)] * random.random_range(-1.0..1.0);
        }
    }
    for first in (0..count - 1).step_by(2) {
        if random.random_bool(0.5) {
            // No faster than it decays, for explicit methods are not to blow up.
            let slower = f64::min(-a[(first, first)], -a[(first + 1, first + 1)]);
            let turns = slower * random.random_range(0.3..1.0);
            (a[(first, first + 1)], a[(first + 1, first)]) = (turns, -turns);
        }
    }
    a
}

fn square(frequency: f64, span: f64) -> Signal {
    let input = move |time: f64| if (time * frequency).fract() < 0.5 { 1.0 } else { -1.0 };
    let jumps = (1..).map(|half| f64::from(half) / (2.0 * frequency)).take_while(|time| *time < span).collect();
    (format!("square(1, {frequency:e} Hz)"), Box::new(input), jumps)
}

fn pulse(start: f64, width: f64) -> Signal {
    let input = move |time: f64| if time >= start && time < start + width { 1.0 } else { 0.0 };
    (format!("pulse(1, {start:e} s, {width:e} s)"), Box::new(input), vec![start, start + width])
}

fn none() -> Signal {
    ("constant(0)".to_owned(), Box::new(|_| 0.0), Vec::new())
}

type Signal = (String, Box<dyn Fn(f64) -> f64>, Vec<f64>);

fn linear(a: DMatrix<f64>, b: Vec<f64>, start: Vec<f64>, (signal, input, jumps): Signal) -> Linear {
    Linear { a, b, start, signal, input, jumps }
}

/// Checks a case; `parts` whether the parts alone have to tell the error, too.
fn check(label: &str, errors: &Errors, parts: bool, smallest: &mut f64) {
    let ratio = |stated: f64, truth: f64| if truth > 1e-11 { stated / truth } else { f64::INFINITY };
    let found = ratio(errors.total, errors.truth);
    *smallest = smallest.min(found);
    assert!(found >= LEAST, "{label}: {errors:?}");
    assert!(ratio(errors.to_date.1, errors.to_date.0) >= LEAST, "{label}: {errors:?}");
    assert!(!parts || ratio(errors.parts, errors.truth) >= LEAST, "{label}: {errors:?}");
}

#[test]
fn specs_whose_errors_fell_between_samples_state_them() {
    let folder = Folder::new("every_step_known");
    let one = |rate: f64| DMatrix::from_element(1, 1, -rate);
    let mut smallest = f64::INFINITY;
    for span in [1.03, 100.0] {
        let rc = linear(one(100.0), vec![100.0], vec![0.0], square(2.0, span));
        let found = errors(&rc, &folder, &format!("rc{span}"), ("heun", 5e-3, span));
        assert!((found.truth - 4.5e-2).abs() < 1e-3, "{found:?}");
        check("RC on a square wave", &found, true, &mut smallest);
    }
    let decay = linear(one(1000.0), vec![1000.0], vec![0.0], ("constant(1)".into(), Box::new(|_| 1.0), Vec::new()));
    let found = errors(&decay, &folder, "decay", ("rk4", 2e-3, 10.0));
    assert!((found.truth - 0.198).abs() < 1e-3, "{found:?}");
    check("fast decay", &found, true, &mut smallest);
    assert!(smallest > 0.99, "{smallest}");
}

#[test]
fn no_stated_error_flatters() {
    let folder = Folder::new("every_step");
    let mut dice = ChaCha8Rng::seed_from_u64(17);
    let (mut cases, mut smallest) = (0, f64::INFINITY);
    let solvers =
        ["euler", "heun", "heun3", "rk4", "ab2", "ab4", "implicit_euler", "trapezoidal", "ros2", "rodas3", "rkc5"];
    for round in 0..6 {
        for solver in solvers {
            let count = 2 + round % 3;
            let step = 1e-3;
            // What an explicit method can just take, and what only an implicit one can.
            let implicit = ["implicit_euler", "trapezoidal", "ros2", "rodas3"].contains(&solver);
            let fastest =
                [60.0, 300.0, if implicit { 3e4 } else { 500.0 }][round / 2] * if solver == "ab4" { 0.4 } else { 1.0 };
            let span = [0.613, 2.0, 11.0][round % 3];
            let a = random(&mut dice, count, fastest);
            let b: Vec<f64> = (0..count).map(|row| -a[(row, row)] * dice.random_range(0.5..1.0)).collect();
            let start: Vec<f64> = (0..count).map(|_| dice.random_range(-1.0..1.0)).collect();
            let (on_steps, signal) = match round {
                0 => (true, none()),
                1 => (true, square(5.0, span)),
                2 => (true, pulse(0.25 * span.floor().max(0.4), 0.05)),
                3 => (false, square(7.3, span)),
                4 => (true, square(2.0, span)),
                _ => (false, pulse(0.3 * span + 0.37e-3, 0.0105)),
            };
            let label = format!("{solver}, {count} states, fastest {fastest}, round {round}");
            let found = errors(&linear(a, b, start, signal), &folder, &format!("m{cases}"), (solver, step, span));
            check(&label, &found, on_steps, &mut smallest);
            cases += 1;
        }
    }
    println!("{cases} cases, smallest stated over true total error {smallest:.3}");
    assert!(cases >= 60 && smallest > 0.8, "{cases} cases, {smallest}");
}

#[test]
fn parts_tell_errors_at_bends_and_of_states_that_the_step_makes_large() {
    let cases: [(&str, &str, &[f64]); 4] = [
        ("chua", "rk4", &[2e-3, 1.5e-3, 3e-3]),
        ("gear_backlash", "heun", &[1e-3, 2e-3]),
        ("clamp_tank", "ab3", &[5e-3, 1e-2]),
        ("robertson", "implicit_euler", &[2e-2, 5e-3, 0.1]),
    ];
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/validation");
    for (name, solver, steps) in cases {
        for step in steps {
            let step = format!("{step:e}");
            let options = ["--solver", solver, "--step", &step, "--allow", "E0903", "--pes", "1"];
            let Compiled { loaded, design } = compile_file(&folder.join(format!("{name}.spec")), &options);
            let (model, judged) = (&loaded.model, &design.judged);
            let hidden = pe_judge::progress::silent();
            let reference =
                Reference::solve(model, &judged.times, &judged.looks.times, &[], &*hidden).expect("a solution");
            let truth = reference.compare(model, judged).whole.error;
            let parts = judged.errors.method + judged.errors.word_length + judged.errors.input_hold;
            println!("{name}, {solver}, {step} s: {:.2}", parts / truth);
            assert!(parts >= LEAST * truth, "{name}, {solver}, {step} s: {parts:e}, true is {truth:e}");
        }
    }
}
