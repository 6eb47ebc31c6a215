//! A compilation that is interrupted at any moment leaves a complete folder or none.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::support::bench::Folder;
use crate::support::models::spec;

/// A compilation of a small model into a folder.
fn compilation(target: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("compile").arg(spec("weibel5")).args(["--span", "20ms", "--quiet", "-o"]).arg(target);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Names of the files in a folder, without those of its sub-folders.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the folder can be read");
    let mut names: Vec<String> = entries
        .map(|entry| entry.expect("the folder can be read").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn the_output_folder_is_complete_or_absent_whenever_the_program_ends() {
    let folder = Folder::new("interrupted");
    let whole = folder.0.join("whole");
    let clock = std::time::Instant::now();
    assert!(compilation(&whole).status().expect("pe-synth starts").success());
    let duration = clock.elapsed();
    let complete = names(&whole);
    let (mut absent, mut finished) = (0, 0);
    // Evenly over the compilation and a little beyond its end, by both signals.
    const MOMENTS: u32 = 24;
    for moment in 0..MOMENTS {
        let target = folder.0.join(format!("target{moment}"));
        let mut child = compilation(&target).spawn().expect("pe-synth starts");
        std::thread::sleep(Duration::from_millis(1) + duration * moment * 5 / (MOMENTS * 4));
        let signal = if moment % 2 == 0 { "-INT" } else { "-KILL" };
        // The process may have ended already; then there is no one to signal.
        let _ = Command::new("kill").arg(signal).arg(child.id().to_string()).stderr(Stdio::null()).status();
        child.wait().expect("pe-synth ends");
        if target.exists() {
            assert_eq!(names(&target), complete, "interrupted after {moment}/{MOMENTS} of its time");
            finished += 1;
        } else {
            absent += 1;
        }
    }
    println!("{absent} interrupted without a folder, {finished} finished with a complete one");
    assert!(absent > 0, "no compilation was interrupted");
}

#[test]
fn replacing_a_folder_leaves_the_old_or_the_new_one_and_no_remains() {
    let folder = Folder::new("replaced");
    let target = folder.0.join("design");
    let compile = |step: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        command.arg("compile").arg(spec("harmonic_oscillator")).args(["--span", "50ms", "--quiet", "--step", step]);
        command.arg("-o").arg(&target).stdout(Stdio::null()).stderr(Stdio::null());
        command
    };
    let clock = std::time::Instant::now();
    assert!(compile("1ms").status().expect("pe-synth starts").success());
    let duration = clock.elapsed();
    let complete = names(&target);
    const MOMENTS: u32 = 40;
    let mut replaced = 0;
    for moment in 0..MOMENTS {
        let step = if moment % 2 == 0 { "2ms" } else { "1ms" };
        let before = std::fs::read(target.join("report.json")).expect("a report");
        let mut child = compile(step).spawn().expect("pe-synth starts");
        // Mostly in the last third, where files are written.
        std::thread::sleep(duration / 2 + duration * moment / (MOMENTS * 2));
        child.kill().and_then(|()| child.wait()).expect("pe-synth ends");
        assert_eq!(names(&target), complete, "killed at moment {moment} of {MOMENTS}");
        let after = std::fs::read(target.join("report.json")).expect("a report");
        replaced += u32::from(before != after);
    }
    assert!(replaced < MOMENTS, "no compilation was killed before it had finished");
    assert!(compile("1ms").status().expect("pe-synth starts").success());
    assert_eq!(names(&folder.0), ["design"], "folders of killed compilations are left");
}

#[test]
fn an_interrupt_while_files_are_written_leaves_nothing() {
    let folder = Folder::new("interrupted_writing");
    let mut interrupted = 0;
    for attempt in 0..4 {
        let target = folder.0.join(format!("design{attempt}"));
        let mut command = compilation(&target);
        command.args(["--set", "generations=8", "--tries", "1000"]);
        let mut child = command.spawn().expect("pe-synth starts");
        // The hidden folder appears as the first file is about to be written.
        while names(&folder.0).is_empty() && child.try_wait().expect("pe-synth runs").is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        let _ = Command::new("kill").arg("-INT").arg(child.id().to_string()).stderr(Stdio::null()).status();
        let status = child.wait().expect("pe-synth ends");
        if target.exists() {
            std::fs::remove_dir_all(&target).expect("the folder can be removed");
        } else {
            assert_eq!(status.code(), Some(130), "attempt {attempt}");
            interrupted += 1;
        }
        assert_eq!(names(&folder.0), [""; 0], "attempt {attempt} left something");
    }
    assert!(interrupted > 0, "no compilation was interrupted while it wrote");
}

#[test]
fn a_folder_that_another_compilation_writes_to_is_left_alone() {
    let folder = Folder::new("two_at_once");
    let busy = folder.0.join(".design.partial-1");
    std::fs::create_dir(&busy).expect("a folder");
    let lock = std::fs::File::open(&busy).expect("the folder opens");
    lock.try_lock().expect("it is not locked yet");
    assert!(compilation(&folder.0.join("design")).status().expect("pe-synth starts").success());
    assert_eq!(names(&folder.0), [".design.partial-1", "design"]);
}

#[test]
fn a_summary_into_a_closed_pipe_is_no_error() {
    let folder = Folder::new("closed_pipe");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("compile").arg(spec("harmonic_oscillator")).args(["--span", "50ms", "-o"]).arg(folder.0.join("out"));
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("pe-synth starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("pe-synth ends");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !errors.contains("panicked"), "{errors}");
}
