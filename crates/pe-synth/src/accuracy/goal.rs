//! The cheapest point that is right enough, and which points to try next.

use pe_hls::schedule::Bound;
use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_ir::word::Latency;
use pe_sim::reference::TOLERANCE;

use super::lists::{Lists, Plan, WORD, Word};
use crate::explore::axes::with_forms;
use crate::explore::row::{Figures, Outcome, Row};
use crate::options::DesignPoint;
use crate::pipeline::{MappingOptions, default_pes};

/// Run times this close count as equal; then size decides.
const EQUAL_TIME: f64 = 1.02;

/// Products over the span that a run may take: first so many, then four times as many in every round.
const FIRST_PRODUCTS: f64 = 1e7;

/// Products over the span that a run may take at last.
pub const MOST_PRODUCTS: f64 = 1e9;

/// Lower bound of the run time over the lowest of those that are right enough, from which on others are no rivals.
const RIVAL: f64 = 2.5;

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

/// Rounds of new steps, and of words if nothing is right enough.
const ROUNDS: u32 = 10;
const WORD_ROUNDS: u32 = 4;

/// Rows whose total error is at most `limit`: the cheapest first, then the others by run time. Cheap is a short run
/// time; of those within two percent of the shortest the smallest design.
pub fn cheapest(rows: &[Row], limit: f64) -> Vec<usize> {
    let figures = |index: &usize| rows[*index].figures().expect("filtered");
    let met = |index: &usize| rows[*index].figures().and_then(Figures::total_error).is_some_and(|error| error <= limit);
    let mut met: Vec<usize> = (0..rows.len()).filter(met).collect();
    let key = |index: &usize| (figures(index).time_ms(), figures(index).equivalent_lut());
    met.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let Some(first) = met.first() else { return met };
    let slowest = EQUAL_TIME * key(first).0;
    let fastest = met.iter().enumerate().take_while(|(_, index)| key(index).0 <= slowest);
    let smallest = fastest.min_by(|(_, a), (_, b)| key(a).1.total_cmp(&key(b).1)).map_or(0, |(place, _)| place);
    let chosen = met.remove(smallest);
    met.insert(0, chosen);
    met
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
    next: Stage,
}

/// A solver and what its step takes.
struct Candidate {
    solver: Solver,
    products: f64,
    /// Clock cycles, at least.
    cycles: f64,
}

/// What is tried next, and for how many rounds already.
#[derive(Clone, Copy)]
enum Stage {
    Steps(u32),
    Words(u32),
    Done,
}

impl<'a> Search<'a> {
    /// A search among the points of a plan and more.
    pub fn new(model: &'a Model, mapping: &'a MappingOptions, lists: &'a Lists, plan: &Plan, limit: f64) -> Search<'a> {
        let word =
            plan.words.iter().copied().find(|word| *word == WORD).or(plan.words.first().copied()).unwrap_or(WORD);
        let latency = lists.point(model.solver, model.step, word).format(model).map(|format| Latency::of(&format)).ok();
        let candidate = |(solver, graph): &(Solver, StepGraph)| {
            let bound =
                |latency| Bound::of(graph, lists.pes.unwrap_or_else(|| default_pes(graph)), latency).binding().0;
            let cycles = latency.map_or(1.0, |latency| f64::from(bound(latency)));
            Candidate { solver: *solver, products: graph.macs() as f64, cycles }
        };
        let solvers = plan.graphs.iter().map(candidate).collect();
        let (free_steps, words) = (plan.free_steps, plan.words.clone());
        Search { model, mapping, lists, solvers, free_steps, words, word, limit, next: Stage::Steps(0) }
    }

    /// The points that a search begins with: solvers and steps at one word.
    pub fn begin(&self, plan: &Plan) -> Vec<DesignPoint> {
        let at_word = |point: &&DesignPoint| Word::of(point) == self.word;
        plan.points.iter().filter(at_word).copied().collect()
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
                    self.next = if over { Stage::Words(0) } else { Stage::Steps(round + 1) };
                    points
                }
                Stage::Words(round) => {
                    let found = round > 0 && !cheapest(rows, self.limit).is_empty();
                    let over = found || round >= WORD_ROUNDS;
                    let points = if over { Vec::new() } else { self.new_ones(rows, self.finals(rows, round)) };
                    self.next = if over { Stage::Done } else { Stage::Words(round + 1) };
                    points
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

    /// Steps over the span.
    fn count(&self, step: f64) -> f64 {
        self.model.steps() as f64 * self.model.step / step
    }

    /// Products of a solver's run with a step, over the span.
    fn products(&self, solver: Solver, step: f64) -> f64 {
        self.of_solver(solver, |candidate| candidate.products).map_or(f64::INFINITY, |macs| macs * self.count(step))
    }

    /// Clock cycles of a solver's run with a step on the hardware over the span, at least.
    fn cycles(&self, solver: Solver, step: f64) -> f64 {
        self.of_solver(solver, |candidate| candidate.cycles).map_or(f64::INFINITY, |cycles| cycles * self.count(step))
    }

    /// Products that a run may take, at most: so many, or a few times those of the spec's own step.
    fn most_products(&self, solver: Solver) -> f64 {
        MOST_PRODUCTS.max(4.0 * self.products(solver, self.model.step))
    }

    /// The next step of each solver, where the steps so far leave open which is the largest that is right enough in
    /// double precision, as far as a run takes no more products than the budget and may be among the fastest.
    fn steps(&self, rows: &[Row], budget: f64) -> Vec<DesignPoint> {
        let fitting = rows.iter().filter(|row| self.fits(row)).filter_map(pair);
        let least = fitting.map(|(solver, step)| self.cycles(solver, step)).fold(f64::INFINITY, f64::min);
        let next = |candidate: &Candidate| {
            let solver = candidate.solver;
            let of_solver = |row: &&Row| row.point.solver == Some(solver) && Word::of(&row.point) == self.word;
            let mut tried: Vec<(f64, &Row)> =
                rows.iter().filter(of_solver).filter_map(|row| Some((row.point.step?, row))).collect();
            tried.sort_by(|a, b| a.0.total_cmp(&b.0));
            let step = match tried.iter().rposition(|(_, row)| self.fits(row)) {
                Some(largest) => self.larger(solver, tried[largest], tried.get(largest + 1).map(|(step, _)| *step)),
                None => self
                    .smaller(solver, &tried)
                    .filter(|step| self.products(solver, *step) <= budget.min(self.most_products(solver))),
            };
            let step = step.filter(|step| self.cycles(solver, *step) <= RIVAL * least)?;
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
        let mut best: Vec<(Solver, f64)> = Vec::new();
        let ranked = cheapest(rows, self.limit);
        let time = |index: usize| rows[index].figures().map_or(f64::INFINITY, Figures::time_ms);
        let close = |index: &&usize| time(**index) <= CLOSE_TIME * time(ranked[0]);
        for index in ranked.iter().filter(close) {
            if let Some(pair) = pair(&rows[*index])
                && best.len() < FINALISTS
                && !best.contains(&pair)
            {
                best.push(pair);
            }
        }
        let words =
            |(solver, step): (Solver, f64)| self.words.iter().map(move |word| self.lists.point(solver, step, *word));
        let mut points: Vec<DesignPoint> = best.iter().flat_map(|pair| words(*pair)).collect();
        // Only the word is wrong, so far.
        let mut short: Vec<(Solver, f64)> =
            rows.iter().filter(|row| self.fits(row)).filter_map(pair).filter(|pair| !best.contains(pair)).collect();
        short.sort_by(|a, b| self.cycles(a.0, a.1).total_cmp(&self.cycles(b.0, b.1)));
        short.dedup();
        if round > 0 {
            // Longer words were not enough: the method may have what is left of the error.
            short = short.iter().filter_map(|pair| self.half(*pair)).collect();
        }
        // Among those that met the goal one that is not among the best is slower.
        short.retain(|pair| best.iter().all(|best| self.cycles(pair.0, pair.1) < self.cycles(best.0, best.1)));
        let longer = |word: &&Word| word.holds(&self.word);
        for (solver, step) in short.into_iter().take(SHORT_OF_BITS) {
            points.extend(self.words.iter().filter(longer).map(|word| self.lists.point(solver, step, *word)));
        }
        points
    }

    /// Half of the step, if steps are free.
    fn half(&self, (solver, step): (Solver, f64)) -> Option<(Solver, f64)> {
        let half = self.lists.suitable(self.model, step / 2.0).filter(|_| self.free_steps)?;
        (self.products(solver, half) <= self.most_products(solver)).then_some((solver, half))
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

/// Solver and step of a row.
fn pair(row: &Row) -> Option<(Solver, f64)> {
    row.point.solver.zip(row.point.step)
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
        Outcome::Compiled(figures) => Some((figures.total_error()?, figures.number("error.double")?)),
        Outcome::Failed(reason) => reason.beyond,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn row(time: f64, lut: f64, error: f64) -> Row {
        let area = json!({"lut": lut, "dsp": 0, "bram18": 0});
        let report = json!({"time_per_simulated_second_ms": time, "area": area, "error": {"total": error}});
        Row::compiled(&report)
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
