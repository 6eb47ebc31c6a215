//! Formats in which no value can leave its word, where a bit or two make the proof.

use pe_hls::formats::Ranges;
use pe_hls::rounding::Aim;
use pe_ir::graph::{Chain, FixedPoint, StepGraph, ValueId};
use pe_ir::model::Model;
use pe_ir::word::WordFormat;

use crate::criteria::{Criteria, ProofMode};
use crate::proof::{self, Enclosed, Proof};

use super::exact::Exact;
use super::settled::Settled;

/// Formats that are tried: a wider one rounds more, which may ask for another bit.
const TRIES: usize = 5;

/// Most of the room of a word that is spared for what rounding does in wider formats.
const SPARED: f64 = 1.0 / 64.0;

/// Most by which wider formats may multiply the word-length error: what two bits cost where rounding is all of it. An
/// error that is small anyway may grow up to [`HARMLESS`].
pub(super) const ERROR_GROWTH: f64 = 4.0;

/// Word-length error below which wider formats are always worth a proof.
pub(super) const HARMLESS: f64 = 1e-6;

/// What the proof of ranges proposes, before any run in fixed point.
pub struct Proposal {
    /// Ranges by which formats are chosen.
    ranges: Ranges,
    /// The formats, with coefficients as they are rounded at first.
    fixed: FixedPoint,
    enclosed: Option<Enclosed>,
    /// Bits by which formats are wider than measured ranges ask for, at most.
    widened: i32,
    /// The formats of the measured ranges where these are others, with what is proven in them.
    narrow: Option<(FixedPoint, Enclosed)>,
}

impl Exact {
    /// Looks for formats in which all ranges are proven: wider by as many bits as the criteria allow. None if no proof is
    /// asked for, or there are no formats at all.
    pub fn propose(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        criteria: &Criteria,
    ) -> Option<Proposal> {
        if criteria.proof == ProofMode::Off {
            return None;
        }
        let steps = model.steps();
        let mut ranges = self.ranges.clone();
        let mut fixed = self.formats(graph, &ranges, format, Aim::Chain).ok()?;
        let mut narrow = None;
        for _ in 0..TRIES {
            let widened = ranges.widened.iter().copied().max().unwrap_or(0);
            let Some(found) = proof::enclose(graph, &fixed, steps) else { break };
            let missing = most_missing(graph, &found);
            if missing == 0 {
                return Some(Proposal { ranges, fixed, enclosed: Some(found), widened, narrow });
            }
            // Coarser words round more: what fits with less to spare than rounding takes now would be next.
            let full = format.max_word() as f64;
            let rounding = written(graph).map(|value| found.enclosure.rounding[value.index()] / full);
            let spared = rounding.fold(0.0, f64::max).min(SPARED);
            let mut ahead = found.enclosure.clone();
            ahead.largest.iter_mut().for_each(|largest| *largest /= 1.0 - spared);
            for value in written(graph) {
                ranges.widened[value.index()] += ahead.missing(value);
            }
            narrow.get_or_insert((fixed, found));
            if ranges.widened.iter().any(|bits| *bits > criteria.widen) {
                break;
            }
            let Ok(wider) = self.formats(graph, &ranges, format, Aim::Chain) else { break };
            fixed = wider;
        }
        // Not affine, or no formats that prove everything.
        let (fixed, enclosed) = match narrow {
            Some((fixed, found)) => (fixed, Some(found)),
            None => (self.formats(graph, &self.ranges, format, Aim::Chain).ok()?, None),
        };
        Some(Proposal { ranges: self.ranges.clone(), fixed, enclosed, widened: 0, narrow: None })
    }
}

impl Proposal {
    /// Bits by which formats are wider than measured ranges ask for, at most.
    pub(super) fn widened(&self) -> i32 {
        self.widened
    }

    /// Ranges by which formats are chosen.
    pub(super) fn ranges(&self) -> &Ranges {
        &self.ranges
    }

    /// What was proven about the values of a step, in a few words.
    pub fn figure(&self, graph: &StepGraph) -> String {
        let fits = |value: &ValueId| self.enclosed.as_ref().is_some_and(|found| found.enclosure.fits(*value));
        let (proven, all) = (written(graph).filter(fits).count(), written(graph).count());
        match self.widened {
            0 => format!("{proven} of {all} values proven to stay in range"),
            bits => format!("{proven} of {all} values proven to stay in range, with formats up to {bits} bits wider"),
        }
    }

    /// What is proven of formats that were settled on. Their coefficients may have been rounded once more.
    fn enclosed(&self, model: &Model, graph: &StepGraph, fixed: &FixedPoint) -> Option<Enclosed> {
        if *fixed == self.fixed { self.enclosed.clone() } else { proof::enclose(graph, fixed, model.steps()) }
    }

    /// The wider formats with their proof; none if they have it no more.
    pub(super) fn proven(&self, model: &Model, graph: &StepGraph, settled: Settled) -> Option<Settled> {
        let enclosed = self.enclosed(model, graph, settled.fixed())?;
        (most_missing(graph, &enclosed) == 0).then(|| {
            let proof = Proof { enclosed: Some(enclosed), widened: self.widened, word_length: None };
            Settled { proof: Some(proof), ..settled }
        })
    }

    /// The formats of measured ranges, with what is proven of them.
    pub(super) fn as_found(&self, model: &Model, graph: &StepGraph, settled: Settled) -> Settled {
        let enclosed = match &self.narrow {
            Some((fixed, found)) if fixed == settled.fixed() => Some(found.clone()),
            _ => self.enclosed(model, graph, settled.fixed()),
        };
        let proof = Proof { enclosed, widened: 0, word_length: Some(settled.word_length()) };
        Settled { proof: Some(proof), ..settled }
    }
}

impl Settled {
    /// Beside wider formats, the word-length error of those that measured ranges ask for.
    pub(super) fn with_error_before(mut self, word_length: f64) -> Settled {
        if let Some(proof) = &mut self.proof {
            proof.word_length = Some(word_length);
        }
        self
    }
}

/// Values that chains write.
fn written(graph: &StepGraph) -> impl Iterator<Item = ValueId> {
    graph.chains.iter().flat_map(Chain::writes).map(|write| write.value)
}

/// The most bits that a format is too narrow by.
fn most_missing(graph: &StepGraph, enclosed: &Enclosed) -> i32 {
    written(graph).map(|value| enclosed.enclosure.missing(value)).max().unwrap_or(0)
}
