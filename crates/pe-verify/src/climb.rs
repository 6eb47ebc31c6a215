//! Starts that are sought, because random words hardly ever get there: one in 20,000 of a motor's controller. What is
//! aimed at is a sum of products of few words, so a climb from word to word, each moved where that brings the sum nearer,
//! gets there soon if it can. A climb that ends elsewhere proves nothing.
//!
//! - Results that nothing takes are too large: they decide nothing but what a `send` in the wrong control word would do.
//! - Operands are too large for their sum.
//! - Arguments of functions are in segments whose entries no run has read.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::sync::Arc;

use pe_ir::index::PeId;
use pe_ir::program::{ControlWord, PeProgram, Program};
use pe_sim::clocked::{Clocked, Control};
use pe_sim::coverage::{BASE, Coverage};

use crate::pace::{Effort, Efforts};
use crate::stimuli::{Candidate, observe_controlled, spread};

/// Control words of all PEs that a search may cost together in the simulator.
const BUDGET: u64 = 8_000_000;

/// The part of it that most searches take which find something, as a divisor.
const USUAL: u64 = 10;

/// Starts from which places are told apart, or that are tried before a place is given up: what has the same sums in all
/// of them is one result.
const PROBES: u64 = 2;

/// Further segments of an argument that are tried in the same start.
const FURTHER: usize = 4;

/// A word that a climb may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

    /// The ends of its format, the upper one first.
    fn ends(self, program: &Program) -> [i64; 2] {
        let format = &program.format;
        let bits = match self {
            Coordinate::Own(..) | Coordinate::Imported(..) => format.data_bits,
            Coordinate::Base(..) => format.word_bits(),
            Coordinate::Input(_) => format.storage_bits,
        };
        [(1i64 << (bits - 1)) - 1, -(1i64 << (bits - 1))]
    }
}

/// Base words of a PE that are entries of tables: those that are read with an index.
fn entries(pe: &PeProgram) -> BTreeSet<usize> {
    let segments = pe.features.segments().count();
    let indexed = pe.words.iter().enumerate().filter(|(k, _)| pe.takes_index(*k));
    let first = indexed.filter_map(|(_, word)| word.base);
    first.flat_map(|base| (0..segments).map(move |entry| usize::from(base) | entry)).collect()
}

/// A number of a step: a result before it saturates, or an operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    Result(PeId, usize),
    Own(PeId, usize),
    Imported(PeId, usize),
}

impl Place {
    fn of(self, network: &Clocked<&Program>) -> i128 {
        match self {
            Place::Result(pe, word) => network.sums(pe)[word],
            Place::Own(pe, word) => network.operands(pe)[word][0].into(),
            Place::Imported(pe, word) => network.operands(pe)[word][1].into(),
        }
    }
}

/// Where a result that nothing takes was not seen to be too large.
fn unsent(program: &Program, seen: &Coverage) -> Vec<Place> {
    let all = Coverage::of_program(program);
    let pes = all.pes.numbered().zip(&seen.pes);
    let places = pes.flat_map(|((pe, all), seen)| {
        let words = all.unsent.iter().zip(&seen.unsent).enumerate();
        words.filter(|(_, (all, seen))| **all && !**seen).map(move |(word, _)| Place::Result(pe, word))
    });
    places.collect()
}

/// Operands of PEs in which none was seen to be too large for its sum.
fn joined(program: &Program, seen: &Coverage) -> Vec<Place> {
    let all = Coverage::of_program(program);
    let pes = program.pes.numbered().filter(|(pe, _)| all.pes[*pe].too_large && !seen.pes[*pe].too_large);
    let places = pes.flat_map(|(index, pe)| {
        let words = pe.words.iter().enumerate().filter(|(_, word)| word.own.is_some() && word.imported.is_some());
        words.flat_map(move |(word, _)| [Place::Own(index, word), Place::Imported(index, word)])
    });
    places.collect()
}

/// The network after one step.
fn look<'c>(control: &Arc<Control>, candidate: &'c Candidate) -> Clocked<&'c Program> {
    let mut network = Clocked::controlled(Arc::clone(control), &candidate.program);
    network.step(candidate.stimulus.first().map_or(&[], Vec::as_slice), &mut |_| {});
    network
}

/// A search: what it may still cost, in steps, and what it may change.
struct Search<'a> {
    program: &'a Program,
    /// That of all candidates, which differ in images alone.
    control: Arc<Control>,
    steps: u64,
    left: u64,
    coordinates: Vec<Coordinate>,
}

impl<'a> Search<'a> {
    /// None if not even one climb would end.
    fn of(program: &'a Program, steps: u64) -> Option<Search<'a>> {
        let left = BUDGET / (program.pes.len() as u64 * u64::from(program.period)).max(1);
        let coordinates = Coordinate::all(program);
        (left >= coordinates.len() as u64).then(|| Search {
            program,
            control: Control::of(program),
            steps,
            left,
            coordinates,
        })
    }

    /// Whether a start shows what was not seen, by this measure, without a word that escapes.
    fn shows(&self, candidate: &Candidate, seen: &Coverage, measure: fn(&Coverage) -> u64) -> bool {
        let observed = observe_controlled(&self.control, &candidate.program, &candidate.stimulus, self.steps);
        let mut sum = seen.clone();
        sum.add(&observed.coverage);
        !observed.escaped && measure(&sum) > measure(seen)
    }
}

/// A start in which results that nothing takes are too large and were not in those before, if one is found.
pub fn too_large_unsent(program: &Program, steps: u64, seen: &Coverage) -> Option<Candidate> {
    let format = program.format;
    let ends = (i128::from(format.min_word()), i128::from(format.max_word()));
    beyond(program, steps, seen, &unsent(program, seen), ends, Coverage::unsent)
}

/// A start in which operands are too large for their sum in a PE where they were not in those before, if one is found.
pub fn too_large_operands(program: &Program, steps: u64, seen: &Coverage) -> Option<Candidate> {
    let half = 1i128 << (program.format.data_bits - 2);
    beyond(program, steps, seen, &joined(program, seen), (-half, half - 1), Coverage::flags)
}

/// A start in which one of some places is beyond limits and shows what was not seen.
fn beyond(
    program: &Program,
    steps: u64,
    seen: &Coverage,
    places: &[Place],
    limits: (i128, i128),
    measure: fn(&Coverage) -> u64,
) -> Option<Candidate> {
    let mut search = Search::of(program, steps)?;
    let mut results = BTreeSet::new();
    let probes: Vec<Candidate> = (0..PROBES).map(|number| spread(program, steps, number)).collect();
    let probed: Vec<Clocked<&Program>> = probes.iter().map(|probe| look(&search.control, probe)).collect();
    for place in places {
        let (Place::Result(pe, _) | Place::Own(pe, _) | Place::Imported(pe, _)) = *place;
        if !results.insert((pe, probed.iter().map(|network| place.of(network)).collect::<Vec<_>>())) {
            continue;
        }
        for upwards in [true, false] {
            let found = search.climb(spread(program, steps, 0), *place, upwards, limits);
            // Flags that rise in later steps may hide it.
            if let Some(candidate) = found.filter(|candidate| search.shows(candidate, seen, measure)) {
                return Some(candidate);
            }
        }
    }
    None
}

impl Search<'_> {
    /// Moves one word after another to an end of its format where that brings a place nearer to a limit, until it is
    /// beyond it and the PE's flag is not set yet.
    fn climb(
        &mut self,
        mut candidate: Candidate,
        place: Place,
        upwards: bool,
        (least, most): (i128, i128),
    ) -> Option<Candidate> {
        let control = &self.control;
        let height = |candidate: &Candidate| {
            let network = look(control, candidate);
            let value = place.of(&network);
            // A flag that is set already hides all that comes after.
            let hidden = match place {
                Place::Result(pe, word) => {
                    network.overflow_cycle().is_some() && !network.coverage().pes[pe].unsent[word]
                }
                _ => false,
            };
            (!hidden, if upwards { value - most } else { least - value })
        };
        let mut reached = height(&candidate);
        for coordinate in &self.coordinates {
            for end in coordinate.ends(self.program) {
                self.left = self.left.checked_sub(1)?;
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

    /// Words on which some places depend, of those that may be changed.
    fn influences(&mut self, places: &BTreeSet<Place>) -> Option<BTreeMap<Place, Vec<Coordinate>>> {
        if places.is_empty() {
            return Some(BTreeMap::new());
        }
        let mut influences: BTreeMap<Place, Vec<Coordinate>> =
            places.iter().map(|place| (*place, Vec::new())).collect();
        let (control, mut candidate) = (&self.control, spread(self.program, self.steps, 0));
        let values = |candidate: &Candidate| -> Vec<i128> {
            let network = look(control, candidate);
            places.iter().map(|place| place.of(&network)).collect()
        };
        let usual = values(&candidate);
        for coordinate in &self.coordinates {
            self.left = self.left.checked_sub(1)?;
            let [end, _] = coordinate.ends(self.program);
            let before = std::mem::replace(coordinate.of(&mut candidate), end);
            for (found, (usual, now)) in influences.values_mut().zip(usual.iter().zip(values(&candidate))) {
                if *usual != now {
                    found.push(*coordinate);
                }
            }
            *coordinate.of(&mut candidate) = before;
        }
        Some(influences)
    }

    /// Moves words until a place is in a range, and others stay in theirs; whether it gets there.
    fn approach(&mut self, candidate: &mut Candidate, aim: &Aim, held: &[&Aim], coordinates: &[Coordinate]) -> bool {
        let (control, centre) = (&self.control, aim.centre());
        // Distance to the centre with its sign, and whether it is in the range; none if another one would not be.
        let value = |candidate: &Candidate| {
            let network = look(control, candidate);
            let stays = held.iter().all(|held| held.range.contains(&held.place.of(&network)));
            let value = aim.place.of(&network);
            stays.then_some((value - centre, aim.range.contains(&value)))
        };
        let Some(mut now) = value(candidate) else { return false };
        for (coordinate, upper) in coordinates.iter().flat_map(|one| [(one, true), (one, false)]) {
            if now.1 {
                return true;
            }
            let mut near = *coordinate.of(candidate);
            let [top, bottom] = coordinate.ends(self.program);
            let end = if upper { top } else { bottom };
            let mut far = end;
            let mut at = end;
            while at != near {
                let Some(left) = self.left.checked_sub(1) else { return false };
                self.left = left;
                *coordinate.of(candidate) = at;
                match value(candidate) {
                    // It leads away, or nowhere, and so does all that is between.
                    Some(other) if at == end && !other.1 && nearer(now.0, other.0) => break,
                    Some(other) if other.1 || nearer(other.0, now.0) => (near, now) = (at, other),
                    _ => far = at,
                }
                if now.1 || near == end {
                    break;
                }
                at = near + (far - near) / 2;
            }
            *coordinate.of(candidate) = near;
        }
        now.1
    }
}

/// Whether a distance is on the same side as another one and at most as large.
fn nearer(distance: i128, other: i128) -> bool {
    distance.signum() == other.signum() && distance.abs() <= other.abs()
}

/// A place that is to be in a range.
struct Aim {
    place: Place,
    segment: usize,
    range: RangeInclusive<i128>,
    /// What is read then and was not yet: PE and base word.
    entries: BTreeSet<(PeId, usize)>,
}

impl Aim {
    fn centre(&self) -> i128 {
        self.range.start() + (self.range.end() - self.range.start()) / 2
    }
}

/// Arguments and segments of which entries were not read.
fn unread(program: &Program, seen: &Coverage) -> Vec<Aim> {
    let bits = program.format.word_bits();
    let mut aims: BTreeMap<(Place, usize), Aim> = BTreeMap::new();
    for (index, pe) in program.pes.numbered() {
        let segments = pe.features.segments();
        for (k, word) in pe.words.iter().enumerate() {
            let (Some(address), Some(base)) = (word.index, pe.words[(k + 1) % pe.words.len()].base) else { continue };
            let writes = |word: &ControlWord| word.write_index.filter(|(written, _)| *written == address);
            let writers: Vec<usize> = (0..pe.words.len()).filter(|k| writes(&pe.words[*k]).is_some()).collect();
            // What was written last is read.
            let last = writers.iter().rfind(|written| **written < k).or(writers.last());
            let Some((written, (_, octaves))) = last.and_then(|k| Some((*k, writes(&pe.words[*k])?))) else { continue };
            for segment in 0..segments.count() {
                let (place, entry) = (Place::Result(index, written), usize::from(base) | segment);
                if seen.pes[index].fetched[BASE][entry] {
                    continue;
                }
                let (first, end) = segments.range(segment, octaves);
                let [first, end] = [first, end].map(|edge| libm::scalbn(edge, bits as i32 - 1) as i128);
                let aim = Aim { place, segment, range: first..=end - 1, entries: BTreeSet::new() };
                aims.entry((place, segment)).or_insert(aim).entries.insert((index, entry));
            }
        }
    }
    aims.into_values().collect()
}

/// What searches found out of a design, for those that follow.
#[derive(Default)]
pub struct Memory {
    /// Words on which arguments of functions depend.
    influences: BTreeMap<Place, Vec<Coordinate>>,
    /// From how many starts each segment of an argument was sought.
    tried: BTreeMap<(Place, usize), u64>,
}

impl Memory {
    fn tried(&self, aim: &Aim) -> u64 {
        self.tried.get(&(aim.place, aim.segment)).copied().unwrap_or(0)
    }
}

/// What searches take, if any start is likely.
pub fn effort(program: &Program, likely: u64) -> Efforts {
    if likely == 0 {
        return Efforts::default();
    }
    let cost = (program.pes.len() as u64 * u64::from(program.period)).max(1);
    let of = |words: u64| Effort { runs: words / cost, words };
    Efforts { found: of(BUDGET / USUAL), nothing: of(BUDGET) }
}

/// Starts that it takes to read what was not read, where all segments are found: each has one of every argument.
pub fn unread_starts(program: &Program, seen: &Coverage, memory: &Memory) -> u64 {
    let mut left: BTreeMap<Place, u64> = BTreeMap::new();
    for aim in unread(program, seen).iter().filter(|aim| memory.tried(aim) < PROBES) {
        *left.entry(aim.place).or_default() += 1;
    }
    left.into_values().max().unwrap_or(0)
}

/// A start in which entries of tables are read that were not in those before, if one is found.
pub fn unread_entries(memory: &mut Memory, program: &Program, steps: u64, seen: &Coverage) -> Option<Candidate> {
    let mut aims = unread(program, seen);
    aims.retain(|aim| memory.tried(aim) < PROBES);
    let mut search = Search::of(program, steps).filter(|_| !aims.is_empty())?;
    let unknown = aims.iter().map(|aim| aim.place).filter(|place| !memory.influences.contains_key(place)).collect();
    memory.influences.extend(search.influences(&unknown)?);
    aims.sort_by_key(|aim| memory.tried(aim));
    let Memory { influences, tried } = memory;
    for aim in &aims {
        if search.left == 0 {
            break;
        }
        let tried = tried.entry((aim.place, aim.segment)).or_default();
        let mut candidate = spread(program, steps, *tried);
        *tried += 1;
        if !search.approach(&mut candidate, aim, &[], &influences[&aim.place]) {
            continue;
        }
        // Other arguments go where they may, to what is near and read by none of those before.
        let (mut held, mut read) = (vec![aim], aim.entries.clone());
        for (place, coordinates) in influences.iter().filter(|(place, _)| **place != aim.place) {
            let value = place.of(&look(&search.control, &candidate));
            let mut others: Vec<&Aim> =
                aims.iter().filter(|other| other.place == *place && !other.entries.is_subset(&read)).collect();
            others.sort_by_key(|other| (other.centre() - value).abs());
            let mut others = others.into_iter().take(FURTHER);
            if let Some(found) = others.find(|other| search.approach(&mut candidate, other, &held, coordinates)) {
                read.extend(&found.entries);
                held.push(found);
            }
        }
        if search.shows(&candidate, seen, Coverage::fetched) {
            return Some(candidate);
        }
    }
    None
}
