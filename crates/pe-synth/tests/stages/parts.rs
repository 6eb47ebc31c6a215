//! One program for all parts of a step that are alike: bit for bit what the program of the whole step computes, in the simulators
//! and in all engines; what is not alike keeps its program, and faults are found.

use std::path::Path;

use crate::support::agree::engines;
use crate::support::bench::assert_lively_agreement;
use crate::support::flow::Start;
use crate::support::kept;
use crate::support::written::next;
use pe_flow::known::Known;
use pe_flow::pipeline::{self, Design, Prepared};
use pe_flow::settings::{MappingOptions, Settings, StageLoop};
use pe_flow::spec::{self, LoadedModel};
use pe_flow::watch::Stopwatch;
use pe_hls::rounds::Rounds;
use pe_ir::graph::{Factor, FixedPoint, Role, StepGraph};
use pe_ir::index::{EquationId, StateId, at};
use pe_ir::program::{Fold, Program};
use pe_ir::verify;
use pe_ir::word::Pipeline;
use pe_judge::{Criteria, DesignPoint};
use pe_sim::clocked::Clocked;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::{self, Machine};

fn loaded(text: &str) -> LoadedModel {
    let loaded = spec::load_text(Path::new("written.spec"), text, &Default::default());
    loaded.unwrap_or_else(|failure| panic!("{failure:?}\n{text}")).0
}

/// The design with one program for all parts, where they are alike, and that of the same step with one for the whole step.
fn designs(text: &str, point: &DesignPoint) -> (LoadedModel, Design, Design) {
    let loaded = loaded(text);
    let mapping = |stage_loop| MappingOptions { stage_loop, tries: Some(500), ..MappingOptions::default() };
    // A run in which little happens is as good as another.
    let criteria = Criteria { allow: vec!["E0903".into(), "E0907".into()], ..Criteria::default() };
    let settings = Settings { criteria, mapping: mapping(StageLoop::On), ..Settings::default() };
    let watch = &mut Stopwatch::silent();
    let prepared = pipeline::prepare(&loaded, &settings, point, watch);
    let Prepared { graph, judged, network } = prepared.unwrap_or_else(|failure| panic!("{failure:?}\n{text}"));
    let mut design = |stage_loop| {
        let options = mapping(stage_loop);
        let known = Known::default();
        pipeline::implement(&loaded, &graph, &judged, network.clone(), &options, &known, watch)
            .unwrap_or_else(|failure| panic!("{failure:?}\n{text}"))
    };
    let (parts, whole) = (design(StageLoop::On), design(StageLoop::Off));
    assert_eq!(whole.program.rounds, 1);
    (loaded, parts, whole)
}

/// Asserts that all words are those of the step graph, from a number of steps on, and that one program serves all parts.
fn assert_words(label: &str, design: &Design, loaded: &LoadedModel, (from, steps): (u64, u64)) {
    let (graph, program) = (&design.graph, &design.program);
    let stimulus = pipeline::stimulus(&loaded.model, design, 0, from + steps);
    let mut run = FixedRun::new(graph, &design.judged.fixed);
    stimulus[..from as usize].iter().for_each(|words| _ = run.step(words));
    let mut begun = program.clone();
    if from > 0 {
        for (register, (state, _)) in program.states.iter().zip(&graph.states) {
            register.set(&mut begun.pes, &begun.format, run.word(*state));
        }
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
            let word = machine::output_word(&design.judged.fixed.format, run.word(*value));
            assert_eq!(machine.outputs()[output], word, "{label}: output {output} of step {step}");
        }
    }
}

/// A row or a sheet of cells with a table, of two states, coupled with their neighbours; some without coupling or with another.
struct Tissue {
    solver: &'static str,
    rows: u32,
    columns: u32,
    /// Rows whose cells have no neighbours in their row.
    apart: Vec<u32>,
    /// Whether the coupling differs from row to row.
    uneven: bool,
}

impl Tissue {
    fn text(&self) -> String {
        let Tissue { solver, rows, columns, apart, uneven } = self;
        let beside = |condition: &str, other: &str| format!("(if {condition} then v[{other}] - v[i,j] else 0)");
        let coupled = apart.iter().map(|row| format!("i != {row}")).collect::<Vec<_>>().join(" and ");
        let within = |condition: &str, other: &str| {
            let condition =
                if coupled.is_empty() { condition.to_owned() } else { format!("{condition} and {coupled}") };
            beside(&condition, other)
        };
        let sum = [
            beside("i > 1", "i - 1,j"),
            beside("i < n", "i + 1,j"),
            within("j > 1", "i,j - 1"),
            within("j < m", "i,j + 1"),
        ];
        let strength = if *uneven { "(0.5 + 0.01*i)" } else { "0.5" };
        format!(
            "model m\nsolver {solver}\nstep 0.01\nspan 0.4\nconst n = {rows}\nconst m = {columns}\nindex i in 1..n\n\
             index j in 1..m\nstate v[i,j] = 0.3*i - 0.2*j in -6 .. 6\nstate w[i,j] = 0.1*j - 0.05*i in -4 .. 4\n\
             v[i,j]' = 2*exp(-v[i,j]^2) - v[i,j] - w[i,j] + {strength}*({})\n\
             w[i,j]' = (v[i,j] - w[i,j])/(2 + exp(-v[i,j]^2))\noutput v[1,1], w[n,m], v[n,1]\n",
            sum.join(" + ")
        )
    }
}

#[test]
fn parts_that_are_alike_compute_what_the_whole_step_computes() {
    let mut seed = 77;
    let (mut of_parts, mut of_whole, mut shared) = (0, 0, 0);
    for round in 0..16 {
        let solver = ["euler", "rush_larsen"][round % 2];
        let (rows, columns) = ([3, 5, 6, 9, 15, 4, 7, 10][round % 8], 1 + (4.0 * next(&mut seed)) as u32);
        let apart = if round % 5 == 4 { vec![1 + (f64::from(rows) * next(&mut seed)) as u32] } else { Vec::new() };
        let tissue = Tissue { solver, rows, columns, apart, uneven: round % 3 == 1 };
        let text = tissue.text();
        let pipeline = if round % 4 == 3 { Pipeline::Deep } else { Pipeline::Short };
        let pes = 1 + (4.0 * next(&mut seed)) as u32;
        let point = DesignPoint { pes: Some(pes), pipeline, ..DesignPoint::default() };
        let (loaded, parts, whole) = designs(&text, &point);
        let label = format!("round {round} on {pes} PEs, {pipeline:?}\n{text}");
        let text = parts.program.to_string();
        assert_eq!(text.parse::<Program>().unwrap().to_string(), text, "{label}");
        for design in [&parts, &whole] {
            assert_words(&label, design, &loaded, (0, 7));
            assert_words(&label, design, &loaded, (5, 4));
        }
        match parts.program.rounds {
            1 => of_whole += 1,
            rounds => {
                of_parts += 1;
                assert!(rows.is_multiple_of(rounds) || columns.is_multiple_of(rounds), "{label}");
                // What differs between the parts is in few sequences; most of the words are stored once.
                let folds = parts.program.pes.iter().map(|pe| Fold::of(&parts.program, pe));
                shared += folds.filter(|fold| fold.stream.is_empty() && !fold.repeated.is_empty()).count();
            }
        }
    }
    assert!(of_parts >= 8 && of_whole >= 1 && shared > 0, "{of_parts} in parts, {of_whole} whole, {shared} PEs");
}

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
fn all_engines_agree_on_rounds_of_parts_from_reset_and_from_the_middle() {
    let cases = [(3, 4, 2, Pipeline::Short, true), (5, 3, 2, Pipeline::Deep, true), (9, 2, 3, Pipeline::Short, false)];
    for (rows, columns, pes, pipeline, uneven) in kept(cases, 2) {
        let text = Tissue { solver: "rush_larsen", rows, columns, apart: Vec::new(), uneven }.text();
        let point = DesignPoint { pes: Some(pes), pipeline, ..DesignPoint::default() };
        let (loaded, parts, _) = designs(&text, &point);
        assert!(parts.program.rounds > 1, "{text}");
        // Columns make base memories deeper than own ones.
        assert!(parts.program.pes.iter().any(|pe| pe.features.own_words <= pe.features.base_words), "{text}");
        let starts = [start("beginning", &loaded, &parts, (0, 11)), start("middle", &loaded, &parts, (9, 10))];
        let label = format!("{rows} x {columns} cells on {pes} PEs, {pipeline:?}");
        let engines = engines(pipeline == Pipeline::Deep);
        let sum = assert_lively_agreement(&label, &starts, engines, 0.5);
        println!("{label}: {} memory writes and {} outputs equal", sum.writes, sum.outputs);
    }
}

/// A design in rounds of parts.
fn of_parts() -> Design {
    let text = Tissue { solver: "euler", rows: 9, columns: 2, apart: Vec::new(), uneven: false }.text();
    let (_, parts, _) = designs(&text, &DesignPoint { pes: Some(2), ..DesignPoint::default() });
    assert!(parts.program.rounds > 1);
    parts
}

#[test]
fn what_is_not_alike_has_no_rounds() {
    let design = of_parts();
    let (graph, fixed) = (&*design.graph, &design.judged.fixed);
    assert!(Rounds::of_parts(graph, fixed).is_some());
    let refused = |label: &str, change: &dyn Fn(&mut StepGraph, &mut FixedPoint)| {
        let (mut graph, mut fixed) = (graph.clone(), fixed.clone());
        change(&mut graph, &mut fixed);
        assert!(Rounds::of_parts(&graph, &fixed).is_none(), "{label}");
    };
    let last = |graph: &StepGraph| graph.chains.len() - 1;
    refused("another format", &|graph, fixed| fixed.exponents[graph.states[StateId::new(17)].0.index()] += 1);
    refused("another shift", &|graph, fixed| fixed.shifts.vec_mut()[last(graph)][0] += 1);
    refused("another product point", &|graph, fixed| fixed.products.vec_mut()[last(graph)] += 1);
    refused("another weight", &|graph, _| graph.chains.vec_mut().last_mut().unwrap().write.weight += 1);
    refused("another operand", &|graph, _| {
        let place = at(graph.chains.vec_mut().last().unwrap().terms.start);
        graph.terms[place].operand = graph.states[StateId::new(0)].0;
    });
    refused("a number in place of a value", &|graph, _| {
        let factor = graph.terms.iter().rposition(|term| matches!(term.factor, Factor::Value(_))).unwrap();
        graph.terms[factor].factor = Factor::Coefficient(1.0);
    });
    refused("another table", &|graph, _| {
        let other = graph.functions.tables[0].clone();
        graph.functions.tables.push(other);
        let table = graph.functions.tables.len() as u32 - 1;
        graph.functions.lookups.last_mut().unwrap().table = table;
    });
    refused("another constant", &|graph, _| {
        let constant = graph.values.iter().rposition(|value| matches!(value.role, Role::Constant(_))).unwrap();
        graph.values[constant].role = Role::Constant(1.5);
    });
    refused("another partner", &|graph, _| {
        let (count, of) = (graph.parts.count, &mut graph.parts.of);
        let last = EquationId::at(of.len() - 1);
        of[last] = ((of[last].0 + 1) % count, of[last].1);
    });
    refused("a term less", &|graph, _| graph.chains.vec_mut().last_mut().unwrap().terms.end -= 1);
}

/// What the checker of programs finds in one that was changed.
fn found(design: &Design, change: impl FnOnce(&mut Program)) -> Vec<String> {
    let mut program = design.program.clone();
    change(&mut program);
    assert_ne!(program, design.program, "the change changes something");
    verify::program::check(&program, &design.graph, &design.judged.fixed, 3)
}

#[test]
fn the_checker_finds_words_of_other_parts() {
    let design = of_parts();
    assert!(found(&design, |program| program.names.vec_mut().push("more".into())).is_empty());
    let stride = |program: &Program, pe: usize| {
        let states: Vec<u16> =
            program.states.iter().filter(|state| state.own.0.index() == pe).map(|state| state.own.1).collect();
        states.len() as u16 / program.rounds as u16
    };
    let length = design.program.round_words() as usize;
    // An operand, a base and a result of the part beside, in the second round alone.
    for what in 0..3 {
        let changed = found(&design, |program| {
            let step = stride(program, 0).next_power_of_two();
            let words = &mut program.pes.vec_mut()[0].words[length..2 * length];
            let swapped = words.iter_mut().find_map(|word| match what {
                0 => word.own.as_mut().filter(|own| own.swap).map(|own| &mut own.word),
                1 => word.base.as_mut().filter(|base| **base >= step && **base < 2 * step),
                _ => word.write.as_mut().filter(|write| write.address.swap).map(|write| &mut write.address.word),
            });
            *swapped.expect("a word of a state") ^= step;
        });
        assert!(!changed.is_empty(), "{what}");
    }
}
