//! Damage to a text: in its characters, words, numbers, lines.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// What numbers are replaced by.
const NUMBERS: [&str; 24] = [
    "0",
    "1",
    "-1",
    "2",
    "3",
    "7",
    "16",
    "31",
    "32",
    "33",
    "63",
    "64",
    "127",
    "128",
    "255",
    "65535",
    "65536",
    "2147483648",
    "4294967295",
    "18446744073709551616",
    "1e308",
    "1e-320",
    "inf",
    "NaN",
];

/// Pieces of text that are likely to hurt.
const PIECES: [&str; 32] = [
    "(",
    ")",
    "[",
    "]",
    "\"",
    "'",
    "=",
    "..",
    ",",
    ":",
    "\n",
    "\r\n",
    "#",
    "-",
    "^",
    "/",
    "*",
    "+",
    "~",
    "~2",
    " ",
    "\t",
    "\u{FEFF}",
    "\u{e9}",
    "\u{0}",
    "e\u{301}",
    "\u{1F469}\u{200D}\u{1F680}",
    "\\",
    "\\u{110000}",
    "if ",
    "sum(",
    "((((((((((((((((",
];

/// What texts are damaged with: lines and words of the whole corpus.
pub struct Damage {
    lines: Vec<String>,
    words: Vec<String>,
}

impl Damage {
    /// Of these texts.
    pub fn of(corpus: &[String]) -> Damage {
        let mut lines: Vec<String> = corpus.iter().flat_map(|text| text.lines()).map(str::to_owned).collect();
        let mut words: Vec<String> = corpus.iter().flat_map(|text| words(text)).map(str::to_owned).collect();
        for items in [&mut lines, &mut words] {
            items.sort();
            items.dedup();
        }
        Damage { lines, words }
    }

    /// The text with one damage more.
    pub fn once(&self, text: &str, generator: &mut ChaCha8Rng) -> String {
        match generator.random_range(0..8) {
            0 => characters(text, generator),
            1..=3 => self.one_word(text, generator),
            4 => self.all_words(text, generator),
            _ => self.one_line(text, generator),
        }
    }

    fn one_word(&self, text: &str, generator: &mut ChaCha8Rng) -> String {
        let mut words = words(text);
        let solid: Vec<usize> = (0..words.len()).filter(|at| !words[*at].trim().is_empty()).collect();
        let Some(at) = any(&solid, generator) else { return "x".to_owned() };
        let replacement;
        match generator.random_range(0..6) {
            0 => drop(words.remove(*at)),
            1 => words.insert(*at, words[*at]),
            2 => words.swap(*at, *any(&solid, generator).expect("there is one")),
            3 => words[*at] = words[*any(&solid, generator).expect("there is one")],
            4 if words[*at].starts_with(|first: char| first.is_ascii_digit()) => {
                replacement = number(words[*at], generator);
                words[*at] = &replacement;
            }
            _ => words[*at] = any(&self.words, generator).expect("the corpus has words"),
        }
        words.concat()
    }

    /// Replaces a word in all its places, so that what refers to it still does.
    fn all_words(&self, text: &str, generator: &mut ChaCha8Rng) -> String {
        let words = words(text);
        let solid: Vec<&str> = words.iter().copied().filter(|word| !word.trim().is_empty()).collect();
        let Some(old) = any(&solid, generator).copied() else { return "x".to_owned() };
        let new = match generator.random_range(0..3) {
            0 => number(old, generator),
            1 => any(&solid, generator).expect("there is one").to_string(),
            _ => any(&self.words, generator).expect("the corpus has words").clone(),
        };
        words.into_iter().map(|word| if word == old { &new } else { word }).collect()
    }

    fn one_line(&self, text: &str, generator: &mut ChaCha8Rng) -> String {
        let mut lines: Vec<&str> = text.lines().collect();
        if lines.is_empty() {
            return any(&self.lines, generator).expect("the corpus has lines").clone();
        }
        let (at, other) = (generator.random_range(0..lines.len()), generator.random_range(0..lines.len()));
        let (from, to) = (at.min(other), at.max(other) + 1);
        match generator.random_range(0..8) {
            0 => drop(lines.remove(at)),
            1 => lines.insert(at, lines[other]),
            2 => lines.swap(at, other),
            3 => lines.insert(at, any(&self.lines, generator).expect("the corpus has lines")),
            4 => lines[at] = any(&self.lines, generator).expect("the corpus has lines"),
            5 => drop(lines.drain(from..to)),
            6 => {
                let block = lines[from..to].to_vec();
                for _ in 0..generator.random_range(1..20) {
                    lines.splice(from..from, block.iter().copied());
                }
            }
            _ => lines.truncate(at),
        }
        lines.join("\n") + "\n"
    }
}

/// Another number in place of one, often a neighbour.
fn number(word: &str, generator: &mut ChaCha8Rng) -> String {
    match word.parse::<u64>() {
        Ok(number) if generator.random_bool(0.5) => match generator.random_range(0..4) {
            0 => number.saturating_add(1),
            1 => number.saturating_sub(1),
            2 => number.saturating_mul(2),
            _ => number / 2,
        }
        .to_string(),
        _ => any(&NUMBERS, generator).expect("there are some").to_string(),
    }
}

fn characters(text: &str, generator: &mut ChaCha8Rng) -> String {
    let characters: Vec<char> = text.chars().collect();
    let at = generator.random_range(0..=characters.len());
    let end = (at + generator.random_range(0..8)).min(characters.len());
    let mut damaged: String = characters[..at].iter().collect();
    if generator.random_bool(0.7) {
        damaged += any(&PIECES, generator).expect("there are some");
    }
    damaged.extend(&characters[end..]);
    damaged
}

fn any<'a, T>(items: &'a [T], generator: &mut ChaCha8Rng) -> Option<&'a T> {
    (!items.is_empty()).then(|| &items[generator.random_range(0..items.len())])
}

/// Names, numbers, runs of blanks, and single signs.
fn words(text: &str) -> Vec<&str> {
    let mut words = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let run = |of: fn(char) -> bool| rest.find(|c| !of(c)).unwrap_or(rest.len());
        let length = if first.is_alphanumeric() || first == '_' {
            run(|c| c.is_alphanumeric() || c == '_' || c == '.')
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
