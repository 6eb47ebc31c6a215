//! Rounds coefficients so that the errors of a chain cancel where the model moves.
//!
//! With a narrow coefficient port the rounding of coefficients is nearly all of the word-length error. What counts is
//! not each coefficient's error but their sum over a chain, `sum_i delta_i x_i(t)`. Where large terms nearly cancel
//! (a pressure difference that drives a flow, a diffusion stencil) independent roundings leave an error that the
//! difference amplifies. So the roundings of a chain are chosen together: least squares over sampled operands, a
//! closest-vector search by coordinate descent from the nearest roundings. No coefficient moves by more than
//! [`REACH`] units, so the gain outside the samples' directions is bounded.

use pe_ir::graph::{Factor, FixedPoint, StepGraph};

/// Largest distance of a rounded coefficient from the exact one, in units of the product point.
pub const REACH: i64 = 2;

/// Chains with more terms keep nearest rounding: their moments would take memory without need.
pub const MAX_TERMS: usize = 24;

/// Second moments of the operands of every chain: sums of `x_i x_j` over samples.
#[derive(Clone, Debug)]
pub struct Moments {
    /// Start of each chain's lower triangle.
    offsets: Vec<u32>,
    sums: Vec<f64>,
}

impl Moments {
    /// No samples yet.
    pub fn new(graph: &StepGraph) -> Moments {
        let mut offsets = Vec::with_capacity(graph.chains.len() + 1);
        let mut total = 0u32;
        for chain in &graph.chains {
            offsets.push(total);
            let n = chain.len() as usize;
            if n <= MAX_TERMS {
                total += (n * (n + 1) / 2) as u32;
            }
        }
        offsets.push(total);
        Moments { offsets, sums: vec![0.0; total as usize] }
    }

    /// Adds a sample: `operand` gives the current number of a value.
    pub fn add(&mut self, graph: &StepGraph, operand: impl Fn(usize) -> f64) {
        for (chain, offset) in graph.chains.iter().zip(&self.offsets) {
            if chain.terms.len() > MAX_TERMS {
                continue;
            }
            let terms = graph.chain_terms(chain);
            let mut slot = *offset as usize;
            for (i, a) in terms.iter().enumerate() {
                let x = operand(a.operand.index());
                for b in &terms[..=i] {
                    self.sums[slot] += x * operand(b.operand.index());
                    slot += 1;
                }
            }
        }
    }

    /// Moment of two terms of a chain, by position.
    fn of(&self, chain: usize, i: usize, j: usize) -> f64 {
        let (i, j) = (i.max(j), i.min(j));
        self.sums[self.offsets[chain] as usize + i * (i + 1) / 2 + j]
    }
}

/// Improves the roundings of all chains in place.
pub fn improve(graph: &StepGraph, fixed: &mut FixedPoint, moments: &Moments) {
    for chain in 0..graph.chains.len() {
        if graph.chains[chain].terms.len() <= MAX_TERMS {
            improve_chain(graph, fixed, moments, chain);
        }
    }
}

fn improve_chain(graph: &StepGraph, fixed: &mut FixedPoint, moments: &Moments, chain: usize) {
    let start = graph.chains[chain].terms.start as usize;
    // Coefficients: positions, exact coefficient in units of the product point, weight of a unit.
    let mut terms: Vec<(Vec<usize>, f64, f64)> = Vec::new();
    // Terms that may be paired.
    let mut free: Vec<(Vec<usize>, f64, f64)> = Vec::new();
    for (position, term) in graph.chain_terms(&graph.chains[chain]).iter().enumerate() {
        if let Factor::Coefficient(coefficient) = term.factor {
            let operand = fixed.exponents[term.operand.index()] + fixed.format.data_drop() as i32;
            let exact = libm::scalbn(coefficient, operand - fixed.products[chain]);
            // One unit changes the coefficient by 2^(product - operand).
            let unit = libm::scalbn(1.0, fixed.products[chain] - operand);
            let headroom = fixed.headroom[term.operand.index()];
            match free.iter_mut().find(|class| headroom && (class.1, class.2) == (exact, unit)) {
                Some(class) => class.0.push(position),
                None if headroom => free.push((vec![position], exact, unit)),
                None => terms.push((vec![position], exact, unit)),
            }
        }
    }
    // Two operands that are paired have one coefficient, and any two of a class may be paired.
    terms.extend(free);
    let limit = (1i64 << (fixed.format.coefficient_bits - 1)) - 1;
    let gram = |i: usize, j: usize| {
        let pairs = terms[i].0.iter().flat_map(|a| terms[j].0.iter().map(move |b| (*a, *b)));
        pairs.map(|(a, b)| moments.of(chain, a, b)).sum::<f64>() * terms[i].2 * terms[j].2
    };
    let n = terms.len();
    let gram: Vec<f64> = (0..n * n).map(|k| gram(k / n, k % n)).collect();
    let mut rounded: Vec<i64> = terms.iter().map(|(positions, ..)| fixed.coefficients[start + positions[0]]).collect();
    let mut error: Vec<f64> = rounded.iter().zip(&terms).map(|(r, t)| *r as f64 - t.1).collect();
    // Gradient of the squared sum with respect to each error, halved.
    let mut slope: Vec<f64> = (0..n).map(|i| (0..n).map(|j| gram[i * n + j] * error[j]).sum()).collect();
    let allowed = |rounded: i64, error: f64| error.abs() <= REACH as f64 && rounded.abs() <= limit;
    loop {
        let mut best: Option<(f64, usize, i64, usize, i64)> = None;
        let mut offer = |gain: f64, i: usize, di: i64, j: usize, dj: i64| {
            if gain > best.map_or(0.0, |best| best.0) {
                best = Some((gain, i, di, j, dj));
            }
        };
        for i in 0..n {
            for di in [-1i64, 1] {
                if !allowed(rounded[i] + di, error[i] + di as f64) {
                    continue;
                }
                let single = -(2.0 * di as f64 * slope[i] + gram[i * n + i]);
                offer(single, i, di, i, 0);
                for j in 0..i {
                    for dj in [-1i64, 1] {
                        if allowed(rounded[j] + dj, error[j] + dj as f64) {
                            let alone = -(2.0 * dj as f64 * slope[j] + gram[j * n + j]);
                            let cross = -2.0 * (di * dj) as f64 * gram[i * n + j];
                            offer(single + alone + cross, i, di, j, dj);
                        }
                    }
                }
            }
        }
        // Gains below the rounding of the sums themselves would make the descent turn in circles.
        let scale: f64 = (0..n).map(|i| gram[i * n + i]).sum();
        match best {
            Some((gain, i, di, j, dj)) if gain > 1e-12 * scale => {
                for (k, d) in [(i, di), (j, dj)] {
                    rounded[k] += d;
                    error[k] += d as f64;
                    for (m, slope) in slope.iter_mut().enumerate() {
                        *slope += gram[m * n + k] * d as f64;
                    }
                }
            }
            _ => break,
        }
    }
    for (value, (positions, ..)) in rounded.into_iter().zip(&terms) {
        positions.iter().for_each(|position| fixed.coefficients[start + position] = value);
    }
}
