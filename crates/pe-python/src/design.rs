//! A compiled design in memory: its files, and the network it is, in the simulator.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pe_flow::failure::Failure;
use pe_flow::watch::Stopwatch;
use pe_host::{Engine, Error, Model};
use pe_ir::program::Program;
use pe_map::{Map, Meaning};
use pe_plot::axis::Scale;
use pe_plot::chart::{AxisPlan, Chart, Figure, Series};
use pe_plot::style::Look;
use pe_synth::compiled::{Compiled, Files};
use pe_synth::output::OutputFolder;
use pe_synth::page::Shown;
use pe_synth::pictures;
use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

use crate::host::{Host, Snapshot, raised};
use crate::work::{OnInterrupt, done, failed};

/// Time between two looks for signals.
const LOOK: Duration = Duration::from_millis(50);

/// Steps for which the inputs of the spec are computed at once.
const STRETCH: u64 = 4096;

/// A compiled design. Nothing of it changes: every run has a network of its own.
#[pyclass(frozen)]
pub struct Design {
    compiled: Arc<Compiled>,
    map: Arc<Map>,
    program: Arc<Program>,
}

/// What an input does in a run: column of the numbers or words that were given, or what the spec says.
#[derive(Clone, Copy)]
enum Source {
    Spec,
    Number(usize),
    Word(usize),
}

/// Inputs that were given, by step.
struct Inputs {
    sources: Vec<(usize, Source)>,
    numbers: Vec<f64>,
    number_columns: usize,
    words: Vec<i64>,
    word_columns: usize,
}

/// What a run gave; arrays by step, in a row.
#[pyclass(frozen)]
struct Run {
    time: Vec<f64>,
    outputs: Vec<i64>,
    states: Vec<i64>,
    map: Arc<Map>,
    with_states: bool,
    #[pyo3(get)]
    flags: Vec<&'static str>,
    #[pyo3(get)]
    clamped: Vec<String>,
    #[pyo3(get)]
    beyond_range: Vec<String>,
    end: pe_host::Snapshot,
}

/// A failure of a run.
enum Stopped {
    Failed(Error),
    Memory,
}

impl From<Error> for Stopped {
    fn from(error: Error) -> Stopped {
        Stopped::Failed(error)
    }
}

/// A network at work on arrays.
struct Work<'a> {
    design: &'a Design,
    host: pe_host::Host,
    inputs: Inputs,
    /// Words of the spec's inputs, by step from `from` on.
    driven: Vec<Vec<i64>>,
    from: u64,
    clamped: Vec<bool>,
    beyond: Vec<bool>,
    time: Vec<f64>,
    outputs: Vec<i64>,
    states: Vec<i64>,
    with_states: bool,
}

impl Design {
    pub fn of(compiled: Compiled) -> PyResult<Design> {
        let map = Map::read(&compiled.map());
        let map = map.map_err(|fault| pyo3::exceptions::PyRuntimeError::new_err(fault.to_string()))?;
        let program = Arc::new(compiled.design.program.clone());
        Ok(Design { compiled: Arc::new(compiled), map: Arc::new(map), program })
    }

    /// The network in its initial state.
    fn network(&self) -> Result<pe_host::Host, Error> {
        let design = pe_host::Design::of(Map::clone(&self.map));
        let engine: Box<dyn Engine> = Box::new(Model::over(&design, Arc::clone(&self.program)));
        pe_host::Host::over(design, engine)
    }
}

#[pymethods]
impl Design {
    #[getter]
    fn report(&self) -> String {
        self.compiled.report.text()
    }

    #[getter]
    fn table(&self) -> String {
        self.compiled.table()
    }

    #[getter]
    fn map(&self) -> String {
        self.map.text()
    }

    #[getter]
    fn steps(&self) -> u64 {
        self.compiled.loaded.model.steps()
    }

    /// Numbers of the states in the initial state.
    #[getter]
    fn initial(&self) -> Vec<f64> {
        self.map.states.iter().map(|state| state.number(state.initial)).collect()
    }

    /// Numbers of the outputs at sample 0; none for those that have no value then.
    fn sample_0(&self, py: Python<'_>) -> PyResult<Vec<Option<f64>>> {
        let read = py.detach(|| self.network()?.read_defined());
        read.map_err(|error| raised(py, &error))
    }

    fn pictures(&self, py: Python<'_>) -> Vec<(String, String)> {
        let Compiled { loaded, design, variables, .. } = &*self.compiled;
        py.detach(|| pictures::draw(&Shown::of(&loaded.model, design, variables)))
    }

    fn write(&self, py: Python<'_>, folder: PathBuf, header: bool, pictures: bool) -> PyResult<()> {
        let compiled = Arc::clone(&self.compiled);
        done(py, OnInterrupt::Leave, move |_| {
            let folder = OutputFolder::create(&folder)?;
            compiled.write(&folder, Files { header, pictures }, &mut Stopwatch::silent())?;
            folder.finish()
        })
    }

    fn open(&self, py: Python<'_>) -> PyResult<Host> {
        py.detach(|| self.network()).map(Host::of).map_err(|error| raised(py, &error))
    }

    /// Runs steps: inputs by column, `-1 - c` is column c of `words`; an input that is not there is driven by the spec.
    #[pyo3(signature = (steps, columns, numbers, words, parameters, begin, states))]
    #[allow(clippy::too_many_arguments, reason = "one caller, which has them by name")]
    fn run(
        &self,
        py: Python<'_>,
        steps: u64,
        columns: Vec<(usize, i64)>,
        numbers: &Bound<'_, PyAny>,
        words: &Bound<'_, PyAny>,
        parameters: Option<Vec<f64>>,
        begin: Option<&Snapshot>,
        states: bool,
    ) -> PyResult<Run> {
        let host = py.detach(|| self.network()).map_err(|error| raised(py, &error))?;
        let mut sources: Vec<(usize, Source)> = Vec::new();
        let quantities = self.map.inputs.iter().enumerate().filter(|(_, input)| input.meaning == Meaning::Quantity);
        for (index, (port, _)) in quantities.enumerate() {
            let given = columns.iter().find(|(input, _)| *input == index).map(|(_, column)| *column);
            let source = match given {
                None => Source::Spec,
                Some(column) => match usize::try_from(column) {
                    Ok(column) => Source::Number(column),
                    Err(_) => Source::Word(usize::try_from(-1 - column).unwrap_or(0)),
                },
            };
            sources.push((port, source));
        }
        let count = sources.len();
        let number_columns = sources.iter().filter(|(_, source)| matches!(source, Source::Number(_))).count();
        let word_columns = sources.iter().filter(|(_, source)| matches!(source, Source::Word(_))).count();
        let inputs = Inputs { numbers: flat(numbers)?, number_columns, words: flat(words)?, word_columns, sources };
        let mut work = Work {
            design: self,
            host,
            inputs,
            driven: Vec::new(),
            from: 0,
            clamped: vec![false; count],
            beyond: vec![false; count],
            time: Vec::new(),
            outputs: Vec::new(),
            states: Vec::new(),
            with_states: states,
        };
        let stopped = |stopped| match stopped {
            Stopped::Failed(error) => raised(py, &error),
            Stopped::Memory => PyMemoryError::new_err(format!("the arrays of {steps} steps do not fit in memory")),
        };
        let mut tuned = py.detach(|| work.begin(steps, parameters.as_deref(), begin)).map_err(stopped)?;
        let mut done = 0;
        while done < steps {
            done = py.detach(|| work.go_on(done, steps)).map_err(stopped)?;
            py.check_signals()?;
        }
        let mut run = py.detach(|| work.end()).map_err(stopped)?;
        run.clamped.append(&mut tuned.0);
        run.beyond_range.append(&mut tuned.1);
        Ok(run)
    }
}

/// What an array holds, row by row.
fn flat<T: Element>(array: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    PyBuffer::<T>::get(array)?.to_vec(array.py())
}

/// Room for so many rows of a width.
fn reserve<T>(list: &mut Vec<T>, rows: u64, width: usize) -> Result<(), Stopped> {
    let count = usize::try_from(rows).ok().and_then(|rows| rows.checked_mul(width)).ok_or(Stopped::Memory)?;
    list.try_reserve_exact(count).map_err(|_| Stopped::Memory)
}

impl Work<'_> {
    /// Brings the network to where it begins; parameters that were clamped, or are beyond their ranges.
    fn begin(
        &mut self,
        steps: u64,
        parameters: Option<&[f64]>,
        begin: Option<&Snapshot>,
    ) -> Result<(Vec<String>, Vec<String>), Stopped> {
        let map = &self.design.map;
        reserve(&mut self.time, steps, 1)?;
        reserve(&mut self.outputs, steps, map.outputs.len())?;
        if self.with_states {
            reserve(&mut self.states, steps, map.states.len())?;
        }
        if let Some(Snapshot(begin)) = begin {
            self.host.restore(begin)?;
        }
        let Some(numbers) = parameters else { return Ok(Default::default()) };
        let written = self.host.write_parameters(numbers)?;
        let names = |indices: &[usize]| indices.iter().map(|index| map.parameters[*index].name.clone()).collect();
        Ok((names(&written.clamped), names(&written.beyond_range)))
    }

    /// Runs for a while; how many steps are done then.
    fn go_on(&mut self, mut done: u64, steps: u64) -> Result<u64, Stopped> {
        let begun = Instant::now();
        let mut words = vec![0; self.inputs.sources.len()];
        while done < steps && (begun.elapsed() < LOOK) {
            self.words(done, steps, &mut words)?;
            let outputs = self.host.exchange_words(&words, 1)?;
            // After a step every output has a word.
            self.outputs.extend(outputs.iter().map(|word| word.unwrap_or(0)));
            self.time.push(self.host.time());
            if self.with_states {
                let states = self.design.map.states.len();
                self.states.extend_from_slice(&self.host.snapshot()?.state[..states]);
            }
            done += 1;
        }
        Ok(done)
    }

    /// Words of the inputs in a step.
    fn words(&mut self, step: u64, steps: u64, words: &mut [i64]) -> Result<(), Stopped> {
        let map = &self.design.map;
        let sample = self.host.sample();
        let is_driven = self.inputs.sources.iter().any(|(_, source)| matches!(source, Source::Spec));
        if is_driven && !(self.from..self.from + self.driven.len() as u64).contains(&sample) {
            (self.from, self.driven) = (sample, self.design.compiled.stimulus(sample, (steps - step).min(STRETCH)));
        }
        let row = usize::try_from(step).map_err(|_| Stopped::Memory)?;
        for (index, (port, source)) in self.inputs.sources.iter().enumerate() {
            let input = &map.inputs[*port];
            words[index] = match source {
                Source::Spec => self.driven[(sample - self.from) as usize][*port],
                Source::Word(column) => self.inputs.words[row * self.inputs.word_columns + column],
                Source::Number(column) => {
                    let number = self.inputs.numbers[row * self.inputs.number_columns + column];
                    let word = input.word(number).ok_or_else(|| Error::NotANumber(input.name.clone()))?;
                    self.clamped[index] |= word.clamped;
                    self.beyond[index] |= input.range.is_some_and(|[least, most]| !(least..=most).contains(&number));
                    word.word
                }
            };
        }
        Ok(())
    }

    fn end(&mut self) -> Result<Run, Stopped> {
        let names = |marks: &[bool]| {
            let marked = self.host.inputs().zip(marks).filter(|(_, mark)| **mark);
            marked.map(|(input, _)| input.name.clone()).collect()
        };
        let (clamped, beyond_range) = (names(&self.clamped), names(&self.beyond));
        Ok(Run {
            clamped,
            beyond_range,
            time: std::mem::take(&mut self.time),
            outputs: std::mem::take(&mut self.outputs),
            states: std::mem::take(&mut self.states),
            map: Arc::clone(&self.design.map),
            with_states: self.with_states,
            flags: self.host.flags()?.names().collect(),
            end: self.host.snapshot()?,
        })
    }
}

/// Numbers in memory as an array of Python.
fn bytes<'py, const N: usize>(py: Python<'py>, all: impl Iterator<Item = [u8; N]>) -> Bound<'py, PyByteArray> {
    PyByteArray::new(py, &all.flatten().collect::<Vec<u8>>())
}

#[pymethods]
impl Run {
    fn time<'py>(&self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        bytes(py, self.time.iter().map(|number| number.to_ne_bytes()))
    }

    fn output_words<'py>(&self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        bytes(py, self.outputs.iter().map(|word| word.to_ne_bytes()))
    }

    fn outputs<'py>(&self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        let formats = self.map.outputs.iter().map(|output| output.format).cycle();
        bytes(py, self.outputs.iter().zip(formats).map(|(word, format)| format.number(*word).to_ne_bytes()))
    }

    fn state_words<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyByteArray>> {
        self.with_states.then(|| bytes(py, self.states.iter().map(|word| word.to_ne_bytes())))
    }

    fn states<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyByteArray>> {
        let states = self.map.states.iter().cycle();
        let numbers = self.states.iter().zip(states).map(|(word, state)| state.number(*word).to_ne_bytes());
        self.with_states.then(|| bytes(py, numbers))
    }

    #[getter]
    fn end(&self) -> Snapshot {
        Snapshot(self.end.clone())
    }
}

/// Curves over time, each in a chart of its own: name, unit and numbers.
#[pyfunction]
fn curves(py: Python<'_>, title: String, time: Vec<f64>, curves: Vec<(String, String, Vec<f64>)>) -> PyResult<String> {
    if time.is_empty() || curves.is_empty() {
        return Err(failed(py, &Failure::Usage("there is nothing to draw".to_owned())));
    }
    let columns = if curves.len() == 1 { 1 } else { 2 };
    let cell = |(name, unit, numbers): (String, String, Vec<f64>)| {
        vec![Chart {
            series: vec![Series::new(&name, Look::line(0), time.iter().copied().zip(numbers))],
            title: name,
            x: AxisPlan::new("time / s", Scale::Linear),
            y: AxisPlan::new(&unit, Scale::Linear),
            field: None,
            height: 130.0,
        }]
    };
    let cells = curves.into_iter().map(cell).collect();
    let caption = "Words of the network as numbers.".to_owned();
    Ok(py.detach(|| Figure { title, caption, width: 960.0, columns, cells }.draw()))
}

/// Adds all of it to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Design>()?;
    module.add_class::<Run>()?;
    module.add_function(wrap_pyfunction!(curves, module)?)
}
