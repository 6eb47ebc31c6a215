//! The network of a design and what its PEs do, as data of its page.

use std::collections::HashMap;

use pe_ir::index::ValueId;
use pe_ir::program::{PeProgram, Program};
use pe_plot::layout::Place;
use pe_plot::network::Network;
use serde_json::{Value, json};

use super::names::Names;

/// Names that the page gives of a PE.
const NAMED: usize = 24;

/// Pieces of work that the page shows at most.
const MOST_WORK: usize = 60_000;

/// Places, loads and names of the PEs, and the words that go between them.
pub fn network(program: &Program, network: &Network, places: &[Place], names: &Names) -> Value {
    let pes = program.pes.numbered().zip(places).map(|((id, pe), (x, y))| {
        let equations = pe.equations.iter().take(NAMED).map(|name| names.label(name));
        let outputs = program.outputs.iter().filter(|output| output.pe == id).map(|output| output.name.as_str());
        let rounded = |place: &f64| (place * 1e3).round() / 1e3;
        json!({
            "x": rounded(x),
            "y": rounded(y),
            "load": (network.loads[id] * 1e4).round() / 1e4,
            "names": equations.collect::<Vec<_>>(),
            "more": pe.equations.len().saturating_sub(NAMED),
            "outputs": outputs.take(NAMED).collect::<Vec<_>>(),
            "input": network.reads_input[id],
        })
    });
    let links = network.words.iter().map(|((from, to), words)| json!([from.index(), to.index(), words]));
    json!({"pes": pes.collect::<Vec<_>>(), "links": links.collect::<Vec<_>>(), "connections": network.connections()})
}

/// Names of the values in work, each once.
struct Book<'a> {
    program: &'a Program,
    names: &'a Names,
    places: HashMap<ValueId, usize>,
    texts: Vec<String>,
}

impl Book<'_> {
    fn place(&mut self, value: ValueId) -> usize {
        *self.places.entry(value).or_insert_with(|| {
            self.texts.push(self.names.label(self.program.name(Some(value))).into_owned());
            self.texts.len() - 1
        })
    }

    /// Runs of the same value: first cycle, length, place of the name, one after another.
    fn runs(&mut self, values: impl Iterator<Item = Option<ValueId>>) -> Vec<usize> {
        let mut runs: Vec<usize> = Vec::new();
        for (cycle, value) in values.enumerate() {
            let Some(value) = value else { continue };
            let name = self.place(value);
            match runs.as_mut_slice() {
                [.., first, length, last] if *last == name && *first + *length == cycle => *length += 1,
                _ => runs.extend([cycle, 1, name]),
            }
        }
        runs
    }
}

/// What every PE does, cycle by cycle: of the first PEs as far as the page has room.
pub fn occupancy(program: &Program, names: &Names) -> Value {
    let mut book = Book { program, names, places: HashMap::new(), texts: Vec::new() };
    let (mut pes, mut work) = (Vec::new(), 0);
    for pe in program.pes.iter() {
        let [products, writes, receives] = lanes(&mut book, pe);
        work += (products.len() + writes.len() + receives.len()) / 3;
        if work > MOST_WORK && !pes.is_empty() {
            break;
        }
        pes.push(json!({"products": products, "writes": writes, "receives": receives}));
    }
    json!({"pes": pes, "names": book.texts})
}

fn lanes(book: &mut Book, pe: &PeProgram) -> [Vec<usize>; 3] {
    let notes = || pe.notes.iter().zip(&pe.words);
    let product = notes().map(|(note, word)| {
        let multiplies = word.own.is_some() || word.imported.is_some();
        note.chain.or(note.operand).filter(|_| multiplies)
    });
    [
        book.runs(product),
        book.runs(notes().map(|(note, word)| note.write.filter(|_| word.write.is_some() || word.send))),
        book.runs(notes().map(|(note, word)| note.receive.filter(|_| word.receive.is_some()))),
    ]
}
