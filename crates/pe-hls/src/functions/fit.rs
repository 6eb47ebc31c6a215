//! Piecewise polynomials: interpolation at Chebyshev nodes in each segment, checked on a dense grid.

use std::sync::LazyLock;

use pe_ir::functions::Segments;

use super::WORDS;
use super::domain::{Domain, Map};
use super::known::Asked;
use super::scaling::Scaling;

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

/// What the table of a function is like, without its entries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub layout: Layout,
    pub map: Map,
    pub degree: usize,
    /// How many times what is tolerated the largest difference to the function is, at least 1.
    pub excess: f64,
    /// The octaves that arguments are brought to one of, if they are: the rest is that of this octave then.
    pub scaling: Option<Scaling>,
}

impl Shape {
    /// Products of a lookup, at least.
    pub const FEWEST_PRODUCTS: u64 = 2;

    /// The cheapest table that holds the tolerance, or the most accurate one.
    pub fn of(domain: &Domain, segments: Segments) -> Shape {
        Shape::within(domain, segments, f64::INFINITY).expect("some degree is tried")
    }

    /// The same, unless it misses more than so many times what is tolerated.
    pub fn within(domain: &Domain, segments: Segments, most: f64) -> Option<Shape> {
        domain.answers.shape(Asked::best(segments), most, || Shape::found(domain, segments, most))
    }

    /// The same, looked for.
    fn found(domain: &Domain, segments: Segments, most: f64) -> Option<Shape> {
        let uniform = domain.answers.shape(Asked::Uniform(segments.index_bits), most, || {
            let maps = [true, false].map(|whole| domain.uniform(whole));
            Shape::in_layout((domain, segments, most), Layout::Uniform, maps, None)
        });
        let maps = domain.octaves(true).zip(domain.octaves(false)).filter(|_| segments.octave_bits > 0);
        let octaves = maps.and_then(|(whole, tight)| {
            Shape::in_layout((domain, segments, most), Layout::Octaves, [whole, tight], uniform)
        });
        let whole = octaves.or(uniform);
        let Some(scaling) = domain.scaling.filter(|scaling| scaling.fits(segments)) else { return whole };
        let one = domain.answers.shape(Asked::Octave(segments.index_bits), most, || {
            let reference = domain.reference(scaling);
            let one = Shape::with_map((&reference, segments, most), Layout::Uniform, scaling.local(), None);
            one.map(|shape| Shape { scaling: Some(scaling), ..shape })
        });
        let order = |shape: &Shape| {
            let words = (shape.columns() << segments.index_bits) as f64;
            (shape.excess, shape.products() as f64 * (1.0 + words / WORDS))
        };
        whole.into_iter().chain(one).reduce(|best, shape| if order(&shape) < order(&best) { shape } else { best })
    }

    /// The table with the first map, unless the second makes a cheaper or a more accurate one; none if it is no better than
    /// another one.
    fn in_layout(
        asked: (&Domain, Segments, f64),
        layout: Layout,
        [first, second]: [Map; 2],
        other: Option<Shape>,
    ) -> Option<Shape> {
        let shape = Shape::with_map(asked, layout, first, other);
        if first.slope == second.slope {
            return shape;
        }
        Shape::with_map(asked, layout, second, shape.or(other)).or(shape)
    }

    /// The least degree that holds the tolerance, or the most accurate one; none if that is no better than another shape, or
    /// misses too much.
    fn with_map(
        (domain, segments, most): (&Domain, Segments, f64),
        layout: Layout,
        map: Map,
        other: Option<Shape>,
    ) -> Option<Shape> {
        let order = |shape: &Shape| (shape.excess, shape.products());
        let better = |shape: &Shape| other.is_none_or(|other| order(shape) < order(&other));
        let piece = |degree: usize, index: usize| Piece::of(domain, map, place(segments, layout, index), degree);
        // Most degrees that are too low are so where the one below was.
        let mut hard = 0;
        for degree in 0..=HIGHEST_DEGREE {
            let shape = Shape { layout, map, degree, excess: 1.0, scaling: None };
            if !better(&shape) {
                break;
            }
            let misses = |index: &usize| !piece(degree, *index).holds();
            match std::iter::once(hard).chain(0..segments.count()).find(misses) {
                None => return Some(shape),
                Some(index) => hard = index,
            }
        }
        let most = other.map_or(most, |other| most.min(other.excess));
        if most <= 1.0 {
            return None;
        }
        let mut best: Option<Shape> = None;
        for degree in 0..=HIGHEST_DEGREE {
            let least = best.map_or(most, |best| best.excess);
            let mut largest = 0.0f64;
            for index in std::iter::once(hard).chain(0..segments.count()) {
                let (error, _) = piece(degree, index).error();
                largest = if error.is_nan() { f64::INFINITY } else { largest.max(error) };
                if largest / domain.tolerance > least {
                    break;
                }
            }
            let excess = (largest / domain.tolerance).max(1.0);
            if excess <= most && best.is_none_or(|best| excess < best.excess) {
                best = Some(Shape { layout, map, degree, excess, scaling: None });
            }
        }
        best.filter(better)
    }

    /// The same as [`Shape::of`], found by trying everything.
    #[cfg(test)]
    pub fn tried(domain: &Domain, segments: Segments) -> Shape {
        let of = |layout: Layout, map: Map| {
            (0..=HIGHEST_DEGREE).map(move |degree| {
                let piece = |index: usize| Piece::of(domain, map, place(segments, layout, index), degree).error().0;
                let errors = (0..segments.count()).map(piece);
                let error =
                    errors.fold(0.0, |most: f64, error| if error.is_nan() { f64::INFINITY } else { most.max(error) });
                Shape { layout, map, degree, excess: (error / domain.tolerance).max(1.0), scaling: None }
            })
        };
        let uniform = [true, false].into_iter().flat_map(|whole| of(Layout::Uniform, domain.uniform(whole)));
        let octaves = [true, false].into_iter().filter_map(|whole| domain.octaves(whole));
        let octaves = octaves.filter(|_| segments.octave_bits > 0).flat_map(|map| of(Layout::Octaves, map));
        let order = |shape: &Shape| (shape.excess, shape.products());
        let all = uniform.chain(octaves);
        let best = |all: &mut dyn Iterator<Item = Shape>| {
            all.reduce(|best, shape| if order(&shape) < order(&best) { shape } else { best })
        };
        let whole = best(&mut { all });
        let scaling = domain.scaling.filter(|scaling| scaling.fits(segments));
        let one = scaling.and_then(|scaling| {
            let reference = domain.reference(scaling);
            let of = |degree: usize| {
                let piece = |index: usize| {
                    let place = place(segments, Layout::Uniform, index);
                    Piece::of(&reference, scaling.local(), place, degree).error().0
                };
                let errors = (0..segments.count()).map(piece);
                let error =
                    errors.fold(0.0, |most: f64, error| if error.is_nan() { f64::INFINITY } else { most.max(error) });
                let excess = (error / domain.tolerance).max(1.0);
                Shape { layout: Layout::Uniform, map: scaling.local(), degree, excess, scaling: Some(scaling) }
            };
            best(&mut (0..=HIGHEST_DEGREE).map(of))
        });
        let price = |shape: &Shape| {
            let words = (shape.columns() << segments.index_bits) as f64;
            (shape.excess, shape.products() as f64 * (1.0 + words / WORDS))
        };
        whole
            .into_iter()
            .chain(one)
            .reduce(|best, shape| if price(&shape) < price(&best) { shape } else { best })
            .expect("some degree is tried")
    }

    /// Products of a lookup: the argument, the local coordinate, and the polynomial with its first factor.
    pub fn products(&self) -> usize {
        let scale = usize::from(self.layout == Layout::Octaves);
        let table = if self.degree == 0 { Self::FEWEST_PRODUCTS as usize } else { 3 + scale + self.degree };
        // The scale, what it is multiplied with, the centre, the result, and what it is multiplied by.
        table + self.scaling.map_or(0, |scaling| 4 + usize::from(!scaling.is_reciprocal() && !scaling.is_logarithm()))
    }

    /// Columns of the tables.
    pub fn columns(&self) -> usize {
        let scales = self.scaling.map_or(0, |scaling| 1 + usize::from(!scaling.is_reciprocal()));
        self.head() + self.degree + 1 + scales
    }

    /// Columns in front of the coefficients: what is added to the argument for the local coordinate, and its scale.
    fn head(&self) -> usize {
        if self.degree == 0 { 0 } else { 1 + usize::from(self.layout == Layout::Octaves) }
    }
}

/// The table of a function.
pub(super) struct Fit {
    pub shape: Shape,
    /// Of degree zero the constants. Else what is added to the scaled argument for the local coordinate, with octaves
    /// its scale, and the coefficients of the polynomial, highest first.
    pub columns: Vec<Vec<f64>>,
    /// Largest difference to the function.
    pub error: f64,
    /// The same in what is tolerated, at least 1, where an argument that the data port does not tell from its neighbours
    /// excuses a part of it.
    pub blurred_excess: f64,
    /// Where the largest difference is.
    pub worst: f64,
}

impl Fit {
    /// The table of the shape that suits a function.
    pub fn of(domain: &Domain, segments: Segments) -> Fit {
        let shape = Shape::of(domain, segments);
        let Shape { layout, map, degree, scaling, .. } = shape;
        let head = shape.head();
        let reference = scaling.map(|scaling| domain.reference(scaling));
        let domain = reference.as_ref().unwrap_or(domain);
        let mut columns = vec![Vec::with_capacity(segments.count()); head + degree + 1];
        let (mut error, mut worst, mut blurred_excess) = (0.0, domain.low, 1.0f64);
        for index in 0..segments.count() {
            let (centre, half) = place(segments, layout, index);
            let piece = Piece::of(domain, map, (centre, half), degree);
            let (largest, at) = piece.error();
            if largest.is_nan() || largest > error {
                (error, worst) = (if largest.is_nan() { f64::INFINITY } else { largest }, at);
            }
            blurred_excess = blurred_excess.max(piece.blurred_excess());
            let head = [-centre / half, 1.0 / half].into_iter().take(head);
            let coefficients = piece.polynomial().iter().enumerate().rev();
            let of_table = |(power, number): (usize, &f64)| scaling.map_or(*number, |of| of.entry(power, *number));
            let entries = head.chain(coefficients.map(of_table));
            columns.iter_mut().zip(entries).for_each(|(column, entry)| column.push(entry));
        }
        error += scaling.map_or(0.0, |scaling| scaling.apart);
        Fit { shape, columns, error, blurred_excess, worst }
    }
}

/// Centre of a segment, and half of its width.
fn place(segments: Segments, layout: Layout, index: usize) -> (f64, f64) {
    let (start, end) = segments.range(index, layout == Layout::Octaves);
    (0.5 * (start + end), 0.5 * (end - start))
}

/// Coefficients of a polynomial, lowest first.
type Coefficients = [f64; HIGHEST_DEGREE + 1];

/// The polynomial of a segment in its local coordinate.
struct Piece<'a> {
    domain: &'a Domain<'a>,
    map: Map,
    /// Centre of the segment, and half of its width.
    place: (f64, f64),
    degree: usize,
    coefficients: Coefficients,
    /// The part of the segment that the domain covers; none if it covers nothing.
    covered: Option<(f64, f64)>,
}

impl<'a> Piece<'a> {
    /// The polynomial around `centre`, `half` the segment to either side.
    fn of(domain: &'a Domain, map: Map, (centre, half): (f64, f64), degree: usize) -> Piece<'a> {
        let mut piece =
            Piece { domain, map, place: (centre, half), degree, coefficients: Coefficients::default(), covered: None };
        // The part of the segment that the domain covers.
        let covered = [domain.low, domain.high].map(|x| (x - map.argument(centre)) * map.slope / half);
        let (from, to) = (covered[0].min(covered[1]).max(-1.0), covered[0].max(covered[1]).min(1.0));
        if from >= to {
            // No argument falls here; the value at the nearest end keeps the range of the column small.
            piece.coefficients[0] = domain.function.evaluate(piece.nearest());
            return piece;
        }
        let (middle, width) = (0.5 * (from + to), 0.5 * (to - from));
        piece.covered = Some((from, to));
        let value = |u: f64| domain.function.evaluate(piece.argument(u));
        let interpolated = interpolate(degree, |t| value(middle + width * t));
        let mut coefficients = moved(degree, interpolated, middle, width);
        if domain.is_part {
            // What a part is at its ends stays when the argument is beyond them.
            let is = |u: f64| polynomial(&coefficients[..=degree], u);
            let ends = [(covered[0].min(covered[1]), from), (covered[0].max(covered[1]), to)];
            let missing = ends.map(|(end, u)| if end == u { value(u) - is(u) } else { 0.0 });
            if missing.iter().all(|missing| missing.is_finite()) {
                let slope = if degree == 0 { 0.0 } else { (missing[1] - missing[0]) / (to - from) };
                coefficients[0] += if missing[0] == 0.0 { missing[1] - slope * to } else { missing[0] - slope * from };
                if degree > 0 {
                    coefficients[1] += slope;
                }
            }
        }
        piece.coefficients = coefficients;
        piece
    }

    fn argument(&self, u: f64) -> f64 {
        let (centre, half) = self.place;
        self.map.argument(centre + half * u)
    }

    /// The argument of the domain that is nearest to the segment.
    fn nearest(&self) -> f64 {
        self.argument(0.0).clamp(self.domain.low, self.domain.high)
    }

    /// Its coefficients, lowest first.
    fn polynomial(&self) -> &[f64] {
        &self.coefficients[..=self.degree]
    }

    /// Arguments with the difference to the function there; none where the domain covers nothing.
    fn differences(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let (domain, map, (centre, half)) = (self.domain, self.map, self.place);
        self.covered.into_iter().flat_map(move |(from, to)| {
            let (middle, width) = (0.5 * (from + to), 0.5 * (to - from));
            // Just inside, where a jump at the end of the segment is not seen.
            let even = |check: usize| (2.0 * check as f64 / (CHECKS - 1) as f64 - 1.0) * (1.0 - 1e-12);
            let peaks = domain.features_between(self.argument(from), self.argument(to)).iter();
            let peaks = peaks.map(move |x| (((map.slope * x + map.offset) - centre) / half - middle) / width);
            (0..CHECKS).map(even).chain(peaks).map(move |t| {
                let u = middle + width * t;
                let x = self.argument(u);
                (x, (polynomial(self.polynomial(), u) - domain.function.evaluate(x)).abs())
            })
        })
    }

    /// Whether no difference to the function is larger than tolerated.
    fn holds(&self) -> bool {
        let tolerance = self.domain.tolerance;
        self.differences().all(|(_, difference)| difference <= tolerance || difference / tolerance <= 1.0)
    }

    /// The largest difference to the function, or what is no number, and where it is.
    fn error(&self) -> (f64, f64) {
        let worst = self.covered.map_or_else(|| self.nearest(), |(from, to)| self.argument(0.5 * (from + to)));
        self.differences().fold((0.0, worst), |worst, (x, difference)| {
            if difference.is_nan() || difference > worst.0 { (difference, x) } else { worst }
        })
    }

    /// The largest difference in what is tolerated there.
    fn blurred_excess(&self) -> f64 {
        let tolerance = self.domain.tolerance;
        let missed = self.differences().filter(|(_, difference)| difference.is_nan() || *difference > tolerance);
        let excess = missed.map(|(x, difference)| difference / self.domain.tolerance_at(x));
        excess.fold(0.0, |most: f64, excess| if excess.is_nan() { f64::INFINITY } else { most.max(excess) })
    }
}

/// Whether the polynomials of highest degree hold a function in all segments of a layout, but for so many times of what
/// their arguments excuse.
pub(super) fn holds(domain: &Domain, segments: Segments, excess: f64) -> bool {
    let all = |layout: Layout, map: Map| {
        let piece = |index: usize| Piece::of(domain, map, place(segments, layout, index), HIGHEST_DEGREE);
        (0..segments.count()).all(|index| piece(index).blurred_excess() <= excess)
    };
    match segments.octave_bits {
        0 => all(Layout::Uniform, domain.uniform(false)),
        _ => domain.octaves(false).is_some_and(|map| all(Layout::Octaves, map)),
    }
}

/// Whether one polynomial does from one argument to another.
pub(super) fn piece_holds(domain: &Domain, low: f64, high: f64, excess: f64) -> bool {
    let (map, place) = (Map { slope: 1.0, offset: 0.0 }, (0.5 * (low + high), 0.5 * (high - low)));
    Piece::of(domain, map, place, HIGHEST_DEGREE).blurred_excess() <= excess
}

/// The number that a polynomial has, its coefficients lowest first.
fn polynomial(coefficients: &[f64], u: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * u + coefficient)
}

/// Chebyshev nodes of -1 .. 1, and by order the Chebyshev polynomials there.
struct Nodes {
    nodes: Coefficients,
    values: [Coefficients; HIGHEST_DEGREE + 1],
}

/// Those of each degree.
static NODES: LazyLock<[Nodes; HIGHEST_DEGREE + 1]> = LazyLock::new(|| {
    std::array::from_fn(|degree| {
        let angle = |node: usize| core::f64::consts::PI * (node as f64 + 0.5) / (degree + 1) as f64;
        let nodes = std::array::from_fn(|node| libm::cos(angle(node)));
        let of = |order: usize| std::array::from_fn(|node| libm::cos(order as f64 * angle(node)));
        Nodes { nodes, values: std::array::from_fn(of) }
    })
});

/// The coefficients of the polynomial of a degree that agrees with a function at the Chebyshev nodes of -1 .. 1.
fn interpolate(degree: usize, function: impl Fn(f64) -> f64) -> Coefficients {
    let count = degree + 1;
    let Nodes { nodes, values: chebyshev } = &NODES[degree];
    let mut values = Coefficients::default();
    values.iter_mut().zip(&nodes[..count]).for_each(|(value, node)| *value = function(*node));
    // Coefficients of Chebyshev polynomials, then of powers: T(k + 1) = 2 x T(k) - T(k - 1).
    let mut powers = Coefficients::default();
    let (mut before, mut current) = (Coefficients::default(), Coefficients::default());
    current[0] = 1.0;
    for (order, chebyshev) in chebyshev[..count].iter().enumerate() {
        let products = values[..count].iter().zip(chebyshev).map(|(value, cosine)| value * cosine);
        let weight = if order == 0 { 1.0 } else { 2.0 } / count as f64 * products.sum::<f64>();
        for (power, coefficient) in powers[..count].iter_mut().zip(&current) {
            *power += weight * coefficient;
        }
        let twice = if order == 0 { 1.0 } else { 2.0 };
        let next = std::array::from_fn(|k| if k == 0 { 0.0 } else { twice * current[k - 1] } - before[k]);
        before = std::mem::replace(&mut current, next);
    }
    powers
}

/// The polynomial `p((u - middle)/width)` of a degree in powers of `u`.
fn moved(degree: usize, coefficients: Coefficients, middle: f64, width: f64) -> Coefficients {
    if middle == 0.0 && width == 1.0 {
        return coefficients;
    }
    let mut sum = Coefficients::default();
    for coefficient in coefficients[..=degree].iter().rev() {
        // sum := sum * (u - middle)/width + coefficient
        for power in (0..=degree).rev() {
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
        let moved = moved(3, [1.0, -2.0, 0.0, 0.5, 0.0, 0.0, 0.0], 0.3, 0.25);
        for u in [0.1, 0.3, 0.5] {
            let is = moved.iter().rev().fold(0.0, |sum, coefficient| sum * u + coefficient);
            assert!((is - cubic((u - 0.3) / 0.25)).abs() < 1e-12);
        }
    }
}
