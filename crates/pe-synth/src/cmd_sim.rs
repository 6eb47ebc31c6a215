//! `pe-synth sim`: outputs over time, from the cycle-accurate simulator or in double precision.

use std::path::PathBuf;

use pe_ir::codes;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;
use pe_sim::machine::Machine;

use crate::console;
use crate::messages::MessageFormat;
use crate::options::{MappingArgs, ModelArgs, PointArgs};
use crate::output;
use crate::progress;
use crate::rerun::{self, WatchArgs};
use crate::waveforms;
use pe_flow::failure::Failure;
use pe_flow::pipeline;
use pe_flow::spec::LoadedModel;
use pe_flow::watch::Stopwatch;

/// Simulates the outputs over the span and writes them as CSV, or as VCD for waveform viewers
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth sim models/lorenz/lorenz.spec -o lorenz.csv
  pe-synth sim models/lorenz/lorenz.spec -o lorenz.vcd
  pe-synth sim models/lorenz/lorenz.spec --double --span 2s | head")]
pub struct Sim {
    #[command(flatten)]
    point: PointArgs,
    #[command(flatten)]
    mapping: MappingArgs,
    /// File, VCD if its name ends in `.vcd`, otherwise CSV [default: CSV on standard output]
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Runs the model in double precision instead of the hardware's fixed point
    #[arg(long, help_heading = "Numbers")]
    double: bool,
    #[command(flatten)]
    again: WatchArgs,
    #[command(flatten)]
    model: ModelArgs,
}

impl Sim {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        if self.again.watch {
            return rerun::watch(&self.model, &self.mapping);
        }
        let loaded = self.model.load(&self.point.point(), &progress::listener(true, self.message_format()))?;
        let rows = if self.double { self.double_rows(&loaded)? } else { self.machine_rows(&loaded)? };
        let is_vcd = self.output.as_ref().and_then(|path| path.extension()).is_some_and(|end| end == "vcd");
        let trace = if is_vcd { vcd(&loaded.model, &rows)? } else { csv(&loaded.model, &rows).into_bytes() };
        match &self.output {
            Some(path) => output::write_file(path, &trace),
            None => console::out(&String::from_utf8_lossy(&trace)),
        }
    }

    fn double_rows(&self, loaded: &LoadedModel) -> Result<Vec<Vec<f64>>, Failure> {
        let model = &loaded.model;
        let graph = pipeline::build(loaded, &self.point.point(), &self.mapping.options(), &mut Stopwatch::silent())?;
        let mut run = DoubleRun::new(&graph);
        let mut rows = vec![first_row(model)];
        for step in 0..model.steps() {
            let time = model.time(step, 0.0);
            run.step(&model.sample_inputs(time)).map_err(|diverged| {
                let message =
                    format!("`{}` is no longer a finite number at t = {time:.6e} s", graph.value_name(diverged.value));
                let finding = Diagnostic::global(codes::DIVERGED, message).with_help("try a smaller `--step`");
                Failure::Spec(vec![finding], loaded.sources.clone())
            })?;
            rows.push((0..model.outputs.len()).map(|output| run.output(output)).collect());
        }
        Ok(rows)
    }

    fn machine_rows(&self, loaded: &LoadedModel) -> Result<Vec<Vec<f64>>, Failure> {
        let model = &loaded.model;
        let design = pipeline::design(
            loaded,
            &self.model.settings(&self.mapping),
            &self.point.point(),
            &mut progress::stopwatch(true, self.message_format()),
        )?;
        let mut machine = Machine::new(&design.program);
        let ports = &design.program.outputs;
        let most = libm::ldexp(1.0, design.program.format.storage_bits as i32 - 1);
        let shown = |(number, port): (f64, &pe_ir::program::OutputPort)| {
            let word = libm::floor(libm::ldexp(number, -port.exponent) + 0.5).clamp(-most, most - 1.0);
            libm::ldexp(word, port.exponent)
        };
        let mut rows = vec![first_row(model).into_iter().zip(ports).map(shown).collect()];
        for inputs in pipeline::stimulus(model, &design, 0, model.steps()) {
            machine.step(&inputs, &mut |_| {});
            if machine.escaped() {
                return Err(Failure::Internal("a word is out of range, which was proven impossible".to_owned()));
            }
            let number = |(word, port): (&i64, &pe_ir::program::OutputPort)| libm::ldexp(*word as f64, port.exponent);
            rows.push(machine.outputs().iter().zip(ports).map(number).collect());
        }
        Ok(rows)
    }
}

/// The outputs at time zero.
fn first_row(model: &Model) -> Vec<f64> {
    let inputs: Vec<f64> = model.inputs.iter().map(|input| input.waveform.at(0.0)).collect();
    model.initial_outputs(&inputs)
}

/// Rows of time and outputs.
fn csv(model: &Model, rows: &[Vec<f64>]) -> String {
    let mut csv = String::from("t");
    for output in &model.outputs {
        csv += &format!(",{}", quoted(&output.name));
    }
    csv.push('\n');
    for (step, row) in rows.iter().enumerate() {
        csv += &format!("{:e}", model.time(step as u64, 0.0));
        for number in row {
            csv += &format!(",{number:e}");
        }
        csv.push('\n');
    }
    csv
}

/// The same for waveform viewers.
fn vcd(model: &Model, rows: &[Vec<f64>]) -> Result<Vec<u8>, Failure> {
    let names: Vec<&str> = model.outputs.iter().map(|output| output.name.as_str()).collect();
    let dump = waveforms::dump(&model.name, &names, model.step, rows);
    dump.map_err(|error| Failure::Internal(format!("the dump cannot be written: {error}")))
}

/// A CSV field; names with indices contain commas.
fn quoted(name: &str) -> String {
    if name.contains(',') { format!("\"{name}\"") } else { name.to_owned() }
}
