//! Starts for grids: slabs, pencils and tiles, along coordinates that are found from the dependency graph.
//!
//! In a box of cells that read their neighbours, a corner has fewer neighbours than any cell next to it. Two corners
//! `a` and `c` at the ends of an edge of the box give a coordinate of every cell,
//!
//! ```text
//! x = (d(a, cell) - d(c, cell) + d(a, c)) / 2
//! ```
//!
//! where `d` is the distance in the graph. Other graphs have too many corners, or too few, or give coordinates that
//! mean little; then the start is a bad one and loses.

use std::collections::VecDeque;
use std::ops::Range;

use pe_ir::index::{self, EquationId, List, PeId, number};
use pe_ir::mapping::Mapping;

use super::problem::Problem;

/// Corners of a rectangle, and more than a box or a few joined ones have.
const CORNERS: std::ops::RangeInclusive<usize> = 4..=16;
/// Most coordinates that tiles are cut along.
const DIMENSIONS: usize = 3;
/// Equations over which all cuts that are tried may go together.
const EFFORT: usize = 400_000;
/// Numbers of slabs, and of PEs per pencil in a slab, that are tried as far as the effort allows.
const SLABS: [usize; 12] = [5, 1, 14, 7, 3, 10, 2, 20, 4, 28, 6, 40];
const PER_PENCIL: [usize; 6] = [10, 2, 1, 5, 3, 7];

const UNSEEN: u32 = u32::MAX;

/// The best of some ways to cut a box into slabs, these into pencils, and these into tiles; none without coordinates.
pub(super) fn tiles(problem: &Problem, pes: u32) -> Option<Mapping> {
    let axes = coordinates(problem)?;
    let count = index::at(problem.equations());
    let pes = index::at(pes);
    // In two dimensions a slab is a pencil.
    let per_pencil = if axes.len() > 2 { &PER_PENCIL[..] } else { &PER_PENCIL[..1] };
    let shapes = per_pencil.iter().flat_map(|&pencil| SLABS.iter().map(move |&slabs| (slabs, pencil)));
    let shapes = shapes.filter(|&(slabs, _)| slabs <= pes).take((EFFORT / count).max(1));
    let mappings = shapes.map(|(slabs, pencil)| cut_box(problem, &axes, pes, slabs, pencil));
    mappings.min_by_key(|mapping| {
        let cost = problem.cost(mapping);
        u64::from(cost.max_load) * u64::from(cost.connections)
    })
}

/// Two or three coordinates of every equation.
pub(super) fn coordinates(problem: &Problem) -> Option<Vec<Vec<u32>>> {
    let count = index::at(problem.equations());
    let degrees: Vec<usize> = (0..count).map(|equation| problem.adjacent(equation).count()).collect();
    let is_corner = |&equation: &usize| problem.adjacent(equation).all(|next| degrees[equation] < degrees[next]);
    let corners: Vec<usize> = (0..count).filter(is_corner).take(CORNERS.end() + 1).collect();
    if !CORNERS.contains(&corners.len()) {
        return None;
    }
    let origin = corners[0];
    let from_origin = distances(problem, origin);
    if from_origin.contains(&UNSEEN) {
        return None;
    }
    let mut ends = corners[1..].to_vec();
    ends.sort_by_key(|&end| (from_origin[end], end));
    let mut axes: Vec<(usize, Vec<u32>)> = Vec::new();
    for end in ends {
        // A corner behind another one is no end of an edge.
        let behind = axes.iter().any(|(axis, from)| from_origin[*axis] + from[end] == from_origin[end]);
        if !behind && axes.len() < DIMENSIONS {
            axes.push((end, distances(problem, end)));
        }
    }
    let coordinate = |(end, from): (usize, Vec<u32>)| {
        let length = from_origin[end];
        from.iter().zip(&from_origin).map(|(end, origin)| (origin + length - end.min(&(origin + length))) / 2).collect()
    };
    (axes.len() > 1).then(|| axes.into_iter().map(coordinate).collect())
}

/// Distances from an equation.
fn distances(problem: &Problem, from: usize) -> Vec<u32> {
    let mut distances = vec![UNSEEN; index::at(problem.equations())];
    distances[from] = 0;
    let mut queue = VecDeque::from([from]);
    while let Some(equation) = queue.pop_front() {
        for next in problem.adjacent(equation) {
            if distances[next] == UNSEEN {
                distances[next] = distances[equation] + 1;
                queue.push_back(next);
            }
        }
    }
    distances
}

/// Cuts a box into slabs, each into pencils with about so many PEs, and these into tiles.
fn cut_box(problem: &Problem, axes: &[Vec<u32>], pes: usize, slabs: usize, per_pencil: usize) -> Mapping {
    let mut pe_of = List::filled(PeId::new(0), index::at(problem.equations()));
    let mut all: Vec<u32> = (0..problem.equations()).collect();
    let at = |axis: usize, equation: &u32| axes[axis][index::at(*equation)];
    let (second, last) = (1, axes.len() - 1);
    all.sort_by_key(|equation| (at(0, equation), at(second, equation), at(last, equation)));
    let mut rest = PeId::all(number(pes));
    let of_slabs = shares(pes, slabs);
    for (slab, pes) in cut(problem, &all, &of_slabs).into_iter().zip(of_slabs) {
        let slab = &mut all[slab];
        slab.sort_by_key(|equation| (at(second, equation), at(last, equation), at(0, equation)));
        let pencils = if last == second { 1 } else { ((pes + per_pencil / 2) / per_pencil).clamp(1, pes) };
        let of_pencils = shares(pes, pencils);
        for (pencil, pes) in cut(problem, slab, &of_pencils).into_iter().zip(of_pencils) {
            let pencil = &mut slab[pencil];
            pencil.sort_by_key(|equation| (at(last, equation), at(0, equation), at(second, equation)));
            for tile in cut(problem, pencil, &vec![1; pes]) {
                let pe = rest.next().expect("a tile for each PE");
                for equation in &pencil[tile] {
                    pe_of[EquationId::new(*equation)] = pe;
                }
            }
        }
    }
    Mapping { pes: number(pes), pe_of }
}

/// So many PEs in so many shares, as equal as they can be.
fn shares(pes: usize, count: usize) -> Vec<usize> {
    (0..count).map(|share| pes * (share + 1) / count - pes * share / count).collect()
}

/// Cuts a list into runs whose loads follow their numbers of PEs, each with an equation per PE at least.
fn cut(problem: &Problem, list: &[u32], pes: &[usize]) -> Vec<Range<usize>> {
    let load = |at: usize| u64::from(problem.loads()[index::at(list[at])]);
    let total: u64 = (0..list.len()).map(load).sum();
    let all: usize = pes.iter().sum();
    let (mut runs, mut at, mut done, mut before) = (Vec::with_capacity(pes.len()), 0, 0, 0);
    for &own in pes {
        let first = at;
        before += own;
        let goal = total * before as u64 / all as u64;
        let latest = list.len() - (all - before);
        while at < latest && (at < first + own || before == all || 2 * done + load(at) < 2 * goal) {
            done += load(at);
            at += 1;
        }
        runs.push(first..at);
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of cells that read their nearest neighbours, numbered in an order that says nothing.
    fn cells(sides: [u32; 3]) -> Problem {
        let count = sides[0] * sides[1] * sides[2];
        let name = |cell: u32| cell * 7919 % count;
        let mut arcs = Vec::new();
        for cell in 0..count {
            let mut stride = 1;
            for side in sides {
                if cell / stride % side + 1 < side {
                    arcs.extend([(name(cell), name(cell + stride)), (name(cell + stride), name(cell))]);
                }
                stride *= side;
            }
        }
        Problem::new(vec![4; count as usize], &arcs, &[])
    }

    #[test]
    fn coordinates_are_those_of_the_box() {
        for sides in [[5, 7, 9], [6, 6, 6], [12, 5, 1]] {
            let axes = coordinates(&cells(sides)).expect("a box");
            let mut lengths: Vec<u32> = axes.iter().map(|axis| axis.iter().max().expect("cells") + 1).collect();
            lengths.sort_unstable();
            let mut expected = sides.to_vec();
            expected.retain(|side| *side > 1);
            expected.sort_unstable();
            assert_eq!(lengths, expected);
            let mut places: Vec<Vec<u32>> =
                (0..axes[0].len()).map(|cell| axes.iter().map(|axis| axis[cell]).collect()).collect();
            places.sort_unstable();
            places.dedup();
            assert_eq!(places.len(), axes[0].len(), "two cells at one place");
        }
    }

    #[test]
    fn a_rectangle_becomes_strips_or_tiles_and_every_pe_is_used() {
        let problem = cells([40, 40, 1]);
        for pes in [10, 97, 400, 1599, 1600] {
            let mapping = tiles(&problem, pes).expect("a rectangle");
            assert!(PeId::all(pes).all(|pe| mapping.pe_of.contains(&pe)), "{pes}");
            let cost = problem.cost(&mapping);
            assert!(cost.connections <= 2 * pes, "{cost:?} on {pes}");
        }
    }

    #[test]
    fn trees_and_chains_have_no_coordinates() {
        let tree: Vec<_> = (1..200).map(|branch| ((branch - 1) / 2, branch)).collect();
        assert!(tiles(&Problem::new(vec![1; 200], &tree, &[]), 8).is_none());
        assert!(tiles(&cells([50, 1, 1]), 8).is_none());
        assert!(tiles(&Problem::new(vec![1; 3], &[], &[]), 2).is_none());
    }
}
