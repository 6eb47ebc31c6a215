//! Steps of functions that differ by random constants: with shared tables they compute what they do with tables of their
//! own, and what is only close to a shape keeps its own.

use pe_ir::graph::{Factor, Role, StepGraph, ValueId};
use pe_ir::index::{ChainId, at};
use pe_ir::word::WordFormat;

use super::{Price, Shared, Tabulated, tabulate};

pub(super) const FORMAT: WordFormat = WordFormat::new(32, 32, 32);

/// Functions of a family in a step.
const MEMBERS: usize = 12;

/// Points at which steps are compared.
const POINTS: usize = 400;

/// Numbers between 0 and 1 that are the same every time.
pub(super) fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Members of families, with numbers of their own, and what is added beside.
type Make = fn(&str, &mut dyn FnMut() -> f64) -> String;

const FAMILIES: [(&str, Make); 6] = [
    ("activation", |odd, next| format!("{}*x^2/(x^2 + {}{odd})", 0.2 + next(), 0.3 + next())),
    ("repression", |odd, next| format!("{}/(1 + {}*x^4{odd})", 0.2 + next(), 0.5 + next())),
    ("saturation", |odd, next| format!("{}*x/(x + {}{odd})", 0.5 + next(), 0.4 + next())),
    ("sigmoid", |odd, next| format!("{}/(1 + exp({}*x + {}{odd}))", 0.2 + next(), -2.0 - 3.0 * next(), 1.0 + next())),
    ("exponential", |odd, next| format!("{}*exp({}*x + {}{odd})", 0.2 + next(), -0.5 - next(), next())),
    ("gate", |odd, next| {
        let (centre, slope) = (-1.0 - next(), -1.0 - next());
        // Anything beside the argument would make a pole of the singularity.
        format!("{}*(x + {centre})/(1 + -1*exp({slope}*(x + {centre}))){odd}", 0.2 + next())
    }),
];

/// A step with a state for each function, which reads it; and the arguments.
pub(super) struct Step {
    pub graph: StepGraph,
    pub arguments: Vec<(f64, f64)>,
    pub ranges: Vec<(f64, f64)>,
}

pub(super) fn step(functions: &[String], ranges: Vec<(f64, f64)>) -> Step {
    let mut text = "pe-synth step 1\nstep 0.01 form euler stages 1\n".to_owned();
    let of_each = |line: &dyn Fn(usize) -> String| (0..functions.len()).map(line).collect::<String>();
    text += &of_each(&|of| format!("state s{of} initial 1 start s{of} end s{of}.next\n"));
    text += &of_each(&|of| format!("algebraic f{of}\n"));
    text += "output s0 value s0.next\n";
    text += &of_each(&|of| format!("equation s{of}\n"));
    text += &of_each(&|of| format!("equation f{of}\n"));
    text += &of_each(&|of| {
        format!(
            "value s{of} state s{of} in s{of}\nvalue s{of}.next next s{of} in s{of}\nvalue f{of}.stage1 algebraic f{of} 1 in f{of}\n"
        )
    });
    text += &of_each(&|of| format!("function \"{of}: {0}\" state {of} = {0}\n", functions[of]));
    text += &of_each(&|of| format!("chain f{of}.stage1 = function {of} of (1*s{of})\n"));
    text += &of_each(&|of| format!("chain s{of}.next = s{of} + (-0.01*s{of} + 0.01*f{of}.stage1)\n"));
    let graph: StepGraph = text.parse().unwrap_or_else(|error| panic!("{error}\n{text}"));
    let mut arguments = vec![(f64::INFINITY, f64::NEG_INFINITY); graph.values.len()];
    for chain in &graph.chains {
        if let Some(function) = chain.function {
            arguments[chain.write.value.index()] = ranges[at(function)];
        }
    }
    Step { graph, arguments, ranges }
}

/// Arguments between 0.1 and 2 for each function.
fn narrow(functions: &[String], next: &mut dyn FnMut() -> f64) -> Step {
    step(functions, functions.iter().map(|_| (0.1 + 0.4 * next(), 1.4 + 0.6 * next())).collect())
}

/// The states at the end of a step with tables, in exact arithmetic; written from the decision record.
pub(super) fn ends(graph: &StepGraph, starts: &[f64]) -> Vec<f64> {
    let mut numbers = vec![0.0; graph.values.len()];
    for ((start, _), number) in graph.states.iter().zip(starts) {
        numbers[start.index()] = *number;
    }
    let segments = graph.functions.segments;
    let of = |numbers: &[f64], value: ValueId| match graph.value(value).role {
        Role::Constant(number) => number,
        Role::Column(lookup, column) => {
            let lookup = graph.functions.lookups[at(lookup)];
            let table = &graph.functions.tables[at(lookup.table)];
            let index = segments.index_of(numbers[lookup.argument.index()], table.octaves);
            table.columns[usize::from(column)][index]
        }
        _ => numbers[value.index()],
    };
    for chain in &graph.chains {
        let product = |term: &pe_ir::graph::Term| {
            let factor = match term.factor {
                Factor::Coefficient(coefficient) => coefficient,
                Factor::Value(factor) => of(&numbers, factor),
            };
            of(&numbers, term.operand) * factor
        };
        let sum: f64 = graph.chain_terms(chain).iter().map(product).sum();
        let base = chain.write.base.map_or(0.0, |base| of(&numbers, base));
        numbers[chain.write.value.index()] = base + libm::scalbn(sum, chain.write.weight);
    }
    graph.states.iter().map(|(_, end)| numbers[end.index()]).collect()
}

/// The largest difference between what a step with tables and its functions make of the states, over what is stated; the
/// states are powers of even numbers between the ends of their ranges.
pub(super) fn worst(step: &Step, tabled: &StepGraph, power: f64, next: &mut dyn FnMut() -> f64) -> f64 {
    let exact = &step.graph.functions.exact;
    // What each table may be wrong by, in units of the function that it stands for.
    let stated = |function: usize| {
        let of = |table: &pe_ir::functions::Table| {
            let own = (table.stands_for.is_empty() && table.name == exact[function].name).then_some(table.error);
            let shared = table.stands_for.iter().find(|of| of.name == exact[function].name);
            own.or_else(|| shared.map(|of| of.factor.abs() * table.error))
        };
        let all = tabled.functions.tables.iter().filter_map(of);
        all.reduce(f64::max).unwrap_or_else(|| panic!("no table of `{}`", exact[function].name))
    };
    let stated: Vec<f64> = (0..exact.len()).map(stated).collect();
    let mut worst = 0.0f64;
    for _ in 0..POINTS {
        let starts: Vec<f64> =
            step.ranges.iter().map(|(low, high)| low + (high - low) * libm::pow(next(), power)).collect();
        for (of, (end, start)) in ends(tabled, &starts).into_iter().zip(starts).enumerate() {
            let value = exact[of].evaluate(start);
            let should = start + 0.01 * (value - start);
            let near = exact[of].evaluate(start * (1.0 + f64::EPSILON));
            let rounding = 64.0 * (f64::EPSILON * (value.abs() + start.abs()) + (near - value).abs());
            worst = worst.max((end - should).abs() / (0.01 * stated[of] + rounding));
        }
    }
    worst
}

#[test]
fn shared_tables_compute_what_own_ones_do_within_what_is_stated() {
    for (seed, (kind, make)) in (1..).zip(FAMILIES) {
        let mut next = noise(seed);
        let functions: Vec<String> = (0..MEMBERS).map(|_| make("", &mut next)).collect();
        let step = narrow(&functions, &mut next);
        let shared = tabulate(&step.graph, &step.arguments, FORMAT, &[]).unwrap_or_else(|_| panic!("{kind}"));
        let own = Tabulated::of(&step.graph, &step.arguments, (&Shared::default(), &[]), Price::of(FORMAT));
        let own = own.unwrap_or_else(|_| panic!("{kind}")).graph;
        let counts = [&shared, &own].map(|graph| graph.functions.tables.len());
        assert!(counts[0] <= 3 && counts[1] == MEMBERS, "{kind}: {counts:?} tables");
        for graph in [&shared, &own] {
            let worst = worst(&step, graph, 1.0, &mut next);
            assert!(worst <= 1.05, "{kind}: {worst} times what {} tables state", graph.functions.tables.len());
        }
        // Every lookup says which function it is one of, and every function is covered.
        for lookup in &shared.functions.lookups {
            let of = shared.functions.shared(*lookup).unwrap_or_else(|| panic!("{kind}: a lookup of no function"));
            let (name, covered) = shared.functions.looked_up(*lookup);
            let function = step.graph.functions.exact.iter().position(|exact| exact.name == name).expect("its name");
            let range = step.ranges[function];
            let room = 1e-9 * (range.1 - range.0);
            assert!(covered.0 <= range.0 + room && range.1 <= covered.1 + room, "{kind}: {of:?} from {covered:?}");
        }
        assert_eq!(shared.scaled().len(), MEMBERS, "{kind}");
    }
}

#[test]
fn what_is_only_close_to_a_shape_keeps_its_table() {
    for (seed, (kind, make)) in (11..).zip(FAMILIES) {
        let mut next = noise(seed);
        let mut functions: Vec<String> = (0..MEMBERS).map(|_| make("", &mut next)).collect();
        functions[3] = make(" + 1e-6*x^3", &mut next);
        let step = narrow(&functions, &mut next);
        let shared = tabulate(&step.graph, &step.arguments, FORMAT, &[]).unwrap_or_else(|_| panic!("{kind}"));
        let close = &step.graph.functions.exact[3].name;
        let tables = &shared.functions.tables;
        assert!(tables.iter().any(|table| table.name == *close && table.stands_for.is_empty()), "{kind}");
        assert!(tables.iter().all(|table| table.stands_for.iter().all(|of| of.name != *close)), "{kind}");
        assert!(tables.iter().any(|table| table.stands_for.len() == MEMBERS - 1), "{kind}");
        let worst = worst(&step, &shared, 1.0, &mut next);
        assert!(worst <= 1.05, "{kind}: {worst}");
    }
}

#[test]
fn the_comparison_finds_a_wrong_factor_slope_or_entry() {
    let (kind, make) = FAMILIES[0];
    let mut next = noise(21);
    let functions: Vec<String> = (0..MEMBERS).map(|_| make("", &mut next)).collect();
    let step = narrow(&functions, &mut next);
    let shared = tabulate(&step.graph, &step.arguments, FORMAT, &[]).unwrap_or_else(|_| panic!("{kind}"));
    assert!(worst(&step, &shared, 1.0, &mut next) <= 1.05);
    let damaged = |damage: &dyn Fn(&mut StepGraph)| {
        let mut graph = shared.clone();
        damage(&mut graph);
        worst(&step, &graph, 1.0, &mut noise(22))
    };
    let chain_of = |name: &str| {
        let of = |id: ChainId| shared.value_name(shared.chains[id].write.value) == name;
        shared.chains.numbered().map(|(id, _)| id).find(|id| of(*id)).expect("a chain")
    };
    let multiply = |graph: &mut StepGraph, chain: ChainId, term: usize| {
        let place = at(graph.chains[chain].terms.start) + term;
        if let Factor::Coefficient(coefficient) = &mut graph.terms[place].factor {
            *coefficient *= 1.0 + 1e-6;
        }
    };
    let argument = shared.value_name(shared.functions.lookups[5].argument);
    type Damage<'a> = &'a dyn Fn(&mut StepGraph);
    let cases: [(&str, Damage); 3] = [
        ("factor", &|graph| multiply(graph, chain_of("s5.next"), 1)),
        ("slope", &|graph| multiply(graph, chain_of(&argument), 0)),
        ("entry", &|graph| {
            let last = graph.functions.tables[0].columns.len() - 1;
            graph.functions.tables[0].columns[last].iter_mut().for_each(|entry| *entry += 1e-7);
        }),
    ];
    for (what, damage) in cases {
        let found = damaged(damage);
        assert!(found > 2.0, "{what}: {found}");
    }
}
