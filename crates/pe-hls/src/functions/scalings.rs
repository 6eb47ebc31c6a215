//! Powers and logarithms over many octaves: one octave tells all of them, within what is stated, and of nothing else.

use pe_ir::functions::ScalarFunction;
use pe_ir::graph::StepGraph;
use pe_ir::index::ChainId;
use pe_ir::word::WordFormat;

use super::domain::Domain;
use super::families::{FORMAT, Step, ends, noise, step, worst};
use super::{Price, Shared, Tabulated};

/// Steps of functions with random numbers.
const CASES: u64 = 12;

/// Functions of a step.
const MEMBERS: usize = 6;

/// How starts crowd at the low ends of ranges: as high powers of even ones.
const CROWDED: f64 = 6.0;

/// Functions of distances from a place, with what is beside them.
const POWERS: [&str; 8] = ["1/D", "1/D^2", "D^(-1.5)", "D^(-0.3)", "sqrt(D)", "D^(0.7)", "log(D)", "0.5 + 1/D"];

/// A function, and arguments over many octaves.
fn member(next: &mut impl FnMut() -> f64) -> (String, (f64, f64)) {
    let power = POWERS[(next() * POWERS.len() as f64) as usize];
    let (place, factor) = (libm::round(8.0 * next() - 4.0) / 4.0, 0.2 + next());
    let near = libm::pow(10.0, 3.0 * next() - 3.0);
    let far = near * libm::pow(10.0, 1.5 + 3.0 * next());
    // Arguments on either side of the place.
    let (distance, range) = match next() < 0.3 {
        true => (format!("({place} + -1*x)"), (place - far, place - near)),
        false => (format!("(x + {})", -place), (place + near, place + far)),
    };
    (format!("{factor}*({})", power.replace('D', &distance)), range)
}

fn members(seed: u64) -> Step {
    let mut next = noise(seed);
    let (functions, ranges): (Vec<String>, Vec<(f64, f64)>) = (0..MEMBERS).map(|_| member(&mut next)).unzip();
    step(&functions, ranges)
}

fn tabled(step: &Step) -> StepGraph {
    let own = Tabulated::of(&step.graph, &step.arguments, (&Shared::default(), &[]), Price::of(FORMAT));
    own.unwrap_or_else(|_| panic!("functions without tables")).graph
}

/// The tables that tell octaves apart.
fn scales(graph: &StepGraph) -> usize {
    graph.functions.tables.iter().filter(|table| table.name.ends_with(": scales")).count()
}

fn scaling(function: &ScalarFunction, range: (f64, f64)) -> bool {
    Domain::of(function, range, FORMAT).is_ok_and(|domain| domain.scaling.is_some())
}

#[test]
fn one_octave_computes_all_of_them_within_what_is_stated() {
    let (mut by_octave, mut words) = (0, 0);
    for seed in 1..=CASES {
        let step = members(seed);
        for (function, range) in step.graph.functions.exact.iter().zip(&step.ranges) {
            assert!(scaling(function, *range), "{} over {range:?}", function.name);
        }
        let graph = tabled(&step);
        by_octave += scales(&graph);
        words += graph.functions.tables.iter().map(|table| table.columns.len()).sum::<usize>()
            << graph.functions.segments.index_bits;
        let worst = worst(&step, &graph, CROWDED, &mut noise(seed));
        assert!(worst <= 1.05, "{seed}: {worst} times what is stated");
    }
    let count = CASES as usize * MEMBERS;
    assert!(2 * by_octave > count, "{by_octave} of {count} functions by one octave");
    assert!(words < 600 * count, "{words} words for {count} functions");
}

#[test]
fn what_only_resembles_them_is_none() {
    for (place, near, far) in [(0.0, 0.5, 50.0), (-0.25, 0.5, 50.0), (-3.0, 0.01, 40.0)] {
        let of = |beside: &str| {
            let distance = format!("(x + {})", -place);
            let of = |power: &&str| format!("0.7*({}){beside}", power.replace('D', &distance));
            let functions: Vec<String> = POWERS.iter().map(of).collect();
            step(&functions, vec![(place + near, place + far); POWERS.len()])
        };
        for (beside, is) in [("", true), (" + 0.000001*x^2", false), (" + 0.0001*sin(x)", false)] {
            let step = of(beside);
            for (function, range) in step.graph.functions.exact.iter().zip(&step.ranges) {
                assert_eq!(scaling(function, *range), is, "{} over {range:?}", function.name);
            }
        }
    }
    // Nor what reaches its place, or is narrow.
    let step = step(&["1/(x + 1)".to_owned()], vec![(1.0, 2.0)]);
    let reciprocal = &step.graph.functions.exact[0];
    for (range, is) in [((-1.0, 5.0), false), ((-3.0, 5.0), false), ((0.0, 1.5), false), ((0.0, 15.0), true)] {
        assert_eq!(scaling(reciprocal, range), is, "{range:?}");
    }
    // Scales of more octaves than a coefficient has bits are none.
    let narrow = WordFormat::new(32, 25, 18);
    for (far, is) in [(20.0, true), (1e3, false)] {
        assert_eq!(
            Domain::of(reciprocal, (0.0, far), narrow).is_ok_and(|domain| domain.scaling.is_some()),
            is,
            "{far}"
        );
    }
}

#[test]
fn the_comparison_finds_wrong_scales_powers_and_entries() {
    let functions = ["1/(x + 1)", "sqrt(x + 1)", "log(x + 1)"].map(str::to_owned);
    let step = step(&functions, vec![(-0.99, 900.0); 3]);
    let graph = tabled(&step);
    assert_eq!(scales(&graph), 3, "{:?}", graph.functions.tables.iter().map(|table| &table.name).collect::<Vec<_>>());
    assert!(worst(&step, &graph, CROWDED, &mut noise(31)) <= 1.05);
    for (index, table) in graph.functions.tables.iter().enumerate() {
        let mut damaged = graph.clone();
        let last = damaged.functions.tables[index].columns.last_mut().expect("a column");
        // A reciprocal is the same by any scale that leaves its place in the octave.
        let is_scale = table.name.ends_with(": scales");
        last.iter_mut().for_each(|entry| *entry += if is_scale { 0.5 * *entry } else { 1e-6 });
        let found = worst(&step, &damaged, CROWDED, &mut noise(31));
        assert!(found > 2.0, "{}: {found}", table.name);
    }
}

/// A step of `b`, which falls, and of `q`, which reads `a` over a power of it.
fn quotient(power: &str, reading: &str) -> Step {
    let text = format!(
        "pe-synth step 1\nstep 0.01 form euler stages 1\n\
         state a initial 1 start a end a.next\nstate b initial 1 start b end b.next\nstate q initial 0 start q end q.next\n\
         algebraic f\noutput q value q.next\nequation a\nequation b\nequation q\nequation f\n\
         value a state a in a\nvalue a.next next a in a\nvalue b state b in b\nvalue b.next next b in b\n\
         value q state q in q\nvalue q.next next q in q\nvalue f.stage1 algebraic f 1 in f\n\
         value q.factor1 inner q 1 in q factor\n\
         function \"{power}\" state 1 = {power}\nchain f.stage1 = function 0 of (1*b)\n\
         chain a.next = a + (-0.01*a)\nchain b.next = b + (-0.01*b)\n\
         chain q.factor1 = 2^-1*(3*f.stage1)\nchain q.next = q + ({reading})\n"
    );
    let graph: StepGraph = text.parse().unwrap_or_else(|error| panic!("{error}\n{text}"));
    let mut arguments = vec![(f64::INFINITY, f64::NEG_INFINITY); graph.values.len()];
    arguments[graph.chains[ChainId::new(0)].write.value.index()] = (0.02, 900.0);
    Step { graph, arguments, ranges: vec![(0.02, 900.0)] }
}

#[test]
fn quotients_are_shifted_before_they_are_multiplied() {
    for power in ["1/x", "1/x^2", "x^(-0.3)"] {
        // Products alone; with another reader; with what only sums read.
        for (reading, is_quotient) in [
            ("q.factor1*a", true),
            ("q.factor1*a - 0.5*q + q.factor1*b", true),
            ("q.factor1*a + 0.1*f.stage1", false),
            ("q.factor1*a + q.factor1*b + q.factor1*q", false),
        ] {
            let step = quotient(power, reading);
            let graph = tabled(&step);
            let is = graph.functions.tables.iter().any(|table| table.name.ends_with(": one octave"));
            assert_eq!(is, is_quotient, "{power}, {reading}");
            let written = graph.chains.iter().any(|chain| graph.value_name(chain.write.value) == "f.stage1");
            assert_eq!(written, !is_quotient, "{power}, {reading}");
            let function = &step.graph.functions.exact[0];
            for b in [0.02, 0.3, 1.0, 17.0, 256.0, 900.0] {
                let starts = [0.7 * b, b, 0.1];
                let f = function.evaluate(b);
                let rate = 1.5 * f * starts[0]
                    + match reading {
                        "q.factor1*a - 0.5*q + q.factor1*b" => -0.5 * starts[2] + 1.5 * f * b,
                        "q.factor1*a + 0.1*f.stage1" => 0.1 * f,
                        "q.factor1*a + q.factor1*b + q.factor1*q" => 1.5 * f * (b + starts[2]),
                        _ => 0.0,
                    };
                // The table is as good for small values of the function as for large ones.
                let room = if is_quotient { 1e-8 * rate.abs() } else { 1e-8 * function.evaluate(0.02) };
                let end = ends(&graph, &starts)[2];
                assert!(
                    (end - starts[2] - rate).abs() <= room,
                    "{power}, {reading}, {b}: {end} of {}",
                    starts[2] + rate
                );
            }
        }
    }
}

#[test]
fn what_is_kept_is_computed_itself() {
    let step = quotient("1/x", "q.factor1*a");
    let kept = step.graph.chains[ChainId::new(0)].write.value;
    let graph = Tabulated::of(&step.graph, &step.arguments, (&Shared::default(), &[kept]), Price::of(FORMAT));
    let graph = graph.unwrap_or_else(|_| panic!("a function without a table")).graph;
    assert!(graph.chains.iter().any(|chain| chain.write.value == kept));
}
