//! Designs as files, run by the engines and compared with the simulator.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use pe_emit::EmitOptions;
use pe_flow::failure::Failure;
use pe_ir::program::Program;
use pe_verify::engines::{self, Bench, Engine, Job, Run};
use pe_verify::package;

use super::flow::Start;
use super::is_long_suite;

/// Least share of words that must be neither zero nor what stood there before; otherwise a comparison proves little.
const LIVELINESS: f64 = 0.9;

/// A folder of its own below cargo's folder for tests, empty at first and removed when a test has passed.
pub struct Folder(pub PathBuf);

impl Folder {
    /// The folder of a test or design; `name` must be unique among all tests of a file.
    pub fn new(name: &str) -> Folder {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        // Test files run one after another, but two people may run them at the same time.
        let name = format!("{}-{}", name.chars().map(plain).collect::<String>(), std::process::id());
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).expect("cargo's test folder takes folders");
        Folder(path)
    }

    /// A new folder in it.
    pub fn sub(&self, name: &str) -> PathBuf {
        let path = self.0.join(name);
        fs::create_dir_all(&path).expect("the test folder takes folders");
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let _ = fs::remove_dir_all(&self.0);
        }
    }
}

/// What was found equal.
#[derive(Clone, Copy, Debug, Default)]
pub struct Agreement {
    pub runs: u64,
    pub writes: u64,
    pub outputs: u64,
    /// Seconds in all engines.
    pub seconds: f64,
}

impl std::ops::AddAssign for Agreement {
    fn add_assign(&mut self, other: Agreement) {
        self.runs += other.runs;
        self.writes += other.writes;
        self.outputs += other.outputs;
        self.seconds += other.seconds;
    }
}

/// A design as files and what engines have built of them.
struct Built {
    program: Program,
    bench: Bench<'static>,
    /// Stays if the caller finds a run to be wrong and panics while holding it.
    folder: Folder,
}

impl Built {
    fn new(program: &Program, stimulus: &[Vec<i64>], name: &str) -> Built {
        let folder = Folder::new(name);
        let (files, scratch) = (folder.sub("design"), folder.sub("scratch"));
        emit(program, stimulus, &files);
        let bench = Bench::new(&files, &pe_emit::design_name(program), &scratch);
        let bench = bench.unwrap_or_else(|failure| panic!("{name}: {failure:?}"));
        Built { program: program.clone(), bench, folder }
    }

    /// Whether the other program differs from this one's in nothing but initial words, which engines take as they
    /// start.
    fn starts(&self, other: &Program) -> bool {
        let mut program = self.program.clone();
        for (pe, other) in program.pes.iter_mut().zip(&other.pes) {
            pe.own_image.clone_from(&other.own_image);
            pe.base_image.clone_from(&other.base_image);
            pe.imported_image.clone_from(&other.imported_image);
        }
        program == *other
    }

    /// Runs one engine; a missing engine is a failure of the test that says what to install.
    fn run(&mut self, engine: Engine, program: &Program, stimulus: &[Vec<i64>]) -> Run {
        let words = package::differences(&self.program, program);
        let files = pe_emit::emit(program, &options(program, stimulus));
        let lines = files.iter().find(|file| file.path.ends_with("_stimulus.txt")).expect("a design has a stimulus");
        let steps = stimulus.len() as u64;
        match self.bench.run(engine, &Job { steps, words: &words, stimulus: Some(&lines.text), control: None }) {
            Ok(run) => run,
            Err(Failure::MissingTool(text)) => panic!("{text}"),
            Err(failure) => panic!("{}: {failure:?}", self.folder.0.display()),
        }
    }
}

fn options(program: &Program, stimulus: &[Vec<i64>]) -> EmitOptions {
    EmitOptions {
        command: "cargo test".into(),
        spec: program.model.clone(),
        version: "0".into(),
        stimulus: stimulus.to_vec(),
        default_steps: stimulus.len() as u32,
        ..EmitOptions::default()
    }
}

/// Writes the files of a design.
pub fn emit(program: &Program, stimulus: &[Vec<i64>], folder: &Path) {
    for artefact in pe_emit::emit(program, &options(program, stimulus)) {
        let path = folder.join(&artefact.path);
        fs::create_dir_all(path.parent().expect("artefacts are in a folder")).expect("the test folder takes folders");
        fs::write(path, artefact.text).expect("the test folder takes files");
    }
}

/// Runs one engine on a program; the folder with the design stays if the caller panics while holding it.
pub fn run(engine: Engine, program: &Program, stimulus: &[Vec<i64>], name: &str) -> (Run, Folder) {
    let mut built = Built::new(program, stimulus, &format!("{name}-{}", engine.name()));
    (built.run(engine, program, stimulus), built.folder)
}

/// Asserts that engines print for all starts of a design what the simulator computes, and that nearly all words change.
pub fn assert_agreement(label: &str, starts: &[Start], engines: &[Engine]) -> Agreement {
    assert_lively_agreement(label, starts, engines, LIVELINESS)
}

/// The same where so large a part of the words changes. Starts that differ in words alone share what engines build. GHDL, which
/// takes most of the time, has one of the starts, by the words that the design writes, but all in the long suite.
pub fn assert_lively_agreement(label: &str, starts: &[Start], engines: &[Engine], part: f64) -> Agreement {
    let mut agreement = Agreement::default();
    let mut last: Option<Built> = None;
    for (number, start) in (0..).zip(starts) {
        let in_ghdl = is_long_suite() || number == start.program.writes_per_step() % starts.len() as u64;
        let steps = start.stimulus.len() as u64;
        let label = format!("{label}, from the {}", start.name);
        let expected = engines::simulate(&start.program, &start.stimulus, steps);
        let liveliness = engines::liveliness(&expected);
        assert!(liveliness >= part, "{label}: only {:.1} % of the words change", 100.0 * liveliness);
        let writes = start.program.writes_per_step() * steps;
        let built = last.take().filter(|built| built.starts(&start.program));
        let mut built = built.unwrap_or_else(|| Built::new(&start.program, &start.stimulus, &label));
        for engine in engines {
            if *engine == Engine::Ghdl && !in_ghdl {
                continue;
            }
            let clock = Instant::now();
            let run = built.run(*engine, &start.program, &start.stimulus);
            engine
                .compare(&start.program, &run, &expected, writes)
                .unwrap_or_else(|difference| panic!("{label}: {difference}"));
            assert!(
                !run.trace.is_empty() | !run.states.is_empty() && !run.outputs.is_empty(),
                "{label}: nothing was compared"
            );
            agreement += Agreement {
                runs: 1,
                writes: run.trace.len() as u64,
                outputs: run.outputs.len() as u64,
                seconds: clock.elapsed().as_secs_f64(),
            };
        }
        last = Some(built);
    }
    agreement
}
