//! What must hold for any text: it is accepted, or refused with a place inside it; what is accepted is valid, and reads
//! back as it was printed.

use std::fmt::{Debug, Display};
use std::path::Path;
use std::str::FromStr;

use pe_flow::failure::Failure;
use pe_flow::mapping_file::MappingFile;
use pe_flow::stages;
use pe_frontend::{Limits, NoFiles, Overrides, elaborate_within, parse};
use pe_hls::lift;
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::program::Program;
use pe_ir::source::{Diagnostic, Severity, Sources, Span};
use pe_ir::text::{self, Section, Stage, TextError};
use pe_ir::verify;
use pe_ir::word::Latency;

use crate::Verdict;

/// Large models run into these limits instead of taking their full time thousands of times over.
const LIMITS: Limits = Limits { elements: 3_000, evaluations: 60_000, reads: 20_000 };

/// Most bytes of a message and its help: it may quote the text, but not all of it.
const LONGEST_MESSAGE: usize = 3_000;

/// A spec becomes findings, or a valid model that has a text.
pub fn spec(text: &str) -> Verdict {
    let mut sources = Sources::new("fuzzed.spec", text);
    let (spec, mut findings) = parse(&mut sources, &NoFiles);
    let (model, more) = elaborate_within(&spec, &Overrides::default(), &LIMITS);
    findings.extend(more);
    let errors: Vec<&Diagnostic> = findings.iter().filter(|finding| finding.severity == Severity::Error).collect();
    assert_eq!(model.is_none(), !errors.is_empty(), "{findings:?}");
    findings.iter().for_each(|finding| placed(finding, text));
    let Some(model) = model else { return errors.first().map(|error| error.message.clone()) };
    valid_model(&model);
    valid_model(&lift::lift(model));
    None
}

/// A text of stages becomes findings, or stages that their checkers look at. `path` is where the text lies.
pub fn stages(text: &str, path: &Path) -> Verdict {
    if let Err(failure) = MappingFile::read(Sources::new("fuzzed.txt", text)) {
        refused(failure, text);
    }
    match whole(text, path) {
        Ok(()) => None,
        Err(failure) => Some(refused(failure, text)),
    }
}

fn whole(text: &str, path: &Path) -> Result<(), Failure> {
    let (model, sources, stages) = stages::load(path)?;
    assert_eq!(sources.text(), text);
    valid_model(&model);
    let Some(graph) = &stages.graph else { return Ok(()) };
    valid_step(graph);
    let Some(fixed) = &stages.fixed else { return Ok(()) };
    assert_eq!(verify::fixed::check(graph, fixed), Vec::<String>::new());
    let printed = text::fixed::print(graph, fixed);
    assert_eq!(&reread(&printed, Stage::Fixed, |section| text::fixed::read(section, graph)), fixed);
    let Some(mapping) = &stages.mapping else { return Ok(()) };
    let mapping = mapping.mapping(graph)?;
    let printed = text::mapping::print(graph, &mapping);
    assert_eq!(reread(&printed, Stage::Mapping, |section| text::mapping::read(section, graph)), mapping);
    let given = Some((&stages, &sources));
    if let Some(schedule) = stages::schedule(given, graph, &mapping, Latency::of(&fixed.format))? {
        let printed = text::schedule::print(graph, &schedule);
        let read = |section: &Section| text::schedule::read(section, graph, mapping.pes);
        assert_eq!(reread(&printed, Stage::Schedule, read), schedule);
    }
    if let Some(program) = stages::program(given, graph, fixed, &mapping)? {
        same::<Program>(&stages::with_labels(&program, graph).to_string());
    }
    Ok(())
}

/// A program is refused, or reads back as it was printed.
pub fn program(text: &str) -> Verdict {
    match text.parse::<Program>() {
        Ok(program) => {
            same::<Program>(&program.to_string());
            None
        }
        Err(error) => {
            inside(error.span, text);
            assert!(error.line >= 1 && error.column >= 1, "{error:?}");
            Some(error.message)
        }
    }
}

/// The first message of a failure, which has to be one about the text.
fn refused(failure: Failure, text: &str) -> String {
    let Failure::Spec(findings, sources) = failure else { panic!("{failure:?}") };
    assert_eq!(sources.text(), text);
    findings.iter().for_each(|finding| placed(finding, text));
    findings.first().expect("a reason").message.clone()
}

fn placed(finding: &Diagnostic, text: &str) {
    let labels = finding.labels.iter().map(|(span, _)| *span);
    finding.span.into_iter().chain(labels).for_each(|span| inside(span, text));
    let known = pe_ir::codes::CODES.iter().any(|code| code.code == finding.code);
    assert!(known && finding.code.starts_with('E') == (finding.severity == Severity::Error), "{finding:?}");
    let length = finding.message.len() + finding.help.as_ref().map_or(0, String::len);
    assert!(length < LONGEST_MESSAGE, "a message of {length} bytes: {finding:?}");
}

fn inside(span: Span, text: &str) {
    // `get` wants the ends in order, inside the text and between characters.
    assert!(text.get(span.start as usize..span.end as usize).is_some(), "{span:?} lies outside");
}

fn valid_model(model: &Model) {
    assert_eq!(verify::model::check(model), Vec::<String>::new());
    let printed = model.to_string();
    let in_full = |model: &Model| format!("{:?}", model.without_spans());
    assert_eq!(in_full(&same(&printed)), in_full(model), "{printed}");
}

fn valid_step(graph: &StepGraph) {
    assert_eq!(verify::step::check(graph), Vec::<String>::new());
    let printed = graph.to_string();
    let mut read = same::<StepGraph>(&printed);
    for (read, equation) in read.equations.iter_mut().zip(&graph.equations) {
        read.span = equation.span;
    }
    assert_eq!(format!("{read:?}"), format!("{graph:?}"), "{printed}");
}

/// What is read from a text that was printed; it prints the same again.
fn same<T: FromStr<Err = TextError> + Display>(printed: &str) -> T {
    let read: T = printed.parse().unwrap_or_else(|error| panic!("{error}\n{printed}"));
    assert_eq!(read.to_string(), printed);
    read
}

/// The only section of a text that was printed.
fn reread<T: Debug>(text: &str, stage: Stage, read: impl FnOnce(&Section) -> Result<T, TextError>) -> T {
    text::single(text, stage).and_then(|section| read(&section)).unwrap_or_else(|error| panic!("{error}\n{text}"))
}
