//! `pe-synth explore`: many design points of a model, their size, speed and error.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};
use pe_ir::model::Model;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use crate::cmd_compile::positive;
use crate::console;
use crate::explore::axes::Axes;
use crate::explore::estimate::Estimate;
use crate::explore::files::Sheet;
use crate::explore::given::Given;
use crate::explore::record::Record;
use crate::explore::row::Outcome;
use crate::explore::show;
use crate::explore::sweep::{self, Event, Job, Sweep};
use crate::failure::{Failure, MessageFormat};
use crate::options::ModelOptions;
use crate::output::OutputFolder;
use crate::pipeline::MappingOptions;
use crate::report::{ASSUMED_CLOCK_MHZ, Clock};

/// First part of `generator` in all our files, and the version.
const GENERATOR: &str = concat!("pe-synth ", env!("CARGO_PKG_VERSION"));

/// Fineness of the progress bar.
const TICKS_PER_SECOND: f64 = 1000.0;

/// Compiles many design points of a model and shows what size, speed and accuracy cost each other
///
/// Every combination of the lists is compiled as `compile --reference` would, and its figures are kept: tables,
/// pictures, and a page to read. A combination that cannot be compiled is a row that says why. Ctrl-C ends the sweep
/// with the points it has; `--resume` goes on.
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
    given: Given,
    #[command(flatten)]
    axes: Axes,
    #[command(flatten)]
    mapping: MappingOptions,
    /// Output folder; replaced if it is one of ours [default: out/MODEL_explore]
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Clock for the speed [default: 150, marked as assumed]
    #[arg(long, value_name = "MHZ", value_parser = positive, help_heading = "Output")]
    clock: Option<f64>,
    /// Largest total error of points that compete in size and speed [default: any]
    #[arg(long, value_name = "E", value_parser = positive, help_heading = "Output")]
    max_error: Option<f64>,
    /// Goes on with the sweep in the output folder: points that it holds are not compiled again
    #[arg(long, help_heading = "Sweep")]
    resume: bool,
    /// Points compiled at the same time; the result does not depend on it [default: one per core]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), help_heading = "Sweep")]
    jobs: Option<u16>,
    #[command(flatten)]
    model: ModelOptions,
    /// Prints errors and warnings only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
}

impl Explore {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let quiet = self.quiet || self.message_format() == MessageFormat::Json;
        let loaded = self.model.read()?;
        let model = &loaded.model;
        let folder = || PathBuf::from("out").join(format!("{}_explore", model.name));
        let target = self.output.clone().unwrap_or_else(folder);
        OutputFolder::permitted(&target)?;
        let (axes, graphs) = self.axes.complete(model);
        let clock = Clock { mhz: self.clock.unwrap_or(ASSUMED_CLOCK_MHZ), given: self.clock.is_some() };
        let points = axes.formed(model, &self.mapping).into_iter();
        let mut record = Record {
            head: self.head(model, &axes),
            title: format!("{} ({} ODEs)", model.name, model.states.len()),
            max_error: self.max_error,
            clock: format!("{} MHz ({})", clock.mhz, if clock.given { "given" } else { "assumed" }),
            rows: points.map(|point| (point, self.given.command(&point), None)).collect(),
            target,
        };
        if self.resume {
            record.resume()?;
        }
        let jobs = record.pending();
        let threads = self.jobs.map(usize::from);
        let threads = threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
        let estimate = Estimate::of(model, &graphs, &self.mapping);
        let seconds = estimate.total(&sweep::families(jobs.clone()));
        if !quiet {
            console::err(&announcement(&axes, &record, jobs.len(), seconds, threads));
        }
        let bar = if quiet { ProgressBar::hidden() } else { progress_bar(seconds) };
        let sweep = Sweep { loaded, options: self.model.clone(), mapping: self.mapping.clone(), clock, estimate };
        let events = start(sweep, jobs, threads)?;
        let followed = record.follow(&events, &mut |done, total, seconds| {
            bar.set_message(format!("{done}/{total} points"));
            bar.inc((seconds * TICKS_PER_SECOND) as u64);
        });
        bar.finish_and_clear();
        followed?;
        let sheet = record.sheet();
        if !quiet {
            let page = record.target.join("index.html");
            console::out(&format!("{}  see {}\n", show::summary(&sheet), page.display()));
        }
        verdict(&sheet)
    }

    /// What was asked for, as `points.json` says it.
    fn head(&self, model: &Model, axes: &Axes) -> Map<String, Value> {
        let words = axes.multiplier.iter().map(|(a, b)| format!("{a}x{b}"));
        let head = json!({
            "generator": GENERATOR,
            "model": model.name,
            "odes": model.states.len(),
            "model_sha256": fingerprint(model),
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

/// A hash of all that a model is, wherever it was read from.
fn fingerprint(model: &Model) -> String {
    let digest = Sha256::digest(format!("{model:?}"));
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Starts the sweep in threads of its own, so that the command can end without them.
fn start(sweep: Sweep, jobs: Vec<Job>, threads: usize) -> Result<Receiver<Event>, Failure> {
    let (sender, events) = channel();
    watch_signals(sender.clone())?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| Failure::File(format!("cannot start {threads} threads: {error}")))?;
    std::thread::spawn(move || {
        sweep::run(&sweep, jobs, &pool, &sender);
        let _ = sender.send(Event::Finished);
    });
    Ok(events)
}

/// Lets Ctrl-C and requests to terminate end the sweep with a partial result.
fn watch_signals(sender: Sender<Event>) -> Result<(), Failure> {
    ctrlc::set_handler(move || {
        let _ = sender.send(Event::Interrupted);
    })
    .map_err(|error| Failure::Internal(format!("cannot watch for signals: {error}")))
}

/// Number of points, axis by axis, and roughly how long they take.
fn announcement(axes: &Axes, record: &Record, pending: usize, seconds: f64, threads: usize) -> String {
    let axis = |count: usize, name: &str| format!("{count} {name}{}", if count == 1 { "" } else { "s" });
    let sizes = [
        axis(axes.step.len(), "step"),
        axis(axes.solver.len(), "solver"),
        axis(axes.multiplier.len(), "multiplier"),
        axis(axes.storage.len(), "word length"),
        axis(axes.pes.len(), "PE count"),
    ];
    let done = record.rows.len() - pending;
    let kept = if done > 0 { format!(", {done} done before") } else { String::new() };
    let time = HumanDuration(Duration::from_secs_f64((seconds / threads.min(pending).max(1) as f64).max(1.0)));
    format!(
        "   explore  {}: {} points = {}{kept}; about {time} on {}\n",
        record.title,
        record.rows.len(),
        sizes.join(" x "),
        axis(threads, "thread")
    )
}

/// A bar for all the work; invisible when standard error is no terminal.
fn progress_bar(seconds: f64) -> ProgressBar {
    let style = ProgressStyle::with_template("   explore  {bar:40} {msg}, {eta} left").expect("a valid template");
    ProgressBar::new((seconds * TICKS_PER_SECOND) as u64).with_style(style)
}

/// A sweep fails if no point succeeded, or if one met an error of the compiler itself.
fn verdict(sheet: &Sheet) -> Result<(), Failure> {
    let internal = sheet.rows.iter().find_map(|row| match &row.outcome {
        Outcome::Failed(reason) if reason.exit_code == Failure::INTERNAL => Some((row, reason)),
        _ => None,
    });
    if let Some((row, reason)) = internal {
        return Err(Failure::Internal(format!("{}; met by `{}`", reason.message, row.command)));
    }
    match sheet.rows.iter().any(|row| row.figures().is_some()) {
        true => Ok(()),
        false => Err(Failure::Fruitless("no point could be compiled; the table has the reasons".into())),
    }
}
