//! Where mechanisms start: random trusses of masses and rods in the plane, with closures that depend on each other, too.

mod common;

use pe_frontend::{NoFiles, Overrides};
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write;

/// Masses at points, which rods of their distances connect; it moves as a rigid body.
struct Truss {
    masses: Vec<f64>,
    places: Vec<[f64; 2]>,
    speeds: Vec<[f64; 2]>,
    rods: Vec<(usize, usize, f64)>,
}

impl Truss {
    /// Of so many masses, with a rod between every two of them or in a chain.
    fn random(size: usize, whole: bool, random: &mut ChaCha8Rng) -> Truss {
        let places: Vec<[f64; 2]> = (0..size)
            .map(|place| [place as f64 + random.random_range(-0.2..0.2), random.random_range(-1.0..1.0)])
            .collect();
        let [u, v, turning]: [f64; 3] = std::array::from_fn(|_| random.random_range(-1.0..1.0));
        let speeds = places.iter().map(|[x, y]| [u - turning * y, v + turning * x]).collect();
        let mut rods = Vec::new();
        for one in 0..size {
            for other in (one + 1..size).filter(|other| whole || *other == one + 1) {
                let [dx, dy] = [0, 1].map(|axis: usize| places[one][axis] - places[other][axis]);
                rods.push((one, other, libm::hypot(dx, dy)));
            }
        }
        Truss { masses: (0..size).map(|_| random.random_range(0.5..2.0)).collect(), places, speeds, rods }
    }

    /// With places and speeds off by up to so much.
    fn moved(&self, places: f64, speeds: f64, random: &mut ChaCha8Rng) -> Truss {
        let mut off = |all: &[[f64; 2]], by: f64| -> Vec<[f64; 2]> {
            all.iter()
                .map(|[x, y]| [x + by * random.random_range(-1.0..1.0), y + by * random.random_range(-1.0..1.0)])
                .collect()
        };
        let (places, speeds) = (off(&self.places, places), off(&self.speeds, speeds));
        Truss { places, speeds, masses: self.masses.clone(), rods: self.rods.clone() }
    }

    fn spec(&self) -> String {
        let (size, rods) = (2 * self.masses.len(), self.rods.len());
        let list = |numbers: &mut dyn Iterator<Item = f64>| {
            numbers.map(|number| format!("{number:?}")).collect::<Vec<_>>().join(", ")
        };
        let mut text = format!(
            "model truss\nsolver rk4\nstep 1 ms\nspan 10 ms\nindex i in 1..{size}, j in 1..{size}, r in 1..{rods}\n\
             param m[i] = [{}]\nparam l[r] = [{}]\nstate q[i] = [{}]\nstate w[i] = [{}]\nmatrix M[i, j] symmetric\n\
             matrix J[r, i]\nM[i, i] = m[i]\nf[i] = 0\nq' = w\nw' = constrained(M, f, J, gap, bend, 400, 100)\noutput q, w\n",
            list(&mut self.masses.iter().flat_map(|mass| [*mass, *mass])),
            list(&mut self.rods.iter().map(|rod| rod.2)),
            list(&mut self.places.iter().flatten().copied()),
            list(&mut self.speeds.iter().flatten().copied()),
        );
        for (row, (one, other, _)) in self.rods.iter().enumerate() {
            let row = row + 1;
            let [x, y] = [1, 2].map(|axis| format!("(q[{}] - q[{}])", 2 * one + axis, 2 * other + axis));
            let [u, v] = [&x, &y].map(|place| place.replace('q', "w"));
            writeln!(text, "gap[{row}] = ({x}^2 + {y}^2 - l[{row}]^2)/2").unwrap();
            writeln!(text, "bend[{row}] = {u}^2 + {v}^2").unwrap();
            for (end, sign) in [(one, ""), (other, "-")] {
                writeln!(text, "J[{row}, {}] = {sign}{x}\nJ[{row}, {}] = {sign}{y}", 2 * end + 1, 2 * end + 2).unwrap();
            }
        }
        text
    }

    /// The same where a model starts.
    fn of(&self, model: &Model) -> Truss {
        let size = self.masses.len();
        let both = |from: usize| {
            (0..size).map(|body| [0, 1].map(|axis| initial(model, from + 2 * body + axis))).collect::<Vec<[f64; 2]>>()
        };
        Truss { places: both(0), speeds: both(2 * size), masses: self.masses.clone(), rods: self.rods.clone() }
    }

    /// How far the worst rod is from its length, and how fast it changes, half the squares of both.
    fn open(&self, model: &Model) -> (f64, f64) {
        let size = 2 * self.masses.len();
        let rod = |(one, other, length): &(usize, usize, f64)| {
            let apart = |from: usize| {
                [0, 1].map(|axis| initial(model, from + 2 * one + axis) - initial(model, from + 2 * other + axis))
            };
            let ([dx, dy], [du, dv]) = (apart(0), apart(size));
            (((dx * dx + dy * dy - length * length) / 2.0).abs(), (dx * du + dy * dv).abs())
        };
        self.rods.iter().map(rod).fold((0.0, 0.0), |most, rod| (most.0.max(rod.0), most.1.max(rod.1)))
    }

    /// By how much places and speeds of a model differ from these at most; and momentum and angular momentum of the
    /// difference of speeds, and that of the mean place, which closures cannot change.
    fn moves(&self, model: &Model) -> (f64, [f64; 5]) {
        let size = 2 * self.masses.len();
        let (mut most, mut kept) = (0.0f64, [0.0; 5]);
        for (body, mass) in self.masses.iter().enumerate() {
            let places = [0, 1].map(|axis| initial(model, 2 * body + axis) - self.places[body][axis]);
            let speeds = [0, 1].map(|axis| initial(model, size + 2 * body + axis) - self.speeds[body][axis]);
            let [x, y] = [0, 1].map(|axis| initial(model, 2 * body + axis));
            let turning = x * speeds[1] - y * speeds[0];
            let all = [places[0], places[1], speeds[0], speeds[1], turning];
            kept.iter_mut().zip(all).for_each(|(kept, one)| *kept += mass * one);
            most = all[..4].iter().fold(most, |most, one| most.max(one.abs()));
        }
        (most, kept)
    }
}

/// The initial value of the state with this number.
fn initial(model: &Model, number: usize) -> f64 {
    model.states[StateId::at(number)].initial
}

fn compiled(text: &str) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    pe_frontend::compile(&mut common::source(text), &NoFiles, &Overrides::default())
}

fn codes(findings: &[Diagnostic]) -> Vec<&str> {
    findings.iter().map(|finding| finding.code).collect()
}

/// Codes of the findings of a text that does not compile.
fn refused(text: &str) -> Vec<&'static str> {
    match compiled(text) {
        Ok((_, findings)) => panic!("it compiles: {findings:#?}\n{text}"),
        Err(findings) => findings.iter().map(|finding| finding.code).collect(),
    }
}

/// Trusses of all kinds.
fn trusses() -> impl Iterator<Item = (Truss, ChaCha8Rng)> {
    (0..24).map(|seed| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let truss = Truss::random(2 + seed as usize % 4, seed % 2 == 0, &mut random);
        (truss, random)
    })
}

#[test]
fn a_consistent_start_stays_as_it_is() {
    for (truss, _) in trusses() {
        let (model, findings) = compiled(&truss.spec()).unwrap_or_else(|findings| panic!("{findings:#?}"));
        assert_eq!(codes(&findings), [""; 0], "{}", truss.spec());
        assert_eq!(truss.moves(&model).0, 0.0);
    }
}

#[test]
fn a_start_that_is_nearly_consistent_is_moved_by_no_more_than_it_takes() {
    for (truss, mut random) in trusses() {
        for by in [1e-2, 1e-5, 1e-8] {
            let moved = truss.moved(by, by, &mut random);
            let (model, findings) = compiled(&moved.spec()).unwrap_or_else(|findings| panic!("{findings:#?}"));
            assert_eq!(codes(&findings), ["W0932"]);
            let (gap, rate) = truss.open(&model);
            assert!(gap < 1e-11 && rate < 1e-11, "{gap:e} {rate:e}");
            // Another start is as near, so that the nearest one is no farther than twice as far, in the measure of masses.
            let (most, kept) = moved.moves(&model);
            assert!(most < 12.0 * by, "{most:e}");
            assert!(kept.iter().all(|kept| kept.abs() < 1e-7 * by + 1e-13), "{kept:?}");
            // What was moved needs no more of it.
            let settled = truss.of(&model);
            let (_, findings) = compiled(&settled.spec()).unwrap();
            assert_eq!(codes(&findings), [""; 0]);
        }
    }
}

#[test]
fn what_is_far_from_closed_is_refused() {
    for (mut truss, mut random) in trusses() {
        let mut longer = truss.moved(0.0, 0.0, &mut random);
        longer.rods[0].2 *= 2.5;
        // Rods that make no ring can have any lengths.
        let ring = longer.rods.len() >= longer.masses.len();
        match &refused(&longer.spec())[..] {
            ["E0417"] => {}
            ["E0928"] => assert!(ring, "{}", longer.spec()),
            other => panic!("{other:?}\n{}", longer.spec()),
        }
        // Both ends of a rod leave each other.
        let (one, other, length) = truss.rods[0];
        for axis in [0, 1] {
            let along = 2.0 * (truss.places[one][axis] - truss.places[other][axis]) / length;
            (truss.speeds[one][axis], truss.speeds[other][axis]) = (along, -along);
        }
        assert_eq!(refused(&truss.spec()), ["E0417"]);
    }
}

#[test]
fn wrong_derivatives_and_masses_are_found() {
    for (truss, _) in trusses() {
        let spec = truss.spec();
        let wrong = |from: &str, to: &str| {
            assert!(spec.contains(from), "{spec}");
            refused(&spec.replacen(from, to, 1))
        };
        let factor = "J[1, 1] = ";
        assert_eq!(wrong(factor, "J[1, 1] = 1.01*"), ["E0419"]);
        assert_eq!(wrong(factor, "J[1, 1] = -"), ["E0419"]);
        assert_eq!(wrong("bend[1] = ", "bend[1] = -"), ["E0419"]);
        assert_eq!(wrong("bend[1] = ", "bend[1] = 0*"), ["E0419"]);
        assert_eq!(wrong("M[i, i] = m[i]", "M[i, i] = (if i == 2 then -1 else 1)*m[i]"), ["E0418"]);
        assert_eq!(wrong("M[i, i] = m[i]", "M[i, i] = m[i]\nM[2, 1] = 2*m[1]"), ["E0418"]);
    }
}

#[test]
fn angles_of_a_mechanism_start_closed_as_well() {
    let text = "model gear\nsolver rk4\nstep 1 ms\nspan 10 ms\nindex i in 1..2, j in 1..2, r in 1..1\n\
        angle a = 0.3\nstate x = 0.2956\nstate w[i] = [1, 0.9553]\nmatrix M[i, j] symmetric\nmatrix J[r, i]\nM[i, i] = 1\n\
        f[i] = 0\ngap[r] = x - sin(a)\nJ[r, 1] = -cos(a)\nJ[r, 2] = 1\nbend[r] = sin(a)*w[1]^2\na' = w[1]\nx' = w[2]\n\
        w' = constrained(M, f, J, gap, bend, 400, 100)\noutput a, x\n";
    let (model, findings) = compiled(text).unwrap_or_else(|findings| panic!("{findings:#?}"));
    assert_eq!(codes(&findings), ["W0932"]);
    let angle = initial(&model, 0) * 2.0 * std::f64::consts::PI;
    assert!((initial(&model, 1) - libm::sin(angle)).abs() < 1e-11, "{} {}", initial(&model, 1), libm::sin(angle));
    // The mechanism reads the equations that angles have become.
    let mechanism = model.mechanism.as_ref().unwrap();
    let mut names = Vec::new();
    mechanism.each_variable(&mut |variable| {
        if let pe_ir::model::Variable::Algebraic(number) = variable {
            names.push(model.algebraics[number as usize].name.clone());
        }
    });
    for name in ["gap[1]", "bend[1]", "J[1,1]"] {
        assert!(names.iter().any(|own| own == name), "{name}: {names:?}");
    }
}
