//! Rows of past words as rings: bit for bit what the rows compute, in the simulators and in all engines, and faults that the
//! checkers find.

use std::collections::BTreeMap;
use std::path::Path;

use crate::support::agree::engines;
use crate::support::bench::assert_lively_agreement;
use crate::support::flow::Start;
use crate::support::kept;
use crate::support::written::next;
use pe_flow::pipeline::{self, Design};
use pe_flow::settings::{MappingOptions, Settings};
use pe_flow::spec::{self, LoadedModel};
use pe_flow::watch::Stopwatch;
use pe_hls::rings::Choice;
use pe_ir::graph::{Factor, Role, StepGraph, Term, ValueId};
use pe_ir::index::StateId;
use pe_ir::model::Solver;
use pe_ir::pasts::Pasts;
use pe_ir::program::Program;
use pe_ir::verify;
use pe_ir::word::Pipeline;
use pe_judge::{Criteria, DesignPoint};
use pe_sim::clocked::Clocked;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::{self, Machine};

fn loaded(text: &str) -> LoadedModel {
    let loaded = spec::load_text(Path::new("written.spec"), text, &Default::default());
    loaded.unwrap_or_else(|failure| panic!("{failure:?}\n{text}")).0
}

fn design(loaded: &LoadedModel, point: &DesignPoint, rings: Choice) -> Design {
    let mapping = MappingOptions { rings, tries: Some(500), ..MappingOptions::default() };
    // A run in which little happens is as good as another.
    let criteria = Criteria { allow: vec!["E0903".into(), "E0907".into()], ..Criteria::default() };
    let settings = Settings { criteria, mapping, ..Settings::default() };
    let design = pipeline::design(loaded, &settings, point, &mut Stopwatch::silent());
    design.unwrap_or_else(|failure| panic!("{failure:?}\n{}", loaded.model.title))
}

/// Whether a design has rings.
fn has_rings(design: &Design) -> bool {
    design.program.pes.iter().any(|pe| pe.features.ring_bits > 0)
}

/// Asserts that a design with rings computes the words of the step with rows, from a number of steps on.
fn assert_words(label: &str, rows: &Design, rings: &Design, loaded: &LoadedModel, (from, steps): (u64, u64)) {
    let (graph, program) = (&rows.graph, &rings.program);
    let stimulus = pipeline::stimulus(&loaded.model, rows, 0, from + steps);
    let mut run = FixedRun::new(graph, &rows.judged.fixed);
    stimulus[..from as usize].iter().for_each(|words| _ = run.step(words));
    let mut begun = program.clone();
    if from > 0 {
        for (register, (state, _)) in program.states.iter().zip(&graph.states) {
            register.set(&mut begun.pes, &begun.format, run.word(*state));
        }
        begun.start_ticks(from);
    }
    let (mut machine, mut clocked) = (Machine::new(&begun), Clocked::new(&begun));
    for (step, words) in (from..).zip(&stimulus[from as usize..]) {
        run.step(words);
        let (mut fast, mut slow) = (Vec::new(), Vec::new());
        machine.step(words, &mut |line| fast.push(line));
        clocked.step(words, &mut |line| slow.push(line));
        fast.sort_unstable();
        slow.sort_unstable();
        assert_eq!(fast, slow, "{label}: memory writes of step {step}");
        for (index, (state, _)) in graph.states.iter().enumerate() {
            let id = StateId::at(index);
            let name = &graph.names.states[id];
            assert_eq!(machine.state(id), run.word(*state), "{label}: `{name}` after step {step}");
            assert_eq!(clocked.state(id), run.word(*state), "{label}: `{name}` after step {step}, clock by clock");
        }
        for (output, value) in graph.outputs.iter().enumerate() {
            let word = machine::output_word(&rows.judged.fixed.format, run.word(*value));
            assert_eq!(machine.outputs()[output], word, "{label}: output {output} of step {step}");
        }
    }
    let mut ringed = FixedRun::new(&rings.graph, &rings.judged.fixed);
    for (step, words) in stimulus.iter().enumerate() {
        ringed.step(words);
        if step + 1 == stimulus.len() {
            let words = |run: &FixedRun, design: &Design| -> Vec<i64> {
                design.graph.states.iter().map(|(state, _)| run.word(*state)).collect()
            };
            assert_eq!(words(&ringed, rings), words(&run, rows), "{label}: the step with rings");
        }
    }
}

const SOLVERS: [Solver; 17] = [
    Solver::Euler,
    Solver::SymplecticEuler,
    Solver::Leapfrog,
    Solver::RushLarsen,
    Solver::Exact,
    Solver::Rk4,
    Solver::Heun,
    Solver::Heun3,
    Solver::Ab2,
    Solver::Ab3,
    Solver::Ab4,
    Solver::Rkc5,
    Solver::Rkc10,
    Solver::ImplicitEuler,
    Solver::Trapezoidal,
    Solver::Ros2,
    Solver::Rodas3,
];

/// A model of coupled states that read several of the others as they were, one to `longest` steps ago.
fn generated(solver: Solver, longest: u32, seed: &mut u64) -> String {
    let count = 1 + (4.0 * next(seed)) as usize;
    let mut delay = || 1 + (f64::from(longest) * next(seed)) as u32;
    let delays: Vec<u32> = (0..4).map(|_| delay()).collect();
    let step = 0.01;
    let span = step * f64::from(2 * longest + 20);
    let mut text = format!("model m\nsolver {}\nstep {step}\nspan {span}\ndrive = sine(1, 0.5 Hz)\n", solver.name());
    for state in 0..count {
        let (own, other) = (delays[state % 4], delays[(state + 1) % 4]);
        let before = (state + count - 1) % count;
        let begin = 2.0 * next(seed) - 1.0;
        text += &format!("state x{state} = {begin}\n");
        let past = |name: String, steps: u32| format!("{name}(t - {})", step * f64::from(steps));
        let coupled = past(format!("x{before}"), other);
        let pull = format!("-0.6*{} - 0.4*x{state} + 0.3*{coupled} + 0.2*drive", past(format!("x{state}"), own));
        text += &match solver {
            Solver::SymplecticEuler | Solver::Leapfrog => {
                format!("state v{state} = 0.1\nx{state}' = v{state}\nv{state}' = {pull}\n")
            }
            Solver::RushLarsen => {
                let opening = format!("1/(1 + exp(-x{before}))");
                let gate = format!("state g{state} = 0.3\ng{state}' = ({opening} - g{state})/0.3\n");
                format!("{gate}x{state}' = {pull} + 0.1*{}\n", past(format!("g{state}"), own))
            }
            _ => format!("x{state}' = {pull}\n"),
        };
        text += &format!("output x{state}\n");
        if matches!(solver, Solver::SymplecticEuler | Solver::Leapfrog | Solver::RushLarsen | Solver::Exact) {
            continue;
        }
        if state % 2 == 1 {
            text += &format!("p{state} = x{state}*x{before}\nstate y{state} = 0.1\n");
            text += &format!("y{state}' = {} - y{state}\noutput y{state}\n", past(format!("p{state}"), own));
        }
    }
    text
}

/// Compares generated designs; returns how many have rings, by their methods.
fn compared(rounds: std::ops::Range<usize>, longest: u32) -> BTreeMap<&'static str, usize> {
    let mut seed = 5 + rounds.start as u64;
    let mut ringed = BTreeMap::new();
    for round in rounds {
        let solver = SOLVERS[round % SOLVERS.len()];
        let text = generated(solver, longest, &mut seed);
        let loaded = loaded(&text);
        let pes = 1 + (8.0 * next(&mut seed)) as u32;
        let pipeline = if round % 3 == 2 { Pipeline::Deep } else { Pipeline::Short };
        let point = DesignPoint { pes: Some(pes), pipeline, ..DesignPoint::default() };
        let rows = design(&loaded, &point, Choice::Chains);
        assert!(!has_rings(&rows));
        assert_words(&format!("round {round}, chains\n{text}"), &rows, &rows, &loaded, (0, 40));
        for choice in [Choice::Rings, Choice::Copies, Choice::ByCost] {
            let label = format!("{} round {round}, {choice:?} on {pes} PEs\n{text}", solver.name());
            let rings = design(&loaded, &point, choice);
            if !has_rings(&rings) {
                continue;
            }
            *ringed.entry(solver.name()).or_insert(0) += 1;
            assert!(pe_ir::verify::step::check(&rings.graph).is_empty(), "{label}");
            let text = rings.program.to_string();
            assert_eq!(text.parse::<Program>().unwrap().to_string(), text, "{label}");
            // As far as counters come round.
            let oldest = Pasts::of(&rings.graph).heads().map(|(_, oldest)| oldest).max().unwrap_or(0);
            assert_words(&label, &rows, &rings, &loaded, (0, u64::from(2 * oldest + 5)));
            assert_words(&label, &rows, &rings, &loaded, (u64::from(oldest / 2 + 3), u64::from(oldest + 7)));
        }
    }
    println!("{} designs with rings: {ringed:?}", ringed.values().sum::<usize>());
    ringed
}

#[test]
fn rings_compute_what_rows_compute_with_all_methods() {
    let ringed = compared(0..34, 12);
    assert_eq!(ringed.len(), SOLVERS.len(), "every method has rings: {ringed:?}");
}

#[test]
fn long_rings_compute_what_rows_compute() {
    assert!(!compared(39..45, 300).is_empty());
}

/// A step in double precision, value by value, as the graph says it.
fn by_hand(graph: &StepGraph, values: &mut [f64], inputs: &[f64]) {
    graph.inputs.iter().zip(inputs).for_each(|(input, number)| values[input.index()] = *number);
    for chain in &graph.chains {
        let mut sum = 0.0;
        let coefficients = |term: &&Term| matches!(term.factor, Factor::Coefficient(_));
        let (constant, products): (Vec<&Term>, Vec<&Term>) = graph.chain_terms(chain).iter().partition(coefficients);
        for term in constant.into_iter().chain(products) {
            sum += values[term.operand.index()]
                * match term.factor {
                    Factor::Coefficient(coefficient) => coefficient,
                    Factor::Value(value) => values[value.index()],
                };
        }
        for write in chain.writes() {
            let base = write.base.map_or(0.0, |base| values[base.index()]);
            let result = base + libm::scalbn(1.0, write.weight) * sum;
            let function = chain.function.map(|function| &graph.functions.exact[function as usize]);
            values[write.value.index()] = function.map_or(result, |function| function.evaluate(result));
        }
    }
    let next: Vec<f64> = graph.states.iter().map(|(_, end)| values[end.index()]).collect();
    graph.states.iter().zip(next).for_each(|((start, _), number)| values[start.index()] = number);
}

/// Runs do not move long rows of the past, and nothing that they tell may show it, even as states are put elsewhere.
#[test]
fn runs_in_double_precision_have_the_past_that_the_graph_states() {
    let mut seed = 77;
    for round in 0..2 * SOLVERS.len() {
        let solver = SOLVERS[round % SOLVERS.len()];
        let text = generated(solver, 70, &mut seed);
        let model = loaded(&text).model;
        let graph = pe_hls::step::build(&model).unwrap_or_else(|findings| panic!("{findings:#?}\n{text}"));
        let mut values = vec![0.0; graph.values.len()];
        for (index, value) in graph.values.iter().enumerate() {
            if let Role::Constant(number) = value.role {
                values[index] = number;
            }
        }
        graph.states.iter().zip(&graph.initial).for_each(|((start, _), number)| values[start.index()] = *number);
        let (mut run, mut largest) = (DoubleRun::new(&graph), vec![0.0f64; values.len()]);
        for step in 0..180 {
            if step % 50 == 20 {
                for state in graph.states.ids() {
                    let number = next(&mut seed);
                    if number > 0.2 {
                        continue;
                    }
                    values[graph.states[state].0.index()] = number;
                    run.set_state(state, number);
                }
            }
            graph.states.iter().for_each(|(start, _)| {
                let number = values[start.index()].abs();
                largest[start.index()] = largest[start.index()].max(number);
            });
            let inputs = model.sample_inputs(model.time(step, 0.0));
            by_hand(&graph, &mut values, &inputs);
            run.step(&inputs).unwrap_or_else(|diverged| panic!("{diverged:?}\n{text}"));
            for (index, number) in values.iter().enumerate() {
                let name = graph.value_name(ValueId::at(index));
                assert_eq!(run.value(index), *number, "{} round {round}, step {step}: {name}\n{text}", solver.name());
            }
            let states: Vec<f64> = graph.states.iter().map(|(start, _)| values[start.index()]).collect();
            assert_eq!(run.states().collect::<Vec<f64>>(), states);
        }
        let told = run.largest();
        assert!(largest.iter().zip(&told).all(|(largest, told)| largest <= told), "{text}");
    }
}

/// A delay of a hundred steps in a model that no PE can hurry.
const LONG: &str = "model m\nsolver rk4\nstep 0.01\nspan 4\nstate x = 1\nx' = -x(t - 1)\nstate y = 0.5\n\
    y' = x(t - 0.37) - y*y(t - 0.2)\noutput x, y\n";

fn start(name: &'static str, loaded: &LoadedModel, design: &Design, (step, steps): (u64, u64)) -> Start {
    let mut program = design.program.clone();
    let stimulus = pipeline::stimulus(&loaded.model, design, 0, step + steps);
    let mut run = FixedRun::new(&design.graph, &design.judged.fixed);
    stimulus[..step as usize].iter().for_each(|words| _ = run.step(words));
    for (register, (state, _)) in program.states.iter().zip(&design.graph.states) {
        register.set(&mut program.pes, &program.format, run.word(*state));
    }
    Start { name, program, stimulus: stimulus[step as usize..].to_vec(), step }
}

#[test]
fn all_engines_agree_on_rings_from_reset_and_from_the_middle() {
    let loaded = loaded(LONG);
    let cases =
        [(3, Pipeline::Short, Choice::Rings), (4, Pipeline::Deep, Choice::Copies), (1, Pipeline::Short, Choice::Rings)];
    for (pes, pipeline, choice) in kept(cases, 2) {
        let point = DesignPoint { pes: Some(pes), pipeline, ..DesignPoint::default() };
        let design = design(&loaded, &point, choice);
        assert!(has_rings(&design));
        let starts = [start("beginning", &loaded, &design, (0, 120)), start("middle", &loaded, &design, (170, 60))];
        let label = format!("rings on {pes} PEs, {pipeline:?}");
        let engines = engines(pipeline == Pipeline::Deep);
        let sum = assert_lively_agreement(&label, &starts, engines, 0.5);
        println!("{label}: {} memory writes and {} outputs equal", sum.writes, sum.outputs);
    }
}

/// What the checker of programs finds in one that was changed.
fn found(design: &Design, change: impl FnOnce(&mut Program)) -> Vec<String> {
    let mut program = design.program.clone();
    change(&mut program);
    assert_ne!(program, design.program, "the change changes something");
    verify::program::check(&program, &design.graph, &design.judged.fixed, 3)
}

#[test]
fn the_checker_finds_wrong_ages_and_rings() {
    let loaded = loaded(LONG);
    for pes in [1, 3] {
        let point = DesignPoint { pes: Some(pes), ..DesignPoint::default() };
        let design = design(&loaded, &point, Choice::Rings);
        assert_eq!(found_nothing(&design), [""; 0]);
        // Every read of a ring with an age that is off by one, in either direction.
        let mut reads = 0;
        for pe in design.program.pes.ids() {
            let mask = (1u16 << design.program.pes[pe].features.ring_bits).wrapping_sub(1);
            for word in 0..design.program.period as usize {
                for other in [1, mask] {
                    let moved = |word: u16| word & !mask | word.wrapping_add(other) & mask;
                    let control = design.program.pes[pe].words[word];
                    if control.own.is_some_and(|address| address.ring) {
                        let change = |program: &mut Program| {
                            let own = program.pes[pe].words[word].own.as_mut().expect("it is there");
                            own.word = moved(own.word);
                        };
                        assert!(!found(&design, change).is_empty(), "PE {pe}, word {word}: an own read of another age");
                        reads += 1;
                    }
                    if control.imported.is_some_and(|address| address.ring) {
                        let change = |program: &mut Program| {
                            let imported = program.pes[pe].words[word].imported.as_mut().expect("it is there");
                            imported.word = moved(imported.word);
                        };
                        assert!(!found(&design, change).is_empty(), "PE {pe}, word {word}: an import of another age");
                        reads += 1;
                    }
                    if control.write.is_some_and(|target| target.address.ring) {
                        let change = |program: &mut Program| {
                            let target = program.pes[pe].words[word].write.as_mut().expect("it is there");
                            target.address.word = moved(target.address.word);
                        };
                        assert!(!found(&design, change).is_empty(), "PE {pe}, word {word}: written a place further");
                        let still = |program: &mut Program| {
                            let target = program.pes[pe].words[word].write.as_mut().expect("it is there");
                            target.address.ring = false;
                        };
                        assert!(!found(&design, still).is_empty(), "PE {pe}, word {word}: written without the counter");
                    }
                    if let Some((port, address)) = control.receive.filter(|(_, address)| address.ring) {
                        let change = |program: &mut Program| {
                            let place = pe_ir::program::Address { word: moved(address.word), ..address };
                            program.pes[pe].words[word].receive = Some((port, place));
                        };
                        assert!(!found(&design, change).is_empty(), "PE {pe}, word {word}: received a place further");
                    }
                }
            }
        }
        assert!(reads > 4, "{reads} reads of rings");
        // Rings that are too short, counters that stand still, and two rings in one place.
        for pe in design.program.pes.ids().filter(|pe| design.program.pes[*pe].features.ring_bits > 0) {
            let shorter = |program: &mut Program| program.pes[pe].features.ring_bits -= 1;
            assert!(!found(&design, shorter).is_empty(), "PE {pe}: a ring that is too short");
            let still = |program: &mut Program| {
                for word in &mut program.pes[pe].words {
                    let own = word.own.iter_mut().chain(&mut word.imported);
                    own.for_each(|address| address.ring = false);
                }
            };
            assert!(!found(&design, still).is_empty(), "PE {pe}: reads without the counter");
            let size = 1u16 << design.program.pes[pe].features.ring_bits;
            let joined = |program: &mut Program| {
                let writes = program.pes[pe].words.iter_mut().filter_map(|word| word.write.as_mut());
                let rings: Vec<_> = writes.filter(|target| target.address.ring).collect();
                let first = rings.iter().map(|target| target.address.word / size).min();
                for target in rings {
                    target.address.word = target.address.word % size + first.unwrap_or(0) * size;
                }
            };
            let mut joins = design.program.clone();
            joined(&mut joins);
            if joins != design.program {
                assert!(!found(&design, joined).is_empty(), "PE {pe}: two rings in one place");
            }
        }
        let aged = |program: &mut Program| {
            let state = program.states.iter_mut().find(|state| state.age.is_some()).expect("rings");
            state.age = None;
        };
        assert!(!found(&design, aged).is_empty(), "a state without an age");
    }
}

fn found_nothing(design: &Design) -> Vec<String> {
    verify::program::check(&design.program, &design.graph, &design.judged.fixed, 3)
}

#[test]
fn few_steps_stay_rows_and_many_become_rings() {
    let few = loaded("model m\nsolver rk4\nstep 0.1\nspan 4\nstate x = 1\nx' = -x(t - 0.3)\noutput x\n");
    let point = DesignPoint { pes: Some(1), ..DesignPoint::default() };
    assert!(!has_rings(&design(&few, &point, Choice::ByCost)));
    let long = loaded(LONG);
    assert!(has_rings(&design(&long, &point, Choice::ByCost)));
}
