//! Counts of dependencies between places.
//!
//! A *place* is a PE or, behind the PEs, an external input.

use pe_ir::index::number;

/// Dependencies between a PE and another place, as the PE sees them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Link {
    /// Dependencies through which the other place reads the PE.
    pub(super) out: u32,
    /// Dependencies through which the PE reads the other place.
    pub(super) into: u32,
}

impl Link {
    /// Dependencies in both directions.
    pub(super) fn weight(self) -> u32 {
        self.out + self.into
    }

    /// The sum of two links.
    pub(super) fn plus(self, other: Link) -> Link {
        Link { out: self.out + other.out, into: self.into + other.into }
    }

    /// The difference of two links.
    pub(super) fn minus(self, other: Link) -> Link {
        Link { out: self.out - other.out, into: self.into - other.into }
    }

    /// The same link as the other end sees it.
    pub(super) fn reversed(self) -> Link {
        Link { out: self.into, into: self.out }
    }
}

/// Tables up to this number of entries are stored in full, 8 bytes each; larger ones as sorted rows.
const DENSE_LIMIT: usize = 5 << 20;

/// For every PE and place the link between them.
#[derive(Clone, Debug)]
pub(super) enum Links {
    /// One row of all places per PE.
    Dense { places: usize, links: Vec<Link> },
    /// Per PE the links that exist, sorted by place.
    Sparse(Vec<Vec<(u32, Link)>>),
}

impl Links {
    /// No links.
    pub(super) fn new(pes: usize, places: usize) -> Links {
        if pes * places <= DENSE_LIMIT { Links::dense(pes, places) } else { Links::sparse(pes) }
    }

    /// No links, stored in full.
    pub(super) fn dense(pes: usize, places: usize) -> Links {
        Links::Dense { places, links: vec![Link::default(); pes * places] }
    }

    /// No links, stored as sorted rows.
    pub(super) fn sparse(pes: usize) -> Links {
        Links::Sparse(vec![Vec::new(); pes])
    }

    /// The link between a PE and a place.
    #[inline]
    pub(super) fn get(&self, pe: usize, place: usize) -> Link {
        match self {
            Links::Dense { places, links } => links[pe * places + place],
            Links::Sparse(rows) => {
                let row = &rows[pe];
                row.binary_search_by_key(&number(place), |entry| entry.0).map_or(Link::default(), |at| row[at].1)
            }
        }
    }

    /// Replaces the link between a PE and a place, in the PE's row only.
    pub(super) fn set(&mut self, pe: usize, place: usize, link: Link) {
        match self {
            Links::Dense { places, links } => links[pe * *places + place] = link,
            Links::Sparse(rows) => {
                let row = &mut rows[pe];
                match row.binary_search_by_key(&number(place), |entry| entry.0) {
                    Ok(at) if link.weight() == 0 => drop(row.remove(at)),
                    Ok(at) => row[at].1 = link,
                    Err(_) if link.weight() == 0 => {}
                    Err(at) => row.insert(at, (number(place), link)),
                }
            }
        }
    }
}
