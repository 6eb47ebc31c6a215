//! The campaign of damage: its proofs against the simulator, its damages against GHDL, a small campaign.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::Command;

use crate::support::bench::Folder;
use crate::support::flow::{Flow, Placement, format};
use crate::support::models::spec;
use crate::support::{Family, is_long_suite};
use pe_emit::EmitOptions;
use pe_ir::graph::StageForm;
use pe_ir::model::Solver;
use pe_ir::program::{Fold, LinkSource, Program};
use pe_ir::word::Pipeline;
use pe_sim::clocked::Clocked;
use pe_sim::coverage::{BASE, Coverage, PeCoverage};
use pe_sim::machine::Machine;
use pe_sim::trace::TraceLine;
use pe_verify::climb::{self, Memory};
use pe_verify::inject::class::Class;
use pe_verify::inject::classes::{Damage, Places, Sources};
use pe_verify::inject::datasheet::Design;
use pe_verify::inject::library::REPLACEMENTS;
use pe_verify::inject::symbolic;
use pe_verify::stimuli;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Damages of each design of the cross-check.
const DAMAGES: usize = 150;

/// Steps of its runs.
const STEPS: u64 = 8;

/// Small designs that have every feature between them: swapped buffers, factors, looped stages, variants, tables, a
/// deep pipeline, pairs of operands, and own memories that swap beside base memories as deep.
fn designs() -> Vec<Flow> {
    let flow = |family, size, solver, (storage, data, coefficient), seed| {
        Flow::random(family, size, solver, format(storage, data, coefficient), Placement::Scattered, seed)
    };
    let looped = flow(Family::Affine, (10, 4), Solver::Heun3, (32, 25, 18), 42);
    let sums = Flow::formed(
        (Family::Stencil, StageForm::Sums),
        (10, 4),
        Solver::Rk4,
        format(32, 25, 18),
        Placement::Annealed,
        45,
    );
    let deep = format(32, 18, 18).with_pipeline(Pipeline::Deep);
    vec![
        flow(Family::Shared, (6, 3), Solver::Euler, (32, 25, 18), 51),
        flow(Family::Polynomial, (4, 3), Solver::Rk4, (32, 25, 18), 52),
        flow(Family::Hub, (6, 4), Solver::Rk4, (32, 32, 32), 53),
        looped.looped().expect("stages are alike"),
        sums.looped().expect("stages are alike"),
        Flow::tabled((8, 3), Solver::Heun, format(32, 25, 18), Placement::Scattered, 56),
        Flow::random(Family::Shared, (6, 3), Solver::Heun, deep, Placement::Scattered, 57),
        Flow::tabled((8, 3), Solver::Euler, format(32, 25, 18), Placement::Scattered, 58),
    ]
}

/// The VHDL that a program gives, without the hand-written files.
fn sources(program: &Program) -> Sources {
    let artefacts = pe_emit::emit(program, &EmitOptions::default());
    let kept = artefacts.into_iter().filter(|artefact| !artefact.path.starts_with("hdl/"));
    let name = pe_emit::design_name(program);
    Sources {
        texts: kept.map(|artefact| (artefact.path, artefact.text)).collect(),
        package_file: format!("{name}_program_pkg.vhd"),
        network_file: format!("{name}.vhd"),
    }
}

/// What the simulator makes of control words and images as the datasheet reads them.
fn observed(
    program: &Program,
    design: &Design,
    stimulus: &[Vec<i64>],
) -> Option<(Vec<TraceLine>, Vec<Vec<i64>>, bool)> {
    let signed = |word: u128, bits: u32| ((word as u64) << (64 - bits)) as i64 >> (64 - bits);
    let mut program = program.clone();
    for (to, from) in program.pes.iter_mut().zip(&design.pes) {
        let [word, data, coefficient] = design.widths;
        let images = [
            (&mut to.own_image, data),
            (&mut to.base_image, word),
            (&mut to.coefficient_image, coefficient),
            (&mut to.imported_image, data),
        ];
        for ((image, bits), words) in images.into_iter().zip(&from.images) {
            image.iter_mut().zip(words).for_each(|(to, from)| *to = signed(*from, bits));
        }
    }
    let bits: Vec<Vec<u128>> = design.pes.iter().map(|pe| pe.words.clone()).collect();
    // A word without meaning is none for the simulator.
    let run = catch_unwind(AssertUnwindSafe(|| {
        let mut machine = Machine::with_bits(&program, &bits);
        let (mut trace, mut outputs) = (Vec::new(), Vec::new());
        for step in 0..STEPS {
            let inputs = &stimulus[step as usize % stimulus.len().max(1)];
            machine.step(inputs, &mut |line| trace.push(line));
            outputs.push(machine.outputs().to_vec());
        }
        trace.sort_unstable();
        (trace, outputs, machine.overflow())
    }));
    run.ok()
}

/// The damages of programs and images.
fn flips(sources: &Sources, count: usize, seed: u64) -> Vec<Damage> {
    let places = Places::of(sources).unwrap_or_else(|what| panic!("not understood: {what}"));
    let mut damages = places.choose(3 * count, &mut ChaCha8Rng::seed_from_u64(seed));
    damages.retain(|damage| damage.file == sources.package_file);
    damages.truncate(count);
    damages
}

#[test]
fn the_datasheet_reads_the_words_that_were_emitted() {
    for flow in designs() {
        let (_, _, design) = sources(&flow.program).read().unwrap_or_else(|what| panic!("{}: {what}", flow.label));
        assert_eq!(design.pause(), flow.program.latency().pause(), "{}", flow.label);
        for (is, should) in design.pes.iter().zip(&flow.program.pes) {
            let fold = Fold::of(&flow.program, should);
            let words: Vec<u128> = (0..flow.program.period as usize).map(|k| fold.word(k)).collect();
            assert!(is.words == words, "{}: other control words", flow.label);
        }
        assert_eq!(symbolic::equal(&design, &design), Ok(()), "{}", flow.label);
    }
}

#[test]
fn no_damage_without_effect_by_the_datasheet_shows_in_the_simulator() {
    let (mut proven, mut showing, mut silent) = (0, 0, 0);
    for (index, flow) in designs().iter().enumerate() {
        let sources = sources(&flow.program);
        let (_, _, design) = sources.read().expect("read by the test above");
        let start = flow.middle(STEPS);
        let reference = |design: &Design| observed(&flow.program, design, &start.stimulus);
        let good = reference(&design);
        assert!(good.is_some(), "{}: the simulator runs the design", flow.label);
        for damage in flips(&sources, DAMAGES, index as u64) {
            let (_, _, damaged) = sources.damaged(&damage).read().expect("a flipped bit is a bit");
            let same = reference(&damaged) == good;
            match (symbolic::equal(&design, &damaged).is_ok(), same) {
                (true, true) => proven += 1,
                (true, false) => panic!("{}: {damage:?} is said to have no effect", flow.label),
                (false, true) => silent += 1,
                (false, false) => showing += 1,
            }
        }
    }
    println!(
        "{proven} damages without effect, {showing} show, {silent} do not show in {STEPS} steps from the beginning"
    );
    assert!(proven > 50 && showing > 100, "{proven} proven, {showing} show");
}

#[test]
fn a_field_that_is_taken_for_idle_is_found_out() {
    // What a careless reading of the datasheet could say: the address of a base counts only if the word writes.
    let flow = &designs()[1];
    let sources = sources(&flow.program);
    let (_, _, design) = sources.read().expect("read by the test above");
    let mut wrong = 0;
    for pe in 0..design.pes.len() {
        let fields = &design.pes[pe].fields;
        for word in 0..design.period as usize {
            let bits = design.pes[pe].words[word];
            if !fields.base_enable.set(bits) || fields.write_base.set(bits) || fields.base_address.width == 0 {
                continue;
            }
            let mut damaged = design.clone();
            damaged.pes[pe].words[word] ^= 1 << fields.base_address.lsb;
            wrong += u32::from(symbolic::equal(&design, &damaged).is_err());
        }
    }
    assert!(wrong > 5, "{wrong} bases that another word takes");
}

#[test]
fn rules_are_without_effect_where_no_word_meets_them() {
    let (mut idle, mut flagged, mut shallow) = (0, 0, 0);
    for flow in designs() {
        let sources = sources(&flow.program);
        let (_, _, design) = sources.read().expect("read by the test above");
        let equal = |change: &dyn Fn(&mut Design)| {
            let mut damaged = design.clone();
            change(&mut damaged);
            symbolic::equal(&design, &damaged).is_ok()
        };
        assert!(!equal(&|damaged| damaged.rules.settled_early = design.pause()), "{}: a first pass", flow.label);
        // Bounds may show that nothing ever saturates; then nothing does.
        let flags = !equal(&|damaged| damaged.rules.flagged = [false; 5]);
        assert!(flags || !saturates(&flow.program), "{}: flags", flow.label);
        flagged += u32::from(flags);
        let sums = design.pes.iter().any(|pe| {
            let f = &pe.fields;
            pe.words.iter().any(|word| f.own_enable.set(*word) && f.imported_enable.set(*word))
        });
        assert_eq!(equal(&|damaged| damaged.rules.sums_flagged = false), !sums, "{}: sums", flow.label);
        let last = design.pes.iter().any(|pe| pe.features.base_last);
        assert!(last || equal(&|damaged| damaged.rules.last_round = false), "{}: rounds", flow.label);
        let swaps = design.pes.iter().any(|pe| {
            pe.features.own_words <= pe.features.base_words
                && pe.words.iter().any(|word| pe.fields.write_base.set(*word) && pe.fields.write_swap.set(*word))
        });
        assert_eq!(equal(&|damaged| damaged.rules.bases_plain = false), !swaps, "{}: pairs", flow.label);
        shallow += u32::from(swaps);
        idle += u32::from(equal(&|damaged| damaged.rules.settled_early = 1));
    }
    assert!(idle > 0, "no word before the pause that writes nothing");
    assert!(flagged > 0, "no flag anywhere");
    assert!(shallow > 0, "no own memory that swaps beside a base memory as deep");
}

#[test]
fn inputs_sampled_in_every_word_are_the_same_only_if_the_first_word_takes_them() {
    let (_, sequencer) = pe_emit::LIBRARY.iter().find(|(file, _)| *file == "pe_sequencer.vhd").expect("a sequencer");
    let (mut same, mut other) = (0, 0);
    for flow in designs().iter().filter(|flow| flow.program.ports().count() > 0) {
        let mut sources = sources(&flow.program);
        sources.texts.insert("hdl/pe_sequencer.vhd".into(), (*sequencer).to_owned());
        let (_, _, design) = sources.read().expect("read by the test above");
        let damaged = sequencer.replace("sample_o  <= fetch and waiting and not replace_i;", "sample_o <= fetch;");
        sources.texts.insert("hdl/pe_sequencer.vhd".into(), damaged);
        let (_, _, damaged) = sources.read().expect("a wire is a wire");
        let format = &flow.program.format;
        // The word behind the pause word is the first that can receive.
        let first = design.pause() as usize + 1;
        let takes = flow.program.pes.iter().flat_map(|pe| {
            let received = pe.words.iter().enumerate().filter_map(|(k, word)| Some((k, pe.ports[word.receive?.0])));
            received.filter(|(_, source)| matches!(source, LinkSource::Input(_))).map(|(k, _)| k)
        });
        let early = takes.into_iter().all(|k| k == first);
        let clamps = format.data_bits < format.storage_bits || format.pipeline == Pipeline::Deep;
        let expected = early && !clamps && flow.program.ticks().next().is_none();
        assert_eq!(symbolic::equal(&design, &damaged).is_ok(), expected, "{}", flow.label);
        (same, other) = (same + u32::from(expected), other + u32::from(!expected));
    }
    println!("{same} designs that do not change, {other} that do");
    assert!(other > 0);
}

#[test]
fn entries_of_tables_that_no_run_read_are_sought() {
    let flow = Flow::tabled((8, 3), Solver::Heun, format(32, 25, 18), Placement::Scattered, 56);
    let program = &flow.program;
    let mut seen = Coverage::none(program);
    seen.add(&stimuli::observe(program, &flow.middle(1).stimulus, 1).coverage);
    let entries = |seen: &Coverage| -> usize {
        let read = |pe: &PeCoverage| pe.fetched[BASE].iter().filter(|read| **read).count();
        seen.pes.iter().map(read).sum()
    };
    let before = entries(&seen);
    let (mut starts, mut memory) = (0, Memory::default());
    let likely = climb::unread_starts(program, &seen, &memory);
    while let Some(candidate) = climb::unread_entries(&mut memory, program, 2, &seen) {
        let news = stimuli::observe(&candidate.program, &candidate.stimulus, 2).coverage;
        let read = entries(&seen);
        seen.add(&news);
        assert!(entries(&seen) > read, "a start that reads nothing new");
        starts += 1;
    }
    // States at their limits read none of the others.
    let found = entries(&seen);
    let mut limited = seen.clone();
    for seed in 0..2_000 {
        let (started, stimulus) = at_limits(program, seed);
        limited.add(&stimuli::observe(&started, &stimulus, 1).coverage);
    }
    assert_eq!(entries(&limited), found);
    println!("{before} words read in one step, {found} in {starts} of {likely} starts");
    assert!(likely > 0);
    // What was sought in vain from several starts is not sought again, so there is an end.
    let mut further = 0;
    while climb::unread_starts(program, &seen, &memory) > 0 {
        if let Some(candidate) = climb::unread_entries(&mut memory, program, 2, &seen) {
            seen.add(&stimuli::observe(&candidate.program, &candidate.stimulus, 2).coverage);
        }
        further += 1;
        assert!(further < 100);
    }
    println!("{} words after {further} searches more", entries(&seen));
    assert!(climb::unread_entries(&mut memory, program, 2, &seen).is_none());
    assert!(starts > 0 && found > 2 * before, "{found} words");
}

/// A program with states and inputs at their limits, or half of the upper one.
fn at_limits(program: &Program, seed: u64) -> (Program, Vec<Vec<i64>>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut started = program.clone();
    let limits = |bits: u32, random: &mut ChaCha8Rng| {
        let largest = (1i64 << (bits - 1)) - 1;
        [-largest - 1, largest, largest / 2][random.random_range(0..3)]
    };
    for state in &program.states {
        state.set(&mut started.pes, &program.format, limits(program.format.word_bits(), &mut random));
    }
    let line = |random: &mut ChaCha8Rng| program.ports().map(|_| limits(program.format.storage_bits, random)).collect();
    (started, (0..4).map(|_| line(&mut random)).collect())
}

/// Whether any PE sets its flag from states and with inputs at their limits.
fn saturates(program: &Program) -> bool {
    (0..200).any(|seed| {
        let (started, stimulus) = at_limits(program, seed);
        let mut network = Clocked::new(&started);
        stimulus.iter().for_each(|words| network.step(words, &mut |_| {}));
        !network.flags().is_empty()
    })
}

#[test]
fn every_damage_of_the_library_is_vhdl() {
    let folder = Folder::new("inject_library");
    let library = |text: &dyn Fn(&str, &str) -> String, only: Option<&str>| {
        let work = format!("--workdir={}", folder.0.display());
        let mut command = Command::new("ghdl");
        command.args(["-a", "--std=08", "--work=pe_lib", &work]);
        for (file, original) in pe_emit::LIBRARY.iter().filter(|(file, _)| only.is_none_or(|only| only == *file)) {
            let path = folder.0.join(file);
            std::fs::write(&path, text(file, original)).expect("the test folder takes files");
            command.arg(path);
        }
        let output = command.output().expect("apt-get install ghdl");
        assert!(output.status.success(), "{only:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    library(&|_, original| original.to_owned(), None);
    for (_, _, file, before, after) in REPLACEMENTS {
        library(&|_, original| original.replace(before, after), Some(file));
        // What uses a package is obsolete once that is analysed again.
        library(&|_, original| original.to_owned(), (!file.ends_with("_pkg.vhd")).then_some(file));
    }
}

#[test]
fn the_datasheet_lists_every_class() {
    let page = include_str!("../../../../docs/hardware.md");
    for class in Class::ALL.iter().copied() {
        let row = format!("| `{}` | {} |", class.name(), class.what());
        assert!(page.lines().any(|line| line == row), "no row `{row}`");
    }
}

/// Runs the program; what it prints and its exit code.
fn pe_synth(arguments: &[&str]) -> (String, String, Option<i32>) {
    let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().expect("cargo built it");
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    (text(output.stdout), text(output.stderr), output.status.code())
}

/// Compiles a model into a folder.
fn compiled(model: &str, options: &[&str], folder: &Path) -> String {
    let (spec, folder) = (spec(model).display().to_string(), folder.display().to_string());
    let arguments = [&["compile", &spec, "--quiet", "--no-pictures", "-o", &folder], options].concat();
    let (_, errors, code) = pe_synth(&arguments);
    assert_eq!(code, Some(0), "{errors}");
    folder
}

#[test]
fn a_small_campaign_catches_or_proves_damage_and_is_the_same_again() {
    let folder = Folder::new("inject_campaign");
    let design = compiled("van_der_pol", &["--pes", "2", "--span", "100ms"], &folder.0.join("design"));
    let campaign = |count, seed| -> (serde_json::Value, String) {
        let (text, errors, code) =
            pe_synth(&["verify", &design, "--inject", count, "--seed", seed, "--message-format", "json"]);
        let result: serde_json::Value = serde_json::from_str(&text).unwrap_or_else(|_| panic!("{text}{errors}"));
        let missed = result["all"]["missed"].as_u64().expect("a count");
        assert_eq!(code, Some(if missed == 0 { 0 } else { 4 }), "{errors}");
        (result, text)
    };
    let (damages, injected, caught) = if is_long_suite() { ("30", 30, 10) } else { ("10", 10, 4) };
    let (result, text) = campaign(damages, "1");
    let count = |name: &str| result["all"][name].as_u64().expect("a count");
    assert_eq!(count("injected"), injected);
    let fates = ["caught", "datasheet", "equivalence", "never_read", "missed"];
    assert_eq!(fates.map(count).iter().sum::<u64>(), injected);
    assert!(count("caught") > caught && count("datasheet") > 1, "{text}");
    assert_eq!(count("missed"), 0, "{text}");
    assert_eq!(campaign("2", "9").1, campaign("2", "9").1);
}

#[test]
fn a_folder_that_fails_undamaged_is_not_damaged() {
    let folder = Folder::new("inject_broken");
    let design = compiled("harmonic_oscillator", &["--span", "100ms"], &folder.0.join("design"));
    let file = folder.0.join("design/hdl/pe_multiplier.vhd");
    let text = std::fs::read_to_string(&file).expect("the design has it");
    std::fs::write(&file, text.replace("product_o <= product;", "product_o <= (others => '0');")).expect("writable");
    let (text, errors, code) = pe_synth(&["verify", &design, "--inject", "3"]);
    assert_eq!((code, text.as_str()), (Some(4), ""), "{errors}");
    let (_, errors, code) = pe_synth(&["verify", &design, "--seed", "3"]);
    assert_eq!(code, Some(2), "{errors}");
}
