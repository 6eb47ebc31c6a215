//! Numbers of segments into which the range of a table can be divided.

use pe_ir::functions::Segments;
use pe_ir::word::WordFormat;

/// Bits of an index that are tried.
const INDEX_BITS: std::ops::RangeInclusive<u32> = 3..=8;

/// Bits of an index that may count octaves.
const OCTAVE_BITS: std::ops::RangeInclusive<u32> = 2..=4;

/// The divisions that words of a format can have, those with the fewest segments first.
pub(super) fn divisions(format: WordFormat) -> impl DoubleEndedIterator<Item = Segments> {
    let octaves = move || std::iter::once(0).chain(OCTAVE_BITS);
    let all = INDEX_BITS.flat_map(move |bits| octaves().map(move |octave_bits| (bits, octave_bits)));
    all.map(|(index_bits, octave_bits)| Segments { index_bits, octave_bits }).filter(move |segments| {
        let deepest = (1u32 << segments.octave_bits) - 1 + segments.index_bits.saturating_sub(segments.octave_bits);
        segments.octave_bits < segments.index_bits && deepest < format.data_bits
    })
}
