//! Designs with something broken in them.

use std::fs;
use std::path::{Path, PathBuf};

use super::is_long_suite;

/// A damage of a design: file, with `NAME` for that of the design; what is there, once; what takes its place.
pub type Damage = (&'static str, &'static str, &'static str);

/// Copies a folder and those in it, in place of what was there.
pub fn copied(from: &Path, to: &Path) -> PathBuf {
    let _ = fs::remove_dir_all(to);
    fs::create_dir_all(to).expect("the test folder takes folders");
    for entry in fs::read_dir(from).expect("the design is there").map(|entry| entry.expect("entries can be read")) {
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            copied(&entry.path(), &to);
        } else {
            fs::copy(entry.path(), to).expect("copies");
        }
    }
    to.to_owned()
}

/// A copy of a design in `to` with another text of a file.
pub fn edited(design: &Path, to: &Path, file: &str, edit: impl Fn(&str) -> String) -> PathBuf {
    copied(design, to);
    let path = to.join(file);
    let before = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{file}: {error}"));
    let after = edit(&before);
    assert_ne!(before, after, "{file} was not damaged");
    fs::write(path, after).expect("the test folder takes files");
    to.to_owned()
}

/// Damages that nothing finds: each is made in copies, in `scratch`, of the designs that have its place, until one is
/// caught. `caught` has a folder of its own beside the copy.
pub fn missed(
    designs: &[&Path],
    scratch: &Path,
    damages: &[Damage],
    caught: impl Fn(&Path, &Path) -> bool,
) -> Vec<&'static str> {
    let is_caught = |number: usize, (file, from, to): &Damage| {
        let mut places = 0;
        let found = designs.iter().enumerate().any(|(index, design)| {
            let file = file.replace("NAME", &entity(design));
            let text = fs::read_to_string(design.join(&file)).unwrap_or_default();
            let here = text.matches(from).count();
            assert!(here < 2, "{file}: `{from}` is there {here} times");
            if here == 0 {
                return false;
            }
            places += 1;
            // The others are there for the long suite.
            if number % 2 == 1 && !is_long_suite() {
                return true;
            }
            let home = scratch.join(format!("{number}_{index}"));
            let broken = edited(design, &home.join("design"), &file, |text| text.replace(from, to));
            fs::create_dir_all(home.join("scratch")).expect("the test folder takes folders");
            let caught = caught(&broken, &home.join("scratch"));
            let _ = fs::remove_dir_all(&home);
            caught
        });
        assert!(places > 0, "{file}: `{from}` is nowhere");
        found
    };
    damages
        .iter()
        .enumerate()
        .filter(|(number, damage)| !is_caught(*number, damage))
        .map(|(_, damage)| damage.1)
        .collect()
}

/// Name of the design in a folder.
fn entity(design: &Path) -> String {
    let names = fs::read_dir(design).expect("the design is there");
    let names = names.map(|entry| entry.expect("entries can be read").file_name().to_string_lossy().into_owned());
    names.filter_map(|name| Some(name.strip_suffix("_map.json")?.to_owned())).next().expect("it has a map")
}
