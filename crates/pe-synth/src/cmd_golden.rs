//! `pe-synth golden`: the figures of a design and what it computes in its first steps, small enough for a repository.

use std::path::PathBuf;

use crate::figures::Record;
use crate::messages::MessageFormat;
use crate::output::OutputFolder;
use pe_flow::failure::Failure;

/// Saves the figures and first outputs of a compiled design, for later comparison with `diff`
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth golden out/weibel5 -o models/weibel5/golden")]
pub struct Golden {
    /// Folder that `compile` wrote
    folder: PathBuf,
    /// Folder to write; replaced if pe-synth wrote it
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Format of errors on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl Golden {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        let record = Record::read(&self.folder)?;
        let (Some(outputs), true) = (&record.outputs, record.report.trace.is_some()) else {
            return Err(Failure::file("read", &self.folder, "it holds no trace; give the folder that `compile` wrote"));
        };
        let folder = OutputFolder::create(&self.output)?;
        folder.write("report.json", &format!("{:#}\n", record.reduced()))?;
        let design = record.report.model.as_deref().unwrap_or_default();
        folder.write(&format!("{design}_outputs.txt"), outputs)?;
        folder.finish()
    }
}
