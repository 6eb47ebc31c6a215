//! Standard output that cannot be written.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

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
    let home = Path::new(env!("CARGO_TARGET_TMPDIR")).join("console");
    let _ = fs::remove_dir_all(&home);
    fs::create_dir_all(&home).unwrap();
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
