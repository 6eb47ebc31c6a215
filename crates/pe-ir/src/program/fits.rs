//! Whether a control word that was read is one of its PE.

use super::{Address, CoefficientOperand, ControlWord, PeProgram, Target};

/// Whether everything a control word refers to exists in its PE.
pub(super) fn fits(word: &ControlWord, pe: &PeProgram, coefficient_bits: u32) -> bool {
    let features = &pe.features;
    let own = |address: Option<Address>| address.is_none_or(|a| u32::from(a.word) < features.own_words);
    let imported = |address: Option<Address>| address.is_none_or(|a| u32::from(a.word) < features.imported_words);
    let multiplier = match word.coefficient {
        CoefficientOperand::Coefficient(value) => {
            features.coefficient_words == 0
                && (1..64).contains(&coefficient_bits)
                && value >> (coefficient_bits - 1) == value >> 63
        }
        CoefficientOperand::Stored(index) => u32::from(index) < features.coefficient_words,
    };
    let target = |target: Target| {
        u32::from(target.address.word) < features.write_words()
            && (features.factor || !target.factor)
            && (target.own || target.base || target.factor)
    };
    let written = word.write.map(|target| target.address);
    let ringed = |address: Option<Address>, words: u32| {
        let fits = features.ring_bits > 0 && words >> features.ring_bits > 0;
        address.is_none_or(|address| !address.ring || fits && !address.swap)
    };
    let plain = word.write.is_none_or(|target| !target.address.ring || (!target.base && !target.factor));
    let received = word.receive.map(|(_, address)| address);
    let rings = plain
        && [word.own, word.write.map(|target| target.address)].into_iter().all(|own| ringed(own, features.own_words))
        && [word.imported, received].into_iter().all(|imported| ringed(imported, features.imported_words));
    let addresses = [word.own, word.imported, written, received];
    multiplier
        && own(word.own)
        && word.base.is_none_or(|base| u32::from(base) < features.base_words)
        && word.index.is_none_or(|index| u32::from(index) < features.index_words)
        && word.write_index.is_none_or(|(index, octaves)| {
            u32::from(index) < features.index_words && (features.octave_bits > 0 || !octaves)
        })
        && word.write.is_none_or(target)
        && imported(word.imported)
        && word.receive.is_none_or(|(port, a)| pe.ports.find(port).is_some() && imported(Some(a)))
        && (features.pre_adder || word.own.is_none() || word.imported.is_none())
        && usize::from(word.shift) < features.shifts.len()
        && (features.send || !word.send)
        && (features.shown_words > 0 || !word.show)
        && (features.swap || addresses.iter().flatten().all(|address| !address.swap))
        && rings
}
