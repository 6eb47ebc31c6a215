//! What differs between what a stored sweep was asked for and what is asked now, in words.

use std::collections::BTreeMap;

use serde_json::{Map, Value};

/// The first difference that keeps the points of the stored sweep from being taken over; none if they can be.
pub fn between(stored: &Value, head: &Map<String, Value>) -> Option<String> {
    let pair = |key: &str| (stored.get(key), head.get(key));
    let differs = |key: &str| {
        let (then, now) = pair(key);
        then != now
    };
    let text = |value: Option<&Value>| match value {
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
        None => "none".to_owned(),
    };
    let of = |key: &str, say: &dyn Fn(String, String) -> String| {
        let (then, now) = pair(key);
        differs(key).then(|| say(text(then), text(now)))
    };
    of("generator", &|then, now| format!("the version differs: it was written by {then}, this is {now}"))
        .or_else(|| of("shared_options", &|then, now| format!("the options differ: {}", options(&then, &now))))
        .or_else(|| of("model", &|then, now| format!("the model differs: it was `{then}`, this is `{now}`")))
        .or_else(|| of("odes", &|then, now| format!("the model differs: it had {then} equations, now {now}")))
        .or_else(|| of("span_s", &|then, now| format!("the model differs: its span was {then} s, now {now} s")))
        .or_else(|| {
            let words = "the model differs: equations, parameters, initial values or signals of the spec, or of a file that it \
                         names, have changed";
            of("model_sha256", &|_, _| words.to_owned())
        })
}

/// The options that differ between two lists of words.
fn options(then: &str, now: &str) -> String {
    let (then, now) = (values(then), values(now));
    let names: std::collections::BTreeSet<&String> = then.keys().chain(now.keys()).collect();
    let shown = |name: &str| if name.is_empty() { "the spec".to_owned() } else { format!("`{name}`") };
    let difference = |name: &&String| {
        let (then, now) = (then.get(*name), now.get(*name));
        let words = |value: &String| if value.is_empty() { "given".to_owned() } else { format!("`{value}`") };
        let state = |value: Option<&String>| value.map_or("not given".to_owned(), words);
        (then != now).then(|| format!("{} was {}, now it is {}", shown(name), state(then), state(now)))
    };
    let all: Vec<String> = names.iter().filter_map(difference).collect();
    if all.is_empty() { "they stand in another order".to_owned() } else { all.join("; ") }
}

/// The values of each option, those of repeated ones in a row; what belongs to none has an empty name.
fn values(words: &str) -> BTreeMap<String, String> {
    let mut values: BTreeMap<String, String> = BTreeMap::new();
    let mut name = String::new();
    for word in words.split(' ').filter(|word| !word.is_empty()) {
        if word.starts_with("--") {
            name = word.to_owned();
            values.entry(name.clone()).or_default();
        } else {
            let value = values.entry(std::mem::take(&mut name)).or_default();
            let mark = if value.is_empty() { "" } else { " " };
            *value += &format!("{mark}{word}");
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn told(then: Value, now: Value) -> Option<String> {
        let Value::Object(now) = now else { panic!("an object") };
        between(&then, &now)
    }

    #[test]
    fn differences_are_told_by_what_the_user_wrote() {
        let head = |options: &str| json!({"generator": "g 1", "shared_options": options, "model_sha256": "a"});
        assert_eq!(told(head("m.spec --span 2s"), head("m.spec --span 2s")), None);
        let found = told(head("m.spec --span 12s"), head("m.spec --span 2s --seed 2")).expect("a difference");
        assert_eq!(
            found,
            "the options differ: `--seed` was not given, now it is `2`; `--span` was `12s`, now it is `2s`"
        );
        let spec = told(head("m.spec"), head("n.spec")).expect("a difference");
        assert!(spec.contains("the spec was `m.spec`, now it is `n.spec`"), "{spec}");
        let flag = told(head("m.spec --no-pre-adder"), head("m.spec")).expect("a difference");
        assert!(flag.contains("`--no-pre-adder` was given, now it is not given"), "{flag}");
        let other = told(
            json!({"generator": "g 1", "shared_options": ""}),
            json!({"generator": "g 1", "shared_options": "", "span_s": 2.0}),
        );
        assert_eq!(other.as_deref(), Some("the model differs: its span was none s, now 2.0 s"));
    }
}
