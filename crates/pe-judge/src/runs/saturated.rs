//! Findings of a fixed-point run that reached the end of a range.

use pe_ir::codes;
use pe_ir::functions::Lookup;
use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;

use super::exact::Exact;

/// Why a run in fixed point and those beside it ended.
pub(super) enum Ended {
    Saturated(Saturated),
    /// Double precision with quantised coefficients met what is not finite.
    Diverged(Vec<Diagnostic>),
    /// The word-length error is larger than anybody wants to know.
    Beyond(Beyond),
}

impl From<Saturated> for Ended {
    fn from(saturated: Saturated) -> Ended {
        Ended::Saturated(saturated)
    }
}

impl From<Vec<Diagnostic>> for Ended {
    fn from(findings: Vec<Diagnostic>) -> Ended {
        Ended::Diverged(findings)
    }
}

/// A word-length error that ended a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beyond {
    /// The error of the worst state so far, relative to its scale.
    pub error: f64,
    /// Seconds of the span that were run.
    pub time: f64,
}

/// A fixed-point run met the end of a range.
pub struct Saturated {
    /// The values that did, in this step.
    pub values: Vec<ValueId>,
    /// The step.
    pub step: u64,
}

/// The finding for a format that is given and too narrow.
pub(super) fn too_narrow(graph: &StepGraph, value: ValueId, what: &str) -> Diagnostic {
    let message = format!("`{}` {what} in the formats that are given", graph.value_name(value));
    let finding = match graph.equation_of(value) {
        Some(equation) => Diagnostic::error(codes::SATURATED, equation.span, message),
        None => Diagnostic::global(codes::SATURATED, message),
    };
    finding.with_help("raise the exponent of its format, or leave the section `fixed` to the compiler")
}

impl Saturated {
    /// The lookup whose argument saturated before all else, if one did: no wider format would help.
    pub fn argument<'a>(&self, graph: &'a StepGraph) -> Option<&'a Lookup> {
        let mut written = graph.chains.iter().flat_map(|chain| chain.writes()).map(|write| write.value);
        let first = written.find(|value| self.values.contains(value))?;
        graph.functions.lookups.iter().find(|lookup| lookup.argument == first)
    }

    /// The finding for a range that no widening makes wide enough.
    pub(super) fn refusal(&self, model: &Model, graph: &StepGraph, exact: &Exact, fixed: &FixedPoint) -> Diagnostic {
        if let Some(lookup) = self.argument(graph) {
            let equation = graph.equation_of(lookup.argument).expect("an equation computes it");
            let (function, (low, high)) = graph.functions.looked_up(*lookup);
            let time = model.time(self.step, 0.0);
            let message = format!(
                "`{}` gets an argument beyond its table at t = {time:.6e} s: `{function}` is tabulated from {low:.6e} to {high:.6e}",
                equation.name
            );
            return Diagnostic::error(codes::SATURATED, equation.span, message)
                .with_help("rounding moves the argument: try more `--storage` bits or a wider `--multiplier`");
        }
        // Of what rounding carries away, the value that it carries furthest beyond its size.
        let noise = exact.noise(model, graph, fixed);
        let times = |(value, largest): &(ValueId, f64)| largest / exact.largest[value.index()];
        let worst = noise.iter().filter(|noisy| graph.equation_of(noisy.0).is_some());
        let (value, largest) = worst.copied().max_by(|a, b| times(a).total_cmp(&times(b))).unwrap_or_else(|| {
            let value = self.values[0];
            (value, exact.largest[value.index()])
        });
        let equation = graph.equation_of(value).expect("an equation computes it");
        let time = model.time(self.step, 0.0);
        let message = format!(
            "`{}` saturates at t = {time:.6e} s, however wide its range: it is at most {:.1e} in double precision, and rounding \
             makes it {largest:.1e} at an LSB of {:.1e}",
            equation.name,
            exact.largest[value.index()],
            libm::scalbn(1.0, fixed.exponents[value.index()])
        );
        Diagnostic::error(codes::SATURATED, equation.span, message)
            .with_help("rounding noise grows with the range that is to hold it: `check` tries wider words and names the one that works")
    }
}
