//! The common part of all sweeps: threads, progress, termination.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use pe_ir::model::Model;
use pe_map::sha256;

use super::cluster::Cluster;
use super::record::{Ended, Record};
use super::sheet::Sheet;
use crate::console;
use crate::options::SweepArgs;
use pe_flow::explore::estimate::{Forecast, Work};
use pe_flow::explore::family;
use pe_flow::explore::row::Outcome;
use pe_flow::explore::sweep::{self, Event, Sweep};
use pe_flow::failure::Failure;
use pe_judge::times::processor_seconds;

/// First part of `generator` in all our files, and the version.
pub const GENERATOR: &str = concat!("pe-synth ", env!("CARGO_PKG_VERSION"));

/// Fineness of the progress bar.
const TICKS: f64 = 1000.0;

/// Parts of a sweep after which is told what is left, where no bar shows it.
const TOLD: [f64; 4] = [0.1, 0.25, 0.5, 0.75];

/// Seconds of processor time before which the load of the machine does not show.
const SETTLING: f64 = 0.2;

/// Seconds of a sweep of which that is told, at least.
const LONG: f64 = 10.0;

/// The threads of a sweep, which may have several rounds.
pub struct Driver {
    /// The command, for the progress bar.
    name: &'static str,
    pool: std::sync::Arc<rayon::ThreadPool>,
    sender: Sender<Event>,
    events: Receiver<Event>,
    threads: usize,
    /// When no more work is begun.
    until: Option<Instant>,
    /// Where points are computed, if not here.
    cluster: Option<Cluster>,
}

impl Driver {
    /// Threads of a command. From here on Ctrl-C ends sweeps, not the process.
    ///
    /// # Errors
    /// If threads cannot be started or signals not be watched.
    pub fn new(name: &'static str, threads: usize, options: &SweepArgs) -> Result<Driver, Failure> {
        let (sender, events) = channel();
        watch_signals(sender.clone())?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| Failure::File(format!("cannot start {threads} threads: {error}")))?;
        let until = options.within.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        Ok(Driver { name, pool: pool.into(), sender, events, threads, until, cluster: options.cluster() })
    }

    /// Number of threads that were asked for, or of cores.
    pub fn threads(jobs: Option<u16>) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        jobs.map_or_else(cores, usize::from)
    }

    /// The time that is left of points that are not done yet.
    pub fn forecast(&self, record: &Record, sweep: &Sweep) -> Forecast {
        let families = family::families(record.pending(), family::has_functions(&sweep.loaded.model));
        Forecast::new(sweep.estimate.planned(&families), self.threads)
    }

    /// Compiles the points that the record lacks, in threads of their own, so that the command can end without them.
    ///
    /// # Errors
    /// As of [`Record::follow`].
    pub fn round(&self, record: &mut Record, sweep: Sweep, quiet: bool) -> Result<Ended, Failure> {
        if let Some(cluster) = &self.cluster {
            return cluster.round(&self.events, record, &sweep, quiet);
        }
        let jobs = record.pending();
        let sweep = Sweep { until: self.until, ..sweep };
        let mut teller = Teller::new(self.name, self.forecast(record, &sweep), self.threads, quiet);
        let (pool, sender) = (std::sync::Arc::clone(&self.pool), self.sender.clone());
        std::thread::spawn(move || {
            sweep::run(&sweep, jobs, &pool, &sender);
            let _ = sender.send(Event::Finished);
        });
        let followed = record.follow(&self.events, self.until, &mut |done, total, work| teller.hear(done, total, work));
        teller.bar.finish_and_clear();
        followed
    }
}

/// Tells how far a sweep is: a bar where there is a terminal, else a line now and then.
struct Teller {
    name: &'static str,
    bar: ProgressBar,
    forecast: Forecast,
    begun: Instant,
    /// Processor time of the process at the beginning.
    used: Option<f64>,
    threads: f64,
    /// Which of the lines are still to come.
    lines: std::slice::Iter<'static, f64>,
}

impl Teller {
    fn new(name: &'static str, forecast: Forecast, threads: usize, quiet: bool) -> Teller {
        let style = ProgressStyle::with_template("{prefix:>10}  {bar:40} {msg}").expect("a valid template");
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(TICKS as u64) };
        let bar = bar.with_style(style).with_prefix(name);
        let lines = if quiet || !bar.is_hidden() { [].iter() } else { TOLD.iter() };
        let (begun, used) = (Instant::now(), processor_seconds());
        Teller { name, bar, forecast, begun, used, threads: threads as f64, lines }
    }

    fn hear(&mut self, done: usize, total: usize, work: Option<&Work>) {
        work.into_iter().for_each(|work| self.forecast.include(work));
        let elapsed = self.begun.elapsed().as_secs_f64();
        // As busy as the machine was so far, others included.
        let used = processor_seconds().zip(self.used).map(|(now, begun)| now - begun);
        let load = used.map_or(1.0, |used| (self.threads * elapsed + SETTLING) / (used + SETTLING)).max(1.0);
        let left = load * self.forecast.remaining();
        let part = elapsed / (elapsed + left).max(f64::MIN_POSITIVE);
        self.bar.set_position((part * TICKS) as u64);
        self.bar.set_message(format!("{done}/{total} points, {} left", duration(left)));
        let reached = self.lines.as_slice().iter().take_while(|line| part >= **line).count();
        if reached > 0 && elapsed + left >= LONG {
            self.lines.nth(reached - 1);
            let name = self.name;
            let (elapsed, left) = (duration(elapsed), duration(left));
            console::err(&format!("{name:>10}  {done} of {total} points after {elapsed}; about {left} to go\n"));
        }
    }
}

/// Seconds as a person reads them.
pub fn duration(seconds: f64) -> String {
    match seconds {
        ..9.95 => format!("{seconds:.1} s"),
        ..119.5 => format!("{seconds:.0} s"),
        ..5970.0 => format!("{:.1} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

/// What is said of a store: damaged files, and the end of a part.
/// Whether this was a part.
pub fn tell_of_store(record: &Record, store: Option<&Path>, quiet: bool) -> bool {
    if !record.damaged.is_empty() {
        let count = record.damaged.len();
        let noun = if count == 1 { "point" } else { "points" };
        console::err(&format!("     store  {count} {noun} had a damaged file and were computed again\n"));
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

/// Lets Ctrl-C and requests to terminate end the sweep with a partial result.
fn watch_signals(sender: Sender<Event>) -> Result<(), Failure> {
    ctrlc::set_handler(move || {
        let _ = sender.send(Event::Interrupted);
    })
    .map_err(|error| Failure::Internal(format!("cannot watch for signals: {error}")))
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
