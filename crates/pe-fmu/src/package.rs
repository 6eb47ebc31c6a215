//! The archive that an FMU is.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;

use askama::Template;
use pe_host::Transport;
use pe_map::Map;
use zip::write::SimpleFileOptions;

use crate::variables::{DEFAULT_TRANSPORT, Variable, Variables, inputs, output_name};

/// Folder of the design among the resources.
pub const DESIGN: &str = "design";

/// Version of the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// FMI 2.0.
    Two,
    /// FMI 3.0.
    Three,
}

/// Why there is no FMU.
#[derive(Debug)]
pub enum Error {
    /// The folder is no design.
    Design(pe_host::Error),
    /// A file cannot be read.
    File(std::path::PathBuf, std::io::Error),
    /// The archive cannot be made.
    Archive(String),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Error::Design(error) => write!(f, "{error}"),
            Error::File(path, error) => write!(f, "cannot read {}: {error}", path.display()),
            Error::Archive(message) => write!(f, "cannot pack the FMU: {message}"),
        }
    }
}

/// A variable of the description.
struct Entry {
    name: String,
    number: u32,
    description: String,
    unit: Option<String>,
}

/// `modelDescription.xml` of FMI 2.0.
#[derive(Template)]
#[template(path = "fmu2.xml")]
struct Two<'a> {
    content: Content<'a>,
}

/// `modelDescription.xml` of FMI 3.0.
#[derive(Template)]
#[template(path = "fmu3.xml")]
struct Three<'a> {
    content: Content<'a>,
}

/// What a description says.
struct Content<'a> {
    map: &'a Map,
    transports: String,
    transport: &'static str,
    units: BTreeSet<&'a str>,
    inputs: Vec<Entry>,
    outputs: Vec<Entry>,
    /// Words in 64 bits, or in FMI 2.0 their halves.
    words: Vec<Entry>,
    /// Tunable parameters, with their values in the spec.
    parameters: Vec<(Entry, f64)>,
}

impl Content<'_> {
    /// Places of outputs and their words among the variables of FMI 2.0, which begin at 1 with the two parameters.
    fn unknowns(&self) -> std::ops::Range<usize> {
        let first = 3 + self.inputs.len();
        first..first + self.outputs.len() + self.words.len()
    }
}

/// The FMU of the design in a folder, whose shared library for this kind of computer is `library`.
///
/// The same folder and library make the same bytes.
///
/// # Errors
/// If the folder is no design, or cannot be read.
pub fn pack(folder: &Path, library: &[u8], version: Version) -> Result<Vec<u8>, Error> {
    let design = pe_host::Design::open(folder).map_err(Error::Design)?;
    let map = design.map();
    // What does not belong to its map would fail at run time only.
    design.program().map_err(Error::Design)?;
    let archived = |error: &dyn fmt::Display| Error::Archive(error.to_string());
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let mut add = |path: &str, bytes: &[u8]| {
        // 1980: the same bytes each time.
        archive.start_file(path, SimpleFileOptions::default()).map_err(|error| archived(&error))?;
        archive.write_all(bytes).map_err(|error| archived(&error))
    };
    add("modelDescription.xml", describe(map, version).as_bytes())?;
    add(&library_path(&map.entity, version), library)?;
    for name in files(folder, "")? {
        let path = folder.join(&name);
        let bytes = fs::read(&path).map_err(|error| Error::File(path, error))?;
        add(&format!("resources/{DESIGN}/{name}"), &bytes)?;
    }
    let done = archive.finish().map_err(|error| archived(&error))?;
    Ok(done.into_inner())
}

/// Where an FMU has its library for this kind of computer.
fn library_path(name: &str, version: Version) -> String {
    use std::env::consts::{ARCH, DLL_SUFFIX, OS};
    let platform = match (version, OS, ARCH) {
        (Version::Two, "linux", "x86_64") => "linux64".to_owned(),
        (Version::Two, "windows", "x86_64") => "win64".to_owned(),
        (Version::Two, "macos", _) => "darwin64".to_owned(),
        (_, "macos", arch) => format!("{arch}-darwin"),
        (_, os, arch) => format!("{arch}-{os}"),
    };
    format!("binaries/{platform}/{name}{DLL_SUFFIX}")
}

/// All files below a folder, in order, with `/` between folders; but not FMUs.
fn files(folder: &Path, prefix: &str) -> Result<Vec<String>, Error> {
    let failed = |error| Error::File(folder.to_owned(), error);
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let Ok(name) = entry.file_name().into_string() else { continue };
        if entry.path().is_dir() {
            names.extend(files(&entry.path(), &format!("{prefix}{name}/"))?);
        } else if !name.ends_with(".fmu") {
            names.push(format!("{prefix}{name}"));
        }
    }
    names.sort();
    Ok(names)
}

/// The description.
fn describe(map: &Map, version: Version) -> String {
    let variables = Variables::of(map);
    let mut taken = BTreeSet::from(["time".to_owned(), "transport".to_owned(), "clock_budget".to_owned()]);
    let mut entry = |name: String, variable: Variable, description: String, unit: &Option<String>| {
        let mut name = name;
        while !taken.insert(name.clone()) {
            name.push('\'');
        }
        Entry { name, number: variables.number(variable), description, unit: unit.clone() }
    };
    let range = |range: [f64; 2]| format!(", judged for {} .. {}", range[0], range[1]);
    let given = inputs(map).enumerate().map(|(index, input)| {
        let description = format!("port {}{}", input.port, input.range.map_or(String::new(), range));
        entry(input.name.clone(), Variable::Input(index), description, &input.unit)
    });
    let given = given.collect();
    let shown = map.outputs.iter().enumerate().map(|(index, output)| {
        let description = format!("port {}", output.port);
        entry(output_name(map, output), Variable::Output(index), description, &output.unit)
    });
    let shown = shown.collect();
    let mut words = Vec::new();
    for (index, output) in map.outputs.iter().enumerate() {
        let name = output_name(map, output);
        let what = format!("{} bits, worth 2^{} each", output.format.bits, output.format.exponent);
        let mut add = |ending: &str, variable, part: &str| {
            words.push(entry(
                format!("{name}.{ending}"),
                variable,
                format!("{part}word of port {}: {what}", output.port),
                &None,
            ));
        };
        match version {
            Version::Two => {
                add("word_low", Variable::Low(index), "lower 32 bits of the ");
                add("word_high", Variable::High(index), "upper 32 bits of the ");
            }
            Version::Three => add("word", Variable::Word(index), ""),
        }
    }
    let tuned = map.parameters.iter().enumerate().map(|(index, parameter)| {
        let description = format!("tunable{}", range(parameter.range));
        (entry(parameter.name.clone(), Variable::Parameter(index), description, &parameter.unit), parameter.value)
    });
    let parameters = tuned.collect();
    let units = inputs(map).map(|input| &input.unit).chain(map.outputs.iter().map(|output| &output.unit));
    let units = units.chain(map.parameters.iter().map(|parameter| &parameter.unit));
    let content = Content {
        map,
        transports: Transport::FORMS.map(|(form, _)| form).join(", "),
        transport: DEFAULT_TRANSPORT,
        units: units.flatten().map(String::as_str).collect(),
        inputs: given,
        outputs: shown,
        words,
        parameters,
    };
    let text = match version {
        Version::Two => Two { content }.render(),
        Version::Three => Three { content }.render(),
    };
    text.expect("memory takes the description") + "\n"
}
