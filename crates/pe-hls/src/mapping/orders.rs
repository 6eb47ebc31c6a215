//! Linear orders of the equations in which neighbours in the dependency graph are close together.

use pe_ir::index::{at, number};
use std::collections::VecDeque;

use super::problem::Problem;

const UNSEEN: u32 = u32::MAX;

/// The order in which the equations are declared.
pub(super) fn declared(problem: &Problem) -> Vec<u32> {
    (0..problem.equations()).collect()
}

/// Breadth first from the end of each component, neighbours by rising degree (Cuthill and McKee 1969,
/// doi 10.1145/800195.805928): runs of it are layers.
pub(super) fn breadth_first(problem: &Problem) -> Vec<u32> {
    let all = declared(problem);
    let mut region = Region::new(problem);
    region.enter(&all);
    region.layers_of_all(&all)
}

/// Depth first from the end of each component, equations before (`after` = false) or after what is reached through
/// them, small subtrees first: runs of it are parts of trees.
pub(super) fn depth_first(problem: &Problem, after: bool) -> Vec<u32> {
    let all = declared(problem);
    let mut region = Region::new(problem);
    region.enter(&all);
    let mut seen = vec![false; all.len()];
    let mut order = Vec::with_capacity(all.len());
    for root in breadth_first_ends(problem, &mut region, &all) {
        let tree = Tree::depth_first(problem, root, &mut seen);
        tree.write(after, &mut order);
    }
    order
}

/// The end of each component.
fn breadth_first_ends(problem: &Problem, region: &mut Region, all: &[u32]) -> Vec<u32> {
    let mut ends = Vec::new();
    let mut component = Vec::with_capacity(at(problem.equations()));
    for &equation in all {
        if region.is_unseen(equation) {
            let end = region.far_end(equation);
            region.layers(end, &mut component);
            ends.push(end);
        }
    }
    ends
}

/// The depth-first spanning tree of a component.
pub(super) struct Tree {
    /// Equations in the order of their discovery.
    found: Vec<u32>,
    /// Position in `found` of the equation through which each was found.
    parents: Vec<u32>,
}

impl Tree {
    /// The tree of what can be reached from a root and was not seen before.
    pub(super) fn depth_first(problem: &Problem, root: u32, seen: &mut [bool]) -> Tree {
        let mut tree = Tree { found: Vec::new(), parents: Vec::new() };
        // Neighbours are pushed before they are known to be children; the first one popped is the one that counts.
        let mut stack = vec![(root, 0)];
        while let Some((equation, parent)) = stack.pop() {
            if std::mem::replace(&mut seen[at(equation)], true) {
                continue;
            }
            let position = number(tree.found.len());
            tree.found.push(equation);
            tree.parents.push(parent);
            let unseen = problem.adjacent(at(equation)).rev().filter(|&next| !seen[next]);
            stack.extend(unseen.map(|next| (number(next), position)));
        }
        tree
    }

    /// Appends the tree in pre-order or post-order, children by rising size of their subtrees.
    pub(super) fn write(&self, after: bool, order: &mut Vec<u32>) {
        let count = self.found.len();
        let mut sizes = vec![1u32; count];
        for position in (1..count).rev() {
            sizes[at(self.parents[position])] += sizes[position];
        }
        let mut by_size: Vec<u32> = (1..count as u32).collect();
        by_size.sort_by_key(|&position| (self.parents[at(position)], sizes[at(position)], position));
        // The first position of each subtree in the written order follows from the sizes alone.
        let mut first = vec![0u32; count];
        let base = order.len();
        order.resize(base + count, 0);
        for children in by_size.chunk_by(|&left, &right| self.parents[at(left)] == self.parents[at(right)]) {
            let mut next = first[at(self.parents[at(children[0])])] + u32::from(!after);
            for &child in children {
                first[at(child)] = next;
                next += sizes[at(child)];
            }
        }
        for position in 0..count {
            let place = first[position] + if after { sizes[position] - 1 } else { 0 };
            order[base + at(place)] = self.found[position];
        }
    }
}

/// Breadth-first searches within a part of the equations; the cost of each is that of the part.
pub(super) struct Region<'p> {
    problem: &'p Problem,
    /// Number of the search that last saw an equation; none for equations outside the part.
    seen: Vec<u32>,
    searches: u32,
    queue: VecDeque<u32>,
}

impl<'p> Region<'p> {
    /// No part yet.
    pub(super) fn new(problem: &'p Problem) -> Region<'p> {
        Region { problem, seen: vec![UNSEEN; at(problem.equations())], searches: 1, queue: VecDeque::new() }
    }

    /// Makes these equations the part.
    pub(super) fn enter(&mut self, part: &[u32]) {
        for &equation in part {
            self.seen[at(equation)] = 0;
        }
    }

    /// Takes these equations out of the part.
    pub(super) fn leave(&mut self, part: &[u32]) {
        for &equation in part {
            self.seen[at(equation)] = UNSEEN;
        }
    }

    /// Whether an equation of the part is in no component written so far.
    pub(super) fn is_unseen(&self, equation: u32) -> bool {
        self.seen[at(equation)] != u32::MAX - 1
    }

    /// An equation at an end of the component: the last of two searches, each from the last of the one before.
    pub(super) fn far_end(&mut self, equation: u32) -> u32 {
        let mut end = equation;
        for _ in 0..2 {
            self.searches += 1;
            end = self.search(end, self.searches, |_| {});
        }
        end
    }

    /// All equations of the region in layers from the end of each component.
    pub(super) fn layers_of_all(&mut self, equations: &[u32]) -> Vec<u32> {
        let mut order = Vec::with_capacity(equations.len());
        for &equation in equations {
            if self.is_unseen(equation) {
                let end = self.far_end(equation);
                self.layers(end, &mut order);
            }
        }
        order
    }

    /// Appends the component of an equation in layers and marks it as seen.
    pub(super) fn layers(&mut self, equation: u32, order: &mut Vec<u32>) {
        self.search(equation, u32::MAX - 1, |found| order.push(found));
    }

    /// Visits the component breadth first, neighbours by rising degree; the last one found.
    fn search(&mut self, equation: u32, mark: u32, mut visit: impl FnMut(u32)) -> u32 {
        let mut last = equation;
        self.queue.clear();
        self.queue.push_back(equation);
        self.seen[at(equation)] = mark;
        let mut next: Vec<u32> = Vec::new();
        while let Some(found) = self.queue.pop_front() {
            visit(found);
            last = found;
            for neighbour in self.problem.adjacent(at(found)) {
                if self.seen[neighbour] < mark {
                    self.seen[neighbour] = mark;
                    next.push(number(neighbour));
                }
            }
            next.sort_by_key(|&equation| self.problem.neighbours(at(equation)).len());
            self.queue.extend(next.drain(..));
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A binary tree and, apart from it, a pair and a single equation.
    fn forest() -> Problem {
        let tree = (1..15).map(|branch| ((branch - 1) / 2, branch));
        Problem::new(vec![1; 18], &tree.chain([(16, 15)]).collect::<Vec<_>>(), &[])
    }

    #[test]
    fn orders_are_permutations() {
        let problem = forest();
        for mut order in [breadth_first(&problem), depth_first(&problem, false), depth_first(&problem, true)] {
            order.sort_unstable();
            assert_eq!(order, declared(&problem));
        }
    }

    #[test]
    fn layers_of_a_path_follow_it_from_its_end() {
        let order = [3, 0, 4, 1, 2];
        let arcs: Vec<_> = order.windows(2).map(|pair| (pair[0], pair[1])).collect();
        let found = breadth_first(&Problem::new(vec![1; 5], &arcs, &[]));
        assert!(found == order || found.iter().rev().eq(&order), "{found:?}");
    }

    #[test]
    fn depth_first_orders_grow_trees() {
        let problem = forest();
        // From an end of each of the three components, every equation is next to one before it, or after it.
        for after in [false, true] {
            let mut order = depth_first(&problem, after);
            if after {
                order.reverse();
            }
            let attached = |place: &usize| {
                problem.adjacent(order[*place] as usize).any(|next| order[..*place].contains(&(next as u32)))
            };
            assert_eq!((0..order.len()).filter(attached).count(), order.len() - 3, "{order:?}");
        }
    }
}
