//! Proof of ranges: which values can never leave their words.

use pe_hls::formats::RANGE_MARGIN;
use pe_hls::norms::Norms;
use pe_ir::graph::{Chain, FixedPoint, Role, StepGraph, Term, ValueId};
use pe_ir::index::List;
use pe_ir::mapping::Mapping;
use pe_ir::program::Program;
use pe_ir::verify::ranges::{Drift, Enclosure, Measured, Norm, Step};

/// Rounding may move a state by so much of the largest word before another norm is asked for.
const SMALL: f64 = 1.0 / 1024.0;

/// What the proof of ranges came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Proof {
    /// Bounds; none of steps that are not affine, or that grow in all norms that were tried.
    pub enclosed: Option<Enclosed>,
    /// Bits by which formats were widened for it, at most.
    pub widened: i32,
    /// Word-length error with the formats as they were before; none if nobody asked, as wider ones have next to none.
    pub word_length: Option<f64>,
}

/// Bounds of all values.
#[derive(Clone, Debug, PartialEq)]
pub struct Enclosed {
    /// The bounds.
    pub enclosure: Enclosure,
    /// What rounding can do, in the norm that the bounds come from.
    pub drift: Drift,
    /// The kind of norm.
    pub norm: &'static str,
}

/// How sure it is that a state stays in range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Certainty {
    /// Proven: no word can be out of range over the span, whatever words the inputs have.
    Proven,
    /// Measured, with the head room that formats have.
    Probable,
    /// Measured, with less.
    Unknown,
}

impl Certainty {
    /// All of them.
    pub const ALL: [Certainty; 3] = [Certainty::Proven, Certainty::Probable, Certainty::Unknown];

    /// The word in reports.
    pub fn name(self) -> &'static str {
        match self {
            Certainty::Proven => "proven",
            Certainty::Probable => "probable",
            Certainty::Unknown => "unknown",
        }
    }
}

/// Bounds for so many steps, in the norm that proves most.
pub fn enclose(graph: &StepGraph, fixed: &FixedPoint, steps: u64) -> Option<Enclosed> {
    let step = Step::of(graph, fixed)?;
    let norms = Norms::of(graph, fixed, steps)?;
    let mut best: Option<(Drift, Measured)> = None;
    let mut consider = |norm: Norm| {
        if let Some(measured) = step.measure(norm)
            && let Some(drift) = step.drift(&measured, Some(steps))
            && best.as_ref().is_none_or(|(known, _)| drift.largest < known.largest)
        {
            best = Some((drift, measured));
        }
        let (is_small, for_ever) =
            best.as_ref().map_or((false, false), |(drift, _)| (drift.largest < SMALL, drift.growth < 1.0));
        (is_small, is_small && for_ever)
    };
    let (mut is_small, mut done) = (false, false);
    for norm in norms.weighted() {
        (is_small, done) = consider(norm);
        if done {
            break;
        }
    }
    // What does not decay has no bounds for ever in any norm.
    if !done && (!is_small || norms.forgets()) {
        norms.whole().map(consider);
    }
    let (drift, measured) = best?;
    let enclosure = step.enclose(&measured, steps);
    let norm = match measured.norm {
        Norm::Largest(_) => "largest",
        Norm::Energy(_) => "energy",
        Norm::Basis(..) => "basis",
    };
    Some(Enclosed { enclosure, drift, norm })
}

impl Proof {
    fn fits(&self, value: ValueId) -> bool {
        self.enclosed.as_ref().is_some_and(|enclosed| enclosed.enclosure.fits(value))
    }

    /// Leaves saturation out of the PEs that cannot need it, and the clamps out of outputs of these PEs that cannot need
    /// them. A PE needs it if one of its chains writes, or adds in front of the multiplier, a value without proof.
    /// `graph` is the step as it is issued.
    pub fn leave_out(&self, program: &mut Program, graph: &StepGraph, mapping: &Mapping) {
        let mut needed = List::filled(self.enclosed.is_none(), program.pes.len());
        for chain in &graph.chains {
            let joined = graph.chain_terms(chain).iter().filter(|term| term.partner.is_some());
            let mut values = chain.writes().map(|write| write.value).chain(joined.flat_map(Term::operands));
            needed[mapping.pe_of[chain.equation]] |= values.any(|value| !self.fits(value));
        }
        program.pes.iter_mut().zip(needed).for_each(|(pe, needed)| pe.features.proven = !needed);
        let Some(Enclosed { enclosure, .. }) = &self.enclosed else { return };
        for (output, value) in program.outputs.iter_mut().zip(&graph.outputs) {
            let proven = program.pes[output.pe].features.proven;
            output.proven = proven && enclosure.shows(*value, &program.format);
        }
    }

    /// How sure the range of each state is, and what it is proven not to exceed. `largest` is the largest magnitude that
    /// each value of the step graph had.
    pub fn states(&self, graph: &StepGraph, fixed: &FixedPoint, largest: &[f64]) -> Vec<(Certainty, Option<f64>)> {
        let mut states = vec![(Certainty::Proven, Some(0.0f64)); graph.states.len()];
        let states_of = graph.chains.iter().flat_map(Chain::writes).map(|write| write.value);
        for value in states_of.chain(graph.states.iter().map(|(start, _)| *start)) {
            let (Role::State(state)
            | Role::Stage(state, _)
            | Role::Sum(state, _)
            | Role::Interim(state, _)
            | Role::Next(state)) = graph.value(value).role
            else {
                continue;
            };
            let limit = fixed.format.max_word() as f64;
            let word = libm::scalbn(largest[value.index()], -fixed.exponents[value.index()]);
            let certainty = match self.fits(value) {
                true => Certainty::Proven,
                false if RANGE_MARGIN * word <= limit => Certainty::Probable,
                false => Certainty::Unknown,
            };
            let bound = self.enclosed.as_ref().filter(|_| certainty == Certainty::Proven).map(|enclosed| {
                libm::scalbn(enclosed.enclosure.largest[value.index()], fixed.exponents[value.index()])
            });
            let slot = &mut states[state.index()];
            *slot = (slot.0.max(certainty), slot.1.zip(bound).map(|(a, b)| a.max(b)));
        }
        states
    }

    /// The most bits by which a format is too narrow for its bound.
    pub fn missing(&self, graph: &StepGraph) -> i32 {
        let Some(enclosed) = &self.enclosed else { return 0 };
        let written = graph.chains.iter().flat_map(Chain::writes).map(|write| write.value);
        written.map(|value| enclosed.enclosure.missing(value)).max().unwrap_or(0)
    }
}
