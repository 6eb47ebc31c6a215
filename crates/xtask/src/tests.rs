//! Tests of the list of tasks.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use super::{TASKS, find, folder, list, script, tasks};

/// Scripts in the folder of the crate, with their text.
fn scripts() -> Vec<(String, String)> {
    let mut found = Vec::new();
    for part in ["", "packages/", "pages/", "synthesis/"] {
        for entry in fs::read_dir(folder().join(part)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "sh" || ending == "py" || ending == "awk") {
                let name = path.file_name().unwrap().to_str().unwrap();
                found.push((format!("{part}{name}"), fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found
}

#[test]
fn every_script_is_a_task_or_part_of_one() {
    let there: BTreeSet<String> = scripts().into_iter().map(|(name, _)| name).collect();
    let known: BTreeSet<String> =
        TASKS.iter().map(|task| task.script).chain(tasks::PARTS.iter().copied()).map(str::to_owned).collect();
    assert_eq!(there, known);
    for part in tasks::PARTS {
        let name = Path::new(part).file_stem().unwrap().to_str().unwrap();
        let callers = scripts().into_iter().filter(|(other, text)| other != part && text.contains(name));
        assert!(callers.count() > 0, "nobody calls {part}");
    }
}

#[test]
fn tasks_have_names_of_their_own_and_can_be_run() {
    let names: BTreeSet<&str> = TASKS.iter().map(tasks::Task::name).collect();
    assert_eq!(names.len(), TASKS.len());
    let text = list();
    for task in TASKS {
        assert_eq!(find(task.name()).map(|found| found.script), Some(task.script));
        let mode = fs::metadata(script(task)).unwrap().permissions().mode();
        assert_eq!(mode & 0o111, 0o111, "{} cannot be run", task.script);
        assert!(text.lines().any(|line| line.trim_start().starts_with(task.name()) && line.contains(task.makes)));
    }
    assert!(find("common").is_none());
}

#[test]
fn documents_name_the_task_that_makes_what_they_show() {
    let docs = folder().join("../../docs");
    for task in TASKS {
        let text = fs::read_to_string(script(task)).unwrap();
        let usage = format!("cargo run -p xtask -- {}", task.name());
        assert!(text.contains(&usage), "{} does not say how it is called", task.script);
        for page in task.shown {
            // Lines may end within a command.
            let page_text = fs::read_to_string(docs.join(page)).unwrap();
            let page_text = page_text.split_whitespace().collect::<Vec<_>>().join(" ");
            let named = [usage.clone(), format!("xtask {}", task.name())].iter().any(|name| page_text.contains(name));
            assert!(named, "docs/{page} does not name {}", task.name());
        }
    }
}
