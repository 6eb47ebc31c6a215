//! Orders of elimination: what a matrix fills in, how deep its pivots depend on one another, and orders that keep one or
//! the other small.

use std::collections::BTreeSet;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How the order of an elimination is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// As the rows stand.
    Natural,
    /// Next is what can fill in least (Markowitz 1957).
    #[default]
    Fill,
    /// Next is what waits for the fewest pivots: neighbours in turn, as cyclic reduction does.
    Depth,
    /// From both ends of the matrix inwards.
    Twisted,
    /// Halves first, then what separates them.
    Dissection,
    /// The shortest in a search that begins with the others.
    Search,
}

impl Order {
    /// All of them.
    pub const ALL: [Order; 6] =
        [Order::Natural, Order::Fill, Order::Depth, Order::Twisted, Order::Dissection, Order::Search];

    /// The one with a name.
    pub fn named(name: &str) -> Option<Order> {
        Order::ALL.into_iter().find(|order| order.name() == name)
    }

    /// The name that options and reports have for it.
    pub fn name(self) -> &'static str {
        match self {
            Order::Natural => "natural",
            Order::Fill => "fill",
            Order::Depth => "depth",
            Order::Twisted => "twisted",
            Order::Dissection => "dissection",
            Order::Search => "search",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            Order::Natural => "As the rows stand",
            Order::Fill => "What fills in least comes next",
            Order::Depth => "What waits for the fewest pivots comes next",
            Order::Twisted => "From both ends of the matrix inwards",
            Order::Dissection => "Halves first, then what separates them",
            Order::Search => "The shortest in a search that begins with the others",
        }
    }
}

/// Words that a product of two variables takes until another chain can read its sum.
const PRODUCT: u64 = 10;

/// Words from a pivot to its reciprocal.
const RECIPROCAL: u64 = 60;

/// Entries right of a pivot up to which their products do not wait for its reciprocal.
const AHEAD: usize = super::system::MOST_AHEAD;

/// Issue slots of a product of two variables, and of a reciprocal.
const PRODUCT_SLOTS: u64 = 2;
const RECIPROCAL_SLOTS: u64 = 9;

/// PEs that an estimate is for: more are seldom worth their area where pivots wait for each other.
const PES: u64 = 4;

/// Elementary operations that a search may spend on estimates, and the fewest and the most estimates.
const SEARCH_WORK: u64 = 30_000_000;
const SEARCH_TRIES: (u64, u64) = (50, 4_000);

/// What an order leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Estimate {
    /// Entries that are zero in the matrix and none after the elimination; of a symmetric pattern those of one triangle.
    pub fill: u64,
    /// Most pivots that wait for one another.
    pub depth: u64,
    /// Words of a step that it takes, roughly.
    pub words: u64,
    /// Operations on pairs of entries.
    pub work: u64,
}

/// Places of the entries of a matrix that are not zero all the time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    rows: Vec<BTreeSet<usize>>,
}

impl Pattern {
    /// A matrix with these columns in its rows.
    pub fn new(rows: Vec<BTreeSet<usize>>) -> Pattern {
        Pattern { rows }
    }

    /// Rows.
    pub fn size(&self) -> usize {
        self.rows.len()
    }

    /// Entries.
    pub fn entries(&self) -> usize {
        self.rows.iter().map(BTreeSet::len).sum()
    }

    /// Whether there is an entry.
    pub fn has(&self, row: usize, column: usize) -> bool {
        self.rows[row].contains(&column)
    }

    /// Row and column of each entry.
    pub fn all(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.rows.iter().enumerate().flat_map(|(row, columns)| columns.iter().map(move |column| (row, *column)))
    }

    /// Whether no order differs from another one.
    fn is_full(&self) -> bool {
        self.rows.iter().all(|row| row.len() == self.size())
    }

    /// The rows of a matrix in an order in which each has a pivot; none if there is none.
    pub fn order(&self, order: Order) -> Option<Vec<usize>> {
        let natural: Vec<usize> = (0..self.size()).collect();
        let found = match order {
            Order::Natural => natural,
            Order::Fill => return self.least_fill(),
            _ if self.is_full() => natural,
            Order::Depth => self.least_depth(),
            Order::Twisted => {
                let ends = [twisted(&natural), twisted(&self.levels())];
                ends.into_iter().min_by_key(|order| self.words(order))?
            }
            Order::Dissection => self.dissected(),
            Order::Search => return self.searched(),
        };
        self.estimate(&found).map(|_| found)
    }

    fn words(&self, order: &[usize]) -> u64 {
        self.estimate(order).map_or(u64::MAX, |estimate| estimate.words)
    }

    /// Always the diagonal entry next whose elimination can fill in least.
    fn least_fill(&self) -> Option<Vec<usize>> {
        let mut rows = self.rows.clone();
        let mut columns = vec![BTreeSet::new(); rows.len()];
        for (index, row) in rows.iter().enumerate() {
            row.iter().for_each(|column| _ = columns[*column].insert(index));
        }
        let price =
            |index: usize, rows: &[BTreeSet<usize>], columns: &[BTreeSet<usize>]| match rows[index].contains(&index) {
                true => (rows[index].len() - 1) * (columns[index].len() - 1),
                false => usize::MAX,
            };
        let mut prices: Vec<usize> = (0..rows.len()).map(|index| price(index, &rows, &columns)).collect();
        let mut queue: BTreeSet<(usize, usize)> =
            prices.iter().enumerate().map(|(index, price)| (*price, index)).collect();
        let mut order = Vec::with_capacity(rows.len());
        while let Some((least, pivot)) = queue.pop_first() {
            if least == usize::MAX {
                return None;
            }
            let mut row = std::mem::take(&mut rows[pivot]);
            row.remove(&pivot);
            row.iter().for_each(|column| _ = columns[*column].remove(&pivot));
            let mut below = std::mem::take(&mut columns[pivot]);
            below.remove(&pivot);
            for other in &below {
                rows[*other].remove(&pivot);
                for column in &row {
                    rows[*other].insert(*column);
                    columns[*column].insert(*other);
                }
            }
            order.push(pivot);
            for index in below.into_iter().chain(row) {
                queue.remove(&(prices[index], index));
                prices[index] = price(index, &rows, &columns);
                queue.insert((prices[index], index));
            }
        }
        Some(order)
    }

    /// For each row the others that share an entry with it.
    fn neighbours(&self) -> Vec<BTreeSet<usize>> {
        let mut neighbours = vec![BTreeSet::new(); self.size()];
        for (index, row) in self.rows.iter().enumerate() {
            for column in row.iter().copied().filter(|column| *column != index) {
                neighbours[index].insert(column);
                neighbours[column].insert(index);
            }
        }
        neighbours
    }

    /// Always the row next that waits for the fewest pivots, of these the one with the fewest neighbours.
    fn least_depth(&self) -> Vec<usize> {
        let mut neighbours = self.neighbours();
        let mut levels = vec![0usize; self.size()];
        let key = |index: usize, levels: &[usize], neighbours: &[BTreeSet<usize>]| {
            (levels[index], neighbours[index].len(), index)
        };
        let mut queue: BTreeSet<(usize, usize, usize)> =
            (0..self.size()).map(|index| key(index, &levels, &neighbours)).collect();
        let mut order = Vec::with_capacity(self.size());
        while let Some((level, _, pivot)) = queue.pop_first() {
            order.push(pivot);
            let around = std::mem::take(&mut neighbours[pivot]);
            for other in around.iter().copied() {
                queue.remove(&key(other, &levels, &neighbours));
                levels[other] = levels[other].max(level + 1);
                neighbours[other].remove(&pivot);
                neighbours[other].extend(around.iter().copied().filter(|index| *index != other));
                queue.insert(key(other, &levels, &neighbours));
            }
        }
        order
    }

    /// Rows by their distance from one that is far from others, part after part of what is connected.
    fn levels(&self) -> Vec<usize> {
        let neighbours = self.neighbours();
        let mut order = Vec::with_capacity(self.size());
        let mut seen = vec![false; self.size()];
        for first in 0..self.size() {
            if !seen[first] {
                let part = breadth_first(&neighbours, far_end(&neighbours, first, &|_| true), &|_| true);
                part.iter().for_each(|index| seen[*index] = true);
                order.extend(part);
            }
        }
        order
    }

    /// Halves first, each in the same way, then what separates them.
    fn dissected(&self) -> Vec<usize> {
        let neighbours = self.neighbours();
        let mut order = Vec::with_capacity(self.size());
        let mut open: Vec<(Vec<usize>, bool)> = vec![((0..self.size()).collect(), false)];
        while let Some((part, done)) = open.pop() {
            if done || part.len() <= 2 {
                order.extend(part);
                continue;
            }
            let mut inside = vec![false; self.size()];
            part.iter().for_each(|index| inside[*index] = true);
            let within = |index: usize| inside[index];
            let reached = breadth_first(&neighbours, far_end(&neighbours, part[0], &within), &within);
            if reached.len() < part.len() {
                let others = part.into_iter().filter(|index| !reached.contains(index)).collect();
                open.push((others, false));
                open.push((reached, false));
                continue;
            }
            // The rows at one distance from an end part those before them from those behind.
            let (begin, end) = narrowest(&neighbours, &reached);
            open.push((reached[begin..end].to_vec(), true));
            open.push((reached[end..].to_vec(), false));
            open.push((reached[..begin].to_vec(), false));
        }
        order
    }

    /// The best that moving single rows makes of the best of the other orders.
    fn searched(&self) -> Option<Vec<usize>> {
        let starts = [Order::Natural, Order::Fill, Order::Depth, Order::Twisted, Order::Dissection];
        let starts = starts.into_iter().filter_map(|order| self.order(order));
        let (mut words, mut best) = starts.map(|order| (self.words(&order), order)).min_by_key(|(words, _)| *words)?;
        let work = self.estimate(&best)?.work.max(1);
        if self.is_full() || self.size() < 3 {
            return Some(best);
        }
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let mut below = |limit: usize| random.random_range(0..limit);
        for _ in 0..(SEARCH_WORK / work).clamp(SEARCH_TRIES.0, SEARCH_TRIES.1) {
            let mut moved = best.clone();
            for _ in 0..=below(2) {
                let row = moved.remove(below(self.size()));
                moved.insert(below(self.size()), row);
            }
            let found = self.words(&moved);
            // Equal ones are taken as well: plateaus are wide.
            if found <= words {
                (words, best) = (found, moved);
            }
        }
        Some(best)
    }

    /// What an order leads to; none if a row has no pivot when its turn comes.
    pub fn estimate(&self, order: &[usize]) -> Option<Estimate> {
        let count = self.size();
        let mut place = vec![0; count];
        order.iter().enumerate().for_each(|(at, row)| place[*row] = at);
        // By place: for each pivot the places right of it, and, if they are others, those below it.
        let mut right = vec![BTreeSet::new(); count];
        let mut below = vec![BTreeSet::new(); count];
        let mut pivots = vec![false; count];
        for (index, row) in self.rows.iter().enumerate() {
            for column in row {
                let (row, column) = (place[index], place[*column]);
                match row.cmp(&column) {
                    std::cmp::Ordering::Less => _ = right[row].insert(column),
                    std::cmp::Ordering::Equal => pivots[row] = true,
                    std::cmp::Ordering::Greater => _ = below[column].insert(row),
                }
            }
        }
        let symmetric = right == below;
        let given = |sets: &[BTreeSet<usize>]| sets.iter().map(BTreeSet::len).sum::<usize>() as u64;
        let before = given(&right) + if symmetric { 0 } else { given(&below) };
        let (mut ready, mut depths) = (vec![0u64; count], vec![0u64; count]);
        let (mut slots, mut work, mut stored) = (0, 0, 0);
        let mut reciprocals = vec![0u64; count];
        for pivot in 0..count {
            if !pivots[pivot] {
                return None;
            }
            let columns = std::mem::take(&mut right[pivot]);
            let rows = if symmetric { columns.clone() } else { std::mem::take(&mut below[pivot]) };
            reciprocals[pivot] = ready[pivot] + RECIPROCAL;
            slots += RECIPROCAL_SLOTS + PRODUCT_SLOTS * rows.len() as u64;
            stored += columns.len() as u64 + if symmetric { 0 } else { rows.len() as u64 };
            for row in rows.iter().copied() {
                ready[row] = ready[row].max(reciprocals[pivot] + PRODUCT * if columns.len() <= AHEAD { 1 } else { 2 });
                depths[row] = depths[row].max(depths[pivot] + 1);
                for column in columns.iter().copied().filter(|column| !symmetric || *column >= row) {
                    work += 1;
                    match row.cmp(&column) {
                        std::cmp::Ordering::Less => _ = right[row].insert(column),
                        std::cmp::Ordering::Equal => pivots[row] = true,
                        std::cmp::Ordering::Greater => _ = below[column].insert(row),
                    }
                }
            }
            (right[pivot], below[pivot]) = (columns, if symmetric { BTreeSet::new() } else { rows });
        }
        slots += PRODUCT_SLOTS * (work + 2 * stored);
        // Backwards: what is known of later unknowns, then one product each.
        let mut solved: Vec<u64> = reciprocals.iter().map(|ready| ready + PRODUCT).collect();
        for pivot in (0..count).rev() {
            let known = right[pivot].iter().map(|column| solved[*column] + PRODUCT).max().unwrap_or(0);
            solved[pivot] = solved[pivot].max(known);
        }
        let path = solved.into_iter().max().unwrap_or(0);
        let depth = depths.into_iter().max().map_or(0, |depth| depth + 1);
        let words = path + slots / PES;
        Some(Estimate { fill: stored - before, depth, words, work: work + stored + count as u64 })
    }
}

/// First, last, second, last but one and so on.
fn twisted(order: &[usize]) -> Vec<usize> {
    let (mut first, mut last) = (0, order.len());
    let mut found = Vec::with_capacity(order.len());
    while first < last {
        found.push(order[first]);
        first += 1;
        if first < last {
            last -= 1;
            found.push(order[last]);
        }
    }
    found
}

/// What can be reached from a vertex, the nearest first.
fn breadth_first(neighbours: &[BTreeSet<usize>], from: usize, within: &dyn Fn(usize) -> bool) -> Vec<usize> {
    let mut seen = vec![false; neighbours.len()];
    seen[from] = true;
    let mut reached = vec![from];
    let mut next = 0;
    while next < reached.len() {
        for other in neighbours[reached[next]].iter().copied().filter(|other| within(*other)) {
            if !std::mem::replace(&mut seen[other], true) {
                reached.push(other);
            }
        }
        next += 1;
    }
    reached
}

/// Of vertices in the order in which they are reached, the places of those at one distance from the first: the fewest
/// that leave a quarter on both sides, or those in the middle.
fn narrowest(neighbours: &[BTreeSet<usize>], reached: &[usize]) -> (usize, usize) {
    let mut distances = vec![usize::MAX; neighbours.len()];
    distances[reached[0]] = 0;
    for vertex in reached {
        for other in neighbours[*vertex].iter().filter(|other| reached.contains(other)) {
            distances[*other] = distances[*other].min(distances[*vertex] + 1);
        }
    }
    let count = reached.len();
    let level = |at: usize| {
        let distance = distances[reached[at]];
        let begin = reached.partition_point(|vertex| distances[*vertex] < distance);
        (begin, reached.partition_point(|vertex| distances[*vertex] <= distance))
    };
    let levels = (0..count).map(level).filter(|(begin, end)| *begin >= count / 4 && count - end >= count / 4);
    levels.min_by_key(|(begin, end)| (end - begin, begin.abs_diff(count / 2))).unwrap_or_else(|| level(count / 2))
}

/// A vertex that is far from another one.
fn far_end(neighbours: &[BTreeSet<usize>], from: usize, within: &dyn Fn(usize) -> bool) -> usize {
    let last = |from| breadth_first(neighbours, from, within).last().copied().unwrap_or(from);
    last(last(from))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows coupled with their next ones, within a distance.
    fn banded(size: usize, distance: usize) -> Pattern {
        let row = |index: usize| (0..size).filter(|other| other.abs_diff(index) <= distance).collect();
        Pattern::new((0..size).map(row).collect())
    }

    #[test]
    fn every_order_has_each_row_once() {
        for pattern in [banded(1, 0), banded(2, 1), banded(17, 1), banded(20, 3), banded(9, 9), banded(6, 0)] {
            for order in Order::ALL {
                let mut rows = pattern.order(order).unwrap();
                rows.sort_unstable();
                assert_eq!(rows, (0..pattern.size()).collect::<Vec<_>>(), "{order:?}");
            }
        }
    }

    #[test]
    fn a_chain_is_as_deep_as_its_order_says() {
        let chain = banded(31, 1);
        let of = |order| chain.estimate(&chain.order(order).unwrap()).unwrap();
        assert_eq!((of(Order::Natural).depth, of(Order::Natural).fill), (31, 0));
        assert_eq!((of(Order::Twisted).depth, of(Order::Twisted).fill), (16, 0));
        assert_eq!(of(Order::Depth).depth, 5);
        assert!(of(Order::Dissection).depth <= 7, "{:?}", of(Order::Dissection));
        assert!(Order::ALL.iter().all(|order| of(Order::Search).words <= of(*order).words));
    }

    #[test]
    fn a_row_without_a_pivot_waits_for_one() {
        // [[0, 1], [1, 2]]
        let pattern = Pattern::new(vec![BTreeSet::from([1]), BTreeSet::from([0, 1])]);
        assert_eq!(pattern.order(Order::Natural), None);
        assert_eq!(pattern.order(Order::Fill), Some(vec![1, 0]));
        let never = Pattern::new(vec![BTreeSet::from([1]), BTreeSet::from([0])]);
        assert_eq!(never.order(Order::Fill), None);
    }
}
