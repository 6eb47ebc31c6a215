//! Functions of all kinds over ranges of all widths, with words of all lengths: each has tables as accurate as the
//! argument's word allows, or is refused for the right reason.

use pe_ir::functions::{ScalarFunction, Segments};
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Function, Select, Variable};
use pe_ir::word::WordFormat;

use super::domain::Domain;
use super::expand::{Computed, Planned};
use super::tests::at_argument;
use super::{COARSEST, Price, computed, parts};

fn x() -> Expr {
    Expr::Variable(Variable::State(StateId::new(0)))
}

fn apply(function: Function, argument: Expr) -> Expr {
    Expr::Apply(function, Box::new(argument))
}

fn plus(expr: Expr, number: f64) -> Expr {
    Expr::sum(vec![expr, Expr::Constant(number)])
}

fn over(above: Expr, below: Expr) -> Expr {
    Expr::product(vec![above, apply(Function::Reciprocal, below)])
}

fn at_least(expr: Expr, least: f64) -> Expr {
    let distance = plus(expr, -least);
    let magnitude = apply(Function::Abs, distance.clone());
    plus(Expr::sum(vec![Expr::scaled(0.5, distance), Expr::scaled(0.5, magnitude)]), least)
}

/// What a case must come to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Must {
    /// Tables that are right.
    Run,
    /// Refused for a place without bounded values, near this one.
    Pole(f64),
    /// Tables that are right, or a refusal because it is too steep.
    RunOrSteep,
    /// Not looked at: what decision 0044 lists as its drawbacks.
    Drawback,
}

/// A function, its library version, a range and what must become of it.
struct Case {
    name: String,
    body: Expr,
    range: (f64, f64),
    must: Must,
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut add = |name: String, body: Expr, range: (f64, f64), must| cases.push(Case { name, body, range, must });
    for decades in [1, 4, 7, 9] {
        let wide = libm::pow(10.0, f64::from(decades));
        for (low, high) in [(1.0, wide), (1.0 / wide, 1.0), (-wide, -1.0), (-1.0, -1.0 / wide)] {
            let name = |what: &str| format!("{what} on {low:e} .. {high:e}");
            let size = if low > 0.0 { x() } else { Expr::scaled(-1.0, x()) };
            add(name("1/x"), apply(Function::Reciprocal, x()), (low, high), Must::Run);
            add(name("1/x^2"), apply(Function::Reciprocal, Expr::power(x(), 2)), (low, high), Must::RunOrSteep);
            add(name("x^-1.5"), apply(Function::RealPower(-1.5), size.clone()), (low, high), Must::RunOrSteep);
            add(name("x^0.3"), apply(Function::RealPower(0.3), size.clone()), (low, high), Must::Run);
            add(name("sqrt"), apply(Function::Sqrt, size.clone()), (low, high), Must::Run);
            add(name("log"), apply(Function::Log, size.clone()), (low, high), Must::Run);
            let must = if decades > 7 { Must::Drawback } else { Must::Run };
            add(name("monod"), over(size.clone(), plus(size.clone(), 0.01)), (low, high), must);
            let hill = over(Expr::power(size.clone(), 4), plus(Expr::power(size, 4), 1.0));
            add(name("hill"), hill, (low, high), Must::RunOrSteep);
        }
        // Poles inside and right outside of the range.
        for place in [0.0, 0.3, -wide / 3.0].into_iter().filter(|place| decades <= 7 || place.abs() < 1.0) {
            let moved = plus(x(), -place);
            for (what, body) in [
                ("1/(x-p)", apply(Function::Reciprocal, moved.clone())),
                ("1/(x-p)^2", apply(Function::Reciprocal, Expr::power(moved.clone(), 2))),
                ("1+1e-6/(x-p)", plus(Expr::scaled(1e-6, apply(Function::Reciprocal, moved.clone())), 1.0)),
                ("log|x-p|", apply(Function::Log, apply(Function::Abs, moved.clone()))),
            ] {
                let narrow = decades > 7 && what == "log|x-p|";
                let must = if narrow { Must::Drawback } else { Must::Pole(place) };
                add(format!("{what} with p = {place} in {wide:e}"), body, (-wide, wide), must);
            }
        }
    }
    for low in [0.0, -1e-6, -1.0] {
        for body in [
            apply(Function::Sqrt, at_least(x(), 0.0)),
            apply(Function::RealPower(0.3), at_least(x(), 0.0)),
            apply(Function::RealPower(1.5), at_least(x(), 0.0)),
            apply(Function::Sqrt, apply(Function::Abs, x())),
            apply(Function::Log, at_least(x(), 1e-6)),
            apply(Function::Abs, Expr::sum(vec![x(), Expr::Constant(-0.3)])),
        ] {
            add(format!("kink from {low}"), body, (low, 1.0), Must::Run);
        }
    }
    for width in [1.0, 1e-2, 1e-3, 1e-5] {
        for centre in [0.0, 90.005, 99.9999] {
            let near = Expr::scaled(1.0 / width, plus(x(), -centre));
            let bell = apply(Function::Exp, Expr::scaled(-1.0, Expr::power(near.clone(), 2)));
            let must = if width < 1e-4 { Must::RunOrSteep } else { Must::Run };
            add(format!("bell of {width} at {centre}"), bell, (0.0, 100.0), must);
            add(format!("step of {width} at {centre}"), apply(Function::Tanh, near.clone()), (0.0, 100.0), must);
            let peak = apply(Function::Reciprocal, plus(Expr::power(near, 2), 1.0));
            add(format!("peak of {width} at {centre}"), peak, (0.0, 100.0), must);
        }
    }
    for rate in [1.0, 10.0, 100.0, 700.0] {
        add(format!("exp({rate} x)"), apply(Function::Exp, Expr::scaled(rate, x())), (-1.0, 1.0), Must::Run);
        add(format!("exp(-{rate} x)"), apply(Function::Exp, Expr::scaled(-rate, x())), (0.0, 1.0), Must::Run);
        add(format!("sin({rate} x)"), apply(Function::Sin, Expr::scaled(rate, x())), (-1.0, 1.0), Must::RunOrSteep);
    }
    for range in [(-1.0, 1.0), (-1.0, 2.0), (-30.0, 45.0), (-1e-3, 1e-3), (0.0, 5.0)] {
        let one_less = |expr: Expr| plus(expr, -1.0);
        for (what, body) in [
            ("x/(exp(x)-1)", over(x(), one_less(apply(Function::Exp, x())))),
            ("sin(x)/x", over(apply(Function::Sin, x()), x())),
            ("(cosh(x)-1)/x^2", over(one_less(apply(Function::Cosh, x())), Expr::power(x(), 2))),
            ("log(1+x^2)/x", over(apply(Function::Log, plus(Expr::power(x(), 2), 1.0)), x())),
            ("(x^2-1)/(x-1)", over(one_less(Expr::power(x(), 2)), one_less(x()))),
        ] {
            add(format!("{what} on {range:?}"), body, range, Must::RunOrSteep);
        }
    }
    let choice = Select { condition: plus(x(), -0.3), yes: apply(Function::Log, x()), no: Expr::Constant(2.0) };
    let floor = || apply(Function::Floor, x());
    add("steps of some".to_owned(), floor(), (-20.3, 30.4), Must::Run);
    add("steps of some, again".to_owned(), floor(), (-20.3, 30.4), Must::Run);
    add("steps of many".to_owned(), floor(), (0.0, 1e6), Must::RunOrSteep);
    add("steps of many, again".to_owned(), floor(), (0.0, 1e6), Must::RunOrSteep);
    add("jump".to_owned(), Expr::Select(Box::new(choice)), (-1.0, 2.0), Must::Run);
    cases
}

/// What the chains of a function compute, in exact arithmetic.
fn looked_up(computed: &Computed, segments: Segments, x: f64) -> f64 {
    let table = |planned: &Planned, x: f64| at_argument(&planned.fit, segments, x);
    let parts = computed.parts.iter();
    parts.map(|part| table(&part.table, part.clamps.iter().fold(x, |x, clamp| table(clamp, x)))).sum()
}

/// Arguments of a range: evenly spread, and close to both ends and to places of interest.
fn arguments((low, high): (f64, f64)) -> Vec<f64> {
    let mut all: Vec<f64> = (0..=600).map(|k| low + (high - low) * f64::from(k) / 600.0).collect();
    for place in [low, high, 0.0, 0.3, 1.0, 3.3, 90.005, 99.9999] {
        for distance in (0..80).map(|k| (high - low) * libm::exp2(-0.5 * f64::from(k))) {
            all.extend([place - distance, place + distance].into_iter().filter(|x| (low..=high).contains(x)));
        }
    }
    all
}

/// What became of functions.
#[derive(Default)]
struct Tally {
    failures: Vec<String>,
    run: usize,
    divided: usize,
    steep: usize,
    poles: usize,
}

impl Tally {
    fn add(&mut self, Case { name, body, range, must }: Case, format: WordFormat) {
        let function = ScalarFunction { name: name.clone(), body, variable: Variable::State(StateId::new(0)) };
        let domain = match Domain::of(&function, range, format) {
            Ok(domain) => domain,
            Err(place) => {
                self.poles += 1;
                // A removable place is none without bounds.
                let right = matches!(must, Must::Pole(at) if (at - place).abs() <= 1e-3 * (range.1 - range.0));
                self.failures.extend((!right).then(|| format!("{name}: no bounded values at {place:e}")));
                return;
            }
        };
        if let Must::Pole(place) = must {
            self.failures.push(format!("{name}: the pole at {place:e} is not found"));
            return;
        }
        let (largest, tolerance, blur) = (domain.largest, domain.tolerance, domain.blur);
        let (segments, mut all) = computed(vec![domain], &[1], Price::of(format));
        let computed = all.remove(0);
        if let Some((at, error)) = computed.misses(COARSEST, parts::COARSE) {
            self.steep += 1;
            let message = || format!("{name}: too steep at {at:e}, {error:e}, {} parts", computed.parts());
            self.failures.extend((must == Must::Run).then(message));
            return;
        }
        self.run += 1;
        self.divided += usize::from(computed.parts() > 1 || !computed.parts[0].clamps.is_empty());
        let mut worst = (0.0f64, 0.0);
        for x in arguments(range) {
            let exact = function.evaluate(x);
            // Right beside 0/0 what is computed from the formula is rounding noise.
            if name.contains('/') && name.contains(" on (") && [0.0, 1.0].iter().any(|at| (x - at).abs() < 1e-4) {
                continue;
            }
            let near = |by: f64| function.evaluate((x + by).clamp(range.0, range.1));
            let jumps = (near(1e-12) - near(-1e-12)).abs() > 0.1;
            let blurred = (near(blur) - exact).abs().max((near(-blur) - exact).abs());
            // Parts that are small are cut where they are as good as flat.
            let allowed = COARSEST * largest.min(1e300);
            let difference = (looked_up(&computed, segments, x) - exact).abs();
            let excess = difference / (32.0 * tolerance + 32.0 * blurred + 1e-11 * largest);
            if difference.is_nan() || difference > allowed + 16.0 * blurred {
                self.failures.push(format!("{name}: off by {difference:e} of {largest:e} at {x:e}"));
                break;
            }
            if excess > worst.0 && !jumps {
                worst = (excess, x);
            }
        }
        let fine = computed.parts.iter().all(|part| part.table.fit.blurred_excess <= parts::COARSE);
        if worst.0 > 1.0 && fine {
            self.failures.push(format!("{name}: {:e} times what is excused at {:e}", worst.0, worst.1));
        }
    }
}

#[test]
fn every_function_has_tables_that_are_right_or_a_reason_that_is() {
    let formats = [WordFormat::new(32, 32, 32), WordFormat::new(32, 35, 25)];
    // Each format has every other case, and a thread of its own.
    let of_format = |remainder: usize| {
        let mut tally = Tally::default();
        let of_it = cases().into_iter().enumerate().filter(|(number, _)| number % 2 == remainder);
        of_it.filter(|(_, case)| case.must != Must::Drawback).for_each(|(_, case)| tally.add(case, formats[remainder]));
        tally
    };
    let (first, second) = std::thread::scope(|scope| {
        let second = scope.spawn(|| of_format(1));
        (of_format(0), second.join().expect("no case panics"))
    });
    let failures = [first.failures, second.failures].concat();
    let (run, divided) = (first.run + second.run, first.divided + second.divided);
    let (steep, poles) = (first.steep + second.steep, first.poles + second.poles);
    println!("{run} run, {divided} of them divided, {steep} too steep, {poles} poles");
    assert!(failures.is_empty(), "{} failures\n{}", failures.len(), failures.join("\n"));
    assert!(run > 180 && divided > 50 && poles > 30, "{run} {divided} {poles}");
}
