//! Commands as they can be typed again.

use std::path::Path;

use clap::{Arg, ArgMatches};

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
