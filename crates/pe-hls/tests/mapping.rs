//! The mapper on random and regular problems.

use pe_hls::mapping::{Candidate, MapError, MapOptions, Problem, RANDOM, map};
use pe_ir::index::{EquationId, PeId};
use pe_ir::verify::mapping::{Facts, check_facts};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const LIMIT: u32 = MapOptions::DEFAULT_MAX_IN_DEGREE;

fn options(pes: u32, tries: u64) -> MapOptions {
    MapOptions { pes, seed: 7, tries, max_in_degree: LIMIT }
}

fn facts(loads: &[u32], arcs: &[(u32, u32)], input_reads: &[(u32, u32)]) -> Facts {
    let arcs = arcs.iter().filter(|(read, reader)| read != reader);
    let dependencies = arcs.map(|&(read, reader)| (EquationId::new(read), EquationId::new(reader))).collect();
    let input_reads = input_reads.iter().map(|&(input, reader)| (input, EquationId::new(reader))).collect();
    Facts { loads: loads.to_vec().into(), dependencies, input_reads }
}

/// Maps and has every candidate checked.
fn checked(loads: &[u32], arcs: &[(u32, u32)], input_reads: &[(u32, u32)], options: &MapOptions) -> Vec<Candidate> {
    let candidates = map(&Problem::new(loads.to_vec(), arcs, input_reads), options).expect("a mapping");
    let facts = facts(loads, arcs, input_reads);
    for candidate in &candidates {
        let limit = candidate.cost.max_in_degree.max(options.max_in_degree);
        assert_eq!(check_facts(&facts, &candidate.mapping, &candidate.cost, limit), [""; 0], "{}", candidate.start);
    }
    assert!(candidates[0].cost.max_in_degree <= options.max_in_degree);
    assert!(candidates.iter().any(|candidate| candidate.start == RANDOM));
    candidates
}

/// Arcs in both directions.
fn both_ways(pairs: impl Iterator<Item = (u32, u32)>) -> Vec<(u32, u32)> {
    pairs.flat_map(|(left, right)| [(left, right), (right, left)]).collect()
}

#[test]
fn candidates_of_random_problems_pass_the_checker() {
    for seed in 0..20 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let equations = rng.random_range(1..120u32);
        let loads: Vec<u32> = (0..equations).map(|_| rng.random_range(0..40)).collect();
        let mut any = |below: u32| rng.next_u32() % below;
        let arcs: Vec<_> = (0..equations * (seed as u32 % 4)).map(|_| (any(equations), any(equations))).collect();
        let input_reads: Vec<_> = (0..seed as u32 % 5).map(|_| (any(3), any(equations))).collect();
        let pes = any(equations.min(12)) + 1;
        checked(&loads, &arcs, &input_reads, &options(pes, 20_000));
    }
}

#[test]
fn the_same_seed_gives_the_same_mappings() {
    let arcs = both_ways((0..399).map(|equation| (equation, (equation * 7 + 1) % 400)));
    let mappings = || {
        let candidates = checked(&[5; 400], &arcs, &[(0, 3)], &options(20, 50_000));
        candidates.into_iter().map(|candidate| (candidate.start, candidate.mapping)).collect::<Vec<_>>()
    };
    assert_eq!(mappings(), mappings());
}

#[test]
fn a_shuffled_chain_becomes_a_chain_of_pes() {
    // 7 and 600 are coprime, so the places of the links are a permutation of the equations.
    let arcs = both_ways((0..599).map(|link| (link * 7 % 600, (link + 1) * 7 % 600)));
    let best = &checked(&[12; 600], &arcs, &[], &options(30, 200_000))[0];
    assert_eq!((best.cost.max_load, best.cost.connections), (240, 29));
}

#[test]
fn a_tree_needs_hardly_more_connections_than_a_tree_of_pes() {
    let arcs = both_ways((1..1023).map(|branch| ((branch - 1) / 2, branch)));
    let best = &checked(&[10; 1023], &arcs, &[], &options(32, 500_000))[0];
    assert!(best.cost.max_load <= 330 && best.cost.connections <= 34, "{:?}", best.cost);
}

#[test]
fn a_grid_of_long_runs_needs_hardly_more_connections_than_a_chain() {
    let side = 40;
    let down = (0..side * (side - 1)).map(|cell| (cell, cell + side));
    let right = (0..side * side).filter(|cell| cell % side + 1 < side).map(|cell| (cell, cell + 1));
    let arcs = both_ways(down.chain(right));
    let best = &checked(&[5; 1600], &arcs, &[], &options(25, 200_000))[0];
    assert!(best.cost.max_load <= 325 && best.cost.connections <= 26, "{:?}", best.cost);
}

#[test]
fn annealing_alone_finds_the_tree_from_a_random_start() {
    let arcs = both_ways((1..255).map(|branch| ((branch - 1) / 2, branch)));
    let candidates = checked(&[10; 255], &arcs, &[], &options(16, 400_000));
    let random = candidates.iter().find(|candidate| candidate.start == RANDOM).expect("always there");
    assert!(random.start_cost.connections > 90, "{:?}", random.start_cost);
    assert!(random.cost.max_load <= 170 && random.cost.connections <= 18, "{:?}", random.cost);
}

#[test]
fn the_in_degree_limit_is_met_on_a_random_graph() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let arcs: Vec<_> = (0..900).map(|arc| (rng.random_range(0..600), arc % 600)).collect();
    let candidates = checked(&[6; 600], &arcs, &[(0, 5), (1, 5)], &options(40, 600_000));
    assert!(candidates[0].start_cost.max_in_degree > LIMIT, "{:?}", candidates[0].start_cost);
}

#[test]
fn the_number_of_pes_must_suit_the_equations() {
    let problem = Problem::new(vec![1; 3], &[], &[]);
    assert_eq!(map(&problem, &options(0, 100)).unwrap_err(), MapError::Pes { pes: 0, equations: 3 });
    assert_eq!(map(&problem, &options(4, 100)).unwrap_err(), MapError::Pes { pes: 4, equations: 3 });
    checked(&[1; 3], &[], &[], &options(3, 100));
    checked(&[1; 3], &[], &[], &options(1, 100));
}

#[test]
fn an_impossible_in_degree_names_the_equation() {
    // Equation 0 reads all others, and each PE has one equation.
    let arcs: Vec<_> = (1..20).map(|read| (read, 0)).collect();
    let error = map(&Problem::new(vec![1; 20], &arcs, &[]), &options(20, 1_000)).unwrap_err();
    let MapError::InDegree { equation, degree, limit, .. } = error else { panic!("{error}") };
    assert_eq!((equation.number(), degree, limit), (0, 19, 15), "{error}");
}

#[test]
fn the_graphs_show_both_levels() {
    let problem = Problem::new(vec![2, 3, 4], &[(0, 1), (0, 2), (1, 2)], &[(0, 0)]);
    let ode = problem.ode_graph();
    assert_eq!((ode.node_count(), ode.edge_count()), (3, 3));
    let mapping = pe_ir::mapping::Mapping { pes: 2, pe_of: [0, 0, 1].map(PeId::new).to_vec().into() };
    let pes = problem.pe_graph(&mapping);
    assert_eq!(pes.node_weights().copied().collect::<Vec<_>>(), [5, 4]);
    assert_eq!(pes.edge_weights().copied().collect::<Vec<_>>(), [2]);
}
