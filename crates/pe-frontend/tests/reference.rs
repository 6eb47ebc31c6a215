//! The examples in `docs/diagnostics.md` show what they say: each one, completed to a spec, gives its code.

mod common;

use pe_frontend::{Limits, NoFiles, Overrides, elaborate_within, parse};
use pe_ir::codes::CODES;
use std::collections::BTreeMap;

/// Codes whose examples need other files, a command line, the step graph, or more text than a page holds.
const ELSEWHERE: [&str; 17] = [
    "E0104", "E0105", "E0108", "E0109", "E0110", "E0111", "E0112", "E0113", "E0116", "E0117", "E0118", "E0209",
    "E0412", "E0508", "E0509", "W0005", "E0601",
];

/// The one code that is about comments.
const OF_COMMENTS: &str = "W0007";

/// The lines of a code's example that are not marked as right, without their comments.
fn example(code: &str) -> Vec<&'static str> {
    let section = pe_ir::codes::explain(code).expect("every code has a section");
    let fenced = section.split("```text\n").nth(1).and_then(|rest| rest.split("```").next()).expect("an example");
    let wrong = fenced.lines().filter(|line| line.split_once("//").is_none_or(|(_, note)| note.trim() != "right"));
    wrong
        .map(|line| if code == OF_COMMENTS { line } else { line.split("//").next().unwrap_or("").trim_end() })
        .collect()
}

/// The one-letter names that a line reads, each with what stands in the bracket that touches it.
fn names(line: &str) -> Vec<(String, Option<String>)> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut names = Vec::new();
    let mut rest = line;
    let mut after_number = false;
    while let Some(first) = rest.chars().next() {
        let length = rest.find(|c| !is_name(c)).unwrap_or(rest.len()).max(first.len_utf8());
        let (word, tail) = rest.split_at(length);
        // A letter after a number and a blank is a unit.
        if word.len() == 1 && first.is_ascii_alphabetic() && !after_number {
            let bracket = tail.strip_prefix('[').and_then(|inside| inside.split(']').next());
            names.push((word.to_owned(), bracket.map(str::to_owned)));
        }
        after_number = first.is_ascii_digit() || (after_number && first == ' ');
        rest = tail;
    }
    names
}

/// A spec around a fragment: what it leaves out of the head, declarations of what it reads, equations, an output.
fn completed(fragment: &[&str]) -> String {
    let begins = |word: &str| fragment.iter().any(|line| line.split_whitespace().next() == Some(word));
    let mut text = fragment.join("\n") + "\n";
    if !begins("model") {
        let head = [("model", "model m"), ("solver", "solver rk4"), ("step", "step 1 ms"), ("span", "span 1 s")];
        text += &head.iter().filter(|(word, _)| !begins(word)).map(|(_, line)| format!("{line}\n")).collect::<String>();
    }
    let used: Vec<(String, Option<String>)> = fragment.iter().flat_map(|line| names(line)).collect();
    let indices: Vec<&str> = used.iter().filter_map(|(_, bracket)| bracket.as_deref()?.get(..1)).collect();
    // Of a name that occurs with and without bracket, the bracket counts; the first letter in it is the index.
    let mut shapes: BTreeMap<&str, Option<&str>> = BTreeMap::new();
    for (name, bracket) in &used {
        let shape = shapes.entry(name).or_default();
        *shape = shape.or(bracket.as_deref());
    }
    let mut states = Vec::new();
    for (name, bracket) in shapes {
        let starts = |start: String| fragment.iter().any(|line| line.starts_with(&start));
        let declared = ["param", "const", "index", "input"].iter().any(|kind| starts(format!("{kind} {name}")));
        let algebraic = starts(format!("{name} =")) || (starts(format!("{name}[")) && !text.contains("]' ="));
        let bound = fragment.iter().any(|line| line.contains(&format!("({name} in")));
        if declared || algebraic || bound {
            continue;
        }
        if indices.contains(&name) && bracket.is_none() && name != "y" && name != "n" {
            text += &format!("index {name} in 1..4\n");
        } else if name == "n" || (name == "b" && bracket.is_none()) {
            text += &format!("const {name} = 7\n");
        } else {
            let index = bracket.and_then(|inside| inside.get(..1)).filter(|i| i.starts_with(char::is_alphabetic));
            let index = index.filter(|index| *index != "y" && *index != "n");
            let subscript = match (bracket, index) {
                (None, _) => String::new(),
                (Some(_), Some(index)) => format!("[{index}]"),
                (Some(_), None) => "[k in 1..4]".to_owned(),
            };
            if !["state", "angle"].iter().any(|kind| starts(format!("{kind} {name}"))) {
                text += &format!("state {name}{subscript} = 0\n");
            }
            if !starts(format!("{name}'")) && !starts(format!("{name}[")) {
                text += &format!("{name}{}' = 0\n", subscript.replace("[k in 1..4]", "[k]"));
            }
            states.push(name);
        }
    }
    if !begins("output") {
        if states.is_empty() {
            text += "state z = 0\nz' = -z\n";
            states.push("z");
        }
        text += &format!("output {}\n", states.join(", "));
    }
    text
}

#[test]
fn every_example_gives_its_code() {
    let limits = Limits { evaluations: 100_000, ..Limits::default() };
    let (mut failures, mut tried) = (String::new(), 0);
    for code in CODES.iter().filter(|code| &code.code[1..3] < "08" && !ELSEWHERE.contains(&code.code)) {
        let text = completed(&example(code.code));
        tried += 1;
        let mut sources = common::source(&text);
        let (spec, mut findings) = parse(&mut sources, &NoFiles);
        findings.extend(elaborate_within(&spec, &Overrides::default(), &limits).1);
        if !findings.iter().any(|finding| finding.code == code.code) {
            let found: String = findings.iter().map(|finding| format!("  {finding}\n")).collect();
            failures += &format!("{}: {}\n{text}{found}\n", code.code, code.title);
        }
    }
    assert!(failures.is_empty() && tried > 40, "{tried} tried\n{failures}");
}
