//! The Python package `pe_synth`: the commands in process, networks on arrays, and the interface of hosts. The folder
//! `python` has what users import; here is what it stands on, module `pe_synth._native`.
#![allow(missing_docs, reason = "the stub file has the documentation")]

mod commands;
mod design;
mod host;
mod work;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    host::add(module)?;
    design::add(module)?;
    commands::add(module)
}
