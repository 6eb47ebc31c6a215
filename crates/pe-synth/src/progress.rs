//! Progress of compiler stages and long runs on standard error.

use std::cell::RefCell;
use std::sync::Arc;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use pe_flow::watch::{Listener, Stopwatch};
use pe_ir::source::{Diagnostic, Sources};
use pe_judge::progress::{Progress, silent};

use crate::console;
use crate::messages::{MessageFormat, print_findings};

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
    Stopwatch::new(Console { quiet, format, spinner: RefCell::new(None) })
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
