//! Every pass alone, from text to text: `tests/passes/PASS` has small inputs, `CASE.txt`, and what comes out,
//! `CASE.expect`.
//!
//! An input is made of [stage texts](../../../docs/stages.md); lines that begin with `#:` give the pass its options.
//! `UPDATE_EXPECT=1 cargo test -p pe-hls --test passes` writes what comes out now. All results go through the checkers.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use expect_test::expect_file;
use pe_hls::formats::{self, Ranges};
use pe_hls::mapping::{self, MapOptions, Problem};
use pe_hls::rounding::{self, Aim, Sampling};
use pe_hls::rounds::Rounds;
use pe_hls::step::StepOptions;
use pe_hls::{
    assemble, functions, fuse, grid, lift, outputs, pairs, parts, relay, rings, route, schedule, shorten, split, step,
    sums, two_slots,
};
use pe_ir::graph::{FixedPoint, StageForm, StepGraph};
use pe_ir::mapping::Mapping;
use pe_ir::model::{Model, Solver};
use pe_ir::program::{Fold, Program};
use pe_ir::schedule::Schedule;
use pe_ir::source::{Diagnostic, Sources};
use pe_ir::text::labels::Labels;
use pe_ir::text::{self, Section, Stage, TextError};
use pe_ir::verify;
use pe_ir::word::{Latency, Pipeline, WordFormat};

/// The input of a pass.
struct Case {
    name: String,
    text: String,
}

impl Case {
    /// The words behind each option of a name.
    fn options<'a>(&'a self, name: &'a str) -> impl Iterator<Item = Vec<&'a str>> {
        let lines = self.text.lines().filter_map(|line| line.strip_prefix("#:"));
        let words = lines.map(|line| line.split_whitespace().collect::<Vec<_>>());
        words.filter(move |words| words.first() == Some(&name)).map(|words| words[1..].to_vec())
    }

    fn option<T: FromStr>(&self, name: &str, default: T) -> T {
        let given = self.options(name).next();
        given.map_or(default, |words| words[0].parse().ok().unwrap_or_else(|| panic!("{}: option {name}", self.name)))
    }

    fn format(&self) -> WordFormat {
        let (storage, data, coefficient) = match self.options("format").next() {
            Some(words) => (words[0].parse().unwrap(), words[1].parse().unwrap(), words[2].parse().unwrap()),
            None => (32, 32, 32),
        };
        let deep = self.options("deep").next().is_some();
        WordFormat::new(storage, data, coefficient).with_pipeline(if deep { Pipeline::Deep } else { Pipeline::Short })
    }

    fn section(&self, stage: Stage) -> Section<'_> {
        let sections = text::sections(&self.text).unwrap_or_else(|error| panic!("{}: {error}", self.name));
        sections
            .into_iter()
            .find(|section| section.stage == stage)
            .unwrap_or_else(|| panic!("{}: no {stage:?}", self.name))
    }

    fn read<T>(&self, stage: Stage, read: impl FnOnce(&Section) -> Result<T, TextError>) -> T {
        read(&self.section(stage)).unwrap_or_else(|error| panic!("{}: {error}", self.name))
    }

    fn model(&self) -> Model {
        self.read(Stage::Model, text::model::read)
    }

    fn graph(&self) -> StepGraph {
        self.read(Stage::Step, text::step::read)
    }

    fn fixed(&self, graph: &StepGraph) -> FixedPoint {
        self.read(Stage::Fixed, |section| text::fixed::read(section, graph))
    }

    fn mapping(&self, graph: &StepGraph) -> Mapping {
        self.read(Stage::Mapping, |section| text::mapping::read(section, graph))
    }

    fn schedule(&self, graph: &StepGraph, pes: u32) -> Schedule {
        self.read(Stage::Schedule, |section| text::schedule::read(section, graph, pes))
    }

    /// Numbers of values: those that options `largest NAME X` give, 1 for all others.
    fn largest(&self, graph: &StepGraph) -> Vec<f64> {
        let labels = Labels::of_values(graph);
        let mut largest = vec![1.0; graph.values.len()];
        for words in self.options("largest") {
            let value = labels.find(words[0]).unwrap_or_else(|| panic!("{}: no value {}", self.name, words[0]));
            largest[value as usize] = words[1].parse().unwrap();
        }
        largest
    }

    /// Findings with the lines that they are about.
    fn findings(&self, findings: &[Diagnostic]) -> String {
        let sources = Sources::new("", &self.text);
        let mut text = String::new();
        for finding in findings {
            _ = writeln!(text, "{finding}");
            if let Some(span) = finding.span {
                let around = sources.lines_around(span);
                let line = &self.text[around.start as usize..around.end as usize];
                _ = writeln!(text, "  at {}", line.trim());
            }
            if let Some(help) = &finding.help {
                _ = writeln!(text, "  help: {help}");
            }
        }
        text
    }
}

/// Runs a pass on all its cases.
fn check(pass: &str, run: impl Fn(&Case) -> String) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/passes").join(pass);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut inputs: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    inputs.retain(|path| path.extension().is_some_and(|extension| extension == "txt"));
    inputs.sort();
    assert!(!inputs.is_empty(), "{pass} has no cases");
    for input in inputs {
        let name = format!("{pass}/{}", input.file_stem().unwrap().display());
        let case = Case { text: std::fs::read_to_string(&input).unwrap(), name };
        expect_file![input.with_extension("expect")].assert_eq(&run(&case));
    }
}

/// The text of a step, which is valid and read as it was printed.
fn valid_step(graph: &StepGraph) -> String {
    assert_eq!(verify::step::check(graph), Vec::<String>::new());
    let text = graph.to_string();
    let mut read: StepGraph = text.parse().unwrap_or_else(|error| panic!("{error}\n{text}"));
    for (read, equation) in read.equations.iter_mut().zip(&graph.equations) {
        read.span = equation.span;
    }
    assert_eq!(format!("{read:?}"), format!("{graph:?}"));
    text
}

/// The only section of a text that was printed.
fn reread<T>(text: &str, stage: Stage, read: impl FnOnce(&Section) -> Result<T, TextError>) -> T {
    text::single(text, stage).and_then(|section| read(&section)).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn valid_mapping(graph: &StepGraph, mapping: &Mapping) -> String {
    let text = text::mapping::print(graph, mapping);
    assert_eq!(&reread(&text, Stage::Mapping, |section| text::mapping::read(section, graph)), mapping);
    text
}

fn step_or_unchanged(graph: Option<&StepGraph>) -> String {
    graph.map_or("unchanged\n".to_owned(), valid_step)
}

fn valid_fixed(graph: &StepGraph, fixed: &FixedPoint) -> String {
    assert_eq!(verify::fixed::check(graph, fixed), Vec::<String>::new());
    let text = text::fixed::print(graph, fixed);
    assert_eq!(&reread(&text, Stage::Fixed, |section| text::fixed::read(section, graph)), fixed);
    text
}

#[test]
fn fuse_writes_out_equations_within_functions() {
    check("fuse", |case| {
        let (fused, findings) = fuse::fuse(case.model());
        assert_eq!(verify::model::check(&fused), Vec::<String>::new());
        let lifted = lift::lift(fused);
        // A step that is taken again makes no other model.
        let mut again = lifted.clone();
        again.set_step(lifted.step);
        assert_eq!(again.to_string(), lifted.to_string());
        format!("{lifted}{}", case.findings(&findings))
    });
}

#[test]
fn lift_makes_equations_of_functions_of_one_variable() {
    check("lift", |case| {
        let lifted = lift::lift(case.model());
        assert_eq!(verify::model::check(&lifted), Vec::<String>::new());
        lifted.to_string()
    });
}

#[test]
fn step_writes_one_step_of_the_solver_as_chains() {
    check("step", |case| {
        let mut model = lift::lift(case.model());
        if let Some(words) = case.options("solver").next() {
            model.solver = Solver::ALL.into_iter().find(|solver| solver.name() == words[0]).expect("a solver");
        }
        let form = case.options("form").next();
        let form = form.map(|words| StageForm::ALL.into_iter().find(|form| form.name() == words[0]).expect("a form"));
        let options = StepOptions {
            form,
            pes: case.options("pes").next().map(|words| words[0].parse().unwrap()),
            pre_adder: case.options("no_pre_adder").next().is_none(),
            ..StepOptions::default()
        };
        match step::build_with(&model, &options) {
            Ok(graph) => valid_step(&graph),
            Err(findings) => case.findings(&findings),
        }
    });
}

/// The step with tables for the arguments that the options of a case state.
fn tabulated(case: &Case) -> Result<StepGraph, Vec<Diagnostic>> {
    let graph = case.graph();
    let ends = |words: Vec<&str>| (words[0].parse().unwrap(), words[1].parse().unwrap());
    let of_functions: Vec<(f64, f64)> = case.options("arguments").map(ends).collect();
    // Those of single values come first.
    let labels = Labels::of_values(&graph);
    let mut arguments = vec![(f64::INFINITY, f64::NEG_INFINITY); graph.values.len()];
    for chain in &graph.chains {
        let Some(function) = chain.function else { continue };
        let index = chain.write.value.index();
        let own = case.options("arguments_of").find(|words| labels.find(words[0]) == Some(index as u32));
        arguments[index] = own.map_or_else(|| of_functions[function as usize], |words| ends(words[1..].to_vec()));
    }
    functions::tabulate(&graph, &arguments, case.format(), &[])
        .map_err(|untabled| untabled.into_iter().map(|untabled| untabled.finding).collect())
}

/// A step without the entries of its tables, which unit tests are about.
fn without_entries(text: &str) -> String {
    text.lines().filter(|line| !line.starts_with("  column")).map(|line| format!("{line}\n")).collect()
}

#[test]
fn functions_become_tables() {
    check("functions", |case| match tabulated(case) {
        Ok(graph) => without_entries(&valid_step(&graph)),
        Err(findings) => case.findings(&findings),
    });
}

#[test]
fn tables_are_shortened_where_latency_binds() {
    check("shorten", |case| {
        let graph = tabulated(case).expect("it has tables");
        let latency = Latency::of(&case.format());
        without_entries(&step_or_unchanged(shorten::shorten(&graph, case.option("pes", 2), latency).as_ref()))
    });
}

#[test]
fn split_makes_trees_of_heavy_equations() {
    check("split", |case| {
        let latency = Latency::of(&case.format());
        let split = split::split(&case.graph(), case.option("pes", 2), case.option("max_in_degree", 15), latency);
        step_or_unchanged(split.as_ref())
    });
}

#[test]
fn grid_cuts_sums_over_nearly_everything() {
    check("grid", |case| {
        let latency = Latency::of(&case.format());
        let on_grid = grid::grid(&case.graph(), case.option("pes", 4), case.option("max_in_degree", 15), latency);
        step_or_unchanged(on_grid.as_ref().map(|on_grid| &on_grid.graph))
    });
}

#[test]
fn parts_that_are_alike_get_the_same_terms() {
    check("parts", |case| {
        let arranged = parts::arranged(&case.graph(), case.option("pes", 1));
        if let Some(arranged) = &arranged {
            let parts = &arranged.parts;
            assert!(parts.of.numbered().all(|(equation, (part, like))| (*part == 0) == (equation == *like)));
        }
        // Texts have the terms only.
        let text = |graph: StepGraph| {
            format!("{} parts\n{}", graph.parts.count, valid_step(&StepGraph { parts: Default::default(), ..graph }))
        };
        arranged.map_or("unchanged\n".to_owned(), text)
    });
}

#[test]
fn sums_are_cut_to_what_the_accumulator_holds() {
    check("sums", |case| step_or_unchanged(sums::cut(&case.graph(), &case.format()).as_ref()));
}

#[test]
fn relay_copies_what_many_read() {
    check("relay", |case| {
        let (pes, max_in_degree, relays) =
            (case.option("pes", 4), case.option("max_in_degree", 15), case.option("relays", 1));
        step_or_unchanged(
            relay::relay(&case.graph(), pes, max_in_degree, relays).as_ref().map(|relayed| &*relayed.graph),
        )
    });
}

#[test]
fn rings_keep_rows_of_past_words() {
    check("rings", |case| {
        let graph = case.graph();
        let fixed = case.fixed(&graph);
        let choice = match case.option("choice", "cost".to_owned()).as_str() {
            "rings" => rings::Choice::Rings,
            "copies" => rings::Choice::Copies,
            _ => rings::Choice::ByCost,
        };
        match rings::rings(&graph, &fixed, choice) {
            Some(ringed) => valid_step(&ringed.graph) + &valid_fixed(&ringed.graph, &ringed.fixed),
            None => "unchanged\n".to_owned(),
        }
    });
}

#[test]
fn route_copies_what_comes_from_far() {
    check("route", |case| {
        let graph = case.graph();
        match route::route(&graph, &case.mapping(&graph), case.option("max_in_degree", 2)) {
            Some(routed) => {
                let cost = Problem::of(&routed.relayed.graph).cost(&routed.mapping);
                let found = verify::mapping::check(&routed.relayed.graph, &routed.mapping, &cost, cost.max_in_degree);
                assert_eq!(found, Vec::<String>::new());
                valid_step(&routed.relayed.graph) + &valid_mapping(&routed.relayed.graph, &routed.mapping)
            }
            None => "no routes\n".to_owned(),
        }
    });
}

#[test]
fn formats_are_chosen_from_ranges() {
    check("formats", |case| {
        let graph = case.graph();
        let mut widened = vec![0; graph.values.len()];
        let labels = Labels::of_values(&graph);
        for words in case.options("widened") {
            widened[labels.find(words[0]).expect("a value") as usize] = words[1].parse().unwrap();
        }
        match formats::choose(&graph, &Ranges { largest: case.largest(&graph), widened }, case.format()) {
            Ok(fixed) => valid_fixed(&graph, &fixed),
            Err(finding) => case.findings(&[finding]),
        }
    });
}

#[test]
fn roundings_cancel_in_the_samples() {
    check("rounding", |case| {
        let graph = case.graph();
        let mut fixed = case.fixed(&graph);
        let labels = Labels::of_values(&graph);
        let mut sampling = Sampling::new(&graph);
        for words in case.options("sample") {
            let mut numbers = vec![0.0; graph.values.len()];
            for pair in words.chunks(2) {
                numbers[labels.find(pair[0]).expect("a value") as usize] = pair[1].parse().unwrap();
            }
            sampling.add(|value| numbers[value]);
        }
        let aim = if case.option("aim", "chain".to_owned()) == "step" { Aim::Step } else { Aim::Chain };
        rounding::improve(&graph, &mut fixed, &sampling.moments(), aim);
        valid_fixed(&graph, &fixed)
    });
}

#[test]
fn coefficients_take_two_slots() {
    check("two_slots", |case| {
        let graph = case.graph();
        step_or_unchanged(two_slots::split(&graph, &case.fixed(&graph)).as_ref())
    });
}

#[test]
fn mapping_gives_equations_to_pes() {
    check("mapping", |case| {
        let graph = case.graph();
        let problem = Problem::of(&graph);
        let max_in_degree = case.option("max_in_degree", 15);
        let options = MapOptions {
            pes: case.option("pes", 2),
            seed: case.option("seed", 1),
            tries: case.option("tries", 20_000),
            max_in_degree,
        };
        match mapping::map(&problem, &options) {
            Ok(candidates) => {
                let mut text = String::new();
                for candidate in &candidates {
                    let (cost, mapping) = (&candidate.cost, &candidate.mapping);
                    assert_eq!(verify::mapping::check(&graph, mapping, cost, max_in_degree), Vec::<String>::new());
                    let (load, connections, ports) = (cost.max_load, cost.connections, cost.max_in_degree);
                    _ = writeln!(text, "# {}: load {load}, {connections} connections, {ports} ports", candidate.start);
                }
                text + &valid_mapping(&graph, &candidates[0].mapping)
            }
            Err(error) => format!("{error}\n"),
        }
    });
}

#[test]
fn pairs_add_operands_with_equal_coefficients() {
    check("pairs", |case| {
        let graph = case.graph();
        let paired = pairs::pair(&graph, &case.fixed(&graph), &case.mapping(&graph));
        match paired {
            None => "unchanged\n".to_owned(),
            Some(paired) => {
                let text = format!("# {} pairs, {} values sent home\n", paired.pairs, paired.sent_home);
                text + &valid_step(&paired.graph) + &valid_fixed(&paired.graph, &paired.fixed)
            }
        }
    });
}

#[test]
fn schedule_gives_chains_and_transfers_their_words() {
    check("schedule", |case| {
        let graph = case.graph();
        let (mapping, latency) = (case.mapping(&graph), Latency::of(&case.format()));
        let schedule = schedule::schedule(&graph, &mapping, latency);
        assert_eq!(verify::schedule::check(&graph, &mapping, &schedule, latency), Vec::<String>::new());
        let text = text::schedule::print(&graph, &schedule);
        let read = |section: &Section| text::schedule::read(section, &graph, mapping.pes);
        assert_eq!(reread(&text, Stage::Schedule, read), schedule);
        let bound = schedule::Bound::of(&graph, mapping.pes, latency).binding();
        format!("# no shorter than {} by {}\n", bound.0, bound.1) + &text
    });
}

#[test]
fn rounds_are_stages_that_are_alike() {
    check("rounds", |case| {
        let graph = case.graph();
        match Rounds::of(&graph, &case.fixed(&graph)) {
            None => "one round\n".to_owned(),
            Some(rounds) => format!("# {} rounds\n{}", rounds.count, rounds.graph),
        }
    });
}

#[test]
fn assemble_writes_control_words_and_images() {
    check("assemble", |case| {
        let (model, graph) = (case.model(), case.graph());
        let (fixed, mapping) = (case.fixed(&graph), case.mapping(&graph));
        let schedule = case.schedule(&graph, mapping.pes);
        let latency = Latency::of(&fixed.format);
        assert_eq!(verify::schedule::check(&graph, &mapping, &schedule, latency), Vec::<String>::new());
        match assemble::assemble(&model, &graph, &fixed, &mapping, &schedule) {
            Ok(program) => {
                assert_eq!(verify::program::check(&program, &graph, &fixed, 3), Vec::<String>::new());
                let text = program.to_string();
                let read: Program = text.parse().unwrap_or_else(|error| panic!("{error}\n{text}"));
                // Names are numbered anew; the text has them all.
                assert_eq!(read.to_string(), text);
                text
            }
            Err(limit) => format!("{limit}\n"),
        }
    });
}

#[test]
fn fold_keeps_what_rounds_repeat_once() {
    check("fold", |case| {
        let program = case.read(Stage::Program, pe_ir::program::read);
        let mut text = String::new();
        for (index, pe) in program.pes.iter().enumerate() {
            let fold = Fold::of(&program, pe);
            let (repeated, streamed) = (fold.all & !fold.streamed, fold.streamed);
            _ = writeln!(text, "pe {index} bits {:x} repeated {repeated:x} streamed {streamed:x}", fold.all);
            for (memory, words) in
                [("loop", &fold.repeated), ("stream", &fold.stream), ("variant", &fold.variant_words)]
            {
                for (address, word) in words.iter().enumerate() {
                    _ = writeln!(text, "{memory} {address} {word:x}");
                }
            }
            for (word, variant) in fold.variant_of.iter().enumerate() {
                _ = writeln!(text, "word {word} takes variant {variant}");
            }
        }
        text
    });
}

#[test]
fn outputs_get_places_in_the_order_of_their_words() {
    check("outputs", |case| {
        let mut program = case.read(Stage::Program, pe_ir::program::read);
        match outputs::to_memory(&mut program) {
            Ok(()) => {
                assert_eq!(program.check_outputs(), Ok(()));
                let text = program.to_string();
                assert_eq!(text.parse::<Program>().map(|read| read.to_string()), Ok(text.clone()));
                text
            }
            Err(reason) => format!("{reason}\n"),
        }
    });
}

#[test]
fn every_pass_has_cases() {
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/passes");
    for pass in pe_hls::PASSES {
        let cases = std::fs::read_dir(home.join(pass.name)).map_or(0, Iterator::count);
        assert!(cases > 0, "{} has no case", pass.name);
    }
}

#[test]
fn the_architecture_lists_the_passes() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/architecture.md");
    let text = std::fs::read_to_string(path).expect("the document");
    let rows: Vec<&str> = text
        .lines()
        .skip_while(|line| *line != "| pass | reads | makes | purpose |")
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .collect();
    let row = |pass: &pe_hls::Pass| format!("| `{}` | {} | {} | {} |", pass.name, pass.reads, pass.makes, pass.purpose);
    assert_eq!(rows, pe_hls::PASSES.iter().map(row).collect::<Vec<_>>());
}
