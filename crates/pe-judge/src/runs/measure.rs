//! A run in fixed point beside the one in double precision.

use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::Receiver;

use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::model::Model;
use pe_sim::compared::{Compared, Rows};
use pe_sim::error::Trajectory;
use pe_sim::fixed::FixedRun;

use crate::times::thread_seconds;

use super::exact::{AtCorner, Exact, compared_outputs};
use super::judged::Checkpoint;
use super::lockstep::{Pass, Plan, RoundedPass};
use super::saturated::{Beyond, Ended, Saturated};
use super::settle::Aids;
use super::settled::Run;

/// Where the run in double precision comes from, block by block.
pub(super) enum Source<'a> {
    /// A run that another thread does anyway.
    Shared(Receiver<Arc<Rows>>),
    /// A run of before.
    Kept(std::slice::Iter<'a, Arc<Rows>>),
    Own(Box<Pass<'a>>),
}

impl Source<'_> {
    /// The next block.
    pub fn next(&mut self, plan: &Plan, block: &Range<u64>) -> Arc<Rows> {
        match self {
            Source::Shared(blocks) => blocks.recv().expect("all blocks are sent"),
            Source::Kept(blocks) => Arc::clone(blocks.next().expect("all blocks are kept")),
            Source::Own(own) => {
                own.block(plan, block).expect("it was finite before");
                Arc::new(own.take())
            }
        }
    }
}

impl Exact {
    /// Where a run comes from that this one is compared with.
    pub(super) fn source<'a>(&'a self, graph: &'a StepGraph, aids: Aids<'a>) -> Source<'a> {
        match aids.kept.or(self.kept.as_ref()) {
            Some(kept) => Source::Kept(kept.blocks.iter()),
            None => Source::Own(Box::new(self.own(graph))),
        }
    }

    /// Runs in fixed point, and in double precision with coefficients rounded in some ways, beside the run in double
    /// precision. A word-length error above `most` ends them.
    pub(super) fn measure<const N: usize>(
        &self,
        model: &Model,
        graph: &StepGraph,
        fixed: &FixedPoint,
        roundings: [&FixedPoint; N],
        mut source: Source,
        most: Option<f64>,
    ) -> Result<(Run, [Compared; N]), Ended> {
        let plan = &self.plan;
        let (states, outputs) = (model.states.len(), compared_outputs(graph));
        let output_turns = model.output_turns().into_iter().filter(|(output, _)| *output < outputs).collect();
        let mut run = FixedPass::new(graph, fixed, (states, outputs));
        let mut rounded = RoundedPass::new(plan, graph, roundings);
        let mut quantised = roundings.map(|_| self.compared());
        let mut measured = Run {
            word: self.compared(),
            outputs: Compared::new(states, &self.output_scales, &vec![0.0; outputs]).modulo(output_turns),
            hardware: Trajectory::new(states),
            looks: Trajectory::new(states),
            curves: Trajectory::new(self.curves.outputs.len()),
            checkpoint: Checkpoint { step: 0, words: Vec::new() },
            seconds: 0.0,
        };
        for block in plan.blocks() {
            let double = &*source.next(plan, &block);
            let begin = thread_seconds();
            run.rows.clear();
            for step in block.clone() {
                if step == plan.steps / 2 {
                    measured.checkpoint = run.checkpoint(step);
                }
                run.step(model, step)?;
                if plan.samples.binary_search(&(step + 1)).is_ok() {
                    measured.curves.push(|at| run.run.output(self.curves.outputs[at]));
                }
                plan.advance(step + 1, 1);
            }
            measured.seconds += thread_seconds() - begin;
            plan.compare(&block, &mut measured.word, double, &run.rows);
            let error = measured.word.worst().1;
            if most.is_some_and(|most| error > most) {
                return Err(Ended::Beyond(Beyond { error, time: model.time(block.end, 0.0) }));
            }
            if outputs > 0 {
                plan.include(&block, &mut measured.outputs, double, &run.rows);
            }
            for (compared, rows) in quantised.iter_mut().zip(rounded.block(plan, &block)?) {
                plan.compare(&block, compared, double, rows);
            }
            for row in plan.sampled(&block) {
                measured.hardware.push(|state| run.rows.row(row)[state]);
            }
            for row in plan.looked_at(&block) {
                measured.looks.push(|state| run.rows.row(row)[state]);
            }
        }
        Ok((measured, quantised))
    }

    /// Runs in fixed point with tunable parameters at the ends of their ranges, where the same formats must do.
    pub(super) fn hold_at_corners(&self, graph: &StepGraph, fixed: &FixedPoint) -> Result<(), Ended> {
        for AtCorner { corner, model, exact } in &self.corners {
            let graph = corner.graph(graph);
            let mut run = FixedRun::new(&graph, fixed);
            for step in 0..exact.plan.steps {
                let words = port_words(model, &run, step);
                advance(&mut run, &words, step)?;
            }
        }
        Ok(())
    }
}

/// A run in fixed point, a row of states and outputs after each step.
struct FixedPass<'a> {
    graph: &'a StepGraph,
    run: FixedRun<'a>,
    states: usize,
    outputs: usize,
    rows: Rows,
}

impl<'a> FixedPass<'a> {
    fn new(graph: &'a StepGraph, fixed: &'a FixedPoint, (states, outputs): (usize, usize)) -> FixedPass<'a> {
        FixedPass { graph, run: FixedRun::new(graph, fixed), states, outputs, rows: Rows::new(states + outputs) }
    }

    fn checkpoint(&self, step: u64) -> Checkpoint {
        Checkpoint { step, words: self.graph.states.iter().map(|(state, _)| self.run.word(*state)).collect() }
    }

    fn step(&mut self, model: &Model, step: u64) -> Result<(), Saturated> {
        let FixedPass { run, states, outputs, rows, .. } = self;
        let words = port_words(model, run, step);
        advance(run, &words, step)?;
        rows.add(run.states().take(*states).chain((0..*outputs).map(|output| run.output(output))));
        Ok(())
    }
}

/// Runs a step in which nothing may saturate, and in front of the first one the initial values may not either.
fn advance(run: &mut FixedRun, words: &[i64], step: u64) -> Result<(), Saturated> {
    if run.step(words) || (step == 0 && run.saturations().iter().any(|count| *count > 0)) {
        let values = run.saturations().into_iter().enumerate().filter(|(_, count)| *count > 0);
        let values = values.map(|(index, _)| ValueId::at(index)).collect();
        return Err(Saturated { values, step });
    }
    Ok(())
}

/// Input port words of a step.
pub fn port_words(model: &Model, run: &FixedRun, step: u64) -> Vec<i64> {
    let numbers = model.sample_inputs(model.time(step, 0.0));
    numbers.iter().enumerate().map(|(index, number)| run.encode_input(index, *number).0).collect()
}
