//! What of a network was at work in a run, told from the data: an item counts when another value of it would have
//! made a difference that a register or a memory word of the network shows.

use pe_ir::program::{Address, FieldName, Program};
use pe_ir::word::round_shift;

/// Memories of a PE, in the order of [`PeCoverage::read`] and [`PeCoverage::written`].
pub const MEMORIES: [&str; 5] = ["own", "base", "coefficient", "imported", "index"];

/// Positions in [`MEMORIES`].
pub(crate) const OWN: usize = 0;
pub(crate) const BASE: usize = 1;
pub(crate) const COEFFICIENT: usize = 2;
pub(crate) const IMPORTED: usize = 3;
pub(crate) const INDEX: usize = 4;

/// What was at work in one PE.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PeCoverage {
    /// For each control word a bit per [`FieldName`].
    pub fields: Vec<u32>,
    /// Words of each memory that were read with effect.
    pub read: [Vec<bool>; 5],
    /// Words of each memory whose content changed.
    pub written: [Vec<bool>; 5],
    /// Ports through which a word came that was another one than the memory word held.
    pub ports: Vec<bool>,
    /// Shifts of sums that were not 0.
    pub shifts: Vec<bool>,
    /// Whether a result saturated: below, above.
    pub saturated: [bool; 2],
    /// Whether operands of the pre-adder were too large for their sum.
    pub too_large: bool,
}

/// What was at work in a network.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// PE by PE.
    pub pes: Vec<PeCoverage>,
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
}

/// Bit of a field in [`PeCoverage::fields`].
pub fn bit(field: FieldName) -> u32 {
    1 << field as u32
}

impl Coverage {
    /// Nothing at work yet.
    pub fn none(program: &Program) -> Coverage {
        let pe = |pe: &pe_ir::program::PeProgram| {
            let features = &pe.features;
            let depths = [
                features.own_words,
                features.base_words,
                features.coefficient_words,
                features.imported_words,
                features.index_words,
            ];
            let words = depths.map(|depth| vec![false; depth as usize]);
            PeCoverage {
                fields: vec![0; program.period as usize],
                read: words.clone(),
                written: words,
                ports: vec![false; pe.ports.len()],
                shifts: vec![false; features.shifts.len()],
                saturated: [false; 2],
                too_large: false,
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
        }
    }

    /// All that the control words of a program can have at work, whatever the data. Fields without effect are no items.
    pub fn of_program(program: &Program) -> Coverage {
        let mut coverage = Coverage::none(program);
        let format = &program.format;
        let used = used_results(program);
        for ((pe, cover), used) in program.pes.iter().zip(&mut coverage.pes).zip(used) {
            let features = &pe.features;
            let places = |address: Address, depth: usize| {
                let word = usize::from(address.word);
                [word, if address.swap { word ^ (depth / 2) } else { word }]
            };
            let mut kept = vec![false; pe.base_image.len()];
            let targets = pe.words.iter().filter_map(|word| word.write).filter(|target| target.base);
            targets.for_each(|target| kept[features.base_word(target.address.word)] = true);
            for (k, word) in pe.words.iter().enumerate() {
                let mut fields = 0;
                let mut operand = |address: Option<Address>, names: [FieldName; 3], memory: usize| {
                    let Some(address) = address else { return };
                    let depth = cover.read[memory].len();
                    fields |= bit(names[0]) | bit(names[1]) | if address.swap { bit(names[2]) } else { 0 };
                    places(address, depth).iter().for_each(|word| cover.read[memory][*word] = true);
                };
                operand(word.own, [FieldName::OwnEnable, FieldName::OwnAddress, FieldName::OwnSwap], OWN);
                let imported = [FieldName::ImportedEnable, FieldName::ImportedAddress, FieldName::ImportedSwap];
                operand(word.imported, imported, IMPORTED);
                if word.own.is_some() || word.imported.is_some() {
                    fields |= match word.multiplier {
                        pe_ir::program::Multiplier::Coefficient(_) => bit(FieldName::Coefficient),
                        pe_ir::program::Multiplier::Stored(address) => {
                            cover.read[COEFFICIENT][usize::from(address)] = true;
                            bit(FieldName::CoefficientAddress)
                        }
                    };
                }
                if word.close {
                    fields |= bit(FieldName::Close);
                }
                let before = &pe.words[(k + pe.words.len() - 1) % pe.words.len()];
                if used[k] {
                    if let Some(base) = word.base {
                        let indexed = before.index.is_some();
                        let entries = if indexed { features.segments().count() } else { 1 };
                        (0..entries).for_each(|entry| cover.read[BASE][usize::from(base) | entry] = true);
                        // A constant that is what a disabled base adds anyway needs no enable.
                        let word = usize::from(base);
                        let needless = !indexed && !kept[word] && pe.base_image[word] == format.data_offset();
                        fields |= bit(FieldName::BaseAddress);
                        fields |= if needless { 0 } else { bit(FieldName::BaseEnable) };
                    }
                    fields |= bit(FieldName::Shift);
                    cover.shifts[usize::from(word.shift)] = true;
                    cover.saturated = [!features.proven; 2];
                }
                if let Some(index) = word.index {
                    fields |= bit(FieldName::IndexEnable) | bit(FieldName::IndexAddress);
                    cover.read[INDEX][usize::from(index)] = true;
                }
                if let Some(target) = word.write {
                    fields |= bit(FieldName::WriteAddress);
                    if target.own {
                        fields |= bit(FieldName::WriteOwn);
                        fields |= if target.address.swap { bit(FieldName::WriteSwap) } else { 0 };
                        let depth = cover.written[OWN].len();
                        places(target.address, depth).iter().for_each(|word| {
                            cover.written[OWN][word & (depth - 1)] = true;
                        });
                    }
                    if target.base && (!features.base_last || program.ends_step(k as u32)) {
                        fields |= bit(FieldName::WriteBase);
                        cover.written[BASE][features.base_word(target.address.word)] = true;
                    }
                    if target.factor {
                        fields |= bit(FieldName::WriteFactor);
                        cover.written[COEFFICIENT][features.factor_word(target.address.word)] = true;
                    }
                }
                if let Some((index, octaves)) = word.write_index {
                    fields |= bit(FieldName::WriteIndex) | bit(FieldName::WriteIndexAddress);
                    fields |= if octaves { bit(FieldName::WriteOctave) } else { 0 };
                    cover.written[INDEX][usize::from(index)] = true;
                }
                if word.send {
                    fields |= bit(FieldName::Send);
                }
                if let Some((port, address)) = word.receive {
                    fields |= bit(FieldName::ReceiveEnable) | bit(FieldName::ReceiveAddress);
                    fields |= if pe.ports.len() > 1 { bit(FieldName::Port) } else { 0 };
                    fields |= if address.swap { bit(FieldName::ReceiveSwap) } else { 0 };
                    let depth = cover.written[IMPORTED].len();
                    places(address, depth).iter().for_each(|word| cover.written[IMPORTED][*word] = true);
                    cover.ports[usize::from(port)] = true;
                }
                let joins = features.pre_adder && word.own.is_some() && word.imported.is_some();
                cover.too_large |= joins && !features.proven;
                cover.fields[k] = fields;
            }
        }
        let all = u64::MAX >> (64 - format.storage_bits);
        coverage.inputs.fill([all; 2]);
        coverage.outputs.fill([all; 2]);
        let largest = (1i64 << (format.storage_bits - 1)) - 1;
        let clamps = (i128::from(largest) << format.guard_bits) + i128::from(format.data_offset());
        coverage.clamped.fill(clamps > i128::from(format.max_word()));
        let pes = coverage.pes.iter().map(|pe| pe.saturated != [false; 2] || pe.too_large);
        coverage.raised = pes.chain(coverage.clamped.iter().copied()).collect();
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
            pe.read.iter_mut().zip(&from.read).for_each(|(to, from)| flags(to, from));
            pe.written.iter_mut().zip(&from.written).for_each(|(to, from)| flags(to, from));
            flags(&mut pe.ports, &from.ports);
            flags(&mut pe.shifts, &from.shifts);
            flags(&mut pe.saturated, &from.saturated);
            pe.too_large |= from.too_large;
        }
        bits(&mut self.inputs, &other.inputs);
        bits(&mut self.outputs, &other.outputs);
        flags(&mut self.clamped, &other.clamped);
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
        let pe = |pe: &PeCoverage| set(&pe.saturated) + u64::from(pe.too_large);
        self.pes.iter().map(pe).sum::<u64>() + set(&self.clamped) + set(&self.raised)
    }
}

fn set(flags: &[bool]) -> u64 {
    flags.iter().filter(|flag| **flag).count() as u64
}

/// For each PE and control word, whether anything takes the result whose base and shift the word chooses.
pub(crate) fn used_results(program: &Program) -> Vec<Vec<bool>> {
    let delay = program.latency().scale_to_write() as usize;
    let period = program.period as usize;
    let used = |(index, pe): (usize, &pe_ir::program::PeProgram)| {
        let captured = |k: usize| program.outputs.iter().any(|o| (o.pe as usize, o.word as usize) == (index, k));
        let taken: Vec<bool> = (0..period)
            .map(|k| {
                let word = &pe.words[k];
                word.write.is_some() || word.write_index.is_some() || word.send || captured(k)
            })
            .collect();
        (0..period).map(|k| taken[(k + delay) % period]).collect()
    };
    program.pes.iter().enumerate().map(used).collect()
}

/// Whether another of the shifts would have given another result.
pub(crate) fn shift_matters(lifted: i128, shift: u8, shifts: &[u8]) -> bool {
    let shifted = |shift: u8| match i64::try_from(lifted) {
        Ok(sum) => i128::from(round_shift(sum, u32::from(shift))),
        Err(_) => lifted >> shift,
    };
    lifted != 0
        && (shifts.len() == 1 || shifts.iter().any(|other| *other != shift && shifted(*other) != shifted(shift)))
}
