//! Damaged folders: whatever was done to a design, `verify` says so, also to one that rests where it starts.

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::bench::Folder;
use crate::support::damage;
use crate::support::models::spec;
use pe_flow::failure::Failure;
use pe_verify::engines::Engine;
use pe_verify::folder::Change;
use pe_verify::judge::{Listener, Nobody, Options, Verdict, judge};

/// A converter with a sampled controller: nothing moves in the first half of its span.
const CONVERTER: &str = "\
model converter
solver heun
step 10 us
span 20 ms
input target = pulse(1, 10 ms, 5 ms)
input load = pulse(0.02, 12 ms, 3 ms)
state i = 0
state v = 0
i' = (u - v - 0.1*i)/1e-3
v' = (i - 0.1*v - load)/1e-4
every 100 us {
  state integral = 0
  error = target - v
  u = 0.5*error + integral
  next integral = integral + 0.01*error
}
output v, u
";

/// A file of the library or, with `NAME`, of the design; what stands there once or more; what stands there then.
type Damage = (&'static str, &'static str, &'static str, &'static str);

/// Damage that every design can take.
const ALWAYS: [Damage; 15] = [
    ("multiplier at 0", "hdl/pe_multiplier.vhd", "product_o <= product;", "product_o <= (others => '0');"),
    (
        "no saturation",
        "hdl/pe_scale.vhd",
        "if (SATURATE and differs = '1') then",
        "if (SATURATE and differs = 'U') then",
    ),
    ("no sticky flag", "hdl/pe.vhd", "overflow_o <= overflow;", "overflow_o <= '0';"),
    ("dead overflow_o", "NAME.vhd", "overflow_o <= overflowed;", "overflow_o <= '0';"),
    ("overflow_o always", "NAME.vhd", "overflow_o <= overflowed;", "overflow_o <= '1';"),
    ("step_i ignored", "hdl/pe_sequencer.vhd", "ce_i and (step_i or not waiting);", "ce_i;"),
    ("ce_i ignored", "hdl/pe_sequencer.vhd", "ce_i and (step_i or not waiting);", "step_i or not waiting;"),
    (
        "ce_i ignored as steps begin",
        "hdl/pe_sequencer.vhd",
        "ce_i and (step_i or not waiting);",
        "(ce_i and not waiting) or (waiting and step_i);",
    ),
    ("busy_o stuck", "hdl/pe_sequencer.vhd", "busy_o    <= hold_i or not waiting;", "busy_o   <= '1';"),
    ("outputs shown early", "hdl/pe_output.vhd", "if (publish = '1') then", "if (clk_i = '1') then"),
    ("outputs never shown", "hdl/pe_output.vhd", "if (publish = '1') then", "if (publish = 'U') then"),
    ("no rounding of outputs", "hdl/pe_output.vhd", "WORD_BITS + 1) + round_by;", "WORD_BITS + 1);"),
    ("settle ignored", "hdl/pe_sequencer.vhd", ":= '1';", ":= '0';"),
    ("accumulator without feedback", "hdl/pe.vhd", "kept := accumulator;", "kept := (others => '0');"),
    ("base not added", "hdl/pe_scale.vhd", "resize(signed(base & '0'), SUM_BITS)", "to_signed(0, SUM_BITS)"),
];

/// Damage of designs with the short pipeline.
const SHORT: [Damage; 4] = [
    ("ce_i ignored by PEs", "hdl/pe.vhd", "advance <= advance_i;", "advance <= '1';"),
    (
        "ce_i ignored by done_o",
        "hdl/pe_sequencer.vhd",
        "done <= publish;\n        end if;",
        "done <= publish;\n        else done <= '0';\n        end if;",
    ),
    (
        "an extra product register",
        "hdl/pe_multiplier.vhd",
        "whole <= product_of(own + imported, coefficient);",
        "kept <= product_of(own + imported, coefficient);\n          whole <= kept;",
    ),
    ("inputs taken whenever", "hdl/pe_input.vhd", "arrive <= sample_i;", "arrive <= '1';"),
];

/// Damage of designs with the deep pipeline.
const DEEP: [Damage; 2] = [
    (
        "ce_i ignored by PEs",
        "hdl/pe_sequencer.vhd",
        "advances(2 downto 1) & (fetch and valid);",
        "advances(2 downto 1) & valid;",
    ),
    (
        "done_o not held",
        "hdl/pe_sequencer.vhd",
        "if (ce_i = '1') then\n          done <= '0';",
        "if (clk_i = '1') then\n          done <= '0';",
    ),
];

fn options(engines: &[Engine]) -> Options {
    Options { engines: engines.to_vec(), steps: Some(12), within: None }
}

fn verdict(folder: &Path, engines: &[Engine]) -> Result<Verdict, Failure> {
    judge(folder, &options(engines), &Nobody)
}

/// Compiles a spec; gives the folder of the design.
fn compiled(folder: &Folder, spec: &Path, arguments: &[&str]) -> PathBuf {
    let target = folder.0.join("design");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("compile").arg(spec).args(arguments).args(["-q", "--no-pictures", "--tries", "500"]);
    // Proven designs have no saturation that could be damaged.
    command.args(["--proof", "off", "-o"]).arg(&target);
    let output = command.output().expect("pe-synth starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    target
}

fn converter(folder: &Folder, arguments: &[&str]) -> PathBuf {
    let spec = folder.0.join("converter.spec");
    fs::write(&spec, CONVERTER).expect("the spec can be written");
    compiled(folder, &spec, arguments)
}

/// A copy of a design beside it with another text of a file.
fn edited(design: &Path, file: &str, edit: impl Fn(&str) -> String) -> PathBuf {
    damage::edited(design, &design.with_file_name("damaged"), file, edit)
}

/// What is said of a folder.
#[derive(Default)]
struct Said(RefCell<String>);

impl Listener for Said {
    fn say(&self, line: &str) {
        *self.0.borrow_mut() += line;
    }
    fn at(&self, _: &str, _: usize, _: Option<f64>) {}
}

/// Asserts that GHDL finds damage, and that the file is named.
fn assert_caught(design: &Path, name: &str, file: &str, edit: impl Fn(&str) -> String) {
    let damaged = edited(design, file, edit);
    let said = Said::default();
    match judge(&damaged, &options(&[Engine::Ghdl]), &said) {
        // What GHDL refuses says nothing about what was compared.
        Err(Failure::Mismatch(what)) if what.contains("ghdl failed") => panic!("{name}: {what}"),
        Err(Failure::Mismatch(what)) => println!("{name}: {}", what.lines().next().unwrap_or_default()),
        Err(failure) => panic!("{name}: {failure:?}"),
        Ok(_) => panic!("{name} passes"),
    }
    let said = said.0.into_inner();
    let first = said.lines().next().unwrap_or_default();
    assert!(first.contains(file) && first.contains("hash"), "{name}: {said}");
}

fn assert_all_caught(design: &Path, name: &str, damages: &[Damage]) {
    for (what, file, from, to) in damages {
        let file = file.replace("NAME", name);
        assert_caught(design, what, &file, |text| {
            let mut text = text.replace(from, to);
            if to.contains("kept") {
                text = text.replace("architecture rtl of pe_multiplier is", "architecture rtl of pe_multiplier is\n  signal kept : signed(DATA_BITS + COEFFICIENT_BITS - 1 downto 0) := (others => '0');");
            }
            text
        });
    }
}

/// Flips the bit of a control word that enables its own operand, in the first word that has it set.
fn without_own_operand(package: &str) -> String {
    let lines = package.lines().map(str::to_owned).collect::<Vec<_>>();
    let start = lines.iter().position(|line| line.contains("PE0_STREAM : ")).expect("PE 0 has a program");
    let at = (start..lines.len()).find(|at| lines[*at].contains("=> b\"1_")).expect("a word has an own operand");
    let mut lines = lines;
    lines[at] = lines[at].replacen("b\"1_", "b\"0_", 1);
    lines.join("\n") + "\n"
}

/// Exchanges the first two links that a PE's ports are wired to.
fn with_swapped_links(network: &str) -> String {
    let line = network.lines().find(|line| line.contains("ports_") && line.contains("<= ") && line.contains(" & "));
    let line = line.expect("a PE has two ports");
    let (name, wiring) = line.trim_end_matches(';').split_once("<= ").expect("an assignment");
    let mut parts: Vec<&str> = wiring.split(" & ").collect();
    parts.swap(0, 1);
    network.replacen(line, &format!("{name}<= {};", parts.join(" & ")), 1)
}

/// Adds 1 to the first shift of a PE.
fn with_another_shift(network: &str) -> String {
    let (head, rest) = network.split_once("SHIFTS           => (0 => ").expect("a PE has shifts");
    let end = rest.find([',', ')']).expect("a list");
    let shift: u32 = rest[..end].parse().expect("a number");
    format!("{head}SHIFTS           => (0 => {}{}", shift + 1, &rest[end..])
}

/// Changes the lowest bit of a coefficient.
fn with_another_coefficient(program: &str) -> String {
    if let Some(line) = program.lines().find(|line| line.starts_with("coefficient ")) {
        let (head, last) = line.rsplit_once(' ').expect("numbers");
        let word = u64::from_str_radix(last, 16).expect("a coefficient") ^ 1;
        return program.replacen(line, &format!("{head} {word:x}"), 1);
    }
    let (head, rest) = program.split_once(" times ").expect("a PE has coefficients");
    let end = rest.find([' ', '\n']).expect("more words");
    let word = rest[..end].parse::<i64>().expect("a coefficient") ^ 1;
    format!("{head} times {word}{}", &rest[end..])
}

#[test]
fn a_design_at_rest_hides_no_damage() {
    let folder = Folder::new("damage_rest");
    let design = converter(&folder, &["--multiplier", "25x18", "--pes", "2"]);
    let verdict = verdict(&design, &[Engine::Ghdl]).unwrap_or_else(|failure| panic!("{failure:?}"));
    assert!(verdict.changes.is_empty());
    let met = verdict.coverage.handshake.all();
    assert!(met.iter().all(|(_, count)| *count > 0), "{met:?}");
    let live = |at: usize| verdict.runs[at]["live"].as_f64().expect("a share");
    println!("live {:.2} at first, {:.2} in motion", live(0), live(2));
    assert!(live(0) < 0.5 && live(2) > 0.6, "it starts at rest and is set in motion");
    assert_all_caught(&design, "converter", &ALWAYS);
    assert_all_caught(&design, "converter", &SHORT);
    let clamp = "if (word(WORD_BITS) /= word(WORD_BITS - 1)) then";
    let others: [Damage; 4] = [
        ("no clamp of inputs", "hdl/pe_input.vhd", clamp, "if (word(WORD_BITS) = 'U') then"),
        ("no flag of inputs", "hdl/pe_input.vhd", "overflow_o <= overflow;", "overflow_o <= '0';"),
        ("another rate", "converter.vhd", "STEPS     => 10,", "STEPS     => 11,"),
        ("another phase", "converter.vhd", "DONE      => 0,", "DONE      => 1,"),
    ];
    assert_all_caught(&design, "converter", &others);
    assert_caught(&design, "own_enable", "converter_program_pkg.vhd", without_own_operand);
    assert_caught(&design, "swapped links", "converter.vhd", with_swapped_links);
    assert_caught(&design, "a shift", "converter.vhd", with_another_shift);
    assert_caught(&design, "a coefficient", "converter_program.txt", with_another_coefficient);
}

#[test]
fn damage_shows_in_a_deep_pipeline() {
    let folder = Folder::new("damage_deep");
    let options = ["--multiplier", "25x18", "--pes", "3", "--pipeline", "deep", "--solver", "euler", "--span", "20ms"];
    let design = compiled(&folder, &spec("rc_ladder"), &options);
    verdict(&design, &[Engine::Ghdl, Engine::Reference]).unwrap_or_else(|failure| panic!("{failure:?}"));
    assert_all_caught(&design, "rc_ladder", &ALWAYS);
    assert_all_caught(&design, "rc_ladder", &DEEP);
    assert_caught(&design, "own_enable", "rc_ladder_program_pkg.vhd", without_own_operand);
    assert_caught(&design, "swapped links", "rc_ladder.vhd", with_swapped_links);
    assert_caught(&design, "a shift", "rc_ladder.vhd", with_another_shift);
}

#[test]
fn changed_missing_and_extra_files_are_named_and_fail_the_command() {
    let folder = Folder::new("damage_hashes");
    let design = converter(&folder, &["--multiplier", "25x18", "--pes", "1"]);
    let run = |folder: &Path, arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        command.arg("verify").arg(folder).args(["--engines", "reference", "--steps", "2"]).args(arguments);
        let output = command.output().expect("pe-synth starts");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        (output.status.code(), text, String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(run(&design, &[]).0, Some(0));
    let harmless = edited(&design, "hdl/pe_ram.vhd", |text| format!("{text}-- a note\n"));
    fs::write(harmless.join("hdl/pe_extra.vhd"), "").expect("the test folder takes files");
    fs::remove_file(harmless.join("converter_shapes.txt")).expect("the file is there");
    let (code, text, errors) = run(&harmless, &[]);
    let named: Vec<&str> = text.lines().take(3).collect();
    let files = ["converter_shapes.txt", "hdl/pe_extra.vhd", "hdl/pe_ram.vhd"];
    assert!(code == Some(4) && errors.contains("3 findings"), "{errors}");
    assert!(named.iter().zip(files).all(|(line, file)| line.contains(file)), "{text}");
    assert_eq!(run(&harmless, &["--allow-changed"]).0, Some(0));
    let (code, text, errors) = run(&harmless, &["--allow-changed", "--message-format", "json"]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"));
    assert!(code == Some(0) && errors.is_empty(), "{errors}");
    assert_eq!(json["changed"].as_array().map(Vec::len), Some(3));
    assert!(json["coverage"]["groups"].as_array().is_some_and(|groups| groups.len() > 10), "{json}");
    // As earlier versions wrote it.
    let old = edited(&design, "report.json", |text| text.replacen("\"files\"", "\"other\"", 1));
    let verdict = verdict(&old, &[Engine::Reference]).unwrap_or_else(|failure| panic!("{failure:?}"));
    assert_eq!(verdict.changes, [Change::NoHashes]);
    assert_eq!(run(&old, &[]).0, Some(4));
}

#[test]
fn the_reference_of_the_folder_is_judged() {
    let folder = Folder::new("damage_reference");
    let design = converter(&folder, &["--multiplier", "25x18", "--pes", "1"]);
    let damages = [
        ("saturation", "127 << (WORD_BITS - 8)", "126 << (WORD_BITS - 8)"),
        ("clamp of inputs", "stored.min(largest)", "stored"),
        ("a product", "wrapped(kept.wrapping_add(product)", "wrapped(kept.wrapping_add(product >> 1)"),
    ];
    for (what, from, to) in damages {
        let damaged = edited(&design, "converter_reference.rs", |text| text.replace(from, to));
        assert!(matches!(verdict(&damaged, &[Engine::Reference]), Err(Failure::Mismatch(_))), "{what} passes");
    }
}

#[test]
fn the_fast_form_of_the_folder_is_judged() {
    let folder = Folder::new("damage_fast");
    let design = converter(&folder, &["--multiplier", "25x18", "--pes", "1"]);
    let damages = [
        (
            "a coefficient",
            "slots[*slot as usize].factor = *coefficient;",
            "slots[*slot as usize].factor = *coefficient ^ 1;",
        ),
        ("rounding of a word", "(left >> shift) + (left << 1 >> shift & 1)", "(left >> shift)"),
        ("saturation", "(signed(word, WORD_BITS) == word).then_some(word)", "Some(word)"),
        ("a flag", "if beyond && written.flagged {", "if false {"),
        ("a state that stays", "changing.map(|(home, next)|", "changing.skip(1).map(|(home, next)|"),
        (
            "an output that shows another word",
            "self.slots[self.outputs[output] as usize].word",
            "self.slots[self.outputs[0] as usize].word",
        ),
        (
            "the order of moves",
            "let Fast { slots, sums, .. } = self;",
            "self.moves.pop(); let Fast { slots, sums, .. } = self;",
        ),
        ("a segment or a pass that differs", "const FOLLOWED: u32 = 4;", "const FOLLOWED: u32 = 1;"),
        (
            "an input",
            ".for_each(|(slot, operand)| slot.operand = *operand);",
            ".for_each(|(slot, operand)| slot.operand = *operand ^ 4);",
        ),
    ];
    for (what, from, to) in damages {
        let damaged = edited(&design, "converter_reference.rs", |text| text.replacen(from, to, 1));
        match verdict(&damaged, &[Engine::Reference, Engine::Fast]) {
            Err(Failure::Mismatch(text)) => {
                assert!(text.contains("fast form") || text.contains("reference failed"), "{text}")
            }
            _ => panic!("{what} passes"),
        }
    }
    verdict(&design, &[Engine::Reference, Engine::Fast]).unwrap_or_else(|failure| panic!("{failure:?}"));
}
