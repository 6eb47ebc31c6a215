//! Coverage of a design in the runs on which all engines agreed, as a table and as JSON.

use std::collections::BTreeSet;

use pe_ir::program::{FieldName, Layout, LinkSource, Program};
use pe_sim::coverage::{BASE, COEFFICIENT, Coverage, FLAGGING, IMPORTED, MEMORIES, OWN, PeCoverage, bit};
use serde_json::{Value, json};

use crate::handshake::Met;

/// Items that the table names of what was not at work.
const NAMED: usize = 8;

/// Columns of the table.
const WIDTH: usize = 112;

/// Things of a kind: those that the program uses, and of these the ones that were at work.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Part of the design: a line of the table.
    pub part: &'static str,
    /// What is counted.
    pub name: String,
    /// Number of things at work.
    pub covered: usize,
    /// Number of things that could be.
    pub possible: usize,
    /// The others.
    pub missing: Vec<String>,
}

/// What was at work of all that could be.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Kinds of things, those that the design has.
    pub groups: Vec<Group>,
    /// Situations of the handshake.
    pub handshake: Met,
}

/// A word of a memory of a PE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryWord {
    /// The PE.
    pub pe: usize,
    /// Position of the memory in [`MEMORIES`].
    pub memory: usize,
    /// Its address.
    pub word: usize,
}

impl MemoryWord {
    /// Whether it was read, with effect or without; true of a word that does not exist.
    pub fn is_read(self, seen: &Coverage) -> bool {
        let pe = seen.pes.get(self.pe);
        let fetched = |pe: &PeCoverage| pe.fetched.get(self.memory)?.get(self.word).copied();
        pe.and_then(fetched) != Some(false)
    }
}

impl Group {
    fn of(part: &'static str, name: impl Into<String>, items: impl IntoIterator<Item = (bool, String)>) -> Group {
        let mut group = Group { part, name: name.into(), covered: 0, possible: 0, missing: Vec::new() };
        for (covered, item) in items {
            group.possible += 1;
            if covered {
                group.covered += 1;
            } else {
                group.missing.push(item);
            }
        }
        group
    }
}

impl Table {
    /// Compares what was at work with what the program could have at work.
    pub fn new(program: &Program, seen: &Coverage, met: Met) -> Table {
        let possible = Coverage::of_program(program);
        let mut groups = fields(program, seen, &possible);
        groups.extend(memories(program, seen, &possible));
        let pes = || (0..).zip(seen.pes.iter().zip(&possible.pes).zip(&program.pes));
        let source = |source: &LinkSource| match source {
            LinkSource::Pe(pe) => (true, format!("PE {pe}")),
            LinkSource::Input(input) => (false, format!("`{}`", program.inputs[*input as usize].name)),
        };
        for (name, linked) in [("links between PEs", true), ("inputs of PEs", false)] {
            let mut items = Vec::new();
            for (index, ((seen, possible), pe)) in pes() {
                let _: u32 = index;
                for (port, from) in pe.ports.numbered().filter(|(port, _)| possible.ports[*port]) {
                    let (is_link, from) = source(from);
                    if is_link == linked {
                        items.push((seen.ports[port], format!("PE {index} port {port} from {from}")));
                    }
                }
            }
            groups.push(Group::of("network", name, items));
        }
        let shifts = pes().flat_map(|(index, ((seen, possible), pe))| {
            let used = possible.shifts.iter().enumerate().filter(|(_, used)| **used);
            let name = move |at: usize| format!("PE {index} shift {}", pe.features.shifts[at]);
            used.map(move |(at, _)| (seen.shifts[at], name(at))).collect::<Vec<_>>()
        });
        groups.push(Group::of("network", "shifts", shifts));
        for (side, name) in [(0, "PEs that saturate below"), (1, "PEs that saturate above")] {
            let items = pes().filter(|(_, ((_, possible), _))| possible.saturated[side]);
            let items = items.map(|(index, ((seen, _), _))| (seen.saturated[side], format!("PE {index}")));
            groups.push(Group::of("flags", name, items));
        }
        let items = pes().filter(|(_, ((_, possible), _))| possible.too_large);
        let items = items.map(|(index, ((seen, _), _))| (seen.too_large, format!("PE {index}")));
        groups.push(Group::of("flags", "PEs with operands too large for their sum", items));
        for (cause, name) in FLAGGING.iter().enumerate() {
            let items = pes().filter(|(_, ((_, possible), _))| possible.flagged[cause]);
            let items = items.map(|(index, ((seen, _), _))| (seen.flagged[cause], format!("PE {index}")));
            groups.push(Group::of("flags", format!("flags set by {name} alone"), items));
        }
        let names: Vec<String> = program.ports().map(|input| format!("`{}`", input.name)).collect();
        let clamps = possible.clamped.iter().zip(&seen.clamped).zip(&names).filter(|((possible, _), _)| **possible);
        groups.push(Group::of("flags", "clamps of inputs", clamps.map(|((_, seen), name)| (*seen, name.clone()))));
        let clamps = possible.shown_clamped.iter().zip(&seen.shown_clamped).zip(&program.outputs);
        let clamps = clamps.filter(|((possible, _), _)| **possible);
        let clamps = clamps.map(|((_, seen), output)| (*seen, format!("`{}`", output.name)));
        groups.push(Group::of("flags", "clamps of outputs", clamps));
        let pes = program.pes.len();
        for (name, range) in [("PEs alone behind overflow_o", 0..pes), ("inputs alone", pes..seen.raised.len())] {
            let items = range.filter(|at| possible.raised[*at]).map(|at| {
                let name = if at < pes { format!("PE {at}") } else { names[at - pes].clone() };
                (seen.raised[at], name)
            });
            groups.push(Group::of("flags", name, items));
        }
        let width = program.format.storage_bits;
        let bits = |seen: &[[u64; 2]], names: &[String]| {
            let mut items = Vec::new();
            for (port, name) in seen.iter().zip(names) {
                let both = |bit: u32| port[0] >> bit & port[1] >> bit & 1 == 1;
                items.extend((0..width).map(|bit| (both(bit), format!("{name} bit {bit}"))));
            }
            items
        };
        groups.push(Group::of("ports", "bits of inputs", bits(&seen.inputs, &names)));
        let names: Vec<String> = program.outputs.iter().map(|output| format!("`{}`", output.name)).collect();
        groups.push(Group::of("ports", "bits of outputs", bits(&seen.outputs, &names)));
        let ticks =
            program.ticks().zip(seen.ticks.iter().zip(&possible.ticks)).map(|((index, _, _), (seen, possible))| {
                let both = seen.iter().zip(possible).all(|(seen, possible)| *seen || !*possible);
                (both, format!("`{}`", program.inputs[index as usize].name))
            });
        groups.push(Group::of("ports", "ticks", ticks));
        groups.retain(|group| group.possible > 0);
        Table { groups, handshake: met }
    }

    /// What was at work, and what could be.
    pub fn total(&self) -> (usize, usize) {
        (self.groups.iter().map(|group| group.covered).sum(), self.groups.iter().map(|group| group.possible).sum())
    }

    /// The lines for people.
    pub fn text(&self) -> String {
        let (covered, possible) = self.total();
        let mut text = line("coverage", &[format!("{covered} of {possible} items at work that the program uses")]);
        let mut part = "";
        for group in &self.groups {
            if group.part != part {
                part = group.part;
                let items = self.groups.iter().filter(|group| group.part == part);
                let items = items.map(|group| format!("{} {} of {}", group.name, group.covered, group.possible));
                text += &line(part, &items.collect::<Vec<_>>());
            }
        }
        let met = self.handshake.all().map(|(name, count)| format!("{name} {count}"));
        text += &line("handshake", &met);
        let missing: Vec<String> = self
            .groups
            .iter()
            .flat_map(|group| group.missing.iter().map(move |item| format!("{item} ({})", group.name)))
            .collect();
        if !missing.is_empty() {
            let mut named: Vec<String> = missing.iter().take(NAMED).cloned().collect();
            if missing.len() > NAMED {
                named.push(format!("and {} more, all of them with `--message-format json`", missing.len() - NAMED));
            }
            text += &line("not at work", &named);
        }
        text
    }

    /// The same for tools.
    pub fn json(&self) -> Value {
        let groups = self.groups.iter().map(|group| {
            json!({"part": group.part, "name": group.name, "covered": group.covered, "possible": group.possible,
                   "missing": group.missing})
        });
        let met = self.handshake.all().into_iter().map(|(name, count)| (name.to_owned(), json!(count)));
        json!({"groups": groups.collect::<Vec<_>>(), "handshake": met.collect::<serde_json::Map<_, _>>()})
    }
}

/// Items after a name, broken into lines.
fn line(name: &str, items: &[String]) -> String {
    let mut lines = vec![format!("{name:>14}   ")];
    for (index, item) in items.iter().enumerate() {
        let end = if index + 1 < items.len() { ", " } else { "" };
        let last = lines.last_mut().expect("there is a line");
        if last.len() + item.len() + end.len() > WIDTH && last.trim_end().len() > 14 {
            let kept = last.trim_end().len();
            last.truncate(kept);
            lines.push(format!("{:>14}   {item}{end}", ""));
        } else {
            *last += &format!("{item}{end}");
        }
    }
    lines.join("\n") + "\n"
}

/// The fields of the control words.
fn fields(program: &Program, seen: &Coverage, possible: &Coverage) -> Vec<Group> {
    let names = program.pes.iter().flat_map(|pe| Layout::new(&pe.features, &program.format).fields);
    let names: BTreeSet<FieldName> = names.map(|field| field.name).collect();
    let group = |name: FieldName| {
        let mut items = Vec::new();
        for (pe, (seen, possible)) in seen.pes.iter().zip(&possible.pes).enumerate() {
            let words = seen.fields.iter().zip(&possible.fields).enumerate();
            for (word, (seen, _)) in words.filter(|(_, (_, possible))| *possible & bit(name) != 0) {
                items.push((seen & bit(name) != 0, format!("PE {pe} word {word}")));
            }
        }
        Group::of("control word", name.text(), items)
    };
    names.into_iter().map(group).collect()
}

/// The words of the memories, and the entries of tables.
fn memories(program: &Program, seen: &Coverage, possible: &Coverage) -> Vec<Group> {
    let entries: Vec<BTreeSet<usize>> = program.pes.iter().map(entries).collect();
    let mut groups = Vec::new();
    for (at, memory) in MEMORIES.iter().enumerate() {
        let (mut read, mut written, mut table) = (Vec::new(), Vec::new(), Vec::new());
        for (pe, (seen, possible)) in seen.pes.iter().zip(&possible.pes).enumerate() {
            for word in 0..possible.read[at].len() {
                let item = |seen: bool| (seen, format!("PE {pe} word {word}"));
                let is_entry = *memory == "base" && entries[pe].contains(&word);
                if possible.read[at][word] {
                    if is_entry { &mut table } else { &mut read }.push(item(seen.read[at][word]));
                }
                if possible.written[at][word] {
                    written.push(item(seen.written[at][word]));
                }
            }
        }
        groups.push(Group::of("memories", format!("{memory} read"), read));
        groups.push(Group::of("memories", format!("{memory} written"), written));
        groups.push(Group::of("memories", "entries of tables", table));
    }
    groups
}

/// Base words that an index chooses.
fn entries(pe: &pe_ir::program::PeProgram) -> BTreeSet<usize> {
    let count = pe.words.len();
    let indexed = (0..count).filter(|k| pe.words[(k + count - 1) % count].index.is_some());
    let bases = indexed.filter_map(|k| pe.words[k].base);
    bases.flat_map(|base| (0..pe.features.segments().count()).map(move |entry| usize::from(base) | entry)).collect()
}

/// Least share of a PE's written words that must change in some run.
const LEAST_LIVE: f64 = 0.5;

/// PEs and memories that rest in all runs: what is said of them is said of nothing.
pub fn resting(program: &Program, seen: &Coverage) -> Vec<String> {
    let mut possible = Coverage::of_program(program);
    let mut seen = seen.clone();
    // Tunable parameters, and what stages make of them, are written again and again as they are.
    let tunable: BTreeSet<&str> =
        program.states.iter().filter(|state| state.tunable).map(|state| state.name.as_str()).collect();
    let stands = |value| program.name(value).split('.').next().is_some_and(|name| tunable.contains(name));
    for (index, pe) in program.pes.numbered().filter(|_| !tunable.is_empty()) {
        let features = &pe.features;
        for (word, note) in pe.words.iter().zip(&pe.notes) {
            let mut places = Vec::new();
            if let Some(target) = word.write.filter(|_| stands(note.write)) {
                let own = usize::from(target.address.word) & (features.own_words as usize - 1);
                places.extend(target.own.then_some((OWN, own)));
                places.extend(target.base.then_some((BASE, features.base_word(target.address.word))));
                places.extend(target.factor.then(|| (COEFFICIENT, features.factor_word(target.address.word))));
            }
            if let Some((_, address)) = word.receive.filter(|_| stands(note.receive)) {
                places.push((IMPORTED, usize::from(address.word)));
            }
            for (memory, place) in places {
                for coverage in [&mut possible, &mut seen] {
                    let words = &mut coverage.pes[index].written[memory];
                    let half = if features.swap && [OWN, IMPORTED].contains(&memory) { words.len() / 2 } else { 0 };
                    (words[place], words[place ^ half]) = (false, false);
                }
            }
        }
    }
    let mut resting = Vec::new();
    for (pe, (seen, possible)) in seen.pes.iter().zip(&possible.pes).enumerate() {
        let (mut live, mut all) = (0, 0);
        for (at, memory) in MEMORIES.iter().enumerate() {
            let count = |words: &[bool]| words.iter().filter(|word| **word).count();
            let (changed, written) = (count(&seen.written[at]), count(&possible.written[at]));
            if written > 0 && changed == 0 {
                resting.push(format!("no word of the {memory} memory of PE {pe} ever changes"));
            }
            (live, all) = (live + changed, all + written);
        }
        if (live as f64) < LEAST_LIVE * all as f64 {
            resting.push(format!("only {live} of {all} words that PE {pe} writes ever change"));
        }
    }
    resting
}
