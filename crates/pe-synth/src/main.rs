//! `pe-synth`: compiles ordinary differential equations to a network of processing elements.

use std::path::Path;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser, Subcommand};

use pe_flow::failure::Failure;
use pe_synth::messages::{MessageFormat, guarded, print_failure, print_plain};
use pe_synth::{
    cmd_accuracy, cmd_bench, cmd_check, cmd_compile, cmd_diff, cmd_dump, cmd_explain, cmd_explore, cmd_fmt, cmd_fmu,
    cmd_golden, cmd_import, cmd_lsp, cmd_new, cmd_rates, cmd_serve, cmd_shell, cmd_sim, cmd_verify, cmd_wrap, command,
    console,
};

/// Compiles ordinary differential equations to a network of processing elements on an FPGA
///
/// A spec states the equations as on paper. pe-synth compiles it to a network of small microcoded processing elements
/// (PEs), written as VHDL-2008 for any FPGA, together with a Rust program that computes the same bits, and reports
/// size, speed and error of the result.
#[derive(Parser)]
#[command(version, propagate_version = true, after_help = AFTER_HELP)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// What follows the commands on the help page.
const AFTER_HELP: &str = "\
Examples:
  pe-synth compile models/van_der_pol/van_der_pol.spec --pes 2 -o out/van_der_pol
  pe-synth check models/van_der_pol/van_der_pol.spec --step 0.2
  pe-synth verify out/van_der_pol
  pe-synth wrap out/van_der_pol
  pe-synth sim models/van_der_pol/van_der_pol.spec --double -o van_der_pol.csv
  pe-synth explore models/van_der_pol/van_der_pol.spec --pes 1,2 --solver rk4
  pe-synth accuracy models/van_der_pol/van_der_pol.spec --max-error 1e-4
  pe-synth import model.xml -o model.spec
  pe-synth explain E0307
  pe-synth new oscillator
  pe-synth check oscillator.spec --watch

Exit codes:
   0  success
   1  the model is wrong, or its result would be; the findings carry codes
   2  wrong options
   3  a file cannot be read or written
   4  engines disagree, figures changed beyond their tolerance, nothing was compared, or `fmt --check` found something
   5  a required program is missing
  70  internal error; please report it
 130  interrupted; a sweep keeps the points computed so far

Documents:
  docs/guide.md        how to choose PEs, word lengths and ranges, and how to read the report
  docs/language.md     the language of specs
  docs/import.md       what is imported, and what becomes of it
  docs/diagnostics.md  every error and warning, as `pe-synth explain` prints them
  docs/report.md       every key of report.json, and of messages in JSON";

#[derive(Subcommand)]
enum Command {
    Compile(Box<cmd_compile::Compile>),
    Check(Box<cmd_check::Check>),
    Verify(cmd_verify::Verify),
    Wrap(cmd_wrap::Wrap),
    Fmu(cmd_fmu::Fmu),
    Explore(Box<cmd_explore::Explore>),
    Accuracy(Box<cmd_accuracy::Accuracy>),
    Sim(Box<cmd_sim::Sim>),
    New(cmd_new::New),
    Fmt(cmd_fmt::Fmt),
    Bench(Box<cmd_bench::Bench>),
    Dump(Box<cmd_dump::Dump>),
    Import(Box<cmd_import::Import>),
    Golden(cmd_golden::Golden),
    Diff(cmd_diff::Diff),
    Rates(cmd_rates::Rates),
    Serve(cmd_serve::Serve),
    Lsp(cmd_lsp::Lsp),
    Explain(cmd_explain::Explain),
    Completions(cmd_shell::Completions),
    Man(cmd_shell::ManualPage),
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return refused(&error),
    };
    let outcome = guarded(|| match &arguments.command {
        Command::Compile(compile) => (compile.message_format(), compile.run(&command::typed(std::env::args().skip(1)))),
        Command::Check(check) => (check.message_format(), check.run()),
        Command::Verify(verify) => (verify.message_format(), verify.run()),
        Command::Wrap(wrap) => (wrap.message_format(), wrap.run(&command::typed(std::env::args().skip(1)))),
        Command::Fmu(fmu) => (fmu.message_format(), fmu.run()),
        Command::Accuracy(accuracy) => (accuracy.message_format(), accuracy.run()),
        Command::Explore(explore) => (explore.message_format(), explore.run()),
        Command::New(new) => (new.message_format(), new.run()),
        Command::Fmt(fmt) => (fmt.message_format(), fmt.run()),
        Command::Sim(sim) => (sim.message_format(), sim.run()),
        Command::Bench(bench) => (bench.message_format(), bench.run()),
        Command::Dump(dump) => (dump.message_format(), dump.run()),
        Command::Import(import) => (import.message_format(), import.run()),
        Command::Golden(golden) => (golden.message_format(), golden.run()),
        Command::Diff(diff) => (diff.message_format(), diff.run()),
        Command::Rates(rates) => (rates.message_format(), rates.run()),
        Command::Serve(serve) => (serve.message_format(), serve.run()),
        Command::Lsp(lsp) => (MessageFormat::Human, lsp.run()),
        Command::Explain(explain) => (explain.message_format(), explain.run()),
        Command::Completions(completions) => (MessageFormat::Human, completions.run(Arguments::command())),
        Command::Man(man) => (MessageFormat::Human, man.run(Arguments::command())),
    });
    let (format, result) = outcome.unwrap_or_else(|failure| (asked_format(), Err(failure)));
    ended(result, format)
}

/// The exit code of a command; a failure is told.
fn ended(result: Result<(), Failure>, format: MessageFormat) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            print_failure(&failure, format);
            failure.exit_code()
        }
    }
}

/// The form of messages that was asked for, where options were not understood or a command did not return.
fn asked_format() -> MessageFormat {
    let words: Vec<String> = std::env::args().collect();
    let next_is_json = |at: usize| words.get(at + 1).is_some_and(|next| next == "json");
    let json = words
        .iter()
        .enumerate()
        .any(|(at, word)| word == "--message-format=json" || (word == "--message-format" && next_is_json(at)));
    if json { MessageFormat::Json } else { MessageFormat::Human }
}

/// Help, version, or options that do not exist.
fn refused(error: &clap::Error) -> ExitCode {
    let told = with_command(error).or_else(|| with_option(error));
    let error = told.as_ref().unwrap_or(error);
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            return ended(console::out(&error.render().ansi().to_string()), asked_format());
        }
        _ if asked_format() == MessageFormat::Json => {
            let (message, help) = command::refusal(error);
            print_plain("usage", &message, help.as_deref(), MessageFormat::Json);
        }
        _ => console::err(&error.render().ansi().to_string()),
    }
    Failure::Usage(String::new()).exit_code()
}

/// The error with a tip, if a spec stands where a command should.
fn with_command(error: &clap::Error) -> Option<clap::Error> {
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand) else { return None };
    if word != "-" && Path::new(word).extension().is_none_or(|extension| extension != "spec") {
        return None;
    }
    let mut told = clap::Error::new(ErrorKind::InvalidSubcommand).with_cmd(&Arguments::command());
    let tip = format!("a command comes first: 'pe-synth compile {}'", command::quoted(word));
    told.insert(ContextKind::InvalidSubcommand, ContextValue::String(word.clone()));
    told.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    Some(told)
}

/// The error with the option of the command that differs least from what was typed, if that is a likely slip.
fn with_option(error: &clap::Error) -> Option<clap::Error> {
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidArg) else { return None };
    let typed = word.strip_prefix("--").filter(|_| error.kind() == ErrorKind::UnknownArgument)?;
    let mut all = Arguments::command();
    all.build();
    let mut command = std::env::args().skip(1).find_map(|word| all.find_subcommand(word).cloned())?;
    let options = command.get_arguments().filter(|option| !option.is_hide_set()).filter_map(|option| option.get_long());
    let distances = options.map(|option| (strsim::osa_distance(typed, option), option.to_owned()));
    // Of two the one of the same length: letters change places more often than they are left out.
    let (distance, option) =
        distances.min_by_key(|(distance, option)| (*distance, option.len().abs_diff(typed.len())))?;
    if distance > typed.len().div_ceil(3) {
        return None;
    }
    let mut told = clap::Error::new(ErrorKind::UnknownArgument).with_cmd(&command);
    told.insert(ContextKind::InvalidArg, ContextValue::String(word.clone()));
    told.insert(ContextKind::SuggestedArg, ContextValue::String(format!("--{option}")));
    told.insert(ContextKind::Usage, ContextValue::StyledStr(command.render_usage()));
    Some(told)
}
