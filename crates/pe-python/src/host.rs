//! `pe_synth.host`: [`pe_host`] with Python's types.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use pe_host::{Limits, Settings, Transport};

create_exception!(pe_synth.host, Error, PyException, "A call failed, within the timeout.");

pub fn raised(py: Python<'_>, error: &pe_host::Error) -> PyErr {
    let raised = Error::new_err(error.to_string());
    // An exception without its kind is still that exception.
    let _ = raised.value(py).setattr("kind", error.kind());
    raised
}

#[pyclass(subclass, frozen)]
struct Written {
    #[pyo3(get)]
    clamped: Vec<String>,
    #[pyo3(get)]
    beyond_range: Vec<String>,
}

#[pyclass(extends = Written, frozen)]
struct Exchanged {
    #[pyo3(get)]
    outputs: Vec<f64>,
    #[pyo3(get)]
    overruns: u64,
}

#[pyclass(extends = Written, frozen)]
struct Frames {
    #[pyo3(get)]
    outputs: Vec<Vec<f64>>,
    #[pyo3(get)]
    overruns: u64,
}

#[pyclass(frozen)]
pub struct Snapshot(pub pe_host::Snapshot);

#[pymethods]
impl Snapshot {
    #[new]
    fn new(hash: String, sample: u64, state: Vec<i64>) -> Snapshot {
        Snapshot(pe_host::Snapshot { hash, sample, state })
    }

    #[getter]
    fn hash(&self) -> String {
        self.0.hash.clone()
    }

    #[getter]
    fn sample(&self) -> u64 {
        self.0.sample
    }

    #[getter]
    fn state(&self) -> Vec<i64> {
        self.0.state.clone()
    }
}

/// None after `close`.
#[pyclass(frozen)]
pub struct Host(Mutex<Option<pe_host::Host>>);

impl Host {
    pub fn of(host: pe_host::Host) -> Host {
        Host(Mutex::new(Some(host)))
    }

    /// Works with the host while other threads of Python run.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut pe_host::Host) -> Result<T, pe_host::Error> + Send,
    ) -> PyResult<T> {
        let result = py.detach(|| {
            let mut host = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            match &mut *host {
                Some(host) => work(host),
                None => Err(pe_host::Error::Lost("the host was closed".to_owned())),
            }
        });
        result.map_err(|error| raised(py, &error))
    }
}

/// The numbers of all frames in a row.
fn flat<T: Copy>(host: &pe_host::Host, frames: &[Vec<T>]) -> Result<Vec<T>, pe_host::Error> {
    let needed = host.inputs().len();
    match frames.iter().find(|frame| frame.len() != needed) {
        Some(frame) => Err(pe_host::Error::Count { needed, given: frame.len() }),
        None => Ok(frames.concat()),
    }
}

/// The outputs of each step.
fn rows<T: Copy>(host: &pe_host::Host, outputs: &[T]) -> Vec<Vec<T>> {
    outputs.chunks(host.map().outputs.len().max(1)).map(<[T]>::to_vec).collect()
}

fn names(host: &pe_host::Host, indices: &[usize]) -> Vec<String> {
    indices.iter().filter_map(|index| Some(host.inputs().nth(*index)?.name.clone())).collect()
}

fn tuned(host: &pe_host::Host, indices: &[usize]) -> Vec<String> {
    indices.iter().filter_map(|index| Some(host.parameters().get(*index)?.name.clone())).collect()
}

fn written(host: &pe_host::Host, written: &pe_host::Written) -> Written {
    Written { clamped: names(host, &written.clamped), beyond_range: names(host, &written.beyond_range) }
}

#[pymethods]
impl Host {
    #[getter]
    fn inputs(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |host| Ok(host.inputs().map(|input| input.name.clone()).collect()))
    }

    #[getter]
    fn outputs(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |host| Ok(host.map().outputs.iter().map(|output| output.name.clone()).collect()))
    }

    #[getter]
    fn parameters(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |host| Ok(host.parameters().iter().map(|parameter| parameter.name.clone()).collect()))
    }

    fn read_parameters(&self, py: Python<'_>) -> PyResult<Vec<f64>> {
        self.with(py, |host| Ok(host.read_parameters()))
    }

    fn write_parameters(&self, py: Python<'_>, numbers: Vec<f64>) -> PyResult<Written> {
        self.with(py, |host| {
            let what = host.write_parameters(&numbers)?;
            Ok(Written { clamped: tuned(host, &what.clamped), beyond_range: tuned(host, &what.beyond_range) })
        })
    }

    #[getter]
    fn limits(&self, py: Python<'_>) -> PyResult<Vec<(f64, f64)>> {
        self.with(py, |host| Ok(host.inputs().map(|input| input.limits.into()).collect()))
    }

    #[getter]
    fn hash(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |host| Ok(host.map().hash.clone()))
    }

    #[getter]
    fn step(&self, py: Python<'_>) -> PyResult<f64> {
        self.with(py, |host| Ok(host.map().step))
    }

    #[getter]
    fn sample(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |host| Ok(host.sample()))
    }

    #[getter]
    fn time(&self, py: Python<'_>) -> PyResult<f64> {
        self.with(py, |host| Ok(host.time()))
    }

    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, pe_host::Host::reset)
    }

    fn write(&self, py: Python<'_>, numbers: Vec<f64>) -> PyResult<Written> {
        self.with(py, |host| {
            let what = host.write(&numbers)?;
            Ok(written(host, &what))
        })
    }

    fn write_words(&self, py: Python<'_>, words: Vec<i64>) -> PyResult<()> {
        self.with(py, |host| host.write_words(&words))
    }

    #[pyo3(signature = (steps = 1))]
    fn run(&self, py: Python<'_>, steps: u64) -> PyResult<u64> {
        self.with(py, |host| Ok(host.run(steps)?.overruns))
    }

    fn read(&self, py: Python<'_>) -> PyResult<Vec<f64>> {
        self.with(py, |host| {
            let mut numbers = vec![0.0; host.map().outputs.len()];
            host.read(&mut numbers)?;
            Ok(numbers)
        })
    }

    fn read_defined(&self, py: Python<'_>) -> PyResult<Vec<Option<f64>>> {
        self.with(py, pe_host::Host::read_defined)
    }

    fn read_words(&self, py: Python<'_>) -> PyResult<Vec<Option<i64>>> {
        self.with(py, pe_host::Host::read_words)
    }

    #[pyo3(signature = (numbers, steps = 1))]
    fn exchange(&self, py: Python<'_>, numbers: Vec<f64>, steps: u64) -> PyResult<Py<Exchanged>> {
        let (base, exchanged) = self.with(py, |host| {
            let mut outputs = vec![0.0; host.map().outputs.len()];
            let exchanged = host.exchange(&numbers, steps, &mut outputs)?;
            Ok((written(host, &exchanged.written), Exchanged { outputs, overruns: exchanged.ran.overruns }))
        })?;
        Py::new(py, PyClassInitializer::from(base).add_subclass(exchanged))
    }

    #[pyo3(signature = (words, steps = 1))]
    fn exchange_words(&self, py: Python<'_>, words: Vec<i64>, steps: u64) -> PyResult<Vec<Option<i64>>> {
        self.with(py, |host| Ok(host.exchange_words(&words, steps)?.to_vec()))
    }

    fn run_frames(&self, py: Python<'_>, frames: Vec<Vec<f64>>) -> PyResult<Py<Frames>> {
        let (base, shown) = self.with(py, |host| {
            let inputs = flat(host, &frames)?;
            let mut outputs = Vec::new();
            let exchanged = host.run_frames(frames.len(), &inputs, &mut outputs)?;
            let outputs = rows(host, &outputs);
            Ok((written(host, &exchanged.written), Frames { outputs, overruns: exchanged.ran.overruns }))
        })?;
        Py::new(py, PyClassInitializer::from(base).add_subclass(shown))
    }

    fn run_frames_words(&self, py: Python<'_>, frames: Vec<Vec<i64>>) -> PyResult<Vec<Vec<i64>>> {
        self.with(py, |host| {
            let inputs = flat(host, &frames)?;
            let mut outputs = Vec::new();
            host.run_frames_words(frames.len(), &inputs, &mut outputs)?;
            Ok(rows(host, &outputs))
        })
    }

    fn snapshot(&self, py: Python<'_>) -> PyResult<Snapshot> {
        self.with(py, |host| Ok(Snapshot(host.snapshot()?)))
    }

    fn restore(&self, py: Python<'_>, snapshot: &Snapshot) -> PyResult<()> {
        self.with(py, |host| host.restore(&snapshot.0))
    }

    fn flags(&self, py: Python<'_>) -> PyResult<Vec<&'static str>> {
        self.with(py, |host| Ok(host.flags()?.names().collect()))
    }

    fn clear_flags(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, pe_host::Host::clear_flags)
    }

    #[pyo3(signature = (clock_budget = 0, pace_period = 0, go_on = false))]
    fn limit(&self, py: Python<'_>, clock_budget: u32, pace_period: u32, go_on: bool) -> PyResult<()> {
        self.with(py, |host| host.limit(&Limits { clock_budget, pace_period, go_on }))
    }

    fn counters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let counters = self.with(py, pe_host::Host::counters)?;
        let all = PyDict::new(py);
        all.set_item("clocks", counters.clocks)?;
        all.set_item("longest", counters.longest)?;
        all.set_item("shortest", counters.shortest)?;
        all.set_item("least_slack", counters.least_slack)?;
        all.set_item("overruns", counters.overruns)?;
        Ok(all)
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.0.lock().unwrap_or_else(PoisonError::into_inner).take()));
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __exit__(&self, py: Python<'_>, _kind: Py<PyAny>, _error: Py<PyAny>, _traceback: Py<PyAny>) {
        self.close(py);
    }
}

#[pyfunction]
#[pyo3(name = "open_host", signature = (folder, transport = "model", timeout = None, library = None))]
fn open(
    py: Python<'_>,
    folder: PathBuf,
    transport: &str,
    timeout: Option<f64>,
    library: Option<PathBuf>,
) -> PyResult<Host> {
    let wait = |seconds: f64| {
        Duration::try_from_secs_f64(seconds)
            .map_err(|_| PyValueError::new_err(format!("{seconds} s is no time to wait")))
    };
    let timeout = timeout.map(wait).transpose()?;
    let settings = Settings { timeout, library };
    let opened = py.detach(|| {
        let transport: Transport = transport.parse()?;
        pe_host::Host::open(&folder, &transport, &settings)
    });
    let host = opened.map_err(|error| raised(py, &error))?;
    Ok(Host::of(host))
}

/// Adds all of it to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let transports = PyDict::new(module.py());
    for (form, meaning) in Transport::FORMS {
        transports.set_item(form, meaning)?;
    }
    module.add("TRANSPORTS", transports)?;
    module.add("HostError", module.py().get_type::<Error>())?;
    module.add_class::<Written>()?;
    module.add_class::<Exchanged>()?;
    module.add_class::<Frames>()?;
    module.add_class::<Snapshot>()?;
    module.add_class::<Host>()?;
    module.add_function(wrap_pyfunction!(open, module)?)
}
