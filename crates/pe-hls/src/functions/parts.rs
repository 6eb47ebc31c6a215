//! Functions that one table does not hold, as sums of parts that each have a table of their own.
//!
//! A range of arguments is cut where one table ends to hold the function; between two cuts the argument is clamped, so
//! that outside of its part each term stays what it is at the end: `f(x) = f(min(x, c)) + f(max(x, c)) - f(c)`. Parts
//! in which the function does not move are left out. A table counts as holding a function as far as the data port tells
//! arguments apart; see `docs/decisions/0044-reasons.md`.

use pe_ir::functions::ScalarFunction;
use pe_ir::model::{Expr, Select};
use pe_ir::word::WordFormat;

use super::divisions::divisions;
use super::domain::Domain;
use super::fit;
use crate::kinks::{edges, kinks};

/// Excess over what an argument excuses from which on a function is cut, and that parts shall have.
pub(super) const COARSE: f64 = 16.0;
const FINE: f64 = 0.5;

/// Cuts, at most.
const MOST_CUTS: usize = 7;

/// Cells that the mesh of cuts begins with, halvings of each, and cells of the mesh at most.
const CELLS: usize = 16;
const HALVINGS: u32 = 40;
const MOST_CELLS: usize = 3000;

/// Points at which a part is looked at for whether the function moves.
const LOOKS: usize = 64;

/// A part of a function.
pub(super) struct Part {
    /// What makes its argument of that of the whole, one after the other.
    pub clamps: Vec<Domain<'static>>,
    /// The function of that argument.
    pub domain: Domain<'static>,
    /// The argument of the whole from which on that argument is counted.
    pub origin: f64,
}

/// The parts of a function, whose sum it is; none if so few cuts do not help.
pub(super) fn parts(domain: &Domain, format: WordFormat) -> Option<Vec<Part>> {
    let cuts = cuts(domain, format)?;
    let ends: Vec<f64> = [domain.low].into_iter().chain(cuts).chain([domain.high]).collect();
    let mut parts = Vec::new();
    // What the function is before its first part.
    let mut before = 0.0;
    for (number, range) in ends.windows(2).enumerate() {
        let (first, last) = (number == 0, number + 3 > ends.len());
        if is_flat(domain, range[0], range[1]) {
            before += if first { domain.function.evaluate(range[0]) } else { 0.0 };
            continue;
        }
        parts.push(part(domain, (range[0], range[1]), (first, last), format, before));
        before = 0.0;
    }
    (!parts.is_empty()).then_some(parts)
}

/// The part of a function over a range, which is the first or the last one, and a constant.
fn part(domain: &Domain, range: (f64, f64), (first, last): (bool, bool), format: WordFormat, constant: f64) -> Part {
    let ((low, high), variable) = (range, domain.function.variable);
    // The argument of a part is counted from its lower end, that of the first from its upper one.
    let origin = if first { high } else { low };
    let x = || Expr::Variable(variable);
    let width = |reach: f64| libm::scalbn(reach, -(format.data_bits as i32));
    // `place` is where the argument ends to move, on one side or the other.
    let clamp = |place: f64, below: Expr, above: Expr| {
        Expr::Select(Box::new(Select {
            condition: Expr::sum(vec![x(), Expr::Constant(-place)]),
            yes: above,
            no: below,
        }))
    };
    let distance = |place: f64| Expr::sum(vec![x(), Expr::Constant(-place)]);
    let named = |body: Expr, what: String| {
        let name = format!("{} [{what}]", domain.function.name);
        ScalarFunction { name, body, variable }
    };
    let mut clamps = Vec::new();
    if first {
        let body = clamp(high, distance(high), Expr::Constant(0.0));
        let reach = high - domain.low;
        clamps.push(domain.part(named(body, format!("up to {high:.6e}")), domain.low, domain.high, width(reach)));
    } else {
        let body = clamp(low, Expr::Constant(0.0), distance(low));
        let reach = domain.high - low;
        clamps.push(domain.part(named(body, format!("from {low:.6e}")), domain.low, domain.high, width(reach)));
        if !last {
            let body = clamp(high - low, x(), Expr::Constant(high - low));
            let what = format!("from {low:.6e} up to {high:.6e}");
            clamps.push(domain.part(named(body, what), 0.0, reach, width(high - low)));
        }
    }
    let moved = domain.function.body.substituted(&|_| Expr::sum(vec![x(), Expr::Constant(origin)]));
    let offset = if first { 0.0 } else { domain.function.evaluate(origin) };
    let body = Expr::sum(vec![moved, Expr::Constant(constant - offset)]);
    let function = named(body, format!("{low:.6e} .. {high:.6e}"));
    let domain = domain.part(function, low - origin, high - origin, domain.tolerance);
    Part { clamps, domain, origin }
}

/// Where a function is cut so that a table holds each part; none if that takes too many cuts.
fn cuts(domain: &Domain, format: WordFormat) -> Option<Vec<f64>> {
    let candidates = mesh(domain)?;
    let holds = |from: f64, to: f64| {
        let view = domain.between(from, to);
        divisions(format).rev().any(|segments| fit::holds(&view, segments, FINE)) || is_flat(domain, from, to)
    };
    let (mut cuts, mut start, mut next) = (Vec::new(), domain.low, 0);
    while !holds(start, domain.high) {
        if cuts.len() == MOST_CUTS || next >= candidates.len() {
            return None;
        }
        // The farthest end for which one table is enough; the nearest if there is none.
        let rest = &candidates[next..];
        let end = rest.partition_point(|end| holds(start, *end)).max(1) - 1;
        start = rest[end];
        cuts.push(start);
        next += end + 1;
    }
    Some(cuts)
}

/// Places for cuts, close together where a function is steep: the ends of cells that a polynomial holds.
fn mesh(domain: &Domain) -> Option<Vec<f64>> {
    let (low, high) = (domain.low, domain.high);
    let inside = |x: &f64| *x > low && *x < high;
    let mut ends: Vec<f64> = (0..=CELLS).map(|cell| low + (high - low) * (cell as f64 / CELLS as f64)).collect();
    let kinks = kinks(&domain.function.body, low, high);
    let jumps: Vec<f64> = kinks.iter().copied().filter(|kink| jumps(domain, *kink)).collect();
    ends.extend(kinks.into_iter().chain(edges(&domain.function.body)).filter(inside));
    ends.sort_unstable_by(f64::total_cmp);
    ends.dedup();
    let mut places = ends.clone();
    let mut open: Vec<(f64, f64)> = ends.windows(2).map(|ends| (ends[0], ends[1])).collect();
    for _ in 0..HALVINGS {
        open.retain(|(low, high)| high - low > 2.0 * domain.blur && !fit::piece_holds(domain, *low, *high, FINE));
        places.extend(open.iter().map(|(low, high)| 0.5 * (low + high)));
        open = open.iter().flat_map(|(low, high)| [(*low, 0.5 * (low + high)), (0.5 * (low + high), *high)]).collect();
        if places.len() > MOST_CELLS {
            return None;
        }
    }
    places.retain(|place| inside(place) && !jumps.contains(place));
    places.sort_unstable_by(f64::total_cmp);
    places.dedup();
    Some(places)
}

/// Whether a function jumps at a kink: the difference of both sides does not fall with their distance.
fn jumps(domain: &Domain, kink: f64) -> bool {
    let sides = |distance: f64| {
        let at = |x: f64| domain.function.evaluate(x.clamp(domain.low, domain.high));
        (at(kink + distance) - at(kink - distance)).abs()
    };
    let wide = 1e-6 * (domain.high - domain.low);
    let (far, near) = (sides(wide), sides(wide / 1024.0));
    near > domain.tolerance && near > 0.9 * far
}

/// Whether a function stays what it is at the beginning of a range.
fn is_flat(domain: &Domain, low: f64, high: f64) -> bool {
    let first = domain.function.evaluate(low);
    let even = (1..=LOOKS).map(|look| low + (high - low) * (look as f64 / LOOKS as f64));
    let peaks = domain.features_between(low, high).iter().copied();
    even.chain(peaks).all(|x| (domain.function.evaluate(x) - first).abs() <= domain.tolerance)
}
