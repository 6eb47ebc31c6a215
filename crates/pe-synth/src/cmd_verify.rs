//! `pe-synth verify`: every engine against the simulator, bit for bit.

use std::fs;
use std::path::{Path, PathBuf};

use pe_emit::EmitOptions;
use pe_ir::program::Program;

use crate::console;
use crate::engines::{self, Bench, Engine, compare, liveliness, simulate};
use crate::failure::{Failure, MessageFormat};

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
    /// Steps to run from each start [default: as many as the reference trace has]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Engines to compare with the simulator, in this order
    #[arg(long, value_name = "NAME", value_enum, value_delimiter = ',', default_value = "reference,ghdl")]
    engines: Vec<Engine>,
    /// Also runs the synthesised netlist in Verilator
    #[arg(long)]
    verilator: bool,
    /// Form of errors and warnings on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

/// Where a compared run starts.
struct Start {
    name: String,
    program: Program,
    stimulus: Vec<Vec<i64>>,
    /// Folder with the files of this start.
    folder: PathBuf,
}

impl Verify {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let scratch = Scratch::new()?;
        let design = self.design()?;
        let program = self.program(&design)?;
        let beginning = Start {
            name: "the beginning".into(),
            stimulus: self.stimulus(&design, "stimulus", &program)?,
            folder: self.folder.clone(),
            program,
        };
        let recorded = self.recorded(&design, &beginning)?;
        let steps = self.steps.unwrap_or(recorded);
        let middle = self.middle(&design, &beginning.program, &scratch)?;
        for start in [beginning, middle] {
            self.compare(&design, &start, &scratch, steps)?;
        }
        Ok(())
    }

    /// Compares the design's reference trace with the simulator; returns the number of its steps.
    fn recorded(&self, design: &str, start: &Start) -> Result<u64, Failure> {
        let (trace, outputs) = (format!("{design}_trace.txt"), format!("{design}_outputs.txt"));
        let recorded = engines::recorded(&self.read(&trace)?, &self.read(&outputs)?)
            .ok_or_else(|| Failure::file("read", &self.folder.join(trace), "it is damaged"))?;
        let steps = recorded.trace.len() as u64 / start.program.writes_per_step().max(1);
        engines::compare_recorded(&start.program, &recorded, steps, &start.stimulus).map_err(Failure::Mismatch)?;
        console::out(&format!(
            "reference trace = simulator: {} memory writes equal, {steps} steps\n",
            recorded.trace.len()
        ));
        Ok(steps)
    }

    fn compare(&self, design: &str, start: &Start, scratch: &Scratch, steps: u64) -> Result<(), Failure> {
        let expected = simulate(&start.program, &start.stimulus, steps);
        let writes = start.program.writes_per_step() * steps;
        let mut engines = self.engines.clone();
        if self.verilator && !engines.contains(&Engine::Verilator) {
            engines.push(Engine::Verilator);
        }
        for engine in engines {
            let work = scratch.folder(engine.name())?;
            let bench = Bench { folder: &start.folder, design, scratch: &work, steps };
            let run = bench.run(engine)?;
            compare(&start.program, engine.name(), &run, &expected, writes).map_err(Failure::Mismatch)?;
            // A single step has no other one to count clocks to.
            let clocks = if steps < 2 { String::new() } else { format!(", {} clocks per step", run.clocks) };
            console::out(&format!(
                "{:>14} = simulator from {}: {} memory writes and {} outputs equal, {steps} steps{clocks}\n",
                engine.name(),
                start.name,
                run.trace.len(),
                run.outputs.len(),
            ));
        }
        let live = 100.0 * liveliness(&expected);
        console::out(&format!("{:>14}   {live:.1} % of the words are not zero and changing\n", ""));
        Ok(())
    }

    /// The design's name: that of its program file.
    fn design(&self) -> Result<String, Failure> {
        let entries = fs::read_dir(&self.folder).map_err(|error| Failure::file("read", &self.folder, error))?;
        let mut names: Vec<String> = entries
            .filter_map(|entry| Some(entry.ok()?.file_name().to_str()?.strip_suffix("_program.txt")?.to_owned()))
            .collect();
        names.sort();
        names.pop().ok_or_else(|| {
            Failure::file("verify", &self.folder, "it holds no `*_program.txt`; run `pe-synth compile` first")
        })
    }

    fn read(&self, file: &str) -> Result<String, Failure> {
        let path = self.folder.join(file);
        fs::read_to_string(&path).map_err(|error| Failure::file("read", &path, error))
    }

    fn program(&self, design: &str) -> Result<Program, Failure> {
        let file = format!("{design}_program.txt");
        self.read(&file)?.parse().map_err(|error| Failure::file("read", &self.folder.join(file), error))
    }

    fn stimulus(&self, design: &str, kind: &str, program: &Program) -> Result<Vec<Vec<i64>>, Failure> {
        let file = format!("{design}_{kind}.txt");
        let bits = program.format.storage_bits;
        let word = |field: &str| {
            let word = u64::from_str_radix(field, 16).ok()?;
            Some(((word << (64 - bits)) as i64) >> (64 - bits))
        };
        let line = |line: &str| line.split_ascii_whitespace().map(word).collect::<Option<Vec<i64>>>();
        self.read(&file)?
            .lines()
            .map(line)
            .collect::<Option<Vec<_>>>()
            .ok_or_else(|| Failure::file("read", &self.folder.join(file), "it holds something else than hex words"))
    }

    /// The same design with images that start it in the middle of its span.
    fn middle(&self, design: &str, program: &Program, scratch: &Scratch) -> Result<Start, Failure> {
        let file = format!("{design}_checkpoint.txt");
        let text = self.read(&file)?;
        let damaged = || Failure::file("read", &self.folder.join(&file), "it is damaged");
        let (first, words) = text.split_once('\n').ok_or_else(damaged)?;
        let words: Vec<i64> = words
            .lines()
            .map(|line| u64::from_str_radix(line, 16).map(|word| word as i64).map_err(|_| damaged()))
            .collect::<Result<_, _>>()?;
        if words.len() != program.states.len() {
            return Err(damaged());
        }
        let mut program = program.clone();
        for (state, word) in program.states.iter().zip(&words) {
            state.set(&mut program.pes, &program.format, *word);
        }
        let step = first.strip_prefix("step ").and_then(|step| step.parse().ok()).ok_or_else(damaged)?;
        program.start_ticks(step);
        let stimulus = self.stimulus(design, "checkpoint_stimulus", &program)?;
        let options = EmitOptions {
            command: "pe-synth verify".into(),
            spec: program.model.clone(),
            version: env!("CARGO_PKG_VERSION").into(),
            stimulus: stimulus.clone(),
            default_steps: stimulus.len() as u32,
        };
        let folder = scratch.folder("middle")?;
        for artefact in pe_emit::emit(&program, &options) {
            let path = folder.join(&artefact.path);
            if let Some(parent) = path.parent() {
                fs::create_dir_all(parent).map_err(|error| Failure::file("create", parent, error))?;
            }
            fs::write(&path, artefact.text).map_err(|error| Failure::file("write", &path, error))?;
        }
        Ok(Start { name: first.to_owned(), program, stimulus, folder })
    }
}

/// A temporary folder that goes with the process.
pub(crate) struct Scratch {
    path: PathBuf,
}

impl Scratch {
    pub(crate) fn new() -> Result<Scratch, Failure> {
        let path = std::env::temp_dir().join(format!("pe-synth-{}", std::process::id()));
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
