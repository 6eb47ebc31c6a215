//! `pe-synth check`: is the step stable, and what would be better?

use pe_ir::source::Severity;
use serde_json::Value;

use crate::check::{self, Question};
use crate::console;
use crate::failure::{Failure, MessageFormat, print_findings};
use crate::options::{DesignPoint, ModelOptions};
use crate::pipeline::{self, MappingOptions, Stopwatch};
use crate::runs;
use crate::variables;

/// Products of a run over the span of a large model; a longer span is judged over its first part.
const PRODUCTS: u64 = 500_000_000;

/// States from which on a model is large.
const LARGE: usize = 10_000;

/// Steps that are run of a large model in any case.
const FEWEST_STEPS: u64 = 100;

/// Says before hardware is made whether the step is stable, why, and which change would help at least cost
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth check models/weibel5/weibel5.spec
  pe-synth check models/van_der_pol/van_der_pol.spec --step 0.5 --set mu=10
  pe-synth check models/lorenz/lorenz.spec --span 5s --max-error 1e-6")]
pub struct Check {
    #[command(flatten)]
    point: DesignPoint,
    #[command(flatten)]
    mapping: MappingOptions,
    /// Method error that the accuracy step is for
    #[arg(long, value_name = "E", default_value_t = check::ACCURACY, value_parser = crate::cmd_compile::positive, help_heading = "Numbers")]
    max_error: f64,
    /// Shows the ranges of all variables, not only of those with the least headroom
    #[arg(long, help_heading = "Output")]
    all: bool,
    #[command(flatten)]
    model: ModelOptions,
}

impl Check {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command: the result on standard output, findings on standard error.
    ///
    /// # Errors
    /// The findings of a refused step; those of the spec and the options.
    pub fn run(&self) -> Result<(), Failure> {
        let json = self.message_format() == MessageFormat::Json;
        let mut watch = Stopwatch::new(true);
        let mut loaded = self.model.load(&self.point)?;
        let asked_span = loaded.model.span;
        let format = self.point.format(&loaded.model)?;
        let graph = pipeline::build(&loaded, &self.point, &self.mapping, &mut watch)
            .map_err(|failure| check::unbuilt(failure, &loaded))?;
        let (_, pes) = self.mapping.given(self.point.pes)?;
        let graph = pipeline::split(&graph, pes, &self.mapping, format).unwrap_or(graph);
        if loaded.model.states.len() > LARGE {
            let steps = (PRODUCTS / graph.macs().max(1)).max(FEWEST_STEPS).min(loaded.model.steps());
            loaded.model.span = loaded.model.span.min(loaded.model.time(steps, 0.0));
        }
        let (loaded, model) = (&loaded, &loaded.model);
        let goal = Some(self.max_error);
        let question = Question { loaded, graph: &graph, point: &self.point, options: &self.model, format, goal };
        let bar = Stopwatch::new(json).progress_bar("runs");
        let (check, judged) = match runs::judge(model, &graph, format, &self.model, bar) {
            Ok(judged) => (check::Check::of_judged(&question, &judged), Some(judged)),
            Err(refusals) => (check::Check::of_refused(&question, refusals), None),
        };
        let variables = judged.as_ref().map(|judged| variables::variables(model, &graph, judged));
        console::out(&if json {
            let mut result = check::json(model, &check, judged.as_ref(), asked_span, &loaded.sources);
            result["variables"] = variables.map_or(Value::Null, |variables| variables::complete(&variables).into());
            format!("{result:#}\n")
        } else {
            let ranges = variables.map_or_else(String::new, |variables| variables::ranges(&variables, self.all));
            check::text(model, &check, judged.as_ref(), asked_span) + &ranges
        });
        let (refusals, warnings): (Vec<_>, Vec<_>) =
            check.findings.into_iter().partition(|finding| finding.severity == Severity::Error);
        print_findings(&warnings, &loaded.sources, self.message_format());
        if refusals.is_empty() { Ok(()) } else { Err(Failure::Spec(refusals, loaded.sources.clone())) }
    }
}
