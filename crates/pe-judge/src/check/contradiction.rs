//! Closures that move by themselves until they cannot all hold: a driven crank that its linkage does not let past, a rod that grows
//! where others hold both of its ends. The penalty then stretches what should be rigid, and which closures open depends on it.
//!
//! Closures that read coordinates alone hold where they start, so that they never contradict each other later.

use pe_hls::step::{StepOptions, build_with};
use pe_ir::closing::{Openings, anywhere};
use pe_ir::codes;
use pe_ir::index::{StateId, at};
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Expr, Model, Solver, State, Variable};
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;

use super::closures::Closures;

/// Products that a run may take, and times at which it is looked at.
const PRODUCTS: u64 = 300_000_000;
const LOOKS: u64 = 2000;

/// Part of the closure that stays open most, above which another one stays open as well.
const ALSO: f64 = 0.1;

/// Closures that a finding names.
const NAMED: usize = 4;

/// Where closures contradict each other.
struct Contradiction {
    /// Time in seconds.
    time: f64,
    /// Closures that stay open, the worst first, and by how much.
    open: Vec<(usize, f64)>,
}

/// A position that is looked for.
struct Search<'m> {
    closures: Closures<'m>,
    mechanism: &'m Mechanism,
    /// How large coordinates come to be, in the unit of the spec.
    sizes: Vec<f64>,
}

/// The finding about closures of a model that contradict each other on the way, with one that was left out; none if all of them
/// can be closed whenever they are looked at.
pub fn contradiction(model: &Model) -> Option<Diagnostic> {
    let mechanism = model.mechanism.as_deref().filter(|mechanism| !mechanism.drifts.is_empty())?;
    let found = first(model, mechanism)?;
    let name = |row: usize| match &mechanism.gaps[row] {
        Expr::Variable(Variable::Algebraic(algebraic)) => format!("`{}`", model.algebraics[at(*algebraic)].name),
        _ => format!("closure {row}"),
    };
    let named: Vec<String> =
        found.open.iter().take(NAMED).map(|(row, by)| format!("{} {by:.1e}", name(*row))).collect();
    let more = found.open.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let message = format!(
        "closures contradict each other from t = {:.3e} s on: no position was found that closes all of them; {}{more} stay open",
        found.time,
        named.join(", ")
    );
    let holds = |row: &usize| first(model, &without(mechanism, *row)).is_none();
    let help = match found.open.iter().take(NAMED).map(|(row, _)| *row).find(holds) {
        Some(row) => format!("leave out {}: the others can be closed to the end of the span (tried)", name(row)),
        None => "none of them alone is too much: end the span before, or look at lengths and at what moves".to_owned(),
    };
    Some(Diagnostic::error(codes::CONTRADICTION, mechanism.span, message).with_help(help))
}

/// The mechanism without a closure.
fn without(mechanism: &Mechanism, row: usize) -> Mechanism {
    let mut other = mechanism.clone();
    other.jacobian.retain(|entry| at(entry.row) != row);
    other.jacobian.iter_mut().for_each(|entry| entry.row -= u32::from(at(entry.row) > row));
    for parts in [&mut other.gaps, &mut other.bends, &mut other.drifts] {
        parts.remove(row);
    }
    other
}

/// The model whose coordinates rest and whose other states move as they do.
fn at_rest(model: &Model, mechanism: &Mechanism) -> Model {
    let mut rests = Model { solver: Solver::Euler, mechanism: None, ..model.clone() };
    for (coordinate, velocity) in &mechanism.pairs {
        rests.states[*coordinate].derivative = Expr::Constant(0.0);
        rests.states[*velocity].derivative = Expr::Constant(0.0);
    }
    rests
}

/// The first time at which closures contradict each other: where they are looked at, positions follow from the last one that
/// closed them.
fn first(model: &Model, mechanism: &Mechanism) -> Option<Contradiction> {
    // What moves with the mechanism and moves closures is known in its own run only.
    let is_part = |state: StateId| mechanism.pairs.iter().any(|pair| pair.0 == state || pair.1 == state);
    let moves = |(number, state): (StateId, &State)| {
        !is_part(number) && state.motion.is_none() && state.derivative.as_constant() != Some(0.0)
    };
    if model.states.numbered().any(moves) {
        return None;
    }
    let graph = build_with(&at_rest(model, mechanism), &StepOptions::default()).ok()?;
    let steps = model.steps().min(PRODUCTS / graph.macs().max(1));
    let stride = steps.div_ceil(LOOKS).max(1);
    let start: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let mut search = Search::of(model, mechanism, &start);
    let (mut run, mut closed) = (DoubleRun::new(&graph), start.clone());
    for done in 1..=steps {
        run.step(&model.sample_inputs(model.time(done - 1, 0.0))).ok()?;
        if done % stride != 0 && done != steps {
            continue;
        }
        let mut states: Vec<f64> = run.states().take(model.states.len()).collect();
        mechanism.pairs.iter().for_each(|pair| states[pair.0.index()] = closed[pair.0.index()]);
        let time = model.time(done, 0.0);
        match search.anywhere(&states, time) {
            Ok(there) => closed = there,
            Err(open) => return Some(Contradiction { time, open }),
        }
        for (place, (coordinate, _)) in mechanism.pairs.iter().enumerate() {
            let by = search.closures.apart(*coordinate, &closed, &start).abs();
            let size = if model.states[*coordinate].angle { 1.0 } else { by };
            search.sizes[place] = search.sizes[place].max(size);
        }
    }
    None
}

impl<'m> Search<'m> {
    fn of(model: &Model, mechanism: &'m Mechanism, start: &[f64]) -> Search<'m> {
        let sizes = mechanism.pairs.iter().map(|pair| (start[pair.0.index()] * model.radians(pair.0)).abs());
        Search { closures: Closures::of(model, mechanism), mechanism, sizes: sizes.collect() }
    }

    fn size(&self, place: usize) -> f64 {
        let all = self.sizes.iter().copied().fold(0.0, f64::max);
        self.sizes[place].max(if all > 0.0 { 1e-3 * all } else { 1.0 })
    }

    /// States that close all loops, from these coordinates or others; else what stays open where that is least.
    fn anywhere(&self, states: &[f64], time: f64) -> Result<Vec<f64>, Vec<(usize, f64)>> {
        let count = self.mechanism.pairs.len();
        let moved = |position: &[f64]| {
            let mut moved = states.to_vec();
            for (place, pair) in self.mechanism.pairs.iter().enumerate() {
                self.closures.shift(&mut moved, pair.0, position[place] * self.size(place));
            }
            moved
        };
        let openings = |position: &[f64]| {
            let numbers = self.closures.at(&moved(position), time);
            let rows = 0..numbers.gaps.len();
            let lever = |(row, place): (usize, usize)| numbers.levers[(row, place)] * self.size(place);
            let places = rows.flat_map(|row| (0..count).map(move |place| (row, place)));
            Openings { levers: places.map(lever).collect(), gaps: numbers.gaps.iter().copied().collect() }
        };
        anywhere(&[vec![0.0; count]], &openings).map(|position| moved(&position)).map_err(|gaps| {
            let most = gaps.iter().fold(0.0f64, |most, gap| most.max(gap.abs()));
            let mut open: Vec<(usize, f64)> =
                gaps.into_iter().enumerate().filter(|(_, gap)| gap.abs() > ALSO * most).collect();
            open.sort_by(|one, other| other.1.abs().total_cmp(&one.1.abs()));
            open
        })
    }
}
