//! Runs every spec in `tests/specs`: exactly the findings marked in its comments must be reported.
//!
//! `// error: E0201` marks the line it stands on, `// error below: E0201` the next one, and `// global error: E0301`
//! a finding without a place; `warning` works the same. Several codes are separated by commas. A file whose name begins
//! with `accept` must compile.

mod common;

use pe_frontend::NoFiles;
use pe_ir::source::{Severity, Sources};
use std::collections::BTreeSet;
use std::path::Path;

/// The line of findings without a place.
const GLOBAL: usize = 0;

#[test]
fn findings_are_those_marked_in_the_specs() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/specs");
    let mut failures = String::new();
    let mut covered = BTreeSet::new();
    for path in common::specs(&folder) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).expect("the spec can be read");
        let mut sources = Sources::new(name.as_str(), &text);
        let (compiled, findings) =
            match pe_frontend::compile(&mut sources, &NoFiles, &pe_frontend::Overrides::default()) {
                Ok((_, warnings)) => (true, warnings),
                Err(findings) => (false, findings),
            };
        let mut found: Vec<(usize, String)> = Vec::new();
        let mut rendered = String::new();
        for finding in &findings {
            let line = finding.span.map_or(GLOBAL, |span| sources.position(span.start).line);
            found.push((line, finding.code.to_owned()));
            rendered += &format!("{finding} in line {line}\n");
            covered.insert(finding.code);
            assert_eq!(finding.code.starts_with('W'), finding.severity == Severity::Warning, "{name}: {rendered}");
        }
        found.sort();
        found.dedup();
        let wanted = marked(&text);
        let accept = name.starts_with("accept");
        if found != wanted || accept != compiled {
            failures += &format!(
                "{name}: wanted {wanted:?}\n{:>width$} {found:?}\n{rendered}\n",
                "found",
                width = name.len() + 8
            );
        }
    }
    assert!(failures.is_empty(), "{failures}");

    // Limits need huge specs, files others; they have tests of their own. E0209 comes from the command line, E0116 to E0118
    // and E0412 from the step.
    let elsewhere = [
        "E0104", "E0105", "E0108", "E0109", "E0112", "E0113", "E0116", "E0117", "E0118", "E0209", "E0412", "E0508",
        "E0509", "E0601", "E0602", "W0005",
    ];
    // Codes from 08 on belong to the stages after the front end.
    let of_front_end = |code: &&pe_ir::codes::Code| &code.code[1..3] < "08" && !elsewhere.contains(&code.code);
    for code in pe_ir::codes::CODES.iter().filter(of_front_end) {
        assert!(covered.contains(code.code), "no spec shows {}: {}", code.code, code.title);
    }
}

/// Lines and codes that the comments ask for.
fn marked(text: &str) -> Vec<(usize, String)> {
    let mut wanted = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let Some((_, comment)) = line.split_once("// ") else { continue };
        for kind in ["error", "warning"] {
            let places = [
                (format!("{kind}: "), at + 1),
                (format!("{kind} below: "), at + 2),
                (format!("global {kind}: "), GLOBAL),
            ];
            for (mark, line) in places {
                if let Some(codes) = comment.strip_prefix(&mark) {
                    wanted.extend(codes.split(", ").map(|code| (line, code.trim().to_owned())));
                }
            }
        }
    }
    wanted.sort();
    wanted
}

#[test]
fn no_shipped_model_has_a_comment_that_is_taken_for_a_divisor() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let mut read = 0;
    for path in common::specs(&folder) {
        let text = std::fs::read_to_string(&path).expect("the spec can be read");
        let (_, findings) = pe_frontend::parse(&mut Sources::new(path.display().to_string(), &text), &NoFiles);
        let told = findings.iter().find(|finding| finding.code == pe_ir::codes::COMMENTED_QUOTIENT);
        assert!(told.is_none(), "{}: {}", path.display(), told.expect("one is there"));
        read += 1;
    }
    assert!(read > 20, "only {read} models");
}
