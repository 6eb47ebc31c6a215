//! The options of commands as Python knows them: types for editors and type checkers.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

use clap::builder::StyledStr;
use clap::{Arg, ArgAction, Args, Command};
use expect_test::expect_file;
use pe_synth::cmd_accuracy::Accuracy;
use pe_synth::cmd_check::Check;
use pe_synth::cmd_compile::Compile;
use pe_synth::cmd_explore::Explore;

/// What the package says of options that are something else in Python.
const OTHERWISE: &str = include_str!("../../../pe-python/python/pe_synth/_options.py");

/// Names of options that are something else there.
fn otherwise() -> Vec<&'static str> {
    let lines = OTHERWISE.lines().skip_while(|line| !line.starts_with("_OTHERWISE = {")).skip(1);
    let names = lines.take_while(|line| *line != "}").filter_map(|line| line.trim().strip_prefix('"')?.split_once('"'));
    names.map(|(name, _)| name).collect()
}

/// What Python may give for one value of an option.
fn value(argument: &Arg) -> String {
    let words = argument.get_possible_values();
    if !words.is_empty() {
        let words: Vec<_> = words.iter().map(|word| format!("\"{}\"", word.get_name())).collect();
        return format!("Literal[{}]", words.join(", "));
    }
    let kind = argument.get_value_parser().type_id();
    let whole =
        [TypeId::of::<u16>(), TypeId::of::<u32>(), TypeId::of::<u64>(), TypeId::of::<usize>(), TypeId::of::<i32>()];
    if whole.iter().any(|whole| kind == *whole) {
        "int".to_owned()
    } else if kind == TypeId::of::<PathBuf>() {
        "Path".to_owned()
    } else {
        "Value".to_owned()
    }
}

/// The type of an option. A choice of words has a name, which is added to `names`.
fn kind(argument: &Arg, names: &mut BTreeMap<String, String>) -> String {
    if !argument.get_action().takes_values() {
        return "bool".to_owned();
    }
    let listed = matches!(argument.get_action(), ArgAction::Append)
        || argument.get_value_delimiter().is_some()
        || argument.get_value_names().is_some_and(|names| names.iter().any(|name| name.contains(',')));
    let long = argument.get_long().unwrap();
    if long == "set" {
        return "Mapping[str, float] | Sequence[str] | str".to_owned();
    }
    let mut kind = value(argument);
    if kind.starts_with("Literal") {
        let name = format!("{}{}", long[..1].to_uppercase(), &long[1..]);
        let other = names.insert(name.clone(), kind.clone());
        assert!(other.is_none_or(|other| other == kind), "commands differ in the words of --{long}");
        kind = name;
    }
    if listed { format!("{kind} | Sequence[{kind}]") } else { kind }
}

/// Lines of at most 120 characters, as a docstring.
fn docstring(help: &str) -> String {
    let mut lines = vec![String::from("    \"\"\"")];
    for word in help.split_whitespace() {
        let line = lines.last_mut().unwrap();
        if line.len() + word.len() > 110 {
            lines.push(format!("    {word}"));
        } else {
            write!(line, "{}{word}", if line.ends_with(['"', ' ']) { "" } else { " " }).unwrap();
        }
    }
    lines.join("\n") + ".\"\"\"\n"
}

/// Options of a command, each as it stands in a class.
fn entries<C: Args>(names: &mut BTreeMap<String, String>) -> Vec<String> {
    let command = C::augment_args(Command::new("command"));
    let otherwise = otherwise();
    let mut arguments: Vec<_> = command.get_arguments().filter(|argument| !argument.is_hide_set()).collect();
    arguments.sort_by_key(|argument| argument.get_long());
    let mut entries = Vec::new();
    for argument in arguments {
        let Some(long) = argument.get_long() else { continue };
        let key = long.replace('-', "_");
        if otherwise.contains(&key.as_str()) {
            continue;
        }
        // The only option that is a keyword of Python.
        let key = if key == "from" { "from_".to_owned() } else { key };
        let help = argument.get_help().map(StyledStr::to_string).unwrap_or_default();
        let help = help.replace('\\', "\\\\").replace('"', "'");
        entries.push(format!("\n    {key}: {}\n{}", kind(argument, names), docstring(&help)));
    }
    entries
}

/// A class of options.
fn class(title: &str, base: &str, of: &str, entries: &[String]) -> String {
    format!("\n\nclass {title}({base}, total=False):\n    \"\"\"Options of {of}.\"\"\"\n") + &entries.concat()
}

/// Takes what all lists have out of them.
fn common(lists: &mut [&mut Vec<String>]) -> Vec<String> {
    let (first, rest) = lists.split_first_mut().unwrap();
    let (shared, own) = first.drain(..).partition(|entry| rest.iter().all(|list| list.contains(entry)));
    **first = own;
    rest.iter_mut().for_each(|list| list.retain(|entry| !shared.contains(entry)));
    shared
}

#[test]
fn python_knows_the_options_of_commands() {
    let mut names = BTreeMap::new();
    let (mut compile, mut check) = (entries::<Compile>(&mut names), entries::<Check>(&mut names));
    let (mut explore, mut accuracy) = (entries::<Explore>(&mut names), entries::<Accuracy>(&mut names));
    let design = common(&mut [&mut compile, &mut check, &mut explore, &mut accuracy]);
    let single = common(&mut [&mut compile, &mut check]);
    let sweep = common(&mut [&mut explore, &mut accuracy]);
    let classes = [
        class("DesignOptions", "TypedDict", "all commands that design", &design),
        class("SingleOptions", "DesignOptions", "commands that take one design", &single),
        class("SweepOptions", "DesignOptions", "commands that compare designs", &sweep),
        class("CompileOptions", "SingleOptions", "`pe-synth compile`", &compile),
        class("CheckOptions", "SingleOptions", "`pe-synth check`", &check),
        class("ExploreOptions", "SweepOptions", "`pe-synth explore`", &explore),
        class("AccuracyOptions", "SweepOptions", "`pe-synth accuracy`", &accuracy),
    ];
    let mut text = "\
\"\"\"Options of commands with their types: `compile(spec, pes=2)` is `pe-synth compile --pes 2`.

Written by the test `python_options`.
\"\"\"

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Literal, TypeAlias, TypedDict

Path: TypeAlias = str | PathLike[str]
Value: TypeAlias = str | float
\"\"\"A number, or text as it is typed behind the option, such as '1 ms'.\"\"\"
"
    .to_owned();
    for (name, words) in names {
        let one_line = format!("{name}: TypeAlias = {words}\n");
        text += &if one_line.len() <= 120 {
            one_line
        } else {
            one_line.replace("Literal[", "Literal[\n    ").replace(", ", ",\n    ").replace("]\n", ",\n]\n")
        };
    }
    text += &classes.concat();
    for known in ["\n    pes: int\n", "\n    no_pre_adder: bool\n", "\n    from_: Path\n"] {
        assert!(text.contains(known), "{known}");
    }
    assert!(!text.contains("    quiet:") && !text.contains("    cluster:"));
    for (option, times) in [("allow", 1), ("span", 1), ("store", 1), ("coefficients", 2), ("fit", 2)] {
        assert_eq!(text.matches(&format!("\n    {option}: ")).count(), times, "{option}");
    }
    expect_file!["../../../pe-python/python/pe_synth/options.py"].assert_eq(&text);
}
