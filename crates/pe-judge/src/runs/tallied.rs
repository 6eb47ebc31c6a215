//! The runs whose events are counted.

use pe_hls::step::{StepOptions, build_with};
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Model, State};
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;

use super::exact::Exact;
use super::jumping::Jumping;
use super::lockstep::not_finite;
use super::measure::port_words;
use super::sensitivity::in_halves;
use super::tally::{self, Family, Record, Recorder, Tally};

impl Exact {
    /// Counts events in all runs.
    ///
    /// # Errors
    /// `E0901` non-finite.
    pub(super) fn tally(&self, model: &Model, graph: &StepGraph, fixed: &FixedPoint) -> Result<Tally, Vec<Diagnostic>> {
        let found = tally::families(model, &self.scales);
        let counted = Counted { model, families: &found.0, of_state: &found.1 };
        let half = model.in_steps_of(model.step / 2.0);
        let options = StepOptions { form: Some(graph.form), ..StepOptions::default() };
        let finer = build_with(&half, &options.in_parts(2))?;
        let mut disturbed = DoubleRun::new(graph);
        // What counts or tells that something holds stands still, and is exact in any word.
        let moves = |state: &State| state.motion.is_none() && state.derivative != Expr::Constant(0.0);
        for (id, state) in model.states.numbered().filter(|(_, state)| moves(state)) {
            let lowest = fixed.exponents[graph.states[id].0.index()] + fixed.format.guard_bits as i32;
            let lsb = libm::scalbn(1.0, lowest);
            disturbed.set_state(id, state.initial + if id.index() % 2 == 0 { lsb } else { -lsb });
        }
        let records = [
            counted.in_double(graph, DoubleRun::new(graph))?,
            counted.in_fixed(graph, fixed),
            counted.in_halves(&half, &finer)?,
            counted.in_double(graph, disturbed)?,
        ];
        Ok(Tally::new(found, model, records))
    }
}

/// What is counted.
struct Counted<'a> {
    model: &'a Model,
    families: &'a [Family],
    of_state: &'a [Option<usize>],
}

impl Counted<'_> {
    fn recorder(&self) -> Recorder<'_> {
        Recorder::new(self.families.len(), self.of_state)
    }

    fn in_double(&self, graph: &StepGraph, mut run: DoubleRun) -> Result<Record, Vec<Diagnostic>> {
        let mut recorder = self.recorder();
        let mut jumping = Jumping::of(self.model, graph, |state| run.state(state));
        let states = self.model.states.len();
        for done in 1..=self.model.steps() {
            let time = self.model.time(done - 1, 0.0);
            run.step(&self.model.sample_inputs(time)).map_err(|_| not_finite(time))?;
            recorder.jumped(done, jumping.jumped(|state| run.state(state), |value| run.value(value.index())));
            recorder.ended(run.states().take(states));
        }
        Ok(recorder.record(self.families))
    }

    fn in_halves(&self, half: &Model, graph: &StepGraph) -> Result<Record, Vec<Diagnostic>> {
        let (mut recorder, mut run) = (self.recorder(), DoubleRun::new(graph));
        let mut jumping = Jumping::of(half, graph, |state| run.state(state));
        let states = self.model.states.len();
        for done in 1..=self.model.steps() {
            for inputs in in_halves(self.model, half, done - 1) {
                run.step(&inputs).map_err(|_| not_finite(self.model.time(done - 1, 0.0)))?;
                recorder.jumped(done, jumping.jumped(|state| run.state(state), |value| run.value(value.index())));
            }
            recorder.ended(run.states().take(states));
        }
        Ok(recorder.record(self.families))
    }

    fn in_fixed(&self, graph: &StepGraph, fixed: &FixedPoint) -> Record {
        let mut recorder = self.recorder();
        let mut run = FixedRun::new(graph, fixed);
        let mut jumping = Jumping::of(self.model, graph, |state| run.state(state)).rounded(graph, fixed);
        for done in 1..=self.model.steps() {
            let words = port_words(self.model, &run, done - 1);
            run.step(&words);
            recorder.jumped(done, jumping.jumped(|state| run.state(state), |value| run.number(value)));
            let states = (0..self.model.states.len()).map(|state| run.state(StateId::at(state)));
            recorder.ended(states);
        }
        recorder.record(self.families)
    }
}
