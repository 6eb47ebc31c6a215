//! Functions that round, in the hardware.

use std::process::Command;

use crate::support::bench::Folder;

fn run(folder: &Folder, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.current_dir(&folder.0).args(arguments).output().expect("pe-synth starts");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// `mod` of the language.
fn modulo(a: f64, b: f64) -> f64 {
    a - b * (a / b).floor()
}

#[test]
fn rounded_numbers_are_those_of_the_argument_that_the_hardware_has() {
    let folder = Folder::new("rounding");
    let text = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nstate t = -4.3\nt' = 9\nf = floor(3*t)\nc = ceil(t)\nr = round(t)\n\
        q = quotient(t, 0.7)\nm = mod(t, 0.7)\nstate s = 0\ns' = floor(t) - s\noutput t, f, c, r, q, m, s\n";
    std::fs::write(folder.0.join("m.spec"), text).expect("the spec can be written");
    let rows = run(&folder, &["sim", "m.spec", "--pes", "2"]);
    let mut compared = 0;
    for row in rows.lines().skip(2) {
        let numbers: Vec<f64> = row.split(',').skip(1).map(|cell| cell.parse().expect("a number")).collect();
        let t = numbers[0];
        // Beside a jump the port shows fewer bits than the network has.
        if [3.0 * t, t + 0.5, t / 0.7, t].iter().any(|jumps| (jumps - jumps.round()).abs() < 1e-6) {
            continue;
        }
        let wanted = [(3.0 * t).floor(), t.ceil(), t.round(), (t / 0.7).trunc(), modulo(t, 0.7)];
        for (number, wanted) in numbers[1..].iter().zip(wanted) {
            assert!((number - wanted).abs() < 1e-6, "{row}: {number} is not {wanted}");
        }
        compared += 1;
    }
    assert!(compared > 900, "{compared}");
    run(&folder, &["compile", "m.spec", "-o", "out", "--pes", "2", "--no-pictures"]);
    let said = run(&folder, &["verify", "out", "--engines", "ghdl,fast", "--allow-changed"]);
    assert!(said.contains("equal"), "{said}");
}

#[test]
fn whole_numbers_of_sampled_blocks_are_rounded_to_themselves() {
    let folder = Folder::new("rounding_whole");
    let text = "model m\nsolver euler\nstep 1 ms\nspan 100 ms\nevery 1 ms {\nstate n = -20\nnext n = n + 1\n}\n\
        f = floor(n)\nc = ceil(n)\nr = round(n)\nh = floor(n/2)\noutput n, f, c, r, h\n";
    std::fs::write(folder.0.join("m.spec"), text).expect("the spec can be written");
    let rows = run(&folder, &["sim", "m.spec", "--pes", "1"]);
    for row in rows.lines().skip(1) {
        let numbers: Vec<f64> = row.split(',').skip(1).map(|cell| cell.parse().expect("a number")).collect();
        assert!(numbers[1..4].iter().all(|number| *number == numbers[0]), "{row}");
        assert!(numbers[4] == (numbers[0] / 2.0).floor(), "{row}");
    }
}
