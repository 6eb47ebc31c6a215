//! Injected faults: the comparison catches each one that can show, the symbolic checker each one in the program.

use std::collections::BTreeMap;

use crate::support::Family;
use crate::support::bench::run;
use crate::support::faults::{Fault, KINDS, observe};
use crate::support::flow::{Flow, Placement, Start, format};
use pe_ir::index::PeId;
use pe_ir::model::Solver;
use pe_ir::verify;
use pe_ir::word::Pipeline;
use pe_sim::coverage::Coverage;
use pe_sim::trace::TraceLine;
use pe_verify::climb;
use pe_verify::coverage::resting;
use pe_verify::engines::{self, Engine, Run, compare};
use pe_verify::stimuli::{self, Observed};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Steps of every run.
const STEPS: u64 = 6;

/// Faults of each kind in each design.
const FAULTS: usize = 40;

/// Small designs that have every feature between them.
fn designs() -> Vec<Flow> {
    let flow = |family, size, solver, (storage, data, coefficient), seed| {
        Flow::random(family, size, solver, format(storage, data, coefficient), Placement::Scattered, seed)
    };
    vec![
        flow(Family::Shared, (6, 3), Solver::Euler, (32, 25, 18), 51),
        flow(Family::Polynomial, (4, 3), Solver::Rk4, (32, 25, 18), 52),
        flow(Family::Hub, (6, 4), Solver::Rk4, (32, 32, 32), 53),
        flow(Family::Affine, (7, 3), Solver::Euler, (18, 18, 25), 54),
        flow(Family::Stencil, (9, 2), Solver::Heun, (32, 25, 18), 55),
        Flow::tabled((8, 3), Solver::Heun, format(32, 25, 18), Placement::Scattered, 56),
        Flow::random(
            Family::Shared,
            (6, 3),
            Solver::Heun,
            format(32, 18, 18).with_pipeline(Pipeline::Deep),
            Placement::Scattered,
            57,
        ),
    ]
}

/// Number of injected faults, of those that can show, and of those that were caught.
#[derive(Default)]
struct Count {
    injected: u32,
    can_show: u32,
    caught: u32,
}

#[test]
fn the_comparison_catches_every_fault_that_can_show() {
    let mut counts: BTreeMap<&str, Count> = BTreeMap::new();
    for (index, flow) in designs().iter().enumerate() {
        let Start { program, stimulus, .. } = flow.middle(STEPS);
        let good = observe(&program, &stimulus);
        let expected = engines::simulate(&program, &stimulus, STEPS);
        let writes = program.writes_per_step() * STEPS;
        let mut rng = ChaCha8Rng::seed_from_u64(100 + index as u64);
        for number in 0..FAULTS * KINDS.len() {
            let fault = Fault::random(KINDS[number % KINDS.len()], &program, &mut rng);
            let faulty = fault.inject(&program);
            let can_show = observe(&faulty, &stimulus) != good;
            let run = engines::simulate(&faulty, &stimulus, STEPS);
            let caught = compare(&program, "faulty", &run, &expected, writes).is_err();
            assert_eq!(caught, can_show, "{}: {fault:?}", flow.label);
            let count = counts.entry(fault.kind()).or_default();
            count.injected += 1;
            count.can_show += u32::from(can_show);
            count.caught += u32::from(caught);
        }
    }
    for (kind, Count { injected, can_show, caught }) in &counts {
        println!("{kind}: {injected} injected, {can_show} can show, {caught} caught");
        assert!(*can_show > 20, "{kind}: too few faults show");
    }
    assert!(counts.values().map(|count| count.injected).sum::<u32>() >= 200);
}

#[test]
fn both_simulators_see_the_same() {
    for flow in designs() {
        for Start { program, stimulus, name, .. } in [flow.beginning(STEPS), flow.middle(STEPS)] {
            let simulated = engines::simulate(&program, &stimulus, STEPS);
            let observed = stimuli::observe(&program, &stimulus, STEPS);
            assert!(!observed.wrapped, "{}", flow.label);
            let writes = program.writes_per_step() * STEPS;
            compare(&program, &format!("{}, {name}", flow.label), &observed.run, &simulated, writes).unwrap();
            // What is at work is among what the control words can do, and in the middle it is nearly all of that.
            let possible = Coverage::of_program(&program);
            let mut all = possible.clone();
            all.add(&observed.coverage);
            assert_eq!(all, possible, "{}, {name}", flow.label);
            assert!(resting(&program, &observed.coverage).is_empty(), "{}, {name}", flow.label);
        }
    }
}

#[test]
fn a_result_that_is_too_large_is_found_and_shows_once_it_is_sent() {
    let mut found = 0;
    for flow in designs() {
        let program = flow.beginning(STEPS).program;
        let mut seen = Coverage::none(&program);
        while let Some(candidate) = climb::too_large_unsent(&program, 2, &seen) {
            let good = stimuli::observe(&candidate.program, &candidate.stimulus, 2);
            for (pe, cover) in good.coverage.pes.numbered() {
                let words = cover.unsent.iter().enumerate().filter(|(_, unsent)| **unsent);
                for (word, _) in words.filter(|(word, _)| !seen.pes[pe].unsent[*word]) {
                    let mut faulty = candidate.program.clone();
                    faulty.pes[pe].words[word].send = true;
                    let shown = stimuli::observe(&faulty, &candidate.stimulus, 2);
                    let flags = |observed: &Observed| (observed.run.flags.clone(), observed.overflow_cycle);
                    assert_ne!(flags(&shown), flags(&good), "{}: PE {pe}, word {word}", flow.label);
                    found += 1;
                }
            }
            let before = seen.unsent();
            seen.add(&good.coverage);
            assert!(seen.unsent() > before, "{}: a start shows nothing new", flow.label);
        }
    }
    println!("{found} results are too large");
    assert!(found > 20, "{found}");
}

#[test]
fn the_symbolic_checker_rejects_every_program_fault_that_can_show() {
    let (mut injected, mut can_show, mut rejected) = (0, 0, 0);
    for (index, flow) in designs().iter().enumerate() {
        let Start { program, stimulus, .. } = flow.middle(STEPS);
        let good = observe(&program, &stimulus);
        let mut rng = ChaCha8Rng::seed_from_u64(200 + index as u64);
        for _ in 0..3 * FAULTS {
            let fault = Fault::random("program bit", &program, &mut rng);
            let faulty = fault.inject(&program);
            injected += 1;
            if faulty == program || observe(&faulty, &stimulus) == good {
                continue;
            }
            can_show += 1;
            let violations = verify::program::check(&faulty, &flow.graph, &flow.fixed, 3);
            if violations.is_empty() {
                let Fault::ProgramBit { pe, word, .. } = fault else { unreachable!() };
                let (is, should) = (faulty.pes[pe].words[word], program.pes[pe].words[word]);
                println!("{}: {fault:?} passes: {is:?} instead of {should:?}", flow.label);
            }
            rejected += u32::from(!violations.is_empty());
        }
    }
    println!("checker: {injected} program bits flipped, {can_show} can show, {rejected} rejected");
    assert!(can_show >= 100);
    assert_eq!(rejected, can_show);
}

/// Program faults whose designs are built and run, and of these in GHDL as well.
const BUILT: usize = 24;
const BUILT_GHDL: usize = 6;

#[test]
fn a_fault_in_the_program_reaches_every_engine() {
    let flow = &designs()[1];
    let Start { program, stimulus, .. } = flow.middle(STEPS);
    let good = observe(&program, &stimulus);
    let expected = engines::simulate(&program, &stimulus, STEPS);
    let writes = program.writes_per_step() * STEPS;
    let mut rng = ChaCha8Rng::seed_from_u64(300);
    let mut compared = 0;
    let mut built = 0;
    while built < BUILT {
        let fault = Fault::random("program bit", &program, &mut rng);
        let faulty = fault.inject(&program);
        if observe(&faulty, &stimulus) == good {
            continue;
        }
        let own = engines::simulate(&faulty, &stimulus, STEPS);
        let own_writes = faulty.writes_per_step() * STEPS;
        let engines: &[Engine] =
            if built < BUILT_GHDL { &[Engine::Reference, Engine::Ghdl] } else { &[Engine::Reference] };
        for engine in engines {
            let (found, _folder) = run(*engine, &faulty, &stimulus, &format!("fault{built}"));
            compare(&faulty, engine.name(), &found, &own, own_writes).unwrap_or_else(|d| panic!("{fault:?}: {d}"));
            assert!(compare(&program, engine.name(), &found, &expected, writes).is_err(), "{fault:?} does not show");
            compared += 1;
        }
        built += 1;
    }
    println!("{built} faulty designs built, {compared} runs equal to the faulty simulator and not to the good one");
}

/// A correct run and what the comparison says after it was spoilt.
fn verdict(spoil: impl Fn(&mut Run)) -> Result<(), String> {
    let flow = Flow::random(Family::Affine, (3, 2), Solver::Rk4, format(32, 25, 18), Placement::Scattered, 61);
    let start = flow.beginning(STEPS);
    let expected = engines::simulate(&start.program, &start.stimulus, STEPS);
    let mut run = expected.clone();
    spoil(&mut run);
    compare(&start.program, "engine", &run, &expected, start.program.writes_per_step() * STEPS)
}

fn assert_refused(what: &str, message: &str, spoil: impl Fn(&mut Run)) {
    match verdict(spoil) {
        Ok(()) => panic!("{what} passes"),
        Err(text) => assert!(text.contains(message), "{what}: {text}"),
    }
}

#[test]
fn the_comparison_accepts_what_is_equal() {
    assert_eq!(verdict(|_| {}), Ok(()));
}

#[test]
fn the_comparison_refuses_lines_that_are_missing_or_too_many() {
    let last = |run: &Run| *run.trace.last().expect("the run has lines");
    assert_refused("a line dropped at the start", "first difference", |run| {
        run.trace.remove(0);
    });
    assert_refused("a line dropped at the end", "memory writes instead of", |run| {
        run.trace.truncate(run.trace.len() - 1)
    });
    assert_refused("a line too many", "memory writes instead of", |run| {
        run.trace.push(TraceLine { cycle: last(run).cycle + 1, ..last(run) });
    });
    assert_refused("a line twice", "memory writes instead of", |run| run.trace.push(last(run)));
    assert_refused("no lines at all", "nothing was compared", |run| run.trace.clear());
    assert_refused("nothing at all", "nothing was compared", |run| *run = Run::default());
}

#[test]
fn the_comparison_refuses_every_changed_field() {
    assert_refused("a changed value", "first difference", |run| run.trace[7].value ^= 1);
    assert_refused("a changed address", "first difference", |run| run.trace[7].address ^= 1);
    assert_refused("a changed PE", "first difference", |run| run.trace[7].pe = PeId::new(run.trace[7].pe.number() + 1));
    assert_refused("a changed cycle", "first difference", |run| run.trace[7].cycle += 1);
    assert_refused("a changed output", "output `x[0]`", |run| run.outputs[0].2 ^= 1);
    assert_refused("a missing output", "outputs instead of", |run| run.outputs.truncate(run.outputs.len() - 1));
    assert_refused("a missing output in front", "output `x[", |run| {
        run.outputs.remove(0);
    });
    assert_refused("another flag", "overflow flag", |run| run.overflow = !run.overflow);
    assert_refused("other clocks", "clocks per step", |run| run.clocks += 1);
}

#[test]
fn an_empty_run_is_refused_even_if_nothing_was_expected() {
    let flow = Flow::random(Family::Affine, (3, 1), Solver::Rk4, format(32, 25, 18), Placement::Scattered, 61);
    assert!(compare(&flow.program, "engine", &Run::default(), &Run::default(), 0).is_err());
}

#[test]
fn a_run_that_lost_a_line_on_both_sides_is_refused() {
    // Both engines could drop the same write; the count from the control words tells.
    let flow = Flow::random(Family::Affine, (3, 1), Solver::Rk4, format(32, 25, 18), Placement::Scattered, 61);
    let start = flow.beginning(STEPS);
    let mut run = engines::simulate(&start.program, &start.stimulus, STEPS);
    run.trace.remove(3);
    assert!(compare(&start.program, "engine", &run, &run, start.program.writes_per_step() * STEPS).is_err());
}
