//! The arithmetic of the datasheet against exact integers and against real numbers, written apart from the product.

use crate::support::flow::{FORMATS, Flow, Placement};
use crate::support::{FAMILIES, Family};
use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StepGraph, ValueId, Write};
use pe_ir::index::ChainId;
use pe_ir::model::Solver;
use pe_ir::word::{WordFormat, round_shift};
use pe_sim::fixed::FixedRun;
use pe_sim::machine::output_word;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `numerator / 2^shift`, to the nearest integer, halves up: by division with remainder.
fn nearest(numerator: i128, shift: u32) -> i128 {
    let divisor = 1i128 << shift;
    (2 * numerator + divisor).div_euclid(2 * divisor)
}

fn clamp(word: i128, bits: u32) -> i128 {
    let limit = 1i128 << (bits - 1);
    if word >= limit {
        limit - 1
    } else if word < -limit {
        -limit
    } else {
        word
    }
}

/// What a sum becomes that no word of so many bits holds: the largest but for all but its upper eight bits.
fn saturated(sum: i128, bits: u32) -> i128 {
    let ceiling = 127 << (bits - 8);
    if clamp(sum, bits) < sum { ceiling } else { clamp(sum, bits) }
}

/// Words beyond the width of products plus two take their sums shifted to the left.
fn lift(format: &WordFormat) -> u32 {
    let (word, product) = (format.storage_bits + format.guard_bits, format.data_bits + format.coefficient_bits);
    (word + 2).saturating_sub(product)
}

#[test]
fn words_are_shifted_added_and_clamped_as_the_datasheet_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for format in FORMATS {
        let bits = format.word_bits();
        let half = |dropped: u32| if dropped == 0 { 0 } else { 1i128 << (dropped - 1) };
        for _ in 0..20_000 {
            let word = rng.random::<i64>() >> (64 - bits);
            let sum = rng.random::<i64>() >> rng.random_range(lift(&format)..50);
            let shift = rng.random_range(0..41);
            assert_eq!(i128::from(round_shift(sum, shift)), nearest(i128::from(sum), shift));
            let exact = i128::from(word) + nearest(i128::from(sum) << lift(&format), shift);
            assert_eq!(format.write(word, sum, shift), (saturated(exact, bits) as i64, clamp(exact, bits) != exact));
            assert_eq!(
                i128::from(format.data_operand(word)),
                i128::from(word).div_euclid(1 << (bits - format.data_bits))
            );
            let port = rng.random::<i64>() >> (64 - format.storage_bits);
            let stored = (i128::from(port) << format.guard_bits) + half(bits - format.data_bits);
            let operand = clamp(stored.div_euclid(1 << (bits - format.data_bits)), format.data_bits);
            assert_eq!(i128::from(format.input_operand(port)), operand);
            let shown = (i128::from(word) - half(bits - format.data_bits) + half(format.guard_bits))
                .div_euclid(1 << format.guard_bits);
            assert_eq!(i128::from(output_word(&format, word)), clamp(shown, format.storage_bits));
        }
    }
}

#[test]
fn numbers_are_encoded_to_the_nearest_word() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for format in FORMATS {
        for _ in 0..5_000 {
            let exponent = rng.random_range(-60..20);
            // A number with few bits: its quotient by the LSB is exact in an integer.
            let number = f64::from(rng.random::<i32>()) * 2f64.powi(exponent - 6);
            let exact = nearest((number / 2f64.powi(exponent - 6)) as i128, 6) + i128::from(format.data_offset());
            let (word, saturated) = format.encode(number, exponent, format.data_offset());
            // Halves round away from zero there, up here.
            assert!((i128::from(word) - clamp(exact, format.word_bits())).abs() <= 1);
            assert_eq!(saturated, clamp(exact, format.word_bits()) != exact);
        }
    }
}

/// Words of the values that a chain reads: states as they were before the step.
struct Step<'a> {
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    run: &'a FixedRun<'a>,
    before: &'a [i64],
}

impl Step<'_> {
    fn word(&self, id: ValueId) -> i128 {
        i128::from(match self.graph.value(id).role {
            Role::State(state) => self.before[state.index()],
            _ => self.run.word(id),
        })
    }

    fn number(&self, id: ValueId) -> f64 {
        let offset = self.fixed.offset(self.graph.value(id)) as f64;
        (self.word(id) as f64 - offset) * 2f64.powi(self.fixed.exponents[id.index()])
    }

    /// The stored word that a write must give, in exact integers.
    fn exact(&self, index: ChainId, chain: &Chain, position: usize, write: &Write) -> i128 {
        let format = self.fixed.format;
        let bits = format.word_bits();
        let mut sum = 0i128;
        for term in chain.terms.clone() {
            let second = match self.graph.terms[term as usize].factor {
                Factor::Coefficient(_) => i128::from(self.fixed.coefficients[term as usize]),
                Factor::Value(value) => self.word(value).div_euclid(1 << (bits - format.coefficient_bits)),
            };
            sum +=
                self.word(self.graph.terms[term as usize].operand).div_euclid(1 << (bits - format.data_bits)) * second;
        }
        assert!(sum.unsigned_abs() < 1 << (self.fixed.accumulator_bits[index] - 1), "the accumulator overflows");
        let offset = if bits == format.data_bits { 0 } else { 1i128 << (bits - format.data_bits - 1) };
        let base = write.base.map_or(offset, |base| self.word(base));
        saturated(base + nearest(sum << lift(&format), u32::from(self.fixed.shifts[index][position])), bits)
    }

    /// The number that a write should give without any rounding, and a bound of what rounding can change:
    /// half an LSB of the result, of each data operand times its factor, and the rounding of each coefficient.
    fn real(&self, index: ChainId, chain: &Chain, write: &Write) -> (f64, f64) {
        let format = self.fixed.format;
        let weight = 2f64.powi(write.weight);
        let mut number = write.base.map_or(0.0, |base| self.number(base));
        let mut bound = 0.5 * 2f64.powi(self.fixed.exponents[write.value.index()]);
        for term in chain.terms.clone() {
            let operand = self.graph.terms[term as usize].operand;
            let x = self.number(operand);
            let half_operand = 0.5 * 2f64.powi(self.fixed.exponents[operand.index()] + format.data_drop() as i32);
            let (factor, half_factor) = match self.graph.terms[term as usize].factor {
                Factor::Coefficient(exact) => {
                    let stored = self.fixed.coefficient_value(self.graph, index, term as usize);
                    (exact, (stored - exact).abs())
                }
                Factor::Value(value) => {
                    let drop = format.factor_drop() as i32;
                    (self.number(value), 0.5 * 2f64.powi(self.fixed.exponents[value.index()] + drop))
                }
            };
            number += weight * x * factor;
            bound += weight * (factor.abs() * half_operand + x.abs() * half_factor + half_operand * half_factor);
        }
        (number, bound)
    }
}

#[test]
fn every_value_of_a_run_is_its_chain_in_exact_integers_and_near_it_in_real_numbers() {
    let mut compared = 0u64;
    for family in FAMILIES {
        for solver in Solver::RUNGE_KUTTA {
            for format in FORMATS {
                compared += compare(family, solver, format);
            }
        }
    }
    println!("{compared} values compared");
    assert!(compared > 50_000);
}

fn compare(family: Family, solver: Solver, format: WordFormat) -> u64 {
    let flow = Flow::random(family, (12, 3), solver, format, Placement::Scattered, 3);
    let mut run = FixedRun::new(&flow.graph, &flow.fixed);
    let mut compared = 0;
    for step in 0..20u64 {
        let before: Vec<i64> = flow.graph.states.iter().map(|(state, _)| run.word(*state)).collect();
        let inputs = pe_judge::runs::port_words(&flow.model, &run, step);
        run.step(&inputs);
        let step = Step { graph: &flow.graph, fixed: &flow.fixed, run: &run, before: &before };
        for (index, chain) in flow.graph.chains.numbered() {
            for (position, write) in chain.writes().enumerate() {
                let word = i128::from(run.word(write.value));
                let name = flow.graph.value_name(write.value);
                assert_eq!(word, step.exact(index, chain, position, write), "{} {name}", flow.label);
                let (number, bound) = step.real(index, chain, write);
                let error = (step.number(write.value) - number).abs();
                // Saturated words are far off by design; these models never saturate. The slack is that of f64.
                assert!(error <= bound * 1.001 + 1e-12 * number.abs(), "{} {name}: {error:e} > {bound:e}", flow.label);
                compared += 1;
            }
        }
    }
    compared
}
