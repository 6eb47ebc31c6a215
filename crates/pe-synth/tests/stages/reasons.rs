//! Reasons that are right: what runs is right, and what is refused is refused for what it is.

use std::process::Command;

use crate::support::bench::Folder;
use serde_json::Value;

/// Runs a command on statements after a head; gives exit code, messages and the report of a compilation.
fn run(folder: &Folder, command: &str, head: &str, statements: &str, options: &[&str]) -> (Option<i32>, String, Value) {
    let (file, target) = (folder.0.join("m.spec"), folder.0.join("out"));
    let _ = std::fs::remove_dir_all(&target);
    std::fs::write(&file, format!("model m\n{head}\n{statements}")).expect("the spec can be written");
    let mut process = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    process.arg(command).arg(&file).args(options);
    if command == "compile" {
        process.arg("-o").arg(&target).args(["-q", "--no-pictures", "--tries", "20"]);
    }
    let output = process.output().expect("pe-synth starts");
    let report = std::fs::read_to_string(target.join("report.json")).unwrap_or_else(|_| "null".to_owned());
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), errors, serde_json::from_str(&report).expect("JSON"))
}

/// The last words of the outputs of a run, as numbers.
fn end_of(folder: &Folder, options: &[&str]) -> Vec<f64> {
    let table = folder.0.join("s.csv");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("sim").arg(folder.0.join("m.spec")).arg("-o").arg(&table).args(["--pes", "1"]).args(options);
    assert!(command.output().expect("pe-synth starts").status.success());
    let rows = std::fs::read_to_string(&table).expect("a table");
    let last = rows.lines().last().expect("a row").to_owned();
    last.split(',').skip(1).map(|cell| cell.parse().expect("a number")).collect()
}

#[test]
fn what_one_table_does_not_hold_runs_and_is_right() {
    let folder = Folder::new("reasons_parts");
    // Heads, statements, the end in closed form, and how far it may be off.
    for (head, statements, end, error) in [
        ("solver rk4\nstep 1 ms\nspan 1500 ms", "state y = 1\ny' = -2*sqrt(max(y, 0))\noutput y\n", 0.0, 1e-4),
        ("solver rk4\nstep 1 ms\nspan 800 ms", "state y = 1\ny' = -2*sqrt(max(y, 0))\noutput y\n", 0.04, 1e-4),
        (
            "solver rk4\nstep 500 us\nspan 91 s",
            "state t = 0\nt' = 1\nstate y = 0\ny' = exp(-((t - 90.005)/0.001)^2)\noutput y\n",
            1.7724538509e-3,
            1e-6,
        ),
        (
            "solver rk4\nstep 1 ms\nspan 1 s",
            "state x = 1\nx' = 16*x\nstate y = 0\ny' = 1/x\noutput y\n",
            (1.0 - 1.1253517e-7) / 16.0,
            3e-3 / 16.0,
        ),
    ] {
        let (exit, errors, report) = run(&folder, "compile", head, statements, &[]);
        assert_eq!(exit, Some(0), "{statements}{errors}");
        let found = end_of(&folder, &[]);
        assert!((found.last().expect("an output") - end).abs() < error, "{statements}: {found:?}, not {end}");
        assert!(report["error"]["function"].as_f64().is_some_and(|error| error < 1e-3), "{}", report["error"]);
    }
}

/// Head, statements, exit code, what messages have, and what they must not have.
type Named<'a> = (&'a str, &'a str, i32, &'a [&'a str], &'a [&'a str]);

#[test]
fn refusals_and_warnings_name_what_is_the_matter() {
    let folder = Folder::new("reasons_named");
    let lorenz =
        "state x = 1\nstate y = 1\nstate z = 1\nx' = 10*(y - x)\ny' = x*(28 - z) - y\nz' = x*y - 8/3*z\noutput x\n";
    let at_rest = "state y = 1\ny' = -1000*(y - 1)\noutput y\n";
    let nearly = "state y = 0.3\ny' = -1000*(y - 0.3)\noutput y\n";
    let growing = "state x = 0.1\nx' = 0.5*x^2\noutput x\n";
    let cases: [Named; 20] = [
        (
            "solver rk4\nstep 1 ms\nspan 1 s",
            "state t = 0\nt' = 1\nstate y = 0\ny' = 1/(t - 0.3)\noutput y\n",
            1,
            &["E0904", "t = "],
            &["E0916"],
        ),
        (
            "solver rk4\nstep 1 ms\nspan 1 s",
            "state t = 0\nt' = 1\nstate y = 0\ny' = sin(1e5*t)\noutput y\n",
            1,
            &["E0916"],
            &["E0904"],
        ),
        ("solver rk4\nstep 1 ms\nspan 1 s", "state x = 5e-324\nx' = -x\noutput x\n", 1, &["E0917", "`x`"], &["E0907"]),
        (
            "solver rk4\nstep 1 ms\nspan 2 s",
            "state x = 1\nx' = x^2\noutput x\n",
            1,
            &["E0906", "`x`", "t = 1.0"],
            &["chaotic", "E0903"],
        ),
        ("solver euler\nstep 10 ms\nspan 1010 ms", "state x = 1\nx' = x^2\noutput x\n", 1, &["E0906"], &["chaotic"]),
        ("solver rk4\nstep 7 ms\nspan 1.5 s", "state x = 1\nx' = x^2\noutput x\n", 1, &["E0906"], &["chaotic"]),
        (
            "solver rk4\nstep 1 ms\nspan 3 s",
            "state x = 1\nx' = x*sqrt(x)\noutput x\n",
            1,
            &["E0906", "t = 2.0"],
            &["chaotic"],
        ),
        ("solver heun\nstep 5 ms\nspan 20 s", "state x = 1\nx' = exp(x) - 2\noutput x\n", 1, &["E0906"], &["chaotic"]),
        (
            "solver rk4\nstep 1 ms\nspan 2 s",
            "state x = 1\nstate w = 1\nstate y = 0\nx' = -1\nw' = -1\ny' = x/w - y\noutput y\n",
            1,
            &["E0918", "`x`", "t = "],
            &["E0904"],
        ),
        (
            "solver rk4\nstep 1 ms\nspan 2 s",
            "state x = 0\nstate y = 0\nx' = 1\ny' = sin(x)/x\noutput y\n",
            0,
            &["W0926", "t = 0.0"],
            &["error"],
        ),
        (
            "solver rk4\nstep 1 ms\nspan 2 s",
            "state x = 1\nx' = if x > 0 then -1 else 1\noutput x\n",
            0,
            &["W0925", "t = "],
            &["error"],
        ),
        (
            "solver euler\nstep 1 ms\nspan 2 s",
            "state x = 1\nx' = -sign(x)\noutput x\n",
            0,
            &["W0925", "t = "],
            &["error"],
        ),
        (
            "solver rk4\nstep 1 ms\nspan 2 s",
            "state x = 1\nstate v = 0\nx' = v\nv' = -40*x\nstate y = 0\ny' = sign(x)\noutput y\n",
            0,
            &[],
            &["W0925"],
        ),
        ("solver rk4\nstep 1 ms\nspan 120 s", lorenz, 0, &["W0909", "standard deviation"], &["error", "E0903"]),
        ("solver euler\nstep 2.5 ms\nspan 2 s", at_rest, 0, &["W0906", "unstable", "`y`"], &["error"]),
        (
            "solver euler\nstep 2.5 ms\nspan 2 s",
            nearly,
            1,
            &["E0903", "unstable", "`y`"],
            &["E0907", "E0902", "chaotic"],
        ),
        ("solver rk4\nstep 3 ms\nspan 3 s", nearly, 1, &["E0903", "unstable", "`y`"], &["E0907", "E0902", "chaotic"]),
        ("solver implicit_euler\nstep 1 s\nspan 18 s", growing, 1, &["E0905", "`x`", "t = "], &["E0904"]),
        (
            "solver implicit_euler\nstep 9.99 ms\nspan 99.9 ms",
            "state x = 1\nx' = 100*x\noutput x\n",
            1,
            &["E0905", "`x`", "in every step"],
            &["E0903", "E0904"],
        ),
        ("solver implicit_euler\nstep 1 s\nspan 30 s", growing, 1, &["E0906", "`x`", "t = 2.0"], &["E0904", "chaotic"]),
    ];
    let mut failures = Vec::new();
    for (head, statements, code, parts, others) in cases {
        for command in ["check", "compile"] {
            let (exit, errors, _) = run(&folder, command, head, statements, &[]);
            let right = exit == Some(code)
                && parts.iter().all(|part| errors.contains(part))
                && !others.iter().any(|other| errors.contains(other));
            failures.extend((!right).then(|| format!("{command} {head}\n{statements}{exit:?}\n{errors}")));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n---\n"));
}

#[test]
fn quotients_with_few_bits_are_named_where_the_word_is_too_short() {
    let folder = Folder::new("reasons_quotients");
    let statements = "state c = 1\nstate s = 0\nstate w = 1\nstate y = 0\nd = 5000 + 4999.9*c*w\nn = 5000.1 + 4999.8*c*w\n\
                      c' = -s\ns' = c\nw' = 1e-6*s\ny' = 5*(n/d - y)\noutput y\n";
    let head = "solver rk4\nstep 1 ms\nspan 7 s";
    let (exit, errors, _) = run(&folder, "check", head, statements, &["--multiplier", "25x16"]);
    let told = ["W0927", "`1/d` loses 18 of 25 bits", "t = 6.28", "a table of its own keeps 8 bits", "E0907"];
    assert!(exit == Some(1) && told.iter().all(|part| errors.contains(part)), "{errors}");
    // As many are lost of a word that has enough of them.
    let (exit, errors, _) = run(&folder, "check", head, statements, &["--multiplier", "32x32"]);
    assert!(exit == Some(0) && !errors.contains("W0927"), "{errors}");
}

#[test]
fn a_constant_divisor_of_zero_is_refused_for_it() {
    let folder = Folder::new("reasons_constant");
    let statements = "state x = 1\nd = 1 - 1\ne = 1/(d*2)\nx' = e - x\noutput x\n";
    let (exit, errors, _) = run(&folder, "check", "solver rk4\nstep 1 ms\nspan 10 ms", statements, &[]);
    assert!(exit == Some(1) && errors.contains("E0904") && errors.contains("`e`"), "{errors}");
}

/// A seeded stream of numbers from 0 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// One RK4 step of `y' = a*y + b - c*y^3`, row by row.
fn rk4(a: &[Vec<f64>], b: &[f64], c: f64, h: f64, y: &mut [f64]) {
    let slope = |y: &[f64]| -> Vec<f64> {
        let row = |i: usize| a[i].iter().zip(y).map(|(a, y)| a * y).sum::<f64>() + b[i] - c * y[i] * y[i] * y[i];
        (0..y.len()).map(row).collect()
    };
    let moved = |y: &[f64], k: &[f64], by: f64| -> Vec<f64> { y.iter().zip(k).map(|(y, k)| y + by * k).collect() };
    let k1 = slope(y);
    let k2 = slope(&moved(y, &k1, h / 2.0));
    let k3 = slope(&moved(y, &k2, h / 2.0));
    let k4 = slope(&moved(y, &k3, h));
    for i in 0..y.len() {
        y[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
    }
}

#[test]
fn no_step_at_four_fifths_of_the_true_limit_is_called_unstable() {
    let folder = Folder::new("reasons_limits");
    let mut alarms = Vec::new();
    for seed in 0..14u64 {
        let mut random = Random(seed * 7919 + 1);
        let (states, cubic) = (2 + seed as usize % 4, if seed % 2 == 0 { 0.0 } else { 0.5 });
        // Damped, coupled, with rates over three decades.
        let rate: Vec<f64> = (0..states).map(|_| 10f64.powf(3.0 * random.next())).collect();
        let entry = |i: usize, j: usize, number: f64| if i == j { -rate[i] } else { 0.4 * (number - 0.5) * rate[i] };
        let a: Vec<Vec<f64>> = (0..states).map(|i| (0..states).map(|j| entry(i, j, random.next())).collect()).collect();
        let b: Vec<f64> = (0..states).map(|i| rate[i] * (0.5 + random.next())).collect();
        let start: Vec<f64> = (0..states).map(|_| 2.0 * random.next() - 1.0).collect();
        let slowest = rate.iter().copied().fold(f64::INFINITY, f64::min);
        let span = 12.0 / slowest;
        let stable = |h: f64| {
            let mut y = start.clone();
            (0..(span / h).ceil() as u64).all(|_| {
                rk4(&a, &b, cubic, h, &mut y);
                y.iter().all(|y| y.abs() < 50.0)
            })
        };
        let (mut inside, mut outside) = (1e-5 * span, span);
        while outside / inside > 1.005 {
            let middle = (inside * outside).sqrt();
            if stable(middle) { inside = middle } else { outside = middle }
        }
        let mut text = String::new();
        for i in 0..states {
            let row: Vec<String> = (0..states).map(|j| format!("({:e})*y{j}", a[i][j])).collect();
            text +=
                &format!("state y{i} = {:e}\ny{i}' = {} + {:e} - {cubic}*y{i}^3\n", start[i], row.join(" + "), b[i]);
        }
        text += "output y0\n";
        let head = format!("solver rk4\nstep {:e} s\nspan {span:e} s", 0.8 * inside);
        for command in ["check", "compile"] {
            let (_, errors, _) = run(&folder, command, &head, &text, &["--allow", "E0903"]);
            let false_alarm = ["unstable", "E0901", "E0902", "E0906", "E0907"].iter().any(|part| errors.contains(part));
            alarms.extend(false_alarm.then(|| format!("{head}\n{text}{errors}")));
        }
    }
    assert!(alarms.is_empty(), "{} alarms\n{}", alarms.len(), alarms.join("\n"));
}
