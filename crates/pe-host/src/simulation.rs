//! Simulations of a wrapped network that this program builds and starts.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::design::Design;
use crate::error::Error;
use crate::pipe::Pipe;
use crate::scratch::{Scratch, run};

/// What simulates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Simulator {
    /// The VHDL, in GHDL.
    Ghdl,
    /// The netlist that GHDL makes of it, in Verilator.
    Verilator,
}

const INSTALL_GHDL: &str = "apt-get install ghdl";
const INSTALL_VERILATOR: &str = "apt-get install verilator g++ make";

impl Simulator {
    /// Builds and starts the bus master of a folder that `pe-synth wrap` wrote.
    ///
    /// # Errors
    /// [`Error::File`] if the folder has no wrapper, [`Error::MissingTool`] or [`Error::Tool`].
    pub fn open(self, design: &Design, timeout: Duration) -> Result<Pipe, Error> {
        let scratch = Scratch::new()?;
        let (folder, entity) = (scratch.path().to_owned(), design.map().entity.clone());
        analyse(design, &folder)?;
        let (name, program, arguments) = match self {
            Simulator::Ghdl => {
                let top = format!("{entity}_bus");
                run(Command::new("ghdl").args(["-e", "--std=08", &top]).current_dir(&folder), "ghdl", INSTALL_GHDL)?;
                let arguments = ["-r", "--std=08", &top, "--ieee-asserts=disable-at-0"].map(str::to_owned);
                ("ghdl", "ghdl".into(), arguments.to_vec())
            }
            Simulator::Verilator => ("verilator", verilated(&entity, &folder)?, Vec::new()),
        };
        let start = move || {
            let mut command = Command::new(&program);
            command.args(&arguments).current_dir(scratch.path());
            command
        };
        Pipe::open(name, Box::new(start), timeout)
    }
}

/// Analyses a wrapped network. GHDL's libraries record paths and make reads them, and neither can quote what a user may
/// call a folder: all files are copied.
fn analyse(design: &Design, folder: &Path) -> Result<(), Error> {
    let list = design.file("axi.f");
    let text = fs::read_to_string(&list);
    let text = text.map_err(|error| Error::file("read", &list, format!("{error}; run `pe-synth wrap` first")))?;
    let home = list.parent().unwrap_or(Path::new("."));
    let copy = |file: &str| {
        let to = folder.join(file);
        let made = to.parent().map_or(Ok(()), fs::create_dir_all);
        made.and_then(|()| fs::copy(home.join(file), &to)).map_err(|error| Error::file("copy", &home.join(file), error))
    };
    for (library, file) in text.lines().filter_map(|line| line.split_once(' ')) {
        copy(file)?;
        let mut analysis = Command::new("ghdl");
        analysis.args(["-a", "--std=08", &format!("--work={library}"), file]).current_dir(folder);
        run(&mut analysis, "ghdl", INSTALL_GHDL)?;
    }
    copy(&format!("{}_bus.cpp", design.map().entity)).map(drop)
}

/// Builds the netlist as a program.
fn verilated(entity: &str, folder: &Path) -> Result<std::path::PathBuf, Error> {
    let top = format!("{entity}_axi");
    let mut synthesis = Command::new("ghdl");
    synthesis.args(["--synth", "--std=08", "--out=verilog", &top]).current_dir(folder);
    let netlist = folder.join(format!("{top}.v"));
    let text = run(&mut synthesis, "ghdl", INSTALL_GHDL)?;
    fs::write(&netlist, text).map_err(|error| Error::file("write", &netlist, error))?;
    let mut build = Command::new("verilator");
    build.args(["--cc", "--exe", "--build", "-O3", "-Wno-fatal", "-Wno-lint", "-CFLAGS", "-O2", "--Mdir", "obj"]);
    build.args(["--top-module", &top, &format!("{top}.v"), &format!("{entity}_bus.cpp")]).current_dir(folder);
    run(&mut build, "verilator", INSTALL_VERILATOR)?;
    Ok(folder.join("obj").join(format!("V{top}")))
}
