//! Imports the semantic cases of an SBML Test Suite and compares each with its results.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use pe_flow::failure::Failure;
use pe_import::{Settings, Wanted};
use pe_ir::source::{Diagnostic, Severity};
use pe_judge::DesignPoint;
use rayon::prelude::*;

use super::compare::{self, Results};
use super::propose::{self, Asked};
use crate::progress::Teller;

/// Versions of SBML in which a case may be written, the first that is there is taken.
const VERSIONS: [&str; 7] = ["l3v2", "l3v1", "l2v5", "l2v4", "l2v3", "l2v2", "l2v1"];

/// What became of a case.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// All columns agree; the largest difference over its tolerance.
    Passed(f64),
    /// The import refused it, with what cannot be expressed.
    Unexpressed(Vec<String>),
    /// The compiler refused the spec.
    Refused(String),
    /// A column differs, by so many tolerances.
    Wrong(String, f64),
    /// It is no time course.
    Other,
}

/// A case.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its number.
    pub name: String,
    /// What kind of model it is.
    pub kind: &'static str,
    /// What became of it.
    pub outcome: Outcome,
}

/// Runs all cases of a folder, or those whose names begin as one of `only`, and gives them in the order of their names. Tells
/// how many are done unless `quiet`.
///
/// # Errors
/// A folder that cannot be read or holds no case.
pub fn run(folder: &Path, only: &[String], quiet: bool) -> Result<Vec<Case>, Failure> {
    let entries = fs::read_dir(folder).map_err(|error| Failure::file("read", folder, error))?;
    let mut folders: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    folders.retain(|path| {
        let name = name_of(path);
        path.join(format!("{name}-settings.txt")).is_file()
            && (only.is_empty() || only.iter().any(|start| name.starts_with(start)))
    });
    folders.sort();
    if folders.is_empty() {
        return Err(Failure::file("read", folder, "it holds no folder NAME with NAME-settings.txt"));
    }
    let all = folders.len();
    let told = Mutex::new(Teller::new("import", quiet));
    let done = AtomicUsize::new(0);
    let run = |path: &PathBuf| {
        let ended = done.load(Ordering::Relaxed);
        if ended > 0 {
            let mut teller = told.lock().unwrap_or_else(PoisonError::into_inner);
            let left = teller.elapsed() * (all - ended) as f64 / ended as f64;
            let counted = format!("{ended} of {all} cases");
            teller.hear(&format!("{counted}, {} at work", name_of(path)), &counted, left);
        }
        let case = case(path);
        done.fetch_add(1, Ordering::Relaxed);
        case
    };
    let cases = folders.par_iter().map(run).collect();
    told.lock().unwrap_or_else(PoisonError::into_inner).finish();
    Ok(cases)
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

fn case(folder: &Path) -> Case {
    let name = name_of(folder);
    let about = fs::read_to_string(folder.join(format!("{name}-model.m"))).unwrap_or_default();
    let kind = kind(&about);
    let outcome = if kind == "no time course" {
        Outcome::Other
    } else {
        judged(folder, &name).unwrap_or_else(|failure| refusal(&failure))
    };
    Case { name, kind, outcome }
}

/// The kind of a model, by the tags of its case.
fn kind(about: &str) -> &'static str {
    let line = |key: &str| about.lines().find_map(|line| line.trim().strip_prefix(key)).unwrap_or("");
    let (tags, tests) = (line("componentTags:"), line("testType:"));
    let kinds = [
        ("comp:", "composed (comp)"),
        ("Event", "with events"),
        ("AlgebraicRule", "with algebraic rules"),
        ("CSymbolDelay", "with delays"),
        ("FastReaction", "with fast reactions"),
    ];
    if !tests.trim().is_empty() && tests.trim() != "TimeCourse" {
        return "no time course";
    }
    kinds.into_iter().find(|(tag, _)| tags.contains(tag)).map_or("equations", |(_, kind)| kind)
}

fn judged(folder: &Path, name: &str) -> Result<Outcome, Failure> {
    let path = VERSIONS
        .iter()
        .map(|version| folder.join(format!("{name}-sbml-{version}.xml")))
        .find(|path| path.is_file())
        .ok_or_else(|| Failure::file("read", folder, "it holds no model of SBML level 2 or 3"))?;
    let settings_path = folder.join(format!("{name}-settings.txt"));
    let text = fs::read_to_string(&settings_path).map_err(|error| Failure::file("read", &settings_path, error))?;
    let settings = Settings::read(&text).map_err(|error| Failure::file("read", &settings_path, error))?;
    let results = Results::read(&folder.join(format!("{name}-results.csv")))?;
    let asked = Asked {
        span: Some(settings.start + settings.duration),
        interval: Some(settings.duration / f64::from(settings.steps)),
        ..Asked::default()
    };
    let tolerances = settings.tolerances;
    let (imported, _) = super::read(&path, &Wanted::Suite(settings))?;
    let setting = propose::setting(&imported, &asked, name)?;
    let loaded = super::load(&imported, &setting, name)?;
    let columns: Vec<(String, String)> =
        imported.columns().into_iter().map(|(column, output)| (column.to_owned(), output.to_owned())).collect();
    let found =
        compare::compare(&loaded, &DesignPoint::default(), &results, &columns, tolerances, imported.model.seconds())?;
    let worst = found.into_iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio)).expect("columns that are compared");
    Ok(if worst.ratio <= 1.0 { Outcome::Passed(worst.ratio) } else { Outcome::Wrong(worst.name, worst.ratio) })
}

/// What a failure says, without the names of a model.
fn refusal(failure: &Failure) -> Outcome {
    let Failure::Spec(findings, _) = failure else {
        return Outcome::Refused(match failure {
            Failure::Usage(text) | Failure::File(text) | Failure::Mismatch(text) | Failure::Internal(text) => {
                text.clone()
            }
            other => other.kind().to_owned(),
        });
    };
    let errors: Vec<&Diagnostic> = findings.iter().filter(|finding| finding.severity == Severity::Error).collect();
    let mut reasons: Vec<String> =
        errors.iter().map(|finding| format!("{}: {}", finding.code, anonymous(&finding.message))).collect();
    reasons.sort();
    reasons.dedup();
    if errors.iter().all(|finding| finding.code.starts_with("E11")) {
        Outcome::Unexpressed(reasons)
    } else {
        let more = reasons.len() - 1;
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        Outcome::Refused(format!("{}{more}", reasons[0]))
    }
}

/// A message with names and numbers left out.
fn anonymous(message: &str) -> String {
    let parts = message.split('`').enumerate();
    let parts: String = parts
        .map(|(at, part)| if at % 2 == 1 && !part.starts_with('<') { "..".to_owned() } else { part.to_owned() })
        .collect();
    parts.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The table of a page: how many cases of each kind passed, and why others did not.
pub fn page(cases: &[Case]) -> String {
    let mut kinds: BTreeMap<&str, [usize; 4]> = BTreeMap::new();
    let (mut reasons, mut refused, mut wrong) = (BTreeMap::<&str, Vec<&str>>::new(), Vec::new(), Vec::new());
    let mut worst: f64 = 0.0;
    for case in cases {
        let place = match &case.outcome {
            Outcome::Passed(ratio) => {
                worst = worst.max(*ratio);
                0
            }
            Outcome::Unexpressed(found) => {
                found.iter().for_each(|reason| reasons.entry(reason).or_default().push(&case.name));
                1
            }
            Outcome::Refused(reason) => {
                refused.push(format!("| {} | {reason} |\n", case.name));
                2
            }
            Outcome::Wrong(column, ratio) => {
                wrong.push(format!("| {} | `{column}` | {ratio:.3e} |\n", case.name));
                3
            }
            Outcome::Other => continue,
        };
        kinds.entry(case.kind).or_default()[place] += 1;
    }
    let mut text = String::from(
        "| models | cases | passed | not expressible | refused by the compiler | wrong |\n|---|---|---|---|---|---|\n",
    );
    let mut all = [0; 4];
    let row = |kind: &str, counts: &[usize; 4]| {
        let [passed, unexpressed, refused, wrong] = counts;
        format!("| {kind} | {} | {passed} | {unexpressed} | {refused} | {wrong} |\n", counts.iter().sum::<usize>())
    };
    for (kind, counts) in &kinds {
        text += &row(kind, counts);
        all.iter_mut().zip(counts).for_each(|(all, count)| *all += count);
    }
    text += &row("all", &all);
    text += &format!("\nThe largest difference of a case that passed is {worst:.2} of its tolerance.\n");
    if !reasons.is_empty() {
        text += "\n| what a spec cannot express | cases | first |\n|---|---|---|\n";
        let mut rows: Vec<(&str, Vec<&str>)> = reasons.into_iter().collect();
        rows.sort_by_key(|(_, cases)| std::cmp::Reverse(cases.len()));
        for (reason, cases) in rows {
            text += &format!("| {reason} | {} | {} |\n", cases.len(), cases[0]);
        }
    }
    if !refused.is_empty() {
        text += "\n| case | refused by the compiler |\n|---|---|\n";
        text += &refused.concat();
    }
    if !wrong.is_empty() {
        text += "\n| case | column that differs most | of its tolerance |\n|---|---|---|\n";
        text += &wrong.concat();
    }
    text
}
