//! The points of a work-precision study.

use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver, step_count_problem};
use pe_ir::word::{MultiplierPorts, Pipeline, WordFormat};

use crate::explore::axes::{once, with_forms};
use crate::explore::steps;
use crate::settings::MappingOptions;
use pe_judge::early::Early;
use pe_judge::{Coefficients, DesignPoint, FormChoice};

/// A stored word, the ports of the multiplier that reads it, and how coefficients are rounded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Word {
    /// Bits of a stored word, without its guard bits.
    pub storage: u32,
    /// Ports of the multiplier.
    pub multiplier: MultiplierPorts,
    /// Products of a coefficient.
    pub coefficients: Coefficients,
}

impl Word {
    const fn new(storage: u32, data_bits: u32, coefficient_bits: u32) -> Word {
        let multiplier = MultiplierPorts::new(data_bits, coefficient_bits);
        Word { storage, multiplier, coefficients: Coefficients::OneSlot }
    }

    /// Whether no part of it is narrower than another word's.
    pub fn holds(&self, other: &Word) -> bool {
        self.storage >= other.storage && self.multiplier.hold(other.multiplier)
    }

    /// The word of a point of these lists.
    pub fn of(point: &DesignPoint) -> Word {
        let DesignPoint { storage, multiplier, coefficients, .. } = *point;
        Word { storage, multiplier: multiplier.expect("points of lists have one"), coefficients }
    }

    /// In a few letters: `/2` stands for coefficients in two slots.
    pub fn name(&self) -> String {
        let slots = if self.coefficients == Coefficients::TwoSlot { "/2" } else { "" };
        format!("{} {}{slots}", self.storage, self.multiplier)
    }
}

/// The word of the comparison of solvers and steps.
pub const WORD: Word = Word::new(32, 32, 32);

/// Other words: the paper's, one block either way round and with coefficients in two slots, two blocks, longer words.
const OTHER_WORDS: [Word; 7] = [
    Word::new(18, 18, 18),
    Word::new(24, 25, 18),
    Word::new(32, 25, 18),
    Word::new(32, 18, 25),
    Word { coefficients: Coefficients::TwoSlot, ..Word::new(32, 25, 18) },
    Word::new(32, 25, 35),
    Word::new(40, 35, 35),
];

/// The longest word, for goals that no other meets.
const LONGEST_WORD: Word = Word::new(48, 35, 35);

/// Multipliers, where storage bits are given and multipliers are not.
const MULTIPLIERS: [MultiplierPorts; 6] = [
    MultiplierPorts::new(18, 18),
    MultiplierPorts::new(18, 25),
    MultiplierPorts::new(25, 18),
    MultiplierPorts::new(25, 35),
    MultiplierPorts::new(32, 32),
    MultiplierPorts::new(35, 35),
];

/// Powers of two of the steps, relative to the model's: few solvers are tried with more steps.
const MANY_STEPS: [i32; 5] = [2, 1, 0, -1, -2];
const FEW_STEPS: [i32; 3] = [1, 0, -1];

/// More solvers than this are tried with few steps.
const FEW_SOLVERS: usize = 6;

/// Lists of what is compared.
#[derive(Clone, Debug, Default)]
pub struct Lists {
    /// Numerical methods; all that apply if there are none.
    pub solver: Vec<Solver>,
    /// Steps in seconds; the spec's and some around it if there are none.
    pub step: Vec<f64>,
    /// Bits of the multiplier's ports; with a list of these, of storage or of coefficients every solver and step is
    /// combined with every word length.
    pub multiplier: Vec<MultiplierPorts>,
    /// Bits of a stored word, without its guard bits.
    pub storage: Vec<u32>,
    /// Products of a coefficient.
    pub coefficients: Vec<Coefficients>,
    /// Registers that an operation passes.
    pub pipeline: Pipeline,
    /// Form of the step of a model that is affine in its states.
    pub form: FormChoice,
    /// Longest time between two outputs in seconds: steps are whole parts of it.
    pub sample: Option<f64>,
    /// Other steps for the beginning of every point.
    pub early_steps: Option<Early>,
    /// Number of PEs of every point.
    pub pes: Option<u32>,
}

/// A method that cannot compute the model.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// The method.
    pub solver: Solver,
    /// Why.
    pub reason: String,
}

/// What is compared, and what is not.
pub struct Plan {
    /// The points.
    pub points: Vec<DesignPoint>,
    /// Methods that do not apply.
    pub left_out: Vec<LeftOut>,
    /// The step graph of each other method at the spec's step.
    pub graphs: Vec<(Solver, StepGraph)>,
    /// Whether steps may be added to the list.
    pub free_steps: bool,
    /// Words that may be tried.
    pub words: Vec<Word>,
}

impl Lists {
    /// The points of a model.
    pub fn plan(&self, model: &Model, mapping: &MappingOptions) -> Plan {
        let mut solvers = if self.solver.is_empty() { Solver::ALL.to_vec() } else { self.solver.clone() };
        once(&mut solvers);
        let (mut graphs, mut left_out) = (Vec::new(), Vec::new());
        for solver in solvers {
            match pe_hls::step::build(&Model { solver, ..model.clone() }) {
                Ok(graph) => graphs.push((solver, graph)),
                Err(findings) => {
                    let reason = findings.first().map(|first| format!("{} {}", first.code, first.message));
                    left_out.push(LeftOut { solver, reason: reason.unwrap_or_default() });
                }
            }
        }
        let mut plan =
            Plan { points: Vec::new(), left_out, graphs, free_steps: self.step.is_empty(), words: Vec::new() };
        let solvers: Vec<Solver> = plan.graphs.iter().map(|(solver, _)| *solver).collect();
        let steps = self.steps(model, solvers.len());
        let mut points = Vec::new();
        if self.multiplier.is_empty() && self.storage.is_empty() && self.coefficients.is_empty() {
            plan.words = [WORD].into_iter().chain(OTHER_WORDS).chain([LONGEST_WORD]).collect();
            solvers.iter().for_each(|solver| points.extend(steps.iter().map(|step| self.point(*solver, *step, WORD))));
            // The spec's solver shows what word lengths do, at steps around the spec's.
            let of_spec = solvers.iter().copied().find(|solver| *solver == model.solver).or(solvers.first().copied());
            let near = |step: &&f64| (0.5..=2.0).contains(&(**step / model.step)) && solvers.len() <= FEW_SOLVERS;
            let near: Vec<f64> = steps.iter().filter(|step| near(step) || **step == model.step).copied().collect();
            if let Some(solver) = of_spec {
                for word in OTHER_WORDS {
                    points.extend(near.iter().map(|step| self.point(solver, *step, word)));
                }
            }
        } else {
            plan.words = self.words();
            for solver in &solvers {
                for word in &plan.words {
                    points.extend(steps.iter().map(|step| self.point(*solver, *step, *word)));
                }
            }
        }
        plan.points = with_forms(points, model, mapping);
        plan
    }

    /// A point of these lists.
    pub fn point(&self, solver: Solver, step: f64, word: Word) -> DesignPoint {
        let Word { storage, multiplier, coefficients } = word;
        let (solver, step, form, pes, pipeline) = (Some(solver), Some(step), self.form, self.pes, self.pipeline);
        let (multiplier, early_steps) = (Some(multiplier), self.early_steps);
        DesignPoint { solver, step, early_steps, storage, multiplier, coefficients, form, pes, pipeline }
    }

    /// The longest step up to this one, or nearly so, that suits the model and the time between two outputs.
    pub fn suitable(&self, model: &Model, step: f64) -> Option<f64> {
        steps::suitable(model, self.sample, step)
    }

    fn steps(&self, model: &Model, solvers: usize) -> Vec<f64> {
        let mut steps = self.step.clone();
        once(&mut steps);
        if steps.is_empty() {
            let powers: &[i32] = if solvers > FEW_SOLVERS { &FEW_STEPS } else { &MANY_STEPS };
            let suitable = |power: &i32| self.suitable(model, libm::scalbn(model.step, *power));
            steps = powers.iter().filter_map(suitable).collect();
            once(&mut steps);
            steps.retain(|step| step_count_problem(*step, model.span).is_none());
        }
        steps
    }

    /// Every combination of the lists; of a default list what goes together.
    fn words(&self) -> Vec<Word> {
        let or = |given: &[u32], default: u32| if given.is_empty() { vec![default] } else { given.to_vec() };
        let multipliers = match (self.multiplier.is_empty(), self.storage.is_empty()) {
            (false, _) => self.multiplier.clone(),
            (true, false) => MULTIPLIERS.to_vec(),
            (true, true) => vec![MultiplierPorts::new(25, 18)],
        };
        let slots = match self.coefficients.is_empty() {
            true => vec![Coefficients::OneSlot],
            false => self.coefficients.clone(),
        };
        let mut words = Vec::new();
        for storage in or(&self.storage, WORD.storage) {
            for multiplier in &multipliers {
                let format = WordFormat::with_ports(storage, *multiplier);
                let fits = multiplier.widest() <= format.word_bits();
                if fits || !self.multiplier.is_empty() {
                    let word = |slots: &Coefficients| Word {
                        coefficients: *slots,
                        ..Word::new(storage, multiplier.data_bits, multiplier.coefficient_bits)
                    };
                    words.extend(slots.iter().map(word));
                }
            }
        }
        once(&mut words);
        words
    }
}
