//! Runs the scripts of this crate by name: those that write pages of `docs`, and those that synthesise.
//!
//! `cargo run -p xtask` lists them, `cargo run -p xtask -- NAME ARGUMENT...` runs one in the current folder.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

mod tasks;
#[cfg(test)]
mod tests;

use tasks::{TASKS, Task};

/// Folder of this crate.
fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The script of a task.
fn script(task: &Task) -> PathBuf {
    folder().join(task.script)
}

/// The task of a name: that of its script, with or without the ending.
fn find(name: &str) -> Option<&'static Task> {
    TASKS.iter().find(|task| task.name() == name || Path::new(task.script).file_name().is_some_and(|file| file == name))
}

/// One line per task.
fn list() -> String {
    let width = TASKS.iter().map(|task| task.name().len()).max().unwrap_or(0);
    let line = |task: &Task| {
        let needs = if task.needs.is_empty() { String::new() } else { format!("; needs {}", task.needs) };
        format!("  {:width$}  {} ({}); {}{needs}\n", task.name(), task.makes, task.shown.join(", "), task.takes)
    };
    let (pages, synthesis): (Vec<&Task>, Vec<&Task>) = TASKS.iter().partition(|task| task.script.starts_with("pages/"));
    let part = |title: &str, tasks: Vec<&Task>| format!("{title}\n{}", tasks.into_iter().map(line).collect::<String>());
    format!(
        "cargo run -p xtask -- NAME [ARGUMENT...]\n\n{}\n{}\nThe head of each script in crates/xtask says more.\n",
        part("Pages and figures of docs:", pages),
        part("Area and clock of designs:", synthesis)
    )
}

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let Some(name) = arguments.next().filter(|name| name != "--help" && name != "-h") else {
        print!("{}", list());
        return ExitCode::SUCCESS;
    };
    let Some(task) = name.to_str().and_then(find) else {
        eprintln!("xtask: no task is named `{}`\n\n{}", name.display(), list());
        return ExitCode::from(2);
    };
    let script = script(task);
    // Only returns if the script cannot be started.
    let error = Command::new(&script).args(arguments.collect::<Vec<OsString>>()).exec();
    eprintln!("xtask: {}: {error}", script.display());
    ExitCode::from(3)
}
