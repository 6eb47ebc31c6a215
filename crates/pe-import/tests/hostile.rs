//! Files that are meant to hurt.

mod common;

use common::{is_name, setting};
use pe_import::{Imported, Wanted};
use pe_ir::source::{Diagnostic, Sources};

fn import(text: &str) -> (Sources, Result<Imported, Vec<Diagnostic>>) {
    pe_import::import("hostile.xml", text.as_bytes(), &Wanted::Usual, &is_name)
}

fn codes(text: &str) -> Vec<&'static str> {
    import(text).1.err().unwrap_or_default().iter().map(|finding| finding.code).collect()
}

/// A model with these parts.
fn sbml(parts: &str) -> String {
    format!(
        "<sbml xmlns=\"http://www.sbml.org/sbml/level3/version2/core\" level=\"3\" version=\"2\"><model>{parts}</model></sbml>"
    )
}

/// A state whose rate is this.
fn rate(math: &str) -> String {
    let rule = format!("<rateRule variable=\"x\"><math>{math}</math></rateRule>");
    sbml(&format!(
        "<listOfParameters><parameter id=\"x\" value=\"1\" constant=\"false\"/></listOfParameters><listOfRules>{rule}</listOfRules>"
    ))
}

#[test]
fn entities_and_depth_are_refused_before_they_cost_anything() {
    let bomb = "<!DOCTYPE a [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;\">]>".to_owned() + &rate("<ci>&b;</ci>");
    assert_eq!(codes(&bomb), ["E1101"]);
    let deep = |depth: usize| "<apply><sin/>".repeat(depth) + "<ci>x</ci>" + &"</apply>".repeat(depth);
    assert_eq!(codes(&rate(&deep(100))), [""; 0]);
    assert_eq!(codes(&rate(&deep(170))), ["E1102"]);
    assert_eq!(codes(&rate(&deep(300_000))), ["E1102"]);
    assert_eq!(codes(&"<a>".repeat(400_000)), ["E1101"]);
    assert_eq!(codes("\u{0}"), ["E1101"]);
    assert_eq!(codes(""), ["E1101"]);
}

#[test]
fn functions_that_grow_when_written_out_are_refused() {
    let function = |index: usize, body: &str| {
        format!(
            "<functionDefinition id=\"f{index}\"><math><lambda><bvar><ci>x</ci></bvar>{body}</lambda></math></functionDefinition>"
        )
    };
    let twice = |index: usize| {
        format!(
            "<apply><times/><apply><ci>f{index}</ci><ci>x</ci></apply><apply><ci>f{index}</ci><ci>x</ci></apply></apply>"
        )
    };
    // A condition is written out in each call.
    let first = function(
        0,
        "<apply><and/><apply><lt/><ci>x</ci><cn>1</cn></apply><apply><gt/><ci>x</ci><cn>0</cn></apply></apply>",
    );
    let later: String = (0..60).map(|index| function(index + 1, &twice(index))).collect();
    let text = rate("<apply><ci>f60</ci><ci>x</ci></apply>");
    let text = text.replacen(
        "<model>",
        &format!("<model><listOfFunctionDefinitions>{first}{later}</listOfFunctionDefinitions>"),
        1,
    );
    assert!(codes(&text).contains(&"E1102"), "{:?}", codes(&text));
    // Functions that call themselves.
    let own = rate("<apply><ci>f1</ci><ci>x</ci></apply>");
    let circle = function(1, &twice(2)) + &function(2, &twice(1));
    let text =
        own.replacen("<model>", &format!("<model><listOfFunctionDefinitions>{circle}</listOfFunctionDefinitions>"), 1);
    assert!(codes(&text).contains(&"E1108"), "{:?}", codes(&text));
}

#[test]
fn names_are_safe_short_and_apart() {
    let long = "x".repeat(5_000);
    let ids = [
        "state",
        "state_",
        "state__2",
        "time",
        "pi",
        "if",
        "_",
        "__",
        "a-b",
        "a b",
        "a/b",
        "1st",
        "\u{e4}\u{f6}",
        "*/ // \u{202e}",
        &long,
        "x'; drop",
    ];
    let parameters: String =
        ids.iter().map(|id| format!("<parameter id=\"{id}\" value=\"1\" constant=\"false\"/>")).collect();
    let rules: String =
        ids.iter().map(|id| format!("<rateRule variable=\"{id}\"><math><cn>1</cn></math></rateRule>")).collect();
    let text = sbml(&format!("<listOfParameters>{parameters}</listOfParameters><listOfRules>{rules}</listOfRules>"));
    let imported = import(&text).1.unwrap_or_else(|findings| panic!("{findings:?}"));
    let columns = imported.columns();
    let mut names: Vec<&str> = columns.iter().map(|(_, name)| *name).collect();
    for name in &names {
        assert!(name.len() <= 120 && is_name(name), "{name}");
        assert!(name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_'), "{name}");
        assert!(!name.starts_with(|first: char| first.is_ascii_digit()) && !["time", "pi"].contains(name), "{name}");
    }
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), ids.len(), "{names:?}");
    // Names that were safe stay.
    assert!(columns.contains(&("state_", "state_")) && columns.contains(&("state__2", "state__2")));
    let spec = imported.spec(&setting());
    assert!(spec.lines().all(|line| line.len() < 400), "{spec}");
    assert!(spec.contains("// id a-b"), "{spec}");
}

/// What is found in a DiffSL model of one state with these tensors before `F`, which has this value.
fn tensors(before: &str, value: &str) -> Vec<&'static str> {
    let text = format!("u {{ x = 1 }} {before} F {{ {value} }}");
    let result = pe_import::import("hostile.ds", text.as_bytes(), &Wanted::Usual, &is_name).1;
    result.err().unwrap_or_default().iter().map(|finding| finding.code).collect()
}

#[test]
fn tensors_that_are_deep_or_large_are_refused_before_they_cost_anything() {
    let deep = |open: &str, depth: usize| open.repeat(depth) + "x" + &")".repeat(depth);
    assert_eq!(tensors("", &deep("(", 140)), [""; 0]);
    assert_eq!(tensors("", &deep("sin(", 100)), [""; 0]);
    for open in ["(", "-(", "sin(", "x + (", "x[(", "exp(-x*("] {
        let found = tensors("", &open.repeat(300_000));
        assert!(found == ["E1102"] || found == ["E1101"], "{open} {found:?}");
    }
    assert_eq!(tensors("", &deep("sin(", 300)), ["E1102"]);
    assert_eq!(tensors("", &("x".to_owned() + &" + x".repeat(100_000))), [""; 0]);
    assert_eq!(tensors("a_i { (0:1000000000): 1 }", "x"), ["E1102"]);
    assert_eq!(tensors("a_i { (0:99999999999999999999999): 1 }", "x"), ["E1102"]);
    assert_eq!(tensors("a_ij { (4000000000, 4000000000): x }", "x"), ["E1102"]);
    assert_eq!(tensors("a_i { (18446744073709551615): x }", "x"), ["E1102"]);
    assert_eq!(tensors("a_ij { (0..1000000, 0..1000000): 1 }", "x"), ["E1102"]);
    let letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";
    let ranges = vec!["0:2"; letters.len()].join(", ");
    assert_eq!(tensors(&format!("a_{letters} {{ ({ranges}): 1 }}"), "x"), ["E1102"]);
    // Values that double, and interpolations that are written out in interpolations.
    let points: String = (0..100).map(|point| format!("{point}, ")).collect();
    let within = "interp1d(p_i, p_i, ".repeat(6) + "x" + &")".repeat(6);
    assert_eq!(tensors(&format!("p_i {{ {points} }}"), &within), ["E1102"]);
    let last = (1..40).map(|level| format!("a{level} {{ a{} * a{} }} ", level - 1, level - 1)).collect::<String>();
    assert_eq!(tensors(&format!("a0 {{ x }} {last}"), "a39"), [""; 0]);
    let states: String = (0..40).map(|state| format!("s{state} = 0, ")).collect();
    let rates: String = (0..40).map(|state| format!("d{state} = 0, ")).collect();
    let mass: String = (0..40).map(|state| if state == 0 { "d0, ".to_owned() } else { "0, ".to_owned() }).collect();
    let right: String = (0..39).map(|state| format!("s{} - sin(s{state}) * s{state}, ", state + 1)).collect();
    let text = format!("u_i {{ {states} }} dudt_i {{ {rates} }} M_i {{ {mass} }} F_i {{ -s0, {right} }}");
    let found = pe_import::import("hostile.ds", text.as_bytes(), &Wanted::Usual, &is_name).1;
    let found = found.err().unwrap_or_default();
    assert!(!found.is_empty() && found.iter().all(|finding| ["E1102", "E1103"].contains(&finding.code)), "{found:?}");
}

#[test]
fn outputs_that_the_model_lacks_are_found_together() {
    let wanted = Wanted::Named(["x", "y", "z"].map(str::to_owned).into());
    let (_, result) = pe_import::import("m.xml", rate("<cn>1</cn>").as_bytes(), &wanted, &is_name);
    let findings = result.err().unwrap();
    assert_eq!(findings.iter().map(|finding| finding.code).collect::<Vec<_>>(), ["E1104", "E1104"]);
}
