//! The full-size models on hundreds of PEs: two steps from the middle of a shortened span, in GHDL and as Rust
//! reference, bit for bit against the simulator.

use std::time::Instant;

use crate::support::bench::assert_agreement;
use crate::support::models::{compile, compile_file, spec};
use crate::support::{is_long_suite, kept};
use pe_verify::engines::Engine;

/// Steps of every comparison: the second one starts with what the first one left in all registers.
const STEPS: u64 = 2;

/// The annealer's budget: the mappings that it starts from are good enough here.
const TRIES: &str = "50000";

/// Models with numbers of PEs and spans that keep the middle near. GHDL takes minutes for all but the first one.
const MODELS: [(&str, &str, &str); 4] = [
    ("lutchen4000", "397", "50 ms"),
    ("wave80", "380", "10 ms"),
    ("weibel11", "396", "100 ms"),
    ("atrial15", "309", "10 ms"),
];

fn agree((model, pes, span): (&str, &str, &str)) {
    let clock = Instant::now();
    let compiled = compile(model, &["--pes", pes, "--multiplier", "25x18", "--span", span, "--tries", TRIES]);
    assert_eq!(compiled.design.program.pes.len().to_string(), pes);
    let seconds = clock.elapsed().as_secs_f64();
    let sum = assert_agreement(model, &[compiled.middle(STEPS)], &[Engine::Reference, Engine::Ghdl]);
    println!(
        "{model}: {pes} PEs, {} words per step, {} memory writes and {} outputs equal in {} runs; \
         compiled in {seconds:.1} s, engines {:.1} s",
        compiled.design.program.period, sum.writes, sum.outputs, sum.runs, sum.seconds
    );
}

#[test]
fn models_on_hundreds_of_pes_agree() {
    kept(MODELS, 1).for_each(agree);
}

#[test]
fn a_car_on_four_suspensions_agrees() {
    let options = "--pes 7 --multiplier 35x35 --storage 40 --proof off --elimination depth --factors ahead --span 20ms";
    let words: Vec<&str> = options.split(' ').collect();
    let compiled = compile_file(&spec("suspension").with_file_name("four_posts.spec"), &words);
    assert!(compiled.design.program.period > 5000, "only {} words", compiled.design.program.period);
    let engines = [Engine::Reference, Engine::Ghdl];
    let sum = assert_agreement("four_posts", &[compiled.middle(1)], &engines[..if is_long_suite() { 2 } else { 1 }]);
    println!("four_posts: {} memory writes equal, engines {:.1} s", sum.writes, sum.seconds);
}

#[test]
fn a_step_of_thousands_of_control_words_agrees() {
    let options = ["--set", "n=1000", "--pes", "3", "--multiplier", "25x18", "--form", "horner", "--span", "10ms"];
    let compiled = compile("lutchen4000", &options);
    // Their images are beyond what GHDL puts on the stack by default.
    assert!(compiled.design.program.period > 2800, "only {} words", compiled.design.program.period);
    assert_agreement("long", &[compiled.middle(1)], &[Engine::Reference, Engine::Ghdl]);
}
