//! Rounds coefficients so that the errors of a chain cancel where the model moves.
//!
//! With a narrow coefficient port the rounding of coefficients is nearly all of the word-length error. What counts is
//! not each coefficient's error but their sum over a chain, `sum_i delta_i x_i(t)`. Where large terms nearly cancel
//! (a pressure difference that drives a flow, a diffusion stencil) independent roundings leave an error that the
//! difference amplifies. So the roundings of a chain are chosen together: least squares over sampled operands, a
//! closest-vector search by coordinate descent from the nearest roundings. No coefficient moves by more than
//! [`REACH`] units, so the gain outside the samples' directions is bounded.
//!
//! The stages of a Runge-Kutta step round the same coefficients differently. [`Aim::Step`] has the last stage make good,
//! to first order in the step, what the earlier ones have rounded away.

use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StageForm, StepGraph, Term};
use pe_ir::index::{ChainId, EquationId, List, at, number};

use crate::alike::alike;
use crate::parts::Likes;

/// Largest distance of a rounded coefficient from the exact one, in units of the product point.
pub const REACH: i64 = 2;

/// Chains with more terms keep nearest rounding: their moments would take memory without need.
pub const MAX_TERMS: usize = 24;

/// Samples whose products are summed up at once: each sum is then read and written once for all of them.
const BATCH: usize = 8;

/// Numbers that samples may hold while they wait.
const WAITING: usize = 8_000_000;

/// Second moments of the operands of every chain: sums of `x_i x_j` over samples.
#[derive(Clone, Debug)]
pub struct Moments {
    /// Start of each chain's lower triangle.
    offsets: List<ChainId, u32>,
    /// Zero where a term has no coefficient that could be rounded.
    sums: Vec<f64>,
}

/// Samples on their way to moments.
pub struct Sampling<'a> {
    graph: &'a StepGraph,
    moments: Moments,
    /// Values that are operands of coefficients.
    operands: Vec<u32>,
    /// Place of each term's operand among them; none of terms without a coefficient.
    places: Vec<Option<u32>>,
    /// Numbers of each operand in the samples that wait, side by side.
    waiting: Vec<f64>,
    /// Most samples that wait, and how many do.
    batch: usize,
    count: usize,
}

impl<'a> Sampling<'a> {
    /// No samples yet.
    pub fn new(graph: &'a StepGraph) -> Sampling<'a> {
        let mut offsets = List::with_capacity(graph.chains.len());
        let mut total = 0u32;
        let mut place_of = vec![None; graph.values.len()];
        let (mut operands, mut places) = (Vec::new(), vec![None; graph.terms.len()]);
        for chain in &graph.chains {
            offsets.push(total);
            let n = chain.terms.len();
            if n > MAX_TERMS {
                continue;
            }
            total += number(n * (n + 1) / 2);
            for term in chain.terms.clone() {
                let Term { operand, factor: Factor::Coefficient(_), .. } = graph.terms[at(term)] else { continue };
                let place = *place_of[operand.index()].get_or_insert(number(operands.len()));
                if at(place) == operands.len() {
                    operands.push(operand.number());
                }
                places[at(term)] = Some(place);
            }
        }
        let batch = (WAITING / operands.len().max(1)).clamp(1, BATCH);
        let waiting = vec![0.0; operands.len() * batch];
        let moments = Moments { offsets, sums: vec![0.0; at(total)] };
        Sampling { graph, moments, operands, places, waiting, batch, count: 0 }
    }

    /// Adds a sample: `operand` gives the current number of a value.
    pub fn add(&mut self, operand: impl Fn(usize) -> f64) {
        for (numbers, value) in self.waiting.chunks_exact_mut(self.batch).zip(&self.operands) {
            numbers[self.count] = operand(at(*value));
        }
        self.count += 1;
        if self.count == self.batch {
            self.sum_up();
        }
    }

    /// The moments of all samples.
    pub fn moments(mut self) -> Moments {
        self.sum_up();
        self.moments
    }

    /// Adds the products of the samples that wait, in their order.
    fn sum_up(&mut self) {
        let numbers = |place: u32| &self.waiting[at(place) * self.batch..][..self.count];
        for (chain, offset) in self.graph.chains.iter().zip(&self.moments.offsets) {
            if chain.terms.len() > MAX_TERMS {
                continue;
            }
            let places = &self.places[at(chain.terms.start)..chain.terms.end as usize];
            let mut row = at(*offset);
            for (i, a) in places.iter().enumerate() {
                if let Some(a) = a {
                    let sums = &mut self.moments.sums[row..=row + i];
                    for (sum, b) in sums.iter_mut().zip(places) {
                        if let Some(b) = b {
                            *sum = numbers(*a).iter().zip(numbers(*b)).fold(*sum, |sum, (x, y)| sum + x * y);
                        }
                    }
                }
                row += i + 1;
            }
        }
        self.count = 0;
    }
}

impl Moments {
    /// Moment of two terms of a chain, by position.
    fn of(&self, chain: ChainId, i: usize, j: usize) -> f64 {
        let (i, j) = (i.max(j), i.min(j));
        self.sums[at(self.offsets[chain]) + i * (i + 1) / 2 + j]
    }
}

/// What roundings cancel in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aim {
    /// Each chain.
    Chain,
    /// The sum of a state's increments over the stages.
    Step,
}

impl Aim {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Aim::Chain => "chain",
            Aim::Step => "step",
        }
    }
}

/// Improves the roundings of all chains in place.
pub fn improve(graph: &StepGraph, fixed: &mut FixedPoint, moments: &Moments, aim: Aim) {
    let nearest = Likes::of(graph).map(|likes| (likes, fixed.coefficients.clone()));
    let earlier = match aim {
        Aim::Chain => List::filled(Vec::new(), graph.chains.len()),
        Aim::Step => earlier_stages(graph),
    };
    // Chains of earlier stages come first.
    for (chain, earlier) in earlier.numbered() {
        if graph.chains[chain].terms.len() <= MAX_TERMS {
            improve_chain(graph, fixed, moments, chain, earlier);
        }
    }
    // Stages that are alike keep the same coefficients, so that they may share their control words.
    for (chain, &like) in alike(graph).numbered().filter(|(chain, like)| chain != *like) {
        let (own, model) = (&graph.chains[chain], &graph.chains[like]);
        let exact = |(a, b): (&Term, &Term)| {
            fixed.exponents[a.operand.index()] == fixed.exponents[b.operand.index()]
                && (a.factor == b.factor || matches!(a.factor, Factor::Value(_)))
        };
        if fixed.products[chain] == fixed.products[like]
            && graph.chain_terms(own).iter().zip(graph.chain_terms(model)).all(exact)
        {
            fixed.coefficients.copy_within(at(model.terms.start)..model.terms.end as usize, at(own.terms.start));
        }
    }
    if let Some((likes, nearest)) = nearest {
        as_in_the_middle(graph, fixed, &likes, &nearest);
    }
}

/// Gives parts that are alike the coefficients of the one in the middle, as far as these are the same; others are the nearest
/// ones.
fn as_in_the_middle(graph: &StepGraph, fixed: &mut FixedPoint, likes: &Likes, nearest: &[i64]) {
    let mut models: List<ChainId, ChainId> = graph.chains.ids().collect();
    for (chain, (_, like)) in likes.chains.numbered().filter(|(_, (part, _))| *part == likes.count / 2) {
        models[*like] = chain;
    }
    for (chain, (_, like)) in likes.chains.numbered() {
        let model = models[*like];
        for (own, place) in graph.chains[chain].terms.clone().zip(graph.chains[model].terms.clone()) {
            let same = graph.terms[at(own)].factor == graph.terms[at(place)].factor;
            fixed.coefficients[at(own)] = if same { fixed.coefficients[at(place)] } else { nearest[at(own)] };
        }
    }
}

/// Whether the two aims differ for a graph.
pub fn can_balance(graph: &StepGraph) -> bool {
    earlier_stages(graph).iter().any(|earlier| !earlier.is_empty())
}

/// For each chain of a last stage the chains that compute the same in earlier stages, with the weights at which those
/// stages' increments enter the state; nothing for other chains.
fn earlier_stages(graph: &StepGraph) -> List<ChainId, Vec<(f64, ChainId)>> {
    let mut earlier = List::filled(Vec::new(), graph.chains.len());
    if graph.form != StageForm::Increments {
        return earlier;
    }
    let mut own = List::<EquationId, _>::filled(Vec::new(), graph.equations.len());
    for (index, chain) in graph.chains.numbered() {
        own[chain.equation].push(index);
    }
    let producers = graph.producers();
    let role = |chain: &ChainId| graph.value(graph.chains[*chain].write.value).role;
    for chains in own {
        // A stage is its inner factors and what it writes at the end.
        let stages: Vec<&[ChainId]> =
            chains.split_inclusive(|chain| matches!(role(chain), Role::Stage(..) | Role::Next(_))).collect();
        let Some((last, stages)) = stages.split_last() else { continue };
        if !last.last().is_some_and(|chain| matches!(role(chain), Role::Next(_)))
            || stages.iter().any(|stage| stage.len() != last.len())
        {
            continue;
        }
        let weights = increments(graph, &producers, &graph.chains[last[last.len() - 1]]);
        for (place, chain) in last.iter().enumerate() {
            let alike = stages.iter().filter_map(|stage| {
                let (_, weight) = weights.iter().find(|(chain, _)| *chain == stage[stage.len() - 1])?;
                Some((*weight, stage[place]))
            });
            earlier[*chain] = alike.collect();
        }
    }
    earlier
}

/// The chains whose increments a chain adds up through running sums, with their weights.
fn increments(graph: &StepGraph, producers: &[Option<ChainId>], chain: &Chain) -> Vec<(ChainId, f64)> {
    let mut found = Vec::new();
    for term in graph.chain_terms(chain) {
        let Factor::Coefficient(share) = term.factor else { continue };
        let mut sum = Some(term.operand);
        while let Some(value) = sum.filter(|value| matches!(graph.value(*value).role, Role::Sum(..))) {
            let producer = producers[value.index()].expect("a chain computes each running sum");
            let mut writes = graph.chains[producer].writes();
            let write = writes.find(|write| write.value == value).expect("it produces the value");
            found.push((producer, libm::scalbn(share, write.weight)));
            sum = write.base;
        }
    }
    found
}

/// How much larger a coefficient is than its exact value.
fn rounded_by(graph: &StepGraph, fixed: &FixedPoint, chain: ChainId, position: usize) -> f64 {
    let index = at(graph.chains[chain].terms.start) + position;
    match graph.terms[index].factor {
        Factor::Coefficient(exact) => {
            let operand = operand_exponent(fixed, &graph.terms[index]);
            libm::scalbn(fixed.coefficients[index] as f64, fixed.products[chain] - operand) - exact
        }
        Factor::Value(_) => 0.0,
    }
}

/// Exponent of a term's operand as the multiplier sees it.
fn operand_exponent(fixed: &FixedPoint, term: &Term) -> i32 {
    fixed.exponents[term.operand.index()] + fixed.format.data_drop() as i32
}

/// Terms of a chain that keep one coefficient between them.
struct Class {
    positions: Vec<usize>,
    /// The exact coefficient in units of the product point.
    exact: f64,
    /// The same less what earlier stages have rounded up.
    target: f64,
    /// Weight of a unit.
    unit: f64,
}

/// Improves the roundings of a chain; `earlier` are the chains that compute the same in earlier stages, and their weights.
fn improve_chain(
    graph: &StepGraph,
    fixed: &mut FixedPoint,
    moments: &Moments,
    chain: ChainId,
    earlier: &[(f64, ChainId)],
) {
    let start = at(graph.chains[chain].terms.start);
    let mut classes: Vec<Class> = Vec::new();
    // Terms that may be paired.
    let mut free: Vec<Class> = Vec::new();
    for (position, term) in graph.chain_terms(&graph.chains[chain]).iter().enumerate() {
        if let Factor::Coefficient(coefficient) = term.factor {
            // One unit changes the coefficient by 2^(product - operand).
            let exponent = fixed.products[chain] - operand_exponent(fixed, term);
            let made_good: f64 = earlier
                .iter()
                .filter(|(_, stage)| position < graph.chains[*stage].terms.len())
                .map(|(weight, stage)| weight * rounded_by(graph, fixed, *stage, position))
                .sum();
            let class = Class {
                positions: vec![position],
                exact: libm::scalbn(coefficient, -exponent),
                target: libm::scalbn(coefficient - made_good, -exponent),
                unit: libm::scalbn(1.0, exponent),
            };
            let half_scale = fixed.half_scale[term.operand.index()];
            match free.iter_mut().find(|other| half_scale && (other.exact, other.unit) == (class.exact, class.unit)) {
                Some(other) => other.positions.push(position),
                None if half_scale => free.push(class),
                None => classes.push(class),
            }
        }
    }
    // Two operands that are paired have one coefficient, and any two of a class may be paired.
    classes.extend(free);
    let limit = (1i64 << (fixed.format.coefficient_bits - 1)) - 1;
    let gram = |i: usize, j: usize| {
        let pairs = classes[i].positions.iter().flat_map(|a| classes[j].positions.iter().map(move |b| (*a, *b)));
        pairs.map(|(a, b)| moments.of(chain, a, b)).sum::<f64>() * classes[i].unit * classes[j].unit
    };
    let n = classes.len();
    let gram: Vec<f64> = (0..n * n).map(|k| gram(k / n, k % n)).collect();
    let mut rounded: Vec<i64> = classes.iter().map(|class| fixed.coefficients[start + class.positions[0]]).collect();
    let mut error: Vec<f64> = rounded.iter().zip(&classes).map(|(r, class)| *r as f64 - class.target).collect();
    // Gradient of the squared sum with respect to each error, halved.
    let mut slope: Vec<f64> = (0..n).map(|i| (0..n).map(|j| gram[i * n + j] * error[j]).sum()).collect();
    let allowed =
        |i: usize, rounded: i64| (rounded as f64 - classes[i].exact).abs() <= REACH as f64 && rounded.abs() <= limit;
    loop {
        let mut best: Option<(f64, usize, i64, usize, i64)> = None;
        let mut offer = |gain: f64, i: usize, di: i64, j: usize, dj: i64| {
            if gain > best.map_or(0.0, |best| best.0) {
                best = Some((gain, i, di, j, dj));
            }
        };
        for i in 0..n {
            for di in [-1i64, 1] {
                if !allowed(i, rounded[i] + di) {
                    continue;
                }
                let single = -(2.0 * di as f64 * slope[i] + gram[i * n + i]);
                offer(single, i, di, i, 0);
                for j in 0..i {
                    for dj in [-1i64, 1] {
                        if allowed(j, rounded[j] + dj) {
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
    for (value, class) in rounded.into_iter().zip(&classes) {
        class.positions.iter().for_each(|position| fixed.coefficients[start + position] = value);
    }
}
