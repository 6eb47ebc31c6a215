//! The common part of all sweeps: threads, progress, termination.

use std::sync::mpsc::{Receiver, Sender, channel};

use indicatif::{ProgressBar, ProgressStyle};
use pe_ir::model::Model;
use pe_map::sha256;

use super::record::Record;
use super::sheet::Sheet;
use pe_flow::explore::family;
use pe_flow::explore::row::Outcome;
use pe_flow::explore::sweep::{self, Event, Sweep};
use pe_flow::failure::Failure;

/// First part of `generator` in all our files, and the version.
pub const GENERATOR: &str = concat!("pe-synth ", env!("CARGO_PKG_VERSION"));

/// Fineness of the progress bar.
const TICKS_PER_SECOND: f64 = 1000.0;

/// The threads of a sweep, which may have several rounds.
pub struct Driver {
    /// The command, for the progress bar.
    name: &'static str,
    pool: std::sync::Arc<rayon::ThreadPool>,
    sender: Sender<Event>,
    events: Receiver<Event>,
}

impl Driver {
    /// Threads of a command. From here on Ctrl-C ends sweeps, not the process.
    ///
    /// # Errors
    /// If threads cannot be started or signals not be watched.
    pub fn new(name: &'static str, threads: usize) -> Result<Driver, Failure> {
        let (sender, events) = channel();
        watch_signals(sender.clone())?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| Failure::File(format!("cannot start {threads} threads: {error}")))?;
        Ok(Driver { name, pool: pool.into(), sender, events })
    }

    /// Number of threads that were asked for, or of cores.
    pub fn threads(jobs: Option<u16>) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        jobs.map_or_else(cores, usize::from)
    }

    /// Compiles the points that the record lacks, in threads of their own, so that the command can end without them.
    ///
    /// # Errors
    /// As of [`Record::follow`].
    pub fn round(&self, record: &mut Record, sweep: Sweep, quiet: bool) -> Result<(), Failure> {
        let jobs = record.pending();
        let seconds = sweep.estimate.total(&family::families(jobs.clone(), family::has_functions(&sweep.loaded.model)));
        let bar = if quiet { ProgressBar::hidden() } else { progress_bar(self.name, seconds) };
        let (pool, sender) = (std::sync::Arc::clone(&self.pool), self.sender.clone());
        std::thread::spawn(move || {
            sweep::run(&sweep, jobs, &pool, &sender);
            let _ = sender.send(Event::Finished);
        });
        let followed = record.follow(&self.events, &mut |done, total, seconds| {
            bar.set_message(format!("{done}/{total} points"));
            bar.inc((seconds * TICKS_PER_SECOND) as u64);
        });
        bar.finish_and_clear();
        followed
    }
}

/// A hash of all that a model is, wherever it was read from.
pub fn fingerprint(model: &Model) -> String {
    sha256(format!("{model:?}").as_bytes())
}

/// Lets Ctrl-C and requests to terminate end the sweep with a partial result.
fn watch_signals(sender: Sender<Event>) -> Result<(), Failure> {
    ctrlc::set_handler(move || {
        let _ = sender.send(Event::Interrupted);
    })
    .map_err(|error| Failure::Internal(format!("cannot watch for signals: {error}")))
}

/// A bar for all the work; invisible when standard error is no terminal.
fn progress_bar(name: &'static str, seconds: f64) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix:>10}  {bar:40} {msg}, {eta} left").expect("a valid template");
    ProgressBar::new((seconds * TICKS_PER_SECOND) as u64).with_style(style).with_prefix(name)
}

/// A sweep fails if no point succeeded, or if one met an error of the compiler itself.
pub fn verdict(sheet: &Sheet) -> Result<(), Failure> {
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
