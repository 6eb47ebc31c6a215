//! Quotients whose divisors leave few bits of their words: when, how many, and what would give more.
//!
//! A reciprocal falls as its argument grows, and what it is multiplied by grows with it: the product keeps its size, and
//! takes over the relative error of the reciprocal. That error has two parts, half a bit of the result's format and what
//! half a bit of the argument makes of the result. Results that only add to larger ones may be small without harm, so
//! other functions are not looked at.

use std::collections::BTreeMap;

use pe_hls::formats::RANGE_MARGIN;
use pe_hls::step::{Order, Scheme, StepOptions, build_with};
use pe_ir::codes;

use pe_ir::functions::ScalarFunction;
use pe_ir::graph::{Chain, Factor, StepGraph};
use pe_ir::index::{EquationId, at};
use pe_ir::model::{Expr, Function};
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;

use super::question::Question;
use super::trials::affordable;

/// Part of the bits of a data port that a quotient keeps at all times, or it is told.
const PART: f64 = 0.625;

/// Findings, at most; the worst come first.
const MOST: usize = 4;

/// Bits of the widest data port.
const WIDEST: f64 = 35.0;

/// A time at which a use has few bits.
struct Low {
    kept: f64,
    time: f64,
    argument: f64,
    result: f64,
}

/// Warnings about quotients, the worst first.
pub(super) fn findings(question: &Question) -> Vec<Diagnostic> {
    let Question { model, graph, format, .. } = question;
    if graph.functions.tables.is_empty() {
        return Vec::new();
    }
    // Pivots are those of the order and the scheme in which the step was built.
    let elimination = graph.eliminations.first();
    let order = elimination.and_then(|elimination| Order::named(&elimination.order)).unwrap_or_default();
    let scheme = elimination.and_then(|elimination| Scheme::named(&elimination.scheme)).unwrap_or_default();
    let options = StepOptions { form: Some(graph.form), order, scheme, ..StepOptions::default() };
    let Ok(exact) = build_with(model, &options) else { return Vec::new() };
    let steps = model.steps().min(affordable(exact.macs()));
    let mut run = DoubleRun::new(&exact);
    if (0..steps).any(|step| run.step(&model.sample_inputs(model.time(step, 0.0))).is_err()) {
        return Vec::new();
    }
    let (ranges, largest) = (run.arguments(), run.largest());
    let uses = exact.chains.iter().filter_map(|chain| Use::of(&exact, graph, chain, (&ranges, &largest)));
    let uses: Vec<Use> = uses.collect();
    let bits = f64::from(format.data_bits);
    let mut worst: BTreeMap<EquationId, (usize, Low)> = BTreeMap::new();
    let mut run = DoubleRun::new(&exact);
    for step in 0..steps {
        let time = model.time(step, 0.0);
        if run.step(&model.sample_inputs(time)).is_err() {
            break;
        }
        for (index, of) in uses.iter().enumerate() {
            let (argument, result) = (of.argument(&exact, &run), run.value(of.chain.write.value.index()));
            let kept = bits - of.shared.lost(of.function, argument, result);
            if kept < PART * bits && worst.get(&of.chain.equation).is_none_or(|(_, low)| kept < low.kept) {
                worst.insert(of.chain.equation, (index, Low { kept, time, argument, result }));
            }
        }
    }
    let mut worst: Vec<(usize, Low)> = worst.into_values().collect();
    worst.sort_by(|a, b| a.1.kept.total_cmp(&b.1.kept).then(a.0.cmp(&b.0)));
    worst.iter().take(MOST).map(|(index, low)| uses[*index].finding(&exact, low, bits)).collect()
}

/// Formats of argument and result.
#[derive(Clone, Copy)]
struct Formats {
    /// What the format of the result holds; zero if it is stored nowhere.
    scale: f64,
    /// What the last bit of the argument is a part of.
    reach: f64,
}

/// An equation that applies a reciprocal or a negative power.
struct Use<'a> {
    chain: &'a Chain,
    function: &'a ScalarFunction,
    /// Arguments over the run.
    range: (f64, f64),
    /// With the table that it has, and with one of its own.
    shared: Formats,
    own: Formats,
}

impl<'a> Use<'a> {
    fn of(
        exact: &'a StepGraph,
        graph: &StepGraph,
        chain: &'a Chain,
        (ranges, largest): (&[(f64, f64)], &[f64]),
    ) -> Option<Use<'a>> {
        let function = &exact.functions.exact[at(chain.function?)];
        match &function.body {
            Expr::Apply(Function::Reciprocal, _) => {}
            Expr::Apply(Function::RealPower(exponent), _) if *exponent < 0.0 => {}
            _ => return None,
        }
        let range = ranges[chain.write.value.index()];
        // The argument is stored, in formats of its own, before it is mapped to that of the table.
        let stored = exact.chain_terms(chain).iter().map(|term| match term.factor {
            Factor::Coefficient(coefficient) => coefficient.abs() * scale(largest[term.operand.index()]),
            Factor::Value(_) => 0.0,
        });
        let stored = libm::scalbn(stored.sum(), chain.write.weight);
        // Of what only quotients are computed nothing is stored that has few bits.
        let role = exact.value(chain.write.value).role;
        let is_stored = graph.chains.iter().any(|chain| graph.value(chain.write.value).role == role);
        let formats = |(low, high): (f64, f64)| {
            let most = function.evaluate(low).abs().max(function.evaluate(high).abs());
            Formats { scale: if is_stored { scale(most) } else { 0.0 }, reach: stored.max(high - low) }
        };
        // Its table is the narrowest one that covers its arguments.
        let covered = graph.functions.tables.iter().filter_map(|table| table.covers(&function.name));
        let tables = covered.filter(|(low, high)| *low <= range.0 && range.1 <= *high);
        let width = |(low, high): &(f64, f64)| high - low;
        let table = tables.min_by(|a, b| width(a).total_cmp(&width(b))).unwrap_or(range);
        Some(Use { chain, function, range, shared: formats(table), own: formats(range) })
    }

    /// The argument in the latest step.
    fn argument(&self, exact: &StepGraph, run: &DoubleRun) -> f64 {
        let products = exact.chain_terms(self.chain).iter().map(|term| match term.factor {
            Factor::Coefficient(coefficient) => coefficient * run.value(term.operand.index()),
            Factor::Value(factor) => run.value(factor.index()) * run.value(term.operand.index()),
        });
        let base = self.chain.write.base.map_or(0.0, |base| run.value(base.index()));
        base + libm::scalbn(products.sum::<f64>(), self.chain.write.weight)
    }

    fn finding(&self, exact: &StepGraph, low: &Low, bits: f64) -> Diagnostic {
        let Low { kept, time, argument, result } = *low;
        let equation = &exact.equations[self.chain.equation];
        let message = format!(
            "`{}` loses {:.0} of {bits:.0} bits at t = {time:.6e} s: `{}` is {result:.2e} there, for x = {argument:.4e}, in formats for \
             x of {:.2e} to {:.2e}",
            equation.name,
            bits - kept,
            self.function.name,
            self.range.0,
            self.range.1
        );
        let alone = bits - self.own.lost(self.function, argument, result);
        let wide = WIDEST - (bits - kept);
        let estimate =
            format!("as estimated, a table of its own keeps {alone:.0} bits, `--multiplier 35x35` {wide:.0}");
        let help = if wide >= PART * bits {
            format!("take `--multiplier 35x35`; {estimate}")
        } else {
            format!(
                "scale the divisor, so that it changes less, or eliminate in another order or with other `--factors`; {estimate}"
            )
        };
        Diagnostic::error(codes::QUOTIENT_SHORT, equation.span, message).with_help(help).into_warning()
    }
}

impl Formats {
    /// Bits of a word that are lost at an argument: by rounding of the result, and by what that of the argument makes of
    /// it.
    fn lost(self, function: &ScalarFunction, argument: f64, result: f64) -> f64 {
        let beside = argument * (1.0 + 1e-6);
        let slope = ((function.evaluate(beside) - function.evaluate(argument)) / (beside - argument)).abs();
        let lost = libm::log2((self.scale + slope * self.reach) / result.abs());
        if lost.is_finite() { lost.max(0.0) } else { 0.0 }
    }
}

/// What a format for such values holds.
fn scale(largest: f64) -> f64 {
    libm::exp2(libm::ceil(libm::log2(RANGE_MARGIN * largest)))
}
