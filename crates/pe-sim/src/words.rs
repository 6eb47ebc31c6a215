//! Tiles over stored words: the arithmetic of the hardware, many chains at a time.

use pe_ir::index::at;
use pe_ir::word::{WordFormat, round_shift};

use crate::lanes::{self, Gathered, NarrowSums, SPLIT, SplitSums, WideSums};
use crate::tiles::{Factors, LANES, Lookups, NARROW, Place, Shared, Tile, Tiles, Writes};

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
    pub fn run(&mut self, tiles: &Tiles<P>, starts: &[i128], kept: &mut [i128]) -> bool {
        run_tiles(self, tiles, starts, kept)
    }

    #[inline(always)]
    fn run_tiles(&mut self, tiles: &Tiles<P>, starts: &[i128], kept: &mut [i128]) -> bool {
        let mut saturated = false;
        let mut room = Gathered::new();
        let mut narrow = NarrowSums([0; LANES]);
        let mut split = SplitSums { low: [0; LANES], high: [0; LANES] };
        let mut wide = WideSums([0; LANES]);
        let left = self.left;
        for tile in &tiles.tiles {
            let lanes = at(tile.lanes);
            if let Some(lookups) = tile.lookups {
                self.look_up(tiles, lanes, lookups);
                continue;
            }
            if lanes < NARROW {
                saturated |= self.run_narrow(tiles, tile, starts, kept);
                continue;
            }
            let ports = (&self.data[..], &self.factors[..]);
            match of_class(tile.class) {
                (Width::Narrow, wrap) => {
                    narrow.start(lanes, |lane| start(tiles, tile, starts, lane));
                    lanes::accumulate((tiles, tile), ports, &mut room, &mut narrow);
                    narrow.wrap(lanes, wrap);
                    keep(tiles, tile, kept, |lane| i128::from(narrow.0[lane]));
                    saturated |=
                        self.write(tiles, tile, |lane, shift| round_shift(narrow.0[lane] << left, shift as u32));
                }
                (Width::Split, wrap) => {
                    split.start(lanes, |lane| start(tiles, tile, starts, lane));
                    lanes::accumulate((tiles, tile), ports, &mut room, &mut split);
                    split.wrap(lanes, wrap);
                    keep(tiles, tile, kept, |lane| split.whole(lane));
                    saturated |= self.write_split(tiles, tile, &split);
                }
                (Width::Wide, wrap) => {
                    wide.start(lanes, |lane| start(tiles, tile, starts, lane));
                    lanes::accumulate((tiles, tile), ports, &mut room, &mut wide);
                    wide.wrap(lanes, wrap);
                    keep(tiles, tile, kept, |lane| wide.0[lane]);
                    saturated |= self.write(tiles, tile, |lane, shift| round_wide(wide.0[lane] << left, shift));
                }
            }
        }
        saturated
    }

    /// A tile of a few lanes, one after another, with sums of any width.
    #[inline(always)]
    fn run_narrow(&mut self, tiles: &Tiles<P>, tile: &Tile, starts: &[i128], kept: &mut [i128]) -> bool {
        let (left, wrap) = (self.left, of_class(tile.class).1);
        let mut saturated = false;
        for lane in 0..tile.lanes as usize {
            let mut total = start(tiles, tile, starts, lane);
            for products in &tiles.products[at(tile.products.start)..tile.products.end as usize] {
                let operand: i64 = self.data[tiles.slot(products.operands, lane)].into();
                let factor: i64 = match products.factors {
                    Factors::Coefficients(coefficients) => coefficients.of(lane, &tiles.coefficients).into(),
                    Factors::Values(place) => self.factors[tiles.slot(place, lane)].into(),
                };
                total += i128::from(operand) * i128::from(factor);
            }
            let total = if wrap > 0 { lanes::wrapped(total, wrap) } else { total };
            if let Some(place) = tile.kept {
                kept[tiles.slot(place, lane)] = total;
            }
            for writes in &tiles.writes[at(tile.writes.start)..tile.writes.end as usize] {
                let shift = writes.shifts.of(lane, &tiles.shifts);
                let result = sum(self.words[tiles.slot(writes.bases, lane)], round_wide(total << left, shift));
                let (word, outside) = self.format.add(result, 0);
                let target = tiles.slot(writes.targets, lane);
                self.saturations[target] += u64::from(outside);
                saturated |= outside;
                self.words[target] = word;
                self.data[target] = P::of(word >> self.format.data_drop());
                if self.has_factors {
                    self.factors[target] = P::of(word >> self.format.factor_drop());
                }
            }
        }
        saturated
    }

    /// Lookups in the place of sums. Segments are kept as words.
    fn look_up(&mut self, tiles: &Tiles<P>, lanes: usize, lookups: Lookups) {
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
            let (word, saturated) = self.format.add(*result, 0);
            self.saturations[tiles.slot(writes.targets, lane)] += u64::from(saturated);
            *result = word;
        }
    }
}

/// [`Words::run_tiles`] with the widest vectors that this processor has; integers are the same in all of them.
#[multiversion::multiversion(targets = "simd")]
fn run_tiles<P: Port>(words: &mut Words<P>, tiles: &Tiles<P>, starts: &[i128], kept: &mut [i128]) -> bool {
    words.run_tiles(tiles, starts, kept)
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
fn round_wide(sum: i128, shift: i32) -> i64 {
    let rounded = if shift == 0 { sum } else { ((sum >> (shift - 1)) + 1) >> 1 };
    rounded.clamp(i128::from(-BEYOND), i128::from(BEYOND)) as i64
}
