//! Functions that are the same in every octave of their arguments but for a factor or a term, and a number beside them:
//! powers and logarithms. A table of one octave serves all of them; see `docs/decisions/0104-exponents-of-arguments.md`.

use pe_ir::functions::{ScalarFunction, Segments};
use pe_ir::word::WordFormat;

use super::domain::Map;
use crate::formats::RANGE_MARGIN;

/// What an argument in 1/2 .. 1 is multiplied by, and what is added then, for -1 .. 1 with some room at both ends. A number
/// of few bits is exact.
const SPREAD: f64 = 3.75;
const CENTRE: f64 = -0.75 * SPREAD;

/// Bits of a coefficient that a scale has beside one for each octave: sign, those of [`SPREAD`], and room of its format.
const BITS: u32 = 6;

/// What the name of a table has behind that of a function of which only quotients are computed.
pub(super) const ONE_OCTAVE: &str = ": one octave";

/// How many times as far from the place as the nearest argument the farthest one is at least.
const FAR: f64 = 4.0;

/// Part of a distance that is left free at either end, for what rounding makes of it.
const SLACK: f64 = 1.0 / 1024.0;

/// Points at which what is claimed is checked.
const POINTS: usize = 256;

/// Part of the tolerance that a difference between octaves may take.
const PART: f64 = 1.0 / 16.0;

/// How much larger than the function what is beside it may be.
const BESIDE: f64 = 2.0;

/// Numbers that differ by less, relatively, are one.
const EQUAL: f64 = 1e-10;

/// What the value of an octave becomes when distances are doubled.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    /// It is multiplied.
    Factor(f64),
    /// It gets a term.
    Term(f64),
}

/// A function that one octave tells all of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scaling {
    /// From arguments to distances, below 1.
    pub distance: Map,
    /// Octaves below 1/2 .. 1 that distances reach, and those that scales of the coefficient port can reach.
    octaves: u32,
    most: u32,
    /// The one whose values are in the table, counted downwards from 1/2 .. 1: that with the largest ones.
    reference: u32,
    change: Change,
    /// What is beside what is scaled.
    beside: f64,
    /// What makes the entries of the table numbers around 1: a power of two. Tables of like functions are the same then.
    unit: i32,
    /// How far octaves are from one another.
    pub apart: f64,
}

impl Scaling {
    /// A function between two arguments, as distances from one of some places.
    pub fn of(
        function: &ScalarFunction,
        (low, high): (f64, f64),
        places: &[f64],
        tolerance: f64,
        format: WordFormat,
    ) -> Option<Scaling> {
        // A scaled distance has the format of an argument, whose last bit is no finer than that of the product.
        let spread = libm::ceil(libm::log2(RANGE_MARGIN * SPREAD)) as u32;
        let product = format.data_bits + format.coefficient_bits + format.left_shift();
        let finest = product.checked_sub(format.word_bits() + 1 + spread)?;
        let most = format.coefficient_bits.checked_sub(BITS)?.min(finest);
        let of = |place: &f64| Scaling::from_place(function, (low, high), *place, (tolerance, format));
        let scaling = Scaling { most, ..places.iter().find_map(of)? };
        (scaling.octaves <= most).then_some(scaling)
    }

    fn from_place(
        function: &ScalarFunction,
        (low, high): (f64, f64),
        place: f64,
        (tolerance, format): (f64, WordFormat),
    ) -> Option<Scaling> {
        let sign = if place < low { 1.0 } else { -1.0 };
        let (near, far) = if place < low { (low - place, high - place) } else { (place - high, place - low) };
        if !(near > 0.0 && far >= FAR * near && far.is_finite()) {
            return None;
        }
        let at = |distance: f64| function.evaluate(place + sign * distance);
        // Where it changes most, for the digits that are left.
        let three = |first: f64| [at(first), at(2.0 * first), at(4.0 * first)];
        let moved = |values: &[f64; 3]| (values[1] - values[0]).abs();
        let [below, above] = [three(near), three(0.25 * far)];
        let values = if moved(&below) > moved(&above) { below } else { above };
        let ratio = (values[2] - values[1]) / (values[1] - values[0]);
        if !(ratio.is_finite() && ratio > 0.0) {
            return None;
        }
        let power = libm::log2(ratio);
        // Halves are what authors write.
        let halves = 0.5 * libm::round(2.0 * power);
        let ratio = if (power - halves).abs() < EQUAL { libm::exp2(halves) } else { ratio };
        let (change, beside) = if ratio == 1.0 {
            (Change::Term(values[1] - values[0]), 0.0)
        } else {
            let beside = (values[1] - ratio * values[0]) / (1.0 - ratio);
            let least = EQUAL * values.iter().fold(0.0f64, |most, value| most.max(value.abs()));
            (Change::Factor(ratio), if beside.abs() < least { 0.0 } else { beside })
        };
        // A power of two keeps the bits of the argument. Where a place is added to them, what is left of its last bit would be
        // the same for all arguments; any other number makes rounding random.
        let reach = far * (1.0 + SLACK);
        let is_exact = place == 0.0 || format.coefficient_bits < format.data_bits;
        let slope = sign / if is_exact { libm::exp2(libm::ceil(libm::log2(reach))) } else { reach };
        let distance = Map { slope, offset: -place * slope };
        let octaves = libm::floor(-libm::log2(near * slope.abs() * (1.0 - SLACK))) as u32;
        let reference = if ratio < 1.0 { octaves } else { 0 };
        let scaling = Scaling { distance, octaves, most: octaves, reference, change, beside, unit: 0, apart: 0.0 };
        let size = (function.evaluate(scaling.in_reference(1.0)) - beside).abs();
        if !(size.is_finite() && size > 0.0) || beside.abs() > BESIDE * at(near).abs().max(at(far).abs()) {
            return None;
        }
        let scaling = Scaling { unit: -libm::ilogb(size), ..scaling };
        let apart = |point: usize| {
            let x = place + sign * near * libm::pow(far / near, point as f64 / POINTS as f64);
            (scaling.evaluate(function, x) - function.evaluate(x)).abs()
        };
        let apart = (0..=POINTS).map(apart).fold(0.0, |most: f64, apart| if apart <= most { most } else { apart });
        (apart <= PART * tolerance).then_some(Scaling { apart, ..scaling })
    }

    /// The argument at a place of 1/2 .. 1 of the octave that the table has.
    fn in_reference(&self, mantissa: f64) -> f64 {
        self.distance.argument(libm::scalbn(mantissa, -(self.reference as i32)))
    }

    /// The function by the octave that the table has.
    fn evaluate(&self, function: &ScalarFunction, x: f64) -> f64 {
        let distance = self.distance.slope * x + self.distance.offset;
        let octave = (-1 - libm::ilogb(distance)).clamp(0, self.octaves as i32);
        let value = function.evaluate(self.in_reference(libm::scalbn(distance, octave)));
        match self.change {
            Change::Factor(_) => self.beside + self.power(octave as u32) * (value - self.beside),
            Change::Term(_) => value + self.power(octave as u32),
        }
    }

    /// What an octave has of the one of the table: a factor or a term.
    fn power(&self, octave: u32) -> f64 {
        let above = f64::from(self.reference) - f64::from(octave);
        match self.change {
            Change::Factor(ratio) => libm::pow(ratio, above),
            Change::Term(term) => above * term,
        }
    }

    /// Whether segments can tell its octaves apart.
    pub fn fits(&self, segments: Segments) -> bool {
        // That of zero is the lowest one.
        segments.octave_bits > 0 && self.octaves <= octave(segments, segments.index_of(0.0, true))
    }

    /// The arguments of the octave that the table has, a little more on both sides.
    pub fn arguments(&self) -> (f64, f64) {
        let ends = [0.5 * (1.0 - SLACK), 1.0 + SLACK].map(|mantissa| self.in_reference(mantissa));
        (ends[0].min(ends[1]), ends[0].max(ends[1]))
    }

    /// How these are mapped to -1 .. 1.
    pub fn local(&self) -> Map {
        let spread = SPREAD * libm::scalbn(1.0, self.reference as i32);
        Map { slope: spread * self.distance.slope, offset: spread * self.distance.offset + CENTRE }
    }

    /// What is added to a scaled distance: as a product with 1, and as a base.
    pub fn centre(&self) -> (f64, f64) {
        (libm::round(CENTRE), CENTRE - libm::round(CENTRE))
    }

    /// What brings distances to the octave 1/2 .. 1, spread out, by segment: a power of two times a number of few bits.
    pub fn scales(&self, segments: Segments) -> Vec<f64> {
        self.by_octave(segments, |octave| SPREAD * libm::scalbn(1.0, octave as i32))
    }

    /// Whether the scales are also what values are multiplied by: those of reciprocals.
    pub fn is_reciprocal(&self) -> bool {
        self.change == Change::Factor(0.5)
    }

    /// Whether it is a power that falls with the distance, and nothing beside it.
    pub fn is_divisor(&self) -> bool {
        self.beside == 0.0 && matches!(self.change, Change::Factor(ratio) if ratio < 1.0)
    }

    /// Whether values get a term.
    pub fn is_logarithm(&self) -> bool {
        matches!(self.change, Change::Term(_))
    }

    /// What brings values of the table to those of an octave, by segment, if scales do not.
    pub fn powers(&self, segments: Segments) -> Option<Vec<f64>> {
        let unit = if self.is_logarithm() { 0 } else { -self.unit };
        let power = |octave: u32| libm::scalbn(self.power(octave), unit);
        (!self.is_reciprocal()).then(|| self.by_octave(segments, power))
    }

    /// The power of two that a value of the table times its factor is multiplied by.
    pub fn weight(&self) -> i32 {
        if self.is_reciprocal() { -self.unit - self.reference as i32 } else { 0 }
    }

    /// What is beside the values.
    pub fn beside(&self) -> f64 {
        self.beside
    }

    /// An entry of the table, from the coefficient of a power in a polynomial of the function.
    pub fn entry(&self, power: usize, coefficient: f64) -> f64 {
        let coefficient = if power == 0 { coefficient - self.beside } else { coefficient };
        match self.change {
            Change::Term(_) => coefficient,
            Change::Factor(_) if self.is_reciprocal() => libm::scalbn(coefficient, self.unit) / SPREAD,
            Change::Factor(_) => libm::scalbn(coefficient, self.unit),
        }
    }

    fn by_octave(&self, segments: Segments, of: impl Fn(u32) -> f64) -> Vec<f64> {
        // No argument is below the last one.
        let most = if self.is_reciprocal() { self.most } else { self.octaves };
        (0..segments.count()).map(|index| of(octave(segments, index).min(most))).collect()
    }
}

/// The octave below 1/2 .. 1 that a segment is in. The last one that is counted goes down to zero; the mantissa behind it
/// tells a few more apart.
fn octave(segments: Segments, index: usize) -> u32 {
    let mantissa_bits = segments.index_bits - segments.octave_bits;
    let (octave, mantissa) = ((index >> mantissa_bits) as u32, index & ((1 << mantissa_bits) - 1));
    let last = (1 << segments.octave_bits) - 1;
    if octave < last { octave } else { last + mantissa_bits - (usize::BITS - mantissa.leading_zeros()) }
}
