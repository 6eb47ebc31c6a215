//! The pass that computes steps, span and periods.

use crate::context::Context;
use crate::declare::settings::Settings;
use crate::language::measures::{TIMES, scaled, unit_scale};
use crate::syntax::ast::Measure;
use pe_ir::codes;
use pe_ir::model::{Phase, Rate, step_count_problem};
use pe_ir::source::{Diagnostic, Span};

/// Steps and span.
pub(crate) struct Times {
    pub(crate) step: f64,
    pub(crate) phases: Vec<Phase>,
    pub(crate) span: f64,
}

/// Steps for the beginning of a run, at most.
const MOST_EARLY_STEPS: f64 = 1e9;

/// Step, steps for the beginning, and span.
pub(crate) fn times<'a>(context: &mut Context<'a>, settings: &Settings<'a>) -> Option<Times> {
    let step = settings.step.and_then(|step| time(context, step, "step"));
    let span = settings.span.and_then(|span| time(context, span, "span"));
    let (step, span) = (step?, span?);
    let phases = phases(context, settings.early, step, span)?;
    let place = settings.span.map_or_else(Span::default, |span| span.value.span);
    if let Some(problem) = step_count_problem(step, span) {
        context.report.push(Diagnostic::error(codes::BAD_STEP_COUNT, place, problem).with_help("check the units"));
    }
    Some(Times { step, phases, span })
}

/// The steps for the beginning of the run.
fn phases<'a>(context: &mut Context<'a>, early: &'a [(Measure, Measure)], last: f64, span: f64) -> Option<Vec<Phase>> {
    let mut phases: Vec<Phase> = Vec::with_capacity(early.len());
    for (step, until) in early {
        let place = until.value.span;
        let (step, until) = (time(context, step, "step")?, time(context, until, "end of a step")?);
        let from = phases.last().map_or(0.0, |phase| phase.until);
        let steps = (until - from) / step;
        if until <= from || until >= span {
            let message = format!("a step until {until} s does not lie between {from} s and the span of {span} s");
            context.report.push(Diagnostic::error(codes::BAD_STEP_COUNT, place, message));
        } else if (steps - libm::round(steps)).abs() > 1e-6 * steps || steps > MOST_EARLY_STEPS {
            let message = format!("the phase from {from} s to {until} s is {steps} steps of {step} s");
            let help = "it must be a whole number of steps, at most 1e9";
            context.report.push(Diagnostic::error(codes::BAD_STEP_COUNT, place, message).with_help(help));
        }
        phases.push(Phase { until, ratio: last / step });
    }
    Some(phases)
}

/// A positive time.
fn time<'a>(context: &mut Context<'a>, measure: &'a Measure, what: &str) -> Option<f64> {
    let unstated = context.names.time.seconds;
    let scale =
        unit_scale(measure.unit.as_ref(), &TIMES, what, unstated).map_err(|error| context.report.push(error)).ok();
    let value = scaled(context.constant(&measure.value)?, scale?);
    if value > 0.0 {
        return Some(value);
    }
    let message = format!("the {what} is {value} s; it must be positive");
    context.report.push(Diagnostic::error(codes::NOT_POSITIVE, measure.value.span, message));
    None
}

/// The rates of all blocks; `None` after an error.
pub(crate) fn rates(context: &mut Context) -> Option<Vec<Rate>> {
    let spec = context.spec;
    let mut rates = Vec::with_capacity(spec.blocks.len());
    for block in &spec.blocks {
        let period = block.period.as_ref().and_then(|period| time(context, period, "period"));
        rates.extend(period.map(|period| Rate { period, span: block.span }));
    }
    (rates.len() == spec.blocks.len()).then_some(rates)
}
