//! Places for the nodes of a graph, chosen by its structure.
//!
//! A chain becomes a snake, a tree, or what is nearly one, grows outwards from its centre, anything else is laid out so
//! that distances in the plane are those in the graph (stress majorisation). Parts that are not connected stand beside
//! each other.

use std::collections::VecDeque;

/// A point of the plane.
pub type Place = (f64, f64);

/// A full turn.
const TURN: f64 = 2.0 * std::f64::consts::PI;

/// Rounds of stress majorisation.
const ROUNDS: usize = 120;

/// An undirected graph.
struct Graph {
    neighbours: Vec<Vec<usize>>,
}

/// Places of `nodes` nodes with undirected `edges`, in units of about an edge length.
pub fn places(nodes: usize, edges: &[(usize, usize)]) -> Vec<Place> {
    let graph = Graph::new(nodes, edges);
    let mut places = vec![(0.0, 0.0); nodes];
    let mut parts: Vec<(Vec<usize>, Vec<Place>)> = Vec::new();
    let mut seen = vec![false; nodes];
    for start in 0..nodes {
        if !seen[start] {
            let part = graph.part(start);
            part.iter().for_each(|node| seen[*node] = true);
            let inner = graph.restricted(&part);
            let places = inner.layout();
            parts.push((part, places));
        }
    }
    parts.sort_by_key(|(part, _)| std::cmp::Reverse(part.len()));
    let extents: Vec<(f64, f64)> = parts.iter_mut().map(|(_, places)| to_origin(places)).collect();
    let area: f64 = extents.iter().map(|(w, h)| (w + 1.5) * (h + 1.5)).sum();
    let widest = extents.iter().fold((area * 1.5).sqrt(), |widest, (w, _)| widest.max(*w));
    let (mut x, mut y, mut row) = (0.0, 0.0, 0.0f64);
    for ((part, inner), (w, h)) in parts.iter().zip(extents) {
        if x > 0.0 && x + w > widest {
            (x, y, row) = (0.0, y + row + 1.5, 0.0);
        }
        for (node, place) in part.iter().zip(inner) {
            places[*node] = (x + place.0, y + place.1);
        }
        (x, row) = (x + w + 1.5, row.max(h));
    }
    places
}

/// Moves places to the origin; returns their extent.
fn to_origin(places: &mut [Place]) -> (f64, f64) {
    let low = places.iter().fold((f64::MAX, f64::MAX), |low, p| (low.0.min(p.0), low.1.min(p.1)));
    let high = places.iter().fold((f64::MIN, f64::MIN), |high, p| (high.0.max(p.0), high.1.max(p.1)));
    places.iter_mut().for_each(|place| *place = (place.0 - low.0, place.1 - low.1));
    (high.0 - low.0, high.1 - low.1)
}

/// An order in which neighbours stand close together (Cuthill and McKee), for matrices.
pub fn close_order(nodes: usize, edges: &[(usize, usize)]) -> Vec<usize> {
    let graph = Graph::new(nodes, edges);
    let mut order = Vec::new();
    let mut seen = vec![false; nodes];
    for start in 0..nodes {
        if seen[start] {
            continue;
        }
        let end = graph.farthest(graph.farthest(start));
        seen[end] = true;
        let mut queue = VecDeque::from([end]);
        while let Some(node) = queue.pop_front() {
            order.push(node);
            let mut next: Vec<usize> = graph.neighbours[node].iter().copied().filter(|n| !seen[*n]).collect();
            next.sort_by_key(|node| (graph.neighbours[*node].len(), *node));
            for node in next {
                seen[node] = true;
                queue.push_back(node);
            }
        }
    }
    order
}

impl Graph {
    fn new(nodes: usize, edges: &[(usize, usize)]) -> Graph {
        let mut neighbours = vec![Vec::new(); nodes];
        for (a, b) in edges.iter().filter(|(a, b)| a != b) {
            neighbours[*a].push(*b);
            neighbours[*b].push(*a);
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        Graph { neighbours }
    }

    /// Distances from a node; `usize::MAX` where no path leads.
    fn distances(&self, start: usize) -> Vec<usize> {
        let mut distances = vec![usize::MAX; self.neighbours.len()];
        distances[start] = 0;
        let mut queue = VecDeque::from([start]);
        while let Some(node) = queue.pop_front() {
            for next in &self.neighbours[node] {
                if distances[*next] == usize::MAX {
                    distances[*next] = distances[node] + 1;
                    queue.push_back(*next);
                }
            }
        }
        distances
    }

    fn farthest(&self, start: usize) -> usize {
        let distances = self.distances(start);
        let reached = distances.iter().enumerate().filter(|(_, d)| **d < usize::MAX);
        reached.max_by_key(|(node, d)| (**d, usize::MAX - node)).map_or(start, |(node, _)| node)
    }

    /// The nodes that are connected with one, in ascending order.
    fn part(&self, start: usize) -> Vec<usize> {
        let distances = self.distances(start);
        (0..distances.len()).filter(|node| distances[*node] < usize::MAX).collect()
    }

    /// The graph of a part's nodes, renumbered in its order.
    fn restricted(&self, part: &[usize]) -> Graph {
        let number = |node: &usize| part.binary_search(node).expect("a part is closed");
        Graph { neighbours: part.iter().map(|node| self.neighbours[*node].iter().map(number).collect()).collect() }
    }

    /// Places of a connected graph.
    fn layout(&self) -> Vec<Place> {
        let nodes = self.neighbours.len();
        let degrees: usize = self.neighbours.iter().map(Vec::len).sum();
        if degrees / 2 + 1 > nodes + nodes / 12 {
            self.by_distance()
        } else if degrees / 2 + 1 == nodes && self.neighbours.iter().all(|list| list.len() <= 2) {
            self.snake()
        } else {
            self.around_centre()
        }
    }

    /// A chain in rows that turn at their ends.
    fn snake(&self) -> Vec<Place> {
        let nodes = self.neighbours.len();
        let distances = self.distances(self.farthest(0));
        let columns = if nodes <= 12 { nodes } else { (nodes as f64 * 2.0).sqrt().ceil() as usize };
        let place = |distance: &usize| {
            let (row, column) = (distance / columns, distance % columns);
            let column = if row % 2 == 0 { column } else { columns - 1 - column };
            (column as f64, row as f64)
        };
        distances.iter().map(place).collect()
    }

    /// A tree around its centre: the distance from it is the radius, every leaf gets the same angle. Of a graph that is
    /// no tree, every node hangs on the first neighbour that is closer to the centre.
    fn around_centre(&self) -> Vec<Place> {
        let nodes = self.neighbours.len();
        let end = self.farthest(0);
        let distances = self.distances(end);
        let mut centre = self.farthest(end);
        for _ in 0..distances[centre] / 2 {
            let towards = |node: &&usize| distances[**node] + 1 == distances[centre];
            centre = *self.neighbours[centre].iter().find(towards).expect("a path leads back");
        }
        let depth = self.distances(centre);
        let mut order: Vec<usize> = (0..nodes).collect();
        order.sort_by_key(|node| depth[*node]);
        let depth = &depth;
        let parent = |node: usize| self.neighbours[node].iter().copied().find(|other| depth[*other] + 1 == depth[node]);
        let children = |node: usize| self.neighbours[node].iter().copied().filter(move |n| parent(*n) == Some(node));
        let mut leaves = vec![0usize; nodes];
        for node in order.iter().rev() {
            leaves[*node] = children(*node).map(|child| leaves[child]).sum::<usize>().max(1);
        }
        let full = leaves[centre] as f64;
        let mut from = vec![0.0; nodes];
        let mut middles = vec![0.0; nodes];
        let mut places = vec![(0.0, 0.0); nodes];
        for node in order {
            let mut angle = from[node];
            for child in children(node) {
                from[child] = angle;
                angle += leaves[child] as f64 / full;
            }
            middles[node] = from[node] + leaves[node] as f64 / full / 2.0;
        }
        let rings = rings(depth, &middles);
        for (node, place) in places.iter_mut().enumerate() {
            let (radius, angle) = (rings[depth[node]], middles[node] * TURN);
            *place = (radius * libm::cos(angle), radius * libm::sin(angle));
        }
        places
    }

    /// Places whose distances are those of the graph, as far as the plane allows.
    fn by_distance(&self) -> Vec<Place> {
        let nodes = self.neighbours.len();
        let distances: Vec<Vec<usize>> = (0..nodes).map(|node| self.distances(node)).collect();
        let first = self.farthest(0);
        let second = self.farthest(first);
        // The second pair of pivots are the ends of the line between the first, so that a long graph does not bend.
        let skew = |node: &usize| distances[first][*node].abs_diff(distances[second][*node]);
        let least = (0..nodes).map(|node| skew(&node)).min().unwrap_or(0);
        let between: Vec<usize> = (0..nodes).filter(|node| skew(node) <= least + 1).collect();
        let end_from = |start: usize| {
            let apart = |node: &&usize| (distances[start][**node], usize::MAX - **node);
            between.iter().max_by_key(apart).copied().unwrap_or(start)
        };
        let third = end_from(between.first().copied().unwrap_or(0));
        let fourth = end_from(third);
        let mut places: Vec<Place> = (0..nodes)
            .map(|node| {
                let [a, b, c, d] = [first, second, third, fourth].map(|pivot| distances[pivot][node] as f64);
                // No two nodes may start at the same place.
                let jitter = node as f64 * 0.618_033_988_75;
                ((a - b) / 2.0 + 0.1 * (jitter - jitter.floor()), (c - d) / 2.0 + 0.1 * node as f64 / nodes as f64)
            })
            .collect();
        for _ in 0..ROUNDS {
            for node in 0..nodes {
                let (mut x, mut y, mut weights) = (0.0, 0.0, 0.0);
                let (px, py) = places[node];
                for (other, (ox, oy)) in places.iter().enumerate() {
                    if other == node {
                        continue;
                    }
                    let wanted = distances[node][other] as f64;
                    let weight = 1.0 / (wanted * wanted);
                    let (dx, dy) = (px - ox, py - oy);
                    let ratio = wanted / (dx * dx + dy * dy).sqrt().max(1e-9);
                    x += weight * (ox + dx * ratio);
                    y += weight * (oy + dy * ratio);
                    weights += weight;
                }
                places[node] = (x / weights, y / weights);
            }
        }
        places
    }
}

/// Radii of the rings of a tree, so that neighbours on a ring are at least one apart and rings, too; `middles` are
/// angles in parts of a turn.
fn rings(depth: &[usize], middles: &[f64]) -> Vec<f64> {
    let deepest = depth.iter().copied().max().unwrap_or(0);
    let needed = |ring: usize| {
        let mut angles: Vec<f64> = (0..depth.len()).filter(|node| depth[*node] == ring).map(|n| middles[n]).collect();
        angles.sort_by(f64::total_cmp);
        let gap = angles.windows(2).map(|pair| pair[1] - pair[0]).fold(1.0, f64::min);
        if angles.len() > 1 { 1.0 / (gap * TURN) } else { 0.0 }
    };
    let needed: Vec<f64> = (0..=deepest).map(needed).collect();
    // The ring that needs most sets the pace of those inside it.
    let pace = (1..=deepest).map(|ring| needed[ring] / ring as f64).fold(1.0, f64::max);
    let pace_of = (1..=deepest).rev().find(|ring| needed[*ring] / *ring as f64 >= pace).unwrap_or(0);
    (0..=deepest)
        .scan(0.0, |radius: &mut f64, ring| {
            let least = if ring == 0 { 0.0 } else { *radius + 1.0 };
            *radius = if ring <= pace_of { ring as f64 * pace } else { least.max(needed[ring]) };
            Some(*radius)
        })
        .collect()
}
