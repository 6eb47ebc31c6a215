//! `verify --within`: what is compared fits into a time, what is left out is told, and nothing compared is no success.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use crate::support::bench::Folder;
use crate::support::models::spec;
use serde_json::Value;

/// A compiled design.
fn design(folder: &Folder) -> PathBuf {
    let target = folder.0.join("design");
    let mut compile = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    compile
        .arg("compile")
        .arg(spec("van_der_pol"))
        .args(["--span", "1s", "--quiet", "--no-pictures", "-o"])
        .arg(&target);
    assert!(compile.status().expect("pe-synth starts").success());
    target
}

fn verify(design: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("verify").arg(design).args(options);
    command
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn what_fits_is_compared_and_what_does_not_is_told() {
    let folder = Folder::new("verify_within");
    let design = design(&folder);
    let json = |options: &[&str]| {
        let output = verify(&design, &[options, &["--message-format", "json"]].concat()).output().unwrap();
        let verdict: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        (output.status.code(), verdict, stderr(&output))
    };
    let names = |verdict: &Value| -> Vec<(String, u64)> {
        let runs = verdict["runs"].as_array().expect("runs").iter();
        runs.map(|run| (run["start"].as_str().unwrap().to_owned(), run["steps"].as_u64().unwrap())).collect()
    };
    // With time enough it is what it is without a limit, and a first look.
    let engines = ["--engines", "reference,fast", "--steps", "3"];
    let (code, whole, text) = json(&engines);
    assert_eq!(code, Some(0), "{text}");
    let (code, ample, text) = json(&[&engines[..], &["--within", "10min"]].concat());
    assert!(code == Some(0) && ample["left_out"] == Value::Array(Vec::new()), "{ample} {text}");
    let (whole, ample) = (names(&whole), names(&ample));
    assert_eq!(ample[2..], whole, "the first look is in front");
    assert_eq!(ample[0], ("the beginning".to_owned(), 2));
    // Far more steps than there is time for.
    let (code, some, text) = json(&["--engines", "fast", "--steps", "1000000000", "--within", "6s"]);
    match code {
        Some(0) => {
            let left_out = some["left_out"].to_string();
            assert!(left_out.contains("of 1000000000 steps from the beginning"), "{left_out}");
            let moving = some["runs"].as_array().unwrap().iter().any(|run| run["live"].as_f64() > Some(0.0));
            assert!(moving && names(&some).iter().all(|(_, steps)| *steps < 1_000_000_000), "{some}");
        }
        // On a machine that is busy with others.
        code => assert!(code == Some(4) && text.contains("nothing that moves was compared in fast form"), "{text}"),
    }
}

#[test]
fn nothing_compared_in_time_is_a_failure_with_a_remedy() {
    let folder = Folder::new("verify_too_short");
    let design = design(&folder);
    let output = verify(&design, &["--within", "1us", "--quiet"]).output().unwrap();
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(4), "{text}");
    for part in
        ["nothing that moves was compared in Rust reference and fast form and GHDL", "`--within`", "`--engines`"]
    {
        assert!(text.contains(part), "no {part} in {text}");
    }
    // An engine that never ends is ended, and named; the other one does not stand in for it.
    let tools = folder.sub("tools");
    let ghdl = tools.join("ghdl");
    fs::write(&ghdl, "#!/bin/sh\nexec sleep 600\n").unwrap();
    fs::set_permissions(&ghdl, fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", tools.display(), std::env::var("PATH").unwrap());
    let begun = Instant::now();
    let mut command = verify(&design, &["--within", "8s", "--engines", "fast,ghdl"]);
    let output = command.env("PATH", path).output().unwrap();
    let (text, told) = (stderr(&output), String::from_utf8_lossy(&output.stdout).into_owned());
    assert!(output.status.code() == Some(4) && begun.elapsed() < Duration::from_secs(60), "{text}");
    assert!(text.contains("nothing that moves was compared in") && text.contains("GHDL within 8s"), "{text}");
    assert!(told.contains("left out   ") && told.contains("GHDL from the beginning"), "{told}");
    assert_eq!(verify(&design, &["--within", "1s", "--inject", "3"]).output().unwrap().status.code(), Some(2));
}
