//! The language reference must not say anything that is not so.

mod common;

use pe_frontend::{Overrides, compile};

#[test]
fn every_example_in_the_language_reference_compiles_without_warnings() {
    let text = std::fs::read_to_string(common::root().join("docs/language.md")).expect("the reference can be read");
    let mut examples = 0;
    for block in text.split("```ode\n").skip(1) {
        let example = block.split("```").next().unwrap_or("");
        let source = common::source(example);
        let findings = match compile(&source, &Overrides::default()) {
            Ok((_, warnings)) => warnings,
            Err(errors) => errors,
        };
        assert!(findings.is_empty(), "{}", findings.iter().map(|finding| finding.render(&source)).collect::<String>());
        examples += 1;
    }
    assert!(examples >= 4, "only {examples} examples found");
}

#[test]
fn every_model_compiles() {
    for path in common::specs(&common::root().join("models")) {
        let text = std::fs::read_to_string(&path).expect("the spec can be read");
        let source = common::source(&text);
        if let Err(errors) = compile(&source, &Overrides::default()) {
            let rendered: String = errors.iter().map(|error| error.render(&source)).collect();
            panic!("{}:\n{rendered}", path.display());
        }
    }
}
