//! Proof that a damage of programs, images or wiring has no effect, by the rules of the datasheet.
//!
//! Two networks, the design's and the damaged one, execute the control words of a step side by side with symbols in
//! place of numbers: a product, a sum, a rounded word is a symbol made of those that it depends on, and means the same
//! number in both if it is the same symbol. It is an induction over steps. What is stored between two steps is first
//! taken for constant, then for equal, then for different, until a step keeps what was supposed; the proof holds if all
//! memory writes, outputs and words that may saturate are the same symbols then. Nothing is computed, so it holds for
//! all states, inputs and times, also for those that no run reaches.

use std::collections::BTreeSet;

use super::bounds::Bounds;
use super::datasheet::{Design, Features, Pe, Source, log2};
use super::symbols::{Id, Node, Symbols, UNKNOWN_SHIFT, ZERO};

/// What can be seen of a step: place and symbols.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Seen {
    Write {
        word: u32,
        pe: usize,
        address: u64,
        value: Id,
    },
    Receive {
        word: u32,
        pe: usize,
        address: u64,
        value: Id,
    },
    Output {
        port: String,
        step: u32,
        value: Id,
    },
    /// A word that sets the sticky flag if it saturated, or operands that do if they are too large for their sum.
    MaySaturate(usize, Id),
    MayBeTooLarge(usize, Id),
    /// A word that an output clamps if rounding takes it out of range.
    MayClamp(String, Id),
}

impl Seen {
    /// Whether bounds show that nothing is seen of it.
    fn is_empty(&self, bounds: &mut Bounds) -> bool {
        match self {
            Seen::MaySaturate(_, word) => !bounds.may_saturate(*word),
            Seen::MayBeTooLarge(_, both) => !bounds.may_be_too_large(*both),
            Seen::MayClamp(_, word) => !bounds.may_clamp(*word),
            _ => false,
        }
    }
}

/// Places of [`Rules::waits`](super::datasheet::Rules::waits).
const OWN: usize = 0;
const BASE: usize = 1;
const FACTOR: usize = 2;
const IMPORTED: usize = 3;
const INDEX: usize = 4;

/// Words, registers and pipelines of a PE.
#[derive(Clone, Debug, PartialEq, Eq)]
struct PeState {
    own: Vec<Id>,
    base: Vec<Id>,
    coefficient: Vec<Id>,
    imported: Vec<Id>,
    index: Vec<Id>,
    /// Index that the next base address takes.
    fetched: Id,
    running: Id,
    held: Id,
    link: Id,
    /// Products on their way to the sum, the oldest first.
    products: Vec<Id>,
    /// Base word of the scale group of the word before, and its shift.
    scaled: (Id, u32),
    /// Words on their way to the write group, the oldest first.
    words: Vec<Id>,
}

/// A network between two words.
#[derive(Clone, Debug, PartialEq, Eq)]
struct State {
    pes: Vec<PeState>,
    inputs: Vec<Vec<Id>>,
}

impl State {
    /// After configuration.
    fn configured(design: &Design, symbols: &mut Symbols) -> State {
        let index = symbols.of(Node::Constant(design.index_image));
        let mut image = |words: &[u128], depth: u32| -> Vec<Id> {
            let word = |at: usize| words.get(at).copied().unwrap_or(0);
            (0..depth as usize).map(|at| symbols.of(Node::Constant(word(at)))).collect()
        };
        let (operand, addend) = if design.deep { (2, 1) } else { (0, 0) };
        let pe = |pe: &Pe| PeState {
            own: image(&pe.images[0], pe.features.own_words),
            base: image(&pe.images[1], pe.features.base_words),
            coefficient: image(&pe.images[2], pe.features.coefficient_words),
            imported: image(&pe.images[3], pe.features.imported_words),
            index: vec![index; pe.features.index_words as usize],
            fetched: ZERO,
            running: ZERO,
            held: ZERO,
            link: ZERO,
            products: vec![ZERO; (operand + design.multiplier + 1) as usize],
            scaled: (ZERO, 0),
            words: vec![ZERO; addend + 2],
        };
        let pes = design.pes.iter().map(pe).collect();
        let inputs = design.pes.iter().map(|pe| vec![ZERO; pe.ports.len()]).collect();
        State { pes, inputs }
    }

    /// Every place in turn.
    fn places(&mut self) -> Vec<&mut Id> {
        let mut places = Vec::new();
        for pe in &mut self.pes {
            let memories = [&mut pe.own, &mut pe.base, &mut pe.coefficient, &mut pe.imported, &mut pe.index];
            places.extend(memories.into_iter().flatten());
            places.extend([&mut pe.fetched, &mut pe.running, &mut pe.held, &mut pe.link, &mut pe.scaled.0]);
            places.extend(pe.products.iter_mut().chain(&mut pe.words));
        }
        places.extend(self.inputs.iter_mut().flatten());
        places
    }

    /// Moves rings back by so many steps: from there on the next ones do what these did.
    fn turn_back(&mut self, rings: &Rings, steps: u32, design: &Design) {
        for ((state, rings), pe) in self.pes.iter_mut().zip(rings).zip(&design.pes) {
            let words = 1usize << pe.features.ring_bits;
            for (memory, rings) in [&mut state.own, &mut state.imported].into_iter().zip(rings) {
                for first in rings {
                    memory[*first as usize..][..words].rotate_left(steps as usize % words);
                }
            }
        }
    }

    fn symbols(&mut self) -> Vec<Id> {
        self.places().into_iter().map(|place| *place).collect()
    }
}

/// Executes control words.
struct Run<'a> {
    design: &'a Design,
    state: State,
    seen: BTreeSet<Seen>,
    /// Word from which on it is looked at what may be clamped.
    clamping_from: u32,
}

impl Run<'_> {
    /// Executes words `from .. to`, counted from the very first one.
    fn execute(&mut self, symbols: &mut Symbols, from: u32, to: u32) {
        for count in from..to {
            self.word(symbols, count);
        }
    }

    fn word(&mut self, symbols: &mut Symbols, count: u32) {
        let Design { period, rounds, .. } = *self.design;
        let (pause, length) = (self.design.pause(), period / rounds);
        let settle = count < pause - self.design.rules.settled_early;
        let parity = count / length % 2 == 1;
        let last = count >= pause && (count - pause) / length % rounds == rounds - 1;
        let turn = count / period;
        let place = Place { count, word: count % period, settle, parity, last, turn };
        let link = |(pe, state): (&Pe, &PeState)| {
            // A clock in which nothing is executed comes before the word or does not.
            let sends = pe.fields.send.set(bits_of(pe, &place));
            let early = sends && !self.design.rules.links_wait;
            if early { symbols.of(Node::Data(state.words[0])) } else { state.link }
        };
        let links: Vec<Id> = self.design.pes.iter().zip(&self.state.pes).map(link).collect();
        for index in 0..self.design.pes.len() {
            self.pe(symbols, index, &place, &links);
        }
        // The step begins with the word at which the network waits, and so do its inputs.
        let begins = count >= pause && (count - pause).is_multiple_of(period);
        for (pe, operands) in self.design.pes.iter().zip(&mut self.state.inputs) {
            for (source, operand) in pe.ports.iter().zip(operands) {
                match source {
                    Source::Input(made, _) if begins => *operand = symbols.of(Node::Input(made.clone(), count)),
                    Source::Input(made, true) => *operand = symbols.of(Node::Input(made.clone(), count)),
                    _ => {}
                }
            }
        }
    }

    fn pe(&mut self, symbols: &mut Symbols, index: usize, place: &Place, links: &[Id]) {
        let pe = &self.design.pes[index];
        let reads = self.reads(symbols, index, place, links);
        let state = &mut self.state.pes[index];
        let written = state.words[0];
        state.advance(symbols, self.design, pe, place, &reads);
        for (word, port, clamps) in &pe.outputs {
            // What the first pass shows is published by nobody.
            if *word == place.word && !place.settle {
                self.seen.insert(Seen::Output { port: port.clone(), step: place.count, value: written });
                if *clamps && self.design.rules.outputs_clamp && place.count >= self.clamping_from {
                    self.seen.insert(Seen::MayClamp(port.clone(), written));
                }
            }
        }
        self.write(symbols, index, place, written, reads.received);
    }

    /// What the word reads, all from before the word.
    fn reads(&mut self, symbols: &mut Symbols, index: usize, place: &Place, links: &[Id]) -> Reads {
        let pe = &self.design.pes[index];
        let (f, features, rules) = (&pe.fields, &pe.features, self.design.rules);
        let bits = bits_of(pe, place);
        let state = &self.state.pes[index];
        let read = |memory: &[Id], address: u64| memory[address as usize & (memory.len() - 1)];
        let own = f.own_enable.set(bits).then(|| {
            let address = place.steered(f.own_address.of(bits), f.own_swap.set(bits), features.own_words);
            read(&state.own, place.turned(address, f.own_ring.set(bits), features.ring_bits))
        });
        let imported = f.imported_enable.set(bits).then(|| {
            let address = f.imported_address.of(bits);
            let address = place.steered(address, f.imported_swap.set(bits), features.imported_words);
            read(&state.imported, place.turned(address, f.imported_ring.set(bits), features.ring_bits))
        });
        let factor = if features.coefficient_words > 0 {
            read(&state.coefficient, f.coefficient_address.of(bits))
        } else {
            symbols.of(Node::Constant(f.coefficient.of(bits).into()))
        };
        let operand = match (own, imported) {
            (Some(own), Some(imported)) => {
                let both = symbols.of(Node::Both(own, imported, features.pre_adder));
                if !place.settles(pe) && rules.sums_flagged && place.count >= self.clamping_from {
                    self.seen.insert(Seen::MayBeTooLarge(index, both));
                }
                both
            }
            (one, other) => one.or(other).unwrap_or(ZERO),
        };
        let base = (f.base_enable.set(bits) || !rules.bases_enabled).then(|| {
            let address = f.base_address.of(bits);
            if state.fetched == ZERO {
                return read(&state.base, address);
            }
            let entries = (0..1u64 << features.index_width).map(|entry| read(&state.base, address | entry)).collect();
            symbols.of(Node::Chosen(state.fetched, entries))
        });
        let fetched = if f.index_enable.set(bits) { read(&state.index, f.index_address.of(bits)) } else { ZERO };
        let received = f.receive_enable.set(bits).then(|| match pe.ports.get(f.port.of(bits) as usize) {
            Some(Source::Link(link)) => links.get(*link).copied().unwrap_or(ZERO),
            Some(Source::Input(..)) => self.state.inputs[index][f.port.of(bits) as usize],
            None => symbols.of(Node::NoPort),
        });
        Reads { operand, factor, base, fetched, received }
    }

    /// Writes a word to the memories that the control word names, to the link, and what was received.
    fn write(&mut self, symbols: &mut Symbols, index: usize, place: &Place, written: Id, received: Option<Id>) {
        let pe = &self.design.pes[index];
        let (f, features, rules) = (&pe.fields, &pe.features, self.design.rules);
        let bits = bits_of(pe, place);
        let state = &mut self.state.pes[index];
        // In the first pass nothing is written; sending is not disabled.
        let writes = |memory: usize| !(place.settles(pe) && rules.waits[memory]);
        let in_round = place.last || !features.base_last || !rules.last_round;
        let takes_base = f.write_base.set(bits) && in_round && writes(BASE);
        let (takes_own, takes_factor) =
            (f.write_own.set(bits) && writes(OWN), f.write_factor.set(bits) && writes(FACTOR));
        let plain = f.write_address.of(bits);
        let address = place.steered(plain, f.write_swap.set(bits), features.own_words);
        let address = place.turned(address, f.write_ring.set(bits), features.ring_bits);
        let based = if rules.bases_plain { plain } else { address };
        if takes_own || takes_base || takes_factor {
            self.seen.insert(Seen::Write { word: place.count, pe: index, address, value: written });
        }
        let data = symbols.of(Node::Data(written));
        let at = |memory: &[Id], address: u64| address as usize & (memory.len() - 1);
        if takes_own {
            let at = at(&state.own, address);
            state.own[at] = data;
        }
        if takes_base {
            let at = at(&state.base, based);
            state.base[at] = written;
        }
        if takes_factor {
            let at = at(&state.coefficient, plain);
            state.coefficient[at] = symbols.of(Node::Factor(written));
        }
        let takes_index = f.write_index.set(bits) && writes(INDEX);
        if takes_index {
            let at = f.write_index_address.of(bits) as usize;
            state.index[at] = symbols.of(Node::Segment(written, f.write_octave.set(bits)));
        }
        if f.send.set(bits) {
            state.link = data;
        }
        let sends = f.send.set(bits) && !place.settles(pe);
        let flagging = [takes_own, takes_base, takes_factor, takes_index, sends];
        let flagged = flagging.into_iter().zip(rules.flagged).any(|(takes, flagged)| takes && flagged);
        // A word without a sum is a word that is stored already, or the offset.
        let looked_at = place.count >= self.clamping_from;
        if flagged && looked_at && matches!(symbols.nodes[written as usize], Node::Word(..)) {
            self.seen.insert(Seen::MaySaturate(index, written));
        }
        if let Some(received) = received.filter(|_| writes(IMPORTED)) {
            let address = place.steered(f.receive_address.of(bits), f.receive_swap.set(bits), features.imported_words);
            let address = place.turned(address, f.receive_ring.set(bits), features.ring_bits);
            self.seen.insert(Seen::Receive { word: place.count, pe: index, address, value: received });
            let at = address as usize & (state.imported.len() - 1);
            state.imported[at] = received;
        }
    }
}

/// What a control word reads.
struct Reads {
    operand: Id,
    factor: Id,
    /// None where the offset is the base.
    base: Option<Id>,
    fetched: Id,
    received: Option<Id>,
}

impl PeState {
    /// Registers and pipelines take what was read.
    fn advance(&mut self, symbols: &mut Symbols, design: &Design, pe: &Pe, place: &Place, reads: &Reads) {
        let (f, bits) = (&pe.fields, bits_of(pe, place));
        let offset = symbols.of(Node::Offset(design.offset.clone()));
        let (scaled, shift) = self.scaled;
        let next = symbols.word(scaled, self.held, shift);
        self.words.remove(0);
        self.words.push(next);
        self.scaled = (reads.base.unwrap_or(offset), position(&pe.features, f.shift.of(bits)));
        self.fetched = reads.fetched;
        let kept = if f.close.set(bits) { ZERO } else { self.running };
        if f.close.set(bits) {
            self.held = self.running;
        }
        let product = self.products.remove(0);
        self.products.push(symbols.product(reads.operand, reads.factor));
        self.running = symbols.sum(kept, product);
    }
}

/// The control word that a PE executes.
fn bits_of(pe: &Pe, place: &Place) -> u128 {
    if place.count == 0 { pe.first } else { pe.words[place.word as usize] }
}

/// What a shift index means; indices without a position of their own are told apart.
fn position(features: &Features, index: u64) -> u32 {
    features.shifts.get(index as usize).copied().unwrap_or(UNKNOWN_SHIFT + index as u32)
}

/// Where a word stands.
struct Place {
    count: u32,
    word: u32,
    settle: bool,
    parity: bool,
    last: bool,
    /// Number of the step.
    turn: u32,
}

impl Place {
    /// Whether it is in the first pass, as far as a PE is told.
    fn settles(&self, pe: &Pe) -> bool {
        self.settle && pe.settles
    }

    /// An address of a ring, which moves on with every step, or another one.
    fn turned(&self, address: u64, ring: bool, ring_bits: u32) -> u64 {
        let mask = (1u64 << ring_bits) - 1;
        if ring { address & !mask | (address + u64::from(self.turn)) & mask } else { address }
    }

    /// An address of a memory of so many words whose halves may have changed roles.
    fn steered(&self, address: u64, swap: bool, words: u32) -> u64 {
        if swap && self.parity { address ^ (1u64 << log2(words) >> 1) } else { address }
    }
}

/// First words of the rings in the own and in the imported memory of each PE.
type Rings = Vec<[BTreeSet<u64>; 2]>;

/// The rings of a design: in each step they are what they were in the one before, moved on by a word, if nothing takes their words
/// for others.
///
/// # Errors
/// Something does.
fn rings(design: &Design) -> Result<Rings, String> {
    let of = |(index, pe): (usize, &Pe)| {
        let (f, features) = (&pe.fields, &pe.features);
        let mask = !((1u64 << features.ring_bits) - 1);
        let mut rings = [BTreeSet::new(), BTreeSet::new()];
        let mut others = [BTreeSet::new(), BTreeSet::new()];
        for bits in pe.words.iter().copied().chain([pe.first]) {
            let accesses = [
                (0, f.own_enable.set(bits), f.own_address, f.own_ring.set(bits), features.own_words),
                (0, f.write_own.set(bits), f.write_address, f.write_ring.set(bits), features.own_words),
                (
                    1,
                    f.imported_enable.set(bits),
                    f.imported_address,
                    f.imported_ring.set(bits),
                    features.imported_words,
                ),
                (1, f.receive_enable.set(bits), f.receive_address, f.receive_ring.set(bits), features.imported_words),
            ];
            for (memory, _, address, ring, depth) in accesses.into_iter().filter(|(_, enabled, ..)| *enabled) {
                let depth = u64::from(depth);
                let word = address.of(bits) & depth.wrapping_sub(1);
                if ring {
                    rings[memory].insert(word & mask);
                } else {
                    // The halves of a memory may change roles.
                    others[memory]
                        .extend([word & mask, (word ^ (depth / 2)) & mask].iter().take(1 + usize::from(features.swap)));
                }
            }
        }
        match rings.iter().zip(&others).all(|(rings, others)| rings.is_disjoint(others)) {
            true => Ok(rings),
            false => Err(format!("PE {index} takes words of a ring for others")),
        }
    };
    design.pes.iter().enumerate().map(of).collect()
}

/// What is supposed of a place between two steps.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Supposed {
    Constant(Id),
    Equal,
    Different,
}

/// Whether a damaged design writes, shows and flags the same as the design in every step from every state; what is seen
/// first to differ otherwise.
///
/// # Errors
/// Why there is no proof.
pub fn equal(design: &Design, damaged: &Design) -> Result<(), String> {
    let pes = design.pes.iter().zip(&damaged.pes);
    let shapes = |a: &Pe, b: &Pe| {
        let depths = |pe: &Pe| {
            let f = &pe.features;
            [f.own_words, f.base_words, f.coefficient_words, f.imported_words, f.index_words, f.ring_bits]
        };
        depths(a) == depths(b) && a.ports.len() == b.ports.len()
    };
    let alike = [design.period, design.rounds, design.multiplier]
        == [damaged.period, damaged.rounds, damaged.multiplier]
        && design.deep == damaged.deep
        && design.widths == damaged.widths;
    if !alike || design.pes.len() != damaged.pes.len() || !pes.clone().all(|(a, b)| shapes(a, b)) {
        return Err("the networks have other memories or another timing".into());
    }
    let of_design = rings(design)?;
    if of_design != rings(damaged)? {
        return Err("the networks have other rings".into());
    }
    let symbols = &mut Symbols::new();
    let pause = design.pause();
    let mut runs = [design, damaged].map(|design| {
        let state = State::configured(design, symbols);
        Run { design, state, seen: BTreeSet::new(), clamping_from: 0 }
    });
    for run in &mut runs {
        run.execute(symbols, 0, pause);
    }
    difference(&runs, symbols)?;
    // Of the first step it is known what it begins with. Of the others, what was begun in front of it is not, so that
    // what may be clamped is looked at in the second one of two.
    let mut first = runs.each_ref().map(|run| Run { state: run.state.clone(), seen: BTreeSet::new(), ..*run });
    for run in &mut first {
        run.execute(symbols, pause, pause + design.period);
    }
    difference(&first, symbols)?;
    runs.iter_mut().for_each(|run| run.clamping_from = pause + design.period);
    let [own, other] = [0, 1].map(|side| runs[side].state.symbols());
    let mut supposed: Vec<Supposed> = own
        .iter()
        .zip(&other)
        .map(|(own, other)| match own == other {
            true if symbols.is_constant(*own) => Supposed::Constant(*own),
            true => Supposed::Equal,
            false => Supposed::Different,
        })
        .collect();
    // Buffers change roles in every round, so two steps are one turn, or two.
    let steps = 2;
    loop {
        for (side, run) in (0..).zip(&mut runs) {
            let places = run.state.places().into_iter().zip(&supposed);
            for (at, (place, supposed)) in (0..).zip(places) {
                *place = match supposed {
                    Supposed::Constant(id) => *id,
                    Supposed::Equal => symbols.of(Node::Stored(at, 0)),
                    Supposed::Different => symbols.of(Node::Stored(at, 1 + side)),
                };
            }
            // The shift of the word before the step is not a place: it is the program's.
            let word = (pause + design.period - 1) % design.period;
            for (pe, state) in run.design.pes.iter().zip(&mut run.state.pes) {
                state.scaled.1 = position(&pe.features, pe.fields.shift.of(pe.words[word as usize]));
            }
            run.seen.clear();
            run.execute(symbols, pause, pause + steps * design.period);
            run.state.turn_back(&of_design, steps, run.design);
        }
        let [own, other] = [0, 1].map(|side| runs[side].state.symbols());
        let mut kept = true;
        for ((supposed, own), other) in supposed.iter_mut().zip(own).zip(other) {
            let now = match supposed {
                Supposed::Constant(id) if *id == own && own == other => continue,
                Supposed::Constant(_) | Supposed::Equal if own == other => Supposed::Equal,
                _ => Supposed::Different,
            };
            kept &= now == *supposed;
            *supposed = now;
        }
        if kept {
            break;
        }
    }
    difference(&runs, symbols)
}

/// What only one of two networks shows.
fn difference(runs: &[Run; 2], symbols: &Symbols) -> Result<(), String> {
    let mut bounds = Bounds::new(runs[0].design, &symbols.nodes);
    let mut only = runs[0].seen.symmetric_difference(&runs[1].seen);
    let seen = only.find(|seen| !seen.is_empty(&mut bounds));
    seen.map_or(Ok(()), |seen| Err(described(seen, runs[0].design)))
}

fn described(seen: &Seen, design: &Design) -> String {
    match seen {
        Seen::Write { word, pe, address, .. } => {
            format!("PE {pe} may write another word to {address:x} in word {}", word % design.period)
        }
        Seen::Receive { word, pe, address, .. } => {
            format!("PE {pe} may receive another operand to {address:x} in word {}", word % design.period)
        }
        Seen::Output { port, .. } => format!("`{port}` may be another word"),
        Seen::MaySaturate(..) => "another word may set a sticky flag".into(),
        Seen::MayBeTooLarge(..) => "other operands may be too large for their sum".into(),
        Seen::MayClamp(port, _) => format!("`{port}` may be clamped"),
    }
}
