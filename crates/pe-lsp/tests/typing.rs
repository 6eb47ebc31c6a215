//! Whatever is typed, the server lives, and its findings are those of the front end on the same text.

mod common;

use common::{Editor, models, specs, uri};
use pe_frontend::{LoadError, Loader, Overrides, compile, main_file};
use pe_ir::source::Diagnostic;
use pe_lsp::Ended;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

struct Folder(PathBuf);

impl Loader for Folder {
    fn load(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        fs::read(self.0.join(path)).map_err(|_| LoadError::Missing)
    }
}

/// Codes and places of the findings of the front end in the main file, as the protocol counts them.
fn expected(path: &Path, text: &str) -> Vec<String> {
    let (mut sources, problem) = main_file("m.spec", text.as_bytes());
    let folder = Folder(path.parent().unwrap().to_owned());
    let mut found: Vec<Diagnostic> = match compile(&mut sources, &folder, &Overrides::default()) {
        Ok((model, mut warnings)) => {
            warnings.extend(pe_flow::spec::written_out(model, sources.clone()).1);
            warnings
        }
        Err(findings) => findings,
    };
    found.extend(problem);
    let text = sources.text();
    let point = |offset: usize| {
        let before = &text[..offset];
        let line = before.matches('\n').count();
        let start = before.rfind('\n').map_or(0, |at| at + 1);
        format!("{line}:{}", before[start..].encode_utf16().count())
    };
    let main = sources.main().span();
    let within = found.iter().filter(|finding| finding.span.is_none_or(|span| span.start <= main.end));
    within
        .map(|finding| {
            let range = finding.span.map_or("0:0-0:0".to_owned(), |span| {
                format!("{}-{}", point(span.range().start), point(span.range().end.min(main.range().end)))
            });
            format!("{} {range}", finding.code)
        })
        .collect()
}

/// An offset as line and character.
fn position(text: &str, offset: usize) -> [u32; 2] {
    let before = &text[..offset];
    let start = before.rfind('\n').map_or(0, |at| at + 1);
    [before.matches('\n').count() as u32, before[start..].encode_utf16().count() as u32]
}

fn boundary(text: &str, offset: usize) -> usize {
    (0..=offset).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0)
}

/// Models that are elaborated in a moment.
fn quick() -> Vec<PathBuf> {
    let all = specs(&models()).into_iter().filter(|path| !path.to_string_lossy().contains("validation"));
    all.filter(|path| {
        ["lutchen4000", "wave80", "atrial15", "gray_scott", "heat_plate", "dense42"]
            .iter()
            .all(|large| !path.to_string_lossy().contains(large))
    })
    .collect()
}

#[test]
fn after_any_edits_the_findings_are_those_of_the_front_end() {
    let mut random = ChaCha8Rng::seed_from_u64(91);
    let pieces = [
        "x",
        "(",
        ")",
        "[",
        "]",
        "'",
        " = ",
        "\n",
        "\r\n",
        "\t",
        "\"",
        "//",
        "\u{e9}",
        "\u{1d465}",
        "{",
        "}",
        "state q = 1\n",
        "include \"",
        "sum(",
        "in 1..",
        "1e",
        "where",
        "\u{feff}",
    ];
    let mut editor = Editor::new();
    let mut compared = 0;
    for path in quick() {
        let mut text = fs::read_to_string(&path).unwrap();
        // Beside the model, so that its files are found.
        let uri = uri(&path.with_file_name("typed.spec"));
        editor.open(&uri, &text);
        let mut version = 1;
        for _ in 0..6 {
            for _ in 0..random.random_range(1..8) {
                let from = boundary(&text, random.random_range(0..=text.len()));
                let to = boundary(&text, (from + random.random_range(0..12)).min(text.len())).max(from);
                let piece = pieces[random.random_range(0..pieces.len())];
                let [[line, start], [end, stop]] = [position(&text, from), position(&text, to)];
                // Editors know no place between `\r` and `\n`.
                if text[..from].ends_with('\r') || text[..to].ends_with('\r') {
                    continue;
                }
                version += 1;
                editor.change(&uri, version, [line, start, end, stop], piece);
                text.replace_range(from..to, piece);
            }
            editor.at("completion", &uri, (random.random_range(0..40), random.random_range(0..40)), Value::Null);
            // A lone `\r` ends a line for editors, and not for the front end.
            if text.replace("\r\n", "").contains('\r') {
                continue;
            }
            version += 1;
            editor.replace(&uri, version, &text);
            let wanted = expected(&path, &text);
            // The same findings are not sent again.
            editor.expect(&uri, &wanted);
            compared += 1;
        }
        editor.tell("textDocument/didClose", serde_json::json!({"textDocument": {"uri": uri}}));
    }
    assert!(compared > 60, "{compared}");
    assert_eq!(editor.quit(), Ended::Orderly);
}

#[test]
fn a_model_typed_from_nothing_ends_without_findings() {
    let mut random = ChaCha8Rng::seed_from_u64(92);
    let mut editor = Editor::new();
    for name in ["van_der_pol", "motor_pid", "four_bar", "weibel5"] {
        let path = models().join(name).join(format!("{name}.spec"));
        let text = fs::read_to_string(&path).unwrap();
        let uri = uri(&path.with_file_name("typed.spec"));
        editor.open(&uri, "");
        let (mut done, mut version) = (0, 1);
        while done < text.len() {
            let next = boundary(&text, (done + random.random_range(1..9)).min(text.len())).max(done);
            let [line, character] = position(&text, done);
            version += 1;
            editor.change(&uri, version, [line, character, line, character], &text[done..next]);
            done = next;
        }
        let wanted = expected(&path, &text);
        editor.expect(&uri, &wanted);
    }
    assert_eq!(editor.quit(), Ended::Orderly);
}

#[test]
fn findings_on_the_lung_come_within_half_a_second() {
    let path = models().join("weibel11/weibel11.spec");
    let mut times = common::key_presses(&uri(&path), &fs::read_to_string(&path).unwrap(), 20);
    times.sort_by(f64::total_cmp);
    // The median, for the machine may have other work; `cargo bench -p pe-lsp` measures.
    assert!(times[times.len() / 2] < 500.0, "{times:?}");
}
