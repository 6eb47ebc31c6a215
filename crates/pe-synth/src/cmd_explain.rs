//! `pe-synth explain`: what a code means, or which codes there are.

use pe_ir::codes::{self, CODES, Code, GROUPS};

use crate::console;
use crate::messages::MessageFormat;
use pe_flow::failure::Failure;

/// Codes that are suggested in place of one that does not exist.
const SUGGESTED: usize = 3;

/// Explains an error or warning code, or lists all of them
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  pe-synth explain E0307\n  pe-synth explain          lists all codes by group")]
pub struct Explain {
    /// The code, for example E0201; without one, all codes are listed
    code: Option<String>,
    /// Format of errors and warnings on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl Explain {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    pub fn run(&self) -> Result<(), Failure> {
        match &self.code {
            None => console::out(&list()),
            Some(code) => console::out(&format!("{}\n", codes::explain(code).ok_or_else(|| unknown(code))?)),
        }
    }
}

/// All codes by group, errors before warnings.
fn list() -> String {
    let mut text = String::new();
    for (number, title) in GROUPS {
        text += &format!("{title}\n");
        for code in CODES.iter().filter(|code| &code.code[1..3] == *number) {
            text += &format!("  {}  {}\n", code.code, code.title);
        }
    }
    text
}

fn unknown(asked: &str) -> Failure {
    let likely: Vec<String> = likely(asked).iter().map(|code| format!("{} ({})", code.code, code.title)).collect();
    let advice = match likely.as_slice() {
        [] => "`pe-synth explain` lists all codes".to_owned(),
        likely => format!("did you mean {}?", likely.join(" or ")),
    };
    Failure::Usage(format!("there is no code `{asked}`; {advice}"))
}

/// The codes most likely meant: those with the same number, else those whose titles hold the words, else the nearest.
fn likely(asked: &str) -> Vec<&'static Code> {
    let lower = asked.to_lowercase().replace(['_', '-'], " ");
    let digits = lower.trim_start_matches(|c: char| !c.is_ascii_digit()).trim_start_matches('0');
    let by =
        |holds: &dyn Fn(&Code) -> bool| CODES.iter().filter(|code| holds(code)).take(SUGGESTED).collect::<Vec<_>>();
    let same_number = by(&|code| !digits.is_empty() && code.code[1..].trim_start_matches('0') == digits);
    if !same_number.is_empty() {
        return same_number;
    }
    let same_words = by(&|code| lower.len() > 2 && code.title.contains(lower.trim()));
    if !same_words.is_empty() {
        return same_words;
    }
    let distance = |code: &Code| strsim::osa_distance(&code.code.to_lowercase(), &lower);
    let least = CODES.iter().map(distance).min().filter(|least| *least <= 2);
    least.map_or_else(Vec::new, |least| by(&|code| distance(code) == least))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_listed_once() {
        let list = list();
        for code in CODES {
            assert_eq!(list.matches(&format!("  {}  {}\n", code.code, code.title)).count(), 1, "{}\n{list}", code.code);
        }
    }

    #[test]
    fn what_is_no_code_leads_to_the_nearest() {
        let first = |asked: &str| likely(asked).first().map(|code| code.code);
        assert_eq!([first("201"), first("E201"), first("e00307")], [Some("E0201"), Some("E0201"), Some("E0307")]);
        assert_eq!([first("algebraic-loop"), first("Unknown solver")], [Some("E0307"), Some("E0205")]);
        assert_eq!([first("F0201"), first("EO307")], [Some("E0201"), Some("E0307")]);
        assert_eq!([first("banana"), first("")], [None, None]);
    }
}
