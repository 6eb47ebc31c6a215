//! The largest stable RK4 step that `check` predicts and finds, against runs of equations written down here again.
//!
//! A step is stable if no state leaves the range of the solution by more than the width of that range.

use std::path::Path;
use std::process::Command;

use crate::support::bench::Folder;
use serde_json::Value;

type Derivative = fn(&[f64], &mut [f64]);

struct Case {
    /// Name of a shipped model.
    spec: &'static str,
    span: f64,
    initial: Vec<f64>,
    derivative: Derivative,
    /// A step that is fine enough for the range of the solution.
    fine: f64,
    /// Codes that are right at 0.8 of the limit: stable, but half the step changes the result by more than 0.02, or more
    /// than 0.5. All others would be false alarms.
    right: &'static [&'static str],
}

fn step(f: Derivative, h: f64, y: &mut [f64]) {
    let n = y.len();
    let mut k = vec![vec![0.0; n]; 4];
    let mut at = y.to_vec();
    for stage in 0..4 {
        f(&at, &mut k[stage]);
        let reach = [0.5 * h, 0.5 * h, h, 0.0][stage];
        for i in 0..n {
            at[i] = y[i] + reach * k[stage][i];
        }
    }
    for i in 0..n {
        y[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
    }
}

impl Case {
    fn range(&self) -> Vec<(f64, f64)> {
        let mut y = self.initial.clone();
        let mut range: Vec<(f64, f64)> = y.iter().map(|y| (*y, *y)).collect();
        for _ in 0..(self.span / self.fine) as u64 {
            step(self.derivative, self.fine, &mut y);
            range.iter_mut().zip(&y).for_each(|(range, y)| *range = (range.0.min(*y), range.1.max(*y)));
        }
        range
    }

    fn stable(&self, h: f64, range: &[(f64, f64)]) -> bool {
        let mut y = self.initial.clone();
        (0..(self.span / h) as u64).all(|_| {
            step(self.derivative, h, &mut y);
            y.iter().zip(range).all(|(y, (low, high))| {
                let width = (high - low).max(1e-3 * high.abs());
                *y >= low - width && *y <= high + width
            })
        })
    }

    fn limit(&self) -> f64 {
        let range = self.range();
        let (mut inside, mut outside) = (self.fine, self.fine);
        while self.stable(outside, &range) {
            (inside, outside) = (outside, 1.3 * outside);
        }
        while outside / inside > 1.01 {
            let middle = (inside * outside).sqrt();
            if self.stable(middle, &range) { inside = middle } else { outside = middle }
        }
        inside
    }
}

fn cases() -> Vec<Case> {
    let robertson: Derivative = |y, d| {
        d[0] = -0.04 * y[0] + 1e4 * y[1] * y[2];
        d[2] = 3e7 * y[1] * y[1];
        d[1] = -d[0] - d[2];
    };
    let hires: Derivative = |y, d| {
        let bound = 280.0 * y[5] * y[7];
        d[0] = -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007;
        d[1] = 1.71 * y[0] - 8.75 * y[1];
        d[2] = -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4];
        d[3] = 8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3];
        d[4] = -1.745 * y[4] + 0.43 * (y[5] + y[6]);
        d[5] = -bound + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6];
        d[6] = bound - 1.81 * y[6];
        d[7] = -d[6];
    };
    let brusselator: Derivative = |y, d| {
        let c = 441.0 / 50.0;
        let at = |base: usize, i: isize, edge: f64| if (0..20).contains(&i) { y[base + i as usize] } else { edge };
        for i in 0..20isize {
            let (u, v) = (at(0, i, 1.0), at(20, i, 3.0));
            let around = |base, edge, own: f64| c * (at(base, i - 1, edge) - 2.0 * own + at(base, i + 1, edge));
            d[i as usize] = 1.0 + u * u * v - 4.0 * u + around(0, 1.0, u);
            d[20 + i as usize] = 3.0 * u - u * u * v + around(20, 3.0, v);
        }
    };
    let van_der_pol: Derivative = |y, d| {
        d[0] = y[1];
        d[1] = 10.0 * (1.0 - y[0] * y[0]) * y[1] - y[0];
    };
    let lorenz: Derivative = |y, d| {
        d[0] = 10.0 * (y[1] - y[0]);
        d[1] = y[0] * (28.0 - y[2]) - y[1];
        d[2] = y[0] * y[1] - 8.0 / 3.0 * y[2];
    };
    let motor: Derivative = |y, d| {
        let error = 1.0 - y[0];
        let u = 10.0 * error + 20.0 * y[3] + 250.0 * (error - y[4]);
        d[0] = y[1];
        d[1] = (0.05 * y[2] - 1e-5 * y[1]) / 1e-4;
        d[2] = (u - y[2] - 0.05 * y[1]) / 5e-3;
        d[3] = error;
        d[4] = 500.0 * (error - y[4]);
    };
    let decay: Derivative = |y, d| {
        let rate = |k: usize| if k < 6 { 10f64.powi(4 - k as i32) } else { 0.0 };
        for k in 0..7 {
            d[k] = if k > 0 { rate(k - 1) * y[k - 1] } else { 0.0 } - rate(k) * y[k];
        }
    };
    // Without its source, which moves slowly.
    let ladder: Derivative = |y, d| {
        let r = |i: usize| 1000.0 * (1.0 + 0.05 * (2.0 * i as f64).sin());
        let c = |i: usize| 1e-6 * (1.0 + 0.05 * (3.0 * i as f64).cos());
        for i in 1..=10usize {
            let before = if i == 1 { 0.0 } else { y[i - 2] };
            let out = if i == 10 { 0.0 } else { (y[i - 1] - y[i]) / r(i + 1) };
            d[i - 1] = ((before - y[i - 1]) / r(i) - out) / c(i);
        }
    };
    // Masses between walls, cubic springs to their places; x then v.
    let chain: Derivative = |y, d| {
        for k in 0..64 {
            let before = if k > 0 { y[k - 1] } else { 0.0 };
            let after = if k < 63 { y[k + 1] } else { 0.0 };
            d[k] = y[64 + k];
            d[64 + k] = before + after - 2.0 * y[k] - 0.1 * y[k] - 0.05 * y[k].powi(3);
        }
    };
    let brusselator_start = (1..=20).map(|i| 1.0 + (std::f64::consts::TAU * f64::from(i) / 21.0).sin());
    let chain_start = (1..=64).map(|k| (std::f64::consts::PI * f64::from(k) / 65.0).sin());
    let case =
        |spec, span, initial: Vec<f64>, derivative, fine| Case { spec, span, initial, derivative, fine, right: &[] };
    let imprecise = |case: Case| Case { right: &["W0903"], ..case };
    let useless = |case: Case| Case { right: &["E0903"], ..case };
    vec![
        case("validation/robertson", 40.0, vec![1.0, 0.0, 0.0], robertson, 4e-4),
        case("validation/hires", 321.8, vec![1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057], hires, 5e-3),
        case("validation/brusselator20", 10.0, brusselator_start.chain([3.0; 20]).collect(), brusselator, 1e-2),
        useless(case("validation/van_der_pol_10", 40.0, vec![2.0, 0.0], van_der_pol, 1e-3)),
        imprecise(case("lorenz/lorenz", 5.0, vec![1.0; 3], lorenz, 1e-3)),
        imprecise(case("validation/dc_motor", 2.0, vec![0.0; 5], motor, 5e-4)),
        imprecise(case("validation/decay_chain", 10.0, vec![1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], decay, 1e-4)),
        case("rc_ladder/rc_ladder", 0.4, (1..=10).map(|i| 0.1 * (1.0 - f64::from(i) / 20.0)).collect(), ladder, 1e-4),
        imprecise(case("spring_chain/spring_chain", 500.0, chain_start.chain([0.0; 64]).collect(), chain, 2e-2)),
    ]
}

fn check(folder: &Folder, case: &Case, options: &[String]) -> Value {
    let name = case.spec;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").join(format!("{name}.spec"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.current_dir(&folder.0).arg("check").arg(path).args(["--solver", "rk4", "--message-format", "json"]);
    let output = command.arg("--span").arg(case.span.to_string()).args(options).output().expect("pe-synth starts");
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(&text).unwrap_or_else(|_| panic!("{name}: {text}{}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn limits_are_near_the_true_ones_and_no_alarm_is_false_below_them() {
    let folder = Folder::new("check_limits");
    let (mut table, mut alarms) = (String::new(), Vec::new());
    for case in cases() {
        let truth = case.limit();
        let found = check(&folder, &case, &[]);
        let figure =
            |key: &str| found["stability"][key].as_f64().unwrap_or_else(|| panic!("{}: {key} {found}", case.spec));
        let (predicted, tried) = (figure("predicted_step_s"), figure("found_step_s"));
        table += &format!(
            "{:28} true {truth:.4e} predicted {predicted:.4e} ({:+.1} %) found {tried:.4e} ({:+.1} %)\n",
            case.spec,
            100.0 * (truth / predicted - 1.0),
            100.0 * (tried / truth - 1.0)
        );
        assert!((0.8..1.5).contains(&(truth / predicted)), "{table}");
        assert!((0.93..1.07).contains(&(tried / truth)), "{table}");
        // A whole number of steps over the span.
        let steps = (case.span / (0.8 * truth)).ceil();
        let below = check(&folder, &case, &["--step".to_owned(), format!("{}/{steps}", case.span)]);
        let codes = below["stability"]["codes"].as_array().expect("a list").iter().map(|code| code.as_str());
        let codes: Vec<&str> = codes.map(|code| code.expect("a code")).collect();
        if codes != case.right {
            alarms.push(format!("{}: {codes:?} in place of {:?}", case.spec, case.right));
        }
        // What is right is so by the runs.
        let method = below["error"]["method"].as_f64();
        assert_eq!(method.is_none_or(|error| error > 0.02), !case.right.is_empty(), "{}: {method:?}", case.spec);
        let above = check(&folder, &case, &["--step".to_owned(), format!("{:e}", 1.15 * truth)]);
        assert!(above["verdict"] != "fine", "{}: {above}", case.spec);
    }
    println!("{table}");
    assert!(alarms.is_empty(), "{alarms:?}\n{table}");
    assert_eq!(table.lines().count(), 9);
}
