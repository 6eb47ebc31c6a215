//! The output folder: complete or absent, at every moment.
//!
//! Files go into a hidden folder beside the target, `.NAME.partial-PID`. In the end it takes the target's place: by a
//! rename, or, if there is a folder already, by exchanging the two names in one system call, so that there is always
//! either the old one or the new one. The process holds a lock on its hidden folder; one without a lock was left by a
//! process that was killed, and the next compilation removes it. An interrupt removes it at once.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::console;
use pe_flow::failure::Failure;
use pe_map::sha256;

/// Files that mark a folder as written by this program; only such folders are replaced.
const MARKERS: [&str; 4] = ["report.json", "points.json", "accuracy.json", "wrapped.json"];

/// Files of a result: path and content.
pub type Files = Vec<(&'static str, Vec<u8>)>;

/// A lock on a folder that a command writes again and again: no other one does so meanwhile. It is a hidden file beside
/// the folder, for the folder itself is exchanged; a process that is killed leaves the file, but not the lock.
pub struct FolderLock {
    path: PathBuf,
    _file: File,
}

impl FolderLock {
    /// Locks a folder, which need not exist yet.
    ///
    /// # Errors
    /// If another process holds the lock, or nothing can be written beside the folder.
    pub fn take(target: &Path) -> Result<FolderLock, Failure> {
        let name = target.file_name().ok_or_else(|| Failure::file("write to", target, "it has no name"))?;
        let parent = target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(|error| Failure::file("create", parent, error))?;
        let path = parent.join(format!(".{}.lock", name.to_string_lossy()));
        loop {
            let file = File::options().create(true).truncate(false).write(true).open(&path);
            let file = file.map_err(|error| Failure::file("write to", target, error))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(fs::TryLockError::WouldBlock) => {
                    let reason = "another sweep is writing to it; wait until it ends, or choose another folder with -o";
                    return Err(Failure::file("write to", target, reason));
                }
                Err(fs::TryLockError::Error(error)) => return Err(Failure::file("lock", target, error)),
            }
            // The process before may have removed the file between the two calls.
            if is_at(&file, &path) {
                return Ok(FolderLock { path, _file: file });
            }
        }
    }
}

/// Whether a path leads to this open file.
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let number = |data: fs::Metadata| (data.dev(), data.ino());
    file.metadata().ok().map(number) == fs::metadata(path).ok().map(number)
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Writes files into a new folder beside the target and puts it in place at the end.
pub struct OutputFolder {
    target: PathBuf,
    partial: PathBuf,
    /// Hashes of the files so far.
    hashes: Mutex<BTreeMap<String, String>>,
    /// The hidden folder, locked as long as this is open.
    _lock: File,
    /// Whether the folder is in place; held while files change, and for good by who ends the process.
    finished: Arc<Mutex<bool>>,
}

impl OutputFolder {
    /// Whether a result may be put at `target`; to be asked before long work.
    ///
    /// # Errors
    /// If `target` exists and is not ours.
    pub fn permitted(target: &Path) -> Result<(), Failure> {
        if target.exists() && !is_ours(target) {
            let reason = match MARKERS.iter().find(|marker| target.join(marker).exists()) {
                Some(marker) => format!(
                    "{marker} in it is damaged or not from pe-synth; remove the folder, or choose another one with -o"
                ),
                None => "it exists and was not written by pe-synth; choose another folder with -o".to_owned(),
            };
            return Err(Failure::file("replace", target, reason));
        }
        Ok(())
    }

    /// Prepares the folder; nothing is visible at `target` before [`Self::finish`].
    ///
    /// # Errors
    /// If `target` is not permitted, or nothing can be written beside it.
    pub fn create(target: &Path) -> Result<OutputFolder, Failure> {
        Self::begin(target, |_, _| {})
    }

    /// The same; from here on an interrupt removes what has been written and ends the process.
    ///
    /// # Errors
    /// As above.
    pub fn create_until_interrupted(target: &Path) -> Result<OutputFolder, Failure> {
        Self::begin(target, remove_when_interrupted)
    }

    /// Prepares the folder after `before` has been told of its hidden path and its end.
    fn begin(target: &Path, before: impl FnOnce(&Path, &Arc<Mutex<bool>>)) -> Result<OutputFolder, Failure> {
        Self::permitted(target)?;
        let name = target.file_name().ok_or_else(|| Failure::file("write to", target, "it has no name"))?;
        let parent = target.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(|error| Failure::file("create", parent, error))?;
        let prefix = format!(".{}.partial-", name.to_string_lossy());
        remove_abandoned(if parent == Path::new("") { Path::new(".") } else { parent }, &prefix);
        let partial = target.with_file_name(format!("{prefix}{}", std::process::id()));
        let finished: Arc<Mutex<bool>> = Arc::default();
        before(&partial, &finished);
        let held = finished.lock().unwrap_or_else(PoisonError::into_inner);
        let lock = create_locked(&partial).map_err(|error| Failure::file("create", target, error))?;
        drop(held);
        Ok(OutputFolder { target: target.to_owned(), partial, hashes: Mutex::default(), _lock: lock, finished })
    }

    /// Where it will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes a file; `path` is relative and uses `/`.
    pub fn write(&self, path: &str, text: &str) -> Result<(), Failure> {
        self.write_bytes(path, text.as_bytes())
    }

    /// Writes a file that is no text.
    pub fn write_bytes(&self, path: &str, content: &[u8]) -> Result<(), Failure> {
        let _held = self.finished.lock().unwrap_or_else(PoisonError::into_inner);
        let file = self.partial.join(path);
        if let Some(folder) = file.parent() {
            fs::create_dir_all(folder).map_err(|error| Failure::file("create", folder, error))?;
        }
        fs::write(&file, content).map_err(|error| Failure::file("write", &file, error))?;
        let mut hashes = self.hashes.lock().unwrap_or_else(PoisonError::into_inner);
        hashes.insert(path.to_owned(), sha256(content));
        Ok(())
    }

    /// SHA-256 of every file so far, by its path.
    pub fn hashes(&self) -> BTreeMap<String, String> {
        self.hashes.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Puts the folder in place.
    pub fn finish(self) -> Result<(), Failure> {
        let mut finished = self.finished.lock().unwrap_or_else(PoisonError::into_inner);
        // The target may have changed since it was asked about.
        Self::permitted(&self.target)?;
        let result = if self.target.exists() { exchange(&self.partial, &self.target) } else { self.rename() };
        *finished = result.is_ok();
        // The old folder, now under the hidden name, goes with `drop`.
        result.map_err(|error| Failure::file("create", &self.target, error))
    }

    fn rename(&self) -> std::io::Result<()> {
        fs::rename(&self.partial, &self.target)
    }
}

/// Writes a single file: complete, or not at all. A file that is there keeps its permissions, and a link stays one; a device or a
/// pipe is written to.
///
/// # Errors
/// If it cannot be written.
pub fn write_file(path: &Path, content: &[u8]) -> Result<(), Failure> {
    let failed = |error| Failure::file("write", path, error);
    let mut target = path.to_owned();
    let mut permissions = None;
    match fs::metadata(path) {
        Ok(found) if !found.is_file() => return fs::write(path, content).map_err(failed),
        Ok(found) => {
            target = path.canonicalize().map_err(failed)?;
            permissions = Some(found.permissions());
        }
        Err(error) if error.kind() == ErrorKind::NotFound && path.is_symlink() => {
            return fs::write(path, content).map_err(failed);
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(failed(error)),
    }
    let name = target.file_name().ok_or_else(|| Failure::file("write", path, "it has no name"))?;
    // Not the name itself, which may be as long as names can be.
    let name = sha256(name.as_encoded_bytes());
    let partial = target.with_file_name(format!(".{}.partial-{}", &name[..16], std::process::id()));
    let written = fs::write(&partial, content)
        .and_then(|()| permissions.map_or(Ok(()), |permissions| fs::set_permissions(&partial, permissions)))
        .and_then(|()| fs::rename(&partial, &target));
    let Err(error) = written else { return Ok(()) };
    let _ = fs::remove_file(&partial);
    // The file may be written where its folder may not, and a mounted file cannot be replaced.
    match error.kind() {
        ErrorKind::PermissionDenied | ErrorKind::ResourceBusy if target.is_file() => fs::write(&target, content),
        _ => Err(error),
    }
    .map_err(failed)
}

/// Catches interrupts before there is anything to remove: one that comes just as the folder does finds it.
fn remove_when_interrupted(partial: &Path, finished: &Arc<Mutex<bool>>) {
    let (partial, finished) = (partial.to_owned(), Arc::clone(finished));
    // Where signals cannot be caught, the next compilation removes the folder.
    let _ = ctrlc::set_handler(move || {
        let finished = finished.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = fs::remove_dir_all(&partial);
        if !*finished {
            console::err("interrupted: nothing has been written\n");
        }
        std::process::exit(i32::from(Failure::Interrupted(String::new()).code()));
    });
}

/// Exchanges the names of two folders.
#[cfg(target_os = "linux")]
fn exchange(a: &Path, b: &Path) -> std::io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    match renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE) {
        // Some network file systems know no exchange.
        Err(rustix::io::Errno::INVAL | rustix::io::Errno::NOSYS) => exchange_stepwise(a, b),
        result => Ok(result?),
    }
}

/// Exchanges the names of two folders.
#[cfg(not(target_os = "linux"))]
fn exchange(a: &Path, b: &Path) -> std::io::Result<()> {
    exchange_stepwise(a, b)
}

/// Exchanges the names of two folders where the system cannot do it at once: `b` is absent for a moment.
fn exchange_stepwise(a: &Path, b: &Path) -> std::io::Result<()> {
    let mut aside = a.as_os_str().to_owned();
    aside.push("-old");
    fs::rename(b, &aside)?;
    fs::rename(a, b)?;
    fs::rename(&aside, a)
}

/// Creates a folder and locks it.
fn create_locked(path: &Path) -> std::io::Result<File> {
    loop {
        fs::create_dir(path)?;
        let folder = match File::open(path) {
            Ok(folder) => folder,
            Err(error) if error.kind() == ErrorKind::NotFound => continue,
            Err(error) => return Err(error),
        };
        // Until it was locked another process may have taken it for abandoned.
        if folder.try_lock().is_ok() && path.exists() {
            return Ok(folder);
        }
        let _ = fs::remove_dir_all(path);
    }
}

/// Removes folders that begin with `prefix` and that no process holds. An error here has no one to tell.
fn remove_abandoned(parent: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(parent) else { return };
    for entry in entries.flatten() {
        let path = entry.path();
        if entry.file_name().to_string_lossy().starts_with(prefix)
            && let Ok(folder) = File::open(&path)
            && folder.try_lock().is_ok()
        {
            let _ = fs::remove_dir_all(&path);
        }
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
