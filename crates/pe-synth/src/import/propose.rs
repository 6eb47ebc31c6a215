//! Solver, step and span of an imported model.

use pe_flow::failure::Failure;
use pe_flow::pipeline;
use pe_flow::settings::MappingOptions;
use pe_flow::watch::Stopwatch;
use pe_import::expr::{Callee, Expr};
use pe_import::model::{Event, Model as Foreign};
use pe_import::{Imported, Setting};
use pe_ir::model::{Model, Solver};
use pe_judge::DesignPoint;
use pe_sim::linear::Linearised;
use pe_sim::spectrum::{eigenvalues, outer_eigenvalues};

use super::load;

/// Steps over the span, at least.
const FEWEST_STEPS: f64 = 5000.0;

/// Steps over the span from which on an implicit method is proposed.
const MOST_STEPS: f64 = 200_000.0;

/// Steps over the span, at least, where an event comes when a state crosses a value: it comes up to a step late.
const EVENT_STEPS: f64 = 200_000.0;

/// The same where the time of the event within the step is found.
const REFINED_STEPS: f64 = 20_000.0;

/// The same where something is read that was some time ago: each step of that time takes a word and a move.
const PAST_STEPS: f64 = 500.0;

/// Parts of an interval that delays and times of events may ask for, at most, and steps that a span may have for delays, which
/// must be whole steps.
const DELAY_PARTS: u64 = 1_000_000;
const DELAY_STEPS: f64 = 1e7;
const TIME_PARTS: u64 = 2_000;

/// Largest step of `rk4` times the fastest rate: well within what is stable, and accurate.
const RATE_STEPS: f64 = 0.25;

/// The same where an implicit method cannot be built: within what is stable.
const STABLE_STEPS: f64 = 1.5;

/// States up to which all eigenvalues are computed, and vectors that estimate those of larger models.
const ALL: usize = 120;
const VECTORS: usize = 40;

/// Span in units of time where neither the file nor the user says one.
const USUAL_SPAN: f64 = 10.0;

/// What a user asks for; times in the unit of time of the model.
#[derive(Clone, Copy, Debug, Default)]
pub struct Asked {
    /// Numerical method.
    pub solver: Option<Solver>,
    /// Step.
    pub step: Option<f64>,
    /// Span.
    pub span: Option<f64>,
    /// Time between rows of results, of which steps are a part.
    pub interval: Option<f64>,
}

/// Solver, step and span: what is asked for, else what the file says, else what the fastest rate at the beginning
/// suggests.
///
/// # Errors
/// Findings of the spec, which an import should never give.
pub fn setting(imported: &Imported, asked: &Asked, name: &str) -> Result<Setting, Failure> {
    let run = imported.model.run;
    let span = asked.span.or(run.span).unwrap_or(USUAL_SPAN);
    let interval = asked.interval.or(run.interval).unwrap_or(span);
    let events = Events::of(&imported.model, interval, span);
    let fewest = match (events.cross, events.refine, events.past) {
        (true, _, false) => EVENT_STEPS,
        (true, _, true) => REFINED_STEPS,
        (false, true, _) => REFINED_STEPS,
        (false, false, true) => PAST_STEPS,
        (false, false, false) => FEWEST_STEPS,
    };
    let part_of = |interval: f64, most: f64| part_of(interval, events.parts, most);
    let usual = part_of(interval, span / fewest);
    let first = Setting { solver: "rk4".to_owned(), step: usual, span, reason: String::new() };
    let fastest = fastest(&load(imported, &first, name)?.model).map(|fastest| fastest * imported.model.seconds());
    let wanted = fastest.map_or(usual, |fastest| part_of(interval, (RATE_STEPS / fastest).min(span / fewest)));
    let implicit = |solver: Solver| solver.takes_lists();
    let chosen = |solver: Solver, step: f64| {
        let step = asked.step.unwrap_or(if implicit(solver) { usual } else { step });
        Setting { solver: solver.name().to_owned(), step, span, reason: String::new() }
    };
    let mut setting = chosen(asked.solver.unwrap_or(Solver::Rk4), wanted);
    if asked.solver.is_none() && span / wanted > MOST_STEPS.max(2.0 * fewest) {
        setting = chosen(Solver::Rodas3, wanted);
        // Derivatives of quotients may have poles where the quotients have none.
        let loaded = load(imported, &setting, name)?;
        let step =
            pipeline::step(&loaded, &DesignPoint::default(), &MappingOptions::default(), &mut Stopwatch::silent());
        if let (Err(_), Some(fastest)) = (step, fastest) {
            setting = chosen(Solver::Rk4, part_of(interval, STABLE_STEPS / fastest));
        }
    }
    setting.reason = match fastest {
        Some(fastest) if asked.step.is_none() => {
            format!("The fastest rate at the beginning is {fastest:.3e} per unit of time; `pe-synth check` tells more.")
        }
        _ => String::new(),
    };
    Ok(setting)
}

/// The largest magnitude of an eigenvalue of the model linearised at the beginning; `None` if there is none.
fn fastest(model: &Model) -> Option<f64> {
    let states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let linear = Linearised::at(model, &states, &model.sample_inputs(0.0));
    if !linear.is_finite() {
        return None;
    }
    let values = if states.len() <= ALL {
        eigenvalues(states.len(), &linear.dense())
    } else {
        outer_eigenvalues(states.len(), VECTORS, |vector| linear.product(vector))
    };
    let magnitude = |(re, im): &(f64, f64)| libm::hypot(*re, *im);
    let largest = values.map_or_else(|| linear.row_bound(), |values| values.iter().map(magnitude).fold(0.0, f64::max));
    Some(largest).filter(|largest| *largest > 0.0)
}

/// What events and delays ask of a step.
struct Events {
    /// Whether one comes when something else than the time crosses a value, at the end of the step.
    cross: bool,
    /// Whether the time of one within a step is found.
    refine: bool,
    /// Whether an equation reads what was some time ago.
    past: bool,
    /// A number of parts of the interval between results, of which steps are a part, too.
    parts: u64,
}

impl Events {
    fn of(model: &Foreign, interval: f64, span: f64) -> Events {
        let most = DELAY_PARTS.min((DELAY_STEPS * interval / span) as u64);
        let mut events = Events { cross: false, refine: false, past: false, parts: 1 };
        for event in &model.events {
            events.cross |= event.crosses(model) && !event.refines();
            events.refine |= event.crosses(model) && event.refines();
            if let Some(delay) = event.delay.as_ref().and_then(|delay| model.known(delay)) {
                events.fit(delay / interval, most);
            }
        }
        let equations =
            model.quantities.iter().flat_map(|quantity| quantity.kind.expressions()).map(|expr| (expr, true));
        for (expr, moves) in equations.chain(model.events.iter().flat_map(Event::expressions).map(|expr| (expr, false)))
        {
            expr.each(&mut |part| {
                if let Expr::Call(Callee::Past, members) = part
                    && let Some(delay) = model.known(&members[1])
                {
                    events.past |= moves;
                    events.fit(delay / interval, most);
                }
            });
        }
        for event in &model.events {
            event.trigger.each(&mut |part| {
                if let Expr::Compare(_, sides) = part
                    && let (Expr::Time, time) | (time, Expr::Time) = &**sides
                    && let Some(time) = model.known(time)
                {
                    events.fit(time / interval, TIME_PARTS);
                }
            });
        }
        events
    }

    /// Takes as many parts that a number of intervals is a whole number of them, if these are not too many.
    fn fit(&mut self, intervals: f64, most: u64) {
        let whole = |parts: u64| {
            let count = intervals * parts as f64;
            (count - libm::round(count)).abs() <= 1e-9 * count.abs().max(1.0)
        };
        let decimal = [1, 2, 3, 4, 5, 6, 7, 8, 9].map(|digit| (0..7).map(move |decade| digit * 10u64.pow(decade)));
        let mut tried: Vec<u64> = decimal.into_iter().flatten().map(|factor| factor * self.parts).collect();
        tried.sort_unstable();
        if let Some(parts) = tried.into_iter().take_while(|parts| *parts <= most).find(|parts| whole(*parts)) {
            self.parts = parts;
        }
    }
}

/// The largest step of at most `most` that is an interval over 1, 2, 5, 10 and so on times `parts`.
fn part_of(interval: f64, parts: u64, most: f64) -> f64 {
    let interval = interval / parts as f64;
    let mut decade = 1.0;
    loop {
        for digit in [1.0, 2.0, 5.0] {
            let parts = decade * digit;
            if interval / parts <= most * (1.0 + 1e-9) || parts > 1e12 {
                return interval / parts;
            }
        }
        decade *= 10.0;
    }
}
