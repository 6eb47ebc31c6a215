//! Random choices that are the same on every machine.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// A random index below `count`, which must not be 0.
pub(super) fn below(rng: &mut ChaCha8Rng, count: usize) -> usize {
    ((u64::from(rng.next_u32()) * count as u64) >> 32) as usize
}
