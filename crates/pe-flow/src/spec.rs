//! A model and the files of the spec that it comes from.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pe_frontend::{LARGEST_FILE, LoadError, Loader, Overrides};
use pe_ir::codes;
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Sources};

use crate::failure::Failure;
use crate::read::{self, at_most, unreadable};
use crate::stages::{self, Stages};

/// The path that stands for standard input; files that a spec from there names are read from the present folder.
pub const STANDARD_INPUT: &str = "-";

/// A model with the texts it comes from.
#[derive(Clone)]
pub struct LoadedModel {
    /// The model.
    pub model: Model,
    /// The spec and the files it names, or the text of a stage.
    pub sources: Sources,
    /// What is decided already, if it comes from the text of a stage.
    pub stages: Option<Arc<Stages>>,
}

/// Reads and elaborates a spec and writes functions of variables out; with its warnings.
///
/// # Errors
/// [`Failure::File`], and the findings of the spec.
pub fn load(spec: &Path, overrides: &Overrides) -> Result<(LoadedModel, Vec<Diagnostic>), Failure> {
    elaborated(main_text(spec)?, spec, overrides)
}

/// The same of a text; `spec` is its name, from whose folder the files are read that it names.
///
/// # Errors
/// The findings of the spec.
pub fn load_text(spec: &Path, text: &str, overrides: &Overrides) -> Result<(LoadedModel, Vec<Diagnostic>), Failure> {
    let size = text.len() as u64;
    let bytes = if size > LARGEST_FILE as u64 { Err(LoadError::TooLarge(size)) } else { Ok(text.as_bytes().to_vec()) };
    elaborated(sources(spec.display().to_string(), bytes).map_err(|error| error.of(spec))?, spec, overrides)
}

fn elaborated(
    mut sources: Sources,
    spec: &Path,
    overrides: &Overrides,
) -> Result<(LoadedModel, Vec<Diagnostic>), Failure> {
    match pe_frontend::compile(&mut sources, &ModelFolder::of(spec), overrides) {
        Ok((model, mut warnings)) => {
            let (loaded, left_out) = written_out(model, sources);
            warnings.extend(left_out);
            Ok((loaded, warnings))
        }
        Err(findings) => Err(Failure::Spec(findings, sources)),
    }
}

/// Writes functions of variables out in a model that the front end made, as the compiler stages take it; with the
/// choices that this leaves out.
pub fn written_out(model: Model, sources: Sources) -> (LoadedModel, Vec<Diagnostic>) {
    let (model, left_out) = pe_hls::fuse::fuse(model);
    (LoadedModel { model: pe_hls::lift::lift(model), sources, stages: None }, left_out)
}

/// Reads the text of a stage, with all stages before it.
///
/// # Errors
/// [`Failure::File`], and the first place that cannot be read, or stage that is not valid.
pub fn load_stages(path: &Path) -> Result<LoadedModel, Failure> {
    let (model, sources, stages) = stages::load(path)?;
    Ok(LoadedModel { model, sources, stages: Some(Arc::new(stages)) })
}

/// Reads the main file of a spec, or standard input in its place.
///
/// # Errors
/// As of [`main_file`].
pub fn main_text(path: &Path) -> Result<Sources, Failure> {
    if path == Path::new(STANDARD_INPUT) { standard_input() } else { main_file(path) }
}

/// The files that a spec is read from, whether they exist or not, its main file first.
pub fn files(spec: &Path) -> Vec<PathBuf> {
    let named = Named { folder: ModelFolder::of(spec), paths: RefCell::default() };
    if let Ok(mut sources) = main_file(spec) {
        pe_frontend::parse(&mut sources, &named);
    }
    let others = named.paths.into_inner();
    std::iter::once(spec.to_owned()).chain(others.iter().map(|path| named.folder.0.join(path))).collect()
}

/// A folder that notes what is read from it.
struct Named {
    folder: ModelFolder,
    paths: RefCell<Vec<String>>,
}

impl Loader for Named {
    fn load(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        self.paths.borrow_mut().push(path.to_owned());
        self.folder.load(path)
    }
}

/// Reads the main file of a spec.
///
/// # Errors
/// [`Failure::File`], and files that are too large or no text.
pub fn main_file(path: &Path) -> Result<Sources, Failure> {
    sources(path.display().to_string(), at_most(path, LARGEST_FILE as u64)).map_err(|error| error.of(path))
}

/// Reads the spec on standard input.
fn standard_input() -> Result<Sources, Failure> {
    let bytes = read::stream_at_most(&mut std::io::stdin().lock(), LARGEST_FILE as u64);
    sources("standard input".to_owned(), bytes).map_err(|error| match error {
        Unusable::Unread(reason) => Failure::File(format!("cannot read standard input: {reason}")),
        Unusable::Refused(failure) => failure,
    })
}

/// Why there are no sources.
enum Unusable {
    /// In the words of the system.
    Unread(String),
    /// The content was refused.
    Refused(Failure),
}

impl Unusable {
    /// The failure to read a file.
    fn of(self, path: &Path) -> Failure {
        match self {
            Unusable::Unread(reason) => Failure::file("read", path, reason),
            Unusable::Refused(failure) => failure,
        }
    }
}

/// The sources that begin with these bytes.
fn sources(name: String, bytes: Result<Vec<u8>, LoadError>) -> Result<Sources, Unusable> {
    let bytes = match bytes {
        Ok(bytes) => bytes,
        Err(LoadError::TooLarge(size)) => {
            let message = format!("the file has {size} bytes; the most allowed is {LARGEST_FILE}");
            let finding = Diagnostic::global(codes::FILE_TOO_LARGE, message)
                .with_help("describe repeated equations with indices instead of writing them out");
            return Err(Unusable::Refused(Failure::Spec(vec![finding], Sources::new(name, ""))));
        }
        Err(LoadError::Unreadable(reason)) => return Err(Unusable::Unread(reason)),
        Err(LoadError::Missing | LoadError::Outside) => {
            return Err(Unusable::Unread("there is no such file".to_owned()));
        }
    };
    match pe_frontend::main_file(&name, &bytes) {
        (sources, None) => Ok(sources),
        (sources, Some(problem)) => Err(Unusable::Refused(Failure::Spec(vec![problem], sources))),
    }
}

/// The folder of a main file, from which the files are read that it names.
pub struct ModelFolder(PathBuf);

impl ModelFolder {
    /// The folder of this main file.
    pub fn of(spec: &Path) -> Self {
        let folder = spec.parent().filter(|folder| !folder.as_os_str().is_empty());
        ModelFolder(folder.unwrap_or(Path::new(".")).to_owned())
    }
}

impl Loader for ModelFolder {
    fn load(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        let target = self.0.join(path);
        // Links are followed before anything is opened, and what is opened is where they led.
        let target = target.canonicalize().map_err(unreadable)?;
        let folder = self.0.canonicalize().map_err(unreadable)?;
        if !target.starts_with(folder) {
            return Err(LoadError::Outside);
        }
        match target.metadata().map_err(unreadable)?.is_file() {
            true => at_most(&target, LARGEST_FILE as u64),
            false => Err(LoadError::Unreadable("it is not a regular file".to_owned())),
        }
    }
}
