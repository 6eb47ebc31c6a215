//! Closures that cannot all hold: where a mechanism starts, and where those that move by themselves come to it on the way.

use std::fs;
use std::process::Command;

use crate::support::bench::Folder;
use pe_frontend::{NoFiles, Overrides};
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Sources};
use pe_judge::check::contradiction;

fn compiled(text: &str) -> Result<Model, Vec<Diagnostic>> {
    let mut sources = Sources::new("contradictions.spec", text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    compiled.map(|(model, _)| pe_hls::lift::lift(model))
}

fn next(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 33) as f64 / f64::from(1u32 << 31)
}

/// A crank of a length that turns at a speed, and coupler and rocker that follow it, between pivots that are `d` apart.
struct Driven {
    a: f64,
    l: [f64; 2],
    d: f64,
    start: f64,
    speed: f64,
}

impl Driven {
    /// How far the crank's end is from the rocker's pivot.
    fn reach(&self, time: f64) -> f64 {
        let angle = self.start + self.speed * time;
        libm::hypot(self.d - self.a * libm::cos(angle), self.a * libm::sin(angle))
    }

    fn closes(&self, time: f64) -> bool {
        ((self.l[0] - self.l[1]).abs()..=self.l[0] + self.l[1]).contains(&self.reach(time))
    }

    /// When loops cannot be closed any more; none if they can for the span.
    fn locks(&self, span: f64) -> Option<f64> {
        (0..20_000).map(|part| span * f64::from(part) / 20_000.0).find(|time| !self.closes(*time))
    }

    fn spec(&self, sort: &str, solver: &str, penalty: f64) -> String {
        let Driven { a, l, d, start, speed } = self;
        let (x, y) = (d - a * libm::cos(*start), -a * libm::sin(*start));
        let reach = libm::hypot(x, y);
        let coupler =
            libm::atan2(y, x) + libm::acos((reach * reach + l[0] * l[0] - l[1] * l[1]) / (2.0 * reach * l[0]));
        let rocker = libm::atan2(l[0] * libm::sin(coupler) - y, l[0] * libm::cos(coupler) - x);
        let turned = libm::sin(coupler - rocker);
        let speeds = [
            a * speed * libm::sin(rocker - start) / (l[0] * turned),
            a * speed * libm::sin(coupler - start) / (l[1] * turned),
        ];
        format!(
            "model driven\nsolver {solver}\nstep 1 ms\nspan 2 s\nindex i in 1..2, j in 1..2, r in 1..2\nparam a = {a}\nparam l[i] = {l:?}\n\
             param d = {d}\nparam v = {speed}\nparam e[i] = [1, -1]\n{sort} q[i] = [{coupler}, {rocker}]\nstate w[i] = {speeds:?}\n\
             x = a*cos({start} + v*time)\ny = a*sin({start} + v*time)\ns[i] = sin(q[i])\nc[i] = cos(q[i])\nmatrix M[i, j] symmetric\n\
             matrix J[r, i]\nM[i, i] = 1\nf[i] = -2*c[i] - 0.5*w[i]\nJ[r, i] = e[i]*l[i]*(if r == 1 then -s[i] else c[i])\n\
             gap[r] = sum(i: e[i]*l[i]*(if r == 1 then c[i] else s[i])) + (if r == 1 then x - d else y)\n\
             drift[r] = v*(if r == 1 then -y else x)\n\
             bend[r] = sum(i: e[i]*l[i]*(if r == 1 then -c[i] else -s[i])*w[i]^2) - v^2*(if r == 1 then x else y)\nq' = w\n\
             w' = constrained(M, f, J, gap, bend, {penalty}, 100, drift)\noutput q, w\n"
        )
    }
}

#[test]
fn linkages_that_a_crank_locks_are_found_and_no_others() {
    let mut seed = 17;
    let (mut locked, mut free) = (0, 0);
    for case in 0..60 {
        let mut length = || 0.4 + next(&mut seed);
        let (a, l, d) = (length(), [length(), length()], length());
        let driven = Driven { a, l, d, start: 6.0 * next(&mut seed), speed: 1.0 + 5.0 * next(&mut seed) };
        let (low, high) = ((l[0] - l[1]).abs(), l[0] + l[1]);
        let reach = driven.reach(0.0);
        // From positions that are not nearly singular.
        if reach < low + 0.1 || reach > high - 0.1 {
            continue;
        }
        let lock = driven.locks(2.0);
        let (sort, solver) = (["state", "angle"][case % 2], ["trapezoidal", "rk4"][case / 2 % 2]);
        // A penalty that is too small is no contradiction.
        let penalty = [400.0, 1e4, 2.0][case % 3];
        let model = compiled(&driven.spec(sort, solver, penalty)).unwrap_or_else(|found| panic!("{found:?}"));
        let found = contradiction(&model);
        println!("{case} {sort} {solver} {penalty}: {lock:?} {:?}", found.as_ref().map(|found| &found.message));
        match (lock, found) {
            (None, None) => free += 1,
            (None, Some(found)) => panic!("{found:?}\n{}", driven.spec(sort, solver, penalty)),
            // Between two looks, or by less than positions are looked for.
            (Some(_), None) => {
                let most = (0..2000).map(|step| driven.reach(f64::from(step) * 1e-3));
                let over = most.map(|reach| (reach - high).max(low - reach)).fold(0.0, f64::max);
                assert!(over < 1e-4, "{over}\n{}", driven.spec(sort, solver, penalty));
            }
            (Some(time), Some(found)) => {
                locked += 1;
                let told: f64 = found
                    .message
                    .split("t = ")
                    .nth(1)
                    .and_then(|rest| rest.split(' ').next())
                    .unwrap()
                    .parse()
                    .unwrap();
                assert!(told > time - 2e-3 && told < time + 5e-3, "{time}: {}", found.message);
                assert!(found.help.is_some_and(|help| help.contains("(tried)")), "{}", found.message);
            }
        }
    }
    println!("{locked} lock, {free} do not");
    assert!(locked >= 10 && free >= 10, "{locked} {free}");
}

/// A mass on a rod with a second closure.
fn beside(more: &str) -> String {
    format!(
        "model beside\nsolver trapezoidal\nstep 1 ms\nspan 0.5 s\nindex i in 1..2, j in 1..2, r in 1..2\nstate q[i] = [1, 0]\nstate w[i] = 0\n\
         matrix M[i, j] symmetric\nmatrix J[r, i]\nM[i, i] = 1\nf[i] = if i == 2 then -9.81 else 0\nJ[1, i] = q[i]\n\
         gap[1] = (q[1]^2 + q[2]^2 - 1)/2\nbend[1] = w[1]^2 + w[2]^2\n{more}q' = w\n\
         w' = constrained(M, f, J, gap, bend, 400, 100)\noutput q, w\n"
    )
}

#[test]
fn closures_that_cannot_all_hold_where_it_starts_are_told_with_one_to_leave_out() {
    let circle =
        |square: f64| format!("gap[2] = (q[1]^2 + q[2]^2 - {square})/2\nbend[2] = w[1]^2 + w[2]^2\nJ[2, i] = q[i]\n");
    let line = |height: f64| format!("gap[2] = q[2] - {height}\nbend[2] = 0\nJ[2, 2] = 1\n");
    let first = |more: &str| compiled(&beside(more)).map_or_else(|found| found.into_iter().next(), |_| None);
    for more in [circle(1.21), circle(1.002), line(1.3), line(-2.0)] {
        let found = first(&more).unwrap_or_else(|| panic!("{more}"));
        let help = found.help.clone().unwrap_or_default();
        assert_eq!(found.code, "E0928", "{found:?}");
        assert!(found.message.contains("`gap[1]`") && found.message.contains("`gap[2]`"), "{found:?}");
        assert!(help.contains("leave out closure `gap[2]`") && help.contains("(tried)"), "{found:?}");
    }
    // The same circle twice, or a point on it far away, are no contradictions.
    assert!(first(&circle(1.0)).is_none());
    let found = first(&line(0.9)).expect("it is refused");
    let help = found.help.clone().unwrap_or_default();
    assert!(found.code == "E0417" && help.contains("closed at q[1] = "), "{found:?}");
    let place = help.split("closed at ").nth(1).unwrap();
    let number = |name: &str| -> f64 {
        let rest = place.split(&format!("{name} = ")).nth(1).unwrap();
        rest.split(", ").next().unwrap().parse().unwrap()
    };
    assert!((number("q[2]") - 0.9).abs() < 1e-5 && (libm::hypot(number("q[1]"), 0.9) - 1.0).abs() < 1e-5, "{help}");
}

#[test]
fn every_command_tells_of_a_crank_that_its_linkage_does_not_let_past() {
    let folder = Folder::new("contradictions");
    let driven = Driven { a: 0.9, l: [1.2, 0.9], d: 1.0, start: 1.0, speed: 3.0 };
    let lock = driven.locks(2.0).expect("it locks");
    for solver in ["trapezoidal", "rk4"] {
        fs::write(folder.0.join("driven.spec"), driven.spec("angle", solver, 1e4)).unwrap();
        for command in
            [&["check", "driven.spec"][..], &["compile", "driven.spec", "--pes", "2", "--no-pictures", "-o", "out"]]
        {
            let words = [command, &["--multiplier", "35x35", "--storage", "40", "--quiet"]].concat();
            let output =
                Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(words).current_dir(&folder.0).output().unwrap();
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{solver} {command:?}: {told}");
            assert!(
                told.contains("E0928") && told.contains("driven.spec:26:1") && told.contains("leave out `gap["),
                "{solver}: {told}"
            );
            let time: f64 = told.split("t = ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap().parse().unwrap();
            assert!(time > lock - 2e-3 && time < lock + 5e-3, "{lock}: {told}");
        }
    }
}
