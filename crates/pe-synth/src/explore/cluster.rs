//! Sweeps on a cluster: parts of a sweep as an array of jobs that fill the store, again and again until no point is missing.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use pe_flow::explore::sweep::{Event, Sweep};
use pe_flow::failure::Failure;
use pe_map::sha256;

use super::record::{Ended, Record};
use crate::command::quoted;
use crate::console;

/// Time between two looks at the jobs and at the store.
const LOOK: Duration = Duration::from_secs(2);

/// Arrays in a row that compute nothing before the sweep gives up.
const IDLE: u32 = 3;

/// Folder of scripts and logs in a store.
const JOBS: &str = "jobs";

/// Options of this command that its parts lack, and how many words each takes.
const OWN: [(&str, usize); 4] = [("--cluster", 2), ("--parts", 2), ("-q", 1), ("--quiet", 1)];

/// A scheduler.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Scheduler {
    /// Job arrays of Slurm, by `sbatch`, `squeue` and `scancel`
    Slurm,
}

/// Where the parts of a sweep are computed.
pub struct Cluster {
    /// Number of parts.
    pub parts: u32,
    /// The store that all of them see.
    pub store: PathBuf,
}

impl Cluster {
    /// Submits arrays of jobs until the store has all points, and writes the result.
    ///
    /// # Errors
    /// If Slurm is missing or refuses, or if several arrays compute nothing; [`Failure::Interrupted`] after a signal, when
    /// the jobs have been cancelled.
    pub fn round(
        &self,
        events: &Receiver<Event>,
        record: &mut Record,
        sweep: &Sweep,
        quiet: bool,
    ) -> Result<Ended, Failure> {
        let mut idle = 0;
        loop {
            record.ask(Some(&self.store), sweep);
            let before = record.done();
            if !record.waits() {
                return record.save().map(|()| Ended::Done);
            }
            let (job, logs) = self.submit()?;
            if !quiet {
                let missing = record.rows.len() - before;
                console::err(&format!("   cluster  job {job}: {} parts for {missing} points\n", self.parts));
            }
            let mut told = before;
            while waits(&job) {
                if let Ok(Event::Interrupted) = events.recv_timeout(LOOK) {
                    let _ = Command::new("scancel").arg(&job).status();
                    record.ask(Some(&self.store), sweep);
                    return Err(record.interrupted());
                }
                record.ask(Some(&self.store), sweep);
                let (done, total) = (record.done(), record.rows.len());
                if !quiet && 10 * (done - told) >= total {
                    told = done;
                    console::err(&format!("   cluster  {done} of {total} points\n"));
                }
            }
            record.ask(Some(&self.store), sweep);
            idle = if record.done() > before { 0 } else { idle + 1 };
            if idle == IDLE {
                let text = format!("{IDLE} arrays of jobs computed no point; {} says why", logs.display());
                return Err(Failure::File(text));
            }
        }
    }

    /// Writes a script and submits it: the name of the job, and where it logs.
    fn submit(&self) -> Result<(String, PathBuf), Failure> {
        let absolute = |path: &PathBuf| std::path::absolute(path).map_err(|error| Failure::file("find", path, error));
        let folder = absolute(&self.store.join(JOBS))?;
        fs::create_dir_all(&folder).map_err(|error| Failure::file("create", &folder, error))?;
        let program =
            std::env::current_exe().map_err(|error| Failure::File(format!("cannot find this program: {error}")))?;
        let here = absolute(&PathBuf::from("."))?;
        let mut words = vec![program.to_string_lossy().into_owned()];
        words.extend(own_words());
        let words: Vec<String> = words.iter().map(|word| quoted(word)).collect();
        let script = format!(
            "#!/bin/sh\n# A part of a sweep; its points go to the store.\ncd {} || exit 1\nexec {} --quiet --shard \"$SLURM_ARRAY_TASK_ID/{}\"\n",
            quoted(&here.to_string_lossy()),
            words.join(" "),
            self.parts
        );
        let path = folder.join(format!("{}.sh", &sha256(script.as_bytes())[..16]));
        fs::write(&path, script).map_err(|error| Failure::file("write", &path, error))?;
        let logs = folder.join("%A_%a.log");
        let output = Command::new("sbatch")
            .arg("--parsable")
            .arg("--requeue")
            .arg("--job-name=pe-synth")
            .arg(format!("--array=1-{}", self.parts))
            .arg(format!("--output={}", logs.display()))
            .arg(&path)
            .output()
            .map_err(|error| Failure::MissingTool(format!("cannot start `sbatch` of Slurm: {error}")))?;
        if !output.status.success() {
            let reason = String::from_utf8_lossy(&output.stderr);
            return Err(Failure::File(format!("`sbatch` refused {}: {}", path.display(), reason.trim())));
        }
        // Behind a semicolon the cluster is named.
        let job = String::from_utf8_lossy(&output.stdout);
        Ok((job.trim().split(';').next().unwrap_or_default().to_owned(), folder))
    }
}

/// The words of this command without those that say where it is computed.
fn own_words() -> Vec<String> {
    let mut words = Vec::new();
    let mut given = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
    while let Some(word) = given.next() {
        let own = OWN.iter().find(|(name, _)| word == *name);
        match own {
            Some((_, count)) => (1..*count).for_each(|_| drop(given.next())),
            None if OWN.iter().any(|(name, _)| name.len() > 2 && word.starts_with(&format!("{name}="))) => {}
            None => words.push(word),
        }
    }
    words
}

/// Whether a job waits or runs.
fn waits(job: &str) -> bool {
    let output = Command::new("squeue").args(["--noheader", "--jobs", job]).output();
    // One that is long over is unknown, which is an error.
    output.is_ok_and(|output| output.status.success() && !output.stdout.is_empty())
}
