//! The output folder: complete or absent.

use std::fs;
use std::path::{Path, PathBuf};

use crate::failure::Failure;

/// Files that mark a folder as written by this program; only such folders are replaced.
const MARKERS: [&str; 2] = ["report.json", "points.json"];

/// Writes files into a new folder beside the target and puts it in place at the end.
pub struct OutputFolder {
    target: PathBuf,
    partial: PathBuf,
}

impl OutputFolder {
    /// Whether a result may be put at `target`; to be asked before long work.
    ///
    /// # Errors
    /// If `target` exists and is not ours.
    pub fn permitted(target: &Path) -> Result<(), Failure> {
        if target.exists() && !is_ours(target) {
            let reason = "it exists and was not written by pe-synth; choose another folder with -o";
            return Err(Failure::file("replace", target, reason));
        }
        Ok(())
    }

    /// Prepares the folder; nothing is visible at `target` before [`Self::finish`].
    ///
    /// # Errors
    /// If `target` is not permitted, or nothing can be written beside it.
    pub fn create(target: &Path) -> Result<OutputFolder, Failure> {
        Self::permitted(target)?;
        let name = target.file_name().ok_or_else(|| Failure::file("write to", target, "it has no name"))?;
        let parent = target.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(|error| Failure::file("create", parent, error))?;
        let hidden = format!(".{}.partial-{}", name.to_string_lossy(), std::process::id());
        let partial = target.with_file_name(hidden);
        fs::create_dir(&partial).map_err(|error| Failure::file("create", &partial, error))?;
        Ok(OutputFolder { target: target.to_owned(), partial })
    }

    /// Writes a file; `path` is relative and uses `/`.
    pub fn write(&self, path: &str, text: &str) -> Result<(), Failure> {
        let file = self.partial.join(path);
        if let Some(folder) = file.parent() {
            fs::create_dir_all(folder).map_err(|error| Failure::file("create", folder, error))?;
        }
        fs::write(&file, text).map_err(|error| Failure::file("write", &file, error))
    }

    /// Puts the folder in place.
    pub fn finish(self) -> Result<(), Failure> {
        let old = self.partial.with_extension("old");
        if self.target.exists() {
            fs::rename(&self.target, &old).map_err(|error| Failure::file("replace", &self.target, error))?;
        }
        fs::rename(&self.partial, &self.target).map_err(|error| Failure::file("create", &self.target, error))?;
        if old.exists() {
            fs::remove_dir_all(&old).map_err(|error| Failure::file("remove", &old, error))?;
        }
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        // After `finish` there is nothing left; after a failure the remains go. An error here has no one to tell.
        let _ = fs::remove_dir_all(&self.partial);
    }
}

fn is_ours(folder: &Path) -> bool {
    let empty = fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none());
    let names_us = |text: String| text.contains("\"generator\": \"pe-synth ");
    let marked = MARKERS.iter().any(|marker| fs::read_to_string(folder.join(marker)).is_ok_and(names_us));
    empty || marked
}
