//! The common part of all sweeps: threads, progress, termination.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use pe_ir::model::Model;
use pe_map::sha256;

use super::cluster::Cluster;
use super::record::{Ended, Record};
use super::sheet::Sheet;
use crate::console;
use crate::options::SweepArgs;
use crate::progress::Teller;
use pe_flow::explore::estimate::{Forecast, Work};
use pe_flow::explore::family;
use pe_flow::explore::row::Outcome;
use pe_flow::explore::sweep::{self, Event, Sweep};
use pe_flow::failure::Failure;
use pe_judge::times::processor_seconds;

/// First part of `generator` in all our files, and the version.
pub const GENERATOR: &str = concat!("pe-synth ", env!("CARGO_PKG_VERSION"));

/// Seconds of processor time before which the load of the machine does not show.
const SETTLING: f64 = 0.2;

/// What a sweep tells, and whoever wants it to end.
pub struct Events {
    sender: Sender<Event>,
    receiver: Receiver<Event>,
}

impl Events {
    /// With whom sends [`Event::Interrupted`] to end the sweep.
    pub fn new() -> (Events, Sender<Event>) {
        let (sender, receiver) = channel();
        (Events { sender: sender.clone(), receiver }, sender)
    }

    /// From here on Ctrl-C and requests to terminate end sweeps with a partial result, not the process.
    ///
    /// # Errors
    /// If signals cannot be watched.
    pub fn until_interrupted() -> Result<Events, Failure> {
        let (events, sender) = Events::new();
        let interrupt = move || drop(sender.send(Event::Interrupted));
        let watched = ctrlc::set_handler(interrupt);
        watched.map_err(|error| Failure::Internal(format!("cannot watch for signals: {error}")))?;
        Ok(events)
    }
}

/// The threads of a sweep, which may have several rounds.
pub struct Driver {
    /// The command, for the progress bar.
    name: &'static str,
    pool: std::sync::Arc<rayon::ThreadPool>,
    events: Events,
    threads: usize,
    /// When no more work is begun.
    until: Option<Instant>,
    /// Where points are computed, if not here.
    cluster: Option<Cluster>,
}

impl Driver {
    /// Threads of a command.
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn new(name: &'static str, threads: usize, options: &SweepArgs, events: Events) -> Result<Driver, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| Failure::File(format!("cannot start {threads} threads: {error}")))?;
        let until = options.within.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        Ok(Driver { name, pool: pool.into(), events, threads, until, cluster: options.cluster() })
    }

    /// Number of threads that were asked for, or of cores.
    pub fn threads(jobs: Option<u16>) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        jobs.map_or_else(cores, usize::from)
    }

    /// The time that is left of points that are not done yet.
    pub fn forecast(&self, record: &Record, sweep: &Sweep) -> Forecast {
        let families = family::families(record.pending(), &sweep.loaded.model);
        Forecast::new(sweep.estimate.planned(&families), self.threads)
    }

    /// Compiles the points that the record lacks, in threads of their own, so that the command can end without them.
    ///
    /// # Errors
    /// As of [`Record::follow`].
    pub fn round(&self, record: &mut Record, sweep: Sweep, quiet: bool) -> Result<Ended, Failure> {
        if let Some(cluster) = &self.cluster {
            return cluster.round(&self.events.receiver, record, &sweep, quiet);
        }
        let jobs = record.pending();
        let sweep = Sweep { until: self.until, ..sweep };
        let mut left = Left::new(self.name, self.forecast(record, &sweep), self.threads, quiet);
        let (pool, sender) = (std::sync::Arc::clone(&self.pool), self.events.sender.clone());
        std::thread::spawn(move || {
            sweep::run(&sweep, jobs, &pool, &sender);
            let _ = sender.send(Event::Finished);
        });
        let mut hear = |done: usize, total: usize, work: Option<&Work>| left.hear(done, total, work);
        let followed = record.follow(&self.events.receiver, self.until, &mut hear);
        left.teller.finish();
        followed
    }
}

/// Tells how far a sweep is.
struct Left {
    teller: Teller,
    forecast: Forecast,
    /// Processor time of the process at the beginning.
    used: Option<f64>,
    threads: f64,
}

impl Left {
    fn new(name: &'static str, forecast: Forecast, threads: usize, quiet: bool) -> Left {
        Left { teller: Teller::new(name, quiet), forecast, used: processor_seconds(), threads: threads as f64 }
    }

    fn hear(&mut self, done: usize, total: usize, work: Option<&Work>) {
        work.into_iter().for_each(|work| self.forecast.include(work));
        // As busy as the machine was so far, others included.
        let used = processor_seconds().zip(self.used).map(|(now, begun)| now - begun);
        let elapsed = self.teller.elapsed();
        let load = used.map_or(1.0, |used| (self.threads * elapsed + SETTLING) / (used + SETTLING)).max(1.0);
        let left = load * self.forecast.remaining();
        self.teller.hear(&format!("{done}/{total} points"), &format!("{done} of {total} points"), left);
    }
}

/// What is said of stored points: damaged ones, and the end of a part.
/// Whether this was a part.
pub fn tell_of_store(record: &Record, store: Option<&Path>, quiet: bool) -> bool {
    let count = record.damaged.len() + record.lost;
    if count > 0 {
        let (noun, were) = if count == 1 { ("point", "was") } else { ("points", "were") };
        console::err(&format!("     store  {count} {noun} {were} damaged, and {were} computed again\n"));
    }
    let (Some((part, parts)), Some(store)) = (record.share, store) else { return false };
    if !quiet {
        let rest = if record.waits() { "; other parts lack points" } else { "" };
        console::err(&format!("     shard  part {part} of {parts} is in {}{rest}\n", store.display()));
    }
    true
}

/// A hash of all that a model is, wherever it was read from.
pub fn fingerprint(model: &Model) -> String {
    sha256(format!("{model:?}").as_bytes())
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
