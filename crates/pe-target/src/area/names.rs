//! Names of the counts of the area model, and of traits that it may not cover.

/// What a PE's LUTs are counted in.
pub const LUT_TERMS: [&str; 10] = [
    "tables of memories",
    "bits chosen among parts of memories",
    "bits of shifts chosen in LUTs",
    "bits of the base addition",
    "bits of port choices",
    "buffers that change roles",
    "pre-adder with sums of two operands",
    "bits of sums outside of multiplier blocks",
    "bits of running sums that start from 0 in LUTs",
    "one",
];

/// What a PE's flip-flops are counted in.
pub const FF_TERMS: [&str; 6] = [
    "bits of memory read registers",
    "bits of hold register, sum and word",
    "bits of the link register",
    "pre-adder with sums of two operands",
    "bits of sums outside of multiplier blocks",
    "one",
];

/// Traits of PEs that the model may not know from enough measured ones.
pub const TRAITS: [&str; 14] = [
    "multiplier of 32x32",
    "multiplier of 18x25",
    "multiplier of another size but 25x18",
    "factors (products of two stored words)",
    "coefficients in a memory of their own",
    "buffers that change roles",
    "pre-adder with sums of two operands",
    "no link",
    "data memories of more than 32 words in LUTs",
    "data memories in block RAM",
    "more than five shift positions",
    "more than four ports",
    "bases written in the last round only",
    "tables of functions",
];
