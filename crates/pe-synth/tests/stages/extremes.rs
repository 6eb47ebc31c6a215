//! Specs at the edge of what a file, a number or a machine can hold: a verdict, quickly, and nothing left behind.

use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::support::bench::Folder;

/// No verdict may take longer, start of the program included, on a busy machine.
const LONGEST: Duration = Duration::from_secs(10);

/// A spec with these statements after the usual head.
fn spec(statements: &str) -> Vec<u8> {
    format!("model m\nsolver rk4\nstep 1 ms\nspan 100 ms\n{statements}").into_bytes()
}

/// Compiles a text; gives exit code, messages and whether a design was written.
fn verdict(folder: &Folder, text: &[u8]) -> (Option<i32>, String, bool) {
    let (file, target) = (folder.0.join("m.spec"), folder.0.join("out"));
    let _ = fs::remove_dir_all(&target);
    fs::write(&file, text).expect("the spec can be written");
    let begin = Instant::now();
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.arg("compile").arg(&file).arg("-o").arg(&target).arg("-q").output().expect("pe-synth starts");
    assert!(begin.elapsed() < LONGEST, "{:?}", begin.elapsed());
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!errors.contains("panicked") && errors.len() < 100_000, "{errors:.1000}");
    (output.status.code(), errors, target.exists())
}

#[test]
fn what_is_no_spec_is_refused_with_its_code() {
    let folder = Folder::new("extremes_refused");
    let nested = spec(&format!("state x = {}1{}\nx' = -x\noutput x\n", "(".repeat(1_000_000), ")".repeat(1_000_000)));
    let garbage: Vec<u8> = (0u32..50_000_000).map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let garbled: Vec<u8> =
        garbage.iter().take(10 << 20).map(|byte| if byte % 61 == 0 { b'\n' } else { 33 + byte % 90 }).collect();
    for (text, code) in [
        (Vec::new(), "E0301"),
        (b"\n\n// nothing\n".to_vec(), "E0301"),
        (vec![0; 1000], "E0102"),
        (vec![0xff, 0xfe, b'm', 0], "E0109"),
        (garbage, "E0105"),
        (garbled, "E0108"),
        (nested, "E0104"),
        (spec("index i in 1..10000000\nstate x[i] = 0\nx[i]' = -x[i]\noutput x[1]\n"), "E0601"),
        (spec("state x = NaN\nx' = -x\noutput x\n"), "E0201"),
        (spec("state x = 1e308*10\nx' = -x\noutput x\n"), "E0503"),
        (spec("state x = 1e309\nx' = -x\noutput x\n"), "E0107"),
        (spec("state x = 1e300\nx' = -1e300*x\noutput x\n"), "E0901"),
    ] {
        let (exit, errors, written) = verdict(&folder, &text);
        assert_eq!((exit, written), (Some(1), false), "{code}: {errors:.1000}");
        assert!(errors.contains(&format!("error[{code}]")), "no {code} in {errors:.1000}");
    }
}

#[test]
fn numbers_at_the_ends_of_double_precision_compile() {
    let folder = Folder::new("extremes_accepted");
    for statements in [
        "state x = 1e-310\nx' = -1e-320*x\noutput x\n",
        "state x = 1e300\nx' = -x\noutput x\n",
        "state x = 1e-300\nx' = -x\noutput x\n",
        "state x = 0\nx' = 0\noutput x\n",
        "input u = sine(1e300, 10 Hz)\nstate x = 1\nx' = u - x\noutput x\n",
        "state x = 0 in 0 .. 1e-320\nx' = -x\noutput x\n",
    ] {
        let (exit, errors, written) = verdict(&folder, &spec(statements));
        assert_eq!((exit, written), (Some(0), true), "{statements}: {errors:.1000}");
        let report = fs::read_to_string(folder.0.join("out/report.json")).expect("there is a report");
        assert!(!report.contains("NaN") && !report.contains("\"word_length\": null"), "{report}");
    }
}

/// Beside states that move, in every form of a step: what is added to `s` are products with zero alone.
#[test]
fn a_state_that_never_moves_has_a_format_with_every_method() {
    let folder = Folder::new("extremes_rest");
    for solver in ["euler", "heun", "heun3", "rk4", "ab2", "ab3", "ab4", "rkc5", "implicit_euler", "ros2", "rodas3"] {
        for rate in ["k*time", "k*a*b", "k*(a - s)", "0"] {
            let text = spec(&format!(
                "param k = 0\nstate a = 2\nstate b = 2\nstate s = 0\na' = -a*b*time\nb' = -a*b*time\ns' = {rate}\n\
                 output a, b, s\n"
            ));
            let text = String::from_utf8(text).expect("it is text").replace("solver rk4", &format!("solver {solver}"));
            let (exit, errors, written) = verdict(&folder, text.as_bytes());
            assert_eq!((exit, written), (Some(0), true), "{solver}, {rate}: {errors:.1000}");
        }
    }
}

#[test]
fn what_has_no_value_is_refused_with_expression_state_and_time() {
    let folder = Folder::new("extremes_domains");
    // The domain ends at t = 50 ms, on a step or shortly behind it.
    for (start, slope) in [("1", "-20"), ("1.0007", "-20.014")] {
        for expression in ["1/z", "1/z^2", "x/z", "3/(2*z)", "z^-1.5", "log(z)", "sqrt(z)", "z^0.3", "asin(1 - z)"] {
            let text = format!("state z = {start}\nstate x = 0\nz' = {slope}\nx' = {expression}\noutput x\n");
            let (exit, errors, written) = verdict(&folder, &spec(&text));
            assert_eq!((exit, written), (Some(1), false), "{text}: {errors:.1000}");
            assert!(errors.contains("error[E0904]") && errors.contains('z'), "{text}: {errors:.1000}");
            let time = errors.split("t = ").nth(1).and_then(|rest| rest.split(' ').next()?.parse::<f64>().ok());
            assert!(time.is_some_and(|time| (time - 0.05).abs() < 2e-3), "{text}: {errors:.1000}");
        }
    }
}
