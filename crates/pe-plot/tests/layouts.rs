//! Layouts of graphs: nodes stay apart, and structure shows.

use pe_plot::layout::{close_order, places};

fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    ((a.0 - b.0) * (a.0 - b.0) + (a.1 - b.1) * (a.1 - b.1)).sqrt()
}

/// Least distance of two nodes, and largest length of an edge.
fn measures(nodes: usize, edges: &[(usize, usize)]) -> (f64, f64) {
    let places = places(nodes, edges);
    let pairs = (0..nodes).flat_map(|a| (0..a).map(move |b| (a, b)));
    let least = pairs.map(|(a, b)| distance(places[a], places[b])).fold(f64::MAX, f64::min);
    (least, edges.iter().map(|(a, b)| distance(places[*a], places[*b])).fold(0.0, f64::max))
}

#[test]
fn chains_have_equal_edges() {
    let edges: Vec<(usize, usize)> = (1..50).map(|node| (node - 1, node)).collect();
    let (least, longest) = measures(50, &edges);
    assert!((least - 1.0).abs() < 1e-9 && (longest - 1.0).abs() < 1e-9, "{least} {longest}");
}

#[test]
fn nodes_of_trees_grids_and_loose_parts_do_not_touch() {
    let tree: Vec<(usize, usize)> = (1..255).map(|node| ((node - 1) / 2, node)).collect();
    let star: Vec<(usize, usize)> = (1..40).map(|node| (0, node)).collect();
    let grid: Vec<(usize, usize)> = (0..100)
        .flat_map(|node| [(node, node + 1), (node, node + 10)])
        .filter(|(a, b)| *b < 100 && (b - a == 10 || b % 10 != 0))
        .collect();
    let loose = [(0, 1), (2, 3), (3, 4), (4, 2)];
    for (nodes, edges) in [(255, &tree[..]), (40, &star), (100, &grid), (7, &loose), (3, &[])] {
        let (least, _) = measures(nodes, edges);
        assert!(least > 0.45, "{nodes} nodes: {least}");
    }
    let (least, longest) = measures(100, &grid);
    assert!(longest < 2.5 * least, "a grid is bent: {least} {longest}");
}

#[test]
fn neighbours_are_close_in_the_order_of_a_matrix() {
    // A chain whose numbers are scattered: 7 has no common divisor with 50.
    let edges: Vec<(usize, usize)> = (1..50).map(|at| ((at - 1) * 7 % 50, at * 7 % 50)).collect();
    let order = close_order(50, &edges);
    let rank = |node: usize| order.iter().position(|other| *other == node).unwrap();
    assert!(edges.iter().all(|(a, b)| rank(*a).abs_diff(rank(*b)) == 1));
}
