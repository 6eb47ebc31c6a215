//! Compiles the validation set and prints its results as a page, which is `docs/validation.md`.
//!
//! ```sh
//! validation [CASE...] > docs/validation.md         # all cases if none is named; `quick` are those of the test
//! ```
//!
//! Ends with exit code 4 if a case is not what `models/validation/cases.csv` asks for; the page says which.

#[path = "../tests/support/validation.rs"]
mod validation;

use std::collections::BTreeSet;
use std::process::ExitCode;

use validation::{Case, Figures, Outcome};

/// Clock that run times on the hardware are stated for: the assumption of `pe-synth compile`.
const CLOCK: f64 = 150e6;

const HEAD: &str = "\
# Validation

Written by `cargo run -p xtask -- validation`, which compiles every case of
[models/validation/cases.csv](../models/validation/cases.csv): published test problems, and models from the fields
that pe-synth is meant for, with words of 32 bits and the multiplier 32x32 unless the options say otherwise.
[models/validation](../models/validation/README.md) names the sources. Decisions
[0029](decisions/0029-validation-set.md) and [0047](decisions/0047-stated-beside-true.md) give the reasons.

- **word length**: fixed point against double precision with the same step, rounded coefficients included;
  **coefficients** is that part alone.
- **method**: the step in double precision against a reference solution by another library, at the times of its file,
  some 250 that follow the solution, or 20.
- **truth**: the hardware's numbers against the solution after **every** step, and at the times of the file. The solution
  after every step comes from the library of `--reference` and must agree with the file, which has nothing in common with
  the compiler, to a tenth of the error, or to 1e-9.
- **parts**: what `compile` states, word length, method, functions and held inputs added up; **stated**: the total error
  that `compile --reference` states. Neither depends on the file. Both must be at least a third of the truth, and should be
  at least 0.8 of it. A missing truth is below 1e-10, beyond the digits of the file.
- Errors are those of the worst state, relative to its largest magnitude over the span. **must** and **aim** are the
  required and the desired limit of the word-length error.
- **verdict** is `fine`, or the expected codes of warnings and errors (`pe-synth explain CODE`). A refusal is the right
  answer where no result is possible.
- **run** is cycles per step times steps at a clock of 150 MHz, which is assumed. **s** are seconds of the compiler on a
  possibly loaded machine.
";

/// A figure in as many digits as it is worth.
fn short(number: f64) -> String {
    format!("{number:.1e}")
}

/// What was reached of what was asked for.
fn reached(found: f64, (must, aim): (f64, f64)) -> &'static str {
    if found <= aim {
        "aim"
    } else if found <= must {
        "must"
    } else {
        "**missed**"
    }
}

/// A stated error as a part of the truth.
fn share(part: Option<f64>) -> String {
    part.map_or(String::new(), |part| if part < 100.0 { format!("{part:.2}") } else { format!("{part:.0}") })
}

/// Part of the truth that every stated error should be at least, and from which on it says little.
const WANTED: f64 = 0.8;
const SAYS_LITTLE: f64 = 100.0;

/// How stated errors compare with the truth.
fn statements(outcomes: &[(&Case, Outcome)]) -> String {
    let judged: Vec<(&Case, &Figures)> = outcomes
        .iter()
        .filter_map(|(case, outcome)| {
            Some((*case, outcome.figures.as_ref().filter(|figures| figures.whole.is_some())?))
        })
        .collect();
    let problems: BTreeSet<&str> = judged.iter().map(|(case, _)| case.spec.as_str()).collect();
    let seen = judged.iter().filter(|(_, figures)| figures.truth().is_some()).count();
    let mut text = format!(
        "{} cases of {} problems are judged after every step; in {seen} of them the error is large enough to be seen.\n",
        judged.len(),
        problems.len()
    );
    text += &compared("stated/truth", &judged, Figures::stated_of_truth);
    text + &compared("parts/truth", &judged, Figures::parts_of_truth)
}

/// Extremes of a statement as a part of the truth.
fn compared(what: &str, judged: &[(&Case, &Figures)], of: impl Fn(&Figures) -> Option<f64>) -> String {
    let mut found: Vec<(f64, &str)> =
        judged.iter().filter_map(|(case, figures)| Some((of(figures)?, case.name.as_str()))).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(((least, _), (most, _))) = found.first().zip(found.last()) else { return String::new() };
    let names = |is: &dyn Fn(f64) -> bool| {
        let names: Vec<&str> = found.iter().filter(|(part, _)| is(*part)).map(|(_, name)| *name).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    };
    format!(
        "\n**{what}**: smallest {}, median {}, largest {}; below {WANTED}: {}; above {SAYS_LITTLE}: {}.\n",
        share(Some(*least)),
        share(Some(found[found.len() / 2].0)),
        share(Some(*most)),
        names(&|part| part < WANTED),
        names(&|part| part > SAYS_LITTLE)
    )
}

/// A time with a unit that leaves one to three digits before the point.
fn time(seconds: f64) -> String {
    let (number, unit) = match seconds {
        s if s >= 1.0 => (s, "s"),
        s if s >= 1e-3 => (s * 1e3, "ms"),
        s => (s * 1e6, "us"),
    };
    format!("{number:.3} {unit}")
}

fn row(case: &Case, outcome: &Outcome) -> String {
    let mut cells = vec![case.name.clone()];
    match &outcome.figures {
        Some(figures) => {
            let run = f64::from(figures.cycles) * figures.steps as f64 / CLOCK;
            cells.extend([
                figures.method.0.clone(),
                format!("{:e}", figures.method.1),
                figures.states.to_string(),
                figures.steps.to_string(),
                figures.cycles.to_string(),
                time(run),
                format!("{}, `{}`", short(figures.word_length), figures.worst),
                short(figures.coefficient),
                case.word_length.map_or(String::new(), |(must, aim)| format!("{must:e} / {aim:e}")),
                case.word_length.map_or("", |goal| reached(figures.word_length, goal)).to_owned(),
                short(figures.parts),
                figures.whole.map_or(String::new(), |whole| short(whole.stated)),
                figures.truth().map_or(String::new(), short),
                share(figures.parts_of_truth()),
                share(figures.stated_of_truth()),
            ]);
        }
        None => cells.extend(std::iter::repeat_n(String::new(), 15)),
    }
    // The method stands before what is stated.
    cells.insert(11, outcome.method.map_or(String::new(), short));
    cells.extend([outcome.verdict.clone(), format!("{:.1}", outcome.seconds)]);
    format!("| {} |", cells.join(" | "))
}

fn main() -> ExitCode {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let mut cases = validation::cases();
    let asks = |case: &Case, name: &str| case.name == name || (name == "quick" && case.quick);
    if let Some(unknown) = wanted.iter().find(|name| !cases.iter().any(|case| asks(case, name))) {
        eprintln!("there is no case `{unknown}`");
        return ExitCode::from(2);
    }
    cases.retain(|case| wanted.is_empty() || wanted.iter().any(|name| asks(case, name)));
    println!("{HEAD}");
    println!(
        "| case | solver | step, s | states | steps | cycles | run | word length | coefficients | must / aim | reached \
         | method | parts | stated | truth | parts/truth | stated/truth | verdict | s |"
    );
    println!("|{}", "---|".repeat(19));
    let (mut complaints, mut refusals, mut outcomes) = (Vec::new(), Vec::new(), Vec::new());
    for case in &cases {
        eprintln!("{}", case.name);
        let outcome = case.run(true);
        println!("{}", row(case, &outcome));
        complaints.extend(case.complaints(&outcome));
        if let Some(message) = &outcome.message {
            refusals.push(format!("- {}: {} {message}", case.name, outcome.verdict));
        }
        outcomes.push((case, outcome));
    }
    println!("\n{}", statements(&outcomes));
    println!("What the cases with a code say:\n\n{}", refusals.join("\n"));
    if complaints.is_empty() {
        println!("\nAll {} cases are what they must be.", cases.len());
        return ExitCode::SUCCESS;
    }
    println!("\n{} of {} cases are not what they must be:\n", complaints.len(), cases.len());
    complaints.iter().for_each(|complaint| println!("- {complaint}"));
    ExitCode::from(4)
}
