//! Compiled designs in GHDL and as Rust reference in both forms, bit for bit against the simulator.

use crate::support::agree::ENGINES;
use crate::support::bench::{Agreement, Folder, assert_agreement};
use crate::support::flow::{Flow, Placement, Start, format};
use crate::support::hubs::hub_model;
use crate::support::models::{compile, compile_file, spec};
use crate::support::{FAMILIES, Family};
use pe_frontend::{NoFiles, Overrides};
use pe_ir::graph::StageForm;
use pe_ir::model::Solver;
use pe_ir::source::Sources;
use pe_ir::word::{Pipeline, WordFormat};
use pe_verify::engines;

/// Steps of every comparison of small designs.
const STEPS: u64 = 20;

fn report(what: &str, sum: Agreement) {
    let Agreement { runs, writes, outputs, seconds } = sum;
    println!("{what}: {runs} runs, {writes} memory writes and {outputs} outputs equal, {seconds:.1} s in the engines");
}

/// Designs, each from the beginning and from the middle.
fn assert_all_agree(what: &str, flows: impl Iterator<Item = Flow>) {
    let mut sum = Agreement::default();
    flows.for_each(|flow| sum += assert_agreement(&flow.label, &flow.starts(STEPS), ENGINES));
    report(what, sum);
}

/// A random model from the beginning and from the middle.
fn agree(family: Family, size: (usize, u32), solver: Solver, widths: (u32, u32, u32), seed: u64) -> Agreement {
    let flow = Flow::random(family, size, solver, format(widths.0, widths.1, widths.2), Placement::Annealed, seed);
    assert_agreement(&flow.label, &flow.starts(STEPS), ENGINES)
}

#[test]
fn looped_stages_agree() {
    let looped = |flow: Flow| flow.looped().unwrap_or_else(|| panic!("{}: stages are not alike", flow.label));
    // With three rounds the buffers' roles run on from step to step.
    let designs = [(Family::Affine, Solver::Heun), (Family::Affine, Solver::Heun3), (Family::Grid, Solver::Heun3)];
    let plain = (41..).zip(designs).map(|(seed, (family, solver))| {
        let flow = looped(Flow::random(family, (10, 4), solver, format(32, 25, 18), Placement::Annealed, seed));
        assert_eq!(flow.pairs > 0, family == Family::Grid, "{}: {} pairs", flow.label, flow.pairs);
        flow
    });
    // Sums of one scale: nested products, and pairs of operands.
    let designs = [(Family::Polynomial, Solver::Rk4), (Family::Stencil, Solver::Rk4), (Family::Stencil, Solver::Heun)];
    let sums = (44..).zip(designs).map(|(seed, (family, solver))| {
        let form = (family, StageForm::Sums);
        looped(Flow::formed(form, (10, 4), solver, format(32, 25, 18), Placement::Annealed, seed))
    });
    assert_all_agree("looped", plain.chain(sums));
}

#[test]
fn stages_that_are_alike_agree_beside_outputs_that_are_sent_and_equations_that_are_left_out() {
    let folder = Folder::new("looped_beside");
    let filter = folder.0.join("chebyshev.spec");
    let text = std::fs::read_to_string(spec("validation").with_file_name("chebyshev.spec")).expect("a spec");
    std::fs::write(&filter, text.replace("u = 1", "u = sine(1, 20 Hz)")).expect("the spec can be written");
    let sections = ["--multiplier", "32x32", "--pes", "2", "--form", "factors", "--span", "200ms"];
    let pumps = ["--solver", "heun", "--multiplier", "25x18", "--pes", "3", "--form", "sums", "--span", "10ms"];
    let mut sum = Agreement::default();
    // RK4 as two factors of second order; the pumps have sums of two PEs, which are not looped.
    for (path, options, rounds) in [(filter, &sections[..], 2), (spec("pump_station"), &pumps[..], 1)] {
        let compiled = compile_file(&path, &[options, &["--loop", "on", "--tries", "2000"]].concat());
        assert_eq!(compiled.design.program.rounds, rounds, "{}", path.display());
        let label = path.display().to_string();
        sum += assert_agreement(&label, &[compiled.middle(STEPS)], ENGINES);
    }
    report("looped stages beside others", sum);
    assert!(sum.runs == 6 && sum.writes > 500, "{} runs, {} writes", sum.runs, sum.writes);
}

/// A model of each family, with one Runge-Kutta method after the other.
fn families_agree(what: &str, size: (usize, u32), widths: (u32, u32, u32), first_seed: u64) {
    let format = format(widths.0, widths.1, widths.2);
    let flows = (first_seed..).zip(FAMILIES).map(|(seed, family)| {
        let solver = Solver::RUNGE_KUTTA[seed as usize % Solver::RUNGE_KUTTA.len()];
        Flow::random(family, size, solver, format, Placement::Annealed, seed)
    });
    assert_all_agree(what, flows);
}

#[test]
fn random_models_on_a_single_multiplier_block_agree() {
    families_agree("25x18", (10, 4), (32, 25, 18), 11);
}

#[test]
fn designs_with_relays_agree() {
    let designs = [("rk4", format(32, 25, 18)), ("heun", format(18, 18, 25)), ("euler", format(32, 32, 32))];
    let flows = (81..).zip(designs).map(|(seed, (solver, format))| {
        let label = format!("hubs, {solver}, {}x{}, seed {seed}", format.data_bits, format.coefficient_bits);
        let flow = Flow::of(label, hub_model(12, solver, seed), 5, format, Placement::Annealed);
        flow.relayed(3, 2).unwrap_or_else(|| panic!("{}: no hubs", flow.label))
    });
    assert_all_agree("relays", flows);
}

#[test]
fn designs_with_routes_agree() {
    let designs = [
        (Family::Affine, Solver::Rk4, format(32, 25, 18), 2),
        (Family::Affine, Solver::Euler, format(32, 32, 32), 2),
        (Family::Polynomial, Solver::Heun, format(40, 35, 35), 2),
    ];
    let flows = (91..).zip(designs).map(|(seed, (family, solver, format, ports))| {
        let flow = Flow::random(family, (9, 6), solver, format, Placement::Scattered, seed);
        flow.routed(ports).unwrap_or_else(|| panic!("{}: no routes", flow.label))
    });
    assert_all_agree("routes", flows);
}

#[test]
fn designs_with_tables_agree() {
    let designs = [
        (Solver::Rk4, format(32, 25, 18)),
        (Solver::Euler, format(32, 32, 32)),
        (Solver::Heun, format(18, 18, 25)),
        (Solver::Heun3, format(40, 35, 35)),
    ];
    let tabled = |(seed, (solver, format))| Flow::tabled((9, 3), solver, format, Placement::Annealed, seed);
    assert_all_agree("tables", (61..).zip(designs).map(tabled));
}

#[test]
fn deep_pipelines_agree() {
    let deep = |format: WordFormat| format.with_pipeline(Pipeline::Deep);
    let designs = [
        (Family::Shared, Solver::Euler, format(32, 18, 18)),
        (Family::Polynomial, Solver::Rk4, format(32, 32, 32)),
        (Family::Grid, Solver::Heun3, format(32, 25, 18)),
    ];
    let plain = (81..).zip(designs).map(|(seed, (family, solver, format))| {
        let flow = Flow::random(family, (9, 3), solver, deep(format), Placement::Annealed, seed);
        flow.looped().unwrap_or(flow)
    });
    let tabled = Flow::tabled((9, 3), Solver::Heun, deep(format(32, 25, 18)), Placement::Annealed, 84);
    assert_all_agree("deep", plain.chain([tabled]));
}

#[test]
fn random_models_on_wide_multipliers_agree() {
    families_agree("32x32", (9, 3), (32, 32, 32), 21);
}

#[test]
fn random_models_on_turned_square_and_largest_multipliers_agree() {
    let mut sum = agree(Family::Shared, (8, 3), Solver::Rk4, (18, 18, 25), 31);
    sum += agree(Family::Polynomial, (8, 3), Solver::Euler, (18, 18, 18), 32);
    // Sums of more than 64 bits.
    sum += agree(Family::Polynomial, (8, 3), Solver::Rk4, (40, 35, 35), 33);
    report("18x25, 18x18, 35x35", sum);
}

/// A model from the beginning and from the middle of its span.
fn agree_on_model(model: &str, options: &[&str]) -> Agreement {
    let compiled = compile(model, options);
    // Tests run side by side: each design has a name of its own.
    let label = format!("{model} {}", options.join(" ").replace("--", ""));
    assert_agreement(&label, &compiled.starts(STEPS), ENGINES)
}

#[test]
fn small_paper_models_agree() {
    let mut sum = agree_on_model("weibel5", &["--pes", "9", "--multiplier", "25x18", "--span", "100ms"]);
    sum += agree_on_model("lutchen20", &["--pes", "5", "--span", "4ms"]);
    sum += agree_on_model("wave6", &["--pes", "6", "--multiplier", "25x18"]);
    sum += agree_on_model("atrial3", &["--pes", "7"]);
    report("small paper models", sum);
}

#[test]
fn classic_models_agree() {
    let mut sum = agree_on_model("lorenz", &["--pes", "3", "--span", "1s"]);
    sum += agree_on_model("van_der_pol", &["--pes", "2", "--multiplier", "25x18", "--span", "2s"]);
    sum += agree_on_model("lutchen_breathing", &["--pes", "4", "--span", "50ms"]);
    sum += agree_on_model("rc_ladder", &["--pes", "5", "--multiplier", "25x18", "--span", "100ms"]);
    sum += agree_on_model("lotka_volterra", &["--pes", "1", "--solver", "euler", "--span", "100ms"]);
    sum += agree_on_model("harmonic_oscillator", &["--pes", "2", "--storage", "18", "--multiplier", "18x25"]);
    report("classic models", sum);
}

#[test]
fn methods_beside_runge_kutta_agree() {
    let cases = [
        ("harmonic_oscillator", "leapfrog", "2", "25x18"),
        ("spring_chain", "symplectic_euler", "3", "32x32"),
        ("van_der_pol", "ab3", "2", "32x32"),
        ("lotka_volterra", "ab4", "2", "25x18"),
        ("rc_ladder", "rkc5", "4", "25x18"),
        ("rc_ladder", "implicit_euler", "3", "32x32"),
        ("rc_ladder", "rodas3", "4", "25x18"),
        ("rc_ladder", "exact", "2", "32x32"),
    ];
    let mut sum = Agreement::default();
    for (model, solver, pes, multiplier) in cases {
        let step = if solver == "ab4" { "1ms" } else { "" };
        let mut options = vec!["--solver", solver, "--pes", pes, "--multiplier", multiplier, "--span", "400ms"];
        if !step.is_empty() {
            options.extend(["--step", step]);
        }
        sum += agree_on_model(model, &options);
    }
    report("methods", sum);
}

#[test]
fn coefficients_in_two_slots_and_words_of_48_bits_agree() {
    let two_slots = ["--coefficients", "two-slot", "--multiplier", "25x18"];
    let with = |options: &[&'static str]| [&two_slots[..], options].concat();
    let mut sum = agree_on_model("lorenz", &with(&["--pes", "3", "--span", "1s"]));
    sum += agree_on_model("weibel5", &with(&["--pes", "9", "--span", "20ms"]));
    sum += agree_on_model("van_der_pol", &["--pes", "2", "--storage", "48", "--multiplier", "35x35", "--span", "2s"]);
    sum += agree_on_model("lorenz", &["--pes", "3", "--storage", "48", "--multiplier", "25x18", "--span", "1s"]);
    report("two slots, 48 bits", sum);
}

/// What `docs/hardware.md` says about inputs beyond the range stated for them: a word that the port can carry is
/// computed with, the flag rises where rounding to the data operand clamps it, and a number beyond all words is clamped
/// before.
#[test]
fn inputs_at_the_ends_of_their_words_agree() {
    let text = "model m\nsolver rk4\nstep 10 ms\nspan 1 s\ninput u = sine(0.9, 1 Hz) in -1 .. 1\n\
                state x = 1\nx' = 0.01*u - x\nstate y = 1\ny' = x - 0.5*y + 0.02*u\noutput x, y\n";
    let mut sources = Sources::new("m.spec", text);
    let (model, _) = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default()).expect("a model");
    let model = pe_hls::lift::lift(model);
    let mut sum = Agreement::default();
    for (widths, clamps) in [((32, 32, 32), false), ((32, 25, 18), true), ((24, 18, 18), true)] {
        let format = format(widths.0, widths.1, widths.2);
        let flow = Flow::of(format!("inputs {widths:?}"), model.clone(), 1, format, Placement::Annealed);
        let run = flow.fixed_run(0);
        let (least, most) = (-(1i64 << (widths.0 - 1)), (1i64 << (widths.0 - 1)) - 1);
        assert_eq!((run.encode_input(0, 1e9), run.encode_input(0, -1e9)), ((most, true), (least, true)));
        // A little beyond the stated range is a number like others.
        let (beyond, clamped) = run.encode_input(0, 1.01);
        assert!(!clamped && run.encode_input(0, 1.0).0 < beyond && beyond < most, "{beyond}");
        let starts = [([beyond, least, -beyond, 0, beyond, least], false), ([0, beyond, most, 1, -1, most], clamps)];
        let starts = starts.map(|(words, flag)| {
            let start = Start { stimulus: words.iter().map(|word| vec![*word]).collect(), ..flow.beginning(0) };
            let simulated = engines::simulate(&start.program, &start.stimulus, words.len() as u64);
            assert_eq!(simulated.overflow, flag, "{}: {words:?}", flow.label);
            start
        });
        sum += assert_agreement(&flow.label, &starts, ENGINES);
    }
    report("inputs", sum);
}
