//! The statements that occur once: `model`, `solver`, `step`, `span`.

use crate::language::habits;
use crate::language::measures::{TimeUnit, time_unit};
use crate::nearest::suggestion;
use crate::report::Report;
use crate::syntax::ast::{Measure, Name, Spec, StatementKind};
use crate::units::dimension::Units;
use pe_ir::codes;
use pe_ir::model::Solver;
use pe_ir::source::{Diagnostic, Span};

/// The single statements as found.
#[derive(Default)]
pub(crate) struct Settings<'a> {
    model: Option<(&'a Name, &'a str)>,
    solver: Option<Solver>,
    pub(crate) step: Option<&'a Measure>,
    pub(crate) early: &'a [(Measure, Measure)],
    pub(crate) span: Option<&'a Measure>,
    pub(crate) units: Option<Units>,
    pub(crate) time: Option<TimeUnit>,
}

/// What the model is called, and how it is solved.
pub(crate) struct Header {
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) solver: Solver,
}

impl<'a> Settings<'a> {
    /// Finds the single statements; reports missing and repeated ones.
    pub(crate) fn collect(spec: &'a Spec, report: &mut Report) -> Self {
        let mut settings = Settings::default();
        let mut seen: [Option<Span>; 4] = [None; 4];
        const SECTIONS: [&str; 4] = ["model", "solver", "step", "span"];
        let (mut units, mut time): (Option<Span>, Option<Span>) = (None, None);
        for statement in &spec.statements {
            let (word, place) = match &statement.kind {
                StatementKind::Units(_) => ("units", &mut units),
                StatementKind::Time(_) => ("time", &mut time),
                _ => continue,
            };
            match (*place, &statement.kind) {
                (Some(first), _) => {
                    let message = format!("a second `{word}` statement");
                    let error = Diagnostic::error(codes::DUPLICATE, statement.span, message);
                    report.push(error.with_label(first, "the first one"));
                    continue;
                }
                (None, StatementKind::Units(name)) => settings.units = units_mode(name, report),
                (None, StatementKind::Time(unit)) => {
                    settings.time = time_unit(unit).map_err(|error| report.push(error)).ok();
                }
                _ => {}
            }
            *place = Some(statement.span);
        }
        for statement in &spec.statements {
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
    pub(crate) fn header(&self) -> Option<Header> {
        let (name, title) = self.model?;
        Some(Header { name: name.text.clone(), title: title.to_owned(), solver: self.solver? })
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
        let message = format!("`{}` is not a way to check units", name.text);
        let error = Diagnostic::error(codes::UNKNOWN_UNIT, name.span, message);
        report.push(error.with_help("use `strict`, `warn` or `off`"));
    }
    found.map(|(_, units)| units)
}

fn solver(name: &Name, report: &mut Report) -> Option<Solver> {
    let found = Solver::ALL.into_iter().find(|solver| solver.name() == name.text);
    if found.is_none() {
        let message = format!("unknown solver `{}`", name.text);
        let help = habits::solver(&name.text)
            .map(str::to_owned)
            .or_else(|| suggestion(&name.text, Solver::ALL.map(Solver::name)))
            .unwrap_or_else(|| format!("there are `{}`", Solver::ALL.map(Solver::name).join("`, `")));
        report.push(Diagnostic::error(codes::UNKNOWN_SOLVER, name.span, message).with_help(help));
    }
    found
}
