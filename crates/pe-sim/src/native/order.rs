//! Where array elements lie in memory: as declared, with free slots at the edges of grids, or so that the children of a
//! tree's nodes lie in rows.

use std::collections::BTreeMap;

use pe_ir::graph::{Role, StepGraph, ValueId};
use pe_ir::index::{self, at};
use pe_ir::model::{Model, Variable};

use crate::slots::{InRow, NEXT};

/// Places of states, algebraic variables and equations among those of their kind.
pub(super) struct Order {
    states: Vec<u32>,
    algebraics: Vec<u32>,
    equations: Vec<u32>,
    /// For each value the state that it is at the end of the step, if it is one.
    next: BTreeMap<ValueId, u32>,
    /// Free slots before and behind each row of array elements.
    pub edge: u32,
}

impl Order {
    /// As the spec declares them.
    pub fn declared(graph: &StepGraph) -> Order {
        Order::new(graph, &|_| 0, (0, &|_| None))
    }

    /// With the elements of a tree level by level, in each all first children, then all second ones and so on, each in
    /// the order of their parents: what the nodes of a level read of their children then lies in rows. None if no
    /// arrays of the model form a tree.
    pub fn of_tree(model: &Model, graph: &StepGraph) -> Option<Order> {
        let elements = Elements::of(model);
        let ranks = elements.tree()?;
        Some(Order::new(graph, &|name| elements.number(name).map_or(0, |element| ranks[element]), (0, &|_| None)))
    }

    /// With a free slot behind each line of a grid, a free line behind each layer, and free layers around all: what an
    /// element at the edge reads beyond it is zero then, and no case of its own. None if the model has no array of several dimensions, or if too
    /// much memory were free.
    pub fn of_grid(graph: &StepGraph) -> Option<Order> {
        let grids = grids(graph);
        let padded = |name: &str| {
            let (array, subscripts) = split(name);
            Some(grids.get(array)?.place(&numbers(subscripts)?))
        };
        let edge = grids.values().map(|grid| grid.strides().0[0]).max()?;
        Some(Order::new(graph, &|_| 0, (edge, &padded)))
    }

    fn new(
        graph: &StepGraph,
        rank: &impl Fn(&str) -> u32,
        (edge, padded): (u32, &impl Fn(&str) -> Option<u32>),
    ) -> Order {
        let places = |names: &mut dyn Iterator<Item = &str>| {
            let mut arrays: BTreeMap<&str, u32> = BTreeMap::new();
            let mut keys = Vec::new();
            for (index, name) in names.enumerate() {
                let count = index::number(arrays.len());
                let array = *arrays.entry(split(name).0).or_insert(count);
                keys.push((array, padded(name).unwrap_or(0), rank(name), index, padded(name).is_some()));
            }
            keys.sort_unstable();
            let mut places = vec![0; keys.len()];
            let (mut next, mut start, mut before) = (edge, edge, None);
            for (array, place, _, index, is_padded) in keys {
                if before.replace(array) != Some(array) {
                    start = next;
                }
                places[index] = if is_padded { start + place } else { next };
                next = places[index] + 1;
            }
            places
        };
        Order {
            states: places(&mut graph.names.states.iter().map(String::as_str)),
            algebraics: places(&mut graph.names.algebraics.iter().map(String::as_str)),
            equations: places(&mut graph.equations.iter().map(|equation| equation.name.as_str())),
            next: (0..)
                .zip(&graph.states)
                .filter(|(_, (_, next))| !matches!(graph.value(*next).role, Role::State(_)))
                .map(|(state, (_, next))| (*next, state))
                .collect(),
            edge,
        }
    }

    /// The row of a value and its place there, and whether that is exact.
    pub fn row(&self, graph: &StepGraph, value: ValueId, (kind, stage, member): InRow) -> (InRow, bool) {
        if let Some(state) = self.next.get(&value) {
            return ((NEXT, 0, self.states[at(*state)]), true);
        }
        let place = match graph.value(value).role {
            Role::State(_) | Role::Stage(..) | Role::Sum(..) | Role::Interim(..) | Role::Next(_) => {
                self.states[at(member)]
            }
            Role::Algebraic(..) => self.algebraics[at(member)],
            Role::Inner(..) | Role::Partial(..) => self.equations[at(member)],
            _ => return ((kind, stage, member), false),
        };
        ((kind, stage, place), true)
    }
}

/// A name as array and subscripts.
fn split(name: &str) -> (&str, &str) {
    name.split_at(name.find('[').unwrap_or(name.len()))
}

fn numbers(subscripts: &str) -> Option<Vec<u32>> {
    let inner = subscripts.strip_prefix('[')?.strip_suffix(']')?;
    inner.split(',').map(|number| number.trim().parse().ok()).collect()
}

/// An array of two or more dimensions.
struct Grid {
    /// For each dimension the least and the largest subscript.
    bounds: Vec<(u32, u32)>,
    elements: u32,
}

impl Grid {
    /// Slots from one element to the next in each dimension, and slots of the whole.
    fn strides(&self) -> (Vec<u32>, u32) {
        let mut strides = vec![1; self.bounds.len()];
        let mut stride = 1;
        for (dimension, (least, largest)) in self.bounds.iter().enumerate().rev() {
            strides[dimension] = stride;
            let extent = largest - least + 1;
            let free = if dimension == 0 { 0 } else { 1 };
            // Lines begin where vectors do if that takes little.
            let wide = (extent + free).next_multiple_of(VECTOR);
            let aligned = stride == 1 && wide * LITTLE <= (extent + free) * (LITTLE + 1);
            stride *= if aligned { wide } else { extent + free };
        }
        (strides, stride)
    }

    fn place(&self, subscripts: &[u32]) -> u32 {
        let parts = subscripts.iter().zip(&self.bounds).zip(self.strides().0);
        parts.map(|((subscript, (least, _)), stride)| (subscript - least) * stride).sum()
    }
}

/// Numbers of a vector, in double precision.
const VECTOR: u32 = 8;

/// One in so many slots is little.
const LITTLE: u32 = 8;

/// Slots for an element of a grid, at most, in hundredths.
const MOST_FREE: u64 = 140;

/// Arrays of states that are grids.
fn grids(graph: &StepGraph) -> BTreeMap<&str, Grid> {
    let mut grids: BTreeMap<&str, Grid> = BTreeMap::new();
    for name in &graph.names.states {
        let (array, subscripts) = split(name);
        let Some(numbers) = numbers(subscripts).filter(|numbers| numbers.len() > 1) else { continue };
        let bounds = || numbers.iter().map(|number| (*number, *number)).collect();
        let grid = grids.entry(array).or_insert_with(|| Grid { bounds: bounds(), elements: 0 });
        grid.elements += 1;
        for (bounds, number) in grid.bounds.iter_mut().zip(&numbers) {
            *bounds = (bounds.0.min(*number), bounds.1.max(*number));
        }
    }
    grids.retain(|_, grid| u64::from(grid.strides().1) * 100 <= u64::from(grid.elements) * MOST_FREE);
    grids
}

/// Subscripts of the model's arrays, and who reads whom.
struct Elements<'a> {
    numbers: BTreeMap<&'a str, usize>,
    /// For arrays of reader and read: pairs of reading and read element.
    reads: BTreeMap<(&'a str, &'a str), Vec<(usize, usize)>>,
}

impl<'a> Elements<'a> {
    fn of(model: &'a Model) -> Elements<'a> {
        let mut elements = Elements { numbers: BTreeMap::new(), reads: BTreeMap::new() };
        let states = model.states.iter().map(|state| (state.name.as_str(), &state.derivative));
        let equations = states.chain(model.algebraics.iter().map(|equation| (equation.name.as_str(), &equation.expr)));
        for (name, _) in equations.clone() {
            let (_, subscripts) = split(name);
            let next = elements.numbers.len();
            if !subscripts.is_empty() {
                elements.numbers.entry(subscripts).or_insert(next);
            }
        }
        for (name, right) in equations {
            let Some(reader) = elements.number(name) else { continue };
            right.each_variable(&mut |variable| {
                let read = match variable {
                    Variable::State(state) => model.states[state].name.as_str(),
                    Variable::Algebraic(algebraic) => model.algebraics[at(algebraic)].name.as_str(),
                    _ => return,
                };
                let arrays = (split(name).0, split(read).0);
                if let Some(element) = elements.number(read).filter(|element| *element != reader) {
                    elements.reads.entry(arrays).or_default().push((reader, element));
                }
            });
        }
        elements
    }

    fn number(&self, name: &str) -> Option<usize> {
        self.numbers.get(split(name).1).copied()
    }

    /// For each element its rank in the order of the largest tree: arrays of which each element is read by one other
    /// element at most, and some element reads two.
    fn tree(&self) -> Option<Vec<u32>> {
        let trees = self.reads.values().filter_map(|pairs| Tree::new(self.numbers.len(), pairs));
        trees.max_by_key(|tree| tree.nodes).map(|tree| tree.ranks())
    }
}

/// Who is whose child.
struct Tree {
    children: Vec<Vec<usize>>,
    is_child: Vec<bool>,
    nodes: usize,
}

impl Tree {
    fn new(elements: usize, pairs: &[(usize, usize)]) -> Option<Tree> {
        let mut tree = Tree { children: vec![Vec::new(); elements], is_child: vec![false; elements], nodes: 0 };
        for (parent, child) in pairs {
            if tree.children[*parent].contains(child) {
                continue;
            }
            if std::mem::replace(&mut tree.is_child[*child], true) {
                return None;
            }
            tree.children[*parent].push(*child);
            tree.nodes += 1;
        }
        let branches = tree.children.iter().any(|children| children.len() > 1);
        // Elements on a cycle are nobody's descendants.
        (branches && tree.levels().iter().map(Vec::len).sum::<usize>() == elements).then_some(tree)
    }

    /// Elements level by level.
    fn levels(&self) -> Vec<Vec<usize>> {
        let mut levels = vec![(0..self.children.len()).filter(|element| !self.is_child[*element]).collect::<Vec<_>>()];
        while let Some(level) = levels.last().filter(|level| !level.is_empty()) {
            let most = level.iter().map(|parent| self.children[*parent].len()).max().unwrap_or(0);
            let child =
                |number: usize| level.iter().filter_map(move |parent| self.children[*parent].get(number).copied());
            levels.push((0..most).flat_map(child).collect());
        }
        levels
    }

    fn ranks(&self) -> Vec<u32> {
        let mut ranks = vec![0; self.children.len()];
        for (rank, element) in (0..).zip(self.levels().into_iter().flatten()) {
            ranks[element] = rank;
        }
        ranks
    }
}
