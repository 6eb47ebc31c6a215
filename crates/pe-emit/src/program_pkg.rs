//! The program package: control words and memory images of every PE, one line per word, with provenance.

use askama::Template;
use pe_ir::program::{
    ControlWord, Fold, Layout, LinkSource, Multiplier, Note, PeProgram, Program, StateRegister, closed_up,
};
use pe_ir::word::WordFormat;

use crate::Header;
use crate::names::{Names, comment_text};

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
    program: &'a Program,
    folds: &'a [Fold],
    /// Names of values as comments show them.
    shown: Vec<String>,
    states: StateWords,
}

impl ProgramPackage<'_> {
    /// The PEs, described one at a time: the lines of all would take several times the memory of the text.
    fn pes(&self) -> impl Iterator<Item = Pe> {
        let pes = self.program.pes.iter().enumerate();
        pes.map(|(index, pe)| describe(self, index, pe))
    }
}

struct Pe {
    index: usize,
    equations: String,
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
    words: Vec<Line>,
}

/// Initial content of a memory.
struct Image {
    name: &'static str,
    last: usize,
    bits: u32,
    words: Vec<Line>,
}

/// One element of an array constant.
struct Line {
    index: String,
    bits: String,
    /// Comma, or nothing on the last line; with a comment, padded to its column.
    comma: &'static str,
    comment: String,
}

/// The text of `<model>_program_pkg.vhd`.
pub fn render(program: &Program, folds: &[Fold], names: &Names, header: &Header) -> String {
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
        program,
        folds,
        shown: program.names.iter().map(|name| short(name)).collect(),
        states: StateWords::of(program),
    };
    package.render().expect("templates render into strings")
}

/// States by the memory words they begin in: sorted (PE, word) and the state's index.
struct StateWords {
    own: Vec<((u32, u16), usize)>,
    imported: Vec<((u32, u16), usize)>,
}

impl StateWords {
    fn of(program: &Program) -> StateWords {
        let (mut own, mut imported) = (Vec::new(), Vec::new());
        for (index, state) in program.states.iter().enumerate() {
            own.push((state.own, index));
            imported.extend(state.imported.iter().map(|place| (*place, index)));
        }
        own.sort_unstable();
        imported.sort_unstable();
        StateWords { own, imported }
    }

    /// The first state of a word.
    fn find<'p>(words: &[((u32, u16), usize)], place: (u32, u16), program: &'p Program) -> Option<&'p StateRegister> {
        let at = words.partition_point(|(other, _)| *other < place);
        words.get(at).filter(|(other, _)| *other == place).map(|(_, state)| &program.states[*state])
    }
}

fn describe(package: &ProgramPackage, index: usize, pe: &PeProgram) -> Pe {
    let &ProgramPackage { program, folds, ref shown, ref states, .. } = package;
    let fold = &folds[index];
    let layout = Layout::new(&pe.features, &program.format);
    let comments = pe.words.iter().enumerate().map(|(k, word)| {
        let note = pe.notes.get(k).copied().unwrap_or_default();
        word_comment(program, shown, pe, word, &note)
    });
    let comments: Vec<String> = comments.collect();
    let part = |name: &'static str, layout: Layout, words: Vec<u128>, comments: &[String]| {
        let bits = words.iter().map(|word| fields_in_binary(&layout, *word));
        let texts = comments.iter().cloned().chain(std::iter::repeat(String::new()));
        Part {
            name,
            last: words.len().max(1) - 1,
            bits: layout.bits,
            columns: columns(&layout, words.len().max(1) - 1),
            words: lines(bits.zip(texts).collect()),
        }
    };
    let packed = |words: &[u128], mask: u128| words.iter().map(|word| closed_up(*word, mask)).collect::<Vec<_>>();
    let kept = fold.all & !fold.streamed;
    let with_variant =
        |(place, word): (usize, u128)| word | u128::from(fold.next_variant(place)) << fold.repeated_bits();
    let repeated = packed(&fold.repeated, kept).into_iter().enumerate().map(with_variant).collect();
    let loops = part("LOOP", layout.part(kept).with_variant(fold.variant_bits()), repeated, &comments);
    let differing = layout.part(fold.streamed);
    let stream = match fold.variants() {
        Some(_) => part("VARIANTS", differing, packed(&fold.variant_words, fold.streamed), &[]),
        None => part("STREAM", differing, packed(&fold.stream, fold.streamed), &comments),
    };
    let mask = (loops.bits > 0 && stream.bits > 0).then(|| fields_in_binary(&layout, fold.streamed));
    let word_bits = program.format.word_bits();
    let comment = |states: &[((u32, u16), usize)], word: usize, what: &str| {
        let state = StateWords::find(states, (index as u32, word as u16), program);
        state.map_or(String::new(), |state| state_comment(state, what))
    };
    let own_comment = |word: usize| comment(&states.own, word, "state");
    let imported_comment = |word: usize| comment(&states.imported, word, "copy of state");
    let image = |name: &'static str, image: &[i64], bits: u32, comment: &dyn Fn(usize) -> String| {
        let words = image.iter().enumerate().map(|(k, word)| (binary(*word as u128, bits), comment(k))).collect();
        Image { name, last: image.len().max(1) - 1, bits, words: lines(words) }
    };
    let WordFormat { data_bits, coefficient_bits, .. } = program.format;
    Pe {
        index,
        equations: comment_text(&list(&pe.equations)),
        control_bits: layout.bits,
        parts: [loops, stream].into_iter().filter(|part| part.bits > 0).collect(),
        mask,
        images: vec![
            image("OWN", &pe.own_image, data_bits, &own_comment),
            image("BASE", &pe.base_image, word_bits, &own_comment),
            image("COEFFICIENT", &pe.coefficient_image, coefficient_bits, &|_| String::new()),
            image("IMPORTED", &pe.imported_image, data_bits, &imported_comment),
        ],
        shifts: pe.features.shifts.iter().map(u8::to_string).collect::<Vec<_>>().join(", "),
    }
}

fn list(equations: &[String]) -> String {
    if equations.is_empty() { "no equation".to_owned() } else { equations.join(", ") }
}

fn state_comment(state: &StateRegister, what: &str) -> String {
    format!("{what} {}, LSB 2^{}", short(&state.name), state.exponent)
}

fn short(name: &str) -> String {
    let mut text = comment_text(name);
    if text.len() > LONGEST_NAME {
        text.truncate(LONGEST_NAME);
        text.push_str("..");
    }
    text
}

fn lines(words: Vec<(String, String)>) -> Vec<Line> {
    let count = words.len();
    let width = count.saturating_sub(1).to_string().len();
    // The last line has no comma; a blank in its place keeps the comments of several lines in one column.
    let commented = words.iter().filter(|(_, comment)| !comment.is_empty()).count();
    let line = |(index, (bits, comment)): (usize, (String, String))| {
        let last = index + 1 == count;
        let comma = match last {
            false => ",",
            true if comment.is_empty() || commented == 1 => "",
            true => " ",
        };
        Line { index: format!("{index:<width$}"), bits, comma, comment }
    };
    words.into_iter().enumerate().map(line).collect()
}

fn push_binary(text: &mut String, value: u128, bits: u32) {
    text.extend((0..bits).rev().map(|bit| if value >> bit & 1 == 1 { '1' } else { '0' }));
}

fn binary(value: u128, bits: u32) -> String {
    let mut text = String::with_capacity(bits as usize);
    push_binary(&mut text, value, bits);
    text
}

fn fields_in_binary(layout: &Layout, bits: u128) -> String {
    let mut text = String::with_capacity(layout.bits as usize + layout.fields.len());
    for field in &layout.fields {
        if !text.is_empty() {
            text.push('_');
        }
        push_binary(&mut text, bits >> field.lsb, field.width);
    }
    text
}

/// Names above the columns of the fields, as a staircase.
fn columns(layout: &Layout, last_index: usize) -> Vec<String> {
    // Two levels of indentation, `index => b"`; the comment mark and a blank are in the template.
    let start = 4 + last_index.to_string().len() + " => b\"".len() - "    --".len();
    let mut starts = Vec::new();
    let mut column = start;
    for field in &layout.fields {
        starts.push(column);
        column += field.width as usize + 1;
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

/// What a control word does: `F[3].u2 * c -> F[3].u3; write V[1].u2; receive V[2].y from PE 4`.
fn word_comment(program: &Program, shown: &[String], pe: &PeProgram, word: &ControlWord, note: &Note) -> String {
    let shown = |id: u32| shown.get(id as usize).map_or("", String::as_str);
    let name = |id: u32, otherwise: &dyn Fn() -> String| match shown(id) {
        "" => otherwise(),
        name => name.to_owned(),
    };
    let mut text = String::new();
    if word.own.is_some() || word.imported.is_some() {
        let place = || match (word.own, word.imported) {
            (Some(address), _) => format!("own {}", address.word),
            (_, address) => format!("imported {}", address.map_or(0, |address| address.word)),
        };
        push(&mut text, &[&name(note.operand, &place), " * "]);
        match word.multiplier {
            Multiplier::Coefficient(value) => text += &value.to_string(),
            Multiplier::Stored(index) => match pe.coefficient_image.get(usize::from(index)) {
                Some(value) if *value != 0 => text += &value.to_string(),
                _ => text += &format!("stored {index}"),
            },
        }
        if !shown(note.chain).is_empty() {
            text += " -> ";
            text += shown(note.chain);
        }
    }
    if word.close {
        push(&mut text, &["close"]);
    }
    match (word.write, word.send) {
        (Some(target), send) => {
            let verb = if send { "write and send " } else { "write " };
            push(&mut text, &[verb, &name(note.write, &|| format!("own {}", target.address.word))]);
        }
        (None, true) => push(&mut text, &["send ", &name(note.write, &|| "the sum".to_owned())]),
        (None, false) => {}
    }
    if word.index.is_some() {
        push(&mut text, &["index"]);
    }
    if let Some((port, address)) = word.receive {
        let source = match pe.ports[usize::from(port)] {
            LinkSource::Pe(source) => format!("PE {source}"),
            LinkSource::Input(input) => format!("input {}", short(&program.inputs[input as usize].name)),
        };
        let value = name(note.receive, &|| format!("imported {}", address.word));
        push(&mut text, &["receive ", &value, " from ", &source]);
    }
    text
}

/// Appends what a group of the control word does.
fn push(text: &mut String, words: &[&str]) {
    if !text.is_empty() {
        text.push_str("; ");
    }
    words.iter().for_each(|word| text.push_str(word));
}
