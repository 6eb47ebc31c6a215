//! Holds partitions from elsewhere against the mapper's own: all go through the same scheduler.
//!
//! ```sh
//! partitions MODEL.spec PES                         # the ODE-dependency graph in the format of METIS
//! partitions MODEL.spec PES SEEDS [PARTITION ...]   # one line per mapping: own ones for seeds 1 to SEEDS, then files
//! ```
//!
//! A partition is a file with the number of a PE per line, one line per equation. Each line of the result holds where
//! the mapping comes from, its seed, PEs, largest load, connections, largest in-degree and cycles per step.
//! `xtask partitions` makes the comparison of `docs/decisions/0018-mapping.md` with it.

use std::path::PathBuf;
use std::process::ExitCode;

use pe_hls::mapping::{MapOptions, Problem, map};
use pe_hls::schedule::{Bound, schedule};
use pe_hls::step::StepOptions;
use pe_ir::graph::StepGraph;
use pe_ir::index::PeId;
use pe_ir::mapping::Mapping;
use pe_ir::word::{Latency, WordFormat};
use petgraph::visit::EdgeRef;

/// Words of 32 bits, multiplier 25x18.
const FORMAT: WordFormat = WordFormat::new(32, 25, 18);

/// The step graph of a model for a number of PEs, as `compile` takes it.
fn graph(spec: &str, pes: u32) -> Result<StepGraph, String> {
    let mut sources = pe_flow::spec::main_file(&PathBuf::from(spec)).map_err(|failure| format!("{failure:?}"))?;
    let loader = pe_flow::spec::ModelFolder::of(&PathBuf::from(spec));
    let compiled = pe_frontend::compile(&mut sources, &loader, &pe_frontend::Overrides::default());
    let (model, _) = compiled.map_err(|findings| format!("{findings:?}"))?;
    let options = StepOptions { pes: Some(pes), ..StepOptions::default() };
    let graph = pe_hls::step::build_with(&model, &options).map_err(|findings| format!("{findings:?}"))?;
    let split = pe_hls::split::split(&graph, pes, MapOptions::DEFAULT_MAX_IN_DEGREE, Latency::of(&FORMAT));
    Ok(split.unwrap_or(graph))
}

/// The ODE-dependency graph, undirected, weighted by load, as METIS reads it.
fn metis(problem: &Problem) -> String {
    let graph = problem.ode_graph();
    let mut adjacent: Vec<Vec<usize>> = vec![Vec::new(); graph.node_count()];
    for edge in graph.edge_references() {
        adjacent[edge.source().index()].push(edge.target().index());
        adjacent[edge.target().index()].push(edge.source().index());
    }
    for row in &mut adjacent {
        row.sort_unstable();
        row.dedup();
    }
    let mut text = format!("{} {} 010\n", adjacent.len(), adjacent.iter().map(Vec::len).sum::<usize>() / 2);
    for (row, load) in adjacent.iter().zip(problem.loads()) {
        let words: Vec<String> = row.iter().map(|next| (next + 1).to_string()).collect();
        text += &format!("{load} {}\n", words.join(" "));
    }
    text
}

/// Prints a mapping's figures.
fn row(name: &str, seed: &str, graph: &StepGraph, problem: &Problem, mapping: &Mapping) {
    let cost = problem.cost(mapping);
    let period = schedule(graph, mapping, Latency::of(&FORMAT)).period;
    println!(
        "{} {seed} {} {} {} {} {period}",
        name.replace(' ', "-"),
        mapping.pes,
        cost.max_load,
        cost.connections,
        cost.max_in_degree
    );
}

fn run() -> Result<(), String> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [spec, pes, rest @ ..] = words.as_slice() else { return Err("usage: see the head of the example".to_owned()) };
    let number = |word: &String| word.parse::<u32>().map_err(|error| format!("`{word}`: {error}"));
    let pes = number(pes)?;
    let graph = graph(spec, pes)?;
    let problem = Problem::of(&graph);
    let [seeds, files @ ..] = rest else {
        print!("{}", metis(&problem));
        return Ok(());
    };
    let seeds = number(seeds)?;
    println!("bound - {pes} - - - {}", Bound::of(&graph, pes, Latency::of(&FORMAT)).binding().0);
    for seed in 1..=u64::from(seeds) {
        let tries = MapOptions::default_tries(problem.equations());
        let options = MapOptions { pes, seed, tries, max_in_degree: MapOptions::DEFAULT_MAX_IN_DEGREE };
        for candidate in map(&problem, &options).map_err(|error| error.to_string())? {
            row(candidate.start, &seed.to_string(), &graph, &problem, &candidate.mapping);
        }
    }
    for file in files {
        let text = std::fs::read_to_string(file).map_err(|error| format!("{file}: {error}"))?;
        let parsed: Result<Vec<u32>, _> = text.split_whitespace().map(str::parse).collect();
        let mut pe_of = parsed.map_err(|error| format!("{file}: {error}"))?;
        if pe_of.len() != graph.equations.len() {
            return Err(format!("{file}: {} numbers for {} equations", pe_of.len(), graph.equations.len()));
        }
        // A partition may leave parts empty; those are no PEs.
        let mut used = pe_of.clone();
        used.sort_unstable();
        used.dedup();
        for pe in &mut pe_of {
            *pe = used.binary_search(pe).expect("taken from it") as u32;
        }
        let pe_of = pe_of.into_iter().map(PeId::new).collect();
        let mapping = Mapping { pes: used.len() as u32, pe_of };
        let name = PathBuf::from(file).file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let (name, seed) = name.rsplit_once('-').unwrap_or((&name, "-"));
        row(name, seed, &graph, &problem, &mapping);
    }
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
