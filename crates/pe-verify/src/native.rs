//! Programs for this computer: builds those that are generated, times them and others, and finds what limits them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_sim::error::Trajectory;
use pe_sim::native::{self, Work};

use crate::child::execute;
use pe_flow::failure::Failure;

/// Rounds in which all programs run in turn: what else the computer does then meets all of them.
const ROUNDS: usize = 5;

/// Repetitions of a program in a round.
const REPEATS: usize = 4;

/// Repetitions of which the fastest counts: other work on the computer only ever adds.
pub const REPETITIONS: usize = ROUNDS * REPEATS;

/// Products of a step from which on all cores are tried: below, waiting for each other takes longer than the work.
const WORTH_ALL_CORES: u64 = 10_000;

/// A precision, the type that the program computes with, and its bytes.
const PRECISIONS: [(&str, &str, f64); 2] = [("double", "f64", 8.0), ("single", "f32", 4.0)];

/// How a program ran on this computer.
#[derive(Clone, Debug)]
pub struct Measured {
    /// What it is called; none for what is generated.
    pub program: Option<String>,
    /// `double` or `single`.
    pub precision: String,
    /// Cores that it uses.
    pub cores: usize,
    /// Fastest of the repetitions.
    pub seconds_per_step: f64,
    /// Largest deviation of a state from our run in double precision, relative to its largest magnitude.
    pub error: f64,
    /// What a generated program could do at most on one core.
    pub limits: Option<Limits>,
}

/// What one core does at most, measured, and bits of the widest vectors that the loops use.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Additions and multiplications per second.
    pub operations: f64,
    /// Bytes per second loaded and stored, of as many as the step uses.
    pub bytes: f64,
    /// Bytes of a number.
    pub number: f64,
    /// Bits of a vector.
    pub vector: u32,
}

/// What was measured.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// All programs.
    pub runs: Vec<Measured>,
    /// What a step of the generated program does; none if it could not be built.
    pub work: Option<Work>,
    /// What ran.
    pub kernel: String,
}

/// A program of the user's: what it is called, its precision, and where it is.
#[derive(Clone, Debug)]
pub struct Other {
    precision: String,
    program: PathBuf,
}

/// Reads `PRECISION=PROGRAM`.
///
/// # Errors
/// It is no precision, or no program is named.
pub fn other(text: &str) -> Result<Other, String> {
    match text.split_once('=') {
        Some((precision, program)) if PRECISIONS.iter().any(|(name, ..)| *name == precision) && !program.is_empty() => {
            // A bare name would be looked for in the search path.
            Ok(Other { precision: precision.to_owned(), program: Path::new(".").join(program) })
        }
        _ => Err("write `double=PROGRAM` or `single=PROGRAM`".to_owned()),
    }
}

/// A program with its arguments.
struct Entry {
    measured: Measured,
    command: PathBuf,
    arguments: Vec<String>,
    tables: Option<PathBuf>,
}

/// Builds the model as programs, runs them and those of the user, in turn.
///
/// # Errors
/// No compiler, a program that does not run, or one that computes something else.
pub fn measure(
    model: &Model,
    graph: &StepGraph,
    inputs: &[Vec<f64>],
    reference: &Trajectory,
    (folder, others): (&Path, &[Other]),
) -> Result<Measurement, Failure> {
    let install = "install Rust from https://rustup.rs";
    let version = execute(Command::new("rustc").arg("--version"), "rustc", install)?;
    let program = native::program(model, graph);
    let (input_file, tables) = (folder.join("inputs.txt"), folder.join("tables"));
    let line = |numbers: &Vec<f64>| numbers.iter().map(|n| format!("{n:e}")).collect::<Vec<_>>().join(" ") + "\n";
    write(&input_file, inputs.iter().map(line).collect::<String>().as_bytes())?;
    write(&tables, &program.tables)?;
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let mut entries = Vec::new();
    for (precision, number, bytes) in PRECISIONS {
        for (width, option) in widths() {
            let command = folder.join(format!("{precision}{width}"));
            let vector = build(&command, &program.source, (number, option), install)?;
            let limits = limits(&command, program.work, (bytes, vector))?;
            let all = (cores > 1 && graph.macs() >= WORTH_ALL_CORES).then_some(cores);
            for threads in std::iter::once(1).chain(all) {
                entries.push(Entry {
                    measured: measured(None, precision, threads, Some(limits)),
                    command: command.clone(),
                    arguments: vec![threads.to_string()],
                    tables: Some(tables.clone()),
                });
            }
        }
    }
    for Other { precision, program } in others {
        let name = program.file_name().map(|name| name.to_string_lossy().into_owned());
        let measured = measured(name, precision, 1, None);
        entries.push(Entry { measured, command: program.clone(), arguments: Vec::new(), tables: None });
    }
    for _ in 0..ROUNDS {
        for entry in &mut entries {
            let mut run = Command::new(&entry.command);
            run.args([inputs.len().to_string(), REPEATS.to_string()]).args(&entry.arguments).arg(&input_file);
            run.args(&entry.tables);
            let name = entry.command.display().to_string();
            let text = execute(&mut run, &name, "it has to be an executable file")?;
            let (seconds, states) = printed(&text).ok_or_else(|| {
                Failure::Mismatch(format!("{name} did not print {REPEATS} lines `seconds` and a line `state` for each"))
            })?;
            entry.measured.error = error_of(model, reference, &states, &name)?;
            let fastest = seconds.into_iter().fold(f64::INFINITY, f64::min) / inputs.len() as f64;
            entry.measured.seconds_per_step = fastest.min(entry.measured.seconds_per_step);
        }
    }
    let mut runs: Vec<Measured> = Vec::new();
    for run in entries.into_iter().map(|entry| entry.measured) {
        // Of several widths of vectors the one that is fastest here.
        let same = |other: &&mut Measured| {
            run.program.is_none()
                && (&other.program, &other.precision, other.cores) == (&run.program, &run.precision, run.cores)
        };
        match runs.iter_mut().find(same) {
            Some(other) if other.seconds_per_step <= run.seconds_per_step => {}
            Some(other) => *other = run,
            None => runs.push(run),
        }
    }
    let kernel = format!("Rust generated for the model, {}", version.trim());
    Ok(Measurement { runs, work: Some(program.work), kernel })
}

/// Widths of vectors that are worth a try, with the compiler's option: the widest ones that there are, and narrower
/// ones, which cross the lines of the cache less often.
fn widths() -> impl Iterator<Item = (&'static str, Option<&'static str>)> {
    #[cfg(target_arch = "x86_64")]
    let wide = std::is_x86_feature_detected!("avx512f");
    #[cfg(not(target_arch = "x86_64"))]
    let wide = false;
    std::iter::once(("", None)).chain(wide.then_some(("_256", Some("target-feature=+prefer-256-bit"))))
}

fn measured(program: Option<String>, precision: &str, cores: usize, limits: Option<Limits>) -> Measured {
    Measured { program, precision: precision.to_owned(), cores, seconds_per_step: f64::INFINITY, error: 0.0, limits }
}

fn write(path: &Path, text: &[u8]) -> Result<(), Failure> {
    fs::write(path, text).map_err(|error| Failure::file("write", path, error))
}

/// Builds a program; gives the bits of the widest vectors in its loops.
fn build(program: &Path, source: &str, (number, option): (&str, Option<&str>), install: &str) -> Result<u32, Failure> {
    let (text, assembly) = (program.with_extension("rs"), program.with_extension("s"));
    let head = "#![allow(warnings, clippy::all)]\n";
    let fixed = include_str!("../templates/native.rs");
    write(&text, format!("{head}type R = {number};\n{source}{fixed}").as_bytes())?;
    let mut build = Command::new("rustc");
    build.args(["--edition", "2021", "-C", "opt-level=3", "-C", "target-cpu=native"]);
    build.args(option.into_iter().flat_map(|option| ["-C", option]));
    // The compiler leaves parts of the assembly where it runs until they are complete.
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    build.arg(format!("--emit=link={},asm={}", name(program), name(&assembly)));
    build.current_dir(program.parent().unwrap_or(Path::new(".")));
    execute(build.arg(name(&text)), "rustc", install).map_err(|failure| match failure {
        Failure::Mismatch(text) if text.contains("linker") && text.contains("not found") => {
            Failure::MissingTool("a C linker is not installed: apt-get install gcc".into())
        }
        failure => failure,
    })?;
    let assembly = fs::read_to_string(&assembly).map_err(|error| Failure::file("read", &assembly, error))?;
    Ok(vector_bits(&assembly))
}

/// Bits of the widest vectors that arithmetic in the loops has; those of a number are none.
fn vector_bits(assembly: &str) -> u32 {
    let is_loop = |label: &str| {
        let digits = label.trim_start_matches('_').strip_prefix('b').and_then(|rest| rest.strip_suffix(':'));
        digits.is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()))
    };
    let (mut within, mut widest) = (false, 0);
    for line in assembly.lines() {
        if !line.starts_with(char::is_whitespace) && !line.starts_with('.') {
            within = is_loop(line);
        }
        let mut words = line.split_whitespace();
        let instruction = words.next().unwrap_or_default();
        if !within || !["add", "mul", "fma", "fml"].iter().any(|part| instruction.contains(part)) {
            continue;
        }
        let packed = instruction.ends_with("pd") || instruction.ends_with("ps");
        let bits = match line {
            _ if packed && line.contains("zmm") => 512,
            _ if packed && line.contains("ymm") => 256,
            _ if packed && line.contains("xmm") => 128,
            _ if line.contains(".2d") || line.contains(".4s") => 128,
            _ => 0,
        };
        widest = widest.max(bits);
    }
    widest
}

fn limits(program: &Path, work: Work, (number, vector): (f64, u32)) -> Result<Limits, Failure> {
    let mut run = Command::new(program);
    let text = execute(run.args(["peaks", &work.kept.to_string()]), "the native program", "it was just built")?;
    let rate = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.trim().parse::<f64>().ok());
        line.ok_or_else(|| Failure::Internal("a native program".into()))
    };
    Ok(Limits { operations: rate("operations")?, bytes: rate("moved")? * number, number, vector })
}

/// What a program printed: seconds of its repetitions, and states.
fn printed(text: &str) -> Option<(Vec<f64>, Vec<f64>)> {
    let (mut seconds, mut states) = (Vec::new(), Vec::new());
    for line in text.lines() {
        match line.split_once(' ')? {
            ("seconds", number) => seconds.push(number.parse().ok()?),
            ("state", bits) => states.push(f64::from_bits(u64::from_str_radix(bits, 16).ok()?)),
            _ => return None,
        }
    }
    (seconds.len() == REPEATS).then_some((seconds, states))
}

/// Error of the states relative to our own run; a program that computes something else is not a baseline.
fn error_of(model: &Model, reference: &Trajectory, states: &[f64], name: &str) -> Result<f64, Failure> {
    if states.len() != model.states.len() {
        return Err(Failure::Mismatch(format!("{name} printed {} states", states.len())));
    }
    let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
    let mut run = Trajectory::new(states.len());
    run.push(|state| states[state]);
    let run = run.turned(reference, &model.turns());
    let error = reference.deviation(&run).worst(&reference.scales(&quantities)).1;
    if error.is_finite() {
        return Ok(error);
    }
    let states_named = model.states.iter().zip(states);
    let lost = states_named.filter(|(_, value)| !value.is_finite()).map(|(state, _)| &state.name).next();
    Err(Failure::Mismatch(match lost {
        Some(state) => format!("`{state}` of {name} is not finite"),
        None => format!("the error of {name} is not finite"),
    }))
}

impl Measured {
    /// Parts of the limits of arithmetic and of memory that the cores together reach with this work.
    pub fn reached(&self, work: Work) -> Option<(f64, f64)> {
        let limits = self.limits?;
        let rate = |amount: u64| amount as f64 / self.seconds_per_step / self.cores as f64;
        Some((rate(work.operations) / limits.operations, rate(work.moved) * limits.number / limits.bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_those_of_arithmetic_in_loops() {
        let outside = "main:\n\tvaddpd\t%zmm0, %zmm1, %zmm1\n";
        let within = "b2:\n\tvmovupd\t(%rsi), %zmm6\n\tvfmadd231pd\t%ymm3, %ymm6, %ymm10\n";
        let single = "b3:\n\tvfmadd231sd\t%xmm3, %xmm6, %xmm10\n";
        assert_eq!(vector_bits(&format!("{outside}{within}{single}")), 256);
        assert_eq!(vector_bits(&format!("{outside}{single}")), 0);
        assert_eq!(vector_bits("_b0:\n\tfmla\tv0.2d, v1.2d, v2.2d\n"), 128);
    }

    #[test]
    fn a_program_of_the_user_has_a_precision() {
        assert_eq!(other("single=a/b").unwrap().program, Path::new("./a/b"));
        assert!(other("half=a").is_err() && other("single=").is_err() && other("a").is_err());
    }
}
