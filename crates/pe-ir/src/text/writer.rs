//! Names and numbers as they are printed.

/// A number in the shorter of two forms, of the fewest digits that read back exactly.
pub fn number(number: f64) -> String {
    let magnitude = number.abs();
    if number == 0.0 || (1e-4..1e6).contains(&magnitude) || !number.is_finite() {
        number.to_string()
    } else {
        format!("{number:e}")
    }
}

/// A name: as it is where it reads back so, else in quotes.
pub fn name(name: &str) -> String {
    if is_plain(name) { name.to_owned() } else { quoted(name) }
}

/// A text in quotes.
pub fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            '\n' => quoted.push_str("\\n"),
            letter if letter.is_control() => quoted += &format!("\\u{{{:x}}}", u32::from(letter)),
            letter => quoted.push(letter),
        }
    }
    quoted.push('"');
    quoted
}

/// Words of expressions and items that no name without quotes is.
const WORDS: [&str; 5] = ["if", "then", "else", "inf", "NaN"];

/// How many bytes a name without quotes takes at the beginning of a text.
pub(super) fn plain_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    if !bytes.first().is_some_and(|first| first.is_ascii_alphabetic() || *first == b'_') {
        return 0;
    }
    let mut length = 0;
    while let Some(byte) = bytes.get(length) {
        match byte {
            b'_' | b'.' | b'~' => length += 1,
            byte if byte.is_ascii_alphanumeric() => length += 1,
            b'[' => {
                let inside =
                    bytes[length + 1..].iter().take_while(|byte| byte.is_ascii_digit() || **byte == b',').count();
                if inside == 0 || bytes.get(length + 1 + inside) != Some(&b']') {
                    break;
                }
                length += inside + 2;
            }
            _ => break,
        }
    }
    length
}

fn is_plain(name: &str) -> bool {
    plain_length(name) == name.len() && !name.is_empty() && !WORDS.contains(&name)
}
