//! `pe-synth explore`: many design points of a model, their size, speed and error.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use pe_ir::model::Model;
use serde_json::{Map, Value, json};

use crate::console;
use crate::explore::drive::{Driver, Events, GENERATOR, fingerprint, tell_of_store, verdict};
use crate::explore::given::{Given, Sweeping};
use crate::explore::options::AxesArgs;
use crate::explore::record::{Kind, Record};
use crate::explore::sheet::{Sheet, shown};
use crate::explore::show;
use crate::messages::MessageFormat;
use crate::options::{GoalArgs, ModelArgs, SweepArgs, positive};
use crate::output::{FolderLock, OutputFolder};
use crate::progress;
use pe_flow::accuracy::wanted::{Goals, USUAL_ERROR};
use pe_flow::explore::axes::{Axes, Completed};
use pe_flow::explore::estimate::Estimate;
use pe_flow::explore::steps::hit;
use pe_flow::explore::sweep::Sweep;
use pe_flow::failure::Failure;
use pe_flow::watch::Listener;

/// Compiles many design points of a model and shows the trade-off between size, speed and accuracy
///
/// Every combination of the lists is compiled like `compile --reference`. The output is tables, pictures and a page
/// that shows them all. A combination that cannot be compiled is a row that says why. Ctrl-C ends the sweep and keeps
/// the points so far; `--resume` continues.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth explore models/weibel5/weibel5.spec
  pe-synth explore models/weibel5/weibel5.spec --pes 2,4,8,16 --solver rk4 --step 100us,50us
  pe-synth explore models/weibel5/weibel5.spec --max-error 1e-4 --clock 180 -o out/fine
  pe-synth explore models/weibel5/weibel5.spec --max-error 1e-4 --clock 180 -o out/fine --resume")]
pub struct Explore {
    // The first field, for each takes what it reads away from those that follow.
    #[command(flatten)]
    given: Given<Explore>,
    #[command(flatten)]
    axes: AxesArgs,
    #[command(flatten)]
    options: SweepArgs,
    /// Largest total error of points that compete in size and speed, or `any` [default: 0.01]
    #[arg(long, value_name = "E", allow_hyphen_values = true, value_parser = error_limit, help_heading = "Output")]
    max_error: Option<ErrorLimit>,
    /// Continues the sweep in the output folder: points that it holds are not compiled again
    #[arg(long, help_heading = "Sweep")]
    resume: bool,
    #[command(flatten)]
    goal: GoalArgs,
    /// What is computed.
    #[command(flatten)]
    pub model: ModelArgs,
    /// Prints errors and warnings only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
}

/// Largest total error of points that compete; none lets all.
#[derive(Clone, Copy, Debug)]
struct ErrorLimit(Option<f64>);

/// Parses a largest error, or the word for none.
fn error_limit(text: &str) -> Result<ErrorLimit, String> {
    match text {
        "any" => Ok(ErrorLimit(None)),
        _ => positive(text).map(|limit| ErrorLimit(Some(limit))).map_err(|error| format!("{error}, or `any`")),
    }
}

impl Sweeping for Explore {
    const NAME: &'static str = "explore";
}

impl Explore {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command; Ctrl-C ends the sweep.
    ///
    /// # Errors
    /// As of [`Explore::sweep`].
    pub fn run(&self) -> Result<(), Failure> {
        self.sweep(&progress::listener(true, self.message_format()), Events::until_interrupted()?)
    }

    /// Computes the points and writes the folder. Warnings of the spec go to the listener.
    ///
    /// # Errors
    /// Those of the spec, the options and the folder; an interruption; and if no point could be compiled or is as wanted.
    pub fn sweep(&self, told: &dyn Listener, events: Events) -> Result<(), Failure> {
        let quiet = self.quiet || self.message_format() == MessageFormat::Json;
        let mut settings = self.model.settings(&self.options.mapping);
        settings.mapping.of_many()?;
        let loaded = self.model.read(told)?;
        let model = &loaded.model;
        let given = self.given.with_order(model, &mut settings.mapping);
        let folder = || PathBuf::from("out").join(format!("{}_explore", model.name));
        let target = self.options.output.clone().unwrap_or_else(folder);
        OutputFolder::permitted(&target)?;
        let axes = self.axes.axes();
        hit(&axes.step, axes.sample)?;
        let Completed { axes, graphs, stiffness } = axes.complete(model);
        let clock = self.options.clock.source();
        let limit = self.max_error.map_or(Some(USUAL_ERROR), |limit| limit.0);
        let given_goals = self.goal.goals(self.max_error.and_then(|limit| limit.0), self.options.clock);
        let points = axes.formed(model, &settings.mapping).into_iter();
        // The parts of a sweep are computed side by side.
        let lock = self.options.shard.is_none().then(|| FolderLock::take(&target)).transpose()?;
        let mut record = Record {
            head: self.head(model, &axes),
            title: format!("{} ({})", model.name, model.size()),
            max_error: limit,
            goals: Goals { max_error: limit, ..given_goals.unwrap_or_default() },
            clock: clock.words(),
            rows: points.map(|point| (point, given.command(&point), None)).collect(),
            target,
            kind: Kind { store: "points.json", files: Sheet::files },
            searches: false,
            kept: BTreeMap::new(),
            late: false,
            store: None,
            damaged: BTreeSet::new(),
            lost: 0,
            share: self.options.shard,
            lock,
        };
        if self.resume {
            record.resume()?;
        }
        let threads = Driver::threads(self.options.jobs);
        let estimate =
            Estimate::of(model, &graphs, &settings.mapping).among(record.rows.iter().map(|(point, ..)| point));
        let driver = Driver::new(Self::NAME, threads, &self.options, events)?;
        let within = shown(record.max_error);
        let sources = loaded.sources.clone();
        let sweep =
            Sweep { loaded, settings, conserved: Vec::new(), within, early: true, until: None, clock, estimate };
        record.ask(self.options.store.as_deref(), &sweep);
        if !quiet {
            let seconds = driver.forecast(&record, &sweep).remaining();
            console::err(&announcement(&axes, &record, seconds, threads));
            let ratio = stiffness.into_iter();
            ratio.for_each(|ratio| {
                console::err(&format!(
                    "   solvers  all that apply: accuracy would allow steps {ratio:.0} times those that RK4 can take\n"
                ))
            });
        }
        driver.round(&mut record, sweep, quiet)?;
        if tell_of_store(&record, self.options.store.as_deref(), quiet) {
            return Ok(());
        }
        let sheet = record.sheet();
        if !quiet {
            let page = record.target.join("index.html");
            console::out(&format!("{}  see {}\n", show::summary(&sheet), page.display()))?;
        }
        verdict(&sheet)?;
        // Of an error alone the fronts say what there is.
        if given_goals.is_some_and(|goals| goals.concern_others()) && sheet.goals.ranked(&sheet.rows).is_empty() {
            let (why, nearest) = sheet.goals.refusal(&sheet.rows, show::described);
            return Err(Failure::out_of_reach(why, nearest, &sources));
        }
        Ok(())
    }

    /// What was asked for, as `points.json` says it.
    fn head(&self, model: &Model, axes: &Axes) -> Map<String, Value> {
        let words = axes.multiplier.iter().map(ToString::to_string);
        let head = json!({
            "generator": GENERATOR,
            "model": model.name,
            "odes": model.odes(),
            "model_sha256": fingerprint(model),
            "span_s": model.span,
            "command": self.given.command,
            "shared_options": self.given.shared.join(" "),
            "axes": {
                "pes": axes.pes,
                "solver": axes.solver.iter().map(|solver| solver.name()).collect::<Vec<_>>(),
                "step_s": axes.step,
                "multiplier": words.collect::<Vec<_>>(),
                "storage_bits": axes.storage,
            },
        });
        let Value::Object(head) = head else { unreachable!("written as an object") };
        head
    }
}

/// Number of points, axis by axis, and roughly how long they take.
fn announcement(axes: &Axes, record: &Record, seconds: f64, threads: usize) -> String {
    let axis = |count: usize, name: &str| format!("{count} {name}{}", if count == 1 { "" } else { "s" });
    let sizes = [
        axis(axes.step.len(), "step"),
        axis(axes.solver.len(), "solver"),
        axis(axes.multiplier.len(), "multiplier"),
        axis(axes.storage.len(), "word length"),
        axis(axes.pes.len(), "PE count"),
    ];
    let done = record.done();
    let kept = if done > 0 { format!(", {done} done before") } else { String::new() };
    let time = progress::duration(seconds);
    format!(
        "   explore  {}: {} points = {}{kept}; about {time} on {}\n",
        record.title,
        record.rows.len(),
        sizes.join(" x "),
        axis(threads, "thread")
    )
}
