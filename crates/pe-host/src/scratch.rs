//! Folders for what is built, which go with it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::error::Error;

/// A temporary folder.
pub(crate) struct Scratch(PathBuf);

impl Scratch {
    /// A new, empty one.
    pub(crate) fn new() -> Result<Scratch, Error> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("pe-host-{}-{number}", std::process::id()));
        // What an ended process of this number left there would be taken for ours.
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).map_err(|error| Error::file("create", &path, error))?;
        Ok(Scratch(path))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Runs a program to its end; gives what it prints.
pub(crate) fn run(command: &mut Command, name: &str, install: &str) -> Result<Vec<u8>, Error> {
    let output = command.stdin(std::process::Stdio::null()).output().map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => Error::MissingTool(format!("`{name}` is not installed: {install}")),
        _ => Error::Tool(format!("cannot start {name}: {error}")),
    })?;
    if output.status.success() {
        return Ok(output.stdout);
    }
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    if text.contains("linker") && text.contains("not found") {
        return Err(Error::MissingTool("a C linker is not installed: apt-get install gcc".to_owned()));
    }
    let telling = text.lines().find(|line| line.contains("error")).or(text.lines().next());
    Err(Error::Tool(format!("{name} failed: {}", telling.unwrap_or("without a message"))))
}
