//! What goals are judged by: the true error of a design, and the designs of an exhaustive grid.
//!
//! ```sh
//! goals truth SPEC --goal E OPTIONS   # largest error of the design of `compile SPEC OPTIONS`, and how far that is known
//! goals grid SPEC --goal E            # points of the grid that were run, that were left out, and one that meets the goal
//! ```
//!
//! The truth is a run in double precision with a much smaller step, of a method and with code that the search has no part
//! in, compared at every step of the design. The step is divided until two such runs agree to a twentieth of the goal.
//!
//! The grid has all solvers, 20 steps, 5 words and 4 multipliers. A solver and step whose run in double precision has
//! more than twice the error that is asked for is not run in words: rounding would have to cancel half of it. What takes
//! more products than the budget is left out, and counted.
//!
//! `xtask goals` calls both.

use std::process::ExitCode;
use std::sync::mpsc::channel;

use clap::{Args, Parser};
use pe_flow::explore::axes::with_forms;
use pe_flow::explore::estimate::Estimate;
use pe_flow::explore::family::Job;
use pe_flow::explore::steps::suitable;
use pe_flow::explore::sweep::{self, Event, Sweep};
use pe_flow::failure::Failure;
use pe_flow::pipeline;
use pe_flow::watch::Stopwatch;
use pe_hls::step::{StepOptions, build_with};
use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_ir::word::MultiplierPorts;
use pe_judge::runs::port_words;
use pe_judge::{DesignPoint, ProofMode};
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;
use pe_sim::fixed::FixedRun;
use pe_synth::messages::MessageFormat;
use pe_synth::options::{MappingArgs, ModelArgs, PointArgs};
use pe_synth::progress;
use pe_target::clock::ClockSource;

/// Part of the goal to which two runs with smaller steps have to agree.
const AGREEMENT: f64 = 0.05;

/// Halvings of the step, and products that the finest run may take.
const HALVINGS: [i32; 6] = [2, 4, 6, 8, 10, 12];
const MOST_PRODUCTS: f64 = 4e9;

/// The grid: powers of two of the spec's step, bits of words, multipliers; products over the span that a run may take.
const POWERS: std::ops::Range<i32> = -14..6;
const STORAGES: [u32; 5] = [24, 32, 36, 40, 48];
const MULTIPLIERS: [MultiplierPorts; 4] = [
    MultiplierPorts::new(25, 18),
    MultiplierPorts::new(25, 35),
    MultiplierPorts::new(32, 32),
    MultiplierPorts::new(35, 35),
];
const GRID_PRODUCTS: f64 = 1e9;

/// Times the goal that a run in double precision may miss it by.
const CANCELLED: f64 = 2.0;

#[derive(Parser)]
enum Command {
    /// The true error of a design
    Truth(Question),
    /// The grid
    Grid(Question),
}

#[derive(Args)]
struct Question {
    #[command(flatten)]
    model: ModelArgs,
    /// The largest total error that is asked for
    #[arg(long)]
    goal: f64,
    #[command(flatten)]
    point: PointArgs,
    #[command(flatten)]
    mapping: MappingArgs,
}

/// A run with a smaller step.
struct Finer<'a> {
    model: Model,
    run: DoubleRun<'a>,
    parts: u64,
    /// Largest magnitude of each state, within steps of the design, too.
    largest: Vec<f64>,
}

impl<'a> Finer<'a> {
    fn new(model: &Model, graph: &'a StepGraph, halvings: i32) -> Finer<'a> {
        let mut model = model.clone();
        model.set_step(libm::scalbn(model.step, -halvings));
        let largest = model.states.iter().map(|state| state.initial.abs()).collect();
        Finer { run: DoubleRun::new(graph), model, parts: 1 << halvings, largest }
    }

    /// Goes on by a step of the design; none if it diverges.
    fn step(&mut self, step: u64) -> Option<Vec<f64>> {
        for part in 0..self.parts {
            // Inputs as they are in the middle, which is right to second order.
            let [begin, middle] = [0.0, 0.5].map(|at| self.model.time(step * self.parts + part, at));
            self.run.step(&self.model.hold_inputs(middle, begin)).ok()?;
            let states = self.largest.iter_mut().zip(self.run.states());
            states.for_each(|(largest, state)| *largest = largest.max(state.abs()));
        }
        Some(self.run.states().collect())
    }
}

/// Largest error of the design over all steps, and largest difference of two runs with smaller steps, both relative to
/// the largest magnitude of the state.
fn held_against(design: &pipeline::Design, model: &Model, solver: Solver, halvings: i32) -> Option<(f64, f64)> {
    let finer = |halvings: i32| {
        let mut model = Model { solver, ..model.clone() };
        model.set_step(libm::scalbn(model.step, -halvings));
        build_with(&model, &StepOptions::default()).ok()
    };
    let graphs = (finer(halvings)?, finer(halvings + 1)?);
    let products = graphs.1.macs() as f64 * model.steps() as f64 * libm::scalbn(1.0, halvings + 1);
    if products > MOST_PRODUCTS {
        return None;
    }
    let (mut coarse, mut fine) = (Finer::new(model, &graphs.0, halvings), Finer::new(model, &graphs.1, halvings + 1));
    let mut run = FixedRun::new(&design.graph, &design.judged.fixed);
    let states = model.states.len();
    let mut apart = vec![(0.0f64, 0.0f64); states];
    for step in 0..model.steps() {
        let words = port_words(model, &run, step);
        run.step(&words);
        let (coarse, fine) = (coarse.step(step)?, fine.step(step)?);
        let compared = apart.iter_mut().zip(coarse).zip(fine).enumerate();
        for (state, (((error, difference), coarse), fine)) in compared {
            *error = error.max((run.state(StateId::at(state)) - fine).abs());
            *difference = difference.max((coarse - fine).abs());
        }
    }
    let largest = fine.largest;
    let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
    let scales = model.own_scales(Trajectory { largest, ..Trajectory::new(states) }.scales(&quantities));
    let relative = |apart: f64, scale: f64| if apart == 0.0 { 0.0 } else { apart / scale };
    let worst = apart.iter().zip(scales).map(|((a, b), scale)| (relative(*a, scale), relative(*b, scale)));
    Some(worst.fold((0.0, 0.0), |(a, b), (c, d)| (a.max(c), b.max(d))))
}

fn truth(question: &Question) -> Result<String, Failure> {
    let Question { model: options, point, mapping, goal } = question;
    let point = point.point();
    let loaded = options.load(&point, &progress::listener(true, MessageFormat::Human))?;
    let design = pipeline::design(&loaded, &options.settings(mapping), &point, &mut Stopwatch::silent())?;
    let solvers = if loaded.model.phases.is_empty() { vec![Solver::Rk4, Solver::Rodas3] } else { vec![Solver::Rodas3] };
    let tries = solvers.into_iter().flat_map(|solver| HALVINGS.map(|halvings| (solver, halvings)));
    let mut tries = tries.filter_map(|(solver, halvings)| {
        let (error, known) = held_against(&design, &loaded.model, solver, halvings)?;
        (known <= AGREEMENT * goal).then(|| format!("{error:e} {known:e} {} / 2^{halvings}", solver.name()))
    });
    Ok(tries.next().unwrap_or_else(|| "unknown".to_owned()))
}

fn grid(question: &Question) -> Result<String, Failure> {
    let Question { model: options, mapping, goal, .. } = question;
    let loaded = options.read(&progress::listener(true, MessageFormat::Human))?;
    let mut settings = options.settings(mapping);
    settings.criteria.proof = ProofMode::Off;
    let model = &loaded.model;
    let graph = |solver: Solver| Some((solver, pe_hls::step::build(&Model { solver, ..model.clone() }).ok()?));
    let graphs: Vec<(Solver, StepGraph)> = Solver::ALL.into_iter().filter_map(graph).collect();
    let mut steps: Vec<f64> =
        POWERS.rev().filter_map(|power| suitable(model, None, libm::scalbn(model.step, power))).collect();
    steps.dedup();
    let (mut run, mut left_out, mut met) = (0, 0, None);
    let sweep = Sweep {
        loaded: loaded.clone(),
        settings: settings.clone(),
        conserved: Vec::new(),
        within: Some(CANCELLED * goal),
        early: false,
        until: None,
        clock: ClockSource { given: None, device: None },
        estimate: Estimate::of(model, &graphs, &settings.mapping),
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|error| Failure::File(error.to_string()))?;
    for step in steps {
        for (solver, graph) in &graphs {
            let products = graph.macs() as f64 * model.steps() as f64 * model.step / step;
            let words = STORAGES.into_iter().flat_map(|storage| MULTIPLIERS.map(|ports| (storage, ports)));
            let points = words.map(|(storage, multiplier)| DesignPoint {
                solver: Some(*solver),
                step: Some(step),
                storage,
                multiplier: Some(multiplier),
                ..question.point.point()
            });
            let points = with_forms(points.collect(), model, &settings.mapping);
            if products > GRID_PRODUCTS {
                left_out += points.len();
                continue;
            }
            run += points.len();
            let job = |(index, point): (usize, &DesignPoint)| Job { index, point: *point, command: String::new() };
            let (sender, events) = channel();
            sweep::run(&sweep, points.iter().enumerate().map(job).collect(), &pool, &sender);
            drop(sender);
            for event in events {
                if let Event::Point(index, pe_flow::explore::row::Outcome::Compiled(compiled)) = event
                    && let Some(error) = compiled.figures.total_error().filter(|error| error <= goal)
                {
                    let DesignPoint { storage, multiplier, .. } = points[index];
                    let ports = multiplier.expect("points of the grid have one");
                    met = met.or(Some(format!("{} {step:e} {storage} {ports} {error:e}", solver.name())));
                }
            }
            if let Some(met) = met {
                return Ok(format!("{run} {left_out} {met}"));
            }
        }
    }
    Ok(format!("{run} {left_out}"))
}

fn main() -> ExitCode {
    let answer = match Command::parse() {
        Command::Truth(question) => truth(&question),
        Command::Grid(question) => grid(&question),
    };
    match answer {
        Ok(line) => println!("{line}"),
        Err(failure) => {
            eprintln!("{failure:?}");
            return ExitCode::from(1);
        }
    }
    ExitCode::SUCCESS
}
