//! `--watch`: runs a command again whenever a file changes that it reads.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, SystemTime};

use crate::console;
use crate::options::{MappingArgs, ModelArgs};
use pe_flow::failure::Failure;
use pe_flow::spec::{self, STANDARD_INPUT};

/// The option of commands that can be run again and again.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct WatchArgs {
    /// Runs the command again whenever a file changes that it reads, until it is interrupted
    #[arg(long, help_heading = "Output")]
    pub watch: bool,
}

/// Time between two looks at the files, and for which they must have been at rest: editors write in several steps.
const LOOK: Duration = Duration::from_millis(150);

/// The option, as it is left out of the command that is run.
const OPTION: &str = "--watch";

/// A file as it was seen: time of its last change and size; none if there is none.
type Seen = (PathBuf, Option<(SystemTime, u64)>);

/// Runs this command without `--watch`, again after each change of a file; ends when it is interrupted.
///
/// # Errors
/// If it reads standard input, or cannot be started.
pub fn watch(model: &ModelArgs, mapping: &MappingArgs) -> Result<(), Failure> {
    let named = [&model.spec, &model.from, &mapping.mapping];
    if model.spec.as_deref() == Some(Path::new(STANDARD_INPUT)) {
        return Err(Failure::Usage(format!("`{OPTION}` needs a file: standard input does not change")));
    }
    let program =
        std::env::current_exe().map_err(|error| Failure::File(format!("cannot find this program: {error}")))?;
    let arguments: Vec<OsString> = std::env::args_os().skip(1).filter(|word| word != OPTION).collect();
    loop {
        // Before the run, so that a change while it runs starts another one.
        let before = seen(&files(model.spec.as_deref(), named));
        let status = Command::new(&program).args(&arguments).status();
        let status = status.map_err(|error| Failure::File(format!("cannot start {}: {error}", program.display())))?;
        // An interrupt is meant for both.
        if status.code().is_none_or(|code| code == i32::from(Failure::Interrupted(String::new()).code())) {
            return Err(Failure::Interrupted("interrupted".to_owned()));
        }
        let ended =
            if status.success() { "done".to_owned() } else { format!("failed ({})", status.code().unwrap_or(0)) };
        let noun = if before.len() == 1 { "file" } else { "files" };
        console::err(&format!("--- {ended}; waiting for a change of {} {noun}\n", before.len()));
        wait(&before);
    }
}

/// The files that a command reads: those it names, and what the spec includes and takes data from.
fn files(spec: Option<&Path>, named: [&Option<PathBuf>; 3]) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = named.into_iter().flatten().cloned().collect();
    files.extend(spec.into_iter().flat_map(spec::files));
    files.sort();
    files.dedup();
    files
}

fn seen(files: &[PathBuf]) -> Vec<Seen> {
    let state = |path: &PathBuf| {
        let data = std::fs::metadata(path).ok()?;
        Some((data.modified().ok()?, data.len()))
    };
    files.iter().map(|path| (path.clone(), state(path))).collect()
}

/// Waits until a file differs from what was seen, and all of them stay as they are for a while.
fn wait(before: &[Seen]) {
    let paths: Vec<PathBuf> = before.iter().map(|(path, _)| path.clone()).collect();
    let mut last = seen(&paths);
    loop {
        sleep(LOOK);
        let now = seen(&paths);
        if now == last && now != before {
            return;
        }
        last = now;
    }
}
