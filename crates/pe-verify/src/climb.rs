//! Starts in which results that nothing takes are too large. Such a result decides nothing but what a `send` in the
//! wrong control word would do, and random words hardly ever reach one: one start in 20,000 of a motor's controller. It
//! is a sum of products of few words, so a climb from word to word, each moved to the end of its format where that brings
//! the sum nearer to a limit, gets there soon if it can. A climb that ends below the limit proves nothing.

use std::collections::BTreeSet;

use pe_ir::index::PeId;
use pe_ir::program::{PeProgram, Program};
use pe_sim::clocked::Clocked;
use pe_sim::coverage::Coverage;

use crate::stimuli::{Candidate, observe, spread};

/// Control words of all PEs that the search may cost together in the simulator.
const BUDGET: u64 = 8_000_000;

/// Starts from which places are told apart: what has the same sums in all of them is one result.
const PROBES: u64 = 2;

/// A word that a climb may change.
#[derive(Clone, Copy, Debug)]
enum Coordinate {
    Own(PeId, usize),
    Base(PeId, usize),
    Imported(PeId, usize),
    Input(usize),
}

impl Coordinate {
    /// All that a step begins with, but entries of tables.
    fn all(program: &Program) -> Vec<Coordinate> {
        let mut coordinates = Vec::new();
        for (index, pe) in program.pes.numbered() {
            let entries = entries(pe);
            coordinates.extend((0..pe.own_image.len()).map(|word| Coordinate::Own(index, word)));
            let words = (0..pe.base_image.len()).filter(|word| !entries.contains(word));
            coordinates.extend(words.map(|word| Coordinate::Base(index, word)));
            coordinates.extend((0..pe.imported_image.len()).map(|word| Coordinate::Imported(index, word)));
        }
        coordinates.extend((0..program.ports().count()).map(Coordinate::Input));
        coordinates
    }

    fn of(self, candidate: &mut Candidate) -> &mut i64 {
        match self {
            Coordinate::Own(pe, word) => &mut candidate.program.pes[pe].own_image[word],
            Coordinate::Base(pe, word) => &mut candidate.program.pes[pe].base_image[word],
            Coordinate::Imported(pe, word) => &mut candidate.program.pes[pe].imported_image[word],
            Coordinate::Input(port) => &mut candidate.stimulus[0][port],
        }
    }

    fn bits(self, program: &Program) -> u32 {
        let format = &program.format;
        match self {
            Coordinate::Own(..) | Coordinate::Imported(..) => format.data_bits,
            Coordinate::Base(..) => format.word_bits(),
            Coordinate::Input(_) => format.storage_bits,
        }
    }
}

/// Base words of a PE that are entries of tables: those that are read with an index.
fn entries(pe: &PeProgram) -> BTreeSet<usize> {
    let segments = pe.features.segments().count();
    let indexed = pe.words.iter().enumerate().filter(|(k, _)| pe.takes_index(*k));
    let first = indexed.filter_map(|(_, word)| word.base);
    first.flat_map(|base| (0..segments).map(move |entry| usize::from(base) | entry)).collect()
}

/// Where a result that nothing takes was not seen to be too large: PE and control word.
fn unseen(program: &Program, seen: &Coverage) -> Vec<(PeId, usize)> {
    let all = Coverage::of_program(program);
    let pes = all.pes.numbered().zip(&seen.pes);
    let places = pes.flat_map(|((pe, all), seen)| {
        let words = all.unsent.iter().zip(&seen.unsent).enumerate();
        words.filter(|(_, (all, seen))| **all && !**seen).map(move |(word, _)| (pe, word))
    });
    places.collect()
}

/// The network after one step.
fn look(candidate: &Candidate) -> Clocked<'_> {
    let mut network = Clocked::new(&candidate.program);
    network.step(candidate.stimulus.first().map_or(&[], Vec::as_slice), &mut |_| {});
    network
}

/// A start in which results that nothing takes are too large and were not in those before, if one is found.
pub fn too_large_unsent(program: &Program, steps: u64, seen: &Coverage) -> Option<Candidate> {
    let mut left = BUDGET / (program.pes.len() as u64 * u64::from(program.period)).max(1);
    let coordinates = Coordinate::all(program);
    // Not even one climb would end.
    if left < coordinates.len() as u64 {
        return None;
    }
    let mut results = BTreeSet::new();
    let probes: Vec<Candidate> = (0..PROBES).map(|number| spread(program, steps, number)).collect();
    let probed: Vec<Clocked> = probes.iter().map(look).collect();
    for (pe, word) in unseen(program, seen) {
        let sums: Vec<i128> = probed.iter().map(|network| network.sums(pe)[word]).collect();
        if !results.insert((pe, sums)) {
            continue;
        }
        for upwards in [true, false] {
            let found = climb(spread(program, steps, 0), (pe, word), upwards, &coordinates, &mut left);
            // Flags that rise in later steps may hide it.
            let news = |candidate: &Candidate| {
                let observed = observe(&candidate.program, &candidate.stimulus, steps);
                let mut sum = seen.clone();
                sum.add(&observed.coverage);
                !observed.escaped && sum.unsent() > seen.unsent()
            };
            if let Some(candidate) = found.filter(news) {
                return Some(candidate);
            }
        }
    }
    None
}

/// Moves one word after another to an end of its format where that brings the sum at a place nearer to a limit, until
/// it is beyond it and the PE's flag is not set yet.
fn climb(
    mut candidate: Candidate,
    (pe, word): (PeId, usize),
    upwards: bool,
    coordinates: &[Coordinate],
    left: &mut u64,
) -> Option<Candidate> {
    let format = candidate.program.format;
    let height = |candidate: &Candidate| {
        let network = look(candidate);
        let sum = network.sums(pe)[word];
        // A flag that is set already hides all that comes after.
        let hidden = network.overflow_cycle().is_some() && !network.coverage().pes[pe].unsent[word];
        let height = if upwards { sum - i128::from(format.max_word()) } else { i128::from(format.min_word()) - sum };
        (!hidden, height)
    };
    let mut reached = height(&candidate);
    for coordinate in coordinates {
        let bits = coordinate.bits(&candidate.program);
        for end in [(1i64 << (bits - 1)) - 1, -(1i64 << (bits - 1))] {
            *left = left.checked_sub(1)?;
            let before = std::mem::replace(coordinate.of(&mut candidate), end);
            let now = height(&candidate);
            if now <= reached {
                *coordinate.of(&mut candidate) = before;
                continue;
            }
            reached = now;
            if reached.0 && reached.1 > 0 {
                return Some(candidate);
            }
        }
    }
    None
}
