//! Designs that continue from the text of a compiler stage, as `dump` prints it, instead of a spec.
//!
//! A text has the model and each stage up to the last one. What it holds is taken as it is, and proved like what the
//! compiler makes; the runs over the span take place all the same, for they say how wrong the result is.

use std::path::Path;
use std::sync::Arc;

use pe_frontend::LoadError;
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::index::List;
use pe_ir::mapping::Mapping;
use pe_ir::model::Model;
use pe_ir::program::{self, Program};
use pe_ir::schedule::Schedule;
use pe_ir::source::{Diagnostic, Sources};
use pe_ir::text::labels::{Labels, distinct};
use pe_ir::text::{self, Place, Section, Stage, TextError};
use pe_ir::verify;
use pe_ir::word::Latency;

use crate::failure::Failure;
use crate::mapping_file::MappingFile;
use crate::read::at_most;

/// Rounds that the program checker runs: the first fills the pipeline, the second and third see both parities.
pub(crate) const CHECKED_ROUNDS: u32 = 3;

/// What a text says beside the model.
#[derive(Debug)]
pub struct Stages {
    /// Its last stage.
    pub last: Stage,
    /// The step, split for a number of PEs.
    pub graph: Option<Arc<StepGraph>>,
    /// Number formats of the step.
    pub fixed: Option<FixedPoint>,
    /// The mapping.
    pub mapping: Option<MappingFile>,
    /// Where the schedule is, which can be read when the step is known as it is issued.
    schedule: Option<Place>,
    /// The program; its notes have numbers of their own.
    pub program: Option<Program>,
    /// Where the program is.
    of_program: Option<Place>,
}

/// Reads the text of a stage, with all stages before it.
///
/// # Errors
/// [`Failure::File`], and the first place that cannot be read, or stage that is not valid.
pub fn load(path: &Path) -> Result<(Model, Sources, Stages), Failure> {
    let sources = sources(path)?;
    match Stages::read(&sources) {
        Ok((model, stages)) => Ok((model, sources, stages)),
        Err(error) => Err(Failure::Spec(vec![error.finding()], sources)),
    }
}

/// Bytes of a text, at most: many times what the largest models take, and far less than places can count.
const LARGEST_TEXT: u64 = 512 << 20;

/// The text of a file.
fn sources(path: &Path) -> Result<Sources, Failure> {
    let bytes = at_most(path, LARGEST_TEXT).map_err(|error| match error {
        LoadError::TooLarge(size) => {
            let message = format!("it has {size} bytes or more; the most allowed is {LARGEST_TEXT}");
            Failure::file("read", path, message)
        }
        LoadError::Unreadable(reason) => Failure::file("read", path, reason),
        LoadError::Missing | LoadError::Outside => Failure::file("read", path, "there is no such file"),
    })?;
    let text = String::from_utf8(bytes).map_err(|_| Failure::file("read", path, "it is not UTF-8 text"))?;
    Ok(Sources::new(path.display().to_string(), &text))
}

impl Stages {
    fn read(sources: &Sources) -> Result<(Model, Stages), TextError> {
        let sections = text::sections(sources.text())?;
        for (section, expected) in sections.iter().zip(Stage::ALL) {
            if section.stage != expected {
                let message = format!("the section `{}` is missing before this one", expected.header());
                return Err(section.error(message + ": later stages need it"));
            }
        }
        let section = |stage: Stage| sections.iter().find(|section| section.stage == stage);
        let model = text::model::read(&sections[0])?;
        let graph = section(Stage::Step).map(text::step::read).transpose()?;
        if let (Some(graph), Some(section)) = (&graph, section(Stage::Step))
            && let Some(difference) = difference(&model, graph)
        {
            return Err(section.error(format!("this is no step of the model above: {difference}")));
        }
        let fixed = section(Stage::Fixed).zip(graph.as_ref()).map(|(section, graph)| text::fixed::read(section, graph));
        let mapping = section(Stage::Mapping).map(|section| MappingFile::of_section(section, sources)).transpose()?;
        let schedule = section(Stage::Schedule).map(Section::place);
        let program = section(Stage::Program).map(program::read).transpose()?;
        let of_program = section(Stage::Program).map(Section::place);
        let last = sections.last().expect("one at least").stage;
        let stages = Stages {
            last,
            graph: graph.map(Arc::new),
            fixed: fixed.transpose()?,
            mapping,
            schedule,
            program,
            of_program,
        };
        Ok((model, stages))
    }
}

/// In what a step is none of a model, in words.
fn difference(model: &Model, graph: &StepGraph) -> Option<String> {
    let with_ticks = model.with_ticks();
    let states = model.states.iter().map(|state| &state.name);
    let inputs = with_ticks.inputs.iter().map(|input| &input.name);
    let outputs = model.outputs.iter().map(|output| &output.name);
    if graph.step.to_bits() != model.step.to_bits() {
        return Some(format!("its step is {} s, and the model's {} s", graph.step, model.step));
    }
    if graph.states.len() < model.states.len() || !states.eq(graph.names.states.iter().take(model.states.len())) {
        return Some("it does not begin with the model's states".to_owned());
    }
    if !inputs.eq(&graph.names.inputs) {
        return Some("it has other inputs".to_owned());
    }
    if graph.names.algebraics.len() < model.algebraics.len() {
        return Some("it has fewer algebraic variables".to_owned());
    }
    (!outputs.eq(&graph.names.outputs)).then(|| "it has other outputs".to_owned())
}

fn refused(sources: &Sources, section: &Section, violation: &str) -> Failure {
    let message = format!("this {} is wrong: {violation}", section.stage.name());
    let finding = Diagnostic::error(codes::BAD_STAGE_TEXT, section.span(), message)
        .with_help("the checker of this stage refuses it; `pe-synth dump` prints one that it accepts");
    Failure::Spec(vec![finding], sources.clone())
}

/// The schedule of the text, proved; none if it has none. `issued` is the step as it is issued.
///
/// # Errors
/// It cannot be read, or is wrong.
pub fn schedule(
    given: Option<(&Stages, &Sources)>,
    issued: &StepGraph,
    mapping: &Mapping,
    latency: Latency,
) -> Result<Option<Schedule>, Failure> {
    let Some((stages, sources)) = given else { return Ok(None) };
    let Some(section) = stages.schedule.as_ref().map(|place| place.section(sources.text())) else { return Ok(None) };
    let schedule = text::schedule::read(&section, issued, mapping.pes)
        .map_err(|error| Failure::Spec(vec![error.finding()], sources.clone()))?;
    match verify::schedule::check(issued, mapping, &schedule, latency).first() {
        None => Ok(Some(schedule)),
        Some(violation) => Err(refused(sources, &section, violation)),
    }
}

/// A program whose notes tell apart values that have one name: as it is printed to be read back.
pub fn with_labels(program: &Program, graph: &StepGraph) -> Program {
    Program { names: distinct(value_names(graph)).into(), ..program.clone() }
}

fn value_names(graph: &StepGraph) -> impl Iterator<Item = String> {
    (0..graph.values.len() as u32).map(|value| graph.value_name(ValueId::new(value)))
}

/// Gives notes the numbers of the values that they name.
///
/// # Errors
/// A name that no value has.
fn renumbered(program: &mut Program, graph: &StepGraph) -> Result<(), String> {
    let labels = Labels::of_values(graph);
    let number = |name: &String| labels.find(name).map(ValueId::new).ok_or_else(|| name.clone());
    let numbers: List<ValueId, ValueId> = program.names.iter().map(number).collect::<Result<_, _>>()?;
    for note in program.pes.iter_mut().flat_map(|pe| &mut pe.notes) {
        for slot in [&mut note.operand, &mut note.chain, &mut note.write, &mut note.receive] {
            *slot = slot.and_then(|value| numbers.find(value).copied());
        }
    }
    program.names = value_names(graph).collect();
    Ok(())
}

/// The program of the text, proved; none if it has none.
///
/// # Errors
/// It is not that of the step.
pub fn program(
    given: Option<(&Stages, &Sources)>,
    graph: &StepGraph,
    fixed: &FixedPoint,
    mapping: &Mapping,
) -> Result<Option<Program>, Failure> {
    let Some((stages, sources)) = given else { return Ok(None) };
    let Some((mut program, place)) = stages.program.clone().zip(stages.of_program.as_ref()) else { return Ok(None) };
    let section = place.section(sources.text());
    let known = renumbered(&mut program, graph);
    let states = program.states.iter().map(|state| &state.name).eq(&graph.names.states);
    let inputs = program.inputs.iter().map(|input| &input.name).eq(&graph.names.inputs);
    let outputs = program.outputs.iter().map(|output| &output.name).eq(&graph.names.outputs);
    let violation = if let Err(name) = known {
        Some(format!("it has a note of `{name}`, which is not a value of the step"))
    } else if program.format != fixed.format || program.pes.len() != mapping.pes as usize {
        Some("it has other words, or another number of PEs".to_owned())
    } else if !states || !inputs || !outputs {
        Some("its states, inputs and outputs are not those of the step".to_owned())
    } else {
        verify::program::check(&program, graph, fixed, CHECKED_ROUNDS).into_iter().next()
    };
    match violation {
        None => Ok(Some(program)),
        Some(violation) => Err(refused(sources, &section, &violation)),
    }
}
