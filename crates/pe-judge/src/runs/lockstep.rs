//! Runs over the span a block of steps at a time, so that several can be compared at every step in bounded memory.

use std::ops::Range;
use std::sync::Arc;

use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::model::Model;
use pe_ir::motion::MIDDLE;
use pe_ir::source::Diagnostic;
use pe_sim::compared::{Compared, Rows};
use pe_sim::double::DoubleRun;
use pe_sim::rounded::RoundedRuns;

use crate::progress::Progress;

use super::events;
use super::inputs::{self, Sight};
use super::looks;

/// Samples of the trajectory, at most; never fewer than 200 if the span has as many steps.
const SAMPLES: u64 = 400;

/// Numbers that a trajectory may hold before the samples are thinned out.
const SAMPLE_BUDGET: u64 = 32_000_000;

/// Numbers of a run in a block, if that is not a single step: some blocks fit into a processor's cache.
const BLOCK: u64 = 1 << 15;

/// Blocks of the span at least, so that the course of a comparison has times, and steps that they have even so.
const FEWEST_BLOCKS: u64 = 200;
const SHORT_BLOCK: u64 = 16;

/// Which steps are sampled and looked at, how they are grouped, and who is told about the progress.
pub(super) struct Plan {
    pub model: Model,
    pub steps: u64,
    /// Steps done at evenly spread samples, ascending; the last one is among them.
    pub samples: Vec<u64>,
    /// Steps done at other places of interest, ascending.
    pub looks: Vec<u64>,
    /// Steps done around events, ascending, where runs are not compared.
    left_out: Vec<u64>,
    /// Steps of a block, at most.
    block: u64,
    pub progress: Arc<dyn Progress>,
}

impl Plan {
    pub fn of(model: &Model, progress: Arc<dyn Progress>) -> Plan {
        let steps = model.steps();
        let states = model.states.len().max(1) as u64;
        let affordable = (SAMPLE_BUDGET / states).max(200);
        let count = SAMPLES.min(affordable).min(steps);
        let left_out = events::left_out(model);
        let is_left_out = |step: &u64| left_out.binary_search(step).is_ok();
        let mut samples: Vec<u64> = (1..=count)
            .map(|sample| (u128::from(sample) * u128::from(steps)).div_ceil(u128::from(count)) as u64)
            .collect();
        if !left_out.is_empty() {
            let moved = |step: u64| (step..=steps).find(|step| !is_left_out(step)).unwrap_or(steps);
            samples = samples.into_iter().map(moved).collect();
            samples.dedup();
        }
        let mut looks = looks::steps(model, steps / count);
        looks.retain(|step| samples.binary_search(step).is_err() && !is_left_out(step));
        looks.truncate(affordable as usize);
        // Twice the step itself, fixed point, quantised, half the step, means of inputs.
        progress.set_length(steps * if inputs::varying_inputs(model) { 7 } else { 6 });
        let block = (BLOCK / states).clamp(1, steps.div_ceil(FEWEST_BLOCKS).max(SHORT_BLOCK));
        Plan { model: model.clone(), steps, samples, looks, left_out, block, progress }
    }

    /// Tells the progress after `done` steps; rarely, for a step may take no longer than the telling.
    pub fn advance(&self, done: u64, weight: u64) {
        const STRIDE: u64 = 256;
        if done.is_multiple_of(STRIDE) {
            self.progress.advance(STRIDE * weight);
        }
    }

    /// Steps of a block, at most: of all blocks but the last one.
    pub fn block(&self) -> u64 {
        self.block
    }

    /// All steps, block by block.
    pub fn blocks(&self) -> impl Iterator<Item = Range<u64>> + use<> {
        let (steps, block) = (self.steps, self.block);
        (0..steps.div_ceil(block)).map(move |index| index * block..((index + 1) * block).min(steps))
    }

    /// Times in seconds after so many steps.
    pub fn times(&self, steps: &[u64]) -> Vec<f64> {
        steps.iter().map(|done| self.model.time(*done, 0.0)).collect()
    }

    /// Rows of a block that are samples.
    pub fn sampled(&self, block: &Range<u64>) -> impl Iterator<Item = usize> {
        within(&self.samples, block)
    }

    /// Rows of a block that are looked at beside the samples.
    pub fn looked_at(&self, block: &Range<u64>) -> impl Iterator<Item = usize> {
        within(&self.looks, block)
    }

    /// Goes on with a comparison by a block.
    pub fn compare(&self, block: &Range<u64>, compared: &mut Compared, run: &Rows, other: &Rows) {
        self.include(block, compared, run, other);
        for row in self.sampled(block).chain(self.looked_at(block)) {
            compared.see(run.row(row), other.row(row));
        }
    }

    /// The same, where nobody else looks at samples.
    pub fn include(&self, block: &Range<u64>, compared: &mut Compared, run: &Rows, other: &Rows) {
        let left_out: Vec<usize> = within(&self.left_out, block).collect();
        if left_out.is_empty() {
            return compared.include(block.end, run, other);
        }
        let (run, other) = (run.without(&left_out), other.without(&left_out));
        if !run.is_empty() {
            compared.include(block.end, &run, &other);
        }
    }
}

/// Rows of a block after which so many steps are done as one of `steps`.
fn within(steps: &[u64], block: &Range<u64>) -> impl Iterator<Item = usize> {
    let (first, start) = (steps.partition_point(|done| *done <= block.start), block.start);
    let count = steps[first..].partition_point(|done| *done <= block.end);
    steps[first..first + count].iter().map(move |done| (done - start - 1) as usize)
}

/// What runs in double precision see of inputs.
struct Feed {
    /// The model with the step of the run, of which a step of the plan takes so many.
    finer: Model,
    substeps: u64,
    sight: Sight,
    /// Inputs that are taken in their means, if any are.
    continuous: Vec<bool>,
}

impl Feed {
    fn new(model: &Model, substeps: u64, sight: Sight) -> Feed {
        let finer = model.in_steps_of(model.step / substeps as f64);
        Feed { finer, substeps, sight, continuous: inputs::read_by_continuous_alone(model) }
    }

    /// When a part of a step begins.
    fn time(&self, plan: &Plan, step: u64, substep: u64) -> f64 {
        plan.model.time(step, substep as f64 / self.substeps as f64)
    }

    /// Inputs in a part of a step.
    fn inputs(&self, plan: &Plan, step: u64, substep: u64) -> Vec<f64> {
        let Feed { finer, substeps, sight, continuous } = self;
        if finer.inputs.is_empty() && finer.rates.is_empty() {
            return Vec::new();
        }
        let (time, end) = (self.time(plan, step, substep), (substep + 1) as f64 / *substeps as f64);
        match sight {
            Sight::Held => {
                let mut seen = finer.hold_inputs(plan.model.time(step, 0.0), time);
                plan.model.draw_lines(step, end, &mut seen);
                // Jumps are where the whole step sees them.
                let own = plan.model.inputs.len();
                if finer.inputs.len() > own {
                    let middle = plan.model.time(step, MIDDLE);
                    let signals = seen[own..].iter_mut().zip(&plan.model.signals);
                    signals.for_each(|(number, signal)| *number = signal.waveform.at(middle));
                }
                seen
            }
            Sight::Taken => inputs::taken(&plan.model, finer, continuous, step),
            Sight::Sampled => finer.sample_inputs(time),
            Sight::Mean => inputs::means(finer, continuous, (time, plan.model.time(step, end))),
        }
    }
}

/// The finding about a run that is compared and is no longer finite at some time.
pub(super) fn not_finite(time: f64) -> Vec<Diagnostic> {
    let message = format!("a comparison run is not finite at t = {time:.6e} s");
    let help = "the model is at the edge of stability: try a smaller `--step`";
    vec![Diagnostic::global(codes::DIVERGED, message).with_help(help)]
}

/// A run in double precision.
pub(super) struct Pass<'a> {
    run: DoubleRun<'a>,
    feed: Feed,
    /// Outputs in each row, behind the states.
    outputs: usize,
    rows: Rows,
}

impl<'a> Pass<'a> {
    /// A run of the plan's own steps, with so many outputs.
    pub fn new(plan: &Plan, run: DoubleRun<'a>, outputs: usize) -> Pass<'a> {
        let rows = Rows::new(plan.model.states.len() + outputs);
        Pass { outputs, rows, ..Pass::divided(plan, run, 1, Sight::Held) }
    }

    /// A run that divides each step into so many, without outputs.
    pub fn divided(plan: &Plan, run: DoubleRun<'a>, substeps: u64, sight: Sight) -> Pass<'a> {
        Pass::of_model(&plan.model, run, substeps, sight)
    }

    /// The same of a model that has other inputs than the plan's, but its states.
    pub fn of_model(model: &Model, run: DoubleRun<'a>, substeps: u64, sight: Sight) -> Pass<'a> {
        let rows = Rows::new(model.states.len());
        Pass { run, feed: Feed::new(model, substeps, sight), outputs: 0, rows }
    }

    /// Largest magnitudes of the states so far, within steps of the plan, too. `graph` is that of the run.
    pub fn largest(&self, graph: &StepGraph) -> Vec<f64> {
        let largest = self.run.largest();
        graph.states.iter().map(|(state, _)| largest[state.index()]).collect()
    }

    /// The rows of the latest block, to keep.
    pub fn take(&mut self) -> Rows {
        self.rows.take()
    }

    /// The next block: a row of states, then outputs, after each step.
    ///
    /// # Errors
    /// `E0901` non-finite.
    pub fn block(&mut self, plan: &Plan, steps: &Range<u64>) -> Result<&Rows, Vec<Diagnostic>> {
        let Pass { run, feed, outputs, rows } = self;
        let states = plan.model.states.len();
        rows.clear();
        for step in steps.clone() {
            for substep in 0..feed.substeps {
                let seen = feed.inputs(plan, step, substep);
                run.step(&seen).map_err(|_| not_finite(feed.time(plan, step, substep)))?;
            }
            plan.advance(step + 1, feed.substeps);
            let states = run.states().take(states);
            rows.add(states.chain((0..*outputs).map(|output| run.output(output))));
        }
        Ok(rows)
    }
}

/// Runs in double precision with coefficients rounded in several ways.
pub(super) struct RoundedPass<'a, const N: usize> {
    runs: RoundedRuns<'a, N>,
    feed: Feed,
    rows: [Rows; N],
}

impl<'a, const N: usize> RoundedPass<'a, N> {
    /// Of the plan's own steps.
    pub fn new(plan: &Plan, graph: &'a StepGraph, roundings: [&FixedPoint; N]) -> RoundedPass<'a, N> {
        let rows = roundings.map(|_| Rows::new(plan.model.states.len()));
        RoundedPass { runs: RoundedRuns::new(graph, roundings), feed: Feed::new(&plan.model, 1, Sight::Held), rows }
    }

    /// The next block of each run: a row of states after each step.
    ///
    /// # Errors
    /// `E0901` one of them is not finite.
    pub fn block(&mut self, plan: &Plan, steps: &Range<u64>) -> Result<&[Rows; N], Vec<Diagnostic>> {
        let RoundedPass { runs, feed, rows } = self;
        if N == 0 {
            return Ok(rows);
        }
        rows.iter_mut().for_each(Rows::clear);
        for step in steps.clone() {
            if !runs.step(&feed.inputs(plan, step, 0)) {
                return Err(not_finite(feed.time(plan, step, 0)));
            }
            plan.advance(step + 1, 1);
            let states = plan.model.states.len();
            rows.iter_mut().enumerate().for_each(|(run, rows)| rows.add(runs.states(run).take(states)));
        }
        Ok(rows)
    }
}
