//! A design as the datasheet reads it, from the text of its VHDL: control words field by field, images, wiring.
//!
//! Written from `docs/hardware.md` alone. It shares no code with the program's layout, the emitter or the simulator,
//! because it decides which damages have no effect.

use std::collections::{BTreeMap, BTreeSet};

use super::vhdl::{Association, Instance, Network, Package};

/// A field of the control word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Field {
    /// Place of its lowest bit.
    pub lsb: u32,
    /// Bits; 0 if the PE does not have it.
    pub width: u32,
}

impl Field {
    /// Its value in a word.
    pub fn of(self, word: u128) -> u64 {
        if self.width == 0 { 0 } else { (word >> self.lsb) as u64 & (u64::MAX >> (64 - self.width)) }
    }

    /// Whether a flag is set.
    pub fn set(self, word: u128) -> bool {
        self.of(word) == 1
    }
}

/// Features of a PE: the generics of its instance.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct Features {
    pub own_words: u32,
    pub base_words: u32,
    pub coefficient_words: u32,
    pub imported_words: u32,
    pub ports: u32,
    pub shifts: Vec<u32>,
    pub factor: bool,
    pub pre_adder: bool,
    pub swap: bool,
    pub base_last: bool,
    pub send: bool,
    pub index_words: u32,
    pub index_width: u32,
    pub octave_width: u32,
    pub accumulator_bits: u32,
    pub saturate: bool,
    pub shown_words: u32,
    pub show_last: bool,
    pub ring_bits: u32,
}

/// The fields of a PE's control word, as the table of the datasheet lists them.
#[derive(Clone, Debug, Default)]
#[allow(missing_docs)]
pub struct Fields {
    pub own_enable: Field,
    pub own_swap: Field,
    pub own_ring: Field,
    pub own_address: Field,
    pub imported_enable: Field,
    pub imported_swap: Field,
    pub imported_ring: Field,
    pub imported_address: Field,
    pub coefficient: Field,
    pub coefficient_address: Field,
    pub close: Field,
    pub base_enable: Field,
    pub base_address: Field,
    pub index_enable: Field,
    pub index_address: Field,
    pub shift: Field,
    pub write_own: Field,
    pub write_base: Field,
    pub write_factor: Field,
    pub write_swap: Field,
    pub write_ring: Field,
    pub write_address: Field,
    pub write_index: Field,
    pub write_octave: Field,
    pub write_index_address: Field,
    pub show: Field,
    pub send: Field,
    pub receive_enable: Field,
    pub receive_swap: Field,
    pub receive_ring: Field,
    pub receive_address: Field,
    pub port: Field,
    /// Name and place of each field that is present, the most significant first.
    pub names: Vec<(&'static str, Field)>,
    /// Bits of the word.
    pub bits: u32,
}

/// Bits that tell so many things apart.
pub fn log2(count: u32) -> u32 {
    (0..32).find(|bits| 1u64 << bits >= u64::from(count)).unwrap_or(32)
}

impl Fields {
    /// Lays the fields out: those that the features give, from the most significant end.
    pub fn of(features: &Features, coefficient_bits: u32) -> Fields {
        let f = features;
        let imports = u32::from(f.imported_words > 0);
        let (swap, stored) = (u32::from(f.swap), u32::from(f.coefficient_words > 0));
        let ring = u32::from(f.ring_bits > 0);
        let indexed = u32::from(f.index_words > 0);
        let factors = if f.factor { f.coefficient_words } else { 0 };
        let deepest = f.own_words.max(f.base_words).max(factors);
        let imported = imports * log2(f.imported_words);
        let mut fields = Fields::default();
        let list: [(&'static str, &mut Field, u32); 32] = [
            ("own_enable", &mut fields.own_enable, 1),
            ("own_swap", &mut fields.own_swap, swap),
            ("own_ring", &mut fields.own_ring, ring),
            ("own_address", &mut fields.own_address, log2(f.own_words)),
            ("imported_enable", &mut fields.imported_enable, imports),
            ("imported_swap", &mut fields.imported_swap, imports * swap),
            ("imported_ring", &mut fields.imported_ring, imports * ring),
            ("imported_address", &mut fields.imported_address, imported),
            ("coefficient", &mut fields.coefficient, (1 - stored) * coefficient_bits),
            ("coefficient_address", &mut fields.coefficient_address, stored * log2(f.coefficient_words)),
            ("close", &mut fields.close, 1),
            ("base_enable", &mut fields.base_enable, 1),
            ("base_address", &mut fields.base_address, log2(f.base_words)),
            ("index_enable", &mut fields.index_enable, indexed),
            ("index_address", &mut fields.index_address, indexed * log2(f.index_words)),
            ("shift", &mut fields.shift, log2(f.shifts.len() as u32)),
            ("write_own", &mut fields.write_own, 1),
            ("write_base", &mut fields.write_base, 1),
            ("write_factor", &mut fields.write_factor, u32::from(f.factor)),
            ("write_swap", &mut fields.write_swap, swap),
            ("write_ring", &mut fields.write_ring, ring),
            ("write_address", &mut fields.write_address, log2(deepest)),
            ("write_index", &mut fields.write_index, indexed),
            ("write_octave", &mut fields.write_octave, indexed * u32::from(f.octave_width > 0)),
            ("write_index_address", &mut fields.write_index_address, indexed * log2(f.index_words)),
            ("show", &mut fields.show, u32::from(f.shown_words > 0)),
            ("send", &mut fields.send, u32::from(f.send)),
            ("receive_enable", &mut fields.receive_enable, imports),
            ("receive_swap", &mut fields.receive_swap, imports * swap),
            ("receive_ring", &mut fields.receive_ring, imports * ring),
            ("receive_address", &mut fields.receive_address, imported),
            ("port", &mut fields.port, log2(f.ports)),
        ];
        let bits: u32 = list.iter().map(|(_, _, width)| width).sum();
        let (mut lsb, mut names) = (bits, Vec::new());
        for (name, field, width) in list {
            lsb -= width;
            *field = Field { lsb, width };
            if width > 0 {
                names.push((name, *field));
            }
        }
        Fields { names, bits, ..fields }
    }
}

/// What drives a port of a PE.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// The link register of a PE.
    Link(usize),
    /// An input or a tick, by what it is made of, and whether it takes what is at its port in every word, and not just
    /// when a step begins.
    Input(String, bool),
}

/// Initial words of a memory.
pub type Image = Vec<u128>;

/// A PE with what it runs.
#[derive(Clone, Debug, Default)]
pub struct Pe {
    /// Generics.
    pub features: Features,
    /// Layout of the control word.
    pub fields: Fields,
    /// The control word of each word of a step.
    pub words: Vec<u128>,
    /// The very first word after configuration.
    pub first: u128,
    /// Own, base, coefficient, imported memory.
    pub images: [Image; 4],
    /// What the ports are wired to, port 0 first.
    pub ports: Vec<Source>,
    /// Whether it is told of the first pass.
    pub settles: bool,
    /// Words whose write group an output shows, with its port, and whether that clamps.
    pub outputs: Vec<(u32, String, bool)>,
}

impl Pe {
    /// Number of words that outputs show.
    pub fn shown(&self) -> usize {
        self.outputs.iter().map(|(word, ..)| word).collect::<BTreeSet<_>>().len()
    }
}

/// What the hand-written files make of the control words, as far as a damage of them is one of the words' meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// Words by which the first pass ends before the pause word.
    pub settled_early: u32,
    /// Whether in the first pass own, base, coefficient, imported and index memories are not written.
    pub waits: [bool; 5],
    /// Whether words that are written to own, base, coefficient and index memory, or sent, set the sticky flag.
    pub flagged: [bool; 5],
    /// Whether sums of two operands do.
    pub sums_flagged: bool,
    /// Whether bases are written in the last round only, where a PE is told so.
    pub last_round: bool,
    /// Whether base memories take write addresses as control words have them, and not as own memories do.
    pub bases_plain: bool,
    /// Whether a base is added only in words that enable it.
    pub bases_enabled: bool,
    /// Whether outputs clamp what is out of range.
    pub outputs_clamp: bool,
    /// Whether a link takes its word with the clock that executes the control word, and not before.
    pub links_wait: bool,
}

impl Default for Rules {
    fn default() -> Rules {
        Rules {
            settled_early: 0,
            waits: [true; 5],
            flagged: [true; 5],
            sums_flagged: true,
            last_round: true,
            bases_plain: true,
            bases_enabled: true,
            outputs_clamp: true,
            links_wait: true,
        }
    }
}

/// A network with its programs.
#[derive(Clone, Debug, Default)]
pub struct Design {
    /// Words of a step.
    pub period: u32,
    /// Rounds of a step.
    pub rounds: u32,
    /// Clocks of the multiplier.
    pub multiplier: u32,
    /// Registers more of the deep pipeline.
    pub deep: bool,
    /// The PEs.
    pub pes: Vec<Pe>,
    /// Bits of stored word, data port and coefficient port.
    pub widths: [u32; 3],
    /// Bits of inputs and outputs.
    pub port_bits: u32,
    /// Initial word of every index memory.
    pub index_image: u128,
    /// What makes the base of words without one.
    pub offset: String,
    /// What is done with all of that.
    pub rules: Rules,
}

impl Design {
    /// Reads package and network.
    ///
    /// # Errors
    /// What is missing or not understood.
    pub fn read(package: &Package, network: &Network) -> Result<Design, String> {
        let scalar = |name: &str| package.scalars.get(name).copied().ok_or_else(|| format!("no constant {name}"));
        let sequencer = network.of("pe_sequencer").next().ok_or("no sequencer")?;
        let widths = [scalar("WORD_BITS")?, scalar("DATA_BITS")?, scalar("COEFFICIENT_BITS")?];
        let (small, large) = (widths[1].min(widths[2]), widths[1].max(widths[2]));
        let mut design = Design {
            period: scalar("PERIOD")?,
            rounds: scalar("ROUNDS")?,
            multiplier: if small <= 18 && large <= 25 { 1 } else { 3 },
            deep: sequencer.generics.get("DEEP").is_some_and(|deep| deep.value == "true"),
            pes: Vec::new(),
            widths,
            port_bits: scalar("STORAGE_BITS")?,
            index_image: 0,
            offset: String::new(),
            rules: Rules::default(),
        };
        // A word that nobody takes would set the flag of an input that is clamped.
        let inputs = inputs(network, design.deep || widths[1] < design.port_bits);
        for instance in network.of("pe") {
            let index = design.pes.len();
            design.pes.push(design.pe(index, instance, package, network, &inputs)?);
        }
        for output in network.of("pe_output") {
            let word = value(output, "CAPTURE_WORD")?;
            let shown = port(output, "word_i")?.strip_prefix("word_").and_then(|pe| pe.parse::<usize>().ok());
            let pe = shown.and_then(|pe| design.pes.get_mut(pe)).ok_or("an output of no PE")?;
            let clamps = output.generics.get("SATURATE").is_none_or(|generic| generic.value != "false");
            pe.outputs.push((word, port(output, "value_o")?.to_owned(), clamps));
        }
        if let Some(reader) = network.of("pe_output_reader").next() {
            design.read_outputs(reader, package)?;
        }
        Ok(design)
    }

    /// Outputs in memories: the words that PEs show get places in the order from the pause point on, and the first ones
    /// anew where the memory is full.
    fn read_outputs(&mut self, reader: &Instance, package: &Package) -> Result<(), String> {
        let place_bits = value(reader, "PLACE_BITS")?;
        let clamps = reader.generics.get("SATURATE").is_none_or(|generic| generic.value != "false");
        let rows = package.arrays.get("OUTPUT_PLACES").ok_or("no constant OUTPUT_PLACES")?;
        let pause = self.multiplier + if self.deep { 9 } else { 6 };
        let (period, last) = (self.period, self.period / self.rounds * (self.rounds - 1));
        let since = |word: u32| (word + period - pause % period) % period;
        let mut memories: Vec<&mut Pe> = self.pes.iter_mut().filter(|pe| pe.features.shown_words > 0).collect();
        for (output, row) in rows.words.iter().enumerate() {
            let (memory, place) = ((row.value >> place_bits) as usize, row.value as u32 & ((1 << place_bits) - 1));
            let Some(pe) = memories.get_mut(memory) else { continue };
            let words = (0..).zip(&pe.words).filter(|(_, word)| pe.fields.show.set(**word)).map(|(word, _)| word);
            let mut words: Vec<u32> = words.filter(|word| !pe.features.show_last || since(*word) >= last).collect();
            words.sort_unstable_by_key(|word| since(*word));
            let depth = pe.features.shown_words;
            let of_place = (0..).zip(&words).filter(|(number, _)| *number % depth == place % depth).last();
            if let Some((_, word)) = of_place {
                pe.outputs.push((*word, format!("output {output}"), clamps));
            }
        }
        Ok(())
    }

    fn pe(
        &self,
        index: usize,
        instance: &Instance,
        package: &Package,
        network: &Network,
        inputs: &BTreeMap<String, (String, bool)>,
    ) -> Result<Pe, String> {
        let number = |name| value(instance, name);
        let optional = |name: &str| instance.generics.get(name).map_or(Ok(0), |_| value(instance, name));
        let flag = |name: &str| instance.generics.get(name).is_some_and(|generic| generic.value == "true");
        let features = Features {
            own_words: number("OWN_WORDS")?,
            base_words: number("BASE_WORDS")?,
            coefficient_words: number("COEFF_WORDS")?,
            imported_words: number("IMPORTED_WORDS")?,
            ports: number("PORT_COUNT")?,
            shifts: shifts(instance)?,
            factor: flag("FACTOR"),
            pre_adder: flag("PRE_ADDER"),
            swap: flag("SWAP"),
            base_last: flag("BASE_LAST"),
            send: flag("SEND"),
            index_words: optional("INDEX_WORDS")?,
            index_width: optional("INDEX_WIDTH")?,
            octave_width: optional("OCTAVE_WIDTH")?,
            accumulator_bits: number("ACCUMULATOR_BITS")?,
            saturate: instance.generics.get("SATURATE").is_none_or(|generic| generic.value != "false"),
            shown_words: match network.instances.iter().find(|other| other.label == format!("u_outputs_{index}")) {
                Some(memory) if flag("SHOWS") => value(memory, "WORDS")?,
                _ => 0,
            },
            show_last: flag("SHOW_LAST"),
            ring_bits: optional("RING_BITS")?,
        };
        let fields = Fields::of(&features, self.widths[2]);
        let (words, first) = self.words(index, &fields, package)?;
        let image = |kind: &str| -> Result<Image, String> {
            let name = format!("PE{index}_{kind}_IMAGE");
            let array = package.arrays.get(&name).ok_or_else(|| format!("no constant {name}"))?;
            Ok(array.words.iter().map(|word| word.value).collect())
        };
        let wired = network.assignments.get(&format!("ports_{index}")).ok_or("a PE without ports")?;
        // Port 0 is the rightmost one.
        let ports: Vec<Source> = match wired.value.contains("others") {
            true => Vec::new(),
            false => wired.value.rsplit('&').map(|name| source(name.trim(), inputs)).collect::<Result<_, _>>()?,
        };
        let images = [image("OWN")?, image("BASE")?, image("COEFFICIENT")?, image("IMPORTED")?];
        let settles = match port(instance, "settle_i")? {
            "settle" => true,
            "'0'" => false,
            other => return Err(format!("{}: settle_i is `{other}`", instance.label)),
        };
        Ok(Pe { features, fields, words, first, images, ports, settles, outputs: Vec::new() })
    }

    /// The control words of a step and the very first one, put together from the program memories.
    fn words(&self, index: usize, fields: &Fields, package: &Package) -> Result<(Vec<u128>, u128), String> {
        let (period, rounds) = (self.period as usize, self.rounds as usize);
        let length = period / rounds;
        let array = |kind: &str| package.arrays.get(&format!("PE{index}_{kind}"));
        let (looped, stream, variants) = (array("LOOP"), array("STREAM"), array("VARIANTS"));
        let all = u128::MAX >> (128 - fields.bits);
        let streamed = match package.masks.get(&format!("PE{index}_STREAMED")) {
            Some(mask) => mask.value,
            None if looped.is_some() => 0,
            None => all,
        };
        let kept = all & !streamed;
        let turns = rounds.next_power_of_two();
        let word = |k: usize, first: bool| -> Option<u128> {
            let (round, place) = (k / length, k % length);
            let repeated = match looped {
                Some(looped) => spread(looped.words.get(place)?.value, kept),
                None => 0,
            };
            let moving = match (variants, stream) {
                (Some(variants), _) => {
                    let before = if place == 0 { length - 1 } else { place - 1 };
                    let variant = if first { 0 } else { looped?.words.get(before)?.value >> kept.count_ones() };
                    let at = variant as usize * turns + round;
                    // Words beyond the content are 0 in the memory.
                    spread(variants.words.get(at).map_or(0, |word| word.value), streamed)
                }
                (None, Some(stream)) => spread(stream.words.get(k)?.value, streamed),
                (None, None) => 0,
            };
            Some(repeated | moving)
        };
        let words: Option<Vec<u128>> = (0..period).map(|k| word(k, false)).collect();
        words.zip(word(0, true)).ok_or_else(|| format!("the program of PE {index} is incomplete"))
    }

    /// The word before which the network waits.
    pub fn pause(&self) -> u32 {
        let (operand, addend) = if self.deep { (2, 1) } else { (0, 0) };
        operand + self.multiplier + addend + 6
    }
}

/// Puts the bits of a memory's word to their places in the control word, which the ones of `mask` are.
fn spread(packed: u128, mask: u128) -> u128 {
    let places = (0..128).filter(|place| mask >> place & 1 == 1);
    (0..).zip(places).fold(0, |word, (bit, place): (u32, u32)| word | (packed >> bit & 1) << place)
}

fn value(instance: &Instance, generic: &str) -> Result<u32, String> {
    let text = instance.generics.get(generic).map(|generic| generic.value.as_str()).unwrap_or_default();
    text.parse().map_err(|_| format!("{}: {generic} is `{text}`", instance.label))
}

fn port<'a>(instance: &'a Instance, name: &str) -> Result<&'a str, String> {
    let port: Option<&Association> = instance.ports.get(name);
    port.map(|port| port.value.as_str()).ok_or_else(|| format!("{}: no {name}", instance.label))
}

/// The shift positions of a PE: `(0 => 23, 1 => 24)`.
pub fn shifts(instance: &Instance) -> Result<Vec<u32>, String> {
    let text = instance.generics.get("SHIFTS").map(|shifts| shifts.value.as_str()).unwrap_or_default();
    let element = |element: &str| element.split("=>").nth(1)?.trim().parse().ok();
    let list: Option<Vec<u32>> = text.trim_matches(['(', ')']).split(',').map(element).collect();
    list.ok_or_else(|| format!("{}: SHIFTS is `{text}`", instance.label))
}

/// What each operand of an input or a tick is made of, by its signal, and whether it is made in every word. That is
/// told only of inputs that are not `late`: clamped, or with a second register.
fn inputs(network: &Network, late: bool) -> BTreeMap<String, (String, bool)> {
    let of = |instance: &Instance| {
        let sample = instance.ports.get("sample_i").map(|port| port.value.as_str());
        let always = sample == Some("fetch") && instance.entity == "pe_input" && !late;
        let told = always || sample == Some("sample");
        let all = instance.generics.iter().chain(&instance.ports);
        let all = all.filter(|(name, _)| !(name.ends_with("_o") || told && *name == "sample_i"));
        let made: Vec<String> = all.map(|(_, v)| v.value.clone()).collect();
        Some((instance.ports.get("operand_o")?.value.clone(), (made.join(" "), always)))
    };
    network.of("pe_input").chain(network.of("pe_tick")).filter_map(of).collect()
}

fn source(name: &str, inputs: &BTreeMap<String, (String, bool)>) -> Result<Source, String> {
    let link = name.strip_prefix("link_").and_then(|pe| pe.parse().ok()).map(Source::Link);
    let input = || inputs.get(name).map(|(made, always)| Source::Input(made.clone(), *always));
    link.or_else(input).ok_or_else(|| format!("a port of `{name}`"))
}
