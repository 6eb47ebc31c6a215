//! The result: the source of a program, and its cost.

/// A program without its fixed part.
#[derive(Clone, Debug)]
pub struct Program {
    /// Loops and sums as Rust.
    pub source: String,
    /// What the program reads at its start, as words of eight bytes.
    pub tables: Vec<u8>,
    /// What a step costs.
    pub work: Work,
}

/// What a step does, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Additions and multiplications.
    pub operations: u64,
    /// Numbers that loops load and store.
    pub moved: u64,
    /// Numbers in memory that a step reads or writes: values and coefficients.
    pub kept: u64,
    /// Products that are in loops, those with zero among them.
    pub in_loops: u64,
}
