//! What is compared, on the command line, and what a command fixes.

use clap::{Args, FromArgMatches};
use pe_flow::accuracy::choice::Fixed;
use pe_flow::accuracy::lists::Lists;
use pe_ir::model::Solver;
use pe_ir::word::{MultiplierPorts, Pipeline};
use pe_judge::parse::{duration, multiplier};
use pe_judge::{Coefficients, FormChoice};

use crate::options::{coefficients, count, form, pipeline, solver, storage};

/// Lists of what is compared.
#[derive(Args, Clone, Debug)]
pub struct ListArgs {
    /// Numerical methods [default: all that apply]
    #[arg(long, visible_alias = "solvers", value_name = "SOLVER,...", value_delimiter = ',', value_parser = solver(), help_heading = "Points")]
    solver: Vec<Solver>,
    /// Steps [default: the spec's, times and divided by 2 and 4; with many solvers by 2 only]
    #[arg(long, visible_alias = "steps", value_name = "T,...", value_delimiter = ',', allow_hyphen_values = true, value_parser = duration, help_heading = "Points")]
    step: Vec<f64>,
    /// Multipliers; with these lists every solver and step is combined with every word length
    #[arg(long, visible_alias = "multipliers", value_name = "AxB,...", value_delimiter = ',', value_parser = multiplier, help_heading = "Points")]
    multiplier: Vec<MultiplierPorts>,
    /// Bits of a stored word, without its guard bits [default: 32]
    #[arg(long, visible_alias = "storages", value_name = "BITS,...", value_delimiter = ',', value_parser = storage(), help_heading = "Points")]
    storage: Vec<u32>,
    /// Issue slots per coefficient: one-slot, two-slot, auto [default: one-slot]
    #[arg(
        long,
        value_name = "SLOTS,...",
        value_delimiter = ',',
        value_parser = coefficients(),
        hide_possible_values = true,
        help_heading = "Points"
    )]
    coefficients: Vec<Coefficients>,
    /// Pipeline of the PEs
    #[arg(long, default_value = "short", value_parser = pipeline(), help_heading = "Points")]
    pipeline: Pipeline,
    /// Form of the step of a model that is affine in its states
    #[arg(long, value_parser = form(), default_value = "auto", help_heading = "Points")]
    form: FormChoice,
    /// Longest time between two outputs: steps divide this time
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = duration, help_heading = "Points")]
    sample: Option<f64>,
    /// Number of processing elements of every point [default: one for every 200 issue slots]
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = count, help_heading = "Points")]
    pes: Option<u32>,
}

impl ListArgs {
    /// The lists.
    pub fn lists(&self) -> Lists {
        let ListArgs { solver, step, multiplier, storage, coefficients, pipeline, form, sample, pes } = self.clone();
        Lists { solver, step, multiplier, storage, coefficients, pipeline, form, sample, early_steps: None, pes }
    }
}

/// Which axes of the design space the user fixed: those whose options were given.
#[derive(Clone, Copy, Debug, Default)]
pub struct FixedArgs(pub Fixed);

impl FromArgMatches for FixedArgs {
    fn from_arg_matches(matches: &clap::ArgMatches) -> Result<Self, clap::Error> {
        let given = |id: &str| {
            let known = matches.try_contains_id(id).is_ok();
            known && matches.value_source(id) == Some(clap::parser::ValueSource::CommandLine)
        };
        Ok(FixedArgs(Fixed { storage: given("storage"), coefficients: given("coefficients") }))
    }

    fn update_from_arg_matches(&mut self, matches: &clap::ArgMatches) -> Result<(), clap::Error> {
        *self = FixedArgs::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args for FixedArgs {
    fn augment_args(command: clap::Command) -> clap::Command {
        command
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        command
    }
}
