//! Temporary folders.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use pe_flow::failure::Failure;

/// A temporary folder that goes with its owner; all of a process are in one.
pub struct Scratch {
    path: PathBuf,
}

impl Scratch {
    /// A new folder.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn new() -> Result<Scratch, Failure> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let path = Self::all().join(COUNT.fetch_add(1, Ordering::Relaxed).to_string());
        fs::create_dir_all(&path).map_err(|error| Failure::file("create", &path, error))?;
        Ok(Scratch { path })
    }

    fn all() -> PathBuf {
        std::env::temp_dir().join(format!("pe-synth-{}", std::process::id()))
    }

    /// Removes all temporary folders of the process, for one that is about to end: what other threads, and the programs
    /// that they run, write from here on has no place any more.
    pub fn remove_all() {
        let all = Self::all();
        for _ in 0..100 {
            let _ = fs::remove_dir_all(&all);
            let _ = fs::write(&all, "");
            if all.is_file() {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        let _ = fs::remove_file(&all);
    }

    /// A new, empty folder in it.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn folder(&self, name: &str) -> Result<PathBuf, Failure> {
        let path: &Path = &self.path.join(name.replace(' ', "-").to_lowercase());
        // What an earlier start left there would be taken for this one's.
        let _ = fs::remove_dir_all(path);
        fs::create_dir_all(path).map_err(|error| Failure::file("create", path, error))?;
        Ok(path.to_owned())
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path);
        // Fails while there are others.
        let _ = fs::remove_dir(Self::all());
    }
}
