//! LUTs of memories whose words are known, after synthesis has simplified their bits as logic.

use std::collections::BTreeSet;

use pe_ir::memory::{self, LUT_ROM_WORDS, MemoryCells};

use super::Family;

/// A memory without a write port: tables up to [`LUT_ROM_WORDS`] words or if `logic` says so, else blocks.
pub fn rom(words: &[u128], bits: u32, logic: bool, family: Family) -> MemoryCells {
    if words.is_empty() || bits == 0 {
        return MemoryCells::default();
    }
    // Bits that never change are nowhere; words beyond the last one are 0.
    let beyond = if words.len().is_power_of_two() { words[0] } else { 0 };
    let changing = words.iter().fold(beyond ^ words[0], |bits, word| bits | (word ^ words[0]));
    if words.len() > LUT_ROM_WORDS as usize && !logic {
        return memory::rom(words.len() as u32, changing.count_ones());
    }
    // Bits that are alike share tables and registers.
    let changing = (0..bits).filter(|bit| changing >> bit & 1 == 1);
    let changing: BTreeSet<Vec<bool>> = changing.map(|bit| column(words, bit)).collect();
    let joined = joined(words.len() as u32, family);
    changing.iter().fold(MemoryCells::default(), |cells, column| MemoryCells {
        lut: cells.lut + joined * tables(column, family.lut_inputs()),
        ff: cells.ff + 1.0,
        ..cells
    })
}

/// The same of words that are not known: no bit is like another.
pub fn random(words: u32, bits: u32, logic: bool, family: Family) -> MemoryCells {
    if words == 0 || (words > LUT_ROM_WORDS && !logic) {
        return memory::rom(words, bits);
    }
    let parts = words.next_power_of_two().div_ceil(1 << family.lut_inputs());
    MemoryCells { lut: joined(words, family) * f64::from(bits * parts), ff: f64::from(bits), bram18: 0 }
}

/// Factor for what joins the tables of a memory: 1 up to [`LUT_ROM_WORDS`] words. The address of deeper ones comes out of a block,
/// and synthesis spends tables on that path, here as many as whole networks of weibel5 and atrial3 take (docs/silicon.md).
fn joined(words: u32, family: Family) -> f64 {
    match (words > LUT_ROM_WORDS, family.wide_tables()) {
        (false, _) => 1.0,
        (true, true) => 2.4,
        (true, false) => 1.4,
    }
}

/// A bit of all words, up to a power of two of them.
fn column(words: &[u128], bit: u32) -> Vec<bool> {
    let padding = words.len().next_power_of_two() - words.len();
    words.iter().map(|word| word >> bit & 1 == 1).chain(std::iter::repeat_n(false, padding)).collect()
}

/// Tables of so many inputs that give a bit of the word at an address, without what joins them.
fn tables(column: &[bool], inputs: u32) -> f64 {
    let column = supported(column.to_vec());
    match column.len() {
        // A constant, or a bit of the address: a register takes it as it is.
        1 => 0.0,
        2 if column[1] => 0.0,
        words if words <= 1 << inputs => 1.0,
        _ => column.chunks(1 << inputs).filter(|part| part.iter().any(|bit| *bit != part[0])).count().max(1) as f64,
    }
}

/// The same function without address bits that it does not depend on.
fn supported(mut column: Vec<bool>) -> Vec<bool> {
    let mut stride = 1;
    while stride < column.len() {
        let needed = (0..column.len()).any(|at| at & stride == 0 && column[at] != column[at | stride]);
        if needed {
            stride *= 2;
        } else {
            column = (0..column.len()).filter(|at| at & stride == 0).map(|at| column[at]).collect();
        }
    }
    column
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lut(words: &[u128], bits: u32, family: Family) -> f64 {
        rom(words, bits, false, family).lut
    }

    #[test]
    fn bits_that_are_constant_alike_or_of_the_address_cost_nothing() {
        let words: Vec<u128> = (0..16u128).map(|k| (k & 1) | (k & 1) << 1 | 1 << 2).collect();
        let cells = rom(&words, 4, false, Family::Ecp5);
        assert_eq!((cells.lut, cells.ff), (0.0, 1.0));
    }

    #[test]
    fn deeper_memories_take_as_many_tables_as_their_inputs_ask_for() {
        let random: Vec<u128> = (0..64u128).map(|k| ((k * k * 0x9e37_79b9) >> 7) & 0xff).collect();
        assert_eq!(lut(&random, 8, Family::Virtex6), 8.0);
        assert_eq!(lut(&random, 8, Family::Ecp5), 32.0);
        assert_eq!(lut(&random[..16], 8, Family::Ecp5), 8.0);
    }

    #[test]
    fn bits_that_never_change_take_no_part_of_a_block() {
        let words: Vec<u128> = (0..256u128).map(|k| ((k * k * 0x9e37_79b9_7f4a_7c15) >> 5) & ((1 << 36) - 1)).collect();
        assert_eq!(rom(&words, 44, false, Family::Ecp5).bram18, 1);
        assert_eq!(rom(&words, 44, true, Family::Ecp5).bram18, 0);
    }
}
