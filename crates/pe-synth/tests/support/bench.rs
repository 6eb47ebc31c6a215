//! Designs as files, run by the engines and compared with the simulator.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use pe_emit::EmitOptions;
use pe_flow::failure::Failure;
use pe_ir::program::Program;
use pe_verify::engines::{self, Bench, Engine, Job, Run};

use super::flow::Start;

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

/// Writes the files of a design.
pub fn emit(program: &Program, stimulus: &[Vec<i64>], folder: &Path) {
    let options = EmitOptions {
        command: "cargo test".into(),
        spec: program.model.clone(),
        version: "0".into(),
        stimulus: stimulus.to_vec(),
        default_steps: stimulus.len() as u32,
        ..EmitOptions::default()
    };
    for artefact in pe_emit::emit(program, &options) {
        let path = folder.join(&artefact.path);
        fs::create_dir_all(path.parent().expect("artefacts are in a folder")).expect("the test folder takes folders");
        fs::write(path, artefact.text).expect("the test folder takes files");
    }
}

/// Runs one engine on a program; a missing engine is a failure of the test that says what to install.
///
/// The folder with the design stays if the caller finds the run to be wrong and panics while holding it.
pub fn run(engine: Engine, program: &Program, stimulus: &[Vec<i64>], name: &str) -> (Run, Folder) {
    let folder = Folder::new(&format!("{name}-{}", engine.name()));
    let files = folder.sub("design");
    emit(program, stimulus, &files);
    let scratch = folder.sub("scratch");
    let design = pe_emit::design_name(program);
    let job = Job { steps: stimulus.len() as u64, words: &[], stimulus: None, control: None };
    let ran = Bench::new(&files, &design, &scratch).and_then(|mut bench| bench.run(engine, &job));
    match ran {
        Ok(run) => (run, folder),
        Err(Failure::MissingTool(text)) => panic!("{text}"),
        Err(failure) => panic!("{name}: {failure:?}"),
    }
}

/// Asserts that engines print for a start what the simulator computes, and that nearly all words change.
pub fn assert_agreement(label: &str, start: &Start, engines: &[Engine]) -> Agreement {
    assert_lively_agreement(label, start, engines, LIVELINESS)
}

/// The same where so large a part of the words changes.
pub fn assert_lively_agreement(label: &str, start: &Start, engines: &[Engine], part: f64) -> Agreement {
    let steps = start.stimulus.len() as u64;
    let label = format!("{label}, from the {}", start.name);
    let expected = engines::simulate(&start.program, &start.stimulus, steps);
    let liveliness = engines::liveliness(&expected);
    assert!(liveliness >= part, "{label}: only {:.1} % of the words change", 100.0 * liveliness);
    let writes = start.program.writes_per_step() * steps;
    let mut agreement = Agreement::default();
    for engine in engines {
        let clock = Instant::now();
        let (run, _folder) = run(*engine, &start.program, &start.stimulus, &label);
        engines::compare(&start.program, engine.name(), &run, &expected, writes)
            .unwrap_or_else(|difference| panic!("{label}: {difference}"));
        assert!(!run.trace.is_empty() && !run.outputs.is_empty(), "{label}: nothing was compared");
        agreement += Agreement {
            runs: 1,
            writes: run.trace.len() as u64,
            outputs: run.outputs.len() as u64,
            seconds: clock.elapsed().as_secs_f64(),
        };
    }
    agreement
}
