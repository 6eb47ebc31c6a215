//! Points that no other point beats.

use super::row::Row;
use crate::report::Figures;

/// Two figures of a point, both the better the smaller.
pub type Pair = fn(&Figures) -> Option<(f64, f64)>;

/// Run time and error.
pub fn time_and_error(figures: &Figures) -> Option<(f64, f64)> {
    Some((figures.time_ms(), figures.total_error()?))
}

/// Size and run time.
pub fn size_and_time(figures: &Figures) -> Option<(f64, f64)> {
    Some((figures.equivalent_lut(), figures.time_ms()))
}

/// Those of the `eligible` rows that no other of them beats in one figure without losing in the other, from small to
/// large in the first figure. Of rows that are equal in both the first one counts.
pub fn front(rows: &[Row], eligible: &[usize], pair: Pair) -> Vec<usize> {
    let mut points: Vec<(f64, f64, usize)> = eligible
        .iter()
        .filter_map(|index| pair(rows[*index].figures()?).map(|(first, second)| (first, second, *index)))
        .filter(|(first, second, _)| first.is_finite() && second.is_finite())
        .collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut least = f64::INFINITY;
    points.retain(|(_, second, _)| {
        let better = *second < least;
        least = least.min(*second);
        better
    });
    points.into_iter().map(|(_, _, index)| index).collect()
}

/// The knee of a front: the point farthest from the line between its ends, on logarithmic axes of equal length, and
/// on the better side of it. A front that bends nowhere has none.
pub fn knee(rows: &[Row], front: &[usize], pair: Pair) -> Option<usize> {
    // Zero has no logarithm; the smallest positive number stands for it.
    let log = |number: f64| libm::log(number.max(f64::MIN_POSITIVE));
    let place = |index: &usize| pair(rows[*index].figures()?).map(|(first, second)| (log(first), log(second)));
    let places: Vec<(f64, f64)> = front.iter().filter_map(place).collect();
    let ((x0, y0), (x1, y1)) = (*places.first()?, *places.last()?);
    let gain = |(x, y): &(f64, f64)| 1.0 - (x - x0) / (x1 - x0) - (y - y1) / (y0 - y1);
    let best = front.iter().zip(&places).map(|(index, at)| (*index, gain(at)));
    let best = best.fold((0, 1e-9), |best, next| if next.1 > best.1 { next } else { best });
    (best.1 > 1e-9).then_some(best.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows with these run times and total errors.
    fn rows(figures: &[(f64, Option<f64>)]) -> Vec<Row> {
        let row = |(time, total): &(f64, Option<f64>)| Row::compiled(0.0, *time, *total);
        figures.iter().map(row).collect()
    }

    #[test]
    fn a_front_leaves_out_what_another_point_beats_and_what_has_no_error() {
        let rows = rows(&[
            (4.0, Some(1e-6)),
            (1.0, Some(1e-2)),
            (2.0, Some(1e-2)), // as wrong as the second, and slower
            (2.0, Some(1e-3)),
            (0.5, None),
            (2.0, Some(1e-3)), // equal to the fourth
            (8.0, Some(1e-5)), // beaten in both by the first
        ]);
        assert_eq!(front(&rows, &[0, 1, 2, 3, 4, 5, 6], time_and_error), [1, 3, 0]);
        assert_eq!(front(&rows, &[0, 2, 6], time_and_error), [2, 0]);
    }

    #[test]
    fn the_knee_is_where_the_front_bends_most_and_a_straight_front_has_none() {
        let bent = rows(&[(1.0, Some(1e-1)), (2.0, Some(1e-6)), (4.0, Some(5e-7)), (100.0, Some(1e-7))]);
        assert_eq!(knee(&bent, &front(&bent, &[0, 1, 2, 3], time_and_error), time_and_error), Some(1));
        let straight = rows(&[(1.0, Some(1e-1)), (10.0, Some(1e-2)), (100.0, Some(1e-3))]);
        assert_eq!(knee(&straight, &front(&straight, &[0, 1, 2], time_and_error), time_and_error), None);
        assert_eq!(knee(&straight[..1], &[0], time_and_error), None);
        assert_eq!(knee(&straight, &[], time_and_error), None);
    }
}
