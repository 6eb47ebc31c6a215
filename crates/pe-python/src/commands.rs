//! Commands in process, from the words behind their names.

use pe_flow::explore::sweep::Event;
use pe_flow::watch::Stopwatch;
use pe_judge::progress::Progress;
use pe_synth::cmd_accuracy::Accuracy;
use pe_synth::cmd_check::Check;
use pe_synth::cmd_compile::Compile;
use pe_synth::cmd_explore::Explore;
use pe_synth::command::{parsed, typed};
use pe_synth::explore::drive::Events;
use pyo3::prelude::*;
use serde_json::json;
use std::sync::Arc;

use crate::design::Design;
use crate::work::{OnInterrupt, done, told_of};

/// Compiles a spec; `text` is its text, if it is not that of the file that the words name.
#[pyfunction]
fn compile(py: Python<'_>, words: Vec<String>, text: Option<String>) -> PyResult<Design> {
    let command = typed(std::iter::once("compile".to_owned()).chain(words.iter().cloned()));
    let compiled = done(py, OnInterrupt::Leave, move |ear| {
        let mut compile: Compile = parsed("compile", &quiet(words))?;
        compile.model.text = text;
        let loaded = compile.load(ear)?;
        compile.compiled(&loaded, &command, &mut Stopwatch::new(ear.clone()))
    })?;
    Design::of(compiled)
}

/// Judges a step: the result in JSON, and in words.
#[pyfunction]
fn check(py: Python<'_>, words: Vec<String>, text: Option<String>) -> PyResult<(String, String)> {
    done(py, OnInterrupt::Leave, move |ear| {
        let mut check: Check = parsed("check", &words)?;
        check.model.text = text;
        let bar: Arc<dyn Progress> = Arc::new(ear.clone());
        let checked = check.checked(&mut Stopwatch::new(ear.clone()), bar)?;
        let mut result = checked.json();
        let findings = checked.check.findings.iter().map(|finding| told_of(finding, &checked.loaded.sources));
        result["findings"] = json!(findings.collect::<Vec<_>>());
        Ok((result.to_string(), checked.text(true)))
    })
}

/// Computes the points of `explore`, into the folder that the words name.
#[pyfunction]
fn explore(py: Python<'_>, words: Vec<String>, text: Option<String>) -> PyResult<()> {
    let (events, sender) = Events::new();
    let interrupt = OnInterrupt::Tell(Box::new(move || drop(sender.send(Event::Interrupted))));
    done(py, interrupt, move |ear| {
        let mut explore: Explore = parsed("explore", &quiet(words))?;
        explore.model.text = text;
        explore.sweep(ear, events)
    })
}

/// Computes the points of `accuracy`, into the folder that the words name.
#[pyfunction]
fn accuracy(py: Python<'_>, words: Vec<String>, text: Option<String>) -> PyResult<()> {
    let (events, sender) = Events::new();
    let interrupt = OnInterrupt::Tell(Box::new(move || drop(sender.send(Event::Interrupted))));
    done(py, interrupt, move |ear| {
        let mut accuracy: Accuracy = parsed("accuracy", &quiet(words))?;
        accuracy.model.text = text;
        accuracy.sweep(ear, events)
    })
}

/// The words with the one that keeps a command from printing.
fn quiet(mut words: Vec<String>) -> Vec<String> {
    words.insert(0, "--quiet".to_owned());
    words
}

/// Adds all of it to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(compile, module)?)?;
    module.add_function(wrap_pyfunction!(check, module)?)?;
    module.add_function(wrap_pyfunction!(explore, module)?)?;
    module.add_function(wrap_pyfunction!(accuracy, module)?)
}
