//! `pe-synth check`: is the step stable, and what would be better?

use std::sync::Arc;

use pe_ir::source::{Diagnostic, Severity};
use serde_json::Value;

use crate::check;
use crate::console;
use crate::messages::{MessageFormat, print_findings};
use crate::options::{MappingArgs, ModelArgs, PointArgs};
use crate::progress;
use crate::rerun::{self, WatchArgs};
use pe_flow::failure::Failure;
use pe_flow::penalty;
use pe_flow::pipeline;
use pe_flow::spec::LoadedModel;
use pe_flow::variables::{self, Variable};
use pe_flow::watch::Stopwatch;
use pe_ir::model::Model;
use pe_judge::check::{Check as Judgement, Question};
use pe_judge::progress::Progress;
use pe_judge::runs::{self, Judged};

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
    /// What is computed.
    #[command(flatten)]
    pub model: ModelArgs,
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
        let mut watch = progress::stopwatch(true, self.message_format());
        let checked = self.checked(&mut watch, progress::bar("runs", json || self.quiet))?;
        let told = match (self.quiet, json) {
            (true, _) => Ok(()),
            (false, true) => console::out(&format!("{:#}\n", checked.json())),
            (false, false) => console::out(&checked.text(self.all)),
        };
        let (refusals, warnings): (Vec<_>, Vec<_>) =
            checked.check.findings.into_iter().partition(|finding| finding.severity == Severity::Error);
        print_findings(&warnings, &checked.loaded.sources, self.message_format());
        if refusals.is_empty() { told } else { Err(Failure::Spec(refusals, checked.loaded.sources)) }
    }

    /// Judges the step. Warnings of the spec go to the stopwatch's listener, those of the step are part of the result.
    ///
    /// # Errors
    /// Those of the spec and the options, and steps that cannot be built.
    pub fn checked(&self, watch: &mut Stopwatch, bar: Arc<dyn Progress>) -> Result<Checked, Failure> {
        let (point, mapping, criteria) = (self.point.point(), self.mapping.options(), self.model.criteria());
        let mut loaded = self.model.load(&point, watch.listener())?;
        let asked_span = loaded.model.span;
        let format = point.format(&loaded.model).map_err(Failure::Usage)?;
        let settings = self.model.settings(&self.mapping);
        let of_penalty = |loaded: &LoadedModel, refusals: &[Diagnostic]| {
            let other = |name: &str, penalty: f64| self.model.with_penalty(loaded, &point, name, penalty);
            penalty::explained(loaded, &settings, &point, refusals, &other)
        };
        let graph = pipeline::step(&loaded, &point, &mapping, watch)
            .map_err(|failure| unbuilt(failure, &loaded.model, &|refusals| of_penalty(&loaded, refusals)))?;
        if loaded.model.states.len() > LARGE {
            let steps = (PRODUCTS / graph.macs().max(1)).max(FEWEST_STEPS).min(loaded.model.steps());
            loaded.model.span = loaded.model.span.min(loaded.model.time(steps, 0.0));
        }
        let model = &loaded.model;
        let goal = Some(self.max_error);
        let question = Question { model, graph: &graph, point: &point, criteria: &criteria, format, goal };
        let (mut check, judged) = match runs::judge(model, &graph, format, &criteria, bar) {
            Ok(judged) => (Judgement::of_judged(&question, &judged), Some(judged)),
            Err(refusals) => {
                let refusals = of_penalty(&loaded, &refusals).map_or(refusals, |finding| vec![finding]);
                (Judgement::of_refused(&question, refusals), None)
            }
        };
        if let Some(finding) = of_penalty(&loaded, &check.findings) {
            check.findings.iter_mut().filter(|own| own.code == finding.code).for_each(|own| *own = finding.clone());
        }
        let variables = judged.as_ref().map(|judged| variables::variables(model, &graph, judged));
        Ok(Checked { loaded, check, judged, variables, asked_span })
    }
}

/// What a check has found.
pub struct Checked {
    /// The model, with the span that was judged.
    pub loaded: LoadedModel,
    /// The judgement of the step.
    pub check: Judgement,
    judged: Option<Judged>,
    variables: Option<Vec<Variable>>,
    asked_span: f64,
}

impl Checked {
    /// All of it for tools.
    pub fn json(&self) -> Value {
        let Checked { loaded, check, judged, variables, asked_span } = self;
        let mut result = check::json(&loaded.model, check, judged.as_ref(), *asked_span, &loaded.sources);
        result["variables"] = variables.as_deref().map_or(Value::Null, |all| variables::complete(all).into());
        result
    }

    /// All of it for people, with the ranges of all variables or of those with the least headroom.
    pub fn text(&self, all: bool) -> String {
        let Checked { loaded, check, judged, variables, asked_span } = self;
        let ranges = variables.as_deref().map_or_else(String::new, |variables| variables::ranges(variables, all));
        check::text(&loaded.model, check, judged.as_ref(), *asked_span) + &ranges
    }
}

/// A failure to build the step of a model, with what it really comes from.
fn unbuilt(failure: Failure, model: &Model, of_penalty: &dyn Fn(&[Diagnostic]) -> Option<Diagnostic>) -> Failure {
    match failure {
        Failure::Spec(refusals, sources) => match of_penalty(&refusals) {
            Some(finding) => Failure::Spec(vec![finding], sources),
            None => Failure::Spec(Judgement::of_unbuilt(model, refusals), sources),
        },
        failure => failure,
    }
}
