//! Events: against solutions written by hand, and bit for bit through all engines.

use std::fs;
use std::process::Command;

use crate::support::agree::assert_same_words;
use crate::support::bench::Folder;
use crate::support::is_long_suite;
use crate::support::written::{self, compiled, graph_of, next};
use pe_ir::model::Model;
use pe_sim::double::DoubleRun;
use pe_sim::reference;

/// A model, and its states after each step.
fn rows(text: &str) -> (Model, Vec<Vec<f64>>) {
    let model = compiled(text);
    let rows = written::rows(&model);
    (model, rows)
}

fn spec(step: f64, body: &str) -> String {
    format!("model events\nsolver rk4\nstep {step}\nspan 2 s\n{body}")
}

/// A ramp that falls back to zero whenever it reaches 1, and a counter: the exact times are known.
#[test]
fn events_come_at_the_end_of_the_step_in_which_their_condition_becomes_true() {
    let mut seed = 3;
    for _ in 0..20 {
        let rate = 1.0 + 9.0 * next(&mut seed);
        let body =
            format!("state x = 0\nstate n = 0\nx' = {rate}\nn' = 0\nwhen x >= 1 {{ x = 0; n = n + 1 }}\noutput x, n\n");
        let (model, rows) = rows(&spec(1e-3, &body));
        let (mut x, mut n) = (0.0, 0.0);
        for (step, row) in rows.iter().enumerate().skip(1) {
            x += rate * model.step;
            if x >= 1.0 {
                (x, n) = (0.0, n + 1.0);
            }
            assert!((row[0] - x).abs() < 1e-9 && row[1] == n, "rate {rate}, step {step}: {row:?}, not {x} and {n}");
        }
        assert!(n >= 1.0, "something must happen");
    }
}

/// Growth with resets: the solution is known, and so is the order in which the error falls.
#[test]
fn refined_events_have_errors_of_second_order() {
    // x' = x + 1 from 0 reaches 1 at ln 2, and falls to 1/4; from there it takes ln(2/1.25).
    let exact = |time: f64| {
        let (first, period) = (std::f64::consts::LN_2, libm::log(2.0 / 1.25));
        if time < first { libm::exp(time) - 1.0 } else { 1.25 * libm::exp((time - first) % period) - 1.0 }
    };
    let error = |step: f64, manner: &str| {
        let body = format!("state x = 0\nx' = x + 1\nwhen x >= 1{manner} {{ x = 0.25 }}\noutput x\n");
        let (model, rows) = rows(&spec(step, &body));
        // Away from events, where the solution jumps.
        let at = (1.95 / model.step).round() as usize;
        (rows[at][0] - exact(at as f64 * model.step)).abs()
    };
    let worst = |step: f64, manner: &str| {
        let steps = [1.0, 0.93, 0.81, 0.77, 0.69].map(|part| error(0.001 * step * part, manner));
        steps.into_iter().fold(0.0, f64::max)
    };
    let (coarse, fine) = (worst(8.0, ", refine"), worst(2.0, ", refine"));
    let (late, later) = (worst(2.0, ""), worst(8.0, ""));
    println!("refined: {coarse:e} and {fine:e}; at steps: {later:e} and {late:e}");
    assert!(coarse / fine > 8.0, "a quarter of the step must leave a sixteenth: {coarse:e}, {fine:e}");
    assert!(later / late < 8.0 && late > 20.0 * fine, "{later:e}, {late:e}, {fine:e}");
}

#[test]
fn delays_priorities_and_manners_are_those_of_a_simulation_by_hand() {
    let mut seed = 11;
    let mut seen = 0.0;
    for case in 0..24 {
        let rate = 1.0 + 4.0 * next(&mut seed);
        let steps = 1 + (next(&mut seed) * 40.0) as usize;
        let (frozen, cancelled) = (case % 2 == 1, case % 4 >= 2);
        let manner = format!("{}{}", if frozen { ", frozen" } else { "" }, if cancelled { ", cancelled" } else { "" });
        // A triangle wave's half: x rises, falls back at 1, and a delayed event copies it.
        let body = format!(
            "state x = 0\nstate y = -1\nx' = {rate}\ny' = 0\n\
             when x >= 1 {{ x = 0 }}\nwhen x >= 0.5 after {} ms{manner} {{ y = x }}\noutput x, y\n",
            steps
        );
        let (model, rows) = rows(&spec(1e-3, &body));
        let (mut x, mut y, mut held) = (0.0f64, -1.0f64, false);
        let mut waiting: Vec<(usize, f64)> = Vec::new();
        for (step, row) in rows.iter().enumerate().skip(1) {
            x += rate * model.step;
            let condition = x >= 0.5;
            if cancelled && !condition {
                waiting.clear();
            }
            let due: Vec<(usize, f64)> = waiting.iter().filter(|(at, _)| *at == step).copied().collect();
            waiting.retain(|(at, _)| *at != step);
            if condition && !held {
                waiting.push((step + steps, x));
            }
            // The event without a delay stands first; both have no priority.
            let falls = x >= 1.0;
            if falls {
                x = 0.0;
            }
            let off = cancelled && falls;
            if let Some((_, kept)) = due.first().filter(|_| !off) {
                y = if frozen { *kept } else { x };
                seen += 1.0;
            }
            held = x >= 0.5;
            if cancelled && falls {
                waiting.clear();
            }
            assert!(
                (row[0] - x).abs() < 1e-9 && (row[1] - y).abs() < 1e-9,
                "case {case} ({manner}), {steps} steps, step {step}: {row:?}, not {x} and {y}"
            );
        }
    }
    assert!(seen > 20.0, "events must come: {seen}");
}

#[test]
fn events_of_one_instant_come_by_priority_and_set_one_another_off() {
    let body = "state a = 0\nstate b = 0\nstate c = 0\na' = 0\nb' = 0\nc' = 0\n\
                when time >= 1, priority 1 { a = 10*a + 1 }\n\
                when time >= 1, priority 2 { a = 10*a + 2 }\n\
                when a >= 2 { b = a }\nwhen b >= 2 { c = b + 1 }\noutput a, b, c\n";
    let (model, rows) = rows(&spec(1e-3, body));
    let at = |time: f64| &rows[(time / model.step).round() as usize];
    assert_eq!(at(0.999)[..3], [0.0, 0.0, 0.0]);
    // The higher priority first: 2, then 21; what they set off comes in the same instant.
    assert_eq!(at(1.0)[..3], [21.0, 21.0, 22.0]);
    assert_eq!(at(1.5)[..3], [21.0, 21.0, 22.0]);
}

#[test]
fn a_fifth_event_that_waits_is_never_lost_unseen() {
    let text = spec(
        1e-3,
        "state x = 0\nstate y = 0\nx' = 20\ny' = 0\nwhen x >= 1 { x = 0 }\n\
         when x >= 0.5 after 0.5 s { y = y + 1 }\noutput x, y\n",
    );
    let folder = Folder::new("events_lost");
    fs::write(folder.0.join("lost.spec"), text).unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_pe-synth"))
        .args(["compile", "-q", "lost.spec", "-o", "out"])
        .current_dir(&folder.0)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(!run.status.success() && said.contains("E0920") && said.contains("t = "), "{said}");
}

#[test]
fn all_engines_have_the_same_events() {
    let bodies = [
        // A spiking neuron.
        "state v = -65\nstate u = -13\nv' = 1000*(0.04*v^2 + 5*v + 150 - u)\nu' = 20*(0.2*v - u)\n\
         when v >= 30 { v = -65; u = u + 8 }\noutput v, u\n",
        // A ball that bounces, at the time that is found, on two PEs, with a counter that waits.
        "state x = 1\nstate v = 0\nstate n = 0\nx' = v\nv' = -9.81\nn' = 0\n\
         when x <= 0, refine { v = -0.8*v; x = 0 }\nwhen x <= 0 after 7 ms, frozen { n = n + 1 }\noutput x, v, n\n",
        // Three events whose order changes from time to time, and a fourth that they set off, on two PEs.
        "state x = 0\nstate a = 1\nstate b = 2\nstate n = 0\nx' = 90 - x\na' = -a\nb' = x - b\nn' = 0\n\
         when x >= 2, priority a { a = b + 0.5; n = n + 1 }\nwhen x >= 2, priority b { b = 0.5*a }\n\
         when x >= 2, refine, priority n - b { x = 0.25*a; n = 0.5*n }\nwhen n >= 0.75, priority 2*x - a { n = 0.125 }\noutput x, a, b, n\n",
        // A method of one stage, in which all states jump, and words before jumps are terms and bases at once.
        "index i in 1..7\nstate v[i] = 0\nv[i]' = 20 + i - v[i]\nwhen v[i] >= 1 + 0.1*i { v[i] = 0.01*i }\noutput v\n",
    ];
    for (number, body) in bodies.iter().enumerate() {
        let folder = Folder::new(&format!("events_{number}"));
        let text = spec(if number == 0 { 1e-5 } else { 1e-3 }, body).replace("span 2 s", "span 0.6 s");
        let text = if number == 3 { text.replace("solver rk4", "solver euler") } else { text };
        let path = folder.0.join("events.spec");
        fs::write(&path, text).unwrap();
        assert_same_words(
            &path,
            "--pes 2 --allow E0903",
            if is_long_suite() { 200 } else { [100, 100, 24, 100][number] },
            0.2,
        );
    }
}

#[test]
fn what_changes_by_jumps_alone_is_never_late() {
    let body = |manner: &str| {
        format!(
            "state x = 0\nstate n = 0\nstate m = 0\nx' = 7\nn' = 0\nm' = 0\nwhen x >= 1 {{ x = x - 1; n = n + 1 }}\n\
             when n >= 3{manner} {{ n = 0; m = m + 1 }}\noutput x, n, m\n"
        )
    };
    let (_, plain) = rows(&spec(1e-3, &body("")));
    let (_, refined) = rows(&spec(1e-3, &body(", refine")));
    assert!(plain.iter().zip(&refined).all(|(one, other)| one[..3] == other[..3]));
    assert_eq!(plain.last().expect("steps")[2], 4.0);
}

#[test]
fn choices_that_outputs_read_are_those_of_the_spec() {
    let body = "state n = 0\nn' = 0\nearly = if time <= 1 then 1 else 0\nwhen early < 0.5 { n = 1 }\noutput n, early\n";
    let model = compiled(&spec(1e-3, body));
    let graph = graph_of(&model);
    let mut run = DoubleRun::new(&graph);
    for step in 1..=1002u64 {
        run.step(&[]).expect("it is finite");
        let time = model.time(step, 0.0);
        assert_eq!(run.output(1), f64::from(u8::from(time <= 1.0)), "step {step}");
        assert_eq!(run.output(0), f64::from(u8::from(time > 1.0)), "step {step}");
    }
}

/// Delays count whole steps of whatever step a model takes, not of the spec's.
#[test]
fn a_delay_that_is_no_whole_number_of_steps_is_refused_at_every_step() {
    let delays = [0.003, 1.0, 0.01];
    let event = |(place, delay): (usize, &f64)| {
        format!(
            "state n{place} = 0\nn{place}' = 0\nwhen x > 0.{} after {delay} {{ n{place} = 1 }}\noutput n{place}\n",
            place + 1
        )
    };
    let events: String = delays.iter().enumerate().map(event).collect();
    let (mut fitted, mut refused) = (0, 0);
    for step in [1e-3, 5e-4, 2e-3, 3e-3, 2.5e-4, 4e-3, 5e-3, 1e-2, 1.5e-3] {
        let mut model = compiled(&spec(1e-3, &format!("state x = 0\nx' = 1\n{events}")));
        model.set_step(step);
        let whole = |delay: &&f64| ((**delay / step).round() * step - **delay).abs() < 1e-9;
        let should = delays.len() - delays.iter().filter(whole).count();
        let Err(findings) = pe_hls::step::build(&model) else {
            assert_eq!(should, 0, "{step}");
            fitted += 1;
            let rows = written::rows(&model);
            for (place, delay) in delays.iter().enumerate() {
                let name = format!("n{place}");
                let column = model.states.iter().position(|state| state.name == name).expect("it is a state");
                let first = rows.iter().position(|row| row[column] == 1.0).expect("it comes") as f64 * step;
                let should = 0.1 * (place as f64 + 1.0) + delay;
                assert!((-1e-9..=1.001 * step).contains(&(first - should)), "{name} comes at {first}, not {should}");
            }
            continue;
        };
        refused += 1;
        assert!(findings.iter().all(|finding| finding.code == "E0412" && finding.span.is_some()), "{findings:?}");
        assert_eq!(findings.len(), should, "{step}: {findings:?}");
        let help = findings[0].help.clone().unwrap_or_default();
        let (_, better) = help.split_once("--step ").unwrap_or_else(|| panic!("{help}"));
        model.set_step(better.trim_end_matches('`').parse().expect("a number"));
        assert!(model.step < step && pe_hls::step::build(&model).is_ok(), "{help}");
    }
    assert!(fitted >= 3 && refused >= 5, "{fitted} fit, {refused} refused");
}

/// A delay that is computed is rounded to whole steps, one at least, each time anew.
#[test]
fn a_computed_delay_leaves_nothing_behind() {
    for (delay, steps) in [(0.0023, 2), (0.0026, 3), (0.0002, 1), (0.0, 1), (-0.004, 1), (0.0041, 4)] {
        let body = format!(
            "state x = 0\nstate n = 0\nstate d = {delay}\nx' = 7.3\nn' = 0\nd' = 0\nwhen x >= 1 {{ x = 0 }}\n\
             when x > 0.5 after d {{ n = n + 1 }}\noutput x, n, d\n"
        );
        let (_, rows) = rows(&spec(1e-3, &body));
        let (mut due, mut fired, mut above) = (None, 0, false);
        for (step, pair) in rows.windows(2).enumerate() {
            if due == Some(step) {
                assert_eq!(pair[1][1], pair[0][1] + 1.0, "{delay} s at step {step}");
                fired += 1;
            } else {
                assert_eq!(pair[1][1], pair[0][1], "{delay} s at step {step}, due {due:?}");
            }
            let now = pair[1][0] > 0.5;
            if now && !above {
                due = Some(step + steps);
            }
            above = now;
        }
        assert!(fired >= 13, "{delay}: {fired}");
    }
}

/// The reference solution takes events when they are due, wherever steps end: so what being late costs is in the total error.
#[test]
fn the_reference_takes_delayed_events_at_their_times() {
    for (step, delay, computed) in [(1e-3, 0.003, false), (0.02, 0.06, false), (0.02, 0.047, true), (5e-3, 0.2, false)]
    {
        let after = if computed { "d".to_owned() } else { format!("{delay}") };
        let body = format!(
            "state x = 0\nstate y = 0\nstate n = 0\nstate d = {delay}\nx' = 3.7\ny' = n\nn' = 0\nd' = 0\n\
             when x >= 1 {{ x = 0 }}\nwhen x > 0.5 after {after} {{ n = n + 1 }}\noutput x, y, n\n"
        );
        let model = compiled(&spec(step, &body));
        let times: Vec<f64> = (1..=20).map(|sample| 0.1 * f64::from(sample)).collect();
        let solved = reference::solve(&model, &times, reference::TOLERANCE, &mut |_| {}).expect("it has a solution");
        let second = reference::solve_by_second_method(&model, &times, reference::TOLERANCE).expect("another one");
        let column = |name: &str| model.states.iter().position(|state| state.name == name).expect("it is a state");
        let mut largest = 0.0_f64;
        for (row, time) in times.iter().enumerate() {
            let fires = (0..).map(|event| (0.5 + f64::from(event)) / 3.7 + delay).take_while(|fires| fires < time);
            let should: f64 = fires.map(|fires| time - fires).sum();
            for states in [&solved.samples, &second.states.samples] {
                let y = states[row * model.states.len() + column("y")];
                assert!((y - should).abs() < 1e-9, "step {step}, after {after}: y({time}) is {y}, not {should}");
            }
            largest = largest.max(should);
        }
        assert!(largest > 3.0, "something must happen: {largest}");
    }
}

/// Events that wait at time zero wait as long with any step.
#[test]
fn what_waits_at_time_zero_is_counted_in_the_steps_of_the_run() {
    for delay in ["0.012", "d"] {
        let body = format!(
            "state n = 0\nstate d = 0.012\nn' = 0\nd' = 0\nwhen time >= 0 after {delay}, initially {{ n = 1 }}\noutput n\n"
        );
        for step in [1e-3, 2e-3, 4e-3, 5e-4] {
            let mut model = compiled(&spec(1e-3, &body));
            model.set_step(step);
            let rows = written::rows(&model);
            let first = rows.iter().position(|row| row[0] == 1.0).expect("it comes");
            assert!((first as f64 * step - 0.012).abs() < 1e-9, "after {delay}, step {step}: at step {first}");
        }
    }
}

/// Runs with half the step, which designs are judged by, wait as long.
#[test]
fn what_waits_at_time_zero_is_no_error_of_the_step() {
    let folder = Folder::new("events_waiting");
    for delay in ["0.12", "d"] {
        let body = format!(
            "state y = 0\nstate n = 0\nstate d = 0.12\ny' = n - 0.5*y\nn' = 0\nd' = 0\n\
             when time >= 0 after {delay}, initially {{ n = 1 }}\noutput y, n\n"
        );
        fs::write(folder.0.join("waiting.spec"), spec(1e-3, &body)).unwrap();
        let words = "compile waiting.spec --reference --quiet --no-pictures --message-format json -o out".split(' ');
        let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(words).current_dir(&folder.0).output().unwrap();
        assert!(output.status.success(), "after {delay}: {}", String::from_utf8_lossy(&output.stderr));
        let report = fs::read_to_string(folder.0.join("out/report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        let total = report["error"]["total"].as_f64().unwrap_or_else(|| panic!("{}", report["error"]));
        assert!(total < 1e-3, "after {delay}: {total}");
    }
}
