//! Mappings that the user gives.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A folder of a test's own with a mapping in it; the file's path.
fn file(test: &str, text: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mapping_file").join(test);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let path = folder.join("m.map");
    fs::write(&path, text).unwrap();
    path
}

/// Runs a command on the oscillator, whose equations are `x` and `y`.
fn run(command: &[&str], options: &[&str]) -> Output {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/van_der_pol/van_der_pol.spec");
    Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(command).arg(spec).args(options).output().unwrap()
}

const DUMP: [&str; 5] = ["dump", "--span", "1s", "--only", "--stage"];

/// What `dump --stage mapping` prints or complains about with a mapping file.
fn mapped(test: &str, text: &str, options: &[&str]) -> (Option<i32>, String) {
    let path = file(test, text);
    let options = [&["--mapping", path.to_str().unwrap()], options].concat();
    let output = run(&[&DUMP[..], &["mapping"]].concat(), &options);
    let text = if output.status.success() { output.stdout } else { output.stderr };
    (output.status.code(), String::from_utf8(text).unwrap())
}

#[test]
fn what_dump_prints_is_taken_as_it_is() {
    let output = run(&[&DUMP[..], &["mapping"]].concat(), &["--pes", "2"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(mapped("back", &text, &[]), (Some(0), text.clone()));
    // Another one than the compiler's, with all that a file may hold beside it, and without the header.
    let other: String =
        text.lines().rev().filter(|line| !line.starts_with("pe-synth")).map(|line| line.to_owned() + "\n").collect();
    let (header, lines) = text.split_once('\n').unwrap();
    let swapped = lines.replace(" 0\n", " 2\n").replace(" 1\n", " 0\n").replace(" 2\n", " 1\n");
    let swapped = format!("{header}\n{swapped}");
    assert_eq!(mapped("order", &format!("# mine\n\n{other}"), &["--pes", "2"]), (Some(0), text));
    assert_eq!(mapped("swapped", &swapped, &[]), (Some(0), swapped.clone()));
}

#[test]
fn a_mapping_may_come_through_a_pipe() {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/van_der_pol/van_der_pol.spec");
    let target = file("pipe", "").with_file_name("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.args(["compile", "--span", "1s", "--quiet", "--mapping", "/dev/stdin", "-o"]).arg(&target).arg(spec);
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(b"x 0\ny 1\n").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_given_mapping_becomes_a_proved_design() {
    let path = file("design", "x 0\ny 0\n");
    let target = path.with_file_name("out");
    let options = ["--span", "1s", "--mapping", path.to_str().unwrap(), "-o", target.to_str().unwrap()];
    let output = run(&["compile"], &options);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(target.join("report.json")).unwrap()).unwrap();
    assert_eq!((&report["pes"], &report["starts"][0]["start"]), (&1.into(), &"given".into()));
}

#[test]
fn files_that_do_not_fit_are_refused_with_the_line() {
    for (test, text, place, message) in [
        ("unknown", "x 0\ny 1\nz 1\n", "m.map:3:1", "no equation `z`"),
        ("twice", "x 0\ny 1\n x 1\n", "m.map:3:2", "`x` already has a PE"),
        ("missing", "x 0\n", "m.map", "no PE is assigned to `y`"),
        ("gap", "x 0\ny 4294967294\n", "m.map:2:1", "PE 1 has no equation"),
        ("number", "x 0\ny one\n", "m.map:2:1", "does not assign an equation to a PE"),
        ("alone", "x\ny 0\n", "m.map:1:1", "does not assign an equation to a PE"),
        ("negative", "x -1\ny 0\n", "m.map:1:1", "does not assign an equation to a PE"),
        ("empty", "# nothing\n", "m.map", "maps no equation"),
    ] {
        let (code, complaint) = mapped(test, text, &[]);
        assert_eq!(code, Some(1), "{complaint}");
        assert!(complaint.contains("error[E0808]") && complaint.contains(place), "{test}: {complaint}");
        assert!(complaint.contains(message) && complaint.contains("help: "), "{test}: {complaint}");
    }
}

#[test]
fn options_that_do_not_go_with_a_mapping_exit_with_2() {
    let (code, complaint) = mapped("pes", "x 0\ny 1\n", &["--pes", "1"]);
    assert_eq!(code, Some(2), "{complaint}");
    let path = file("sweep", "x 0\ny 0\n");
    let output = run(&["explore"], &["--mapping", path.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    let missing = run(&["compile"], &["--mapping", "there/is/none"]);
    assert_eq!(missing.status.code(), Some(3), "{}", String::from_utf8_lossy(&missing.stderr));
}
