//! Checks that every word of a ring has the age that it is read as, in all steps.
//!
//! A ring moves on by one place with every step, so what holds for one step holds for all, if
//!
//! 1. one control word of a step writes a ring, and nothing else writes or reads its words;
//! 2. each state of the ring begins as far behind the place that is written as its age says, and the state is one whose past the
//!    ring takes;
//! 3. no age is as large as the ring, so that a word is replaced when nothing reads it any more.
//!
//! What is written, and that reads find the states of the first step, is for [`super::program`] to prove.

use std::collections::BTreeMap;

use crate::graph::{Role, StepGraph, ValueId};
use crate::index::{List, PeId, StateId};
use crate::program::{Address, PeProgram, Program};

/// What writes a ring: the value, and its place as the step sees it to which the value belongs.
#[derive(Clone, Copy)]
struct Writer {
    value: Option<ValueId>,
    place: u16,
}

/// The rings of a memory, by their first words.
type Rings = BTreeMap<u16, Writer>;

/// Returns what is wrong with the rings of a program; empty if nothing is.
pub(super) fn check(program: &Program, graph: &StepGraph) -> Vec<String> {
    let mut violations = Vec::new();
    let pes: Vec<[Rings; 2]> = program.pes.numbered().map(|(pe, of)| rings(program, pe, of, &mut violations)).collect();
    if program.states.len() != graph.states.len() {
        return vec!["the program has other states than the step".to_owned()];
    }
    let pasts = pasts(graph);
    for (state, past) in program.states.iter().zip(pasts) {
        if past.map(|(_, age)| age) != state.age.map(|age| age.get()) {
            violations.push(format!("`{}` has another age than in the step", state.name));
        }
        let Some((value, age)) = past else { continue };
        let places = std::iter::once((state.own, 0)).chain(state.imported.iter().map(|place| (*place, 1)));
        for ((pe, word), memory) in places {
            let mask = (1u32 << program.pes[pe].features.ring_bits) - 1;
            let ring = pes[pe.index()][memory].get(&(word & !(mask as u16)));
            let behind = ring
                .filter(|ring| ring.value == Some(value))
                .map(|ring| u32::from(ring.place.wrapping_sub(word)) & mask);
            if behind != Some(age) || age > mask {
                violations.push(format!("PE {pe}: `{}`, {age} steps old, begins in word {word} of a ring", state.name));
            }
        }
    }
    violations
}

/// For each state the value whose past it is, and its age; none if it is in no ring.
fn pasts(graph: &StepGraph) -> Vec<Option<(ValueId, u32)>> {
    let follows = |state: StateId| match graph.value(graph.states[state].1).role {
        Role::State(other) => Some(other),
        _ => None,
    };
    let mut known: List<StateId, Option<(ValueId, u32)>> = List::filled(None, graph.states.len());
    let mut followed = List::filled(false, graph.states.len());
    for state in graph.states.ids() {
        // All that are met on the way are known behind it, so that rows of any order are walked once. What goes round in a circle is
        // for `super::step` to find.
        let (mut last, mut met) = (state, Vec::new());
        while let Some(before) = follows(last).filter(|_| known[last].is_none() && met.len() <= graph.states.len()) {
            followed[before] = true;
            met.push(last);
            last = before;
        }
        let (value, mut age) = known[last].unwrap_or((graph.states[last].1, 1));
        known[last] = Some((value, age));
        for state in met.into_iter().rev() {
            age += 1;
            known[state] = Some((value, age));
        }
    }
    let in_ring =
        |(state, past): (StateId, Option<(ValueId, u32)>)| past.filter(|(_, age)| *age > 1 || followed[state]);
    graph.states.ids().zip(known.iter().copied()).map(in_ring).collect()
}

/// The rings of a PE's own and imported memory.
fn rings(program: &Program, index: PeId, pe: &PeProgram, violations: &mut Vec<String>) -> [Rings; 2] {
    let mask = ((1u32 << pe.features.ring_bits) - 1) as u16;
    let pause = program.latency().pause();
    let depths = [pe.features.own_words, pe.features.imported_words].map(|words| words.saturating_sub(1) as u16);
    let mut rings = [Rings::new(), Rings::new()];
    let writes = |word: u32| {
        let (control, note) = (&pe.words[word as usize], &pe.notes[word as usize]);
        let own = control.write.filter(|target| target.own).map(|target| (target.address, note.write));
        [own, control.receive.map(|(_, address)| (address, note.receive))]
    };
    for word in 0..program.period {
        for (rings, write) in rings.iter_mut().zip(writes(word)) {
            let Some((address, value)) = write.filter(|(address, _)| address.ring) else { continue };
            // What is written before the pause point belongs to the step before.
            let place = address.word.wrapping_add(u16::from(word < pause)) & mask | address.word & !mask;
            if rings.insert(address.word & !mask, Writer { value, place }).is_some() {
                violations.push(format!("PE {index}: word {word} writes a ring that another one writes"));
            }
        }
    }
    for word in 0..program.period {
        let control = &pe.words[word as usize];
        let reads = [control.own, control.imported];
        for (((rings, write), read), depth) in rings.iter().zip(writes(word)).zip(reads).zip(depths) {
            let inside = |address: &Address| {
                let word = address.word & depth;
                let other = if address.swap { word ^ (depth / 2 + 1) } else { word };
                rings.contains_key(&(word & !mask)) || rings.contains_key(&(other & !mask))
            };
            for address in write.map(|(address, _)| address).into_iter().chain(read) {
                if inside(&address) != address.ring {
                    violations.push(format!("PE {index}: word {word} takes a word of a ring for another one"));
                }
            }
        }
    }
    rings
}
