//! The mappings that are candidates: those of the step as it is, and those of the step with relays of its hubs.

use std::borrow::Cow;
use std::cell::LazyCell;
use std::sync::Arc;

use pe_hls::mapping::{self, Candidate, MapError, MapOptions, Problem, Tables, default_pes};
use pe_hls::pairs;
use pe_hls::relay::{Relayed, relay};
use pe_hls::rounds::Rounds;
use pe_hls::route::{Routed, route};
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::number;
use pe_ir::mapping::Mapping;
use pe_ir::source::Diagnostic;
use pe_ir::word::Latency;

use crate::failure::Failure;
use crate::known::Known;
use crate::mapping_file::MappingFile;
use crate::settings::{MappingOptions, StageLoop};
use crate::spec::LoadedModel;
use pe_judge::runs::Judged;

/// Numbers of relays that are tried: one gathers most, more are closer to their readers.
const RELAYS: [u32; 4] = [1, 2, 4, 8];

/// Mappings from which ones are made in which equations with the same tables are together.
const GATHERED: usize = 2;

/// A step that takes no more than this times the products of its fullest PE gains little from other mappings.
const TIGHT: f64 = 1.05;

/// Options of the network.
#[derive(Clone, Debug)]
pub struct Network {
    /// Their number, unless the default is wanted.
    pub pes: Option<u32>,
    /// Whether a number of PEs that is larger than useful is refused rather than taken for the largest useful one.
    pub exact: bool,
    /// Seed of the annealer.
    pub seed: u64,
    /// The mapping that the user gives.
    pub given: Option<Given>,
}

/// A mapping that the user gives.
#[derive(Clone, Debug)]
pub struct Given {
    /// The PE of each equation.
    pub mapping: Mapping,
    /// The number of relays of hubs in it.
    pub relays: u32,
    /// Whether it names relays on the routes of values, which are found anew.
    pub hops: bool,
}

/// A step graph to map: without relays, with a number of them, or with those on the routes of one mapping.
pub struct Alternative<'a> {
    /// The graph.
    pub graph: Arc<StepGraph>,
    /// Its numbers.
    pub fixed: Cow<'a, FixedPoint>,
    /// The step with all pairs that some mapping could allow.
    pub optimistic: Arc<StepGraph>,
    /// The mapping problem of the graph with the pairs that mappings allow.
    pub problem: Problem,
    /// Number of relays of hubs.
    pub relays: u32,
    /// The graph that no mapping can do with less than: without what routes add.
    pub least: Arc<StepGraph>,
    relayed: Option<Relayed>,
}

impl<'a> Alternative<'a> {
    fn new(graph: Arc<StepGraph>, fixed: Cow<'a, FixedPoint>, relays: u32, relayed: Option<Relayed>) -> Self {
        let optimistic = pairs::optimistic(&graph, &fixed).map_or_else(|| Arc::clone(&graph), Arc::new);
        let problem = Problem::with_pairs(&graph, &fixed, &optimistic);
        let least = Arc::clone(&optimistic);
        Alternative { graph, fixed, optimistic, problem, relays, least, relayed }
    }

    /// The graph of a mapping with routes over other PEs, and the mapping of all its equations.
    fn routed(&self, fixed: &FixedPoint, candidate: Candidate, ports: u32) -> Option<(Self, Candidate)> {
        let Routed { relayed, mapping } = route(&self.graph, &candidate.mapping, ports)?;
        let numbers = relayed.fixed(&self.graph, fixed)?;
        let graph = Arc::clone(&relayed.graph);
        let routed = Alternative::new(graph, Cow::Owned(numbers), 0, Some(relayed));
        let cost = routed.problem.cost(&mapping);
        let least = Arc::clone(&self.least);
        Some((Alternative { least, ..routed }, Candidate { mapping, cost, ..candidate }))
    }

    /// The mapping that the step was cut for, if there is one for the number of PEs that is asked for.
    fn on_grid(&self, network: &Network, options: &MappingOptions) -> Option<Candidate> {
        let mapping = mapping::placed(&self.graph)?;
        let cost = self.problem.cost(&mapping);
        let fits = network.pes.is_none_or(|pes| pes == mapping.pes) && cost.max_in_degree <= options.most_ports();
        fits.then_some(Candidate { mapping, cost, start: mapping::GRID, start_cost: cost })
    }

    /// Mappings of the alternative, and mappings from which routes over other PEs lead to such with as many ports as aimed at.
    ///
    /// More ports are a cost and no limit, unless the user set it: where the aim binds, mappings are annealed without one, too.
    fn mapped(
        &self,
        at: impl Fn(u32) -> MapOptions,
        options: &MappingOptions,
        known: &Known,
    ) -> Result<Mapped, MapError> {
        let (aim, most) = (options.ports(), options.most_ports());
        let first = known.annealed(&self.problem, &at(aim))?;
        let within = |candidates: &[Candidate]| -> Vec<Candidate> {
            candidates.iter().filter(|candidate| candidate.cost.max_in_degree <= most).cloned().collect()
        };
        let mut direct = within(&first);
        let waits = LazyCell::new(|| first.first().is_some_and(|first| self.waits(first, known)));
        // Loads are even where the mapper sees the pairs; mappings as if none were lost may be a shorter way through the step.
        if self.relays == 0 && self.problem.has_pairs() && *waits {
            let others = known.annealed(&Problem::of(&self.optimistic), &at(aim))?;
            let counted = |other: Candidate| Candidate { cost: self.problem.cost(&other.mapping), ..other };
            direct.extend(within(&others.into_iter().map(counted).collect::<Vec<_>>()));
        }
        let takes_all = |candidate: &Candidate| candidate.cost.max_in_degree >= aim;
        let binds = match options.max_in_degree {
            Some(_) => direct.is_empty() || at(aim).pes > aim + 1,
            // Some mapping takes as many ports as aimed at, and the first one does or is scheduled with cycles to spare.
            None => self.relays == 0 && first.iter().any(takes_all) && (first.first().is_some_and(takes_all) || *waits),
        };
        let mut routed = Vec::new();
        if self.relays == 0 && binds {
            if first.iter().all(|candidate| candidate.cost.max_in_degree > aim) {
                routed.clone_from(&first);
            }
            let free = known.annealed(&self.problem, &at(MappingOptions::MOST_PORTS))?;
            if options.max_in_degree.is_none() {
                direct.extend(within(&free));
            }
            routed.extend(free);
        }
        let error = || mapping::within(&self.problem, &at(aim), first).expect_err("none is within the limit");
        let refused = direct.is_empty().then(error);
        Ok(Mapped { direct, routed, refused })
    }

    /// Whether a mapping is scheduled with cycles to spare.
    fn waits(&self, candidate: &Candidate, known: &Known) -> bool {
        let paired = pairs::pair(&self.graph, &self.fixed, &candidate.mapping);
        let issued = paired.as_ref().map_or(&*self.graph, |paired| &paired.graph);
        let draft = known.schedule(issued, &candidate.mapping, Latency::of(&self.fixed.format), true);
        f64::from(draft.period) > TIGHT * f64::from(candidate.cost.max_load)
    }

    /// Whether values are copied that the step itself does not copy.
    pub fn copies(&self) -> bool {
        self.relayed.is_some()
    }

    /// Copies in a step that carry values on; none without routes.
    pub fn hops(&self) -> u32 {
        match &self.relayed {
            Some(relayed) if self.relays == 0 => number(relayed.copied.len()),
            _ => 0,
        }
    }

    fn with_relays(graph: &StepGraph, fixed: &FixedPoint, pes: u32, max_in_degree: u32, relays: u32) -> Option<Self> {
        let relayed = relay(graph, pes, max_in_degree, relays)?;
        let numbers = relayed.fixed(graph, fixed)?;
        Some(Alternative::new(Arc::clone(&relayed.graph), Cow::Owned(numbers), relays, Some(relayed)))
    }

    /// What the runs found, with the values of the relays.
    pub fn judged(&self, judged: &Arc<Judged>) -> Arc<Judged> {
        let Some(relayed) = &self.relayed else { return Arc::clone(judged) };
        let largest = relayed.extended(&judged.largest);
        Arc::new(Judged { fixed: self.fixed.clone().into_owned(), largest, ..Judged::clone(judged) })
    }
}

/// What is found for an alternative.
struct Mapped {
    direct: Vec<Candidate>,
    /// Mappings from which routes lead to others.
    routed: Vec<Candidate>,
    /// Why there is no direct one.
    refused: Option<MapError>,
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
    /// Mappings in which equations with the same tables are together, which are the last.
    pub gathered: usize,
    /// Blocks of the base memories of each mapping, about, if the step has tables.
    pub blocks: Vec<u32>,
    starts: usize,
}

impl<'a> Candidates<'a> {
    /// Maps the equations, or takes the mapping that is given. A default number of PEs is halved as long as some PE would
    /// need more input ports than it can have, with and without relays.
    ///
    /// # Errors
    /// That of the step without relays, if no alternative has a mapping.
    pub fn of(
        graph: &Arc<StepGraph>,
        fixed: &'a FixedPoint,
        network: &Network,
        options: &MappingOptions,
        known: &Known,
    ) -> Result<Self, MapError> {
        let mut plain = Some(Alternative::new(Arc::clone(graph), Cow::Borrowed(fixed), 0, None));
        let aim = options.ports();
        let relayed = |pes, relays| Alternative::with_relays(graph, fixed, pes, aim, relays);
        let mut set = Candidates {
            alternatives: Vec::new(),
            candidates: Vec::new(),
            of: Vec::new(),
            plain: 0,
            gathered: 0,
            blocks: Vec::new(),
            starts: 0,
        };
        if let Some(Given { mapping, relays, hops }) = &network.given {
            let alternative =
                (*relays > 0).then(|| relayed(mapping.pes, *relays)).flatten().or(plain).expect("one of two");
            let most = if *hops { aim } else { options.most_ports() };
            let (alternative, candidate) = match mapping::given(&alternative.problem, mapping, most) {
                Ok(candidate) => (alternative, candidate),
                Err(error) if relays > &0 => return Err(error),
                Err(error) => {
                    let candidate = mapping::given(&alternative.problem, mapping, u32::MAX)?;
                    alternative.routed(fixed, candidate, most).ok_or(error)?
                }
            };
            set.of_given(alternative, candidate);
            return Ok(set);
        }
        let first = plain.take().expect("not mapped yet");
        if let Some(candidate) = first.on_grid(network, options) {
            set.add(first, vec![candidate]);
            return Ok(set);
        }
        plain = Some(first);
        // Relays would take away what a stage loop saves.
        let looped = LazyCell::new(|| {
            let rounds = || graph.parts.is_one_of_many() || Rounds::of(graph, fixed).is_some();
            options.stage_loop != StageLoop::Off && rounds()
        });
        let first = plain.as_ref().expect("not mapped yet");
        let useful = |pes: u32| if network.exact { pes } else { pes.min(first.problem.equations()) };
        let default = || default_pes(&first.optimistic, Latency::of(&fixed.format));
        let mut pes = network.pes.map_or_else(default, useful);
        let map_options = |pes: u32, equations: u32, max_in_degree: u32| MapOptions {
            pes,
            seed: network.seed,
            tries: options.tries.unwrap_or_else(|| MapOptions::default_tries(equations)),
            max_in_degree,
        };
        loop {
            let mut refused = None;
            let with_relays = RELAYS.iter().filter_map(|relays| relayed(pes, *relays).filter(|_| !*looped));
            for alternative in plain.take().into_iter().chain(with_relays) {
                let equations = alternative.problem.equations();
                let mapped = alternative.mapped(|ports| map_options(pes, equations, ports), options, known)?;
                let routed =
                    mapped.routed.into_iter().filter_map(|candidate| alternative.routed(fixed, candidate, aim));
                let routed: Vec<(Alternative, Candidate)> = routed.collect();
                match mapped.refused {
                    None => set.add(alternative, mapped.direct),
                    Some(error) if alternative.relays == 0 => {
                        refused = Some(error);
                        plain = Some(alternative);
                    }
                    Some(_) => {}
                }
                set.starts += routed.len();
                routed.into_iter().for_each(|(alternative, candidate)| set.take(alternative, [candidate]));
            }
            match refused.filter(|_| set.of.is_empty()) {
                Some(MapError::InDegree { .. }) if network.pes.is_none() && pes > 1 => pes /= 2,
                Some(error) => return Err(error),
                None => break,
            }
        }
        let equations = set.alternatives[0].problem.equations();
        set.gather(|ports| map_options(pes, equations, ports), aim, options.most_ports());
        Ok(set)
    }

    /// Adds mappings in which equations with the same tables are together, made from the best ones of the step as it is,
    /// where that saves blocks of memory. Teams that need more ports than aimed at may have as many as there are at most.
    fn gather(&mut self, options: impl Fn(u32) -> MapOptions, aim: u32, most: u32) {
        let plain = &self.alternatives[0];
        let tables = if plain.copies() { None } else { Tables::of(&plain.graph, &plain.fixed) };
        let Some(tables) = tables else { return };
        let first = self.candidates.iter().zip(&self.of).filter(|(_, of)| **of == 0).take(GATHERED);
        let gathered = first.filter_map(|(candidate, _)| {
            let options = options(aim.max(candidate.cost.max_in_degree));
            let other = mapping::gathered(&plain.problem, &tables, candidate, &options)?;
            (tables.blocks(&other.mapping) < tables.blocks(&candidate.mapping)).then_some(other)
        });
        let mut gathered: Vec<Candidate> = gathered.collect();
        let best = self.candidates.iter().zip(&self.of).find(|(_, of)| **of == 0).map(|(candidate, _)| candidate);
        let teams = best.and_then(|best| {
            let within = |ports: u32| {
                let teams = mapping::in_teams(&plain.problem, &tables, &best.mapping, &options(ports))?;
                (teams.cost.max_in_degree <= ports).then_some(teams)
            };
            let ports = aim.max(best.cost.max_in_degree);
            within(ports).or_else(|| (most > ports).then(|| within(most)).flatten())
        });
        let fewest = gathered.iter().chain(best).map(|other| tables.blocks(&other.mapping)).min();
        gathered.extend(teams.filter(|teams| fewest.is_some_and(|fewest| tables.blocks(&teams.mapping) < fewest)));
        self.gathered = gathered.len();
        self.candidates.extend(gathered);
        self.of.resize(self.candidates.len(), 0);
        self.blocks = self.candidates.iter().map(|candidate| tables.blocks(&candidate.mapping)).collect();
    }

    /// Adds an alternative with its mappings.
    fn add(&mut self, alternative: Alternative<'a>, candidates: Vec<Candidate>) {
        self.starts += candidates.len();
        self.take(alternative, candidates);
    }

    /// Adds an alternative with the mapping that is given for it.
    fn of_given(&mut self, alternative: Alternative<'a>, candidate: Candidate) {
        self.starts += 1;
        self.take(alternative, [candidate]);
    }

    fn take(&mut self, alternative: Alternative<'a>, candidates: impl IntoIterator<Item = Candidate>) {
        self.candidates.extend(candidates);
        self.of.resize(self.candidates.len(), self.alternatives.len());
        if alternative.relays == 0 {
            self.plain = self.candidates.len();
        }
        self.alternatives.push(alternative);
    }

    /// What was mapped, in words.
    pub fn figure(&self, given: bool) -> String {
        let first = &self.alternatives[0];
        let (equations, pes) = (first.least.equations.len(), self.candidates[0].mapping.pes);
        let origin = if given { "as given".to_owned() } else { format!("{} starts", self.starts) };
        let relays = match self.alternatives.len() {
            1 => "",
            _ if self.alternatives.iter().any(|alternative| alternative.hops() > 0) => ", with routes over other PEs",
            _ => ", with and without relays",
        };
        format!("{equations} equations on {pes} PEs, {origin}{relays}")
    }
}

/// The mapping of a file.
///
/// # Errors
/// An equation of the step, or one of its relays, is not in the file, or the file has others.
pub fn given(file: &MappingFile, graph: &StepGraph, max_in_degree: u32) -> Result<Given, Failure> {
    let (relays, hops) = (file.relays(), file.hops());
    let relayed = (relays > 0).then(|| relay(graph, file.pes(), max_in_degree, relays)).flatten();
    match relayed {
        Some(relayed) => Ok(Given { mapping: file.mapping(&relayed.graph)?, relays, hops }),
        None => Ok(Given { mapping: file.mapping(graph)?, relays: 0, hops }),
    }
}

/// Warnings about a network that has fewer PEs than asked for, PEs with more ports than usual, or values that are copied
/// on their way: of the candidate that was taken.
pub fn other_than_asked(
    network: &Network,
    options: &MappingOptions,
    alternative: &Alternative,
    taken: &Candidate,
) -> Vec<Diagnostic> {
    let (pes, aim, ports) = (taken.mapping.pes, options.ports(), taken.cost.max_in_degree);
    let mut warnings = Vec::new();
    if let Some(asked) = network.pes.filter(|asked| *asked > pes) {
        let message = format!("{pes} PEs in place of {asked}: the step has no more equations");
        let help = "more PEs than equations would stand idle; `--pes` says how many there are at most";
        warnings.push(Diagnostic::global(codes::FEWER_PES, message).with_help(help).into_warning());
    }
    if ports > aim {
        let message = format!("PEs have up to {ports} input ports; {aim} are usual");
        let help = "they save time, and wide multiplexers take cells: `--max-in-degree` sets a bound";
        warnings.push(Diagnostic::global(codes::MANY_PORTS, message).with_help(help).into_warning());
    }
    if alternative.hops() > 0 {
        let message = format!("values travel over other PEs, which copy them: {aim} input ports for a PE do not do");
        let help = match options.max_in_degree {
            Some(_) => {
                "each copy takes an issue slot, and its readers wait for it: more ports with `--max-in-degree`, or \
                 fewer PEs, save cycles"
            }
            None => {
                "each copy takes an issue slot, and its readers wait for it; no mapping with more ports was found that \
                 takes less time"
            }
        };
        warnings.push(Diagnostic::global(codes::HOPS, message).with_help(help).into_warning());
    }
    warnings
}

/// A mapping error as the user gets it.
pub fn failure(error: MapError, graph: &StepGraph, loaded: &LoadedModel) -> Failure {
    match error {
        MapError::Pes { .. } => Failure::Usage(error.to_string()),
        MapError::InDegree { pe, equation, degree, limit } => {
            let equation = &graph.equations[equation];
            let message = format!("PE {pe}, which computes `{}`, needs {degree} input ports of {limit}", equation.name);
            let finding = Diagnostic::error(codes::IN_DEGREE, equation.span, message)
                .with_help("use fewer PEs with `--pes`, or allow more ports with `--max-in-degree`");
            Failure::Spec(vec![finding], loaded.sources.clone())
        }
    }
}
