//! The trace format that every engine writes.

use std::fmt;

/// A data-memory write: `cycle pe address value`, see the datasheet, section "Trace".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TraceLine {
    /// Executed control words before this one.
    pub cycle: u64,
    /// Processing element.
    pub pe: u32,
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
