//! Chains as loops: equations of array elements that differ only in where they are, side by side.
//!
//! A *run* is a number of chains that write slots one after another and read at the same distances from what they
//! write. Runs that follow each other become one where a product more in every lane costs less than another loop: a
//! lane that has no such product gets the coefficient zero. What is in no loop that pays is left over.

use pe_ir::index::{self, at};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use crate::tiles::{self, Chain, Outcome, Term};

/// What a loop costs besides its lanes, in products of lanes.
const LOOP: usize = 200;

/// What a product outside of loops costs, in products of lanes.
const ALONE: usize = 12;

/// What it costs to clear a slot, in numbers of lanes that are loaded or stored.
const CLEARED: usize = 3;

/// Slots that lie together, and where they really are.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub slots: Range<u32>,
    /// What has to be added to a slot in even and in odd steps.
    pub shift: [i64; 2],
    /// The level up to which it keeps its values; none if another row never takes its place.
    pub until: Option<u32>,
}

/// What a loop has to know of slots.
pub(super) struct Memory {
    /// In the order of their slots, without gaps.
    pub rows: Vec<Row>,
    /// Numbers of slots that never change.
    pub constants: Vec<Option<f64>>,
    /// Slots that are one for all lanes: inputs, and what very many chains read.
    pub shared: Vec<bool>,
    /// Free slots within rows: zero at all times.
    pub free: Vec<bool>,
    /// The slot that stands for a missing base.
    pub zero: u32,
}

impl Memory {
    /// The row of a slot.
    pub fn row(&self, slot: u32) -> usize {
        self.rows.partition_point(|row| row.slots.end <= slot)
    }

    /// How far states are moved in odd steps; those of the next step are moved as far back.
    pub fn moved(&self) -> i64 {
        let moved = self.rows.iter().map(|row| row.shift[1] - row.shift[0]);
        moved.into_iter().find(|moved| *moved != 0).unwrap_or(0)
    }

    fn is_free(&self, slot: i64) -> bool {
        usize::try_from(slot).is_ok_and(|slot| self.free.get(slot).copied().unwrap_or(false))
    }
}

/// Where the lanes of a loop read or write.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    /// From a slot on, one after another; the slot may lie outside of its row by lanes whose product is zero. The
    /// second number is the row.
    Row(i64, usize),
    /// A slot of a row.
    Same(u32, usize),
    /// What the lane has written before, by the number of the write.
    Earlier(usize),
}

/// Numbers of the lanes of a loop.
#[derive(Clone, Debug)]
pub(super) enum Factor {
    Value(Place),
    /// None where any number will do.
    Numbers(Vec<Option<f64>>),
}

/// What a write adds to.
#[derive(Clone, Debug)]
pub(super) enum Base {
    None,
    Value(Place),
    Numbers(Vec<Option<f64>>),
}

#[derive(Clone, Debug)]
pub(super) struct Write {
    /// None if only the lane itself reads it.
    pub target: Option<Place>,
    pub base: Base,
    pub shift: i32,
}

/// A sum of products of all lanes, and where it goes.
#[derive(Clone, Debug)]
pub(super) struct Sum {
    pub products: Vec<(Place, Factor)>,
    pub writes: Vec<Write>,
}

/// Sums that each lane computes one after another.
#[derive(Clone, Debug)]
pub(super) struct Loop {
    pub level: u32,
    pub lanes: usize,
    pub sums: Vec<Sum>,
    /// Lanes that write free slots, which have to be zero again behind the loop.
    pub free: Vec<usize>,
}

/// Chains as loops, and those that are left over with their levels.
pub(super) struct Arranged {
    pub loops: Vec<Loop>,
    pub rest: Vec<(u32, usize)>,
    /// Rows whose free slots are read as zeros; states and those of the next step are both or neither.
    pub read_free: BTreeSet<usize>,
}

/// An operand of a lane, from the slot that it writes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Near {
    /// A slot and its row.
    Same(u32, usize),
    /// Row and distance.
    At(usize, i64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum NearBase {
    None,
    Value(Near),
    Constant,
    Earlier(usize),
}

/// What all lanes of a loop have in common.
#[derive(Clone, Debug, PartialEq)]
struct Shape {
    writes: Vec<(Near, NearBase, i32)>,
    values: Vec<(Near, Near)>,
}

/// Chains that write slot after slot.
#[derive(Clone, Debug)]
struct Run {
    lanes: Range<usize>,
    first: u32,
    shape: Shape,
    /// Operands that have a coefficient in some lane.
    operands: BTreeSet<Near>,
    /// Products of all lanes.
    products: usize,
}

impl Run {
    fn in_a_loop(&self) -> usize {
        self.lanes.len() * (self.operands.len() + self.shape.values.len() + self.shape.writes.len()) + LOOP
    }

    fn alone(&self) -> usize {
        (self.products + self.lanes.len() * self.shape.writes.len()) * ALONE
    }

    fn cost(&self) -> usize {
        self.in_a_loop().min(self.alone())
    }

    /// Both as one, if that is possible; lanes between them write free slots.
    fn with(&self, other: &Run, memory: &Memory) -> Option<Run> {
        let apart = at(other.first - self.first);
        if apart != other.lanes.start - self.lanes.start || self.shape != other.shape {
            return None;
        }
        let run = Run {
            lanes: self.lanes.start..other.lanes.end,
            first: self.first,
            shape: self.shape.clone(),
            operands: self.operands.union(&other.operands).copied().collect(),
            products: self.products + other.products,
        };
        run.reads_apart(memory).then_some(run)
    }

    /// Whether no lane reads what a lane writes, not even to multiply it by zero, in this step and the next.
    fn reads_apart(&self, memory: &Memory) -> bool {
        let lanes = self.lanes.len() as i64;
        self.operands.iter().all(|operand| {
            let Near::At(row, _) = *operand else { return true };
            [0, 1].into_iter().all(|step| {
                let start = |near: Near, row: usize| self.start(near) + memory.rows[row].shift[step];
                let read = start(*operand, row);
                self.shape.writes.iter().all(|(target, ..)| match *target {
                    Near::At(row, _) => (start(*target, row) - read).abs() >= lanes,
                    Near::Same(..) => false,
                })
            })
        })
    }

    fn start(&self, near: Near) -> i64 {
        match near {
            Near::Same(slot, _) => i64::from(slot),
            Near::At(_, distance) => i64::from(self.first) + distance,
        }
    }

    fn place(&self, near: Near) -> Place {
        match near {
            Near::Same(slot, row) => Place::Same(slot, row),
            Near::At(row, _) => Place::Row(self.start(near), row),
        }
    }
}

/// Everything that loops are made of.
struct Maker<'a> {
    chains: &'a [Chain],
    terms: &'a [Term<f64>],
    memory: &'a Memory,
}

/// Arranges chains that read only what earlier ones write, or what no chain writes; `levels` has the level of each.
pub(super) fn arrange(chains: &[Chain], terms: &[Term<f64>], levels: &[u32], memory: &Memory) -> Arranged {
    let maker = Maker { chains, terms, memory };
    let mut members: BTreeMap<u32, Vec<(u32, usize)>> = BTreeMap::new();
    for (chain, level) in levels.iter().enumerate() {
        let target = chains[chain].targets().next().expect("a chain writes");
        members.entry(*level).or_default().push((target, chain));
    }
    let mut arranged = Arranged { loops: Vec::new(), rest: Vec::new(), read_free: BTreeSet::new() };
    for (level, mut members) in members {
        members.sort_unstable();
        let mut order: Vec<Option<usize>> = Vec::new();
        for (index, (target, chain)) in members.iter().enumerate() {
            order.push(Some(*chain));
            if let Some((next, _)) = members.get(index + 1).filter(|_| memory.is_free(i64::from(target + 1))) {
                let free = (target + 1..*next).take_while(|slot| memory.is_free(i64::from(*slot))).count();
                order.resize(order.len() + free, None);
            }
        }
        for run in maker.runs(&order, &mut |chain| arranged.rest.push((level, chain))) {
            if run.in_a_loop() < run.alone() {
                let one = maker.in_a_loop(level, &order, &run);
                let read = one.sums[0].products.iter().filter_map(|(operand, factor)| match (operand, factor) {
                    (Place::Row(_, row), Factor::Numbers(numbers)) if numbers.contains(&None) => Some(*row),
                    _ => None,
                });
                arranged.read_free.extend(read);
                arranged.loops.push(one);
            } else {
                arranged.rest.extend(order[run.lanes.clone()].iter().flatten().map(|chain| (level, *chain)));
            }
        }
    }
    arranged.rest.sort_unstable();
    let moved = |row: &usize| memory.rows[*row].shift[0] != memory.rows[*row].shift[1];
    if arranged.read_free.iter().any(moved) {
        arranged.read_free.extend((0..memory.rows.len()).filter(moved));
    }
    arranged
}

impl Maker<'_> {
    fn terms_of(&self, chain: usize) -> &[Term<f64>] {
        let range = &self.chains[chain].terms;
        &self.terms[at(range.start)..range.end as usize]
    }

    fn near(&self, slot: u32, first: u32) -> Near {
        if self.memory.shared[at(slot)] {
            return Near::Same(slot, self.memory.row(slot));
        }
        Near::At(self.memory.row(slot), i64::from(slot) - i64::from(first))
    }

    /// A chain as a run of one lane; none if it cannot be in a loop.
    fn lane(&self, lane: usize, chain: usize) -> Option<Run> {
        let Outcome::Words(write, _) = &self.chains[chain].outcome else { return None };
        let first = write.target;
        let mut shape = Shape { writes: Vec::new(), values: Vec::new() };
        let mut written = Vec::new();
        for write in self.chains[chain].writes() {
            let base = if write.base == self.memory.zero {
                NearBase::None
            } else if let Some(earlier) = written.iter().position(|slot| *slot == write.base) {
                NearBase::Earlier(earlier)
            } else if self.memory.constants[at(write.base)].is_some() {
                NearBase::Constant
            } else {
                NearBase::Value(self.near(write.base, first))
            };
            shape.writes.push((self.near(write.target, first), base, write.shift));
            written.push(write.target);
        }
        let mut operands = BTreeSet::new();
        for term in self.terms_of(chain) {
            let operand = self.near(term.operand, first);
            match term.factor {
                tiles::Factor::Value(slot) => shape.values.push((operand, self.near(slot, first))),
                tiles::Factor::Coefficient(_) if !operands.insert(operand) => return None,
                tiles::Factor::Coefficient(_) => {}
            }
        }
        Some(Run { lanes: lane..lane + 1, first, shape, operands, products: self.terms_of(chain).len() })
    }

    /// Runs of chains in the order of what they write; `left` takes those that can be in none.
    fn runs(&self, order: &[Option<usize>], left: &mut impl FnMut(usize)) -> Vec<Run> {
        let mut runs: Vec<Run> = Vec::new();
        for (lane, chain) in order.iter().enumerate() {
            let Some(chain) = chain else { continue };
            let Some(run) = self.lane(lane, *chain) else {
                left(*chain);
                continue;
            };
            match runs.last().filter(|last| last.operands == run.operands).and_then(|last| last.with(&run, self.memory))
            {
                Some(longer) => *runs.last_mut().expect("there is a last one") = longer,
                None => runs.push(run),
            }
        }
        loop {
            let before = runs.len();
            let mut merged: Vec<Run> = Vec::new();
            for run in runs {
                merged.push(run);
                while let [.., one, other] = &merged[..] {
                    let both = one.with(other, self.memory).filter(|both| both.cost() < one.cost() + other.cost());
                    let Some(both) = both else { break };
                    merged.truncate(merged.len() - 2);
                    merged.push(both);
                }
            }
            runs = merged;
            if runs.len() == before {
                return runs;
            }
        }
    }

    fn in_a_loop(&self, level: u32, order: &[Option<usize>], run: &Run) -> Loop {
        let lanes = &order[run.lanes.clone()];
        let numbers = |operand: &Near| {
            let number = |(lane, chain): (usize, &Option<usize>)| {
                let (first, chain) = (run.first + index::number(lane), (*chain)?);
                let found = self.terms_of(chain).iter().find_map(|term| match term.factor {
                    tiles::Factor::Coefficient(number) if self.near(term.operand, first) == *operand => Some(number),
                    _ => None,
                });
                let reads_zero = match operand {
                    Near::At(_, distance) => self.memory.is_free(i64::from(first) + distance),
                    Near::Same(..) => false,
                };
                found.or(if reads_zero { None } else { Some(0.0) })
            };
            lanes.iter().enumerate().map(number).collect()
        };
        let linear = run.operands.iter().map(|operand| (run.place(*operand), Factor::Numbers(numbers(operand))));
        let values =
            run.shape.values.iter().map(|(operand, factor)| (run.place(*operand), Factor::Value(run.place(*factor))));
        let constant = |position: usize, chain: &Option<usize>| {
            let write = self.chains[(*chain)?].writes().nth(position)?;
            self.memory.constants[at(write.base)]
        };
        let write = |(position, (target, base, shift)): (usize, &(Near, NearBase, i32))| Write {
            target: Some(run.place(*target)),
            base: match base {
                NearBase::None => Base::None,
                NearBase::Value(near) => Base::Value(run.place(*near)),
                NearBase::Earlier(earlier) => Base::Value(Place::Earlier(*earlier)),
                NearBase::Constant => Base::Numbers(lanes.iter().map(|chain| constant(position, chain)).collect()),
            },
            shift: *shift,
        };
        let sum = Sum {
            products: linear.chain(values).collect(),
            writes: run.shape.writes.iter().enumerate().map(write).collect(),
        };
        Loop {
            level,
            lanes: lanes.len(),
            sums: vec![sum],
            free: (0..lanes.len()).filter(|lane| lanes[*lane].is_none()).collect(),
        }
    }
}

impl Loop {
    /// What it costs, in numbers that are loaded and stored.
    fn cost(&self) -> usize {
        let value = |place: &Place| usize::from(matches!(place, Place::Row(..)));
        let varied = |numbers: &Vec<Option<f64>>| usize::from(uniform(numbers).is_none());
        let products = self.sums.iter().flat_map(|sum| &sum.products).map(|(operand, factor)| {
            value(operand)
                + match factor {
                    Factor::Value(place) => value(place),
                    Factor::Numbers(numbers) => varied(numbers),
                }
        });
        let writes = self.sums.iter().flat_map(|sum| &sum.writes).map(|write| {
            1 + match &write.base {
                Base::Value(place) => value(place),
                Base::Numbers(numbers) => varied(numbers),
                Base::None => 0,
            }
        });
        self.lanes * (products.sum::<usize>() + writes.sum::<usize>()) + LOOP + self.free.len() * CLEARED
    }
}

impl Arranged {
    /// What it costs, in numbers that are loaded and stored; `products` gives the number of products of a chain.
    pub fn cost(&self, products: impl Fn(usize) -> usize) -> usize {
        let alone = self.rest.iter().map(|(_, chain)| ALONE * (products(*chain) + 1)).sum::<usize>();
        self.loops.iter().map(Loop::cost).sum::<usize>() + alone
    }
}

/// The number that will do in all lanes.
pub(super) fn uniform(numbers: &[Option<f64>]) -> Option<f64> {
    let mut known = numbers.iter().flatten();
    let first = known.next().copied().unwrap_or(0.0);
    known.all(|number| *number == first).then_some(first)
}
