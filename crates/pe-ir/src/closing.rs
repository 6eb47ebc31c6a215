//! Positions that close what is open: the least squares of openings, from several places.

use crate::cholesky;

/// Corrections of a position, and what the weight of staying where it is begins with, in parts of the squared openings.
const CORRECTIONS: usize = 100;
const STAY: f64 = 0.1;

/// Openings that are none, in parts of what all coordinates together move them by.
const CLOSED: f64 = 1e-6;

/// Positions that are tried beside the given ones, and how far away they are, in turn.
const POSITIONS: usize = 36;
const FAR: [f64; 3] = [0.05, 0.3, 1.0];

/// What is open at a position.
#[derive(Clone, Debug)]
pub struct Openings {
    /// Derivatives of the openings (rows) by coordinates, which count their own sizes.
    pub levers: Vec<f64>,
    /// The openings.
    pub gaps: Vec<f64>,
}

/// A position at which all is closed, from one of several or others about the first; else what stays open where that is least.
/// Coordinates count their own sizes.
///
/// # Errors
/// What stays open.
pub fn anywhere(starts: &[Vec<f64>], at: &dyn Fn(&[f64]) -> Openings) -> Result<Vec<f64>, Vec<f64>> {
    let mut least: Option<(f64, Vec<f64>)> = None;
    for position in 0..starts.len() + POSITIONS {
        let start = match starts.get(position) {
            Some(start) => start.clone(),
            None => {
                let by = |place: usize| libm::sin(1.0 + 2.4 * place as f64 + 1.9 * (position * (place + 1)) as f64);
                let far = FAR[position % FAR.len()];
                starts[0].iter().enumerate().map(|(place, own)| own + far * by(place)).collect()
            }
        };
        match closest(start, at) {
            Ok(closed) => return Ok(closed),
            Err((size, gaps)) => {
                if least.as_ref().is_none_or(|(least, _)| size < *least || least.is_nan()) {
                    least = Some((size, gaps));
                }
            }
        }
    }
    Err(least.map_or_else(Vec::new, |(_, gaps)| gaps))
}

/// Openings in parts of what all coordinates move each by: levers, gaps, and the sum of the squares.
fn scaled(size: usize, openings: &Openings) -> (Vec<f64>, Vec<f64>, f64) {
    let reach = |levers: &[f64]| levers.iter().map(|lever| lever.abs()).sum::<f64>();
    let all = openings.levers.chunks_exact(size).map(reach).fold(0.0, f64::max);
    let (mut levers, mut gaps) = (openings.levers.clone(), openings.gaps.clone());
    for (own, gap) in levers.chunks_exact_mut(size).zip(&mut gaps) {
        let whole = reach(own).max(1e-3 * all).max(f64::MIN_POSITIVE);
        own.iter_mut().for_each(|lever| *lever /= whole);
        *gap /= whole;
    }
    let squares = gaps.iter().map(|gap| gap * gap).sum();
    (levers, gaps, squares)
}

/// Where the squares of the openings are least near a position, if all is closed there; else how large they are, and the openings.
fn closest(mut position: Vec<f64>, at: &dyn Fn(&[f64]) -> Openings) -> Result<Vec<f64>, (f64, Vec<f64>)> {
    let size = position.len();
    let mut openings = at(&position);
    let (mut levers, mut gaps, mut squares) = scaled(size, &openings);
    let mut stay = STAY;
    for _ in 0..CORRECTIONS {
        if gaps.iter().all(|gap| gap.abs() <= CLOSED) {
            return Ok(position);
        }
        if !squares.is_finite() || stay > 1e15 {
            break;
        }
        let mut matrix = vec![0.0; size * size];
        let mut right = vec![0.0; size];
        for (own, gap) in levers.chunks_exact(size).zip(&gaps) {
            for (row, lever) in own.iter().enumerate() {
                right[row] += lever * gap;
                own.iter().enumerate().for_each(|(column, other)| matrix[row * size + column] += lever * other);
            }
        }
        (0..size).for_each(|place| matrix[place * size + place] += stay * squares);
        if cholesky::factor(&mut matrix, 0.0).is_err() {
            stay *= 8.0;
            continue;
        }
        cholesky::solve(&matrix, &mut right);
        let next: Vec<f64> = position.iter().zip(&right).map(|(own, by)| own - by).collect();
        let there = at(&next);
        let found = scaled(size, &there);
        if found.2 < squares {
            (position, openings, stay) = (next, there, stay / 4.0);
            (levers, gaps, squares) = found;
        } else {
            stay *= 8.0;
        }
    }
    if gaps.iter().all(|gap| gap.abs() <= CLOSED) { Ok(position) } else { Err((squares, openings.gaps)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Circles about points, as half the differences of squares.
    fn circles(all: &[(f64, f64, f64)]) -> impl Fn(&[f64]) -> Openings {
        move |at: &[f64]| {
            let (x, y) = (at[0], at[1]);
            let gap = |(a, b, r): &(f64, f64, f64)| ((x - a) * (x - a) + (y - b) * (y - b) - r * r) / 2.0;
            let levers = all.iter().flat_map(|(a, b, _)| [x - a, y - b]).collect();
            Openings { levers, gaps: all.iter().map(gap).collect() }
        }
    }

    #[test]
    fn circles_that_meet_are_closed_and_others_stay_open() {
        let meet = [(0.0, 0.0, 1.0), (1.2, 0.3, 0.8)];
        let found = anywhere(&[vec![5.0, -3.0]], &circles(&meet)).expect("they meet");
        assert!(circles(&meet)(&found).gaps.iter().all(|gap| gap.abs() < 1e-5), "{found:?}");
        for apart in [[(0.0, 0.0, 1.0), (3.0, 0.0, 1.5)], [(0.0, 0.0, 1.0), (0.0, 0.0, 1.1)]] {
            let open = anywhere(&[vec![0.9, 0.1]], &circles(&apart)).expect_err("they do not meet");
            assert!(open.iter().all(|gap| gap.abs() > 0.01), "{open:?}");
        }
        // The same twice.
        assert!(anywhere(&[vec![0.9, 0.1]], &circles(&[(0.0, 0.0, 1.0), (0.0, 0.0, 1.0)])).is_ok());
    }
}
