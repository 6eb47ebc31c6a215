//! `pe-synth wrap`: a network, or a foreign entity, behind a bus.

use std::fs;
use std::path::{Path, PathBuf};

use pe_flow::failure::Failure;
use pe_flow::report::Report;
use pe_flow::report::table::row;
use pe_host::rates::{self, Line};
use pe_map::{Map, sha256};
use pe_verify::folder::DesignFolder;
use pe_wrap::Origin;

use crate::console;
use crate::foreign::Foreign;
use crate::messages::MessageFormat;
use crate::output::OutputFolder;

/// Puts a compiled network, or a VHDL entity, behind a bus: AXI4-Lite registers, and a bus master for simulations
///
/// The host ports of a network decide what the wrapper can do: see `compile --host`. For an entity of your own, with clock
/// and clock enable, the first call writes a map of its ports, which you edit; with the map, the wrapper is written.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth compile models/motor_pid/motor_pid.spec --host restart,states,flags -o out/motor_pid
  pe-synth wrap out/motor_pid
  pe-synth wrap out/motor_pid --stream -o out/motor_board
  pe-synth wrap --vhdl divider.vhd --entity divider -o out/divider
  pe-synth wrap --vhdl divider.vhd --entity divider --map out/divider/divider_entity.json -o out/divider")]
pub struct Wrap {
    /// Folder that `compile` wrote
    #[arg(required_unless_present = "vhdl")]
    folder: Option<PathBuf>,
    /// VHDL file with an entity of your own, or with what it needs; may be repeated, in the order of compilation
    #[arg(long, value_name = "FILE", conflicts_with = "folder", requires_all = ["entity", "output"], help_heading = "Entity")]
    vhdl: Vec<PathBuf>,
    /// The entity
    #[arg(long, value_name = "NAME", requires = "vhdl", help_heading = "Entity")]
    entity: Option<String>,
    /// Map of the entity's ports, edited; without it, a first one is written
    #[arg(long, value_name = "FILE", requires = "vhdl", help_heading = "Entity")]
    map: Option<PathBuf>,
    /// Output folder, with a copy of the design [default: the folder itself]
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Adds AXI4-Stream in and out: a frame gives the inputs of a step, another one its outputs
    #[arg(long, help_heading = "Hardware")]
    stream: bool,
    /// Prints errors and warnings only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
    /// Format of errors and warnings on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl Wrap {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self, command: &str) -> Result<(), Failure> {
        let generator = format!("pe-synth {}", env!("CARGO_PKG_VERSION"));
        let origin = Origin { generator, command: command.to_owned() };
        match (&self.folder, &self.entity, &self.output) {
            (Some(folder), ..) => self.wrap_network(folder, &origin),
            (None, Some(entity), Some(target)) => Foreign {
                files: &self.vhdl,
                entity,
                map: self.map.as_deref(),
                target,
                stream: self.stream,
                origin,
                message_format: self.message_format,
                quiet: self.quiet,
            }
            .run(),
            _ => Err(Failure::Usage("--vhdl needs --entity and -o".to_owned())),
        }
    }

    fn wrap_network(&self, home: &Path, origin: &Origin) -> Result<(), Failure> {
        let target = self.output.as_deref().unwrap_or(home);
        OutputFolder::permitted(target)?;
        let design = DesignFolder::open(home)?;
        let map = read_map(&design)?;
        let list = read(&home.join(format!("{}.f", map.entity)))?;
        let artefacts = pe_wrap::wrap(&map, &list, self.stream, origin);
        let report = home.join("report.json");
        let damaged = |error: serde_json::Error| Failure::file("read", &report, error);
        let mut report: Report = serde_json::from_str(&read(&report)?).map_err(damaged)?;
        let folder = OutputFolder::create_until_interrupted(target)?;
        copy(home, &folder, "")?;
        for artefact in &artefacts {
            folder.write(&artefact.path, &artefact.text)?;
            report.files.insert(artefact.path.clone(), sha256(artefact.text.as_bytes()));
        }
        folder.write("report.json", &report.text())?;
        folder.finish()?;
        if !self.quiet && self.message_format == MessageFormat::Human {
            console::out(&told(&map, self.stream, target))?;
        }
        Ok(())
    }
}

/// What the wrapper offers, for people.
fn told(map: &Map, stream: bool, target: &Path) -> String {
    let windows = pe_map::wrap::windows(map);
    let words = |spans| pe_map::registers::Windows::total(spans);
    let host = map.host.clone().unwrap_or_default();
    let offered =
        [("restart", host.restart.is_some()), ("states", host.access.is_some()), ("flags", host.flags.is_some())];
    let (has, lacks): (Vec<_>, Vec<_>) = offered.iter().partition(|(_, offered)| *offered);
    let names = |list: Vec<&(&'static str, bool)>| list.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    let (has, lacks) = (names(has), names(lacks));
    let lacks = if lacks.is_empty() { String::new() } else { format!("without {lacks}: see `compile --host`") };
    let [inputs, outputs, parameters] =
        [&windows.inputs, &windows.outputs, &windows.parameters].map(|spans| words(spans));
    let parameters = if parameters > 0 { format!(", {parameters} of parameters") } else { String::new() };
    let streams = if stream { "; AXI4-Stream in and out" } else { "" };
    row("bus", &format!("AXI4-Lite, 32 bits, addresses of {} bits{streams}", windows.address_bits))
        + &row("windows", &format!("{inputs} words of inputs, {outputs} of outputs{parameters}"))
        + &row("host", &[has, lacks].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; "))
        + &row("samples/s", &rates(map))
        + &row("files", &format!("{}: {}_axi.vhd, {}_wrap.json and others", target.display(), map.entity, map.entity))
}

/// Clock of boards for which rates are predicted.
const CLOCK_MHZ: u32 = 100;

/// Samples per second in closed loop over usual lines, predicted.
fn rates(map: &Map) -> String {
    let predicted = |(name, line): (&str, Line)| {
        let rate = rates::predicted(map, line, 1e6 * f64::from(CLOCK_MHZ)).rate();
        format!("{name} {rate:.0}")
    };
    let lines: Vec<String> = Line::USUAL.into_iter().map(predicted).collect();
    format!("predicted in closed loop, {CLOCK_MHZ} MHz: {}; see `pe-synth rates`", lines.join(", "))
}

/// The map of a design; what it says must be of the program beside it.
fn read_map(design: &DesignFolder) -> Result<Map, Failure> {
    let map = Map::read(&design.read("map.json")?).map_err(|fault| design.damaged("map.json", &fault.to_string()))?;
    let program = design.read("program.txt")?;
    if map.hash != sha256(format!("{}\n{program}", map.generator).as_bytes()) {
        return Err(
            design.damaged("map.json", "its hash is not that of the program beside it; compile the design again")
        );
    }
    Ok(map)
}

fn read(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path).map_err(|error| Failure::file("read", path, error))
}

/// Copies the files of a folder, and of those in it.
fn copy(from: &Path, to: &OutputFolder, prefix: &str) -> Result<(), Failure> {
    let read_dir = |path: &Path| fs::read_dir(path).map_err(|error| Failure::file("read", path, error));
    for entry in read_dir(from)? {
        let path = entry.map_err(|error| Failure::file("read", from, error))?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        let name = name.ok_or_else(|| Failure::file("copy", &path, "its name is no text"))?;
        if path.is_dir() {
            copy(&path, to, &format!("{prefix}{name}/"))?;
        } else {
            let content = fs::read(&path).map_err(|error| Failure::file("read", &path, error))?;
            to.write_bytes(&format!("{prefix}{name}"), &content)?;
        }
    }
    Ok(())
}
