//! A start for grids whose operands pair: equal blocks on some of the PEs, and equations without pairs on all.
//!
//! A chain keeps its pairs if its PE computes half of its operands. In a box of cells that is so in blocks of two cells
//! along each axis, whose number is seldom that of the PEs. Equations whose place matters for no pair fill what is left.

use pe_ir::index::{EquationId, List, PeId, at, number};
use pe_ir::mapping::Mapping;

use super::problem::Problem;
use super::starts::cut_evenly;
use super::tiles::coordinates;

const NOWHERE: u32 = u32::MAX;

/// Equations that all shapes that are tried may have together.
const EFFORT: usize = 2_000_000;
/// Blocks may be larger than the mean load of a PE by a quarter.
const LARGER: f64 = 1.25;
/// Part of a load by which it rises while it is too small for all equations.
const FINENESS: u64 = 256;

/// The best of some ways to cut a grid into blocks; none without coordinates, or without pairs.
pub(super) fn blocks(problem: &Problem, pes: u32) -> Option<Mapping> {
    if !problem.has_pairs() {
        return None;
    }
    let placed = problem.alike().equations();
    let cells: Vec<usize> = (0..placed.len()).filter(|equation| placed[*equation]).collect();
    let axes = coordinates(&problem.part(&cells))?;
    let lengths: Vec<u32> = axes.iter().map(|axis| axis.iter().max().map_or(0, |most| most + 1)).collect();
    let mean = problem.total_load() as f64 / f64::from(pes);
    let load: u64 = cells.iter().map(|cell| u64::from(problem.loads()[*cell])).sum();
    let of_cell = load as f64 / cells.len() as f64;
    let mut shapes = shapes(&lengths, pes, (LARGER * mean / of_cell) as u32);
    shapes.truncate((EFFORT / placed.len()).max(1));
    let of_shape = |shape: Vec<u32>| {
        let mut pe_of: Vec<Option<u32>> = vec![None; placed.len()];
        for (index, cell) in cells.iter().enumerate() {
            let block = (0..axes.len()).fold(0, |block, axis| {
                let coordinate = u64::from(axes[axis][index]) * u64::from(shape[axis]) / u64::from(lengths[axis]);
                block * shape[axis] + coordinate as u32
            });
            pe_of[*cell] = Some(block);
        }
        filled(problem, pe_of, pes)
    };
    let mappings = shapes.into_iter().filter_map(of_shape);
    mappings.min_by_key(|mapping| {
        let cost = problem.cost(mapping);
        (cost.max_load, cost.connections)
    })
}

/// Numbers of blocks along each axis, such that there are no more blocks than PEs, and no more cells in any than this; the
/// most compact blocks first.
fn shapes(lengths: &[u32], pes: u32, cells: u32) -> Vec<Vec<u32>> {
    let mut shapes = vec![Vec::new()];
    for length in lengths {
        let longer = |shape: &Vec<u32>| {
            let before: u32 = shape.iter().product();
            let shape = shape.clone();
            (1..=(*length).min(pes / before)).map(move |count| [&shape[..], &[count]].concat()).collect::<Vec<_>>()
        };
        shapes = shapes.iter().flat_map(longer).collect();
    }
    let side = |axis: usize, shape: &[u32]| lengths[axis].div_ceil(shape[axis]);
    let volume = |shape: &[u32]| -> u64 { (0..shape.len()).map(|axis| u64::from(side(axis, shape))).product() };
    shapes.retain(|shape| volume(shape) <= u64::from(cells));
    shapes.sort_by_cached_key(|shape| {
        let faces: u64 = (0..shape.len()).map(|axis| volume(shape) / u64::from(side(axis, shape))).sum();
        // Faces per cell, in 1 / 1000.
        (faces * 1000 / volume(shape), shape.clone())
    });
    shapes
}

/// A mapping of blocks with the other equations filled in: on the PE of a block next to them, as far as the fullest block or
/// the mean load allows, and the rest shared equally by the other PEs; none if that leaves PEs without equations,
/// or equations without PEs.
fn filled(problem: &Problem, mut pe_of: Vec<Option<u32>>, pes: u32) -> Option<Mapping> {
    // Blocks without a cell are left out.
    let mut used: Vec<u32> = pe_of.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    for block in pe_of.iter_mut().flatten() {
        *block = number(used.binary_search(block).expect("a block of a cell"));
    }
    let blocks = number(used.len());
    let place_of: Vec<u32> = pe_of.iter().map(|pe| pe.unwrap_or(NOWHERE)).collect();
    let own = problem.alike().own(&place_of);
    let mut loads = vec![0; at(blocks)];
    // Equations without a place, with the first block next to them.
    let mut loose = Vec::new();
    for (equation, pe) in pe_of.iter().enumerate() {
        match pe {
            Some(pe) => loads[at(*pe)] += u64::from(problem.loads()[equation] + problem.alike().missed(equation, &own)),
            None => {
                let near = problem.adjacent(equation).filter_map(|next| pe_of[next]).min();
                loose.push((near.unwrap_or(NOWHERE), number(equation)));
            }
        }
    }
    loose.sort_unstable();
    if blocks == pes && loose.last().is_some_and(|(near, _)| *near == NOWHERE) {
        return None;
    }
    let load = |(_, equation): &(u32, u32)| u64::from(problem.loads()[at(*equation)]);
    let total = loads.iter().sum::<u64>() + loose.iter().map(load).sum::<u64>();
    let mut goal = total.div_ceil(u64::from(pes)).max(loads.iter().copied().max().unwrap_or(0));
    let (places, rest) = loop {
        let mut loads = loads.clone();
        let place = |entry: &(u32, u32)| {
            let block = loads.get_mut(at(entry.0)).filter(|done| **done + load(entry) <= goal)?;
            *block += load(entry);
            Some(entry.0)
        };
        let places: Vec<Option<u32>> = loose.iter().map(place).collect();
        let rest = || loose.iter().zip(&places).filter(|(_, place)| place.is_none()).map(|(entry, _)| *entry);
        if rest().map(|entry| load(&entry)).sum::<u64>() <= u64::from(pes - blocks) * goal || goal > total {
            break (places.clone(), rest().map(|(_, equation)| equation).collect::<Vec<u32>>());
        }
        goal += goal.div_ceil(FINENESS);
    };
    for ((_, equation), place) in loose.iter().zip(places) {
        pe_of[at(*equation)] = place;
    }
    let others = at(pes - blocks);
    if rest.len() < others || (others == 0 && !rest.is_empty()) {
        return None;
    }
    if others > 0 {
        for (pe, run) in (blocks..).zip(cut_evenly(problem, &rest, others)) {
            rest[run].iter().for_each(|equation| pe_of[at(*equation)] = Some(pe));
        }
    }
    let pe_of: List<EquationId, PeId> = pe_of.into_iter().map(|pe| pe.map(PeId::new)).collect::<Option<_>>()?;
    Some(Mapping { pes, pe_of })
}

#[cfg(test)]
mod tests {
    use super::super::grids::grid;
    use super::*;

    #[test]
    fn a_cube_becomes_blocks_that_keep_all_pairs() {
        // 27 blocks of two cells along each axis; four PEs have what no pair needs.
        let problem = grid(&[6, 6, 6], &[&[1, 0, 0], &[0, 1, 0], &[0, 0, 1]]).problem();
        let mapping = blocks(&problem, 31).expect("a cube");
        let cost = problem.cost(&mapping);
        assert!(u64::from(cost.max_load) * 31 * 20 <= problem.total_load() * 23, "{cost:?}, {}", problem.total_load());
        assert!(PeId::all(31).all(|pe| mapping.pe_of.contains(&pe)));
    }

    #[test]
    fn every_pe_has_an_equation_or_there_is_no_mapping() {
        let problem = grid(&[9, 7], &[&[1, 0], &[0, 1]]).problem();
        for pes in 1..problem.equations() {
            let Some(mapping) = blocks(&problem, pes) else { continue };
            assert!(PeId::all(pes).all(|pe| mapping.pe_of.contains(&pe)), "{pes}");
        }
    }

    #[test]
    fn without_pairs_there_are_no_blocks() {
        let problem = grid(&[6, 6], &[&[1, 0], &[0, 1]]).without_pairs();
        assert!(blocks(&problem, 9).is_none());
    }
}
