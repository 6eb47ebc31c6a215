//! Specs that tests wrote, in all engines.

use std::path::Path;
use std::process::Command;

use pe_verify::engines::Engine;
use serde_json::Value;

use super::bench::assert_lively_agreement;
use super::is_long_suite;
use super::models::compile_file;

/// All engines but Verilator, whose build takes longer than all else.
pub const ENGINES: &[Engine] = &[Engine::Reference, Engine::Fast, Engine::Ghdl];

/// The same, and Verilator if it is asked for or in the long suite.
pub fn engines(verilator: bool) -> &'static [Engine] {
    if verilator || is_long_suite() { &Engine::ALL } else { ENGINES }
}

/// Asserts that Rust reference, fast form and GHDL compute the words of the simulator, of which so large a part changes: from
/// the beginning and from the middle, in the long suite from all starts of `verify`. Options are those of `compile`.
pub fn assert_same_words(spec: &Path, options: &str, steps: u64, part: f64) {
    let words: Vec<&str> = options.split_whitespace().collect();
    if !is_long_suite() {
        let starts = compile_file(spec, &words).starts(steps);
        assert_lively_agreement(&spec.display().to_string(), &starts, ENGINES, part);
        return;
    }
    let folder = spec.with_extension("design").display().to_string();
    let run = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().expect("the program starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{arguments:?}: {told}");
        output.stdout
    };
    let path = spec.display().to_string();
    run(&[&["compile", &path, "--quiet", "--no-pictures", "-o", &folder], &words[..]].concat());
    let told = run(&["verify", &folder, "--steps", &steps.to_string(), "--message-format", "json"]);
    let told: Value = serde_json::from_slice(&told).expect("runs as an object");
    let runs = told["runs"].as_array().expect("runs");
    let lively = runs.iter().filter(|run| run["engine"] == "GHDL" && run["live"].as_f64() > Some(part)).count();
    assert!(lively >= 2, "{told}");
}
