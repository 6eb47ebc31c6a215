//! Rules about the source tree that no compiler checks.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Files that git tracks or would track, with their text; binary files and links to others are left out.
fn files() -> Vec<(String, String)> {
    let output = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard"])
        .current_dir(root())
        .output()
        .expect("git lists the files");
    let names = String::from_utf8(output.stdout).unwrap();
    let is_link = |name: &&str| root().join(name).is_symlink();
    let names = names.lines().filter(|name| !is_link(name));
    let files: Vec<(String, String)> =
        names.filter_map(|name| Some((name.to_owned(), fs::read_to_string(root().join(name)).ok()?))).collect();
    assert!(files.len() > 100, "only {} files found", files.len());
    files
}

fn with_ending<'a>(files: &'a [(String, String)], endings: &'a [&str]) -> impl Iterator<Item = &'a (String, String)> {
    files.iter().filter(|(name, _)| endings.iter().any(|ending| name.ends_with(ending)))
}

/// Our crates that a manifest names, those of tests included.
fn arrows(manifest: &str) -> BTreeSet<String> {
    let names = manifest.lines().filter_map(|line| line.split(['.', ' ']).next());
    names.filter(|name| name.starts_with("pe-")).map(str::to_owned).collect()
}

#[test]
fn crates_depend_on_each_other_as_the_architecture_says() {
    let page = fs::read_to_string(root().join("docs/architecture.md")).unwrap();
    let block = page.split("## Crates").nth(1).and_then(|text| text.split("```").nth(1)).expect("the arrows");
    let mut said: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for line in block.lines().skip(1).filter(|line| line.contains("pe-")) {
        let words: Vec<&str> = line.split(|c: char| !(c.is_ascii_lowercase() || c == '-' || c == '>')).collect();
        let crates = words.iter().filter(|word| word.starts_with("pe-")).map(|word| (*word).to_owned());
        let mut crates: Vec<String> = crates.collect();
        let name = crates.remove(0);
        // These know no representation of the compiler.
        let apart = ["pe-ir", "pe-map", "pe-fmu"].contains(&name.as_str());
        let beside = if apart { Vec::new() } else { vec!["pe-ir".to_owned()] };
        said.insert(name, crates.into_iter().chain(beside).collect());
    }
    let mut names = BTreeSet::new();
    for folder in fs::read_dir(root().join("crates")).unwrap() {
        let folder = folder.unwrap();
        let name = folder.file_name().into_string().unwrap();
        // Runs scripts, and knows nothing of the compiler.
        if name == "xtask" {
            continue;
        }
        let manifest = fs::read_to_string(folder.path().join("Cargo.toml")).unwrap();
        let (own, tests) = manifest.split_once("[dev-dependencies]").unwrap_or((&manifest, ""));
        let said = said.get(&name).unwrap_or_else(|| panic!("the architecture lacks {name}"));
        let own: BTreeSet<String> = arrows(own);
        assert!(name == "pe-synth" || own == *said, "{name} depends on {own:?}, the architecture says {said:?}");
        // What judges tells of a model; its tests may read one. The stages of the star meet nobody.
        let more: Vec<String> = arrows(tests).into_iter().filter(|other| !said.contains(other)).collect();
        assert!(
            more.is_empty() || (name == "pe-judge" && more == ["pe-frontend"]),
            "tests of {name} depend on {more:?}"
        );
        for (package, owner) in [
            ("pest", "pe-frontend"),
            ("askama", "pe-emit"),
            ("plotters", "pe-plot"),
            ("clap", "pe-synth"),
            ("indicatif", "pe-synth"),
        ] {
            let uses = manifest.lines().any(|line| line.split(['.', ' ']).next() == Some(package));
            // All three write files from templates.
            let owns = name == owner || (package == "askama" && ["pe-wrap", "pe-fmu"].contains(&name.as_str()));
            assert_eq!(uses, owns, "{package} in {name}");
        }
        names.insert(name);
    }
    assert_eq!(names, said.keys().cloned().collect(), "crates and architecture");
}

/// A path without `.` and `..`; none if it leaves the folder that it begins in.
fn plain(path: &Path) -> Option<PathBuf> {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            std::path::Component::ParentDir => plain.pop().then_some(())?,
            std::path::Component::CurDir => {}
            part => plain.push(part),
        }
    }
    Some(plain)
}

/// Files that a source reads as it is compiled: as written, and whether from the source's own folder.
fn read_at_compile_time(text: &str) -> Vec<(&str, bool)> {
    // Put together here so that this file does not find itself.
    let calls = [("include_", "str!(\""), ("include_", "bytes!(\""), ("inclu", "de!(\""), ("gram", "mar = \"")];
    let mut found = Vec::new();
    for (begin, rest) in calls {
        for (at, call) in text.match_indices(&format!("{begin}{rest}")) {
            let path = text[at + call.len()..].split('"').next().unwrap_or("");
            found.push((path, begin != "gram"));
        }
    }
    found
}

#[test]
fn crates_read_no_file_outside_of_them_as_they_are_compiled() {
    let files = files();
    let mut seen = 0;
    for (name, text) in
        with_ending(&files, &[".rs"]).filter(|(name, _)| name.starts_with("crates/pe-") && name.contains("/src/"))
    {
        let home: PathBuf = Path::new(name).iter().take(2).collect();
        for (path, from_source) in read_at_compile_time(text) {
            let folder = if from_source { Path::new(name).parent().expect("a folder") } else { &home };
            let inside = plain(folder.strip_prefix(&home).expect("in its crate").join(path).as_path());
            let found = inside.as_ref().is_some_and(|inside| root().join(&home).join(inside).is_file());
            assert!(found, "{name} reads {path}: link its folder into the crate");
            seen += 1;
        }
    }
    for (name, text) in with_ending(&files, &["askama.toml"]) {
        let folders = text.lines().find_map(|line| line.strip_prefix("dirs = ")).expect("folders of templates");
        assert!(!folders.contains(".."), "{name}: templates outside of the crate");
        seen += 1;
    }
    assert!(seen > 30, "only {seen} files that are read");
    assert_eq!(plain(Path::new("src/../../hdl/pe.vhd")), None);
    assert_eq!(read_at_compile_time(concat!("inclu", "de_str!(\"../x\")")), [("../x", true)]);
}

#[test]
fn manifests_changelog_and_program_have_one_version() {
    let version = env!("CARGO_PKG_VERSION");
    let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let own: Vec<&str> = manifest.lines().filter(|line| line.contains("path = \"crates/")).collect();
    assert!(own.len() > 10 && manifest.contains(&format!("\nversion = \"{version}\"\n")), "{own:?}");
    for line in own {
        assert!(line.contains(&format!("version = \"{version}\"")), "{line}");
    }
    let changes = fs::read_to_string(root().join("docs/CHANGELOG.md")).unwrap();
    let newest = changes.lines().find_map(|line| line.strip_prefix("## ")).expect("a version");
    let (number, state) = newest.split_once(' ').unwrap_or((newest, ""));
    let dated = state.trim_matches(['(', ')']).split('-').filter(|part| part.parse::<u16>().is_ok()).count() == 3;
    assert!(number == version && (state == "(unreleased)" || dated), "{newest}");
    let told = Command::new(env!("CARGO_BIN_EXE_pe-synth")).arg("--version").output().expect("pe-synth starts");
    assert_eq!(String::from_utf8_lossy(&told.stdout).trim_end(), format!("pe-synth {version}"));
    for name in files().iter().map(|(name, _)| name).filter(|name| name.ends_with("Cargo.toml")) {
        let text = fs::read_to_string(root().join(name)).unwrap();
        let shared = text.contains("version.workspace = true") && text.contains("license.workspace = true");
        assert!(name == "Cargo.toml" || shared, "{name} has a version or a licence of its own");
    }
}

#[test]
fn source_files_are_short_and_start_with_a_description() {
    let files = files();
    for (name, text) in with_ending(&files, &[".rs", ".vhd", ".pest", ".sh"]) {
        assert!(text.lines().count() <= 600, "{name} has {} lines", text.lines().count());
    }
    for (name, text) in with_ending(&files, &[".rs"]).filter(|(name, _)| name.starts_with("crates/")) {
        assert!(text.starts_with("//!"), "{name} does not say what it is for");
    }
}

#[test]
fn the_tutorial_shows_the_model_that_is_shipped() {
    let tutorial = fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let spec = fs::read_to_string(root().join("models/lung/lung.spec")).unwrap();
    assert!(tutorial.contains(&spec), "docs/tutorial.md does not hold models/lung/lung.spec");
}

#[test]
fn nothing_is_left_undone_or_tied_to_a_machine() {
    // Put together here so that this file does not find itself.
    let words = [["todo", "!("], ["unimplemented", "!("], ["#[ign", "ore"], ["FIX", "ME"]].map(|word| word.concat());
    let places = [["/wo", "rk/"], ["/ro", "ot/"], ["/ho", "me/"]].map(|place| place.concat());
    for (name, text) in files() {
        if name.ends_with(".rs") || name.ends_with(".vhd") {
            for word in &words {
                assert!(!text.contains(word.as_str()), "{name} contains {word}");
            }
        }
        for place in &places {
            assert!(name == "Cargo.lock" || !text.contains(place.as_str()), "{name} contains {place}");
        }
        assert!(text.len() <= 1 << 20, "{name} has {} bytes", text.len());
    }
}

#[test]
fn every_code_in_the_sources_is_explained() {
    let files = files();
    let mut codes = BTreeSet::new();
    for (_, text) in with_ending(&files, &[".rs"]).filter(|(name, _)| name.contains("/src/")) {
        for (at, _) in text.match_indices('"') {
            let code = text.get(at + 1..at + 7).unwrap_or("");
            let digits = code.get(1..5).unwrap_or("");
            if (code.starts_with('E') || code.starts_with('W'))
                && code.ends_with('"')
                && digits.bytes().all(|b| b.is_ascii_digit())
            {
                codes.insert(code[..5].to_owned());
            }
        }
    }
    // A test of `explain` asks for a code that must not exist.
    codes.remove("E9999");
    assert!(codes.len() > 30, "{codes:?}");
    for code in codes {
        assert!(pe_ir::codes::explain(&code).is_some(), "{code} is not explained");
    }
}

#[test]
fn decision_records_have_the_same_headings() {
    let files = files();
    let records: Vec<_> =
        with_ending(&files, &[".md"]).filter(|(name, _)| name.starts_with("docs/decisions/")).collect();
    assert!(records.len() > 5);
    for (name, text) in records {
        for heading in ["Context", "Decision", "Alternatives", "Drawbacks", "Consequences"] {
            assert!(text.contains(&format!("## {heading}\n")), "{name} lacks {heading}");
        }
        let status = text.lines().nth(2).unwrap_or("");
        let known = ["Status: accepted", "Status: proposed", "Status: superseded by ["];
        assert!(known.iter().any(|known| status.starts_with(known)), "{name} has no status in its third line");
    }
}

#[test]
fn links_in_the_documents_lead_somewhere() {
    let files = files();
    for (name, text) in with_ending(&files, &[".md"]) {
        for (at, _) in text.match_indices("](") {
            let link = text[at + 2..].split(')').next().unwrap_or("");
            let path = link.split('#').next().unwrap_or("");
            if path.is_empty() || link.contains("://") || link.contains(char::is_whitespace) {
                continue;
            }
            let target = root().join(name).parent().unwrap().join(path);
            assert!(target.exists(), "{name}: broken link {link}");
        }
    }
}

/// Cells of a network of the page on silicon, estimated and measured: tables, multipliers, blocks.
struct Row {
    design: String,
    lut: [f64; 2],
    dsp: [f64; 2],
    bram: [f64; 2],
}

/// The rows of a table of networks, with the family of each.
fn networks(table: &str) -> Vec<(String, Row)> {
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let rows = table.lines().filter(|line| line.starts_with('|')).map(cells).filter(|cells| cells.len() == 14);
    let row = |cells: Vec<String>| {
        let number = |at: usize| cells[at].parse::<f64>().ok();
        let pair = |at: usize, to: usize| Some([number(at)?, number(to)?]);
        let row = Row { design: cells[1].clone(), lut: pair(3, 4)?, dsp: pair(9, 10)?, bram: pair(11, 12)? };
        let told: f64 = cells[5].trim_end_matches(" %").parse().ok()?;
        let is = 100.0 * (row.lut[0] / row.lut[1] - 1.0);
        assert!((told - is).abs() < 0.2, "{cells:?}: {is:.1} %");
        Some((cells[2].clone(), row))
    };
    rows.filter_map(row).collect()
}

#[test]
fn estimates_of_whole_networks_are_near_their_synthesis() {
    let page = fs::read_to_string(root().join("docs/silicon.md")).unwrap();
    let script = fs::read_to_string(root().join("crates/xtask/pages/networks.sh")).unwrap();
    let tables = page.split("<!-- networks -->").nth(1).and_then(|rest| rest.split("<!-- end of networks -->").next());
    let (judged, others) = tables.and_then(|text| text.split_once("Designs by which")).expect("two tables");
    for (table, list, most) in [(judged, "designs='", 0.2), (others, "others='", 0.25)] {
        let listed = script.split(list).nth(1).and_then(|rest| rest.split('\'').next()).expect("a list");
        let rows = networks(table);
        for design in listed.lines().filter_map(|line| line.split(' ').next()).filter(|name| !name.is_empty()) {
            for family in ["xc6v", "ecp5", "gowin"] {
                let row = rows.iter().find(|(of, row)| of == family && row.design == design);
                let (_, row) = row.unwrap_or_else(|| panic!("no row of {design} on {family}"));
                let off = row.lut[0] / row.lut[1] - 1.0;
                assert!(off.abs() <= most, "{design} on {family}: {:.1} % of the tables", 100.0 * off);
                assert_eq!(row.dsp[0], row.dsp[1], "{design} on {family}: multipliers");
                assert!((row.bram[0] - row.bram[1]).abs() <= 1.0, "{design} on {family}: block RAM");
            }
        }
    }
}

#[test]
fn networks_on_the_page_are_as_estimated_today() {
    let page = fs::read_to_string(root().join("docs/silicon.md")).unwrap();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("tidy_networks");
    let spec = root().join("models/lorenz/lorenz.spec");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("compile").arg(spec).args(["--multiplier", "25x35", "-q", "--no-pictures", "-o"]).arg(&folder);
    assert!(command.status().expect("pe-synth starts").success());
    let report = fs::read_to_string(folder.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    for family in report["area"]["families"].as_array().expect("families") {
        let name = family["family"].as_str().expect("a name");
        let rows = networks(&page);
        let (_, row) = rows.iter().find(|(of, row)| of == name && row.design == "lorenz").expect("a row");
        let lut = family["lut"].as_f64().expect("a number");
        assert!((row.lut[0] - lut).abs() <= 1.0, "{name}: {lut}, the page says {}: run `xtask networks`", row.lut[0]);
    }
}
