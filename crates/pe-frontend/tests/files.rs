//! Specs of several files: what joins the model, and what is said where.

mod common;

use pe_frontend::{Loader, Overrides, compile};
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Sources};
use std::collections::BTreeMap;

const HEAD: &str = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\n";

/// Compiles a main file beside other files; findings one per line with code, place and message.
fn build(main: &str, others: &[(&str, &str)]) -> (Option<Model>, String) {
    let files: BTreeMap<String, Vec<u8>> =
        others.iter().map(|(path, text)| ((*path).to_owned(), text.as_bytes().to_vec())).collect();
    build_with(main, &files)
}

fn build_with(main: &str, loader: &dyn Loader) -> (Option<Model>, String) {
    let mut sources = Sources::new("models/m.spec", &format!("{HEAD}{main}"));
    let (model, findings) = match compile(&mut sources, loader, &Overrides::default()) {
        Ok((model, warnings)) => (Some(model), warnings),
        Err(errors) => (None, errors),
    };
    let line = |finding: &Diagnostic| {
        let place = finding.span.map(|span| sources.position(span.start));
        let place = place.map_or_else(String::new, |at| format!("{}:{}:{}", at.file, at.line, at.column));
        format!("{} {place} {}\n", finding.code, finding.message)
    };
    (model, findings.iter().map(line).collect())
}

#[test]
fn statements_of_included_files_stand_where_they_are_included() {
    let gates = "include \"constants.spec\"\nstate x = k\nx' = -x\ngate = 2*x";
    let (model, findings) = build(
        "include \"lib/gates.spec\"\nstate y = 0\ny' = gate\noutput x, y",
        &[("lib/gates.spec", gates), ("lib/constants.spec", "param k = 7")],
    );
    let model = model.expect(&findings);
    assert_eq!(findings, "");
    let states: Vec<(&str, f64)> = model.states.iter().map(|state| (state.name.as_str(), state.initial)).collect();
    assert_eq!(states, [("x", 7.0), ("y", 0.0)]);
}

#[test]
fn findings_lie_in_the_file_that_causes_them() {
    let (_, findings) = build(
        "state x = 0\nx' = -x\ninclude \"a.spec\"\noutput x + 1",
        &[("a.spec", "// first line\nparam z = nothing\nstep 2 s\ny = 2 x\n")],
    );
    let lines: Vec<&str> = findings.lines().collect();
    assert!(lines[0].starts_with("E0101 models/m.spec:8:10 "), "{findings}");
    assert!(lines[1].starts_with("E0201 models/a.spec:2:11 "), "{findings}");
    assert!(lines[2].starts_with("E0113 models/a.spec:3:1 `step` belongs in the main file"), "{findings}");
    assert!(lines[3].starts_with("E0101 models/a.spec:4:7 "), "{findings}");
    assert_eq!(lines.len(), 4, "{findings}");
}

#[test]
fn files_that_include_each_other_are_refused_and_repeats_count_once() {
    let include = |names: &[&str]| names.iter().map(|name| format!("include \"{name}\"\n")).collect::<String>();
    let main = |names: &[&str]| format!("{}output x", include(names));
    let x = "state x = 0\nx' = -x";
    let (_, findings) =
        build(&main(&["a.spec"]), &[("a.spec", &include(&["b.spec"])), ("b.spec", &include(&["./a.spec"]))]);
    assert_eq!(findings, "E0112 models/b.spec:1:9 `a.spec` includes `b.spec` includes `a.spec`\n");

    let (model, findings) = build(&main(&["a.spec", "a.spec"]), &[("a.spec", x)]);
    assert!(model.is_some());
    assert_eq!(findings, "W0005 models/m.spec:6:9 `a.spec` is included twice; it counts once\n");

    // Two files may need the same third one.
    let (model, findings) = build(&main(&["b.spec", "a.spec"]), &[("a.spec", x), ("b.spec", &include(&["a.spec"]))]);
    assert!(model.is_some());
    assert_eq!(findings, "");
}

#[test]
fn a_missing_file_is_one_finding_whatever_it_might_have_defined() {
    let (_, findings) = build("include \"a.spec\"\nx' = -k*x\noutput x, z", &[]);
    assert_eq!(findings, "E0111 models/m.spec:5:9 `a.spec` cannot be read: there is no such file\n");
}

#[test]
fn bytes_that_are_no_text_are_shown_where_they_stand() {
    let files = BTreeMap::from([("a.spec".to_owned(), b"// \xc3\xa4\n\xe4 = 1".to_vec())]);
    let (_, findings) = build_with("include \"a.spec\"\noutput x", &files);
    assert_eq!(findings, "E0109 models/a.spec:2:1 byte 6 is not valid UTF-8\n");
    let (sources, problem) = pe_frontend::main_file("m.spec", b"ab\n c\xff\xfe");
    let place = problem.and_then(|problem| problem.span).map(|span| sources.position(span.start));
    assert_eq!(place.map(|at| (at.line, at.column)), Some((2, 3)));
    assert!(pe_frontend::main_file("m.spec", "\u{e4}".as_bytes()).1.is_none());
}

#[test]
fn a_hundred_files_deep_is_too_deep() {
    let files: BTreeMap<String, Vec<u8>> =
        (0..100).map(|n| (format!("{n}"), format!("include \"{}\"", n + 1).into_bytes())).collect();
    let (_, findings) = build_with("include \"0\"\noutput x", &files);
    assert!(findings.starts_with("E0104 models/31:1:9 "), "{findings}");
}
