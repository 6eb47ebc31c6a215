//! The findings of a campaign, as a table for people and as JSON for programs.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::class::Class;
use super::{Fate, Finding, Proof};

/// What became of the damages of a class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Count {
    injected: usize,
    caught: usize,
    datasheet: usize,
    equivalence: usize,
    never_read: usize,
    missed: usize,
}

impl Count {
    fn take(&mut self, fate: &Fate) {
        self.injected += 1;
        match fate {
            Fate::Caught { .. } => self.caught += 1,
            Fate::WithoutEffect { proof: Proof::Datasheet, .. } => self.datasheet += 1,
            Fate::WithoutEffect { proof: Proof::Equivalence, .. } => self.equivalence += 1,
            Fate::WithoutEffect { proof: Proof::NeverRead, .. } => self.never_read += 1,
            Fate::Missed(_) => self.missed += 1,
        }
    }

    fn fields(&self) -> [(&'static str, usize); 6] {
        [
            ("injected", self.injected),
            ("caught", self.caught),
            ("datasheet", self.datasheet),
            ("equivalence", self.equivalence),
            ("never_read", self.never_read),
            ("missed", self.missed),
        ]
    }

    fn as_json(&self) -> Value {
        Value::Object(self.fields().into_iter().map(|(name, count)| (name.to_owned(), json!(count))).collect())
    }
}

fn counts(findings: &[Finding]) -> (BTreeMap<Class, Count>, Count) {
    let (mut classes, mut all) = (BTreeMap::<Class, Count>::new(), Count::default());
    for finding in findings {
        classes.entry(finding.damage.class).or_default().take(&finding.fate);
        all.take(&finding.fate);
    }
    (classes, all)
}

/// Number of damages that are neither caught nor shown to be without effect.
pub fn missed(findings: &[Finding]) -> usize {
    counts(findings).1.missed
}

/// A row per class, a sum, each damage of a word that no run reads, and each that was missed.
pub fn table(findings: &[Finding]) -> String {
    let (classes, all) = counts(findings);
    let row = |name: &str, count: &Count| {
        let numbers: String =
            count.fields().iter().map(|(title, count)| format!("  {count:>0$}", title.len())).collect();
        format!("{name:<18}{numbers}\n")
    };
    let titles: String = all.fields().iter().map(|(title, _)| format!("  {}", title.replace('_', " "))).collect();
    let mut text = format!("{:<18}{titles}\n", "class of damage");
    for (class, count) in &classes {
        text += &row(class.name(), count);
    }
    text += &row("all", &all);
    for finding in findings {
        if let Fate::WithoutEffect { proof: Proof::NeverRead, .. } = &finding.fate {
            text += &format!("never read: {}\n", finding.damage.what);
        }
    }
    for finding in findings {
        if let Fate::Missed(reason) = &finding.fate {
            let damage = &finding.damage;
            text += &format!(
                "missed: {} in {}, line {}: {}\n    before: {}\n    after:  {}\n    {reason}\n",
                damage.class.name(),
                damage.file,
                damage.line,
                damage.what,
                damage.before,
                damage.after
            );
        }
    }
    text
}

/// Counts by class, and every damage with its fate.
pub fn as_json(findings: &[Finding], design: &str, seed: u64) -> Value {
    let (classes, all) = counts(findings);
    let classes: serde_json::Map<String, Value> =
        classes.iter().map(|(class, count)| (class.name().to_owned(), count.as_json())).collect();
    let damage = |finding: &Finding| {
        let damage = &finding.damage;
        let (fate, proof, caught, text) = match &finding.fate {
            Fate::Caught { passed, start, message } => ("caught", None, Some((passed, start)), message),
            Fate::WithoutEffect { proof, reason } => ("without-effect", Some(proof.name()), None, reason),
            Fate::Missed(reason) => ("missed", None, None, reason),
        };
        let (passed, start) = caught.unzip();
        json!({
            "class": damage.class.name(), "file": damage.file, "line": damage.line, "before": damage.before,
            "after": damage.after, "what": damage.what, "fate": fate, "proof": proof, "runs_passed": passed,
            "caught_from": start, "message": text,
        })
    };
    let damages: Vec<Value> = findings.iter().map(damage).collect();
    json!({"design": design, "seed": seed, "all": all.as_json(), "classes": classes, "damages": damages})
}
