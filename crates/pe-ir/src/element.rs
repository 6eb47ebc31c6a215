//! Names of elements, `V[1,2]`. All instances of an array of components share one quantity: `cell[3].w[2]` is the element
//! with the subscripts 3 and 2 of the quantity `cell[].w`.

use std::borrow::Cow;

/// The places of so many subscripts within a name, nothing for none.
pub fn places(count: usize) -> String {
    match count {
        0 => String::new(),
        _ => format!("[{}]", ",".repeat(count - 1)),
    }
}

/// Number of subscripts within a name.
pub fn count(name: &str) -> usize {
    name.bytes().filter(|letter| matches!(letter, b'[' | b',')).count()
}

/// Name of an element: subscripts fill the places within the name, those that are left stand behind it.
pub fn name(name: &str, subscripts: &[i64]) -> String {
    let mut left = subscripts.iter().map(i64::to_string);
    let mut text = String::with_capacity(name.len() + 4 * subscripts.len() + 2);
    for letter in name.chars() {
        text.push(letter);
        if matches!(letter, '[' | ',') {
            text.extend(left.next());
        }
    }
    let behind: Vec<String> = left.collect();
    if !behind.is_empty() {
        text.push_str(&format!("[{}]", behind.join(",")));
    }
    text
}

/// The name without places for subscripts: `cell.w`, which stands for the whole array.
pub fn bare(name: &str) -> String {
    name.chars().filter(|letter| !matches!(letter, '[' | ',' | ']')).collect()
}

/// Quantity and subscripts of `cell[3].w[2]`, `cell.w`, `p`; `None` if it is written otherwise.
pub fn parse(text: &str) -> Option<(String, Option<Vec<i64>>)> {
    let (mut name, mut subscripts) = (String::new(), None);
    for (at, part) in text.split('.').enumerate() {
        let (word, inner) = match part.split_once('[') {
            None => (part, None),
            Some((word, rest)) => (word.trim_end(), Some(rest.strip_suffix(']')?)),
        };
        let plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
        if word.is_empty() || !word.chars().all(plain) {
            return None;
        }
        if at > 0 {
            // The brackets so far stand within the name.
            let known = subscripts.as_ref().map_or(0, Vec::len);
            name += &places(known - count(&name));
            name.push('.');
        }
        name += word;
        if let Some(inner) = inner {
            let numbers: Option<Vec<i64>> = inner.split(',').map(|number| number.trim().parse().ok()).collect();
            subscripts.get_or_insert_with(Vec::new).extend(numbers?);
        }
    }
    Some((name, subscripts))
}

/// What a group of elements is called: `V` of `V[1,2]`, `cell.w` of `cell[3].w[2]`.
pub fn quantity(name: &str) -> Cow<'_, str> {
    match name.split_once('[') {
        None => Cow::Borrowed(name),
        Some((word, _)) => match parse(name).filter(|(array, _)| array.contains('.')) {
            Some((array, _)) => Cow::Owned(bare(&array)),
            None => Cow::Borrowed(word),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_are_read_as_they_are_written() {
        for (name, subscripts, text) in [
            ("p", &[][..], "p"),
            ("V", &[3], "V[3]"),
            ("w", &[1, -2], "w[1,-2]"),
            ("soma.v", &[], "soma.v"),
            ("cell[].v", &[3], "cell[3].v"),
            ("cell[].w", &[3, 2], "cell[3].w[2]"),
            ("grid[,].cell[].w", &[3, 2, 7, 1, 0], "grid[3,2].cell[7].w[1,0]"),
        ] {
            assert_eq!(super::name(name, subscripts), text);
            let subscripts = (!subscripts.is_empty()).then(|| subscripts.to_vec());
            assert_eq!(parse(text), Some((name.to_owned(), subscripts)));
        }
        assert_eq!(parse("cell.v"), Some(("cell.v".to_owned(), None)));
        let quantities = ["p", "V[3]", "cell[3].w[2]", "soma.v", "x[1]+y[2]"].map(quantity);
        assert_eq!(quantities, ["p", "V", "cell.w", "soma.v", "x"]);
        assert_eq!(bare("grid[,].cell[].w"), "grid.cell.w");
        for wrong in ["", ".v", "cell.", "cell[3.v", "cell[x].v", "cell[3]v", "a b", "cell[].v"] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }
}
