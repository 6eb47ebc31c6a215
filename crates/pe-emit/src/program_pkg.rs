//! The program package: control words and memory images of every PE, one line per word, with provenance.

use std::collections::BTreeMap;
use std::fmt::{Display, Write};

use askama::Template;
use pe_ir::index::{self, List, PeId, StateId, ValueId};
use pe_ir::program::{
    CoefficientOperand, ControlWord, Fold, Layout, LinkSource, Note, PeProgram, Program, StateRegister, closed_up,
};
use pe_ir::word::WordFormat;

use crate::access::Order;
use crate::names::{Names, comment_text};
use crate::options::{Header, Provenance};

/// Longest name in a comment of a control word.
const LONGEST_NAME: usize = 40;

#[derive(Template)]
#[template(path = "program_pkg.vhd")]
struct ProgramPackage<'a> {
    header: &'a Header,
    model: &'a str,
    storage_bits: u32,
    word_bits: u32,
    data_bits: u32,
    coefficient_bits: u32,
    period: u32,
    rounds: u32,
    order: Option<Order>,
    outputs: Option<OutputPlaces>,
    program: &'a Program,
    folds: &'a [Fold],
    /// Names of values as comments show them.
    shown: List<ValueId, String>,
    states: StateWords,
    provenance: &'a Provenance,
}

impl ProgramPackage<'_> {
    /// The PEs, described one at a time: the lines of all would take several times the memory of the text.
    fn pes(&self) -> impl Iterator<Item = Pe> {
        let pes = self.program.pes.numbered();
        pes.map(|(index, pe)| describe(self, index, pe))
    }
}

struct Pe {
    index: PeId,
    equations: String,
    /// What the spec says of them, a line each.
    statements: Vec<String>,
    control_bits: u32,
    /// The memories of the program.
    parts: Vec<Part>,
    /// Bits of the control word that come from the stream or variant memory, if there are two memories.
    mask: Option<String>,
    images: Vec<Image>,
    shifts: String,
}

/// One of the memories of a program.
struct Part {
    name: &'static str,
    last: usize,
    bits: u32,
    /// One line per field: its name at its column, bars for the fields before it.
    columns: Vec<String>,
    /// Elements of the array, see [`lines`].
    words: String,
}

/// Initial content of a memory.
struct Image {
    name: &'static str,
    last: usize,
    bits: u32,
    /// Elements of the array, see [`lines`].
    words: String,
}

/// The text of `<model>_program_pkg.vhd`.
pub fn render(program: &Program, folds: &[Fold], names: &Names, header: &Header, provenance: &Provenance) -> String {
    let format = &program.format;
    let package = ProgramPackage {
        header,
        model: &names.model,
        storage_bits: format.storage_bits,
        word_bits: format.word_bits(),
        data_bits: format.data_bits,
        coefficient_bits: format.coefficient_bits,
        period: program.period,
        rounds: program.rounds,
        order: program.host.replaces().then(|| Order::of(program)),
        outputs: OutputPlaces::of(program),
        program,
        folds,
        shown: program.names.iter().map(|name| short(name)).collect(),
        states: StateWords::of(program),
        provenance,
    };
    package.render().expect("templates render into strings")
}

/// Where outputs are in their memories.
struct OutputPlaces {
    /// Bits of an address.
    address_bits: u32,
    /// Clocks from an address to the word.
    latency: u32,
    /// Bits of a row.
    bits: u32,
    /// Last row.
    last: usize,
    /// The rows, as elements of an array.
    words: String,
}

impl OutputPlaces {
    fn of(program: &Program) -> Option<OutputPlaces> {
        let memory = program.output_memory()?;
        let widths = [memory.memory_bits(), memory.place_bits];
        let fields = |text: &mut String, row: usize| {
            let (number, place) = memory.places[row];
            push_binary(text, u64::from(number), widths[0]);
            text.push('_');
            push_binary(text, u64::from(place), widths[1]);
        };
        let comment = |text: &mut String, row: usize| text.push_str(&comment_text(&program.outputs[row].name));
        Some(OutputPlaces {
            address_bits: memory.address_bits(),
            latency: memory.latency,
            bits: widths.iter().sum(),
            last: memory.places.len() - 1,
            words: lines(memory.places.len(), fields, comment),
        })
    }
}

/// States by the memory words they begin in: sorted (PE, word) and the state's index.
struct StateWords {
    own: Vec<((PeId, u16), StateId)>,
    /// Of rings there is none.
    base: Vec<((PeId, u16), StateId)>,
    imported: Vec<((PeId, u16), StateId)>,
}

impl StateWords {
    fn of(program: &Program) -> StateWords {
        let (mut own, mut base, mut imported) = (Vec::new(), Vec::new(), Vec::new());
        for (index, state) in program.states.numbered() {
            own.push((state.own, index));
            let (pe, own) = state.own;
            let place = (pe, program.pes[pe].features.state_base(own) as u16);
            base.extend(state.age.is_none().then_some((place, index)));
            imported.extend(state.imported.iter().map(|place| (*place, index)));
        }
        own.sort_unstable();
        base.sort_unstable();
        imported.sort_unstable();
        StateWords { own, base, imported }
    }

    /// The first state of a word.
    fn find<'p>(
        words: &[((PeId, u16), StateId)],
        place: (PeId, u16),
        program: &'p Program,
    ) -> Option<&'p StateRegister> {
        let at = words.partition_point(|(other, _)| *other < place);
        words.get(at).filter(|(other, _)| *other == place).map(|(_, state)| &program.states[*state])
    }
}

fn describe(package: &ProgramPackage, index: PeId, pe: &PeProgram) -> Pe {
    let &ProgramPackage { program, folds, ref shown, ref states, provenance, .. } = package;
    let fold = &folds[index.index()];
    let numbers = provenance.coefficients.find(index).map_or(&[][..], Vec::as_slice);
    let exact = |k: usize| numbers.get(k).copied().flatten();
    let layout = Layout::new(&pe.features, &program.format);
    let comment = |text: &mut String, k: usize| {
        let note = pe.notes.get(k).copied().unwrap_or_default();
        word_comment(text, program, shown, pe, (&pe.words[k], exact(k)), &note);
    };
    let part = |name, layout: Layout, words: Vec<u128>, commented: bool| {
        let last = words.len().max(1) - 1;
        let bits = |text: &mut String, k: usize| push_fields(text, &layout, words[k]);
        let comment = |text: &mut String, k| {
            if commented {
                comment(text, k)
            }
        };
        Part {
            name,
            last,
            bits: layout.bits,
            columns: columns(&layout, last),
            words: lines(words.len(), bits, comment),
        }
    };
    let packed = |words: &[u128], mask: u128| words.iter().map(|word| closed_up(*word, mask)).collect::<Vec<_>>();
    let kept = fold.all & !fold.streamed;
    let with_variant =
        |(place, word): (usize, u128)| word | u128::from(fold.next_variant(place)) << fold.repeated_bits();
    let repeated = packed(&fold.repeated, kept).into_iter().enumerate().map(with_variant).collect();
    let loops = part("LOOP", layout.part(kept).with_variant(fold.variant_bits()), repeated, true);
    let differing = layout.part(fold.streamed);
    let stream = match fold.variants() {
        Some(_) => part("VARIANTS", differing, packed(&fold.variant_words, fold.streamed), false),
        None => part("STREAM", differing, packed(&fold.stream, fold.streamed), true),
    };
    let mask = (loops.bits > 0 && stream.bits > 0).then(|| {
        let mut text = String::new();
        push_fields(&mut text, &layout, fold.streamed);
        text
    });
    let word_bits = program.format.word_bits();
    let state_comment = |text: &mut String, states: &[((PeId, u16), StateId)], word: usize, what: &str| {
        if let Some(state) = StateWords::find(states, (index, word as u16), program) {
            text.extend([what, " ", &short(&state.name), ", LSB 2^", &state.exponent.to_string()]);
        }
    };
    let own_comment = |text: &mut String, word| state_comment(text, &states.own, word, "state");
    let base_comment = |text: &mut String, word| state_comment(text, &states.base, word, "state");
    let imported_comment = |text: &mut String, word| state_comment(text, &states.imported, word, "copy of state");
    let stored: BTreeMap<usize, f64> = (pe.words.iter().enumerate().rev())
        .filter_map(|(k, word)| match word.coefficient {
            CoefficientOperand::Stored(place) => Some((usize::from(place), exact(k)?)),
            CoefficientOperand::Coefficient(_) => None,
        })
        .collect();
    let coefficient_comment = |text: &mut String, word: usize| {
        if let Some(number) = stored.get(&word) {
            text.push_str(&rounded(*number));
        }
    };
    let image = |name, image: &[i64], bits, comment: &dyn Fn(&mut String, usize)| {
        let words = lines(image.len(), |text, k| push_binary(text, image[k] as u64, bits), comment);
        Image { name, last: image.len().max(1) - 1, bits, words }
    };
    let WordFormat { data_bits, coefficient_bits, .. } = program.format;
    Pe {
        index,
        equations: comment_text(&list(&pe.equations)),
        statements: provenance.statements.find(index).into_iter().flatten().map(|text| comment_text(text)).collect(),
        control_bits: layout.bits,
        parts: [loops, stream].into_iter().filter(|part| part.bits > 0).collect(),
        mask,
        images: vec![
            image("OWN", &pe.own_image, data_bits, &own_comment),
            image("BASE", &pe.base_image, word_bits, &base_comment),
            image("COEFFICIENT", &pe.coefficient_image, coefficient_bits, &coefficient_comment),
            image("IMPORTED", &pe.imported_image, data_bits, &imported_comment),
        ],
        shifts: pe.features.shifts.iter().map(u8::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// A number with six digits.
fn rounded(number: f64) -> String {
    let short: f64 = format!("{number:.5e}").parse().unwrap_or(number);
    match short.abs() {
        0.0 | 1e-3..1e6 => short.to_string(),
        _ => format!("{short:e}"),
    }
}

fn list(equations: &[String]) -> String {
    if equations.is_empty() { "no equation".to_owned() } else { equations.join(", ") }
}

fn short(name: &str) -> String {
    let mut text = comment_text(name);
    if text.len() > LONGEST_NAME {
        text.truncate(LONGEST_NAME);
        text.push_str("..");
    }
    text
}

/// The elements of an array constant, a line each. They are written straight into the text that they end up in, for they
/// are millions: `bits` and `comment` append what they say of an element.
pub(crate) fn lines(count: usize, bits: impl Fn(&mut String, usize), comment: impl Fn(&mut String, usize)) -> String {
    let width = count.saturating_sub(1).to_string().len();
    let mut text = String::new();
    let mut commented = false;
    for index in 0..count {
        write!(text, "\n    {index:<width$} => b\"").expect("memory takes the line");
        bits(&mut text, index);
        text.push('"');
        let last = index + 1 == count;
        let plain = text.len() + usize::from(!last);
        // The last line has no comma; a blank in its place keeps the comments of several lines in one column.
        text.push_str(match (last, commented) {
            (false, _) => ", -- ",
            (true, true) => "  -- ",
            (true, false) => " -- ",
        });
        let start = text.len();
        comment(&mut text, index);
        if text.len() == start {
            text.truncate(plain);
        } else {
            commented = true;
        }
    }
    text
}

/// The digits of four bits; most of the text is such digits.
const NIBBLES: [&str; 16] = [
    "0000", "0001", "0010", "0011", "0100", "0101", "0110", "0111", "1000", "1001", "1010", "1011", "1100", "1101",
    "1110", "1111",
];

pub(crate) fn push_binary(text: &mut String, value: u64, bits: u32) {
    let nibbles = bits / 4;
    for bit in (4 * nibbles..bits).rev() {
        text.push(if value >> bit & 1 == 1 { '1' } else { '0' });
    }
    for nibble in (0..nibbles).rev() {
        text.push_str(NIBBLES[(value >> (4 * nibble) & 15) as usize]);
    }
}

fn push_fields(text: &mut String, layout: &Layout, bits: u128) {
    for (index, field) in layout.fields.iter().enumerate() {
        if index > 0 {
            text.push('_');
        }
        push_binary(text, (bits >> field.lsb) as u64, field.width);
    }
}

/// Names above the columns of the fields, as a staircase.
fn columns(layout: &Layout, last_index: usize) -> Vec<String> {
    // Two levels of indentation, `index => b"`; the comment mark and a blank are in the template.
    let start = 4 + last_index.to_string().len() + " => b\"".len() - "    --".len();
    let mut starts = Vec::new();
    let mut column = start;
    for field in &layout.fields {
        starts.push(column);
        column += index::at(field.width) + 1;
    }
    let row = |(index, field): (usize, &pe_ir::program::Field)| {
        let mut text = String::new();
        for start in &starts[..index] {
            text.push_str(&" ".repeat(start - text.len()));
            text.push('|');
        }
        text.push_str(&" ".repeat(starts[index] - text.len()));
        text.push_str(field.name.text());
        text
    };
    // From the right, so that no bar crosses a name.
    layout.fields.iter().enumerate().rev().map(row).collect()
}

/// Appends what a control word does: `F[3].u2 * c -> F[3].u3; write V[1].u2; receive V[2].y from PE 4`.
fn word_comment(
    text: &mut String,
    program: &Program,
    shown: &List<ValueId, String>,
    pe: &PeProgram,
    (word, exact): (&ControlWord, Option<f64>),
    note: &Note,
) {
    let start = text.len();
    let group = |text: &mut String, what: &str| {
        if text.len() > start {
            text.push_str("; ");
        }
        text.push_str(what);
    };
    let shown = |id: Option<ValueId>| id.and_then(|id| shown.find(id)).map_or("", String::as_str);
    // A value, or the place of one that has no name.
    let name = |text: &mut String, id: Option<ValueId>, place: &str, number: &dyn Display| match shown(id) {
        "" => write!(text, "{place}{number}").expect("memory takes the comment"),
        name => text.push_str(name),
    };
    if word.own.is_some() || word.imported.is_some() {
        group(text, "");
        match (word.own, word.imported) {
            (Some(address), _) => name(text, note.operand, "own ", &address.word),
            (_, address) => name(text, note.operand, "imported ", &address.map_or(0, |address| address.word)),
        }
        text.push_str(" * ");
        let written = match word.coefficient {
            CoefficientOperand::Coefficient(value) => write!(text, "{value}"),
            CoefficientOperand::Stored(index) => match pe.coefficient_image.get(usize::from(index)) {
                Some(value) if *value != 0 => write!(text, "{value}"),
                _ => write!(text, "stored {index}"),
            },
        };
        written.expect("memory takes the comment");
        if let Some(number) = exact {
            text.extend([" (", &rounded(number), ")"]);
        }
        if !shown(note.chain).is_empty() {
            text.push_str(" -> ");
            text.push_str(shown(note.chain));
        }
    }
    if word.close {
        group(text, "close");
    }
    match (word.write, word.send) {
        (Some(target), send) => {
            group(text, if send { "write and send " } else { "write " });
            name(text, note.write, "own ", &target.address.word);
        }
        (None, true) => {
            group(text, "send ");
            name(text, note.write, "the sum", &"");
        }
        (None, false) => {}
    }
    if word.index.is_some() {
        group(text, "index");
    }
    if let Some((port, address)) = word.receive {
        group(text, "receive ");
        name(text, note.receive, "imported ", &address.word);
        text.push_str(" from ");
        match pe.ports[port] {
            LinkSource::Pe(source) => write!(text, "PE {source}").expect("memory takes the comment"),
            LinkSource::Input(input) => {
                text.push_str("input ");
                text.push_str(&short(&program.inputs[index::at(input)].name));
            }
        }
    }
}
