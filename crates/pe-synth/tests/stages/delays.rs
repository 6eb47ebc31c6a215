//! Delays of quantities: orders of the methods, runs against simulations by hand, and bit for bit through all engines.

use std::fs;
use std::process::Command;

use crate::support::agree::assert_same_words;
use crate::support::bench::Folder;
use crate::support::is_long_suite;
use crate::support::written::{compiled, next, rows};
use pe_ir::model::{Model, Solver};
use pe_sim::error::Trajectory;
use pe_sim::reference::{self, TOLERANCE};
use serde_json::Value;

/// The solution of `x' = -x(t - delay)` that is 1 up to time zero: a polynomial from one multiple of the delay to the next.
fn exact(time: f64, delay: f64) -> f64 {
    let (mut sum, mut factorial) = (1.0, 1.0);
    let mut k = 1.0;
    while time - (k - 1.0) * delay > 0.0 {
        factorial *= k;
        sum += libm::pow(-1.0, k) * libm::pow(time - (k - 1.0) * delay, k) / factorial;
        k += 1.0;
    }
    sum
}

const SOLVERS: [(Solver, f64); 12] = [
    (Solver::Euler, 1.0),
    (Solver::Heun, 2.0),
    (Solver::Heun3, 3.0),
    (Solver::Rk4, 4.0),
    (Solver::Ab2, 2.0),
    (Solver::Ab4, 2.0),
    (Solver::Rkc5, 2.0),
    (Solver::ImplicitEuler, 1.0),
    (Solver::Trapezoidal, 2.0),
    (Solver::Ros2, 2.0),
    (Solver::Rodas3, 2.0),
    (Solver::Exact, 2.0),
];

fn error(model: &Model, solver: Solver, step: f64, solution: &dyn Fn(f64) -> f64) -> f64 {
    let mut model = Model { solver, ..model.clone() };
    model.set_step(step);
    let rows = rows(&model);
    let errors = rows.iter().enumerate().map(|(step, row)| (row[0] - solution(model.time(step as u64, 0.0))).abs());
    errors.fold(0.0, f64::max)
}

/// Bends of the solution at whole numbers take no method its order, for no step reads beyond one.
#[test]
fn every_method_has_its_order_across_bends() {
    let model = compiled("model m\nsolver rk4\nstep 0.1\nspan 4.5\nstate x = 1\nx' = -x(t - 1)\noutput x\n");
    for (solver, order) in SOLVERS {
        let (long, short) = (
            error(&model, solver, 0.05, &|time| exact(time, 1.0)),
            error(&model, solver, 0.025, &|time| exact(time, 1.0)),
        );
        let seen = libm::log2(long / short);
        println!("{}: order {seen:.2}, error {short:.1e}", solver.name());
        assert!(seen > order - 0.25 || short < 1e-12, "{}: {seen:.2}, {long:e}, {short:e}", solver.name());
    }
}

/// Two delays, one of an algebraic quantity that reads another, in a model that is not linear.
const MIXED: &str = "model m\nsolver rk4\nstep 0.1\nspan 6\nstate x = 0.5\nstate z = 0.2\ninput w = 0.3\n\
    drive = sine(1, 0.2 Hz)\n\
    p = x*z(t - 0.4) + 0.2*exp(-x) + 0.1*drive(t - 0.2)\nx' = z - x(t - 1)*p(t - 0.6) + w\n\
    z' = -z - 0.5*x(time - 0.4)^2 + 0.3*p\noutput x, z\n";

#[test]
fn methods_have_their_order_with_delays_of_algebraic_quantities() {
    let model = compiled(MIXED);
    let times: Vec<f64> = (1..=60).map(|place| 0.1 * f64::from(place)).collect();
    let solution = reference::solve(&model, &times, 1e-12, &mut |_| {}).unwrap();
    let at = |time: f64| {
        let place = (time / 0.1).round() as usize;
        if (time - 0.1 * place as f64).abs() > 1e-9 || place == 0 {
            return f64::NAN;
        }
        solution.samples[(place - 1) * model.states.len()]
    };
    for (solver, order) in SOLVERS.into_iter().filter(|(solver, _)| *solver != Solver::Exact) {
        let (long, short) = (error(&model, solver, 0.05, &at), error(&model, solver, 0.025, &at));
        let seen = libm::log2(long / short);
        println!("{}: order {seen:.2}, error {short:.1e}", solver.name());
        assert!(seen > order - 0.3, "{}: {seen:.2}, {long:e}, {short:e}", solver.name());
    }
}

#[test]
fn the_reference_solution_is_that_of_the_delayed_equation() {
    for delays in ["1", "1, 1.3, 1.7"] {
        // Each has a solution of its own; several in one model have the bends of all. Shorter delays would have sums that cancel.
        let equation = |(place, delay): (usize, &str)| {
            format!("state x{place} = 1\nx{place}' = -x{place}(t - {delay})\noutput x{place}\n")
        };
        let equations: String = delays.split(", ").enumerate().map(equation).collect();
        let model = compiled(&format!("model m\nsolver rk4\nstep 0.1\nspan 15\n{equations}"));
        for rows in [15, 60, 150, 1500] {
            let times: Vec<f64> = (1..=rows).map(|place| 15.0 * f64::from(place) / f64::from(rows)).collect();
            let first = reference::solve(&model, &times, TOLERANCE, &mut |_| {}).unwrap();
            let second = reference::solve_by_second_method(&model, &times, TOLERANCE).unwrap().states;
            for (place, delay) in delays.split(", ").enumerate() {
                let delay: f64 = delay.parse().unwrap();
                let largest = |found: &Trajectory| {
                    let errors = times.iter().enumerate().map(|(row, time)| {
                        let found = found.samples[row * model.states.len() + place];
                        (found - exact(*time, delay)).abs()
                    });
                    errors.fold(0.0, f64::max)
                };
                let errors = [&first, &second].map(largest);
                println!("{delays}: delay {delay}, {rows} rows: {errors:?}");
                assert!(errors.iter().all(|error| *error < 2.0 * TOLERANCE), "{delay}, {rows} rows: {errors:?}");
            }
        }
    }
}

/// A step by hand: rows of states, and what they were within each step, at its beginning, in its middle and at its end.
struct ByHand {
    order: usize,
    step: f64,
    count: usize,
    /// For each state its weights: of states, each with the steps of the delay.
    couplings: Vec<Vec<(usize, usize, f64)>>,
    courses: Vec<Vec<[f64; 3]>>,
    states: Vec<f64>,
    start: Vec<f64>,
}

impl ByHand {
    fn was(&self, state: usize, delay: usize, place: usize) -> f64 {
        match self.courses.len().checked_sub(delay) {
            Some(step) => self.courses[step][state][place],
            None => self.start[state],
        }
    }

    fn slopes(&self, states: &[f64], place: usize) -> Vec<f64> {
        let of = |state: usize| {
            let sum: f64 =
                self.couplings[state].iter().map(|(read, delay, weight)| weight * self.was(*read, *delay, place)).sum();
            sum - states[state] - 0.1 * states[state] * states[(state + 1) % self.count]
        };
        (0..self.count).map(of).collect()
    }

    fn advance(&mut self) {
        let h = self.step;
        let moved = |states: &[f64], slopes: &[f64], by: f64| -> Vec<f64> {
            states.iter().zip(slopes).map(|(state, slope)| state + by * slope).collect()
        };
        let begin = self.states.clone();
        let first = self.slopes(&begin, 0);
        let end = match self.order {
            1 => moved(&begin, &first, h),
            2 => {
                let second = self.slopes(&moved(&begin, &first, h), 2);
                moved(&moved(&begin, &first, h / 2.0), &second, h / 2.0)
            }
            _ => {
                let second = self.slopes(&moved(&begin, &first, h / 2.0), 1);
                let third = self.slopes(&moved(&begin, &second, h / 2.0), 1);
                let last = self.slopes(&moved(&begin, &third, h), 2);
                let half = moved(&moved(&begin, &first, h / 6.0), &last, h / 6.0);
                moved(&moved(&half, &second, h / 3.0), &third, h / 3.0)
            }
        };
        let behind = self.slopes(&end, 2);
        let middle = |state: usize| 0.5 * (begin[state] + end[state]) + h / 8.0 * (first[state] - behind[state]);
        self.courses.push((0..self.count).map(|state| [begin[state], middle(state), end[state]]).collect());
        self.states = end;
    }
}

#[test]
fn generated_models_run_as_by_hand() {
    let mut seed = 11;
    for round in 0..30usize {
        let (order, solver) = [(1, "euler"), (2, "heun"), (4, "rk4")][round % 3];
        let count = 1 + (4.0 * next(&mut seed)) as usize;
        let step = 0.05;
        let mut couplings: Vec<Vec<(usize, usize, f64)>> = Vec::new();
        let mut text = format!("model m\nsolver {solver}\nstep {step}\nspan 2\nindex i in 1..{count}\n");
        let start: Vec<f64> = (0..count).map(|_| 2.0 * next(&mut seed) - 1.0).collect();
        // In an array, as instances of a component, or each for itself; read as it is or through an algebraic quantity.
        let form = round % 4;
        let name = |state: usize| match form {
            0 => format!("x[{}]", state + 1),
            1 => format!("cell[{}].x", state + 1),
            _ => format!("x_{}", state + 1),
        };
        match form {
            0 => {
                let values: Vec<String> = start.iter().map(f64::to_string).collect();
                text += &format!("state x[i] = [{}]\n", values.join(", "));
            }
            1 => {
                text += "component Cell(first) {\n  input drive\n  state x = first\n  input other\n  x' = drive - x - 0.1*x*other\n}\n";
                let values: Vec<String> = start.iter().map(f64::to_string).collect();
                text += &format!("param begins[i] = [{}]\n", values.join(", "));
                text += "instance cell[i] = Cell(first = begins[i], drive = drive[i], other = other[i])\n";
            }
            _ => (0..count).for_each(|state| text += &format!("state {} = {}\n", name(state), start[state])),
        }
        for state in 0..count {
            let terms = 1 + (4.0 * next(&mut seed)) as usize;
            let all: Vec<(usize, usize, f64)> = (0..terms)
                .map(|_| {
                    let (read, delay) =
                        ((next(&mut seed) * count as f64) as usize, 1 + (next(&mut seed) * 12.0) as usize);
                    (read, delay, (2.0 * next(&mut seed) - 1.0).round() * 0.5 + 0.25)
                })
                .collect();
            let term = |(read, delay, weight): &(usize, usize, f64)| {
                format!("{weight}*{}(t - {:.2})", name(*read), step * *delay as f64)
            };
            let sum = all.iter().map(term).collect::<Vec<_>>().join(" + ");
            let other = name((state + 1) % count);
            text += &match form {
                1 => format!("drive[{0}] = {sum}\nother[{0}] = {other}\n", state + 1),
                2 => format!("sum_{0} = {sum}\n{1}' = sum_{0} - {1} - 0.1*{1}*{other}\n", state + 1, name(state)),
                _ => format!("{0}' = {sum} - {0} - 0.1*{0}*{other}\n", name(state)),
            };
            couplings.push(all);
        }
        let names: Vec<String> = (0..count).map(name).collect();
        text += &format!("output {}\n", names.join(", "));
        let model = compiled(&text);
        let places: Vec<usize> =
            names.iter().map(|name| model.states.iter().position(|state| state.name == *name).unwrap()).collect();
        let mut hand =
            ByHand { order, step, count, couplings, courses: Vec::new(), states: start.clone(), start: start.clone() };
        for (number, row) in rows(&model).iter().enumerate() {
            for (state, place) in places.iter().enumerate() {
                let (is, should) = (row[*place], hand.states[state]);
                assert!((is - should).abs() < 1e-11, "{text}\nstep {number}: {is} in place of {should}");
            }
            hand.advance();
        }
    }
}

/// A state that jumps by an event is read later with its jump between two steps, and nowhere within one.
#[test]
fn a_jump_comes_later_as_it_was() {
    for solver in ["euler", "heun", "heun3", "rk4", "rkc5", "trapezoidal", "rodas3"] {
        let text = format!(
            "model m\nsolver {solver}\nstep 10 ms\nspan 1 s\nstate s = 0\nstate y = 0\ns' = 0\n\
             q = 2*s\ny' = 50*q(t - 70 ms)\nwhen time >= 0.2 {{ s = 1 }}\nwhen time >= 0.5 {{ s = 0.5 }}\noutput y, s\n"
        );
        let model = compiled(&text);
        let y = model.states.iter().position(|state| state.name == "y").unwrap();
        for (step, row) in rows(&model).iter().enumerate() {
            let time = step as f64 * 0.01;
            let area = (time - 0.27).clamp(0.0, 0.3) + 0.5 * (time - 0.57).max(0.0);
            assert!((row[y] - 100.0 * area).abs() < 1e-9, "{solver}, {time}: {} in place of {}", row[y], 100.0 * area);
        }
    }
}

/// An input is read later as the step then held it, and so is a signal of the model that jumps.
#[test]
fn inputs_are_read_later_as_they_were_held() {
    let signals =
        ["input u = pulse(1, 0.2 s, 0.3 s)", "u = pulse(1, 0.2 s, 0.3 s)", "w = pulse(2, 0.2 s, 0.3 s)\nu = w/2"];
    for (solver, signal) in ["euler", "rk4", "trapezoidal"].into_iter().flat_map(|s| signals.map(|signal| (s, signal)))
    {
        let text = format!(
            "model m\nsolver {solver}\nstep 10 ms\nspan 1 s\n{signal}\nstate y = 0\n\
             y' = 2*u(t - 10 ms) + u(t - 50 ms)\noutput y\n"
        );
        let model = compiled(&text);
        let y = model.states.iter().position(|state| state.name == "y").unwrap();
        for (step, row) in rows(&model).iter().enumerate() {
            let time = step as f64 * 0.01;
            let should = 2.0 * (time - 0.21).clamp(0.0, 0.3) + (time - 0.25).clamp(0.0, 0.3);
            assert!((row[y] - should).abs() < 1e-9, "{solver}, {signal}, {time}: {} in place of {should}", row[y]);
        }
    }
}

#[test]
fn a_delay_that_is_no_whole_number_of_steps_is_refused() {
    let model = compiled("model m\nsolver rk4\nstep 0.1\nspan 4\nstate x = 1\nx' = -x(t - 0.25)\noutput x\n");
    let findings = pe_hls::step::build(&model).unwrap_err();
    assert_eq!(findings[0].code, "E0930");
    assert!(findings[0].help.as_ref().is_some_and(|help| help.contains("8.333")), "{findings:?}");
    let model = compiled("model m\nsolver rk4\nstep 0.1\nspan 4\nstate x = 1\nx' = -x(t - 0.05)\noutput x\n");
    assert_eq!(pe_hls::step::build(&model).unwrap_err()[0].code, "E0930");
}

/// The step that is recommended is one, whatever the delays; each that does not fit is told.
#[test]
fn the_recommended_step_divides_all_delays() {
    let mut followed = 0;
    for (delays, step) in [
        (vec![0.037, 0.05], 0.01),
        (vec![0.03, 0.05], 0.02),
        (vec![0.03, 0.05, 0.1], 0.1),
        (vec![0.3, 0.7, 1.1], 0.013),
        (vec![0.003, 9.0], 0.002),
        (vec![2e-5, 2.0], 0.01),
    ] {
        let equation = |(place, delay): (usize, &f64)| {
            format!("state x{place} = 1\nx{place}' = -x{place}(t - {delay})\noutput x{place}\n")
        };
        let equations: String = delays.iter().enumerate().map(equation).collect();
        let mut model = compiled(&format!("model m\nsolver euler\nstep {step}\nspan 26\n{equations}"));
        let findings = pe_hls::step::build(&model).unwrap_err();
        assert!(findings.iter().all(|finding| finding.code == "E0930"), "{findings:?}");
        assert_eq!(findings.len(), delays.iter().filter(|delay| !divides(step, **delay)).count(), "{delays:?}");
        let help = findings[0].help.clone().unwrap();
        match help.split_once("--step ") {
            Some((_, step)) => {
                model.set_step(step.trim_end_matches('`').parse().unwrap());
                assert!(pe_hls::step::build(&model).is_ok(), "{delays:?}: {help}");
                followed += 1;
            }
            None => assert!(help.contains("no step divides all delays"), "{delays:?}: {help}"),
        }
    }
    assert_eq!(followed, 5);
}

fn divides(step: f64, delay: f64) -> bool {
    let steps = delay / step;
    steps > 0.5 && (steps - steps.round()).abs() < 1e-6 * steps
}

#[test]
fn all_engines_have_the_same_past() {
    let bodies = [
        "solver rk4\nstep 20 ms\nspan 6 s\nstate x = 0.9\nold = x(t - 0.4 s)\nx' = 2*x*(1 - old)\noutput x, old\n",
        // Of an array and an input, with events.
        "solver heun\nstep 10 ms\nspan 3 s\nindex i in 1..3\ninput u = sine(1, 1 Hz)\nstate x[i] = 0.1*i\nstate n = 0\n\
         n' = 0\nx[i]' = u(t - 50 ms) - x[i] - 0.5*x[1 + i mod 3](t - 0.01*(2*i)) + n(t - 30 ms)\n\
         when x[1] > 0.5 { n = 0.3; x[1] = 0 }\noutput x, n\n",
    ];
    for (number, body) in bodies.iter().enumerate() {
        let folder = Folder::new(&format!("delays_{number}"));
        let path = folder.0.join("delays.spec");
        fs::write(&path, format!("model delays\n{body}")).unwrap();
        let mut check = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        let output = check.arg("check").arg(&path).args(["--allow", "E0903"]).output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && told.contains("left out of these eigenvalues"), "{told}");
        assert_same_words(&path, "--pes 2 --allow E0903", if is_long_suite() { 150 } else { 80 }, 0.2);
    }
}

/// Words that move on for long arrive behind the end of the step where much else arrives.
#[test]
fn long_delays_go_onto_any_number_of_pes() {
    let folder = Folder::new("delays_long");
    for steps in [37, 100] {
        let text =
            format!("model long\nsolver rk4\nstep 1 ms\nspan 200 ms\nstate x = 1\nx' = -x(t - {steps} ms)\noutput x\n");
        fs::write(folder.0.join("long.spec"), text).unwrap();
        for pes in ["1", "2", "3", "5"] {
            for word in ["25x18 --coefficients two-slot", "32x32"] {
                let options = format!("compile long.spec --quiet --no-pictures -o out --pes {pes} --multiplier {word}");
                let output = Command::new(env!("CARGO_BIN_EXE_pe-synth"))
                    .args(options.split(' '))
                    .current_dir(&folder.0)
                    .output()
                    .unwrap();
                assert!(output.status.success(), "{steps} {options}: {}", String::from_utf8_lossy(&output.stderr));
            }
        }
    }
}

/// Rings of 32,768 words have no room in one PE, and none beside swapped states: they go onto two, and no rows of 16,400 words
/// are made.
#[test]
fn delays_of_many_steps_take_as_many_pes_as_their_rings_need() {
    for solver in ["rk4", "euler"] {
        let folder = Folder::new("delays_many");
        let text = format!(
            "model many\nsolver {solver}\nstep 60 us\nspan 1.02 s\nstate x = 1\nx' = -x(t - 0.984)\noutput x\n"
        );
        fs::write(folder.0.join("many.spec"), text).unwrap();
        let compile = "compile many.spec --quiet --no-pictures --proof off -o out";
        let output =
            Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(compile.split(' ')).current_dir(&folder.0).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{solver}: {}", String::from_utf8_lossy(&output.stderr));
        let report = fs::read_to_string(folder.0.join("out/report.json")).unwrap();
        let report: Value = serde_json::from_str(&report).unwrap();
        assert!(report["pes"].as_u64().unwrap() <= 4 && report["pes_default"] == true, "{report}");
        assert!(report["cycles_per_step"].as_u64().unwrap() < 50, "{report}");
    }
}
