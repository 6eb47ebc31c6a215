//! `pe-synth fmu`: a network as functional mock-up unit.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use pe_flow::failure::Failure;
use pe_flow::report::table::row;
use pe_fmu::{Error, Version, pack};
use pe_host::Design;

use crate::cmd_serve::failure;
use crate::console;
use crate::messages::MessageFormat;
use crate::output;

/// Packs a compiled network as FMU for co-simulation, FMI 2.0 and 3.0
///
/// The FMU holds the folder and computes the words of the hardware: in the process of the simulation, or by any other
/// transport that its parameter `transport` names, such as a simulation in GHDL or a board. It runs on computers of the
/// kind on which it was packed.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth compile models/motor_pid/motor_pid.spec -o out/motor_pid
  pe-synth fmu out/motor_pid
  pe-synth fmu out/motor_pid --fmi 3.0 -o fmus")]
pub struct Fmu {
    /// Folder that `compile` wrote
    folder: PathBuf,
    /// Version of the interface [default: one FMU for each]
    #[arg(long, value_name = "VERSION")]
    fmi: Option<Fmi>,
    /// Folder for `NAME_fmi2.fmu` and `NAME_fmi3.fmu` [default: the design's]
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Prints errors only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
    /// Format of errors on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

/// Versions of the interface.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Fmi {
    /// FMI 2.0
    #[value(name = "2.0")]
    Two,
    /// FMI 3.0
    #[value(name = "3.0")]
    Three,
}

impl Fmu {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let design = Design::open(&self.folder).map_err(failure)?;
        let target = self.output.as_ref().unwrap_or(&self.folder);
        let library = library()?;
        let mut told = String::new();
        for version in self.fmi.map_or(vec![Fmi::Two, Fmi::Three], |version| vec![version]) {
            let (version, ending) = match version {
                Fmi::Two => (Version::Two, "fmi2"),
                Fmi::Three => (Version::Three, "fmi3"),
            };
            let fmu = pack(&self.folder, &library, version).map_err(|error| match error {
                Error::Design(error) => failure(error),
                error => Failure::File(error.to_string()),
            })?;
            let path = target.join(format!("{}_{ending}.fmu", design.map().entity));
            fs::create_dir_all(target).map_err(|error| Failure::file("create", target, error))?;
            output::write_file(&path, &fmu)?;
            told += &row("FMU", &path.display().to_string());
        }
        if !self.quiet && self.message_format == MessageFormat::Human {
            console::out(&told)?;
        }
        Ok(())
    }
}

/// The shared library of FMUs, which is built with this program and lies beside it, or where packages keep libraries.
fn library() -> Result<Vec<u8>, Failure> {
    let program = env::current_exe().map_err(|error| Failure::File(format!("cannot find this program: {error}")))?;
    let name = format!("{}pe_fmu{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX);
    let beside = program.parent().unwrap_or(Path::new(""));
    let folders = [Path::new(""), Path::new("deps"), Path::new("../lib/pe-synth")];
    let places = folders.map(|folder| beside.join(folder).join(&name));
    let Some(place) = places.iter().find(|place| place.is_file()) else {
        let missing = format!(
            "{name} is not beside {}: `cargo build --release` in a checkout makes both, and the Debian package has both",
            program.display()
        );
        return Err(Failure::File(missing));
    };
    fs::read(place).map_err(|error| Failure::file("read", place, error))
}
