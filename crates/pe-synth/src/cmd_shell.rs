//! `pe-synth completions` and `pe-synth man`: what shells and `man` know about the command line.

use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use pe_flow::failure::Failure;

use crate::console;

/// Prints completions for a shell
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth completions bash > ~/.local/share/bash-completion/completions/pe-synth
  pe-synth completions zsh  > ~/.zfunc/_pe-synth
  pe-synth completions fish > ~/.config/fish/completions/pe-synth.fish")]
pub struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    /// Runs the command; `command` is the whole command line's description.
    ///
    /// # Errors
    /// [`Failure::File`] if it cannot be printed.
    pub fn run(&self, mut command: Command) -> Result<(), Failure> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut command, "pe-synth", &mut script);
        console::out(&String::from_utf8_lossy(&script))
    }
}

/// Prints the manual page
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth man | man -l -
  pe-synth man > ~/.local/share/man/man1/pe-synth.1")]
pub struct ManualPage {}

impl ManualPage {
    /// Runs the command; `command` is the whole command line's description.
    ///
    /// # Errors
    /// [`Failure::File`] if it cannot be printed.
    pub fn run(&self, command: Command) -> Result<(), Failure> {
        console::out(&page(command))
    }
}

/// One page for the tool and all its commands, in the language of `man`.
fn page(mut command: Command) -> String {
    command.build();
    let man = Man::new(command.clone()).title("PE-SYNTH").manual("pe-synth");
    let mut text = APOSTROPHE.to_owned() + &section(|out| man.render_title(out));
    text += &section(|out| man.render_name_section(out));
    text += &section(|out| man.render_synopsis_section(out));
    text += &section(|out| man.render_description_section(out));
    for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
        let man = Man::new(sub.clone());
        text += &format!(".SH \"PE\\-SYNTH {}\"\n", sub.get_name().to_uppercase().replace('-', "\\-"));
        let description = section(|out| man.render_description_section(out));
        text += description.split_once('\n').map_or("", |(_, body)| body);
        // Sections of the command become parts of its own section.
        text += &section(|out| man.render_synopsis_section(out)).replace(".SH ", ".SS ");
        text += &section(|out| man.render_options_section(out)).replace(".SH ", ".SS ");
        text += &sub.get_after_help().map_or_else(String::new, |help| verbatim(".SS", &help.to_string()));
    }
    text + &command.get_after_help().map_or_else(String::new, |help| verbatim(".SH", &help.to_string()))
}

/// What every section defines again: an apostrophe that stays one in all kinds of output.
const APOSTROPHE: &str = ".ie \\n(.g .ds Aq \\(aq\n.el .ds Aq '\n";

fn section(render: impl FnOnce(&mut dyn std::io::Write) -> std::io::Result<()>) -> String {
    let mut bytes = Vec::new();
    render(&mut bytes).expect("writing to memory succeeds");
    let text = String::from_utf8_lossy(&bytes).into_owned();
    text.strip_prefix(APOSTROPHE).unwrap_or(&text).to_owned()
}

/// Help text whose lines stay as they are; a line that ends with a colon opens a section.
fn verbatim(heading: &str, help: &str) -> String {
    let mut text = String::new();
    for line in help.lines() {
        let safe = line.replace('\\', "\\e").replace('-', "\\-");
        match line.strip_suffix(':').filter(|_| !line.starts_with(' ')) {
            Some(title) => text += &format!(".fi\n{heading} {}\n.nf\n", title.to_uppercase()),
            None => text += &format!("\\&{safe}\n"),
        }
    }
    text.strip_prefix(".fi\n").unwrap_or(&text).to_owned() + ".fi\n"
}
