//! `pe-synth check`: is the step stable, and what would be better?

use pe_ir::source::Severity;
use serde_json::Value;

use crate::check;
use crate::console;
use crate::messages::{MessageFormat, print_findings};
use crate::options::{MappingArgs, ModelArgs, PointArgs};
use crate::progress;
use crate::rerun::{self, WatchArgs};
use pe_flow::failure::Failure;
use pe_flow::pipeline;
use pe_flow::variables;
use pe_ir::model::Model;
use pe_judge::check::{Check as Checked, Question};
use pe_judge::runs;

/// Products of a run over the span of a large model; a longer span is judged over its first part.
const PRODUCTS: u64 = 500_000_000;

/// States from which on a model is large.
const LARGE: usize = 10_000;

/// Steps that are run of a large model in any case.
const FEWEST_STEPS: u64 = 100;

/// Checks before anything is built whether the step is stable, why, and which change would help at the lowest cost
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth check models/weibel5/weibel5.spec
  pe-synth check models/van_der_pol/van_der_pol.spec --step 0.5 --set mu=10
  pe-synth check models/lorenz/lorenz.spec --span 5s --max-error 1e-6")]
pub struct Check {
    #[command(flatten)]
    point: PointArgs,
    #[command(flatten)]
    mapping: MappingArgs,
    /// Method error for which the accuracy step is computed
    #[arg(long, value_name = "E", default_value_t = pe_judge::check::ACCURACY, allow_hyphen_values = true, value_parser = crate::options::positive, help_heading = "Numbers")]
    max_error: f64,
    /// Shows the ranges of all variables, not only those with the least headroom
    #[arg(long, help_heading = "Output")]
    all: bool,
    /// Prints errors and warnings only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
    #[command(flatten)]
    again: WatchArgs,
    #[command(flatten)]
    model: ModelArgs,
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
        if self.again.watch {
            return rerun::watch(&self.model, &self.mapping);
        }
        let json = self.message_format() == MessageFormat::Json;
        let (point, mapping, criteria) = (self.point.point(), self.mapping.options(), self.model.criteria());
        let mut watch = progress::stopwatch(true, self.message_format());
        let mut loaded = self.model.load(&point)?;
        let asked_span = loaded.model.span;
        let format = point.format(&loaded.model).map_err(Failure::Usage)?;
        let graph =
            pipeline::step(&loaded, &point, &mapping, &mut watch).map_err(|failure| unbuilt(failure, &loaded.model))?;
        if loaded.model.states.len() > LARGE {
            let steps = (PRODUCTS / graph.macs().max(1)).max(FEWEST_STEPS).min(loaded.model.steps());
            loaded.model.span = loaded.model.span.min(loaded.model.time(steps, 0.0));
        }
        let (loaded, model) = (&loaded, &loaded.model);
        let goal = Some(self.max_error);
        let question = Question { model, graph: &graph, point: &point, criteria: &criteria, format, goal };
        let bar = progress::bar("runs", json || self.quiet);
        let (check, judged) = match runs::judge(model, &graph, format, &criteria, bar) {
            Ok(judged) => (Checked::of_judged(&question, &judged), Some(judged)),
            Err(refusals) => (Checked::of_refused(&question, refusals), None),
        };
        let variables = judged.as_ref().map(|judged| variables::variables(model, &graph, judged));
        let text = if json {
            let mut result = check::json(model, &check, judged.as_ref(), asked_span, &loaded.sources);
            result["variables"] = variables.map_or(Value::Null, |variables| variables::complete(&variables).into());
            format!("{result:#}\n")
        } else {
            let ranges = variables.map_or_else(String::new, |variables| variables::ranges(&variables, self.all));
            check::text(model, &check, judged.as_ref(), asked_span) + &ranges
        };
        let told = if self.quiet { Ok(()) } else { console::out(&text) };
        let (refusals, warnings): (Vec<_>, Vec<_>) =
            check.findings.into_iter().partition(|finding| finding.severity == Severity::Error);
        print_findings(&warnings, &loaded.sources, self.message_format());
        if refusals.is_empty() { told } else { Err(Failure::Spec(refusals, loaded.sources.clone())) }
    }
}

/// A failure to build the step of a model, with what it really comes from.
fn unbuilt(failure: Failure, model: &Model) -> Failure {
    match failure {
        Failure::Spec(refusals, sources) => Failure::Spec(Checked::of_unbuilt(model, refusals), sources),
        failure => failure,
    }
}
