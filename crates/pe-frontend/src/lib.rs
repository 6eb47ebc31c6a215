//! The front end: spec text in, flat [`Model`] out.
//!
//! Text goes through two stages. [`parse`] cuts it into statements and builds the syntax tree; [`elaborate`] binds
//! names, computes constants and writes out every equation of every element, in the passes that `passes.rs` lists;
//! [`compile`] does both. Neither ever panics or stops at the first error, whatever the text, and each finding carries
//! a code that [`pe_ir::codes::explain`] knows. The front end reads no files; what a spec names, a [`Loader`] gives it.
//!
//! The language is described in `docs/language.md`, its grammar is `grammar/ode.pest`.

mod arrays;
mod bind;
mod bound;
mod components;
mod context;
mod declare;
mod equations;
mod evaluate;
mod fault;
mod language;
mod limits;
mod model;
mod names;
mod nearest;
mod outputs;
mod passes;
mod report;
pub mod symbols;
mod syntax;
mod units;
pub mod vocabulary;

pub use limits::Limits;
pub use passes::{Elaborated, Known, Overrides, elaborate, elaborate_within, examine};
pub use report::sort;
pub use syntax::ast::{self, Spec};
pub use syntax::files::{LARGEST_FILE, LoadError, Loader, NoFiles, main_file};
pub use syntax::format::format;
pub use units::dimension::Units;

use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity, Sources};

/// Parses a spec: the main file in `sources` and every file it names, which `loader` reads and `sources` takes up.
/// Never fails: statements with syntax errors are missing in the tree, and noted there as broken.
pub fn parse(sources: &mut Sources, loader: &dyn Loader) -> (Spec, Vec<Diagnostic>) {
    let mut report = report::Report::default();
    let spec = syntax::reader::read(sources, loader, &mut report);
    (spec, report.finish())
}

/// Parses and elaborates a spec: the model and its warnings, or everything that was found, in source order. See
/// [`parse`] and [`elaborate`] for the arguments.
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
