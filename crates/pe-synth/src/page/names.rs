//! Names for pages and pictures: those of the spec, and labels for what lifting made, which is named after its formula.

use std::borrow::Cow;
use std::collections::BTreeMap;

use pe_ir::model::{Model, Variable};

/// Labels of algebraic equations that the spec does not name.
pub struct Names {
    labels: BTreeMap<String, String>,
}

impl Names {
    /// The labels of a model: the parts of an equation are numbered in the order in which it reads them.
    pub fn of(model: &Model) -> Names {
        let mut labels: Vec<Option<String>> = vec![None; model.algebraics.len()];
        let states = model.states.iter().map(|state| (format!("{}'", state.name), &state.derivative));
        let own = model.algebraics.iter().filter(|algebraic| is_named(&algebraic.name));
        let own = own.map(|algebraic| (algebraic.name.clone(), &algebraic.expr));
        let mut parts = vec![];
        for (reader, expr) in states.chain(own) {
            let mut serial = 0;
            // Parts of parts belong to the same equation.
            expr.each_variable(&mut |variable| parts.push(variable));
            while let Some(variable) = parts.pop() {
                let Variable::Algebraic(index) = variable else { continue };
                let algebraic = &model.algebraics[index as usize];
                let label = &mut labels[index as usize];
                if label.is_some() || is_named(&algebraic.name) {
                    continue;
                }
                serial += 1;
                *label = Some(format!("{reader} part {serial}"));
                algebraic.expr.each_variable(&mut |variable| parts.push(variable));
            }
        }
        let labelled = model.algebraics.iter().zip(labels);
        Names { labels: labelled.filter_map(|(algebraic, label)| Some((algebraic.name.clone(), label?))).collect() }
    }

    /// What a variable or a value of the step is called: `formula.stage2` as `x' part 1.stage2`.
    pub fn label<'a>(&self, name: &'a str) -> Cow<'a, str> {
        if let Some(label) = self.labels.get(name) {
            return Cow::Owned(label.clone());
        }
        // Columns of tables name a table and its argument.
        if let Some((table, rest)) = name.split_once(".column")
            && let Some((column, argument)) = rest.split_once('[')
        {
            let argument = argument.strip_suffix(']').unwrap_or(argument);
            return Cow::Owned(format!("{}.column{column}[{}]", self.label(table), self.label(argument)));
        }
        match name.rsplit_once('.') {
            Some((base, role)) => match self.label(base) {
                Cow::Owned(base) => Cow::Owned(format!("{base}.{role}")),
                Cow::Borrowed(_) => Cow::Borrowed(name),
            },
            None => Cow::Borrowed(name),
        }
    }

    /// The formula behind a label, its numbers in three digits; nothing of what the spec names.
    pub fn formula(&self, name: &str) -> String {
        if self.labels.contains_key(name) { short(name) } else { String::new() }
    }
}

/// Whether a name is one that a spec can give: a word, or some of instances in instances, with indices of arrays.
fn is_named(name: &str) -> bool {
    let word = |part: &str| {
        let word = part.split_once('[').map_or(part, |(word, _)| word);
        let ends = !part.contains('[') || part.find(']') == Some(part.len() - 1);
        let letters = word.chars().all(|letter| letter.is_alphanumeric() || letter == '_');
        ends && letters && !word.is_empty() && !word.starts_with(|first: char| first.is_ascii_digit())
    };
    name.split('.').all(word)
}

/// A formula with its numbers in three digits.
fn short(formula: &str) -> String {
    let mut text = String::new();
    let mut rest = formula;
    while let Some(first) = rest.chars().next() {
        let inside = text.chars().next_back().is_some_and(|last| last.is_alphanumeric() || last == '_');
        let length = if first.is_ascii_digit() && !inside { number_length(rest) } else { first.len_utf8() };
        let (piece, behind) = rest.split_at(length);
        match piece.parse::<f64>() {
            // Whole numbers may be indices.
            Ok(number) if piece.len() > 4 && piece.contains(['.', 'e', 'E']) => text += &three_digits(number),
            _ => text += piece,
        }
        rest = behind;
    }
    text
}

/// How much of a text is the number at its beginning.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        let exponent = at > 0 && matches!(bytes[at], b'e' | b'E');
        let sign = at > 0 && matches!(bytes[at], b'+' | b'-') && matches!(bytes[at - 1], b'e' | b'E');
        if !(bytes[at].is_ascii_digit() || bytes[at] == b'.' || exponent || sign) {
            break;
        }
        at += 1;
    }
    at
}

/// A number in three digits, as short as they allow.
pub fn three_digits(number: f64) -> String {
    let rounded: f64 = format!("{number:.2e}").parse().expect("a number");
    let (plain, power) = (format!("{rounded}"), format!("{rounded:e}"));
    if plain.len() <= power.len() { plain } else { power }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_become_short_and_names_stay() {
        assert_eq!(short("1/(0.8333333333333334*h+34*pg3+10*x_1234567^2+1)"), "1/(0.833*h+34*pg3+10*x_1234567^2+1)");
        assert_eq!(short("exp(-1.23456e-12*V[10001])"), "exp(-1.23e-12*V[10001])");
        assert_eq!(short("größe*0.123456e"), "größe*0.123456e");
    }

    #[test]
    fn only_names_of_specs_are_names() {
        assert!(["x", "V[1,2]", "größe_2", "soma.v", "cell[3].w[2]"].iter().all(|name| is_named(name)));
        assert!(
            ["0.5", "x*0.5", "1/(x+1)", "x[1]+y[2]", "x^2", "", "exp(x)", "x[1]^2"].iter().all(|name| !is_named(name))
        );
    }
}
