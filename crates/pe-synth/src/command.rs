//! Commands as they can be typed again.

use std::path::Path;

use clap::{Arg, ArgMatches, Args};
use pe_flow::failure::Failure;

/// A word of a command, quoted for a shell where it needs to be.
pub fn quoted(word: &str) -> String {
    let plain = !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./=+,:%@".contains(c));
    if plain { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// A path as outputs show it: an absolute one is reduced to its last name, since the folders of the machine that wrote
/// an output are of no use on another one.
pub fn shown_path(path: &str) -> &str {
    match Path::new(path).file_name().and_then(|name| name.to_str()) {
        Some(name) if Path::new(path).is_absolute() => name,
        _ => path,
    }
}

/// A word of a command as outputs show it: its path, if it is one, as in [`shown_path`], quoted.
pub fn shown_word(word: &str) -> String {
    match word.split_once('=') {
        Some((option, value)) if option.starts_with('-') => quoted(&format!("{option}={}", shown_path(value))),
        _ => quoted(shown_path(word)),
    }
}

/// The words of a command as it can be typed again in the folder of an absolute path, without the output folder: that does
/// not change the result.
pub fn typed(words: impl Iterator<Item = String>) -> String {
    let mut typed = vec!["pe-synth".to_owned()];
    let mut words = words;
    while let Some(word) = words.next() {
        if word == "-o" || word == "--output" {
            words.next();
        } else if !word.starts_with("-o") && !word.starts_with("--output=") {
            typed.push(shown_word(&word));
        }
    }
    typed.join(" ")
}

/// The options of a command from the words behind its name, for programs that have a command's work done in process.
///
/// # Errors
/// [`Failure::Usage`] in the words of the command line.
pub fn parsed<C: Args>(name: &'static str, words: &[String]) -> Result<C, Failure> {
    let command = C::augment_args(clap::Command::new(name)).no_binary_name(true).disable_help_flag(true);
    let matches = command.try_get_matches_from(words).and_then(|matches| C::from_arg_matches(&matches));
    matches.map_err(|error| {
        let (message, help) = refusal(&error);
        Failure::Usage(help.map_or(message.clone(), |help| format!("{message}; {help}")))
    })
}

/// What is wrong with the words of a command, in one line, and what helps.
pub fn refusal(error: &clap::Error) -> (String, Option<String>) {
    let text = error.render().to_string();
    let mut parts = text.split("\n\n").map(str::trim);
    let message = parts.next().unwrap_or_default().trim_start_matches("error: ");
    let help: Vec<&str> = parts.filter_map(|part| part.strip_prefix("tip: ")).collect();
    (message.split_whitespace().collect::<Vec<_>>().join(" "), (!help.is_empty()).then(|| help.join("; ")))
}

/// The words that give `arguments` again what the user gave them; those at their defaults are left out.
pub fn words<'a>(matches: &ArgMatches, arguments: impl Iterator<Item = &'a Arg>) -> Vec<String> {
    let mut words = Vec::new();
    for argument in arguments {
        let id = argument.get_id().as_str();
        // An argument of another command is unknown here.
        let Ok(Some(occurrences)) = matches.try_get_raw_occurrences(id) else { continue };
        if matches.value_source(id) != Some(clap::parser::ValueSource::CommandLine) {
            continue;
        }
        for values in occurrences {
            let values: Vec<String> = values.map(|value| value.to_string_lossy().into_owned()).collect();
            words.extend(argument.get_long().map(|long| format!("--{long}")));
            if argument.get_action().takes_values() {
                let delimiter = argument.get_value_delimiter().map_or(" ".to_owned(), String::from);
                let values: Vec<&str> = values.iter().map(|value| shown_path(value)).collect();
                words.push(quoted(&values.join(&delimiter)));
            }
        }
    }
    words
}
