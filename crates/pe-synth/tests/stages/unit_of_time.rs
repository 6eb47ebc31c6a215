//! Models that count in other units than seconds, outputs that stand still, and the row of time zero.

use std::process::Command;

use crate::support::bench::Folder;
use serde_json::Value;

fn run(folder: &Folder, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.current_dir(&folder.0).args(arguments).output().expect("pe-synth starts");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn write(folder: &Folder, name: &str, text: &str) {
    std::fs::write(folder.0.join(name), text).expect("the spec can be written");
}

/// A cell that is driven in all ways that time comes in; rates, times and frequencies as given.
fn cell(head: &str, rate: f64, time: f64) -> String {
    format!(
        "model cell\nsolver rk4\n{head}param tau = {}\ninput i = {}*pulse(1, {}, {})\nstate v = 1\nstate w = 0.1\n\
         v' = -v/tau + i + {}*sine(1, {})\nw' = {}*w*(1 - w) + {}*v + {}*(if {}*time > 30 then 1 else 0)\n\
         output v, w\n",
        5.0 * time,
        rate,
        10.0 * time,
        20.0 * time,
        0.5 * rate,
        0.05 * rate,
        0.3 * rate,
        0.001 * rate,
        0.01 * rate,
        1.0 / time,
    )
}

#[test]
fn a_model_has_the_same_solution_and_cost_in_any_unit() {
    let folder = Folder::new("unit_of_time");
    write(&folder, "ms.spec", &cell("step 0.05\nspan 100\ntime [ms]\n", 1.0, 1.0));
    write(&folder, "s.spec", &cell("step 50 us\nspan 100 ms\n", 1e3, 1e-3));
    for (options, apart) in [(&["--double"][..], 1e-12), (&["--pes", "2"], 2e-8)] {
        let rows = ["ms.spec", "s.spec"].map(|spec| run(&folder, &[&["sim", spec], options].concat()));
        let numbers =
            |rows: &str| -> Vec<f64> { rows.split(['\n', ',']).filter_map(|cell| cell.parse().ok()).collect() };
        let [one, other] = rows.each_ref().map(|rows| numbers(rows));
        assert!(one.len() == 3 * 2001 && one.len() == other.len(), "{options:?}");
        assert!(one.iter().zip(&other).all(|(one, other)| (one - other).abs() < apart), "{options:?}");
    }
    let reports = ["ms", "s"].map(|name| {
        run(&folder, &["compile", &format!("{name}.spec"), "--pes", "2", "-o", name]);
        let text = std::fs::read_to_string(folder.0.join(name).join("report.json")).expect("a report");
        serde_json::from_str::<Value>(&text).expect("JSON")
    });
    for key in ["cycles_per_step", "time_per_simulated_second_ms", "step_s", "span_s", "macs_per_step"] {
        assert_eq!(reports[0][key], reports[1][key], "{key}");
    }
}

#[test]
fn what_stands_still_is_shown_from_time_zero_on() {
    let folder = Folder::new("still_outputs");
    let head = "model m\nsolver rk4\nstep 1 ms\nspan 20 ms\n";
    let body = "const n = 2\nparam k[i in 1..2] = 1.5*i\ninput u = 0.25 + time\nfixed = n*k[2]\ndoubled = 2*u\n";
    let still = format!("{head}{body}output n, k, fixed, doubled, time\n");
    let moving = format!("{head}{body}state x = 0.5\nx' = -k[1]*x\nsquare = x^2\noutput fixed, k[1], square, x\n");
    for (text, first) in [(&still, "0e0,2e0,1.5e0,3e0,6e0,5e-1,0e0"), (&moving, "0e0,6e0,1.5e0,2.5e-1,5e-1")] {
        write(&folder, "m.spec", text);
        for options in [&[][..], &["--double"]] {
            let rows = run(&folder, &[&["sim", "m.spec"], options].concat());
            assert_eq!(rows.lines().nth(1), Some(first), "{options:?}");
            assert_eq!(rows.lines().count(), 22, "{options:?}");
        }
        run(&folder, &["compile", "m.spec", "-o", "out", "--no-pictures"]);
        let said = run(&folder, &["verify", "out", "--engines", "ghdl,fast", "--allow-changed"]);
        assert!(said.contains("equal"), "{said}");
        std::fs::remove_dir_all(folder.0.join("out")).expect("it was written");
    }
}
