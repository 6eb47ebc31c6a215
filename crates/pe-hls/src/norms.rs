//! Norms in which the step of an affine model may not grow.
//!
//! What comes out is a guess: [`pe_ir::verify::ranges`] proves what it is worth. Weights count in LSB of the states.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use pe_ir::graph::{Factor, FixedPoint, StepGraph, ValueId};
use pe_ir::index::{self, StateId};
use pe_ir::verify::ranges::Norm;

/// States up to which a norm is made for the model as a whole: the work grows with the third power.
const DENSE: usize = 256;

/// Entries of the matrix of a step, stages included, at most.
const ENTRIES: usize = 1 << 25;

/// Rounds of the iteration for the weights of the largest magnitude.
const ROUNDS: usize = 100;

/// Products that a look at how states decay may take, and the part of them that is little.
const FORGETTING: u64 = 20_000_000;
const FORGOTTEN: f64 = 0.5;

/// The smallest weight relative to the largest.
const SMALLEST: f64 = 1e-6;

/// Norms of the states of a step.
pub struct Norms {
    matrix: Matrix,
    /// Weights in units that all states share.
    alike: Vec<f64>,
    steps: u64,
}

impl Norms {
    /// Norms for so many steps; none if the step is not affine.
    pub fn of(graph: &StepGraph, fixed: &FixedPoint, steps: u64) -> Option<Norms> {
        let matrix = matrix(graph, fixed).filter(|matrix| !matrix.is_empty())?;
        let exponent = |(start, _): &(ValueId, ValueId)| fixed.exponents[start.index()];
        let coarsest = graph.states.iter().map(exponent).max().unwrap_or(0);
        let alike = graph.states.iter().map(|state| libm::scalbn(1.0, coarsest - exponent(state))).collect();
        Some(Norms { matrix, alike, steps })
    }

    /// Those that weigh states one by one, which cost little.
    pub fn weighted(&self) -> impl Iterator<Item = Norm> {
        // In units that all states share, what flows and mixes keeps between its least and its largest.
        let makers: [fn(&Norms) -> Norm; 3] = [
            |norms| Norm::Largest(largest(&norms.matrix, &norms.alike)),
            |norms| Norm::Energy(energy(&norms.matrix)),
            |norms| Norm::Largest(norms.alike.clone()),
        ];
        makers.into_iter().map(|make| make(self))
    }

    /// That of the model as a whole; none of a large one.
    pub fn whole(&self) -> Option<Norm> {
        if self.matrix.len() > DENSE { None } else { basis(&self.matrix, self.steps) }
    }

    /// Whether states forget where they were over the steps, as far as a run from one place shows.
    pub fn forgets(&self) -> bool {
        let size =
            |states: &[f64]| states.iter().zip(&self.alike).map(|(number, weight)| (number / weight).abs()).sum();
        let sign = |index: usize| if (index * index / 2).is_multiple_of(2) { 1.0 } else { -1.0 };
        let mut states: Vec<f64> = self.alike.iter().enumerate().map(|(index, weight)| sign(index) * weight).collect();
        let start: f64 = size(&states);
        for _ in 0..self.steps.min(FORGETTING / self.matrix.iter().map(Vec::len).sum::<usize>().max(1) as u64) {
            let of_row = |row: &Vec<(u32, f64)>| row.iter().map(|(of, number)| number * states[index::at(*of)]).sum();
            states = self.matrix.iter().map(of_row).collect();
        }
        size(&states) < FORGOTTEN * start
    }
}

type Matrix = Vec<Vec<(u32, f64)>>;

/// The states at the end of a step as sums over those at its start, in LSB.
fn matrix(graph: &StepGraph, fixed: &FixedPoint) -> Option<Matrix> {
    let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); graph.values.len()];
    for (state, (start, _)) in (0..).zip(&graph.states) {
        rows[start.index()] = vec![(state, 1.0)];
    }
    let mut entries = 0;
    for chain in &graph.chains {
        let mut sum: Vec<(u32, f64)> = Vec::new();
        for term in graph.chain_terms(chain) {
            let Factor::Coefficient(coefficient) = term.factor else { return None };
            for operand in term.operands() {
                sum.extend(rows[operand.index()].iter().map(|(state, number)| (*state, coefficient * number)));
            }
        }
        for write in chain.writes() {
            let weight = libm::scalbn(1.0, write.weight);
            let mut row: Vec<(u32, f64)> = sum.iter().map(|(state, number)| (*state, weight * number)).collect();
            row.extend(write.base.iter().flat_map(|base| &rows[base.index()]));
            row.sort_by_key(|(state, _)| *state);
            row.dedup_by(|next, kept| {
                let same = next.0 == kept.0;
                kept.1 += if same { next.1 } else { 0.0 };
                same
            });
            entries += row.len();
            rows[write.value.index()] = row;
        }
        if entries > ENTRIES || chain.function.is_some() {
            return None;
        }
    }
    let exponent = |state: StateId| fixed.exponents[graph.states[state].0.index()];
    let scaled = |(state, (_, end)): (usize, &(ValueId, ValueId))| {
        let entry = |(of, number): &(u32, f64)| {
            (*of, libm::scalbn(*number, exponent(StateId::new(*of)) - exponent(StateId::at(state))))
        };
        rows[end.index()].iter().map(entry).collect()
    };
    Some(graph.states.iter().enumerate().map(scaled).collect())
}

/// Weights that a step maps to multiples of themselves, as far as that goes, if no contributions cancel.
fn largest(matrix: &Matrix, start: &[f64]) -> Vec<f64> {
    let mut weights = start.to_vec();
    for _ in 0..ROUNDS {
        let of_row =
            |row: &Vec<(u32, f64)>| row.iter().map(|(of, number)| number.abs() * weights[index::at(*of)]).sum();
        let mapped: Vec<f64> = matrix.iter().map(of_row).collect();
        // The mean with what it was keeps weights from taking turns.
        let mixed: Vec<f64> = mapped.iter().zip(&weights).map(|(mapped, weight)| mapped + weight).collect();
        let most = mixed.iter().fold(0.0, |most: f64, weight| most.max(*weight));
        if !most.is_normal() {
            break;
        }
        weights = mixed.iter().map(|weight| (weight / most).max(SMALLEST)).collect();
    }
    weights
}

/// How strongly two states act on one another.
#[derive(PartialEq)]
struct Coupling {
    strength: f64,
    from: u32,
    to: u32,
}

impl Eq for Coupling {}

impl Ord for Coupling {
    fn cmp(&self, other: &Self) -> Ordering {
        let ends = |coupling: &Coupling| (coupling.from, coupling.to);
        self.strength.total_cmp(&other.strength).then_with(|| ends(other).cmp(&ends(self)))
    }
}

impl PartialOrd for Coupling {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Weights that make the two entries between states alike, along the tree of the strongest couplings: in models of
/// energy flowing between storages these weigh each by its energy.
fn energy(matrix: &Matrix) -> Vec<f64> {
    let entry = |row: u32, column: u32| {
        let row = &matrix[index::at(row)];
        row.binary_search_by_key(&column, |(of, _)| *of).map_or(0.0, |at| row[at].1)
    };
    let mut logarithms = vec![f64::NAN; matrix.len()];
    let mut queue = BinaryHeap::new();
    for root in 0..matrix.len() as u32 {
        if !logarithms[index::at(root)].is_nan() {
            continue;
        }
        logarithms[index::at(root)] = 0.0;
        let mut reached = root;
        loop {
            for (to, there) in &matrix[index::at(reached)] {
                let back = entry(*to, reached);
                if *to != reached && logarithms[index::at(*to)].is_nan() && *there != 0.0 && back != 0.0 {
                    queue.push(Coupling { strength: (there * back).abs(), from: reached, to: *to });
                }
            }
            while queue.peek().is_some_and(|next| !logarithms[index::at(next.to)].is_nan()) {
                queue.pop();
            }
            let Some(Coupling { from, to, .. }) = queue.pop() else { break };
            let ratio = (entry(to, from) / entry(from, to)).abs();
            logarithms[index::at(to)] = logarithms[index::at(from)] + 0.5 * libm::log2(ratio);
            reached = to;
        }
    }
    // Far from one another in magnitude they would help no one.
    logarithms.iter().map(|logarithm| libm::exp2(logarithm.clamp(-500.0, 500.0))).collect()
}

/// The sum of squares over so many steps in which each state counts as it is: it can hardly grow.
fn basis(matrix: &Matrix, steps: u64) -> Option<Norm> {
    let n = matrix.len();
    // What does not decay is held by a forgetting as slow as the run is long.
    let kept = 1.0 / (1.0 + 1.0 / steps as f64);
    let mut power = Square::zero(n);
    for (row, entries) in matrix.iter().enumerate() {
        entries.iter().for_each(|(column, number)| power.0[row][index::at(*column)] = kept * number);
    }
    let mut sum = Square::zero(n);
    (0..n).for_each(|state| sum.0[state][state] = 1.0);
    for _ in 0..steps.ilog2() + 6 {
        let added = power.transposed().times(&sum).times(&power);
        let (more, all) = (added.largest(), sum.largest());
        if !more.is_finite() || more <= 1e-12 * all {
            break;
        }
        sum.0.iter_mut().flatten().zip(added.0.iter().flatten()).for_each(|(sum, added)| *sum += added);
        power = power.times(&power);
    }
    // Of the sum `R'R`, the basis is the inverse of `R`.
    let lower = sum.root()?;
    Some(Norm::Basis(lower.inverse_of_lower().transposed().0, lower.transposed().0))
}

/// A square matrix by rows. Its products are always summed in the same order, on any processor.
struct Square(Vec<Vec<f64>>);

impl Square {
    fn zero(n: usize) -> Square {
        Square(vec![vec![0.0; n]; n])
    }

    fn transposed(&self) -> Square {
        let n = self.0.len();
        Square((0..n).map(|column| self.0.iter().map(|row| row[column]).collect()).collect())
    }

    fn largest(&self) -> f64 {
        self.0
            .iter()
            .flatten()
            .fold(0.0, |most: f64, number| if number.is_nan() { f64::NAN } else { most.max(number.abs()) })
    }

    fn times(&self, other: &Square) -> Square {
        let mut result = Square::zero(self.0.len());
        for (row, sums) in self.0.iter().zip(&mut result.0) {
            for (factor, other) in row.iter().zip(&other.0).filter(|(factor, _)| **factor != 0.0) {
                sums.iter_mut().zip(other).for_each(|(sum, number)| *sum += factor * number);
            }
        }
        result
    }

    /// The lower triangular matrix whose product with its transpose this is (Cholesky).
    fn root(mut self) -> Option<Square> {
        for row in 0..self.0.len() {
            for column in 0..=row {
                let known: f64 = (0..column).map(|k| self.0[row][k] * self.0[column][k]).sum();
                let rest = self.0[row][column] - known;
                self.0[row][column] = match row == column {
                    true if rest > 0.0 => libm::sqrt(rest),
                    true => return None,
                    false => rest / self.0[column][column],
                };
            }
            self.0[row][row + 1..].fill(0.0);
        }
        Some(self)
    }

    /// The inverse of a lower triangular matrix.
    fn inverse_of_lower(&self) -> Square {
        let n = self.0.len();
        let mut inverse = Square::zero(n);
        for row in 0..n {
            let pivot = self.0[row][row];
            let (above, this) = inverse.0.split_at_mut(row);
            for (factor, other) in self.0[row].iter().zip(above.iter()) {
                this[0].iter_mut().zip(other).for_each(|(sum, number)| *sum -= factor * number);
            }
            this[0][row] = 1.0;
            this[0].iter_mut().for_each(|number| *number /= pivot);
        }
        inverse
    }
}
