//! Tiles over stored words: the arithmetic of the hardware, many chains at a time.

use std::ops::Range;

use pe_ir::index::at;
use pe_ir::word::{WordFormat, round_shift};

use crate::lanes::{self, Gathered, NarrowSums, SPLIT, SplitSums, WideSums};
use crate::tape::{self, Chain, Group, Part, Tape};
use crate::tiles::{LANES, Lookups, Place, Shared, Tile, Tiles, Writes};

/// What a port of the multiplier sees: 32 bits where that suffices, for twice as many fit a vector.
pub(crate) trait Port: Copy + Default + PartialEq + Into<i64> {
    /// The port's view of a word without its dropped bits.
    fn of(bits: i64) -> Self;
}

impl Port for i32 {
    #[inline(always)]
    fn of(bits: i64) -> i32 {
        bits as i32
    }
}

impl Port for i64 {
    #[inline(always)]
    fn of(bits: i64) -> i64 {
        bits
    }
}

/// How wide the sums of a tile are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Width {
    /// At most 64 bits.
    Narrow,
    /// Products of at most 64 bits, sums of at most 71.
    Split,
    /// Anything.
    Wide,
}

/// The class of chains whose sums fit `bits`; with `wrap` they are cut to as many bits, as an accumulator does.
pub(crate) fn class(format: &WordFormat, bits: u32, wrap: bool) -> u32 {
    let width = match bits + format.left_shift() {
        ..=64 => Width::Narrow,
        65..=71 if format.data_bits + format.coefficient_bits <= 64 => Width::Split,
        _ => Width::Wide,
    };
    width as u32 | if wrap { bits << 2 } else { 0 }
}

/// Width and wrapping of a class; no wrapping is 0 bits.
fn of_class(class: u32) -> (Width, u32) {
    let width = match class & 3 {
        0 => Width::Narrow,
        1 => Width::Split,
        _ => Width::Wide,
    };
    (width, class >> 2)
}

/// Stored words in slots, as memories and ports see them.
pub(crate) struct Words<P> {
    format: WordFormat,
    /// Left shift of held sums.
    left: u32,
    /// Bits of the operands whose upper ones count segments.
    segment_bits: u32,
    pub words: Vec<i64>,
    /// What the data port sees.
    pub data: Vec<P>,
    /// What the coefficient port sees; kept only if it reads anything.
    pub factors: Vec<P>,
    has_factors: bool,
    /// How often each slot saturated.
    pub saturations: Vec<u64>,
    /// What tiles of many lanes need; it is away while they run.
    room: Option<Box<Room<P>>>,
}

/// Where words end, and where what the ports see of them begins.
struct Ends {
    lowest: i64,
    highest: i64,
    data_drop: u32,
    factor_drop: u32,
}

impl Ends {
    fn of(format: &WordFormat) -> Ends {
        Ends {
            lowest: format.min_word(),
            highest: format.max_word(),
            data_drop: format.data_drop(),
            factor_drop: format.factor_drop(),
        }
    }
}

/// Slots as chains of narrow tiles see them.
struct Memory<'w, P> {
    ends: Ends,
    format: &'w WordFormat,
    words: &'w mut [i64],
    data: &'w mut [P],
    factors: &'w mut [P],
    has_factors: bool,
    saturations: &'w mut [u64],
}

impl<P: Port> Memory<'_, P> {
    /// A sum of at most 64 bits.
    #[inline(always)]
    fn narrow(&self, start: i64, chain: &Chain<'_, P>) -> i64 {
        let mut total = start;
        for (operand, coefficient) in chain.products {
            let operand: i64 = self.data[at(*operand)].into();
            total = total.wrapping_add(operand.wrapping_mul((*coefficient).into()));
        }
        for (operand, factor) in chain.factors {
            let operand: i64 = self.data[at(*operand)].into();
            total = total.wrapping_add(operand.wrapping_mul(self.factors[at(*factor)].into()));
        }
        total
    }

    /// A sum of any width.
    #[inline(always)]
    fn wide(&self, start: i128, chain: &Chain<'_, P>) -> i128 {
        let mut total = start;
        for (operand, coefficient) in chain.products {
            total += product(self.data[at(*operand)], *coefficient);
        }
        for (operand, factor) in chain.factors {
            total += product(self.data[at(*operand)], self.factors[at(*factor)]);
        }
        total
    }

    /// The writes of a chain; `rounded` gives its shifted sum. Whether a word saturated.
    #[inline(always)]
    fn write(&mut self, writes: &[tape::Write], rounded: impl Fn(i32) -> i64) -> bool {
        let Ends { lowest, highest, data_drop, factor_drop } = self.ends;
        let mut saturated = false;
        for write in writes {
            let target = at(write.target);
            // What lies beyond 64 bits lies beyond every word.
            let mut word = self.words[at(write.base)].saturating_add(rounded(write.shift));
            if word < lowest || word > highest {
                word = clamped(self.format, self.saturations, target, word);
                saturated = true;
            }
            self.words[target] = word;
            self.data[target] = P::of(word >> data_drop);
            if self.has_factors {
                self.factors[target] = P::of(word >> factor_drop);
            }
        }
        saturated
    }
}

/// The word that a slot gets of a sum, and note whether it saturated.
#[cold]
fn clamped(format: &WordFormat, saturations: &mut [u64], slot: usize, sum: i64) -> i64 {
    let (word, saturated) = format.add(sum, 0);
    saturations[slot] += u64::from(saturated);
    word
}

/// Room for the sums of a tile of many lanes, and for what they are made of.
struct Room<P> {
    gathered: Gathered<P>,
    narrow: NarrowSums,
    split: SplitSums,
    wide: WideSums,
}

impl<P: Port> Words<P> {
    /// Slots of zero words.
    pub fn new(format: WordFormat, slots: usize, has_factors: bool) -> Words<P> {
        Words {
            format,
            left: format.left_shift(),
            segment_bits: format.data_bits,
            words: vec![0; slots],
            data: vec![P::default(); slots],
            factors: vec![P::default(); slots],
            has_factors,
            saturations: vec![0; slots],
            room: Some(Box::new(Room {
                gathered: Gathered::new(),
                narrow: NarrowSums([0; LANES]),
                split: SplitSums { low: [0; LANES], high: [0; LANES] },
                wide: WideSums([0; LANES]),
            })),
        }
    }

    /// The same words with `room` bits more at the top, of words and ports alike. Operands that count segments still end
    /// where the format has them end.
    pub fn with_room(mut self, room: u32) -> Words<P> {
        self.format.storage_bits += room;
        self.format.data_bits += room;
        self.format.coefficient_bits += room;
        self
    }

    /// Zero words in all slots.
    pub fn clear(&mut self) {
        self.words.fill(0);
        self.data.fill(P::default());
        self.factors.fill(P::default());
    }

    /// Sets a slot.
    pub fn set(&mut self, slot: usize, word: i64) {
        self.words[slot] = word;
        self.data[slot] = P::of(self.format.data_operand(word));
        self.factors[slot] = P::of(self.format.factor_operand(word));
    }

    /// Sets what the data port sees of a slot that nothing else sees.
    pub fn set_operand(&mut self, slot: usize, operand: i64) {
        self.data[slot] = P::of(operand);
    }

    /// Sets what the coefficient port sees of a slot that nothing else sees.
    pub fn set_factor(&mut self, slot: usize, operand: i64) {
        self.factors[slot] = P::of(operand);
    }

    /// Runs all chains; whether a word saturated. Sums start from those of `starts` and are kept in `kept`.
    pub fn run(&mut self, tape: &Tape<P>, starts: &[i128], kept: &mut [i128]) -> bool {
        run_tape(self, tape, starts, kept)
    }

    #[inline(always)]
    fn run_tape(&mut self, tape: &Tape<P>, starts: &[i128], kept: &mut [i128]) -> bool {
        let mut saturated = false;
        let mut room = self.room.take().expect("it is always put back");
        for part in &tape.parts {
            saturated |= match part {
                Part::Groups(groups) => self.run_groups(tape, groups, starts, kept),
                Part::Tile(index) => {
                    let tile = &tape.tiles.tiles[at(*index)];
                    match tile.lookups {
                        Some(lookups) => self.look_up(&tape.tiles, at(tile.lanes), lookups),
                        None => self.run_tile((&tape.tiles, tile), starts, kept, &mut room),
                    }
                }
            };
        }
        self.room = Some(room);
        saturated
    }

    /// A tile of many lanes.
    #[inline(always)]
    fn run_tile(
        &mut self,
        (tiles, tile): (&Tiles<P>, &Tile),
        starts: &[i128],
        kept: &mut [i128],
        room: &mut Room<P>,
    ) -> bool {
        let (left, lanes) = (self.left, at(tile.lanes));
        let ports = (&self.data[..], &self.factors[..]);
        let Room { gathered, narrow, split, wide } = room;
        match of_class(tile.class) {
            (Width::Narrow, wrap) => {
                narrow.start(lanes, |lane| start(tiles, tile, starts, lane));
                lanes::accumulate((tiles, tile), ports, gathered, narrow);
                narrow.wrap(lanes, wrap);
                keep(tiles, tile, kept, |lane| i128::from(narrow.0[lane]));
                self.write(tiles, tile, |lane, shift| round_shift(narrow.0[lane] << left, shift as u32))
            }
            (Width::Split, wrap) => {
                split.start(lanes, |lane| start(tiles, tile, starts, lane));
                lanes::accumulate((tiles, tile), ports, gathered, split);
                split.wrap(lanes, wrap);
                keep(tiles, tile, kept, |lane| split.whole(lane));
                self.write_split(tiles, tile, split)
            }
            (Width::Wide, wrap) => {
                wide.start(lanes, |lane| start(tiles, tile, starts, lane));
                lanes::accumulate((tiles, tile), ports, gathered, wide);
                wide.wrap(lanes, wrap);
                keep(tiles, tile, kept, |lane| wide.0[lane]);
                self.write(tiles, tile, |lane, shift| round_wide(wide.0[lane] << left, shift))
            }
        }
    }

    /// Chains of narrow tiles, one after another. In a function of its own, where sums stay in registers.
    #[inline(never)]
    fn run_groups(&mut self, tape: &Tape<P>, groups: &Range<u32>, starts: &[i128], kept: &mut [i128]) -> bool {
        let mut saturated = false;
        for group in tape.groups(groups) {
            saturated |= match (of_class(group.class), tape.sums(group)) {
                ((Width::Narrow, 0), None) => self.run_narrow(tape, group),
                ((width, wrap), sums) => self.run_chains(tape, group, (width, wrap), sums, starts, kept),
            };
        }
        saturated
    }

    /// Chains whose sums fit 64 bits and are not kept.
    #[inline(always)]
    fn run_narrow(&mut self, tape: &Tape<P>, group: &Group) -> bool {
        let left = self.left;
        let mut memory = self.memory();
        let mut saturated = false;
        for chain in tape.chains(group) {
            let total = memory.narrow(0, &chain);
            saturated |= memory.write(chain.writes, |shift| round_shift(total << left, shift as u32));
        }
        saturated
    }

    /// Chains of any width, which start from kept sums and are kept where there are `sums`.
    #[inline(never)]
    fn run_chains(
        &mut self,
        tape: &Tape<P>,
        group: &Group,
        (width, wrap): (Width, u32),
        sums: Option<&[(Option<u32>, Option<u32>)]>,
        starts: &[i128],
        kept: &mut [i128],
    ) -> bool {
        let left = self.left;
        let mut memory = self.memory();
        let mut saturated = false;
        for (index, chain) in tape.chains(group).enumerate() {
            let (from, to) = sums.map_or((None, None), |sums| sums[index]);
            let start = from.map_or(0, |place| starts[at(place)]);
            let total;
            saturated |= if width == Width::Narrow {
                let narrow = lanes::cut(memory.narrow(start as i64, &chain), wrap);
                total = i128::from(narrow);
                memory.write(chain.writes, |shift| round_shift(narrow << left, shift as u32))
            } else {
                let wide = memory.wide(start, &chain);
                total = if wrap > 0 { lanes::wrapped(wide, wrap) } else { wide };
                memory.write(chain.writes, |shift| round_wide(total << left, shift))
            };
            to.into_iter().for_each(|place| kept[at(place)] = total);
        }
        saturated
    }

    #[inline(always)]
    fn memory(&mut self) -> Memory<'_, P> {
        let slots = self.words.len();
        Memory {
            ends: Ends::of(&self.format),
            format: &self.format,
            words: &mut self.words,
            data: &mut self.data[..slots],
            factors: &mut self.factors[..slots],
            has_factors: self.has_factors,
            saturations: &mut self.saturations,
        }
    }

    /// Lookups in the place of sums. Segments are kept as words.
    fn look_up(&mut self, tiles: &Tiles<P>, lanes: usize, lookups: Lookups) -> bool {
        let segments = tiles.columns.segments;
        match lookups {
            Lookups::Segments { targets, arguments, octaves } => {
                for lane in 0..lanes {
                    let operand: i64 = self.data[tiles.slot(arguments, lane)].into();
                    let end = 1 << (self.segment_bits - 1);
                    let segment = segments.index(operand.clamp(-end, end - 1), self.segment_bits, octaves);
                    self.words[tiles.slot(targets, lane)] = segment as i64;
                }
            }
            Lookups::Choices { targets, segments, among } => {
                for lane in 0..lanes {
                    let segment = self.words[tiles.slot(segments, lane)] as usize;
                    self.words[tiles.slot(targets, lane)] = self.words[tiles.choice(among, lane, segment)];
                }
            }
        }
        false
    }

    #[inline(always)]
    fn write_split(&mut self, tiles: &Tiles<P>, tile: &Tile, sums: &SplitSums) -> bool {
        let long = |shift: &i32| *shift > SPLIT as i32;
        let all_long = self.left == 0
            && tiles.writes[at(tile.writes.start)..tile.writes.end as usize].iter().all(|w| match w.shifts {
                Shared::Same(shift) => long(&shift),
                Shared::Each(start) => tiles.shifts[at(start)..][..tile.lanes as usize].iter().all(long),
            });
        if all_long {
            self.write(tiles, tile, |lane, shift| {
                let half = 1i64 << (shift - 1);
                (sums.high[lane] + ((sums.rest(lane) + half) >> SPLIT)) >> (shift - SPLIT as i32)
            })
        } else {
            let left = self.left;
            self.write(tiles, tile, |lane, shift| round_wide(sums.whole(lane) << left, shift))
        }
    }

    /// The writes of a tile; `rounded` gives the shifted sum of a lane.
    #[inline(always)]
    fn write(&mut self, tiles: &Tiles<P>, tile: &Tile, rounded: impl Fn(usize, i32) -> i64) -> bool {
        let lanes = at(tile.lanes);
        let mut saturated = false;
        let (mut bases, mut results) = ([0; LANES], [0; LANES]);
        for writes in &tiles.writes[at(tile.writes.start)..tile.writes.end as usize] {
            let bases = lanes::values(writes.bases, lanes, &self.words, &tiles.slots, &mut bases);
            let results = &mut results[..lanes];
            match writes.shifts {
                Shared::Same(shift) => {
                    for (lane, (result, base)) in results.iter_mut().zip(bases).enumerate() {
                        *result = sum(*base, rounded(lane, shift));
                    }
                }
                Shared::Each(start) => {
                    let shifts = &tiles.shifts[at(start)..][..lanes];
                    for (lane, ((result, base), shift)) in results.iter_mut().zip(bases).zip(shifts).enumerate() {
                        *result = sum(*base, rounded(lane, *shift));
                    }
                }
            }
            let (lowest, highest) = (self.format.min_word(), self.format.max_word());
            let outside = results.iter().fold(false, |outside, sum| outside | (*sum < lowest) | (*sum > highest));
            if outside {
                self.saturate(tiles, writes, results);
                saturated = true;
            }
            self.store(tiles, writes.targets, results);
        }
        saturated
    }

    #[inline(always)]
    fn store(&mut self, tiles: &Tiles<P>, targets: Place, results: &[i64]) {
        let mut port = [P::default(); LANES];
        let drop = self.format.data_drop();
        port.iter_mut().zip(results).for_each(|(port, word)| *port = P::of(word >> drop));
        lanes::store(targets, &port[..results.len()], &mut self.data, &tiles.slots);
        if self.has_factors {
            let drop = self.format.factor_drop();
            port.iter_mut().zip(results).for_each(|(port, word)| *port = P::of(word >> drop));
            lanes::store(targets, &port[..results.len()], &mut self.factors, &tiles.slots);
        }
        lanes::store(targets, results, &mut self.words, &tiles.slots);
    }

    #[cold]
    fn saturate(&mut self, tiles: &Tiles<P>, writes: &Writes, results: &mut [i64]) {
        for (lane, result) in results.iter_mut().enumerate() {
            *result = clamped(&self.format, &mut self.saturations, tiles.slot(writes.targets, lane), *result);
        }
    }
}

/// [`Words::run_tape`] with the widest vectors that this processor has; integers are the same in all of them.
#[multiversion::multiversion(targets = "simd")]
fn run_tape<P: Port>(words: &mut Words<P>, tape: &Tape<P>, starts: &[i128], kept: &mut [i128]) -> bool {
    words.run_tape(tape, starts, kept)
}

/// A product of any width.
#[inline(always)]
fn product<P: Port>(operand: P, factor: P) -> i128 {
    let (operand, factor): (i64, i64) = (operand.into(), factor.into());
    i128::from(operand) * i128::from(factor)
}

/// The kept sum that a lane starts from.
#[inline(always)]
fn start<P>(tiles: &Tiles<P>, tile: &Tile, starts: &[i128], lane: usize) -> i128 {
    tile.starts.map_or(0, |place| starts[tiles.slot(place, lane)])
}

/// Keeps the sums of a tile whose sums are kept.
#[inline(always)]
fn keep<P>(tiles: &Tiles<P>, tile: &Tile, kept: &mut [i128], sum: impl Fn(usize) -> i128) {
    if let Some(place) = tile.kept {
        (0..tile.lanes as usize).for_each(|lane| kept[tiles.slot(place, lane)] = sum(lane));
    }
}

/// Far beyond every word, and far enough from the end of 64 bits.
const BEYOND: i64 = 1 << 62;

/// Base and shifted sum; what lies beyond every word may be any number beyond it.
#[inline(always)]
fn sum(base: i64, rounded: i64) -> i64 {
    base + rounded.clamp(-BEYOND, BEYOND - 1)
}

/// `sum / 2^shift`, rounded to nearest, halves up; what lies beyond every word may be any number beyond it.
#[inline(always)]
fn round_wide(sum: i128, shift: i32) -> i64 {
    // Most sums fit 64 bits, whatever their products might have become.
    if let (Ok(sum), 0..=63) = (i64::try_from(sum), shift) {
        return round_shift(sum, shift as u32);
    }
    let rounded = if shift == 0 { sum } else { ((sum >> (shift - 1)) + 1) >> 1 };
    rounded.clamp(i128::from(-BEYOND), i128::from(BEYOND)) as i64
}
