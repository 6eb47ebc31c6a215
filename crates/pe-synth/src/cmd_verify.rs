//! `pe-synth verify`: every engine against the simulator, bit for bit.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::console;
use crate::engines::Engine;
use crate::failure::{Failure, MessageFormat};
use crate::verify::{Options, judge};

/// Compares a compiled design in GHDL and as Rust reference with the simulator, bit for bit
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth verify out/weibel5
  pe-synth verify out/weibel11 --steps 2
  pe-synth verify out/weibel11 --steps 100 --engines verilator")]
pub struct Verify {
    /// Folder that `compile` wrote
    folder: PathBuf,
    /// Steps to run from each start, at most [default: as many as the reference trace has, and more where all must move]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Engines to compare with the simulator, in this order
    #[arg(long, value_name = "NAME", value_enum, value_delimiter = ',', default_value = "reference,ghdl")]
    engines: Vec<Engine>,
    /// Also runs the synthesised netlist in Verilator
    #[arg(long)]
    verilator: bool,
    /// Succeeds although files differ from the hashes in report.json, if the engines agree
    #[arg(long)]
    allow_changed: bool,
    /// Form of errors on standard error; `json` also prints runs and coverage as one object on standard output
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl Verify {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let mut engines = self.engines.clone();
        if self.verilator && !engines.contains(&Engine::Verilator) {
            engines.push(Engine::Verilator);
        }
        let options = Options { engines, steps: self.steps };
        let for_people = self.message_format == MessageFormat::Human;
        let mut say = |line: &str| {
            if for_people {
                console::out(line);
            }
        };
        let verdict = judge(&self.folder, &options, &mut say)?;
        if !for_people {
            console::out(&format!("{}\n", verdict.json()));
        }
        match verdict.changes.len() {
            0 => Ok(()),
            _ if self.allow_changed => Ok(()),
            changed => {
                let noun = if changed == 1 { "finding" } else { "findings" };
                Err(Failure::Mismatch(format!(
                    "the engines agree, but the folder is not what `compile` wrote: {changed} {noun} above; \
                     `--allow-changed` accepts that"
                )))
            }
        }
    }
}

/// A temporary folder that goes with the process.
pub(crate) struct Scratch {
    path: PathBuf,
}

impl Scratch {
    pub(crate) fn new() -> Result<Scratch, Failure> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("pe-synth-{}-{number}", std::process::id()));
        fs::create_dir_all(&path).map_err(|error| Failure::file("create", &path, error))?;
        Ok(Scratch { path })
    }

    /// A new, empty folder in it.
    pub(crate) fn folder(&self, name: &str) -> Result<PathBuf, Failure> {
        let path: &Path = &self.path.join(name.replace(' ', "-").to_lowercase());
        // What an earlier start left there would be taken for this one's.
        let _ = fs::remove_dir_all(path);
        fs::create_dir_all(path).map_err(|error| Failure::file("create", path, error))?;
        Ok(path.to_owned())
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path);
    }
}
