//! Sets of small indices with a random element in constant time.

use pe_ir::index::{self, number};

const ABSENT: u32 = u32::MAX;

/// A subset of `0..n` as a list and the place of each index in it.
#[derive(Clone, Debug)]
pub(super) struct IndexSet {
    list: Vec<u32>,
    at: Vec<u32>,
}

impl IndexSet {
    /// The empty subset of `0..count`.
    pub(super) fn new(count: usize) -> IndexSet {
        IndexSet { list: Vec::new(), at: vec![ABSENT; count] }
    }

    /// The elements, in an order that depends on the history.
    pub(super) fn list(&self) -> &[u32] {
        &self.list
    }

    /// Makes an index an element, or none.
    pub(super) fn set(&mut self, index: usize, element: bool) {
        let at = self.at[index];
        if element && at == ABSENT {
            self.at[index] = number(self.list.len());
            self.list.push(number(index));
        } else if !element && at != ABSENT {
            self.at[index] = ABSENT;
            self.list.swap_remove(index::at(at));
            if let Some(&moved) = self.list.get(index::at(at)) {
                self.at[index::at(moved)] = at;
            }
        }
    }

    /// The elements by rising index.
    #[cfg(test)]
    pub(super) fn sorted(&self) -> Vec<u32> {
        let mut sorted = self.list.clone();
        sorted.sort_unstable();
        sorted
    }
}
