//! The language reference must not say anything that is not so.

mod common;

use pe_frontend::{NoFiles, Overrides, compile};
use std::collections::BTreeMap;

#[test]
fn every_example_in_the_language_reference_compiles_without_warnings() {
    let text = std::fs::read_to_string(common::root().join("docs/language.md")).expect("the reference can be read");
    // "```ode file=PATH" is a file that later examples name; "```ode" is a main file.
    let mut files = BTreeMap::new();
    let mut examples = 0;
    for block in text.split("```ode").skip(1) {
        let (kind, rest) = block.split_once('\n').unwrap_or_default();
        let example = rest.split("```").next().unwrap_or("");
        if let Some(path) = kind.strip_prefix(" file=") {
            files.insert(path.to_owned(), example.as_bytes().to_vec());
            continue;
        }
        let mut sources = common::source(example);
        let findings = match compile(&mut sources, &files, &Overrides::default()) {
            Ok((_, warnings)) => warnings,
            Err(errors) => errors,
        };
        assert!(findings.is_empty(), "{}", findings.iter().map(|finding| format!("{finding}\n")).collect::<String>());
        examples += 1;
    }
    assert!(examples >= 4, "only {examples} examples found");
}

#[test]
fn every_model_compiles() {
    for path in common::specs(&common::root().join("models")) {
        let text = std::fs::read_to_string(&path).expect("the spec can be read");
        let mut sources = common::source(&text);
        if let Err(errors) = compile(&mut sources, &NoFiles, &Overrides::default()) {
            let rendered: String = errors.iter().map(|error| format!("{error}\n")).collect();
            panic!("{}:\n{rendered}", path.display());
        }
    }
}
