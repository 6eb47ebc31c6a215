//! Places that apply a function, and which of them share a table.
//!
//! Uses with arguments that are near one another share a range, a table and its number formats. Where arguments are far
//! apart the union of their ranges costs accuracy: results are stored in the format of the largest one, arguments are
//! told apart as finely as the widest range allows, and polynomials need a higher degree. A tree of ranges, divided where
//! most bits are lost, is cut where tables of their own cost less; see `docs/decisions/0068-tables-per-use.md`.

use std::cmp::Ordering;
use std::collections::{BTreeMap, HashMap};

use pe_ir::functions::{ScalarFunction, Segments};
use pe_ir::graph::{Role, StepGraph, ValueId};
use pe_ir::index::{ChainId, EquationId, List, at};

use super::domain::Domain;
use super::fit::Shape;
use super::{Price, WORDS, divide_sampled};
use crate::alike::alike;
use crate::formats::RANGE_MARGIN;

/// Ranges of a function that are looked at one by one, at most; more are rounded until they are so few.
const MOST_CELLS: usize = 256;

/// Divisions of a function's uses, and of those of all functions, at most; places without values come on top.
const MOST_DIVISIONS: usize = 32;
const ALL_DIVISIONS: usize = 256;

/// Bits that a use loses for nothing in a table that it shares, and how much wider the table's range may be, before a
/// division is tried.
const NEAR_BITS: f64 = 1.0;
const NEAR_WIDTH: f64 = 4.0;

/// Another bit that a use loses is worth so many times its products; two bits are worth four times as much.
pub(super) const BIT: f64 = 2.0;

/// Part of the loss that counts for a range that is twice as wide, where uses are divided.
const WIDER: f64 = 0.05;

/// Products of a lookup, as long as none is fitted.
const TYPICAL_PRODUCTS: f64 = 8.0;

/// Points at which a use is sampled.
const SAMPLES: usize = 16;

/// Room of an argument that hardly changes.
const ROOM: f64 = 1e-3;

/// An equation that applies a function, in all stages of the step.
#[derive(Clone, Debug)]
pub(super) struct Use {
    /// The function among those of the step graph.
    pub function: usize,
    pub equation: EquationId,
    /// What it computes with it.
    pub values: Vec<ValueId>,
    /// Least and largest argument.
    pub range: (f64, f64),
}

/// What the values of a use have in common in all stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Quantity {
    Algebraic(u32),
    Pivot(u32),
    Chain(ChainId),
}

/// The uses of functions in a step graph, and for each chain the one that it belongs to. `arguments` are least and
/// largest argument of the function that computes a value, by value.
pub(super) fn uses(graph: &StepGraph, arguments: &[(f64, f64)]) -> (Vec<Use>, List<ChainId, Option<usize>>) {
    let alike = alike(graph);
    let mut known: HashMap<(u32, EquationId, Quantity), usize> = HashMap::new();
    let mut uses: Vec<Use> = Vec::new();
    let mut of_chain = List::filled(None, graph.chains.len());
    for (index, chain) in graph.chains.numbered() {
        let Some(function) = chain.function else { continue };
        let value = chain.write.value;
        let quantity = match graph.value(value).role {
            Role::Algebraic(number, _) => Quantity::Algebraic(number),
            Role::Pivot(state, _) => Quantity::Pivot(state.number()),
            _ => Quantity::Chain(alike[index]),
        };
        let number = *known.entry((function, chain.equation, quantity)).or_insert_with(|| {
            let range = (f64::INFINITY, f64::NEG_INFINITY);
            uses.push(Use { function: at(function), equation: chain.equation, values: Vec::new(), range });
            uses.len() - 1
        });
        let (low, high) = arguments[value.index()];
        let of = &mut uses[number];
        of.range = (of.range.0.min(low), of.range.1.max(high));
        of.values.push(value);
        of_chain[index] = Some(number);
    }
    (uses, of_chain)
}

/// Uses of a function that share a table.
pub(super) struct Cluster<'a> {
    pub domain: Domain<'a>,
    /// Uses, ascending.
    pub uses: Vec<usize>,
    /// Lookups per step.
    pub count: u64,
    /// Mean square of the bits that its uses lose beyond those that are for nothing.
    pub lost: f64,
}

/// The uses that share a table each, by function and range.
///
/// # Errors
/// All uses with a place between their arguments where the function has no value, and that place.
pub(super) fn clusters<'a>(
    functions: &'a [ScalarFunction],
    uses: &[Use],
    price: Price<'a>,
) -> Result<Vec<Cluster<'a>>, Vec<(usize, f64)>> {
    let mut of_function: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (index, of) in uses.iter().enumerate() {
        of_function.entry(of.function).or_default().push(index);
    }
    let format = price.format;
    let most = (ALL_DIVISIONS / of_function.len().max(1)).clamp(1, MOST_DIVISIONS);
    let (mut trees, mut errors) = (Vec::new(), Vec::new());
    for (function, members) in of_function {
        let (cells, is_scaled) = (cells(&functions[function], uses, &members), function >= price.scaled_from);
        let tree = Tree { function: &functions[function], price, cells, is_scaled };
        match tree.grow(most) {
            Ok(nodes) => trees.push((tree.cells, nodes)),
            Err(places) => {
                // A cell may stand for several uses: each is asked for itself.
                let of = |(cell, _): &(usize, f64)| tree.cells[*cell].uses.clone();
                let asked = places.iter().flat_map(of).filter_map(|index| {
                    let place = Domain::of(&functions[function], uses[index].range, format).err()?;
                    Some((index, place))
                });
                let before = errors.len();
                errors.extend(asked);
                if errors.len() == before {
                    errors.extend(places.into_iter().map(|(cell, place)| (tree.cells[cell].uses[0], place)));
                }
            }
        }
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    if trees.iter().any(|(_, nodes)| nodes.len() > 1) {
        prune(&mut trees, price);
    }
    let mut clusters = Vec::new();
    for (cells, mut nodes) in trees {
        let mut taken: Vec<usize> = leaves(&nodes);
        let low = |node: &usize| nodes[*node].range.0;
        taken.sort_by(|a, b| low(a).total_cmp(&low(b)).then(a.cmp(b)));
        for node in taken {
            let Node { cells: members, domain, count, lost, .. } = &mut nodes[node];
            let mut uses: Vec<usize> = members.iter().flat_map(|cell| cells[*cell].uses.iter().copied()).collect();
            uses.sort_unstable();
            let domain = domain.take().expect("a leaf has values");
            clusters.push(Cluster { domain, uses, count: *count, lost: *lost });
        }
    }
    Ok(clusters)
}

/// Uses whose ranges are nearly the same.
struct Cell {
    range: (f64, f64),
    uses: Vec<usize>,
    /// Lookups per step.
    count: u64,
    /// What a format for its results holds.
    scale: f64,
    /// Least and largest magnitude of the slope.
    slopes: (f64, f64),
    /// Largest magnitude of an argument.
    magnitude: f64,
}

impl Cell {
    /// Bits beyond [`NEAR_BITS`] that it loses at some argument in a table for results of such a scale and such
    /// arguments: by rounding of the result, and by what rounding of the argument makes of it.
    fn lost(&self, scale: f64, (low, high): (f64, f64)) -> f64 {
        // An argument that is stored has the format of its own largest value, whatever the table.
        let reach = (high - low).max(self.magnitude);
        let at = |slope: f64| libm::log2((scale + slope * reach) / (self.scale + slope * self.magnitude));
        let lost = at(self.slopes.0).max(at(self.slopes.1));
        if lost.is_finite() { (lost - NEAR_BITS).max(0.0) } else { 0.0 }
    }

    fn width(&self) -> f64 {
        width(self.range)
    }
}

/// The width of a range; an argument that hardly changes has some, too.
fn width((low, high): (f64, f64)) -> f64 {
    let magnitude = low.abs().max(high.abs());
    (high - low).max(ROOM * if magnitude == 0.0 { 1.0 } else { magnitude })
}

/// The ranges of a function's uses, those that are nearly the same only once.
fn cells(function: &ScalarFunction, uses: &[Use], members: &[usize]) -> Vec<Cell> {
    let mut coarse = 0;
    let grouped = loop {
        let mut grouped: BTreeMap<(i32, i64), Vec<usize>> = BTreeMap::new();
        for index in members {
            let (low, high) = uses[*index].range;
            let unit = libm::scalbn(1.0, libm::ilogb(width((low, high))).clamp(-1000, 1000) + coarse - 3);
            let middle = libm::round(0.5 * (low + high) / unit);
            // A middle that is no number is a range of its own.
            grouped.entry((libm::ilogb(unit), middle as i64)).or_default().push(*index);
        }
        if grouped.len() <= MOST_CELLS || coarse > 60 {
            break grouped;
        }
        coarse += 1;
    };
    let cell = |members: Vec<usize>| {
        let ranges = members.iter().map(|index| uses[*index].range);
        let range = ranges.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).expect("a cell has a use");
        let count = members.iter().map(|index| uses[*index].values.len() as u64).sum();
        let (low, step) = (range.0, (range.1 - range.0) / SAMPLES as f64);
        let value = |x: f64| Some(function.evaluate(x)).filter(|value| value.is_finite());
        let points: Vec<(f64, f64)> = (0..=SAMPLES)
            .filter_map(|sample| {
                let x = low + step * sample as f64;
                Some((x, value(x)?))
            })
            .collect();
        let largest = points.iter().fold(0.0f64, |largest, (_, value)| largest.max(value.abs()));
        let scale = libm::exp2(libm::ceil(libm::log2(RANGE_MARGIN * largest)));
        let beside = width(range) / SAMPLES as f64;
        let near = value(low).zip(value(low + beside)).map(|(a, b)| (b - a).abs() / beside);
        let slopes = points.windows(2).map(|two| (two[1].1 - two[0].1).abs() / (two[1].0 - two[0].0));
        let slopes = slopes.chain(near.filter(|_| step == 0.0)).filter(|slope| slope.is_finite());
        let slopes = slopes.fold((f64::INFINITY, 0.0f64), |(least, most), slope| (least.min(slope), most.max(slope)));
        let slopes = (slopes.0.min(slopes.1), slopes.1);
        let magnitude = range.0.abs().max(range.1.abs());
        Cell { range, uses: members, count, scale, slopes, magnitude }
    };
    grouped.into_values().map(cell).collect()
}

/// Ranges that could share a table.
struct Node<'a> {
    /// Cells, ascending.
    cells: Vec<usize>,
    range: (f64, f64),
    count: u64,
    /// The arguments of its table; none if the function has no bounded values between them.
    domain: Option<Domain<'a>>,
    /// Mean square of the bits that its uses lose beyond [`NEAR_BITS`].
    lost: f64,
    /// The two that it is divided into.
    parts: Option<(usize, usize)>,
}

/// The uses of a function as they are divided.
struct Tree<'a> {
    function: &'a ScalarFunction,
    price: Price<'a>,
    cells: Vec<Cell>,
    /// Whether its arguments are scaled anyway.
    is_scaled: bool,
}

/// What a set of cells has in common.
struct Shared {
    range: (f64, f64),
    /// What a format for all results holds.
    scale: f64,
    count: u64,
}

impl<'a> Tree<'a> {
    fn shared(&self, cells: &[usize]) -> Shared {
        let nothing = Shared { range: (f64::INFINITY, f64::NEG_INFINITY), scale: 0.0, count: 0 };
        cells.iter().fold(nothing, |shared, cell| shared.with(&self.cells[*cell]))
    }

    fn node(&self, cells: Vec<usize>) -> (Node<'a>, Option<f64>) {
        let shared = self.shared(&cells);
        let (domain, pole) = match Domain::of(self.function, shared.range, self.price.format) {
            Ok(mut domain) => {
                domain.is_scaled = self.is_scaled;
                if let Some(known) = self.price.known {
                    known.join(&mut domain, self.function, shared.range);
                }
                (Some(domain), None)
            }
            Err(place) => (None, Some(place)),
        };
        let squares = cells.iter().map(|cell| {
            let cell = &self.cells[*cell];
            let lost = cell.lost(shared.scale, shared.range);
            cell.count as f64 * lost * lost
        });
        let lost = squares.sum::<f64>() / shared.count.max(1) as f64;
        (Node { cells, range: shared.range, count: shared.count, domain, lost, parts: None }, pole)
    }

    /// All nodes, the one of all uses first; the error has the cells with a place without a value, and that place.
    fn grow(&self, most: usize) -> Result<Vec<Node<'a>>, Vec<(usize, f64)>> {
        let (first, pole) = self.node((0..self.cells.len()).collect());
        let mut nodes = vec![first];
        let mut errors = Vec::new();
        // Those that are not divided yet, and where they have no value.
        let mut open: Vec<(usize, Option<f64>)> = vec![(0, pole)];
        let mut divisions = 0;
        loop {
            // First what must be divided, then where most is lost.
            let loss = |(node, pole): &(usize, Option<f64>)| match pole {
                Some(_) => f64::INFINITY,
                None => nodes[*node].lost * nodes[*node].count as f64,
            };
            let next = open.iter().enumerate().max_by(|(_, a), (_, b)| loss(a).total_cmp(&loss(b)).then(b.0.cmp(&a.0)));
            let Some((position, (node, pole))) = next.map(|(position, open)| (position, *open)) else { break };
            if pole.is_none() && divisions >= most {
                break;
            }
            open.remove(position);
            let cells = &nodes[node].cells;
            let divided = match pole {
                Some(place) => {
                    let across: Vec<usize> = cells.iter().copied().filter(|cell| self.reaches(*cell, place)).collect();
                    errors.extend(across.iter().map(|cell| (*cell, place)));
                    let rest = cells.iter().copied().filter(|cell| !across.contains(cell));
                    let (below, above): (Vec<usize>, Vec<usize>) =
                        rest.partition(|cell| self.cells[*cell].range.1 < place);
                    if !across.is_empty() {
                        // What is wrong elsewhere is said as well.
                        [below, above].into_iter().filter(|side| !side.is_empty()).for_each(|side| {
                            let (node, pole) = self.node(side);
                            open.extend(pole.map(|pole| (nodes.len(), Some(pole))));
                            nodes.push(node);
                        });
                        continue;
                    }
                    Some((below, above)).filter(|(below, above)| !below.is_empty() && !above.is_empty())
                }
                None => self.divide(cells),
            };
            match (divided, pole) {
                (Some((one, other)), _) => {
                    divisions += usize::from(pole.is_none());
                    nodes[node].parts = Some((nodes.len(), nodes.len() + 1));
                    for cells in [one, other] {
                        let (node, pole) = self.node(cells);
                        open.push((nodes.len(), pole));
                        nodes.push(node);
                    }
                }
                // The place is in the margin of one of them.
                (None, Some(place)) => errors.extend(nodes[node].cells.first().map(|cell| (*cell, place))),
                (None, None) => {}
            }
        }
        if errors.is_empty() { Ok(nodes) } else { Err(errors) }
    }

    /// Whether the arguments of a cell lie on both sides of a place, or so close that its own table has no values there.
    fn reaches(&self, cell: usize, place: f64) -> bool {
        let (low, high) = self.cells[cell].range;
        low <= place && place <= high
    }

    /// The division of cells after which the least is lost, if it is worth to try one.
    fn divide(&self, cells: &[usize]) -> Option<(Vec<usize>, Vec<usize>)> {
        let shared = self.shared(cells);
        let lost = |cell: &usize| self.cells[*cell].lost(shared.scale, shared.range);
        let most = cells.iter().map(lost).fold(0.0, f64::max);
        let narrowest = cells.iter().map(|cell| self.cells[*cell].width()).fold(f64::INFINITY, f64::min);
        if cells.len() < 2 || (most == 0.0 && width(shared.range) <= NEAR_WIDTH * narrowest) {
            return None;
        }
        let keys: [fn(&Cell) -> f64; 3] = [|cell| 0.5 * (cell.range.0 + cell.range.1), Cell::width, |cell| cell.scale];
        let mut best: Option<(f64, Vec<usize>, usize)> = None;
        for key in keys {
            let mut order = cells.to_vec();
            order.sort_by(|a, b| key(&self.cells[*a]).total_cmp(&key(&self.cells[*b])).then(a.cmp(b)));
            for cut in 1..order.len() {
                let loss = self.loss(&order[..cut]) + self.loss(&order[cut..]);
                let less = best.as_ref().is_none_or(|best| loss.total_cmp(&best.0) == Ordering::Less);
                if less {
                    best = Some((loss, order.clone(), cut));
                }
            }
        }
        let (_, order, cut) = best?;
        let sorted = |part: &[usize]| {
            let mut part = part.to_vec();
            part.sort_unstable();
            part
        };
        Some((sorted(&order[..cut]), sorted(&order[cut..])))
    }

    /// What cells lose that share a table.
    fn loss(&self, cells: &[usize]) -> f64 {
        let shared = self.shared(cells);
        let wide = width(shared.range);
        let of = |cell: &usize| {
            let cell = &self.cells[*cell];
            let (lost, wider) = (cell.lost(shared.scale, shared.range), libm::log2(wide / cell.width()));
            cell.count as f64 * (lost * lost + WIDER * wider * wider)
        };
        cells.iter().map(of).sum()
    }
}

impl Shared {
    fn with(self, cell: &Cell) -> Shared {
        let range = (self.range.0.min(cell.range.0), self.range.1.max(cell.range.1));
        Shared { range, scale: self.scale.max(cell.scale), count: self.count + cell.count }
    }
}

/// The nodes of a tree that are not divided, of those that can be reached.
fn leaves(nodes: &[Node]) -> Vec<usize> {
    let (mut found, mut open) = (Vec::new(), vec![0]);
    while let Some(node) = open.pop() {
        match nodes[node].parts {
            Some((one, other)) => open.extend([other, one]),
            None => found.push(node),
        }
    }
    found
}

/// Takes divisions back that cost more than they save, unless they must be; then all of them, if that is no worse.
fn prune(trees: &mut [(Vec<Cell>, Vec<Node>)], price: Price) {
    let all = |pick: fn(&[Node]) -> Vec<usize>, trees: &[(Vec<Cell>, Vec<Node>)]| {
        let mut picked = Vec::new();
        for (tree, (_, nodes)) in trees.iter().enumerate() {
            picked.extend(pick(nodes).into_iter().map(|node| (tree, node)));
        }
        picked
    };
    let division = |picked: &[(usize, usize)], trees: &[(Vec<Cell>, Vec<Node>)]| {
        let of = |(tree, node): &(usize, usize)| {
            let node = &trees[*tree].1[*node];
            Some((node.domain.as_ref()?, node.count))
        };
        divide_sampled(&picked.iter().filter_map(of).collect::<Vec<_>>(), price)
    };
    let segments = division(&all(leaves, trees), trees);
    let lookups: u64 = trees.iter().map(|(_, nodes)| nodes[0].count).sum();
    let per_word = lookups as f64 * TYPICAL_PRODUCTS / WORDS;
    for (_, nodes) in trees.iter_mut().filter(|(_, nodes)| nodes.len() > 1) {
        // Parts come behind what they are parts of.
        let mut costs = vec![0.0; nodes.len()];
        for index in (0..nodes.len()).rev() {
            let own = nodes[index].price(segments, per_word);
            costs[index] = match nodes[index].parts.map(|(one, other)| costs[one] + costs[other]) {
                Some(parts) if parts < own => parts,
                _ => {
                    nodes[index].parts = None;
                    own
                }
            };
        }
    }
    let kept = all(leaves, trees);
    let whole = all(|_| vec![0], trees);
    if whole.iter().any(|(tree, _)| trees[*tree].1[0].domain.is_none()) || kept == whole {
        return;
    }
    let price = |picked: &[(usize, usize)], trees: &[(Vec<Cell>, Vec<Node>)]| {
        let segments = division(picked, trees);
        let of = |(tree, node): &(usize, usize)| {
            let node = &trees[*tree].1[*node];
            node.price(segments, per_word)
        };
        picked.iter().map(of).sum::<f64>()
    };
    if price(&whole, trees) <= price(&kept, trees) {
        trees.iter_mut().for_each(|(_, nodes)| nodes[0].parts = None);
    }
}

impl Node<'_> {
    /// What a table for it costs, in products: those of its lookups, more where bits are lost, and its words.
    fn price(&self, segments: Segments, per_word: f64) -> f64 {
        let Some(domain) = &self.domain else { return f64::INFINITY };
        let shape = Shape::of(domain, segments);
        let words = shape.columns() << segments.index_bits;
        let missed = libm::log2(shape.excess);
        let products = self.count as f64 * shape.products() as f64;
        products * (1.0 + BIT * (self.lost + missed * missed)) + per_word * words as f64
    }
}
