//! Work that takes longer than a key press: models are elaborated on one thread, and run on another.
//!
//! Only the last state of each model counts. Work on an earlier one is dropped if it waits and stopped if it is at
//! work. Ranges and number formats need runs, which begin once nothing has changed for a while.

use crate::files::Texts;
use crate::findings;
use crate::keys::Key;
use crate::view::View;
use gen_lsp_types::{Diagnostic as Shown, DiagnosticSeverity};
use pe_flow::failure::Failure;
use pe_flow::spec::{LoadedModel, written_out};
use pe_flow::variables::{self, Variable};
use pe_frontend::{Elaborated, Overrides, examine, sort};
use pe_ir::source::{Diagnostic, Severity};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Products of each run; about a second of work in all.
const PRODUCTS: u64 = 20_000_000;

/// How long nothing changes before a model is run.
const IDLE: Duration = Duration::from_millis(700);

/// What is known of a quantity or index.
#[derive(Clone, Debug, Default)]
pub(crate) struct Values {
    /// First and last value of each index.
    pub(crate) extents: Vec<(i64, i64)>,
    /// By element; NaN where there is none.
    pub(crate) values: Vec<f64>,
}

/// What an elaboration found.
pub(crate) struct Analysis {
    /// The model.
    pub(crate) root: Key,
    /// The state of the texts that it is about.
    pub(crate) generation: u64,
    /// Findings by file, as the editor shows them.
    pub(crate) shown: BTreeMap<Key, Vec<Shown>>,
    /// Findings as the front end has them.
    pub(crate) findings: Vec<Diagnostic>,
    /// Files that the model was read from, whether they exist or not, without the main file.
    pub(crate) asked: Vec<Key>,
    /// Quantities and indices of the whole spec by name.
    pub(crate) values: BTreeMap<String, Values>,
    /// How long it took.
    pub(crate) took: Duration,
}

/// What runs of a model found.
pub(crate) struct Ranges {
    /// The model.
    pub(crate) root: Key,
    /// The state of the texts that it is about.
    pub(crate) generation: u64,
    /// By name of the element; a text says why there are none.
    pub(crate) variables: Result<BTreeMap<String, Variable>, String>,
    /// Seconds of the span that were run, and the whole span.
    pub(crate) span: (f64, f64),
}

/// A model to work on.
#[derive(Clone)]
pub(crate) struct Job {
    pub(crate) root: Key,
    pub(crate) generation: u64,
    pub(crate) texts: Texts,
    /// Whether it is a file that belongs to no known model, of which only the syntax can be looked at.
    pub(crate) part: bool,
}

/// A model to run.
struct Run {
    root: Key,
    generation: u64,
    model: LoadedModel,
}

/// What waits, and what is at work.
struct Queue<T> {
    waiting: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T> {
    jobs: BTreeMap<Key, T>,
    running: Option<(Key, Arc<AtomicBool>)>,
}

impl<T> Queue<T> {
    fn new() -> Arc<Queue<T>> {
        let state = State { jobs: BTreeMap::new(), running: None };
        Arc::new(Queue { waiting: Mutex::new(state), changed: Condvar::new() })
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a job in the place of an earlier one of its model, which ends if it is at work.
    fn put(&self, root: Key, job: Option<T>) {
        let mut state = self.state();
        if let Some((running, stop)) = &state.running
            && *running == root
        {
            stop.store(true, Ordering::Relaxed);
        }
        match job {
            Some(job) => _ = state.jobs.insert(root, job),
            None => _ = state.jobs.remove(&root),
        }
        self.changed.notify_one();
    }

    /// Waits for a job that nothing has replaced for a while.
    fn take(&self, idle: Duration) -> (T, Arc<AtomicBool>) {
        let mut state = self.state();
        state.running = None;
        loop {
            if state.jobs.is_empty() {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            }
            if !idle.is_zero() {
                let (next, waited) = self.changed.wait_timeout(state, idle).unwrap_or_else(PoisonError::into_inner);
                state = next;
                if !waited.timed_out() {
                    continue;
                }
            }
            if let Some((root, job)) = state.jobs.pop_first() {
                let stop = Arc::new(AtomicBool::new(false));
                state.running = Some((root, Arc::clone(&stop)));
                return (job, stop);
            }
        }
    }
}

/// The threads that elaborate and run models. They end with the process.
pub(crate) struct Worker {
    analyses: Arc<Queue<Job>>,
    runs: Arc<Queue<Run>>,
}

impl Worker {
    /// Starts the threads; `analysed` and `ran` take the results.
    pub(crate) fn new(analysed: impl Fn(Analysis) + Send + 'static, ran: impl Fn(Ranges) + Send + 'static) -> Worker {
        let (analyses, runs) = (Queue::<Job>::new(), Queue::<Run>::new());
        let (queue, next) = (Arc::clone(&analyses), Arc::clone(&runs));
        thread::spawn(move || {
            loop {
                let (job, stop) = queue.take(Duration::ZERO);
                let done = catch_unwind(AssertUnwindSafe(|| analyse(&job, &stop)));
                let (analysis, model) = done.unwrap_or_else(|_| (Some(broken(&job)), None));
                if stop.load(Ordering::Relaxed) {
                    continue;
                }
                let run = model.map(|model| Run { root: job.root.clone(), generation: job.generation, model });
                next.put(job.root, run);
                analysis.into_iter().for_each(&analysed);
            }
        });
        let queue = Arc::clone(&runs);
        thread::spawn(move || {
            loop {
                let (run, _) = queue.take(IDLE);
                ran(ranges(run));
            }
        });
        Worker { analyses, runs }
    }

    /// Elaborates a model in its present state.
    pub(crate) fn analyse(&self, job: Job) {
        self.runs.put(job.root.clone(), None);
        self.analyses.put(job.root.clone(), Some(job));
    }

    /// Forgets what waits of a model.
    pub(crate) fn forget(&self, root: &Key) {
        self.runs.put(root.clone(), None);
        self.analyses.put(root.clone(), None);
    }
}

/// Findings and values of a model, and the model itself if it has no errors; `None` if its main file is gone.
fn analyse(job: &Job, stop: &Arc<AtomicBool>) -> (Option<Analysis>, Option<LoadedModel>) {
    let begun = Instant::now();
    let Some(view) = View::read(&job.root, &job.texts) else {
        let analysis = Analysis { asked: Vec::new(), ..empty(job) };
        return (Some(analysis), None);
    };
    let mut found = view.findings.clone();
    let (mut values, mut loaded) = (BTreeMap::new(), None);
    if !job.part {
        let Elaborated { model, findings, known } = examine(&view.spec, &Overrides::default(), stop);
        found.extend(findings);
        sort(&mut found);
        for known in known {
            values.insert(known.name, Values { extents: known.extents, values: known.values });
        }
        let sound = found.iter().all(|finding| finding.severity == Severity::Warning);
        if let Some(model) = model.filter(|_| sound && !stop.load(Ordering::Relaxed)) {
            let (model, left_out) = written_out(model, view.sources.clone());
            found.extend(left_out);
            loaded = Some(model);
        }
    }
    let mut shown = findings::by_file(&view, &found);
    if job.part {
        let text = "no model was found that includes this file: only its syntax is checked";
        let note = findings::note(text, DiagnosticSeverity::Information);
        shown.entry(job.root.clone()).or_default().push(note);
    }
    let analysis = Analysis { shown, findings: found, asked: view.asked, values, took: begun.elapsed(), ..empty(job) };
    (Some(analysis), loaded)
}

fn empty(job: &Job) -> Analysis {
    Analysis {
        root: job.root.clone(),
        generation: job.generation,
        shown: BTreeMap::new(),
        findings: Vec::new(),
        asked: Vec::new(),
        values: BTreeMap::new(),
        took: Duration::ZERO,
    }
}

/// What is told where the front end itself is wrong.
fn broken(job: &Job) -> Analysis {
    let text = "internal error: this spec cannot be checked; please report it";
    let note = findings::note(text, DiagnosticSeverity::Error);
    Analysis { shown: BTreeMap::from([(job.root.clone(), vec![note])]), ..empty(job) }
}

/// Runs a model over the beginning of its span.
fn ranges(Run { root, generation, model }: Run) -> Ranges {
    let done = catch_unwind(AssertUnwindSafe(|| variables::over_beginning(&model, PRODUCTS)));
    let (variables, seconds) = match done {
        Ok(Ok((variables, seconds))) => {
            let by_name = variables.into_iter().map(|variable| (variable.name.clone(), variable));
            (Ok(by_name.collect()), seconds)
        }
        Ok(Err(failure)) => (Err(reason(&failure)), 0.0),
        Err(_) => (Err("internal error".to_owned()), 0.0),
    };
    Ranges { root, generation, variables, span: (seconds, model.model.span) }
}

/// Why a model cannot be run, in a few words.
fn reason(failure: &Failure) -> String {
    let found = failure.finding().map(|error| format!("{} ({})", error.message, error.code));
    found.unwrap_or_else(|| failure.text().unwrap_or_default().to_owned())
}
