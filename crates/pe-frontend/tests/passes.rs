//! Every pass of the front end by what it does to small specs: `tests/passes/PASS/CASE.spec`, and the model or the
//! findings that come out, `CASE.expect`.
//!
//! `UPDATE_EXPECT=1 cargo test -p pe-frontend --test passes` writes what comes out now.

mod common;

use std::fmt::Write;
use std::path::Path;

use expect_test::expect_file;
use pe_frontend::{NoFiles, Overrides};
use pe_ir::source::{Diagnostic, Sources, Span};

/// Folders of cases, in the order in which the front end does what they are about.
const PASSES: [&str; 17] = [
    "syntax",
    "names",
    "constants",
    "settings",
    "arrays",
    "inline",
    "elementary",
    "equations",
    "signals",
    "sampled",
    "order",
    "prune",
    "fold",
    "units",
    "outputs",
    "data",
    "overrides",
];

/// A finding with the places that it is about, as a line and a column each.
fn finding(finding: &Diagnostic, sources: &Sources) -> String {
    let mut text = format!("{finding}\n");
    let place = |span: Span| {
        let position = sources.position(span.start);
        let around = sources.lines_around(span);
        let line = &sources.text()[around.start as usize..around.end as usize];
        format!("{}:{}: {}", position.line, position.column, line.trim())
    };
    if let Some(span) = finding.span {
        _ = writeln!(text, "  at {}", place(span));
    }
    for (span, label) in &finding.labels {
        _ = writeln!(text, "  {label}, at {}", place(*span));
    }
    if let Some(help) = &finding.help {
        _ = writeln!(text, "  help: {help}");
    }
    text
}

/// What the command line says in a case: lines that begin with `//:`.
fn overrides(text: &str) -> Overrides {
    let mut overrides = Overrides::default();
    for words in text.lines().filter_map(|line| line.strip_prefix("//:")) {
        match words.trim().split_once(' ') {
            Some(("set", assignment)) => {
                let (name, value) = assignment.split_once('=').expect("NAME=VALUE");
                overrides.set.push((name.to_owned(), value.parse().expect("a number")));
            }
            Some(("observe", name)) => overrides.observe.push(name.to_owned()),
            _ => panic!("no option: {words}"),
        }
    }
    overrides
}

fn compiled(name: &str, text: &str) -> String {
    let mut sources = Sources::new(name, text);
    let (model, findings) = match pe_frontend::compile(&mut sources, &NoFiles, &overrides(text)) {
        Ok((model, warnings)) => (Some(model), warnings),
        Err(errors) => (None, errors),
    };
    let findings: String = findings.iter().map(|one| finding(one, &sources)).collect();
    match model {
        Some(model) => {
            assert_eq!(pe_ir::verify::model::check(&model), Vec::<String>::new(), "{name}");
            findings + &model.to_string()
        }
        None => findings,
    }
}

#[test]
fn passes_make_of_specs_what_is_expected() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/passes");
    let mut folders = std::fs::read_dir(&root).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    assert!(folders.all(|folder| PASSES.iter().any(|pass| folder == *pass)), "a folder is in no pass");
    for pass in PASSES {
        let specs = common::specs(&root.join(pass));
        assert!(!specs.is_empty(), "{pass} has no cases");
        for spec in specs {
            let text = std::fs::read_to_string(&spec).expect("a spec");
            let name = spec.file_name().expect("a name").to_string_lossy().into_owned();
            expect_file![spec.with_extension("expect")].assert_eq(&compiled(&name, &text));
        }
    }
}
