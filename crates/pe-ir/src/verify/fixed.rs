//! Checks number formats against their step graph.
//!
//! Invariants:
//!
//! 1. There is a format for every value, coefficient and chain, and the widths are those of hardware that exists.
//! 2. A state has one format at the start and the end of the step, a write the format of its base.
//! 3. The shift of a write is what the exponents of value and products say, and a shifter has it.
//! 4. A coefficient fits its port, and is that of the step graph but for rounding.
//! 5. A product of two values lies on the chain's point.
//! 6. The accumulator holds any sum of the chain, whatever its operands.

use crate::graph::{Factor, FixedPoint, StepGraph};
use crate::index::{ChainId, at};
use crate::word::WordFormat;

/// Furthest that joint rounding moves a coefficient, and the half that nearest rounding does.
const MOVED: f64 = 2.5;

/// Largest right shift of a write.
const LARGEST_SHIFT: i64 = 40;

/// Exponents beyond this are not those of numbers.
const LARGEST_EXPONENT: u32 = 10_000;

/// Why hardware cannot have such widths, if so.
pub fn unsuitable(format: &WordFormat) -> Option<String> {
    let WordFormat { storage_bits, guard_bits, data_bits, coefficient_bits, .. } = *format;
    let ports = [data_bits, coefficient_bits];
    if !(8..=48).contains(&storage_bits) || guard_bits > 48 || storage_bits + guard_bits > 63 {
        return Some("expected 8 to 48 bits of storage, and words of up to 63 bits with guard bits".to_owned());
    }
    if ports.iter().any(|bits| !(4..=35).contains(bits) || *bits > storage_bits + guard_bits) {
        return Some("expected multiplier ports of 4 to 35 bits, and no wider than a word".to_owned());
    }
    None
}

/// Returns what is wrong with formats; empty if nothing is.
pub fn check(graph: &StepGraph, fixed: &FixedPoint) -> Vec<String> {
    let values = graph.values.len();
    let (chains, terms) = (graph.chains.len(), graph.terms.len());
    let of_values = fixed.exponents.len() == values && fixed.half_scale.len() == values;
    let of_chains =
        fixed.products.len() == chains && fixed.shifts.len() == chains && fixed.accumulator_bits.len() == chains;
    if !of_values || !of_chains || fixed.coefficients.len() != terms {
        return vec!["they are not as many as the step's values, chains and terms".to_owned()];
    }
    if let Some(problem) = unsuitable(&fixed.format) {
        return vec![problem];
    }
    let exponents = fixed.exponents.iter().chain(&fixed.products);
    if exponents.clone().any(|exponent| exponent.unsigned_abs() > LARGEST_EXPONENT) {
        return vec![format!("an exponent is beyond {LARGEST_EXPONENT}")];
    }
    let mut violations = Vec::new();
    for (start, end) in &graph.states {
        if fixed.exponents[start.index()] != fixed.exponents[end.index()] {
            violations.push(format!(
                "`{}` and `{}` have two formats",
                graph.value_name(*start),
                graph.value_name(*end)
            ));
        }
    }
    graph.chains.ids().for_each(|chain| check_chain(graph, fixed, chain, &mut violations));
    violations
}

fn check_chain(graph: &StepGraph, fixed: &FixedPoint, index: ChainId, violations: &mut Vec<String>) {
    let (chain, product, format) = (&graph.chains[index], fixed.products[index], &fixed.format);
    let exponent = |id: crate::graph::ValueId| i64::from(fixed.exponents[id.index()]);
    let (word, port) = (i64::from(format.word_bits()), i64::from(format.coefficient_bits));
    let data = i64::from(format.data_bits);
    let name = || graph.value_name(chain.write.value);
    let mut shifts = fixed.shifts[index].into_iter().map(i64::from);
    // Words wider than products have their sums shifted to the left first.
    let left = (word + 2 - data - port).max(0);
    for (write, shift) in chain.writes().zip(&mut shifts) {
        let expected = exponent(write.value) - i64::from(product) - i64::from(write.weight) + left;
        if shift != expected || !(0..=LARGEST_SHIFT + left).contains(&shift) {
            let value = graph.value_name(write.value);
            violations.push(format!("the write of `{value}` is shifted by {shift}; its formats ask for {expected}"));
        }
        if write.base.is_some_and(|base| exponent(base) != exponent(write.value)) {
            violations.push(format!("`{}` and its base have two formats", graph.value_name(write.value)));
        }
    }
    if shifts.any(|shift| shift != 0) {
        violations.push(format!("the chain of `{}` has more shifts than writes", name()));
    }
    let mut bound: i128 = 1;
    for position in chain.terms.clone() {
        let (term, coefficient) = (&graph.terms[at(position)], fixed.coefficients[at(position)]);
        let operand = exponent(term.operand) + word - data;
        if term.partner.is_some_and(|partner| exponent(partner) != exponent(term.operand)) {
            violations.push(format!("a pair in the chain of `{}` has two formats", name()));
        }
        match term.factor {
            Factor::Coefficient(exact) => {
                let scaled = libm::scalbn(exact, (operand - i64::from(product)) as i32);
                let fits = coefficient.unsigned_abs() < 1 << (port - 1);
                if !fits || (coefficient as f64 - scaled).abs() > MOVED {
                    violations.push(format!("{coefficient} in the chain of `{}` does not stand for {exact:e}", name()));
                }
                bound += i128::from(coefficient.unsigned_abs()) << (data - 1);
            }
            Factor::Value(factor) => {
                let point = operand + exponent(factor) + word - port;
                if coefficient != 0 || point != i64::from(product) {
                    violations.push(format!("a product in the chain of `{}` is not on its point", name()));
                }
                bound += 1i128 << (data + port - 2);
            }
        }
    }
    let bits = u32::from(fixed.accumulator_bits[index]);
    if bound.ilog2() + 2 > bits || bits > format.accumulator_limit().min(80) {
        violations.push(format!("an accumulator of {bits} bits does not hold the sums of `{}`", name()));
    }
}
