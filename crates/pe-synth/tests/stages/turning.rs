//! Mechanisms whose coordinates are angles, stepped implicitly: they move as those do whose coordinates count their turns, and as
//! exact solutions do, however many turns they make.

use std::fs;
use std::process::Command;

use crate::support::bench::{Folder, assert_lively_agreement};
use crate::support::models::compile_file;
use crate::systems::exact_angle;
use pe_frontend::{NoFiles, Overrides};
use pe_hls::formats;
use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Sources;
use pe_ir::turns::{self, RADIANS};
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::reference;
use pe_verify::engines::Engine;

fn compiled(text: &str) -> Model {
    let mut sources = Sources::new("turning.spec", text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    let (model, _) = compiled.unwrap_or_else(|findings| panic!("{findings:#?}\n{text}"));
    pe_hls::lift::lift(model)
}

fn next(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 33) as f64 / f64::from(1u32 << 31)
}

/// Rods one behind another, the last of which ends at a pivot; with motors and friction at all of them.
struct Linkage {
    lengths: Vec<f64>,
    masses: Vec<f64>,
    torques: Vec<f64>,
    frictions: Vec<f64>,
    angles: Vec<f64>,
    speeds: Vec<f64>,
}

impl Linkage {
    /// Three rods between pivots that are `base` apart, whose first one turns at a speed.
    fn of_three(lengths: [f64; 3], base: f64, angle: f64, speed: f64, seed: &mut u64) -> Linkage {
        let [a, b, c] = lengths;
        // From the end of the first rod to the other pivot.
        let (x, y) = (base - a * libm::cos(angle), -a * libm::sin(angle));
        let reach = libm::hypot(x, y);
        let second = libm::atan2(y, x) + libm::acos((reach * reach + b * b - c * c) / (2.0 * reach * b));
        let third = libm::atan2(y - b * libm::sin(second), x - b * libm::cos(second));
        let turned = libm::sin(third - second);
        let speeds = vec![
            speed,
            -a * speed * libm::sin(third - angle) / (b * turned),
            a * speed * libm::sin(second - angle) / (c * turned),
        ];
        Linkage {
            lengths: lengths.to_vec(),
            masses: (0..3).map(|_| 0.5 + next(seed)).collect(),
            torques: vec![0.0; 3],
            frictions: vec![0.0; 3],
            angles: vec![angle, second, third],
            speeds,
        }
    }

    /// Some rods from rest.
    fn random(count: usize, seed: &mut u64) -> Linkage {
        let mut many = |low: f64, high: f64| (0..count).map(|_| low + (high - low) * next(seed)).collect::<Vec<_>>();
        Linkage {
            lengths: many(0.5, 1.0),
            masses: many(0.5, 1.5),
            torques: many(-9.0, 9.0),
            frictions: many(0.05, 0.3),
            angles: many(-40.0, 40.0),
            speeds: vec![0.0; count],
        }
    }

    fn spec(&self, sort: &str, solver: &str, step: &str, span: &str) -> String {
        let count = self.lengths.len();
        let beyond = |rod: usize| self.masses[rod + 1..].iter().sum::<f64>();
        let (l, m) = (&self.lengths, &self.masses);
        let carried: Vec<f64> = (0..count).map(|rod| m[rod] / 2.0 + beyond(rod)).collect();
        let moment: Vec<f64> = (0..count).map(|rod| l[rod] * l[rod] * (m[rod] / 3.0 + beyond(rod))).collect();
        let end = |of: fn(f64) -> f64| -> f64 { (0..count).map(|rod| l[rod] * of(self.angles[rod])).sum() };
        format!(
            "model linkage\nsolver {solver}\nstep {step}\nspan {span}\nindex i in 1..{count}, j in 1..{count}, r in 1..2\n\
             param l[i] = {l:?}\nparam carried[i] = {carried:?}\nparam moment[i] = {moment:?}\nparam t[i] = {:?}\n\
             param d[i] = {:?}\nparam end[r] = [{}, {}]\n{sort} q[i] = {:?}\nstate w[i] = {:?}\nmatrix M[i, j] symmetric\n\
             matrix J[r, i]\nM[i, i] = moment[i]\nM[i, j] = l[i]*l[j]*carried[i]*cos(q[i] - q[j]) where i > j\n\
             f[i] = t[i] - d[i]*w[i] - 9.81*l[i]*carried[i]*cos(q[i]) - sum(j: (if i > j then carried[i] else \
             carried[j])*l[i]*l[j]*sin(q[i] - q[j])*w[j]^2)\n\
             J[r, i] = l[i]*(if r == 1 then -sin(q[i]) else cos(q[i]))\n\
             gap[r] = sum(i: l[i]*(if r == 1 then cos(q[i]) else sin(q[i]))) - end[r]\n\
             bend[r] = -sum(i: l[i]*(if r == 1 then cos(q[i]) else sin(q[i]))*w[i]^2)\nq' = w\n\
             w' = constrained(M, f, J, gap, bend, 400, 100)\noutput q, w\n",
            self.torques,
            self.frictions,
            end(libm::cos),
            end(libm::sin),
            self.angles,
            self.speeds,
        )
    }
}

/// Steps a model in double precision and shows all states after each step.
fn stepped(model: &Model, mut show: impl FnMut(f64, &[f64])) {
    let graph = pe_hls::step::build(model).unwrap_or_else(|findings| panic!("{findings:#?}"));
    assert!(pe_ir::verify::step::check(&graph).is_empty());
    let mut run = DoubleRun::new(&graph);
    for done in 1..=model.steps() {
        run.step(&model.sample_inputs(model.time(done - 1, 0.0))).expect("it is finite");
        show(model.time(done, 0.0), &run.states().collect::<Vec<_>>());
    }
}

/// The largest difference of a model with angles from the same one with states, of angles in radians and of speeds; and how many
/// turns the first coordinate makes.
fn apart(linkage: &Linkage, step: &str, span: &str) -> (f64, f64, f64) {
    let count = linkage.lengths.len();
    let mut free: Vec<Vec<f64>> = Vec::new();
    stepped(&compiled(&linkage.spec("state", "trapezoidal", step, span)), |_, states| {
        free.push(states[..2 * count].to_vec());
    });
    let model = compiled(&linkage.spec("angle", "trapezoidal", step, span));
    let (mut angle, mut speed, mut place) = (0.0f64, 0.0f64, 0);
    stepped(&model, |_, states| {
        for coordinate in 0..count {
            let own = states[coordinate] * RADIANS;
            assert!(own.abs() < 0.8 * RADIANS, "{own} rad");
            let there = free[place][coordinate];
            angle = angle.max((turns::nearest(own, there, RADIANS) - there).abs());
            speed = speed.max((states[count + coordinate] - free[place][count + coordinate]).abs());
        }
        place += 1;
    });
    (angle, speed, (free[place - 1][0] - linkage.angles[0]).abs() / RADIANS)
}

#[test]
fn a_crank_that_turns_hundreds_of_times_moves_as_one_that_counts_its_turns() {
    let mut seed = 7;
    // The crank turns, or all three do.
    for (lengths, base) in [([0.4, 1.2, 0.9], 1.0), ([1.0, 0.9, 1.2], 0.4)] {
        let linkage = Linkage::of_three(lengths, base, 0.4, 90.0, &mut seed);
        let (angle, speed, turns) = apart(&linkage, "1 ms", "20 s");
        println!("{lengths:?}: {turns:.0} turns, {angle:e} rad, {speed:e} rad/s");
        assert!(turns > 100.0 && angle < 1e-6 && speed < 1e-4, "{turns} turns, {angle:e} rad, {speed:e} rad/s");
    }
}

#[test]
fn linkages_of_any_size_move_as_those_that_count_their_turns() {
    let mut seed = 29;
    let mut most = 0.0f64;
    for case in 0..9 {
        let linkage = Linkage::random(3 + case % 3, &mut seed);
        let (angle, speed, turns) = apart(&linkage, "1 ms", "1.5 s");
        println!("{} rods, {turns:.1} turns: {angle:e} rad, {speed:e} rad/s", linkage.lengths.len());
        most = most.max(turns);
        // They multiply what rounding leaves between the two.
        assert!(
            angle < 1e-5 && speed < 1e-3,
            "{angle:e} rad, {speed:e} rad/s\n{}",
            linkage.spec("angle", "trapezoidal", "1 ms", "1.5 s")
        );
    }
    assert!(most > 1.0, "none turns");
}

/// Coupler and rocker of a crank that turns by itself, both of which turn with it.
fn driven(sort: &str, step: &str, span: &str) -> String {
    format!(
        "model driven\nsolver trapezoidal\nstep {step}\nspan {span}\nindex i in 1..2, j in 1..2, r in 1..2\nparam a = 1\n\
         param l[i] = [0.9, 1.2]\nparam d = 0.4\nparam e[i] = [1, -1]\nparam t0 = 0.3\nparam v0 = 30\n\
         param x0 = d - a*cos(t0)\nparam y0 = -a*sin(t0)\nparam z0 = sqrt(x0^2 + y0^2)\n\
         param c0 = atan(y0/x0) + pi + acos((z0^2 + l[1]^2 - l[2]^2)/(2*z0*l[1]))\n\
         param k0 = atan((l[1]*sin(c0) - y0)/(l[1]*cos(c0) - x0))\n\
         {sort} q[i] = [c0, k0]\nstate w[i] = [a*v0*sin(k0 - t0)/(l[1]*sin(c0 - k0)), a*v0*sin(c0 - t0)/(l[2]*sin(c0 - k0))]\n\
         x = a*cos(t0 + v0*time)\ny = a*sin(t0 + v0*time)\ns[i] = sin(q[i])\nc[i] = cos(q[i])\nmatrix M[i, j] symmetric\n\
         matrix J[r, i]\nM[i, i] = 1\nf[i] = -9.81*c[i]\nJ[r, i] = e[i]*l[i]*(if r == 1 then -s[i] else c[i])\n\
         gap[r] = sum(i: e[i]*l[i]*(if r == 1 then c[i] else s[i])) + (if r == 1 then x - d else y)\n\
         drift[r] = v0*(if r == 1 then -y else x)\n\
         bend[r] = sum(i: e[i]*l[i]*(if r == 1 then -c[i] else -s[i])*w[i]^2) - v0^2*(if r == 1 then x else y)\nq' = w\n\
         w' = constrained(M, f, J, gap, bend, 1e4, 100, drift)\noutput q, w\n"
    )
}

#[test]
fn what_a_crank_drives_turns_as_its_exact_solution() {
    // Where coupler and rocker meet is the cut of two circles.
    let exact = |time: f64| {
        let angle = 0.3 + 30.0 * time;
        let (x, y) = (0.4 - libm::cos(angle), -libm::sin(angle));
        let reach = libm::hypot(x, y);
        libm::atan2(y, x) + libm::acos((reach * reach + 0.9 * 0.9 - 1.2 * 1.2) / (2.0 * reach * 0.9))
    };
    let worst = |step: &str| {
        let (mut worst, mut turns, mut before) = (0.0f64, 0.0f64, None);
        stepped(&compiled(&driven("angle", step, "30 s")), |time, states| {
            let own = states[0] * RADIANS;
            worst = worst.max(turns::principal(own - exact(time), RADIANS).abs());
            turns += before.map_or(0.0, |before| turns::principal(own - before, RADIANS)) / RADIANS;
            before = Some(own);
        });
        assert!(turns.abs() > 100.0, "{turns}");
        worst
    };
    let (fine, coarse) = (worst("0.5 ms"), worst("1 ms"));
    println!("{fine:e} and {coarse:e} rad");
    assert!(fine < 1e-5 && coarse > 3.0 * fine, "{fine:e} and {coarse:e} rad");
}

#[test]
fn the_four_bar_linkage_turns_as_its_exact_solution() {
    let text = include_str!("../../../../models/four_bar/implicit.spec");
    let angle = text.replace("state q[i] = up[i]*pi/2 in -40*up[i] - 0.1 .. 2", "angle q[i] = up[i]*pi/2");
    assert_ne!(text, angle);
    let mut worst = 0.0f64;
    stepped(&compiled(&angle), |time, states| {
        if (libm::round(time / 4e-3) as u64).is_multiple_of(50) {
            let own = std::f64::consts::FRAC_PI_2 - states[0] * RADIANS;
            worst = worst.max(turns::principal(own - exact_angle(4.0, time), RADIANS).abs());
        }
    });
    println!("{worst:e} rad");
    assert!(worst < 1e-3, "{worst:e} rad");
}

#[test]
fn dropping_turns_adds_no_error_however_many_they_are() {
    // A rotor beside a coordinate that a closure holds: its angle moves by the same words in every step.
    let text = "model rotor\nsolver trapezoidal\nstep 1 ms\nspan 1 s\nindex i in 1..2, j in 1..2, r in 1..1\n\
        angle q[i] = [1, 0]\nstate w[i] = [777.7, 0]\nmatrix M[i, j] symmetric\nmatrix J[r, i]\nM[i, i] = 2\nf[i] = 0\n\
        J[1, 2] = cos(q[2])\ngap[r] = sin(q[2])\nbend[r] = -sin(q[2])*w[2]^2\nq' = w\n\
        w' = constrained(M, f, J, gap, bend, 400, 100)\noutput q, w\n";
    let model = compiled(text);
    let graph: StepGraph = pe_hls::step::build(&model).expect("it has a step");
    let format = pe_ir::word::WordFormat::new(32, 32, 32);
    let graph =
        pe_judge::tables::tabulate(&model, &graph, format, &*pe_judge::progress::silent()).expect("it has tables");
    let mut run = DoubleRun::new(&graph);
    (0..1000).for_each(|_| run.step(&[]).expect("finite"));
    let mut largest = run.largest().to_vec();
    for (start, end) in graph.states.iter().take(2) {
        [start, end].into_iter().for_each(|value| largest[value.index()] = largest[value.index()].max(turns::REACH));
    }
    let ranges = formats::Ranges { widened: vec![0; largest.len()], largest };
    let fixed = formats::choose(&graph, &ranges, format).expect("it has formats");
    let mut run = FixedRun::new(&graph, &fixed);
    let state = graph.states[StateId::new(0)].0;
    let first = i128::from(run.word(state));
    assert!(!run.step(&[]));
    let step = i128::from(run.word(state)) - first;
    let (steps, turn) = (300_000, 1i128 << -fixed.exponents[state.index()]);
    (1..steps).for_each(|_| assert!(!run.step(&[]), "it saturates"));
    let (last, wanted) = (i128::from(run.word(state)), first + steps * step);
    assert_eq!((last - wanted).rem_euclid(turn), 0, "{last} after {steps} steps of {step}");
    assert!(steps * step > 10_000 * turn && 2 * last.abs() < turn + 2 * step.abs() + 2, "{last}, {turn}");
}

#[test]
fn the_range_of_an_angle_is_a_turn_whatever_the_run_does() {
    let folder = Folder::new("turning_range");
    // Two pendulums that a closure makes one.
    let text = "model swung\nsolver trapezoidal\nstep 1 ms\nspan 1 s\nindex i in 1..2, j in 1..2, r in 1..1\n\
        input u = square(80, 8 Hz)\nangle q[i] = 0\nstate w[i] = 0\nmatrix M[i, j] symmetric\nmatrix J[r, i]\nM[i, i] = 1\n\
        f[i] = (if i == 1 then u - 1.5*sin(q[i]) else -sin(q[i])) - 1.5*w[i]\nJ[r, i] = if i == 1 then 1 else -1\ngap[r] = wrap(q[1] - q[2])\nbend[r] = 0\nq' = w\n\
        w' = constrained(M, f, J, gap, bend, 400, 100)\noutput q, w\n";
    let path = folder.0.join("swung.spec");
    fs::write(&path, text).unwrap();
    let found = compile_file(&path, &["--tries", "20", "--multiplier", "35x35"]);
    let mut run = FixedRun::new(&found.design.graph, &found.design.judged.fixed);
    let word = run.encode_input(0, 3.5).0;
    for _ in 0..6000 {
        let saturates = run.step(&[word]);
        let graph = &found.design.graph;
        let counts = run.saturations();
        let those = counts.iter().enumerate().filter(|(_, count)| **count > 0);
        let those: Vec<String> = those.map(|(value, _)| graph.value_name(pe_ir::graph::ValueId::at(value))).collect();
        assert!(!saturates, "{those:?}");
    }
    // The first step begins with the acceleration that the spec's own input gives: half a step of it is a velocity.
    let kick = 5e-4 * (80.0 - 3.5) / 2.0;
    let moved = text.replace("square(80, 8 Hz)", "3.5").replace("span 1 s", "span 6 s");
    let moved = compiled(&moved.replace("state w[i] = 0", &format!("state w[i] = {kick}")));
    let exact =
        reference::solve_with_limit(&moved, &[6.0], 1e-12, 1_000_000, &mut |_| {}).expect("it exists").states.samples;
    let own: Vec<f64> = run.states().collect();
    assert!(exact[0] > 0.45, "it does not come far beyond the run: {exact:?}");
    assert!(turns::principal(own[0] - exact[0], 1.0).abs() < 1e-4, "{own:?} {exact:?}");
    assert!((own[2] - exact[2]).abs() < 1e-3, "{own:?} {exact:?}");
}

#[test]
fn cranks_that_turn_are_judged_as_those_that_count_their_turns() {
    let folder = Folder::new("turning_judged");
    let mut seed = 11;
    let linkage = Linkage::of_three([0.4, 1.2, 0.9], 1.0, 0.4, 9.0, &mut seed);
    let run = |arguments: &[&str]| {
        let output =
            Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).current_dir(&folder.0).output().unwrap();
        (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let mut errors = Vec::new();
    for sort in ["state", "angle"] {
        let name = format!("{sort}.spec");
        fs::write(folder.0.join(&name), linkage.spec(sort, "trapezoidal", "1 ms", "3 s")).unwrap();
        let word = ["--multiplier", "35x35", "--storage", "40", "--quiet"];
        let (status, told) = run(&[&["check", &name][..], &word].concat());
        assert!(status == 0 && told.is_empty(), "{sort}: {told}");
        let compile = ["compile", &name, "--pes", "2", "--no-pictures", "--reference", "-o", sort];
        let (status, told) = run(&[&compile[..], &word].concat());
        assert!(status == 0 && told.is_empty(), "{sort}: {told}");
        let report = fs::read_to_string(folder.0.join(sort).join("report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        let of = |what: &str| report["error"][what].as_f64().unwrap_or_else(|| panic!("{what}: {}", report["error"]));
        errors.push((of("method"), of("word_length")));
        assert!(report["mechanism"]["gap"]["fixed"]["size"].as_f64() < Some(1e-6), "{}", report["mechanism"]);
    }
    println!("{errors:?}");
    // The rates are the worst, and are the same numbers in both.
    let [state, angle] = errors[..] else { panic!("{errors:?}") };
    assert!((angle.0 - state.0).abs() < 0.1 * state.0 && angle.1 < 4.0 * state.1, "{errors:?}");
}

#[test]
fn all_engines_turn_alike() {
    let folder = Folder::new("turning_engines");
    let mut seed = 5;
    for (number, linkage) in
        [Linkage::of_three([1.0, 0.9, 1.2], 0.4, 0.4, 60.0, &mut seed), Linkage::random(4, &mut seed)]
            .iter()
            .enumerate()
    {
        let path = folder.0.join(format!("linkage{number}.spec"));
        let text = linkage.spec("angle", "trapezoidal", "1 ms", "0.2 s");
        fs::write(&path, text.replace("model linkage", &format!("model linkage{number}"))).unwrap();
        let found = compile_file(&path, &["--tries", "20", "--multiplier", "35x35", "--pes", "2"]);
        println!("{number}: {:?}", found.design.judged.errors);
        assert_lively_agreement(&format!("linkage {number}"), &found.starts(12), &[Engine::Ghdl], 0.4);
    }
}
