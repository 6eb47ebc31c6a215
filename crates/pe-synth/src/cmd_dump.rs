//! `pe-synth dump`: the result of a compiler stage, as text.

use std::path::PathBuf;

use pe_hls::mapping::Problem;
use petgraph::dot::{Config, Dot};

use crate::console;
use crate::messages::MessageFormat;
use crate::options::{MappingArgs, ModelArgs, PointArgs};
use crate::output;
use crate::progress;
use pe_flow::elimination;
use pe_flow::failure::Failure;
use pe_flow::known::Known;
use pe_flow::pipeline::{self, Prepared};
use pe_flow::settings::Settings;
use pe_flow::stages;
use pe_ir::index::EquationId;
use pe_ir::text;

/// Prints the result of a compiler stage
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth dump --stage step models/lorenz/lorenz.spec -o step.txt && pe-synth compile --from step.txt
  pe-synth dump --stage ode-graph models/weibel5/weibel5.spec | dot -Tsvg > weibel5.svg
  pe-synth dump --stage mapping --pes 4 models/weibel5/weibel5.spec -o weibel5.map")]
pub struct Dump {
    #[command(flatten)]
    point: PointArgs,
    #[command(flatten)]
    mapping: MappingArgs,
    /// The compiler stage
    #[arg(long, value_enum, help_heading = "Output")]
    stage: Stage,
    /// File [default: standard output]
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Omits the preceding stages, which `compile --from` needs
    #[arg(long, help_heading = "Output")]
    only: bool,
    #[command(flatten)]
    model: ModelArgs,
}

/// Stages that can be dumped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
enum Stage {
    /// Flat equations with folded constants
    Model,
    /// Chains of one solver step
    Step,
    /// Number formats
    Fixed,
    /// Dependency graph of the ODEs, in DOT
    OdeGraph,
    /// Dependency graph of the PEs, in DOT
    PeGraph,
    /// PE of each equation
    Mapping,
    /// Time of each chain and transfer
    Schedule,
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
        match &self.output {
            Some(path) => output::write_file(path, text.as_bytes()),
            None => console::out(&text),
        }
    }

    fn text(&self) -> Result<String, Failure> {
        let (point, mapping) = (self.point.point(), self.mapping.options());
        let told = progress::listener(true, self.message_format());
        let loaded = self.model.load_stages(&point, &mapping, &told)?;
        let mut watch = progress::stopwatch(true, self.message_format());
        let mut sections = vec![loaded.model.to_string()];
        if self.stage == Stage::Model {
            return Ok(self.of(sections));
        }
        let settings = self.model.settings(&self.mapping);
        let (mapping, _) = elimination::settled(&loaded, &settings, &point, &mut watch)?;
        let settings = Settings { mapping, ..settings };
        let mapping = &settings.mapping;
        if matches!(self.stage, Stage::Step | Stage::OdeGraph) {
            let graph = pipeline::step(&loaded, &point, mapping, &mut watch)?;
            if self.stage == Stage::OdeGraph {
                let named = Problem::of(&graph).ode_graph().map_owned(
                    |index, load| format!("{} ({load} slots)", graph.equations[EquationId::at(index.index())].name),
                    |_, ()| "",
                );
                return Ok(Dot::with_config(&named, &[Config::EdgeNoLabel]).to_string());
            }
            sections.push(graph.to_string());
            return Ok(self.of(sections));
        }
        let Prepared { graph, judged, network } = pipeline::prepare(&loaded, &settings, &point, &mut watch)?;
        sections.extend([graph.to_string(), text::fixed::print(&graph, &judged.fixed)]);
        if self.stage == Stage::Fixed {
            return Ok(self.of(sections));
        }
        let design = pipeline::implement(&loaded, &graph, &judged, network, mapping, &Known::default(), &mut watch)?;
        if self.stage == Stage::PeGraph {
            return Ok(Dot::new(&Problem::of(&design.graph).pe_graph(&design.mapping)).to_string());
        }
        sections.push(text::mapping::print(&design.graph, &design.mapping));
        if self.stage >= Stage::Schedule {
            // A program of rounds is that of their schedule; a schedule goes on to rounds again.
            let flat = design.flat.as_ref().filter(|_| self.stage == Stage::Schedule);
            sections.push(text::schedule::print(design.issued(), flat.unwrap_or(&design.schedule)));
        }
        if self.stage == Stage::Program {
            sections.push(stages::with_labels(&design.program, design.issued()).to_string());
        }
        Ok(self.of(sections))
    }

    /// All sections, or the last one.
    fn of(&self, mut sections: Vec<String>) -> String {
        match self.only {
            true => sections.pop().unwrap_or_default(),
            false => sections.concat(),
        }
    }
}
