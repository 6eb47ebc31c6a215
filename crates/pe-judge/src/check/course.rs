//! What a run with exact functions shows on its way: jumps that it keeps crossing, and limits of 0/0 that it uses.

use pe_hls::kinks;
use pe_hls::step::{StepOptions, build_with};
use pe_ir::codes;
use pe_ir::graph::{Role, StepGraph, ValueId};
use pe_ir::index::at;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;

use super::trials::affordable;

/// Steps in a row that cross a jump from which on it is no crossing but chattering: an oscillation that a step resolves
/// crosses far less often.
const IN_A_ROW: u64 = 12;

/// Equations whose limits are named, at most.
const MOST_LIMITS: usize = 8;

/// Part of a jump by which a value changes across it.
const PART: f64 = 0.5;

/// A jump and the values of a step that may take it.
struct Jump {
    /// The algebraic equation that jumps.
    algebraic: usize,
    height: f64,
    /// Its values in the stages of a step.
    stages: Vec<ValueId>,
    last: Option<f64>,
    /// The latest jump, if the step had one.
    rise: Option<f64>,
    /// Steps in a row that crossed it so far, and the first of them.
    row: (u64, f64),
    /// The first time of chattering.
    found: Option<f64>,
}

/// Warnings about the way of a run.
pub(super) fn findings(model: &Model, graph: &StepGraph) -> Vec<Diagnostic> {
    if graph.functions.tables.is_empty() {
        return Vec::new();
    }
    let options = StepOptions { form: Some(graph.form), ..StepOptions::default() };
    let Ok(exact) = build_with(model, &options) else { return Vec::new() };
    let mut jumps = jumps(model, &exact);
    let mut run = DoubleRun::new(&exact);
    // The first value of each equation that does, what it is computed from, and when.
    let mut limits: Vec<(ValueId, f64, f64)> = Vec::new();
    for step in 0..model.steps().min(affordable(exact.macs())) {
        let time = model.time(step, 0.0);
        if run.step(&model.sample_inputs(time)).is_err() {
            break;
        }
        for (value, argument) in run.limits() {
            let equation = exact.value(value).equation;
            if limits.iter().all(|(known, ..)| exact.value(*known).equation != equation) {
                limits.push((value, argument, time));
            }
        }
        jumps.iter_mut().for_each(|jump| jump.follow(&run, time));
    }
    let chattering = jumps.iter().filter_map(|jump| Some(chattering(model, jump.algebraic, jump.found?)));
    let limits = limits.into_iter().take(MOST_LIMITS).filter_map(|found| limit(&exact, found));
    chattering.chain(limits).collect()
}

/// The jumps of a model's continuous part.
fn jumps(model: &Model, graph: &StepGraph) -> Vec<Jump> {
    if !model.rates.is_empty() {
        return Vec::new();
    }
    let all = model.algebraics.iter().enumerate();
    let jumping = all.filter_map(|(index, algebraic)| Some((index, kinks::jump(&algebraic.expr)?)));
    let of = |(algebraic, height): (usize, f64)| {
        let belongs = |role: Role| matches!(role, Role::Algebraic(own, _) if at(own) == algebraic);
        let values = graph.chains.iter().flat_map(|chain| chain.writes()).map(|write| write.value);
        let stages = values.filter(|value| belongs(graph.value(*value).role)).collect();
        Jump { algebraic, height, stages, last: None, rise: None, row: (0, 0.0), found: None }
    };
    jumping.map(of).filter(|jump: &Jump| !jump.stages.is_empty()).collect()
}

impl Jump {
    /// Takes note of a step.
    fn follow(&mut self, run: &DoubleRun, time: f64) {
        let mut crossed = false;
        for value in &self.stages {
            let now = run.value(value.index());
            if let Some(rise) = self.last.map(|last| now - last).filter(|rise| rise.abs() > PART * self.height) {
                // Steps that are taken one after another, in one direction, are a staircase.
                crossed |= self.rise.is_none_or(|before| (before > 0.0) != (rise > 0.0));
                self.rise = Some(rise);
            }
            self.last = Some(now);
        }
        if !crossed {
            self.rise = None;
        }
        self.row = match (crossed, self.row) {
            (false, _) => (0, time),
            (true, (0, _)) => (1, time),
            (true, (steps, first)) => (steps + 1, first),
        };
        if self.row.0 >= IN_A_ROW && self.found.is_none() {
            self.found = Some(self.row.1);
        }
    }
}

fn chattering(model: &Model, algebraic: usize, time: f64) -> Diagnostic {
    let algebraic = &model.algebraics[algebraic];
    let message = format!(
        "`{}` chatters: from t = {time:.6e} s on it jumps back and forth in every step, so that its average depends on the step",
        algebraic.name
    );
    let help = "the solution slides along the jump: write it as a steep slope, such as `tanh(x/0.01)` in place of `sign(x)`, with a \
                step that resolves it, or with hysteresis in a sampled block";
    Diagnostic::error(codes::CHATTERING, algebraic.span, message).with_help(help).into_warning()
}

fn limit(graph: &StepGraph, (value, argument, time): (ValueId, f64, f64)) -> Option<Diagnostic> {
    let chain = graph.chains.iter().find(|chain| chain.write.value == value)?;
    let (equation, function) = (&graph.equations[chain.equation], &graph.functions.exact[at(chain.function?)]);
    let message = format!(
        "`{}` is 0/0 at x = {argument:e}, t = {time:.6e} s: the limit of `{}` is taken there",
        equation.name, function.name
    );
    let help = "this is right where the limit is meant; else keep the argument away with `max`, `min` or `if`";
    Some(Diagnostic::error(codes::LIMIT_TAKEN, equation.span, message).with_help(help).into_warning())
}
