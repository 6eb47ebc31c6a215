//! Proof of ranges: bounds hold against the worst inputs that there are, and are nearly met by them.

use crate::support::models::{Compiled, compile, spec};
use crate::support::{AFFINE_FAMILIES, Family, random_model};
use clap::Parser;
use pe_hls::step::StepOptions;
use pe_ir::graph::{Chain, FixedPoint, StepGraph, ValueId};
use pe_ir::index::PeId;
use pe_ir::model::{Model, Solver};
use pe_ir::verify::ranges::{self, Enclosure, Norm, Step};
use pe_ir::word::WordFormat;
use pe_judge::Criteria;
use pe_judge::progress::silent;
use pe_judge::proof::Certainty;
use pe_judge::runs::{Exact, Judged};
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::Machine;
use pe_synth::options::DesignArgs;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn options(words: &[&str]) -> Criteria {
    DesignArgs::parse_from(["test"].iter().chain(words)).model.criteria()
}

/// A model whose ranges were proven as `compile` does it.
struct Proven {
    label: String,
    model: Model,
    graph: StepGraph,
    judged: Judged,
}

impl Proven {
    fn of(label: String, model: Model, format: WordFormat, criteria: &Criteria) -> Proven {
        let graph = pe_hls::step::build_with(&model, &StepOptions::default()).expect("a step");
        let bar = silent();
        let judged = Exact::run(&model, &graph, bar).and_then(|exact| {
            let proposal = exact.propose(&model, &graph, format, criteria);
            exact.judge(&model, &graph, format, criteria, proposal.as_ref())
        });
        let judged = judged.unwrap_or_else(|findings| panic!("{label}: {findings:?}"));
        Proven { label, model, graph, judged }
    }

    fn fixed(&self) -> &FixedPoint {
        &self.judged.fixed
    }

    fn written(&self) -> Vec<ValueId> {
        self.graph.chains.iter().flat_map(Chain::writes).map(|write| write.value).collect()
    }

    fn enclosure(&self) -> &Enclosure {
        let proof = self.judged.proof.as_ref().expect("a proof was asked for");
        &proof.enclosed.as_ref().unwrap_or_else(|| panic!("{}: no bounds", self.label)).enclosure
    }

    fn all_fit(&self) -> bool {
        self.written().iter().all(|value| self.enclosure().fits(*value))
    }

    /// Numbers of values after each step: from the initial states with inputs at rest, and what an impulse at an input
    /// adds, all in LSB.
    fn responses(&self, input: Option<usize>, steps: u64) -> Vec<Vec<f64>> {
        let fixed = self.fixed();
        let run = |impulse: bool| {
            let mut run = DoubleRun::quantised(&self.graph, fixed);
            let mut rows = Vec::new();
            for step in 0..steps {
                let mut inputs = vec![0.0; self.graph.inputs.len()];
                if let Some(input) = input.filter(|_| impulse && step == 0) {
                    let exponent = fixed.exponents[self.graph.inputs[input].index()];
                    inputs[input] = 2f64.powi(fixed.format.word_bits() as i32 - 1 + exponent);
                }
                run.step(&inputs).expect("a stable model");
                let number = |value: usize| run.value(value) * 2f64.powi(-fixed.exponents[value]);
                rows.push((0..self.graph.values.len()).map(number).collect::<Vec<f64>>());
            }
            rows
        };
        let still = run(false);
        if input.is_none() {
            return still;
        }
        let pushed = run(true);
        let difference = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a - b).collect();
        pushed.iter().zip(&still).map(difference).collect()
    }

    /// Runs with words of the input ports; the largest magnitude of each written value's number.
    fn drive(&self, steps: u64, mut words: impl FnMut(u64) -> Vec<i64>) -> Vec<f64> {
        let mut run = FixedRun::new(&self.graph, self.fixed());
        let offset = self.fixed().format.data_offset();
        let mut largest = vec![0.0f64; self.graph.values.len()];
        for step in 0..steps {
            assert!(!run.step(&words(step)), "{}: a word saturates in step {step}", self.label);
            for value in self.written() {
                let number = (run.word(value) - offset) as f64;
                largest[value.index()] = largest[value.index()].max(number.abs());
            }
        }
        largest
    }

    fn port_ends(&self) -> [i64; 2] {
        let top = 1i64 << (self.fixed().format.storage_bits - 1);
        [-top, top - 1]
    }

    /// Holds the bounds against inputs at the ends of their ports, and returns how nearly the worst ones meet them: for
    /// some values the reached magnitude over the bound.
    fn attack(&self, seed: u64) -> Vec<f64> {
        let steps = self.model.steps();
        let (enclosure, inputs) = (self.enclosure(), self.graph.inputs.len());
        let [low, high] = self.port_ends();
        let hold = |largest: &[f64], what: &str| {
            for value in self.written() {
                let (is, most) = (largest[value.index()], enclosure.largest[value.index()]);
                assert!(
                    is <= most,
                    "{}: {what}: `{}` reaches {is} of {most}",
                    self.label,
                    self.graph.value_name(value)
                );
            }
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        hold(
            &self.drive(steps, |_| (0..inputs).map(|_| if rng.random_bool(0.5) { low } else { high }).collect()),
            "ends",
        );
        hold(&self.drive(steps, |_| (0..inputs).map(|_| rng.random_range(low..=high)).collect()), "any");
        hold(&self.drive(steps, |_| vec![high; inputs]), "held");
        let free = self.responses(None, steps);
        let responses: Vec<Vec<Vec<f64>>> = (0..inputs).map(|input| self.responses(Some(input), steps)).collect();
        let written = self.written();
        let mut met = Vec::new();
        for value in written.iter().step_by(written.len().div_ceil(6)) {
            // The step in which the most can come together, and the inputs that do it: signs of the response, reversed.
            let (mut sum, mut most) = (0.0, (0.0, 0));
            for step in 0..steps as usize {
                sum += responses.iter().map(|response| response[step][value.index()].abs()).sum::<f64>();
                let together = sum + free[step][value.index()].abs();
                if together > most.0 {
                    most = (together, step);
                }
            }
            let (expected, last) = most;
            let direction = free[last][value.index()];
            let word = |step: u64, response: &Vec<Vec<f64>>| {
                let ahead =
                    (last as u64).checked_sub(step).map_or(0.0, |ahead| response[ahead as usize][value.index()]);
                if (ahead >= 0.0) == (direction >= 0.0) { high } else { low }
            };
            let largest = self.drive(last as u64 + 1, |step| responses.iter().map(|of| word(step, of)).collect());
            hold(&largest, "worst");
            assert!(expected <= enclosure.largest[value.index()]);
            met.push(largest[value.index()] / enclosure.largest[value.index()]);
        }
        met
    }
}

#[test]
fn worst_inputs_meet_the_bounds_of_random_models_and_never_exceed_them() {
    let formats = [WordFormat::new(32, 32, 32), WordFormat::new(32, 25, 18), WordFormat::new(18, 18, 18)];
    let solvers = [Solver::Euler, Solver::Rk4, Solver::Heun];
    let wide = options(&["spec", "--widen", "12"]);
    let mut fitting = 0;
    for (family, seed) in AFFINE_FAMILIES.into_iter().zip(1u64..).flat_map(|case| [case, (case.0, case.1 + 100)]) {
        let (format, solver) = (formats[seed as usize % 3], solvers[(seed / 3) as usize % 3]);
        let model = random_model(family, 5 + 3 * (seed as usize % 4), solver, seed);
        let label = format!("{family:?} {solver:?} {}x{}, seed {seed}", format.data_bits, format.coefficient_bits);
        let proven = Proven::of(label, model, format, &wide);
        if !proven.all_fit() {
            // Coarse words: rounding may be all that is left of a bound.
            assert!(format.storage_bits < 32 || family == Family::Scales, "{}: nothing is proven", proven.label);
            continue;
        }
        fitting += 1;
        let met = proven.attack(seed);
        let (least, floor) = (met.iter().copied().fold(1.0, f64::min), if format.data_bits == 32 { 0.99 } else { 0.8 });
        assert!(least > floor, "{}: the worst inputs meet only {least} of a bound", proven.label);
    }
    assert!(fitting >= 7, "only {fitting} random models were proven");
}

/// The affine models that are shipped and run in a moment.
const AFFINE: [&str; 7] =
    ["harmonic_oscillator", "heat_plate", "lutchen20", "rc_ladder", "wave6", "wave_fdtd", "weibel5"];

#[test]
fn overflow_of_the_shipped_affine_models_is_impossible() {
    let validation =
        ["chebyshev", "dc_motor", "decay_chain", "detest_a1", "detest_b2", "detest_c1", "detest_c3", "low_pass"];
    let folder = spec("validation").with_file_name("");
    let small = validation.map(|name| (name, folder.join(format!("{name}.spec"))));
    for (name, path) in AFFINE.map(|name| (name, spec(name))).into_iter().chain(small) {
        let options = DesignArgs::parse_from(["test".as_ref(), path.as_os_str()]);
        let loaded = options.load().unwrap_or_else(|failure| panic!("{name}: {failure:?}"));
        let format = options.point.point().format(&loaded.model).expect("a word");
        let proven = Proven::of(name.to_owned(), loaded.model, format, &options.model.criteria());
        assert!(proven.all_fit(), "{name}: {:?}", proven.judged.proof);
        let states =
            proven.judged.proof.as_ref().unwrap().states(&proven.graph, &proven.judged.fixed, &proven.judged.largest);
        assert!(states.iter().all(|(certainty, bound)| *certainty == Certainty::Proven && bound.is_some()));
        // Runs from other inputs than the model's, over parts of long spans.
        if proven.model.steps() <= 5000 && proven.graph.macs() < 1000 {
            let met = proven.attack(1);
            assert!(met.iter().all(|met| *met > 0.9), "{name}: {met:?}");
        }
    }
}

#[test]
fn what_follows_from_words_that_may_saturate_is_not_proven() {
    let (mut proofs, mut saturated) = (0, 0);
    for (family, seed) in AFFINE_FAMILIES.into_iter().flat_map(|family| (200..212).map(move |seed| (family, seed))) {
        let solver = [Solver::Euler, Solver::Rk4][seed as usize % 2];
        let model = random_model(family, 4 + seed as usize % 5, solver, seed);
        let label = format!("{family:?}, seed {seed}");
        let proven = Proven::of(label, model, WordFormat::new(32, 32, 32), &options(&["spec", "--widen", "0"]));
        let Some(enclosed) = &proven.judged.proof.as_ref().expect("asked for").enclosed else { continue };
        let fits: Vec<ValueId> = proven.written().into_iter().filter(|value| enclosed.enclosure.fits(*value)).collect();
        let mut run = FixedRun::new(&proven.graph, proven.fixed());
        let [low, high] = proven.port_ends();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for step in 0..proven.model.steps() {
            let held = if step / 64 % 3 == 0 { high } else { low };
            let words: Vec<i64> =
                proven.graph.inputs.iter().map(|_| if rng.random_bool(0.9) { held } else { low }).collect();
            run.step(&words);
        }
        let counts = run.saturations();
        saturated += usize::from(counts.iter().any(|count| *count > 0));
        proofs += fits.len();
        for value in fits {
            assert_eq!(counts[value.index()], 0, "{}: `{}`", proven.label, proven.graph.value_name(value));
        }
    }
    assert!(saturated >= 3, "only {saturated} models saturate");
    assert!(proofs > 0, "nothing is proven");
}

#[test]
fn bounds_hold_in_any_norm_and_a_wrong_inverse_proves_nothing() {
    let model = random_model(Family::Affine, 8, Solver::Rk4, 7);
    let proven =
        Proven::of("any norm".to_owned(), model, WordFormat::new(32, 32, 32), &options(&["spec", "--widen", "8"]));
    let step = Step::of(&proven.graph, proven.fixed()).expect("affine");
    let [low, high] = proven.port_ends();
    let reached = proven.drive(50, |step| vec![if step % 7 < 3 { low } else { high }]);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut proofs = 0;
    for _ in 0..20 {
        let weights: Vec<f64> = (0..8).map(|_| rng.random_range(-3.0f64..3.0).exp()).collect();
        for norm in [Norm::Largest(weights.clone()), Norm::Energy(weights)] {
            let Some(measured) = step.measure(norm.clone()) else { continue };
            let enclosure = step.enclose(&measured, 50);
            proofs += 1;
            let holds = |value: &ValueId| reached[value.index()] <= enclosure.largest[value.index()];
            assert!(proven.written().iter().all(holds), "{norm:?}");
        }
    }
    assert!(proofs > 10, "only {proofs} norms");
    let unit = |scale: f64| -> Vec<Vec<f64>> {
        (0..8).map(|row| (0..8).map(|column| if row == column { scale } else { 0.0 }).collect()).collect()
    };
    let drift = |norm: Norm| step.drift(&step.measure(norm)?, Some(50));
    assert!(drift(Norm::Basis(unit(2.0), unit(0.5))).is_some());
    assert_eq!(drift(Norm::Basis(unit(2.0), unit(0.6))), None);
    assert_eq!(drift(Norm::Largest(vec![0.0; 8])), None);
}

#[test]
fn pes_saturate_unless_all_that_they_write_is_proven() {
    let Compiled { design, .. } = compile("rc_ladder", &["--pes", "2", "--tries", "50"]);
    assert!(PeId::all(2).all(|pe| !design.program.saturates(pe)));
    let text = design.program.to_string();
    assert!(text.lines().filter(|line| line.starts_with("pe ") && line.ends_with(" proven")).count() == 2);
    assert_eq!(text.parse::<pe_ir::program::Program>().unwrap().to_string(), text);

    let Compiled { design: kept, .. } = compile("rc_ladder", &["--pes", "2", "--tries", "50", "--widen", "0"]);
    assert!(PeId::all(2).all(|pe| kept.program.saturates(pe)));
    let enclosed = kept.judged.proof.as_ref().unwrap().enclosed.as_ref().unwrap();
    assert!(ranges::check(&kept.program, kept.issued(), &enclosed.enclosure).is_empty());
    // Left out without a proof.
    let mut wrong = kept.program.clone();
    wrong.pes[PeId::new(1)].features.proven = true;
    let violations = ranges::check(&wrong, kept.issued(), &enclosed.enclosure);
    assert!(!violations.is_empty() && violations.iter().all(|text| text.starts_with("PE 1")), "{violations:?}");

    let Compiled { design: off, .. } = compile("rc_ladder", &["--pes", "2", "--tries", "50", "--proof", "off"]);
    assert!(off.judged.proof.is_none() && PeId::all(2).all(|pe| off.program.saturates(pe)));
    assert_eq!(off.judged.fixed, kept.judged.fixed);

    let Compiled { design, .. } = compile("lotka_volterra", &["--pes", "2", "--tries", "50", "--span", "1s"]);
    let proof = design.judged.proof.as_ref().unwrap();
    assert!(proof.enclosed.is_none() && PeId::all(2).all(|pe| design.program.saturates(pe)));
    let states = proof.states(&design.graph, &design.judged.fixed, &design.judged.largest);
    assert!(states.iter().all(|(certainty, bound)| *certainty == Certainty::Probable && bound.is_none()));
}

#[test]
fn a_run_from_where_no_run_gets_is_told() {
    let Compiled { design, .. } = compile("harmonic_oscillator", &["--pes", "2", "--tries", "50"]);
    let format = design.program.format;
    let escapes = |words: [i64; 2]| {
        let mut program = design.program.clone();
        for (state, word) in program.states.clone().iter().zip(words) {
            state.set(&mut program.pes, &format, word);
        }
        let mut machine = Machine::new(&program);
        (0..5000).any(|_| {
            machine.step(&[], &mut |_| {});
            machine.escaped()
        })
    };
    let words: Vec<i64> = design.judged.checkpoint.words.clone();
    assert!(!escapes([words[0], words[1]]));
    assert!(escapes([format.max_word(), format.max_word()]));
}
