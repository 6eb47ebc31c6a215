//! `pe-synth bench`: the same model and solver as native code on this computer, compared with the hardware.

use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;
use serde_json::{Value, json};

use crate::console;
use crate::messages::MessageFormat;
use crate::options::{MappingArgs, ModelArgs, PointArgs, positive};
use crate::output;
use crate::progress;
use pe_flow::failure::Failure;
use pe_flow::pipeline::{self, Design};
use pe_flow::report;
use pe_target::clock::{Clock, ClockSource};
use pe_verify::Scratch;
use pe_verify::native::{self, Measured, Measurement, Other, REPETITIONS};

/// Products of a repetition, at least: long beside the resolution of any clock.
const PRODUCTS: u64 = 50_000_000;

/// Runs the model as native code on this computer and compares its speed with that of the hardware
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth bench models/van_der_pol/van_der_pol.spec --pes 2
  pe-synth bench models/weibel11/weibel11.spec --pes 396 --span 20ms -o weibel11_bench.json
  pe-synth bench models/wave80/wave80.spec --pes 63 --against double=./wave80 --against single=./wave80f")]
pub struct Bench {
    #[command(flatten)]
    point: PointArgs,
    #[command(flatten)]
    mapping: MappingArgs,
    /// Writes the figures as JSON as well
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Clock of the hardware [default: 150, marked as assumed]
    #[arg(long, value_name = "MHZ", allow_hyphen_values = true, value_parser = positive, help_heading = "Output")]
    clock: Option<f64>,
    /// Steps per repetition [default: enough for a fraction of a second]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000_000), help_heading = "Output")]
    steps: Option<u64>,
    /// Also times a program of your own, called with STEPS REPETITIONS INPUTS; it must print what a generated one prints
    #[arg(long, value_name = "PRECISION=PROGRAM", value_parser = native::other, help_heading = "Output")]
    against: Vec<Other>,
    #[command(flatten)]
    model: ModelArgs,
}

impl Bench {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let quiet = self.message_format() == MessageFormat::Json;
        let point = self.point.point();
        let mut watch = progress::stopwatch(quiet, self.message_format());
        let loaded = self.model.load(&point, &progress::listener(true, self.message_format()))?;
        let model = &loaded.model;
        let design = pipeline::design(&loaded, &self.model.settings(&self.mapping), &point, &mut watch)?;
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
            || {
                let scratch = Scratch::new()?;
                native::measure(model, graph, &inputs, &reference, (&scratch.folder("bench")?, &self.against))
            },
            |result| match result {
                Ok(measurement) => format!("{} runs", measurement.runs.len()),
                Err(_) => "not measured".to_owned(),
            },
        );
        let measurement = match native {
            Ok(measurement) => measurement,
            Err(Failure::MissingTool(text)) if self.against.is_empty() => Measurement {
                runs: vec![own],
                work: None,
                kernel: format!("the loops of this program, in double precision on one core: {text}"),
            },
            Err(failure) => return Err(failure),
        };
        let pes = design.program.pes.len() as u32;
        let clock = ClockSource { given: self.clock, device: None }.of(&design.program.format, pes);
        let figures = figures(&design, model, clock, steps, &measurement);
        if let Some(path) = &self.output {
            output::write_file(path, format!("{figures:#}\n").as_bytes())?;
        }
        if quiet {
            console::out(&format!("{figures}\n"))
        } else {
            console::out(&table(&design, model, clock, steps, &measurement))
        }
    }
}

/// Runs the loops that the compiler itself uses; gives the states after the last step and the time of a step.
fn in_process(model: &Model, graph: &StepGraph, inputs: &[Vec<f64>]) -> Result<(Trajectory, Measured), Failure> {
    let mut reference = Trajectory::new(model.states.len());
    let mut fastest = f64::INFINITY;
    for _ in 0..REPETITIONS {
        let mut run = DoubleRun::new(graph);
        let clock = Instant::now();
        for inputs in inputs {
            let finite = run.step(inputs);
            finite
                .map_err(|_| Failure::Mismatch("the run is not finite beyond the span: try fewer `--steps`".into()))?;
        }
        fastest = fastest.min(clock.elapsed().as_secs_f64());
        reference = Trajectory::new(model.states.len());
        reference.push(|state| run.state(StateId::at(state)));
    }
    let seconds_per_step = fastest / inputs.len() as f64;
    let precision = "double".to_owned();
    Ok((reference, Measured { program: None, precision, cores: 1, seconds_per_step, error: 0.0, limits: None }))
}

/// Seconds that the hardware takes for a step.
fn hardware_step(design: &Design, clock: Clock) -> f64 {
    f64::from(design.program.period) / (clock.mhz * 1e6)
}

/// The generated program that a program of the user is compared with.
fn rival<'a>(runs: &'a [Measured], other: &Measured) -> Option<&'a Measured> {
    other.program.as_ref()?;
    runs.iter().find(|run| run.program.is_none() && run.cores == 1 && run.precision == other.precision)
}

fn figures(design: &Design, model: &Model, clock: Clock, steps: u64, measurement: &Measurement) -> Value {
    let hardware = hardware_step(design, clock);
    let run = |run: &Measured| {
        let reached = measurement.work.and_then(|work| run.reached(work));
        json!({
            "program": run.program,
            "precision": run.precision,
            "cores": run.cores,
            "us_per_step": run.seconds_per_step * 1e6,
            "ms_per_simulated_second": run.seconds_per_step * 1e3 / model.mean_step(),
            "ns_per_product": run.seconds_per_step * 1e9 / design.graph.macs() as f64,
            "error": run.error,
            "vector_bits": run.limits.map(|limits| limits.vector),
            "of_arithmetic": reached.map(|(arithmetic, _)| arithmetic),
            "of_memory": reached.map(|(_, memory)| memory),
            "peak_operations_per_s": run.limits.map(|limits| limits.operations),
            "peak_bytes_per_s": run.limits.map(|limits| limits.bytes),
            "generated_takes": rival(&measurement.runs, run).map(|own| own.seconds_per_step / run.seconds_per_step),
            "hardware_faster": run.seconds_per_step / hardware,
        })
    };
    let work = measurement.work.map(|work| {
        json!({
            "operations": work.operations,
            "numbers_moved": work.moved,
            "numbers_kept": work.kept,
            "products_in_loops": work.in_loops,
        })
    });
    json!({
        "model": model.name,
        "states": model.states.len(),
        "step_s": model.step,
        "solver": model.solver.name(),
        "products_per_step": design.graph.macs(),
        "computer": {
            "kernel": measurement.kernel,
            "steps": steps,
            "repetitions": REPETITIONS,
            "work": work,
            "runs": measurement.runs.iter().map(run).collect::<Vec<_>>(),
        },
        "hardware": {
            "pes": design.program.pes.len(),
            "multiplier": pipeline::multiplier_name(&design.program.format),
            "cycles_per_step": design.program.period,
            "clock": pe_flow::report::Clock::of(&clock),
            "us_per_step": hardware * 1e6,
            "ms_per_simulated_second": hardware * 1e3 / model.mean_step(),
            "word_length_error": design.judged.errors.word_length,
        },
    })
}

fn table(design: &Design, model: &Model, clock: Clock, steps: u64, measurement: &Measurement) -> String {
    let hardware = hardware_step(design, clock);
    let mut text =
        format!("  {:<36} {:>12} {:>20} {:>9} {:>10}\n", "", "us per step", "ms per simulated s", "error", "hardware");
    let mut line = |name: &str, seconds: f64, error: f64, factor: &str| {
        let (step, second) = (seconds * 1e6, seconds * 1e3 / model.mean_step());
        let _ = writeln!(text, "  {name:<36} {step:>12.3} {second:>20.3} {error:>9.1e} {factor:>10}");
    };
    let name = |run: &Measured| {
        let cores = if run.cores == 1 { "1 core".to_owned() } else { format!("{} cores", run.cores) };
        format!("{}, {}, {cores}", run.program.as_deref().unwrap_or("computer"), run.precision)
    };
    for run in &measurement.runs {
        let factor = format!("{:.2} x", run.seconds_per_step / hardware);
        line(&name(run), run.seconds_per_step, run.error, &factor);
    }
    let pes = design.program.pes.len();
    line(&format!("hardware, {pes} PEs"), hardware, design.judged.errors.word_length, "1");
    for run in &measurement.runs {
        if let (Some(limits), Some((arithmetic, memory))) =
            (run.limits, measurement.work.and_then(|work| run.reached(work)))
        {
            let (arithmetic, memory) = (arithmetic * 100.0, memory * 100.0);
            let (operations, bytes) = (limits.operations * 1e-9, limits.bytes * 1e-9);
            let limits = format!(
                "vectors of {} bits; {arithmetic:.0} % of the {operations:.0} G operations per s and {memory:.0} % of \
                 the {bytes:.0} GB per s that a core does at most",
                limits.vector
            );
            text += &report::table::row(&format!("{}, {}", run.precision, run.cores), &limits);
        }
        if let Some(own) = rival(&measurement.runs, run) {
            let takes = own.seconds_per_step / run.seconds_per_step;
            text += &report::table::row(&name(run), &format!("the generated program takes {takes:.2} of its time"));
        }
    }
    text += &report::table::row(
        "computer",
        &format!("{}; fastest of {REPETITIONS} runs of {steps} steps", measurement.kernel),
    );
    let name = pipeline::multiplier_name(&design.program.format);
    let cycles = design.program.period;
    text + &report::table::row("hardware", &format!("{cycles} cycles per step at {}, {name}", clock.words()))
}
