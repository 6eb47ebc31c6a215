//! How long the connections of a network are when its PEs stand on a square grid.
//!
//! The PEs are placed on the smallest square that holds them, row by row as far as they reach: halved again and again
//! along the connections, as the square is, and then exchanged with one another while that shortens the sum. The
//! length of a connection is the number of grid steps between its ends, which is 1 for neighbours.

use pe_ir::index;
use pe_ir::mapping::Mapping;

use super::orders::Region;
use super::problem::Problem;

/// Sum and largest of the lengths of all connections, in grid steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WireLength {
    /// Sum over all connections.
    pub total: u64,
    /// The longest connection.
    pub longest: u32,
}

/// Rounds of exchanges; each looks at every PE once.
const ROUNDS: usize = 64;

/// The lengths of the connections of a mapping.
pub fn wire_length(problem: &Problem, mapping: &Mapping) -> WireLength {
    let pes = index::at(mapping.pes);
    let sources = problem.sources(mapping);
    let arcs: Vec<(u32, u32)> =
        sources.into_iter().filter_map(|(pe, source)| Some((pe.number(), source.pe()?.number()))).collect();
    let network = Problem::new(vec![1; pes], &arcs, &[]);
    let mut grid = Grid::halved(&network);
    for _ in 0..ROUNDS {
        if !grid.exchange(&network) {
            break;
        }
    }
    let mut wires = WireLength::default();
    for pe in 0..pes {
        for other in network.adjacent(pe).filter(|other| *other < pe) {
            let length = distance(grid.places[pe], grid.places[other]);
            wires.total += u64::from(length);
            wires.longest = wires.longest.max(length);
        }
    }
    wires
}

fn distance(a: (u32, u32), b: (u32, u32)) -> u32 {
    a.0.abs_diff(b.0) + a.1.abs_diff(b.1)
}

/// PEs on places of a square.
struct Grid {
    side: u32,
    /// Column and row of each PE.
    places: Vec<(u32, u32)>,
    /// PE at each place, row by row; the last ones may be empty.
    at: Vec<u32>,
}

impl Grid {
    /// Halves the PEs in layers from an end, and the places along their longer side, until each PE has a place.
    fn halved(network: &Problem) -> Grid {
        let pes = network.equations();
        let side = (1..).find(|side| side * side >= pes).unwrap_or(1);
        let mut grid = Grid { side, places: vec![(0, 0); index::at(pes)], at: vec![0; index::at(pes)] };
        let places: Vec<(u32, u32)> = (0..pes).map(|place| (place % side, place / side)).collect();
        let mut region = Region::new(network);
        let mut parts = vec![((0..pes).collect::<Vec<u32>>(), places)];
        while let Some((part, mut places)) = parts.pop() {
            if let [pe] = part[..] {
                grid.put(pe, places[0]);
                continue;
            }
            region.enter(&part);
            let mut layered = region.layers_of_all(&part);
            region.leave(&part);
            let extent = |of: fn(&(u32, u32)) -> u32| {
                places.iter().map(of).max().unwrap_or(0) - places.iter().map(of).min().unwrap_or(0)
            };
            if extent(|place| place.0) >= extent(|place| place.1) {
                places.sort_unstable();
            } else {
                places.sort_unstable_by_key(|&(column, row)| (row, column));
            }
            let half = part.len() / 2;
            parts.push((layered.split_off(half), places.split_off(half)));
            parts.push((layered, places));
        }
        grid
    }

    fn put(&mut self, pe: u32, place: (u32, u32)) {
        self.places[index::at(pe)] = place;
        self.at[index::at(place.1 * self.side + place.0)] = pe;
    }

    /// Sum of the lengths of a PE's connections.
    fn length(&self, network: &Problem, pe: u32) -> i64 {
        let own = self.places[index::at(pe)];
        network.adjacent(index::at(pe)).map(|other| i64::from(distance(own, self.places[other]))).sum()
    }

    /// Exchanges each PE with those around it and around the middle of what it is connected to, if that shortens
    /// connections; whether one did.
    fn exchange(&mut self, network: &Problem) -> bool {
        let mut changed = false;
        for pe in 0..network.equations() {
            let mut columns: Vec<u32> = network.adjacent(index::at(pe)).map(|other| self.places[other].0).collect();
            let mut rows: Vec<u32> = network.adjacent(index::at(pe)).map(|other| self.places[other].1).collect();
            if columns.is_empty() {
                continue;
            }
            columns.sort_unstable();
            rows.sort_unstable();
            let middle = (columns[columns.len() / 2], rows[rows.len() / 2]);
            for (right, down) in [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)] {
                for (column, row) in [middle, self.places[index::at(pe)]] {
                    let place = (column.wrapping_add_signed(right), row.wrapping_add_signed(down));
                    changed |= self.try_exchange(network, pe, place);
                }
            }
        }
        changed
    }

    fn try_exchange(&mut self, network: &Problem, pe: u32, place: (u32, u32)) -> bool {
        let index = u64::from(place.1) * u64::from(self.side) + u64::from(place.0);
        let Some(&other) = self.at.get(index as usize) else { return false };
        if place.0 >= self.side || other == pe {
            return false;
        }
        let own = self.places[index::at(pe)];
        let before = self.length(network, pe) + self.length(network, other);
        self.put(pe, place);
        self.put(other, own);
        if self.length(network, pe) + self.length(network, other) < before {
            return true;
        }
        self.put(pe, own);
        self.put(other, place);
        false
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::index::PeId;

    use super::*;

    fn lengths(pes: u32, pairs: &[(u32, u32)]) -> WireLength {
        let problem = Problem::new(vec![1; pes as usize], pairs, &[]);
        wire_length(&problem, &Mapping { pes, pe_of: PeId::all(pes).collect() })
    }

    #[test]
    fn few_pes_stand_side_by_side() {
        assert_eq!(lengths(1, &[]), WireLength::default());
        assert_eq!(lengths(2, &[(0, 1), (1, 0)]), WireLength { total: 1, longest: 1 });
        assert_eq!(lengths(4, &[(0, 1), (1, 2), (2, 3), (3, 0)]), WireLength { total: 4, longest: 1 });
    }

    #[test]
    fn chains_and_grids_get_short_wires() {
        let chain: Vec<_> = (1..64).map(|pe| (pe * 11 % 64, (pe - 1) * 11 % 64)).collect();
        let wires = lengths(64, &chain);
        assert!(wires.total <= 2 * 63 && wires.total >= 63, "{wires:?}");
        let right = (0..100).filter(|cell| cell % 10 < 9).map(|cell| (cell * 37 % 100, (cell + 1) * 37 % 100));
        let down = (0..90).map(|cell| (cell * 37 % 100, (cell + 10) * 37 % 100));
        let wires = lengths(100, &right.chain(down).collect::<Vec<_>>());
        // The best placement has 180; ours is an estimate of the kind that a quick placer makes.
        assert!(wires.total <= 2 * 180 + 18, "{wires:?}");
    }

    #[test]
    fn a_star_reaches_every_place() {
        let star: Vec<_> = (1..25).map(|pe| (0, pe)).collect();
        let wires = lengths(25, &star);
        // From the middle of five times five: distances 1 to 4.
        assert_eq!(wires, WireLength { total: 60, longest: 4 });
    }
}
