//! The result of a sweep as it grows, and the folder it is kept in.

use pe_judge::DesignPoint;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use serde_json::{Map, Value};

use super::sheet::Sheet;
use crate::output::{Files, OutputFolder};
use pe_flow::explore::family::Job;
use pe_flow::explore::row::{Outcome, Row};
use pe_flow::explore::sweep::Event;
use pe_flow::failure::Failure;

/// Time between two writings of an unfinished result.
const SAVE_EVERY: Duration = Duration::from_secs(5);

/// Which files a sweep leaves.
#[derive(Clone, Copy)]
pub struct Kind {
    /// The one that an earlier result is read from.
    pub store: &'static str,
    /// All of them, from what is known.
    pub files: fn(&Sheet) -> Result<Files, Failure>,
}

/// The result as far as it is known.
pub struct Record {
    /// Its files.
    pub kind: Kind,
    /// Keys of the store that say what was asked for.
    pub head: Map<String, Value>,
    /// Name of the model.
    pub title: String,
    /// The clock, as a person reads it.
    pub clock: String,
    /// Largest total error of points that compete in size and speed.
    pub max_error: Option<f64>,
    /// All points in order: the command of each, and what became of it.
    pub rows: Vec<(DesignPoint, String, Option<Outcome>)>,
    /// The folder.
    pub target: PathBuf,
}

impl Record {
    /// Takes over the points of an earlier result; without one the sweep starts from the beginning.
    ///
    /// # Errors
    /// If that result is of another version, model or options, or has points that this sweep has not.
    pub fn resume(&mut self) -> Result<(), Failure> {
        let path = self.target.join(self.kind.store);
        if !path.exists() {
            return Ok(());
        }
        let text = std::fs::read_to_string(&path).map_err(|error| Failure::file("read", &path, error))?;
        let stored: Value = serde_json::from_str(&text).map_err(|error| Failure::file("read", &path, error))?;
        for (key, what) in [("generator", "version"), ("model_sha256", "model"), ("shared_options", "options")] {
            let (then, now) = (stored.get(key), self.head.get(key));
            if then != now {
                let shown = |value: Option<&Value>| value.and_then(Value::as_str).unwrap_or("none").to_owned();
                return Err(refusal(
                    &self.target,
                    &format!("the {what} differs: `{}` then, `{}` now", shown(then), shown(now)),
                ));
            }
        }
        let places: BTreeMap<String, usize> =
            self.rows.iter().enumerate().map(|(place, (_, command, _))| (command.clone(), place)).collect();
        for row in stored.get("points").and_then(Value::as_array).into_iter().flatten() {
            let command = row.get("command").and_then(Value::as_str).unwrap_or("");
            let Some(place) = places.get(command) else {
                return Err(refusal(&self.target, &format!("this sweep lacks a point of that one: `{command}`")));
            };
            self.rows[*place].2 = Row::outcome_from_json(row);
        }
        Ok(())
    }

    /// Points without a result.
    pub fn pending(&self) -> Vec<Job> {
        let rows = self.rows.iter().enumerate().filter(|(_, (_, _, outcome))| outcome.is_none());
        rows.map(|(index, (point, command, _))| Job { index, point: *point, command: command.clone() }).collect()
    }

    /// Waits for the sweep to end, writing what is there from time to time; the whole result at the end. `progress`
    /// hears the number of points done, that of all points, and the seconds that the work done was estimated to take.
    ///
    /// # Errors
    /// [`Failure::Interrupted`] after a signal, when the partial result has been written.
    pub fn follow(
        &mut self,
        events: &Receiver<Event>,
        progress: &mut dyn FnMut(usize, usize, f64),
    ) -> Result<(), Failure> {
        let mut saved = Instant::now();
        let mut done = self.done();
        progress(done, self.rows.len(), 0.0);
        for event in events {
            match event {
                Event::Work(seconds) => progress(done, self.rows.len(), seconds),
                Event::Point(index, outcome) => {
                    self.rows[index].2 = Some(outcome);
                    done += 1;
                }
                Event::Finished => break,
                Event::Interrupted => return Err(self.interrupted()),
            }
            if done > 0 && saved.elapsed() > SAVE_EVERY {
                self.save()?;
                saved = Instant::now();
            }
        }
        self.save()
    }

    fn done(&self) -> usize {
        self.rows.iter().filter(|(_, _, outcome)| outcome.is_some()).count()
    }

    /// Saves what is there after a signal.
    fn interrupted(&self) -> Failure {
        let done = self.done();
        if done == 0 {
            return Failure::Interrupted("interrupted before the first point was done; nothing was written".into());
        }
        match self.save() {
            Ok(()) => Failure::Interrupted(format!(
                "interrupted; {done} of {} points are in {}, the same command with `--resume` continues",
                self.rows.len(),
                self.target.display()
            )),
            Err(failure) => failure,
        }
    }

    /// What there is as files.
    pub fn sheet(&self) -> Sheet {
        let done = self.rows.iter().enumerate().filter_map(|(place, (point, command, outcome))| {
            let row = Row { point: *point, command: command.clone(), outcome: outcome.clone()? };
            Some((place, row))
        });
        let (places, rows) = done.unzip();
        Sheet {
            head: self.head.clone(),
            title: self.title.clone(),
            clock: self.clock.clone(),
            max_error: self.max_error,
            total: self.rows.len(),
            rows,
            places,
        }
    }

    fn save(&self) -> Result<(), Failure> {
        let folder = OutputFolder::create(&self.target)?;
        for (path, bytes) in (self.kind.files)(&self.sheet())? {
            folder.write_bytes(path, &bytes)?;
        }
        folder.finish()
    }
}

fn refusal(target: &Path, reason: &str) -> Failure {
    let remedy = "leave out `--resume` to start over, or choose another folder with `-o`";
    Failure::Usage(format!("cannot resume the sweep in {}: {reason}; {remedy}", target.display()))
}
