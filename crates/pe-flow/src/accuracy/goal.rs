//! The cheapest point that meets the goal, and which points to try next.

use pe_hls::schedule::Bound;
use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_ir::word::Latency;
use pe_sim::reference::TOLERANCE;

use super::early::{self, Method};
use super::lists::{Lists, Plan, WORD, Word};
use super::wanted::{Figure, Goals};
use crate::explore::axes::{once, with_forms};
use crate::explore::row::{Outcome, Row};
use crate::report::Figures;
use crate::settings::MappingOptions;
use pe_hls::mapping::default_pes;
use pe_judge::DesignPoint;
use pe_judge::check::stiffness;
use pe_judge::early::Early;

/// Products over the span that a run may take: first so many, then four times as many in every round.
const FIRST_PRODUCTS: f64 = 1e7;

/// Products over the span that a run may take at last.
pub const MOST_PRODUCTS: f64 = 1e9;

/// Lower bound of the run time over the lowest of those that are right enough, from which on others are no rivals.
const RIVAL: f64 = 2.5;

/// The same where the size is to be small.
const SMALL_RIVAL: f64 = 16.0;

/// Doublings of a step at once, at most, and how far it may be from one that is known to be too long.
const DOUBLINGS: f64 = 3.0;
const APART: f64 = 1.2;

/// Error below which one that does not fall any more is rounding of double precision and of the reference, and what is
/// left of others in a smaller step.
const ROUNDING: f64 = 1e-9;
const STUCK: f64 = 0.7;

/// Steps that a span has at least.
const FEWEST_STEPS: f64 = 10.0;

/// Part of the limit that another step aims at.
const AIM: f64 = 0.7;

/// Solvers and steps with which all words are tried, how much longer their run time may be than the shortest, and those
/// with which longer words are tried if the word is what is wrong.
const FINALISTS: usize = 4;
const CLOSE_TIME: f64 = 1.5;
const SHORT_OF_BITS: usize = 4;

/// Solvers that are tried with lists of steps, how much longer than the shortest the run time with the first step for
/// all of the span may be, of stiff models and of others, and rounds of them.
const LISTED_SOLVERS: usize = 2;
const LISTED_STIFF: f64 = 64.0;
const LISTED: f64 = 4.0;

/// Steps over the span for the sake of stability from which on a model counts as stiff: over a beginning that is not
/// smooth accuracy may ask for as many, which says nothing of what follows.
const MANY_STEPS: f64 = 2000.0;
const LIST_ROUNDS: u32 = 3;

/// Rounds of new steps, and of words if nothing is right enough.
const ROUNDS: u32 = 10;
const WORD_ROUNDS: u32 = 4;

/// Rows whose total error is at most `limit`: the cheapest first, then the others by run time, see [`Goals::ranked`].
pub fn cheapest(rows: &[Row], limit: f64) -> Vec<usize> {
    Goals::error(limit).ranked(rows)
}

/// A search for the cheapest point: first solvers and steps whose run in double precision is right enough, at one word,
/// then words for the best of them, and longer words where rounding is what is wrong.
pub struct Search<'a> {
    model: &'a Model,
    mapping: &'a MappingOptions,
    lists: &'a Lists,
    solvers: Vec<Candidate>,
    free_steps: bool,
    words: Vec<Word>,
    /// The word at which solvers and steps are compared.
    word: Word,
    limit: f64,
    /// Whether numbers of PEs are tried.
    sizes: bool,
    /// Whether the size is to be small.
    small: bool,
    next: Stage,
}

/// A solver and what its step takes.
struct Candidate {
    solver: Solver,
    /// Numbers of PEs, as long as more of them can be faster.
    pes: Vec<u32>,
    products: f64,
    /// Clock cycles, at least.
    cycles: f64,
}

/// What is tried next, and for how many rounds already.
#[derive(Clone, Copy)]
enum Stage {
    Steps(u32),
    Lists(u32),
    Words(u32),
    Sizes,
    Done,
}

impl<'a> Search<'a> {
    /// A search among the points of a plan and more.
    pub fn new(model: &'a Model, mapping: &'a MappingOptions, lists: &'a Lists, plan: &Plan, limit: f64) -> Search<'a> {
        let word =
            plan.words.iter().copied().find(|word| *word == WORD).or(plan.words.first().copied()).unwrap_or(WORD);
        let latency = lists.point(model.solver, model.step, word).format(model).map(|format| Latency::of(&format)).ok();
        let candidate = |(solver, graph): &(Solver, StepGraph)| {
            let bound = |latency| {
                Bound::of(graph, lists.pes.unwrap_or_else(|| default_pes(graph, latency)), latency).binding().0
            };
            let cycles = latency.map_or(1.0, |latency| f64::from(bound(latency)));
            let pes = latency.map_or_else(Vec::new, |latency| useful_pes(graph, latency));
            Candidate { solver: *solver, pes, products: graph.macs() as f64, cycles }
        };
        let solvers = plan.graphs.iter().map(candidate).collect();
        let (free_steps, words) = (plan.free_steps, plan.words.clone());
        let (sizes, small, next) = (false, false, Stage::Steps(0));
        Search { model, mapping, lists, solvers, free_steps, words, word, limit, sizes, small, next }
    }

    /// The same for goals beside the error: numbers of PEs are tried for the best points unless one is given, and slower
    /// methods where the size is to be small.
    #[must_use]
    pub fn wanting(self, goals: &Goals) -> Search<'a> {
        let small = goals.minimise == Figure::Area;
        Search { sizes: goals.concern_size() && self.lists.pes.is_none(), small, ..self }
    }

    /// Run time over the shortest up to which a method is worth a try.
    fn rival(&self) -> f64 {
        if self.small { SMALL_RIVAL } else { RIVAL }
    }

    /// The points that a search begins with: solvers and steps at one word. Where a run with the spec's steps takes
    /// more products than the first round allows, steps are as much longer: which shorter ones are worth it shows then.
    pub fn begin(&self, plan: &Plan) -> Vec<DesignPoint> {
        let at_word = |point: &&DesignPoint| Word::of(point) == self.word;
        let points = plan.points.iter().filter(at_word);
        let mut points: Vec<DesignPoint> = points.map(|point| self.affordable(*point).unwrap_or(*point)).collect();
        once(&mut points);
        points
    }

    /// A point with a step that is longer by a power of two, as long as the first round asks for; none if it need not
    /// be, or cannot be.
    fn affordable(&self, point: DesignPoint) -> Option<DesignPoint> {
        let (solver, step) = point.solver.zip(point.step).filter(|_| self.free_steps)?;
        let doublings = libm::ceil(libm::log2(self.products(self.single(solver, step)) / FIRST_PRODUCTS));
        let longer = (doublings > 0.0).then(|| libm::scalbn(step, doublings as i32))?;
        let longer = self.lists.suitable(self.model, longer)?;
        let suits = longer > step && longer <= self.model.span / FEWEST_STEPS;
        suits.then_some(DesignPoint { step: Some(longer), ..point })
    }

    /// Points to try next; none when the search is over.
    pub fn next(&mut self, rows: &[Row]) -> Vec<DesignPoint> {
        // Without a reference no error is known, and none is to be had by other steps.
        let unknown = |row: &Row| row.figures().is_some_and(|figures| figures.total_error().is_none());
        // Nor does a reference tell errors that are smaller than its own.
        if rows.iter().any(unknown) || self.limit < TOLERANCE {
            self.next = Stage::Done;
        }
        loop {
            let points = match self.next {
                Stage::Steps(round) => {
                    let budget = FIRST_PRODUCTS * libm::scalbn(1.0, 2 * round as i32);
                    let again = self.free_steps && round < ROUNDS;
                    let points = if again { self.new_ones(rows, self.steps(rows, budget)) } else { Vec::new() };
                    let over = points.is_empty() && !again;
                    self.next = if over { Stage::Lists(0) } else { Stage::Steps(round + 1) };
                    points
                }
                Stage::Lists(round) => {
                    self.next = if round + 1 == LIST_ROUNDS { Stage::Words(0) } else { Stage::Lists(round + 1) };
                    self.new_ones(rows, self.lists_of_steps(rows, round))
                }
                Stage::Words(round) => {
                    let found = round > 0 && !cheapest(rows, self.limit).is_empty();
                    let over = found || round >= WORD_ROUNDS;
                    let points = if over { Vec::new() } else { self.new_ones(rows, self.finals(rows, round)) };
                    self.next = if over { Stage::Sizes } else { Stage::Words(round + 1) };
                    points
                }
                Stage::Sizes => {
                    self.next = Stage::Done;
                    self.new_ones(rows, self.sizes(rows))
                }
                Stage::Done => return Vec::new(),
            };
            if !points.is_empty() {
                return points;
            }
        }
    }

    fn new_ones(&self, rows: &[Row], points: Vec<DesignPoint>) -> Vec<DesignPoint> {
        let points = with_forms(points, self.model, self.mapping);
        points.into_iter().filter(|point| rows.iter().all(|row| row.point != *point)).collect()
    }

    fn of_solver<T>(&self, solver: Solver, figure: impl Fn(&Candidate) -> T) -> Option<T> {
        self.solvers.iter().find(|other| other.solver == solver).map(figure)
    }

    /// Products of a run, over the span.
    fn products(&self, method: Method) -> f64 {
        let macs = self.of_solver(method.solver, |candidate| candidate.products);
        macs.map_or(f64::INFINITY, |macs| macs * method.steps(self.model))
    }

    /// Clock cycles of a run on the hardware over the span, at least.
    fn cycles(&self, method: Method) -> f64 {
        let cycles = self.of_solver(method.solver, |candidate| candidate.cycles);
        cycles.map_or(f64::INFINITY, |cycles| cycles * method.steps(self.model))
    }

    /// Products that a run may take, at most: so many, or a few times those of the spec's own step.
    fn most_products(&self, solver: Solver) -> f64 {
        MOST_PRODUCTS.max(4.0 * self.products(self.single(solver, self.model.step)))
    }

    /// A solver with one step for all of the span, or with those for the beginning that the user gave.
    fn single(&self, solver: Solver, step: f64) -> Method {
        Method { solver, step, early: self.lists.early_steps }
    }

    /// The lower bound of the run time of those that are right enough in double precision.
    fn least(&self, rows: &[Row]) -> f64 {
        let fitting = rows.iter().filter(|row| self.fits(row)).filter_map(Method::of);
        fitting.map(|method| self.cycles(method)).fold(f64::INFINITY, f64::min)
    }

    /// Rows of a solver with one step, by the step.
    fn tried<'r>(&self, rows: &'r [Row], solver: Solver) -> Vec<(f64, &'r Row)> {
        let of_solver = |row: &&Row| {
            Method::of(row).is_some_and(|method| method == self.single(solver, method.step))
                && Word::of(&row.point) == self.word
                && row.point.pes == self.lists.pes
        };
        let mut tried: Vec<(f64, &Row)> =
            rows.iter().filter(of_solver).filter_map(|row| Some((row.point.step?, row))).collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        tried
    }

    /// The next step of each solver, where the steps so far leave open which is the largest that is right enough in
    /// double precision, as far as a run takes no more products than the budget and may be among the fastest.
    fn steps(&self, rows: &[Row], budget: f64) -> Vec<DesignPoint> {
        let least = self.least(rows);
        let next = |candidate: &Candidate| {
            let solver = candidate.solver;
            let tried = self.tried(rows, solver);
            let step = match tried.iter().rposition(|(_, row)| self.fits(row)) {
                Some(largest) => self.larger(solver, tried[largest], tried.get(largest + 1).map(|(step, _)| *step)),
                None => self
                    .smaller(solver, &tried)
                    .filter(|step| self.products(self.single(solver, *step)) <= budget.min(self.most_products(solver))),
            };
            let step = step.filter(|step| self.cycles(self.single(solver, *step)) <= self.rival() * least)?;
            Some(self.lists.point(solver, step, self.word))
        };
        self.solvers.iter().filter_map(next).collect()
    }

    /// How much longer the step has to be for a part of the limit, by the order of the method.
    fn factor(&self, solver: Solver, double: f64) -> f64 {
        libm::pow(AIM * self.limit / double.max(f64::MIN_POSITIVE), 1.0 / f64::from(solver.order()))
    }

    /// A step that is longer than one that is right enough, and shorter than one that is not, if there is one.
    fn larger(&self, solver: Solver, (step, row): (f64, &Row), wrong: Option<f64>) -> Option<f64> {
        let expected = errors(row).map_or(1.0, |(_, double)| libm::log2(self.factor(solver, double)));
        let doublings = libm::floor(expected).clamp(1.0, DOUBLINGS) as i32;
        let most = wrong.map_or(self.model.span / FEWEST_STEPS, |wrong| wrong / APART);
        let fitting = |doublings: &i32| {
            let next = self.lists.suitable(self.model, libm::scalbn(step, *doublings))?;
            (next > APART * step && next <= most).then_some(next)
        };
        (1..=doublings).rev().find_map(|doublings| fitting(&doublings))
    }

    /// A step that is shorter than all so far, of which none is right enough.
    fn smaller(&self, solver: Solver, tried: &[(f64, &Row)]) -> Option<f64> {
        let (smallest, finest) = *tried.first()?;
        let factor = match errors(finest) {
            Some((_, double)) => {
                let before = tried.get(1).and_then(|(_, row)| errors(row)).map_or(f64::INFINITY, |(_, before)| before);
                if double < ROUNDING && double > STUCK * before {
                    return None;
                }
                self.factor(solver, double)
            }
            None if unstable(finest) => 0.25,
            None => return None,
        };
        let halvings = libm::ceil(-libm::log2(factor)).max(1.0);
        let step = self.lists.suitable(self.model, libm::scalbn(smallest, -(halvings as i32)));
        step.filter(|step| *step < smallest)
    }

    /// Whether a run in double precision is right enough.
    fn fits(&self, row: &Row) -> bool {
        errors(row).map_or_else(|| short_of_bits(row), |(_, double)| double <= self.limit)
    }

    /// The best solvers and steps with all words; longer words where only the word is wrong.
    fn finals(&self, rows: &[Row], round: u32) -> Vec<DesignPoint> {
        let mut best: Vec<Method> = Vec::new();
        let time = |index: usize| rows[index].figures().map_or(f64::INFINITY, Figures::time_ms);
        let smallest = self.small.then_some(Figure::Area);
        for minimise in [Figure::Time].into_iter().chain(smallest) {
            let ranked = Goals { minimise, ..Goals::error(self.limit) }.ranked(rows);
            let close = |index: &&usize| minimise == Figure::Area || time(**index) <= CLOSE_TIME * time(ranked[0]);
            let most = best.len() + FINALISTS;
            for index in ranked.iter().filter(close) {
                if let Some(method) = Method::of(&rows[*index])
                    && best.len() < most
                    && !best.contains(&method)
                {
                    best.push(method);
                }
            }
        }
        let words = |method: Method| self.words.iter().map(move |word| self.point(method, *word));
        let mut points: Vec<DesignPoint> = best.iter().flat_map(|method| words(*method)).collect();
        // Only the word is wrong, so far.
        let fitting = rows.iter().filter(|row| self.fits(row)).filter_map(Method::of);
        let mut short: Vec<Method> = fitting.filter(|method| !best.contains(method)).collect();
        short.sort_by(|a, b| self.cycles(*a).total_cmp(&self.cycles(*b)));
        short.dedup();
        if round > 0 {
            // Longer words were not enough: the method may have what is left of the error.
            short = short.iter().filter_map(|method| self.half(*method)).collect();
        }
        // Among those that met the goal one that is not among the best is slower.
        short.retain(|method| best.iter().all(|best| self.cycles(*method) < self.cycles(*best)));
        let longer = |word: &&Word| word.holds(&self.word);
        // Those whose longer words were tried before would stand in the way of others.
        let tried = |method: &Method| {
            let with_it = |row: &&Row| Method::of(row) == Some(*method);
            rows.iter().filter(with_it).any(|row| Word::of(&row.point) != self.word)
        };
        short.retain(|method| !tried(method));
        for method in short.into_iter().take(SHORT_OF_BITS) {
            points.extend(self.words.iter().filter(longer).map(|word| self.point(method, *word)));
        }
        points
    }

    /// The fastest and the smallest of the points that are right enough with other numbers of PEs.
    fn sizes(&self, rows: &[Row]) -> Vec<DesignPoint> {
        let mut best: Vec<usize> = Vec::new();
        for minimise in [Figure::Time, Figure::Area].into_iter().filter(|_| self.sizes) {
            let ranked = Goals { minimise, ..Goals::error(self.limit) }.ranked(rows);
            best.extend(ranked.into_iter().take(FINALISTS));
        }
        once(&mut best);
        let sized = |index: usize| {
            let (point, known) = (rows[index].point, rows[index].figures().map(|figures| figures.pes as u32));
            let pes = point.solver.and_then(|solver| self.of_solver(solver, |candidate| candidate.pes.clone()));
            let others = pes.unwrap_or_default().into_iter().filter(move |pes| Some(*pes) != known);
            others.map(move |pes| DesignPoint { pes: Some(pes), ..point })
        };
        best.into_iter().flat_map(sized).collect()
    }

    /// Half of the step, if steps are free.
    fn half(&self, method: Method) -> Option<Method> {
        let half = match method.early.filter(|_| self.lists.early_steps.is_none()) {
            // A list is one of the search's own: all of its steps are halved.
            Some(early) => {
                let halves: Vec<(f64, f64)> = early.list().iter().map(|(step, until)| (step / 2.0, *until)).collect();
                Method { step: method.step / 2.0, early: Early::new(&halves), ..method }
            }
            None => Method { step: self.lists.suitable(self.model, method.step / 2.0)?, ..method },
        };
        (self.free_steps && self.products(half) <= self.most_products(half.solver)).then_some(half)
    }

    fn point(&self, method: Method, word: Word) -> DesignPoint {
        DesignPoint { early_steps: method.early, ..self.lists.point(method.solver, method.step, word) }
    }

    /// Lists of steps for the solvers that take them: first one short step for the beginning, then another one behind
    /// it.
    fn lists_of_steps(&self, rows: &[Row], round: u32) -> Vec<DesignPoint> {
        let model = self.model;
        if !self.free_steps || !model.phases.is_empty() || !model.rates.is_empty() || model.has_equal_steps() {
            return Vec::new();
        }
        let least = self.least(rows);
        let long = |step: f64| self.lists.suitable(model, step);
        let mut lists: Vec<Method> = Vec::new();
        if round == 0 {
            let candidates =
                self.solvers.iter().map(|candidate| candidate.solver).filter(|solver| solver.takes_lists());
            let short = |solver: Solver| {
                let tried = self.tried(rows, solver);
                let largest = tried.iter().rfind(|(_, row)| self.fits(row)).map(|(step, _)| *step);
                let step = largest.or_else(|| self.smaller(solver, &tried))?;
                Some((self.single(solver, step), largest.is_some()))
            };
            let mut short: Vec<(Method, bool)> = candidates.filter_map(short).collect();
            let stiff = || stiffness::steps(model).is_some_and(|steps| steps > MANY_STEPS);
            let listed = |factor: f64| move |(method, _): &(Method, bool)| self.cycles(*method) <= factor * least;
            if !short.iter().all(listed(LISTED)) {
                short.retain(listed(if stiff() { LISTED_STIFF } else { LISTED }));
            }
            short.sort_by(|a, b| self.cycles(a.0).total_cmp(&self.cycles(b.0)));
            for (method, fits) in short.into_iter().take(LISTED_SOLVERS) {
                lists.extend(early::single(method, model.span, if fits { 1.0 } else { 4.0 }, long));
            }
        } else {
            let of_lists = rows.iter().filter(|row| row.point.early_steps.is_some() && self.fits(row));
            let best = of_lists.filter_map(Method::of).min_by(|a, b| self.cycles(*a).total_cmp(&self.cycles(*b)));
            lists.extend(best.iter().flat_map(|method| early::longer(*method, model.span, long)));
        }
        lists.retain(|list| self.cycles(*list) < least && self.products(*list) <= self.most_products(list.solver));
        lists.into_iter().map(|list| self.point(list, self.word)).collect()
    }
}

/// Powers of two, for as long as the bound of the cycles falls.
fn useful_pes(graph: &StepGraph, latency: Latency) -> Vec<u32> {
    let bound = |pes: u32| Bound::of(graph, pes, latency).binding().0;
    let mut pes = vec![1];
    let mut last = bound(1);
    loop {
        let next = 2 * pes[pes.len() - 1];
        if next as usize > graph.equations.len() || bound(next) >= last {
            return pes;
        }
        last = bound(next);
        pes.push(next);
    }
}

/// Whether a point failed for a reason that a smaller step can mend.
fn unstable(row: &Row) -> bool {
    let code = match &row.outcome {
        Outcome::Failed(reason) => reason.code.as_deref(),
        Outcome::Compiled(_) => None,
    };
    [codes::DIVERGED, codes::STEP_TOO_LARGE, codes::SATURATED, codes::OUTSIDE_DOMAIN, codes::SMALL_PIVOT]
        .iter()
        .any(|known| code == Some(*known))
}

/// Whether a point failed for its word.
fn short_of_bits(row: &Row) -> bool {
    let code = match &row.outcome {
        Outcome::Failed(reason) => reason.code.as_deref(),
        Outcome::Compiled(_) => None,
    };
    [codes::WORD_TOO_SHORT, codes::POLE_MOVED].iter().any(|known| code == Some(*known))
}

/// Total error of a row and that of its run in double precision, if both are known.
pub fn errors(row: &Row) -> Option<(f64, f64)> {
    match &row.outcome {
        Outcome::Compiled(compiled) => {
            let error = &compiled.figures.error;
            Some((error.total?, error.of_total.as_ref()?.double))
        }
        Outcome::Failed(reason) => reason.beyond,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time: f64, lut: f64, error: f64) -> Row {
        Row::compiled(lut, time, Some(error))
    }

    #[test]
    fn of_points_that_are_right_enough_the_fastest_is_taken_and_of_equally_fast_ones_the_smallest() {
        let rows = [
            row(1.00, 900.0, 1e-5),
            row(0.50, 100.0, 1e-3), // too wrong
            row(1.01, 300.0, 2e-5), // as fast as the first, and smaller
            row(1.50, 100.0, 1e-6),
        ];
        assert_eq!(cheapest(&rows, 1e-4), [2, 0, 3]);
        assert_eq!(cheapest(&rows, 1e-6), [3]);
        assert!(cheapest(&rows, 1e-7).is_empty());
    }
}
