//! The axes of a sweep on the command line.

use clap::Args;
use pe_flow::explore::axes::Axes;
use pe_ir::model::Solver;
use pe_ir::word::{MultiplierPorts, Pipeline};
use pe_judge::FormChoice;
use pe_judge::parse::{duration, multiplier};

use crate::options::{count, form, pipeline, solver, storage};

/// Options of the axes: lists in place of the single values that the other commands take.
#[derive(Args, Clone, Debug)]
pub struct AxesArgs {
    /// Numbers of processing elements [default: powers of two, as long as more PEs can be faster]
    #[arg(long, value_name = "N,...", value_delimiter = ',', allow_hyphen_values = true, value_parser = count, help_heading = "Sweep")]
    pes: Vec<u32>,
    /// Numerical methods [default: euler,heun,heun3,rk4; for stiff models all that apply]
    #[arg(long, value_name = "SOLVER,...", value_delimiter = ',', value_parser = solver(), help_heading = "Sweep")]
    solver: Vec<Solver>,
    /// Steps [default: the spec's, its half and its double]
    #[arg(long, value_name = "T,...", value_delimiter = ',', allow_hyphen_values = true, value_parser = duration, help_heading = "Sweep")]
    step: Vec<f64>,
    /// Longest time between two outputs: steps divide this time
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = duration, help_heading = "Sweep")]
    sample: Option<f64>,
    /// Pipeline of the PEs
    #[arg(long, default_value = "short", value_parser = pipeline(), help_heading = "Sweep")]
    pipeline: Pipeline,
    /// Form of the step of a model that is affine in its states
    #[arg(long, value_parser = form(), default_value = "auto", help_heading = "Sweep")]
    form: FormChoice,
    /// Multipliers [default: 25x18,18x25,32x32]
    #[arg(long, value_name = "AxB,...", value_delimiter = ',', value_parser = multiplier, help_heading = "Sweep")]
    multiplier: Vec<MultiplierPorts>,
    /// Bits of a stored word, without its guard bits
    #[arg(long, value_name = "BITS,...", value_delimiter = ',', default_value = "32", value_parser = storage(), help_heading = "Sweep")]
    storage: Vec<u32>,
}

impl AxesArgs {
    /// The axes.
    pub fn axes(&self) -> Axes {
        let AxesArgs { pes, solver, step, sample, pipeline, form, multiplier, storage } = self.clone();
        Axes { pes, solver, step, sample, pipeline, form, multiplier, storage }
    }
}
