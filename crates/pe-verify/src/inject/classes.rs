//! The places in a design where each kind of damage can be done.

use std::collections::BTreeMap;
use std::ops::Range;

use pe_sim::coverage::{BASE, COEFFICIENT, IMPORTED, OWN};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::class::Class;
use super::datasheet::{Design, shifts};
use super::library::{REPLACEMENTS, RULED};
use super::vhdl::{Association, Bits, Instance, Network, Package, line_of};
use crate::coverage::MemoryWord;

/// A piece of text that takes the place of another one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edit {
    /// Bytes of the file.
    pub range: Range<usize>,
    /// What stands there afterwards.
    pub text: String,
}

/// A damage: what is done, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Kind.
    pub class: Class,
    /// File, relative to the design's folder.
    pub file: String,
    /// First line that changes, from 1.
    pub line: usize,
    /// That line before and after, trimmed.
    pub before: String,
    /// See `before`.
    pub after: String,
    /// What it is, in a few words.
    pub what: String,
    /// The changes, in the order of the file.
    pub edits: Vec<Edit>,
    /// Whether all that changes is what [`Sources::read`] reads.
    pub is_read: bool,
    /// The word of a memory's initial image that changes.
    pub image: Option<MemoryWord>,
}

impl Damage {
    /// Describes edits of a text.
    fn new(class: Class, file: &str, text: &str, what: String, mut edits: Vec<Edit>) -> Damage {
        edits.sort_by_key(|edit| edit.range.start);
        let changed = applied(text, &edits);
        let same = text.bytes().zip(changed.bytes()).take_while(|(a, b)| a == b).count();
        let line = line_of(text, same);
        let shown = |text: &str| text.lines().nth(line - 1).unwrap_or("").trim().to_owned();
        Damage {
            class,
            file: file.to_owned(),
            line,
            before: shown(text),
            after: shown(&changed),
            what,
            edits,
            is_read: false,
            image: None,
        }
    }

    /// The damaged text of its file.
    pub fn of(&self, text: &str) -> String {
        applied(text, &self.edits)
    }
}

fn applied(text: &str, edits: &[Edit]) -> String {
    let (mut changed, mut at) = (String::with_capacity(text.len() + 64), 0);
    for edit in edits {
        changed.push_str(&text[at..edit.range.start]);
        changed.push_str(&edit.text);
        at = edit.range.end;
    }
    changed + &text[at..]
}

/// The line of `pe_scale.vhd` that makes the base of words without one.
pub const OFFSET: &str = "offset(i) <=";

/// The line of `pe_sequencer.vhd` that makes `sample`, and the damage that makes it the same as `fetch`.
const SAMPLES_ALWAYS: (&str, &str) = ("sample_o  <= fetch and waiting and not replace_i;", "sample_o <= fetch;");

/// The VHDL of a design as it lies in its folder.
#[derive(Clone, Debug)]
pub struct Sources {
    /// Text of each file by its path in the folder.
    pub texts: BTreeMap<String, String>,
    /// Names of package and network.
    pub package_file: String,
    /// See `package_file`.
    pub network_file: String,
}

impl Sources {
    /// Package, network, and the design that they make.
    ///
    /// # Errors
    /// What is not understood.
    pub fn read(&self) -> Result<(Package, Network, Design), String> {
        let package = Package::read(&self.texts[&self.package_file])?;
        let mut network = Network::read(&self.texts[&self.network_file])?;
        let sequencer = self.texts.get("hdl/pe_sequencer.vhd");
        if sequencer.is_some_and(|text| text.contains(SAMPLES_ALWAYS.1) && !text.contains(SAMPLES_ALWAYS.0)) {
            network.rewire("sample", "fetch");
        }
        let mut design = Design::read(&package, &network)?;
        if let Some(text) = self.texts.get("hdl/pe_index.vhd") {
            let image = text.lines().find(|line| line.contains("constant IMAGE"));
            let ones = image.is_some_and(|line| line.contains("(others => '1')"));
            design.index_image = if ones { u128::MAX } else { 0 };
        }
        let offset = |text: &String| text.lines().find(|line| line.contains(OFFSET)).map(|line| line.trim().to_owned());
        design.offset = self.texts.get("hdl/pe_scale.vhd").and_then(offset).unwrap_or_default();
        for (file, before, after, rule) in RULED {
            let text = self.texts.get(&format!("hdl/{file}"));
            if text.is_some_and(|text| text.contains(after) && !text.contains(before)) {
                rule(&mut design.rules);
            }
        }
        Ok((package, network, design))
    }

    /// The same with a damage.
    pub fn damaged(&self, damage: &Damage) -> Sources {
        let mut sources = self.clone();
        if let Some(text) = sources.texts.get_mut(&damage.file) {
            *text = damage.of(text);
        }
        sources
    }
}

/// A word of a memory in the package.
struct Word {
    bits: Bits,
    /// What it is.
    name: String,
    image: Option<MemoryWord>,
}

/// All places of a design where something can be damaged.
pub struct Places {
    /// Damages that can be listed, by class.
    listed: BTreeMap<Class, Vec<Damage>>,
    /// Words whose bits can be flipped, by class: the word's bits and what it is.
    words: BTreeMap<Class, Vec<Word>>,
    package: (String, String),
}

impl Places {
    /// Finds them.
    ///
    /// # Errors
    /// What is not understood of the VHDL.
    pub fn of(sources: &Sources) -> Result<Places, String> {
        let (package, network, design) = sources.read()?;
        let file = &sources.package_file;
        let text = sources.texts[file].clone();
        let mut places = Places { listed: BTreeMap::new(), words: BTreeMap::new(), package: (file.clone(), text) };
        for (name, array) in &package.arrays {
            if name == "OUTPUT_PLACES" {
                let named = array.words.iter().enumerate().map(|(word, bits)| Word {
                    bits: bits.clone(),
                    name: format!("word {word} of {name}"),
                    image: None,
                });
                places.words.entry(Class::OutputPlaces).or_default().extend(named);
                continue;
            }
            let Some((pe, kind)) = name.strip_prefix("PE").and_then(|name| name.split_once('_')) else { continue };
            let (class, memory) = match kind {
                "LOOP" => (Class::ProgramLoop, None),
                "STREAM" => (Class::ProgramStream, None),
                "VARIANTS" => (Class::ProgramVariants, None),
                "OWN_IMAGE" => (Class::ImageOwn, Some(OWN)),
                "BASE_IMAGE" => (Class::ImageBase, Some(BASE)),
                "COEFFICIENT_IMAGE" => (Class::ImageCoefficient, Some(COEFFICIENT)),
                "IMPORTED_IMAGE" => (Class::ImageImported, Some(IMPORTED)),
                _ => continue,
            };
            let pe: usize = pe.parse().map_err(|_| format!("no PE of {name}"))?;
            let words = array.words.iter().enumerate().filter(|(_, word)| !word.places.is_empty());
            let named = words.map(|(word, bits)| Word {
                bits: bits.clone(),
                name: format!("word {word} of {name}"),
                image: memory.map(|memory| MemoryWord { pe, memory, word }),
            });
            places.words.entry(class).or_default().extend(named);
        }
        places.words.retain(|_, words| !words.is_empty());
        let text = &sources.texts[&sources.network_file];
        let mut network_damages = NetworkDamages { file: &sources.network_file, text, damages: Vec::new() };
        network_damages.links(&network);
        network_damages.ports(&network, &design);
        network_damages.generics(&network);
        network_damages.overflow();
        let library = library(sources, &design);
        for damage in network_damages.damages.into_iter().chain(library) {
            places.listed.entry(damage.class).or_default().push(damage);
        }
        Ok(places)
    }

    /// Classes that the design has places of.
    pub fn classes(&self) -> Vec<Class> {
        Class::ALL.iter().copied().filter(|c| self.listed.contains_key(c) || self.words.contains_key(c)).collect()
    }

    /// Chooses so many different damages: as many of each class as of every other, as far as it has places.
    pub fn choose(&self, count: usize, random: &mut ChaCha8Rng) -> Vec<Damage> {
        let mut chosen: Vec<Damage> = Vec::new();
        let mut listed = self.listed.clone();
        let mut flipped = std::collections::BTreeSet::new();
        while chosen.len() < count {
            let before = chosen.len();
            for class in self.classes() {
                if chosen.len() == count {
                    break;
                }
                let left = listed.get_mut(&class).filter(|left| !left.is_empty());
                let words = self.words.get(&class);
                if let Some(left) = left {
                    let at = random.random_range(0..left.len());
                    chosen.push(left.swap_remove(at));
                } else if let Some(words) = words {
                    // A memory of few bits may be used up.
                    let free = (0..32).find_map(|_| {
                        let word = &words[random.random_range(0..words.len())];
                        let place = word.bits.places[random.random_range(0..word.bits.places.len())];
                        flipped.insert(place).then_some((word, place))
                    });
                    chosen.extend(free.map(|(word, place)| self.flip(class, word, place)));
                }
            }
            if chosen.len() == before {
                break;
            }
        }
        chosen
    }

    /// Flips a bit of a word.
    fn flip(&self, class: Class, word: &Word, place: usize) -> Damage {
        let (file, text) = &self.package;
        let bit = word.bits.places.iter().rev().position(|other| *other == place).unwrap_or(0);
        let flipped = if &text[place..=place] == "1" { "0" } else { "1" };
        let edit = Edit { range: place..place + 1, text: flipped.into() };
        let damage = Damage::new(class, file, text, format!("bit {bit} of {}", word.name), vec![edit]);
        Damage { is_read: true, image: word.image, ..damage }
    }
}

/// Damages of the hand-written files.
fn library(sources: &Sources, design: &Design) -> Vec<Damage> {
    let mut damages = Vec::new();
    for (class, when, file, before, after) in REPLACEMENTS {
        let path = format!("hdl/{file}");
        let Some(text) = sources.texts.get(&path).filter(|_| when.holds(design)) else { continue };
        // A folder of another version may have another text.
        if let Some(at) = text.find(before) {
            let edit = Edit { range: at..at + before.len(), text: (*after).to_owned() };
            let damage = Damage::new(*class, &path, text, "hand-written VHDL".into(), vec![edit]);
            let ruled = RULED.iter().any(|(at, from, to, _)| [at, from, to] == [file, before, after]);
            let wired = (*before, *after) == SAMPLES_ALWAYS;
            let is_read = ruled || wired || *class == Class::ImageIndex || damage.before.contains(OFFSET);
            damages.push(Damage { is_read, ..damage });
        }
    }
    damages
}

/// How damages of the network file begin that the datasheet reads there: wiring of ports, and these generics.
const READ: [&str; 11] = [
    "ports of",
    "a port of",
    "sample_i of u_input",
    "settle_i of",
    "position",
    "CAPTURE_WORD",
    "STEPS",
    "DONE",
    "ONE_BIT",
    "BASE_LAST",
    "SHOW_LAST",
];

/// Damages of the network file.
struct NetworkDamages<'a> {
    file: &'a str,
    text: &'a str,
    damages: Vec<Damage>,
}

impl NetworkDamages<'_> {
    fn push(&mut self, class: Class, what: String, edits: Vec<(Range<usize>, String)>) {
        let edits: Vec<Edit> = edits.into_iter().map(|(range, text)| Edit { range, text }).collect();
        if edits.iter().any(|edit| self.text[edit.range.clone()] != edit.text) {
            let damage = Damage::new(class, self.file, self.text, what, edits);
            let is_read = READ.iter().any(|read| damage.what.starts_with(read));
            self.damages.push(Damage { is_read, ..damage });
        }
    }

    /// Ports of a PE swapped with each other, and wired to what another PE's port is wired to.
    fn links(&mut self, network: &Network) {
        let wired: Vec<(&String, &Association, Vec<&str>)> = network
            .assignments
            .iter()
            .filter(|(target, value)| target.starts_with("ports_") && !value.value.contains("others"))
            .map(|(target, value)| (target, value, value.value.split('&').map(str::trim).collect()))
            .collect();
        let mut sources: Vec<&str> = wired.iter().flat_map(|(_, _, sources)| sources.iter().copied()).collect();
        sources.sort_unstable();
        sources.dedup();
        for (target, value, names) in &wired {
            for at in 0..names.len() {
                let mut swapped = names.clone();
                if at > 0 {
                    swapped.swap(at, at - 1);
                    let what = format!("ports of {target} swapped");
                    self.push(Class::Links, what, vec![(value.range.clone(), swapped.join(" & "))]);
                }
                let mut other = names.clone();
                let next = sources.iter().position(|source| *source == names[at]).map_or(0, |place| place + 1);
                other[at] = sources[next % sources.len()];
                let what = format!("a port of {target} wired to {}", other[at]);
                self.push(Class::Links, what, vec![(value.range.clone(), other.join(" & "))]);
            }
        }
    }

    /// Ports of instances tied, or wired to what the next instance has.
    fn ports(&mut self, network: &Network, design: &Design) {
        let tied: [(&str, &str, &str, Class); 19] = [
            ("pe", "parity_i", "'0'", Class::Parity),
            ("pe", "last_i", "'1'", Class::Parity),
            ("pe", "turn_i", "(others => '0')", Class::Address),
            ("pe", "settle_i", "'0'", Class::Settle),
            ("pe", "settle_i", "'1'", Class::Settle),
            ("pe", "advance_i", "'1'", Class::ClockEnable),
            ("pe_rom", "fetch_i", "'1'", Class::ClockEnable),
            ("pe_sequencer", "ce_i", "'1'", Class::ClockEnable),
            ("pe_sequencer", "step_i", "'1'", Class::StepHandshake),
            ("pe_input", "sample_i", "fetch", Class::StepHandshake),
            ("pe_tick", "sample_i", "fetch", Class::Ticks),
            ("pe_output", "publish_i", "'0'", Class::Outputs),
            ("pe_output", "publish_i", "sample", Class::Outputs),
            ("pe_output", "word_i", "(others => '0')", Class::Outputs),
            ("pe_output_memory", "publish_i", "'0'", Class::Outputs),
            ("pe_output_memory", "publish_i", "sample", Class::Outputs),
            ("pe_output_memory", "here_i", "'0'", Class::Outputs),
            ("pe_output_memory", "place_i", "(others => '0')", Class::Outputs),
            ("pe_output_reader", "words_i", "(others => '0')", Class::Outputs),
        ];
        for instance in &network.instances {
            for (entity, port, to, class) in tied {
                // The deep pipeline's memories are always told to fetch.
                let idle = design.deep && port == "fetch_i";
                // A memory of one word has one place.
                let pe = instance.label.strip_prefix("u_outputs_").and_then(|pe| pe.parse::<usize>().ok());
                let single = pe.and_then(|pe| design.pes.get(pe)).is_some_and(|pe| pe.shown() < 2);
                let idle = idle || (port == "place_i" && single);
                if let Some(value) = instance.ports.get(port).filter(|_| instance.entity == entity && !idle) {
                    let what = format!("{port} of {} tied to {to}", instance.label);
                    self.push(class, what, vec![(value.range.clone(), to.to_owned())]);
                }
            }
        }
        let exchanged = [
            ("pe_output", "word_i", Class::Wiring),
            ("pe_output", "value_o", Class::Wiring),
            ("pe_input", "value_i", Class::Wiring),
            ("pe", "link_o", Class::Wiring),
            ("pe", "overflow_o", Class::Flags),
            ("pe_output_memory", "here_i", Class::Wiring),
            ("pe_output_memory", "word_i", Class::Wiring),
        ];
        for (entity, port, class) in exchanged {
            let instances: Vec<&Instance> = network.of(entity).collect();
            for pair in instances.windows(2) {
                if let (Some(one), Some(other)) = (pair[0].ports.get(port), pair[1].ports.get(port)) {
                    let what = format!("{port} of {} and {} exchanged", pair[0].label, pair[1].label);
                    let edits =
                        vec![(one.range.clone(), other.value.clone()), (other.range.clone(), one.value.clone())];
                    self.push(class, what, edits);
                }
            }
        }
    }

    /// Shift lists, captured words, ticks, features.
    fn generics(&mut self, network: &Network) {
        for instance in &network.instances {
            let label = &instance.label;
            if let (Some(value), Ok(list)) = (instance.generics.get("SHIFTS"), shifts(instance)) {
                for at in 0..list.len() {
                    let mut other = list.clone();
                    other[at] += 1;
                    let elements: Vec<String> = other.iter().enumerate().map(|(i, s)| format!("{i} => {s}")).collect();
                    let what = format!("position {at} of the shifts of {label} one more");
                    self.push(Class::Shifts, what, vec![(value.range.clone(), format!("({})", elements.join(", ")))]);
                }
            }
            let mut replace = |class, generic: &str, to: &dyn Fn(i64) -> Option<i64>| {
                let value = instance.generics.get(generic);
                let number = value.and_then(|value| Some((value, value.value.parse().ok()?)));
                if let Some((value, to)) = number.and_then(|(value, number)| Some((value, to(number)?))) {
                    let what = format!("{generic} of {label} is {to}");
                    self.push(class, what, vec![(value.range.clone(), to.to_string())]);
                }
            };
            replace(Class::Outputs, "CAPTURE_WORD", &|word| Some(word + 1));
            replace(Class::Outputs, "CAPTURE_WORD", &|word| (word > 0).then_some(word - 1));
            replace(Class::Ticks, "STEPS", &|steps| Some(steps + 1));
            replace(Class::Ticks, "DONE", &|done| (done == 0).then_some(1));
            replace(Class::Ticks, "ONE_BIT", &|bit| (bit > 0).then_some(bit - 1));
            replace(Class::Register, "ACCUMULATOR_BITS", &|bits| Some(bits / 2));
            for (generic, from, to, class) in [
                ("BASE_LAST", "true", "false", Class::Parity),
                ("BASE_LAST", "false", "true", Class::Parity),
                ("PRE_ADDER", "true", "false", Class::Multiplier),
                ("SHOW_LAST", "true", "false", Class::Outputs),
            ] {
                if let Some(value) = instance.generics.get(generic).filter(|value| value.value == from) {
                    let what = format!("{generic} of {label} is {to}");
                    self.push(class, what, vec![(value.range.clone(), to.to_owned())]);
                }
            }
        }
    }

    /// What the network makes of the flags.
    fn overflow(&mut self) {
        for (before, after) in [
            ("overflow_o <= overflowed;", "overflow_o <= '0';"),
            ("overflow_o <= overflowed;", "overflow_o <= not overflowed;"),
            ("overflowed <= or overflow;", "overflowed <= and overflow;"),
            ("overflowed <= or overflow;", "overflowed <= overflow(0);"),
        ] {
            if let Some(at) = self.text.find(before) {
                let edit = (at..at + before.len(), after.to_owned());
                self.push(Class::OverflowPort, "what the network makes of the flags".into(), vec![edit]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inject::datasheet::Rules;
    use crate::inject::library::Replacement;

    #[test]
    fn every_text_of_the_library_that_is_damaged_stands_there_once() {
        for (class, _, file, before, after) in REPLACEMENTS {
            let text = pe_emit::LIBRARY.iter().find(|(name, _)| name == file).map(|(_, text)| text);
            let count = text.unwrap_or_else(|| panic!("no file {file}")).matches(before).count();
            assert_eq!(count, 1, "{}: `{before}` stands {count} times in {file}", class.name());
            assert_ne!(before, after, "{}: {file}", class.name());
        }
    }

    #[test]
    fn rules_are_those_of_damages_and_another_one_each() {
        let mut rules = vec![Rules::default()];
        for (file, before, after, rule) in RULED {
            let listed = |damage: &Replacement| [damage.2, damage.3, damage.4] == [*file, *before, *after];
            assert_eq!(REPLACEMENTS.iter().filter(|damage| listed(damage)).count(), 1, "{file}: `{before}`");
            let mut other = Rules::default();
            rule(&mut other);
            assert!(!rules.contains(&other), "{file}: `{before}`");
            rules.push(other);
        }
    }

    #[test]
    fn classes_have_names_of_their_own() {
        let mut names: Vec<&str> = Class::ALL.iter().map(|class| class.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Class::ALL.len());
    }

    #[test]
    fn edits_take_their_places_in_order() {
        let text = "first\nsecond third\n";
        let edit = |range: Range<usize>, text: &str| Edit { range, text: text.into() };
        let damage = Damage::new(Class::Links, "f", text, String::new(), vec![edit(13..18, "2nd"), edit(6..12, "3rd")]);
        assert_eq!(damage.of(text), "first\n3rd 2nd\n");
        assert_eq!((damage.line, damage.before.as_str(), damage.after.as_str()), (2, "second third", "3rd 2nd"));
    }
}
