//! Progress of compiler stages and long runs on standard error.

use std::cell::RefCell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use pe_flow::watch::{Listener, Stopwatch};
use pe_ir::source::{Diagnostic, Sources};
use pe_judge::progress::{Progress, silent};

use crate::console;
use crate::messages::{MessageFormat, print_findings};

/// Fineness of the bar of a [`Teller`].
const TICKS: f64 = 1000.0;

/// Parts of a command after which is told what is left, where no bar shows it.
const TOLD: [f64; 4] = [0.1, 0.25, 0.5, 0.75];

/// Seconds of a command of which that is told, at least.
const LONG: f64 = 10.0;

/// Time between two pictures of the spinner of a stage.
const SPINNER_TICK: Duration = Duration::from_millis(200);

/// A bar; invisible when standard error is no terminal.
struct Bar(ProgressBar);

impl Progress for Bar {
    fn set_length(&self, work: u64) {
        self.0.set_length(work);
    }
    fn add_length(&self, work: u64) {
        self.0.inc_length(work);
    }
    fn advance(&self, work: u64) {
        self.0.inc(work);
    }
    fn set_position(&self, work: u64) {
        self.0.set_position(work);
    }
}

/// Tells of stages and warnings.
struct Console {
    quiet: bool,
    format: MessageFormat,
    spinner: RefCell<Option<ProgressBar>>,
}

/// A stopwatch whose warnings are printed, and whose stages are unless `quiet`.
pub fn stopwatch(quiet: bool, format: MessageFormat) -> Stopwatch {
    Stopwatch::new(listener(quiet, format))
}

/// Who prints warnings, and stages unless `quiet`.
pub fn listener(quiet: bool, format: MessageFormat) -> impl Listener {
    Console { quiet, format, spinner: RefCell::new(None) }
}

/// A bar for a long stage; invisible when quiet or when standard error is no terminal.
pub fn bar(stage: &'static str, quiet: bool) -> Arc<dyn Progress> {
    if quiet {
        return silent();
    }
    let style = ProgressStyle::with_template("{msg:>10}  {bar:40} {percent:>3} %, {eta} left");
    let bar = ProgressBar::no_length().with_style(style.expect("a valid template")).with_message(stage);
    Arc::new(Bar(bar.with_finish(ProgressFinish::AndClear)))
}

/// A bar for a campaign of damage.
pub fn damages(quiet: bool) -> Arc<dyn Progress> {
    if quiet {
        return silent();
    }
    let style = ProgressStyle::with_template("{bar:30} {pos} of {len} damages, {elapsed} [{eta} left]");
    let bar = ProgressBar::no_length().with_style(style.expect("a valid template"));
    Arc::new(Bar(bar.with_finish(ProgressFinish::AndClear)))
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

/// Tells how far a command is, and what is left: a bar where there is a terminal, else a line now and then.
pub struct Teller {
    /// The command.
    name: &'static str,
    bar: ProgressBar,
    begun: Instant,
    /// Which of the lines are still to come.
    lines: std::slice::Iter<'static, f64>,
}

impl Teller {
    /// At the beginning.
    pub fn new(name: &'static str, quiet: bool) -> Teller {
        let style = ProgressStyle::with_template("{prefix:>10}  {bar:40} {msg}").expect("a valid template");
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(TICKS as u64) };
        let bar = bar.with_style(style).with_prefix(name);
        let lines = if quiet || !bar.is_hidden() { [].iter() } else { TOLD.iter() };
        Teller { name, bar, begun: Instant::now(), lines }
    }

    /// Seconds since the beginning.
    pub fn elapsed(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Hears what is done, as it stands beside the bar and in a line, and the seconds that are left.
    pub fn hear(&mut self, beside: &str, in_line: &str, left: f64) {
        let elapsed = self.elapsed();
        let part = elapsed / (elapsed + left).max(f64::MIN_POSITIVE);
        self.bar.set_position((part * TICKS) as u64);
        self.bar.set_message(format!("{beside}, {} left", duration(left)));
        let reached = self.lines.as_slice().iter().take_while(|line| part >= **line).count();
        if reached > 0 && elapsed + left >= LONG {
            self.lines.nth(reached - 1);
            let name = self.name;
            let (elapsed, left) = (duration(elapsed), duration(left));
            console::err(&format!("{name:>10}  {in_line} after {elapsed}; about {left} to go\n"));
        }
    }

    /// Hears what is at work while nothing is known of what is left.
    pub fn begin(&self, beside: &str) {
        self.bar.set_message(beside.to_owned());
    }

    /// Prints without a bar in between.
    pub fn suspend<T>(&self, print: impl FnOnce() -> T) -> T {
        self.bar.suspend(print)
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Listener for Console {
    fn progress(&self, stage: &'static str) -> Arc<dyn Progress> {
        bar(stage, self.quiet)
    }

    fn begin(&self, stage: &'static str) {
        let spinner = if self.quiet { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        if spinner.is_hidden() {
            return;
        }
        let style = ProgressStyle::with_template("{prefix:>10}  {spinner} {elapsed}  {msg}").expect("a valid template");
        let spinner = spinner.with_style(style).with_prefix(stage);
        spinner.enable_steady_tick(SPINNER_TICK);
        self.spinner.replace(Some(spinner));
    }

    fn say(&self, text: String) {
        if let Some(spinner) = &*self.spinner.borrow() {
            spinner.set_message(text);
        }
    }

    fn end(&self) {
        if let Some(spinner) = self.spinner.take() {
            spinner.finish_and_clear();
        }
    }

    fn done(&self, stage: &'static str, figure: &str, seconds: f64) {
        if !self.quiet {
            console::err(&format!("{stage:>10}  {figure}  ({seconds:.2} s)\n"));
        }
    }

    fn warn(&self, findings: &[Diagnostic], sources: &Sources) {
        print_findings(findings, sources, self.format);
    }
}
