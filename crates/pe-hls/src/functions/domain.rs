//! The arguments that a table covers, and how they are mapped to -1 .. 1.

use pe_ir::functions::ScalarFunction;
use pe_ir::word::WordFormat;

use crate::lift::{edges, kinks};

/// Factor by which a table covers more than the run needed.
const MARGIN: f64 = 1.2;

/// Points at which a function is looked at beyond and between its arguments.
const PROBES: usize = 256;

/// Part of a probe's distance to the next that no table resolves, and growth within it from which on there is a pole.
const CLOSE: usize = 1024;
const STEEP: f64 = 16.0;

/// Times that the neighbourhood of a pole is looked at more closely, each time by half as many as there are probes.
const ZOOMS: usize = 7;

/// How much larger or steeper than in the run a function may become in the margin.
const GROWTH: f64 = 2.0;

/// Part of a power of two from which on a reach is rounded up to it.
const NEARLY_WHOLE: f64 = 0.75;

/// Part of the range that is left free at both ends, so that rounding does not leave it.
const SLACK: f64 = 1.0 / 1024.0;

/// A function over the arguments that its table covers.
pub(super) struct Domain<'a> {
    pub function: &'a ScalarFunction,
    pub low: f64,
    pub high: f64,
    /// Largest magnitude of the function.
    pub largest: f64,
    /// Error up to which the data port of what reads the function sees no difference: half of its lowest bit.
    pub tolerance: f64,
    /// Whether scales are powers of two: coefficients are too short for others.
    binary: bool,
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

/// Whether a function grows beyond bounds at the place of its largest value among the probes, or within rounding of it: it
/// then keeps growing where no table tells arguments apart. A value right beside a pole is finite, and so large that no
/// error looks large beside it.
fn is_pole(function: &ScalarFunction, (low, high): (f64, f64), place: f64) -> bool {
    let near = |distance: f64| {
        let value = |x: f64| if (low..=high).contains(&x) { function.evaluate(x).abs() } else { 0.0 };
        value(place - distance).max(value(place + distance))
    };
    let close = (high - low) / (PROBES * CLOSE) as f64;
    function.evaluate(place).abs() > STEEP * near(close) && near(close) > 0.0
}

/// The place near which a function grows beyond bounds, as exactly as numbers tell; `place` if it is no larger there.
pub(super) fn steepest_place(function: &ScalarFunction, run: (f64, f64), place: f64) -> f64 {
    let size = |x: f64| Some(function.evaluate(x).abs()).filter(|size| size.is_finite()).unwrap_or(f64::INFINITY);
    let ((mut low, mut high), mut found) = (run, place);
    for _ in 0..ZOOMS {
        let width = (high - low) / PROBES as f64;
        for x in (0..=PROBES).map(|step| low + width * step as f64) {
            if size(x) > size(found) {
                found = x;
            }
        }
        (low, high) = ((found - width).max(low), (found + width).min(high));
    }
    if size(found) > STEEP * size(place) { found } else { place }
}

impl<'a> Domain<'a> {
    /// The domain for arguments of a run.
    ///
    /// # Errors
    /// A place between the arguments where the function has no value.
    pub fn of(function: &'a ScalarFunction, run: (f64, f64), format: WordFormat) -> Result<Domain<'a>, f64> {
        let probe = |from: f64, to: f64, step: usize| from + (to - from) * (step as f64 / PROBES as f64);
        let (mut largest, mut steepest): (f64, f64) = (0.0, 0.0);
        let (mut before, mut highest) = (function.evaluate(run.0), run.0);
        for step in 0..=PROBES {
            let x = probe(run.0, run.1, step);
            let value = function.evaluate(x);
            if !value.is_finite() {
                return Err(x);
            }
            if value.abs() > largest {
                (largest, highest) = (value.abs(), x);
            }
            steepest = steepest.max((value - before).abs() * PROBES as f64 / (run.1 - run.0));
            before = value;
        }
        if is_pole(function, run, highest) {
            return Err(steepest_place(function, run, highest));
        }
        let kinks = kinks(&function.body);
        let (middle, half) = (0.5 * (run.0 + run.1), 0.5 * (run.1 - run.0));
        let magnitude = run.0.abs().max(run.1.abs());
        // An argument that hardly changes still needs room for what rounding makes of it.
        let room = (MARGIN * half).max(1e-3 * if magnitude == 0.0 { 1.0 } else { magnitude });
        let reach = |from: f64, to: f64| {
            // What has a sign keeps it: it may be a divisor, or under a root.
            let to = if from != 0.0 && to / from < 1.0 / MARGIN { from / MARGIN } else { to };
            let (mut reached, mut before) = (from, function.evaluate(from));
            for step in 1..=PROBES {
                let x = probe(from, to, step);
                let value = function.evaluate(x);
                let slope = ((value - before) / (x - reached)).abs();
                let jumps = kinks.iter().any(|kink| (x.min(reached)..=x.max(reached)).contains(kink));
                let grows = largest > 0.0 && value.abs() > GROWTH * largest;
                if !value.is_finite() || (!jumps && (grows || (steepest > 0.0 && slope > GROWTH * steepest))) {
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
        let largest = (0..=PROBES).map(|step| function.evaluate(probe(low, high, step)).abs());
        let largest = largest.filter(|value| value.is_finite()).fold(0.0, f64::max);
        let scale = if largest > 0.0 { libm::exp2(libm::ceil(libm::log2(largest))) } else { 1.0 };
        let tolerance = libm::scalbn(scale, -(format.data_bits as i32));
        let binary = format.coefficient_bits < format.data_bits;
        Ok(Domain { function, low, high, largest, tolerance, binary })
    }

    /// The map for equal segments, its scale a power of two if `whole` says so and that wastes little: a kink falls on
    /// zero, with the value of the function there on the positive side.
    pub fn uniform(&self, whole: bool) -> Map {
        let inside = |kink: &f64| (self.low..=self.high).contains(kink);
        let kink = kinks(&self.function.body).into_iter().find(inside);
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
        let slope = sign * self.scale(reach, whole);
        Map { slope, offset: -centre * slope }
    }

    /// The map for octaves of distances from where the function is steep, or from zero, if all arguments are on one
    /// side of that place.
    pub fn octaves(&self, whole: bool) -> Option<Map> {
        if kinks(&self.function.body).iter().any(|kink| (self.low..=self.high).contains(kink)) {
            return None;
        }
        let places = edges(&self.function.body).into_iter().chain([0.0]);
        let distance = |place: &f64| (self.low - place).max(place - self.high);
        let beside = places.filter(|place| *place <= self.low || *place >= self.high);
        let place = beside.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let (sign, reach) = if place <= self.low { (1.0, self.high - place) } else { (-1.0, place - self.low) };
        let slope = sign * self.scale(reach, whole);
        Some(Map { slope, offset: -place * slope })
    }

    /// What distances up to `reach` are multiplied by. A power of two is exact: the mapped argument then has the bits of the
    /// argument itself.
    fn scale(&self, reach: f64, whole: bool) -> f64 {
        let reach = reach * (1.0 + SLACK);
        let power = libm::exp2(libm::ceil(libm::log2(reach)));
        1.0 / if self.binary || (whole && reach > NEARLY_WHOLE * power) { power } else { reach }
    }
}
