//! A step as tiles: chains of equal shape side by side, so that the inner loops run over lanes and not over terms.
//!
//! What goes in are the chains of a step, in slots of a value memory, each slot written at most once; what comes out is
//! an order of execution that respects all dependencies. Chains that do not depend on each other and are of one shape
//! form a group; a group is cut into tiles of at most [`LANES`] chains, where operands stop lying in a row. A lane's sum
//! is formed term by term in the order of its chain, so that a sum does not depend on how the tiles are cut.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::ops::Range;

/// Most chains of a tile: enough to make the choice of a loop cheap, few enough for the nearest cache.
pub(crate) const LANES: usize = 128;

/// Chains in a row that are worth a tile of their own.
const WORTHWHILE: usize = 16;

/// The second factor of a product.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Factor<C> {
    Coefficient(C),
    /// The value of a slot, as the coefficient port sees it.
    Value(u32),
}

/// A product.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Term<C> {
    pub operand: u32,
    pub factor: Factor<C>,
}

/// A slot written with a base and the chain's sum, shifted by `shift`: what that means is the arithmetic's business.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Write {
    pub target: u32,
    pub base: u32,
    pub shift: i32,
}

/// Where a sum goes.
#[derive(Clone, Debug)]
pub(crate) enum Outcome {
    /// To one or two slots.
    Words(Write, Option<Write>),
    /// As it is to the sums that are kept, at this index.
    Kept(u32),
}

/// A sum of products with its outcome.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    pub terms: Range<u32>,
    /// Index of the kept sum that it starts from; none means zero.
    pub start: Option<u32>,
    pub outcome: Outcome,
    /// Chains that differ in it do not share a tile.
    pub class: u32,
}

impl Chain {
    /// Its writes in order.
    pub fn writes(&self) -> impl Iterator<Item = &Write> {
        let (first, second) = match &self.outcome {
            Outcome::Words(first, second) => (Some(first), second.as_ref()),
            Outcome::Kept(_) => (None, None),
        };
        first.into_iter().chain(second)
    }

    /// Where it goes first: the order of the chains of a group.
    fn target(&self) -> u32 {
        match &self.outcome {
            Outcome::Words(write, _) => write.target,
            Outcome::Kept(index) => *index,
        }
    }
}

/// Slots of the lanes of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Place {
    /// From a slot on, one after another.
    Row(u32),
    /// One slot for all lanes.
    Same(u32),
    /// From this index of [`Tiles::slots`] on, a slot for each lane.
    Each(u32),
}

/// Numbers of the lanes of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shared<T> {
    Same(T),
    /// From this index of the numbers on.
    Each(u32),
}

/// The second factors of the lanes of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Factors<C> {
    Coefficients(Shared<C>),
    Values(Place),
}

/// One product of every lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Products<C> {
    pub operands: Place,
    pub factors: Factors<C>,
}

/// One write of every lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Writes {
    pub targets: Place,
    pub bases: Place,
    pub shifts: Shared<i32>,
}

/// Chains side by side.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    pub lanes: u32,
    /// Tiles of one level do not depend on each other.
    pub level: u32,
    pub class: u32,
    /// Kept sums that the sums start from; none means zero.
    pub starts: Option<Place>,
    pub products: Range<u32>,
    pub writes: Range<u32>,
    /// Where the sums are kept, if they are.
    pub kept: Option<Place>,
}

/// The step.
#[derive(Clone, Debug)]
pub(crate) struct Tiles<C> {
    pub tiles: Vec<Tile>,
    pub products: Vec<Products<C>>,
    pub writes: Vec<Writes>,
    pub slots: Vec<u32>,
    pub coefficients: Vec<C>,
    pub shifts: Vec<i32>,
}

impl<C: Copy + PartialEq> Tiles<C> {
    /// Arranges chains that read only what earlier ones write, or what no chain writes.
    pub fn new(chains: &[Chain], terms: &[Term<C>], slots: usize) -> Tiles<C> {
        let mut tiles = Tiles {
            tiles: Vec::new(),
            products: Vec::new(),
            writes: Vec::new(),
            slots: Vec::new(),
            coefficients: Vec::new(),
            shifts: Vec::new(),
        };
        for (shape, group) in &groups(chains, terms, slots) {
            let mut rest = &group[..];
            while !rest.is_empty() {
                let (tile, others) = rest.split_at(tile_length(rest, terms));
                tiles.push(tile, terms, shape.0);
                rest = others;
            }
        }
        tiles
    }

    fn push(&mut self, lanes: &[&Chain], terms: &[Term<C>], level: u32) {
        let (products, writes) = (self.products.len() as u32, self.writes.len() as u32);
        let first = lanes[0];
        for position in 0..first.terms.len() {
            let term = |chain: &&Chain| terms[chain.terms.start as usize + position];
            let operands = self.place(lanes.iter().map(|chain| term(chain).operand));
            let factors = match term(&first).factor {
                Factor::Value(_) => Factors::Values(self.place(lanes.iter().map(|chain| match term(chain).factor {
                    Factor::Value(slot) => slot,
                    Factor::Coefficient(_) => unreachable!("chains of one group have the same shape"),
                }))),
                Factor::Coefficient(_) => {
                    let coefficients = lanes.iter().filter_map(|chain| match term(chain).factor {
                        Factor::Coefficient(coefficient) => Some(coefficient),
                        Factor::Value(_) => None,
                    });
                    Factors::Coefficients(shared(coefficients, &mut self.coefficients))
                }
            };
            self.products.push(Products { operands, factors });
        }
        for position in 0..first.writes().count() {
            let writes: Vec<&Write> = lanes.iter().filter_map(|chain| chain.writes().nth(position)).collect();
            let targets = self.place(writes.iter().map(|write| write.target));
            let bases = self.place(writes.iter().map(|write| write.base));
            let shifts = shared(writes.iter().map(|write| write.shift), &mut self.shifts);
            self.writes.push(Writes { targets, bases, shifts });
        }
        let starts = first.start.is_some().then(|| self.place(lanes.iter().filter_map(|chain| chain.start)));
        let kept = matches!(first.outcome, Outcome::Kept(_)).then(|| self.place(lanes.iter().map(|c| c.target())));
        self.tiles.push(Tile {
            lanes: lanes.len() as u32,
            level,
            class: first.class,
            starts,
            kept,
            products: products..self.products.len() as u32,
            writes: writes..self.writes.len() as u32,
        });
    }

    fn place(&mut self, slots: impl Iterator<Item = u32> + Clone) -> Place {
        let first = slots.clone().next().expect("a tile has lanes");
        if slots.clone().zip(first..).all(|(slot, next)| slot == next) {
            Place::Row(first)
        } else if slots.clone().all(|slot| slot == first) {
            Place::Same(first)
        } else {
            let start = self.slots.len() as u32;
            self.slots.extend(slots);
            Place::Each(start)
        }
    }
}

impl<C> Tiles<C> {
    /// The slot of a lane.
    #[inline(always)]
    pub fn slot(&self, place: Place, lane: usize) -> usize {
        match place {
            Place::Row(start) => start as usize + lane,
            Place::Same(slot) => slot as usize,
            Place::Each(start) => self.slots[start as usize + lane] as usize,
        }
    }
}

fn shared<T: Copy + PartialEq>(numbers: impl Iterator<Item = T> + Clone, all: &mut Vec<T>) -> Shared<T> {
    let first = numbers.clone().next().expect("a tile has lanes");
    if numbers.clone().all(|number| number == first) {
        return Shared::Same(first);
    }
    let start = all.len() as u32;
    all.extend(numbers);
    Shared::Each(start)
}

/// What chains of a group have in common: level of their dependencies, class, start, number of writes, and the kinds of
/// their products, long chains first.
type Shape = (u32, u32, bool, usize, Reverse<usize>, Vec<bool>);

/// Chains that may run side by side, in the order of what they write.
fn groups<'a, C>(chains: &'a [Chain], terms: &[Term<C>], slots: usize) -> BTreeMap<Shape, Vec<&'a Chain>> {
    let mut level_of = vec![0u32; slots];
    let mut groups: BTreeMap<Shape, Vec<&Chain>> = BTreeMap::new();
    for chain in chains {
        let own = &terms[chain.terms.start as usize..chain.terms.end as usize];
        let operands = own.iter().map(|term| term.operand);
        let factors = own.iter().filter_map(|term| match term.factor {
            Factor::Value(slot) => Some(slot),
            Factor::Coefficient(_) => None,
        });
        let read = operands.chain(factors).chain(chain.writes().map(|write| write.base));
        let level = read.map(|slot| level_of[slot as usize]).max().unwrap_or(0);
        for write in chain.writes() {
            level_of[write.target as usize] = level + 1;
        }
        let kinds = own.iter().map(|term| matches!(term.factor, Factor::Value(_))).collect();
        let writes = chain.writes().count();
        let shape = (level, chain.class, chain.start.is_some(), writes, Reverse(own.len()), kinds);
        groups.entry(shape).or_default().push(chain);
    }
    for group in groups.values_mut() {
        group.sort_by_key(|chain| chain.target());
    }
    groups
}

/// The slots that chains write, in an order in which each tile would write rows.
pub(crate) fn rows<C>(chains: &[Chain], terms: &[Term<C>], slots: usize) -> Vec<u32> {
    let mut order = Vec::new();
    for group in groups(chains, terms, slots).values() {
        for position in 0..2 {
            order.extend(group.iter().filter_map(|chain| chain.writes().nth(position)).map(|write| write.target));
        }
    }
    order
}

/// How many of the chains form the next tile: a tile ends where operands that lay in a row do not any more, if the tile
/// is worthwhile or the next one will be.
fn tile_length<C>(chains: &[&Chain], terms: &[Term<C>]) -> usize {
    let most = chains.len().min(LANES);
    let mut regular = Regular::new(chains[0], terms);
    for lane in 1..most {
        let before = regular.count();
        regular.add(chains[lane - 1], chains[lane], terms);
        if lane > 1 && regular.count() < before {
            let ahead = &chains[lane..chains.len().min(lane + WORTHWHILE)];
            if lane >= WORTHWHILE || (ahead.len() == WORTHWHILE && stays_regular(ahead, terms)) {
                return lane;
            }
        }
    }
    most
}

/// Whether operands that lie in a row in the first two chains do so in all.
fn stays_regular<C>(chains: &[&Chain], terms: &[Term<C>]) -> bool {
    let mut regular = Regular::new(chains[0], terms);
    regular.add(chains[0], chains[1], terms);
    let first = regular.count();
    chains[1..].windows(2).for_each(|pair| regular.add(pair[0], pair[1], terms));
    regular.count() == first
}

/// Which slots of a chain have lain in a row so far.
struct Regular {
    streams: Vec<bool>,
}

impl Regular {
    fn new<C>(chain: &Chain, terms: &[Term<C>]) -> Regular {
        Regular { streams: vec![true; streams(chain, terms).count()] }
    }

    fn add<C>(&mut self, before: &Chain, chain: &Chain, terms: &[Term<C>]) {
        let pairs = streams(before, terms).zip(streams(chain, terms));
        for (regular, (before, slot)) in self.streams.iter_mut().zip(pairs) {
            *regular &= slot == before + 1;
        }
    }

    fn count(&self) -> usize {
        self.streams.iter().filter(|regular| **regular).count()
    }
}

fn streams<'a, C>(chain: &'a Chain, terms: &'a [Term<C>]) -> impl Iterator<Item = u32> + 'a {
    let own = &terms[chain.terms.start as usize..chain.terms.end as usize];
    let factors = own.iter().filter_map(|term| match term.factor {
        Factor::Value(slot) => Some(slot),
        Factor::Coefficient(_) => None,
    });
    let writes = chain.writes().flat_map(|write| [write.target, write.base]);
    own.iter().map(|term| term.operand).chain(factors).chain(writes)
}
