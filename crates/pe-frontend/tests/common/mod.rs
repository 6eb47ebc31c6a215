//! Shared by the integration tests: spec files, and a direct evaluator of right-hand sides.

// Each test binary uses a part of this.
#![allow(dead_code)]

use pe_frontend::{NoFiles, Overrides};
use pe_ir::model::{Expr, Model, Variable};
use pe_ir::source::Sources;
use std::path::{Path, PathBuf};

/// A spec of one file.
pub fn source(text: &str) -> Sources {
    Sources::new("test.spec", text)
}

/// The model of a text that must compile.
pub fn model(text: &str) -> Model {
    model_with(text, Overrides::default())
}

/// The model of a text that must compile with these values and outputs of the command line.
pub fn model_with(text: &str, overrides: Overrides) -> Model {
    let mut sources = source(text);
    match pe_frontend::compile(&mut sources, &NoFiles, &overrides) {
        Ok((model, _)) => model,
        Err(errors) => panic!("{}", errors.iter().map(|error| format!("{error}\n")).collect::<String>()),
    }
}

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// All `.spec` files below a folder, sorted.
pub fn specs(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    for entry in entries {
        let path = entry.expect("the folder can be read").path();
        if path.is_dir() {
            found.extend(specs(&path));
        } else if path.extension().is_some_and(|extension| extension == "spec") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Derivatives of all states for given values of states and inputs.
pub fn derivatives(model: &Model, states: &[f64], inputs: &[f64]) -> Vec<f64> {
    let mut algebraics: Vec<f64> = Vec::new();
    for algebraic in &model.algebraics {
        // Fails if an equation reads one that comes later.
        let value = evaluate(&algebraic.expr, states, inputs, &algebraics);
        algebraics.push(value);
    }
    model.states.iter().map(|state| evaluate(&state.derivative, states, inputs, &algebraics)).collect()
}

fn evaluate(expr: &Expr, states: &[f64], inputs: &[f64], algebraics: &[f64]) -> f64 {
    expr.evaluate(&|variable| match variable {
        Variable::State(i) => states[i.index()],
        Variable::Input(i) => inputs[i as usize],
        Variable::Algebraic(i) => algebraics[i as usize],
    })
}

/// The folder of a main file on disk.
pub struct Folder(pub PathBuf);

impl pe_frontend::Loader for Folder {
    fn load(&self, path: &str) -> Result<Vec<u8>, pe_frontend::LoadError> {
        std::fs::read(self.0.join(path)).map_err(|_| pe_frontend::LoadError::Missing)
    }
}
