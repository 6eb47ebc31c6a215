//! The result of a sweep as it grows, and the folder it is kept in.

use pe_ir::model::Solver;
use pe_judge::DesignPoint;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

use super::changes;
use super::seal::is_whole;
use super::sheet::Sheet;
use super::store::{Known, Store};
use crate::output::{Files, FolderLock, OutputFolder};
use pe_flow::accuracy::wanted::Goals;
use pe_flow::explore::estimate::Work;
use pe_flow::explore::family::Job;
use pe_flow::explore::row::{Outcome, Row};
use pe_flow::explore::sweep::{Event, Sweep};
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
    /// What the best point is wanted to be.
    pub goals: Goals,
    /// All points in order: the command of each, and what became of it.
    pub rows: Vec<(DesignPoint, String, Option<Outcome>)>,
    /// The folder.
    pub target: PathBuf,
    /// Whether further points depend on the outcomes of these.
    pub searches: bool,
    /// Rows of an earlier result by their commands that no point has asked for yet.
    pub kept: BTreeMap<String, Value>,
    /// Whether the time ran out that the sweep was given.
    pub late: bool,
    /// Points that other sweeps share.
    pub store: Option<Store>,
    /// Points with a damaged file there, which are computed again.
    pub damaged: BTreeSet<usize>,
    /// Number of points that are damaged in an earlier result, and computed again.
    pub lost: usize,
    /// The part of the points that is computed, of so many, for the store alone.
    pub share: Option<(u32, u32)>,
    /// No other sweep writes to the folder; none if this one does not, either.
    pub lock: Option<FolderLock>,
}

/// How a round of a sweep ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// All points are done.
    Done,
    /// The time ran out.
    Late,
}

impl Record {
    /// Takes over the points of an earlier result; without one the sweep starts from the beginning.
    ///
    /// # Errors
    /// If that result is damaged, of another version, model or options, or has points that this sweep has not.
    pub fn resume(&mut self) -> Result<(), Failure> {
        let path = self.target.join(self.kind.store);
        if !path.exists() {
            return Ok(());
        }
        let bytes = std::fs::read(&path).map_err(|error| Failure::file("read", &path, error))?;
        let stored: Option<Value> = serde_json::from_slice(&bytes).ok();
        let Some((stored, points)) =
            stored.as_ref().and_then(|stored| Some((stored, stored.get("points")?.as_array()?)))
        else {
            let reason = format!("{} is damaged, so none of its points can be used", path.display());
            return Err(refusal(&self.target, &reason));
        };
        if let Some(changed) = changes::between(stored, &self.head) {
            return Err(refusal(&self.target, &changed));
        }
        let command = |row: &Value| row.get("command").and_then(Value::as_str).unwrap_or("").to_owned();
        // What a point was too wrong for is another limit now.
        let other_limit = stored.get("max_error") != Some(&json!(self.max_error));
        let ended = |row: &Value| other_limit && row.get("exit_code") == Some(&json!(0));
        let (whole, lost): (Vec<&Value>, Vec<&Value>) = points.iter().partition(|row| is_whole(row));
        self.lost = lost.len();
        self.kept = whole.into_iter().filter(|row| !ended(row)).map(|row| (command(row), row.clone())).collect();
        for (_, command, outcome) in &mut self.rows {
            *outcome = self.kept.remove(command).as_ref().and_then(Row::outcome_from_json);
        }
        // A search that is asked the same again asks for its points again.
        let searches_again = self.searches && stored.get("command") == self.head.get("command");
        match self.kept.first_key_value().filter(|_| !searches_again) {
            Some((command, _)) => {
                Err(refusal(&self.target, &format!("this sweep lacks a point of that one: `{command}`")))
            }
            None => Ok(()),
        }
    }

    /// Adds points, whose outcomes an earlier result may have.
    pub fn extend(&mut self, points: impl IntoIterator<Item = (DesignPoint, String)>) {
        for (point, command) in points {
            let outcome = self.kept.remove(&command).as_ref().and_then(Row::outcome_from_json);
            self.rows.push((point, command, outcome));
        }
    }

    /// Takes over what the store has of the points without a result, for a sweep that has such limits.
    pub fn ask(&mut self, folder: Option<&Path>, sweep: &Sweep) {
        self.store = folder.map(|folder| Store::of(folder, sweep));
        let Some(store) = &self.store else { return };
        for (index, (_, command, outcome)) in self.rows.iter_mut().enumerate() {
            if outcome.is_some() {
                continue;
            }
            match store.find(command) {
                Known::Outcome(known) => *outcome = Some(known),
                Known::Damaged => drop(self.damaged.insert(index)),
                Known::Nothing => {}
            }
        }
    }

    /// Whether points without a result are left to others.
    pub fn waits(&self) -> bool {
        self.rows.iter().any(|(_, _, outcome)| outcome.is_none())
    }

    /// Whether a point is of the part that is computed: points with the same step graph are, or are not.
    fn shares(&self) -> Vec<bool> {
        let Some((part, parts)) = self.share else { return vec![true; self.rows.len()] };
        let mut known: Vec<(Option<Solver>, Option<u64>)> = Vec::new();
        let of = |point: &DesignPoint| (point.solver, point.step.map(f64::to_bits));
        self.rows.iter().for_each(|(point, ..)| {
            if !known.contains(&of(point)) {
                known.push(of(point));
            }
        });
        let place = |point: &DesignPoint| known.iter().position(|other| *other == of(point)).expect("pushed above");
        self.rows.iter().map(|(point, ..)| place(point) as u32 % parts == part - 1).collect()
    }

    /// Points without a result that are to be computed.
    pub fn pending(&self) -> Vec<Job> {
        let shares = self.shares();
        let rows = self.rows.iter().enumerate().filter(|(index, (_, _, outcome))| outcome.is_none() && shares[*index]);
        rows.map(|(index, (point, command, _))| Job { index, point: *point, command: command.clone() }).collect()
    }

    /// Waits for the sweep to end, or for some time, writing what is there from time to time; the whole result at the end.
    /// `progress` hears the number of points done, that of all points, and of the work that is over.
    ///
    /// # Errors
    /// [`Failure::Interrupted`] after a signal, when the partial result has been written; [`Failure::Fruitless`] if the
    /// time was too short for a point.
    pub fn follow(
        &mut self,
        events: &Receiver<Event>,
        until: Option<Instant>,
        progress: &mut dyn FnMut(usize, usize, Option<&Work>),
    ) -> Result<Ended, Failure> {
        let mut saved = Instant::now();
        let mut done = self.done();
        progress(done, self.rows.len(), None);
        loop {
            let event = match until {
                Some(until) => events.recv_timeout(until.saturating_duration_since(Instant::now())),
                None => events.recv().map_err(|_| RecvTimeoutError::Disconnected),
            };
            match event {
                Ok(Event::Work(work)) => progress(done, self.rows.len(), Some(&work)),
                Ok(Event::Point(index, outcome)) => {
                    let (point, command, _) = &self.rows[index];
                    let row = Row { point: *point, command: command.clone(), outcome };
                    self.store.as_ref().map_or(Ok(()), |store| store.keep(&row))?;
                    self.rows[index].2 = Some(row.outcome);
                    done += 1;
                }
                Ok(Event::Finished) | Err(_) => break,
                Ok(Event::Interrupted) => return Err(self.interrupted()),
            }
            if done > 0 && saved.elapsed() > SAVE_EVERY {
                self.save()?;
                saved = Instant::now();
            }
        }
        self.late = !self.pending().is_empty();
        if self.late && done == 0 {
            let text = "no point was done in the time of `--within`; nothing was written";
            return Err(Failure::Fruitless(text.to_owned()));
        }
        self.save()?;
        Ok(if self.late { Ended::Late } else { Ended::Done })
    }

    /// Number of points with a result.
    pub fn done(&self) -> usize {
        self.rows.iter().filter(|(_, _, outcome)| outcome.is_some()).count()
    }

    /// Saves what is there after a signal.
    pub fn interrupted(&self) -> Failure {
        let done = self.done();
        if done == 0 {
            return Failure::Interrupted("interrupted before the first point was done; nothing was written".into());
        }
        let target = match self.share {
            Some(_) => "the store".to_owned(),
            None => self.target.display().to_string(),
        };
        match self.save() {
            Ok(()) => Failure::Interrupted(format!(
                "interrupted; {done} of {} points are in {}, the same command with `--resume` continues",
                self.rows.len(),
                target
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
            goals: self.goals,
            total: self.rows.len(),
            late: self.late,
            rows,
            places,
        }
    }

    /// Writes what there is.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self) -> Result<(), Failure> {
        if self.share.is_some() {
            return Ok(());
        }
        let folder = OutputFolder::create(&self.target)?;
        for (path, bytes) in (self.kind.files)(&self.sheet())? {
            let bytes = if path == self.kind.store { self.with_kept(bytes) } else { bytes };
            folder.write_bytes(path, &bytes)?;
        }
        folder.finish()
    }

    /// The store with the rows that a search may still ask for: another interrupt must not lose them.
    fn with_kept(&self, store: Vec<u8>) -> Vec<u8> {
        if self.kept.is_empty() {
            return store;
        }
        let mut whole: Value = serde_json::from_slice(&store).unwrap_or_default();
        let points = whole.get_mut("points").and_then(Value::as_array_mut);
        points.into_iter().for_each(|points| points.extend(self.kept.values().cloned()));
        format!("{whole:#}\n").into_bytes()
    }
}

fn refusal(target: &Path, reason: &str) -> Failure {
    let remedy = "leave out `--resume` to start over, or choose another folder with `-o`";
    Failure::Usage(format!("cannot resume the sweep in {}: {reason}; {remedy}", target.display()))
}
