//! Points in a store: computed once, by whoever comes first, and a page with the same bytes however they came there.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::bench::Folder;
use crate::support::models::spec;

fn pe_synth(command: &str, spec: &Path, target: &Path, options: &[&str]) -> Command {
    let mut process = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    process.arg(command).arg(spec).arg("-o").arg(target).args(options);
    process
}

fn succeeded(command: &mut Command) -> String {
    let output: Output = command.output().expect("pe-synth starts");
    let told = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).concat();
    assert!(output.status.success(), "{told}");
    told
}

fn assert_same(a: &Path, b: &Path) {
    let names = |folder: &Path| {
        let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names(a), names(b));
    for name in names(a) {
        assert!(fs::read(a.join(&name)).unwrap() == fs::read(b.join(&name)).unwrap(), "{name:?} differs");
    }
}

/// Files of a store.
fn records(store: &Path) -> Vec<PathBuf> {
    let inside = |path: PathBuf| fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path());
    let mut records: Vec<PathBuf> = inside(store.to_owned()).flat_map(inside).collect();
    records.sort();
    records
}

/// Points of which some are too wrong, and some are refused.
const LISTS: [&str; 10] =
    ["--pes", "1,2,9", "--solver", "euler,heun,rk4", "--multiplier", "18x18,32x32", "--span", "5s", "--tries", "200"];

#[test]
fn a_changed_list_computes_what_is_new_and_nothing_of_another_model_is_taken() {
    let folder = Folder::new("store_lists");
    let model = folder.0.join("m.spec");
    let text = fs::read_to_string(spec("van_der_pol")).unwrap();
    fs::write(&model, &text).unwrap();
    let [store, first, plain, shared, other] =
        ["s", "first", "plain", "shared", "other"].map(|name| folder.0.join(name));
    let store_options = ["--store", store.to_str().unwrap()];
    succeeded(pe_synth("explore", &model, &first, &LISTS).args(["--step", "20ms"]).args(store_options));
    let count = records(&store).len();
    assert_eq!(count, 18);
    succeeded(pe_synth("explore", &model, &plain, &LISTS).args(["--step", "50ms,20ms"]));
    let told =
        succeeded(pe_synth("explore", &model, &shared, &LISTS).args(["--step", "50ms,20ms"]).args(store_options));
    assert!(told.contains("18 done before"), "{told}");
    assert_same(&plain, &shared);
    // All points are known now.
    let told = succeeded(pe_synth("explore", &model, &first, &LISTS).args(["--step", "50ms,20ms"]).args(store_options));
    assert!(told.contains("36 done before"), "{told}");
    assert_same(&plain, &first);
    fs::write(&model, text.replacen("mu", "unused_one = 1\nparam mu", 1)).unwrap();
    let told = succeeded(pe_synth("explore", &model, &other, &LISTS).args(["--step", "20ms"]).args(store_options));
    assert!(!told.contains("done before"), "{told}");
}

#[test]
fn damaged_records_are_told_and_computed_again() {
    let folder = Folder::new("store_broken");
    let [store, plain, shared] = ["s", "plain", "shared"].map(|name| folder.0.join(name));
    let model = spec("van_der_pol");
    let options = [&LISTS[..], &["--step", "20ms"]].concat();
    let with_store = [&options[..], &["--store", store.to_str().unwrap()]].concat();
    succeeded(&mut pe_synth("explore", &model, &plain, &with_store));
    let files = records(&store);
    let whole = fs::read(&files[0]).unwrap();
    fs::write(&files[0], &whole[..whole.len() / 2]).unwrap();
    fs::write(&files[1], "").unwrap();
    let text = fs::read_to_string(&files[2]).unwrap();
    fs::write(&files[2], text.replacen("exit_code\":", "exit_code\":1", 1).replacen("\"lut\":", "\"lut\":1", 1))
        .unwrap();
    // That of another point.
    fs::copy(&files[4], &files[3]).unwrap();
    let told = succeeded(&mut pe_synth("explore", &model, &shared, &with_store));
    assert!(told.contains("4 points were damaged"), "{told}");
    assert_same(&plain, &shared);
    let told = succeeded(&mut pe_synth("explore", &model, &shared, &with_store));
    assert!(told.contains("18 done before") && !told.contains("damaged"), "{told}");
}

#[test]
fn parts_that_run_side_by_side_make_the_page_of_the_whole() {
    let folder = Folder::new("store_parts");
    let model = spec("van_der_pol");
    let goal = ["--max-error", "1e-4", "--span", "5s", "--solver", "heun,rk4,ab4"];
    for (command, options) in [("explore", &LISTS[..]), ("accuracy", &goal)] {
        let [store, plain, merged] = ["s", "plain", "merged"].map(|name| folder.0.join(format!("{command}_{name}")));
        succeeded(&mut pe_synth(command, &model, &plain, options));
        let with_store = [options, &["--store", store.to_str().unwrap()]].concat();
        // A search goes on from round to round when all parts have theirs.
        let mut rounds = 0;
        loop {
            let start = |part: &str| pe_synth(command, &model, &merged, &with_store).args(["--shard", part]).spawn();
            let children: Vec<_> = ["1/3", "2/3", "3/3"].into_iter().map(start).collect();
            for child in children {
                assert!(child.expect("pe-synth starts").wait().expect("it ends").success());
            }
            assert!(!merged.exists(), "a part wrote a page");
            rounds += 1;
            let told = succeeded(pe_synth(command, &model, &merged, &with_store).args(["--shard", "1/3"]));
            if !told.contains("other parts lack points") {
                break;
            }
            assert!(rounds < 40, "{told}");
        }
        succeeded(&mut pe_synth(command, &model, &merged, &with_store));
        assert_same(&plain, &merged);
    }
    let refused = |options: &[&str]| {
        let output = pe_synth("explore", &model, &folder.0.join("no"), options).output().expect("pe-synth starts");
        assert_eq!(output.status.code(), Some(2), "{options:?}");
    };
    refused(&["--shard", "1/3"]);
    ["0/3", "4/3", "3", "a/b"].into_iter().for_each(|part| refused(&["--store", "s", "--shard", part]));
}
