//! A point of the design space: how a model is computed.

use pe_ir::graph::StageForm;
use pe_ir::model::{Model, Solver, step_count_problem};
use pe_ir::word::{MultiplierPorts, Pipeline, WordFormat};

use crate::early::Early;
use crate::feedback::{Feedback, VISIBLE_BITS};

/// Bits of a stored word unless the user says otherwise.
const STORAGE: u32 = 32;

/// Bits of a stored word, at most.
pub const MOST_STORAGE: u32 = 48;

/// Bits of both ports of the multiplier unless the user says otherwise, and the most that four blocks make.
const PORT_BITS: u32 = 32;
const WIDEST_PORT: u32 = 35;

/// Method, step, words and network of a design; what is not given is the spec's, or a default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DesignPoint {
    /// Numerical method.
    pub solver: Option<Solver>,
    /// Step in seconds.
    pub step: Option<f64>,
    /// Other steps for the beginning.
    pub early_steps: Option<Early>,
    /// Bits of a stored word, without its guard bits.
    pub storage: u32,
    /// Ports of the multiplier.
    pub multiplier: Option<MultiplierPorts>,
    /// Registers that an operation passes.
    pub pipeline: Pipeline,
    /// Products that a coefficient takes.
    pub coefficients: Coefficients,
    /// Form of the step of a model that is affine in its states.
    pub form: FormChoice,
    /// Number of PEs.
    pub pes: Option<u32>,
}

impl Default for DesignPoint {
    fn default() -> Self {
        DesignPoint {
            solver: None,
            step: None,
            early_steps: None,
            storage: STORAGE,
            multiplier: None,
            pipeline: Pipeline::Short,
            coefficients: Coefficients::default(),
            form: FormChoice::default(),
            pes: None,
        }
    }
}

/// How coefficients are rounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coefficients {
    /// A product each, rounded to the coefficient port.
    #[default]
    OneSlot,
    /// A second product with what the port does not see, where that can be seen in the result.
    TwoSlot,
    /// Two slots if they at least halve the word-length error.
    Auto,
}

impl Coefficients {
    /// All of them.
    pub const ALL: [Coefficients; 3] = [Coefficients::OneSlot, Coefficients::TwoSlot, Coefficients::Auto];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Coefficients::OneSlot => "one-slot",
            Coefficients::TwoSlot => "two-slot",
            Coefficients::Auto => "auto",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            Coefficients::OneSlot => "One slot each, rounded to the coefficient port",
            Coefficients::TwoSlot => {
                "A second slot for the bits that the port does not see, where they affect the result"
            }
            Coefficients::Auto => "Two slots if that at least halves the word-length error",
        }
    }
}

/// The form of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FormChoice {
    /// The one that is estimated to take the fewest cycles.
    #[default]
    Auto,
    /// Increments that are summed up beside the state.
    Increments,
    /// Increments of one scale in a running sum: stages that are the same sums.
    Sums,
    /// Horner's rule: as many stages as the method has.
    Horner,
    /// Real factors of the method's polynomial: half the stages, denser equations.
    Factors,
    /// The method's polynomial as one matrix: one stage, the densest equations.
    Full,
}

impl FormChoice {
    /// All of them.
    pub const ALL: [FormChoice; 6] = [
        FormChoice::Auto,
        FormChoice::Increments,
        FormChoice::Sums,
        FormChoice::Horner,
        FormChoice::Factors,
        FormChoice::Full,
    ];

    /// The form that was chosen, if any.
    pub fn form(self) -> Option<StageForm> {
        match self {
            FormChoice::Auto => None,
            FormChoice::Increments => Some(StageForm::Increments),
            FormChoice::Sums => Some(StageForm::Sums),
            FormChoice::Horner => Some(StageForm::Horner),
            FormChoice::Factors => Some(StageForm::Factors),
            FormChoice::Full => Some(StageForm::Full),
        }
    }

    /// The choice of a form among others; `Auto` for forms that are the only one of a model.
    pub fn of(form: StageForm) -> FormChoice {
        FormChoice::ALL.into_iter().find(|choice| choice.form() == Some(form)).unwrap_or_default()
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            FormChoice::Auto => "auto",
            FormChoice::Increments => "increments",
            FormChoice::Sums => "sums",
            FormChoice::Horner => "horner",
            FormChoice::Factors => "factors",
            FormChoice::Full => "full",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            FormChoice::Auto => "The one with the fewest estimated cycles",
            FormChoice::Increments => "Increments, summed in addition to the state",
            FormChoice::Sums => "Increments of equal scale in a running sum: all stages compute the same sums",
            FormChoice::Horner => "Horner's rule: as many stages as the method",
            FormChoice::Factors => "Real factors of the method's polynomial: half the stages, denser equations",
            FormChoice::Full => "The method's polynomial as one matrix: one stage, the densest equations",
        }
    }
}

impl DesignPoint {
    /// Puts solver and step in place of the model's.
    ///
    /// # Errors
    /// What is wrong with the options: the span is shorter than the step, or takes more steps than can be run.
    pub fn apply(&self, model: &mut Model) -> Result<(), String> {
        model.solver = self.solver.unwrap_or(model.solver);
        model.set_step(self.step.unwrap_or(model.step));
        if let Some(early) = &self.early_steps {
            early.apply(model)?;
        }
        step_count_problem(model.step, model.span).map_or(Ok(()), Err)
    }

    /// Ports of the multiplier, given or by default.
    pub fn ports(&self, model: &Model) -> MultiplierPorts {
        self.multiplier.unwrap_or_else(|| default_ports(model, self.storage))
    }

    /// Word widths.
    ///
    /// # Errors
    /// What is wrong with the options: a port that is wider than a word.
    pub fn format(&self, model: &Model) -> Result<WordFormat, String> {
        let ports = self.ports(model);
        let format = WordFormat::with_ports(self.storage, ports).with_pipeline(self.pipeline);
        if ports.widest() > format.word_bits() {
            return Err(format!(
                "a {ports} multiplier reads more bits than a word of {} + {} has",
                self.storage, format.guard_bits
            ));
        }
        Ok(Feedback::of(model).map_or(format, |feedback| format.with_hidden(feedback.hidden_bits)))
    }
}

/// Ports of the multiplier unless the user says otherwise: where sampled states may ring they see some bits below those
/// that are stored.
pub fn default_ports(model: &Model, storage: u32) -> MultiplierPorts {
    let rings = Feedback::of(model).is_some_and(|feedback| feedback.rings);
    let bits = if rings { (storage + VISIBLE_BITS).clamp(PORT_BITS, WIDEST_PORT) } else { PORT_BITS };
    MultiplierPorts::new(bits, bits)
}
