//! Fault injection: measures what `verify` catches.
//!
//! In: a folder that `compile` wrote, a number, a seed. Damages of many kinds ([`classes`]) are put into copies of its
//! VHDL, and each copy is judged as [`crate::judge`] judges a folder. Out: for every damage whether it was caught, and
//! by what, or why it has no effect. That is never concluded from a simulation: either the rules of the datasheet tell
//! it ([`symbolic`]), or yosys proves the logic equivalent ([`equivalence`]). A damage that is neither is a failure, unless
//! it is one of a memory word that no run reads: nothing is said of such words, and they are counted by themselves.
//!
//! Simulation and proof control each other: a damage that is proven to have no effect and is caught is an internal
//! error.

pub mod bisimulation;
mod bounds;
pub mod class;
pub mod classes;
pub mod datasheet;
pub mod diagram;
pub mod equivalence;
pub mod library;
pub mod show;
pub mod symbolic;
mod symbols;
pub mod vhdl;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::Scratch;
use crate::engines::Engine;
use crate::folder;
use crate::judge::{self, Nobody, Options, Plan};
use classes::{Damage, Places, Sources};
use datasheet::Design;
use equivalence::{Equivalence, Netlist, Yosys};
use pe_flow::failure::Failure;
use pe_judge::progress::Progress;

/// Damages that are judged at a time: GHDL is one thread, and memory is small.
const AT_A_TIME: usize = 2;

/// What became of a damage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fate {
    /// `verify` fails.
    Caught {
        /// Runs that passed before.
        passed: usize,
        /// Where the run starts that fails.
        start: String,
        /// What `verify` says.
        message: String,
    },
    /// It cannot show.
    WithoutEffect {
        /// Kind of proof.
        proof: Proof,
        /// What was proven.
        reason: String,
    },
    /// Neither: why there is no proof.
    Missed(String),
}

/// What shows that a damage has no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Proof {
    /// The rules of the datasheet: control words, images and wiring with symbols in place of numbers.
    Datasheet,
    /// Equivalence of the synthesised logic.
    Equivalence,
    /// Coverage: no run of `verify` reads the word, so nothing is said of it.
    NeverRead,
}

impl Proof {
    /// Name in the table and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Proof::Datasheet => "datasheet",
            Proof::Equivalence => "equivalence",
            Proof::NeverRead => "never-read",
        }
    }
}

/// A damage and what became of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What was done.
    pub damage: Damage,
    /// What became of it.
    pub fate: Fate,
}

/// A campaign on one folder.
#[derive(Clone, Debug)]
pub struct Campaign {
    /// Number of damages.
    pub count: usize,
    /// Which ones.
    pub seed: u64,
    /// Steps of each run of `verify`, as its option says.
    pub steps: Option<u64>,
}

/// What all damages of a folder have in common.
struct Subject<'a> {
    folder: &'a Path,
    design: String,
    sources: Sources,
    /// As the datasheet reads it.
    read: Design,
    plan: Plan,
    /// Made when the first proof needs it.
    proofs: OnceLock<Result<Equivalence, String>>,
    yosys: Yosys,
}

impl Campaign {
    /// Damages a folder's VHDL again and again; the findings in the order of the choice.
    ///
    /// # Errors
    /// If the folder cannot be read or fails undamaged, if a tool is missing, or if simulation and proof contradict each
    /// other.
    pub fn run(&self, folder: &Path, progress: &dyn Progress) -> Result<Vec<Finding>, Failure> {
        let yosys = Yosys::find()?;
        let options = Options { engines: vec![Engine::Ghdl], steps: self.steps, within: None };
        // A damage in a folder that fails anyway would count as caught.
        judge::judge(folder, &options, &Nobody)?;
        let plan = Plan::of(folder, &options)?;
        let sources = sources(folder)?;
        let unread = |what: String| Failure::file("read", folder, format!("its VHDL is not understood: {what}"));
        let places = Places::of(&sources).map_err(unread)?;
        let (_, _, read) = sources.read().map_err(unread)?;
        let damages = places.choose(self.count, &mut ChaCha8Rng::seed_from_u64(self.seed));
        let subject = Subject {
            folder,
            design: sources.network_file.trim_end_matches(".vhd").to_owned(),
            sources,
            read,
            plan,
            proofs: OnceLock::new(),
            yosys,
        };
        progress.set_length(damages.len() as u64);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(AT_A_TIME).build();
        let pool = pool.map_err(|error| Failure::Internal(error.to_string()))?;
        let findings: Vec<Result<Finding, Failure>> = pool.install(|| {
            let judged = damages.into_par_iter().map(|damage| {
                let fate = subject.judge(&damage);
                progress.advance(1);
                fate.map(|fate| Finding { damage, fate })
            });
            judged.collect()
        });
        findings.into_iter().collect()
    }
}

/// The VHDL of a folder, without its test bench: what is damaged is the design.
fn sources(folder: &Path) -> Result<Sources, Failure> {
    let read = |path: &Path| fs::read_to_string(path).map_err(|error| Failure::file("read", path, error));
    let design = folder::DesignFolder::open(folder)?.design;
    let list = read(&folder.join(format!("{design}.f")))?;
    let mut texts = BTreeMap::new();
    for (_, file) in list.lines().filter_map(|line| line.split_once(' ')) {
        if !file.ends_with("_tb.vhd") && !file.ends_with("trace_pkg.vhd") {
            texts.insert(file.to_owned(), read(&folder.join(file))?);
        }
    }
    let sources =
        Sources { texts, package_file: format!("{design}_program_pkg.vhd"), network_file: format!("{design}.vhd") };
    let known = [&sources.package_file, &sources.network_file].iter().all(|file| sources.texts.contains_key(*file));
    if known { Ok(sources) } else { Err(Failure::file("read", folder, "its file list has no package or no network")) }
}

impl Subject<'_> {
    /// What becomes of a damage.
    fn judge(&self, damage: &Damage) -> Result<Fate, Failure> {
        let scratch = Scratch::new()?;
        let copy = scratch.folder("copy")?;
        self.copy(damage, &copy)?;
        let judged = self.plan.judge(&copy, &scratch.folder("bench")?)?;
        if judged.is_err() {
            self.can_be_analysed(damage, &copy, &scratch)?;
        }
        let caught = |(passed, start, message)| Fate::Caught { passed, start, message };
        let proven = || self.equivalence(&copy, &scratch);
        let is_read = damage.image.is_none_or(|word| self.plan.reads(word));
        fate(damage, judged.map_err(caught), self.datasheet(damage), proven, is_read)
    }

    /// Copies the folder, with a damage in it.
    fn copy(&self, damage: &Damage, to: &Path) -> Result<(), Failure> {
        for folder in [self.folder.to_owned(), self.folder.join("hdl")] {
            let entries = fs::read_dir(&folder).map_err(|error| Failure::file("read", &folder, error))?;
            for path in entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_file()) {
                let name = path.strip_prefix(self.folder).unwrap_or(&path);
                // Pictures are most of a small design, and nobody judges them.
                if name.extension().is_some_and(|kind| kind == "svg" || kind == "csv") {
                    continue;
                }
                let target = to.join(name);
                if let Some(parent) = target.parent() {
                    fs::create_dir_all(parent).map_err(|error| Failure::file("create", parent, error))?;
                }
                fs::copy(&path, &target).map_err(|error| Failure::file("copy", &path, error))?;
            }
        }
        let path = to.join(&damage.file);
        fs::write(&path, damage.of(&self.sources.texts[&damage.file]))
            .map_err(|error| Failure::file("write", &path, error))
    }

    /// A damage that is no VHDL would be caught by any tool, and prove nothing.
    fn can_be_analysed(&self, damage: &Damage, copy: &Path, scratch: &Scratch) -> Result<(), Failure> {
        let work = scratch.folder("analysis")?;
        match analyse(copy, &self.design, &work)? {
            Ok(()) => Ok(()),
            Err(message) => Err(Failure::Internal(format!(
                "a damage is no VHDL: {} line {}: `{}`: {message}",
                damage.file, damage.line, damage.after
            ))),
        }
    }

    /// Whether the rules of the datasheet say that a damage has no effect; they tell of programs, images and wiring.
    fn datasheet(&self, damage: &Damage) -> Result<(), String> {
        if !damage.is_read {
            return Err(String::new());
        }
        let (_, _, damaged) = self.sources.damaged(damage).read()?;
        symbolic::equal(&self.read, &damaged)
    }

    /// Whether yosys proves that the damaged network is the same logic.
    fn equivalence(&self, copy: &Path, scratch: &Scratch) -> Result<Result<String, String>, Failure> {
        let proofs = self.proofs.get_or_init(|| {
            let told = |failure: Failure| format!("{failure:?}");
            let work = scratch.folder("undamaged").map_err(told)?;
            let netlist = synthesised(self.folder, &self.design, &work)?;
            Equivalence::of(self.yosys.clone(), netlist, &work).map_err(told)
        });
        let proofs = proofs.as_ref().map_err(|message| Failure::Mismatch(message.clone()))?;
        match synthesised(copy, &self.design, &scratch.folder("synthesis")?) {
            Ok(damaged) => proofs.holds(&damaged, &scratch.folder("equivalence")?),
            Err(message) => Ok(Err(message)),
        }
    }
}

/// What simulation and proofs make of a damage; they control each other. `is_read` tells whether any run reads the word
/// that is damaged, if it is one of a memory.
fn fate(
    damage: &Damage,
    judged: Result<(), Fate>,
    datasheet: Result<(), String>,
    equivalence: impl FnOnce() -> Result<Result<String, String>, Failure>,
    is_read: bool,
) -> Result<Fate, Failure> {
    match (judged, datasheet) {
        (Err(fate), Err(_)) => Ok(fate),
        (Err(fate), Ok(())) => Err(Failure::Internal(format!(
            "`{}` for `{}` in {}, line {}, has no effect by the rules of the datasheet, but: {fate:?}",
            damage.after, damage.before, damage.file, damage.line
        ))),
        (Ok(()), Ok(())) => {
            let reason = "memory writes, outputs and flags depend on the same words".to_owned();
            Ok(Fate::WithoutEffect { proof: Proof::Datasheet, reason })
        }
        (Ok(()), Err(reason)) => Ok(match equivalence()? {
            Ok(reason) => Fate::WithoutEffect { proof: Proof::Equivalence, reason },
            Err(_) if !is_read => {
                let reason = format!("{}: no run reads it", damage.what);
                Fate::WithoutEffect { proof: Proof::NeverRead, reason }
            }
            Err(other) if reason.is_empty() => Fate::Missed(other),
            Err(other) => Fate::Missed(format!("{reason}; {other}")),
        }),
    }
}

/// Analyses the VHDL of a folder; the inner error is what GHDL says.
fn analyse(folder: &Path, design: &str, work: &Path) -> Result<Result<(), String>, Failure> {
    let list = folder.join(format!("{design}.f"));
    let text = fs::read_to_string(&list).map_err(|error| Failure::file("read", &list, error))?;
    let files: Vec<(&str, &str)> = text.lines().filter_map(|line| line.split_once(' ')).collect();
    for part in files.chunk_by(|(library, _), (other, _)| library == other) {
        let mut command = Command::new("ghdl");
        command.args(["-a", "--std=08", &format!("--work={}", part[0].0)]).arg(format!("--workdir={}", work.display()));
        command.arg(format!("-P{}", work.display())).args(part.iter().map(|(_, file)| folder.join(file)));
        let output =
            command.output().map_err(|_| Failure::MissingTool("ghdl is not installed: apt-get install ghdl".into()))?;
        if !output.status.success() {
            return Ok(Err(String::from_utf8_lossy(&output.stderr).lines().take(2).collect::<Vec<_>>().join(" ")));
        }
    }
    Ok(Ok(()))
}

/// The netlist that GHDL makes of a folder's VHDL.
fn synthesised(folder: &Path, design: &str, work: &Path) -> Result<Netlist, String> {
    analyse(folder, design, work).map_err(|failure| format!("{failure:?}"))??;
    let mut command = Command::new("ghdl");
    // Assertions would be tasks that yosys does not know. Without the trace: what a device would have.
    command.args(["--synth", "--no-formal", "--std=08", "--out=verilog"]).arg(format!("--workdir={}", work.display()));
    command.arg(format!("-P{}", work.display())).arg(design);
    let output = command.output().map_err(|error| error.to_string())?;
    if output.status.success() {
        return Ok(Netlist::of(&String::from_utf8_lossy(&output.stdout)));
    }
    let first = String::from_utf8_lossy(&output.stderr).lines().find(|line| line.contains("error")).map(str::to_owned);
    Err(format!("GHDL does not synthesise it: {}", first.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::class::Class;
    use super::*;

    fn damage() -> Damage {
        Damage {
            class: Class::Links,
            file: "m.vhd".into(),
            line: 3,
            before: "a".into(),
            after: "b".into(),
            what: "a port".into(),
            edits: Vec::new(),
            is_read: true,
            image: None,
        }
    }

    fn missed() -> Result<Result<String, String>, Failure> {
        Ok(Err("no".into()))
    }

    #[test]
    fn a_proof_that_simulation_contradicts_is_an_internal_error() {
        let caught = || Err(Fate::Caught { passed: 0, start: "step 3".into(), message: "another word".into() });
        let failure = fate(&damage(), caught(), Ok(()), missed, false).expect_err("both cannot hold");
        assert!(matches!(failure, Failure::Internal(text) if text.contains("m.vhd") && text.contains("another word")));
        assert_eq!(fate(&damage(), caught(), Err("why".into()), missed, false).ok(), caught().err());
    }

    #[test]
    fn what_is_neither_caught_nor_proven_is_missed_and_counted() {
        let fates = [
            fate(&damage(), Ok(()), Ok(()), || panic!("there is a proof already"), false),
            fate(&damage(), Ok(()), Err("why".into()), || Ok(Ok("same logic".into())), false),
            fate(&damage(), Ok(()), Err("why".into()), missed, true),
            fate(&damage(), Ok(()), Err(String::new()), missed, true),
            fate(&damage(), Ok(()), Err("why".into()), missed, false),
        ];
        let findings: Vec<Finding> =
            fates.into_iter().map(|fate| Finding { damage: damage(), fate: fate.expect("a fate") }).collect();
        let told: Vec<&Fate> = findings.iter().map(|finding| &finding.fate).collect();
        assert!(matches!(told[0], Fate::WithoutEffect { proof: Proof::Datasheet, .. }));
        assert!(matches!(told[1], Fate::WithoutEffect { proof: Proof::Equivalence, .. }));
        assert_eq!(told[2], &Fate::Missed("why; no".into()));
        assert_eq!(told[3], &Fate::Missed("no".into()));
        assert!(matches!(told[4], Fate::WithoutEffect { proof: Proof::NeverRead, .. }));
        assert_eq!(show::missed(&findings), 2);
        let table = show::table(&findings);
        let row = table.lines().find(|line| line.starts_with("links")).expect("a row");
        let numbers: Vec<&str> = row.split_ascii_whitespace().skip(1).collect();
        assert_eq!(numbers, ["5", "0", "1", "1", "1", "2"], "{table}");
        assert!(table.contains("never read: a port\n"), "{table}");
        assert!(table.contains("missed: links in m.vhd, line 3: a port"), "{table}");
        let json = show::as_json(&findings, "m", 7);
        assert_eq!((json["seed"].as_u64(), json["all"]["missed"].as_u64()), (Some(7), Some(2)));
        assert_eq!(json["damages"][1]["proof"], "equivalence");
    }
}
