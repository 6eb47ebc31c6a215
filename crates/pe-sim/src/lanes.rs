//! The inner loops over the lanes of a tile, written so that the compiler vectorises them.

use crate::tiles::{Factors, LANES, Place, Shared, Tile, Tiles};
use pe_ir::index;

/// Sums of the lanes of a tile. `V` is what a slot holds, `C` what it is multiplied by.
pub(crate) trait Sums<V, C> {
    /// Adds one product to each lane, in the order of the lanes.
    fn add(&mut self, products: impl Iterator<Item = (V, C)>);
}

/// Sums in double precision.
pub(crate) struct DoubleSums(pub [f64; LANES]);

impl Sums<f64, f64> for DoubleSums {
    #[inline(always)]
    fn add(&mut self, products: impl Iterator<Item = (f64, f64)>) {
        for (sum, (value, coefficient)) in self.0.iter_mut().zip(products) {
            *sum += value * coefficient;
        }
    }
}

/// Sums of at most 64 bits.
pub(crate) struct NarrowSums(pub [i64; LANES]);

impl NarrowSums {
    /// The sums before the first product.
    #[inline(always)]
    pub fn start(&mut self, lanes: usize, start: impl Fn(usize) -> i128) {
        (0..lanes).for_each(|lane| self.0[lane] = start(lane) as i64);
    }

    /// Cuts the sums to `bits` bits, if any.
    #[inline(always)]
    pub fn wrap(&mut self, lanes: usize, bits: u32) {
        self.0[..lanes].iter_mut().for_each(|sum| *sum = cut(*sum, bits));
    }
}

impl<V: Into<i64>, C: Into<i64>> Sums<V, C> for NarrowSums {
    #[inline(always)]
    fn add(&mut self, products: impl Iterator<Item = (V, C)>) {
        for (sum, (value, coefficient)) in self.0.iter_mut().zip(products) {
            *sum = sum.wrapping_add(value.into().wrapping_mul(coefficient.into()));
        }
    }
}

/// Sums of up to 71 bits, of products of at most 64: each sum modulo 2^64 in `low`, and the sum of the products without
/// their last [`SPLIT`] bits in `high`. Together they are the whole sum, and vectors can form both.
pub(crate) struct SplitSums {
    pub low: [i64; LANES],
    pub high: [i64; LANES],
}

/// Bits that the high parts of split sums lack.
pub(crate) const SPLIT: u32 = 8;

impl<V: Into<i64>, C: Into<i64>> Sums<V, C> for SplitSums {
    #[inline(always)]
    fn add(&mut self, products: impl Iterator<Item = (V, C)>) {
        for ((low, high), (value, coefficient)) in self.low.iter_mut().zip(&mut self.high).zip(products) {
            let product = value.into().wrapping_mul(coefficient.into());
            *low = low.wrapping_add(product);
            *high = high.wrapping_add(product >> SPLIT);
        }
    }
}

impl SplitSums {
    /// The sums before the first product.
    #[inline(always)]
    pub fn start(&mut self, lanes: usize, start: impl Fn(usize) -> i128) {
        (0..lanes).for_each(|lane| self.set(lane, start(lane)));
    }

    /// Cuts the sums to `bits` bits, if any.
    #[inline(always)]
    pub fn wrap(&mut self, lanes: usize, bits: u32) {
        if bits > 0 {
            (0..lanes).for_each(|lane| self.set(lane, wrapped(self.whole(lane), bits)));
        }
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, sum: i128) {
        (self.low[lane], self.high[lane]) = (sum as i64, (sum >> SPLIT) as i64);
    }

    /// The sum of a lane.
    #[inline(always)]
    pub fn whole(&self, lane: usize) -> i128 {
        (i128::from(self.high[lane]) << SPLIT) + i128::from(self.rest(lane))
    }

    /// What the high part of a lane lacks of its sum: the last bits of the products, added up.
    #[inline(always)]
    pub fn rest(&self, lane: usize) -> i64 {
        self.low[lane].wrapping_sub(self.high[lane] << SPLIT)
    }
}

/// Sums of any width.
pub(crate) struct WideSums(pub [i128; LANES]);

impl WideSums {
    /// The sums before the first product.
    #[inline(always)]
    pub fn start(&mut self, lanes: usize, start: impl Fn(usize) -> i128) {
        (0..lanes).for_each(|lane| self.0[lane] = start(lane));
    }

    /// Cuts the sums to `bits` bits, if any.
    #[inline(always)]
    pub fn wrap(&mut self, lanes: usize, bits: u32) {
        if bits > 0 {
            self.0[..lanes].iter_mut().for_each(|sum| *sum = wrapped(*sum, bits));
        }
    }
}

impl<V: Into<i64>, C: Into<i64>> Sums<V, C> for WideSums {
    #[inline(always)]
    fn add(&mut self, products: impl Iterator<Item = (V, C)>) {
        for (sum, (value, coefficient)) in self.0.iter_mut().zip(products) {
            *sum += i128::from(value.into()) * i128::from(coefficient.into());
        }
    }
}

/// A sum of at most 64 bits cut to `bits` bits, if any.
#[inline(always)]
pub(crate) fn cut(sum: i64, bits: u32) -> i64 {
    if bits > 0 && bits < 64 { sum << (64 - bits) >> (64 - bits) } else { sum }
}

/// The low `bits` of a sum as a signed number.
pub(crate) fn wrapped(sum: i128, bits: u32) -> i128 {
    sum << (128 - bits) >> (128 - bits)
}

/// Room for the values of the lanes of a tile that do not lie in a row.
pub(crate) struct Gathered<V> {
    operands: [V; LANES],
    factors: [V; LANES],
}

impl<V: Copy + Default> Gathered<V> {
    /// Empty room.
    pub fn new() -> Self {
        Gathered { operands: [V::default(); LANES], factors: [V::default(); LANES] }
    }
}

/// The value of a slot. Slots are never beyond the end; told so, the compiler leaves out the branch to a panic, which
/// would keep it from unrolling.
#[inline(always)]
fn at<V: Copy>(values: &[V], slot: u32) -> V {
    values[index::at(slot).min(values.len() - 1)]
}

/// Adds the products of a tile to `sums`, term after term: operands from `data`, second factors from `factors`.
#[inline(always)]
pub(crate) fn accumulate<V: Copy, C: Copy, S: Sums<V, C> + Sums<V, V>>(
    (tiles, tile): (&Tiles<C>, &Tile),
    (data, factors): (&[V], &[V]),
    room: &mut Gathered<V>,
    sums: &mut S,
) {
    let lanes = index::at(tile.lanes);
    for products in &tiles.products[index::at(tile.products.start)..tile.products.end as usize] {
        match (products.operands, products.factors) {
            (Place::Row(start), Factors::Coefficients(Shared::Same(coefficient))) => {
                let operands = &data[index::at(start)..][..lanes];
                sums.add(operands.iter().map(|operand| (*operand, coefficient)));
            }
            (Place::Row(start), Factors::Coefficients(Shared::Each(coefficients))) => {
                let operands = &data[index::at(start)..][..lanes];
                let coefficients = &tiles.coefficients[index::at(coefficients)..][..lanes];
                sums.add(operands.iter().copied().zip(coefficients.iter().copied()));
            }
            (Place::Each(start), Factors::Coefficients(Shared::Same(coefficient))) => {
                let slots = &tiles.slots[index::at(start)..][..lanes];
                sums.add(slots.iter().map(|slot| (at(data, *slot), coefficient)));
            }
            (Place::Each(start), Factors::Coefficients(Shared::Each(coefficients))) => {
                let slots = &tiles.slots[index::at(start)..][..lanes];
                let coefficients = &tiles.coefficients[index::at(coefficients)..][..lanes];
                sums.add(slots.iter().map(|slot| at(data, *slot)).zip(coefficients.iter().copied()));
            }
            (Place::Same(slot), Factors::Coefficients(Shared::Same(coefficient))) => {
                sums.add(std::iter::repeat_n((data[index::at(slot)], coefficient), lanes));
            }
            (Place::Same(slot), Factors::Coefficients(Shared::Each(coefficients))) => {
                let operand = data[index::at(slot)];
                let coefficients = &tiles.coefficients[index::at(coefficients)..][..lanes];
                sums.add(coefficients.iter().map(|coefficient| (operand, *coefficient)));
            }
            (place, Factors::Values(other)) => {
                let operands = values(place, lanes, data, &tiles.slots, &mut room.operands);
                let factors = values(other, lanes, factors, &tiles.slots, &mut room.factors);
                sums.add(operands.iter().copied().zip(factors.iter().copied()));
            }
        }
    }
}

/// The values of a place, in a row.
#[inline(always)]
pub(crate) fn values<'a, V: Copy>(
    place: Place,
    lanes: usize,
    all: &'a [V],
    slots: &[u32],
    room: &'a mut [V; LANES],
) -> &'a [V] {
    match place {
        Place::Row(start) => &all[index::at(start)..][..lanes],
        Place::Same(slot) => {
            room[..lanes].fill(all[index::at(slot)]);
            &room[..lanes]
        }
        Place::Each(start) => {
            for (value, slot) in room.iter_mut().zip(&slots[index::at(start)..][..lanes]) {
                *value = at(all, *slot);
            }
            &room[..lanes]
        }
    }
}

/// Stores the lanes of a tile.
#[inline(always)]
pub(crate) fn store<V: Copy>(place: Place, lanes: &[V], all: &mut [V], slots: &[u32]) {
    match place {
        Place::Row(start) => all[index::at(start)..][..lanes.len()].copy_from_slice(lanes),
        Place::Same(slot) => all[index::at(slot)] = lanes[lanes.len() - 1],
        Place::Each(start) => {
            for (value, slot) in lanes.iter().zip(&slots[index::at(start)..][..lanes.len()]) {
                all[index::at(*slot)] = *value;
            }
        }
    }
}
