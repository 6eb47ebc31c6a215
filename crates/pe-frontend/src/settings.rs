//! The statements that occur once: `model`, `solver`, `step`, `span`.

use crate::ast::{Measure, Name, Spec, StatementKind};
use crate::elaborate::Elaborator;
use crate::nearest::suggestion;
use crate::report::Report;
use crate::units::Units;
use pe_ir::codes;
use pe_ir::model::{Phase, Solver, step_count_problem};
use pe_ir::source::{Diagnostic, Span};

/// Units of time and their length in seconds.
pub(crate) const TIMES: [(&str, f64); 6] =
    [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0)];

/// Units of frequency in hertz.
pub(crate) const FREQUENCIES: [(&str, f64); 2] = [("Hz", 1.0), ("kHz", 1e3)];

/// The single statements as found.
#[derive(Default)]
pub(crate) struct Settings<'a> {
    model: Option<(&'a Name, &'a str)>,
    solver: Option<Solver>,
    step: Option<&'a Measure>,
    early: &'a [(Measure, Measure)],
    span: Option<&'a Measure>,
    pub(crate) units: Option<Units>,
}

/// What the single statements say.
pub(crate) struct Header {
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) solver: Solver,
    pub(crate) times: Times,
}

/// Steps and span.
pub(crate) struct Times {
    pub(crate) step: f64,
    pub(crate) phases: Vec<Phase>,
    pub(crate) span: f64,
}

/// Steps for the beginning of a run, at most.
const MOST_EARLY_STEPS: f64 = 1e9;

impl<'a> Settings<'a> {
    /// Finds the single statements; reports missing and repeated ones.
    pub(crate) fn collect(spec: &'a Spec, report: &mut Report) -> Self {
        let mut settings = Settings::default();
        let mut seen: [Option<Span>; 4] = [None; 4];
        const SECTIONS: [&str; 4] = ["model", "solver", "step", "span"];
        let mut units: Option<Span> = None;
        for statement in &spec.statements {
            if let StatementKind::Units(name) = &statement.kind {
                match units.replace(statement.span) {
                    None => settings.units = units_mode(name, report),
                    Some(first) => report.push(
                        Diagnostic::error(codes::DUPLICATE, statement.span, "a second `units` statement")
                            .with_label(first, "the first one"),
                    ),
                }
            }
            let section = match &statement.kind {
                StatementKind::Model { .. } => 0,
                StatementKind::Solver(_) => 1,
                StatementKind::Step(..) => 2,
                StatementKind::Span(_) => 3,
                _ => continue,
            };
            if let Some(first) = seen[section] {
                let message = format!("a second `{}` statement", SECTIONS[section]);
                report.push(
                    Diagnostic::error(codes::DUPLICATE, statement.span, message).with_label(first, "the first one"),
                );
                continue;
            }
            seen[section] = Some(statement.span);
            match &statement.kind {
                StatementKind::Model { name, title } => {
                    check_model_name(name, report);
                    settings.model = Some((name, title));
                }
                StatementKind::Solver(name) => settings.solver = solver(name, report),
                StatementKind::Step(step, early) => (settings.step, settings.early) = (Some(step), early),
                StatementKind::Span(span) => settings.span = Some(span),
                _ => {}
            }
        }
        const EXAMPLES: [&str; 4] = ["model NAME \"title\"", "solver rk4", "step 1 ms", "span 2 s"];
        for ((section, example), seen) in SECTIONS.iter().zip(EXAMPLES).zip(seen) {
            if seen.is_none() && !spec.broken.iter().any(|broken| broken.section == *section) {
                report.push(
                    Diagnostic::global(codes::MISSING_SECTION, format!("the spec has no `{section}` statement"))
                        .with_help(format!("add one, for example `{example}`")),
                );
            }
        }
        settings
    }

    /// Everything together; `None` if something is missing.
    pub(crate) fn header(&self, times: Times) -> Option<Header> {
        let (name, title) = self.model?;
        Some(Header { name: name.text.clone(), title: title.to_owned(), solver: self.solver?, times })
    }
}

fn check_model_name(name: &Name, report: &mut Report) {
    if name.text.starts_with('_') {
        let message = format!("the model name `{}` does not begin with a letter", name.text);
        let help = "files and hardware units are named after the model";
        report.push(Diagnostic::error(codes::WRONG_KIND, name.span, message).with_help(help));
    }
}

fn units_mode(name: &Name, report: &mut Report) -> Option<Units> {
    let found = Units::ALL.into_iter().find(|(word, _)| *word == name.text);
    if found.is_none() {
        let message = format!("`{}` is no way to check units", name.text);
        let error = Diagnostic::error(codes::UNKNOWN_UNIT, name.span, message);
        report.push(error.with_help("there are `strict`, `warn` and `off`"));
    }
    found.map(|(_, units)| units)
}

fn solver(name: &Name, report: &mut Report) -> Option<Solver> {
    let found = Solver::ALL.into_iter().find(|solver| solver.name() == name.text);
    if found.is_none() {
        let message = format!("unknown solver `{}`", name.text);
        let help = suggestion(&name.text, Solver::ALL.map(Solver::name))
            .unwrap_or_else(|| format!("there are `{}`", Solver::ALL.map(Solver::name).join("`, `")));
        report.push(Diagnostic::error(codes::UNKNOWN_SOLVER, name.span, message).with_help(help));
    }
    found
}

impl<'a> Elaborator<'a> {
    /// Step, steps for the beginning, and span.
    pub(crate) fn times(&mut self, settings: &Settings<'a>) -> Option<Times> {
        let step = settings.step.and_then(|step| self.time(step, "step"));
        let span = settings.span.and_then(|span| self.time(span, "span"));
        let (step, span) = (step?, span?);
        let phases = self.phases(settings.early, step, span)?;
        let place = settings.span.map_or_else(Span::default, |span| span.value.span);
        if let Some(problem) = step_count_problem(step, span) {
            self.report.push(Diagnostic::error(codes::BAD_STEP_COUNT, place, problem).with_help("check the units"));
        }
        Some(Times { step, phases, span })
    }

    /// The steps for the beginning of the run.
    fn phases(&mut self, early: &'a [(Measure, Measure)], last: f64, span: f64) -> Option<Vec<Phase>> {
        let mut phases: Vec<Phase> = Vec::with_capacity(early.len());
        for (step, until) in early {
            let place = until.value.span;
            let (step, until) = (self.time(step, "step")?, self.time(until, "end of a step")?);
            let from = phases.last().map_or(0.0, |phase| phase.until);
            let steps = (until - from) / step;
            if until <= from || until >= span {
                let message = format!("a step until {until} s does not lie between {from} s and the span of {span} s");
                self.report.push(Diagnostic::error(codes::BAD_STEP_COUNT, place, message));
            } else if (steps - libm::round(steps)).abs() > 1e-6 * steps || steps > MOST_EARLY_STEPS {
                let message = format!("the stretch from {from} s to {until} s is {steps} steps of {step} s");
                let help = "it must be a whole number of steps, at most 1e9";
                self.report.push(Diagnostic::error(codes::BAD_STEP_COUNT, place, message).with_help(help));
            }
            phases.push(Phase { until, ratio: last / step });
        }
        Some(phases)
    }

    pub(crate) fn time(&mut self, measure: &'a Measure, what: &str) -> Option<f64> {
        let value = self.measure(measure, &TIMES, what)?;
        if value > 0.0 {
            return Some(value);
        }
        let message = format!("the {what} is {value} s; it must be positive");
        self.report.push(Diagnostic::error(codes::NOT_POSITIVE, measure.value.span, message));
        None
    }

    /// Value of a constant with an optional unit.
    fn measure(&mut self, measure: &'a Measure, units: &[(&str, f64)], what: &str) -> Option<f64> {
        let scale = unit_scale(measure.unit.as_ref(), units, what).map_err(|error| self.report.push(error)).ok();
        let value = self.constant(&measure.value)?;
        Some(scaled(value, scale?))
    }
}

/// What a unit stands for, or why it does not suit.
pub(crate) fn unit_scale(unit: Option<&Name>, units: &[(&str, f64)], what: &str) -> Result<f64, Diagnostic> {
    let Some(unit) = unit else { return Ok(1.0) };
    if let Some((_, scale)) = units.iter().find(|(name, _)| *name == unit.text) {
        return Ok(*scale);
    }
    let message = format!("`{}` is no unit for the {what}", unit.text);
    let known: Vec<String> = units.iter().map(|(name, _)| format!("`{name}`")).collect();
    let help = match known.as_slice() {
        [] => "give a plain number here".to_owned(),
        _ => format!("known units are {}", known.join(", ")),
    };
    Err(Diagnostic::error(codes::UNKNOWN_UNIT, unit.span, message).with_help(help))
}

/// `value` in the base unit. Small units are powers of ten, so dividing by their inverse rounds only once:
/// `100 us` is the double nearest to 1e-4.
pub(crate) fn scaled(value: f64, scale: f64) -> f64 {
    if scale < 1.0 { value / libm::round(1.0 / scale) } else { value * scale }
}
