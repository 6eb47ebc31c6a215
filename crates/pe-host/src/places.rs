//! Addresses and bits of the register map that hosts use, by their names in `pe_map::registers`.

use pe_map::registers::{Register, register};

/// A register of the map.
///
/// # Panics
/// If there is none of this name, which a test would have found.
pub(crate) fn named(name: &str) -> &'static Register {
    register(name).unwrap_or_else(|| panic!("there is no register {name}"))
}

/// Address of a register.
pub(crate) fn address(name: &str) -> u32 {
    named(name).address
}

/// Bits of a field of a register.
pub(crate) fn mask(register: &str, field: &str) -> u32 {
    named(register).field(field).unwrap_or_else(|| panic!("there is no {register}.{field}")).mask()
}

/// Bits of several fields.
pub(crate) fn masks(register: &str, fields: &[&str]) -> u32 {
    fields.iter().fold(0, |all, field| all | mask(register, field))
}

/// A field of a word of a register.
pub(crate) fn part(register: &str, field: &str, word: u32) -> u32 {
    let mask = mask(register, field);
    (word & mask) >> mask.trailing_zeros()
}

/// The first 32 digits of a hash as the words of `HASH_0` to `HASH_3`.
pub(crate) fn hash_words(hash: &str) -> [u32; 4] {
    let word =
        |index: usize| hash.get(8 * index..8 * index + 8).and_then(|digits| u32::from_str_radix(digits, 16).ok());
    [0, 1, 2, 3].map(|index| word(index).unwrap_or(0))
}

/// Words of 32 bits of a number, low half first.
pub(crate) fn halves(word: i64) -> [u32; 2] {
    [word as u32, (word >> 32) as u32]
}

/// The number of these words, the last of which has its sign.
pub(crate) fn whole(words: &[u32]) -> i64 {
    match words {
        [low] => i64::from(*low as i32),
        [low, high, ..] => i64::from(*high as i32) << 32 | i64::from(*low),
        [] => 0,
    }
}
