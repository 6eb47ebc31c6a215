//! A compiled design in its folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use pe_ir::program::Program;
use pe_map::sha256;
use serde_json::Value;

use pe_flow::failure::Failure;

/// The files of a design, read by name.
pub struct DesignFolder {
    /// The folder.
    pub path: PathBuf,
    /// The files' common prefix.
    pub design: String,
    /// What the program file says.
    pub program: Program,
}

/// A file that is not what the report says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// Its content has another hash.
    Differs(String),
    /// It is not there.
    Missing(String),
    /// It is in `hdl/`, and the report does not know it.
    Extra(String),
    /// The report has no hashes, or there is no report.
    NoHashes,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Change::Differs(file) => {
                write!(f, "`{file}` is not what `compile` wrote: its hash differs from report.json")
            }
            Change::Missing(file) => write!(f, "`{file}` is missing"),
            Change::Extra(file) => write!(f, "`{file}` was not written by `compile`"),
            Change::NoHashes => {
                write!(f, "report.json is of an earlier version without file hashes: changes cannot be detected")
            }
        }
    }
}

impl DesignFolder {
    /// Reads a folder's program.
    ///
    /// # Errors
    /// If there is none, or if it cannot be read.
    pub fn open(path: &Path) -> Result<DesignFolder, Failure> {
        let entries = fs::read_dir(path).map_err(|error| Failure::file("read", path, error))?;
        let mut names: Vec<String> = entries
            .filter_map(|entry| Some(entry.ok()?.file_name().to_str()?.strip_suffix("_program.txt")?.to_owned()))
            .collect();
        names.sort();
        let design = names.pop().ok_or_else(|| {
            Failure::file("verify", path, "it holds no `*_program.txt`; run `pe-synth compile` first")
        })?;
        let file = path.join(format!("{design}_program.txt"));
        let text = fs::read_to_string(&file).map_err(|error| Failure::file("read", &file, error))?;
        let program = text.parse().map_err(|error| Failure::file("read", &file, error))?;
        Ok(DesignFolder { path: path.to_owned(), design, program })
    }

    /// The text of `NAME_kind`.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(&self, kind: &str) -> Result<String, Failure> {
        let path = self.file(kind);
        fs::read_to_string(&path).map_err(|error| Failure::file("read", &path, error))
    }

    /// That a file holds something else than it should.
    pub fn damaged(&self, kind: &str, what: &str) -> Failure {
        Failure::file("read", &self.file(kind), what)
    }

    fn file(&self, kind: &str) -> PathBuf {
        self.path.join(format!("{}_{kind}", self.design))
    }

    /// The input words of every step in a stimulus file.
    ///
    /// # Errors
    /// If it cannot be read or holds something else.
    pub fn stimulus(&self, kind: &str) -> Result<Vec<Vec<i64>>, Failure> {
        let file = format!("{kind}.txt");
        let bits = self.program.format.storage_bits;
        let word = |field: &str| {
            let word = u64::from_str_radix(field, 16).ok()?;
            Some(((word << (64 - bits)) as i64) >> (64 - bits))
        };
        let ports = self.program.ports().count();
        let line = |line: &str| {
            let words = line.split_ascii_whitespace().map(word).collect::<Option<Vec<i64>>>()?;
            (words.len() == ports).then_some(words)
        };
        let lines = self.read(&file)?.lines().map(line).collect::<Option<Vec<_>>>();
        lines.ok_or_else(|| self.damaged(&file, "it must hold one hex word for each input"))
    }

    /// Number of steps and words of the states in the middle of the span.
    ///
    /// # Errors
    /// If the file cannot be read or holds something else.
    pub fn checkpoint(&self) -> Result<(u64, Vec<i64>), Failure> {
        const FILE: &str = "checkpoint.txt";
        let text = self.read(FILE)?;
        let damaged = || self.damaged(FILE, "it is damaged");
        let (first, words) = text.split_once('\n').ok_or_else(damaged)?;
        let word = |line: &str| u64::from_str_radix(line, 16).ok().map(|word| word as i64);
        let words = words.lines().map(word).collect::<Option<Vec<i64>>>().ok_or_else(damaged)?;
        let step = first.strip_prefix("step ").and_then(|step| step.parse().ok()).ok_or_else(damaged)?;
        let limits = self.program.format.min_word()..=self.program.format.max_word();
        let complete = words.len() == self.program.states.len() && words.iter().all(|word| limits.contains(word));
        if complete { Ok((step, words)) } else { Err(damaged()) }
    }

    /// Files that are not what the report says, in the order of their names.
    pub fn changes(&self) -> Vec<Change> {
        let report = fs::read_to_string(self.path.join("report.json")).ok();
        let report: Option<Value> = report.and_then(|text| serde_json::from_str(&text).ok());
        let Some(files) = report.as_ref().and_then(|report| report["files"].as_object()) else {
            return vec![Change::NoHashes];
        };
        let mut changes = BTreeMap::new();
        for (file, hash) in files {
            match fs::read(self.path.join(file)) {
                Ok(content) if hash.as_str() == Some(&sha256(&content)) => {}
                Ok(_) => drop(changes.insert(file.clone(), Change::Differs(file.clone()))),
                Err(_) => drop(changes.insert(file.clone(), Change::Missing(file.clone()))),
            }
        }
        let there: BTreeSet<String> = fs::read_dir(self.path.join("hdl"))
            .into_iter()
            .flatten()
            .filter_map(|entry| Some(format!("hdl/{}", entry.ok()?.file_name().to_string_lossy())))
            .collect();
        let extra = there.into_iter().filter(|file| !files.contains_key(file));
        changes.extend(extra.map(|file| (file.clone(), Change::Extra(file))));
        changes.into_values().collect()
    }
}
