//! `pe-synth rates`: samples per second of a closed loop, predicted and measured.

use std::path::PathBuf;
use std::time::Duration;

use pe_host::rates::{self, Line, Times};
use pe_host::{Design, Host, Settings, Transport};
use serde_json::{Value, json};

use crate::cmd_serve::failure;
use crate::console;
use crate::messages::MessageFormat;
use pe_flow::failure::Failure;

/// Measures the samples per second of a closed loop over transports, and predicts those of boards
///
/// A sample takes the time to write the inputs, to run a step and to read the outputs. These are measured call by call, and
/// predict the rate beside that of a loop which exchanges all in one message. For boards the times follow from the accesses
/// and the clock; the times of the host program itself are not among them.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth rates out/motor_pid
  pe-synth rates out/motor_pid --transport model,fast,ghdl --seconds 2
  pe-synth rates out/motor_pid --transport tcp:board:5025 --clock 125")]
pub struct Rates {
    /// Folder that `compile` wrote; for `ghdl` and `verilator` one that `wrap` completed
    folder: PathBuf,
    /// Transports to measure
    #[arg(long, value_name = "TRANSPORT", value_delimiter = ',', default_value = "model,fast")]
    transport: Vec<Transport>,
    /// Seconds for each
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(1..=3600), default_value_t = 1)]
    seconds: u64,
    /// Clock of boards in MHz
    #[arg(long, value_name = "MHZ", default_value_t = 100.0)]
    clock: f64,
    /// Format of the result on standard output, and of errors
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

/// A row: what it is of, times, and the rate that was measured.
struct Row {
    name: String,
    times: Times,
    measured: Option<f64>,
}

impl Rates {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        if !(self.clock.is_finite() && self.clock > 0.0) {
            return Err(Failure::Usage(format!("`--clock {}` is no clock", self.clock)));
        }
        let design = Design::open(&self.folder).map_err(failure)?;
        let mut rows = Vec::new();
        for transport in &self.transport {
            let mut host = Host::open(&self.folder, transport, &Settings::default()).map_err(failure)?;
            let measured = rates::measured(&mut host, Duration::from_secs(self.seconds)).map_err(failure)?;
            rows.push(Row { name: transport.to_string(), times: measured.times, measured: Some(measured.rate) });
        }
        for (name, line) in Line::USUAL {
            let times = rates::predicted(design.map(), line, self.clock * 1e6);
            rows.push(Row { name: format!("board, {name}"), times, measured: None });
        }
        match self.message_format {
            MessageFormat::Human => console::out(&table(&rows)),
            MessageFormat::Json => console::out(&format!("{}\n", json(&rows))),
        }
    }
}

fn table(rows: &[Row]) -> String {
    let micro = |seconds: f64| format!("{:.3} us", seconds * 1e6);
    let rate = |rate: f64| if rate < 100.0 { format!("{rate:.1}") } else { format!("{rate:.0}") };
    let mut text = String::from(
        "| transport | write | run | read | predicted, samples/s | measured |\n|---|---|---|---|---|---|\n",
    );
    for Row { name, times, measured } in rows {
        let [write, run, read] = [times.write, times.run, times.read].map(micro);
        let measured = measured.map_or("-".to_owned(), rate);
        text += &format!("| {name} | {write} | {run} | {read} | {} | {measured} |\n", rate(times.rate()));
    }
    text
}

fn json(rows: &[Row]) -> Value {
    let row = |Row { name, times, measured }: &Row| {
        json!({"transport": name, "write_s": times.write, "run_s": times.run, "read_s": times.read,
            "predicted_samples_per_s": times.rate(), "measured_samples_per_s": measured})
    };
    rows.iter().map(row).collect()
}
