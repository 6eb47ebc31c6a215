//! The total error: the hardware's states against the reference solution of the model.

use pe_ir::codes;
use pe_ir::index::StateId;
use pe_ir::model::{Model, Variable};
use pe_ir::source::Diagnostic;
use pe_sim::compared::{Compared, Rows};
use pe_sim::error::{SCALE_FLOOR, Trajectory};
use pe_sim::reference::{self, Method, ReferenceError, Solution};

use crate::conserved::{Conserved, Drift};
use crate::oscillation::{self, Period};
use crate::progress::Progress;
use crate::runs::{Comparison, Difference, Exact, Judged, Tally, varying_inputs};

/// How much looser the tolerance of the second solution is, which tells how far the first can be trusted.
const LOOSER: f64 = 10.0;

/// Parts of the progress bar.
const BAR: u64 = 1000;

/// Deviation relative to the scale of a state from which on a run and the solution have nothing to do with each other.
const DIVERGED: f64 = 0.1;

/// Part of the error at the times of the reference from which on what its parts are larger in between counts as seen
/// there alone.
const TELLING_BETWEEN: f64 = 0.05;

/// Correct digits that are told apart, at most.
const DIGITS: f64 = 16.0;

/// A reference solution at the samples of a run, and where else it is looked at.
pub struct Reference {
    /// All times, and which of them are samples.
    all_times: Vec<f64>,
    sampled: Vec<bool>,
    /// The solution at all times.
    whole: Trajectory,
    /// Times of the samples, and the solution there.
    times: Vec<f64>,
    solution: Trajectory,
    /// Magnitudes that errors are relative to.
    scales: Vec<f64>,
    /// States in the order in which their periods are looked for.
    candidates: Vec<StateId>,
    /// Quantities that the solution conserves.
    conserved: Vec<Conserved>,
    /// States that are angles, each with the length of a turn.
    turns: Vec<(usize, f64)>,
    /// Times and states of its jumps, and of those of the second method.
    jumps: [Vec<(f64, StateId)>; 2],
    /// Relative difference to a solution with a tolerance `LOOSER` times as large.
    pub uncertainty: f64,
    /// The method that found it.
    pub method: Method,
    /// Comparison with the solution of another method, which may have none.
    pub agreement: Result<Agreement, ReferenceError>,
}

/// The largest error of all states, and where it is.
#[derive(Clone, Copy, Debug)]
pub struct Worst {
    /// The state.
    pub state: StateId,
    /// Error relative to the scale of the state.
    pub error: f64,
}

/// The total error of a run.
#[derive(Clone, Debug)]
pub struct TotalError {
    /// Over all steps: the largest at the times of the reference, plus what the parts of the error are larger in between;
    /// where that is much, at least the sum of these parts.
    pub whole: Worst,
    /// The part of it that was added for steps between these times.
    pub between: f64,
    /// Relative to the largest magnitude of a state up to the time in question.
    pub to_date: f64,
    /// Number of times at which the reference was compared.
    pub compared: usize,
    /// At the last one.
    pub end: Worst,
    /// The run in double precision with the same step, over all steps and at the last one: what the method and held
    /// inputs cost.
    pub double: (f64, f64),
    /// L2 norm of the deviation over that of the solution, all states at all samples, each relative to its scale.
    pub l2: f64,
    /// Significant correct digits of the worst state at the last sample: the negative decimal logarithm of its
    /// deviation over its own magnitude there; at most 16.
    pub digits: f64,
    /// Time in seconds of the first sample at which a state is wrong by a tenth of its scale.
    pub diverged: Option<f64>,
    /// The period of the first output that oscillates.
    pub period: Option<Period>,
    /// Drift of conserved quantities.
    pub drift: Vec<Drift>,
    /// How far the reference itself can be trusted, by its tolerance.
    pub uncertainty: f64,
    /// The method that found the reference.
    pub method: Method,
    /// How far another method agrees with it.
    pub agreement: Result<Agreement, ReferenceError>,
    /// Events of runs held against those of the solution, where a design is judged by them.
    pub events: Option<EventsOfSolution>,
}

/// Differences from the events of the reference solution.
#[derive(Clone, Debug)]
pub struct EventsOfSolution {
    /// Of the run in fixed point.
    pub fixed: Difference,
    /// Of the same steps in double precision.
    pub double: Difference,
    /// Of the solution by the second method; none if that found none.
    pub second: Option<Difference>,
}

/// Two methods compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// The second method.
    pub method: Method,
    /// Largest difference of the solutions, relative to the scale of the state.
    pub difference: f64,
    /// Time in seconds of the first sample at which they differ by [`Agreement::APART`].
    pub apart: Option<f64>,
}

impl TotalError {
    /// A warning if the two methods differ by more than the error that is told.
    pub fn doubt(&self) -> Option<Diagnostic> {
        let agreement = self.agreement.ok().filter(|agreement| agreement.difference > self.whole.error)?;
        let since = agreement.apart.map_or(String::new(), |time| format!(", from t = {time:.6e} s on by 1e-6 or more"));
        let message = format!(
            "the reference solutions by {} and by {} differ by {:.1e}{since}, which is more than the total error of {:.1e}",
            self.method.name(),
            agreement.method.name(),
            agreement.difference,
            self.whole.error
        );
        let help = "take the difference for the total error, or judge it over a shorter `--span`";
        Some(Diagnostic::global(codes::REFERENCES_DIFFER, message).with_help(help).into_warning())
    }
}

impl Agreement {
    /// Relative difference from which on the solutions of two methods are apart: then neither is the model's.
    pub const APART: f64 = 1e-6;

    /// Whether errors of this size mean something: the solutions agree ten times better.
    pub fn vouches_for(&self, error: f64) -> bool {
        10.0 * self.difference <= error
    }
}

impl Reference {
    /// Solves the model three times side by side: with different tolerances, and by another method of the library.
    /// `times` are those of samples, `looks` others, both ascending. `conserved` are the user's conserved quantities;
    /// linear invariants are found.
    ///
    /// # Errors
    /// If there is no solution up to the last of the times.
    pub fn solve(
        model: &Model,
        samples: &[f64],
        looks: &[f64],
        conserved: &[Conserved],
        progress: &dyn Progress,
    ) -> Result<Reference, ReferenceError> {
        let (all_times, sampled) = merged(samples, looks);
        let times = &all_times[..];
        let end = times.last().copied().unwrap_or(0.0);
        progress.set_length(BAR);
        let mut silent = |_: f64| {};
        let mut tell = |time: f64| progress.set_position((time / end * BAR as f64) as u64);
        let ended = |panic| std::panic::resume_unwind(panic);
        let steps = reference::explicit_steps(model);
        let tolerance = LOOSER * reference::TOLERANCE;
        let (loose, second, solution) = std::thread::scope(|scope| {
            let loose = scope.spawn(|| reference::solve_with_limit(model, times, tolerance, steps, &mut silent));
            let second = scope.spawn(|| reference::solve_by_second_method(model, times, reference::TOLERANCE));
            let solution = reference::solve_with_limit(model, times, reference::TOLERANCE, steps, &mut tell);
            (loose.join().unwrap_or_else(ended), second.join().unwrap_or_else(ended), solution)
        });
        let turns = model.turns();
        let Solution { states: solution, method, jumps } = solution?;
        let solution = solution.principal(&turns);
        let loose = loose?.states.turned(&solution, &turns);
        let scales = model.own_scales(solution.scales(&quantities(model)));
        let uncertainty = solution.deviation(&loose).worst(&scales).1.max(reference::TOLERANCE);
        let conserved = conserved.iter().cloned().chain(Conserved::found(model, &scales)).collect();
        let candidates = if varying_inputs(model) || model.has_signals() { Vec::new() } else { outputs_first(model) };
        let turned = |second: Solution| Solution { states: second.states.turned(&solution, &turns), ..second };
        let jumps = [jumps, second.as_ref().map(|second| second.jumps.clone()).unwrap_or_default()];
        let agreement = second.map(|second| agreement(times, &solution, &turned(second), &scales));
        let (whole, times) = (solution, samples.to_vec());
        let mut solution = Trajectory::new(whole.states);
        let rows = whole.samples.chunks_exact(whole.states).zip(&sampled).filter(|(_, sampled)| **sampled);
        rows.for_each(|(row, _)| solution.push(|state| row[state]));
        Ok(Reference {
            all_times,
            sampled,
            whole,
            times,
            solution,
            scales,
            candidates,
            conserved,
            turns,
            jumps,
            uncertainty,
            method,
            agreement,
        })
    }

    /// How far the fixed-point run of `judged`, sampled and looked at at the same times, is from it.
    pub fn compare(&self, model: &Model, judged: &Judged) -> TotalError {
        assert_eq!(merged(&judged.times, &judged.looks.times).0, self.all_times, "a run at other times");
        let run = &judged.hardware.clone().turned(&self.solution, &self.turns);
        let last = self.solution.last();
        let end = |run: &Trajectory| {
            let (state, error) = last.deviation(&run.last()).worst(&self.scales);
            Worst { state: StateId::at(state), error }
        };
        let drift = |conserved: &Conserved| conserved.drift(model, &self.times, &run.samples);
        let unseen = &judged.unseen;
        let hardware = self.together(run, &judged.looks.hardware);
        let compared = self.compared(model, &hardware);
        let added: Vec<f64> =
            unseen.word_length.iter().zip(&unseen.double).map(|(word, double)| word + double).collect();
        let double = self.compared(model, &self.together(&judged.double, &judged.looks.double));
        let judged_double = judged.double.as_ref().clone().turned(&self.solution, &self.turns);
        // What method and word length are at all steps, which is all they can be together.
        let together = double.relative().zip(&unseen.double).zip(&judged.state_errors);
        let together = together.map(|((seen, unseen), word_length)| seen + unseen + word_length);
        let between: Vec<f64> = compared
            .relative()
            .zip(added)
            .zip(together)
            .map(|((seen, added), together)| {
                // They may cancel at the times of the reference only.
                if added > TELLING_BETWEEN * seen { added.max(together - seen) } else { added }
            })
            .collect();
        let whole = worst(&compared, &between);
        TotalError {
            whole,
            between: between[whole.state.index()],
            to_date: compared.to_date().max(judged.errors.largest_to_date()),
            compared: self.all_times.len(),
            end: end(run),
            double: (worst(&double, &unseen.double).error, end(&judged_double).error),
            l2: self.l2(run),
            digits: self.digits(&last, &run.last()),
            diverged: first_beyond(&self.all_times, &self.whole, &hardware, &self.scales, DIVERGED),
            period: self.period(run),
            drift: self.conserved.iter().map(drift).collect(),
            uncertainty: self.uncertainty,
            method: self.method,
            agreement: self.agreement,
            events: judged.tally.as_ref().map(|tally| self.events(tally)),
        }
    }

    /// Events of the runs against those of the solution.
    fn events(&self, tally: &Tally) -> EventsOfSolution {
        let [own, second] = [0, 1].map(|number| tally.of_solution(&self.jumps[number]));
        EventsOfSolution {
            fixed: tally.difference(&own, &tally.fixed),
            double: tally.difference(&own, &tally.double),
            second: self.agreement.is_ok().then(|| tally.difference(&own, &second)),
        }
    }

    /// By how much states differ from the solution, of the worst one relative to its scale, at one of all times.
    pub fn deviation(&self, index: usize, states: &[f64]) -> f64 {
        let width = self.whole.states;
        let start = vec![0.0; width];
        let mut compared = Compared::new(0, &self.scales, &start).modulo(self.turns.clone());
        let row = |numbers: &[f64]| {
            let mut rows = Rows::new(width);
            rows.add(numbers.iter().copied());
            rows
        };
        compared.include(1, &row(&self.whole.samples[index * width..(index + 1) * width]), &row(states));
        compared.worst().1
    }

    /// One of all times in seconds.
    pub fn time(&self, index: usize) -> f64 {
        self.all_times[index]
    }

    /// Total error of a run in double precision alone: what method, held inputs and functions cost; without a comparison
    /// only that at the times of the solution.
    pub fn double_error(&self, model: &Model, exact: &Exact, comparison: Option<&Comparison>) -> f64 {
        let (samples, looks) = exact.states();
        let unseen = comparison.map_or_else(|| vec![0.0; model.states.len()], Comparison::unseen);
        worst(&self.compared(model, &self.together(samples, looks)), &unseen).error
    }

    /// A run's states at all times, from those at samples and at looks.
    fn together(&self, samples: &Trajectory, looks: &Trajectory) -> Trajectory {
        assert_eq!(samples.len() + looks.len(), self.sampled.len(), "a run at other times");
        let mut both = [samples, looks].map(|states| states.samples.chunks_exact(states.states));
        let mut together = Trajectory::new(samples.states);
        for sampled in &self.sampled {
            let row = both[usize::from(!sampled)].next().expect("as many as times");
            together.push(|state| row[state]);
        }
        together.turned(&self.whole, &self.turns)
    }

    /// A run compared with the solution at all times.
    fn compared(&self, model: &Model, run: &Trajectory) -> Compared {
        let start: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
        let mut compared = Compared::new(0, &self.scales, &start);
        let rows = |trajectory: &Trajectory| {
            let mut rows = Rows::new(trajectory.states);
            let all = trajectory.samples.chunks_exact(trajectory.states);
            all.for_each(|row| rows.add(row.iter().copied()));
            rows
        };
        compared.include(run.len() as u64, &rows(&self.whole), &rows(run));
        compared
    }

    fn l2(&self, run: &Trajectory) -> f64 {
        let mut sums = (0.0, 0.0);
        for (solution, run, scale) in
            pairs(&self.solution, run, &self.scales).filter(|(.., scale)| *scale > 0.0 && scale.is_finite())
        {
            let (wrong, whole) = ((run - solution) / scale, solution / scale);
            sums = (sums.0 + wrong * wrong, sums.1 + whole * whole);
        }
        if sums.0 == 0.0 { 0.0 } else { libm::sqrt(sums.0 / sums.1) }
    }

    /// Significant correct digits of a sample; a state close to zero is judged by a part of its scale.
    fn digits(&self, solution: &Trajectory, run: &Trajectory) -> f64 {
        let numbers = solution.samples.iter().zip(&run.samples).zip(&self.scales);
        let digits = numbers.map(|((solution, run), scale)| {
            let wrong = (run - solution).abs();
            if wrong == 0.0 { DIGITS } else { -libm::log10(wrong / solution.abs().max(SCALE_FLOOR * scale)) }
        });
        digits.fold(DIGITS, f64::min)
    }

    fn period(&self, run: &Trajectory) -> Option<Period> {
        let of = |trajectory: &Trajectory, state: StateId| -> Vec<f64> {
            trajectory.samples.iter().skip(state.index()).step_by(trajectory.states).copied().collect()
        };
        let period =
            |state: &StateId| oscillation::period(*state, &self.times, &of(&self.solution, *state), &of(run, *state));
        self.candidates.iter().find_map(period)
    }
}

/// The state with the largest error, where `added` comes on top.
fn worst(compared: &Compared, added: &[f64]) -> Worst {
    let errors = compared.relative().zip(added).map(|(error, added)| error + added).enumerate();
    let larger = |worst: Worst, (state, error)| {
        if error > worst.error { Worst { state: StateId::at(state), error } } else { worst }
    };
    errors.fold(Worst { state: StateId::new(0), error: 0.0 }, larger)
}

/// Times of samples and others in one order, and which of them are samples.
fn merged(samples: &[f64], others: &[f64]) -> (Vec<f64>, Vec<bool>) {
    let mut all: Vec<(f64, bool)> = samples.iter().map(|time| (*time, true)).collect();
    all.extend(others.iter().map(|time| (*time, false)));
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all.into_iter().unzip()
}

/// Numbers of samples, state by state: solution, other, scale.
fn pairs<'a>(
    solution: &'a Trajectory,
    other: &'a Trajectory,
    scales: &'a [f64],
) -> impl Iterator<Item = (f64, f64, f64)> + 'a {
    let numbers = solution.samples.iter().zip(&other.samples);
    numbers.zip(scales.iter().cycle()).map(|((solution, other), scale)| (*solution, *other, *scale))
}

/// Time of the first sample at which some state of `other` deviates by more than `limit` of its scale.
fn first_beyond(times: &[f64], solution: &Trajectory, other: &Trajectory, scales: &[f64], limit: f64) -> Option<f64> {
    let within = |(solution, other, scale): (f64, f64, f64)| (other - solution).abs() <= limit * scale;
    let beyond = pairs(solution, other, scales).position(|numbers| !within(numbers))?;
    Some(times[beyond / solution.states])
}

/// How far another solution at the same times agrees.
fn agreement(times: &[f64], solution: &Trajectory, second: &Solution, scales: &[f64]) -> Agreement {
    Agreement {
        method: second.method,
        difference: solution.deviation(&second.states).worst(scales).1,
        apart: first_beyond(times, solution, &second.states, scales, Agreement::APART),
    }
}

fn quantities(model: &Model) -> Vec<u32> {
    model.states.iter().map(|state| state.quantity).collect()
}

/// The first states, those that are outputs first.
fn outputs_first(model: &Model) -> Vec<StateId> {
    const MOST: usize = 16;
    let outputs = model.outputs.iter().filter_map(|output| match output.variable {
        Variable::State(state) => Some(state),
        _ => None,
    });
    let mut states: Vec<StateId> = Vec::new();
    for state in outputs.chain(model.states.ids()) {
        if states.len() < MOST && !states.contains(&state) && !model.states[state].angle {
            states.push(state);
        }
    }
    states
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_state(samples: [f64; 4]) -> Trajectory {
        Trajectory { samples: samples.to_vec(), ..Trajectory::new(1) }
    }

    const TIMES: [f64; 4] = [0.5, 1.0, 1.5, 2.0];
    const RISE: [f64; 4] = [1.0, 2.0, 3.0, 4.0];

    #[test]
    fn a_wrong_solution_of_the_second_method_is_noticed() {
        let solution = |samples| Solution { states: one_state(samples), method: Method::Verner98, jumps: Vec::new() };
        let second = |samples| agreement(&TIMES, &one_state(RISE), &solution(samples), &[4.0]);
        let close = second([1.0, 2.0, 3.0, 4.0 + 4e-10]);
        assert!(close.vouches_for(1e-8) && close.apart.is_none(), "{close:?}");
        let wrong = second([1.0, 2.0, 3.0 + 4e-4, 4.0]);
        assert!(!wrong.vouches_for(1e-8) && wrong.apart == Some(1.5), "{wrong:?}");
        let broken = second([1.0, f64::NAN, 3.0, 4.0]);
        assert!(!broken.vouches_for(1e-8) && broken.apart == Some(1.0), "{broken:?}");
    }

    #[test]
    fn norms_and_digits_are_those_of_their_definitions() {
        let reference = Reference {
            all_times: TIMES.to_vec(),
            sampled: vec![true; TIMES.len()],
            whole: one_state(RISE),
            times: TIMES.to_vec(),
            solution: one_state(RISE),
            scales: vec![4.0],
            candidates: Vec::new(),
            conserved: Vec::new(),
            turns: Vec::new(),
            jumps: Default::default(),
            uncertainty: 1e-12,
            method: Method::Dop853,
            agreement: Ok(Agreement { method: Method::Verner98, difference: 0.0, apart: None }),
        };
        let run = one_state([1.0, 2.0, 3.0, 4.04]);
        assert!((reference.l2(&run) - 0.04 / libm::sqrt(30.0)).abs() < 1e-12);
        assert!((reference.digits(&reference.solution.last(), &run.last()) - 2.0).abs() < 1e-9);
        let beyond = |limit| first_beyond(&TIMES, &reference.solution, &run, &[4.0], limit);
        assert_eq!((beyond(0.1), beyond(0.001)), (None, Some(2.0)));
    }

    #[test]
    fn methods_that_differ_by_more_than_the_error_are_told() {
        let worst = Worst { state: StateId::new(0), error: 1e-9 };
        let total = |difference| TotalError {
            whole: worst,
            between: 0.0,
            to_date: 1e-9,
            compared: 1,
            end: worst,
            double: (0.0, 0.0),
            l2: 0.0,
            digits: 9.0,
            diverged: None,
            period: None,
            drift: Vec::new(),
            uncertainty: 1e-12,
            method: Method::Radau5,
            agreement: Ok(Agreement { method: Method::Bdf, difference, apart: None }),
            events: None,
        };
        assert!(total(9e-10).doubt().is_none());
        let finding = total(2e-9).doubt().expect("they differ");
        assert!(finding.code == "W0914" && finding.message.contains("Radau5 and by BDF"), "{}", finding.message);
    }
}
