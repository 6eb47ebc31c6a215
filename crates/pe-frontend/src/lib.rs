//! The front end: spec text in, flat [`Model`] out.
//!
//! Text goes through two stages. [`parse`] cuts it into statements and builds the syntax tree; [`elaborate()`] binds
//! names, computes constants and writes out every equation of every element; [`compile`] does both. Neither ever
//! panics or stops at the first error, whatever the text, and each finding carries a code that
//! [`pe_ir::codes::explain`] knows. The front end reads no files; what a spec names, a [`Loader`] gives it.
//!
//! The language is described in `docs/language.md`, its grammar is `grammar/ode.pest`.

mod algebra;
mod arrays;
pub mod ast;
mod bound;
mod constants;
mod data;
mod declarations;
mod defined;
mod elaborate;
mod elementary;
mod equations;
mod evaluate;
mod files;
mod fold;
mod functions;
mod inline;
mod lexer;
mod matrix;
mod names;
mod nearest;
mod observe;
mod order;
mod outputs;
mod pattern;
mod prune;
mod reader;
mod report;
mod resolve;
mod sampled;
mod set;
mod settings;
mod signals;
mod statements;
mod syntax;
mod syntax_errors;
mod tables;
mod units;

pub use ast::Spec;
pub use elaborate::{Limits, elaborate, elaborate_within};
pub use files::{LARGEST_FILE, LoadError, Loader, NoFiles, main_file};
pub use units::Units;

use pe_ir::model::{Interpolation, Model};
use pe_ir::source::{Diagnostic, Severity, Sources};

/// Parses a spec: the main file in `sources` and every file it names, which `loader` reads and `sources` takes up.
/// Never fails: statements with syntax errors are missing in the tree, and noted there as broken.
pub fn parse(sources: &mut Sources, loader: &dyn Loader) -> (Spec, Vec<Diagnostic>) {
    let mut report = report::Report::default();
    let spec = reader::read(sources, loader, &mut report);
    (spec, report.finish())
}

/// What the command line says in place of the spec.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Values of constants, parameters and states at time zero: of `R` all elements, of `R[3]` one. The last counts.
    pub set: Vec<(String, f64)>,
    /// Lists of scalars, elements and whole arrays (`V[3], p`) that are the outputs; the spec's if there is none.
    pub observe: Vec<String>,
    /// How strictly units are checked; what the spec says, if this is not given.
    pub units: Option<Units>,
    /// What inputs are between two samples if the spec does not say; the earlier one, if this is not given.
    pub inputs: Option<Interpolation>,
}

/// Parses and elaborates a spec: the model and its warnings, or everything that was found, in source order. See
/// [`parse`] and [`elaborate()`] for the arguments.
pub fn compile(
    sources: &mut Sources,
    loader: &dyn Loader,
    overrides: &Overrides,
) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    let (spec, mut findings) = parse(sources, loader);
    let (model, more) = elaborate(&spec, overrides);
    findings.extend(more);
    report::sort(&mut findings);
    match model {
        Some(model) if findings.iter().all(|finding| finding.severity == Severity::Warning) => Ok((model, findings)),
        _ => Err(findings),
    }
}
