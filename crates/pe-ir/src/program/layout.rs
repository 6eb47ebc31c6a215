//! Bit layout of the control word, derived from a PE's features.

use super::{Address, CoefficientOperand, ControlWord, PeFeatures, Target};
use crate::index::{PortId, number};
use crate::word::WordFormat;

/// Fields of a control word, from the most significant end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs)]
pub enum FieldName {
    Variant,
    OwnEnable,
    OwnSwap,
    OwnRing,
    OwnAddress,
    ImportedEnable,
    ImportedSwap,
    ImportedRing,
    ImportedAddress,
    Coefficient,
    CoefficientAddress,
    Close,
    BaseEnable,
    BaseAddress,
    IndexEnable,
    IndexAddress,
    Shift,
    WriteOwn,
    WriteBase,
    WriteFactor,
    WriteSwap,
    WriteRing,
    WriteAddress,
    WriteIndex,
    WriteOctave,
    WriteIndexAddress,
    Show,
    Send,
    ReceiveEnable,
    ReceiveSwap,
    ReceiveRing,
    ReceiveAddress,
    Port,
}

impl FieldName {
    /// All of them that a control word has.
    pub const ALL: [FieldName; 32] = {
        use FieldName::*;
        [
            OwnEnable,
            OwnSwap,
            OwnRing,
            OwnAddress,
            ImportedEnable,
            ImportedSwap,
            ImportedRing,
            ImportedAddress,
            Coefficient,
            CoefficientAddress,
            Close,
            BaseEnable,
            BaseAddress,
            IndexEnable,
            IndexAddress,
            Shift,
            WriteOwn,
            WriteBase,
            WriteFactor,
            WriteSwap,
            WriteRing,
            WriteAddress,
            WriteIndex,
            WriteOctave,
            WriteIndexAddress,
            Show,
            Send,
            ReceiveEnable,
            ReceiveSwap,
            ReceiveRing,
            ReceiveAddress,
            Port,
        ]
    };

    /// Name in the datasheet and in program listings.
    pub fn text(self) -> &'static str {
        use FieldName::*;
        match self {
            Variant => "variant",
            OwnEnable => "own_enable",
            OwnSwap => "own_swap",
            OwnRing => "own_ring",
            OwnAddress => "own_address",
            ImportedEnable => "imported_enable",
            ImportedSwap => "imported_swap",
            ImportedRing => "imported_ring",
            ImportedAddress => "imported_address",
            Coefficient => "coefficient",
            CoefficientAddress => "coefficient_address",
            Close => "close",
            BaseEnable => "base_enable",
            BaseAddress => "base_address",
            IndexEnable => "index_enable",
            IndexAddress => "index_address",
            Shift => "shift",
            WriteOwn => "write_own",
            WriteBase => "write_base",
            WriteFactor => "write_factor",
            WriteSwap => "write_swap",
            WriteRing => "write_ring",
            WriteAddress => "write_address",
            WriteIndex => "write_index",
            WriteOctave => "write_octave",
            WriteIndexAddress => "write_index_address",
            Show => "show",
            Send => "send",
            ReceiveEnable => "receive_enable",
            ReceiveSwap => "receive_swap",
            ReceiveRing => "receive_ring",
            ReceiveAddress => "receive_address",
            Port => "port",
        }
    }
}

/// The fields of an operand, and of a word that is received.
const OWN: [FieldName; 4] = [FieldName::OwnEnable, FieldName::OwnSwap, FieldName::OwnRing, FieldName::OwnAddress];
const IMPORTED: [FieldName; 4] =
    [FieldName::ImportedEnable, FieldName::ImportedSwap, FieldName::ImportedRing, FieldName::ImportedAddress];
const RECEIVE: [FieldName; 4] =
    [FieldName::ReceiveEnable, FieldName::ReceiveSwap, FieldName::ReceiveRing, FieldName::ReceiveAddress];

/// One field that is present.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Which field.
    pub name: FieldName,
    /// Width in bits, at least 1.
    pub width: u32,
    /// Position of its least significant bit.
    pub lsb: u32,
}

/// The control-word layout of a PE: the fields that its features need, most significant first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Present fields.
    pub fields: Vec<Field>,
    /// Width of the control word.
    pub bits: u32,
    /// Width and place of each field by its name; width 0 where it is absent. Programs of large networks have millions of
    /// words to pack and unpack.
    places: [(u32, u32); FieldName::Port as usize + 1],
    /// The bits of each field by its name.
    masks: [u128; FieldName::Port as usize + 1],
}

/// Bits that count `n` things: `ceil(log2 n)`.
pub fn index_bits(n: u32) -> u32 {
    n.max(1).next_power_of_two().trailing_zeros()
}

/// The widths of all fields by the features of a PE, most significant first; 0 of those that it does not have.
fn widths(features: &PeFeatures, format: &WordFormat) -> [(FieldName, u32); 32] {
    use FieldName::*;
    let own = index_bits(features.own_words);
    let imports = u32::from(features.imported_words > 0);
    let imported = if imports > 0 { index_bits(features.imported_words) } else { 0 };
    let swap = u32::from(features.swap);
    let ring = u32::from(features.ring_bits > 0);
    let stored = u32::from(features.coefficient_words > 0);
    let indexed = u32::from(features.index_words > 0);
    let octaves = u32::from(features.octave_bits > 0);
    let index = indexed * index_bits(features.index_words);
    [
        (OwnEnable, 1),
        (OwnSwap, swap),
        (OwnRing, ring),
        (OwnAddress, own),
        (ImportedEnable, imports),
        (ImportedSwap, swap * imports),
        (ImportedRing, ring * imports),
        (ImportedAddress, imported),
        (Coefficient, (1 - stored) * format.coefficient_bits),
        (CoefficientAddress, stored * index_bits(features.coefficient_words)),
        (Close, 1),
        (BaseEnable, 1),
        (BaseAddress, index_bits(features.base_words)),
        (IndexEnable, indexed),
        (IndexAddress, index),
        (Shift, index_bits(number(features.shifts.len()))),
        (WriteOwn, 1),
        (WriteBase, 1),
        (WriteFactor, u32::from(features.factor)),
        (WriteSwap, swap),
        (WriteRing, ring),
        (WriteAddress, index_bits(features.write_words())),
        (WriteIndex, indexed),
        (WriteOctave, indexed * octaves),
        (WriteIndexAddress, index),
        (Show, u32::from(features.shown_words > 0)),
        (Send, u32::from(features.send)),
        (ReceiveEnable, imports),
        (ReceiveSwap, swap * imports),
        (ReceiveRing, ring * imports),
        (ReceiveAddress, imported),
        (Port, index_bits(features.ports)),
    ]
}

impl Layout {
    /// Bits of the longest control word.
    pub const MOST_BITS: u32 = 128;

    /// Bits of the control word of a PE.
    pub fn bits_of(features: &PeFeatures, format: &WordFormat) -> u32 {
        widths(features, format).iter().map(|(_, width)| width).sum()
    }

    /// Derives the layout from the features.
    pub fn new(features: &PeFeatures, format: &WordFormat) -> Layout {
        let widths = widths(features, format);
        let bits = Layout::bits_of(features, format);
        assert!(bits <= Layout::MOST_BITS, "control word of {bits} bits");
        let mut lsb = bits;
        let mut fields = Vec::new();
        for (name, width) in widths {
            lsb -= width;
            if width > 0 {
                fields.push(Field { name, width, lsb });
            }
        }
        Layout::of(fields, bits)
    }

    /// The layout of some fields, most significant first, and their width in all.
    pub(super) fn of(fields: Vec<Field>, bits: u32) -> Layout {
        let mut places = [(0, 0); FieldName::Port as usize + 1];
        let mut masks = [0; FieldName::Port as usize + 1];
        for field in &fields {
            places[field.name as usize] = (field.width, field.lsb);
            masks[field.name as usize] = (u128::MAX >> (128 - field.width)) << field.lsb;
        }
        Layout { fields, bits, places, masks }
    }

    /// Packs a control word.
    ///
    /// # Panics
    /// If a group needs a field that the PE does not have, or a value does not fit its field.
    pub fn encode(&self, word: &ControlWord) -> u128 {
        use FieldName::*;
        let mut bits = 0u128;
        let mut put = |name: FieldName, value: u64| match self.places[name as usize] {
            (0, _) => assert_eq!(value, 0, "no field {}", name.text()),
            (width, lsb) => {
                assert!(width >= 64 || value >> width == 0, "{} = {value}", name.text());
                bits |= u128::from(value) << lsb;
            }
        };
        // Fields of a group that does nothing stay zero.
        let mut address = |[enable, swap, ring, index]: [FieldName; 4], address: Option<Address>| {
            if let Some(address) = address {
                put(enable, 1);
                put(swap, u64::from(address.swap));
                put(ring, u64::from(address.ring));
                put(index, u64::from(address.word));
            }
        };
        address(OWN, word.own);
        address(IMPORTED, word.imported);
        if let Some((port, place)) = word.receive {
            address(RECEIVE, Some(place));
            put(Port, u64::from(port.number()));
        }
        if let Some(base) = word.base {
            put(BaseEnable, 1);
            put(BaseAddress, u64::from(base));
        }
        if let Some(index) = word.index {
            put(IndexEnable, 1);
            put(IndexAddress, u64::from(index));
        }
        if let Some((index, octaves)) = word.write_index {
            put(WriteIndex, 1);
            put(WriteOctave, u64::from(octaves));
            put(WriteIndexAddress, u64::from(index));
        }
        if let Some(target) = word.write {
            put(WriteOwn, u64::from(target.own));
            put(WriteBase, u64::from(target.base));
            put(WriteFactor, u64::from(target.factor));
            put(WriteSwap, u64::from(target.address.swap));
            put(WriteRing, u64::from(target.address.ring));
            put(WriteAddress, u64::from(target.address.word));
        }
        match word.coefficient {
            CoefficientOperand::Coefficient(value) => {
                let width = self.width(Coefficient).max(1);
                assert!(value >= -(1 << (width - 1)) && value < 1 << (width - 1), "coefficient {value}");
                put(Coefficient, value as u64 & (u64::MAX >> (64 - width)));
            }
            CoefficientOperand::Stored(index) => put(CoefficientAddress, u64::from(index)),
        }
        put(Close, u64::from(word.close));
        put(Shift, u64::from(word.shift));
        put(Show, u64::from(word.show));
        put(Send, u64::from(word.send));
        bits
    }

    /// The bits of a control word that have an effect, given whether the result it scales is used.
    pub fn effective(&self, word: &ControlWord, result: bool) -> u128 {
        use FieldName::*;
        let idle = |field: &&Field| match field.name {
            OwnSwap | OwnRing | OwnAddress => word.own.is_none(),
            ImportedSwap | ImportedRing | ImportedAddress => word.imported.is_none(),
            Coefficient | CoefficientAddress => word.own.is_none() && word.imported.is_none(),
            BaseEnable | Shift => !result,
            BaseAddress => !result || word.base.is_none(),
            IndexAddress => word.index.is_none(),
            WriteSwap | WriteRing | WriteAddress => word.write.is_none(),
            WriteOctave | WriteIndexAddress => word.write_index.is_none(),
            ReceiveSwap | ReceiveRing | ReceiveAddress | Port => word.receive.is_none(),
            _ => false,
        };
        self.fields.iter().filter(|field| !idle(field)).map(|field| self.masks[field.name as usize]).sum()
    }

    /// Unpacks a control word; fields without effect are normalised away.
    pub fn decode(&self, bits: u128) -> ControlWord {
        use FieldName::*;
        let get = |name: FieldName| match self.places[name as usize] {
            (0, _) => 0,
            (width, lsb) => (bits >> lsb) as u64 & (u64::MAX >> (64 - width)),
        };
        let address = |[enable, swap, ring, index]: [FieldName; 4]| {
            (get(enable) == 1).then(|| Address { word: get(index) as u16, swap: get(swap) == 1, ring: get(ring) == 1 })
        };
        let width = self.width(Coefficient);
        let target = Target {
            address: Address { word: get(WriteAddress) as u16, swap: get(WriteSwap) == 1, ring: get(WriteRing) == 1 },
            own: get(WriteOwn) == 1,
            base: get(WriteBase) == 1,
            factor: get(WriteFactor) == 1,
        };
        ControlWord {
            own: address(OWN),
            imported: address(IMPORTED),
            coefficient: if width == 0 {
                CoefficientOperand::Stored(get(CoefficientAddress) as u16)
            } else {
                CoefficientOperand::Coefficient(((get(Coefficient) << (64 - width)) as i64) >> (64 - width))
            },
            close: get(Close) == 1,
            base: (get(BaseEnable) == 1).then(|| get(BaseAddress) as u16),
            index: (get(IndexEnable) == 1).then(|| get(IndexAddress) as u16),
            shift: get(Shift) as u8,
            write: (target.own || target.base || target.factor).then_some(target),
            write_index: (get(WriteIndex) == 1).then(|| (get(WriteIndexAddress) as u16, get(WriteOctave) == 1)),
            show: get(Show) == 1,
            send: get(Send) == 1,
            receive: address(RECEIVE).map(|address| (PortId::new(get(Port) as u8), address)),
        }
    }

    fn width(&self, name: FieldName) -> u32 {
        self.places[name as usize].0
    }

    /// The bits of a field; none where it is absent.
    pub fn mask(&self, name: FieldName) -> u128 {
        self.masks[name as usize]
    }
}
