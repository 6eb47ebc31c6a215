//! `pe-synth fmt`: lays out the text of specs.

use std::path::{Path, PathBuf};

use crate::console;
use crate::messages::MessageFormat;
use crate::output;
use pe_flow::failure::Failure;
use pe_flow::spec::{self, STANDARD_INPUT};

/// Lays out specs: blanks, indentation and columns; words, line ends and comments stay
///
/// A statement over several lines keeps the layout of its writer. A spec with syntax errors is not touched.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth fmt models/weibel5/weibel5.spec
  pe-synth fmt --check models/*/*.spec
  pe-synth fmt - < a.spec")]
pub struct Fmt {
    /// Specs and files that they include; `-` reads standard input and writes standard output
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Writes nothing; fails with exit code 4 if a file would change
    #[arg(long)]
    check: bool,
    /// Format of errors on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl Fmt {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Files that cannot be read or written, syntax errors, and with `--check` files that would change.
    pub fn run(&self) -> Result<(), Failure> {
        let mut texts = Vec::new();
        // All files are understood before one is written.
        for path in &self.files {
            let sources = spec::main_text(path)?;
            let text = pe_frontend::format(&sources).map_err(|findings| Failure::Spec(findings, sources.clone()))?;
            texts.push((path, sources.text() != text, text));
        }
        let changed: Vec<&Path> =
            texts.iter().filter(|(_, changed, _)| *changed).map(|(path, ..)| path.as_path()).collect();
        if self.check {
            let names: Vec<String> = changed.iter().map(|path| path.display().to_string()).collect();
            return match names.len() {
                0 => Ok(()),
                1 => Err(Failure::Mismatch(format!("{} is not laid out by `fmt`", names[0]))),
                count => {
                    Err(Failure::Mismatch(format!("{count} files are not laid out by `fmt`: {}", names.join(", "))))
                }
            };
        }
        for (path, changed, text) in &texts {
            if path.as_path() == Path::new(STANDARD_INPUT) {
                console::out(text)?;
            } else if *changed {
                output::write_file(path, text.as_bytes())?;
            }
        }
        Ok(())
    }
}
