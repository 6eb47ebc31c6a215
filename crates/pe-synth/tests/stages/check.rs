//! Extreme and malformed cases with the answer that `check` must give: exit code, codes, state, time, remedy.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::support::bench::Folder;
use serde_json::Value;

/// No answer may take longer on a busy machine.
const LONGEST: Duration = Duration::from_secs(60);

/// What `check` answers: exit code, JSON if there is a result, messages and text for people.
struct Answer {
    exit: Option<i32>,
    result: Value,
    codes: Vec<String>,
    messages: String,
}

fn check(folder: &Folder, spec: &str, options: &[&str]) -> Answer {
    let path = folder.0.join("m.spec");
    fs::write(&path, spec).expect("the spec can be written");
    let begin = Instant::now();
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let command = command.current_dir(&folder.0).args(["check", "m.spec", "--message-format", "json"]).args(options);
    let output = command.output().expect("pe-synth starts");
    assert!(begin.elapsed() < LONGEST, "{spec}: {:?}", begin.elapsed());
    let messages = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!messages.contains("panicked") && !messages.contains("internal"), "{spec}: {messages}");
    let result: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    let lines = messages.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let codes = lines.filter_map(|line| line["code"].as_str().map(str::to_owned)).collect();
    let left: Vec<_> = fs::read_dir(&folder.0).expect("the folder").flatten().map(|entry| entry.file_name()).collect();
    assert_eq!(left, ["m.spec"], "check writes no file");
    Answer { exit: output.status.code(), result, codes, messages }
}

fn spec(solver: &str, step: &str, span: &str, statements: &str) -> String {
    format!("model m\nsolver {solver}\nstep {step}\nspan {span}\n{statements}\n")
}

/// A case: what is special, the spec, options, exit code, codes, and what the messages must hold.
type Case<'a> = (&'a str, String, &'a [&'a str], i32, &'a [&'a str], &'a [&'a str]);

#[test]
fn extreme_cases_get_the_answer_that_they_must() {
    let folder = Folder::new("check_cases");
    let decay = "state x = 1\nstate q = 1\nq' = -q\nx' = -1000*x + q\noutput x, q";
    let oscillator = "state x = 1\nstate v = 0\nx' = v\nv' = -100*x\noutput x";
    let lorenz =
        "state x = 1\nstate y = 1\nstate z = 1\nx' = 10*(y - x)\ny' = x*(28 - z) - y\nz' = x*y - 8/3*z\noutput x";
    // The first filter of tests/sampled.rs multiplied out.
    let polynomial = "input x = pulse(1, 0, 100 ms)
every 1 ms {
  y = 0.00980927596766147*x + m1
  state m1 = 0
  next m1 = -0.03915975470094762*x + 3.95754150804959*y + m2
  state m2 = 0
  next m2 = 0.05870103378203576*x - 5.873524488664223*y + m3
  state m3 = 0
  next m3 = -0.039159754700947604*x + 3.8744132097553794*y + m4
  state m4 = 0
  next m4 = 0.009809275967661466*x - 0.9584303054562103*y
}
output y";
    let resonator = "input x = pulse(1, 0, 10 ms)
every 1 ms {
  state m1 = 0
  state m2 = 0
  next m1 = 1.9*m1 + m2 + 0.01*x
  next m2 = -0.999998*m1
}
output m1";
    // A section of a Chebyshev II low pass.
    let section = "input x = pulse(1, 0, 100 ms)
every 1 ms {
  state m1 = 0
  state m2 = 0
  y = 0.1*x + m1
  next m1 = -0.1593397720677305*x + 1.6566468384753021*y + m2
  next m2 = 0.1*x - 0.8475628573300946*y
}
output y";
    let cases: Vec<Case> = vec![
        (
            "a filter of fourth order as one polynomial",
            spec("euler", "1 ms", "1 s", polynomial),
            &["--multiplier", "18x25"],
            0,
            &["W0905", "W0912", "W0915"],
            &["towards the unit circle", "0.992370"],
        ),
        (
            "a pole that rounding moves to the unit circle",
            spec("euler", "1 ms", "200 ms", resonator),
            &["--multiplier", "25x18"],
            1,
            &["E0908"],
            &["|z| = 1.000000000, not 0.999999000", "`--multiplier 25x25` works"],
        ),
        (
            "the same, let through",
            spec("euler", "1 ms", "200 ms", resonator),
            &["--multiplier", "25x18", "--allow", "E0908"],
            0,
            &["E0908"],
            &[],
        ),
        (
            "a filter that rings with what a narrow multiplier sees",
            spec("euler", "1 ms", "1 s", section),
            &["--multiplier", "25x18"],
            0,
            &["W0915"],
            &["does not come to rest", "`--multiplier 35x35` works"],
        ),
        ("the same with the word that it gets", spec("euler", "1 ms", "1 s", section), &[], 0, &[], &[]),
        (
            "an unstable sampled loop",
            spec("rk4", "1 ms", "40 ms", "state x = 1\nx' = -u\nevery 4 ms {\n  u = 1000*x\n}\noutput x"),
            &[],
            0,
            &["W0912"],
            &["|z| = 3.000000000 over 4 steps"],
        ),
        (
            "a period of two and a half steps",
            spec("rk4", "2 ms", "40 ms", "state x = 1\nx' = -u\nevery 5 ms {\n  u = x\n}\noutput x"),
            &[],
            1,
            &["E0807"],
            &["2.500000 steps", "--step 1.6666666666666668e-3"],
        ),
        (
            "a sampled state that stays",
            spec("rk4", "1 ms", "40 ms", "every 1 ms {\n  state m = 1\n  next m = m\n}\noutput m"),
            &[],
            0,
            &["W0911"],
            &[],
        ),
        (
            "zero dynamics",
            spec("rk4", "1 ms", "100 ms", "state x = 0\nstate y = 3\nx' = 0\ny' = 0*x\noutput x, y"),
            &[],
            0,
            &["W0911"],
            &["no state moves"],
        ),
        (
            "a denormal parameter",
            spec("rk4", "1 ms", "100 ms", "state x = 1\nx' = -1e-320*x\noutput x"),
            &[],
            0,
            &["W0911"],
            &[],
        ),
        (
            "a rate of 1e12",
            spec("rk4", "1 ms", "100 ms", "state x = 1\nx' = -1e12*x\noutput x"),
            &[],
            1,
            &["E0901"],
            &["`x`", "eigenvalue -1.00e12"],
        ),
        ("not a number", spec("rk4", "1 ms", "100 ms", "state x = NaN\nx' = -x\noutput x"), &[], 1, &["E0201"], &[]),
        ("infinite", spec("rk4", "1 ms", "100 ms", "state x = 1e308*10\nx' = -x\noutput x"), &[], 1, &["E0503"], &[]),
        (
            "step far too large",
            spec("rk4", "20 ms", "1 s", decay),
            &[],
            1,
            &["E0903"],
            &["`x`", "steps above 2.79e-3 s are unstable for `x`", "works (tried)"],
        ),
        (
            "step just stable",
            spec("rk4", "2.7 ms", "999 ms", "state x = 0.995\nx' = -1000*x + 1000\noutput x"),
            &[],
            0,
            &["W0906"],
            &["of the largest stable one", "`x`", "works (tried)"],
        ),
        (
            "step at 0.8 of the limit",
            spec("rk4", "2 ms", "1 s", "state x = 0.995\nx' = -1000*x + 1000\noutput x"),
            &[],
            0,
            &[],
            &[],
        ),
        (
            "step that does not divide the span",
            spec("rk4", "30 ms", "1 s", "state x = 1\nx' = -x\noutput x"),
            &[],
            0,
            &["W0910"],
            &["33.333 steps", "--span 0.99"],
        ),
        (
            "Euler on an undamped oscillator",
            spec("euler", "1 ms", "10 s", oscillator),
            &[],
            0,
            &["W0903", "W0907"],
            &["lets undamped oscillations grow by a factor of 1.65", "works (tried)"],
        ),
        (
            "Euler on an undamped oscillator with a long step",
            spec("euler", "10 ms", "10 s", oscillator),
            &[],
            1,
            &["E0903"],
            &["lets undamped oscillations grow by a factor of 144.77", "works (tried)"],
        ),
        (
            "Euler on an undamped oscillator for a short time",
            spec("euler", "0.1 ms", "3 s", oscillator),
            &[],
            0,
            &[],
            &[],
        ),
        (
            "a jump between steps",
            spec("rk4", "1 ms", "1 s", "input u = square(1, 3.3 Hz)\nstate x = 0\nx' = 50*(u - x)\noutput x"),
            &[],
            0,
            &["W0921"],
            &["`u` jumps within the step", "`x`"],
        ),
        (
            "a jump on a step",
            spec("rk4", "1 ms", "1 s", "input u = square(1, 2.5 Hz)\nstate x = 0\nx' = 50*(u - x)\noutput x"),
            &[],
            0,
            &[],
            &[],
        ),
        (
            "chaos past the divergence time",
            spec("rk4", "1 ms", "60 s", lorenz),
            &[],
            0,
            &["W0909"],
            &["chaotic", "--span", "standard deviation"],
        ),
        ("chaos before it", spec("rk4", "1 ms", "5 s", lorenz), &[], 0, &[], &[]),
        (
            "finite-time blow-up",
            spec("rk4", "1 ms", "2 s", "state z = 1\nstate x = 1\nz' = -z\nx' = x^2\noutput x, z"),
            &[],
            1,
            &["E0906"],
            &["`x`", "t = 1.000000e0 s"],
        ),
        (
            "blow-up at another time",
            spec("heun", "1 ms", "2 s", "state x = 1\nstate z = 1.25\nz' = z^2\nx' = -x\noutput x, z"),
            &[],
            1,
            &["E0906"],
            &["`z`", "t = 8.00000"],
        ),
        (
            "1e13 steps",
            spec("rk4", "1 ns", "10000 s", "state x = 1\nx' = -x\noutput x"),
            &[],
            1,
            &["E0505"],
            &["1.0e13"],
        ),
        (
            "1e13 steps by option",
            spec("rk4", "1 ms", "1 s", "state x = 1\nx' = -x\noutput x"),
            &["--step", "1e-9", "--span", "10000"],
            2,
            &[],
            &["1.0e13"],
        ),
        (
            "an algebraic cycle",
            spec("rk4", "1 ms", "1 s", "state x = 1\na = b + x\nb = a - x\nx' = -a\noutput x"),
            &[],
            1,
            &["E0307"],
            &["`a`", "`b`"],
        ),
        (
            "an unused state",
            spec("rk4", "1 ms", "1 s", "state x = 1\nstate y = 1\nx' = -x\ny' = y^2\noutput x"),
            &[],
            0,
            &["W0002"],
            &["`y`"],
        ),
        (
            "increments below one LSB",
            spec("rk4", "1 us", "1 s", "state x = 0.5\nx' = 0.01*(1 - x)\noutput x"),
            &["--storage", "16", "--multiplier", "16x16"],
            0,
            &["W0908"],
            &["`x`"],
        ),
        (
            "a divisor that passes zero",
            spec("rk4", "1 ms", "2 s", "state z = 1\nstate x = 0\nz' = -1.0007\nx' = 1/z\noutput x"),
            &[],
            1,
            &["E0904"],
            &["`1/z`", "1/x", "gets there at t = 9.99"],
        ),
        (
            "a divisor that passes zero, less simply",
            spec("rk4", "1 ms", "2 s", "state z = 1\nstate x = 0\nz' = -z\nx' = 3*x/(z - 0.5)\noutput x"),
            &[],
            1,
            &["E0904"],
            &["z-0.5", "gets there at t = 6.9"],
        ),
        (
            "a logarithm of what turns negative",
            spec("rk4", "1 ms", "2 s", "state z = 1\nstate x = 0\nz' = -1\nx' = log(z)\noutput x"),
            &[],
            1,
            &["E0904"],
            &["`log(z)`", "at t = ", "9.99"],
        ),
        (
            "a root of what turns negative",
            spec("rk4", "1 ms", "2 s", "state z = 1\nstate x = 0\nz' = -0.8\nx' = sqrt(z) - x\noutput x"),
            &[],
            1,
            &["E0904"],
            &["`sqrt(z)`", "at t = 1.24"],
        ),
        (
            "a signal beyond its stated range",
            spec("rk4", "1 ms", "1 s", "input u = sine(3, 1 Hz) in -1 .. 1\nstate x = 1\nx' = u - x\noutput x"),
            &[],
            0,
            &["W0913"],
            &["`u`", "at t = 5.500000e-2 s with 1.01", "as far as 3 at t = 2.500000e-1 s", "in -3 .. 3"],
        ),
        (
            "a signal that leaves its stated range after the span",
            spec("rk4", "1 ms", "1 s", "input u = ramp(0, 9, 2, 1) in 0 .. 1\nstate x = 1\nx' = u - x\noutput x"),
            &[],
            0,
            &[],
            &[],
        ),
        ("growth of the model itself", spec("rk4", "1 ms", "5 s", "state x = 1\nx' = 2*x\noutput x"), &[], 0, &[], &[]),
    ];
    let mut wrong = Vec::new();
    for (name, text, options, exit, codes, parts) in &cases {
        let answer = check(&folder, text, options);
        let wanted: Vec<String> = codes.iter().map(|code| (*code).to_owned()).collect();
        let complete = parts.iter().all(|part| answer.messages.contains(part));
        if (answer.exit, &answer.codes) != (Some(*exit), &wanted) || !complete {
            wrong.push(format!("{name}: exit {:?} {:?}\n{}", answer.exit, answer.codes, answer.messages));
        }
        // A result is there whenever the model could be read, and says the same.
        if !answer.result.is_null() {
            let verdict = match (exit, codes.iter().any(|code| *code != "W0002")) {
                (1, _) => "refused",
                (_, true) => "warning",
                _ => "fine",
            };
            let findings = answer.result["findings"].as_array().map_or(0, Vec::len);
            let counted = codes.iter().filter(|code| **code != "W0002").count();
            if answer.result["verdict"] != verdict || findings != counted {
                wrong.push(format!("{name}: {}", answer.result));
            }
        }
    }
    assert!(wrong.is_empty() && cases.len() > 20, "{}", wrong.join("\n"));
}

#[test]
fn the_text_fits_a_terminal_and_names_the_limit() {
    let folder = Folder::new("check_text");
    let statements = "state pressure = 1\nstate volume = 1\nvolume' = -volume\npressure' = -1000*pressure + volume\noutput pressure, volume";
    fs::write(folder.0.join("m.spec"), spec("rk4", "1 ms", "1 s", statements)).expect("the spec can be written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.current_dir(&folder.0).args(["check", "m.spec"]).output().expect("pe-synth starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && text.lines().all(|line| line.chars().count() <= 80), "{text}");
    for part in [
        "verdict          fine",
        "2.785e-3 s by all eigenvalues",
        "`pressure`",
        "2.228e-3 s, 0.8 of it",
        "accuracy step",
    ] {
        assert!(text.contains(part), "no {part} in {text}");
    }
}

#[test]
fn a_remedy_works_when_it_is_taken() {
    let folder = Folder::new("check_remedy");
    let text = spec("rk4", "20 ms", "1 s", "state x = 1\nstate q = 1\nq' = -q\nx' = -1000*x + q\noutput x, q");
    let answer = check(&folder, &text, &[]);
    let help = answer.result["findings"][0]["help"].as_str().expect("a remedy");
    let options: Vec<&str> = help.split('`').nth(1).expect("options in backticks").split(' ').collect();
    let answer = check(&folder, &text, &options);
    assert_eq!(answer.exit, Some(0), "{options:?}: {}", answer.messages);
    assert!(
        !answer.codes.iter().any(|code| code.starts_with("E0") || code == "W0906"),
        "{options:?}: {}",
        answer.messages
    );
}

#[test]
fn the_same_question_gets_the_same_bytes() {
    let folder = Folder::new("check_bytes");
    let text = spec("rk4", "10 ms", "5 s", "state x = 2\nstate v = 0\nx' = v\nv' = 5*(1 - x^2)*v - x\noutput x");
    let [first, second] = [(), ()].map(|()| check(&folder, &text, &[]).result.to_string());
    assert!(first == second && first.contains("predicted_step_s"), "{first}\n{second}");
}

#[test]
fn compile_says_the_same_before_it_writes_anything() {
    let folder = Folder::new("check_compile");
    let compile = |statements: &str| {
        let text = spec("rk4", "1 ms", "2 s", statements);
        fs::write(folder.0.join("m.spec"), text).expect("the spec can be written");
        let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        let output = command.current_dir(&folder.0).args(["compile", "m.spec", "-o", "out", "--no-pictures"]).output();
        let output = output.expect("pe-synth starts");
        let report = fs::read_to_string(folder.0.join("out/report.json")).unwrap_or_default();
        (String::from_utf8_lossy(&output.stderr).into_owned(), report)
    };
    let (messages, report) = compile("state x = 1\nx' = x^2\noutput x");
    assert!(messages.contains("E0906") && messages.contains("t = 1.000000e0 s") && report.is_empty(), "{messages}");
    let (messages, report) = compile("state x = 1\nx' = -100*x + 100\noutput x");
    let report: Value = serde_json::from_str(&report).unwrap_or_else(|_| panic!("{messages}"));
    let stability = &report["stability"];
    // 2.785 / 100, the end of RK4's stability region on the real axis.
    let predicted = stability["predicted_step_s"].as_f64().expect("a limit");
    assert!((predicted - 2.785e-2).abs() < 1e-4 && stability["basis"] == "all eigenvalues", "{stability}");
}

#[test]
fn a_list_of_steps_is_judged_by_its_own_times() {
    let folder = Folder::new("check_list");
    let statements = "input u = ramp(0.7, 1, 30 ms, 100 ms)\nstate x = 1\nx' = -20*x + 20*u\noutput x";
    // 20 short steps, then 17 long ones; 4 ms more are 0.4 of one.
    let answer = check(&folder, &spec("rodas3", "1 ms until 20 ms, then 10 ms", "190 ms", statements), &[]);
    assert_eq!((answer.exit, answer.codes.as_slice()), (Some(0), [].as_slice()), "{}", answer.messages);
    assert_eq!(answer.result["verdict"], "fine", "{}", answer.result);
    let answer = check(&folder, &spec("rodas3", "1 ms until 20 ms, then 10 ms", "194 ms", statements), &[]);
    assert_eq!(answer.codes, ["W0910"], "{}", answer.messages);
    assert!(answer.messages.contains("37.4"), "{}", answer.messages);
}

#[test]
fn ranges_of_all_variables_are_there() {
    let folder = Folder::new("check_ranges");
    let statements = "index i in 1..9\nstate x[i] = i\nx[i]' = -x[i]\noutput x";
    let answer = check(&folder, &spec("rk4", "1 ms", "1 s", statements), &[]);
    let variables = answer.result["variables"].as_array().expect("a list");
    assert_eq!(variables.len(), 9, "{}", answer.result);
    for (index, variable) in variables.iter().enumerate() {
        let number = |key: &str| variable[key].as_f64().expect("a number");
        assert_eq!(
            (variable["name"].as_str(), number("largest")),
            (Some(&*format!("x[{}]", index + 1)), index as f64 + 1.0)
        );
        assert!(number("limit") > 1.2 * number("largest") && number("lsb") > 0.0 && number("word_length") < 1e-6);
        assert!((number("bits") - (number("limit") / number("largest")).log2()).abs() < 1e-9);
    }
    let text = |options: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        let output = command.current_dir(&folder.0).args(["check", "m.spec"]).args(options).output();
        String::from_utf8_lossy(&output.expect("pe-synth starts").stdout).into_owned()
    };
    assert!(text(&[]).contains("3 more with more headroom; `--all` shows them"), "{}", text(&[]));
    let all = text(&["--all"]);
    assert!((1..=9).all(|i| all.contains(&format!("x[{i}] "))) && !all.contains("--all"), "{all}");
    let refused = check(&folder, &spec("rk4", "1 ms", "2 s", "state x = 1\nx' = x^2\noutput x"), &[]);
    assert!(refused.exit == Some(1) && refused.result["variables"].is_null(), "{}", refused.result);
}

#[test]
fn a_word_that_decides_the_trajectory_is_refused_and_an_imprecise_one_is_not() {
    let model = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").join(name);
    let answer = |name: &str, options: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        let output = command.arg("check").arg(model(name)).args(options).output().expect("pe-synth starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    // An orbit with close encounters: half the step agrees to 1e-5.
    let (exit, messages) = answer("validation/arenstorf.spec", &["--multiplier", "28x28"]);
    let parts = ["error[E0907]", "`v`", "t = ", "multiplies differences by", "`--multiplier 32x32` works (tried)"];
    assert!(exit == Some(1) && parts.iter().all(|part| messages.contains(part)), "{messages}");
    let (exit, messages) = answer("validation/arenstorf.spec", &["--multiplier", "35x35"]);
    assert!(exit == Some(0) && !messages.contains("E0907"), "{messages}");
    // With 12 bits, more than half of the largest magnitude of one model is wrong, and an eighth of another's.
    let (exit, messages) = answer("lotka_volterra/lotka_volterra.spec", &["--storage", "12", "--multiplier", "12x12"]);
    assert!(
        exit == Some(1) && messages.contains("error[E0907]") && messages.contains("little in common"),
        "{messages}"
    );
    let (exit, messages) = answer("validation/brusselator.spec", &["--storage", "12", "--multiplier", "12x12"]);
    assert!(exit == Some(0) && messages.contains("warning[W0905]"), "{messages}");
}

#[test]
fn a_step_too_coarse_for_jumps_is_not_called_chaos() {
    let folder = Folder::new("check_jumps");
    // A relaxation oscillator: no model is less chaotic, but steps that are too large land before or behind a jump.
    for (mu, solver, step) in [(30, "rodas3", "20 ms"), (100, "ros2", "5 ms"), (300, "rodas3", "5 ms")] {
        let statements = format!("state x = 2\nstate v = 0\nx' = v\nv' = {mu}*(1 - x^2)*v - x\noutput x");
        let answer = check(&folder, &spec(solver, step, &format!("{} s", 3 * mu), &statements), &[]);
        assert!(answer.exit == Some(1) && answer.codes == ["E0903"], "{}", answer.messages);
        assert!(!answer.messages.contains("the model is chaotic"), "{}", answer.messages);
        assert!(answer.messages.contains("t = ") && answer.messages.contains("--step"), "{}", answer.messages);
    }
}

#[test]
fn the_period_of_a_sampled_part_limits_no_stable_step() {
    let folder = Folder::new("check_periods");
    let held = "every 2 ms {\n  state m = 0\n  next m = 0.5*m + u\n}\noutput m";
    let decay = check(&folder, &spec("rk4", "1 ms", "1 s", &format!("state u = 1\nu' = -u\n{held}")), &[]);
    let ratio = decay.result["stability"]["stiffness_ratio"].as_f64().expect("a ratio");
    assert!(ratio < 1.0, "a single slow decay is not stiff: {}", decay.result);
    let filter = check(&folder, &spec("euler", "1 ms", "1 s", &format!("input u = 1\n{held}")), &[]);
    assert!(filter.result["stability"]["stiffness_ratio"].is_null(), "{}", filter.result);
}

#[test]
fn a_transient_between_the_samples_and_equal_eigenvalues_give_no_alarm() {
    // Three equal motors have equal eigenvalues, and the bus swings further in its first milliseconds than ever after.
    let path = crate::support::models::spec("pump_station");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.arg("check").arg(path).args(["--message-format", "json"]).output().expect("pe-synth starts");
    let result: Value = serde_json::from_slice(&output.stdout).expect("a result");
    assert_eq!(result["verdict"], "fine", "{}", String::from_utf8_lossy(&output.stderr));
    let stability = &result["stability"];
    assert_eq!(stability["basis"], "all eigenvalues", "{stability}");
    for key in ["predicted_step_s", "found_step_s"] {
        assert!(stability[key].as_f64().is_some_and(|step| step > 4e-4), "{stability}");
    }
}
