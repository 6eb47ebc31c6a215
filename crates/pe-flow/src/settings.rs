//! Settings common to all designs of a command.

use std::path::PathBuf;

use pe_hls::mapping::MapOptions;
use pe_hls::rings;
use pe_hls::step::{Order, Scheme, StepOptions};
use pe_judge::{Coefficients, Criteria, DesignPoint};

use crate::failure::Failure;
use crate::mapping_file::MappingFile;
use crate::spec;

/// What is asked of the mapping.
#[derive(Clone, Debug)]
pub struct MappingOptions {
    /// File that has the PE of each equation, as `dump --stage mapping` prints it.
    pub mapping: Option<PathBuf>,
    /// Annealing budget in tries; it grows with the number of equations if there is none.
    pub tries: Option<u64>,
    /// Most input ports a PE may have; if there is none the usual number, or as many more as a mapping needs.
    pub max_in_degree: Option<u32>,
    /// Whether operands with equal coefficients are never added in front of the multiplier.
    pub no_pre_adder: bool,
    /// One round of control words for all stages of a step.
    pub stage_loop: StageLoop,
    /// The order in which matrices are eliminated; found by trial if there is none.
    pub elimination: Option<Order>,
    /// How symmetric matrices of linear systems are eliminated; found by trial if there is none.
    pub factors: Option<Scheme>,
    /// Which rows of past words are kept in rings.
    pub rings: rings::Choice,
}

impl Default for MappingOptions {
    fn default() -> Self {
        MappingOptions {
            mapping: None,
            tries: None,
            max_in_degree: None,
            no_pre_adder: false,
            stage_loop: StageLoop::Auto,
            elimination: None,
            factors: None,
            rings: rings::Choice::default(),
        }
    }
}

/// What all designs of a command have in common.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// By what they are judged.
    pub criteria: Criteria,
    /// What is asked of their mappings.
    pub mapping: MappingOptions,
    /// Seed of everything random.
    pub seed: u64,
}

impl MappingOptions {
    /// Most input ports that a PE can have.
    pub const MOST_PORTS: u32 = 256;

    /// The number of input ports that mappings aim at.
    pub fn ports(&self) -> u32 {
        self.max_in_degree.unwrap_or(MapOptions::DEFAULT_MAX_IN_DEGREE)
    }

    /// The number of input ports that no mapping may exceed.
    pub fn most_ports(&self) -> u32 {
        self.max_in_degree.unwrap_or(MappingOptions::MOST_PORTS)
    }

    /// The mapping file and the number of PEs: those of the file, or those asked for.
    ///
    /// # Errors
    /// Those of the file, and of another number of PEs beside it.
    pub fn given(&self, pes: Option<u32>) -> Result<(Option<MappingFile>, Option<u32>), Failure> {
        let Some(path) = &self.mapping else { return Ok((None, pes)) };
        let file = MappingFile::read(spec::main_file(path)?)?;
        match pes.filter(|pes| *pes != file.pes()) {
            None => {
                let pes = Some(file.pes());
                Ok((Some(file), pes))
            }
            Some(pes) => Err(Failure::Usage(format!(
                "{} maps to {} PEs, and `--pes` asks for {pes}; leave `--pes` out",
                path.display(),
                file.pes()
            ))),
        }
    }

    /// Refuses a mapping file where designs of several kinds are made.
    ///
    /// # Errors
    /// There is one.
    pub fn of_many(&self) -> Result<(), Failure> {
        match self.mapping {
            None => Ok(()),
            Some(_) => Err(Failure::Usage(
                "each design of a sweep has a mapping of its own; give `--mapping` to a `compile` of one design"
                    .to_owned(),
            )),
        }
    }
}

/// Whether stages that are alike share their control words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageLoop {
    /// Where area times cycles gets smaller.
    Auto,
    /// Wherever the stages are alike.
    On,
    /// Never.
    Off,
}

impl StageLoop {
    /// All of them.
    pub const ALL: [StageLoop; 3] = [StageLoop::Auto, StageLoop::On, StageLoop::Off];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            StageLoop::Auto => "auto",
            StageLoop::On => "on",
            StageLoop::Off => "off",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            StageLoop::Auto => "Where area times cycles gets smaller",
            StageLoop::On => "Wherever the stages are alike",
            StageLoop::Off => "Never",
        }
    }
}

/// What is asked of the form of the step.
pub fn step_options(point: &DesignPoint, mapping: &MappingOptions) -> StepOptions {
    let MappingOptions { no_pre_adder, stage_loop, elimination, factors, .. } = *mapping;
    StepOptions {
        form: point.form.form(),
        pes: point.pes,
        max_in_degree: mapping.ports(),
        pre_adder: !no_pre_adder,
        sums: point.coefficients == Coefficients::OneSlot,
        rounds: stage_loop != StageLoop::Off,
        order: elimination.unwrap_or_default(),
        scheme: factors.unwrap_or_default(),
        ..StepOptions::default()
    }
}
