//! `pe-synth dump`: what a stage hands on, as text.

use pe_hls::mapping::Problem;
use petgraph::dot::{Config, Dot};

use crate::console;
use crate::messages::MessageFormat;
use crate::options::{MappingArgs, ModelArgs, PointArgs};
use crate::progress;
use pe_flow::failure::Failure;
use pe_flow::pipeline;

/// Prints what a stage of the compiler hands on
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth dump --stage step models/lorenz/lorenz.spec
  pe-synth dump --stage ode-graph models/weibel5/weibel5.spec | dot -Tsvg > weibel5.svg
  pe-synth dump --stage mapping --pes 4 models/weibel5/weibel5.spec > weibel5.map")]
pub struct Dump {
    #[command(flatten)]
    point: PointArgs,
    #[command(flatten)]
    mapping: MappingArgs,
    /// The stage
    #[arg(long, value_enum, help_heading = "Output")]
    stage: Stage,
    #[command(flatten)]
    model: ModelArgs,
}

/// Stages that can be dumped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Stage {
    /// Flat equations with folded constants
    Model,
    /// Chains of one solver step
    Step,
    /// ODE-dependency graph, in DOT
    OdeGraph,
    /// PE-dependency graph, in DOT
    PeGraph,
    /// PE of each equation
    Mapping,
    /// Control words, memory images and links
    Program,
}

impl Dump {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.model.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let text = self.text()?;
        console::out(&text);
        Ok(())
    }

    fn text(&self) -> Result<String, Failure> {
        let (point, mapping) = (self.point.point(), self.mapping.options());
        let loaded = self.model.load(&point)?;
        if self.stage == Stage::Model {
            return Ok(loaded.model.to_string());
        }
        let mut watch = progress::stopwatch(true, self.message_format());
        let graph = pipeline::build(&loaded, &point, &mapping, &mut watch)?;
        let (_, pes) = mapping.given(point.pes)?;
        let graph = pipeline::split(&graph, pes, &mapping, point.format(&loaded.model).map_err(Failure::Usage)?)
            .unwrap_or(graph);
        match self.stage {
            Stage::Step => return Ok(graph.to_string()),
            Stage::OdeGraph => {
                let named = Problem::of(&graph).ode_graph().map_owned(
                    |index, load| format!("{} ({load} slots)", graph.equations[index.index()].name),
                    |_, ()| "",
                );
                return Ok(Dot::with_config(&named, &[Config::EdgeNoLabel]).to_string());
            }
            _ => {}
        }
        let design = pipeline::design(&loaded, &self.model.settings(&self.mapping), &point, &mut watch)?;
        Ok(match self.stage {
            Stage::PeGraph => Dot::new(&Problem::of(&design.graph).pe_graph(&design.mapping)).to_string(),
            Stage::Mapping => {
                let line = |(equation, pe): (&pe_ir::graph::Equation, &u32)| format!("{} {pe}\n", equation.name);
                design.graph.equations.iter().zip(&design.mapping.pe_of).map(line).collect()
            }
            _ => design.program.to_string(),
        })
    }
}
