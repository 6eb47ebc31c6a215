//! The validation set: compiles the cases of `models/validation/cases.csv` and holds each against its reference.
//!
//! A reference is a small file of states at times, made by `models/validation/reference.py` with another library. Used
//! by the tests, and by `examples/validation.rs`, which prints the table of `docs/validation.md`.

// The test and the example each use a part.
#![allow(dead_code)]

use std::f64::consts::TAU;
use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use pe_flow::failure::Failure;
use pe_flow::pipeline::{self, Design};
use pe_flow::watch::Stopwatch;
use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_judge::progress::silent;
use pe_judge::runs::port_words;
use pe_judge::total;
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;
use pe_sim::fixed::FixedRun;
use pe_synth::options::DesignArgs;

/// Times closer than this part of the last one are the same.
const SAME_TIME: f64 = 1e-9;

/// A model with options, and what must come out.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the case.
    pub name: String,
    /// The spec, below `models/`.
    pub spec: String,
    /// Name of the reference; the spec has none in this set if it is empty.
    pub reference: String,
    /// Options of the command line.
    pub options: String,
    /// Codes of errors and warnings that it must end with, or `fine`.
    pub verdict: String,
    /// Largest word-length error that is accepted, coefficients included, and the one that is aimed at.
    pub word_length: Option<(f64, f64)>,
    /// Largest total error at the times of the reference that is accepted, and error in double precision.
    pub total: Option<f64>,
    /// The same of all steps.
    pub steps: Option<f64>,
    /// Whether it takes little enough time for the test.
    pub quick: bool,
}

/// What came out.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Codes of errors and warnings, ascending, or `fine`.
    pub verdict: String,
    /// The first of the messages.
    pub message: Option<String>,
    /// The step in double precision against the reference, if there is one and the run does not diverge.
    pub method: Option<f64>,
    /// Figures, unless it was refused.
    pub figures: Option<Figures>,
    /// Seconds of the compiler.
    pub seconds: f64,
}

/// Figures of a compiled case. Errors are relative to the largest magnitude of a state; the worst state counts.
#[derive(Clone, Debug)]
pub struct Figures {
    /// Name of the solver and step in seconds.
    pub method: (String, f64),
    /// Number of states.
    pub states: usize,
    /// Steps of the span.
    pub steps: u64,
    /// Clocks per step.
    pub cycles: u32,
    /// Fixed point against double precision with exact coefficients.
    pub word_length: f64,
    /// Its state.
    pub worst: String,
    /// The part of coefficients alone.
    pub coefficient: f64,
    /// What the compiler states without a reference: word length, method, functions and input hold together.
    pub parts: f64,
    /// Fixed point against the reference at all of its times, if there is one.
    pub total: Option<f64>,
    /// What is known of all steps, where it was asked for and there is a reference.
    pub whole: Option<Whole>,
}

/// All steps of a case. Errors are those of the worst state, relative to its largest magnitude.
#[derive(Clone, Copy, Debug)]
pub struct Whole {
    /// The total error that the compiler states with `--reference`.
    pub stated: f64,
    /// Fixed point against the solution after every step.
    pub truth: f64,
    /// That solution against the reference, at the times of the reference.
    pub doubt: f64,
}

/// The part of the truth that a stated error may be at least.
pub const LEAST_STATED: f64 = 1.0 / 3.0;

/// Relative error below which reference and roundings of its digits are what is seen.
const SEEN: f64 = 1e-10;

/// Part of the truth that the solution it is held against may be off the reference, and a difference that the digits of a
/// reference and the agreement of its methods explain.
const DOUBT: f64 = 0.1;
const EXPLAINED: f64 = 1e-9;

/// What errors of angles are relative to, in turns.
const HALF_TURN: f64 = 0.5;

impl Figures {
    /// The true largest error as far as it is known: over all steps, or else at the times of the reference. None without a
    /// reference, or where it is below what can be seen.
    pub fn truth(&self) -> Option<f64> {
        let everywhere = self.whole.map_or(0.0, |whole| whole.truth);
        self.total.map(|total| total.max(everywhere)).filter(|truth| *truth > SEEN)
    }

    /// The sum of the parts as a part of the truth.
    pub fn parts_of_truth(&self) -> Option<f64> {
        self.truth().map(|truth| self.parts / truth)
    }

    /// What is stated with `--reference` as a part of the truth.
    pub fn stated_of_truth(&self) -> Option<f64> {
        self.truth().zip(self.whole).map(|(truth, whole)| whole.stated / truth)
    }
}

/// The folder of all models.
fn models() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// The words of a command line: blanks part them, but not those between single quotes, as in `--set 'a = 1'`.
pub fn words(options: &str) -> Vec<String> {
    let (mut words, mut word, mut quoted): (Vec<String>, Option<String>, bool) = (Vec::new(), None, false);
    for character in options.chars() {
        match character {
            '\'' => {
                quoted = !quoted;
                word.get_or_insert_default();
            }
            blank if blank.is_whitespace() && !quoted => words.extend(word.take()),
            other => word.get_or_insert_default().push(other),
        }
    }
    assert!(!quoted, "a quote is not closed in `{options}`");
    words.extend(word);
    words
}

/// All cases, in the order of their file.
pub fn cases() -> Vec<Case> {
    let path = models().join("validation/cases.csv");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_path(path).unwrap();
    let head: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let case = |record: csv::StringRecord| {
        let field = |name: &str| {
            let at = head.iter().position(|title| title == name).unwrap_or_else(|| panic!("cases.csv lacks `{name}`"));
            record[at].to_owned()
        };
        let number = |name: &str| {
            let text = field(name);
            (!text.is_empty()).then(|| text.parse::<f64>().unwrap_or_else(|_| panic!("`{text}` is not a number")))
        };
        Case {
            name: field("case"),
            spec: field("spec"),
            reference: field("reference"),
            options: field("options"),
            verdict: field("verdict"),
            word_length: number("word must").zip(number("word aim")),
            total: number("total must"),
            steps: number("steps must"),
            quick: field("run") == "quick",
        }
    };
    let cases: Vec<Case> = reader.records().map(|record| case(record.expect("cases.csv can be read"))).collect();
    assert!(!cases.is_empty(), "there are no cases");
    cases
}

/// States at times, from a file beside the models.
pub struct Reference {
    /// Names of the states.
    names: Vec<String>,
    /// Largest magnitude of each over the span.
    largest: Vec<f64>,
    /// Time and states.
    rows: Vec<(f64, Vec<f64>)>,
}

impl Reference {
    /// Reads a reference.
    pub fn read(name: &str) -> Reference {
        let path = models().join(format!("validation/reference/{name}.csv"));
        Reference::parse(&std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{name}: {error}")))
    }

    /// Parses the text of a reference: remarks, names, largest magnitudes, rows.
    pub fn parse(text: &str) -> Reference {
        let mut lines = text.lines().filter(|line| !line.starts_with('#')).map(|line| line.split_once(',').unwrap());
        let (_, names) = lines.next().expect("a line of names");
        let numbers = |text: &str| -> Vec<f64> { text.split(',').map(|n| n.parse().expect("a number")).collect() };
        let (title, largest) = lines.next().expect("a line of magnitudes");
        assert_eq!(title, "largest");
        let rows = lines.map(|(time, states)| (time.parse().expect("a time"), numbers(states))).collect();
        Reference { names: names.split(',').map(str::to_owned).collect(), largest: numbers(largest), rows }
    }

    /// The column of a state, and the radians of its unit if it is an angle: those are kept in turns.
    fn column(&self, name: &str) -> (usize, Option<f64>) {
        let (wanted, unit) = name.strip_suffix(".turns").map_or((name, None), |angle| (angle, Some(TAU)));
        let column = self.names.iter().position(|known| known == wanted);
        (column.unwrap_or_else(|| panic!("the reference lacks `{wanted}`")), unit)
    }

    /// Magnitudes that errors of these states are relative to, as the compiler takes them from its own runs.
    fn scales(&self, states: &[(&str, u32)]) -> Vec<f64> {
        let largest = states.iter().map(|(name, _)| match self.column(name) {
            (_, Some(_)) => HALF_TURN,
            (column, None) => self.largest[column],
        });
        let largest = largest.collect();
        let quantities: Vec<u32> = states.iter().map(|(_, quantity)| *quantity).collect();
        Trajectory { largest, ..Trajectory::new(states.len()) }.scales(&quantities)
    }

    /// Times of the rows.
    pub fn times(&self) -> impl Iterator<Item = f64> {
        self.rows.iter().map(|(time, _)| *time)
    }

    /// The largest error of a run, relative to the largest magnitude of the state. `states` are those of the run, names and
    /// quantities.
    ///
    /// # Panics
    /// If a state or a time of the reference is not in the run: a comparison of nothing must not pass.
    pub fn error(&self, states: &[(&str, u32)], times: &[f64], run: &Trajectory) -> f64 {
        assert!(!self.rows.is_empty() && !states.is_empty(), "nothing to compare");
        let end = self.rows.last().map_or(0.0, |(time, _)| *time);
        let scales = self.scales(states);
        let mut worst = 0.0f64;
        for (time, expected) in &self.rows {
            let sample = times.partition_point(|sample| *sample < time - SAME_TIME * end);
            let found = times.get(sample).filter(|sample| **sample <= time + SAME_TIME * end);
            assert!(found.is_some(), "the run has no sample at t = {time}");
            for (state, (name, _)) in states.iter().enumerate() {
                let (column, unit) = self.column(name);
                let difference = run.samples[sample * run.states + state] - expected[column] / unit.unwrap_or(1.0);
                let error = apart(difference, unit.is_some()) / scales[state];
                worst = if error.is_nan() { f64::INFINITY } else { worst.max(error) };
            }
        }
        worst
    }
}

impl Case {
    /// Compiles the case and compares it with its reference, `everywhere` also with a solution after every step that
    /// agrees with the reference.
    pub fn run(&self, everywhere: bool) -> Outcome {
        let clock = Instant::now();
        let spec = models().join(&self.spec).into_os_string();
        let words = ["validation".into(), spec].into_iter().chain(words(&self.options).into_iter().map(Into::into));
        let options = DesignArgs::try_parse_from(words).unwrap_or_else(|error| panic!("{}: {error}", self.name));
        let reference = (!self.reference.is_empty()).then(|| Reference::read(&self.reference));
        let (mut method, mut seconds) = (None, None);
        let design = options.load().and_then(|loaded| {
            let watch = &mut Stopwatch::silent();
            if let Some(reference) = &reference {
                let graph = pipeline::build(&loaded, &options.point.point(), &options.mapping.options(), watch)?;
                method = in_double_precision(&loaded.model, &graph, reference);
            }
            let design = options.design(&loaded, watch)?;
            seconds = Some(clock.elapsed().as_secs_f64());
            Ok((figures(&loaded.model, &design, reference.as_ref(), everywhere), design))
        });
        let seconds = seconds.unwrap_or_else(|| clock.elapsed().as_secs_f64());
        let (findings, figures) = match design {
            Ok((figures, design)) => (design.judged.warnings.clone(), Some(figures)),
            Err(Failure::Spec(findings, _)) => (findings, None),
            Err(failure) => panic!("{}: {failure:?}", self.name),
        };
        let mut codes: Vec<&str> = findings.iter().map(|finding| finding.code).collect();
        codes.sort_unstable();
        codes.dedup();
        let verdict = if codes.is_empty() { "fine".to_owned() } else { codes.join(" ") };
        Outcome { verdict, message: findings.first().map(|finding| finding.message.clone()), method, figures, seconds }
    }

    /// Why an outcome is not what the case asks for; empty if it is.
    pub fn complaints(&self, outcome: &Outcome) -> Vec<String> {
        let mut complaints = Vec::new();
        if outcome.verdict != self.verdict {
            let message = outcome.message.as_deref().unwrap_or("no message");
            complaints.push(format!("{}: {} in place of {}: {message}", self.name, outcome.verdict, self.verdict));
        }
        let word_length = outcome.figures.as_ref().map(|figures| figures.word_length);
        let total = outcome.figures.as_ref().and_then(|figures| figures.total);
        let whole = outcome.figures.as_ref().and_then(|figures| figures.whole);
        // What is refused on purpose has no figures but that of double precision, where it gets so far.
        let refused = outcome.figures.is_none() && self.verdict == outcome.verdict;
        let word_must = self.word_length.map(|(must, _)| must);
        for (what, found, most, needed) in [
            ("word-length", word_length, word_must, !refused),
            ("total", total, self.total, !refused),
            ("largest of all steps'", whole.map(|whole| whole.truth), self.steps, false),
            ("method", outcome.method, self.total, true),
        ] {
            match (found, most) {
                (Some(found), Some(most)) if found <= most => {}
                (_, None) => {}
                (None, _) if !needed => {}
                (found, Some(most)) => {
                    let found = found.map_or("no".to_owned(), |found| format!("{found:.1e} as"));
                    complaints.push(format!("{}: {found} {what} error, at most {most:.1e} is accepted", self.name));
                }
            }
        }
        let Some(figures) = &outcome.figures else { return complaints };
        for (what, part) in [("sum of the parts", figures.parts_of_truth()), ("total", figures.stated_of_truth())] {
            if let Some(part) = part.filter(|part| part.is_nan() || *part < LEAST_STATED) {
                complaints.push(format!("{}: the stated {what} is {part:.2} of the truth", self.name));
            }
        }
        let doubtful = |whole: &Whole| whole.doubt.is_nan() || whole.doubt > EXPLAINED.max(DOUBT * whole.truth);
        if let Some(whole) = figures.whole.filter(doubtful) {
            complaints.push(format!("{}: the solution is {:.1e} off the reference", self.name, whole.doubt));
        }
        complaints
    }
}

fn figures(model: &Model, design: &Design, reference: Option<&Reference>, everywhere: bool) -> Figures {
    let judged = &design.judged;
    Figures {
        method: (model.solver.name().to_owned(), model.step),
        states: model.states.len(),
        steps: model.steps(),
        cycles: design.program.period,
        word_length: judged.errors.word_length,
        worst: model.states[judged.errors.worst_state].name.clone(),
        coefficient: judged.errors.coefficient,
        parts: judged.errors.word_length
            + judged.errors.method
            + judged.errors.function.unwrap_or(0.0)
            + judged.errors.input_hold,
        total: reference.map(|reference| in_fixed_point(model, design, reference)),
        whole: reference.filter(|_| everywhere).map(|reference| whole(model, design, reference)),
    }
}

/// Compares every step with a solution of the model by the library that `--reference` uses, which stops at each of them.
/// That it is the model's is what the reference says.
fn whole(model: &Model, design: &Design, reference: &Reference) -> Whole {
    let judged = &design.judged;
    let known = total::Reference::solve(model, &judged.times, &judged.looks.times, &[], &*silent());
    let known = known.expect("a model with a reference has a solution");
    let times: Vec<f64> = (1..=model.steps()).map(|done| model.time(done, 0.0)).collect();
    let solution = pe_sim::reference::solve(model, &times, pe_sim::reference::TOLERANCE, &mut |_| {});
    let solution = solution.expect("a model with a reference has a solution");
    let mut run = FixedRun::new(&design.graph, &judged.fixed);
    let scales = reference.scales(&known_states(model));
    let mut truth = 0.0f64;
    for (step, row) in (0..).zip(solution.samples.chunks_exact(solution.states)) {
        run.step(&port_words(model, &run, step));
        for (state, (number, scale)) in row.iter().zip(&scales).enumerate() {
            let turns = model.states.get(state).is_some_and(|state| state.angle);
            let wrong = apart(run.state(StateId::at(state)) - number, turns) / scale;
            truth = if wrong.is_nan() { f64::INFINITY } else { truth.max(wrong) };
        }
    }
    let mut done = 0;
    let doubt = at_all_times(model, reference, |time, samples| {
        match time {
            Some(_) => done += 1,
            None => samples.push(|state| solution.samples[(done - 1) * solution.states + state]),
        }
        true
    });
    let doubt = doubt.expect("it was found");
    Whole { stated: known.compare(model, judged).whole.error, truth, doubt }
}

/// What two numbers differ by, if these are turns by less than one.
fn apart(difference: f64, turns: bool) -> f64 {
    if turns { (difference - difference.round()).abs() } else { difference.abs() }
}

/// Names and quantities of the states that a reference knows; behind them are those that signals are made of.
fn known_states(model: &Model) -> Vec<(&str, u32)> {
    let (of_signals, own): (Vec<_>, Vec<_>) = model.states.iter().enumerate().partition(|(_, s)| s.motion.is_some());
    assert!(of_signals.iter().all(|(index, _)| *index >= own.len()), "signals come last");
    own.iter().map(|(_, state)| (state.name.as_str(), state.quantity)).collect()
}

/// Error of the step graph in double precision; none if it diverges.
fn in_double_precision(model: &Model, graph: &StepGraph, reference: &Reference) -> Option<f64> {
    let mut run = DoubleRun::new(graph);
    at_all_times(model, reference, |time, samples| {
        if let Some(time) = time {
            return run.step(&model.sample_inputs(time)).is_ok();
        }
        samples.push(|state| run.state(StateId::at(state)));
        true
    })
}

/// Error of the hardware's numbers.
fn in_fixed_point(model: &Model, design: &Design, reference: &Reference) -> f64 {
    let mut run = FixedRun::new(&design.graph, &design.judged.fixed);
    let error = at_all_times(model, reference, |time, samples| {
        if let Some(time) = time {
            let inputs = model.sample_inputs(time).into_iter().enumerate();
            let words: Vec<i64> = inputs.map(|(index, number)| run.encode_input(index, number).0).collect();
            run.step(&words);
        } else {
            samples.push(|state| run.state(StateId::at(state)));
        }
        true
    });
    error.expect("fixed point does not diverge")
}

/// Error of a run at all times of a reference. `run` steps from a time on, or samples the states if there is none; it
/// gives false if it diverges.
fn at_all_times(
    model: &Model,
    reference: &Reference,
    mut run: impl FnMut(Option<f64>, &mut Trajectory) -> bool,
) -> Option<f64> {
    let mut samples = Trajectory::new(model.states.len());
    let (mut times, mut rows) = (Vec::new(), reference.times().peekable());
    for done in 1..=model.steps() {
        let (before, time) = (model.time(done - 1, 0.0), model.time(done, 0.0));
        if !run(Some(before), &mut samples) {
            return None;
        }
        if rows.peek().is_some_and(|row| (time - row).abs() <= (time - before) / 2.0) {
            rows.next();
            times.push(time);
            run(None, &mut samples);
        }
    }
    Some(reference.error(&known_states(model), &times, &samples))
}
