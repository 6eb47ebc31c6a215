//! `pe-synth new`: a spec to start from.

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::command::quoted;
use crate::console;
use crate::messages::MessageFormat;
use pe_flow::failure::Failure;

/// What a new spec says; its model has another name.
const STARTER: &str = include_str!("new/starter.spec");

/// The name of its model.
const MODEL: &str = "starter";

/// Writes a spec to start from, with remarks, which compiles at once
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth new oscillator
  pe-synth new models/oscillator/oscillator")]
pub struct New {
    /// Name of the model and of its file NAME.spec; a path puts it into that folder
    name: PathBuf,
    /// Format of errors on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl New {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Names that no model can have, and a file that is there already.
    pub fn run(&self) -> Result<(), Failure> {
        let path = if self.name.extension().is_some_and(|end| end == "spec") {
            self.name.clone()
        } else {
            let mut name = self.name.clone().into_os_string();
            name.push(".spec");
            PathBuf::from(name)
        };
        let model = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("");
        let text = STARTER.replacen(&format!("model {MODEL}"), &format!("model {model}"), 1);
        let mut sources = pe_ir::source::Sources::new(path.display().to_string(), &text);
        let overrides = pe_frontend::Overrides::default();
        if !plain(model) || pe_frontend::compile(&mut sources, &pe_frontend::NoFiles, &overrides).is_err() {
            let message = format!(
                "`{model}` cannot be the name of a model: it has letters, digits and `_`, begins with a letter, and is no keyword"
            );
            return Err(Failure::Usage(message));
        }
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|error| Failure::file("create", folder, error))?;
        }
        write(&path, &text)?;
        let shown = quoted(&path.display().to_string());
        console::out(&format!(
            "{shown}: change it, then\n  pe-synth check {shown}\n  pe-synth compile {shown} -o out/{model}\n  pe-synth verify out/{model}\n"
        ))
    }
}

/// Whether a word looks like a name, so that nothing else gets into the text.
fn plain(word: &str) -> bool {
    !word.is_empty() && word.chars().all(|sign| sign.is_ascii_alphanumeric() || sign == '_')
}

/// Writes a file that must not exist.
fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let mut file = File::create_new(path).map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => Failure::file("write", path, "it exists; choose another name"),
        _ => Failure::file("write", path, error),
    })?;
    file.write_all(text.as_bytes()).map_err(|error| Failure::file("write", path, error))
}
