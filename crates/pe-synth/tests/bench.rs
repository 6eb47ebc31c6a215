//! `pe-synth bench`: the native baseline computes what the compiler's own run computes.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

fn bench(path: Option<&Path>) -> Value {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/van_der_pol/van_der_pol.spec");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("bench").arg(spec).args(["--pes", "2", "--span", "1s", "--steps", "1000", "--message-format", "json"]);
    if let Some(path) = path {
        command.env("PATH", path);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn native_code_computes_the_same_numbers_in_double_precision_and_near_ones_in_single() {
    let figures = bench(None);
    let runs = figures["computer"]["runs"].as_array().unwrap();
    let errors: Vec<f64> = runs.iter().map(|run| run["error"].as_f64().unwrap()).collect();
    assert_eq!(errors[0], 0.0, "{figures}");
    assert!(errors[1] > 0.0 && errors[1] < 1e-3, "{figures}");
    assert!(runs.iter().all(|run| run["us_per_step"].as_f64().unwrap() > 0.0), "{figures}");
    assert_eq!(figures["hardware"]["clock"]["basis"], "assumed", "{figures}");
}

#[test]
fn without_a_compiler_the_loops_of_this_program_are_the_baseline_and_it_says_so() {
    let empty = std::env::temp_dir().join(format!("pe-synth-bench-test-{}", std::process::id()));
    std::fs::create_dir_all(&empty).unwrap();
    let figures = bench(Some(&empty));
    std::fs::remove_dir(&empty).unwrap();
    let kernel = figures["computer"]["kernel"].as_str().unwrap();
    assert!(kernel.contains("loops of this program") && kernel.contains("rustc"), "{kernel}");
    assert_eq!(figures["computer"]["runs"].as_array().unwrap().len(), 1);
}
