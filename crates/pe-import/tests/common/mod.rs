//! What several tests need.

#![allow(dead_code, reason = "each test uses a part")]

use pe_import::Setting;
use pe_ir::source::{Diagnostic, Sources};

/// Some words that are no names in specs.
pub fn is_name(word: &str) -> bool {
    !["state", "param", "if", "in", "model", "next", "step", "input"].contains(&word)
}

/// How the specs of tests are run.
pub fn setting() -> Setting {
    Setting { solver: "rk4".to_owned(), step: 0.001, span: 5.0, reason: String::new() }
}

/// A finding in a line, with a second one for its help.
pub fn line(finding: &Diagnostic, sources: &Sources) -> String {
    let place = finding.span.map_or_else(String::new, |span| format!("{}: ", sources.position(span.start).line));
    let help = finding.help.as_ref().map_or_else(String::new, |help| format!("    help: {help}\n"));
    format!("{} {place}{}\n{help}", finding.code, finding.message)
}

/// Numbers that look random, the same in every run.
pub struct Random(pub u64);

impl Random {
    /// A number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end.max(1)
    }
}
