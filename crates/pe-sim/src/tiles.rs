//! A step as tiles: chains of equal shape side by side, so that the inner loops run over lanes and not over terms.
//!
//! What goes in are the chains of a step, in slots of a value memory, each slot written at most once; what comes out is
//! an order of execution that respects all dependencies. Chains that do not depend on each other and are of one shape
//! form a group; a group is cut into tiles of at most [`LANES`] chains, where operands stop lying in a row. A lane's
//! sum is formed term by term in the order of its chain, so that a sum does not depend on how the tiles are cut.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::ops::Range;

use pe_ir::functions::Segments;
use pe_ir::index::{self, at};

/// Most chains of a tile: enough to make the choice of a loop cheap, few enough for the nearest cache.
pub(crate) const LANES: usize = 128;

/// Lanes from which on the choice of a loop is cheap beside what the loop does.
pub(crate) const NARROW: usize = 16;

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
    /// To one, two or three slots, in this order.
    Words(Write, [Option<Write>; 2]),
    /// As it is to the sums that are kept, at this index.
    Kept(u32),
    /// No sum: a slot takes the segment of what the data port sees of another slot.
    Segment { target: u32, argument: u32, octaves: bool },
    /// No sum: a slot takes the word of that slot among some that the segment in a slot tells. The slots stand in
    /// [`Tiles::choices`] from this index on, one for each segment.
    Choice { target: u32, segment: u32, among: u32 },
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
        let (first, others) = match &self.outcome {
            Outcome::Words(first, others) => (Some(first), others.as_slice()),
            Outcome::Kept(_) | Outcome::Segment { .. } | Outcome::Choice { .. } => (None, [].as_slice()),
        };
        first.into_iter().chain(others.iter().flatten())
    }

    /// The slots that it writes, in order.
    pub fn targets(&self) -> impl Iterator<Item = u32> {
        let found = match self.outcome {
            Outcome::Segment { target, .. } | Outcome::Choice { target, .. } => Some(target),
            Outcome::Words(..) | Outcome::Kept(_) => None,
        };
        self.writes().map(|write| write.target).chain(found)
    }

    /// What a lookup reads besides the words that it chooses among.
    pub fn looked_at(&self) -> Option<u32> {
        match self.outcome {
            Outcome::Segment { argument, .. } => Some(argument),
            Outcome::Choice { segment, .. } => Some(segment),
            Outcome::Words(..) | Outcome::Kept(_) => None,
        }
    }

    /// Chains of different kinds do not share a tile.
    fn kind(&self) -> u8 {
        match self.outcome {
            Outcome::Kept(_) => 0,
            Outcome::Words(_, [None, _]) => 1,
            Outcome::Words(_, [Some(_), None]) => 2,
            Outcome::Segment { octaves: false, .. } => 3,
            Outcome::Segment { octaves: true, .. } => 4,
            Outcome::Choice { .. } => 5,
            Outcome::Words(_, [Some(_), Some(_)]) => 6,
        }
    }

    /// Where it goes first: the order of the chains of a group.
    fn target(&self) -> u32 {
        match &self.outcome {
            Outcome::Words(write, _) => write.target,
            Outcome::Kept(index) => *index,
            Outcome::Segment { target, .. } | Outcome::Choice { target, .. } => *target,
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

impl<T: Copy> Shared<T> {
    /// The number of a lane; `all` are the numbers of all tiles.
    #[inline(always)]
    pub fn of(self, lane: usize, all: &[T]) -> T {
        match self {
            Shared::Same(number) => number,
            Shared::Each(start) => all[at(start) + lane],
        }
    }
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

/// A lookup of every lane, in the place of sums.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Lookups {
    /// The segments of arguments.
    Segments { targets: Place, arguments: Place, octaves: bool },
    /// The words of chosen slots: the first of each lane's in [`Tiles::choices`].
    Choices { targets: Place, segments: Place, among: Shared<u32> },
}

/// Chains side by side.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    pub lanes: u32,
    pub class: u32,
    /// Kept sums that the sums start from; none means zero.
    pub starts: Option<Place>,
    pub products: Range<u32>,
    pub writes: Range<u32>,
    /// Where the sums are kept, if they are.
    pub kept: Option<Place>,
    /// What is done in the place of sums, if the tile is one of lookups.
    pub lookups: Option<Lookups>,
}

/// What lookups choose among.
#[derive(Clone, Debug, Default)]
pub(crate) struct Columns {
    /// How arguments become segments.
    pub segments: Segments,
    /// Slots, as many for each choice as there are segments.
    pub choices: Vec<u32>,
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
    pub columns: Columns,
    /// First choice of each lane.
    pub firsts: Vec<u32>,
}

impl<C: Copy + PartialEq> Tiles<C> {
    /// Arranges chains that read only what earlier ones write, or what no chain writes.
    pub fn new(chains: &[Chain], terms: &[Term<C>], slots: usize, columns: Columns) -> Tiles<C> {
        let mut tiles = Tiles {
            tiles: Vec::new(),
            products: Vec::new(),
            writes: Vec::new(),
            slots: Vec::new(),
            coefficients: Vec::new(),
            shifts: Vec::new(),
            columns,
            firsts: Vec::new(),
        };
        for group in groups(chains, terms, slots, &tiles.columns).values() {
            let mut rest = &group[..];
            while !rest.is_empty() {
                let (tile, others) = rest.split_at(tile_length(rest, terms));
                tiles.push(tile, terms);
                rest = others;
            }
        }
        tiles
    }

    fn push(&mut self, lanes: &[&Chain], terms: &[Term<C>]) {
        let (products, writes) = (index::number(self.products.len()), index::number(self.writes.len()));
        let first = lanes[0];
        for position in 0..first.terms.len() {
            let term = |chain: &&Chain| terms[at(chain.terms.start) + position];
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
        let lookups = self.lookups(lanes);
        self.tiles.push(Tile {
            lanes: index::number(lanes.len()),
            class: first.class,
            starts,
            kept,
            lookups,
            products: products..self.products.len() as u32,
            writes: writes..self.writes.len() as u32,
        });
    }

    fn lookups(&mut self, lanes: &[&Chain]) -> Option<Lookups> {
        let looked_at =
            self.place(lanes.iter().map(|chain| chain.looked_at()).collect::<Option<Vec<u32>>>()?.into_iter());
        let targets = self.place(lanes.iter().map(|chain| chain.target()));
        if let Outcome::Segment { octaves, .. } = lanes[0].outcome {
            return Some(Lookups::Segments { targets, arguments: looked_at, octaves });
        }
        let among = lanes.iter().filter_map(|chain| match chain.outcome {
            Outcome::Choice { among, .. } => Some(among),
            _ => None,
        });
        let among = shared(among, &mut self.firsts);
        Some(Lookups::Choices { targets, segments: looked_at, among })
    }

    fn place(&mut self, slots: impl Iterator<Item = u32> + Clone) -> Place {
        let first = slots.clone().next().expect("a tile has lanes");
        if slots.clone().zip(first..).all(|(slot, next)| slot == next) {
            Place::Row(first)
        } else if slots.clone().all(|slot| slot == first) {
            Place::Same(first)
        } else {
            let start = index::number(self.slots.len());
            self.slots.extend(slots);
            Place::Each(start)
        }
    }
}

impl<C> Tiles<C> {
    /// The slot that a lane chooses in a segment.
    pub fn choice(&self, among: Shared<u32>, lane: usize, segment: usize) -> usize {
        at(self.columns.choices[at(among.of(lane, &self.firsts)) + segment])
    }

    /// The slot of a lane.
    #[inline(always)]
    pub fn slot(&self, place: Place, lane: usize) -> usize {
        match place {
            Place::Row(start) => at(start) + lane,
            Place::Same(slot) => at(slot),
            Place::Each(start) => at(self.slots[at(start) + lane]),
        }
    }
}

fn shared<T: Copy + PartialEq>(numbers: impl Iterator<Item = T> + Clone, all: &mut Vec<T>) -> Shared<T> {
    let first = numbers.clone().next().expect("a tile has lanes");
    if numbers.clone().all(|number| number == first) {
        return Shared::Same(first);
    }
    let start = index::number(all.len());
    all.extend(numbers);
    Shared::Each(start)
}

/// What chains of a group have in common: level of their dependencies, class, start, kind, and the kinds of their
/// products, long chains first.
type Shape = (u32, u32, bool, u8, Reverse<usize>, Vec<bool>);

/// For each chain how many others have to run before it, one after another.
pub(crate) fn levels<C>(chains: &[Chain], terms: &[Term<C>], slots: usize, columns: &Columns) -> Vec<u32> {
    let mut level_of = vec![0u32; slots];
    let mut level = |chain: &Chain| {
        let own = &terms[at(chain.terms.start)..chain.terms.end as usize];
        let operands = own.iter().map(|term| term.operand);
        let factors = own.iter().filter_map(|term| match term.factor {
            Factor::Value(slot) => Some(slot),
            Factor::Coefficient(_) => None,
        });
        let among = match chain.outcome {
            Outcome::Choice { among, .. } => &columns.choices[at(among)..][..columns.segments.count()],
            _ => &[],
        };
        let read = operands.chain(factors).chain(chain.writes().map(|write| write.base));
        let read = read.chain(chain.looked_at()).chain(among.iter().copied());
        let level = read.map(|slot| level_of[at(slot)]).max().unwrap_or(0);
        for target in chain.targets() {
            level_of[at(target)] = level + 1;
        }
        level
    };
    chains.iter().map(&mut level).collect()
}

/// Chains that may run side by side, in the order of what they write.
fn groups<'a, C>(
    chains: &'a [Chain],
    terms: &[Term<C>],
    slots: usize,
    columns: &Columns,
) -> BTreeMap<Shape, Vec<&'a Chain>> {
    let mut groups: BTreeMap<Shape, Vec<&Chain>> = BTreeMap::new();
    for (chain, level) in chains.iter().zip(levels(chains, terms, slots, columns)) {
        let own = &terms[at(chain.terms.start)..chain.terms.end as usize];
        let kinds = own.iter().map(|term| matches!(term.factor, Factor::Value(_))).collect();
        let shape = (level, chain.class, chain.start.is_some(), chain.kind(), Reverse(own.len()), kinds);
        groups.entry(shape).or_default().push(chain);
    }
    for group in groups.values_mut() {
        group.sort_by_key(|chain| chain.target());
    }
    groups
}

/// The slots that chains write, in an order in which each tile would write rows.
pub(crate) fn rows<C>(chains: &[Chain], terms: &[Term<C>], slots: usize, columns: &Columns) -> Vec<u32> {
    let mut order = Vec::new();
    for group in groups(chains, terms, slots, columns).values() {
        for position in 0..3 {
            order.extend(group.iter().filter_map(|chain| chain.targets().nth(position)));
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
    let own = &terms[at(chain.terms.start)..chain.terms.end as usize];
    let factors = own.iter().filter_map(|term| match term.factor {
        Factor::Value(slot) => Some(slot),
        Factor::Coefficient(_) => None,
    });
    let writes = chain.writes().flat_map(|write| [write.target, write.base]);
    let lookup = chain.looked_at().into_iter().flat_map(|slot| [chain.target(), slot]);
    own.iter().map(|term| term.operand).chain(factors).chain(writes).chain(lookup)
}
