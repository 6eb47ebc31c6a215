//! The design that `compile --max-error` and other goals choose: the best one that keeps all limits.

use std::sync::mpsc::channel;

use pe_ir::model::Model;
use pe_sim::reference::TOLERANCE;

use super::goal::{MOST_PRODUCTS, Search, errors};
use super::lists::{Lists, Plan};
use super::wanted::{Figure, Goals, USUAL_ERROR};
use crate::explore::estimate::Estimate;
use crate::explore::family::Job;
use crate::explore::row::{self, Outcome, RUNNERS_UP, Row};
use crate::explore::steps::hit;
use crate::explore::sweep::{self, Event, Sweep};
use crate::failure::Failure;
use crate::report::{Chosen, Figures, RunnerUp};
use crate::settings::Settings;
use crate::spec::LoadedModel;
use pe_judge::conserved::Conserved;
use pe_judge::{Coefficients, Criteria, DesignPoint, ProofMode};
use pe_target::clock::ClockSource;

/// Which axes of the design space the user fixed: those whose options were given.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fixed {
    /// Bits of a stored word.
    pub storage: bool,
    /// Products of a coefficient.
    pub coefficients: bool,
}

/// What the choice is made from.
pub struct Question<'a> {
    /// The model with the spec's solver and step.
    pub loaded: &'a LoadedModel,
    /// What its designs have in common.
    pub settings: &'a Settings,
    /// What the user fixed: solver, step and PEs if they are given, words if `fixed` says so.
    pub point: DesignPoint,
    /// See `point`.
    pub fixed: Fixed,
    /// Quantities that the user says are conserved.
    pub conserved: &'a [Conserved],
    /// The clock that run times are computed with.
    pub clock: ClockSource,
    /// What the design is wanted to be.
    pub goals: Goals,
    /// Longest time between two outputs, in seconds.
    pub sample: Option<f64>,
}

/// The chosen point and those after it.
pub struct Choice {
    /// Rows of the chosen point and the next ones.
    rows: Vec<Row>,
    /// Points that came before it and were not confirmed.
    unconfirmed: usize,
    /// Points that were tried, and those that were right enough.
    tried: usize,
    met: usize,
    goals: Goals,
    /// The limit that costs the most, and points that miss limits, in words.
    binding: Option<String>,
    misses: Vec<String>,
}

/// Part of the smallest total error so far that the next search aims at where the error is to be small, and what is left
/// of it if that was worth the time.
const SMALLER: f64 = 0.25;
const WORTH: f64 = 0.8;

/// Total error over the limit up to which a point gets a network if there are goals beside the error.
const SLACK: f64 = 4.0;

impl Question<'_> {
    /// Tries solvers, steps and word lengths. Only points that are right enough get a network.
    ///
    /// # Errors
    /// If no point is right enough; the message names the one that comes closest.
    pub fn answer(&self) -> Result<Choice, Failure> {
        let model = &self.loaded.model;
        let DesignPoint { solver, step, early_steps, storage, multiplier, coefficients, form, pes, pipeline } =
            self.point;
        let lists = Lists {
            solver: solver.into_iter().collect(),
            step: step.into_iter().collect(),
            multiplier: multiplier.into_iter().collect(),
            storage: if self.fixed.storage { vec![storage] } else { Vec::new() },
            coefficients: if self.fixed.coefficients { vec![coefficients] } else { Vec::new() },
            form,
            sample: self.sample,
            early_steps,
            pes,
            pipeline,
        };
        hit(&lists.step, self.sample)?;
        let plan = lists.plan(model, &self.settings.mapping);
        let pool = rayon::ThreadPoolBuilder::new().build();
        let pool = pool.map_err(|error| Failure::File(format!("cannot start threads: {error}")))?;
        let estimate = Estimate::of(model, &plan.graphs, &self.settings.mapping).among(plan.points.iter());
        let goals = self.limited();
        let mut rows: Vec<Row> = Vec::new();
        let mut limit = self.max_error();
        loop {
            let compiled = |points: &[DesignPoint]| self.compiled(points, limit, &estimate, &pool);
            self.search(limit, (&lists, &plan), &mut rows, &compiled);
            let ranked = goals.ranked(&rows);
            let error = ranked.first().and_then(|best| errors(&rows[*best])).map(|(error, _)| error);
            // A smaller error is sought as long as there is one.
            match error.filter(|_| goals.minimise == Figure::Error) {
                Some(error) if error <= WORTH * limit && SMALLER * error >= TOLERANCE => limit = SMALLER * error,
                _ => break,
            }
        }
        let ranked = goals.ranked(&rows);
        if ranked.is_empty() {
            return Err(self.refusal(&rows));
        }
        let shown = ranked.iter().take(1 + RUNNERS_UP).map(|index| rows[*index].clone()).collect();
        let binding = goals.binding(&rows).map(|(limit, gain)| {
            format!("{}: without it the {} could be {gain:.2} times smaller", limit.name(), goals.minimise.words())
        });
        let misses = goals.misses(&rows).into_iter().map(|miss| {
            let row = &rows[miss.row];
            let taken: Vec<String> = miss.limits.iter().map(|limit| goals.taken(*limit, row)).collect();
            format!("{} would take {}", sized(model, row), taken.join(" and "))
        });
        let misses = misses.collect();
        Ok(Choice { rows: shown, unconfirmed: 0, tried: rows.len(), met: ranked.len(), goals, binding, misses })
    }

    /// Largest total error.
    fn max_error(&self) -> f64 {
        self.goals.max_error.unwrap_or(USUAL_ERROR)
    }

    /// The goals with a limit of the total error.
    fn limited(&self) -> Goals {
        Goals { max_error: Some(self.max_error()), ..self.goals }
    }

    /// Adds to the rows those of a search for such an error.
    fn search(
        &self,
        limit: f64,
        (lists, plan): (&Lists, &Plan),
        rows: &mut Vec<Row>,
        compiled: &dyn Fn(&[DesignPoint]) -> Vec<Row>,
    ) {
        let (model, mapping) = (&self.loaded.model, &self.settings.mapping);
        let mut search = Search::new(model, mapping, lists, plan, limit).wanting(&self.goals);
        let mut points = if rows.is_empty() { search.begin(plan) } else { search.next(rows) };
        while !points.is_empty() {
            rows.extend(compiled(&points));
            points = search.next(rows);
        }
    }

    fn compiled(&self, points: &[DesignPoint], limit: f64, estimate: &Estimate, pool: &rayon::ThreadPool) -> Vec<Row> {
        let sweep = Sweep {
            loaded: self.loaded.clone(),
            // The chosen design keeps its formats, so no proof can change what is compared here.
            settings: Settings {
                criteria: Criteria { proof: ProofMode::Off, ..self.settings.criteria.clone() },
                ..self.settings.clone()
            },
            conserved: self.conserved.to_vec(),
            // What misses the error by little is of interest beside other goals.
            within: Some(if self.goals.concern_others() { SLACK * limit } else { limit }),
            // How wrong a point is says which one is tried next.
            early: false,
            until: None,
            clock: self.clock,
            estimate: estimate.clone(),
        };
        let job = |(index, point): (usize, &DesignPoint)| Job { index, point: *point, command: String::new() };
        let (sender, events) = channel();
        sweep::run(&sweep, points.iter().enumerate().map(job).collect(), pool, &sender);
        drop(sender);
        let mut rows: Vec<Option<Row>> = vec![None; points.len()];
        for event in events {
            if let Event::Point(index, outcome) = event {
                rows[index] = Some(Row { point: points[index], command: String::new(), outcome });
            }
        }
        rows.into_iter().map(|row| row.expect("every point has an outcome")).collect()
    }

    fn refusal(&self, rows: &[Row]) -> Failure {
        let max_error = self.max_error();
        let reached = rows.iter().filter_map(errors).any(|(error, _)| error <= max_error);
        if reached {
            let (why, nearest) = self.limited().refusal(rows, |row| sized(&self.loaded.model, row));
            return Failure::out_of_reach(why, nearest, &self.loaded.sources);
        }
        // Where the method is right enough, what its word makes of it; else what the method comes to.
        let known = rows.iter().filter_map(|row| Some((errors(row)?, row)));
        let rank = |(total, double): (f64, f64)| (double > max_error, total);
        let best = known.min_by(|a, b| {
            let (a, b) = (rank(a.0), rank(b.0));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let (text, help) = match best {
            Some(((error, double), row)) => {
                let text = format!(
                    "no design has a total error of at most {max_error:e}; the best of {} has {error:.1e}, {:.2} times that: {}",
                    rows.len(),
                    error / max_error,
                    described(&self.loaded.model, row)
                );
                (text, self.limited_by(error, double))
            }
            None => {
                let reasons = rows.iter().find_map(|row| match &row.outcome {
                    Outcome::Failed(reason) => Some(reason.message.clone()),
                    Outcome::Compiled(compiled) => compiled.figures.error.total_reason.clone(),
                });
                let first = reasons.unwrap_or_else(|| "no solver applies".to_owned());
                let text = format!("no design has a known total error; the first of {} says: {first}", rows.len());
                (text, "take another `--solver`, a smaller `--step` or a shorter `--span`".to_owned())
            }
        };
        Failure::out_of_reach(text, help, &self.loaded.sources)
    }

    /// What keeps the best point from the goal, and what would help.
    fn limited_by(&self, error: f64, double: f64) -> String {
        let fixed_words = self.point.multiplier.is_some() || self.fixed.storage || self.fixed.coefficients;
        if double <= self.max_error() {
            let help = if fixed_words { "let the search choose the word" } else { "no longer word is there" };
            return format!("its word limits it: {double:.1e} in double precision; {help}");
        }
        let limit = if self.max_error() < TOLERANCE {
            format!("reference solutions are accurate to {TOLERANCE:.0e} only")
        } else if self.point.step.is_some() {
            "the step is given; leave `--step` out".to_owned()
        } else {
            format!("smaller steps would take more than {MOST_PRODUCTS:.0e} products over the span, or no longer help")
        };
        let share = if double > 0.9 * error { String::new() } else { format!(" ({double:.1e} in double precision)") };
        format!("its method limits it{share}: {limit}. Allow more, or take a shorter `--span` if the model is chaotic")
    }
}

/// A point in words.
fn described(model: &Model, row: &Row) -> String {
    let solver = row.point.solver.unwrap_or(model.solver).name();
    let slots = if row.point.coefficients == Coefficients::TwoSlot { ", coefficients in two slots" } else { "" };
    let (step, multiplier) = (row::step(&row.point), row::multiplier(&row.point));
    format!("{solver}, step {step}, {} bits, {multiplier}{slots}", row.point.storage)
}

/// The same with its number of PEs.
fn sized(model: &Model, row: &Row) -> String {
    let pes = row.figures().map_or(row.point.pes, |figures| Some(figures.pes as u32));
    format!("{}{}", described(model, row), pes.map_or(String::new(), |pes| format!(", PEs: {pes}")))
}

impl Choice {
    /// The chosen point and those that may take its place, the best first.
    pub fn points(&self) -> Vec<DesignPoint> {
        self.rows.iter().map(|row| row.point).collect()
    }

    /// Leaves out so many of the first points, which were not confirmed.
    pub fn pass_over(&mut self, points: usize) {
        self.rows.drain(..points);
        self.unconfirmed += points;
    }

    /// As the report has it.
    pub fn report(&self, model: &Model) -> Chosen {
        let runners_up = self.rows.iter().skip(1).map(|row| {
            let figures = row.figures();
            RunnerUp {
                solver: row.point.solver.map(|solver| solver.name().to_owned()),
                step_s: row.point.step,
                early_steps: row.point.early_steps.map(|early| early.to_string()),
                storage_bits: row.point.storage,
                multiplier: row::multiplier(&row.point),
                coefficients: row.point.coefficients.name().to_owned(),
                total_error: figures.and_then(Figures::total_error),
                seconds: figures.map(|figures| figures.time_ms() * 1e-3 * model.span),
                equivalent_lut: figures.map(Figures::equivalent_lut),
            }
        });
        let Choice { goals, tried, met, unconfirmed, .. } = *self;
        Chosen {
            max_error: goals.max_error.unwrap_or(USUAL_ERROR),
            realtime: goals.realtime,
            fits: goals.fit.map(|device| device.name.to_owned()),
            minimise: goals.minimise.name().to_owned(),
            binding: self.binding.clone(),
            misses: self.misses.clone(),
            tried,
            met,
            unconfirmed,
            runners_up: runners_up.collect(),
        }
    }

    /// In a few words.
    pub fn figure(&self, model: &Model) -> String {
        format!(
            "{}: {} of {} points that meet {}, {} tried",
            described(model, &self.rows[0]),
            if self.goals.minimise == Figure::Time { "cheapest" } else { "best" },
            self.met,
            self.goals.words(),
            self.tried
        )
    }

    /// The rows of the summary table: the chosen point and those after it.
    pub fn table(&self, model: &Model) -> Vec<(&'static str, String)> {
        let line = |(place, row): (usize, &Row)| {
            let figures = row.figures();
            let error = figures.and_then(|figures| figures.total_error()).unwrap_or(f64::NAN);
            let seconds = figures.map_or(f64::NAN, |figures| figures.time_ms() * 1e-3 * model.span);
            let size = figures.map_or(f64::NAN, |figures| figures.equivalent_lut());
            let name = if place == 0 { "chosen" } else { "next" };
            let described = if self.goals.concern_others() { sized(model, row) } else { described(model, row) };
            (name, format!("{described}: error {error:.1e}, {seconds:.2e} s, {size:.0} eq. LUT"))
        };
        let mut table: Vec<(&'static str, String)> = self.rows.iter().enumerate().map(line).collect();
        table.extend(self.binding.iter().map(|binding| ("binding", binding.clone())));
        table.extend(self.misses.iter().map(|miss| ("missed", miss.clone())));
        table
    }
}
