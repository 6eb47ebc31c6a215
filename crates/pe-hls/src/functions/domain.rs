//! The arguments that a table covers, and how they are mapped to -1 .. 1.

use std::borrow::Cow;
use std::rc::Rc;

use pe_ir::functions::ScalarFunction;
use pe_ir::word::WordFormat;

use super::fill::filled;
use super::known::Answers;
use super::places::{self, Singular};
use super::scaling::Scaling;
use crate::kinks::{edges, even_grid, kinks, origins};

/// Factor by which a table covers more than the run needed.
const MARGIN: f64 = 1.2;

/// Points at which a function is looked at beyond and between its arguments.
const PROBES: usize = 256;

/// How much larger or steeper than in the run a function may become in the margin.
const GROWTH: f64 = 2.0;

/// Part of a power of two from which on a reach is rounded up to it.
const NEARLY_WHOLE: f64 = 0.75;

/// Intervals between kinks on either side of zero for which the fewest segments are enough.
const FEWEST_INTERVALS: f64 = 4.0;

/// Largest magnitude of an offset that the base of the argument holds, with room, and from which on it is too large to be
/// made smaller by a scale.
pub(super) const LARGEST_BASE: f64 = 0.99;
const NEARLY_BASE: f64 = 1.05;

/// Part of the range that is left free at both ends, so that rounding does not leave it.
const SLACK: f64 = 1.0 / 1024.0;

/// A function over the arguments that its table covers.
pub(super) struct Domain<'a> {
    /// The function; around places where it is 0/0 what stands for it.
    pub function: Cow<'a, ScalarFunction>,
    pub low: f64,
    pub high: f64,
    /// Largest magnitude of the function.
    pub largest: f64,
    /// Error up to which the data port of what reads the function sees no difference: half of its lowest bit.
    pub tolerance: f64,
    /// Half of what the data port tells arguments apart by.
    pub blur: f64,
    /// Arguments around narrow peaks, ascending: what is fitted is looked at there, too.
    pub features: Vec<f64>,
    /// Whether scales are powers of two: coefficients are too short for others.
    binary: bool,
    /// Whether its arguments are scaled anyway, so that another scale costs no bit.
    pub is_scaled: bool,
    /// Whether it is a part of another one, whose argument is counted from an end of it: zero is no place of its own
    /// then.
    pub is_part: bool,
    /// How one octave tells all of it, if it does.
    pub scaling: Option<Scaling>,
    /// What is known of its tables.
    pub answers: Rc<Answers>,
}

/// `z = slope*x + offset`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Map {
    pub slope: f64,
    pub offset: f64,
}

impl Map {
    /// The argument that is mapped to `z`.
    pub fn argument(self, z: f64) -> f64 {
        (z - self.offset) / self.slope
    }
}

impl<'a> Domain<'a> {
    /// The domain for arguments of a run.
    ///
    /// # Errors
    /// A place between the arguments where the function has no value.
    pub fn of(function: &'a ScalarFunction, run: (f64, f64), format: WordFormat) -> Result<Domain<'a>, f64> {
        let probe = |from: f64, to: f64, step: usize| from + (to - from) * (step as f64 / PROBES as f64);
        let (middle, half) = (0.5 * (run.0 + run.1), 0.5 * (run.1 - run.0));
        let magnitude = run.0.abs().max(run.1.abs());
        // An argument that hardly changes still needs room for what rounding makes of it.
        let room = (MARGIN * half).max(1e-3 * if magnitude == 0.0 { 1.0 } else { magnitude });
        let Singular { pole, removable } = places::singular(function, run.0, run.1);
        if let Some(pole) = pole {
            return Err(pole);
        }
        let function = match removable.is_empty() {
            true => Cow::Borrowed(function),
            false => Cow::Owned(filled(function, &removable, run)),
        };
        let (mut largest, mut steepest): (f64, f64) = (0.0, 0.0);
        let mut before = (run.0, function.evaluate(run.0));
        let features = places::features(&function, run.0, run.1);
        let mut probes: Vec<f64> = (0..=PROBES).map(|step| probe(run.0, run.1, step)).collect();
        probes.extend(&features);
        probes.sort_unstable_by(f64::total_cmp);
        for x in probes {
            let value = function.evaluate(x);
            if !value.is_finite() {
                return Err(x);
            }
            largest = largest.max(value.abs());
            if x > before.0 {
                steepest = steepest.max((value - before.1).abs() / (x - before.0));
            }
            before = (x, value);
        }
        let kinks = kinks(&function.body, middle - room, middle + room);
        let is_pole = |place: &f64| !function.evaluate(*place).is_finite();
        let poles: Vec<f64> = origins(&function.body).into_iter().filter(is_pole).collect();
        let reach = |from: f64, to: f64| {
            // What has a sign keeps it: it may be a divisor, or under a root.
            let to = if from != 0.0 && to / from < 1.0 / MARGIN { from / MARGIN } else { to };
            let (mut reached, mut before) = (from, function.evaluate(from));
            for step in 1..=PROBES {
                let x = probe(from, to, step);
                let value = function.evaluate(x);
                let slope = ((value - before) / (x - reached)).abs();
                let between = |places: &[f64]| places.iter().any(|at| (x.min(reached)..=x.max(reached)).contains(at));
                let jumps = between(&kinks);
                let grows = largest > 0.0 && value.abs() > GROWTH * largest;
                // The values on the other side of a pole may look alike.
                if !value.is_finite()
                    || between(&poles)
                    || (!jumps && (grows || (steepest > 0.0 && slope > GROWTH * steepest)))
                {
                    break;
                }
                (reached, before) = (x, value);
            }
            reached
        };
        let (mut low, mut high) = (reach(run.0, middle - room), reach(run.1, middle + room));
        if low == high {
            // Alone between two places where the function has no value.
            (low, high) = (low - f64::EPSILON * magnitude, high + f64::EPSILON * magnitude);
        }
        let places = (0..=PROBES).map(|step| probe(low, high, step)).chain(features.iter().copied());
        let largest = places.map(|x| function.evaluate(x).abs());
        let largest = largest.filter(|value| value.is_finite()).fold(0.0, f64::max);
        let scale = if largest > 0.0 { libm::exp2(libm::ceil(libm::log2(largest))) } else { 1.0 };
        let tolerance = libm::scalbn(scale, -(format.data_bits as i32));
        let binary = format.coefficient_bits < format.data_bits;
        let blur = libm::scalbn(high - low, -(format.data_bits as i32));
        let beside = |place: &f64| *place <= low || *place >= high;
        let places: Vec<f64> = origins(&function.body).into_iter().chain([0.0]).filter(beside).collect();
        let scaling = match kinks.is_empty() {
            true => Scaling::of(&function, (low, high), &places, tolerance, format),
            false => None,
        };
        let (is_scaled, is_part, answers) = (false, false, Rc::default());
        Ok(Domain {
            function,
            low,
            high,
            largest,
            tolerance,
            blur,
            features,
            binary,
            is_scaled,
            is_part,
            scaling,
            answers,
        })
    }

    /// The domain of a function that stands for a part of this one, or for what leads to it: what is tolerated is the
    /// same, but for what its own values are held by.
    pub fn part(&self, function: ScalarFunction, low: f64, high: f64, tolerance: f64) -> Domain<'static> {
        let values = (0..=PROBES).map(|step| function.evaluate(low + (high - low) * (step as f64 / PROBES as f64)));
        let largest = values.filter(|value| value.is_finite()).fold(0.0f64, |largest, value| largest.max(value.abs()));
        let features = places::features(&function, low, high);
        let (blur, binary, function) = (self.blur, self.binary, Cow::Owned(function));
        let (is_scaled, is_part, scaling, answers) = (self.is_scaled, true, None, Rc::default());
        Domain { function, low, high, largest, tolerance, blur, features, binary, is_scaled, is_part, scaling, answers }
    }

    /// The same function from one argument to another.
    pub fn between(&self, low: f64, high: f64) -> Domain<'_> {
        let (features, function) = (self.features_between(low, high).to_vec(), Cow::Borrowed(&*self.function));
        Domain { function, low, high, features, is_part: true, scaling: None, answers: Rc::default(), ..*self }
    }

    /// The octave of a function that tells all of it.
    pub fn reference(&self, scaling: Scaling) -> Domain<'_> {
        let (low, high) = scaling.arguments();
        let function = Cow::Borrowed(&*self.function);
        Domain { function, low, high, features: Vec::new(), blur: 0.0, scaling: None, answers: Rc::default(), ..*self }
    }

    /// The arguments around narrow peaks that lie between two, whichever is larger.
    pub fn features_between(&self, from: f64, to: f64) -> &[f64] {
        let index = |x: f64| self.features.partition_point(|feature| *feature <= x);
        &self.features[index(from.min(to))..index(from.max(to)).max(index(from.min(to)))]
    }

    /// Error up to which nothing is lost at an argument: half a bit of the result, or what half a bit of the argument
    /// makes of it.
    pub fn tolerance_at(&self, x: f64) -> f64 {
        let at = |x: f64| self.function.evaluate(x.clamp(self.low, self.high));
        let change = (at(x + self.blur) - at(x - self.blur)).abs();
        self.tolerance + if change.is_finite() { 0.5 * change } else { 0.0 }
    }

    /// The map for equal segments, its scale a power of two if `whole` says so and that wastes little: a kink falls on
    /// zero, with the value of the function there on the positive side.
    pub fn uniform(&self, whole: bool) -> Map {
        if let Some(map) = self.knotted() {
            return map;
        }
        let inside = |kink: &f64| (self.low..=self.high).contains(kink);
        let kink = kinks(&self.function.body, self.low, self.high).into_iter().find(inside);
        let centre = kink.unwrap_or(0.5 * (self.low + self.high));
        let reach = (self.high - centre).max(centre - self.low);
        let sign = match kink {
            Some(kink) => {
                let [left, at, right] =
                    [kink - SLACK * reach, kink, kink + SLACK * reach].map(|x| self.function.evaluate(x));
                if (at - left).abs() < (right - at).abs() { -1.0 } else { 1.0 }
            }
            None => 1.0,
        };
        let mut slope = sign * self.scale(reach, whole && !self.is_scaled);
        let offset = (centre * slope).abs();
        if self.is_scaled && !self.binary && (LARGEST_BASE..NEARLY_BASE).contains(&offset) {
            // A little narrower, and the offset needs no product.
            slope *= (1.0 - SLACK) * LARGEST_BASE / offset;
        }
        Map { slope, offset: -centre * slope }
    }

    /// The map for a function with several kinks: all of them fall between two segments.
    fn knotted(&self) -> Option<Map> {
        let kinks = kinks(&self.function.body, self.low, self.high);
        if kinks.len() < 2 {
            return None;
        }
        let (first, spacing) = even_grid(&kinks)?;
        let centre = first + spacing * libm::round((0.5 * (self.low + self.high) - first) / spacing);
        let reach = (self.high - centre).max(centre - self.low) / spacing;
        let slope = 1.0 / (spacing * libm::exp2(libm::ceil(libm::log2(reach.max(FEWEST_INTERVALS)))));
        Some(Map { slope, offset: -centre * slope })
    }

    /// The map for octaves of distances from where the function is steep, or from zero, if all arguments are on one
    /// side of that place.
    pub fn octaves(&self, whole: bool) -> Option<Map> {
        let kinks = kinks(&self.function.body, self.low, self.high);
        if kinks.iter().any(|kink| *kink > self.low && *kink < self.high) {
            return None;
        }
        let beside = |place: &f64| *place <= self.low || *place >= self.high;
        let mut places: Vec<f64> = edges(&self.function.body).into_iter().chain(kinks).filter(beside).collect();
        if places.is_empty() || !self.is_part {
            places.extend(Some(0.0).filter(beside));
        }
        let distance = |place: &f64| (self.low - place).max(place - self.high);
        let place = places.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let (sign, reach) = if place <= self.low { (1.0, self.high - place) } else { (-1.0, place - self.low) };
        let slope = sign * self.scale(reach, whole);
        Some(Map { slope, offset: -place * slope })
    }

    /// What distances up to `reach` are multiplied by. A power of two is exact: the mapped argument then has the bits
    /// of the argument itself.
    fn scale(&self, reach: f64, whole: bool) -> f64 {
        let reach = reach * (1.0 + SLACK);
        let power = libm::exp2(libm::ceil(libm::log2(reach)));
        1.0 / if self.binary || (whole && reach > NEARLY_WHOLE * power) { power } else { reach }
    }
}
