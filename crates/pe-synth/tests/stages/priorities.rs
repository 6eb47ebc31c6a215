//! The order of events of one instant, against a queue that is sorted anew behind each of them.

use std::fs;
use std::process::Command;

use crate::support::bench::Folder;
use crate::support::written::{self, compiled, next};

const STATES: [&str; 4] = ["a", "b", "c", "d"];

/// Where a condition becomes true.
#[derive(Clone, Copy)]
enum Trigger {
    /// At a number of steps.
    Time(usize),
    /// Where a state is at least a number.
    Level(usize, f64),
}

/// A sum of states with factors, and a number.
type Sum = ([f64; 4], f64);

#[derive(Clone)]
struct Event {
    trigger: Trigger,
    priority: Option<Sum>,
    assignments: Vec<(usize, Sum)>,
    frozen: bool,
    cancelled: bool,
    delay: usize,
}

fn value((factors, constant): &Sum, states: &[f64; 4]) -> f64 {
    factors.iter().zip(states).map(|(factor, state)| factor * state).sum::<f64>() + constant
}

fn text((factors, constant): &Sum) -> String {
    let terms = factors.iter().zip(STATES).filter(|(factor, _)| **factor != 0.0);
    terms.fold(format!("{constant}"), |text, (factor, name)| format!("{text} + ({factor})*{name}"))
}

impl Event {
    fn text(&self) -> String {
        let mut text = match self.trigger {
            Trigger::Time(steps) => format!("when time >= {steps}*0.001"),
            Trigger::Level(state, least) => format!("when {} >= {least}", STATES[state]),
        };
        if self.delay > 0 {
            text += &format!(" after {} ms", self.delay);
        }
        for (says, word) in [(self.frozen, ", frozen"), (self.cancelled, ", cancelled")] {
            text += if says { word } else { "" };
        }
        if let Some(priority) = &self.priority {
            text += &format!(", priority {}", self::text(priority));
        }
        let assignments =
            self.assignments.iter().map(|(state, sum)| format!("{} = {}", STATES[*state], self::text(sum)));
        format!("{text} {{ {} }}\n", assignments.collect::<Vec<_>>().join("; "))
    }

    fn holds(&self, step: usize, states: &[f64; 4]) -> bool {
        match self.trigger {
            Trigger::Time(steps) => step >= steps,
            Trigger::Level(state, least) => states[state] >= least,
        }
    }

    fn values(&self, states: &[f64; 4]) -> Vec<f64> {
        self.assignments.iter().map(|(_, sum)| value(sum, states)).collect()
    }
}

/// The states of all steps, and the most events in one instant; none if one sets itself off, or is set off while it is due
/// more often than it `may`, where the language goes another way.
fn queued(events: &[Event], steps: usize, may: usize) -> Option<(Vec<[f64; 4]>, usize)> {
    let mut states = [0.0; 4];
    let mut held: Vec<bool> = events.iter().map(|event| event.holds(0, &states)).collect();
    let mut waiting: Vec<(usize, usize, Vec<f64>)> = Vec::new();
    let (mut rows, mut most) = (vec![states], 0);
    for step in 1..=steps {
        let mut due: Vec<Vec<Vec<f64>>> = vec![Vec::new(); events.len()];
        let mut set_off = |event: usize, states: &[f64; 4], due: &mut Vec<Vec<Vec<f64>>>| {
            let values = events[event].values(states);
            match events[event].delay {
                0 => {
                    due[event].push(values);
                    Some(())
                }
                delay => {
                    waiting.push((event, step + delay, values));
                    Some(())
                }
            }
        };
        for (event, own) in events.iter().enumerate() {
            let holds = own.holds(step, &states);
            if holds && !held[event] {
                set_off(event, &states, &mut due)?;
            }
            held[event] = holds;
        }
        let mut came = 0;
        waiting.retain(|(event, at, values)| {
            let (is_due, off) = (*at == step, events[*event].cancelled && !held[*event]);
            if is_due && !off {
                due[*event].push(values.clone());
            }
            !is_due && !off
        });
        loop {
            let priority =
                |event: usize| events[event].priority.as_ref().map_or(f64::NEG_INFINITY, |own| value(own, &states));
            let all = (0..events.len()).filter(|event| !due[*event].is_empty());
            let Some(first) = all.reduce(|one, other| if priority(other) > priority(one) { other } else { one }) else {
                break;
            };
            let kept = due[first].remove(0);
            let values = if events[first].frozen { kept } else { events[first].values(&states) };
            for ((state, _), value) in events[first].assignments.iter().zip(values) {
                states[*state] = value;
            }
            came += 1;
            for (event, own) in events.iter().enumerate() {
                let holds = own.holds(step, &states);
                if own.cancelled && !holds {
                    due[event].clear();
                }
                if holds && !held[event] {
                    // What is set off behind others with a delay is looked at in the next step.
                    if event == first || own.delay > 0 || due[event].len() > may {
                        return None;
                    }
                    due[event].push(own.values(&states));
                }
                held[event] = holds;
            }
            if came > 40 {
                return None;
            }
        }
        most = most.max(came);
        rows.push(states);
    }
    Some((rows, most))
}

fn random(seed: &mut u64, count: usize) -> Vec<Event> {
    let mut below = |most: f64| (next(seed) * most) as usize;
    let sum = |below: &mut dyn FnMut(f64) -> usize, least: f64| {
        let mut factors = [0.0; 4];
        factors[below(4.0)] = [-1.0, 0.5, 1.0, 2.0][below(4.0)];
        factors[below(4.0)] = [-0.5, 0.25, 1.0, -1.0][below(4.0)];
        (factors, least + below(4.0) as f64)
    };
    (0..count)
        .map(|place| {
            let target = below(4.0);
            let second = (target + 1 + below(3.0)) % 4;
            let mut assignments = vec![(target, sum(&mut below, 1.0))];
            if below(3.0) == 0 {
                assignments.push((second, sum(&mut below, -1.0)));
            }
            let trigger = match below(4.0) {
                0 if place > 0 => Trigger::Level(below(4.0), 1.0 + below(3.0) as f64),
                _ => Trigger::Time([3, 3, 5][below(3.0)]),
            };
            let priority = match below(5.0) {
                0 => None,
                1 => Some(([0.0; 4], below(4.0) as f64)),
                _ => Some(sum(&mut below, 0.0)),
            };
            let delay = if below(4.0) == 0 { 2 } else { 0 };
            Event { trigger, priority, assignments, frozen: below(3.0) == 0, cancelled: below(4.0) == 0, delay }
        })
        .collect()
}

fn rows(events: &[Event], steps: usize) -> Vec<Vec<f64>> {
    let states: String = STATES.iter().map(|name| format!("state {name} = 0\n{name}' = 0\n")).collect();
    let events: String = events.iter().map(Event::text).collect();
    let head = format!("model priorities\nsolver euler\nstep 1 ms\nspan {steps} ms\nunits off\n");
    written::rows(&compiled(&format!("{head}{states}{events}output a, b, c, d\n")))
}

#[test]
fn events_come_in_the_order_of_a_queue_that_is_sorted_behind_each() {
    const STEPS: usize = 9;
    let mut seed = 5;
    let (mut compared, mut ordered, mut set_off) = (0, 0, 0);
    for case in 0..400 {
        let events = random(&mut seed, 2 + case % 3);
        let Some((expected, most)) = queued(&events, STEPS, 0) else { continue };
        // More than there are passes for are looked at in the next step.
        let levels = events.iter().any(|event| matches!(event.trigger, Trigger::Level(..)));
        if most > events.len() {
            continue;
        }
        let found = rows(&events, STEPS);
        let spec: String = events.iter().map(Event::text).collect();
        for (step, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let near = found.iter().zip(expected).all(|(one, other)| (one - other).abs() <= 1e-9 * (1.0 + other.abs()));
            assert!(near, "case {case}, step {step}: {:?}, not {expected:?}\n{spec}", &found[..4]);
        }
        // Whether the order of priorities matters here.
        let plain: Vec<Event> = events.iter().map(|event| Event { priority: None, ..event.clone() }).collect();
        compared += 1;
        ordered += usize::from(queued(&plain, STEPS, 0).is_some_and(|(rows, _)| rows != expected));
        set_off += usize::from(levels);
    }
    println!("{compared} models compared; the order matters in {ordered}, {set_off} have events that states set off");
    assert!(compared > 200 && ordered > 60 && set_off > 40, "{compared}, {ordered}, {set_off}");
}

/// What is set off and has a higher priority comes before what was due already, also where priorities are numbers.
#[test]
fn what_is_set_off_comes_before_all_of_lower_priority() {
    let body = "model order\nsolver euler\nstep 1 ms\nspan 4 ms\nstate a = 0\nstate b = 0\na' = 0\nb' = 0\n\
                when time >= 0.002, priority 3 { a = 1 }\nwhen time >= 0.002, priority 1 { b = 10*b + 1 }\n\
                when a >= 1, priority 2 { b = 10*b + 2 }\noutput a, b\n";
    let rows = written::rows(&compiled(body));
    assert_eq!(rows[4][..2], [1.0, 21.0]);
}

/// Events that have nothing to do with one another need no order: what is written out is what it is without priorities.
#[test]
fn an_order_that_cannot_be_seen_costs_nothing() {
    let sizes = ["priority -x[i]", "priority 2", "initially"].map(|manner| {
        let body = format!(
            "model pools\nsolver euler\nstep 1 ms\nspan 10 ms\nindex i in 1..12\nstate x[i] = 0\nx[i]' = 100 + i\n\
             when x[i] >= 0.5, {manner} {{ x[i] = 0 }}\noutput x\n"
        );
        let model = compiled(&body);
        (model.states.len(), model.algebraics.len())
    });
    assert!(sizes[0] == sizes[1] && sizes[1] == sizes[2], "{sizes:?}");
}

/// A state that goes up and down several times in an instant, and events of lower priority that it sets off each time.
#[test]
fn what_is_set_off_again_before_it_comes_does_so_as_often() {
    const STEPS: usize = 6;
    let mut seed = 23;
    let (mut repeated, mut lost) = (0, 0);
    for case in 0..200 {
        let mut below = |most: f64| (next(&mut seed) * most) as usize;
        let swings = 2 + below(9.0);
        let mut events: Vec<Event> = (0..swings)
            .map(|place| Event {
                trigger: Trigger::Time(3),
                priority: Some(([0.0; 4], 40.0 - place as f64)),
                assignments: vec![(0, ([0.0; 4], [2.0, 0.0, 3.0][(place + below(1.5)) % 3]))],
                frozen: below(2.0) == 0,
                cancelled: false,
                delay: 0,
            })
            .collect();
        for place in 0..1 + below(3.0) {
            let target = 1 + place;
            let mut factors = [0.0; 4];
            factors[target] = 1.0;
            factors[below(4.0)] += 0.5;
            events.push(Event {
                trigger: Trigger::Level(0, 1.0),
                priority: Some(([0.0; 4], 20.5 - place as f64 - 20.0 * (below(4.0) as f64 / 3.0))),
                assignments: vec![(target, (factors, 1.0))],
                frozen: below(3.0) == 0,
                cancelled: below(4.0) == 0,
                delay: 0,
            });
        }
        let found = rows(&events, STEPS);
        let spec: String = events.iter().map(Event::text).collect();
        let lost_one = found.last().expect("steps")[4..].iter().any(|state| *state >= 16.0);
        let Some((expected, _)) = queued(&events, STEPS, 4) else {
            assert!(lost_one, "case {case}: an event is lost unseen\n{spec}");
            lost += 1;
            continue;
        };
        assert!(!lost_one, "case {case}\n{spec}");
        for (step, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let near = found.iter().zip(expected).all(|(one, other)| (one - other).abs() <= 1e-9 * (1.0 + other.abs()));
            assert!(near, "case {case}, step {step}: {:?}, not {expected:?}\n{spec}", &found[..4]);
        }
        repeated += usize::from(queued(&events, STEPS, 0).is_none());
    }
    println!(
        "{repeated} models in which an event is due more than once, {lost} with more of them than there are places"
    );
    assert!(repeated > 40, "{repeated}");
}

/// What cannot come as often as it is set off is told with its time and name.
#[test]
fn what_is_set_off_too_often_is_never_lost_unseen() {
    let swing =
        |place: usize| format!("when time >= 0.002, priority {} {{ a = {} }}\n", 30 - place, 2 * ((place + 1) % 2));
    let head = "model often\nsolver euler\nstep 1 ms\nspan 6 ms\nunits off\nstate a = 0\nstate b = 0\na' = 0\nb' = 0\n";
    for (swings, priority, is_lost) in
        [(9, "1", false), (11, "1", true), (3, "1", false), (3, "b", true), (1, "b", false)]
    {
        let all: String = (0..swings).map(swing).collect();
        let text = format!("{head}{all}when a > 1, priority {priority} {{ b = b + 1 }}\noutput a, b\n");
        let folder = Folder::new(&format!("often_{swings}_{priority}"));
        fs::write(folder.0.join("often.spec"), text).unwrap();
        let run = Command::new(env!("CARGO_BIN_EXE_pe-synth"))
            .args(["compile", "-q", "--no-pictures", "often.spec", "-o", "out"])
            .current_dir(&folder.0)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.success(), !is_lost, "{swings}, {priority}: {said}");
        let named = format!("`event_{}`", swings + 1);
        assert!(!is_lost || ["E0920", &named, "t = 2.000000e-3 s"].iter().all(|part| said.contains(part)), "{said}");
    }
}
