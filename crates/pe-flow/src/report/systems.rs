//! Pivots and eliminations in the report.

use std::fmt;

use pe_ir::graph;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::elimination::Trial;
use crate::pipeline::Design;

/// A magnitude of a state.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
pub struct Pivot {
    /// The state.
    pub state: String,
    /// The pivot's magnitude, relative to the 1 of the identity.
    pub magnitude: f64,
}

/// How the matrix of linear systems is eliminated.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Elimination {
    /// Name of the matrix.
    pub matrix: String,
    /// Rows.
    pub size: u32,
    /// Whether it is symmetric.
    pub symmetric: bool,
    /// The order.
    pub order: String,
    /// How the triangles are computed: `ahead`, `plain` or `root`.
    #[serde(default)]
    pub scheme: String,
    /// Entries that are not zero all the time.
    pub entries: u32,
    /// Entries that the elimination adds; of a symmetric matrix to one triangle.
    pub fill: u32,
    /// Most pivots that wait for one another.
    pub depth: u32,
    /// Pivots that are numbers.
    pub constant_pivots: u32,
    /// The least magnitude of a pivot over the span in double precision.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smallest_pivot: Option<f64>,
    /// The largest magnitude.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_pivot: Option<f64>,
}

impl fmt::Display for Elimination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Elimination { matrix, size, order, scheme, fill, depth, .. } = self;
        write!(f, "`{matrix}`, {size} rows, order `{order}`, scheme `{scheme}`: depth {depth}, fill {fill}")?;
        match (self.smallest_pivot, self.largest_pivot) {
            (Some(least), Some(largest)) => write!(f, ", pivots {least:.2e} .. {largest:.2e}"),
            _ => Ok(()),
        }
    }
}

/// An order of elimination that was tried.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct EliminationTrial {
    /// The order.
    pub order: String,
    /// The scheme.
    #[serde(default)]
    pub scheme: String,
    /// Cycles per step of a quick mapping.
    pub cycles_per_step: u32,
    /// Word-length error; missing where it was too slow to be run, or refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub word_length: Option<f64>,
    /// Whether it was taken.
    pub taken: bool,
}

/// The matrices of a design.
pub(super) fn eliminations(design: &Design) -> Vec<Elimination> {
    design.graph.eliminations.iter().map(elimination).collect()
}

fn elimination(of: &graph::Elimination) -> Elimination {
    let magnitudes = of.pivots.iter().filter_map(|pivot| match *pivot {
        graph::Pivot::Number(number) => Some((number.abs(), number.abs())),
        graph::Pivot::Varying { range, .. } => {
            let (low, high) = range?;
            let least = if low * high > 0.0 { low.abs().min(high.abs()) } else { 0.0 };
            Some((least, low.abs().max(high.abs())))
        }
    });
    let ends = magnitudes.reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)));
    let constant = of.pivots.iter().filter(|pivot| matches!(pivot, graph::Pivot::Number(_)));
    Elimination {
        matrix: of.name.clone(),
        size: of.size,
        symmetric: of.symmetric,
        order: of.order.clone(),
        scheme: of.scheme.clone(),
        entries: of.entries,
        fill: of.fill,
        depth: of.depth,
        constant_pivots: constant.count() as u32,
        smallest_pivot: ends.map(|(least, _)| least),
        largest_pivot: ends.map(|(_, largest)| largest),
    }
}

/// The orders that were tried for a design.
pub(super) fn trials(design: &Design) -> Vec<EliminationTrial> {
    let trial = |Trial { order, scheme, cycles, word_length, taken, .. }: &Trial| EliminationTrial {
        order: order.name().to_owned(),
        scheme: scheme.name().to_owned(),
        cycles_per_step: *cycles,
        word_length: *word_length,
        taken: *taken,
    };
    design.trials.iter().map(trial).collect()
}
