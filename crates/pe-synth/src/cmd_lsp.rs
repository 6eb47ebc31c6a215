//! `pe-synth lsp`: a language server for editors.

use std::io::{self, BufReader};

use pe_flow::failure::Failure;
use pe_lsp::Ended;

/// Serves an editor: findings while typing, hover, definitions, renaming, completion, layout
///
/// Speaks the Language Server Protocol over standard input and output; editors start it. `docs/editors.md` says how they are
/// told to.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth lsp
  pe-synth lsp --stdio")]
pub struct Lsp {
    /// Does nothing: some editors pass it, and standard input and output are the only way
    #[arg(long)]
    stdio: bool,
}

impl Lsp {
    /// Runs the command, until the editor ends it.
    ///
    /// # Errors
    /// An end that was not announced with `shutdown`, as the protocol demands.
    pub fn run(&self) -> Result<(), Failure> {
        match pe_lsp::serve(BufReader::new(io::stdin()), io::stdout()) {
            Ended::Orderly => Ok(()),
            Ended::Abruptly => Err(Failure::Fruitless("the editor left without `shutdown`".to_owned())),
        }
    }
}
