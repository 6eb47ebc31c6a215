//! Proves that no write of an affine step can leave its word, from the integers of the step alone.
//!
//! The number of a value is a sum of three parts, each bounded over all steps of a horizon:
//!
//! 1. what the initial states and the constants make of it: one run in double precision;
//! 2. what the inputs make of it, if they take any word that their ports can take in any step: the sum of the magnitudes
//!    of its responses to an impulse, times the largest operand; one run for each input;
//! 3. what rounding makes of it: of operands and words in the hardware, as inputs of half an LSB, and of double precision
//!    in the two runs. For each value a sum over all sources would take a run per source. A norm in which a step grows by
//!    a factor that is proven bounds what the errors of all steps together can be in the states.
//!
//! The norm is the certificate. Whoever finds it may err: what is proven of it is computed here, with bounds of every
//! rounding, from the words, shifts and coefficients that [`super::program`] holds the program to.

mod cholesky;
mod norm;
mod runs;
mod system;

use crate::graph::{FixedPoint, StepGraph, Term};
use crate::index::{self, ValueId};
use crate::program::{OutputPort, Program};
use crate::word::WordFormat;

pub use norm::{Measured, Norm};

use runs::Responses;
use system::{Row, System, UNIT, up};

/// Entries of the matrix of a step, stages included, at most.
const ENTRIES: usize = 1 << 25;

/// An affine step whose ranges can be proven.
pub struct Step {
    system: System,
    /// The states at the end as sums over those at the start, and the most roundings on the way to one.
    rows: (Vec<Row>, usize),
    full: f64,
    rooms: Vec<f64>,
}

/// Errors of the states that a norm proves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Most by which a step multiplies the norm.
    pub growth: f64,
    /// Most by which rounding moves a state over the horizon, relative to the largest word.
    pub largest: f64,
}

/// Magnitudes that no value exceeds in any step of a span.
#[derive(Clone, Debug, PartialEq)]
pub struct Enclosure {
    /// For each value the largest magnitude of its number, in LSB.
    pub largest: Vec<f64>,
    /// For each value the part of it that rounding can have.
    pub rounding: Vec<f64>,
    /// Whether what fits does so for ever.
    pub lasts: bool,
    /// For each value the largest number whose word is in range: half of full scale where operands may meet.
    rooms: Vec<f64>,
    /// For each value whether it comes from nothing, in this step or an earlier one, that may be out of range: what is
    /// clamped or wraps is no longer affine, and the bounds of what follows from it are none.
    linear: Vec<bool>,
}

impl Enclosure {
    /// Whether no word of a value is out of range.
    pub fn fits(&self, value: ValueId) -> bool {
        self.linear[value.index()] && self.missing(value) == 0
    }

    /// Whether no word of a value leaves the range of an output port that shows it, rounded.
    pub fn shows(&self, value: ValueId, format: &WordFormat) -> bool {
        let rounding = 0.5 * libm::scalbn(1.0, format.guard_bits as i32);
        let full = libm::scalbn(1.0, format.word_bits() as i32 - 1);
        // The sum of two doubles is rounded once.
        self.fits(value) && up(self.largest[value.index()] + rounding, 1) < full
    }

    /// Bits by which the format of a value is too narrow.
    pub fn missing(&self, value: ValueId) -> i32 {
        let (largest, room) = (self.largest[value.index()], self.rooms[value.index()]);
        let ratio = largest / room;
        if largest < room { 0 } else { libm::frexp(ratio.min(1e300)).1.max(1) }
    }
}

impl Step {
    /// `None` if the step is not affine in states and inputs, or its matrix has too many entries.
    pub fn of(graph: &StepGraph, fixed: &FixedPoint) -> Option<Step> {
        let system = System::of(graph, fixed)?;
        let full = system.input;
        let offset = fixed.format.data_offset() as f64;
        let room =
            |half_scale: &bool| (if *half_scale { full / 2.0 } else { full } - 2.0 * offset - 1.0) * (1.0 - 4.0 * UNIT);
        let rows = system.rows(ENTRIES)?;
        Some(Step { full, rooms: fixed.half_scale.iter().map(room).collect(), rows, system })
    }

    /// What is proven of a norm; none if nothing is.
    pub fn measure(&self, norm: Norm) -> Option<Measured> {
        Measured::of(&self.rows, norm)
    }

    /// What rounding can do to the states over so many steps, or for ever; `None` if the norm proves nothing.
    pub fn drift(&self, measured: &Measured, steps: Option<u64>) -> Option<Drift> {
        let drift = self.drift_norm(measured) * measured.sum_of_growth(steps);
        let largest = measured.reach.iter().fold(0.0, |most: f64, reach| most.max(reach * drift)) / self.full;
        largest.is_finite().then_some(Drift { growth: measured.growth, largest })
    }

    /// An upper bound of the norm of what the words round in a step.
    fn drift_norm(&self, measured: &Measured) -> f64 {
        let errors = self.system.errors(&vec![0.0; self.system.states.len()], true, None);
        measured.of_magnitudes(&self.system.at_end(&errors))
    }

    /// Bounds of all values over so many steps.
    pub fn enclose(&self, measured: &Measured, steps: u64) -> Enclosure {
        let responses = Responses::run(&self.system, measured, steps);
        let over_span = self.enclosure(measured, &responses, Some(steps));
        let for_ever = self.enclosure(measured, &responses, None);
        let mut values = (0..self.system.values as u32).map(ValueId::new);
        let lasts = values.all(|value| for_ever.fits(value) || !over_span.fits(value));
        Enclosure { lasts, ..over_span }
    }

    fn enclosure(&self, measured: &Measured, responses: &Responses, steps: Option<u64>) -> Enclosure {
        let system = &self.system;
        let quiet = vec![0.0; system.states.len()];
        let growth = measured.sum_of_growth(steps);
        // What double precision rounded in the runs.
        let of_peaks = system.errors(&quiet, false, Some(&responses.peaks));
        let of_sums = system.errors(&quiet, false, Some(&responses.sums));
        let rounded = measured.of_magnitudes(&system.at_end(&of_peaks))
            + measured.of_sums(&system.at_end(&of_sums))
            + responses.cut * measured.of_sums(&vec![1.0; system.states.len()]);
        let initial: Vec<f64> = system.initial.iter().map(|number| UNIT * number.abs()).collect();
        let before = measured.of_magnitudes(&initial) * measured.power(steps.unwrap_or(0));
        // What the runs left out: the steps behind their ends.
        let rest = match steps {
            Some(steps) if responses.steps >= steps => 0.0,
            Some(steps) => measured.sum_of_growth(Some(steps - responses.steps)),
            None => growth,
        };
        let left_out = if rest == 0.0 { 0.0 } else { rest * measured.of_magnitudes(&responses.last) };
        let noise = self.drift_norm(measured) * growth;
        let of_states = |norm: f64| -> Vec<f64> { measured.reach.iter().map(|reach| up(reach * norm, 8)).collect() };
        let rounding = system.errors(&of_states(noise), true, None);
        let arithmetic = system.errors(&of_states(rounded * growth + left_out + before), false, None);
        let largest = (0..system.values)
            .map(|value| {
                let moved = rounding[value] + arithmetic[value] + of_peaks[value] + of_sums[value];
                up(responses.peaks[value] + moved, responses.steps as usize + 16)
            })
            .collect();
        let rooms = self.rooms.clone();
        let mut enclosure = Enclosure { largest, rounding, lasts: false, rooms, linear: Vec::new() };
        enclosure.linear = system.untouched(|value| enclosure.missing(value) > 0);
        enclosure
    }
}

/// Checks that PEs without saturation write, send and add only what an enclosure proves to be in range. `graph` is the
/// step as it is issued.
pub fn check(program: &Program, graph: &StepGraph, enclosure: &Enclosure) -> Vec<String> {
    let producers = graph.producers();
    let fits = |value: ValueId| value.index() < enclosure.largest.len() && enclosure.fits(value);
    let mut violations = Vec::new();
    for (index, pe) in program.pes.numbered().filter(|(_, pe)| pe.features.proven) {
        for (at, (word, note)) in pe.words.iter().zip(&pe.notes).enumerate() {
            let writes = word.write.is_some() || word.write_index.is_some() || word.send;
            if writes && !note.write.is_some_and(fits) {
                let name = program.name(note.write);
                violations.push(format!("PE {index}, word {at}: nothing proves that `{name}` stays in range"));
            }
            let shown = |output: &&OutputPort| output.proven && (output.pe, output.word) == (index, index::number(at));
            for output in program.outputs.iter().filter(shown) {
                let proven = |value: ValueId| fits(value) && enclosure.shows(value, &program.format);
                if !note.write.is_some_and(proven) {
                    violations.push(format!("output `{}`: nothing proves that it stays in range", output.name));
                }
            }
            if word.own.is_some() && word.imported.is_some() {
                let producer = note.chain.and_then(|value| *producers.get(value.index())?);
                let chain = producer.map(|chain| &graph.chains[chain]);
                let joined = chain.map_or(&[][..], |chain| graph.chain_terms(chain));
                let mut joined = joined.iter().filter(|term| term.partner.is_some()).peekable();
                if joined.peek().is_none() || joined.flat_map(Term::operands).any(|value| !fits(value)) {
                    violations.push(format!("PE {index}, word {at}: nothing proves that a sum of operands fits"));
                }
            }
        }
    }
    let saturates = |output: &&OutputPort| output.proven && program.saturates(output.pe);
    violations.extend(
        program
            .outputs
            .iter()
            .filter(saturates)
            .map(|output| format!("output `{}`: it clamps nothing, but its PE does", output.name)),
    );
    violations
}
