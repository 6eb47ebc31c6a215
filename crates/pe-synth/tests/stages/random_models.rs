//! Random models through every stage up to the simulator.

use crate::support::flow::{Flow, Placement, Start, format};
use crate::support::{AFFINE_FAMILIES, FAMILIES, Family};
use pe_ir::graph::StageForm;
use pe_ir::model::Solver;
use pe_ir::program::{Layout, Program};
use pe_ir::word::Pipeline;
use pe_sim::machine::Machine;
use pe_sim::trace;

/// Steps of every comparison.
const STEPS: u64 = 20;

/// Widths, and the (states, PEs, placement) that each family runs in them. One PE, and more PEs than most models fill.
const WIDE: [(u32, u32, u32); 2] = [(32, 32, 32), (32, 25, 18)];
const SIZES: [(usize, u32, Placement); 4] = [
    (3, 1, Placement::Scattered),
    (8, 3, Placement::Annealed),
    (30, 5, Placement::Scattered),
    (25, 11, Placement::Annealed),
];
const NARROW: [(u32, u32, u32); 4] = [(18, 18, 25), (18, 18, 18), (40, 35, 35), (17, 25, 18)];
const NARROW_SIZES: [(usize, u32, Placement); 1] = [(12, 4, Placement::Annealed)];

/// Forms of affine models besides Horner's rule.
const FORMS: [(Solver, StageForm); 5] = [
    (Solver::Heun, StageForm::Full),
    (Solver::Heun3, StageForm::Factors),
    (Solver::Heun3, StageForm::Full),
    (Solver::Rk4, StageForm::Factors),
    (Solver::Rk4, StageForm::Full),
];

/// Families that are not affine, whose stages may be sums of one scale.
const SUMS_FAMILIES: [Family; 3] = [Family::Polynomial, Family::Shared, Family::Stencil];

/// What was compared.
#[derive(Default)]
struct Tally {
    designs: u32,
    compared: u64,
    pairs: u64,
    looped: u32,
    looped_pairs: u64,
}

impl Tally {
    /// Checks a design, and once more with its stages looped if they are alike.
    fn take(&mut self, flow: &Flow, check: impl Fn(&Flow) -> u64) {
        let count = check(flow);
        assert!(count > 0, "{}: nothing was compared", flow.label);
        self.designs += 1;
        self.compared += count;
        self.pairs += flow.pairs;
        if let Some(flow) = flow.looped() {
            self.compared += check(&flow);
            self.looped += 1;
            self.looped_pairs += flow.pairs;
        }
    }
}

/// Runs `check` on every family, solver and width; prints how many words it compared.
fn on_all_designs(what: &str, check: impl Fn(&Flow) -> u64) {
    let mut tally = Tally::default();
    let cases = [(&WIDE[..], &SIZES[..]), (&NARROW[..], &NARROW_SIZES[..])];
    for (widths, sizes) in cases {
        for (storage, data, coefficient) in widths {
            for family in FAMILIES {
                for solver in Solver::RUNGE_KUTTA {
                    for (seed, (states, pes, placement)) in (1..).zip(sizes) {
                        let format = format(*storage, *data, *coefficient);
                        let flow = Flow::random(family, (*states, *pes), solver, format, *placement, seed);
                        tally.take(&flow, &check);
                    }
                }
            }
        }
    }
    for (storage, data, coefficient) in [(32, 18, 18), (32, 32, 32)] {
        for (family, solver) in FAMILIES.into_iter().zip(Solver::RUNGE_KUTTA.into_iter().cycle()) {
            for (seed, (states, pes, placement)) in (1..).zip(SIZES) {
                let format = format(storage, data, coefficient).with_pipeline(Pipeline::Deep);
                let flow = Flow::random(family, (states, pes), solver, format, placement, seed);
                tally.take(&flow, &check);
            }
        }
    }
    let affine = AFFINE_FAMILIES.into_iter().flat_map(|family| FORMS.map(|form| (family, form)));
    let sums = [(Solver::Heun, StageForm::Sums), (Solver::Rk4, StageForm::Sums)];
    let sums = SUMS_FAMILIES.into_iter().flat_map(|family| sums.map(|form| (family, form)));
    let formed: Vec<_> = affine.chain(sums).collect();
    for (storage, data, coefficient) in WIDE {
        for &(family, (solver, form)) in &formed {
            for (seed, (states, pes, placement)) in (1..).zip(SIZES) {
                let format = format(storage, data, coefficient);
                let flow = Flow::formed((family, form), (states, pes), solver, format, placement, seed);
                tally.take(&flow, &check);
            }
        }
    }
    let mut entries = 0;
    for (widths, sizes) in cases {
        for (storage, data, coefficient) in widths {
            for solver in Solver::RUNGE_KUTTA {
                for (seed, (states, pes, placement)) in (1..).zip(sizes) {
                    let format = format(*storage, *data, *coefficient);
                    let flow = Flow::tabled((*states, *pes), solver, format, *placement, seed);
                    assert!(flow.looped().is_none(), "{}: stages with lookups", flow.label);
                    tally.take(&flow, &check);
                    let words = flow.program.pes.iter().flat_map(|pe| &pe.words);
                    entries += words.filter(|word| word.index.is_some()).count();
                }
            }
        }
    }
    let Tally { designs, compared, pairs, looped, looped_pairs } = tally;
    println!(
        "{what}: {designs} designs, {looped} of them looped as well, {compared} comparisons, {pairs} pairs, \
         {looped_pairs} looped, {entries} entries looked up"
    );
    assert!(pairs > 4_000, "{pairs} pairs");
    assert!(entries > 2_000, "{entries} entries");
    assert!(looped > 0, "{what}: no stages are alike");
    assert!(looped_pairs > 2_000, "{what}: {looped_pairs} pairs in looped designs");
}

/// Compares state words and outputs of machine and fixed-point run, step after step; returns the words compared.
fn compare_steps(flow: &Flow, start: &Start) -> u64 {
    let mut machine = Machine::new(&start.program);
    let mut reference = flow.fixed_run(start.step);
    let mut untraced = Machine::new(&start.program);
    let mut checksums = vec![0; start.program.pes.len()];
    let (mut lines, mut compared) = (0, 0);
    for (step, inputs) in start.stimulus.iter().enumerate() {
        reference.step(inputs);
        machine.step(inputs, &mut |line| {
            checksums[line.pe.index()] = trace::checksum(checksums[line.pe.index()], line.address, line.value);
            lines += 1;
        });
        untraced.step(inputs, &mut |_| {});
        compared += flow.assert_words(&machine, &reference, &format!("{}, step {step}", start.name));
    }
    let expected = start.program.writes_per_step() * start.stimulus.len() as u64;
    assert_eq!(lines, expected, "{}: memory writes", flow.label);
    assert_eq!(machine.checksums(), checksums, "{}: checksums of the trace", flow.label);
    assert_eq!(untraced.checksums(), checksums, "{}: checksums without a trace", flow.label);
    compared
}

#[test]
fn the_machine_computes_what_the_step_graph_says_from_the_beginning_and_from_the_middle() {
    on_all_designs("machine = fixed point", |flow| {
        compare_steps(flow, &flow.beginning(STEPS)) + compare_steps(flow, &flow.middle(STEPS))
    });
}

#[test]
fn a_run_from_the_middle_is_the_rest_of_a_run_from_the_beginning() {
    // The patched images must stand for all that a step leaves behind, in odd steps of swapping buffers as well.
    for (family, solver) in [(Family::Shared, Solver::Rk4), (Family::Affine, Solver::Euler)] {
        let flow = Flow::random(family, (9, 3), solver, format(32, 25, 18), Placement::Annealed, 5);
        let middle = flow.middle(STEPS);
        let whole = flow.beginning(middle.step + STEPS);
        let (mut late, mut early) = (Machine::new(&middle.program), Machine::new(&whole.program));
        for (step, inputs) in whole.stimulus.iter().enumerate() {
            early.step(inputs, &mut |_| {});
            if step as u64 >= middle.step {
                late.step(inputs, &mut |_| {});
                assert_eq!(late.outputs(), early.outputs(), "{}, step {step}", flow.label);
            }
        }
    }
}

#[test]
fn a_program_survives_its_text() {
    on_all_designs("text form", |flow| {
        let text = flow.program.to_string();
        let parsed: Program = text.parse().unwrap_or_else(|error| panic!("{}: {error}", flow.label));
        assert!(parsed.to_string() == text, "{}: the text of the parsed program differs", flow.label);
        assert_eq!(parsed.format, flow.program.format);
        assert_eq!(parsed.states, flow.program.states, "{}", flow.label);
        let mut compared = 0;
        for (is, should) in parsed.pes.iter().zip(&flow.program.pes) {
            assert_eq!(is.features, should.features, "{}", flow.label);
            assert_eq!(is.ports, should.ports, "{}", flow.label);
            assert_eq!(is.words, should.words, "{}", flow.label);
            assert_eq!(is.own_image, should.own_image, "{}", flow.label);
            assert_eq!(is.base_image, should.base_image, "{}", flow.label);
            assert_eq!(is.coefficient_image, should.coefficient_image, "{}", flow.label);
            assert_eq!(is.imported_image, should.imported_image, "{}", flow.label);
            compared += is.words.len() + is.own_image.len() + is.imported_image.len();
        }
        assert_eq!(parsed.pes.len(), flow.program.pes.len(), "{}", flow.label);
        compared as u64
    });
}

#[test]
fn a_control_word_survives_its_bits() {
    on_all_designs("control words", |flow| {
        let mut compared = 0;
        for pe in &flow.program.pes {
            let layout = Layout::new(&pe.features, &flow.program.format);
            for word in &pe.words {
                assert_eq!(layout.decode(layout.encode(word)), *word, "{}", flow.label);
                compared += 1;
            }
        }
        compared
    });
}
