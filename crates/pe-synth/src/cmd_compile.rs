//! `pe-synth compile`: model to hardware, reference and report.

use pe_judge::DesignPoint;
use std::path::{Path, PathBuf};

use clap::builder::PossibleValuesParser;
use pe_hls::rings;
use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::program::{Host, Program};
use pe_ir::source::{Diagnostic, Severity, Sources};
use pe_sim::reference::ReferenceError;

use crate::accuracy::options::FixedArgs;
use crate::check;
use crate::compiled::{Compiled, Files};
use crate::console;
use crate::messages::MessageFormat;
use crate::options::{ClockArgs, ConservedArgs, GoalArgs, MappingArgs, ModelArgs, PointArgs, positive};
use crate::output::OutputFolder;
use crate::progress;
use crate::rerun::{self, WatchArgs};
use pe_flow::accuracy::choice::{Choice, Question};
use pe_flow::accuracy::wanted::{Goals, USUAL_ERROR};
use pe_flow::failure::Failure;
use pe_flow::outputs;
use pe_flow::penalty;
use pe_flow::pipeline::{self, Design};
use pe_flow::report::mechanism::Mechanism;
use pe_flow::report::table::row;
use pe_flow::report::{DeviceFit, Report, Silicon, Stability, Told, timing};
use pe_flow::settings::Settings;
use pe_flow::spec::LoadedModel;
use pe_flow::variables::variables;
use pe_flow::watch::{Listener, Stopwatch};
use pe_judge::check::{self as judge, Check, EXPLAINED, JUDGED_STATES};
use pe_judge::conserved::Conserved;
use pe_judge::parse::duration;
use pe_judge::residuals::Residuals;
use pe_judge::total::{Reference, TotalError};
use pe_target::area::{self, Measured};
use pe_target::clock::ClockSource;
use pe_target::devices::Fit;

/// Compiles a model to VHDL, test bench, Rust reference, reference trace and report
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth compile models/weibel5/weibel5.spec
  pe-synth compile models/weibel5/weibel5.spec --pes 8 --multiplier 25x18 -o out/small
  pe-synth compile models/weibel5/weibel5.spec --span 20ms --set generations=4
  pe-synth compile models/van_der_pol/van_der_pol.spec --max-error 1e-4
  pe-synth compile --from step.txt")]
pub struct Compile {
    // The first field, for each takes what it reads away from those that follow.
    #[command(flatten)]
    fixed: FixedArgs,
    #[command(flatten)]
    point: PointArgs,
    #[command(flatten)]
    mapping: MappingArgs,
    /// Output folder; replaced if pe-synth wrote it [default: out/MODEL]
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<PathBuf>,
    #[command(flatten)]
    clock: ClockArgs,
    /// Uses measured sizes of PEs instead of estimates, from a file that `cargo run -p xtask -- measure-area` wrote
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    area_from: Option<PathBuf>,
    /// Writes `NAME.h`, the C header of the Rust reference as a library
    #[arg(long, help_heading = "Output")]
    header: bool,
    /// Draws no pictures and no page
    #[arg(long, help_heading = "Output")]
    no_pictures: bool,
    /// Solves the model with a library for differential equations to measure the total error
    #[arg(long, help_heading = "Output")]
    reference: bool,
    /// Gives the network ports for a host: `restart` brings back the initial state, `states` reads and replaces states
    /// between two steps, `flags` has one flag per cause and clears them
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = PossibleValuesParser::new(Host::NAMES), help_heading = "Hardware")]
    host: Vec<String>,
    /// Outputs as ports, or in memories with one read port; `auto` chooses beyond 16 outputs what takes less
    #[arg(long, value_enum, value_name = "KIND", default_value_t, help_heading = "Hardware")]
    outputs: OutputsArg,
    #[command(flatten)]
    conserved: ConservedArgs,
    /// Chooses solver, step, multiplier and storage that meet this total error with the shortest run time; options that
    /// are given are kept
    #[arg(long, value_name = "E", allow_hyphen_values = true, value_parser = positive, help_heading = "Output")]
    max_error: Option<f64>,
    /// Longest time between two outputs of the design that `--max-error` or another goal chooses: its step divides this time
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = duration, help_heading = "Output")]
    sample: Option<f64>,
    #[command(flatten)]
    goal: GoalArgs,
    #[command(flatten)]
    again: WatchArgs,
    /// What is computed.
    #[command(flatten)]
    pub model: ModelArgs,
    /// Prints errors and warnings only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
}

/// Where outputs are.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
enum OutputsArg {
    #[default]
    Auto,
    Ports,
    Memory,
}

impl Compile {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Those of the spec, the options and the stages, and files that cannot be written.
    pub fn run(&self, command: &str) -> Result<(), Failure> {
        if self.again.watch {
            return rerun::watch(&self.model, &self.mapping);
        }
        let mut watch = progress::stopwatch(self.is_quiet(), self.message_format());
        let told = progress::listener(true, self.message_format());
        let loaded = watch.stage(
            "read",
            || self.load(&told),
            |loaded| match loaded {
                Ok(LoadedModel { model, .. }) => {
                    let title = if model.title.is_empty() { String::new() } else { format!(", {}", model.title) };
                    format!("{}: {}{title}", model.name, model.size())
                }
                Err(_) => "refused".to_owned(),
            },
        )?;
        let target = self.output.clone().unwrap_or_else(|| PathBuf::from("out").join(&loaded.model.name));
        OutputFolder::permitted(&target)?;
        let compiled = self.compiled(&loaded, command, &mut watch)?;
        let folder = OutputFolder::create_until_interrupted(&target)?;
        let files = Files { header: self.header, pictures: !self.no_pictures };
        compiled.write(&folder, files, &mut watch)?;
        folder.write("report-timing.json", &format!("{:#}\n", timing(&watch, &compiled.design)))?;
        folder.finish()?;
        if !self.is_quiet() {
            let files = row("files", &format!("{}; all figures in report.json", target.display()));
            console::out(&(compiled.table() + &files))?;
        }
        Ok(())
    }

    fn is_quiet(&self) -> bool {
        self.quiet || self.message_format() == MessageFormat::Json
    }

    /// Reads the model, or the text of a stage; its warnings go to the listener.
    ///
    /// # Errors
    /// Those of the spec, and options that come too late.
    pub fn load(&self, told: &dyn Listener) -> Result<LoadedModel, Failure> {
        self.model.load_stages(&self.point.point(), &self.mapping.options(), told)
    }

    /// Compiles a model; `command` is what its files say made them.
    ///
    /// # Errors
    /// Those of the options and of the stages.
    pub fn compiled(&self, loaded: &LoadedModel, command: &str, watch: &mut Stopwatch) -> Result<Compiled, Failure> {
        let clock = self.clock.source();
        let conserved = self.conserved.of(&loaded.model)?;
        let measured = self.area_from.as_deref().map_or_else(|| Ok(Measured::default()), measured)?;
        let (choice, Built { loaded, mut design, check, total }) = self.decided(loaded, &conserved, watch)?;
        for name in &self.host {
            design.program.host.add(name);
        }
        hosted(&design.program)?;
        if design.program.host.replaces() {
            watch.warn(rows_stay(&design).as_slice(), &loaded.sources);
        }
        reached(&loaded.model, &design.program)?;
        let wanted = match self.outputs {
            OutputsArg::Auto => outputs::Wanted::Auto,
            OutputsArg::Ports => outputs::Wanted::Ports,
            OutputsArg::Memory => outputs::Wanted::Memory,
        };
        let outputs_in = outputs::place(&mut design.program, wanted, clock.family())?;
        let model = &loaded.model;
        let area = area::size(&design.program, &measured, clock.family());
        let pes = design.program.pes.len() as u32;
        let fit = self.clock.device.map(|device| Fit::of(device, &area));
        if let Some(complaint) = fit.as_ref().filter(|_| self.goal.fit).and_then(Fit::complaint) {
            return Err(Failure::out_of_reach(
                complaint,
                "leave out `--fit`, `--host` or `--outputs`",
                &loaded.sources,
            ));
        }
        let silicon = Silicon { area, clock: clock.of(&design.program.format, pes) };
        let variables = variables(model, &design.graph, &design.judged);
        let told = Told { variables: &variables, silicon, total: &total, seed: self.model.seed, command };
        let mut report = Report::of(model, &design, &told);
        report.outputs_in = outputs_in;
        report.stability = check.as_ref().map(|check| Stability::of(model, check));
        report.mechanism = residuals(&loaded, &design, &conserved, watch);
        report.stability_reason = check.is_none().then(unjudged);
        if let Some(fit) = &fit {
            report.device = Some(DeviceFit::of(fit));
            let warning = fit.complaint().map(|text| Diagnostic::global(codes::DOES_NOT_FIT, text));
            let help = format!("{} such PEs would fit", fit.fitting_pes);
            let warning = warning.map(|warning| warning.with_help(help).into_warning());
            watch.warn(warning.as_slice(), &loaded.sources);
        }
        report.choice = choice.as_ref().map(|choice| choice.report(model));
        let stability = check.as_ref().map_or_else(unjudged, |check| check::summary(model, check));
        let chosen = choice.map_or(Vec::new(), |choice| choice.table(model)).into_iter();
        let rows = std::iter::once(("stability", stability)).chain(chosen);
        let rows = rows.chain(fit.map(|fit| ("device", fit.summary())));
        let rows = rows.map(|(name, text)| row(name, &text)).collect();
        Ok(Compiled { loaded, design, variables, report, rows, command: command.to_owned() })
    }

    /// Designs the point of the options, or one that meets the goals.
    fn decided(
        &self,
        loaded: &LoadedModel,
        conserved: &[Conserved],
        watch: &mut Stopwatch,
    ) -> Result<(Option<Choice>, Built), Failure> {
        let mut settings = self.model.settings(&self.mapping);
        // What replaces states does not know where in a ring they are.
        if self.host.iter().any(|name| Host::REPLACING.contains(&&**name)) {
            settings.mapping.rings = rings::Choice::Chains;
        }
        let goals = self.goal.goals(self.max_error, self.clock);
        if goals.is_none() && self.sample.is_some() {
            let message = "`--sample` needs a goal, such as `--max-error`, for which a step is chosen";
            return Err(Failure::Usage(message.to_owned()));
        }
        let mut choice = match goals {
            Some(goals) => {
                settings.mapping.of_many()?;
                if loaded.stages.as_ref().is_some_and(|stages| stages.graph.is_some()) {
                    let message = "a goal (`--max-error`) chooses solver and step, which the text has decided; start from a model";
                    return Err(Failure::Usage(message.to_owned()));
                }
                Some(self.choose(loaded, &settings, conserved, self.clock.source(), goals, watch)?)
            }
            None => None,
        };
        // Formats of a design that was chosen for its error stay as they are.
        if choice.is_some() {
            settings.criteria.widen = 0;
        }
        let points = choice.as_ref().map_or_else(|| vec![self.point.point()], Choice::points);
        let (place, built) = first_that_works(&points, |point| {
            let built = self.build(loaded, &settings, (point, goals), conserved, watch);
            if let Some(text) = built.as_ref().err().and_then(Failure::why_not).filter(|_| !self.is_quiet()) {
                console::err(&format!("{:>10}  {text}\n", "refused"));
            }
            built
        })?;
        if let Some(choice) = &mut choice {
            choice.pass_over(place);
        }
        Ok((choice, built))
    }

    /// The cheapest design that is right enough.
    fn choose(
        &self,
        loaded: &LoadedModel,
        settings: &Settings,
        conserved: &[Conserved],
        clock: ClockSource,
        goals: Goals,
        watch: &mut Stopwatch,
    ) -> Result<Choice, Failure> {
        let (point, fixed) = (self.point.point(), self.fixed.0);
        let question = Question { loaded, settings, point, fixed, conserved, clock, goals, sample: self.sample };
        watch.stage(
            "choose",
            || question.answer(),
            |choice| choice.as_ref().map_or("no design".to_owned(), |choice| choice.figure(&loaded.model)),
        )
    }
}

/// Refuses ports for a host that the network cannot have.
fn hosted(program: &Program) -> Result<(), Failure> {
    if program.host.replaces() {
        let refused = |reason| Failure::Usage(format!("{reason}; leave `restart` and `states` out of `--host`"));
        program.replacements().map_err(refused)?;
    }
    Ok(())
}

/// What rows of past words cost where states are replaced, and nothing can be in rings.
fn rows_stay(design: &Design) -> Option<Diagnostic> {
    let (all, ringed) =
        (design.graph.macs(), rings::rings(&design.graph, &design.judged.fixed, rings::Choice::ByCost)?.graph.macs());
    let message = format!(
        "{} of {all} products of a step move the words of delays on: a host that replaces states needs each of them as a state",
        all - ringed
    );
    let help = "leave `restart` and `states` out of `--host`, or take a longer step";
    Some(Diagnostic::global(codes::ROWS_STAY, message).with_help(help).into_warning())
}

/// Refuses tunable parameters that no host can write.
fn reached(model: &Model, program: &Program) -> Result<(), Failure> {
    match model.tunables().next() {
        Some((parameter, _)) if !program.host.states => Err(Failure::Usage(format!(
            "`{}` is tunable, but nothing can write it: add `--host states`, or leave `tunable` out of its declaration",
            parameter.name
        ))),
        _ => Ok(()),
    }
}

/// A design with what was found out about it.
struct Built {
    /// The model with the design's solver and step.
    loaded: LoadedModel,
    design: Design,
    check: Option<Check>,
    total: Option<Result<TotalError, ReferenceError>>,
}

impl Compile {
    /// Designs a point, judges its step, and confirms it if there is a goal.
    fn build(
        &self,
        loaded: &LoadedModel,
        settings: &Settings,
        (point, goals): (&DesignPoint, Option<Goals>),
        conserved: &[Conserved],
        watch: &mut Stopwatch,
    ) -> Result<Built, Failure> {
        let mut loaded = loaded.clone();
        point.apply(&mut loaded.model).map_err(Failure::Usage)?;
        let design = pipeline::design(&loaded, settings, point, watch)
            .map_err(|failure| self.explained(failure, &loaded, settings, point))?;
        let check = checked(&loaded, settings, &design, point, watch)
            .map_err(|failure| self.explained(failure, &loaded, settings, point))?;
        let total = (self.reference || goals.is_some()).then(|| total_error(&loaded, &design, conserved, watch));
        if let (Some(goals), Some(total)) = (goals, &total) {
            confirm(goals.max_error.unwrap_or(USUAL_ERROR), total, &loaded.sources)?;
        }
        Ok(Built { loaded, design, check, total })
    }

    /// A refusal with what explains it and what helps; other failures as they are.
    fn explained(&self, failure: Failure, loaded: &LoadedModel, settings: &Settings, point: &DesignPoint) -> Failure {
        let Failure::Spec(refusals, sources) = failure else { return failure };
        let other = |name: &str, penalty: f64| self.model.with_penalty(loaded, point, name, penalty);
        if let Some(finding) = penalty::explained(loaded, settings, point, &refusals, &other) {
            return Failure::Spec(vec![finding], sources);
        }
        let explained = refusals.iter().any(|refusal| EXPLAINED.contains(&refusal.code));
        if !explained || loaded.model.states.len() > JUDGED_STATES {
            return Failure::Spec(refusals, sources);
        }
        let graph = pipeline::build(loaded, point, &settings.mapping, &mut Stopwatch::silent());
        let question = graph.as_ref().ok().and_then(|graph| step_question(loaded, settings, graph, point).ok());
        let findings = match question {
            Some(question) => Check::of_refused(&question, refusals).findings,
            None => Check::of_unbuilt(&loaded.model, refusals),
        };
        Failure::Spec(findings, sources)
    }
}

/// How well a design keeps the closures of a mechanism, if the model states one.
fn residuals(
    loaded: &LoadedModel,
    design: &Design,
    conserved: &[Conserved],
    watch: &mut Stopwatch,
) -> Option<Mechanism> {
    loaded.model.mechanism.as_ref()?;
    let of =
        || Residuals::of(&loaded.model, &design.graph, &design.judged.fixed, conserved).map(|of| Mechanism::of(&of));
    watch.stage("closures", of, |found| found.as_ref().map_or_else(String::new, Mechanism::to_string))
}

/// Judges the step of a design, unless it is large.
fn checked(
    loaded: &LoadedModel,
    settings: &Settings,
    design: &Design,
    point: &DesignPoint,
    watch: &mut Stopwatch,
) -> Result<Option<Check>, Failure> {
    if loaded.model.states.len() > JUDGED_STATES {
        return Ok(None);
    }
    let question = step_question(loaded, settings, &design.graph, point)?;
    let check = watch.stage(
        "stability",
        || Check::of_judged(&question, &design.judged),
        |check| check::summary(&loaded.model, check),
    );
    let (refusals, warnings): (Vec<_>, Vec<_>) =
        check.own_findings().into_iter().partition(|finding| finding.severity == Severity::Error);
    watch.warn(&warnings, &loaded.sources);
    if refusals.is_empty() { Ok(Some(check)) } else { Err(Failure::Spec(refusals, loaded.sources.clone())) }
}

fn step_question<'a>(
    loaded: &'a LoadedModel,
    settings: &'a Settings,
    graph: &'a StepGraph,
    point: &'a DesignPoint,
) -> Result<judge::Question<'a>, Failure> {
    let (model, criteria) = (&loaded.model, &settings.criteria);
    let format = point.format(model).map_err(Failure::Usage)?;
    Ok(judge::Question { model, graph, point, criteria, format, goal: None })
}

/// The first of some candidates that works out, with its place; if the model refuses all of them, why it refused the
/// first.
fn first_that_works<P, T>(
    candidates: &[P],
    mut build: impl FnMut(&P) -> Result<T, Failure>,
) -> Result<(usize, T), Failure> {
    let mut refusal = None;
    for (place, candidate) in candidates.iter().enumerate() {
        match build(candidate) {
            Ok(built) => return Ok((place, built)),
            Err(failure @ (Failure::Fruitless(_) | Failure::Spec(..))) => refusal = refusal.or(Some(failure)),
            Err(failure) => return Err(failure),
        }
    }
    Err(refusal.unwrap_or_else(|| Failure::Internal("no candidate".to_owned())))
}

/// The design that is about to be written is held against the goal itself.
fn confirm(max_error: f64, total: &Result<TotalError, ReferenceError>, sources: &Sources) -> Result<(), Failure> {
    match total {
        Ok(total) if total.whole.error <= max_error => Ok(()),
        Ok(total) => {
            let error = total.whole.error;
            let text = format!(
                "the chosen design has a total error of {error:.1e}, {:.2} times the limit of {max_error:e}",
                error / max_error
            );
            Err(Failure::out_of_reach(text, "take a smaller goal, so that others are tried", sources))
        }
        Err(error) => Err(Failure::Fruitless(format!("the chosen design has no known total error: {error}"))),
    }
}

/// Why a large model has no verdict.
fn unjudged() -> String {
    format!("not judged beyond the runs: more than {JUDGED_STATES} states, see `pe-synth check`")
}

/// Measured PEs of a file.
fn measured(path: &Path) -> Result<Measured, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::file("read", path, error))?;
    Measured::parse(&text).map_err(|line| {
        Failure::File(format!(
            "{}:{line}: not a measured PE; `cargo run -p xtask -- measure-area` writes such files",
            path.display()
        ))
    })
}

/// Total error; that there is none is a warning, for the design does not depend on it.
fn total_error(
    loaded: &LoadedModel,
    design: &Design,
    conserved: &[Conserved],
    watch: &mut Stopwatch,
) -> Result<TotalError, ReferenceError> {
    let (model, judged) = (&loaded.model, &design.judged);
    let progress = watch.progress("reference");
    let result: Result<TotalError, ReferenceError> = watch.timed(
        "reference",
        || {
            let reference = Reference::solve(model, &judged.times, &judged.looks.times, conserved, &*progress)?;
            Ok(reference.compare(model, judged))
        },
        |total| match total {
            Ok(total) => format!("total error {:.1e}", total.whole.error),
            Err(_) => "no solution".to_owned(),
        },
    );
    let warning = match &result {
        Ok(total) => total.doubt(),
        Err(error) => {
            let help = "the design is written; its report has no total error. Try a shorter `--span`";
            Some(Diagnostic::global(codes::NO_REFERENCE, error.to_string()).with_help(help).into_warning())
        }
    };
    watch.warn(warning.as_slice(), &loaded.sources);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_best_candidate_takes_the_place_of_one_that_is_not_confirmed() {
        let refused = |text: &str| Failure::Fruitless(text.to_owned());
        let build =
            |candidate: &u32| if *candidate < 2 { Err(refused(&candidate.to_string())) } else { Ok(*candidate) };
        assert!(matches!(first_that_works(&[0, 1, 2, 3], build), Ok((2, 2))));
        assert!(matches!(first_that_works(&[1, 0], build), Err(Failure::Fruitless(text)) if text == "1"));
        // What is no refusal of the model ends it.
        let broken = |candidate: &u32| if *candidate == 0 { Err(Failure::File("full".to_owned())) } else { Ok(()) };
        assert!(matches!(first_that_works(&[0, 1], broken), Err(Failure::File(_))));
    }
}
