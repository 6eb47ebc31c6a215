//! Tables against the functions themselves, on dense grids.

use pe_ir::functions::{ScalarFunction, Segments};
use pe_ir::index::{EquationId, StateId, ValueId};
use pe_ir::model::{Expr, Function, Select, Variable};
use pe_ir::word::WordFormat;

use super::divisions::divisions;
use super::domain::Domain;
use super::fit::{Fit, Layout, Shape};
use super::uses::{self, Cluster, Use};
use super::{MISSED, Planned, Price, WORDS, divide, plan};

/// Points of a dense grid.
const POINTS: usize = 20_001;

fn x() -> Expr {
    Expr::Variable(Variable::State(StateId::new(0)))
}

fn apply(function: Function, argument: Expr) -> Expr {
    Expr::Apply(function, Box::new(argument))
}

fn scalar(body: Expr) -> ScalarFunction {
    ScalarFunction { name: body.text(&|_, _| "x".to_owned()), body, variable: Variable::State(StateId::new(0)) }
}

fn planned(function: &ScalarFunction, range: (f64, f64), format: WordFormat) -> (Segments, Planned<'_>) {
    let domain = Domain::of(function, range, format).expect("a bounded function");
    let (segments, mut planned) = plan(vec![domain], &[1], Price::of(format));
    (segments, planned.remove(0))
}

fn looked_up(planned: &Planned, segments: Segments, x: f64) -> f64 {
    at_argument(&planned.fit, segments, x)
}

/// What the PE computes at an argument, in exact arithmetic; written from the decision records, not from the expansion.
pub(super) fn at_argument(fit: &Fit, segments: Segments, x: f64) -> f64 {
    let Some(scaling) = &fit.shape.scaling else {
        let z = fit.shape.map.slope * x + fit.shape.map.offset;
        assert!((-1.0..=1.0).contains(&z), "{x} is mapped to {z}");
        return interpolated(fit, segments, z);
    };
    let distance = scaling.distance.slope * x + scaling.distance.offset;
    assert!((0.0..1.0).contains(&distance), "{x} is at a distance of {distance}");
    let segment = segments.index_of(distance, true);
    let scale = scaling.scales(segments)[segment];
    let local = scale * distance - 2.8125;
    assert!(local.abs() <= 0.94, "{x} is at {local} of its octave");
    let value = interpolated(fit, segments, local);
    let power = scaling.powers(segments).map_or(scale, |powers| powers[segment]);
    if scaling.is_logarithm() {
        return value + power;
    }
    scaling.beside() + libm::scalbn(value * power, scaling.weight())
}

/// What it computes from a table.
fn interpolated(fit: &Fit, segments: Segments, z: f64) -> f64 {
    let octaves = fit.shape.layout == Layout::Octaves;
    let entry = |column: usize| fit.columns[column][segments.index_of(z, octaves)];
    if fit.columns.len() == 1 {
        return entry(0);
    }
    let scale = if octaves { entry(1) } else { segments.count() as f64 };
    let u = entry(0) + scale * z;
    let head = if octaves { 2 } else { 1 };
    (head..fit.columns.len()).fold(0.0, |sum, column| entry(column) + u * sum)
}

fn grid((low, high): (f64, f64)) -> impl Iterator<Item = f64> {
    (0..POINTS).map(move |point| low + (high - low) * point as f64 / (POINTS - 1) as f64)
}

/// A function, a library's version of it, and arguments.
type Case = (Function, fn(f64) -> f64, (f64, f64));

/// All functions, with arguments as they occur in models.
fn cases() -> Vec<Case> {
    vec![
        (Function::Exp, libm::exp, (-5.0, 5.0)),
        (Function::Exp, libm::exp, (-30.0, 0.0)),
        (Function::Reciprocal, |x| 1.0 / x, (1.0, 2.0)),
        (Function::Reciprocal, |x| 1.0 / x, (0.05, 40.0)),
        (Function::Reciprocal, |x| 1.0 / x, (-3.0, -0.01)),
        (Function::Sqrt, libm::sqrt, (0.01, 9.0)),
        (Function::RealPower(-0.5), |x| 1.0 / libm::sqrt(x), (0.1, 9.0)),
        (Function::RealPower(-1.5), |x| 1.0 / (x * libm::sqrt(x)), (0.2, 4.0)),
        (Function::RealPower(0.3), |x| libm::pow(x, 0.3), (0.1, 5.0)),
        (Function::Log, libm::log, (1e-3, 10.0)),
        (Function::Sin, libm::sin, (-3.2, 3.2)),
        (Function::Cos, libm::cos, (-3.2, 3.2)),
        (Function::Tan, libm::tan, (-1.2, 1.2)),
        (Function::Asin, libm::asin, (-0.9, 0.9)),
        (Function::Acos, libm::acos, (-0.9, 0.9)),
        (Function::Atan, libm::atan, (-20.0, 20.0)),
        (Function::Sinh, libm::sinh, (-4.0, 4.0)),
        (Function::Cosh, libm::cosh, (-4.0, 4.0)),
        (Function::Tanh, libm::tanh, (-6.0, 6.0)),
        (Function::Abs, |x| if x < 0.0 { -x } else { x }, (-2.0, 3.0)),
        (Function::Floor, libm::floor, (-2.3, 3.4)),
        (Function::Floor, libm::floor, (0.0, 40.2)),
        (Function::Floor, libm::floor, (0.1, 0.9)),
        (Function::Sign, |x| if x < 0.0 { -1.0 } else { 1.0 }, (-2.0, 3.0)),
    ]
}

#[test]
fn tables_hold_their_bound_and_half_a_bit_of_their_readers() {
    for format in [WordFormat::new(32, 32, 32), WordFormat::new(32, 25, 18)] {
        for (function, library, range) in cases() {
            let scalar = scalar(apply(function, x()));
            let (segments, planned) = planned(&scalar, range, format);
            let fit = &planned.fit;
            assert!(fit.shape.excess <= 1.0, "{function:?} on {range:?}: {} times the tolerance", fit.shape.excess);
            let (mut worst, mut largest): (f64, f64) = (0.0, 0.0);
            for x in grid(range) {
                worst = worst.max((looked_up(&planned, segments, x) - library(x)).abs());
                largest = largest.max(library(x).abs());
            }
            let rounding = 64.0 * f64::EPSILON * largest;
            assert!(worst <= fit.error * 1.05 + rounding, "{function:?} on {range:?}: {worst:e} above {:e}", fit.error);
            // Half a unit of a data operand that can hold the largest value.
            let half = largest * libm::scalbn(2.0, -(format.data_bits as i32)) * 1.2;
            assert!(worst <= half, "{function:?} on {range:?}: {worst:e} above {half:e}");
        }
    }
}

#[test]
fn a_reduced_range_takes_eight_products_at_most() {
    use core::f64::consts::{FRAC_PI_2, LN_2};
    let format = WordFormat::new(32, 32, 32);
    let reduced = [
        (Function::Exp, (-LN_2 / 2.0, LN_2 / 2.0)),
        (Function::Reciprocal, (1.0, 2.0)),
        (Function::Sin, (-FRAC_PI_2, FRAC_PI_2)),
        (Function::Cos, (-FRAC_PI_2, FRAC_PI_2)),
    ];
    for (function, range) in reduced {
        let scalar = scalar(apply(function, x()));
        let (segments, planned) = planned(&scalar, range, format);
        let (products, words) = (planned.fit.shape.products(), planned.fit.shape.columns() << segments.index_bits);
        assert!(products <= 8 && words <= 1024, "{function:?}: {products} products, {words} words");
        assert!(planned.fit.error <= 0.5 * libm::exp2(-30.0), "{function:?}: {:e}", planned.fit.error);
    }
}

#[test]
fn tables_rise_and_fall_with_their_functions() {
    let format = WordFormat::new(32, 32, 32);
    for (function, library, range) in cases() {
        let rises = grid(range).zip(grid(range).skip(1)).all(|(x, next)| library(next) >= library(x));
        if !rises {
            continue;
        }
        let scalar = scalar(apply(function, x()));
        let (segments, planned) = planned(&scalar, range, format);
        let mut before = f64::NEG_INFINITY;
        for x in grid(range) {
            let value = looked_up(&planned, segments, x);
            // Of words that are rounded to a unit, none is more than a unit below the one before.
            assert!(value >= before - 2.0 * planned.fit.error, "{function:?} falls at {x}");
            before = value;
        }
    }
}

#[test]
fn a_choice_is_exact_at_its_jump_and_undefined_branches_do_no_harm() {
    let format = WordFormat::new(32, 32, 32);
    let above = Expr::sum(vec![x(), Expr::Constant(-0.3)]);
    for (condition, at_jump) in [(above.clone(), 7.0), (Expr::scaled(-2.0, above), 7.0)] {
        // A logarithm where it is taken, and 7 elsewhere, at 0.3 itself as well.
        let rising = condition.derivative(Variable::State(StateId::new(0))) == Expr::Constant(1.0);
        let distance = Expr::sum(vec![Expr::scaled(if rising { 1.0 } else { -1.0 }, x()), Expr::Constant(2.0)]);
        let yes = apply(Function::Log, distance.clone());
        let select = Select { condition, yes, no: Expr::Constant(7.0) };
        let scalar = scalar(Expr::Select(Box::new(select)));
        let (segments, planned) = planned(&scalar, (-1.5, 1.5), format);
        assert!(planned.fit.shape.excess <= 1.0, "{}", planned.fit.shape.excess);
        assert!((looked_up(&planned, segments, 0.3) - at_jump).abs() < 1e-9);
        for x in grid((-1.5, 1.5)).filter(|x| (x - 0.3).abs() > 1e-9) {
            let taken = if rising { x > 0.3 } else { x < 0.3 };
            let should = if taken { libm::log(if rising { x } else { -x } + 2.0) } else { 7.0 };
            assert!((looked_up(&planned, segments, x) - should).abs() < 1e-8, "{x}");
        }
    }
}

/// Whether a table counts octaves.
fn by_octaves(shape: &Shape) -> bool {
    shape.layout == Layout::Octaves || shape.scaling.is_some()
}

/// The division that costs least, found by asking every table of every division.
fn divided(functions: &[(&Domain, u64)], format: WordFormat) -> Segments {
    let mut best: Option<(f64, Segments)> = None;
    for segments in divisions(format) {
        let shapes: Vec<(Shape, u64)> =
            functions.iter().map(|(domain, uses)| (Shape::tried(domain, segments), *uses)).collect();
        if segments.octave_bits > 0 && !shapes.iter().any(|(shape, _)| by_octaves(shape)) {
            continue;
        }
        let products: u64 = shapes.iter().map(|(shape, uses)| uses * shape.products() as u64).sum();
        let words: usize = shapes.iter().map(|(shape, _)| shape.columns() << segments.index_bits).sum();
        let missed: f64 = shapes.iter().map(|(shape, _)| libm::log2(shape.excess)).sum();
        let cost = products as f64 * (1.0 + words as f64 / WORDS) * libm::exp2(MISSED * missed);
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, segments));
        }
    }
    best.expect("some division is tried").1
}

#[test]
fn what_is_not_tried_is_not_better() {
    let cases: Vec<(ScalarFunction, (f64, f64))> =
        cases().into_iter().map(|(function, _, range)| (scalar(apply(function, x())), range)).collect();
    for format in [WordFormat::new(32, 32, 32), WordFormat::new(32, 25, 18), WordFormat::new(24, 18, 25)] {
        let domains = cases.iter().filter_map(|(function, range)| Domain::of(function, *range, format).ok());
        let domains: Vec<Domain> = domains.collect();
        for (index, domain) in domains.iter().enumerate() {
            // Alone, and beside others that ask for something else.
            let other = &domains[(7 * index + 3) % domains.len()];
            for functions in [vec![(domain, 1)], vec![(domain, 3), (other, 1 + index as u64 % 4)]] {
                let segments = divide(&functions, Price::of(format));
                assert_eq!(
                    segments,
                    divided(&functions, format),
                    "{} and {}",
                    domain.function.name,
                    other.function.name
                );
                for (domain, _) in functions {
                    let (shape, tried) = (Shape::of(domain, segments), Shape::tried(domain, segments));
                    assert_eq!((shape.excess, shape.products()), (tried.excess, tried.products()));
                    assert_eq!(shape.map.slope, tried.map.slope);
                }
            }
        }
    }
}

#[test]
fn a_gate_rate_is_one_table_across_its_removable_singularity() {
    let moved = Expr::sum(vec![x(), Expr::Constant(40.0)]);
    let fallen = apply(Function::Exp, Expr::scaled(-0.1, moved.clone()));
    let below = Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, fallen)]);
    let rate = scalar(Expr::product(vec![moved, apply(Function::Reciprocal, below)]));
    // Also with the singularity in the middle of the range, at an end of two segments.
    for range in [(-77.0, 45.0), (-90.0, 10.0)] {
        let (segments, planned) = planned(&rate, range, WordFormat::new(32, 32, 32));
        assert!(planned.fit.shape.excess <= 1.0, "{range:?}: {}", planned.fit.shape.excess);
        for x in grid(range) {
            // u/(1 - exp(-u)) without cancellation.
            let u = 0.1 * (x + 40.0);
            let should = if u == 0.0 { 10.0 } else { -10.0 * u / libm::expm1(-u) };
            assert!((looked_up(&planned, segments, x) - should).abs() < 2e-8, "{x}");
        }
    }
}

#[test]
fn what_is_steep_beside_its_arguments_is_divided_by_octaves_from_there() {
    let moved = Expr::sum(vec![x(), Expr::Constant(0.05)]);
    for (body, library) in [
        (apply(Function::Log, moved.clone()), (|x| libm::log(x + 0.05)) as fn(f64) -> f64),
        (apply(Function::Reciprocal, Expr::scaled(-1.0, moved)), |x| -1.0 / (x + 0.05)),
    ] {
        let scalar = scalar(body);
        let (segments, planned) = planned(&scalar, (-0.045, 4.0), WordFormat::new(32, 32, 32));
        assert!(by_octaves(&planned.fit.shape) && planned.fit.shape.excess <= 1.0, "{}", scalar.name);
        for x in grid((-0.045, 4.0)) {
            assert!((looked_up(&planned, segments, x) - library(x)).abs() < 1e-7, "{} at {x}", scalar.name);
        }
    }
}

#[test]
fn a_pole_between_the_arguments_is_found() {
    let format = WordFormat::new(32, 32, 32);
    for range in [(-1.0, 2.0), (-1e-3, 1.0)] {
        let reciprocal = scalar(apply(Function::Reciprocal, x()));
        assert!(Domain::of(&reciprocal, range, format).is_err_and(|place| place.abs() < 1e-9), "{range:?}");
    }
}

#[test]
fn the_margin_of_a_table_does_not_reach_across_a_pole() {
    let moved = Expr::sum(vec![x(), Expr::Constant(3.0)]);
    let format = WordFormat::new(32, 32, 32);
    for body in [moved.clone(), Expr::power(moved, 2)] {
        let reciprocal = scalar(apply(Function::Reciprocal, body));
        // A margin of a fifth of the range would, and values beyond the pole are like those before it.
        for far in [2.0, 20.0, 37.0, 90.0, 900.0] {
            for near in [0.3, 0.03, 0.01, 0.003] {
                let domain = Domain::of(&reciprocal, (near - 3.0, far), format).expect("a bounded function");
                assert!(domain.low > -3.0, "{}: {near} to {far}: from {}", reciprocal.name, domain.low);
            }
        }
    }
}

fn use_of(function: usize, range: (f64, f64), lookups: usize) -> Use {
    let values = vec![ValueId::new(0); lookups];
    Use { function, equation: EquationId::new(0), values, range }
}

/// Numbers between 0 and 1 that are the same every time.
fn noise() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[test]
fn every_use_is_covered_by_one_table_however_ranges_lie() {
    let format = WordFormat::new(32, 32, 32);
    let bodies = [Function::Reciprocal, Function::Exp, Function::Sin, Function::Log, Function::Abs];
    let functions: Vec<ScalarFunction> = bodies.into_iter().map(|function| scalar(apply(function, x()))).collect();
    let mut noise = noise();
    for case in 0..20 {
        let uses: Vec<Use> = (0..1 + case % 9)
            .map(|_| {
                let function = (noise() * functions.len() as f64) as usize;
                // Exponentials overflow, and have their poles far away.
                let decades = if function == 1 { 2.0 } else { 9.0 };
                let low = libm::pow(10.0, decades * (noise() - 0.5));
                let (low, high) = (low, low * (1.0 + libm::pow(10.0, 5.0 * noise() - 4.0)));
                let negative = function != 3 && noise() < 0.3;
                use_of(function, if negative { (-high, -low) } else { (low, high) }, 1 + (noise() * 8.0) as usize)
            })
            .collect();
        let clusters = uses::clusters(&functions, &uses, Price::of(format)).expect("no use has a pole");
        let mut of = vec![0; uses.len()];
        for Cluster { domain, uses: members, count, .. } in &clusters {
            assert_eq!(*count, members.iter().map(|index| uses[*index].values.len() as u64).sum::<u64>());
            for index in members {
                of[*index] += 1;
                let (low, high) = uses[*index].range;
                assert!(domain.low <= low && high <= domain.high, "case {case}: {low} .. {high} is not covered");
                assert_eq!(*domain.function, functions[uses[*index].function]);
            }
        }
        assert!(of.iter().all(|count| *count == 1), "case {case}: {of:?}");
    }
}

#[test]
fn many_uses_share_few_tables() {
    let format = WordFormat::new(32, 32, 32);
    let functions = [scalar(apply(Function::Reciprocal, x())), scalar(apply(Function::Exp, x()))];
    let mut noise = noise();
    let uses: Vec<Use> = (0..100_000)
        .map(|index| {
            let middle = libm::pow(10.0, if index % 2 == 0 { 8.0 * noise() } else { 0.1 * noise() });
            use_of(index % 2, (middle * (0.5 + 0.1 * noise()), middle * (1.5 + 0.1 * noise())), 4)
        })
        .collect();
    let clusters = uses::clusters(&functions, &uses, Price::of(format)).expect("no use has a pole");
    let count = |function: usize| clusters.iter().filter(|cluster| uses[cluster.uses[0]].function == function).count();
    // Exponentials span two powers of two, reciprocals 27.
    assert!(count(1) <= 2 && (2..=33).contains(&count(0)), "{} and {} tables", count(0), count(1));
}

#[test]
fn the_use_with_a_pole_is_named_and_no_other() {
    let functions = [scalar(apply(Function::Reciprocal, x()))];
    let ranges = [(1.0, 2.0), (-1.0, 3.0), (-5.0, -4.0), (0.5, 9.0), (-2.0, 1e-3)];
    let uses: Vec<Use> = ranges.into_iter().map(|range| use_of(0, range, 1)).collect();
    let places =
        uses::clusters(&functions, &uses, Price::of(WordFormat::new(32, 32, 32))).err().expect("two uses have a pole");
    let mut named: Vec<usize> = places.iter().map(|(of, _)| *of).collect();
    named.sort_unstable();
    assert_eq!(named, [1, 4]);
    assert!(places.iter().all(|(_, at)| at.abs() < 1e-9), "{places:?}");
}
