//! Points of sweeps in a folder that several sweeps share.
//!
//! A point is a job that can be done again and again: its file is named by the hash of what decides its outcome, and holds
//! that outcome. Files are written whole or not at all, so that sweeps may share a folder at the same time, on one machine or
//! many.

use std::fs;
use std::path::{Path, PathBuf};

use pe_flow::explore::row::{Outcome, Row};
use pe_flow::explore::sweep::Sweep;
use pe_flow::failure::Failure;
use pe_map::sha256;
use serde_json::{Value, json};

use super::drive::{GENERATOR, fingerprint};

/// Characters of a name that are the name of its folder: a hundredth of ten thousand points each.
const BRANCH: usize = 2;

/// A store, as a sweep sees it.
#[derive(Clone)]
pub struct Store {
    folder: PathBuf,
    /// Hash of the model.
    model: String,
    /// From which total error on points are ended, and whether at once.
    within: Option<f64>,
    early: bool,
}

/// What a store knows of a point.
pub enum Known {
    /// Its outcome.
    Outcome(Outcome),
    /// Its file is damaged.
    Damaged,
    /// Nothing.
    Nothing,
}

impl Store {
    /// The store in a folder, for the points of a sweep.
    pub fn of(folder: &Path, sweep: &Sweep) -> Store {
        let model = fingerprint(&sweep.loaded.model);
        Store { folder: folder.to_owned(), model, within: sweep.within, early: sweep.early }
    }

    /// What decides the outcome of a point.
    fn key(&self, command: &str) -> Value {
        json!({
            "generator": GENERATOR,
            "model_sha256": self.model,
            "command": command,
            "within": self.within,
            "early": self.early,
        })
    }

    fn path(&self, key: &Value) -> PathBuf {
        let name = sha256(key.to_string().as_bytes());
        self.folder.join(&name[..BRANCH]).join(format!("{name}.json"))
    }

    /// The outcome of the point that a command compiles.
    pub fn find(&self, command: &str) -> Known {
        let own = self.read(command);
        let (Known::Nothing, Some(limit)) = (&own, self.within) else { return own };
        // One that was designed whatever its error is the same if its error is small.
        let any = Store { within: None, early: false, ..self.clone() };
        match any.read(command) {
            Known::Outcome(Outcome::Compiled(compiled)) => {
                let error = &compiled.figures.error;
                let double = error.of_total.as_ref().map(|of| of.double);
                let small = error.total.zip(double).is_some_and(|(total, double)| total <= limit && double <= limit);
                if small { Known::Outcome(Outcome::Compiled(compiled)) } else { Known::Nothing }
            }
            Known::Damaged => Known::Damaged,
            _ => Known::Nothing,
        }
    }

    fn read(&self, command: &str) -> Known {
        let key = self.key(command);
        let Ok(bytes) = fs::read(self.path(&key)) else { return Known::Nothing };
        let outcome = || {
            let text = std::str::from_utf8(&bytes).ok()?;
            let (hash, text) = text.split_once('\n')?;
            let record: Value = serde_json::from_str(text).ok().filter(|_| hash == sha256(text.as_bytes()))?;
            Row::outcome_from_json(record.get("row").filter(|_| record.get("key") == Some(&key))?)
        };
        outcome().map_or(Known::Damaged, Known::Outcome)
    }

    /// Keeps the outcome of a point, unless it is due to the machine or to a mistake of the compiler.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&self, row: &Row) -> Result<(), Failure> {
        if let Outcome::Failed(reason) = &row.outcome
            && reason.exit_code > Failure::Usage(String::new()).code()
        {
            return Ok(());
        }
        let key = self.key(&row.command);
        let path = self.path(&key);
        let text = format!("{}\n", json!({"key": key, "row": row.to_json()}));
        let folder = path.parent().expect("it is in a folder");
        fs::create_dir_all(folder).map_err(|error| Failure::file("create", folder, error))?;
        // Another sweep may write the same at the same time.
        let draft = path.with_extension(format!("{}.part", std::process::id()));
        let written = fs::write(&draft, format!("{}\n{text}", sha256(text.as_bytes())));
        written.and_then(|()| fs::rename(&draft, &path)).map_err(|error| Failure::file("write", &path, error))
    }
}
