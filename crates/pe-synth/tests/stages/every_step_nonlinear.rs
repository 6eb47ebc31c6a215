//! Stated errors of nonlinear models against the truth at every step, which steps 64 times as fine give.

use pe_ir::index::StateId;
use std::fmt::Write;

use crate::support::bench::Folder;
use crate::support::models::{Compiled, compile_file};
use pe_judge::runs;
use pe_judge::total::Reference;
use pe_sim::fixed::FixedRun;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Part of the truth that a statement must have.
const LEAST: f64 = 0.8;

/// Parts of a step in the run that is the truth.
const FINER: u32 = 64;

type Slopes = Box<dyn Fn(f64, &[f64]) -> Vec<f64>>;

/// A model in both languages.
struct Case {
    start: Vec<f64>,
    statements: String,
    slopes: Slopes,
}

/// Species that grow and push one another aside, at rates over three decades.
fn competition(dice: &mut ChaCha8Rng, fastest: f64) -> Case {
    let count = dice.random_range(2..4usize);
    let rate: Vec<f64> = (0..count).map(|_| fastest * 10f64.powf(dice.random_range(-2.5..0.0))).collect();
    let pushed: Vec<Vec<f64>> = (0..count)
        .map(|i| (0..count).map(|j| if i == j { 1.0 } else { dice.random_range(0.0..0.9) }).collect())
        .collect();
    let start: Vec<f64> = (0..count).map(|_| 10f64.powf(dice.random_range(-4.0..0.0))).collect();
    let mut statements = String::new();
    for i in 0..count {
        let all: Vec<String> = (0..count).map(|j| format!("{:e}*x{j}", pushed[i][j])).collect();
        let _ = writeln!(statements, "x{i}' = {:e}*x{i}*(1 - ({}))", rate[i], all.join(" + "));
    }
    let slopes = move |_: f64, x: &[f64]| {
        let of = |i: usize| rate[i] * x[i] * (1.0 - pushed[i].iter().zip(x).map(|(a, x)| a * x).sum::<f64>());
        (0..x.len()).map(of).collect()
    };
    Case { start, statements, slopes: Box::new(slopes) }
}

/// A cubic spring with friction, pushed to and fro, and a state that follows it.
fn spring(dice: &mut ChaCha8Rng, fastest: f64, step: f64) -> Case {
    // As much friction as explicit methods of low order need.
    let stiffness = fastest * fastest * dice.random_range(0.01..0.2);
    let friction = fastest * dice.random_range(0.02..0.5) + 8.0 * step * stiffness;
    let (follows, push) = (fastest * dice.random_range(0.05..1.0), dice.random_range(0.1..0.5));
    let start = vec![dice.random_range(-1.0..1.0), 0.0, dice.random_range(-1.0..1.0)];
    let statements = format!(
        "x0' = x1\nx1' = ({:e})*(x0 + x0^3) - {friction:e}*x1 + {:e}*u\nx2' = {follows:e}*(x0*x0 - x2)\ninput u = square({push:e}, 5 Hz)\n",
        -stiffness, stiffness
    );
    let slopes = move |time: f64, x: &[f64]| {
        let u = if (time * 5.0).fract() < 0.5 { push } else { -push };
        let force = -stiffness * (x[0] + x[0].powi(3)) - friction * x[1] + stiffness * u;
        vec![x[1], force, follows * (x[0] * x[0] - x[2])]
    };
    Case { start, statements, slopes: Box::new(slopes) }
}

/// A narrow peak at some time, and what runs through it and forgets it.
fn peak(dice: &mut ChaCha8Rng, step: f64, span: f64) -> Case {
    let (at, width) = (span * dice.random_range(0.2..0.8), step * dice.random_range(2.0..40.0));
    let forgets = dice.random_range(5.0..100.0);
    let statements = format!("x0' = 1\nx1' = {forgets:e}*(exp(-((x0 - {at:e})/{width:e})^2) - x1)\n");
    let slopes = move |_: f64, x: &[f64]| {
        let part = (x[0] - at) / width;
        vec![1.0, forgets * ((-part * part).exp() - x[1])]
    };
    Case { start: vec![0.0, 0.0], statements, slopes: Box::new(slopes) }
}

/// A step of RK4; inputs are those in the middle of it.
fn rk4(slopes: &Slopes, time: f64, h: f64, x: &mut [f64]) {
    let moved = |x: &[f64], k: &[f64], by: f64| -> Vec<f64> { x.iter().zip(k).map(|(x, k)| x + by * k).collect() };
    let middle = time + 0.5 * h;
    let k1 = slopes(middle, x);
    let k2 = slopes(middle, &moved(x, &k1, 0.5 * h));
    let k3 = slopes(middle, &moved(x, &k2, 0.5 * h));
    let k4 = slopes(middle, &moved(x, &k3, h));
    for (i, x) in x.iter_mut().enumerate() {
        *x += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
    }
}

/// The true largest error of all steps, and the stated one; none of a model that was refused for being no model.
fn errors(case: &Case, folder: &Folder, name: &str, (solver, step, span): (&str, f64, f64)) -> (f64, f64) {
    let path = folder.0.join(format!("{name}.spec"));
    let mut text = format!("model m\nsolver {solver}\nstep {step:e} s\nspan {span:e} s\n");
    for (state, start) in case.start.iter().enumerate() {
        let _ = writeln!(text, "state x{state} = {start:e}");
    }
    let outputs: Vec<String> = (0..case.start.len()).map(|state| format!("x{state}")).collect();
    let _ = writeln!(text, "{}output {}", case.statements, outputs.join(", "));
    std::fs::write(&path, text).expect("the spec can be written");
    let allowed = ["E0903", "E0907", "E0913", "E0915"].map(|code| ["--allow", code]).concat();
    let Compiled { loaded, design } = compile_file(&path, &[&allowed[..], &["--pes", "1", "--proof", "off"]].concat());
    let (model, judged) = (&loaded.model, &design.judged);
    let mut run = FixedRun::new(&design.graph, &judged.fixed);
    let mut truth = case.start.clone();
    let mut scales: Vec<f64> = truth.iter().map(|start| start.abs()).collect();
    let mut wrong = vec![0.0f64; truth.len()];
    for done in 0..model.steps() {
        run.step(&runs::port_words(model, &run, done));
        let fine = step / f64::from(FINER);
        for part in 0..FINER {
            rk4(&case.slopes, done as f64 * step + f64::from(part) * fine, fine, &mut truth);
        }
        for (state, truth) in truth.iter().enumerate() {
            scales[state] = scales[state].max(truth.abs());
            wrong[state] = wrong[state].max((run.state(StateId::at(state)) - truth).abs());
        }
    }
    let wrong = wrong.iter().zip(&scales).map(|(wrong, scale)| wrong / scale).fold(0.0, f64::max);
    let reference = Reference::solve(model, &judged.times, &judged.looks.times, &[], &*pe_judge::progress::silent())
        .expect("a reference");
    (wrong, reference.compare(model, judged).whole.error)
}

#[test]
fn no_stated_error_of_a_nonlinear_model_flatters() {
    let folder = Folder::new("every_step_nonlinear");
    let mut dice = ChaCha8Rng::seed_from_u64(23);
    let (mut smallest, mut failures, mut cases) = (f64::INFINITY, Vec::new(), 0);
    for round in 0..6 {
        for solver in ["euler", "heun", "rk4", "ab2", "implicit_euler", "rodas3"] {
            let (step, span) = (1e-3, [0.6, 1.5, 4.0][round / 2]);
            let fastest = [60.0, 300.0][round % 2];
            for (kind, case) in [
                ("competition", competition(&mut dice, fastest)),
                ("spring", spring(&mut dice, fastest, step)),
                ("peak", peak(&mut dice, step, span)),
            ] {
                let (truth, stated) = errors(&case, &folder, &format!("m{cases}"), (solver, step, span));
                cases += 1;
                // Below, the tables' and the truth's own roundings count.
                let ratio = if truth > 1e-9 { stated / truth } else { f64::INFINITY };
                smallest = smallest.min(ratio);
                if ratio < LEAST {
                    failures.push(format!(
                        "{kind}, {solver}, round {round}: stated {stated:.2e}, true {truth:.2e}\n{}",
                        case.statements
                    ));
                }
            }
        }
    }
    println!("{cases} cases, smallest stated over true total error {smallest:.3}");
    assert!(failures.is_empty(), "{} of {cases}\n{}", failures.len(), failures.join("\n"));
}
