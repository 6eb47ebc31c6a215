//! Faults in programs: what goes wrong, and what a fault-free simulator makes of it.

use pe_ir::index::{PeId, PortId};
use pe_ir::program::{ControlWord, Layout, LinkSource, Note, PeProgram, Program};
use pe_sim::machine::Machine;
use pe_sim::trace::TraceLine;
use rand::{Rng, RngExt};

/// A part of an operation that is executed one control word too late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Late {
    Write,
    Receive,
    Close,
}

/// A memory of a PE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    Own,
    Base,
    Coefficient,
    Imported,
}

impl Memory {
    fn image(self, pe: &mut PeProgram) -> &mut Vec<i64> {
        match self {
            Memory::Own => &mut pe.own_image,
            Memory::Base => &mut pe.base_image,
            Memory::Coefficient => &mut pe.coefficient_image,
            Memory::Imported => &mut pe.imported_image,
        }
    }
}

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A bit of a control word is inverted.
    ProgramBit { pe: PeId, word: usize, bit: u32 },
    /// Bits of an initial word of a memory are inverted.
    Image { pe: PeId, memory: Memory, index: usize, mask: i64 },
    /// Two input ports of a PE are swapped.
    SwappedPorts { pe: PeId, ports: (usize, usize) },
    /// A port is joined to another PE.
    OtherSource { pe: PeId, port: PortId, source: PeId },
    /// Something happens one word later.
    Latency { pe: PeId, word: usize, late: Late },
}

/// Kinds of faults, drawn evenly.
pub const KINDS: [&str; 4] = ["program bit", "image word", "link", "latency"];

impl Fault {
    /// Name of its kind.
    pub fn kind(&self) -> &'static str {
        match self {
            Fault::ProgramBit { .. } => KINDS[0],
            Fault::Image { .. } => KINDS[1],
            Fault::SwappedPorts { .. } | Fault::OtherSource { .. } => KINDS[2],
            Fault::Latency { .. } => KINDS[3],
        }
    }

    /// A random fault of a kind that the datasheet gives a meaning; indices beyond a list have none.
    pub fn random(kind: &str, program: &Program, rng: &mut impl Rng) -> Fault {
        loop {
            let pe = PeId::at(rng.random_range(0..program.pes.len()));
            let fault = match kind {
                "program bit" => Fault::random_bit(program, pe, rng),
                "image word" => Fault::random_image(program, pe, rng),
                "link" => Fault::random_link(program, pe, rng),
                _ => Fault::random_latency(program, pe, rng),
            };
            if let Some(fault) = fault {
                return fault;
            }
        }
    }

    fn random_bit(program: &Program, pe: PeId, rng: &mut impl Rng) -> Option<Fault> {
        let features = &program.pes[pe].features;
        let layout = Layout::new(features, &program.format);
        let word = rng.random_range(0..program.period as usize);
        let bit = rng.random_range(0..layout.bits);
        let after = flipped(program, pe, word, bit);
        let shift = usize::from(after.shift) < features.shifts.len();
        let port = after.receive.is_none_or(|(port, _)| program.pes[pe].ports.find(port).is_some());
        let one_operand = after.own.is_none() || after.imported.is_none();
        (shift && port && one_operand).then_some(Fault::ProgramBit { pe, word, bit })
    }

    fn random_image(program: &Program, pe: PeId, rng: &mut impl Rng) -> Option<Fault> {
        let memory = [Memory::Own, Memory::Base, Memory::Coefficient, Memory::Imported][rng.random_range(0..4)];
        let format = &program.format;
        let bits = match memory {
            Memory::Own | Memory::Imported => format.data_bits,
            Memory::Base => format.word_bits(),
            Memory::Coefficient => format.coefficient_bits,
        };
        let words = memory.image(&mut program.pes[pe].clone()).len();
        // The top bit may stay: its change would still be a legal word, but often one that saturates everything.
        (words > 0).then(|| {
            let (index, mask) = (rng.random_range(0..words), 1 << rng.random_range(0..bits - 1));
            Fault::Image { pe, memory, index, mask }
        })
    }

    fn random_link(program: &Program, pe: PeId, rng: &mut impl Rng) -> Option<Fault> {
        let ports = &program.pes[pe].ports;
        if ports.is_empty() {
            return None;
        }
        let position = rng.random_range(0..ports.len());
        if rng.random_bool(0.5) {
            let other = rng.random_range(0..ports.len());
            (position != other).then_some(Fault::SwappedPorts { pe, ports: (position, other) })
        } else {
            let port = PortId::at(position);
            let source = PeId::new(rng.random_range(0..program.pes.len() as u32));
            let sends = program.pes[source].features.send;
            (sends && ports[port] != LinkSource::Pe(source)).then_some(Fault::OtherSource { pe, port, source })
        }
    }

    fn random_latency(program: &Program, pe: PeId, rng: &mut impl Rng) -> Option<Fault> {
        let word = rng.random_range(0..program.period as usize);
        let late = [Late::Write, Late::Receive, Late::Close][rng.random_range(0..3)];
        let (from, to) = (program.pes[pe].words[word], program.pes[pe].words[(word + 1) % program.period as usize]);
        // Two operations in one word would be two faults.
        let movable = match late {
            Late::Write => (from.write.is_some() || from.send) && to.write.is_none() && !to.send,
            Late::Receive => from.receive.is_some() && to.receive.is_none(),
            Late::Close => from.close && !to.close,
        };
        movable.then_some(Fault::Latency { pe, word, late })
    }

    /// The program with the fault. Its notes stay: they say what was meant.
    pub fn inject(&self, program: &Program) -> Program {
        let mut faulty = program.clone();
        match *self {
            Fault::ProgramBit { pe, word, bit } => faulty.pes[pe].words[word] = flipped(program, pe, word, bit),
            Fault::Image { pe, memory, index, mask } => memory.image(&mut faulty.pes[pe])[index] ^= mask,
            Fault::SwappedPorts { pe, ports: (a, b) } => faulty.pes[pe].ports.swap(a, b),
            Fault::OtherSource { pe, port, source } => faulty.pes[pe].ports[port] = LinkSource::Pe(source),
            Fault::Latency { pe, word, late } => {
                let next = (word + 1) % program.period as usize;
                let words = &mut faulty.pes[pe].words;
                let from = words[word];
                match late {
                    Late::Write => {
                        (words[next].write, words[next].send) = (from.write, from.send);
                        (words[word].write, words[word].send) = (None, false);
                    }
                    Late::Receive => {
                        words[next].receive = from.receive;
                        words[word].receive = None;
                    }
                    Late::Close => {
                        words[next].close = true;
                        words[word].close = false;
                    }
                }
            }
        }
        faulty
    }
}

/// A control word with one of its bits inverted.
fn flipped(program: &Program, pe: PeId, word: usize, bit: u32) -> ControlWord {
    let layout = Layout::new(&program.pes[pe].features, &program.format);
    layout.decode(layout.encode(&program.pes[pe].words[word]) ^ (1 << bit))
}

/// Everything that can be seen of a run: memory writes in the order of execution, outputs, flag.
///
/// Apart from `engines::simulate`, which the comparison under test is fed with.
pub fn observe(program: &Program, stimulus: &[Vec<i64>]) -> (Vec<TraceLine>, Vec<Vec<i64>>, bool) {
    let bits: Vec<Vec<u128>> = program
        .pes
        .iter()
        .map(|pe| {
            let layout = Layout::new(&pe.features, &program.format);
            pe.words.iter().map(|word| layout.encode(word)).collect()
        })
        .collect();
    let mut machine = Machine::with_bits(program, &bits);
    let mut writes = Vec::new();
    let mut outputs = Vec::new();
    for inputs in stimulus {
        machine.step(inputs, &mut |line| writes.push(line));
        outputs.push(machine.outputs().to_vec());
    }
    (writes, outputs, machine.overflow())
}

/// Words of a program that carry a note, for tests that break one.
pub fn noted(program: &Program, which: impl Fn(&Note) -> bool) -> Vec<(PeId, usize)> {
    let words = |(index, pe): (PeId, &pe_ir::program::PeProgram)| {
        let matching = pe.notes.iter().enumerate().filter(|(_, note)| which(note));
        matching.map(move |(word, _)| (index, word)).collect::<Vec<_>>()
    };
    program.pes.numbered().flat_map(words).collect()
}
