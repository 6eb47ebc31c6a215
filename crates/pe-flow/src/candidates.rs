//! The mappings that are candidates: those of the step as it is, and those of the step with relays of its hubs.

use std::borrow::Cow;
use std::cell::LazyCell;
use std::sync::Arc;

use pe_hls::even::even;
use pe_hls::mapping::{self, Candidate, MapError, MapOptions, Problem, default_pes};
use pe_hls::pairs;
use pe_hls::relay::{Relayed, relay};
use pe_hls::rounds::Rounds;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::mapping::Mapping;
use pe_ir::word::Latency;

use crate::failure::Failure;
use crate::mapping_file::MappingFile;
use crate::settings::{MappingOptions, StageLoop};
use pe_judge::runs::Judged;

/// Numbers of relays that are tried: one gathers most, more are closer to their readers.
const RELAYS: [u32; 4] = [1, 2, 4, 8];

/// Options of the network.
#[derive(Clone, Debug)]
pub struct Network {
    /// Their number, unless the default is wanted.
    pub pes: Option<u32>,
    /// Seed of the annealer.
    pub seed: u64,
    /// The mapping that the user gives, and the number of relays in it.
    pub given: Option<(Mapping, u32)>,
}

/// A step graph to map: without relays, or with a number of them.
pub struct Alternative<'a> {
    /// The graph.
    pub graph: Arc<StepGraph>,
    /// Its numbers.
    pub fixed: Cow<'a, FixedPoint>,
    /// The step with all pairs that some mapping could allow; loads are taken from it.
    pub optimistic: Arc<StepGraph>,
    /// The mapping problem of that.
    pub problem: Problem,
    /// Number of relays.
    pub relays: u32,
    relayed: Option<Relayed>,
}

impl<'a> Alternative<'a> {
    fn new(graph: Arc<StepGraph>, fixed: Cow<'a, FixedPoint>, relays: u32, relayed: Option<Relayed>) -> Self {
        let optimistic = pairs::optimistic(&graph, &fixed).map_or_else(|| Arc::clone(&graph), Arc::new);
        let problem = Problem::of(&optimistic);
        Alternative { graph, fixed, optimistic, problem, relays, relayed }
    }

    fn with_relays(graph: &StepGraph, fixed: &FixedPoint, pes: u32, max_in_degree: u32, relays: u32) -> Option<Self> {
        let relayed = relay(graph, pes, max_in_degree, relays)?;
        let numbers = relayed.fixed(graph, fixed)?;
        Some(Alternative::new(Arc::clone(&relayed.graph), Cow::Owned(numbers), relays, Some(relayed)))
    }

    /// A mapping evened out under the pairs that it allows, if that changes it.
    fn evened(&self, candidate: &Candidate, max_in_degree: u32) -> Option<Candidate> {
        if Arc::ptr_eq(&self.optimistic, &self.graph) {
            return None;
        }
        let mapping = even(&self.graph, &self.fixed, &candidate.mapping);
        let cost = self.problem.cost(&mapping);
        let useful = mapping != candidate.mapping && cost.max_in_degree <= max_in_degree;
        useful.then_some(Candidate { mapping, cost, ..candidate.clone() })
    }

    /// What the runs found, with the values of the relays.
    pub fn judged(&self, judged: &Arc<Judged>) -> Arc<Judged> {
        let Some(relayed) = &self.relayed else { return Arc::clone(judged) };
        let largest = relayed.extended(&judged.largest);
        Arc::new(Judged { fixed: self.fixed.clone().into_owned(), largest, ..Judged::clone(judged) })
    }
}

/// Mappings of all alternatives for one number of PEs.
pub struct Candidates<'a> {
    /// The alternatives that can be mapped, the one without relays first if it is among them.
    pub alternatives: Vec<Alternative<'a>>,
    /// Mappings, alternative after alternative.
    pub candidates: Vec<Candidate>,
    /// For each mapping its alternative.
    pub of: Vec<usize>,
    /// Mappings without relays, which are the first.
    pub plain: usize,
    starts: usize,
}

impl<'a> Candidates<'a> {
    /// Maps the equations, or takes the mapping that is given. A default number of PEs is halved as long as some PE would
    /// need too many input ports with and without relays.
    ///
    /// # Errors
    /// That of the step without relays, if no alternative has a mapping.
    pub fn of(
        graph: &Arc<StepGraph>,
        fixed: &'a FixedPoint,
        network: &Network,
        options: &MappingOptions,
    ) -> Result<Self, MapError> {
        let mut plain = Some(Alternative::new(Arc::clone(graph), Cow::Borrowed(fixed), 0, None));
        let relayed = |pes, relays| Alternative::with_relays(graph, fixed, pes, options.max_in_degree, relays);
        let mut set =
            Candidates { alternatives: Vec::new(), candidates: Vec::new(), of: Vec::new(), plain: 0, starts: 0 };
        if let Some((mapping, relays)) = &network.given {
            let alternative =
                (*relays > 0).then(|| relayed(mapping.pes, *relays)).flatten().or(plain).expect("one of two");
            let candidate = mapping::given(&alternative.problem, mapping, options.max_in_degree)?;
            set.add(alternative, vec![candidate], None);
            return Ok(set);
        }
        // Relays would take away what a stage loop saves.
        let looped = LazyCell::new(|| options.stage_loop != StageLoop::Off && Rounds::of(graph, fixed).is_some());
        let mut pes = network.pes.unwrap_or_else(|| {
            default_pes(&plain.as_ref().expect("not mapped yet").optimistic, Latency::of(&fixed.format))
        });
        loop {
            let mut refused = None;
            let with_relays = RELAYS.iter().filter_map(|relays| relayed(pes, *relays).filter(|_| !*looped));
            for alternative in plain.take().into_iter().chain(with_relays) {
                let map_options = MapOptions {
                    pes,
                    seed: network.seed,
                    tries: options.tries.unwrap_or_else(|| MapOptions::default_tries(alternative.problem.equations())),
                    max_in_degree: options.max_in_degree,
                };
                match mapping::map(&alternative.problem, &map_options) {
                    Ok(candidates) => set.add(alternative, candidates, Some(options.max_in_degree)),
                    Err(error) if alternative.relays == 0 => {
                        refused = Some(error);
                        plain = Some(alternative);
                    }
                    Err(_) => {}
                }
            }
            match refused {
                Some(MapError::InDegree { .. }) if set.of.is_empty() && network.pes.is_none() && pes > 1 => pes /= 2,
                Some(error) if set.of.is_empty() => return Err(error),
                _ => break,
            }
        }
        Ok(set)
    }

    /// Adds a alternative with its mappings; with a limit of input ports also those evened out under the pairs they allow.
    fn add(&mut self, alternative: Alternative<'a>, candidates: Vec<Candidate>, even_within: Option<u32>) {
        self.starts += candidates.len();
        let evened: Vec<Candidate> = match even_within {
            Some(limit) => candidates.iter().filter_map(|candidate| alternative.evened(candidate, limit)).collect(),
            None => Vec::new(),
        };
        self.candidates.extend(candidates.into_iter().chain(evened));
        self.of.resize(self.candidates.len(), self.alternatives.len());
        if alternative.relays == 0 {
            self.plain = self.candidates.len();
        }
        self.alternatives.push(alternative);
    }

    /// What was mapped, in words.
    pub fn figure(&self, given: bool) -> String {
        let (equations, pes) = (self.alternatives[0].problem.equations(), self.candidates[0].mapping.pes);
        let origin = if given { "as given".to_owned() } else { format!("{} starts", self.starts) };
        let relays = if self.alternatives.len() > 1 { ", with and without relays" } else { "" };
        format!("{equations} equations on {pes} PEs, {origin}{relays}")
    }
}

/// The mapping of a file, and the number of relays in it.
///
/// # Errors
/// An equation of the step, or one of its relays, is not in the file, or the file has others.
pub fn given(file: &MappingFile, graph: &StepGraph, max_in_degree: u32) -> Result<(Mapping, u32), Failure> {
    let relays = file.relays();
    let relayed = (relays > 0).then(|| relay(graph, file.pes(), max_in_degree, relays)).flatten();
    match relayed {
        Some(relayed) => Ok((file.mapping(&relayed.graph)?, relays)),
        None => Ok((file.mapping(graph)?, 0)),
    }
}
