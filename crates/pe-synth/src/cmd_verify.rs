//! `pe-synth verify`: every engine against the simulator, bit for bit.

use std::cell::RefCell;
use std::path::PathBuf;
use std::time::Duration;

use crate::console;
use crate::messages::MessageFormat;
use crate::options::engine;
use crate::progress::{self, Teller};
use pe_flow::failure::Failure;
use pe_judge::parse::duration;
use pe_verify::Scratch;
use pe_verify::engines::Engine;
use pe_verify::folder::DesignFolder;
use pe_verify::inject::{Campaign, show};
use pe_verify::judge::{Listener, Options, judge};

/// Compares a compiled design in GHDL and as Rust reference with the simulator, bit for bit
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth verify out/weibel5
  pe-synth verify out/weibel11 --steps 2
  pe-synth verify out/weibel11 --steps 100 --engines verilator
  pe-synth verify out/weibel11 --within 1min
  pe-synth verify out/van_der_pol --inject 100 --seed 7")]
pub struct Verify {
    /// Folder that `compile` wrote
    folder: PathBuf,
    /// Most steps to run from each start [default: as many as the reference trace has, more where everything must move]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Fits starts and steps to this time, and says what it left out; what is compared may differ from run to run. In every
    /// engine something must move by then
    #[arg(long, value_name = "T", value_parser = duration, conflicts_with = "inject")]
    within: Option<f64>,
    /// Engines to compare with the simulator, in this order
    #[arg(long, value_name = "NAME", value_parser = engine(), value_delimiter = ',', default_value = "reference,fast,ghdl")]
    engines: Vec<Engine>,
    /// Also runs the synthesised netlist in Verilator
    #[arg(long)]
    verilator: bool,
    /// Accepts files that differ from the hashes in report.json, if the engines agree
    #[arg(long)]
    allow_changed: bool,
    /// Damages the VHDL of N copies of the folder, and reports which damages verify catches
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), help_heading = "Damage")]
    inject: Option<u64>,
    /// Seed that selects the damages
    #[arg(long, value_name = "SEED", default_value_t = 1, requires = "inject", help_heading = "Damage")]
    seed: u64,
    /// Prints errors and warnings only, and what was left out
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
    /// Format of errors on standard error; `json` also prints runs and coverage as one object on standard output
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
        if !self.folder.exists() {
            return Err(Failure::file("read", &self.folder, "there is no such folder"));
        }
        if let Some(count) = self.inject {
            return self.campaign(count as usize);
        }
        let mut engines = self.engines.clone();
        if self.verilator && !engines.contains(&Engine::Verilator) {
            engines.push(Engine::Verilator);
        }
        let within = self.within.map(Duration::from_secs_f64);
        let options = Options { engines, steps: self.steps, within };
        let for_people = self.message_format == MessageFormat::Human;
        let told = Told {
            lines: for_people && !self.quiet,
            left: RefCell::new((Teller::new("verify", !for_people || self.quiet), Ok(()))),
        };
        let verdict = judge(&self.folder, &options, &told)?;
        let (teller, mut told) = told.left.into_inner();
        teller.finish();
        if !for_people {
            told = console::out(&format!("{}\n", verdict.json()));
        } else if self.quiet {
            // What was not judged is no matter of style.
            told = console::out(&verdict.limits());
        }
        match verdict.changes.len() {
            0 => told,
            _ if self.allow_changed => told,
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

/// Prints the runs, and how far they are.
struct Told {
    lines: bool,
    /// The bar, and whether everything was printed.
    left: RefCell<(Teller, Result<(), Failure>)>,
}

impl Listener for Told {
    fn say(&self, line: &str) {
        let (teller, told) = &mut *self.left.borrow_mut();
        if self.lines && told.is_ok() {
            *told = teller.suspend(|| console::out(line));
        }
    }

    fn at(&self, what: &str, over: usize, left: Option<f64>) {
        let (teller, _) = &mut *self.left.borrow_mut();
        match left {
            Some(left) => teller.hear(&format!("{over} runs, {what}"), &format!("{over} runs compared"), left),
            None => teller.begin(&format!("{over} runs, {what}")),
        }
    }
}

impl Verify {
    /// Damages copies of the folder.
    fn campaign(&self, count: usize) -> Result<(), Failure> {
        // Where signals cannot be caught, the folders stay.
        let _ = ctrlc::set_handler(|| {
            Scratch::remove_all();
            std::process::exit(i32::from(Failure::Interrupted(String::new()).code()));
        });
        let campaign = Campaign { count, seed: self.seed, steps: self.steps };
        let findings = campaign.run(&self.folder, &*progress::damages(self.message_format == MessageFormat::Json))?;
        let told = console::out(&match self.message_format {
            MessageFormat::Human => show::table(&findings),
            MessageFormat::Json => {
                let design = DesignFolder::open(&self.folder)?.design;
                format!("{}\n", show::as_json(&findings, &design, self.seed))
            }
        });
        match show::missed(&findings) {
            0 => told,
            missed => Err(Failure::Mismatch(format!(
                "{missed} of {} damages are neither caught nor shown to be without effect",
                findings.len()
            ))),
        }
    }
}
