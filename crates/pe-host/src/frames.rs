//! Messages between a host and a server, on lines that may lose or change bytes.
//!
//! A frame is a body and its CRC-32, stuffed so that no byte is zero, and a zero at its end (consistent overhead byte
//! stuffing). Whatever is lost, the next zero begins anew. `docs/host.md` has the layout of the bodies; numbers are little
//! endian.

use crate::bus::Op;

/// Version of the messages.
pub(crate) const PROTOCOL: u8 = 2;

/// Most accesses in a message.
pub(crate) const MOST_OPS: usize = 1024;

/// The bytes of a frame, with the zero at its end.
pub(crate) fn frame(body: &[u8]) -> Vec<u8> {
    let mut bytes = body.to_vec();
    bytes.extend_from_slice(&crc32fast::hash(body).to_le_bytes());
    let mut stuffed = Vec::with_capacity(bytes.len() + bytes.len() / 254 + 2);
    // Each block is its length plus one, and up to 254 bytes that are not zero; a shorter one stands for a zero behind it.
    for (index, run) in bytes.split(|byte| *byte == 0).enumerate() {
        debug_assert!(index == 0 || !stuffed.is_empty());
        let mut blocks = run.chunks(254).peekable();
        if blocks.peek().is_none() {
            stuffed.push(1);
        }
        while let Some(block) = blocks.next() {
            stuffed.push(block.len() as u8 + 1);
            stuffed.extend_from_slice(block);
            if block.len() == 254 && blocks.peek().is_none() {
                stuffed.push(1);
            }
        }
    }
    stuffed.push(0);
    stuffed
}

/// The body of a frame without the zero at its end; none if it is damaged.
pub(crate) fn body(mut stuffed: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(stuffed.len());
    while let Some((code, rest)) = stuffed.split_first() {
        let length = usize::from(*code).checked_sub(1)?;
        let (block, rest) = rest.split_at_checked(length)?;
        bytes.extend_from_slice(block);
        if *code < 255 && !rest.is_empty() {
            bytes.push(0);
        }
        stuffed = rest;
    }
    let check = bytes.split_off(bytes.len().checked_sub(4)?);
    (crc32fast::hash(&bytes).to_le_bytes() == check[..]).then_some(bytes)
}

/// What a host asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Request {
    /// Who is there; forgets what was asked before.
    Hello,
    /// Accesses.
    Access(Vec<Op>),
}

/// What a server answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// Words that were read; to [`Request::Hello`] the version of the messages and whether the hardware is simulated.
    Words(Vec<u32>),
    /// The bus answers an access to this address by an error.
    Refused(u32),
    /// What was received is damaged: ask again.
    Again,
    /// It failed.
    Failed(String),
}

impl Request {
    /// The body, with a number by which a repetition is known.
    pub(crate) fn body(&self, number: u8) -> Vec<u8> {
        let Request::Access(ops) = self else { return vec![number, 0] };
        let mut bytes = vec![number, 1];
        let mut at = 0;
        while at < ops.len() {
            // Accesses to words that follow each other share an address.
            let run = |same: fn(&Op) -> Option<u32>| {
                let first = same(&ops[at])?;
                let follows = |(index, op): &(usize, &Op)| same(op) == Some(first.wrapping_add(4 * *index as u32));
                Some((first, ops[at..].iter().enumerate().take_while(follows).count()))
            };
            let read = |op: &Op| if let Op::Read(address) = op { Some(*address) } else { None };
            let write = |op: &Op| if let Op::Write(address, _) = op { Some(*address) } else { None };
            let count = match (run(read), run(write), ops[at]) {
                (Some((address, count)), ..) => {
                    bytes.push(0);
                    bytes.extend_from_slice(&address.to_le_bytes());
                    bytes.extend_from_slice(&(count as u16).to_le_bytes());
                    count
                }
                (_, Some((address, count)), _) => {
                    bytes.push(1);
                    bytes.extend_from_slice(&address.to_le_bytes());
                    bytes.extend_from_slice(&(count as u16).to_le_bytes());
                    let words = ops[at..at + count].iter();
                    words.for_each(|op| bytes.extend_from_slice(&written(op).to_le_bytes()));
                    count
                }
                (.., Op::Poll { address, mask, set, clocks }) => {
                    bytes.push(2 + u8::from(set));
                    [address, mask, clocks].iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
                    1
                }
                // A read or write is a run of one.
                _ => 1,
            };
            at += count;
        }
        bytes
    }

    /// Number and request of a body; none if it is not one.
    pub(crate) fn read(body: &[u8]) -> Option<(u8, Request)> {
        let mut reader = Reader(body);
        let number = reader.byte()?;
        match reader.byte()? {
            0 => reader.0.is_empty().then_some((number, Request::Hello)),
            1 => {
                let mut ops = Vec::new();
                while let Some(kind) = reader.byte() {
                    let address = reader.word()?;
                    match kind {
                        0 | 1 => {
                            let count = reader.half()?;
                            for index in 0..u32::from(count) {
                                let place = address.wrapping_add(4 * index);
                                ops.push(if kind == 0 { Op::Read(place) } else { Op::Write(place, reader.word()?) });
                            }
                        }
                        2 | 3 => {
                            let (mask, clocks) = (reader.word()?, reader.word()?);
                            ops.push(Op::Poll { address, mask, set: kind == 3, clocks });
                        }
                        _ => return None,
                    }
                    if ops.len() > MOST_OPS {
                        return None;
                    }
                }
                Some((number, Request::Access(ops)))
            }
            _ => None,
        }
    }
}

fn written(op: &Op) -> u32 {
    if let Op::Write(_, word) = op { *word } else { 0 }
}

impl Answer {
    /// The body, with the number of what it answers.
    pub(crate) fn body(&self, number: u8) -> Vec<u8> {
        let mut bytes = vec![number];
        match self {
            Answer::Words(words) => {
                bytes.push(0);
                words.iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
            }
            Answer::Refused(address) => {
                bytes.push(1);
                bytes.extend_from_slice(&address.to_le_bytes());
            }
            Answer::Again => bytes.push(2),
            Answer::Failed(what) => {
                bytes.push(3);
                bytes.extend_from_slice(what.as_bytes());
            }
        }
        bytes
    }

    /// Number and answer of a body; none if it is not one.
    pub(crate) fn read(body: &[u8]) -> Option<(u8, Answer)> {
        let mut reader = Reader(body);
        let (number, kind) = (reader.byte()?, reader.byte()?);
        let answer = match kind {
            0 => {
                let words = reader.0.chunks(4).map(|chunk| Some(u32::from_le_bytes(chunk.try_into().ok()?)));
                Answer::Words(words.collect::<Option<Vec<u32>>>()?)
            }
            1 => Answer::Refused(reader.word()?),
            2 => Answer::Again,
            3 => Answer::Failed(String::from_utf8_lossy(reader.0).into_owned()),
            _ => return None,
        };
        Some((number, answer))
    }
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }

    fn byte(&mut self) -> Option<u8> {
        Some(u8::from_le_bytes(self.take()?))
    }

    fn half(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.take()?))
    }

    fn word(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that look random.
    fn bytes(seed: u32, count: usize) -> Vec<u8> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        // Half of them zero in some, none in others.
        (0..count)
            .map(|_| if seed.is_multiple_of(3) && next() < 128 { 0 } else { next() | u8::from(seed.is_multiple_of(3)) })
            .collect()
    }

    #[test]
    fn frames_bring_back_every_body_and_hold_no_zero() {
        for count in (0..20).chain(248..260).chain(500..515) {
            for seed in 0..12 {
                let original = bytes(seed, count);
                let framed = frame(&original);
                let (last, stuffed) = framed.split_last().unwrap();
                assert!(*last == 0 && !stuffed.contains(&0));
                assert_eq!(body(stuffed), Some(original), "{count} bytes, seed {seed}");
            }
        }
    }

    #[test]
    fn every_changed_or_missing_byte_is_noticed() {
        for seed in 0..6 {
            let framed = frame(&bytes(seed, 40));
            let stuffed = &framed[..framed.len() - 1];
            for at in 0..stuffed.len() {
                for change in [1_u8, 0x80, 0xFF] {
                    let mut damaged = stuffed.to_vec();
                    damaged[at] ^= change;
                    assert_eq!(body(&damaged), None, "byte {at}");
                }
                assert_eq!(body(&[&stuffed[..at], &stuffed[at + 1..]].concat()), None, "without byte {at}");
                assert_eq!(body(&stuffed[..at]), None, "the first {at}");
            }
        }
    }

    #[test]
    fn messages_are_read_as_they_were_written() {
        let ops = vec![
            Op::Write(0x800, 1),
            Op::Write(0x804, u32::MAX),
            Op::Write(0x20, 1),
            Op::Poll { address: 0x24, mask: 6, set: true, clocks: 47 },
            Op::Poll { address: 0x24, mask: 1, set: false, clocks: 0 },
            Op::Read(0xC00),
            Op::Read(0xC04),
            Op::Read(0xC0C),
        ];
        for request in [Request::Hello, Request::Access(ops), Request::Access(Vec::new())] {
            assert_eq!(Request::read(&request.body(200)), Some((200, request)));
        }
        let failed = Answer::Failed("no".to_owned());
        for answer in [Answer::Words(vec![1, 0, u32::MAX]), Answer::Refused(0x30), Answer::Again, failed] {
            assert_eq!(Answer::read(&answer.body(3)), Some((3, answer)));
        }
        assert_eq!(Answer::read(&[3, 0, 1, 2]), None);
        assert_eq!(Request::read(&[1, 1, 0, 0, 0, 0, 0, 0xFF, 0xFF]), None, "more than anybody asks for");
    }
}
