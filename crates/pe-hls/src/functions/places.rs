//! Places of a function that evenly spread samples miss: poles, and narrow peaks and steps.
//!
//! Bounds over cells of the range tell where samples do not tell the whole story; these cells are halved until they do.

use pe_ir::functions::ScalarFunction;

use super::enclosure::bounds;
use crate::kinks::{edges, kinks};

/// Cells that a search begins with, besides those that kinks and edges make.
const CELLS: usize = 64;

/// Halvings of a cell in search of a pole, and in search of what samples miss.
const POLE_HALVINGS: usize = 44;
const HALVINGS: usize = 16;

/// Evaluations of bounds that a search may take.
const EVALUATIONS: usize = 20_000;

/// Samples of a cell.
const SAMPLES: usize = 4;

/// Part of a function's largest magnitude by which bounds may go beyond samples.
const UNEXPLAINED: f64 = 1.0 / 64.0;

/// Part of it from which on what was found between samples counts, and by which the samples of a cell may differ.
const COUNTS: f64 = 1.0 / 50.0;
const STEEP: f64 = 1.0 / 8.0;

/// Halvings of a cell from which on steepness counts: samples of tables are closer together before.
const FINE: usize = 4;

/// Halvings of a distance from a pole between two looks; growth does not slow down from look to look by more
/// than this, and comes to this part of the value in two of them.
const LOOK: i32 = 8;
const STEADY: f64 = 0.95;
const GROWTH: f64 = 0.01;

/// Relative difference of values so far apart, in parts of their distance from a place, from which on they are rounding noise:
/// those of a pole of sixth order differ less. Closer ones may be rounded alike.
const NOISE: f64 = 1e-2;
const APART: f64 = 1.0 / 2048.0;

/// The ends of the first cells.
fn cells(function: &ScalarFunction, low: f64, high: f64) -> Vec<(f64, f64)> {
    let mut ends: Vec<f64> = (0..=CELLS).map(|cell| low + (high - low) * (cell as f64 / CELLS as f64)).collect();
    ends.extend(
        kinks(&function.body, low, high).into_iter().chain(edges(&function.body)).filter(|x| *x > low && *x < high),
    );
    ends.sort_unstable_by(f64::total_cmp);
    ends.dedup();
    ends.windows(2).map(|ends| (ends[0], ends[1])).collect()
}

/// Places between two arguments at which bounds of a function do not become finite however small a cell is.
pub(super) struct Singular {
    /// One where the function grows beyond all bounds. A function that is only very steep, or very large somewhere, has
    /// none.
    pub pole: Option<f64>,
    /// Those where it does not: `x/(exp(x) - 1)` has one at zero.
    pub removable: Vec<f64>,
}

/// Looks for singular places between two arguments.
pub(super) fn singular(function: &ScalarFunction, low: f64, high: f64) -> Singular {
    let mut open = cells(function, low, high);
    let mut evaluations = 0;
    for _ in 0..POLE_HALVINGS {
        evaluations += open.len();
        if evaluations > EVALUATIONS {
            break;
        }
        open.retain(|(low, high)| !bounds(function, *low, *high).is_bounded());
        open = open.into_iter().flat_map(|(low, high)| halves(low, high)).collect();
    }
    // Neighbouring cells that are left are one place.
    let size = |x: f64| Some(function.evaluate(x).abs()).filter(|size| size.is_finite()).unwrap_or(f64::INFINITY);
    let largest = |cells: &[(f64, f64)]| {
        let ends = cells.iter().flat_map(|cell| [cell.0, 0.5 * (cell.0 + cell.1), cell.1]);
        ends.max_by(|a, b| size(*a).total_cmp(&size(*b)))
    };
    // Where exactly the place is within its cells is not known.
    let widest = |cells: &[(f64, f64)]| cells.iter().map(|cell| cell.1 - cell.0).fold(0.0, f64::max);
    let places = open.chunk_by(|a, b| b.0 <= a.1).filter_map(|cells| Some((largest(cells)?, widest(cells))));
    let (poles, removable): (Vec<_>, Vec<_>) =
        places.partition(|(place, width)| grows(function, (low, high), *place, *width));
    Singular { pole: poles.first().map(|pole| pole.0), removable: removable.into_iter().map(|place| place.0).collect() }
}

/// The two halves of a cell; none if no number lies between its ends.
fn halves(low: f64, high: f64) -> Vec<(f64, f64)> {
    let middle = 0.5 * (low + high);
    if middle > low && middle < high { vec![(low, middle), (middle, high)] } else { vec![(low, high)] }
}

/// Whether a function keeps growing towards a place as far as it is more than rounding noise.
fn grows(function: &ScalarFunction, (low, high): (f64, f64), place: f64, width: f64) -> bool {
    let inside = |x: f64| (low..=high).contains(&x) && x != place;
    let at = |x: f64| if inside(x) { function.evaluate(x).abs() } else { 0.0 };
    let size = |distance: f64| at(place - distance).max(at(place + distance));
    let quiet = |distance: f64| {
        let around = (0..4).map(|step| size(distance * (1.0 + f64::from(step) * APART)));
        let (least, most) = around.fold((f64::INFINITY, 0.0f64), |(least, most), n| (least.min(n), most.max(n)));
        most.is_finite() && most - least <= NOISE * most
    };
    // Closer to a place than this its neighbours are the same number, or as far from the true place.
    let closest = (1024.0 * f64::EPSILON * place.abs()).max(16.0 * width);
    let looks = (0..).map(|look| libm::scalbn(0.25 * (high - low), -LOOK * look));
    let looks = looks.take(40).take_while(|distance| *distance > closest.max(f64::MIN_POSITIVE) && quiet(*distance));
    let sizes: Vec<f64> = looks.map(size).collect();
    match sizes.as_slice() {
        [.., far, nearer, near] => {
            let steady = near > nearer && nearer > far && near - nearer >= STEADY * (nearer - far);
            steady && near - far > GROWTH * near
        }
        _ => false,
    }
}

/// Arguments around narrow peaks and steps, which samples so far apart as `(high - low)/256` do not show; ascending.
pub(super) fn features(function: &ScalarFunction, low: f64, high: f64) -> Vec<f64> {
    let mut largest: f64 = 0.0;
    let mut open: Vec<(f64, f64, f64, f64)> = Vec::new();
    let sampled = |low: f64, high: f64, largest: &mut f64| {
        let values = (0..=SAMPLES).map(|k| function.evaluate(low + (high - low) * (k as f64 / SAMPLES as f64)));
        let values = values.filter(|value| value.is_finite());
        let range = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), n| (least.min(n), most.max(n)));
        *largest = largest.max(range.0.abs()).max(range.1.abs());
        range
    };
    for (low, high) in cells(function, low, high) {
        let (least, most) = sampled(low, high, &mut largest);
        open.push((low, high, least, most));
    }
    let (mut found, mut evaluations) = (Vec::new(), 0);
    for halving in 1..=HALVINGS {
        evaluations += open.len();
        if evaluations > EVALUATIONS {
            break;
        }
        open.retain(|(low, high, least, most)| {
            let (bounds, room) = (bounds(function, *low, *high), UNEXPLAINED * largest);
            bounds.low < least - room || bounds.high > most + room || most - least > STEEP * largest
        });
        let mut next = Vec::with_capacity(2 * open.len());
        for (low, high, least, most) in open {
            for (low, high) in halves(low, high) {
                let (own_least, own_most) = sampled(low, high, &mut largest);
                let steep = if halving < FINE { 0.0 } else { own_most - own_least };
                found.push((low, high, (least - own_least).max(own_most - most).max(steep)));
                next.push((low, high, own_least, own_most));
            }
        }
        open = next;
    }
    found.retain(|(.., beyond)| *beyond > COUNTS * largest);
    let inside = |(low, high, _): &(f64, f64, f64)| {
        let (low, high) = (*low, *high);
        (0..=SAMPLES).map(move |k| low + (high - low) * (k as f64 / SAMPLES as f64))
    };
    let mut places: Vec<f64> = found.iter().flat_map(inside).collect();
    // At a kink itself the function may belong to the other side.
    let kinks = kinks(&function.body, low, high);
    places.retain(|place| !kinks.contains(place));
    places.sort_unstable_by(f64::total_cmp);
    places.dedup();
    places
}
