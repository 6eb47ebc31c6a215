//! Damaged specs: whatever the text, there is no panic, places lie inside the file, and it does not take long.
//!
//! Every shipped spec is damaged in each of its words and lines, then at random. A spec that is refused has an error,
//! every finding has a known code, and a spec without an error has a model.

mod common;

use pe_frontend::{Limits, NoFiles, Overrides, elaborate_within, parse};
use pe_ir::source::{Severity, Sources};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// No single text may take longer, even in an unoptimised build on a busy machine.
const LONGEST: Duration = Duration::from_millis(990);

/// Large models run into these limits instead of taking their full time thousands of times over.
const LIMITS: Limits = Limits { elements: 3_000, evaluations: 60_000, reads: 20_000 };

/// Texts made from one spec by systematic damage, and by random damage, of which the long suite takes [`MORE`] times as many;
/// what is more is thinned out evenly.
const SYSTEMATIC: usize = 350;
const RANDOM: usize = 75;
const MORE: usize = 2;

/// Of these, texts that run within the limits of the product, however large the model.
const FULL_SIZE: usize = 6;

/// Values that a number is replaced by.
const NUMBERS: [&str; 12] =
    ["NaN", "inf", "1e308", "1e309", "1e-320", "1e-400", "0", "-1", "0.5", "99999999999", "9007199254740993", "(-0)"];

/// Pieces that are likely to hurt.
const PIECES: [&str; 56] = [
    "(",
    ")",
    "[",
    "]",
    "\"",
    "'",
    "=",
    "==",
    "..",
    ",",
    ":",
    "\n",
    "//",
    "-",
    "^",
    "/",
    "*",
    "+",
    "0",
    "1e308",
    "1e999",
    "999999999",
    "if",
    "then",
    "else",
    "sum(",
    "where",
    "in",
    "for",
    "state",
    "include \"a\"",
    "output",
    "index",
    "param",
    "div",
    "mod",
    "not",
    "\u{FEFF}",
    "é",
    "\u{0}",
    "..9007199254740993",
    "\u{202E}",
    "e\u{301}",
    "\u{1F469}\u{200D}\u{1F680}",
    "\r",
    "\t",
    " [",
    "function f(x) = ",
    "units strict",
    "data(\"a\", \"b\")",
    "[1, 2; 3, 4]",
    "A*x",
    "x'",
    "dot(x, x)",
    "transpose(",
    "[i]",
];

#[test]
fn no_damage_to_a_shipped_spec_makes_the_front_end_panic_or_hang() {
    let mut paths = common::specs(&common::root().join("models"));
    paths.extend(common::specs(&common::root().join("crates/pe-frontend/tests/specs")));
    let mut texts: Vec<(String, String, Limits)> = Vec::new();
    let more = if std::env::var_os("PE_LONG").is_some() { MORE } else { 1 };
    for (number, path) in paths.iter().enumerate() {
        let original = std::fs::read_to_string(path).expect("the spec can be read");
        let mut generator = ChaCha8Rng::seed_from_u64(number as u64);
        let mut damaged = thinned(systematic(&original), SYSTEMATIC * more);
        for _ in 0..RANDOM * more {
            let mut text = original.clone();
            for _ in 0..generator.random_range(1..=4) {
                text = mutate(&text, &mut generator);
            }
            damaged.push(text);
        }
        let stride = damaged.len() / FULL_SIZE;
        for (at, text) in damaged.into_iter().enumerate() {
            let limits = if at % stride == 0 { Limits::default() } else { LIMITS };
            texts.push((path.file_name().unwrap_or_default().to_string_lossy().into_owned(), text, limits));
        }
    }
    assert!(texts.len() > 15_000, "only {} texts", texts.len());
    let (accepted, slowest) = check_all(&texts);
    println!("{} texts, {accepted} of them accepted, the slowest took {slowest:?}", texts.len());
    assert!(accepted > texts.len() / 50, "nearly everything is refused: {accepted} of {}", texts.len());
}

#[test]
fn random_pieces_do_not_make_the_front_end_panic_or_hang() {
    let mut generator = ChaCha8Rng::seed_from_u64(2);
    let texts: Vec<(String, String, Limits)> = (0..4000)
        .map(|_| {
            let mut text = String::new();
            for _ in 0..generator.random_range(1..200) {
                text += PIECES[generator.random_range(0..PIECES.len())];
                text += if generator.random_bool(0.5) { " " } else { "" };
            }
            ("random pieces".to_owned(), text, LIMITS)
        })
        .collect();
    check_all(&texts);
}

/// Checks all texts on two threads; gives the number of accepted ones and the longest time.
fn check_all(texts: &[(String, String, Limits)]) -> (usize, Duration) {
    let next = AtomicUsize::new(0);
    let worker = || {
        let (mut accepted, mut slowest) = (0, Duration::ZERO);
        while let Some((origin, text, limits)) = texts.get(next.fetch_add(1, Ordering::Relaxed)) {
            let outcome = catch_unwind(AssertUnwindSafe(|| check(text, limits)));
            let (model, taken) = outcome.unwrap_or_else(|_| panic!("{origin}: see above, for\n{text}"));
            assert!(taken < LONGEST, "{origin}: {taken:?} for\n{text}");
            accepted += usize::from(model);
            slowest = slowest.max(taken);
        }
        (accepted, slowest)
    };
    std::thread::scope(|scope| {
        let other = scope.spawn(worker);
        let mine = worker();
        let other = other.join().expect("the texts of the second thread pass");
        (mine.0 + other.0, mine.1.max(other.1))
    })
}

/// Parses, elaborates and checks what was found; gives whether there is a model, and the time.
fn check(text: &str, limits: &Limits) -> (bool, Duration) {
    let mut sources = Sources::new("damaged.spec", text);
    let begin = Instant::now();
    let (spec, mut findings) = parse(&mut sources, &NoFiles);
    let (model, more) = elaborate_within(&spec, &Overrides::default(), limits);
    let taken = begin.elapsed();
    findings.extend(more);
    let errors = findings.iter().any(|finding| finding.severity == Severity::Error);
    assert_eq!(model.is_none(), errors, "{findings:?}");
    for finding in &findings {
        let labels = finding.labels.iter().map(|(span, _)| *span);
        for span in finding.span.into_iter().chain(labels) {
            // `get` wants the ends in order, inside the text and between characters.
            assert!(text.get(span.start as usize..span.end as usize).is_some(), "{finding:?} lies outside");
        }
        let known = pe_ir::codes::CODES.iter().any(|code| code.code == finding.code);
        assert!(known && finding.code.starts_with('E') == (finding.severity == Severity::Error), "{finding:?}");
        // A message may quote the text, but not all of it.
        assert!(finding.message.len() + finding.help.as_ref().map_or(0, String::len) < 1000, "{finding:?}");
    }
    (model.is_some(), taken)
}

/// At most `most` items, evenly from all of them.
fn thinned(items: Vec<String>, most: usize) -> Vec<String> {
    let stride = items.len().div_ceil(most).max(1);
    items.into_iter().step_by(stride).collect()
}

/// The words of a text: names, numbers, single signs, comments, and the blanks between them.
fn words(text: &str) -> Vec<&str> {
    let mut words = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let run = |of: fn(char) -> bool| rest.find(|c| !of(c)).unwrap_or(rest.len());
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if first.is_alphanumeric() || first == '_' {
            run(|c| c.is_alphanumeric() || c == '_')
        } else if first == ' ' {
            run(|c| c == ' ')
        } else {
            first.len_utf8()
        };
        words.push(&rest[..length]);
        rest = &rest[length..];
    }
    words
}

/// The text with each word and each line deleted, doubled, swapped with the next or replaced, and cut off everywhere.
fn systematic(text: &str) -> Vec<String> {
    let words = words(text);
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let mut damaged = Vec::new();
    let with = |parts: &[&str], at: usize, replaced: usize, by: &[&str]| {
        [&parts[..at], by, &parts[at + replaced..]].concat().concat()
    };
    for (at, line) in lines.iter().enumerate() {
        damaged.push(with(&lines, at, 1, &[]));
        damaged.push(with(&lines, at, 1, &[line, line]));
        if let Some(next) = lines.get(at + 1) {
            damaged.push(with(&lines, at, 2, &[next, line]));
        }
    }
    for (at, word) in words.iter().enumerate().filter(|(_, word)| !word.starts_with("//")) {
        damaged.push(words[..at].concat());
        damaged.push(with(&words, at, 1, &[]));
        damaged.push(with(&words, at, 1, &[word, word]));
        damaged.push(with(&words, at, 1, &["\u{3b1}\u{301}"]));
        if let Some(next) = words.get(at + 1) {
            damaged.push(with(&words, at, 2, &[next, word]));
        }
        if word.starts_with(|first: char| first.is_ascii_digit()) {
            damaged.extend(NUMBERS.iter().map(|number| with(&words, at, 1, &[number])));
        } else if word.starts_with(|first: char| first.is_alphabetic()) {
            let other = words[(at * 7 + 3) % words.len()];
            let long = word.repeat(60);
            let turned: String = word.chars().rev().collect();
            for name in [other, &long, &turned, &word.to_uppercase(), "pi", "sum", "_"] {
                damaged.push(with(&words, at, 1, &[name]));
            }
        }
    }
    damaged
}

/// Damages a text at one place.
fn mutate(text: &str, generator: &mut impl Rng) -> String {
    let characters: Vec<char> = text.chars().collect();
    if characters.is_empty() {
        return "state".to_owned();
    }
    let at = generator.random_range(0..characters.len());
    let length = generator.random_range(1..=12).min(characters.len() - at);
    let piece = PIECES[generator.random_range(0..PIECES.len())];
    let (before, rest): (String, &[char]) = (characters[..at].iter().collect(), &characters[at..]);
    let tail = |skip: usize| rest[skip..].iter().collect::<String>();
    match generator.random_range(0..6) {
        0 => before + &tail(length),
        1 => before + piece + &tail(0),
        2 => before + piece + &tail(length),
        3 => before + &tail(0)[..tail(0).len() - tail(length).len()].repeat(3) + &tail(length),
        4 => {
            // Two lines trade places.
            let mut lines: Vec<&str> = text.lines().collect();
            let (a, b) = (generator.random_range(0..lines.len().max(1)), generator.random_range(0..lines.len().max(1)));
            if !lines.is_empty() {
                lines.swap(a, b);
            }
            lines.join("\n")
        }
        _ => before,
    }
}
