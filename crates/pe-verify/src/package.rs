//! Other initial words in a program package, and nothing else.

use std::collections::BTreeMap;

use pe_ir::program::Program;

/// A memory that states begin in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Memory {
    /// Data operands of the PE's own words.
    Own,
    /// Stored words.
    Base,
    /// Data operands of other PEs' words.
    Imported,
}

impl Memory {
    /// Name of its constant in the package.
    fn constant(self) -> &'static str {
        match self {
            Memory::Own => "OWN",
            Memory::Base => "BASE",
            Memory::Imported => "IMPORTED",
        }
    }
}

/// Place of an initial word: PE, memory, address.
type Place = (usize, Memory, usize);

/// An initial word that a start replaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InitialWord {
    /// Where it is.
    pub place: Place,
    /// The word, two's complement.
    pub word: i64,
    /// Its bits.
    pub bits: u32,
}

/// The initial words by which a program differs from another one of the same network.
pub fn differences(from: &Program, to: &Program) -> Vec<InitialWord> {
    let (data, word) = (from.format.data_bits, from.format.word_bits());
    let mut words = Vec::new();
    for (pe, (from, to)) in from.pes.iter().zip(&to.pes).enumerate() {
        let images = [
            (Memory::Own, data, &from.own_image, &to.own_image),
            (Memory::Base, word, &from.base_image, &to.base_image),
            (Memory::Imported, data, &from.imported_image, &to.imported_image),
        ];
        for (memory, bits, from, to) in images {
            let pairs = from.iter().zip(to).enumerate().filter(|(_, (from, to))| from != to);
            words.extend(pairs.map(|(address, (_, to))| InitialWord { place: (pe, memory, address), word: *to, bits }));
        }
    }
    words
}

/// The words as lines that the Rust reference reads.
pub fn lines(words: &[InitialWord]) -> String {
    let line = |InitialWord { place: (pe, memory, address), word, .. }: &InitialWord| {
        format!("{pe} {} {address} {word}\n", memory.constant().to_lowercase())
    };
    words.iter().map(line).collect()
}

/// The package with other initial words.
///
/// # Errors
/// The word that the package has no line for, or a line beside those words that changed.
pub fn with_words(package: &str, words: &[InitialWord]) -> Result<String, String> {
    let wanted: BTreeMap<Place, &InitialWord> = words.iter().map(|word| (word.place, word)).collect();
    let mut left = wanted.clone();
    let mut text = String::with_capacity(package.len());
    let mut replaced = Vec::new();
    let mut image = None;
    for (number, line) in package.split_inclusive('\n').enumerate() {
        image = opened(line).or(if line.trim_start().starts_with(");") { None } else { image });
        let found = image.and_then(|(pe, memory)| {
            let (address, literal) = element(line)?;
            Some((left.remove(&(pe, memory, address))?, literal))
        });
        match found {
            Some((word, literal)) => {
                if literal.len() != word.bits as usize {
                    return Err(format!("line {}: a word of {} bits, not {}", number + 1, literal.len(), word.bits));
                }
                text += &line[..literal.start];
                text.extend((0..word.bits).rev().map(|bit| if word.word >> bit & 1 == 1 { '1' } else { '0' }));
                text += &line[literal.end..];
                replaced.push(number);
            }
            None => text += line,
        }
    }
    if let Some(((pe, memory, address), _)) = left.first_key_value() {
        return Err(format!("no line for word {address} of `PE{pe}_{}_IMAGE`", memory.constant()));
    }
    only_words_differ(package, &text, &replaced)?;
    Ok(text)
}

/// Compares the two texts line by line: those of replaced words may differ in digits of the literal, no other line in
/// anything.
fn only_words_differ(before: &str, after: &str, replaced: &[usize]) -> Result<(), String> {
    let masked = |line: &str| {
        let (from, to) = (line.find("b\"").map_or(0, |at| at + 2), line.rfind('"').unwrap_or(0));
        let digits = line.get(from..to).is_some_and(|digits| digits.bytes().all(|digit| matches!(digit, b'0' | b'1')));
        digits.then(|| (line[..from].to_owned(), to - from, line[to..].to_owned()))
    };
    let (before, after): (Vec<&str>, Vec<&str>) = (before.lines().collect(), after.lines().collect());
    let same = |number: usize| match replaced.binary_search(&number) {
        Ok(_) => masked(before[number]).is_some() && masked(before[number]) == masked(after[number]),
        Err(_) => before[number] == after[number],
    };
    match (0..before.len()).find(|number| after.len() != before.len() || !same(*number)) {
        Some(number) => Err(format!("line {} would change beside its word", number + 1)),
        None => Ok(()),
    }
}

/// PE and memory of the image that begins in a line.
fn opened(line: &str) -> Option<(usize, Memory)> {
    let name = line.trim_start().strip_prefix("constant PE")?;
    let (pe, name) = name.split_once('_')?;
    let memories = [Memory::Own, Memory::Base, Memory::Imported];
    let memory = memories.into_iter().find(|memory| {
        name.strip_prefix(memory.constant()).is_some_and(|rest| rest.trim_start().starts_with("_IMAGE"))
    })?;
    Some((pe.parse().ok()?, memory))
}

/// Address of an element and the place of its digits in the line.
fn element(line: &str) -> Option<(usize, std::ops::Range<usize>)> {
    let (address, rest) = line.split_once("=>")?;
    let start = line.len() - rest.len() + rest.find("b\"")? + 2;
    let end = start + line[start..].find('"')?;
    Some((address.trim().parse().ok()?, start..end))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKAGE: &str = "\
  constant PE0_OWN_IMAGE : word_array_t(0 to 1)(3 downto 0) :=
  (
    0 => b\"0000\", -- state x
    1 => b\"0101\"  -- state y
  );
  constant PE0_BASE_IMAGE : word_array_t(0 to 0)(3 downto 0) :=
  (
    0 => b\"0000\"
  );
";

    fn word(memory: Memory, address: usize, word: i64) -> InitialWord {
        InitialWord { place: (0, memory, address), word, bits: 4 }
    }

    #[test]
    fn words_are_replaced_where_they_stand() {
        let text = with_words(PACKAGE, &[word(Memory::Own, 1, -2), word(Memory::Base, 0, 3)]).unwrap();
        assert_eq!(text, PACKAGE.replace("0101", "1110").replace("0 => b\"0000\"\n", "0 => b\"0011\"\n"));
        assert_eq!(with_words(PACKAGE, &[]).unwrap(), PACKAGE);
    }

    #[test]
    fn a_word_without_a_line_or_of_another_width_is_refused() {
        assert!(with_words(PACKAGE, &[word(Memory::Own, 2, 0)]).unwrap_err().contains("word 2 of `PE0_OWN_IMAGE`"));
        assert!(with_words(PACKAGE, &[word(Memory::Imported, 0, 0)]).is_err());
        let wide = InitialWord { bits: 5, ..word(Memory::Own, 0, 0) };
        assert!(with_words(PACKAGE, &[wide]).unwrap_err().contains("line 3"));
    }

    #[test]
    fn whatever_changes_beside_a_word_is_named() {
        let other = PACKAGE.replace("state y", "state z");
        assert!(only_words_differ(PACKAGE, &other, &[]).unwrap_err().contains("line 4"));
        assert!(only_words_differ(PACKAGE, &other, &[3]).is_err());
        assert!(only_words_differ(PACKAGE, &PACKAGE.replace("0101", "1101"), &[3]).is_ok());
        assert!(only_words_differ(PACKAGE, &PACKAGE.replace("0101", "x101"), &[3]).is_err());
        assert!(only_words_differ(PACKAGE, &format!("{PACKAGE}\n"), &[]).is_err());
    }
}
