//! The design that `compile --max-error` builds: the cheapest one that meets the goal.

use std::sync::mpsc::channel;

use pe_ir::model::Model;
use pe_sim::reference::TOLERANCE;

use super::goal::{MOST_PRODUCTS, Search, cheapest, errors};
use super::lists::Lists;
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
    /// Largest total error.
    pub max_error: f64,
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
    max_error: f64,
}

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
        let mut search = Search::new(model, &self.settings.mapping, &lists, &plan, self.max_error);
        let pool = rayon::ThreadPoolBuilder::new().build();
        let pool = pool.map_err(|error| Failure::File(format!("cannot start threads: {error}")))?;
        let estimate = Estimate::of(model, &plan.graphs, &self.settings.mapping);
        let mut rows: Vec<Row> = Vec::new();
        let mut points = search.begin(&plan);
        while !points.is_empty() {
            rows.extend(self.compiled(&points, &estimate, &pool));
            points = search.next(&rows);
        }
        let ranked = cheapest(&rows, self.max_error);
        if ranked.is_empty() {
            return Err(self.refusal(&rows));
        }
        let shown = ranked.iter().take(1 + RUNNERS_UP).map(|index| rows[*index].clone()).collect();
        Ok(Choice { rows: shown, unconfirmed: 0, tried: rows.len(), met: ranked.len(), max_error: self.max_error })
    }

    fn compiled(&self, points: &[DesignPoint], estimate: &Estimate, pool: &rayon::ThreadPool) -> Vec<Row> {
        let sweep = Sweep {
            loaded: self.loaded.clone(),
            // The chosen design keeps its formats, so no proof can change what is compared here.
            settings: Settings {
                criteria: Criteria { proof: ProofMode::Off, ..self.settings.criteria.clone() },
                ..self.settings.clone()
            },
            conserved: self.conserved.to_vec(),
            within: Some(self.max_error),
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
        // Where the method is right enough, what its word makes of it; else what the method comes to.
        let known = rows.iter().filter_map(|row| Some((errors(row)?, row)));
        let rank = |(total, double): (f64, f64)| (double > self.max_error, total);
        let best = known.min_by(|a, b| {
            let (a, b) = (rank(a.0), rank(b.0));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let text = match best {
            Some(((error, double), row)) => format!(
                "no design has a total error of at most {:e}; the best of {} has {error:.1e}: {}. {}",
                self.max_error,
                rows.len(),
                described(&self.loaded.model, row),
                self.limited_by(error, double)
            ),
            None => {
                let reasons = rows.iter().find_map(|row| match &row.outcome {
                    Outcome::Failed(reason) => Some(reason.message.clone()),
                    Outcome::Compiled(compiled) => compiled.figures.error.total_reason.clone(),
                });
                let first = reasons.unwrap_or_else(|| "no solver applies".to_owned());
                format!("no design has a known total error; the first of {} says: {first}", rows.len())
            }
        };
        Failure::Fruitless(text)
    }

    /// What keeps the best point from the goal, and what would help.
    fn limited_by(&self, error: f64, double: f64) -> String {
        let fixed_words = self.point.multiplier.is_some() || self.fixed.storage || self.fixed.coefficients;
        if double <= self.max_error {
            let help = if fixed_words { "let the search choose the word" } else { "no longer word is there" };
            return format!("Its word limits it: {double:.1e} in double precision; {help}");
        }
        let limit = if self.max_error < TOLERANCE {
            format!("reference solutions are accurate to {TOLERANCE:.0e} only")
        } else if self.point.step.is_some() {
            "the step is given; leave `--step` out".to_owned()
        } else {
            format!("smaller steps would take more than {MOST_PRODUCTS:.0e} products over the span, or no longer help")
        };
        let share = if double > 0.9 * error { String::new() } else { format!(" ({double:.1e} in double precision)") };
        format!("Its method limits it{share}: {limit}. Allow more, or take a shorter `--span` if the model is chaotic")
    }
}

/// A point in words.
fn described(model: &Model, row: &Row) -> String {
    let solver = row.point.solver.unwrap_or(model.solver).name();
    let slots = if row.point.coefficients == Coefficients::TwoSlot { ", coefficients in two slots" } else { "" };
    let (step, multiplier) = (row::step(&row.point), row::multiplier(&row.point));
    format!("{solver}, step {step}, {} bits, {multiplier}{slots}", row.point.storage)
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
        let Choice { max_error, tried, met, unconfirmed, .. } = *self;
        Chosen { max_error, tried, met, unconfirmed, runners_up: runners_up.collect() }
    }

    /// In a few words.
    pub fn figure(&self, model: &Model) -> String {
        format!(
            "{}: cheapest of {} points that meet {:e}, {} tried",
            described(model, &self.rows[0]),
            self.met,
            self.max_error,
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
            (name, format!("{}: error {error:.1e}, {seconds:.2e} s, {size:.0} eq. LUT", described(model, row)))
        };
        self.rows.iter().enumerate().map(line).collect()
    }
}
