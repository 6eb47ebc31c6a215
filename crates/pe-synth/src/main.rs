//! `pe-synth`: compiles ordinary differential equations to a network of processing elements.

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use pe_synth::failure::{Failure, MessageFormat};
use pe_synth::{cmd_compile, cmd_dump, cmd_sim, cmd_verify};

/// Compiles ordinary differential equations to a network of processing elements on an FPGA
#[derive(Parser)]
#[command(version, propagate_version = true)]
#[command(after_help = "Exit codes: 0 success, 1 the model is wrong or its result would be, 2 wrong options, \
                        3 a file cannot be read or written, 4 engines disagree, 5 a needed program is missing.")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Compile(Box<cmd_compile::Compile>),
    Verify(cmd_verify::Verify),
    Sim(Box<cmd_sim::Sim>),
    Dump(Box<cmd_dump::Dump>),
    /// Explains an error or warning code
    Explain {
        /// The code, for example E0201
        code: String,
    },
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let (format, result) = match &arguments.command {
        Command::Compile(compile) => (compile.message_format(), compile.run(&command_line())),
        Command::Verify(verify) => (MessageFormat::Human, verify.run()),
        Command::Sim(sim) => (sim.message_format(), sim.run()),
        Command::Dump(dump) => (dump.message_format(), dump.run()),
        Command::Explain { code } => (MessageFormat::Human, explain(code)),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.print(format);
            failure.exit_code()
        }
    }
}

/// The command as it can be typed again, without the output folder: that does not change the result.
fn command_line() -> String {
    let mut words = vec!["pe-synth".to_owned()];
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "-o" || argument == "--output" {
            arguments.next();
        } else if !argument.starts_with("-o") && !argument.starts_with("--output=") {
            let plain = argument.chars().all(|c| c.is_ascii_alphanumeric() || "-_./=+,:%@".contains(c));
            words.push(if plain { argument } else { format!("'{}'", argument.replace('\'', "'\\''")) });
        }
    }
    words.join(" ")
}

fn explain(code: &str) -> Result<(), Failure> {
    let text = pe_ir::codes::explain(code)
        .ok_or_else(|| Failure::Usage(format!("there is no code `{code}`; codes look like E0201 or W0001")))?;
    // A closed pipe (`| head`) ends the output, not with an error.
    let _ = std::io::Write::write_all(&mut std::io::stdout(), format!("{text}\n").as_bytes());
    Ok(())
}
