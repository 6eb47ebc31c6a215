//! Functions of variables through the whole compiler: accuracy, domains, sizes.

use std::process::Command;

use crate::support::bench::Folder;
use pe_frontend::{NoFiles, Overrides};
use pe_ir::source::Sources;
use serde_json::Value;

/// Compiles statements after the usual head; gives exit code, messages and the report.
fn compile(folder: &Folder, statements: &str, options: &[&str]) -> (Option<i32>, String, Value) {
    let (file, target) = (folder.0.join("m.spec"), folder.0.join("out"));
    let _ = std::fs::remove_dir_all(&target);
    let text = format!("model m\nsolver rk4\nstep 1 ms\nspan 300 ms\n{statements}");
    std::fs::write(&file, text).expect("the spec can be written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("compile").arg(&file).arg("-o").arg(&target).args(["--no-pictures", "--tries", "50"]).args(options);
    let output = command.output().expect("pe-synth starts");
    let report = std::fs::read_to_string(target.join("report.json")).unwrap_or_else(|_| "null".to_owned());
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), errors, serde_json::from_str(&report).expect("JSON"))
}

#[test]
fn every_function_is_tabulated_to_half_a_bit() {
    let folder = Folder::new("functions_accurate");
    // A state for each, driven through a range of arguments by the clock `t`; jumps lie between steps, for on a step
    // rounding decides.
    let terms = [
        "1/(0.2 + t)",
        "sqrt(0.1 + t)",
        "exp(-3*t)",
        "log(0.05 + t)",
        "log10(1 + t)*log2(2 + t)",
        "sin(9*t)",
        "cos(9*t)",
        "tan(3*t)",
        "asin(3*t - 0.45)",
        "acos(3*t - 0.45)",
        "atan(20*t - 3)",
        "sinh(5*t)",
        "cosh(5*t)",
        "tanh(10*t - 1)",
        "abs(t - 0.15)",
        "sign(t - 0.1501)",
        "min(t, 0.1)",
        "max(t, 0.1, 0.2)",
        "(0.3 + t)^-1.5",
        "(1 + t)^t",
        "2^(5*t)",
        "if t > 0.2003 then log(t - 0.1) else 3*t",
        "if t > 0.1003 and x1 > 0 then log(t + 0.1)/x1 else 0",
        "(t - 0.15)/(1 - exp(-(t - 0.15)/0.1))",
    ];
    let mut spec = "state t = 0\nt' = 1\n".to_owned();
    for (number, term) in terms.iter().enumerate() {
        spec += &format!("state x{number} = 0\nx{number}' = 5*({term}) - x{number}\n");
    }
    spec += &format!("output {}\n", (0..terms.len()).map(|number| format!("x{number}")).collect::<Vec<_>>().join(", "));
    let (exit, errors, report) = compile(&folder, &spec, &["--pes", "8", "--allow", "E0903"]);
    assert_eq!(exit, Some(0), "{errors}");
    let functions = report["functions"].as_array().expect("functions");
    assert!(functions.len() > terms.len() - 4, "{functions:#?}");
    for function in functions {
        let bound = function["bound_lsb"].as_f64().expect("a bound");
        assert!(bound <= 0.5, "{function}");
    }
    let error = |key: &str| report["error"][key].as_f64().unwrap_or_else(|| panic!("{key} in {}", report["error"]));
    assert!(error("function") < 1e-8 && error("word_length") < 2e-6, "{}", report["error"]);
}

/// Outputs of the hardware over time, by column, without the names, the times and the row of time zero.
fn outputs(folder: &Folder, text: &str) -> Vec<Vec<f64>> {
    let (file, table) = (folder.0.join("s.spec"), folder.0.join("s.csv"));
    std::fs::write(&file, text).expect("the spec can be written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.arg("sim").arg(&file).arg("-o").arg(&table).args(["--pes", "1"]).output();
    assert!(output.expect("pe-synth starts").status.success(), "{text}");
    let rows = std::fs::read_to_string(&table).expect("a table");
    let numbers = |row: &str| row.split(',').skip(1).map(|cell| cell.parse().expect("a number")).collect();
    rows.lines().skip(2).map(numbers).collect()
}

#[test]
fn functions_on_reduced_ranges_are_right_to_two_units_in_2_to_the_30() {
    let folder = Folder::new("functions_units");
    for (name, library, low, high) in [
        ("exp(t)", libm::exp as fn(f64) -> f64, -0.35, 0.35),
        ("1/t", |t| 1.0 / t, 1.0, 2.0),
        ("sin(t)", libm::sin, -1.57, 1.57),
        ("cos(t)", libm::cos, -1.57, 1.57),
    ] {
        let slope = high - low;
        let head = "model s\nsolver euler\nstep 1 ms\nspan 1 s\n";
        let text = format!("{head}state t = {low}\nt' = {slope}\nf = {name}\noutput f, t\n");
        let rows = outputs(&folder, &text);
        assert_eq!(rows.len(), 1000);
        let largest = rows.iter().map(|row| row[0].abs()).fold(0.0, f64::max);
        // Against the function of the argument that the hardware had.
        let error = rows.iter().map(|row| (row[0] - library(row[1])).abs()).fold(0.0, f64::max);
        let units = error / largest * libm::exp2(30.0);
        println!("{name}: {units:.2}");
        assert!(units <= 2.0, "{name}: {units}");
    }
}

#[test]
fn powers_and_logarithms_over_many_octaves_are_computed_from_one() {
    let folder = Folder::new("functions_octaves");
    // The argument falls from 8,000 to 1; a step of its own for each function, which so chooses its division.
    for (name, library) in [
        ("1/x", (|x| 1.0 / x) as fn(f64) -> f64),
        ("3 + 1/(x + 0.5)", |x| 3.0 + 1.0 / (x + 0.5)),
        ("x^-0.3", |x| libm::pow(x, -0.3)),
        ("0.01*sqrt(x)", |x| 0.01 * libm::sqrt(x)),
        ("log(x)", libm::log),
        ("1/(0.25 - -x)^2", |x| 1.0 / ((0.25 + x) * (0.25 + x))),
    ] {
        let head = "model s\nsolver rk4\nstep 5 ms\nspan 9 s\n";
        let text = format!("{head}state x = 8000\nx' = -x\nf = {name}\noutput f, x\n");
        let rows = outputs(&folder, &text);
        let largest = rows.iter().map(|row| library(row[1]).abs()).fold(0.0, f64::max);
        for row in &rows {
            let (is, x) = (row[0], row[1]);
            // Half of what a data port tells arguments apart by, twice: as a state, and as a distance from a place.
            let bit = libm::scalbn(8192.0, -31);
            let blurred = (library(x + bit) - library(x - bit)).abs();
            let error = (is - library(x)).abs();
            assert!(error < blurred + largest * libm::exp2(-29.0), "{name} at {x}: {error:e} of {largest}");
        }
    }
    let statements = "state x = 8000\nx' = -30*x\nf = 1/x\ng = sqrt(x)\noutput f, g\n";
    let (exit, errors, report) = compile(&folder, statements, &["--pes", "1"]);
    assert_eq!(exit, Some(0), "{errors}");
    let functions = report["functions"].as_array().expect("functions");
    let words: u64 = functions.iter().map(|function| function["words"].as_u64().expect("words")).sum();
    assert!(words <= 1024 && functions.iter().any(|of| of["name"] == "1/x: scales"), "{functions:#?}");
    for function in functions {
        assert!(function["bound_lsb"].as_f64().expect("a bound") <= 0.5, "{function}");
    }
    // Words and ports of other lengths have fewer octaves, and no format is missed for them.
    for (ports, rate) in [("25x18", 9), ("25x35", 40), ("28x28", 40), ("35x35", 50), ("18x25", 9)] {
        let statements = format!("state x = 8000\nx' = -{rate}*x\nf = 9/x\ng = x/(x + 0.01)\noutput f, g\n");
        let (exit, errors, _) =
            compile(&folder, &statements, &["--pes", "1", "--multiplier", ports, "--allow", "E0907"]);
        assert_eq!(exit, Some(0), "{ports}: {errors}");
    }
}

#[test]
fn functions_outside_their_domain_are_named_with_argument_and_time() {
    let folder = Folder::new("functions_domain");
    for (statements, part) in [
        ("state x = 0.1\nx' = -1 - sqrt(x)\noutput x\n", "sqrt(x)"),
        ("state x = 0.1\nx' = -1 - 0.01*log(x)\noutput x\n", "log(x)"),
        ("state x = 0\nstate y = 0\nx' = 9\ny' = asin(x)\noutput y\n", "asin(x)"),
        ("state x = 0\nstate y = 0\nx' = 1\ny' = 1/x\noutput y\n", "1/x"),
        // No step falls on zero, and yet the values on both sides of it cannot be held.
        ("state x = -0.10037\nstate y = 0\nx' = 1\ny' = 1/x\noutput y\n", "1/x"),
        ("state x = 1.4\nstate y = 0\nx' = 1\ny' = tan(x)\noutput y\n", "tan(x)"),
        ("state x = 0.1\nstate y = 1\nx' = -1\ny' = if y > 0 then log(x) else y\noutput y\n", "log("),
    ] {
        let (exit, errors, report) = compile(&folder, statements, &[]);
        let named = errors.contains("error[E0904]") && errors.contains(part) && errors.contains("m.spec:");
        assert!(exit == Some(1) && named && report.is_null(), "{statements}{errors}");
    }
}

#[test]
fn a_branch_that_is_not_taken_may_be_undefined() {
    let folder = Folder::new("functions_branches");
    for statements in [
        "state x = 0.1\nx' = if x > 0.05 then -log(x) - 3 else 1\noutput x\n",
        "state x = 0.1\nstate y = 0.2\nx' = -1\ny' = if x > 0 then sqrt(x) + y else -y\noutput x, y\n",
        "state x = 0.1\nstate y = 0\nx' = -1\ny' = if y < 5 and x > 0.02 then y + log(x) else y - x\noutput x, y\n",
        "state x = 0.1\nstate y = 0.2\nx' = -1\ny' = if x > y - 0.2 then log(x - y + 0.2) else 0\noutput x, y\n",
    ] {
        let (exit, errors, report) = compile(&folder, statements, &["--allow", "E0903"]);
        assert!(exit == Some(0) && !report.is_null(), "{statements}{errors}");
    }
}

#[test]
fn equations_of_one_form_share_a_function_however_many_there_are() {
    let count = 20_000;
    let text = format!(
        "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nindex i in 1..{count}\nstate x[i] = i/{count}\n\
         x[i]' = -tanh(x[i]) + 0.1*(if i > 1 then exp(-x[max(i - 1, 1)]) else 0)\noutput x[1]\noutput x[{count}]\n"
    );
    let mut sources = Sources::new("m.spec", &text);
    let (model, _) = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default()).expect("a model");
    let model = pe_hls::lift::lift(model);
    assert_eq!(model.algebraics.len(), 2 * count - 1);
    let graph = pe_hls::step::build(&model).expect("a step");
    assert_eq!(graph.functions.exact.len(), 2);
    let applied = graph.chains.iter().filter(|chain| chain.function.is_some()).count();
    assert_eq!(applied, 4 * (2 * count - 1));
}

/// Hill functions with names and constants of their own, one for each state. With `odd` a little of a third power makes each
/// the only one of its kind.
fn named(count: usize, odd: bool) -> String {
    let mut text = String::new();
    for own in 0..count {
        text += &format!("state g{own} = {:.3}\n", 0.3 + 0.11 * (own % 8) as f64);
    }
    for own in 0..count {
        let (k, most) = (0.4 + 0.031 * own as f64, 3.0 + 0.9 * (own % 8) as f64);
        let beside = if odd { format!(" + {:.3}*g{own}^3", 0.01 + 0.001 * own as f64) } else { String::new() };
        text += &format!("h{own} = {most:.3}*g{own}^2/({k:.3} + g{own}^2{beside})\n");
    }
    for own in 0..count {
        text += &format!("g{own}' = 10*(0.2*h{} - g{own})\n", (own + 1) % count);
    }
    text + &format!("output {}\n", (0..count).map(|own| format!("g{own}")).collect::<Vec<_>>().join(", "))
}

#[test]
fn functions_that_differ_by_constants_share_tables_and_others_do_not() {
    let folder = Folder::new("functions_shared");
    let options = ["--pes", "4"];
    let count = 16;
    let (exit, errors, report) = compile(&folder, &named(count, false), &options);
    assert_eq!(exit, Some(0), "{errors}");
    let functions = report["functions"].as_array().expect("functions");
    let lookups: u64 = functions.iter().filter_map(|function| function["lookups"].as_u64()).sum();
    let shared: u64 = functions.iter().filter_map(|function| function["shared_by"].as_u64()).sum();
    assert!(functions.len() <= 4 && shared == count as u64, "{} tables of {shared}", functions.len());
    assert_eq!(lookups, 4 * count as u64);
    for function in functions {
        let bound = function["bound_lsb"].as_f64().expect("a bound");
        assert!(bound <= 0.55, "{function}");
    }
    // Both sides of the comparison run the model: one with its functions, one with their shapes.
    let error = |report: &Value, key: &str| report["error"][key].as_f64().expect("an error");
    assert!(error(&report, "function") < 1e-8 && error(&report, "word_length") < 1e-6, "{}", report["error"]);
    let cycles = |report: &Value| report["cycles_per_step"].as_u64().expect("cycles");
    let (exit, errors, unlike) = compile(&folder, &named(count, true), &options);
    assert_eq!(exit, Some(0), "{errors}");
    let own = unlike["functions"].as_array().expect("functions").len();
    assert_eq!(own, count);
    assert!(cycles(&report) <= cycles(&unlike), "sharing costs cycles");
}

/// Largest magnitude and limit of each algebraic variable in the table of variables.
fn algebraics(folder: &Folder) -> Vec<(String, [f64; 2])> {
    let table = std::fs::read_to_string(folder.0.join("out").join("m_variables.csv")).expect("variables");
    let rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let of = |cells: &[&str]| [3, 4].map(|cell| cells[cell].parse().expect("a number"));
    rows.filter(|cells| cells[1] == "algebraic").map(|cells| (cells[0].to_owned(), of(&cells))).collect()
}

#[test]
fn quantities_that_share_a_table_are_shown_in_their_own_units() {
    let folder = Folder::new("functions_units");
    let count = 8;
    let (exit, errors, report) = compile(&folder, &named(count, false), &["--pes", "2"]);
    assert_eq!(exit, Some(0), "{errors}");
    let shared = |report: &Value| {
        report["functions"].as_array().map_or(0, |all| all.iter().filter(|of| of["shared_by"] != 0).count())
    };
    assert!(shared(&report) > 0, "{}", report["functions"]);
    let scaled = algebraics(&folder);
    // Outputs are what they are called, whatever the tables.
    let names: Vec<String> = (0..count).map(|own| format!("h{own}")).collect();
    let (exit, errors, report) = compile(&folder, &named(count, false), &["--pes", "2", "--observe", &names.join(",")]);
    assert_eq!(exit, Some(0), "{errors}");
    assert!(report["error"]["word_length"].as_f64().expect("an error") < 1e-6, "{}", report["error"]);
    let whole = algebraics(&folder);
    assert_eq!(scaled.len(), count);
    for ((name, [largest, limit]), (other, [should, _])) in scaled.iter().zip(&whole) {
        assert_eq!(name, other);
        assert!(
            (largest / should - 1.0).abs() < 1e-3 && limit >= largest,
            "{name}: {largest} of {limit}, not {should}"
        );
    }
}
