//! What `pe-synth import` does with a model after it is read: solver and step, comparison with results, suites.

pub mod compare;
pub mod propose;
pub mod suite;

use std::path::Path;

use pe_flow::failure::Failure;
use pe_flow::read::at_most;
use pe_flow::spec::LoadedModel;
use pe_frontend::{LoadError, NoFiles, Overrides};
use pe_import::{Imported, Setting, Wanted};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Sources};

/// Reads a model of another format.
///
/// # Errors
/// [`Failure::File`], and all findings of the file.
pub fn read(path: &Path, wanted: &Wanted) -> Result<(Imported, Sources), Failure> {
    let name = path.display().to_string();
    let bytes = match at_most(path, pe_import::LARGEST_FILE) {
        Ok(bytes) => bytes,
        Err(LoadError::TooLarge(size)) => {
            let message = format!("the file has {size} bytes; the most allowed is {}", pe_import::LARGEST_FILE);
            let finding = Diagnostic::global(codes::IMPORT_LIMIT, message);
            return Err(Failure::Spec(vec![finding], Sources::new(name, "")));
        }
        Err(LoadError::Unreadable(reason)) => return Err(Failure::file("read", path, reason)),
        Err(LoadError::Missing | LoadError::Outside) => {
            return Err(Failure::file("read", path, "there is no such file"));
        }
    };
    match pe_import::import(&name, &bytes, wanted, &is_name) {
        (sources, Ok(imported)) => Ok((imported, sources)),
        (sources, Err(findings)) => Err(Failure::Spec(findings, sources)),
    }
}

/// Whether the language takes a word as a name.
fn is_name(word: &str) -> bool {
    let mut sources = Sources::new("", &format!("param {word} = 1"));
    pe_frontend::parse(&mut sources, &NoFiles).1.is_empty()
}

/// The model of a spec that was just written, which stands in no file yet.
///
/// # Errors
/// Its findings.
pub fn load(imported: &Imported, setting: &Setting, name: &str) -> Result<LoadedModel, Failure> {
    let mut sources = Sources::new(name, &imported.spec(setting));
    match pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default()) {
        Ok((model, _)) => {
            let model = pe_hls::lift::lift(pe_hls::fuse::fuse(model).0);
            Ok(LoadedModel { model, sources, stages: None })
        }
        Err(findings) => Err(Failure::Spec(findings, sources)),
    }
}
