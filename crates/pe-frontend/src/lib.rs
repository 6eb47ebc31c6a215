//! The front end: spec text in, flat [`Model`] out.
//!
//! Text goes through two stages. [`parse`] cuts it into statements and builds the syntax tree; [`elaborate()`] binds
//! names, computes constants and writes out every equation of every element; [`compile`] does both. Neither ever
//! panics or stops at the first error, whatever the text, and each finding carries a code that
//! [`codes::explain`] knows.
//!
//! The language is described in `docs/language.md`, its grammar is `grammar/ode.pest`.

pub mod ast;
mod bound;
mod constants;
mod declarations;
mod elaborate;
mod equations;
mod evaluate;
mod fold;
mod functions;
mod lexer;
mod names;
mod nearest;
mod observe;
mod order;
mod outputs;
mod pattern;
mod prune;
mod report;
mod resolve;
mod settings;
mod statements;
mod syntax;
mod syntax_errors;

pub use ast::Spec;
pub use elaborate::{Limits, elaborate, elaborate_within};

use pe_ir::codes;
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity, SourceFile};

/// Larger files are refused before they are looked at.
const LARGEST_FILE: usize = 16 << 20;

/// Parses a spec. Never fails: statements with syntax errors are missing in the tree, and noted there as broken.
pub fn parse(source: &SourceFile) -> (Spec, Vec<Diagnostic>) {
    let text = source.text.as_str();
    let mut report = report::Report::default();
    let mut spec = Spec::default();
    if text.len() > LARGEST_FILE {
        let message = format!("the file has {} bytes; the most allowed is {LARGEST_FILE}", text.len());
        report.push(
            Diagnostic::global(codes::FILE_TOO_LARGE, message)
                .with_help("describe repeated equations with indices instead of writing them out"),
        );
        // Nothing must be concluded from the empty tree: any section may have been there.
        let broken = lexer::SECTIONS.map(|section| ast::Broken { section: section.to_owned(), names: Vec::new() });
        spec.broken.extend(broken);
        return (spec, report.finish());
    }
    let tokens = lexer::tokenize(text, &mut report);
    for statement in statements::split(text, &tokens) {
        let parsed = statements::check(text, &statement, &mut report)
            .then(|| syntax::parse_statement(text, &statement, &mut report))
            .flatten();
        match parsed {
            Some(parsed) => spec.statements.push(parsed),
            None => spec.broken.push(statements::salvage(text, &statement)),
        }
    }
    (spec, report.finish())
}

/// What the command line says in place of the spec.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Values of constants and parameters (all elements of an array); of several for one name the last counts.
    pub set: Vec<(String, f64)>,
    /// Lists of scalars, elements and whole arrays (`V[3], p`) that are the outputs; the spec's if there is none.
    pub observe: Vec<String>,
}

/// Parses and elaborates a spec: the model and its warnings, or everything that was found, in source order.
pub fn compile(source: &SourceFile, overrides: &Overrides) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    let (spec, mut findings) = parse(source);
    let (model, more) = elaborate(&spec, overrides);
    findings.extend(more);
    report::sort(&mut findings);
    match model {
        Some(model) if findings.iter().all(|finding| finding.severity == Severity::Warning) => Ok((model, findings)),
        _ => Err(findings),
    }
}
