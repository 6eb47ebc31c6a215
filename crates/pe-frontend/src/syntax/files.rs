//! Files that a spec names: how paths are resolved, and why a file cannot be used.
//!
//! The front end reads nothing itself; a [`Loader`] gives it the bytes. Paths are relative to the file that names
//! them and never lead out of the folder of the main file, so a spec can be moved and shared with its folder.

use crate::syntax::ast::Name;
use pe_ir::codes;
use pe_ir::index::number;
use pe_ir::source::{Diagnostic, Sources, Span};
use std::collections::BTreeMap;

/// Larger files are refused before they are looked at.
pub const LARGEST_FILE: usize = 16 << 20;

/// All files of a spec together; far below the 4 GiB that spans can count.
const LARGEST_TOTAL: usize = 128 << 20;

/// Gives the front end the files that a spec names.
pub trait Loader {
    /// The content of a file, at most [`LARGEST_FILE`] bytes. `path` is relative to the folder of the main file, its
    /// parts are separated by `/`, and none of them is `.` or `..`.
    fn load(&self, path: &str) -> Result<Vec<u8>, LoadError>;
}

/// Why there is no content.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LoadError {
    /// There is no such file.
    Missing,
    /// A symbolic link leads out of the folder of the main file.
    Outside,
    /// It has this many bytes, more than [`LARGEST_FILE`].
    TooLarge(u64),
    /// Something else, in the words of the system.
    Unreadable(String),
}

/// A loader without any files, for specs that consist of one.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoFiles;

impl Loader for NoFiles {
    fn load(&self, _: &str) -> Result<Vec<u8>, LoadError> {
        Err(LoadError::Missing)
    }
}

/// Files kept in memory, by path.
impl Loader for BTreeMap<String, Vec<u8>> {
    fn load(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        self.get(path).cloned().ok_or(LoadError::Missing)
    }
}

/// The main file of a spec, and what is wrong with its bytes if they are no text.
pub fn main_file(name: &str, bytes: &[u8]) -> (Sources, Option<Diagnostic>) {
    let sources = Sources::new(name, &String::from_utf8_lossy(bytes));
    let problem = not_text(bytes, sources.main().span());
    (sources, problem)
}

/// The first byte that is not UTF-8, in a file at this place. Up to there the lossy text has the same offsets.
fn not_text(bytes: &[u8], file: Span) -> Option<Diagnostic> {
    let at = std::str::from_utf8(bytes).err()?.valid_up_to();
    let start = file.start + number(at);
    // The sign that stands for what is not text has three bytes.
    let place = Span { start, end: (start + 3).min(file.end) };
    let message = format!("byte {at} is not valid UTF-8");
    Some(Diagnostic::error(codes::NOT_TEXT, place, message).with_help("save the file as UTF-8 text"))
}

/// The path of a file named by `path` in a file of the folder `folder`, relative to the folder of the main file.
pub(crate) fn resolve(folder: &str, path: &Name) -> Result<String, Diagnostic> {
    let refuse = |message: &str, help: &str| {
        Err(Diagnostic::error(codes::BAD_PATH, path.span, message.to_owned()).with_help(help))
    };
    let text = path.text.as_str();
    if text.contains('\\') || text.chars().any(char::is_control) {
        return refuse("a path separates its parts with `/`", "write it as in `data/airways.csv`");
    }
    if text.starts_with('/') || text.contains(':') {
        return refuse("an absolute path", "give the path relative to this file, so that the model can be moved");
    }
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in text.split('/') {
        match part {
            "" | "." => {}
            ".." if parts.pop().is_none() => {
                return refuse(
                    "the path leads outside the model's folder",
                    "put the file into the folder of the main spec or one below it",
                );
            }
            ".." => {}
            part => parts.push(part),
        }
    }
    match text.rsplit('/').next() {
        Some("" | "." | "..") | None => refuse("the path names no file", "write it as in `data/airways.csv`"),
        Some(_) => Ok(parts.join("/")),
    }
}

/// The folder of a path, without a slash at its end.
pub(crate) fn folder(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Loads a file into `sources` and gives its place; `path` is resolved, `named` is where the spec names it.
pub(crate) fn load(
    sources: &mut Sources,
    loader: &dyn Loader,
    path: &str,
    named: Span,
) -> Result<Span, Box<Diagnostic>> {
    let missing =
        |reason: String| Diagnostic::error(codes::NO_FILE, named, format!("`{path}` cannot be read: {reason}"));
    let bytes = loader.load(path).map_err(|error| match error {
        LoadError::Missing => {
            missing("there is no such file".to_owned()).with_help("paths are relative to the file that names them")
        }
        LoadError::Unreadable(reason) => missing(reason),
        LoadError::Outside => {
            let message = format!("`{path}` is a link that leads outside the model's folder");
            Diagnostic::error(codes::BAD_PATH, named, message).with_help("copy the file into the folder")
        }
        LoadError::TooLarge(size) => too_large(path, size, named),
    })?;
    let total = sources.text().len() + bytes.len();
    if bytes.len() > LARGEST_FILE {
        return Err(Box::new(too_large(path, u64::try_from(bytes.len()).unwrap_or(u64::MAX), named)));
    }
    if total > LARGEST_TOTAL {
        let message = format!("with `{path}` the files have {total} bytes; the most allowed is {LARGEST_TOTAL}");
        return Err(Box::new(Diagnostic::error(codes::FILE_TOO_LARGE, named, message)));
    }
    let shown = match sources.main().name().rfind(['/', '\\']) {
        Some(end) => format!("{}{path}", &sources.main().name()[..=end]),
        None => path.to_owned(),
    };
    let file = sources.add(shown, &String::from_utf8_lossy(&bytes));
    match not_text(&bytes, file) {
        Some(problem) => Err(Box::new(problem.with_label(named, "read from here"))),
        None => Ok(file),
    }
}

fn too_large(path: &str, size: u64, named: Span) -> Diagnostic {
    let message = format!("`{path}` has {size} bytes; the most allowed is {LARGEST_FILE}");
    Diagnostic::error(codes::FILE_TOO_LARGE, named, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_inside_the_folder_of_the_main_file() {
        let resolved = |folder: &str, path: &str| {
            let path = Name { text: path.to_owned(), span: Span::default() };
            resolve(folder, &path).map_err(|error| error.code)
        };
        assert_eq!(resolved("", "lib/gates.spec").as_deref(), Ok("lib/gates.spec"));
        assert_eq!(resolved("lib/deep", "../a.csv").as_deref(), Ok("lib/a.csv"));
        assert_eq!(resolved("lib", "./x/.././a b.csv").as_deref(), Ok("lib/a b.csv"));
        for (folder, path) in [
            ("", "../a"),
            ("lib", "../../a"),
            ("", "a/../../lib/a"),
            ("", "/etc/passwd"),
            ("", "C:/a"),
            ("", "a\\b"),
            ("", "a\u{0}"),
            ("", ""),
            ("lib", "."),
            ("", "a/"),
        ] {
            assert_eq!(resolved(folder, path), Err("E0110"), "{folder} {path}");
        }
    }
}
