//! The mapping that the user gives: a file with the PE of each equation, as `dump --stage mapping` prints it.
//!
//! One equation in each line, its name and the number of its PE; empty lines and lines that begin with `#` say nothing. Of the
//! text of a stage the section of the mapping counts.

use std::collections::BTreeMap;

use pe_hls::relay::is_relay;
use pe_hls::route::is_hop;
use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::index::PeId;
use pe_ir::mapping::Mapping;
use pe_ir::source::{Diagnostic, Sources, Span};
use pe_ir::text::mapping::Placed;
use pe_ir::text::{self, Section, Stage, TextError};

use crate::failure::Failure;

/// Equations that a message names at most.
const NAMED: usize = 5;

/// What a mapping file says.
#[derive(Clone, Debug)]
pub struct MappingFile {
    sources: Sources,
    lines: Vec<Line>,
    pes: u32,
}

/// An equation and its PE.
#[derive(Clone, Debug)]
struct Line {
    equation: String,
    /// Of the equation's name.
    span: Span,
    pe: PeId,
}

impl MappingFile {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// A line is none of a mapping, or a PE between the first and the last has no equation.
    pub fn read(sources: Sources) -> Result<MappingFile, Failure> {
        if text::is_stage_text(sources.text()) {
            return MappingFile::of_stages(&sources);
        }
        let mut findings = Vec::new();
        let (mut lines, mut begin) = (Vec::new(), 0);
        for text in sources.text().split_inclusive('\n') {
            let at = begin + (text.len() - text.trim_start().len()) as u32;
            begin += text.len() as u32;
            let text = text.trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let span = |from: usize, to: usize| Span { start: at + from as u32, end: at + to as u32 };
            let words = text.rsplit_once(char::is_whitespace).map(|(name, number)| (name.trim_end(), number));
            match words.and_then(|(name, number)| Some((name, number.parse().ok()?))) {
                Some((name, pe)) => lines.push(Line { equation: name.to_owned(), span: span(0, name.len()), pe }),
                None => findings.push(
                    Diagnostic::error(
                        codes::BAD_MAPPING,
                        span(0, text.len()),
                        "this line does not assign an equation to a PE",
                    )
                    .with_help("write the name of an equation, a blank, and the number of its PE, from 0"),
                ),
            }
        }
        MappingFile::of_lines(lines, findings, sources)
    }

    /// The mapping in the text of a stage, as `dump` prints it.
    fn of_stages(sources: &Sources) -> Result<MappingFile, Failure> {
        let refused = |error: TextError| Failure::Spec(vec![error.finding()], sources.clone());
        let sections = text::sections(sources.text()).map_err(refused)?;
        match sections.iter().find(|section| section.stage == Stage::Mapping) {
            Some(section) => MappingFile::of_section(section, sources).map_err(refused),
            None => MappingFile::of_lines(Vec::new(), Vec::new(), sources.clone()),
        }
    }

    /// The mapping in a section of a text.
    ///
    /// # Errors
    /// A line is none of a mapping, or a PE between the first and the last has no equation.
    pub fn of_section(section: &Section, sources: &Sources) -> Result<MappingFile, TextError> {
        let line = |Placed { equation, span, pe }| Line { equation, span, pe };
        let lines: Vec<Line> = text::mapping::lines(section)?.into_iter().map(line).collect();
        match MappingFile::of_lines(lines, Vec::new(), sources.clone()) {
            Ok(file) => Ok(file),
            Err(Failure::Spec(findings, _)) => Err(section.error(findings[0].message.clone())),
            Err(other) => Err(section.error(format!("{other:?}"))),
        }
    }

    fn of_lines(lines: Vec<Line>, mut findings: Vec<Diagnostic>, sources: Sources) -> Result<MappingFile, Failure> {
        if lines.is_empty() && findings.is_empty() {
            findings.push(
                Diagnostic::global(codes::BAD_MAPPING, "the file maps no equation")
                    .with_help("`pe-synth dump --stage mapping` prints a mapping to start from"),
            );
        }
        findings.extend(gap(&lines));
        let pes = lines.iter().map(|line| line.pe.number() + 1).max().unwrap_or(0);
        if findings.is_empty() {
            Ok(MappingFile { sources, lines, pes })
        } else {
            Err(Failure::Spec(findings, sources))
        }
    }

    /// Number of PEs.
    pub fn pes(&self) -> u32 {
        self.pes
    }

    /// Number of relays among its equations.
    pub fn relays(&self) -> u32 {
        self.lines.iter().filter(|line| is_relay(&line.equation)).count() as u32
    }

    /// Whether there are relays on the routes of values among its equations.
    pub fn hops(&self) -> bool {
        self.lines.iter().any(|line| is_hop(&line.equation))
    }

    /// The mapping of a step graph. Relays on the routes of values follow from it, so that their lines say nothing.
    ///
    /// # Errors
    /// An equation is not in the graph, has two PEs, or none.
    pub fn mapping(&self, graph: &StepGraph) -> Result<Mapping, Failure> {
        let known: BTreeMap<&str, usize> =
            graph.equations.iter().enumerate().map(|(index, equation)| (equation.name.as_str(), index)).collect();
        let mut given: Vec<Option<&Line>> = vec![None; graph.equations.len()];
        let mut findings = Vec::new();
        for line in &self.lines {
            let Some(index) = known.get(line.equation.as_str()) else {
                if is_hop(&line.equation) {
                    continue;
                }
                let message = format!("the model has no equation `{}`", line.equation);
                findings.push(Diagnostic::error(codes::BAD_MAPPING, line.span, message).with_help(
                    "`pe-synth dump --stage mapping` with the same options prints all equations of the step",
                ));
                continue;
            };
            match given[*index] {
                None => given[*index] = Some(line),
                Some(first) => {
                    let message = format!("`{}` already has a PE", line.equation);
                    let finding = Diagnostic::error(codes::BAD_MAPPING, line.span, message)
                        .with_label(first.span, format!("here it is on PE {}", first.pe));
                    findings.push(finding.with_help("remove one of the two lines"));
                }
            }
        }
        let without = graph.equations.iter().zip(&given).filter(|(_, line)| line.is_none());
        let without: Vec<&str> = without.map(|(equation, _)| equation.name.as_str()).collect();
        if !without.is_empty() {
            let names: Vec<String> = without.iter().take(NAMED).map(|name| format!("`{name}`")).collect();
            let more = without.len() - names.len();
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let message = format!("no PE is assigned to {}{more}", names.join(", "));
            findings.push(
                Diagnostic::global(codes::BAD_MAPPING, message).with_help("every equation needs a line with its PE"),
            );
        }
        if !findings.is_empty() {
            return Err(Failure::Spec(findings, self.sources.clone()));
        }
        Ok(Mapping { pes: self.pes, pe_of: given.iter().flatten().map(|line| line.pe).collect() })
    }
}

/// The finding about the first PE without an equation among those below the last one.
fn gap(lines: &[Line]) -> Option<Diagnostic> {
    let mut used: Vec<PeId> = lines.iter().map(|line| line.pe).collect();
    used.sort_unstable();
    used.dedup();
    let missing = (0..).map(PeId::new).zip(&used).find(|(expected, pe)| expected != *pe)?.0;
    let above = lines.iter().find(|line| line.pe > missing)?;
    let message = format!("`{}` is on PE {}, and PE {missing} has no equation", above.equation, above.pe);
    Some(
        Diagnostic::error(codes::BAD_MAPPING, above.span, message)
            .with_help("number the PEs from 0 on without a gap; every PE computes at least one equation"),
    )
}
