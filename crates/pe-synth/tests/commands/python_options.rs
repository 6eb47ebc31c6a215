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

/// A command's options as a class.
fn class<C: Args>(name: &'static str, title: &str, names: &mut BTreeMap<String, String>) -> String {
    let command = C::augment_args(Command::new(name));
    let otherwise = otherwise();
    let mut text =
        format!("\n\nclass {title}(TypedDict, total=False):\n    \"\"\"Options of `pe-synth {name}`.\"\"\"\n");
    let mut arguments: Vec<_> = command.get_arguments().filter(|argument| !argument.is_hide_set()).collect();
    arguments.sort_by_key(|argument| argument.get_long());
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
        write!(text, "\n    {key}: {}\n{}", kind(argument, names), docstring(&help)).unwrap();
    }
    text
}

#[test]
fn python_knows_the_options_of_commands() {
    let mut names = BTreeMap::new();
    let classes = [
        class::<Compile>("compile", "CompileOptions", &mut names),
        class::<Check>("check", "CheckOptions", &mut names),
        class::<Explore>("explore", "ExploreOptions", &mut names),
        class::<Accuracy>("accuracy", "AccuracyOptions", &mut names),
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
    expect_file!["../../../pe-python/python/pe_synth/options.py"].assert_eq(&text);
}
