//! The page on the reference as a library: its commands and examples run, and all languages print the same.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::support::bench::Folder;
use crate::support::models::spec;

const PAGE: &str = include_str!("../../../../docs/library.md");

/// Fenced blocks of a language.
fn blocks(language: &str) -> Vec<&'static str> {
    let fence = format!("```{language}\n");
    PAGE.split(fence.as_str()).skip(1).map(|rest| rest.split("```").next().unwrap_or("")).collect()
}

/// Runs a command line; what it prints.
fn run(folder: &Path, command: &str) -> String {
    let output = Command::new("sh").args(["-c", command]).current_dir(folder).output().expect("there is a shell");
    assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

fn compile(folder: &Path, options: &[&str]) {
    let mut compile = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    compile.arg("compile").arg(spec("motor_pid")).args(["-q", "--no-pictures"]).args(options).current_dir(folder);
    let output = compile.output().expect("it was just built");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn examples_of_the_page_run_and_print_the_same() {
    let folder = Folder::new("library_page");
    let home = &folder.0;
    compile(home, &["--header", "-o", "out/motor_pid"]);
    for (language, file) in [("c", "loop.c"), ("python", "loop.py"), ("rust", "loop.rs")] {
        let [example] = blocks(language)[..] else { panic!("one example in {language}") };
        fs::write(home.join(file), example).expect("the test's own folder");
    }
    let commands: Vec<&str> = blocks("sh").into_iter().flat_map(str::lines).collect();
    let (compiles, builds): (Vec<&str>, Vec<&str>) = commands.iter().partition(|line| line.starts_with("pe-synth "));
    assert_eq!(compiles, ["pe-synth compile models/motor_pid/motor_pid.spec --header -o out/motor_pid"]);
    assert_eq!(builds.len(), 4, "{builds:?}");
    let mut printed = Vec::new();
    for build in builds {
        run(home, build);
        if build.contains("-o loop ") {
            printed.push(run(home, "./loop"));
        }
    }
    printed.push(run(home, "python3 loop.py"));
    assert!(printed.len() == 3 && printed.iter().all(|text| *text == printed[0]), "{printed:?}");
    let words: Vec<i64> = printed[0].split_whitespace().map(|word| word.parse().expect("a word")).collect();
    assert!(words.len() == 2 && words.iter().all(|word| *word != 0), "{words:?}");
    // The page lists the functions of the header, which is C and C++ without warnings.
    let header = fs::read_to_string(home.join("out/motor_pid/motor_pid.h")).expect("it was asked for");
    for line in header.lines().filter(|line| line.ends_with(");")) {
        let name = line.split("motor_pid_").nth(1).filter(|_| !line.contains("_network *motor_pid_new"));
        let name = name.map_or("new", |rest| rest.split('(').next().unwrap_or(""));
        let name = if name == "network" { "new" } else { name };
        assert!(PAGE.contains(&format!("NAME_{name}(")), "{name} is not on the page");
    }
    fs::write(home.join("only.c"), "#include \"motor_pid.h\"\n").expect("the test's own folder");
    for compiler in ["cc -std=c99", "c++ -std=c++11 -x c++"] {
        run(home, &format!("{compiler} -Wall -Wextra -Werror -pedantic -I out/motor_pid -fsyntax-only only.c"));
    }
    // Without the option there is none.
    compile(home, &["-o", "plain"]);
    assert!(!home.join("plain/motor_pid.h").exists() && home.join("plain/motor_pid_map.json").exists());
}
