//! Models of `tests/files`: the spec that each becomes, or what is found in it, stands beside it as `.expect`.
//! `UPDATE_EXPECT=1` writes them.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{is_name, setting};
use pe_import::Wanted;

fn models() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/files");
    let mut models: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    models.retain(|path| path.extension().is_some_and(|end| end != "expect" && end != "md"));
    models.sort();
    models
}

#[test]
fn a_model_becomes_the_spec_a_person_would_write_or_findings_with_their_places() {
    let models = models();
    assert!(models.len() >= 5, "{models:?}");
    for path in models {
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let (sources, result) = pe_import::import(&name, &fs::read(&path).unwrap(), &Wanted::Usual, &is_name);
        let told = match result {
            Ok(imported) => {
                let warnings = imported.warnings.iter().map(|warning| common::line(warning, &sources));
                warnings.collect::<String>() + &imported.spec(&setting())
            }
            Err(findings) => findings.iter().map(|finding| common::line(finding, &sources)).collect(),
        };
        expect_test::expect_file![path.with_extension("expect")].assert_eq(&told);
    }
}

#[test]
fn damaged_files_give_findings_inside_of_the_file_and_never_a_panic() {
    let mut random = common::Random(7);
    for path in models() {
        let bytes = fs::read(&path).unwrap();
        for _ in 0..300 {
            let mut damaged = bytes.clone();
            for _ in 0..=random.below(3) {
                if damaged.is_empty() {
                    break;
                }
                let at = random.below(damaged.len());
                let end = (at + random.below(40)).min(damaged.len());
                match random.below(4) {
                    0 => damaged[at] = b"<>/\"'&;=()[]0\n"[random.below(14)],
                    1 => drop(damaged.drain(at..end)),
                    2 => {
                        let piece = damaged[at..end].to_vec();
                        let to = random.below(damaged.len());
                        damaged.splice(to..to, piece);
                    }
                    _ => damaged.truncate(at.max(1)),
                }
            }
            let name = path.file_name().unwrap().to_str().unwrap();
            let (sources, result) = pe_import::import(name, &damaged, &Wanted::Usual, &is_name);
            match result {
                Ok(imported) => drop(imported.spec(&setting())),
                Err(findings) => {
                    assert!(!findings.is_empty());
                    for span in findings.iter().filter_map(|finding| finding.span) {
                        assert!(span.range().end <= sources.text().len() && span.start <= span.end, "{span}");
                    }
                }
            }
        }
    }
}
