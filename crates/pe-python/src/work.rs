//! Long work beside the interpreter: in a thread of its own, without the lock of Python, and until Ctrl-C.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle, ThreadId, current};
use std::time::Duration;

use pe_flow::failure::Failure;
use pe_flow::watch::Listener;
use pe_ir::source::{Diagnostic, Sources};
use pe_judge::progress::Progress;
use pe_synth::render;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use serde_json::{Value, json};

/// Time between two looks for signals.
const LOOK: Duration = Duration::from_millis(50);

/// Bytes of the stack of a worker, as the main thread of the program has.
const STACK: usize = 8 << 20;

/// What unwinds a worker that nobody waits for any more.
struct Abandoned;

/// Hears of warnings, and ends work that was abandoned: wherever it tells how far it is.
#[derive(Clone)]
pub struct Ear {
    told: Arc<Mutex<Vec<Value>>>,
    abandoned: Arc<AtomicBool>,
    /// The thread that may be unwound; others are waited for by it.
    worker: ThreadId,
}

impl Ear {
    fn look(&self) {
        if self.abandoned.load(Ordering::Relaxed) && current().id() == self.worker {
            resume_unwind(Box::new(Abandoned));
        }
    }
}

impl Progress for Ear {
    fn set_length(&self, _: u64) {
        self.look();
    }
    fn add_length(&self, _: u64) {
        self.look();
    }
    fn advance(&self, _: u64) {
        self.look();
    }
    fn set_position(&self, _: u64) {
        self.look();
    }
}

impl Listener for Ear {
    fn progress(&self, _: &'static str) -> Arc<dyn Progress> {
        Arc::new(self.clone())
    }
    fn begin(&self, _: &'static str) {
        self.look();
    }
    fn say(&self, _: String) {
        self.look();
    }
    fn end(&self) {
        self.look();
    }
    fn done(&self, _: &'static str, _: &str, _: f64) {
        self.look();
    }
    fn warn(&self, findings: &[Diagnostic], sources: &Sources) {
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        told.extend(findings.iter().map(|finding| told_of(finding, sources)));
    }
}

/// A finding with its text for people.
pub fn told_of(finding: &Diagnostic, sources: &Sources) -> Value {
    let mut told = render::for_tools(finding, sources);
    told["text"] = json!(render::plain(finding, sources));
    told
}

/// What Ctrl-C does to work.
pub enum OnInterrupt {
    /// It is left, and ends by itself soon.
    Leave,
    /// It is told, and waited for: it has something to put in order.
    Tell(Box<dyn Fn() + Send>),
}

/// Does work in a thread of its own while Python goes on. Warnings become those of Python when it is done.
///
/// # Errors
/// The failure as an exception of the package, a signal as the exception that its handler raises.
pub fn done<T: Send + 'static>(
    py: Python<'_>,
    on_interrupt: OnInterrupt,
    work: impl FnOnce(&Ear) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let (told, abandoned) = (Arc::<Mutex<Vec<Value>>>::default(), Arc::<AtomicBool>::default());
    let (sender, receiver) = channel::<()>();
    let (own_told, own_abandoned) = (Arc::clone(&told), Arc::clone(&abandoned));
    let worker = Builder::new().name("pe-synth".to_owned()).stack_size(STACK).spawn(move || {
        // Dropped at the end, whatever that is.
        let _sender = sender;
        work(&Ear { told: own_told, abandoned: own_abandoned, worker: current().id() })
    });
    let worker = worker.map_err(|error| PyRuntimeError::new_err(format!("cannot start a thread: {error}")))?;
    if let Err(signal) = wait(py, receiver) {
        match on_interrupt {
            OnInterrupt::Leave => abandoned.store(true, Ordering::Relaxed),
            OnInterrupt::Tell(tell) => {
                tell();
                let _ = py.detach(|| worker.join());
            }
        }
        return Err(signal);
    }
    let result = py.detach(|| joined(worker));
    let told = std::mem::take(&mut *told.lock().unwrap_or_else(PoisonError::into_inner));
    let errors = py.import("pe_synth.errors")?;
    if !told.is_empty() {
        errors.call_method1("_warn", (json!(told).to_string(),))?;
    }
    result.map_err(|failure| match raised(&errors, &failure) {
        Ok(raised) => raised,
        Err(error) => error,
    })
}

/// Waits for the end of a worker, or a signal.
fn wait(py: Python<'_>, ended: Receiver<()>) -> PyResult<()> {
    let ended = Mutex::new(ended);
    loop {
        let event = py.detach(|| ended.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LOOK));
        if event == Err(RecvTimeoutError::Disconnected) {
            return Ok(());
        }
        py.check_signals()?;
    }
}

/// What a worker has made; a panic is a bug and becomes an internal error.
fn joined<T>(worker: JoinHandle<Result<T, Failure>>) -> Result<T, Failure> {
    worker.join().unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        Err(Failure::Internal(text.unwrap_or_else(|| "a panic".to_owned())))
    })
}

/// The exception for a failure.
fn raised(errors: &Bound<'_, PyModule>, failure: &Failure) -> PyResult<PyErr> {
    let findings = match failure {
        Failure::Spec(findings, sources) => findings.iter().map(|finding| told_of(finding, sources)).collect(),
        _ => Vec::new(),
    };
    let text = failure.text().unwrap_or_default();
    let findings = Value::Array(findings).to_string();
    Ok(PyErr::from_value(errors.call_method1("_raised", (failure.kind(), text, findings))?))
}

/// The exception for a failure outside of a worker.
pub fn failed(py: Python<'_>, failure: &Failure) -> PyErr {
    py.import("pe_synth.errors").and_then(|errors| raised(&errors, failure)).unwrap_or_else(|error| error)
}
