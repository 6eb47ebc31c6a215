//! A random model taken through the stages, so that a test can look at every result on the way.

use pe_hls::formats::{self, Ranges};
use pe_hls::grid::{OnGrid, grid};
use pe_hls::mapping::{MapOptions, Problem};
use pe_hls::pairs;
use pe_hls::relay::relay;
use pe_hls::rounds::Rounds;
use pe_hls::route::{Routed, route};
use pe_hls::step::StepOptions;
use pe_ir::graph::{FixedPoint, StageForm, StepGraph};
use pe_ir::index::PeId;
use pe_ir::index::StateId;
use pe_ir::mapping::Mapping;
use pe_ir::model::{Model, Solver};
use pe_ir::program::Program;
use pe_ir::schedule::Schedule;
use pe_ir::verify;
use pe_ir::word::{Latency, WordFormat};
use pe_judge::runs;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::{self, Machine};

use super::{Family, random_model, tables};

/// Widths with the guard bits that the product gives them.
pub const fn format(storage_bits: u32, data_bits: u32, coefficient_bits: u32) -> WordFormat {
    WordFormat::new(storage_bits, data_bits, coefficient_bits)
}

/// With and without dropped bits, up to the largest that the command line takes.
pub const FORMATS: [WordFormat; 7] = [
    format(32, 32, 32),
    format(32, 25, 18),
    format(18, 18, 25),
    format(18, 18, 18),
    format(17, 25, 18),
    format(40, 35, 35),
    format(32, 18, 18),
];

/// How equations get to PEs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// The annealer with a small budget.
    Annealed,
    /// Scattered without regard to what reads what: the schedule must be right for any mapping.
    Scattered,
}

/// Fixed-point steps before a design's middle.
const MIDDLE: u64 = 25;

/// Largest in-degree that a mapping may have in these tests.
const MAX_IN_DEGREE: u32 = 30;

/// A random model and what every stage made of it.
pub struct Flow {
    /// What it is, for messages.
    pub label: String,
    pub model: Model,
    pub graph: StepGraph,
    pub fixed: FixedPoint,
    pub mapping: Mapping,
    pub schedule: Schedule,
    pub program: Program,
    /// Products of two operands with equal coefficients.
    pub pairs: u64,
}

/// A start of a run: a program with its images and the inputs of the steps from there.
pub struct Start {
    pub name: &'static str,
    pub program: Program,
    pub stimulus: Vec<Vec<i64>>,
    /// Steps that were done before.
    pub step: u64,
}

impl Flow {
    /// Runs all stages; panics if an independent checker objects.
    pub fn random(
        family: Family,
        (states, pes): (usize, u32),
        solver: Solver,
        format: WordFormat,
        placement: Placement,
        seed: u64,
    ) -> Flow {
        let label = format!(
            "{family:?} {solver:?} {}x{} storage {}, {states} states on {pes} PEs, {placement:?}, seed {seed}",
            format.data_bits, format.coefficient_bits, format.storage_bits
        );
        let model = random_model(family, states, solver, seed);
        Flow::of(label, model, pes, format, placement)
    }

    /// A random model whose step has the given form.
    pub fn formed(
        (family, form): (Family, StageForm),
        (states, pes): (usize, u32),
        solver: Solver,
        format: WordFormat,
        placement: Placement,
        seed: u64,
    ) -> Flow {
        let model = random_model(family, states, solver, seed);
        let options = StepOptions { form: Some(form), ..StepOptions::default() };
        let graph = pe_hls::step::build_with(&model, &options).unwrap_or_else(|error| panic!("{form}: {error:?}"));
        let label = format!("{family:?} {solver:?} {form}, {format:?}, {states} states on {pes} PEs, seed {seed}");
        Flow::with(label, model, graph, pes, format, placement)
    }

    /// A random model with algebraic variables that go through tables.
    pub fn tabled(size: (usize, u32), solver: Solver, format: WordFormat, placement: Placement, seed: u64) -> Flow {
        let model = random_model(Family::Shared, size.0, solver, seed);
        let graph = tables::tabled(&stage_by_stage(&model));
        let label = format!("tables {solver:?}, {format:?}, {size:?}, {placement:?}, seed {seed}");
        Flow::with(label, model, graph, size.1, format, placement)
    }

    /// The same for a given model.
    pub fn of(label: String, model: Model, pes: u32, format: WordFormat, placement: Placement) -> Flow {
        let graph = stage_by_stage(&model);
        Flow::with(label, model, graph, pes, format, placement)
    }

    /// A model with the graph of its step, whose functions are tables.
    pub fn with(
        label: String,
        model: Model,
        graph: StepGraph,
        pes: u32,
        format: WordFormat,
        placement: Placement,
    ) -> Flow {
        let pes = pes.min(graph.equations.len() as u32);
        let latency = Latency::of(&format);
        let graph = pe_hls::split::split(&graph, pes, MAX_IN_DEGREE, latency).unwrap_or(graph);
        let graph = pe_hls::sums::cut(&graph, &format).unwrap_or(graph);
        let fixed = settled(&label, &model, &graph, format);
        let mapping = place(&label, &graph, pes, placement);
        Flow::mapped(label, model, graph, fixed, mapping)
    }

    /// What the stages behind the mapping make of it.
    fn mapped(label: String, model: Model, graph: StepGraph, fixed: FixedPoint, mapping: Mapping) -> Flow {
        let (pes, latency) = (mapping.pes, Latency::of(&fixed.format));
        let paired = pairs::pair(&graph, &fixed, &mapping);
        let (issued, numbers) = paired.as_ref().map_or((&graph, &fixed), |paired| (&paired.graph, &paired.fixed));
        let schedule = pe_hls::schedule::schedule(issued, &mapping, latency);
        let bound = pe_hls::schedule::Bound::of(issued, pes, latency).binding().0;
        assert!(schedule.period >= bound, "{label}: {} words, fewer than the bound of {bound}", schedule.period);
        assert_clean(&label, &verify::schedule::check(issued, &mapping, &schedule, latency));
        let program = pe_hls::assemble::assemble(&model, issued, numbers, &mapping, &schedule).expect("small");
        assert_clean(&label, &verify::program::check(&program, &graph, &fixed, 3));
        let pairs = paired.map_or(0, |paired| paired.pairs);
        Flow { label, model, graph, fixed, mapping, schedule, program, pairs }
    }

    /// The same design with relays of its hubs, if it has hubs for PEs of so few ports.
    pub fn relayed(&self, ports: u32, relays: u32) -> Option<Flow> {
        let Flow { model, graph, fixed, mapping, .. } = self;
        let relayed = relay(graph, mapping.pes, ports, relays)?;
        let numbers = relayed.fixed(graph, fixed)?;
        let mut mapping = mapping.clone();
        mapping.pe_of.extend((0..relays).map(|relay| PeId::new(relay * 7919 % mapping.pes)));
        let graph = StepGraph::clone(&relayed.graph);
        Some(Flow::mapped(format!("{}, {relays} relays", self.label), model.clone(), graph, numbers, mapping))
    }

    /// The same design with values that travel over other PEs, where PEs have so few ports.
    pub fn routed(&self, ports: u32) -> Option<Flow> {
        let Flow { model, graph, fixed, mapping, .. } = self;
        let Routed { relayed, mapping } = route(graph, mapping, ports)?;
        let numbers = relayed.fixed(graph, fixed)?;
        let label = format!("{}, {ports} ports", self.label);
        let cost = Problem::of(&relayed.graph).cost(&mapping);
        assert_clean(&label, &verify::mapping::check(&relayed.graph, &mapping, &cost, ports));
        Some(Flow::mapped(label, model.clone(), StepGraph::clone(&relayed.graph), numbers, mapping))
    }

    /// A model on a grid of PEs with so many ports, if a grid does.
    pub fn on_grid(label: String, model: Model, (pes, ports): (u32, u32), format: WordFormat) -> Option<Flow> {
        let OnGrid { graph, mapping, cost, .. } = grid(&stage_by_stage(&model), pes, ports, Latency::of(&format))?;
        let graph = pe_hls::sums::cut(&graph, &format).unwrap_or(graph);
        let fixed = settled(&label, &model, &graph, format);
        assert_clean(&label, &verify::mapping::check(&graph, &mapping, &cost, ports));
        Some(Flow::mapped(label, model, graph, fixed, mapping))
    }

    /// The same design with one round of control words for all stages, if these are alike.
    pub fn looped(&self) -> Option<Flow> {
        let Flow { model, graph, fixed, mapping, pairs, .. } = self;
        let paired = pairs::pair(graph, fixed, mapping);
        let (issued, numbers) = paired.as_ref().map_or((graph, fixed), |paired| (&paired.graph, &paired.fixed));
        let rounds = Rounds::of(issued, numbers)?;
        let label = format!("{}, looped", self.label);
        let latency = Latency::of(&fixed.format);
        let round = pe_hls::schedule::schedule(&rounds.graph, mapping, latency);
        let schedule = rounds.unroll(issued, &round);
        assert_clean(&label, &verify::schedule::check(issued, mapping, &schedule, latency));
        let program =
            pe_hls::assemble::assemble_rounds(model, issued, numbers, mapping, &rounds, &round).expect("small");
        assert_clean(&label, &verify::program::check(&program, graph, fixed, 3));
        let (model, graph, fixed, mapping) = (model.clone(), graph.clone(), fixed.clone(), mapping.clone());
        Some(Flow { label, model, graph, fixed, mapping, schedule, program, pairs: *pairs })
    }

    /// Input port words of a step.
    pub fn inputs(&self, run: &FixedRun, step: u64) -> Vec<i64> {
        runs::port_words(&self.model, run, step)
    }

    /// The run from the initial values.
    pub fn beginning(&self, steps: u64) -> Start {
        let run = FixedRun::new(&self.graph, &self.fixed);
        let stimulus = (0..steps).map(|step| self.inputs(&run, step)).collect();
        Start { name: "beginning", program: self.program.clone(), stimulus, step: 0 }
    }

    /// The run from the middle: images hold the states that the fixed-point run has reached there.
    pub fn middle(&self, steps: u64) -> Start {
        let run = self.fixed_run(MIDDLE);
        let mut program = self.program.clone();
        for (register, (state, _)) in program.states.iter().zip(&self.graph.states) {
            register.set(&mut program.pes, &program.format, run.word(*state));
        }
        program.start_ticks(MIDDLE);
        let stimulus = (MIDDLE..MIDDLE + steps).map(|step| self.inputs(&run, step)).collect();
        Start { name: "middle", program, stimulus, step: MIDDLE }
    }

    /// Both.
    pub fn starts(&self, steps: u64) -> [Start; 2] {
        [self.beginning(steps), self.middle(steps)]
    }

    /// Asserts that the machine has the words of the fixed-point run in states and outputs; how many it compared.
    /// `when` is for messages.
    pub fn assert_words(&self, machine: &Machine<&Program>, run: &FixedRun, when: &str) -> u64 {
        for (index, (state, _)) in self.graph.states.iter().enumerate() {
            assert_eq!(machine.state(StateId::at(index)), run.word(*state), "{}, {when}, state {index}", self.label);
        }
        for (output, value) in self.graph.outputs.iter().enumerate() {
            let word = machine::output_word(&self.fixed.format, run.word(*value));
            assert_eq!(machine.outputs()[output], word, "{}, {when}, output {output}", self.label);
        }
        (self.graph.states.len() + self.graph.outputs.len()) as u64
    }

    /// The fixed-point run after some steps.
    pub fn fixed_run(&self, steps: u64) -> FixedRun<'_> {
        let mut run = FixedRun::new(&self.graph, &self.fixed);
        for step in 0..steps {
            let inputs = self.inputs(&run, step);
            run.step(&inputs);
        }
        run
    }
}

/// The step with as many stages as the solver has, by Horner's rule or by increments.
pub fn stage_by_stage(model: &Model) -> StepGraph {
    let formed = |form| pe_hls::step::build_with(model, &StepOptions { form: Some(form), ..StepOptions::default() });
    let found = formed(StageForm::Horner).or_else(|_| formed(StageForm::Increments));
    found.or_else(|_| pe_hls::step::build(model)).unwrap_or_else(|error| panic!("{}: {error:?}", model.title))
}

/// Panics with the findings of a checker, if there are any.
pub fn assert_clean(label: &str, violations: &[String]) {
    assert!(violations.is_empty(), "{label}: {violations:#?}");
}

/// Formats for the ranges of a run in double precision, widened until the fixed-point run does not saturate.
fn settled(label: &str, model: &Model, graph: &StepGraph, format: WordFormat) -> FixedPoint {
    const STEPS: u64 = 60;
    let mut run = DoubleRun::new(graph);
    for step in 0..STEPS {
        run.step(&model.sample_inputs(model.time(step, 0.0))).unwrap_or_else(|error| panic!("{label}: {error:?}"));
    }
    let mut ranges = Ranges { largest: run.largest(), widened: vec![0; graph.values.len()] };
    for (input, value) in model.inputs.iter().zip(&graph.inputs) {
        let (low, high) = input.waveform.bounds();
        ranges.largest[value.index()] = low.abs().max(high.abs());
    }
    for _ in 0..8 {
        let fixed = formats::choose(graph, &ranges, format).unwrap_or_else(|error| panic!("{label}: {error:?}"));
        let mut run = FixedRun::new(graph, &fixed);
        for step in 0..STEPS {
            let words = runs::port_words(model, &run, step);
            run.step(&words);
        }
        if run.saturations().iter().all(|count| *count == 0) {
            return fixed;
        }
        for (widened, count) in ranges.widened.iter_mut().zip(run.saturations()) {
            *widened += i32::from(count > 0);
        }
    }
    panic!("{label}: saturates however wide");
}

fn place(label: &str, graph: &StepGraph, pes: u32, placement: Placement) -> Mapping {
    let equations = graph.equations.len() as u32;
    match placement {
        Placement::Scattered => Mapping { pes, pe_of: (0..equations).map(|e| PeId::new(e * 7919 % pes)).collect() },
        Placement::Annealed => {
            let options = MapOptions { pes, seed: 1, tries: 2_000, max_in_degree: MAX_IN_DEGREE };
            let candidates =
                pe_hls::mapping::map(&Problem::of(graph), &options).unwrap_or_else(|error| panic!("{label}: {error}"));
            let best = &candidates[0];
            assert_clean(label, &verify::mapping::check(graph, &best.mapping, &best.cost, MAX_IN_DEGREE));
            best.mapping.clone()
        }
    }
}
