//! Piecewise polynomials: interpolation at Chebyshev nodes in each segment, checked on a dense grid.

use pe_ir::functions::Segments;

use super::domain::{Domain, Map};

/// Highest degree: eight products with the map, the local coordinate and the first factor.
const HIGHEST_DEGREE: usize = 6;

/// Points of a segment at which a polynomial is compared with its function, the ends included.
const CHECKS: usize = 17;

/// How a table divides its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// Equal segments of -1 .. 1.
    Uniform,
    /// Parts of octaves of 0 .. 1.
    Octaves,
}

/// The table of a function.
pub(super) struct Fit {
    pub layout: Layout,
    pub map: Map,
    pub degree: usize,
    /// Of degree zero the constants. Else what is added to the scaled argument for the local coordinate, with octaves
    /// its scale, and the coefficients of the polynomial, highest first.
    pub columns: Vec<Vec<f64>>,
    /// Largest difference to the function.
    pub error: f64,
    /// How many times that is what is tolerated, at least 1.
    pub excess: f64,
    /// The same where an argument that the data port does not tell from its neighbours excuses a part of it.
    pub blurred_excess: f64,
    /// Where the largest difference is.
    pub worst: f64,
}

impl Fit {
    /// The cheapest table that holds the tolerance, or the most accurate one.
    pub fn of(domain: &Domain, segments: Segments) -> Fit {
        let maps = [true, false].map(|whole| domain.uniform(whole));
        let uniform = Fit::cheaper(domain, segments, Layout::Uniform, maps);
        let maps = domain.octaves(true).zip(domain.octaves(false)).filter(|_| segments.octave_bits > 0);
        let octaves = maps.map(|(whole, tight)| Fit::cheaper(domain, segments, Layout::Octaves, [whole, tight]));
        match octaves {
            Some(octaves) if (octaves.excess, octaves.products()) < (uniform.excess, uniform.products()) => octaves,
            _ => uniform,
        }
    }

    /// The table with the first map, unless the second makes a cheaper or a more accurate one.
    fn cheaper(domain: &Domain, segments: Segments, layout: Layout, [first, second]: [Map; 2]) -> Fit {
        let fit = Fit::in_layout(domain, segments, layout, first);
        if first.slope == second.slope {
            return fit;
        }
        let other = Fit::in_layout(domain, segments, layout, second);
        if (other.excess, other.products()) < (fit.excess, fit.products()) { other } else { fit }
    }

    fn in_layout(domain: &Domain, segments: Segments, layout: Layout, map: Map) -> Fit {
        let mut best: Option<Fit> = None;
        for degree in 0..=HIGHEST_DEGREE {
            let fit = Fit::of_degree(domain, segments, layout, map, degree);
            let done = fit.excess <= 1.0;
            if best.as_ref().is_none_or(|best| fit.excess < best.excess) {
                best = Some(fit);
            }
            if done {
                break;
            }
        }
        best.expect("some degree is tried")
    }

    fn of_degree(domain: &Domain, segments: Segments, layout: Layout, map: Map, degree: usize) -> Fit {
        let octaves = layout == Layout::Octaves;
        let head = if degree == 0 { 0 } else { 1 + usize::from(octaves) };
        let mut columns = vec![Vec::with_capacity(segments.count()); head + degree + 1];
        let (mut error, mut worst, mut blurred_excess) = (0.0, domain.low, 1.0f64);
        for index in 0..segments.count() {
            let (start, end) = segments.range(index, octaves);
            let (centre, half) = (0.5 * (start + end), 0.5 * (end - start));
            let piece = Piece::of(domain, map, (centre, half), degree);
            if piece.error.is_nan() || piece.error > error {
                (error, worst) = (if piece.error.is_nan() { f64::INFINITY } else { piece.error }, piece.worst);
            }
            blurred_excess = blurred_excess.max(piece.blurred_excess);
            let head = [-centre / half, 1.0 / half].into_iter().take(head);
            let entries = head.chain(piece.polynomial.into_iter().rev());
            columns.iter_mut().zip(entries).for_each(|(column, entry)| column.push(entry));
        }
        let excess = (error / domain.tolerance).max(1.0);
        Fit { layout, map, degree, columns, error, excess, blurred_excess, worst }
    }

    /// Products of a lookup: the argument, the local coordinate, and the polynomial with its first factor.
    pub fn products(&self) -> usize {
        let scale = usize::from(self.layout == Layout::Octaves);
        if self.degree == 0 { 2 } else { 3 + scale + self.degree }
    }
}

/// The polynomial of a segment in its local coordinate.
struct Piece {
    /// Coefficients, lowest first.
    polynomial: Vec<f64>,
    error: f64,
    blurred_excess: f64,
    worst: f64,
}

impl Piece {
    /// The polynomial around `centre`, `half` the segment to either side.
    fn of(domain: &Domain, map: Map, (centre, half): (f64, f64), degree: usize) -> Piece {
        let argument = |u: f64| map.argument(centre + half * u);
        // The part of the segment that the domain covers.
        let covered = [domain.low, domain.high].map(|x| (x - map.argument(centre)) * map.slope / half);
        let (from, to) = (covered[0].min(covered[1]).max(-1.0), covered[0].max(covered[1]).min(1.0));
        if from >= to {
            // No argument falls here; the value at the nearest end keeps the range of the column small.
            let nearest = argument(0.0).clamp(domain.low, domain.high);
            let mut polynomial = vec![0.0; degree + 1];
            polynomial[0] = domain.function.evaluate(nearest);
            return Piece { polynomial, error: 0.0, blurred_excess: 0.0, worst: nearest };
        }
        let (middle, width) = (0.5 * (from + to), 0.5 * (to - from));
        let value = |u: f64| domain.function.evaluate(argument(u));
        let polynomial = interpolate(degree, |t| value(middle + width * t));
        let mut polynomial = moved(&polynomial, middle, width);
        if domain.is_part {
            // What a part is at its ends stays when the argument is beyond them.
            let is = |polynomial: &[f64], u: f64| polynomial.iter().rev().fold(0.0, |sum, entry| sum * u + entry);
            let ends = [(covered[0].min(covered[1]), from), (covered[0].max(covered[1]), to)];
            let missing = ends.map(|(end, u)| if end == u { value(u) - is(&polynomial, u) } else { 0.0 });
            if missing.iter().all(|missing| missing.is_finite()) {
                let slope = if degree == 0 { 0.0 } else { (missing[1] - missing[0]) / (to - from) };
                polynomial[0] += if missing[0] == 0.0 { missing[1] - slope * to } else { missing[0] - slope * from };
                polynomial.iter_mut().skip(1).take(1).for_each(|entry| *entry += slope);
            }
        }
        let (mut error, mut worst, mut blurred_excess) = (0.0, argument(middle), 0.0f64);
        // Just inside, where a jump at the end of the segment is not seen.
        let even = |check: usize| (2.0 * check as f64 / (CHECKS - 1) as f64 - 1.0) * (1.0 - 1e-12);
        let peaks = domain.features_between(argument(from), argument(to));
        let peaks = peaks.iter().map(|x| (((map.slope * x + map.offset) - centre) / half - middle) / width);
        for t in (0..CHECKS).map(even).chain(peaks) {
            let u = middle + width * t;
            let is = polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * u + coefficient);
            let difference = (is - value(u)).abs();
            if difference.is_nan() || difference > error {
                (error, worst) = (difference, argument(u));
            }
            if difference.is_nan() || difference > domain.tolerance {
                let excess = difference / domain.tolerance_at(argument(u));
                blurred_excess = if excess.is_nan() { f64::INFINITY } else { blurred_excess.max(excess) };
            }
        }
        Piece { polynomial, error, blurred_excess, worst }
    }
}

/// Whether the polynomials of highest degree hold a function in all segments of a layout, but for so many times of what
/// their arguments excuse.
pub(super) fn holds(domain: &Domain, segments: Segments, excess: f64) -> bool {
    let all = |layout: Layout, map: Map| {
        (0..segments.count()).all(|index| {
            let (start, end) = segments.range(index, layout == Layout::Octaves);
            let place = (0.5 * (start + end), 0.5 * (end - start));
            Piece::of(domain, map, place, HIGHEST_DEGREE).blurred_excess <= excess
        })
    };
    match segments.octave_bits {
        0 => all(Layout::Uniform, domain.uniform(false)),
        _ => domain.octaves(false).is_some_and(|map| all(Layout::Octaves, map)),
    }
}

/// Whether one polynomial does from one argument to another.
pub(super) fn piece_holds(domain: &Domain, low: f64, high: f64, excess: f64) -> bool {
    let (map, place) = (Map { slope: 1.0, offset: 0.0 }, (0.5 * (low + high), 0.5 * (high - low)));
    Piece::of(domain, map, place, HIGHEST_DEGREE).blurred_excess <= excess
}

/// The coefficients of the polynomial of a degree that agrees with a function at the Chebyshev nodes of -1 .. 1, lowest
/// first.
fn interpolate(degree: usize, function: impl Fn(f64) -> f64) -> Vec<f64> {
    use core::f64::consts::PI;
    let count = degree + 1;
    let angle = |node: usize| PI * (node as f64 + 0.5) / count as f64;
    let values: Vec<f64> = (0..count).map(|node| function(libm::cos(angle(node)))).collect();
    // Coefficients of Chebyshev polynomials, then of powers: T(k + 1) = 2 x T(k) - T(k - 1).
    let mut powers = vec![0.0; count];
    let (mut before, mut current) = (vec![0.0; count], vec![0.0; count]);
    current[0] = 1.0;
    for order in 0..count {
        let products = values.iter().enumerate().map(|(node, value)| value * libm::cos(order as f64 * angle(node)));
        let weight = if order == 0 { 1.0 } else { 2.0 } / count as f64 * products.sum::<f64>();
        for (power, coefficient) in powers.iter_mut().zip(&current) {
            *power += weight * coefficient;
        }
        let twice = if order == 0 { 1.0 } else { 2.0 };
        let next = (0..count).map(|k| if k == 0 { 0.0 } else { twice * current[k - 1] } - before[k]).collect();
        before = std::mem::replace(&mut current, next);
    }
    powers
}

/// The polynomial `p((u - middle)/width)` in powers of `u`.
fn moved(polynomial: &[f64], middle: f64, width: f64) -> Vec<f64> {
    if middle == 0.0 && width == 1.0 {
        return polynomial.to_vec();
    }
    let mut sum = vec![0.0; polynomial.len()];
    for coefficient in polynomial.iter().rev() {
        // sum := sum * (u - middle)/width + coefficient
        for power in (0..sum.len()).rev() {
            let below = if power == 0 { 0.0 } else { sum[power - 1] };
            sum[power] = (below - middle * sum[power]) / width;
        }
        sum[0] += coefficient;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_is_its_own_interpolation() {
        let cubic = |x: f64| 1.0 - 2.0 * x + 0.5 * x * x * x;
        for (is, should) in interpolate(4, cubic).iter().zip([1.0, -2.0, 0.0, 0.5, 0.0]) {
            assert!((is - should).abs() < 1e-14);
        }
        let moved = moved(&[1.0, -2.0, 0.0, 0.5], 0.3, 0.25);
        for u in [0.1, 0.3, 0.5] {
            let is = moved.iter().rev().fold(0.0, |sum, coefficient| sum * u + coefficient);
            assert!((is - cubic((u - 0.3) / 0.25)).abs() < 1e-12);
        }
    }
}
