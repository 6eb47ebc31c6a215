//! Word widths, the arithmetic of stored words, and the latency table.
//!
//! This module is the one place that defines rounding, saturation and operand extraction; the datasheet
//! (`docs/hardware.md`, section "Arithmetic") states the same rules in prose, and `hdl/` implements them.

/// How many registers an operation passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Pipeline {
    /// As few as a device with registers inside its blocks needs: the fewest clocks from operand to result.
    #[default]
    Short,
    /// Second registers behind memories, control words and shifts, and one in front of the multiplication: a faster
    /// clock where blocks have no such registers.
    Deep,
}

impl Pipeline {
    /// All of them, the default first.
    pub const ALL: [Pipeline; 2] = [Pipeline::Short, Pipeline::Deep];

    /// The name on the command line and in the report.
    pub fn name(self) -> &'static str {
        match self {
            Pipeline::Short => "short",
            Pipeline::Deep => "deep",
        }
    }
}

/// Widths of the two ports of the multiplier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct MultiplierPorts {
    /// Bits of the data port.
    pub data_bits: u32,
    /// Bits of the coefficient port.
    pub coefficient_bits: u32,
}

impl MultiplierPorts {
    /// Ports of these widths.
    pub const fn new(data_bits: u32, coefficient_bits: u32) -> MultiplierPorts {
        MultiplierPorts { data_bits, coefficient_bits }
    }

    /// Bits of the wider port.
    pub fn widest(self) -> u32 {
        self.data_bits.max(self.coefficient_bits)
    }

    /// Whether no port is narrower than that of the other multiplier.
    pub fn hold(self, other: MultiplierPorts) -> bool {
        self.data_bits >= other.data_bits && self.coefficient_bits >= other.coefficient_bits
    }
}

/// As on the command line: bits of the data port, `x`, bits of the coefficient port.
impl std::fmt::Display for MultiplierPorts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.data_bits, self.coefficient_bits)
    }
}

/// Widths of stored words and multiplier ports of a design, and its pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WordFormat {
    /// Bits of a stored word without guard bits (`--storage`).
    pub storage_bits: u32,
    /// Extra low bits that only additions see.
    pub guard_bits: u32,
    /// Bits of the multiplier's data port.
    pub data_bits: u32,
    /// Bits of the multiplier's coefficient port.
    pub coefficient_bits: u32,
    /// Registers that an operation passes (`--pipeline`).
    pub pipeline: Pipeline,
}

impl WordFormat {
    /// Bits of a stored word below what the multiplier sees, if storage has fewer. Eight suffice: sixteen measure no
    /// better in `docs/decisions/0001`.
    const HIDDEN_BITS: u32 = 8;

    /// Bits of a stored word, at most: 48 storage bits and eight guard bits.
    const LARGEST_WORD: u32 = 56;

    /// Bits by which products are longer than words with added guard bits: a word's LSB is then no less than a product's
    /// with coefficients of up to 16.
    const PRODUCT_ROOM: u32 = 5;

    /// Widths with guard bits below the storage bits: so many that eight bits of a stored word are hidden from both
    /// ports of the multiplier, and at most eight. The pipeline is the short one.
    pub const fn new(storage_bits: u32, data_bits: u32, coefficient_bits: u32) -> WordFormat {
        let widest = if data_bits > coefficient_bits { data_bits } else { coefficient_bits };
        let guard_bits = Self::HIDDEN_BITS.saturating_sub(storage_bits.saturating_sub(widest));
        WordFormat { storage_bits, guard_bits, data_bits, coefficient_bits, pipeline: Pipeline::Short }
    }

    /// Widths of a word with these multiplier ports, otherwise as [`WordFormat::new`].
    pub const fn with_ports(storage_bits: u32, ports: MultiplierPorts) -> WordFormat {
        WordFormat::new(storage_bits, ports.data_bits, ports.coefficient_bits)
    }

    /// Both ports of the multiplier.
    pub const fn multiplier(&self) -> MultiplierPorts {
        MultiplierPorts::new(self.data_bits, self.coefficient_bits)
    }

    /// The same widths with more guard bits, so that at least so many bits of a stored word are hidden from both ports of
    /// the multiplier, as far as words and products go.
    pub fn with_hidden(self, bits: u32) -> WordFormat {
        let widest = self.data_bits.max(self.coefficient_bits);
        let products = self.data_bits + self.coefficient_bits - Self::PRODUCT_ROOM;
        let word_bits = (widest + bits).min(Self::LARGEST_WORD).min(products);
        WordFormat { guard_bits: self.guard_bits.max(word_bits.saturating_sub(self.storage_bits)), ..self }
    }

    /// The same widths in another pipeline.
    pub const fn with_pipeline(self, pipeline: Pipeline) -> WordFormat {
        WordFormat { pipeline, ..self }
    }

    /// Top bits of a saturated word that tell its sign.
    pub const CEILING_BITS: u32 = 8;

    /// Bits of a word in the own memory, guard bits included.
    #[inline]
    pub fn word_bits(&self) -> u32 {
        self.storage_bits + self.guard_bits
    }

    /// Bits of the accumulator that a program may use: a DSP block's 48, or, where logic adds, room for 16 products;
    /// shifted to the left it fits 64 bits.
    pub fn accumulator_limit(&self) -> u32 {
        if self.single_multiplier() {
            48.min(64 - self.left_shift())
        } else {
            self.data_bits + self.coefficient_bits + 4
        }
    }

    /// Left shift of the held sum before a write's right shift. Words that are wider than products need it: a product
    /// of two variables may lie above the LSB of the value that it is added to. Two bits make room for increments of
    /// up to twice the value.
    #[inline]
    pub fn left_shift(&self) -> u32 {
        (self.word_bits() + 2).saturating_sub(self.data_bits + self.coefficient_bits)
    }

    /// Whether one 25x18 multiplier block (either way round) forms the product.
    pub fn single_multiplier(&self) -> bool {
        let (small, large) = (self.data_bits.min(self.coefficient_bits), self.data_bits.max(self.coefficient_bits));
        small <= 18 && large <= 25
    }

    /// Low bits that the data port does not see.
    #[inline]
    pub fn data_drop(&self) -> u32 {
        self.word_bits() - self.data_bits
    }

    /// Low bits that the coefficient port does not see of a stored factor.
    #[inline]
    pub fn factor_drop(&self) -> u32 {
        self.word_bits() - self.coefficient_bits
    }

    /// Half an LSB of the data port in stored words: every stored word carries it, so that dropping bits rounds.
    pub fn data_offset(&self) -> i64 {
        half(self.data_drop())
    }

    /// Upper bits of a stored word that its rounding to `storage_bits` depends on: what is added before the guard bits are
    /// dropped has zeros below them, so nothing carries into them.
    pub fn shown_bits(&self) -> u32 {
        let added = half(self.guard_bits) - self.data_offset();
        self.word_bits() - added.trailing_zeros().min(self.guard_bits)
    }

    /// Half an LSB of the coefficient port: the offset of words that are read as factors.
    pub fn factor_offset(&self) -> i64 {
        half(self.factor_drop())
    }

    /// Largest stored word.
    #[inline]
    pub fn max_word(&self) -> i64 {
        (1 << (self.word_bits() - 1)) - 1
    }

    /// The word of a sum above the largest word: the top [`WordFormat::CEILING_BITS`] bits of the largest, the rest 0.
    /// So every bit below is 0 in both saturated words, which a register's reset does without logic.
    pub fn ceiling(&self) -> i64 {
        let below = self.word_bits() - Self::CEILING_BITS;
        self.max_word() >> below << below
    }

    /// Smallest stored word.
    #[inline]
    pub fn min_word(&self) -> i64 {
        -(1 << (self.word_bits() - 1))
    }

    /// What the data port sees of a stored word.
    #[inline]
    pub fn data_operand(&self, word: i64) -> i64 {
        word >> self.data_drop()
    }

    /// The stored word of a value that is kept as a data operand alone.
    pub fn operand_word(&self, operand: i64) -> i64 {
        (operand << self.data_drop()) + self.data_offset()
    }

    /// What the coefficient port sees of a stored word.
    #[inline]
    pub fn factor_operand(&self, word: i64) -> i64 {
        word >> self.factor_drop()
    }

    /// Write side: adds the shifted and rounded accumulator to the base word. The flag tells whether it saturated.
    pub fn write(&self, base: i64, accumulator: i64, shift: u32) -> (i64, bool) {
        self.add(base, round_shift(accumulator << self.left_shift(), shift))
    }

    /// Adds a number in units of the word's LSB to the base word. The flag tells whether the result saturated.
    #[inline]
    pub fn add(&self, base: i64, rounded: i64) -> (i64, bool) {
        // A sum beyond 64 bits is beyond every word as well, so saturating early changes nothing.
        let sum = base.saturating_add(rounded);
        if sum > self.max_word() {
            (self.ceiling(), true)
        } else if sum < self.min_word() {
            (self.min_word(), true)
        } else {
            (sum, false)
        }
    }

    /// The stored word of a real number: `value / 2^exponent` rounded to nearest, plus `offset`, saturated.
    pub fn encode(&self, value: f64, exponent: i32, offset: i64) -> (i64, bool) {
        let scaled = libm::round(libm::scalbn(value, -exponent));
        let sum = scaled + offset as f64;
        let word = sum.clamp(self.min_word() as f64, self.max_word() as f64);
        // Exact: words have at most 56 bits, and a clamped value below 2^53 is an integer already.
        let exact = if scaled.abs() < 9.0e15 { scaled as i64 + offset } else { word as i64 };
        let bounded = exact.clamp(self.min_word(), self.max_word());
        (bounded, word != sum)
    }

    /// The real number a stored word stands for.
    pub fn decode(&self, word: i64, exponent: i32, offset: i64) -> f64 {
        libm::scalbn((word - offset) as f64, exponent)
    }

    /// What an input PE port receives of a `storage_bits` wide input word: the rounded data operand.
    pub fn input_operand(&self, word: i64) -> i64 {
        let stored = ((word << self.guard_bits) + self.data_offset()).min(self.max_word());
        self.data_operand(stored)
    }
}

fn half(dropped: u32) -> i64 {
    if dropped == 0 { 0 } else { 1 << (dropped - 1) }
}

/// `accumulator / 2^shift`, rounded to nearest, halves up.
#[inline(always)]
pub fn round_shift(accumulator: i64, shift: u32) -> i64 {
    if shift == 0 {
        accumulator
    } else {
        // The last bit that is dropped is the rounding increment; adding it before the shift could overflow 64 bits.
        (accumulator >> (shift - 1) >> 1) + (accumulator >> (shift - 1) & 1)
    }
}

/// Distances in control words between the parts of one operation; shared by scheduler, simulator and VHDL.
///
/// A product issued in word `k` is accumulated in word `k + accumulate`, and so on; see the datasheet, "Timing".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Latency {
    /// Clock cycles from operands to product register, without those of a deep pipeline.
    pub multiplier: u32,
    /// Registers that an operation passes.
    pub pipeline: Pipeline,
}

impl Latency {
    /// The latency table of a word format.
    pub fn of(format: &WordFormat) -> Latency {
        Latency { multiplier: if format.single_multiplier() { 1 } else { 3 }, pipeline: format.pipeline }
    }

    /// Operand word to the word in which the multiplication takes the operands, less one: the second register behind
    /// the memories, and the one of the sum of both operands.
    pub fn operand(&self) -> u32 {
        match self.pipeline {
            Pipeline::Short => 0,
            Pipeline::Deep => 2,
        }
    }

    /// Operand word to the word that sets the flag of operands which are too large for their sum.
    pub fn operand_flag(&self) -> u32 {
        match self.pipeline {
            Pipeline::Short => 1,
            Pipeline::Deep => 2,
        }
    }

    /// Operand word to the word in which its product stands in the product register, less one.
    pub fn product(&self) -> u32 {
        self.operand() + self.multiplier
    }

    /// Scale word to the word whose addition takes base and shifted sum, less one.
    pub fn addend(&self) -> u32 {
        match self.pipeline {
            Pipeline::Short => 0,
            Pipeline::Deep => 1,
        }
    }

    /// Operand word to the word whose `close` field sees its product.
    pub fn accumulate(&self) -> u32 {
        self.product() + 1
    }

    /// Last operand word of a chain to the word whose `close` field ends the chain.
    pub fn close(&self) -> u32 {
        self.accumulate() + 1
    }

    /// Last operand word of a chain to its first possible scale word (base read, choice of shift).
    pub fn scale(&self) -> u32 {
        self.close()
    }

    /// Scale word to write word (own write, send).
    pub fn scale_to_write(&self) -> u32 {
        self.addend() + 3
    }

    /// Last operand word of a chain to its first possible write word.
    pub fn write(&self) -> u32 {
        self.scale() + self.scale_to_write()
    }

    /// Write word (or receive word) to the first word that may read the value.
    pub const WRITE_TO_READ: u32 = 1;

    /// Scale word to the first scale word that may have its result as the base.
    pub fn base_again(&self) -> u32 {
        self.scale_to_write() + Self::WRITE_TO_READ
    }

    /// Word that reads the index memory to the scale word whose base address takes the index.
    pub const INDEX_TO_SCALE: u32 = 1;

    /// Write word of a table's argument to the first scale word that may read an entry at its index.
    pub const WRITE_TO_INDEXED: u32 = Self::WRITE_TO_READ + Self::INDEX_TO_SCALE;

    /// Write word with `send` to the first word that may receive the value.
    pub const SEND_TO_RECEIVE: u32 = 1;

    /// Number of leading words in which a program finishes the previous step; the network pauses before this word.
    ///
    /// Own writes of the previous step end at word `write() - 1`, its receives one word later.
    pub fn pause(&self) -> u32 {
        self.write() + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NARROW: WordFormat = WordFormat::new(32, 25, 18);

    #[test]
    fn dropping_bits_of_an_offset_word_rounds_to_nearest() {
        for value in [-3.49, -2.51, -0.5, 0.49, 0.5, 1.7] {
            let (word, _) = NARROW.encode(value, -(NARROW.data_drop() as i32), NARROW.data_offset());
            assert_eq!(NARROW.data_operand(word), (value + 0.5).floor() as i64, "{value}");
        }
    }

    #[test]
    fn guard_bits_are_added_as_far_as_products_go() {
        let added = |storage, data, coefficient, bits| {
            let format = WordFormat::new(storage, data, coefficient);
            format.with_hidden(bits).guard_bits - format.guard_bits
        };
        assert_eq!([added(32, 32, 32, 8), added(32, 32, 32, 13), added(32, 35, 35, 13)], [0, 5, 8]);
        assert_eq!([added(32, 35, 35, 40), added(48, 35, 35, 40)], [16, 8]);
        assert_eq!([added(32, 25, 18, 20), added(32, 25, 35, 20)], [5, 15]);
    }

    #[test]
    fn writes_saturate_and_say_so() {
        assert_eq!(NARROW.write(NARROW.max_word(), 1 << 20, 20), (NARROW.ceiling(), true));
        assert_eq!(NARROW.ceiling(), 0x7f << 25);
        assert_eq!(NARROW.write(NARROW.max_word() - 1, 1, 0), (NARROW.max_word(), false));
        assert_eq!(NARROW.write(NARROW.min_word(), -3, 1), (NARROW.min_word(), true));
        assert_eq!(NARROW.write(5, 3, 1), (7, false));
    }

    #[test]
    fn shifts_round_halves_up_without_overflow() {
        assert_eq!(round_shift(-3, 1), -1);
        assert_eq!(round_shift(3, 1), 2);
        assert_eq!(round_shift(i64::MAX, 1), 1 << 62);
    }
}
