//! The texts that are open in the editor, and those on disk behind them.

use crate::keys::Key;
use pe_flow::read;
use pe_flow::spec::ModelFolder;
use pe_frontend::{LARGEST_FILE, LoadError, Loader};
use pe_ir::source::{Diagnostic, Sources};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Words that describe a whole model: a file with one of them is a main file.
const MAIN_WORDS: [&str; 4] = ["model", "solver", "step", "span"];

/// Folders above that of a file in which a model is looked for that includes it.
const FOLDERS_ABOVE: usize = 4;

/// Specs of a folder that are looked at.
const MOST_SPECS: usize = 200;

/// Main files of models are short; longer ones are not looked at.
const LARGEST_SPEC: u64 = 1 << 20;

/// A text in the editor.
#[derive(Clone, Debug)]
pub(crate) struct Document {
    /// Its address, as the editor writes it.
    pub(crate) uri: String,
    /// Its version.
    pub(crate) version: i32,
    /// Its text.
    pub(crate) text: Arc<str>,
}

/// All texts in the editor at one time.
#[derive(Clone, Debug, Default)]
pub(crate) struct Texts(Arc<BTreeMap<Key, Document>>);

impl Texts {
    pub(crate) fn get(&self, key: &Key) -> Option<&Document> {
        self.0.get(key)
    }

    pub(crate) fn all(&self) -> impl Iterator<Item = (&Key, &Document)> {
        self.0.iter()
    }

    pub(crate) fn set(&mut self, key: Key, document: Document) {
        Arc::make_mut(&mut self.0).insert(key, document);
    }

    pub(crate) fn remove(&mut self, key: &Key) {
        Arc::make_mut(&mut self.0).remove(key);
    }

    /// The address of a text, as the editor writes it if it has it open.
    pub(crate) fn uri(&self, key: &Key) -> String {
        self.get(key).map_or_else(|| key.uri(), |document| document.uri.clone())
    }

    /// A main file with what is wrong with its bytes; `None` if there is none, or it cannot be read.
    pub(crate) fn main_file(&self, key: &Key) -> Option<(Sources, Option<Diagnostic>)> {
        match self.get(key) {
            Some(document) => Some(pe_frontend::main_file(&key.name(), document.text.as_bytes())),
            None => {
                let bytes = read::at_most(key.path()?, LARGEST_FILE as u64).ok()?;
                Some(pe_frontend::main_file(&key.name(), &bytes))
            }
        }
    }
}

/// Gives a model its files: from the editor, else from disk. Notes what is asked for.
pub(crate) struct Files<'a> {
    texts: &'a Texts,
    folder: Option<(PathBuf, ModelFolder)>,
    asked: RefCell<Vec<Key>>,
}

impl<'a> Files<'a> {
    /// The files of the model with this main file.
    pub(crate) fn of(main: &Key, texts: &'a Texts) -> Files<'a> {
        let folder = main.path().and_then(|path| Some((path.parent()?.to_owned(), ModelFolder::of(path))));
        Files { texts, folder, asked: RefCell::default() }
    }

    /// What was asked for, whether it exists or not.
    pub(crate) fn asked(self) -> Vec<Key> {
        self.asked.into_inner()
    }
}

impl Loader for Files<'_> {
    fn load(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        // What is no file has no folder.
        let Some((folder, disk)) = &self.folder else { return Err(LoadError::Missing) };
        let key = Key::File(folder.join(path));
        self.asked.borrow_mut().push(key.clone());
        match self.texts.get(&key) {
            Some(document) => Ok(document.text.as_bytes().to_vec()),
            None => disk.load(path),
        }
    }
}

/// Lines of a text with something on them, comments aside.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.lines().map(|line| line.trim_start_matches(['\u{FEFF}', ' ', '\t']));
    lines.filter(|line| !line.is_empty() && !line.starts_with("//"))
}

/// Whether a text describes a whole model; others are parts of one, or nothing yet.
pub(crate) fn is_main(text: &str) -> bool {
    let begins = |line: &str, word: &str| {
        line.strip_prefix(word).is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', '\t']))
    };
    lines(text).any(|line| MAIN_WORDS.iter().any(|word| begins(line, word)))
}

/// Whether a text says nothing yet.
pub(crate) fn is_empty(text: &str) -> bool {
    lines(text).next().is_none()
}

/// The main files on disk or in the editor that include a file, those in its folder first.
pub(crate) fn including(file: &Path, texts: &Texts) -> Vec<Key> {
    let mut found = Vec::new();
    let wanted = Key::File(file.to_owned());
    for folder in file.ancestors().skip(1).take(FOLDERS_ABOVE + 1) {
        let on_disk = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let open = texts.all().filter_map(|(key, _)| key.path()).filter(|path| path.parent() == Some(folder));
        let mut specs: Vec<PathBuf> = on_disk.chain(open.map(Path::to_owned)).collect();
        specs.retain(|path| path.extension().is_some_and(|end| end == "spec") && path != file);
        specs.sort();
        specs.dedup();
        for main in specs.into_iter().take(MOST_SPECS).map(Key::File) {
            let small = main.path().and_then(|path| path.metadata().ok()).is_none_or(|data| data.len() <= LARGEST_SPEC);
            let Some((mut sources, None)) = small.then(|| texts.main_file(&main)).flatten() else { continue };
            if !sources.text().contains("include") || !is_main(sources.text()) {
                continue;
            }
            let files = Files::of(&main, texts);
            pe_frontend::parse(&mut sources, &files);
            if files.asked().contains(&wanted) {
                found.push(main);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::{is_empty, is_main};

    #[test]
    fn parts_of_models_are_told_from_models() {
        for text in ["param a = 1\nmodel x", "  step 1 ms", "model"] {
            assert!(is_main(text), "{text}");
        }
        for text in ["param a = 1", "// model x\nfunction f(x) = x", "models = 1", "step_size = 1", ""] {
            assert!(!is_main(text), "{text}");
        }
        assert!(["", "// note\n", "\n\n"].iter().all(|text| is_empty(text)) && !is_empty("\n\ta"));
    }
}
