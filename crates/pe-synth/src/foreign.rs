//! `pe-synth wrap --vhdl`: a user's own VHDL entity behind a bus.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use pe_flow::failure::Failure;
use pe_flow::report::table::row;
use pe_map::Map;
use pe_map::registers::Windows;
use pe_wrap::Origin;
use pe_wrap::foreign::{self, EntityMap, Given, Reading, Role, Wrapping};
use serde::Serialize;

use crate::console;
use crate::messages::{MessageFormat, print_findings};
use crate::output::OutputFolder;

/// What is asked for.
pub struct Foreign<'a> {
    /// VHDL files, in the order in which they are analysed.
    pub files: &'a [PathBuf],
    /// Name of the entity.
    pub entity: &'a str,
    /// Its map; without one the first map is written.
    pub map: Option<&'a Path>,
    /// Output folder.
    pub target: &'a Path,
    /// Streams, too.
    pub stream: bool,
    /// What the files tell about their origin.
    pub origin: Origin,
    /// Form of findings.
    pub message_format: MessageFormat,
    /// Prints findings only.
    pub quiet: bool,
}

/// `wrapped.json`: what is in a folder of a foreign entity.
#[derive(Serialize)]
struct Contents<'a> {
    generator: &'a str,
    command: &'a str,
    files: BTreeMap<String, String>,
}

impl Foreign<'_> {
    /// Writes the first map, or the wrapper.
    pub fn run(&self) -> Result<(), Failure> {
        OutputFolder::permitted(self.target)?;
        let files: Vec<Given> = self.files.iter().map(given).collect::<Result<_, _>>()?;
        let map = self.map.map(given).transpose()?;
        let reading = foreign::read(&files, self.entity);
        let mut reading = reading.map_err(|(findings, sources)| Failure::Spec(findings, sources))?;
        let text = match map {
            Some(map) => {
                let text = map.text();
                let wrapping = reading.wrap(&files, (&map.name, &text), self.stream, &self.origin);
                let wrapping = match wrapping {
                    Ok(wrapping) => wrapping,
                    Err(findings) => return Err(Failure::Spec(findings, reading.sources)),
                };
                print_findings(&wrapping.warnings, &reading.sources, self.message_format);
                self.write_wrapper(&wrapping, &files)?;
                self.told(&wrapping.map)
            }
            None => {
                let (map, warnings) = reading.first_map(&self.origin.generator);
                self.write_first(&map)?;
                print_findings(&warnings, &reading.sources, self.message_format);
                self.told_first(&reading, &map)
            }
        };
        if !self.quiet && self.message_format == MessageFormat::Human {
            console::out(&text)?;
        }
        Ok(())
    }

    fn write_wrapper(&self, wrapping: &Wrapping, files: &[Given]) -> Result<(), Failure> {
        let folder = OutputFolder::create_until_interrupted(self.target)?;
        for artefact in &wrapping.artefacts {
            folder.write(&artefact.path, &artefact.text)?;
        }
        for (path, content) in foreign::copies(files) {
            folder.write_bytes(&path, content)?;
        }
        self.finish(folder)
    }

    fn write_first(&self, map: &EntityMap) -> Result<(), Failure> {
        let name = map_name(&map.entity);
        let path = self.target.join(&name);
        // What a user wrote is not replaced.
        if path.exists() {
            let reason = "it exists; give it with --map, or remove it to get a new one";
            return Err(Failure::file("replace", &path, reason));
        }
        let folder = OutputFolder::create_until_interrupted(self.target)?;
        folder.write(&name, &map.text())?;
        self.finish(folder)
    }

    fn finish(&self, folder: OutputFolder) -> Result<(), Failure> {
        let Origin { generator, command } = &self.origin;
        let contents = Contents { generator, command, files: folder.hashes() };
        let text = serde_json::to_string_pretty(&contents).map_err(|error| Failure::Internal(error.to_string()))?;
        folder.write("wrapped.json", &(text + "\n"))?;
        folder.finish()
    }

    fn told_first(&self, reading: &Reading, map: &EntityMap) -> String {
        let mut text = row("map", &self.target.join(map_name(&map.entity)).display().to_string());
        for (entry, port) in map.ports.iter().zip(&reading.entity.ports) {
            let role = serde_json::to_string(&entry.role).unwrap_or_default().replace(['"', '_'], " ");
            let bits = reading.bits(port).filter(|_| entry.role == Role::Data);
            let bits = bits.map_or(String::new(), |bits| format!(", {bits} bit{}", if bits == 1 { "" } else { "s" }));
            text += &row(&entry.name, &format!("{}: {}{bits}", entry.declared, role.trim()));
        }
        text + &row("next", "edit the map, and give it with --map to the same command")
    }

    fn told(&self, map: &Map) -> String {
        let windows = pe_map::wrap::windows(map);
        let [inputs, outputs] = [Windows::total(&windows.inputs), Windows::total(&windows.outputs)];
        let foreign = map.foreign.as_ref();
        let step = match foreign.map_or(0, |foreign| foreign.step_clocks) {
            0 => "until the entity is ready".to_owned(),
            1 => "1 clock".to_owned(),
            clocks => format!("{clocks} clocks"),
        };
        let restart = map.host.as_ref().is_some_and(|host| host.restart.is_some());
        let streams = if self.stream { "; AXI4-Stream in and out" } else { "" };
        row("bus", &format!("AXI4-Lite, 32 bits, addresses of {} bits{streams}", windows.address_bits))
            + &row("windows", &format!("{inputs} words of inputs, {outputs} of outputs"))
            + &row("step", &step)
            + &row("host", if restart { "restart" } else { "no restart: the entity has no reset" })
            + &row(
                "files",
                &format!("{}: {}_axi.vhd, {}_wrap.json and others", self.target.display(), map.entity, map.entity),
            )
    }
}

fn map_name(entity: &str) -> String {
    format!("{}_entity.json", foreign::base_name(entity))
}

/// A file, as findings name it.
fn given(path: impl AsRef<Path>) -> Result<Given, Failure> {
    let path = path.as_ref();
    let content = fs::read(path).map_err(|error| Failure::file("read", path, error))?;
    Ok(Given { name: path.display().to_string(), content })
}
