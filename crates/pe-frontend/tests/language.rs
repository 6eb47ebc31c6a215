//! The language reference must not say anything that is not so.

mod common;

use pe_frontend::{Overrides, compile};
use std::collections::BTreeMap;

#[test]
fn every_example_in_the_language_reference_compiles_without_warnings() {
    let text = std::fs::read_to_string(common::root().join("docs/language.md")).expect("the reference can be read");
    // "```ode file=PATH" and "```csv file=PATH" are files that examples name, "```ode" alone is a main file.
    let mut files = BTreeMap::new();
    let blocks: Vec<(&str, &str)> =
        text.split("\n```").skip(1).step_by(2).filter_map(|block| block.split_once('\n')).collect();
    for (kind, content) in &blocks {
        if let Some((_, path)) = kind.split_once(" file=") {
            files.insert(path.to_owned(), content.as_bytes().to_vec());
        }
    }
    let mut examples = 0;
    for (_, example) in blocks.iter().filter(|(kind, _)| *kind == "ode") {
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
        if let Err(errors) =
            compile(&mut sources, &common::Folder(path.parent().expect("a folder").to_owned()), &Overrides::default())
        {
            let rendered: String = errors.iter().map(|error| format!("{error}\n")).collect();
            panic!("{}:\n{rendered}", path.display());
        }
    }
}
