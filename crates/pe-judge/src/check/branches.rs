//! Whether a mechanism stays on the branch of its reference solution. In singular positions, where closures hold one direction
//! less, several motions keep the loops closed: a step that is too large, or forces in closures that come too late, may go on with
//! another one. Loops stay closed, and half the step may leave the branch as well, so that nothing else tells.
//!
//! Two positions are of one branch if closed loops lead from one to the other: from the nearest one of the solution, independent coordinates are
//! moved to where the run has them, and Newton's iteration keeps the loops closed on the way. Where that ends elsewhere than at
//! the run, the run is on another branch. A way that comes near a singular position says nothing, nor does a run whose closures are
//! open by as much as it is away.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use pe_ir::codes;
use pe_ir::index::StateId;
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;
use pe_sim::reference;

use super::closures::{Closures, Numbers};
use super::question::Question;
use super::remedies;
use crate::runs::Judged;

/// Tolerance of the reference solution, products of numbers that it may take before it is given up, and fewest steps.
const TOLERANCE: f64 = 1e-8;
const OPERATIONS: u64 = 200_000_000;
const FEWEST_STEPS: u64 = 2000;

/// Products that the run of a trial may take.
const PRODUCTS: u64 = 300_000_000;

/// Part of the largest singular value of the closures that counts as one: what is below everywhere holds nothing.
const RANK: f64 = 1e-5;

/// Part of the largest mass that each coordinate is given, so that the measure exists without one.
const LIFT: f64 = 1e-6;

/// Singular values over their change to the next place, up to which a singular position may be between the two.
const NEAR: f64 = 1.5;

/// Part of the largest that the least singular value comes to, below which a position is too near a singular one.
const REGULAR: f64 = 0.1;

/// Places on the way of the independent coordinates, and iterations at each.
const PLACES: usize = 32;
const ITERATIONS: usize = 12;

/// A correction that is rounding, in parts of a coordinate, and the part to which each has to shrink.
const ROUNDING: f64 = 1e-10;
const SHRINKS: f64 = 0.5;

/// How far a run has to be away, in times of what its closures are open by, and in parts of what they move by from sample to
/// sample.
const AWAY: f64 = 10.0;
const MOVED: f64 = 0.1;

/// Part of its largest magnitude by which half a step may differ in a state, of a change that is proposed.
const ALIKE: f64 = 0.1;

/// Times at which a step is looked at that has no runs yet.
const LOOKS: u64 = 400;

/// Samples that have to say so.
const SAMPLES: usize = 3;

/// Where a run is on another branch.
#[derive(Clone, Debug, PartialEq)]
pub struct Departure {
    /// Time of the first such sample in seconds.
    pub time: f64,
    /// The coordinate that is farthest away, in the measure of the masses, and by how much.
    pub coordinate: StateId,
    pub by: f64,
}

/// The branch of the reference solution, at times.
pub struct Branch<'m> {
    closures: Closures<'m>,
    mechanism: &'m Mechanism,
    times: &'m [f64],
    solution: Trajectory,
    turns: Vec<(usize, f64)>,
    /// How many directions closures hold, and the largest that the least of them comes to.
    rank: usize,
    most: f64,
    /// How far each closure would open if its coordinates moved one by one as they do from sample to sample, at most.
    moves: Vec<f64>,
}

impl<'m> Branch<'m> {
    /// The branch of a mechanism whose run, which has states at these times, comes to a singular position; none where it
    /// does not, or where there is no reference solution.
    pub fn of(model: &'m Model, times: &'m [f64], run: &Trajectory) -> Option<Branch<'m>> {
        let mechanism = model.mechanism.as_deref()?;
        let mut branch = Branch {
            closures: Closures::of(model, mechanism),
            mechanism,
            times,
            solution: Trajectory::new(run.states),
            turns: model.turns(),
            rank: 0,
            most: 0.0,
            moves: vec![0.0; mechanism.gaps.len()],
        };
        if !branch.passes_singular(run) {
            return None;
        }
        let terms = (model.states.len() + model.algebraics.len()).max(1) as u64;
        let steps = (OPERATIONS / (50 * terms)).max(FEWEST_STEPS);
        branch.solution = reference::solve_with_limit(model, times, TOLERANCE, steps, &mut |_| {}).ok()?.states;
        for (sample, time) in times.iter().enumerate().skip(1) {
            let (before, now) = (branch.row(&branch.solution, sample - 1), branch.row(&branch.solution, sample));
            let numbers = branch.closures.at(now, *time);
            let mut most = std::mem::take(&mut branch.moves);
            for (row, moves) in most.iter_mut().enumerate() {
                let by = mechanism.pairs.iter().enumerate().map(|(column, pair)| {
                    let moved = branch.closures.apart(pair.0, now, before);
                    (numbers.levers[(row, column)] * moved).abs()
                });
                *moves = moves.max(by.sum());
            }
            branch.moves = most;
        }
        Some(branch)
    }

    /// Where a run with states at the same times leaves the branch.
    pub fn departure(&self, run: &Trajectory) -> Option<Departure> {
        let mut found = (0..self.times.len()).filter_map(|sample| self.away(run, sample));
        let first = found.next()?;
        (found.take(SAMPLES - 1).count() == SAMPLES - 1).then_some(first)
    }

    fn row<'t>(&self, run: &'t Trajectory, sample: usize) -> &'t [f64] {
        &run.samples[sample * run.states..(sample + 1) * run.states]
    }

    /// What closures hold, the largest first: singular values of their derivatives, in the measure of the masses.
    fn held(numbers: &Numbers) -> Option<Vec<f64>> {
        let mut masses = numbers.masses.clone();
        let lift = LIFT * masses.diagonal().amax();
        (0..masses.nrows()).for_each(|place| masses[(place, place)] += lift);
        let scaled = masses.cholesky()?.l().solve_lower_triangular(&numbers.levers.transpose())?;
        let finite = scaled.iter().all(|number| number.is_finite());
        finite.then(|| sorted(scaled.singular_values().iter().copied().collect()))
    }

    /// Whether the least that closures hold may come to zero in a run.
    fn passes_singular(&mut self, run: &Trajectory) -> bool {
        let held = |sample: usize| Branch::held(&self.closures.at(self.row(run, sample), self.times[sample]));
        let Some(all) = (0..self.times.len()).map(held).collect::<Option<Vec<_>>>() else { return false };
        let most = |place: usize| all.iter().map(|values| values[place]).fold(0.0, f64::max);
        let count = all.first().map_or(0, Vec::len);
        self.rank = (0..count).take_while(|place| most(*place) > RANK * most(0)).count();
        let Some(least) = self.rank.checked_sub(1) else { return false };
        self.most = most(least);
        let values: Vec<f64> = all.iter().map(|values| values[least]).collect();
        values.windows(2).any(|two| two[0].min(two[1]) <= NEAR * (two[1] - two[0]).abs())
    }

    fn is_regular(&self, numbers: &Numbers) -> bool {
        Branch::held(numbers).is_some_and(|values| values[self.rank - 1] > REGULAR * self.most)
    }

    /// The position of the solution that is nearest to that of a run, in the measure of the masses, and the run's in turns next to
    /// it; closures that move by themselves have one for each time.
    fn nearest(&self, run: &Trajectory, sample: usize) -> Option<(Vec<f64>, Vec<f64>)> {
        let own = self.row(run, sample);
        let masses = self.closures.at(own, self.times[sample]).masses;
        let beside = |from: &[f64]| -> Vec<f64> {
            let mut there = own.to_vec();
            for (state, turn) in &self.turns {
                there[*state] -= turn * libm::round((there[*state] - from[*state]) / turn);
            }
            there
        };
        let distance = |from: &[f64]| -> f64 {
            let there = beside(from);
            let pairs = self.mechanism.pairs.iter().enumerate();
            let part = |(place, pair): (usize, &(StateId, StateId))| {
                let apart = self.closures.apart(pair.0, &there, from);
                masses[(place, place)].abs() * apart * apart
            };
            pairs.map(part).sum()
        };
        let samples = if self.mechanism.drifts.is_empty() { 0..self.times.len() } else { sample..sample + 1 };
        let all = samples.map(|sample| self.row(&self.solution, sample));
        let from = all.min_by(|one, other| distance(one).total_cmp(&distance(other)))?;
        Some((from.to_vec(), beside(from)))
    }

    /// Where the run is on another branch at a sample; none where it is not, or where nothing can be said.
    fn away(&self, run: &Trajectory, sample: usize) -> Option<Departure> {
        let time = self.times[sample];
        let (from, there) = self.nearest(run, sample)?;
        let (from, there) = (&from[..], &there[..]);
        let (start, end) = (self.closures.at(from, time), self.closures.at(there, time));
        let pairs = &self.mechanism.pairs;
        let apart =
            DVector::from_iterator(pairs.len(), pairs.iter().map(|pair| self.closures.apart(pair.0, there, from)));
        // What lies along the branch is no departure.
        let far = |opens: &DVector<f64>| {
            let mut rows = opens.iter().zip(&end.gaps).zip(&self.moves);
            rows.any(|((opens, gap), moves)| opens.abs() > AWAY * gap.abs().max(MOVED * moves))
        };
        if !far(&(&start.levers * &apart)) || !self.is_regular(&start) || !self.is_regular(&end) {
            return None;
        }
        let (rows, columns) = pivots(&start, self.rank)?;
        let reached = self.moved(from, there, time, &rows, &columns)?;
        let mut away = DVector::<f64>::zeros(pairs.len());
        for column in &columns {
            away[*column] = self.closures.apart(pairs[*column].0, there, &reached);
        }
        if !far(&(&self.closures.at(&reached, time).levers * &away)) {
            return None;
        }
        let weighed = |column: usize| away[column].abs() * libm::sqrt(end.masses[(column, column)].max(0.0));
        let worst = (0..pairs.len()).max_by(|one, other| weighed(*one).total_cmp(&weighed(*other)))?;
        Some(Departure { time, coordinate: pairs[worst].0, by: away[worst] })
    }

    /// The states of the branch whose independent coordinates are those of another position; none where the way there is
    /// not certain. Closures in `rows` determine the coordinates in `columns`.
    fn moved(&self, from: &[f64], to: &[f64], time: f64, rows: &[usize], columns: &[usize]) -> Option<Vec<f64>> {
        let mut states = from.to_vec();
        let mut least: Option<f64> = None;
        for part in 1..=PLACES {
            for (place, pair) in self.mechanism.pairs.iter().enumerate() {
                if !columns.contains(&place) {
                    let own = pair.0.index();
                    states[own] = from[own] + (to[own] - from[own]) * part as f64 / PLACES as f64;
                }
            }
            let held = self.closed(&mut states, time, rows, columns)?;
            if least.is_some_and(|before| held.min(before) <= NEAR * (held - before).abs()) {
                return None;
            }
            least = Some(held);
        }
        Some(states)
    }

    /// Closes loops by moving dependent coordinates; the least singular value there.
    fn closed(&self, states: &mut [f64], time: f64, rows: &[usize], columns: &[usize]) -> Option<f64> {
        let mut before = f64::INFINITY;
        for _ in 0..ITERATIONS {
            let numbers = self.closures.at(states, time);
            let own =
                DMatrix::from_fn(rows.len(), columns.len(), |row, column| numbers.levers[(rows[row], columns[column])]);
            let open = DVector::from_iterator(rows.len(), rows.iter().map(|row| numbers.gaps[*row]));
            let correction = own.clone().lu().solve(&open)?;
            let mut size: f64 = 0.0;
            for (column, by) in columns.iter().zip(&correction) {
                size = size.max(self.closures.shift(states, self.mechanism.pairs[*column].0, -by));
            }
            if size <= ROUNDING {
                return sorted(own.singular_values().iter().copied().collect()).last().copied();
            }
            if size.is_nan() || size > SHRINKS * before {
                return None;
            }
            before = size;
        }
        None
    }
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(|one, other| other.total_cmp(one));
    values
}

/// Rows and columns of so many largest pivots of the closures' derivatives, weighed by masses.
fn pivots(numbers: &Numbers, count: usize) -> Option<(Vec<usize>, Vec<usize>)> {
    let mut left = numbers.levers.clone();
    let lift = LIFT * numbers.masses.diagonal().amax();
    for column in 0..left.ncols() {
        let mass = numbers.masses[(column, column)].abs() + lift;
        left.column_mut(column).scale_mut(1.0 / libm::sqrt(mass));
    }
    let (mut rows, mut columns) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let (row, column) = left.iamax_full();
        let pivot = left[(row, column)];
        if pivot == 0.0 || !pivot.is_finite() {
            return None;
        }
        let across = left.row(row).clone_owned();
        let down = left.column(column) / pivot;
        left -= down * across;
        left.row_mut(row).fill(0.0);
        left.column_mut(column).fill(0.0);
        rows.push(row);
        columns.push(column);
    }
    Some((rows, columns))
}

/// Refuses a design whose mechanism leaves the branch of its reference solution, with a change that was tried.
pub(super) fn finding(question: &Question, judged: &Judged) -> Option<Diagnostic> {
    let branch = Branch::of(question.model, &judged.times, &judged.double)?;
    let departure = branch.departure(&judged.hardware)?;
    if branch.departure(&judged.double).is_some() {
        return Some(left(
            question.model,
            &branch,
            &departure,
            cure(question.model, &branch),
            "in double precision, too",
        ));
    }
    let help = remedies::for_word(question).map_or_else(
        || "the word is short: take a wider multiplier or more `--storage` bits".to_owned(),
        |remedy| remedy.text(),
    );
    Some(left(question.model, &branch, &departure, help, "in fixed point alone"))
}

/// The same of a step that half of it differs from: whether that is why.
pub(super) fn refused(model: &Model) -> Option<Diagnostic> {
    model.mechanism.as_ref()?;
    let count = model.steps().min(LOOKS);
    let times: Vec<f64> = (1..=count).map(|look| model.time(model.steps() * look / count, 0.0)).collect();
    let run = sampled(model, &times)?;
    let branch = Branch::of(model, &times, &run)?;
    let departure = branch.departure(&run)?;
    Some(left(model, &branch, &departure, cure(model, &branch), "in double precision, too"))
}

fn left(model: &Model, branch: &Branch, departure: &Departure, help: String, how: &str) -> Diagnostic {
    let message = format!(
        "the mechanism leaves its branch: from t = {:.3e} s on `{}` is {:.2e} from where closed loops lead, {how}",
        departure.time,
        model.states[departure.coordinate].name,
        departure.by.abs()
    );
    Diagnostic::error(codes::BRANCH_LEFT, branch.mechanism.span, message).with_help(help)
}

/// The first change with which the step keeps the branch and half of it moves alike, tried in double precision; else the first
/// with which it keeps the branch.
fn cure(model: &Model, branch: &Branch) -> String {
    let velocity = &model.states[branch.mechanism.pairs[0].1].name;
    let velocity = velocity.split('[').next().unwrap_or(velocity);
    let factors: &[f64] = if model.solver == Solver::Trapezoidal { &[1.0, 10.0, 100.0, 1000.0] } else { &[1.0] };
    let mut kept = None;
    for (parts, factor) in
        [1.0, 2.0, 4.0].into_iter().flat_map(|parts| factors.iter().map(move |factor| (parts, *factor)))
    {
        let penalty = factor * branch.mechanism.penalty;
        let mechanism = Some(Arc::new(Mechanism { penalty, ..branch.mechanism.clone() }));
        let with_step = |step: f64| {
            let mut other = Model { mechanism: mechanism.clone(), ..model.clone() };
            other.set_step(step);
            sampled(&other, branch.times)
        };
        let step = model.step / parts;
        let Some(run) = Some(()).filter(|()| (parts, factor) != (1.0, 1.0)).and_then(|()| with_step(step)) else {
            continue;
        };
        if branch.departure(&run).is_some() {
            continue;
        }
        let set = (factor > 1.0).then(|| format!("--set {velocity}.penalty={penalty}"));
        let options: Vec<String> = set.into_iter().chain((parts > 1.0).then(|| format!("--step {step:e}"))).collect();
        let options = options.join(" ");
        let alike = |half: Trajectory| differ(&run, &half.turned(&run, &model.turns())) <= ALIKE;
        if with_step(step / 2.0).is_some_and(alike) {
            return format!("`{options}` keeps it (tried)");
        }
        kept.get_or_insert(options);
    }
    match kept {
        Some(options) => format!("`{options}` keeps it (tried), but half of that step still differs from it"),
        None => {
            "no larger penalty and no smaller step that was tried keeps it: look at what it is to do there".to_owned()
        }
    }
}

/// The largest difference of two runs, in parts of the largest magnitude of each state.
fn differ(one: &Trajectory, other: &Trajectory) -> f64 {
    let mut largest = vec![(0.0f64, 0.0f64); one.states.max(1)];
    let count = largest.len();
    for (place, (one, other)) in one.samples.iter().zip(&other.samples).enumerate() {
        let (size, apart) = &mut largest[place % count];
        (*size, *apart) = (size.max(one.abs()), apart.max((one - other).abs()));
    }
    largest.into_iter().map(|(size, apart)| if size > 0.0 { apart / size } else { 0.0 }).fold(0.0, f64::max)
}

/// States of the model's own step in double precision, at times; none if they are not finite or too many.
fn sampled(model: &Model, times: &[f64]) -> Option<Trajectory> {
    let graph = pe_hls::step::build(model).ok()?;
    if model.steps().saturating_mul(graph.macs()) > PRODUCTS {
        return None;
    }
    let mut run = DoubleRun::new(&graph);
    let mut samples = Trajectory::new(model.states.len());
    let mut step = 0;
    for time in times {
        while model.time(step, 0.0) < time - 0.5 * model.step {
            run.step(&model.sample_inputs(model.time(step, 0.0))).ok()?;
            step += 1;
        }
        samples.push(|state| run.state(StateId::at(state)));
    }
    Some(samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn next(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 33) as f64 / f64::from(1u32 << 31)
    }

    /// A parallelogram of crank, coupler and rocker with masses, torques and friction; flat it is singular, and the solution stays a
    /// parallelogram, whose coupler keeps its direction.
    struct Linkage {
        crank: f64,
        base: f64,
        spec: String,
    }

    impl Linkage {
        fn random(seed: &mut u64, slow: bool) -> Linkage {
            let (a, b) = (0.5 + next(seed), 0.5 + next(seed));
            let mut three = |low: f64, high: f64| [(); 3].map(|()| low + (high - low) * next(seed));
            let (m, torque, friction) = (three(0.3, 2.0), three(-3.0, 3.0), three(0.0, if slow { 0.9 } else { 0.3 }));
            let (speed, start) = match slow {
                true => (-next(seed) - 0.2, 0.05 + 0.4 * next(seed)),
                false => (1.5 + 3.5 * next(seed), 0.6 + 1.9 * next(seed)),
            };
            let spec = format!(
                "model linkage\nsolver SOLVER\nstep STEP s\nspan 2 s\nindex i in 1..3, j in 1..3, r in 1..2\nparam a = {a}\n\
                 param b = {b}\nparam m[i] = {m:?}\nparam t[i] = {torque:?}\nparam d[i] = {friction:?}\n\
                 param e[i] = [1, 1, -1]\nparam l[i] = [a, b, a]\nparam carried[i] = [m[1]/2 + m[2], m[2]/2, m[3]/2]\n\
                 SORT q[i] = [{start}, 0, {start}]\nstate w[i] = [{speed}, 0, {speed}]\ns[i] = sin(q[i])\nc[i] = cos(q[i])\n\
                 matrix M[i, j] symmetric\nmatrix J[r, i]\nM[i, i] = m[i]*l[i]^2/3 + (if i == 1 then m[2]*a^2 else 0)\n\
                 M[2, 1] = m[2]*a*b/2*(c[1]*c[2] + s[1]*s[2])\nturn = m[2]*a*b/2*(s[1]*c[2] - c[1]*s[2])\n\
                 f[i] = t[i] - d[i]*w[i] - 9.81*l[i]*c[i]*carried[i] + (if i == 1 then -turn*w[2]^2 else if i == 2 then \
                 turn*w[1]^2 else 0)\nJ[r, i] = e[i]*l[i]*(if r == 1 then -s[i] else c[i])\n\
                 gap[r] = sum(i: e[i]*l[i]*(if r == 1 then c[i] else s[i])) - (if r == 1 then b else 0)\n\
                 bend[r] = sum(i: e[i]*l[i]*(if r == 1 then -c[i] else -s[i])*w[i]^2)\nq' = w\n\
                 w' = constrained(M, f, J, gap, bend, PENALTY, 100)\noutput q, w\n"
            );
            Linkage { crank: a, base: b, spec }
        }

        fn model(&self, sort: &str, solver: &str, step: f64, penalty: f64) -> Model {
            let text = self.spec.replace("SORT", sort).replace("SOLVER", solver).replace("STEP", &step.to_string());
            let text = text.replace("PENALTY", &penalty.to_string());
            let mut sources = pe_ir::source::Sources::new("linkage.spec", &text);
            let compiled =
                pe_frontend::compile(&mut sources, &pe_frontend::NoFiles, &pe_frontend::Overrides::default());
            pe_hls::lift::lift(compiled.unwrap_or_else(|findings| panic!("{findings:?}\n{text}")).0)
        }

        /// Coupler and rocker of the linkage that is no parallelogram with the crank at an angle.
        fn crossed(&self, angle: f64) -> (f64, f64) {
            let (x, y) = (self.crank * libm::cos(angle), self.crank * libm::sin(angle));
            // The rocker's end, reflected at the line from the crank's end to the rocker's pivot.
            let (dx, dy) = (self.base - x, -y);
            let along = (self.base * dx) / (dx * dx + dy * dy);
            let (ex, ey) = (x + 2.0 * along * dx - self.base, y + 2.0 * along * dy);
            (libm::atan2(ey - y, ex - x), libm::atan2(ey, ex - self.base))
        }
    }

    fn times(model: &Model) -> Vec<f64> {
        (1..=200).map(|look| model.time(model.steps() * look / 200, 0.0)).collect()
    }

    #[test]
    fn linkages_that_leave_their_branch_are_found_and_no_others() {
        let mut seed = 11;
        let (mut left, mut found, mut judged) = (0, 0, 0);
        for number in 0..40 {
            let linkage = Linkage::random(&mut seed, number % 2 == 1);
            let sort = ["state", "angle"][number / 2 % 2];
            for (solver, step, penalty) in [
                ("trapezoidal", 8e-3, 4.0),
                ("trapezoidal", 1.6e-2, 4.0),
                ("trapezoidal", 3.2e-2, 10.0),
                ("rk4", 4e-3, 100.0),
            ] {
                let model = linkage.model(sort, solver, step, penalty);
                let times = times(&model);
                let Some(run) = sampled(&model, &times) else { continue };
                let Some(branch) = Branch::of(&model, &times, &run) else { continue };
                let departure = branch.departure(&run);
                // The coupler of a parallelogram keeps its direction.
                let unit = model.radians(StateId::new(1));
                let crossed = |row: &&[f64]| libm::sin(row[1] * unit / 2.0).abs() > 0.1;
                let all = || run.samples.chunks_exact(run.states);
                let (own, first) = (all().filter(crossed).count() >= 20, all().position(|row| crossed(&row)));
                judged += 1;
                left += usize::from(own);
                if let Some(departure) = departure {
                    found += usize::from(own);
                    let first =
                        first.unwrap_or_else(|| panic!("{solver} {step} {penalty}: {departure:?}\n{}", linkage.spec));
                    assert!(departure.time >= times[first] - 0.05, "{departure:?}, {}", times[first]);
                }
            }
        }
        println!("{judged} runs, {left} leave, {found} of them found");
        assert!(judged >= 100 && left >= 8 && found == left, "{judged} {left} {found}");
    }

    #[test]
    fn a_linkage_that_is_put_on_the_other_branch_is_found() {
        let mut seed = 7;
        for case in 0..6 {
            let linkage = Linkage::random(&mut seed, false);
            let model = linkage.model(["state", "angle"][case % 2], "trapezoidal", 4e-3, 400.0);
            let unit = model.radians(StateId::new(0));
            let times = times(&model);
            let mut run = sampled(&model, &times).expect("it is finite");
            let Some(branch) = Branch::of(&model, &times, &run) else { continue };
            assert_eq!(branch.departure(&run), None, "{}", linkage.spec);
            for sample in 120..times.len() {
                let (coupler, rocker) = linkage.crossed(run.samples[sample * run.states] * unit);
                (run.samples[sample * run.states + 1], run.samples[sample * run.states + 2]) =
                    (coupler / unit, rocker / unit);
            }
            let departure = branch.departure(&run).unwrap_or_else(|| panic!("{}", linkage.spec));
            assert!((times[119]..times[150]).contains(&departure.time), "{departure:?}");
        }
    }
}
