//! The options that the user gave, as words of commands.

use pe_flow::explore::row;
use pe_flow::settings::MappingOptions;
use pe_hls::step;
use pe_judge::DesignPoint;
use std::marker::PhantomData;

use clap::{Args, FromArgMatches};
use pe_ir::model::Model;
use pe_ir::word::Pipeline;

use crate::cmd_compile::Compile;
use crate::command;
use crate::options::PointArgs;
use pe_judge::Coefficients;

/// Options that do not change a result.
const WITHOUT_EFFECT: [&str; 10] =
    ["output", "jobs", "within", "store", "shard", "cluster", "parts", "resume", "quiet", "message_format"];

/// Options of sweeps that a point's command lacks, or has with another meaning.
const OF_SWEEPS: [&str; 5] = ["max_error", "sample", "realtime", "fit", "minimise"];

/// A command that sweeps over points.
pub trait Sweeping: Args {
    /// Its name.
    const NAME: &'static str;
}

/// What the user gave to the command `C`, as words of commands.
#[derive(Clone, Debug)]
pub struct Given<C> {
    /// This command.
    pub command: String,
    /// The words of a point's command that do not belong to the point.
    pub shared: Vec<String>,
    sweep: PhantomData<C>,
}

impl<C: Sweeping> FromArgMatches for Given<C> {
    fn from_arg_matches(matches: &clap::ArgMatches) -> Result<Self, clap::Error> {
        let options = |command: clap::Command, without: &[&str]| {
            let known = |argument: &&clap::Arg| !without.contains(&argument.get_id().as_str());
            command::words(matches, command.get_arguments().filter(known))
        };
        let of_point = PointArgs::augment_args(clap::Command::new("point"));
        let mut without: Vec<&str> = of_point.get_arguments().map(|argument| argument.get_id().as_str()).collect();
        without.extend(WITHOUT_EFFECT.iter().chain(&OF_SWEEPS));
        let words = options(C::augment_args(clap::Command::new(C::NAME)), &WITHOUT_EFFECT);
        Ok(Given {
            command: format!("pe-synth {} {}", C::NAME, words.join(" ")),
            shared: options(Compile::augment_args(clap::Command::new("compile")), &without),
            sweep: PhantomData,
        })
    }

    fn update_from_arg_matches(&mut self, matches: &clap::ArgMatches) -> Result<(), clap::Error> {
        *self = Given::<C>::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<C: Sweeping> Args for Given<C> {
    fn augment_args(command: clap::Command) -> clap::Command {
        command
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        command
    }
}

impl<C: Sweeping> Given<C> {
    /// The same where all points eliminate the linear systems of a model in the order that is estimated to be the shortest,
    /// unless one is given: a trial for each point would be the most of a sweep.
    pub fn with_order(&self, model: &Model, options: &mut MappingOptions) -> Given<C> {
        let mut given = Given { command: self.command.clone(), shared: self.shared.clone(), sweep: PhantomData };
        let shortest = step::orders(model).first().map(|(order, _)| *order);
        if let (None, Some(order)) = (options.elimination, shortest) {
            options.elimination = Some(order);
            given.shared.push(format!("--elimination {}", order.name()));
        }
        if let (None, Some(scheme)) = (options.factors, step::schemes(model).first().copied()) {
            options.factors = Some(scheme);
            given.shared.push(format!("--factors {}", scheme.name()));
        }
        given
    }

    /// The command that compiles a point alone.
    pub fn command(&self, point: &DesignPoint) -> String {
        let mut words = vec!["pe-synth".to_owned(), "compile".to_owned()];
        words.extend(self.shared.iter().cloned());
        words.extend(point.pes.map(|pes| format!("--pes {pes}")));
        words.extend(point.solver.map(|solver| format!("--solver {}", solver.name())));
        words.extend(point.step.map(|step| format!("--step {step:e}")));
        words.extend(point.early_steps.map(|early| format!("--early-steps {early}")));
        words.extend(point.form.form().map(|form| format!("--form {form}")));
        words.push(format!("--storage {} --multiplier {}", point.storage, row::multiplier(point)));
        if point.coefficients != Coefficients::OneSlot {
            words.push(format!("--coefficients {}", point.coefficients.name()));
        }
        if point.pipeline != Pipeline::Short {
            words.push(format!("--pipeline {}", point.pipeline.name()));
        }
        words.push("--reference".to_owned());
        words.join(" ")
    }
}
