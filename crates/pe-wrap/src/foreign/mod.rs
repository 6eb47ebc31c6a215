//! Wrappers around a user's own VHDL entity, which runs by its clock enable: `docs/wrapper.md`.
//!
//! In: VHDL files and, from the second call on, the map of the entity. Out: that map, or a shell that gives the entity the
//! handshake of a network, its [`pe_map::Map`] and the wrapper around it. What cannot be wrapped is told in findings with
//! places, all in one run.

mod entity;
mod evaluate;
mod map;
mod plan;
mod shell;
mod source;

pub use entity::{Entity, Port};
pub use map::{ENTITY_VERSION, EntityMap, GenericEntry, Level, PortEntry, Role, Setting, Tied};
pub use plan::{base_name, shell_name};
pub use source::Given;

use std::collections::{BTreeMap, BTreeSet};

use pe_emit::Artefact;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Severity, Sources, Span};
use pe_map::{Fault, Map, sha256};

use crate::Origin;

/// What the files of a user say.
pub struct Reading {
    /// The files, for findings.
    pub sources: Sources,
    /// The entity; none if there are errors.
    pub entity: Entity,
}

/// A wrapper around a foreign entity.
pub struct Wrapping {
    /// Its files.
    pub artefacts: Vec<Artefact>,
    /// What hosts read.
    pub map: Map,
    /// Warnings.
    pub warnings: Vec<Diagnostic>,
}

fn is_wrong(findings: &[Diagnostic]) -> bool {
    findings.iter().any(|finding| finding.severity == Severity::Error)
}

/// Finds an entity in files.
///
/// # Errors
/// All findings, with the files that they are about.
pub fn read(files: &[Given], name: &str) -> Result<Reading, (Vec<Diagnostic>, Sources)> {
    let mut sources = Sources::new("--vhdl", "");
    let mut findings = Vec::new();
    let entity = entity::read(files, name, &mut sources, &mut findings);
    if let Some(entity) = &entity {
        plan::check_names(entity, &mut findings);
        if !is_wrong(&findings) {
            plan::check_entity(entity, &mut findings);
        }
    }
    match entity {
        Some(entity) if !is_wrong(&findings) => Ok(Reading { sources, entity }),
        _ => Err((findings, sources)),
    }
}

impl Reading {
    /// The first map, to be edited, and warnings: what it lacks.
    pub fn first_map(&self, generator: &str) -> (EntityMap, Vec<Diagnostic>) {
        EntityMap::first(&self.entity, generator)
    }

    /// Bits of a port with the defaults of the generics; none if they are not known.
    pub fn bits(&self, port: &Port) -> Option<u32> {
        self.entity.bits(port, &self.entity.generics(&BTreeMap::new())).ok()
    }

    /// The wrapper that a map asks for; `name` is the map's file.
    ///
    /// # Errors
    /// All findings, for [`Reading::sources`].
    pub fn wrap(
        &mut self,
        files: &[Given],
        (name, text): (&str, &str),
        stream: bool,
        origin: &Origin,
    ) -> Result<Wrapping, Vec<Diagnostic>> {
        let span = self.sources.add(name, text);
        let map = EntityMap::read(text).map_err(|fault| vec![damaged(fault, text, span)])?;
        let map = EntityMap { generator: origin.generator.clone(), ..map };
        let mut findings = Vec::new();
        let hash = hash(&map, files);
        let plan = plan::plan(&self.entity, &map, hash, &self.sources, span, &mut findings);
        findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
        if is_wrong(&findings) {
            return Err(findings);
        }
        let copies = copies(files);
        let list: String = copies.iter().map(|(path, _)| format!("work {path}\n")).collect();
        let shell = format!("{}.vhd", shell_name(&plan.name));
        let mut artefacts = crate::wrap(&plan.map, &format!("{list}work {shell}\n"), stream, origin);
        artefacts.push(Artefact { path: shell, text: pe_emit::aligned(shell::render(&plan, stream, origin)) });
        artefacts.push(Artefact { path: format!("{}_map.json", plan.name), text: plan.map.text() });
        artefacts.push(Artefact { path: format!("{}_entity.json", plan.name), text: text.to_owned() });
        Ok(Wrapping { artefacts, map: plan.map, warnings: findings })
    }
}

/// A map that is none.
fn damaged((fault, place): (Fault, Option<(usize, usize)>), text: &str, span: Span) -> Diagnostic {
    let start = span.range().start;
    let at = place.map_or(start, |(line, column)| {
        let before: usize = text.split_inclusive('\n').take(line - 1).map(str::len).sum();
        start + (before + column.saturating_sub(1)).min(text.len())
    });
    let message = match fault {
        Fault::Damaged(what) => what,
        Fault::Version(version) => {
            format!("the map is of version {version}, this program reads version {ENTITY_VERSION}")
        }
    };
    let finding =
        Diagnostic::error(codes::BAD_ENTITY_MAP, Span::of(at, (at + 1).min(span.range().end.max(at))), message);
    finding.with_help("`pe-synth wrap --vhdl FILE --entity NAME -o DIR` writes a new one")
}

/// Hash of a design: of what decides the words that it computes.
fn hash(map: &EntityMap, files: &[Given]) -> String {
    let mut content = format!("{}\n{}", map.generator, map.text()).into_bytes();
    for file in files {
        content.extend(format!("{}\n", file.content.len()).into_bytes());
        content.extend(&file.content);
    }
    sha256(&content)
}

/// Where the files of a user go, with their content: names that no tool stumbles over.
pub fn copies(files: &[Given]) -> Vec<(String, &[u8])> {
    let mut taken = BTreeSet::new();
    let mut copies = Vec::new();
    for file in files {
        let name = file.name.rsplit(['/', '\\']).next().unwrap_or_default();
        let plain = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.') { c } else { '_' };
        let name: String = name.trim_start_matches(['.', '-']).chars().map(plain).collect();
        let numbered = (2..).map(|number| format!("{number}_{name}"));
        let free = |name: &String| !name.is_empty() && taken.insert(name.to_lowercase());
        let name = std::iter::once(name.clone()).chain(numbered).find(free).unwrap_or_default();
        copies.push((format!("vhdl/{name}"), &file.content[..]));
    }
    copies
}
