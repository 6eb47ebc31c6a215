//! `pe-synth bench`: the same model and solver as native code on this computer, beside the hardware's figures.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;
use pe_sim::native;
use serde_json::{Value, json};

use crate::clock::{Clock, ClockSource};
use crate::cmd_compile::positive;
use crate::cmd_verify::Scratch;
use crate::console;
use crate::engines::execute;
use crate::failure::{Failure, MessageFormat};
use crate::options::{DesignPoint, ModelOptions};
use crate::pipeline::{self, Design, MappingOptions, Stopwatch};
use crate::report;

/// Products of a repetition, at least: long beside the resolution of any clock.
const PRODUCTS: u64 = 200_000_000;

/// Products of a step from which on all cores are tried: below, waiting for each other takes longer than the work.
const WORTH_ALL_CORES: u64 = 10_000;

/// Repetitions of which the median counts.
const REPEATS: usize = 5;

/// Runs the model as native code on this computer and compares its speed with the hardware's
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth bench models/van_der_pol/van_der_pol.spec --pes 2
  pe-synth bench models/weibel11/weibel11.spec --pes 396 --span 20ms -o weibel11_bench.json")]
pub struct Bench {
    #[command(flatten)]
    point: DesignPoint,
    #[command(flatten)]
    mapping: MappingOptions,
    /// Writes the figures as JSON as well
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Clock of the hardware [default: 150, marked as assumed]
    #[arg(long, value_name = "MHZ", value_parser = positive, help_heading = "Output")]
    clock: Option<f64>,
    /// Steps of a repetition [default: as many as take a fraction of a second]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000_000), help_heading = "Output")]
    steps: Option<u64>,
    #[command(flatten)]
    model: ModelOptions,
}

/// How the model ran on this computer.
struct Measured {
    precision: &'static str,
    cores: usize,
    /// Median of the repetitions.
    seconds_per_step: f64,
    /// Largest deviation of a state from our run in double precision, relative to its largest magnitude.
    error: f64,
}

/// A precision and the type that the program computes with.
const PRECISIONS: [(&str, &str); 2] = [("double", "f64"), ("single", "f32")];

impl Bench {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let quiet = self.message_format() == MessageFormat::Json;
        let mut watch = Stopwatch::new(quiet);
        let loaded = self.model.load(&self.point)?;
        let model = &loaded.model;
        let design = pipeline::design(&loaded, &self.model, &self.point, &self.mapping, &mut watch)?;
        let graph = &design.graph;
        let steps = self.steps.unwrap_or((PRODUCTS / graph.macs().max(1)).clamp(10, 1_000_000));
        let inputs: Vec<Vec<f64>> = (0..steps).map(|step| model.sample_inputs(model.time(step, 0.0))).collect();
        let (reference, own) = watch.stage(
            "in process",
            || in_process(model, graph, &inputs),
            |result| result.as_ref().map_or("failed".into(), |(_, own)| format!("{:.3e} s", own.seconds_per_step)),
        )?;
        let native = watch.stage(
            "native",
            || natively(model, graph, &inputs, &reference),
            |result| match result {
                Ok((runs, _)) => format!("{} runs", runs.len()),
                Err(_) => "not measured".to_owned(),
            },
        );
        let (runs, kernel) = match native {
            Ok((runs, compiler)) => (runs, format!("Rust generated for the model, {compiler}")),
            Err(Failure::MissingTool(text)) => {
                (vec![own], format!("the loops of this program, in double precision on one core: {text}"))
            }
            Err(failure) => return Err(failure),
        };
        let pes = design.program.pes.len() as u32;
        let clock = ClockSource { given: self.clock, device: None }.of(&design.program.format, pes);
        let figures = figures(&design, model, clock, (&kernel, steps), &runs);
        if let Some(path) = &self.output {
            fs::write(path, format!("{figures:#}\n")).map_err(|error| Failure::file("write", path, error))?;
        }
        if quiet {
            console::out(&format!("{figures}\n"));
        } else {
            console::out(&table(&design, model, clock, (&kernel, steps), &runs));
        }
        Ok(())
    }
}

/// Runs the loops that the compiler itself uses; gives the states after the last step and the time of a step.
fn in_process(model: &Model, graph: &StepGraph, inputs: &[Vec<f64>]) -> Result<(Trajectory, Measured), Failure> {
    let mut reference = Trajectory::new(model.states.len());
    let mut seconds = Vec::new();
    for _ in 0..=REPEATS {
        let mut run = DoubleRun::new(graph);
        let clock = Instant::now();
        for inputs in inputs {
            let finite = run.step(inputs);
            finite
                .map_err(|_| Failure::Mismatch("the run is not finite beyond the span: try fewer `--steps`".into()))?;
        }
        seconds.push(clock.elapsed().as_secs_f64());
        reference = Trajectory::new(model.states.len());
        reference.push(|state| run.state(state));
    }
    let seconds_per_step = median(&mut seconds[1..]) / inputs.len() as f64;
    Ok((reference, Measured { precision: "double", cores: 1, seconds_per_step, error: 0.0 }))
}

fn median(numbers: &mut [f64]) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}

/// Builds the model as Rust programs and runs them; also gives the compiler's version.
fn natively(
    model: &Model,
    graph: &StepGraph,
    inputs: &[Vec<f64>],
    reference: &Trajectory,
) -> Result<(Vec<Measured>, String), Failure> {
    let install = "install Rust from https://rustup.rs";
    let version = execute(Command::new("rustc").arg("--version"), "rustc", install)?;
    let scratch = Scratch::new()?;
    let folder = scratch.folder("bench")?;
    let write = |path: &Path, text: &str| fs::write(path, text).map_err(|error| Failure::file("write", path, error));
    let input_file = folder.join("inputs.txt");
    let line = |numbers: &Vec<f64>| numbers.iter().map(|n| format!("{n:e}")).collect::<Vec<_>>().join(" ") + "\n";
    write(&input_file, &inputs.iter().map(line).collect::<String>())?;
    let loops = native::loops(graph);
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let mut runs = Vec::new();
    for (precision, number) in PRECISIONS {
        let (source, program) = (folder.join(format!("{precision}.rs")), folder.join(precision));
        let head = "#![allow(overflowing_literals, unused_unsafe, dead_code, clippy::all)]\n";
        write(&source, &format!("{head}type R = {number};\n{loops}{}", include_str!("../../../templates/native.rs")))?;
        let mut build = Command::new("rustc");
        build.args(["--edition", "2021", "-C", "opt-level=3", "-C", "target-cpu=native", "-o"]);
        execute(build.arg(&program).arg(&source), "rustc", install).map_err(|failure| match failure {
            Failure::Mismatch(text) if text.contains("linker") && text.contains("not found") => {
                Failure::MissingTool("a C linker is not installed: apt-get install gcc".into())
            }
            failure => failure,
        })?;
        let all = (cores > 1 && graph.macs() >= WORTH_ALL_CORES).then_some(cores);
        for threads in std::iter::once(1).chain(all) {
            let mut run = Command::new(&program);
            run.args([inputs.len().to_string(), REPEATS.to_string(), threads.to_string()]).arg(&input_file);
            let text = execute(&mut run, "the native program", "it was just built")?;
            let (mut seconds, states) = printed(&text).ok_or_else(|| Failure::Internal("a native program".into()))?;
            let error = error_of(model, reference, &states)?;
            let seconds_per_step = median(&mut seconds) / inputs.len() as f64;
            runs.push(Measured { precision, cores: threads, seconds_per_step, error });
        }
    }
    Ok((runs, version.trim().to_owned()))
}

/// What a native program printed: seconds of its repetitions, and states.
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
fn error_of(model: &Model, reference: &Trajectory, states: &[f64]) -> Result<f64, Failure> {
    if states.len() != model.states.len() {
        return Err(Failure::Mismatch(format!("the native program printed {} states", states.len())));
    }
    let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
    let mut run = Trajectory::new(states.len());
    run.push(|state| states[state]);
    let error = reference.deviation(&run).worst(&reference.scales(&quantities)).1;
    if error.is_finite() { Ok(error) } else { Err(Failure::Mismatch("the native program is not finite".into())) }
}

/// Seconds that the hardware takes for a step.
fn hardware_step(design: &Design, clock: Clock) -> f64 {
    f64::from(design.program.period) / (clock.mhz * 1e6)
}

fn figures(design: &Design, model: &Model, clock: Clock, (kernel, steps): (&str, u64), runs: &[Measured]) -> Value {
    let hardware = hardware_step(design, clock);
    let run = |run: &Measured| {
        json!({
            "precision": run.precision,
            "cores": run.cores,
            "us_per_step": run.seconds_per_step * 1e6,
            "ms_per_simulated_second": run.seconds_per_step * 1e3 / model.mean_step(),
            "ns_per_product": run.seconds_per_step * 1e9 / design.graph.macs() as f64,
            "error": run.error,
            "hardware_faster": run.seconds_per_step / hardware,
        })
    };
    json!({
        "model": model.name,
        "states": model.states.len(),
        "step_s": model.step,
        "solver": model.solver.name(),
        "products_per_step": design.graph.macs(),
        "computer": {
            "kernel": kernel,
            "steps": steps,
            "repetitions": REPEATS,
            "runs": runs.iter().map(run).collect::<Vec<_>>(),
        },
        "hardware": {
            "pes": design.program.pes.len(),
            "multiplier": pipeline::multiplier_name(&design.program.format),
            "cycles_per_step": design.program.period,
            "clock": clock.report(),
            "us_per_step": hardware * 1e6,
            "ms_per_simulated_second": hardware * 1e3 / model.mean_step(),
            "word_length_error": design.judged.errors.word_length,
        },
    })
}

fn table(design: &Design, model: &Model, clock: Clock, (kernel, steps): (&str, u64), runs: &[Measured]) -> String {
    let hardware = hardware_step(design, clock);
    let mut text =
        format!("  {:<30} {:>12} {:>20} {:>9} {:>10}\n", "", "us per step", "ms per simulated s", "error", "hardware");
    let mut line = |name: &str, seconds: f64, error: f64, factor: &str| {
        let (step, second) = (seconds * 1e6, seconds * 1e3 / model.mean_step());
        let _ = writeln!(text, "  {name:<30} {step:>12.3} {second:>20.3} {error:>9.1e} {factor:>10}");
    };
    for run in runs {
        let cores = if run.cores == 1 { "1 core".to_owned() } else { format!("{} cores", run.cores) };
        let factor = format!("{:.2} x", run.seconds_per_step / hardware);
        line(&format!("computer, {}, {cores}", run.precision), run.seconds_per_step, run.error, &factor);
    }
    let pes = design.program.pes.len();
    line(&format!("hardware, {pes} PEs"), hardware, design.judged.errors.word_length, "1");
    text += &report::row("computer", &format!("{kernel}; median of {REPEATS} runs of {steps} steps"));
    let name = pipeline::multiplier_name(&design.program.format);
    let cycles = design.program.period;
    text + &report::row("hardware", &format!("{cycles} cycles per step at {}, {name}", clock.words()))
}
