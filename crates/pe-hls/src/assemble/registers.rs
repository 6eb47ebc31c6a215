//! Register allocation: which memory word holds which value, when.
//!
//! A program is a loop, so lifetimes are arcs on a circle of `period` words. Arcs are packed by start time; an arc
//! that would wrap onto its register's first one gets a register of its own.

use pe_ir::index::{at, number};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Life of a value in one memory: the word that writes it and the last word that reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Arc {
    /// Word whose end writes the value.
    pub write: u32,
    /// Last word that reads it, at least `write`.
    pub last_read: u32,
    /// What the caller knows the value by.
    pub key: u32,
}

/// Packs arcs; returns `(key, register)` pairs and the number of registers.
pub(super) fn pack(mut arcs: Vec<Arc>, period: u32) -> (Vec<(u32, u32)>, u32) {
    arcs.sort_unstable();
    let mut registers: BinaryHeap<Reverse<(u32, u32)>> = BinaryHeap::new();
    let mut first: Vec<u32> = Vec::new();
    let mut assigned = Vec::with_capacity(arcs.len());
    for arc in arcs {
        // One that arrives behind the end of the step is taken to be written in its last word, and may go all round.
        let most = period - u32::from(arc.write + 1 != period);
        debug_assert!(arc.last_read - arc.write <= most, "a value outlives its own next write: {arc:?}");
        let free = registers.peek().filter(|Reverse((last_read, register))| {
            *last_read < arc.write && arc.last_read < first[at(*register)] + period
        });
        let register = match free {
            Some(Reverse((_, register))) => *register,
            None => number(first.len()),
        };
        if at(register) == first.len() {
            first.push(arc.write);
        } else {
            registers.pop();
        }
        registers.push(Reverse((arc.last_read, register)));
        assigned.push((arc.key, register));
    }
    (assigned, number(first.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disjoint_lives_share_a_register_and_overlapping_ones_do_not() {
        let arc = |write, last_read, key| Arc { write, last_read, key };
        let (assigned, count) = pack(vec![arc(0, 3, 0), arc(3, 5, 1), arc(4, 9, 2), arc(6, 7, 3)], 20);
        assert_eq!(count, 2);
        let register = |key| assigned.iter().find(|(k, _)| *k == key).unwrap().1;
        assert_ne!(register(0), register(1), "a word read last where another is written is not free");
        assert_eq!(register(0), register(2));
    }

    #[test]
    fn an_arc_that_goes_all_round_has_its_register_alone() {
        let arc = |write, last_read, key| Arc { write, last_read, key };
        let (_, count) = pack(vec![arc(0, 3, 0), arc(9, 19, 1), arc(9, 12, 2), arc(4, 8, 3)], 10);
        assert_eq!(count, 3);
    }

    #[test]
    fn an_arc_that_wraps_keeps_clear_of_the_first_one() {
        let arc = |write, last_read, key| Arc { write, last_read, key };
        let (_, count) = pack(vec![arc(1, 2, 0), arc(8, 11, 1)], 10);
        assert_eq!(count, 2);
    }
}
