//! What generated files say about their spec: files, their hashes, statements.

use std::collections::{BTreeMap, BTreeSet};

use pe_emit::{Driven, Interface, Provenance, Tunable};
use pe_flow::pipeline::Design;
use pe_flow::spec::LoadedModel;
use pe_hls::assemble::coefficients;

use pe_ir::index::{List, at};
use pe_ir::model::{Interpolation, Model, State, Variable};
use pe_ir::source::{Sources, Span};

use pe_map::sha256;
use pe_map::{Between, Meaning};

use crate::command::shown_path;

/// Longest text of a statement in a comment.
const LONGEST_STATEMENT: usize = 160;

/// The files that the spec was read from, each with its SHA-256 in hex.
pub fn files(sources: &Sources) -> Vec<(String, String)> {
    let one = |file: &pe_ir::source::SourceFile| {
        let content = &sources.text()[file.span().range()];
        (shown_path(file.name()).to_owned(), sha256(content.as_bytes()))
    };
    sources.files().iter().map(one).collect()
}

/// What the ports and the step of a model's design stand for.
pub fn interface(model: &Model) -> Interface {
    let ratio = model.step_ratio();
    let driven = |(index, input): (u32, &pe_ir::model::Input)| Driven {
        meaning: if ratio == Some(Variable::Input(index)) { Meaning::StepRatio } else { Meaning::Quantity },
        range: input.range.map(|(least, most)| [least, most]),
        between: match input.between {
            Interpolation::Hold => Between::Hold,
            Interpolation::Linear => Between::Linear,
        },
    };
    let tunable = |(state, (least, greatest)): (&State, (f64, f64))| Tunable {
        name: state.name.clone(),
        unit: state.unit.clone(),
        value: state.initial,
        range: [least, greatest],
    };
    Interface {
        step: model.step,
        early_steps: model.phases.iter().map(|phase| (phase.until, model.step / phase.ratio)).collect(),
        inputs: (0..).zip(&model.inputs).map(driven).collect(),
        parameters: model.tunables().map(tunable).collect(),
        initial: initial(model),
    }
}

/// Numbers of the outputs in the initial state, with all inputs 0; a ratio of steps is that of the first one.
fn initial(model: &Model) -> BTreeMap<String, f64> {
    let mut inputs = vec![0.0; model.inputs.len()];
    if let Some(Variable::Input(ratio)) = model.step_ratio() {
        inputs[at(ratio)] = model.phases.first().map_or(1.0, |phase| phase.ratio);
    }
    let numbers = model.initial_outputs(&inputs);
    let outputs = model.outputs.iter().map(|output| output.name.clone()).zip(numbers);
    outputs.filter(|(_, number)| number.is_finite()).collect()
}

/// What the words of a design's program come from; the text of a stage has no statements of a spec.
pub fn provenance(design: &Design, loaded: &LoadedModel) -> Provenance {
    let graph = design.paired.as_ref().map_or(&*design.graph, |paired| &paired.graph);
    let mut spans = List::filled(BTreeSet::new(), at(design.mapping.pes));
    for (equation, pe) in graph.equations.iter().zip(&design.mapping.pe_of) {
        spans[*pe].insert(equation.span);
    }
    let of_pe = |spans: BTreeSet<Span>| {
        let stated = |span: &Span| span.length() > 0 && loaded.stages.is_none();
        spans.into_iter().filter(stated).map(|span| statement(&loaded.sources, span)).collect()
    };
    Provenance {
        statements: spans.into_iter().map(of_pe).collect(),
        coefficients: coefficients(graph, &design.mapping, &design.schedule),
    }
}

/// Place and text of a statement in one line, without remarks.
fn statement(sources: &Sources, span: Span) -> String {
    let position = sources.position(span.start);
    let lines = sources.text().get(span.range()).unwrap_or("").lines();
    let words = lines.flat_map(|line| line.split("//").next().unwrap_or("").split_whitespace());
    let mut text = words.collect::<Vec<_>>().join(" ");
    if text.chars().count() > LONGEST_STATEMENT {
        text = text.chars().take(LONGEST_STATEMENT).collect::<String>() + " ..";
    }
    format!("{}:{}: {text}", shown_path(position.file), position.line)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_have_a_place_and_one_line() {
        let sources = Sources::new("a/b.spec", "state x = 1\nx' = -2*x // falls\n   + 1\n");
        assert_eq!(statement(&sources, Span { start: 12, end: 37 }), "a/b.spec:2: x' = -2*x + 1");
        let hashes = files(&sources);
        assert_eq!((hashes.len(), hashes[0].0.as_str(), hashes[0].1.len()), (1, "a/b.spec", 64));
    }
}
