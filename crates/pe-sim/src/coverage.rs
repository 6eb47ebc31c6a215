//! Coverage of a network in a run, derived from the data: an item counts if another value of it would have changed a
//! register or a memory word.

use pe_ir::index::{List, PeId, PortId, at, number};
use pe_ir::program::{Address, CoefficientOperand, ControlWord, FieldName, PeFeatures, PeProgram, Program, Target};
use pe_ir::word::round_shift;

/// Memories of a PE, in the order of [`PeCoverage::read`] and [`PeCoverage::written`].
pub const MEMORIES: [&str; 5] = ["own", "base", "coefficient", "imported", "index"];

/// What sets a PE's flag: a word that saturates, by where it goes, and operands; in the order of [`PeCoverage::flagged`].
pub const FLAGGING: [&str; 6] = ["own memory", "base memory", "coefficient memory", "index memory", "link", "operands"];

/// Position in [`FLAGGING`].
pub(crate) const OPERANDS: usize = 5;

/// Position of own memories in [`MEMORIES`].
pub const OWN: usize = 0;
/// Of base memories.
pub const BASE: usize = 1;
/// Of coefficient memories.
pub const COEFFICIENT: usize = 2;
/// Of imported memories.
pub const IMPORTED: usize = 3;
pub(crate) const INDEX: usize = 4;

/// What was at work in one PE.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PeCoverage {
    /// For each control word a bit per [`FieldName`].
    pub fields: Vec<u64>,
    /// Words of each memory that were read at all.
    pub fetched: [Vec<bool>; 5],
    /// Words of each memory that were read with effect.
    pub read: [Vec<bool>; 5],
    /// Words of each memory whose content changed.
    pub written: [Vec<bool>; 5],
    /// Ports through which a word came that was another one than the memory word held.
    pub ports: List<PortId, bool>,
    /// Shifts of sums that were not 0.
    pub shifts: Vec<bool>,
    /// Whether a result saturated: below, above.
    pub saturated: [bool; 2],
    /// Whether operands of the pre-adder were too large for their sum.
    pub too_large: bool,
    /// Whether each of [`FLAGGING`] alone set the flag, so that without it the flag would not have risen, or later.
    pub flagged: [bool; FLAGGING.len()],
    /// Control words whose result nothing takes, and would have set the flag of a PE with a link if it had been sent.
    pub unsent: Vec<bool>,
}

/// Memory words that an address names, whatever the roles of the buffers.
fn places(address: Address, depth: usize) -> [usize; 2] {
    let word = usize::from(address.word);
    [word, if address.swap { word ^ (depth / 2) } else { word }]
}

/// The bits beside an address that change it.
fn moved(address: Address, swap: FieldName, ring: FieldName) -> u64 {
    let swapped = if address.swap { bit(swap) } else { 0 };
    swapped | if address.ring { bit(ring) } else { 0 }
}

/// What parts of a control word can have at work: each marks it, and gives the fields.
impl PeCoverage {
    /// Operands, their factor, and the end of a sum.
    fn operands(&mut self, word: &ControlWord) -> u64 {
        let mut fields = 0;
        let mut operand = |address: Option<Address>, names: [FieldName; 4], memory: usize| {
            let Some(address) = address else { return };
            let depth = self.read[memory].len();
            fields |= bit(names[0]) | bit(names[1]) | moved(address, names[2], names[3]);
            places(address, depth).iter().for_each(|word| self.read[memory][*word] = true);
        };
        use FieldName::*;
        operand(word.own, [OwnEnable, OwnAddress, OwnSwap, OwnRing], OWN);
        operand(word.imported, [ImportedEnable, ImportedAddress, ImportedSwap, ImportedRing], IMPORTED);
        if word.own.is_some() || word.imported.is_some() {
            fields |= match word.coefficient {
                CoefficientOperand::Coefficient(_) => bit(FieldName::Coefficient),
                CoefficientOperand::Stored(address) => {
                    self.read[COEFFICIENT][usize::from(address)] = true;
                    bit(FieldName::CoefficientAddress)
                }
            };
        }
        if word.close {
            fields |= bit(FieldName::Close);
        }
        fields
    }

    /// Base and shift of a result that something takes. `kept` tells the base words that are written.
    fn scale(
        &mut self,
        word: &ControlWord,
        indexed: bool,
        (program, pe): (&Program, &PeProgram),
        kept: &[bool],
    ) -> u64 {
        let mut fields = bit(FieldName::Shift);
        if let Some(base) = word.base {
            let entries = if indexed { pe.features.segments().count() } else { 1 };
            let base = usize::from(base);
            (0..entries).for_each(|entry| self.read[BASE][base | entry] = true);
            // A constant that is what a disabled base adds anyway needs no enable.
            let needless = !indexed && !kept[base] && pe.base_image[base] == program.format.data_offset();
            fields |= bit(FieldName::BaseAddress);
            fields |= if needless { 0 } else { bit(FieldName::BaseEnable) };
        }
        self.shifts[usize::from(word.shift)] = true;
        self.saturated = [!pe.features.proven; 2];
        fields
    }

    /// Memories that a result is written to.
    fn write(&mut self, target: Target, features: &PeFeatures, ends_step: bool) -> u64 {
        let mut fields = bit(FieldName::WriteAddress);
        if target.own {
            fields |= bit(FieldName::WriteOwn);
            fields |= moved(target.address, FieldName::WriteSwap, FieldName::WriteRing);
            let depth = self.written[OWN].len();
            let words = places(target.address, depth);
            words.iter().for_each(|word| self.written[OWN][word & (depth - 1)] = true);
        }
        if target.base && (!features.base_last || ends_step) {
            fields |= bit(FieldName::WriteBase);
            self.written[BASE][features.base_word(target.address.word)] = true;
        }
        if target.factor {
            fields |= bit(FieldName::WriteFactor);
            self.written[COEFFICIENT][features.factor_word(target.address.word)] = true;
        }
        fields
    }

    /// The port that is received from, and the imported word.
    fn receive(&mut self, port: PortId, address: Address) -> u64 {
        let mut fields = bit(FieldName::ReceiveEnable) | bit(FieldName::ReceiveAddress);
        fields |= if self.ports.len() > 1 { bit(FieldName::Port) } else { 0 };
        fields |= moved(address, FieldName::ReceiveSwap, FieldName::ReceiveRing);
        let depth = self.written[IMPORTED].len();
        places(address, depth).iter().for_each(|word| self.written[IMPORTED][*word] = true);
        self.ports[port] = true;
        fields
    }
}

/// What was at work in a network.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// PE by PE.
    pub pes: List<PeId, PeCoverage>,
    /// Input ports: bits that were 1, and bits that were 0.
    pub inputs: Vec<[u64; 2]>,
    /// Input ports that took a word beyond the largest operand.
    pub clamped: Vec<bool>,
    /// PEs, then input ports, that alone made the overflow flag rise.
    pub raised: Vec<bool>,
    /// Ticks: whether they were 1 in a step and 0 in another one.
    pub ticks: Vec<[bool; 2]>,
    /// Output ports: bits that were 1, and bits that were 0.
    pub outputs: Vec<[u64; 2]>,
    /// Output ports that clamped a word in range, because rounding took it beyond.
    pub shown_clamped: Vec<bool>,
}

/// Bit of a field in [`PeCoverage::fields`].
pub fn bit(field: FieldName) -> u64 {
    1 << field as u32
}

impl Coverage {
    /// Nothing at work yet.
    pub fn none(program: &Program) -> Coverage {
        let pe = |pe: &PeProgram| {
            let features = &pe.features;
            let depths = [
                features.own_words,
                features.base_words,
                features.coefficient_words,
                features.imported_words,
                features.index_words,
            ];
            let words = depths.map(|depth| vec![false; at(depth)]);
            PeCoverage {
                fields: vec![0; at(program.period)],
                fetched: words.clone(),
                read: words.clone(),
                written: words,
                ports: List::filled(false, pe.ports.len()),
                shifts: vec![false; features.shifts.len()],
                saturated: [false; 2],
                too_large: false,
                flagged: [false; FLAGGING.len()],
                unsent: vec![false; at(program.period)],
            }
        };
        let ports = program.ports().count();
        Coverage {
            pes: program.pes.iter().map(pe).collect(),
            inputs: vec![[0; 2]; ports],
            clamped: vec![false; ports],
            raised: vec![false; program.pes.len() + ports],
            ticks: vec![[false; 2]; program.ticks().count()],
            outputs: vec![[0; 2]; program.outputs.len()],
            shown_clamped: vec![false; program.outputs.len()],
        }
    }

    /// All that the control words of a program can have at work, whatever the data. Fields without effect are no items.
    pub fn of_program(program: &Program) -> Coverage {
        let mut coverage = Coverage::none(program);
        let format = &program.format;
        let used = used_results(program);
        for (((index, pe), cover), used) in program.pes.numbered().zip(&mut coverage.pes).zip(used) {
            cover.fetched.iter_mut().for_each(|words| words.fill(true));
            let mut kept = vec![false; pe.base_image.len()];
            let targets = pe.words.iter().filter_map(|word| word.write).filter(|target| target.base);
            targets.for_each(|target| kept[pe.features.base_word(target.address.word)] = true);
            let causes = flags_of(program, index);
            causes.iter().for_each(|(_, cause)| cover.flagged[*cause] = !pe.features.proven);
            for (k, word) in pe.words.iter().enumerate() {
                let mut fields = cover.operands(word);
                if used[k] {
                    fields |= cover.scale(word, pe.takes_index(k), (program, pe), &kept);
                }
                if let Some(index) = word.index {
                    fields |= bit(FieldName::IndexEnable) | bit(FieldName::IndexAddress);
                    cover.read[INDEX][usize::from(index)] = true;
                }
                if let Some(target) = word.write {
                    fields |= cover.write(target, &pe.features, program.ends_step(number(k)));
                }
                if let Some((index, octaves)) = word.write_index {
                    fields |= bit(FieldName::WriteIndex) | bit(FieldName::WriteIndexAddress);
                    fields |= if octaves { bit(FieldName::WriteOctave) } else { 0 };
                    cover.written[INDEX][usize::from(index)] = true;
                }
                if word.show && (!pe.features.show_last || program.ends_step(number(k))) {
                    fields |= bit(FieldName::Show);
                }
                if word.send {
                    fields |= bit(FieldName::Send);
                }
                if let Some((port, address)) = word.receive {
                    fields |= cover.receive(port, address);
                }
                let joins = pe.features.pre_adder && word.own.is_some() && word.imported.is_some();
                cover.too_large |= joins && !pe.features.proven;
                cover.flagged[OPERANDS] = cover.too_large;
                cover.fields[k] = fields;
            }
        }
        let all = u64::MAX >> (64 - format.storage_bits);
        coverage.inputs.fill([all; 2]);
        coverage.outputs.fill([all; 2]);
        for (cover, pe) in coverage.pes.iter_mut().zip(&program.pes) {
            let untaken = |word: &ControlWord| word.write.is_none() && word.write_index.is_none() && !word.send;
            let flags = pe.features.send && !pe.features.proven;
            cover.unsent = pe.words.iter().map(|word| flags && untaken(word)).collect();
        }
        let largest = (1i64 << (format.storage_bits - 1)) - 1;
        let clamps = (i128::from(largest) << format.guard_bits) + i128::from(format.data_offset());
        coverage.clamped.fill(clamps > i128::from(format.max_word()));
        let pes = coverage.pes.iter().map(|pe| pe.saturated != [false; 2] || pe.too_large);
        coverage.raised = pes.chain(coverage.clamped.iter().copied()).collect();
        // Half an LSB of the port less the offset that stored words carry is added to what is shown.
        let clamps = format.data_offset() != if format.guard_bits == 0 { 0 } else { 1 << (format.guard_bits - 1) };
        coverage.shown_clamped = program.outputs.iter().map(|output| clamps && !output.proven).collect();
        // A tick of one step is always due.
        coverage.ticks = program.ticks().map(|(_, tick, _)| [tick.steps > 1, true]).collect();
        coverage
    }

    /// Adds what was at work in another run.
    pub fn add(&mut self, other: &Coverage) {
        fn flags(to: &mut [bool], from: &[bool]) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to |= from);
        }
        fn bits(to: &mut [[u64; 2]], from: &[[u64; 2]]) {
            to.iter_mut().flatten().zip(from.iter().flatten()).for_each(|(to, from)| *to |= from);
        }
        for (pe, from) in self.pes.iter_mut().zip(&other.pes) {
            pe.fields.iter_mut().zip(&from.fields).for_each(|(to, from)| *to |= from);
            pe.fetched.iter_mut().zip(&from.fetched).for_each(|(to, from)| flags(to, from));
            pe.read.iter_mut().zip(&from.read).for_each(|(to, from)| flags(to, from));
            pe.written.iter_mut().zip(&from.written).for_each(|(to, from)| flags(to, from));
            flags(&mut pe.ports, &from.ports);
            flags(&mut pe.shifts, &from.shifts);
            flags(&mut pe.saturated, &from.saturated);
            pe.too_large |= from.too_large;
            flags(&mut pe.flagged, &from.flagged);
            flags(&mut pe.unsent, &from.unsent);
        }
        bits(&mut self.inputs, &other.inputs);
        bits(&mut self.outputs, &other.outputs);
        flags(&mut self.clamped, &other.clamped);
        flags(&mut self.shown_clamped, &other.shown_clamped);
        flags(&mut self.raised, &other.raised);
        self.ticks.iter_mut().zip(&other.ticks).for_each(|(to, from)| flags(to, from));
    }

    /// Number of items.
    pub fn count(&self) -> u64 {
        let pe = |pe: &PeCoverage| {
            let fields: u64 = pe.fields.iter().map(|fields| u64::from(fields.count_ones())).sum();
            let words: u64 = pe.read.iter().chain(&pe.written).map(|words| set(words)).sum();
            fields + words + set(&pe.ports) + set(&pe.shifts)
        };
        let bits = |ports: &[[u64; 2]]| ports.iter().flatten().map(|bits| u64::from(bits.count_ones())).sum::<u64>();
        let ticks: u64 = self.ticks.iter().map(|tick| set(tick)).sum();
        self.pes.iter().map(pe).sum::<u64>() + bits(&self.inputs) + bits(&self.outputs) + ticks + self.flags()
    }

    /// Number of items that have to do with saturation and flags.
    pub fn flags(&self) -> u64 {
        let pe = |pe: &PeCoverage| set(&pe.saturated) + u64::from(pe.too_large) + set(&pe.flagged);
        let ports = set(&self.clamped) + set(&self.shown_clamped);
        self.pes.iter().map(pe).sum::<u64>() + ports + set(&self.raised)
    }

    /// Number of memory words that were read at all.
    pub fn fetched(&self) -> u64 {
        self.pes.iter().flat_map(|pe| &pe.fetched).map(|words| set(words)).sum()
    }

    /// Number of control words whose result nothing takes, and would have set a flag.
    pub fn unsent(&self) -> u64 {
        self.pes.iter().map(|pe| set(&pe.unsent)).sum()
    }
}

/// The words of a PE whose result, if it saturates, sets the flag by one of [`FLAGGING`] alone, and which one that is.
pub fn flags_of(program: &Program, pe: PeId) -> Vec<(usize, usize)> {
    let pe = &program.pes[pe];
    let cause = |(k, word): (usize, &ControlWord)| {
        let rests = pe.features.base_last && !program.ends_step(number(k));
        Some((k, alone(takes(word, rests, false))?))
    };
    pe.words.iter().enumerate().filter_map(cause).collect()
}

/// Which of [`FLAGGING`] take the result in the write group of a word.
pub(crate) fn takes(word: &ControlWord, base_rests: bool, too_large: bool) -> [bool; FLAGGING.len()] {
    let target = |of: fn(&Target) -> bool| word.write.as_ref().is_some_and(of);
    let base = target(|target| target.base) && !base_rests;
    let [own, factor] = [target(|target| target.own), target(|target| target.factor)];
    [own, base, factor, word.write_index.is_some(), word.send, too_large]
}

/// The only one that is set, if it is.
pub(crate) fn alone(set: [bool; FLAGGING.len()]) -> Option<usize> {
    let mut positions = (0..set.len()).filter(|position| set[*position]);
    positions.next().filter(|_| positions.next().is_none())
}

fn set(flags: &[bool]) -> u64 {
    flags.iter().filter(|flag| **flag).count() as u64
}

/// For each PE and control word, whether anything takes the result whose base and shift the word chooses.
pub(crate) fn used_results(program: &Program) -> List<PeId, Vec<bool>> {
    let delay = at(program.latency().scale_to_write());
    let period = at(program.period);
    let used = |(index, pe): (PeId, &PeProgram)| {
        let captured = |k: usize| program.outputs.iter().any(|o| (o.pe, at(o.word)) == (index, k));
        let taken: Vec<bool> = (0..period)
            .map(|k| {
                let word = &pe.words[k];
                word.write.is_some() || word.write_index.is_some() || word.send || captured(k)
            })
            .collect();
        (0..period).map(|k| taken[(k + delay) % period]).collect()
    };
    program.pes.numbered().map(used).collect()
}

/// Whether another of the shifts would have given another result.
pub(crate) fn shift_matters(wide: i128, shift: u8, shifts: &[u8]) -> bool {
    let shifted = |shift: u8| match i64::try_from(wide) {
        Ok(sum) => i128::from(round_shift(sum, u32::from(shift))),
        Err(_) => wide >> shift,
    };
    wide != 0 && (shifts.len() == 1 || shifts.iter().any(|other| *other != shift && shifted(*other) != shifted(shift)))
}
