//! Reads models that others wrote in their own formats, and writes them as specs.
//!
//! [`import`] reads a file into a [`Model`], the same for all formats; [`Imported::spec`] writes it. What a spec cannot
//! express is found as a whole, and nothing is written then. Formats, and what of them is read: `docs/import.md`.

mod cellml;
mod diffsl;
pub mod expr;
mod finish;
mod infix;
mod mathml;
mod mmt;
pub mod model;
mod names;
mod number;
mod pulses;
mod rolled;
mod sbml;
pub mod settings;
mod solve;
mod write;
mod xml;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Severity, Sources};

pub use crate::model::Model;
use crate::names::Names;
pub use crate::settings::Settings;
pub use crate::write::Setting;

/// Largest file that is read, in bytes.
pub const LARGEST_FILE: u64 = 16 << 20;

/// Which quantities are outputs.
#[derive(Clone, Debug)]
pub enum Wanted {
    /// Those that the format suggests: what changes.
    Usual,
    /// These, by their names in the file.
    Named(Vec<String>),
    /// Those of a case of the SBML Test Suite.
    Suite(Settings),
}

/// A model that can be written.
pub struct Imported {
    /// The model.
    pub model: Model,
    /// Findings that do not stand in the way.
    pub warnings: Vec<Diagnostic>,
    names: Names,
    file: String,
}

impl Imported {
    /// The text of the spec.
    pub fn spec(&self, setting: &Setting) -> String {
        write::Writer::new(&self.model, &self.names).spec(&self.file, setting)
    }

    /// Name of the column of each output in a file of results, and name of the output in the spec.
    pub fn columns(&self) -> Vec<(&str, &str)> {
        let outputs = self.model.outputs.iter();
        outputs.map(|(column, quantity)| (column.as_str(), self.names.quantities[*quantity].as_str())).collect()
    }
}

/// Reads a model. `file` is its name as it is shown, `bytes` what it holds; `is_name` says whether the language takes a
/// word as a name.
///
/// # Errors
/// All findings, if there is one that stands in the way.
pub fn import(
    file: &str,
    bytes: &[u8],
    wanted: &Wanted,
    is_name: &dyn Fn(&str) -> bool,
) -> (Sources, Result<Imported, Vec<Diagnostic>>) {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.strip_prefix('\u{FEFF}').unwrap_or(text),
        Err(error) => {
            let message = format!("the file is no UTF-8 text from byte {} on", error.valid_up_to());
            let finding = Diagnostic::global(codes::IMPORT_SYNTAX, message);
            return (Sources::new(file, ""), Err(vec![finding.with_help("convert it to UTF-8")]));
        }
    };
    let sources = Sources::new(file, text);
    let mut findings = Vec::new();
    let model = read(file, text, wanted, &mut findings);
    let stem =
        std::path::Path::new(file).file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    (sources, finished(model, stem, file, findings, is_name))
}

fn finished(
    model: Option<Model>,
    stem: String,
    file: &str,
    mut findings: Vec<Diagnostic>,
    is_name: &dyn Fn(&str) -> bool,
) -> Result<Imported, Vec<Diagnostic>> {
    let refused = |findings: &[Diagnostic]| findings.iter().any(|finding| finding.severity == Severity::Error);
    let Some(mut model) = model else { return Err(sorted(findings)) };
    let mut more = Vec::new();
    if !refused(&findings) {
        finish::finish(&mut model, &mut more);
    } else {
        finish::events(&mut model, &mut more);
    }
    findings.extend(more);
    let findings = sorted(findings);
    if refused(&findings) {
        return Err(findings);
    }
    if model.id.is_empty() {
        model.id = stem;
    }
    let names = Names::of(&model, is_name);
    let file =
        std::path::Path::new(file).file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    Ok(Imported { model, warnings: findings, names, file })
}

fn read(file: &str, text: &str, wanted: &Wanted, findings: &mut Vec<Diagnostic>) -> Option<Model> {
    let end = std::path::Path::new(file).extension().map(std::ffi::OsStr::to_ascii_lowercase);
    match end.as_deref().and_then(std::ffi::OsStr::to_str) {
        Some("mmt") => return mmt::read(text, wanted, findings),
        Some("ds" | "diffsl") => return diffsl::read(text, wanted, findings),
        _ => {}
    }
    let document = match xml::read(text) {
        Ok(document) => document,
        Err(finding) => {
            findings.push(finding);
            return None;
        }
    };
    match document.root_element().tag_name().name() {
        "model" => cellml::read(&document, wanted, findings),
        "sbml" => sbml::read(&document, wanted, findings),
        other => {
            let message = format!("`<{}>` is the root of no known format", other.escape_debug());
            findings.push(
                Diagnostic::error(codes::IMPORT_SYNTAX, xml::span(document.root_element()), message)
                    .with_help("SBML, CellML, Myokit's `.mmt`, and DiffSL as `.ds` or `.diffsl` can be imported"),
            );
            None
        }
    }
}

/// In the order of the file, each finding once.
fn sorted(mut findings: Vec<Diagnostic>) -> Vec<Diagnostic> {
    findings.sort_by(|a, b| (a.span, a.code, &a.message).cmp(&(b.span, b.code, &b.message)));
    findings.dedup();
    findings
}

/// An output that the model does not have.
pub(crate) fn no_output(name: &str) -> Diagnostic {
    let message = format!("the model has no `{}` to be an output", name.escape_debug());
    Diagnostic::global(codes::IMPORT_UNKNOWN, message)
}
