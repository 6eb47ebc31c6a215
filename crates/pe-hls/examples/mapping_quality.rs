//! Prints what the mapper makes of synthetic problems shaped like the models of Huang, Vahid and Givargis (2013),
//! doi 10.1145/2514641.2514650: a lung tree, a chain, a wave grid and an atrial cube.
//!
//! `cargo run --release -p pe-hls --example mapping_quality [name [seeds]]`; with a number of seeds, how the random
//! start ends beside the best of the others, in the mean.

use std::time::Instant;

use pe_hls::mapping::{Candidate, MapOptions, Problem, REGIONS, map};

/// A binary tree of branches; each has a pressure, `2 b`, and a flow, `2 b + 1`.
fn tree(generations: u32) -> Problem {
    let branches = (1u32 << generations) - 1;
    let mut loads = Vec::new();
    let mut arcs = Vec::new();
    for branch in 0..branches {
        let leaf = 2 * branch + 1 >= branches;
        let (pressure, flow) = (2 * branch, 2 * branch + 1);
        loads.extend([16, if leaf { 12 } else { 16 }]);
        arcs.extend([(flow, pressure), (pressure, flow)]);
        if branch > 0 {
            let (parent, sibling) = ((branch - 1) / 2, if branch % 2 == 1 { branch + 1 } else { branch - 1 });
            arcs.extend([(2 * parent + 1, pressure), (2 * sibling, pressure), (pressure, 2 * parent + 1)]);
        }
    }
    Problem::new(loads, &arcs, &[(0, 1)])
}

/// A box of cells that read their nearest neighbours; a chain and a grid are flat boxes.
fn cells(sides: [u32; 3], load: impl Fn(u32) -> u32) -> Problem {
    let count = sides[0] * sides[1] * sides[2];
    let mut arcs = Vec::new();
    let mut readings = vec![0; count as usize];
    for cell in 0..count {
        let mut stride = 1;
        for side in sides {
            if cell / stride % side + 1 < side {
                arcs.extend([(cell, cell + stride), (cell + stride, cell)]);
                readings[cell as usize] += 1;
                readings[(cell + stride) as usize] += 1;
            }
            stride *= side;
        }
    }
    Problem::new(readings.into_iter().map(load).collect(), &arcs, &[])
}

/// Equations that each read three random others.
fn random(equations: u32) -> Problem {
    let mut number = 1u64;
    let mut next = || {
        number = number.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (number >> 33) as u32 % equations
    };
    let arcs: Vec<_> = (0..3 * equations).map(|arc| (next(), arc / 3)).collect();
    Problem::new(vec![12; equations as usize], &arcs, &[])
}

/// Equations that all read the first one.
fn star(equations: u32) -> Problem {
    Problem::new(vec![8; equations as usize], &(1..equations).map(|reader| (0, reader)).collect::<Vec<_>>(), &[])
}

/// Load x connections of the mapping from the random start, regions cut anew, over that from the best of the others.
fn behind(problem: &Problem, pes: u32, seed: u64) -> f64 {
    let tries = MapOptions::default_tries(problem.equations());
    let candidates = map(problem, &MapOptions { pes, seed, tries, max_in_degree: 15 }).expect("a mapping");
    let product = |candidate: &Candidate| f64::from(candidate.cost.max_load) * f64::from(candidate.cost.connections);
    let (random, others): (Vec<_>, Vec<_>) = candidates.iter().partition(|candidate| candidate.start == REGIONS);
    product(random[0]) / others.iter().map(|candidate| product(candidate)).fold(f64::INFINITY, f64::min)
}

fn main() {
    let chain = |count| cells([count, 1, 1], |_| 12);
    let grid = |side| cells([side, side, 1], |neighbours| neighbours + 1);
    let cube = |side| cells([side, side, side], |neighbours| 4 * (neighbours + 3) + 1);
    let cases = [
        ("tree 4094", tree(11), 64),
        ("tree 4094", tree(11), 396),
        ("chain 4000", chain(4000), 63),
        ("chain 4000", chain(4000), 397),
        ("grid 6400", grid(80), 63),
        ("grid 6400", grid(80), 380),
        ("cube 3375", cube(15), 63),
        ("cube 3375", cube(15), 309),
        ("random 4000", random(4000), 16),
        ("star 4000", star(4000), 64),
        ("toy 5", chain(5), 3),
        ("large tree 131070", tree(16), 1024),
        ("large chain 100000", chain(100_000), 1024),
        ("large grid 102400", grid(320), 1024),
        ("large cube 103823", cube(47), 1024),
        ("large cube 103823", cube(47), 2048),
    ];
    let wanted = std::env::args().nth(1).unwrap_or_default();
    let seeds: u64 = std::env::args().nth(2).map_or(1, |count| count.parse().expect("a number of seeds"));
    println!(
        "start: max load / bound, connections, in-degree; load x connections / (bound x (PEs - 1)); before annealing"
    );
    for (name, problem, pes) in cases {
        let title = format!("{name} on {pes} PEs");
        if !title.contains(&wanted) {
            continue;
        }
        let bound = problem.total_load().div_ceil(u64::from(pes)) as f64;
        let tries = MapOptions::default_tries(problem.equations());
        if seeds > 1 {
            println!(
                "{title}: random start / best other {:.3}",
                (1..=seeds).map(|seed| behind(&problem, pes, seed)).sum::<f64>() / seeds as f64
            );
            continue;
        }
        let begin = Instant::now();
        let result = map(&problem, &MapOptions { pes, seed: 1, tries, max_in_degree: 15 });
        println!("{title}, bound {bound}, {:.2} s", begin.elapsed().as_secs_f64());
        for Candidate { cost, start, start_cost, .. } in result.unwrap_or_else(|error| panic!("{title}: {error}")) {
            let load = f64::from(cost.max_load);
            let product = load * f64::from(cost.connections) / (bound * f64::from(pes - 1));
            println!(
                "  {start:15} {load:5} {:.3} {:5} {:3}   {product:.3}   {:5} {:.3} {:5} {:3}",
                load / bound,
                cost.connections,
                cost.max_in_degree,
                start_cost.max_load,
                f64::from(start_cost.max_load) / bound,
                start_cost.connections,
                start_cost.max_in_degree,
            );
        }
    }
}
