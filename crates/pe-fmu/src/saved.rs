//! The state of an instance, and its bytes.

use pe_host::Snapshot;

/// What an instance goes on from.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// Time of sample 0.
    pub start: f64,
    /// Numbers of the inputs.
    pub numbers: Vec<f64>,
    /// State of the network.
    pub snapshot: Snapshot,
}

/// What the bytes begin with.
const MARK: [u8; 8] = *b"pe-fmu 1";

impl Saved {
    /// The bytes: numbers of 64 bits, the lower bytes first.
    pub fn bytes(&self) -> Vec<u8> {
        let Snapshot { hash, sample, state } = &self.snapshot;
        let mut bytes = MARK.to_vec();
        let mut add = |word: u64| bytes.extend(word.to_le_bytes());
        add(self.start.to_bits());
        add(*sample);
        add(self.numbers.len() as u64);
        self.numbers.iter().for_each(|number| add(number.to_bits()));
        add(state.len() as u64);
        state.iter().for_each(|word| add(*word as u64));
        bytes.extend(hash.bytes());
        bytes
    }

    /// The state that has these bytes; none if they are damaged.
    pub fn of(bytes: &[u8]) -> Option<Saved> {
        let mut rest = bytes.strip_prefix(&MARK)?;
        let mut next = || {
            let (word, behind) = rest.split_first_chunk()?;
            rest = behind;
            Some(u64::from_le_bytes(*word))
        };
        let start = f64::from_bits(next()?);
        let sample = next()?;
        let count = next()?;
        let numbers = (0..count).map(|_| next().map(f64::from_bits)).collect::<Option<_>>()?;
        let count = next()?;
        let state = (0..count).map(|_| next().map(|word| word as i64)).collect::<Option<_>>()?;
        let hash = String::from_utf8(rest.to_vec()).ok()?;
        Some(Saved { start, numbers, snapshot: Snapshot { hash, sample, state } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_read_as_they_are_written() {
        let snapshot = Snapshot { hash: "ab".repeat(32), sample: 7, state: vec![-1, i64::MAX, 0] };
        let saved = Saved { start: 0.5, numbers: vec![-2.0, f64::MAX], snapshot };
        let bytes = saved.bytes();
        assert_eq!(Saved::of(&bytes), Some(saved));
        // The hash at the end is compared elsewhere.
        for length in 0..bytes.len() - 64 {
            assert_eq!(Saved::of(&bytes[..length]), None, "{length} bytes");
        }
        let mut huge = bytes.clone();
        huge[24..32].fill(0xff);
        assert_eq!(Saved::of(&huge), None);
    }
}
