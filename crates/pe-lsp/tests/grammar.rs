//! The grammar of Visual Studio Code against the words of the front end: it is made of the same lists, and it finds the
//! same words in all shipped models.
//!
//! `UPDATE_GRAMMAR=1 cargo test -p pe-lsp --test grammar` writes it anew. It uses no look-around, so that the engine of
//! the editor and the one here agree.

mod common;

use pe_frontend::vocabulary::{self, WordKind};
use regex::Regex;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

fn file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("vscode/syntaxes/ode.tmLanguage.json")
}

/// The patterns in order: an expression with the scope of the whole, or of its groups.
fn patterns() -> Vec<Value> {
    let any = |words: &[&str]| words.join("|");
    let operators = ["and", "or", "not", "div", "mod"];
    let inner: Vec<&str> = vocabulary::keywords().iter().copied().filter(|word| !operators.contains(word)).collect();
    let calls = |signal: bool| {
        let names: Vec<&str> =
            vocabulary::functions().filter(|call| call.signal == signal).map(|call| call.name).collect();
        names.join("|")
    };
    let unit = r"(\[[^\]]*\])";
    let whole = |scope: &str, expression: String| json!({"match": expression, "name": format!("{scope}.ode")});
    let groups = |expression: String, scopes: &[&str]| {
        let captures: serde_json::Map<String, Value> = (1..)
            .zip(scopes)
            .filter(|(_, scope)| !scope.is_empty())
            .map(|(group, scope)| (group.to_string(), json!({"name": format!("{scope}.ode")})))
            .collect();
        json!({"match": expression, "captures": captures})
    };
    let measures: Vec<&str> = vocabulary::measures().collect();
    vec![
        whole("comment.line.double-slash", "//.*$".to_owned()),
        whole("string.quoted.double", r#""[^"]*"?"#.to_owned()),
        groups(format!(r"^[ \t]*(time)[ \t]+{unit}"), &["keyword.control.statement", "constant.other.unit"]),
        whole("keyword.control.statement", format!(r"\b(?:{})\b", any(vocabulary::statements()))),
        whole("keyword.operator.word", format!(r"\b(?:{})\b", any(&operators))),
        whole("keyword.control", format!(r"\b(?:{})\b", any(&inner))),
        groups(r"\b(tunable)[ \t]+(in)\b".to_owned(), &["keyword.other", "keyword.control"]),
        groups(
            r"\b(until)[ \t]+([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)".to_owned(),
            &["keyword.other", "constant.numeric"],
        ),
        groups(r"([\])'])[ \t]+(symmetric)\b".to_owned(), &["punctuation.bracket", "keyword.other"]),
        groups(r"(,)[ \t]*(hold|linear)\b".to_owned(), &["punctuation.separator", "constant.language"]),
        groups(
            format!(r"\b([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)[ \t]+{unit}"),
            &["constant.numeric", "constant.other.unit"],
        ),
        groups(
            format!(r"\b([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)[ \t]+({})\b", any(&measures)),
            &["constant.numeric", "constant.other.unit"],
        ),
        whole("constant.numeric", r"\b[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?".to_owned()),
        groups(format!(r"\b({})[ \t]*(\()", calls(true)), &["support.function.signal", "punctuation.bracket"]),
        groups(format!(r"\b({})[ \t]*(\()", calls(false)), &["support.function", "punctuation.bracket"]),
        groups(r"\b([A-Za-z_][A-Za-z0-9_]*)(\()".to_owned(), &["entity.name.function", "punctuation.bracket"]),
        groups(format!(r"\b([A-Za-z_][A-Za-z0-9_]*)[ \t]+{unit}"), &["variable.other", "constant.other.unit"]),
        whole("constant.language", format!(r"\b(?:{})\b", any(&vocabulary::constants().collect::<Vec<_>>()))),
        whole("variable.other", r"\b[A-Za-z_][A-Za-z0-9_]*".to_owned()),
        groups(format!(r"([\])'])[ \t]+{unit}"), &["punctuation.bracket", "constant.other.unit"]),
        whole("keyword.operator", r"==|!=|<=|>=|\.\.|[=+\-*/^<>']".to_owned()),
        whole("punctuation.separator", "[.,:;]".to_owned()),
        whole("punctuation.bracket", r"[()\[\]{}]".to_owned()),
    ]
}

fn grammar() -> String {
    let grammar =
        json!({"name": "pe-synth spec", "scopeName": "source.ode", "fileTypes": ["spec"], "patterns": patterns()});
    format!("{grammar:#}\n")
}

#[test]
fn the_grammar_is_made_of_the_words_of_the_language() {
    if std::env::var_os("UPDATE_GRAMMAR").is_some() {
        fs::write(file(), grammar()).unwrap();
    }
    let shipped = fs::read_to_string(file()).unwrap();
    assert!(shipped == grammar(), "write it anew: UPDATE_GRAMMAR=1 cargo test -p pe-lsp --test grammar");
}

/// A pattern as the editor uses it.
struct Pattern {
    expression: Regex,
    name: Option<String>,
    captures: Vec<(usize, String)>,
}

fn read(grammar: &Value) -> Vec<Pattern> {
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let pattern = |pattern: &Value| Pattern {
        expression: Regex::new(pattern["match"].as_str().unwrap()).unwrap(),
        name: pattern["name"].as_str().map(str::to_owned),
        captures: pattern["captures"]
            .as_object()
            .into_iter()
            .flatten()
            .map(|(group, scope)| (group.parse().unwrap(), text(&scope["name"])))
            .collect(),
    };
    grammar["patterns"].as_array().unwrap().iter().map(pattern).collect()
}

/// Scopes of the parts of a line, as TextMate finds them: the pattern that matches first, the earlier one in doubt.
fn tokens(line: &str, patterns: &[Pattern]) -> Vec<(usize, usize, String)> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < line.len() {
        let matches = patterns.iter().filter_map(|pattern| Some((pattern, pattern.expression.captures_at(line, at)?)));
        let Some((pattern, captures)) = matches.min_by_key(|(_, captures)| captures.get(0).unwrap().start()) else {
            break;
        };
        let whole = captures.get(0).unwrap();
        found.extend(pattern.name.iter().map(|name| (whole.start(), whole.end(), name.clone())));
        for (group, scope) in &pattern.captures {
            found.extend(captures.get(*group).map(|part| (part.start(), part.end(), scope.clone())));
        }
        at = whole.end().max(at + 1);
    }
    found
}

fn suits(kind: WordKind, scope: &str, word: &str) -> bool {
    match kind {
        WordKind::Keyword => scope.starts_with("keyword.") || (word == "mod" && scope.starts_with("support.function")),
        WordKind::Name => {
            let contextual =
                vocabulary::CONTEXTUAL.contains(&word) || vocabulary::measures().any(|known| known == word);
            ["variable.", "entity.name.function", "support.function", "constant.language"]
                .iter()
                .any(|start| scope.starts_with(start))
                || (contextual && (scope.starts_with("keyword.") || scope.starts_with("constant.other.unit")))
        }
        WordKind::Number => scope == "constant.numeric.ode",
        WordKind::Text => scope.starts_with("string."),
        WordKind::Unit => scope == "constant.other.unit.ode",
        WordKind::Comment => scope.starts_with("comment."),
        WordKind::Sign => scope.starts_with("keyword.operator") || scope.starts_with("punctuation."),
        WordKind::Unknown => true,
    }
}

/// Words of a text that the grammar takes for something else, and the number of those that were compared.
fn differences(text: &str, patterns: &[Pattern]) -> (Vec<String>, usize) {
    let (mut wrong, mut count, mut start) = (Vec::new(), 0, 0);
    let words = vocabulary::words(text);
    for line in text.split_inclusive('\n') {
        let scopes = tokens(line.trim_end_matches(['\r', '\n']), patterns);
        for word in words.iter().filter(|word| (start..start + line.len()).contains(&word.span.range().start)) {
            let (from, to) = (word.span.range().start - start, word.span.range().end - start);
            let scope = scopes.iter().find(|(begin, end, _)| *begin <= from && from < *end);
            let shown = text.get(word.span.range()).unwrap_or_default();
            // The `'` of a derivative, and signs of two letters, are whole; so is every word.
            let right = scope.is_some_and(|(begin, end, scope)| {
                (*begin, *end) == (from, to.min(line.trim_end().len())) && suits(word.kind, scope, shown)
            });
            if !right {
                wrong.push(format!("{:?} `{shown}`: {scope:?} in `{}`", word.kind, line.trim_end()));
            }
            count += 1;
        }
        start += line.len();
    }
    (wrong, count)
}

#[test]
fn the_grammar_finds_the_words_of_all_models() {
    let patterns = read(&serde_json::from_str(&fs::read_to_string(file()).unwrap()).unwrap());
    let (mut wrong, mut words) = (Vec::new(), 0);
    for path in common::specs(&common::models()) {
        let (more, count) = differences(&fs::read_to_string(&path).unwrap(), &patterns);
        wrong.extend(more);
        words += count;
    }
    assert!(words > 20_000, "{words} words");
    assert!(wrong.is_empty(), "{} of {words} words, {:#?}", wrong.len(), &wrong[..wrong.len().min(20)]);
}

#[test]
fn the_comparison_finds_a_grammar_that_is_wrong() {
    let shipped: Value = serde_json::from_str(&fs::read_to_string(file()).unwrap()).unwrap();
    let text = fs::read_to_string(common::models().join("weibel11/weibel11.spec")).unwrap();
    assert!(differences(&text, &read(&shipped)).0.is_empty());
    for lost in 0..shipped["patterns"].as_array().unwrap().len() {
        let mut damaged = shipped.clone();
        damaged["patterns"].as_array_mut().unwrap().remove(lost);
        let name = &shipped["patterns"][lost]["name"];
        let used =
            ["comment.line.double-slash.ode", "keyword.control.ode", "constant.numeric.ode", "variable.other.ode"];
        if used.iter().any(|used| name == used) {
            assert!(!differences(&text, &read(&damaged)).0.is_empty(), "{name}");
        }
    }
}
