//! The trace format that every engine writes, and checksums of traces.

use std::fmt;

use pe_ir::index::{List, PeId, at, number};
use pe_ir::word::WordFormat;

/// A data-memory write: `cycle pe address value`, see the datasheet, section "Trace".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TraceLine {
    /// Executed control words before this one.
    pub cycle: u64,
    /// Processing element.
    pub pe: PeId,
    /// Own memory word, or own depth plus imported memory word.
    pub address: u32,
    /// The word's bits.
    pub value: u64,
}

impl fmt::Display for TraceLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {:x} {:x}", self.cycle, self.pe, self.address, self.value)
    }
}

impl TraceLine {
    /// Reads a line; `None` if it is not one.
    pub fn parse(text: &str) -> Option<TraceLine> {
        let mut fields = text.split_ascii_whitespace();
        let line = TraceLine {
            cycle: fields.next()?.parse().ok()?,
            pe: fields.next()?.parse().ok()?,
            address: u32::from_str_radix(fields.next()?, 16).ok()?,
            value: u64::from_str_radix(fields.next()?, 16).ok()?,
        };
        fields.next().is_none().then_some(line)
    }
}

/// A memory write of a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemoryWrite {
    /// Control words executed in the step before it.
    pub cycle: u32,
    pub pe: PeId,
    /// The address in the first step, and what is added for its memory.
    pub address: u32,
    pub offset: u32,
    /// Bits that count the words of the ring in which it is, if it is in one.
    pub ring: u32,
    pub slot: u32,
    /// Whether a result is written; otherwise the imported memory takes a data operand.
    pub own: bool,
}

impl MemoryWrite {
    /// The address in a step.
    pub fn address_in(&self, step: u64) -> u32 {
        let mask = (1u64 << self.ring) - 1;
        let place = ((u64::from(self.address) + step) & mask) as u32;
        self.offset + (self.address & !(mask as u32) | place)
    }
}

/// Factor of the rolling checksums: odd, so that no single difference can vanish.
pub const CHECKSUM_FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;

/// Takes a memory write into the checksum of its PE.
///
/// The checksum of a PE is a polynomial in its writes modulo 2^64: each write multiplies it by [`CHECKSUM_FACTOR`] and
/// adds `address * 2^48 + value`. Two traces that differ in one write never have the same checksums.
pub fn checksum(before: u64, address: u32, value: u64) -> u64 {
    before.wrapping_mul(CHECKSUM_FACTOR).wrapping_add(u64::from(address) << 48).wrapping_add(value)
}

/// The checksums of a step as one sum of products per PE, over words and data operands in slots.
pub(crate) struct Checksums {
    pes: Vec<PeChecksum>,
    /// Slot and weight of each write to an own memory, PE after PE.
    own: Vec<(u32, u64)>,
    /// The same for imported memories.
    imported: Vec<(u32, u64)>,
}

struct PeChecksum {
    /// Factor of the checksum before the step.
    factor: u64,
    /// What the addresses add that are the same in all steps.
    addresses: u64,
    /// Writes to rings, with the factors of their addresses.
    rings: Vec<(MemoryWrite, u64)>,
    /// Ends in `own` and in `imported`.
    ends: (u32, u32),
}

impl Checksums {
    pub fn new(writes: &[MemoryWrite], pes: usize) -> Checksums {
        let mut of_pe: List<PeId, Vec<&MemoryWrite>> = List::filled(Vec::new(), pes);
        writes.iter().for_each(|write| of_pe[write.pe].push(write));
        let mut checksums = Checksums { pes: Vec::with_capacity(pes), own: Vec::new(), imported: Vec::new() };
        for writes in of_pe {
            let (mut factor, mut addresses, mut rings) = (1u64, 0u64, Vec::new());
            for write in writes.iter().rev() {
                match write.ring {
                    0 => {
                        addresses = addresses.wrapping_add((u64::from(write.address_in(0)) << 48).wrapping_mul(factor))
                    }
                    _ => rings.push((**write, factor)),
                }
                let memory = if write.own { &mut checksums.own } else { &mut checksums.imported };
                memory.push((write.slot, factor));
                factor = factor.wrapping_mul(CHECKSUM_FACTOR);
            }
            let ends = (number(checksums.own.len()), number(checksums.imported.len()));
            checksums.pes.push(PeChecksum { factor, addresses, rings, ends });
        }
        checksums
    }

    /// Takes the writes of a step, of this number in the run, into the checksums of all PEs.
    pub fn advance<P: Copy + Into<i64>>(
        &self,
        (sums, number): (&mut [u64], u64),
        format: &WordFormat,
        words: &[i64],
        data: &[P],
    ) {
        let (word_mask, data_mask) = (u64::MAX >> (64 - format.word_bits()), u64::MAX >> (64 - format.data_bits));
        let mut starts = (0, 0);
        for (sum, pe) in sums.iter_mut().zip(&self.pes) {
            let (own, imported) = (at(starts.0)..pe.ends.0 as usize, at(starts.1)..pe.ends.1 as usize);
            let own = self.own[own].iter().map(|(slot, weight)| (words[at(*slot)] as u64 & word_mask, weight));
            let imported = self.imported[imported].iter();
            let imported = imported.map(|(slot, weight)| (data[at(*slot)].into() as u64 & data_mask, weight));
            let weigh = |sum: u64, (value, weight): (u64, &u64)| sum.wrapping_add(value.wrapping_mul(*weight));
            let rings = pe
                .rings
                .iter()
                .map(|(write, factor)| (u64::from(write.address_in(number)) << 48).wrapping_mul(*factor));
            let addresses = rings.fold(pe.addresses, u64::wrapping_add);
            let before = sum.wrapping_mul(pe.factor).wrapping_add(addresses);
            *sum = imported.fold(own.fold(before, weigh), weigh);
            starts = pe.ends;
        }
    }
}
