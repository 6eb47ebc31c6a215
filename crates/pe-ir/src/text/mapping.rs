//! The mapping: a line with the name of each equation and the number of its PE, as in a mapping file.

use crate::graph::StepGraph;
use crate::index::{EquationId, List, PeId, number};
use crate::mapping::Mapping;
use crate::source::Span;

use super::labels::Labels;
use super::{Section, Stage, TextError};

/// An equation and its PE.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placed {
    /// Name of the equation.
    pub equation: String,
    /// The bytes of the name.
    pub span: Span,
    /// Its PE.
    pub pe: PeId,
}

/// The section of a mapping.
pub fn print(graph: &StepGraph, mapping: &Mapping) -> String {
    let labels = Labels::of(graph.equations.iter().map(|equation| equation.name.clone()));
    let line = |(equation, pe): (EquationId, &PeId)| format!("{} {pe}\n", labels.text(equation.number()));
    Stage::Mapping.header() + "\n" + &mapping.pe_of.numbered().map(line).collect::<String>()
}

/// Reads the lines of a mapping.
///
/// # Errors
/// A line is no equation with its PE.
pub fn lines(section: &Section) -> Result<Vec<Placed>, TextError> {
    let mut placed = Vec::new();
    for mut line in section.lines() {
        let equation = line.name("the name of an equation")?;
        let span = line.last();
        let pe = line.integer()?;
        line.done()?;
        placed.push(Placed { equation, span, pe });
    }
    Ok(placed)
}

/// Reads the mapping of a step graph.
///
/// # Errors
/// A line is no equation with its PE; an equation is not in the step, has two PEs or none; or a PE has none.
pub fn read(section: &Section, graph: &StepGraph) -> Result<Mapping, TextError> {
    let labels = Labels::of(graph.equations.iter().map(|equation| equation.name.clone()));
    let mut pe_of: List<EquationId, Option<PeId>> = List::filled(None, labels.len());
    let mut pes = 0;
    for mut line in section.lines() {
        let equation = labels.read(&mut line, "an equation of the step").map(EquationId::new)?;
        let place = line.last();
        let pe: PeId = line.integer()?;
        line.done()?;
        // More PEs than equations cannot all have one.
        if pe.index() >= labels.len() {
            return Err(line.error(format!("expected the number of a PE below that of equations, {}", labels.len())));
        }
        if pe_of[equation].replace(pe).is_some() {
            return Err(line.error_at(place, format!("{} already has a PE", labels.text(equation.number()))));
        }
        pes = pes.max(pe.number() + 1);
    }
    if let Some(missing) = pe_of.iter().position(Option::is_none) {
        return Err(section.error(format!("{} has no PE", labels.text(number(missing)))));
    }
    if let Some(empty) = PeId::all(pes).find(|pe| !pe_of.contains(&Some(*pe))) {
        return Err(section.error(format!("PE {empty} has no equation")));
    }
    Ok(Mapping { pes, pe_of: pe_of.into_iter().flatten().collect() })
}
