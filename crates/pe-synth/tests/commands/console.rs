//! Standard output and files that cannot be written.

use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::support::bench::Folder;

fn model(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").join(name).join(format!("{name}.spec"))
}

fn pe_synth() -> Command {
    Command::new(env!("CARGO_BIN_EXE_pe-synth"))
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_full_disk_behind_standard_output_is_a_failure_and_a_closed_pipe_is_none() {
    let spec = model("van_der_pol").into_os_string().into_string().unwrap();
    let folder = Folder::new("console");
    let home = &folder.0;
    let design = home.join("design").into_os_string().into_string().unwrap();
    let golden = model("van_der_pol").with_file_name("golden").into_os_string().into_string().unwrap();
    let (sweep, studied) = (home.join("sweep").display().to_string(), home.join("study").display().to_string());
    let rk4 = ["--solver", "rk4", "--span", "50ms"];
    let commands = [
        vec!["compile", &spec, "--span", "50ms", "--no-pictures", "-o", &design],
        [&["explore", &spec, "--pes", "1", "--multiplier", "25x18", "--step", "5ms", "-o", &sweep], &rk4[..]].concat(),
        [&["accuracy", &spec, "--storage", "32", "--multiplier", "25x18", "-o", &studied], &rk4[..]].concat(),
        vec!["dump", &spec, "--stage", "model"],
        vec!["dump", &spec, "--stage", "program", "--span", "50ms"],
        vec!["sim", &spec, "--double", "--span", "50ms"],
        vec!["check", &spec, "--span", "50ms"],
        vec!["diff", &golden, &golden],
        vec!["explain"],
        vec!["explain", "E0307"],
        vec!["completions", "bash"],
        vec!["man"],
        vec!["--help"],
        vec!["compile", "--help"],
        vec!["--version"],
    ];
    for command in commands {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = pe_synth().args(&command).stdout(full).output().unwrap();
        assert_eq!(output.status.code(), Some(3), "{command:?}: {}", stderr(&output));
        assert!(stderr(&output).contains("cannot write standard output: "), "{command:?}: {}", stderr(&output));
        // A sweep does not write over a folder that has another one.
        [&sweep, &studied].iter().for_each(|folder| drop(fs::remove_dir_all(folder)));
        let mut child = pe_synth().args(&command).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        drop(child.stdout.take());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{command:?} with a closed pipe");
    }
}

#[test]
fn a_file_is_written_whole_through_links_and_into_devices_and_pipes() {
    let spec = model("van_der_pol").into_os_string().into_string().unwrap();
    let folder = Folder::new("console_files");
    let home = &folder.0;
    folder.sub("inner");
    let sim = |to: &str| {
        let words = ["sim", &spec, "--double", "--span", "20ms", "-o", to];
        pe_synth().current_dir(home).args(words).output().unwrap()
    };
    assert!(sim("inner/trace.csv").status.success());
    let trace = fs::read(home.join("inner/trace.csv")).unwrap();
    assert!(trace.len() > 100);

    // A link stays one, and the file behind it keeps its permissions.
    fs::write(home.join("inner/old.csv"), "old").unwrap();
    let mut permissions = fs::metadata(home.join("inner/old.csv")).unwrap().permissions();
    permissions.set_mode(0o640);
    fs::set_permissions(home.join("inner/old.csv"), permissions).unwrap();
    std::os::unix::fs::symlink("inner/old.csv", home.join("link.csv")).unwrap();
    assert!(sim("link.csv").status.success());
    assert!(fs::symlink_metadata(home.join("link.csv")).unwrap().is_symlink());
    assert_eq!(fs::read(home.join("inner/old.csv")).unwrap(), trace);
    assert_eq!(fs::metadata(home.join("inner/old.csv")).unwrap().permissions().mode() & 0o777, 0o640);

    // A link to what is not there yet makes it, and a name as long as names can be is one.
    std::os::unix::fs::symlink("inner/new.csv", home.join("early.csv")).unwrap();
    assert!(sim("early.csv").status.success());
    assert!(fs::symlink_metadata(home.join("early.csv")).unwrap().is_symlink());
    assert_eq!(fs::read(home.join("inner/new.csv")).unwrap(), trace);
    let long = format!("{}.csv", "x".repeat(251));
    assert!(sim(&long).status.success());
    assert_eq!(fs::read(home.join(&long)).unwrap(), trace);

    // What is no file is written to, and is there afterwards.
    assert_eq!(sim("/dev/stdout").stdout, trace);
    assert!(sim("/dev/null").status.success());
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    let full = sim("/dev/full");
    assert_eq!(full.status.code(), Some(3), "{}", stderr(&full));
    let folder = sim("inner");
    assert_eq!(folder.status.code(), Some(3), "{}", stderr(&folder));
    assert!(stderr(&folder).contains("inner"), "{}", stderr(&folder));
    let names = |path: &Path| {
        let entries = fs::read_dir(path).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    assert_eq!(names(home), ["early.csv", "inner", "link.csv", &long]);
    assert_eq!(names(&home.join("inner")), ["new.csv", "old.csv", "trace.csv"]);
}

#[test]
fn a_file_that_a_full_disk_cannot_take_stays_as_it_was() {
    let spec = model("van_der_pol").into_os_string().into_string().unwrap();
    let folder = Folder::new("console_full");
    let home = &folder.0;
    let trace = home.join("trace.csv");
    fs::write(&trace, "old").unwrap();
    // A limit on the size of files ends a write like a full disk, but with a signal unless that is ignored.
    let limited = "trap '' XFSZ; ulimit -f 1; exec \"$@\"";
    let mut sim = Command::new("bash");
    sim.args(["-c", limited, "bash", env!("CARGO_BIN_EXE_pe-synth"), "sim", &spec, "--double", "--span", "2s", "-o"]);
    let output = sim.arg(&trace).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(stderr(&output).contains("trace.csv"), "{}", stderr(&output));
    assert_eq!(fs::read(&trace).unwrap(), b"old");
    assert_eq!(fs::read_dir(home).unwrap().count(), 1);
}
