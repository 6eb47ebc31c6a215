//! Limits of a PE that follow from the widths of control-word fields.

use std::fmt;

use pe_ir::program::Layout;

/// Words of a memory that an address of 16 bits reaches.
const MOST_WORDS: u32 = 1 << 16;

/// Input ports of a PE that a port number of 8 bits tells apart.
const MOST_PORTS: u32 = 1 << 8;

/// A PE that would need more than can be told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge {
    pe: usize,
    count: u32,
    most: u32,
    what: &'static str,
    remedy: &'static str,
}

impl fmt::Display for TooLarge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TooLarge { pe, count, most, what, remedy } = self;
        write!(f, "PE {pe} would need {count} {what}, of which a PE can have {most}; use {remedy}")
    }
}

impl std::error::Error for TooLarge {}

/// Refuses the first PE beyond a limit, by the own, base, imported and index words, the ports, the coefficients and
/// the bits of a control word of each.
pub(super) fn check(sizes: impl Iterator<Item = [u32; 7]>) -> Result<(), TooLarge> {
    const MORE_PES: &str = "more PEs with `--pes`";
    for (pe, [own, base, imported, indices, ports, coefficients, bits]) in sizes.enumerate() {
        let limits = [
            (own, MOST_WORDS, "words of its own memory", MORE_PES),
            (base, MOST_WORDS, "words of its base memory", MORE_PES),
            (imported, MOST_WORDS, "words of its imported memory", MORE_PES),
            (indices, MOST_WORDS, "words of its index memory", MORE_PES),
            (ports, MOST_PORTS, "input ports", "a smaller `--max-in-degree`"),
            (coefficients, MOST_WORDS, "stored coefficients", MORE_PES),
            (bits, Layout::MOST_BITS, "bits of a control word", MORE_PES),
        ];
        if let Some((count, most, what, remedy)) = limits.into_iter().find(|(count, most, ..)| count > most) {
            return Err(TooLarge { pe, count, most, what, remedy });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memories_and_ports_beyond_the_addresses_are_refused_with_a_remedy() {
        let refusal = |sizes: [u32; 7]| check([[4; 7], sizes].into_iter()).map_err(|limit| limit.to_string());
        assert_eq!(refusal([1 << 16, 1 << 16, 1 << 16, 1 << 16, 256, 1 << 16, 128]), Ok(()));
        let words = "PE 1 would need 131072 words of its own memory, of which a PE can have 65536; \
                     use more PEs with `--pes`";
        assert_eq!(refusal([1 << 17, 4, 4, 4, 1, 4, 4]), Err(words.to_owned()));
        let ports = "PE 1 would need 257 input ports, of which a PE can have 256; use a smaller `--max-in-degree`";
        assert_eq!(refusal([4, 4, 4, 4, 257, 4, 4]), Err(ports.to_owned()));
        let bits = "PE 1 would need 129 bits of a control word, of which a PE can have 128; use more PEs with `--pes`";
        assert_eq!(refusal([4, 4, 4, 4, 1, 4, 129]), Err(bits.to_owned()));
    }
}
