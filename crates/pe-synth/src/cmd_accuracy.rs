//! `pe-synth accuracy`: error against run time for solvers, steps and word lengths.

use pe_judge::DesignPoint;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use pe_ir::model::Model;
use serde_json::{Map, Value, json};

use crate::accuracy::files;
use crate::accuracy::options::ListArgs;
use crate::accuracy::view::View;
use crate::console;
use crate::explore::drive::{Driver, Events, GENERATOR, fingerprint, tell_of_store, verdict};
use crate::explore::given::{Given, Sweeping};
use crate::explore::record::{Ended, Kind, Record};
use crate::messages::MessageFormat;
use crate::options::{ConservedArgs, ModelArgs, SweepArgs, positive};
use crate::output::{FolderLock, OutputFolder};
use crate::progress::{self, duration};
use pe_flow::accuracy::goal::Search;
use pe_flow::accuracy::lists::Plan;
use pe_flow::accuracy::wanted::Goals;
use pe_flow::explore::estimate::Estimate;
use pe_flow::explore::steps::hit;
use pe_flow::explore::sweep::Sweep;
use pe_flow::failure::Failure;
use pe_flow::watch::Listener;

/// Plots error against run time for many solvers, steps and word lengths of a model
///
/// Every point is compiled like `compile --reference`. Its run time on the hardware is shown with its total error
/// against a library's solution and the parts of it: method, word length, coefficients, functions, input hold. The
/// output is a work-precision diagram, a table and a CSV file; a point that diverges is a row with an infinite error
/// and the reason.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth accuracy models/lorenz/lorenz.spec --span 5s
  pe-synth accuracy models/lorenz/lorenz.spec --span 5s --max-error 1e-4
  pe-synth accuracy models/van_der_pol/van_der_pol.spec --solver heun,rk4 --step 10ms,5ms,2ms --multiplier 25x18,32x32")]
pub struct Accuracy {
    // The first field, for each takes what it reads away from those that follow.
    #[command(flatten)]
    given: Given<Accuracy>,
    #[command(flatten)]
    lists: ListArgs,
    #[command(flatten)]
    options: SweepArgs,
    /// Picks the cheapest point with at most this total error, trying more steps and words; points that miss it show only
    /// their error
    #[arg(long, value_name = "E", allow_hyphen_values = true, value_parser = positive, help_heading = "Points")]
    max_error: Option<f64>,
    /// Continues the study in the output folder: points that it holds are not compiled again
    #[arg(long, help_heading = "Points")]
    resume: bool,
    #[command(flatten)]
    conserved: ConservedArgs,
    /// What is computed.
    #[command(flatten)]
    pub model: ModelArgs,
    /// Prints errors and warnings only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
}

impl Sweeping for Accuracy {
    const NAME: &'static str = "accuracy";
}

impl Accuracy {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command; Ctrl-C ends the sweep.
    ///
    /// # Errors
    /// As of [`Accuracy::sweep`].
    pub fn run(&self) -> Result<(), Failure> {
        self.sweep(&progress::listener(true, self.message_format()), Events::until_interrupted()?)
    }

    /// Computes the points and writes the folder. Warnings of the spec go to the listener.
    ///
    /// # Errors
    /// Those of the spec, the options and the folder; an interruption; and if no point could be compiled or is as wanted.
    pub fn sweep(&self, told: &dyn Listener, events: Events) -> Result<(), Failure> {
        let quiet = self.quiet || self.message_format() == MessageFormat::Json;
        let (lists, mut settings) = (self.lists.lists(), self.model.settings(&self.options.mapping));
        settings.mapping.of_many()?;
        let loaded = self.model.read(told)?;
        let model = &loaded.model;
        let given = self.given.with_order(model, &mut settings.mapping);
        let folder = || PathBuf::from("out").join(format!("{}_accuracy", model.name));
        let target = self.options.output.clone().unwrap_or_else(folder);
        OutputFolder::permitted(&target)?;
        let conserved = self.conserved.of(model)?;
        hit(&lists.step, lists.sample)?;
        let plan = lists.plan(model, &settings.mapping);
        let clock = self.options.clock.source();
        let row = |point: DesignPoint| (point, given.command(&point));
        // The parts of a sweep are computed side by side.
        let lock = self.options.shard.is_none().then(|| FolderLock::take(&target)).transpose()?;
        let mut record = Record {
            kind: Kind { store: "accuracy.json", files: files::files },
            head: self.head(model, &plan),
            title: format!("{} ({})", model.name, model.size()),
            max_error: self.max_error,
            goals: self.max_error.map_or_else(Goals::default, Goals::error),
            clock: clock.words(),
            rows: Vec::new(),
            target,
            searches: self.max_error.is_some(),
            kept: BTreeMap::new(),
            late: false,
            store: None,
            damaged: BTreeSet::new(),
            lost: 0,
            share: self.options.shard,
            lock,
        };
        record.extend(plan.points.iter().copied().map(row));
        if self.resume {
            record.resume()?;
        }
        let estimate = Estimate::of(model, &plan.graphs, &settings.mapping).among(plan.points.iter());
        let sources = loaded.sources.clone();
        let sweep = |within: Option<f64>| Sweep {
            loaded: loaded.clone(),
            settings: settings.clone(),
            conserved: conserved.clone(),
            within,
            // How wrong a point is says which one is tried next.
            early: false,
            until: None,
            clock,
            estimate: estimate.clone(),
        };
        let threads = Driver::threads(self.options.jobs);
        let driver = Driver::new(Self::NAME, threads, &self.options, events)?;
        let store = self.options.store.as_deref();
        record.ask(store, &sweep(None));
        if !quiet {
            let seconds = driver.forecast(&record, &sweep(None)).remaining();
            let (points, title) = (record.rows.len(), &record.title);
            let time = duration(seconds);
            let done = record.done();
            let kept = if done > 0 { format!(", {done} done before") } else { String::new() };
            console::err(&format!("  accuracy  {title}: {points} points{kept}, about {time}\n"));
        }
        let mut ended = driver.round(&mut record, sweep(None), quiet)?;
        if record.share.is_some() {
            record.ask(store, &sweep(None));
        }
        if let Some(limit) = self.max_error {
            let mut search = Search::new(model, &settings.mapping, &lists, &plan, limit);
            // Of parts the next round takes the results of all.
            while ended == Ended::Done && !record.waits() {
                let more = search.next(&record.sheet().rows);
                if more.is_empty() {
                    break;
                }
                let count = more.len();
                record.extend(more.into_iter().map(row));
                let round = sweep(Some(limit));
                record.ask(store, &round);
                if !quiet {
                    let time = duration(driver.forecast(&record, &round).remaining());
                    console::err(&format!("            {count} points more in search of the goal, about {time}\n"));
                }
                ended = driver.round(&mut record, round, quiet)?;
                if record.share.is_some() {
                    record.ask(store, &sweep(Some(limit)));
                }
            }
        }
        if tell_of_store(&record, store, quiet) {
            return Ok(());
        }
        let sheet = record.sheet();
        let view = View::new(&sheet);
        if !quiet {
            console::out(&format!("{}  see {}\n", view.summary(), record.target.display()))?;
            if ended == Ended::Late {
                let (done, total) = (sheet.rows.len(), sheet.total);
                console::out(&format!("  {done} of {total} points in the time of `--within`; `--resume` goes on\n"))?;
            }
        }
        verdict(&sheet)?;
        match (self.max_error, view.chosen) {
            (Some(_), None) => {
                let (why, _) = sheet.goals.refusal(&sheet.rows, |row| row.command.clone());
                Err(Failure::out_of_reach(why, "take a larger `--max-error`, or other lists", &sources))
            }
            _ => Ok(()),
        }
    }

    /// What was asked for, as `accuracy.json` says it.
    fn head(&self, model: &Model, plan: &Plan) -> Map<String, Value> {
        let left_out = plan.left_out.iter();
        let left_out = left_out.map(|left_out| json!({"solver": left_out.solver.name(), "reason": left_out.reason}));
        let head = json!({
            "generator": GENERATOR,
            "model": model.name,
            "odes": model.odes(),
            "model_sha256": fingerprint(model),
            "span_s": model.span,
            "command": self.given.command,
            "shared_options": self.given.shared.join(" "),
            "left_out": left_out.collect::<Vec<_>>(),
        });
        let Value::Object(head) = head else { unreachable!("written as an object") };
        head
    }
}
