//! Initial mappings: random, runs of linear orders, and recursive bisection.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

use pe_ir::index::{EquationId, List, PeId, at, number};
use pe_ir::mapping::Mapping;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::blocks::blocks;
use super::orders::{self, Region};
use super::problem::Problem;
use super::random::below;
use super::tiles::tiles;

/// The equations in random order, dealt to the PEs in turn.
pub(super) fn random(problem: &Problem, pes: u32, seed: u64) -> Mapping {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(1);
    let mut order = orders::declared(problem);
    for last in (1..order.len()).rev() {
        order.swap(last, below(&mut rng, last + 1));
    }
    let mut pe_of = List::filled(PeId::new(0), order.len());
    for (turn, &equation) in order.iter().enumerate() {
        pe_of[EquationId::new(equation)] = PeId::new(number(turn) % pes);
    }
    Mapping { pes, pe_of }
}

/// The largest load when each equation in turn, the heaviest first, goes to the PE that has least (Graham 1969,
/// doi 10.1137/0117039): close to the smallest possible, whatever the dependencies.
pub(super) fn packed_load(problem: &Problem, pes: u32) -> u32 {
    let mut loads = problem.loads().to_vec();
    loads.sort_unstable_by_key(|&load| Reverse(load));
    let mut packed: BinaryHeap<Reverse<u32>> = (0..pes).map(|_| Reverse(0)).collect();
    for load in loads {
        if let Some(mut least) = packed.peek_mut() {
            least.0 += load;
        }
    }
    packed.into_iter().map(|Reverse(load)| load).max().unwrap_or(0)
}

/// Mappings with structure, by name, without repeats.
pub(super) fn structured(problem: &Problem, pes: u32) -> Vec<(&'static str, Mapping)> {
    let mut starts: Vec<(&'static str, Mapping)> = Vec::new();
    let mut add = |name, mapping: Mapping| {
        if starts.iter().all(|(_, other)| *other != mapping) {
            starts.push((name, mapping));
        }
    };
    add("declared order", runs(problem, &orders::declared(problem), pes));
    add("breadth first", runs(problem, &orders::breadth_first(problem), pes));
    add("depth first", runs(problem, &orders::depth_first(problem, false), pes));
    add("depth last", runs(problem, &orders::depth_first(problem, true), pes));
    add("bisection", bisection(problem, pes));
    if let Some(mapping) = tiles(problem, pes) {
        add("tiles", mapping);
    }
    if let Some(mapping) = blocks(problem, pes) {
        add("blocks", mapping);
    }
    starts
}

/// Cuts an order of all equations into one run per PE.
pub(super) fn runs(problem: &Problem, order: &[u32], pes: u32) -> Mapping {
    let mut pe_of = List::filled(PeId::new(0), order.len());
    for (pe, run) in PeId::all(pes).zip(cut_evenly(problem, order, at(pes))) {
        order[run].iter().for_each(|&equation| pe_of[EquationId::new(equation)] = pe);
    }
    Mapping { pes, pe_of }
}

/// Cuts an order into runs, none of them empty, such that the largest load of a run is the smallest possible, and the
/// loads of the runs follow the mean as closely as that allows.
pub(super) fn cut_evenly(problem: &Problem, order: &[u32], count: usize) -> Vec<Range<usize>> {
    let loads: Vec<u64> = order.iter().map(|&equation| u64::from(problem.loads()[at(equation)])).collect();
    let cap = smallest_cap(&loads, count);
    // What is left must fit into the runs left, so no run may end before `earliest`.
    let earliest = earliest_ends(&loads, count, cap);
    let total: u64 = loads.iter().sum();
    let mut runs = Vec::with_capacity(count);
    let (mut next, mut done) = (0, 0u64);
    for (run, earliest) in earliest.into_iter().enumerate() {
        let goal = total * (run as u64 + 1) / count as u64;
        let latest = order.len() - (count - 1 - run);
        let (first, begin) = (next, done);
        while next < latest {
            let after = done + loads[next];
            let fits = after - begin <= cap;
            let closer = after.saturating_sub(goal) <= goal.saturating_sub(done);
            if next >= earliest && next > first && !(fits && closer) {
                break;
            }
            done = after;
            next += 1;
        }
        runs.push(first..next);
    }
    runs
}

/// The smallest load that allows a cut into `pes` runs, by bisection.
fn smallest_cap(loads: &[u64], pes: usize) -> u64 {
    let total: u64 = loads.iter().sum();
    let mut low = loads.iter().copied().max().unwrap_or(0).max(total.div_ceil(pes as u64));
    let mut high = total.max(low);
    while low < high {
        let middle = low + (high - low) / 2;
        let mut runs = 1;
        let mut run = 0;
        for &load in loads {
            if run + load > middle {
                runs += 1;
                run = 0;
            }
            run += load;
        }
        if runs <= pes {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

/// For each run the smallest end that leaves no more to the runs behind it than they can take under the cap.
fn earliest_ends(loads: &[u64], pes: usize, cap: u64) -> Vec<usize> {
    let mut ends = vec![0; pes];
    let mut end = loads.len();
    for earliest in ends.iter_mut().rev() {
        *earliest = end;
        let mut run = 0;
        while end > 0 && run + loads[end - 1] <= cap {
            end -= 1;
            run += loads[end];
        }
    }
    ends
}

/// Halves the equations again and again: each part in layers from one of its ends, cut where the loads match the
/// numbers of PEs.
fn bisection(problem: &Problem, pes: u32) -> Mapping {
    let mut pe_of = List::filled(PeId::new(0), at(problem.equations()));
    let mut order = orders::breadth_first(problem);
    let mut region = Region::new(problem);
    // Parts of `order` with their first PE and number of PEs.
    let mut parts = vec![(0..order.len(), 0, at(pes))];
    while let Some((part, first, count)) = parts.pop() {
        let equations = &mut order[part.clone()];
        if count == 1 {
            for &equation in equations.iter() {
                pe_of[EquationId::new(equation)] = PeId::at(first);
            }
            continue;
        }
        region.enter(equations);
        let layered = region.layers_of_all(equations);
        region.leave(equations);
        equations.copy_from_slice(&layered);
        let half = count / 2;
        let load = |equation: &u32| u64::from(problem.loads()[at(*equation)]);
        let total: u64 = equations.iter().map(load).sum();
        let goal = total * half as u64 / count as u64;
        let mut done = 0;
        let cut = equations.iter().take_while(|&equation| {
            done += load(equation);
            done <= goal
        });
        let cut = cut.count().clamp(half, part.len() - (count - half));
        parts.push((part.start..part.start + cut, first, half));
        parts.push((part.start + cut..part.end, first + half, count - half));
    }
    Mapping { pes, pe_of }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The smallest largest load of a cut into runs, by trying all cuts.
    fn smallest(loads: &[u32], pes: usize) -> u32 {
        if pes == 1 {
            return loads.iter().sum();
        }
        let cuts = 1..=loads.len() - (pes - 1);
        cuts.map(|cut| loads[..cut].iter().sum::<u32>().max(smallest(&loads[cut..], pes - 1))).min().unwrap_or(0)
    }

    #[test]
    fn runs_have_the_smallest_largest_load() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for case in 0..300 {
            let loads: Vec<u32> = (0..1 + case % 12).map(|_| below(&mut rng, 20) as u32).collect();
            for pes in 1..=loads.len().min(5) {
                let problem = Problem::new(loads.clone(), &[], &[]);
                let mapping = runs(&problem, &orders::declared(&problem), pes as u32);
                assert!(mapping.pe_of.is_sorted());
                assert!(PeId::all(pes as u32).all(|pe| mapping.pe_of.contains(&pe)), "{loads:?} {mapping:?}");
                assert_eq!(problem.cost(&mapping).max_load, smallest(&loads, pes), "{loads:?} {mapping:?}");
            }
        }
    }

    #[test]
    fn every_start_uses_every_pe() {
        let arcs: Vec<_> = (1..50).filter(|reader| reader % 20 != 0).map(|reader| (reader / 3, reader)).collect();
        let problem = Problem::new((0..50).map(|equation| equation % 7).collect(), &arcs, &[]);
        for pes in [1, 2, 13, 49, 50] {
            let all = structured(&problem, pes).into_iter().chain([("random", random(&problem, pes, 5))]);
            for (name, mapping) in all {
                assert!(PeId::all(pes).all(|pe| mapping.pe_of.contains(&pe)), "{name} on {pes}");
            }
        }
    }
}
