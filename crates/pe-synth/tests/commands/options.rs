//! Options that commands have alike.

use std::fs;
use std::process::{Command, Output};

use crate::support::bench::Folder;
use crate::support::models::spec;

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn commands_have_the_options_that_others_have() {
    let help = |words: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(words).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let commands = help(&["--help"]);
    let commands = commands.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    let names =
        commands.lines().filter(|line| !line.starts_with("   ")).filter_map(|line| line.split_whitespace().next());
    // These print a text that others made, or have a protocol for messages.
    for name in names.filter(|name| !["help", "completions", "man", "lsp"].contains(name)) {
        let page = help(&[name, "-h"]);
        assert!(page.contains("--message-format"), "{name}");
        assert_eq!(page.contains("--quiet"), page.contains("-q, --quiet"), "{name}");
        assert_eq!(page.contains("--output <"), page.contains("-o, --output <"), "{name}");
        let tells = ["accuracy", "check", "compile", "explore", "fmu", "import", "verify", "wrap"];
        assert!(!tells.contains(&name) || page.contains("--quiet"), "{name} cannot be quiet");
    }
    let usage = Command::new(env!("CARGO_BIN_EXE_pe-synth")).arg("import").output().unwrap();
    let text = stderr(&usage);
    assert!(usage.status.code() == Some(2) && text.contains("import [OPTIONS] <FILE>\n"), "{text}");
    assert!(text.contains("import [OPTIONS] --suite <FOLDER>") && !text.contains("--suite <FOLDER> <FILE>"), "{text}");
}

#[test]
fn quiet_commands_print_findings_only() {
    let folder = Folder::new("quiet_commands");
    let home = &folder.0;
    let spec = spec("harmonic_oscillator");
    let quiet = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).current_dir(home).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty() && output.stderr.is_empty(), "{arguments:?}: {}", stderr(&output));
    };
    let spec = spec.to_str().unwrap();
    quiet(&["check", spec, "--span", "50ms", "-q"]);
    quiet(&["compile", spec, "--span", "50ms", "-q", "--no-pictures", "-o", "out"]);
    quiet(&["verify", "out", "-q", "--engines", "fast", "--steps", "2"]);
    quiet(&["dump", spec, "--stage", "model", "-o", "model.txt"]);
    assert!(fs::read_to_string(home.join("model.txt")).unwrap().contains("harmonic_oscillator"));
    let output =
        Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(["check", spec, "--step", "2", "--quiet"]).output().unwrap();
    assert!(output.status.code() == Some(1) && output.stdout.is_empty() && !output.stderr.is_empty());
}

#[test]
fn a_number_of_pes_that_is_no_count_is_told_so() {
    for command in ["compile", "explore", "accuracy"] {
        for count in ["-1", "0", "1.5", "many"] {
            let mut program = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
            let output = program.arg(command).arg(spec("lorenz")).args(["--pes", count]).output().unwrap();
            let text = stderr(&output);
            let told = text.contains("expected a count: a whole number from 1 on") && !text.contains("tip");
            assert!(told && output.status.code() == Some(2), "{command} {count}: {text}");
        }
    }
}

#[test]
fn a_slip_in_an_option_is_told_with_that_option() {
    let refused = |word: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(["compile", word]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{word}");
        stderr(&output)
    };
    let help = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(["compile", "-h"]).output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    // What is said of options stands further to the right.
    let indented =
        |line: &&str| line.find(|letter| letter != ' ').is_some_and(|at| at <= 6 && line[at..].starts_with('-'));
    let lines = help.lines().filter(indented);
    let named = |line: &str| -> Option<String> {
        line.split_whitespace().find(|word| word.starts_with("--")).map(str::to_owned)
    };
    let options: Vec<String> = lines.filter_map(named).filter(|word| word.len() > 4).collect();
    assert!(options.len() > 30, "{options:?}");
    for option in &options {
        let mut letters: Vec<char> = option.chars().collect();
        let last = letters.len() - 1;
        letters.swap(last - 1, last);
        let typed: String = letters.into_iter().collect();
        if !options.contains(&typed) {
            let told = refused(&typed);
            assert!(told.contains(&format!("exists: '{option}'\n")), "{told}");
        }
    }
    assert!(refused("--pse").contains("'--pes'"), "{}", refused("--pse"));
    assert!(!refused("--nonsense-of-all-kinds").contains("similar"), "{}", refused("--nonsense-of-all-kinds"));
}
