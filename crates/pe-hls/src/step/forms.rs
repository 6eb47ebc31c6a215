//! The forms that the step of a model can take, what each costs, and which one is taken.
//!
//! With its inputs held, a step of an affine model multiplies the state by a polynomial of the matrix: that of the
//! method, `P(z) = 1 + z + z^2/2 + ..`. Horner's rule takes it stage by stage, each with the matrix itself; its real
//! factors take fewer stages with denser matrices, and the polynomial as a whole takes one.

use pe_ir::codes;
use pe_ir::graph::{FormCost, StageForm};
use pe_ir::index::{at, number};
use pe_ir::memory;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Diagnostic;

use super::elimination::order::Order;
use super::elimination::scheme::Scheme;
use super::rows::Rows;
use super::sharing::Expanded;
use crate::mapping::MapOptions;

/// Words from the last operand of a result to the first read of it in another PE, for the wide multiplier.
const LATENCY: u64 = 10;

/// Words for which a sum with an interim value keeps the hold register.
const HELD: u32 = 5;

/// Bits of a control word, and equivalent tables of a PE without its program, as estimates go.
const CONTROL_BITS: u32 = 64;
const PE_LUTS: f64 = 600.0;

/// What counts as fewer cycles: one part in so many. Denser matrices have to save that, for their wider halo costs
/// links and memory; shared control words may cost it.
const WORTHWHILE: u64 = 32;

/// Entries of a matrix that the user asked for; an estimate stops where a form has lost.
const LARGEST: usize = 1 << 27;

/// Real factors of the polynomial of a method, or the polynomial as a whole: for each the coefficients of `z`, `z^2`..
/// None for Horner's rule, and for models that are not affine.
///
/// The factors of degree two belong to pairs of conjugate roots. The factor with the smaller coefficients comes first:
/// it damps what the second one amplifies.
pub fn polynomials(solver: Solver, form: StageForm) -> &'static [&'static [f64]] {
    match (form, solver) {
        (StageForm::Full, Solver::Heun) => &[&[1.0, 1.0 / 2.0]],
        (StageForm::Full, Solver::Heun3) => &[&[1.0, 1.0 / 2.0, 1.0 / 6.0]],
        (StageForm::Full, Solver::Rk4) => &[&[1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0]],
        (StageForm::Factors, Solver::Heun3) => &HEUN3,
        (StageForm::Factors, Solver::Rk4) => &RK4,
        _ => &[],
    }
}

const HEUN3: [&[f64]; 2] = [&[0.373_461_706_729_200_27, 0.266_011_939_663_886_9], &[0.626_538_293_270_799_7]];

const RK4: [&[f64]; 2] =
    [&[0.085_253_313_005_404_85, 0.157_552_199_573_942_8], &[0.914_746_686_994_595_2, 0.264_462_614_799_049_87]];

/// What is asked of the form of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepOptions {
    /// The form; otherwise the one that is estimated to take the fewest cycles.
    pub form: Option<StageForm>,
    /// Number of PEs that cycles are estimated for; without it products count.
    pub pes: Option<u32>,
    /// Most input ports that a PE may have.
    pub max_in_degree: u32,
    /// Whether operands with equal coefficients may be added in front of the multiplier.
    pub pre_adder: bool,
    /// Whether stages may be sums of one scale; their coefficients have one slot each.
    pub sums: bool,
    /// Whether stages that are alike may share their control words.
    pub rounds: bool,
    /// Steps of a delay, at most; runs with parts of the step have more.
    pub longest_past: u32,
    /// Most products of two variables in a sum that inlining makes; see [`crate::sums`].
    pub longest_sum: u32,
    /// The order in which linear systems and the matrices of implicit methods are eliminated.
    pub order: Order,
    /// How linear systems are eliminated.
    pub scheme: Scheme,
}

impl Default for StepOptions {
    fn default() -> Self {
        StepOptions {
            form: None,
            pes: None,
            max_in_degree: MapOptions::DEFAULT_MAX_IN_DEGREE,
            pre_adder: true,
            sums: true,
            rounds: true,
            longest_past: 65_536,
            longest_sum: u32::MAX,
            order: Order::default(),
            scheme: Scheme::default(),
        }
    }
}

impl StepOptions {
    /// The same for a run with a part of the step: its delays have so many more steps.
    #[must_use]
    pub fn in_parts(self, count: u32) -> StepOptions {
        StepOptions { longest_past: self.longest_past.saturating_mul(count), ..self }
    }
}

/// A form with its matrices.
pub struct Form {
    /// Which one.
    pub form: StageForm,
    /// One matrix per stage; none in forms that take the right-hand side as it is written.
    pub stages: Vec<Rows>,
    /// What it is estimated to cost.
    pub cost: FormCost,
}

/// Chooses the form of a step; the costs of all that were considered, in the order of their stages. `written` are those
/// that take the right-hand side as it is written, at least one.
///
/// # Errors
/// `E0805` if the model does not have the form that was asked for.
pub fn choose(
    model: &Model,
    expanded: &Expanded,
    written: &[FormCost],
    options: &StepOptions,
) -> Result<(Form, Vec<FormCost>), Vec<Diagnostic>> {
    let asked = options.form;
    // Time comes first: what is smaller must not be noticeably slower.
    let fewest = written.iter().map(|cost| cost.cycles).min().unwrap_or(0);
    let fast = written.iter().filter(|cost| (cost.cycles - fewest).saturating_mul(WORTHWHILE) <= fewest);
    let cheapest = fast.min_by(|a, b| price(a, options).total_cmp(&price(b, options)));
    let plain = written.iter().find(|cost| asked == Some(cost.form)).or(cheapest).expect("at least one");
    let mut best = Form { form: plain.form, stages: Vec::new(), cost: *plain };
    let wants_matrix = matches!(asked, Some(StageForm::Factors | StageForm::Full));
    if asked.is_some_and(|form| form != plain.form && !wants_matrix)
        || (wants_matrix && plain.form != StageForm::Horner)
    {
        return Err(vec![unsuitable(model, asked.unwrap_or(plain.form), plain.form)]);
    }
    if plain.form != StageForm::Horner || asked == Some(StageForm::Horner) {
        return Ok((best, written.to_vec()));
    }
    let limit = if wants_matrix { LARGEST } else { plain.products as usize };
    let Some(rows) = Rows::of(expanded, model.inputs.len(), limit) else {
        return if wants_matrix {
            Err(vec![no_matrix(model, asked.unwrap_or(plain.form))])
        } else {
            Ok((best, vec![*plain]))
        };
    };
    let parts = Parts::of(&rows, options.pes);
    best.cost.ports = parts.ports(&rows);
    let mut costs = vec![best.cost];
    for form in [StageForm::Factors, StageForm::Full] {
        let polynomials = polynomials(model.solver, form);
        if polynomials.is_empty() || (wants_matrix && asked != Some(form)) {
            continue;
        }
        let stages = polynomials.iter().map(|coefficients| rows.polynomial(coefficients, model.step, limit));
        let Ok(stages) = stages.collect::<Result<Vec<Rows>, _>>() else { continue };
        let cost = cost(form, &stages, &parts, options.pes);
        costs.push(cost);
        let feasible = cost.ports <= options.max_in_degree.max(costs[0].ports);
        let faster = cost.cycles.saturating_mul(WORTHWHILE) <= best.cost.cycles.saturating_mul(WORTHWHILE - 1);
        if wants_matrix || (feasible && faster) {
            best = Form { form, stages, cost };
        }
    }
    match asked {
        Some(form) if form != best.form => Err(vec![no_matrix(model, form)]),
        _ => Ok((best, costs)),
    }
}

/// Cycles times the equivalent tables of a PE, whose control words of a step are as many unless its stages are alike.
fn price(cost: &FormCost, options: &StepOptions) -> f64 {
    if options.pes.is_none() {
        return cost.cycles as f64;
    }
    let rounds = if cost.form == StageForm::Sums && options.rounds { u64::from(cost.stages) } else { 1 };
    let words = u32::try_from(cost.cycles / rounds).unwrap_or(u32::MAX);
    cost.cycles as f64 * (PE_LUTS + memory::rom(words, CONTROL_BITS).equivalent_luts())
}

/// The only form of a method whose step is a matrix.
///
/// # Errors
/// `E0805` if another form was asked for.
pub fn single(model: &Model, rows: Rows, options: &StepOptions) -> Result<(Form, Vec<FormCost>), Vec<Diagnostic>> {
    let form = StageForm::Full;
    check_only(model, form, options)?;
    let parts = Parts::of(&rows, options.pes);
    let stages = vec![rows];
    let cost = cost(form, &stages, &parts, options.pes);
    Ok((Form { form, stages, cost }, vec![cost]))
}

/// Whether the only form that a step has is the one asked for, if any is.
///
/// # Errors
/// `E0805` if it is not.
pub fn check_only(model: &Model, has: StageForm, options: &StepOptions) -> Result<(), Vec<Diagnostic>> {
    match options.form {
        Some(asked) if asked != has => Err(vec![unsuitable(model, asked, has)]),
        _ => Ok(()),
    }
}

/// The cost of the right-hand side as it is written, stage after stage.
pub fn plain_cost(form: StageForm, stages: u32, equations: &[u32], pes: Option<u32>) -> FormCost {
    // By increments the last stage of a state has one product more.
    let slots = |slots: &u32| stages * slots + u32::from(form == StageForm::Increments);
    let products = equations.iter().map(|equation| u64::from(slots(equation))).sum();
    let largest = equations.iter().map(slots).max().unwrap_or(0);
    with_cycles(FormCost { form, stages, products, largest, ports: 0, cycles: 0 }, pes)
}

/// The cost of stages that are the same sums: products per stage of all equations, and of the outer sum of each state,
/// whose next sum waits for the last write.
pub fn sums_cost(solver: Solver, equations: &[u32], outer: &[u32], pes: Option<u32>) -> FormCost {
    let stages = solver.stages();
    let held = if solver == Solver::Heun { 2 } else { HELD };
    let wait = |index: usize| outer.get(index).map_or(0, |outer| held.saturating_sub(*outer));
    let products = equations.iter().map(|slots| u64::from(stages * slots)).sum();
    let waits: u64 = (0..outer.len()).map(|index| u64::from(stages * wait(index))).sum();
    let slots = |(index, slots): (usize, &u32)| stages * (slots + wait(index));
    let largest = equations.iter().enumerate().map(slots).max().unwrap_or(0);
    let cost = FormCost { form: StageForm::Sums, stages, products: products + waits, largest, ports: 0, cycles: 0 };
    let cost = with_cycles(cost, pes);
    let latency = pes.map_or(0, |_| u64::from(stages) * (LATENCY + u64::from(held - 1)));
    FormCost { products, cycles: cost.cycles.max(latency), ..cost }
}

/// The cost of a form with matrices.
fn cost(form: StageForm, stages: &[Rows], parts: &Parts, pes: Option<u32>) -> FormCost {
    let states = stages[0].len();
    let slots = |state: usize| stages.iter().map(|rows| rows.row(state).len().max(1)).sum::<usize>() as u32;
    let products = (0..states).map(|state| u64::from(slots(state))).sum();
    let largest = (0..states).map(slots).max().unwrap_or(0);
    let ports = stages.iter().map(|rows| parts.ports(rows)).max().unwrap_or(0);
    with_cycles(FormCost { form, stages: number(stages.len()), products, largest, ports, cycles: 0 }, pes)
}

/// Completes a cost with the cycles that products, the largest equation or the latency of the stages take. Arrivals
/// never take more than products: every imported word is an operand of one at least.
pub fn with_cycles(cost: FormCost, pes: Option<u32>) -> FormCost {
    let latency = pes.map_or(0, |_| u64::from(cost.stages) * LATENCY);
    let spread = cost.products.div_ceil(u64::from(pes.unwrap_or(1).max(1)));
    FormCost { cycles: spread.max(u64::from(cost.largest)).max(latency), ..cost }
}

/// Connected parts of equal size, one per PE: what a mapping that heeds neighbourhood may look like.
struct Parts {
    of: Vec<u32>,
}

impl Parts {
    /// Cuts the breadth-first order of the states into pieces.
    fn of(rows: &Rows, pes: Option<u32>) -> Parts {
        let states = rows.len();
        let pes = (at(pes.unwrap_or(1))).clamp(1, states.max(1));
        let mut of = vec![0; states];
        if pes > 1 {
            for (rank, state) in breadth_first(rows).into_iter().enumerate() {
                of[at(state)] = number(rank * pes / states);
            }
        }
        Parts { of }
    }

    /// Most parts and inputs that a part reads.
    fn ports(&self, rows: &Rows) -> u32 {
        let states = rows.len();
        let mut links: Vec<(u32, u32)> = Vec::new();
        for (row, part) in self.of.iter().enumerate() {
            for (column, _) in rows.row(row) {
                match self.of.get(at(column)) {
                    Some(source) if source != part => links.push((*part, *source)),
                    None if at(column) < rows.width() - 1 => links.push((*part, column + number(states))),
                    _ => {}
                }
            }
        }
        links.sort_unstable();
        links.dedup();
        number(links.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len).max().unwrap_or(0))
    }
}

/// States in breadth-first order over who reads whom, each connected component after the other.
fn breadth_first(rows: &Rows) -> Vec<u32> {
    let states = rows.len();
    let arcs = || (0..states).flat_map(|row| rows.row(row).map(move |(column, _)| (row, at(column))));
    let arcs = || arcs().filter(|(row, column)| *column < states && row != column);
    let mut starts = vec![0usize; states + 1];
    for (row, column) in arcs() {
        starts[row + 1] += 1;
        starts[column + 1] += 1;
    }
    for state in 0..states {
        starts[state + 1] += starts[state];
    }
    let mut next = starts.clone();
    let mut neighbours = vec![0u32; starts[states]];
    for (row, column) in arcs() {
        for (a, b) in [(row, column), (column, row)] {
            neighbours[next[a]] = number(b);
            next[a] += 1;
        }
    }
    let mut order = Vec::with_capacity(states);
    let mut seen = vec![false; states];
    let mut read = 0;
    for root in 0..states {
        if !std::mem::replace(&mut seen[root], true) {
            order.push(number(root));
        }
        while let Some(state) = order.get(read).map(|state| at(*state)) {
            read += 1;
            for neighbour in &neighbours[starts[state]..starts[state + 1]] {
                if !std::mem::replace(&mut seen[at(*neighbour)], true) {
                    order.push(*neighbour);
                }
            }
        }
    }
    order
}

fn unsuitable(model: &Model, asked: StageForm, has: StageForm) -> Diagnostic {
    let message = format!("`{}` has no step in the form `{asked}`, only in the form `{has}`", model.name);
    let help = match has {
        StageForm::Increments | StageForm::Sums => {
            "all other forms need derivatives that are affine in the states; leave `--form` out"
        }
        _ => "leave `--form` out",
    };
    Diagnostic::global(codes::UNSUITABLE_FORM, message).with_help(help)
}

fn no_matrix(model: &Model, asked: StageForm) -> Diagnostic {
    let message = format!("the step of `{}` has no matrix for the form `{asked}`", model.name);
    Diagnostic::global(codes::UNSUITABLE_FORM, message).with_help(
        "it needs derivatives that are affine in states and inputs together, and few enough products; try `horner`",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factors_of_a_method_multiply_to_its_polynomial() {
        for solver in [Solver::Heun3, Solver::Rk4] {
            let mut product = vec![1.0];
            for factor in polynomials(solver, StageForm::Factors) {
                let mut next = vec![0.0; product.len() + factor.len()];
                for (i, a) in product.iter().enumerate() {
                    next[i] += a;
                    for (j, b) in factor.iter().enumerate() {
                        next[i + j + 1] += a * b;
                    }
                }
                product = next;
            }
            let whole = polynomials(solver, StageForm::Full)[0];
            assert_eq!(product.len(), whole.len() + 1);
            for (is, should) in product[1..].iter().zip(whole) {
                assert!((is - should).abs() < 2.0 * f64::EPSILON, "{solver:?}: {is} is not {should}");
            }
        }
    }
}
