//! The cheapest point that is right enough, and which points to try next.

use pe_ir::codes;
use pe_ir::model::{Model, Solver};

use super::lists::{Lists, Plan, WORD, Word};
use crate::explore::axes::with_forms;
use crate::explore::row::{Figures, Outcome, Row};
use crate::options::DesignPoint;
use crate::pipeline::MappingOptions;

/// Run times this close count as equal; then size decides.
const EQUAL_TIME: f64 = 1.02;

/// Smallest step that is tried, relative to the model's, and steps that a span has at least.
const SMALLEST_STEP: f64 = 1.0 / 64.0;
const FEWEST_STEPS: f64 = 10.0;

/// Solvers and steps with which all words are tried.
const FINALISTS: usize = 4;

/// Rounds of new steps.
const ROUNDS: u32 = 6;

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

/// A search for the cheapest point: first solvers and steps at the default word, then words for the best of them.
pub struct Search<'a> {
    model: &'a Model,
    mapping: &'a MappingOptions,
    lists: &'a Lists,
    solvers: Vec<Solver>,
    free_steps: bool,
    words: Vec<Word>,
    /// The word at which solvers and steps are compared.
    word: Word,
    limit: f64,
    rounds: u32,
}

impl<'a> Search<'a> {
    /// A search among the points of a plan and more.
    pub fn new(model: &'a Model, mapping: &'a MappingOptions, lists: &'a Lists, plan: &Plan, limit: f64) -> Search<'a> {
        let solvers = plan.graphs.iter().map(|(solver, _)| *solver).collect();
        let word =
            plan.words.iter().copied().find(|word| *word == WORD).or(plan.words.first().copied()).unwrap_or(WORD);
        let (free_steps, words) = (plan.free_steps, plan.words.clone());
        Search { model, mapping, lists, solvers, free_steps, words, word, limit, rounds: 0 }
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
        if self.rounds <= ROUNDS && !rows.iter().any(unknown) {
            self.rounds += 1;
            let points = if self.free_steps && self.rounds < ROUNDS { self.steps(rows) } else { Vec::new() };
            let points = self.new_ones(rows, points);
            if !points.is_empty() {
                return points;
            }
            // No step is left to try.
            self.rounds = ROUNDS + 1;
            return self.new_ones(rows, self.finals(rows));
        }
        Vec::new()
    }

    fn new_ones(&self, rows: &[Row], points: Vec<DesignPoint>) -> Vec<DesignPoint> {
        let points = with_forms(points, self.model, self.mapping);
        points.into_iter().filter(|point| rows.iter().all(|row| row.point != *point)).collect()
    }

    /// The next step of each solver, where the steps so far leave open which is the largest that is right enough.
    fn steps(&self, rows: &[Row]) -> Vec<DesignPoint> {
        let next = |solver: &Solver| {
            let of_solver = |row: &&Row| row.point.solver == Some(*solver) && Word::of(&row.point) == self.word;
            let mut tried: Vec<(f64, &Row)> =
                rows.iter().filter(of_solver).filter_map(|row| Some((row.point.step?, row))).collect();
            tried.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (smallest, finest) = *tried.first()?;
            let (largest, coarsest) = *tried.last()?;
            let met = |row: &Row| errors(row).is_some_and(|(total, _)| total <= self.limit);
            let step = if met(coarsest) {
                Some(2.0 * largest).filter(|step| self.model.span / step >= FEWEST_STEPS)
            } else if tried.iter().any(|(_, row)| met(row)) {
                None
            } else {
                let wanted = match errors(finest) {
                    // Words, not steps, are what is wrong.
                    Some((_, double)) if double <= self.limit => return None,
                    Some((_, double)) => libm::pow(self.limit / double, 1.0 / f64::from(solver.order())),
                    None if unstable(finest) => 0.5,
                    None => return None,
                };
                let halvings = libm::ceil(-libm::log2(wanted)).max(1.0);
                let step = libm::scalbn(smallest, -(halvings as i32));
                Some(step).filter(|step| *step >= SMALLEST_STEP * self.model.step)
            };
            step.map(|step| self.lists.point(*solver, step, self.word))
        };
        self.solvers.iter().filter_map(next).collect()
    }

    /// The best solvers and steps, and the next smaller steps, with all words.
    fn finals(&self, rows: &[Row]) -> Vec<DesignPoint> {
        let mut best: Vec<(Solver, f64)> = Vec::new();
        for index in cheapest(rows, self.limit) {
            if let (Some(solver), Some(step)) = (rows[index].point.solver, rows[index].point.step)
                && best.len() < FINALISTS
                && !best.contains(&(solver, step))
            {
                best.push((solver, step));
            }
        }
        let halves: Vec<(Solver, f64)> = best.iter().map(|(solver, step)| (*solver, step / 2.0)).collect();
        for half in halves {
            if self.free_steps && !best.contains(&half) {
                best.push(half);
            }
        }
        let words =
            |(solver, step): (Solver, f64)| self.words.iter().map(move |word| self.lists.point(solver, step, *word));
        best.into_iter().flat_map(words).collect()
    }
}

/// Whether a point failed for a reason that a smaller step can mend.
fn unstable(row: &Row) -> bool {
    let code = match &row.outcome {
        Outcome::Failed(reason) => reason.code.as_deref(),
        Outcome::Compiled(_) => None,
    };
    [codes::DIVERGED, codes::STEP_TOO_LARGE, codes::SATURATED].iter().any(|known| code == Some(*known))
}

/// Total error of a row and that of its run in double precision, if both are known.
fn errors(row: &Row) -> Option<(f64, f64)> {
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
