//! The schedule: when each chain issues and each transfer arrives.
//!
//! Times count control words from the first word in which an operation of the step may issue; they are below
//! `period` for operands and may exceed it for the writes and receives that finish in the next step's first words.

use crate::graph::ValueId;
use crate::index::{ChainId, List, PeId};

/// A word arriving at another PE.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Transfer {
    /// Value that travels.
    pub value: ValueId,
    /// Receiving PE.
    pub to: PeId,
    /// Time of the receive group.
    pub receive: u32,
}

/// When everything happens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Control words per step.
    pub period: u32,
    /// For each chain the time of its first operand; operands follow in every word.
    pub starts: List<ChainId, u32>,
    /// For each chain, at the positions of its terms, the terms in issue order.
    pub order: Vec<u32>,
    /// Transfers between PEs, and of inputs to PEs, sorted.
    pub transfers: Vec<Transfer>,
}
