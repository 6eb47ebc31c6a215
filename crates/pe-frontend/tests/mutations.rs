//! Damaged specs: whatever the text, there is no panic, places lie inside the file, and it does not take long.

mod common;

use pe_frontend::{Limits, Overrides, elaborate_within, parse};
use pe_ir::source::SourceFile;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::{Duration, Instant};

/// Mutations per spec.
const ROUNDS: usize = 150;

/// No single text may take longer, even in an unoptimised build on a busy machine.
const LONGEST: Duration = Duration::from_millis(900);

/// Pieces that are likely to hurt.
const PIECES: [&str; 40] = [
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
];

#[test]
fn no_damage_makes_the_front_end_panic_or_hang() {
    let mut paths = common::specs(&common::root().join("crates/pe-frontend/tests/specs"));
    paths.extend(common::specs(&common::root().join("models")));
    // Large models run into the limits instead of taking their full time thousands of times over.
    let limits = Limits { elements: 20_000, evaluations: 200_000, reads: 100_000 };
    let mut generator = ChaCha8Rng::seed_from_u64(1);
    for path in paths {
        let original = std::fs::read_to_string(&path).expect("the spec can be read");
        for _ in 0..ROUNDS {
            let mut text = original.clone();
            for _ in 0..generator.random_range(1..=4) {
                text = mutate(&text, &mut generator);
            }
            check(text, &limits, &path.display().to_string());
        }
    }
}

#[test]
fn random_pieces_do_not_make_the_front_end_panic_or_hang() {
    let limits = Limits { elements: 20_000, evaluations: 200_000, reads: 100_000 };
    let mut generator = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..2000 {
        let mut text = String::new();
        for _ in 0..generator.random_range(1..200) {
            text += PIECES[generator.random_range(0..PIECES.len())];
            text += if generator.random_bool(0.5) { " " } else { "" };
        }
        check(text, &limits, "random pieces");
    }
}

/// Parses, elaborates and renders a text.
fn check(text: String, limits: &Limits, origin: &str) {
    let source = SourceFile { name: "damaged.spec".to_owned(), text };
    let begin = Instant::now();
    let (spec, mut findings) = parse(&source);
    let (model, more) = elaborate_within(&spec, &Overrides::default(), limits);
    let taken = begin.elapsed();
    assert!(taken < LONGEST, "{origin}: {taken:?} for\n{}", source.text);
    findings.extend(more);
    let errors = findings.iter().any(|finding| finding.code.starts_with('E'));
    assert_eq!(model.is_none(), errors, "{origin}: {findings:?} for\n{}", source.text);
    for finding in &findings {
        let labels = finding.labels.iter().map(|(span, _)| *span);
        for span in finding.span.into_iter().chain(labels) {
            let place = source.text.get(span.start as usize..span.end as usize);
            assert!(place.is_some(), "{origin}: {finding:?} lies outside of\n{}", source.text);
        }
        assert!(pe_ir::codes::explain(finding.code).is_some(), "{} is not explained", finding.code);
        finding.render(&source);
    }
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
