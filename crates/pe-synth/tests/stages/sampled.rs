//! Models with sampled parts: against the library's solution, bit for bit through all stages, and at rest.

use crate::support::agree::{ENGINES, engines};
use crate::support::bench::assert_lively_agreement;
use crate::support::flow::{Flow, Placement, format};
use pe_frontend::{NoFiles, Overrides};
use pe_hls::formats::{self, Ranges};
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StageForm, StepGraph, ValueId};
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_ir::program::Program;
use pe_ir::source::Sources;
use pe_ir::word::WordFormat;
use pe_judge::default_ports;
use pe_judge::feedback::Feedback;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::reference;
use pe_verify::engines::Engine;

/// Part of the words that changes at least: held ones do not, and a filter sees steps only.
const HELD: f64 = 0.4;

/// A motor with a controller that samples every `PERIOD`.
const MOTOR: &str = "
input r = square(1, 3)
state w = 0.2
state c = 0.1
w' = 5*c - 2*w
c' = 2*u - 3*c - w
every PERIOD {
  state s = 0.3
  e = r - w
  u = 4*e + s
  next s = s + 0.4*e
}
output w, c, u, e
";

/// Two rates that read each other, states that read one another in a circle, and a continuous equation between them.
const RATES: &str = "
index i in 1..2, j in 1..2
param A[i, j] = [0.7, 0.4; -0.4, 0.7]
state x = 0.5
x' = 2*load - x
load = slow + x/4
every FAST {
  state m[i] = [0.6, -0.2]
  fast = m[1] - x
  next m = A*m
}
every SLOW {
  state n = 0.5
  slow = n + fast/2
  next n = 0.6*n - 0.1*fast*x
}
output x, load, fast, m
";

/// An observer whose states all read each other beside a chain of stages that are alike, with a shared sampled sum.
const OBSERVER: &str = "
index i in 1..3, j in 1..3
param A[i, j] = [0.7, 0.2, 0.1; -0.2, 0.6, 0.3; 0.1, -0.3, 0.5]
state x[i] = i
x[i]' = -x[i] + 0.5*(if i < 3 then x[i + 1] else u[1])
every PERIOD {
  state m[i] = 0.1*i
  total = sum(i: m[i]) + x[1] - x[2]
  u[i] = 0.3*m[i] - 0.1*total
  next m[i] = sum(j: A[i, j]*m[j]) + 0.1*x[i] - 0.2*total
}
output x, u
";

/// A filter and nothing else.
const FILTER: &str = "
input x = square(1, 2)
every PERIOD {
  state m1 = 0.3
  state m2 = -0.1
  y = 0.2*x + m1
  next m1 = 0.1*x + 1.6*y + m2
  next m2 = 0.05*x - 0.7*y
}
level = y + 1
output y, level, x
";

fn compiled(body: &str, solver: Solver, step: &str) -> Model {
    let text = format!("model m \"test\"\nsolver {}\nstep {step}\nspan 1 s\n{body}", solver.name());
    let mut sources = Sources::new("m.spec", &text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    pe_hls::lift::lift(compiled.unwrap_or_else(|findings| panic!("{findings:?}")).0)
}

fn motor(period: &str, solver: Solver) -> Model {
    compiled(&MOTOR.replace("PERIOD", period), solver, "10 ms")
}

fn rates(fast: &str, slow: &str, solver: Solver) -> Model {
    compiled(&RATES.replace("FAST", fast).replace("SLOW", slow), solver, "10 ms")
}

fn observer(period: &str, solver: Solver) -> Model {
    compiled(&OBSERVER.replace("PERIOD", period), solver, "10 ms")
}

fn filter(period: &str) -> Model {
    compiled(&FILTER.replace("PERIOD", period), Solver::Rk4, "10 ms")
}

/// Largest difference of a run in double precision from the library's solution, and from half the step.
fn errors(model: &Model) -> (f64, f64) {
    let times: Vec<f64> = (1..=model.steps()).map(|step| model.time(step, 0.0)).collect();
    let reference = reference::solve(model, &times, 1e-12, &mut |_| {}).expect("smooth between samples");
    let difference = |model: &Model, each: u64| {
        let graph = pe_hls::step::build(model).unwrap_or_else(|findings| panic!("{findings:?}"));
        let mut run = DoubleRun::new(&graph);
        let (states, mut worst) = (model.states.len(), 0.0f64);
        for step in 0..model.steps() {
            run.step(&model.sample_inputs(model.time(step, 0.0))).expect("finite");
            if (step + 1).is_multiple_of(each) {
                let row = ((step + 1) / each - 1) as usize * states;
                let of = |state: usize| (run.state(StateId::at(state)) - reference.samples[row + state]).abs();
                worst = (0..states).map(of).fold(worst, f64::max);
            }
        }
        worst
    };
    (difference(model, 1), difference(&Model { step: model.step / 2.0, ..model.clone() }, 2))
}

#[test]
fn samples_are_taken_when_the_reference_takes_them() {
    let cases = [
        (motor("10 ms", Solver::Rk4), 16.0),
        (motor("30 ms", Solver::Rk4), 16.0),
        (motor("30 ms", Solver::Rodas3), 8.0),
        (motor("50 ms", Solver::Heun), 4.0),
        (motor("50 ms", Solver::Trapezoidal), 4.0),
        (motor("50 ms", Solver::Rkc5), 4.0),
        (observer("10 ms", Solver::Rk4), 16.0),
        (observer("20 ms", Solver::Heun3), 8.0),
        (rates("10 ms", "30 ms", Solver::Rk4), 16.0),
        (rates("20 ms", "50 ms", Solver::Heun3), 8.0),
        (rates("20 ms", "50 ms", Solver::ImplicitEuler), 2.0),
        (rates("20 ms", "50 ms", Solver::Euler), 2.0),
    ];
    for (model, gain) in cases {
        let (error, halved) = errors(&model);
        // Samples at other times would be an error that no smaller step makes smaller.
        assert!(error < 0.02, "{}: {error}", model.solver.name());
        assert!((0.7..1.6).contains(&(error / halved / gain)), "{}: {error}, {halved}", model.solver.name());
    }
    // What is only sampled has no error but rounding.
    for period in ["10 ms", "40 ms"] {
        let (error, halved) = errors(&filter(period));
        assert!(error < 1e-12 && halved < 1e-12, "{period}: {error}, {halved}");
    }
}

/// The states in the middle of the run, in double precision and in fixed point.
fn ends(flow: &Flow) -> (Vec<f64>, Vec<f64>) {
    let mut run = DoubleRun::new(&flow.graph);
    for step in 0..25 {
        run.step(&flow.model.sample_inputs(flow.model.time(step, 0.0))).expect("finite");
    }
    let fixed = flow.fixed_run(25);
    let states = 0..flow.model.states.len();
    (
        states.clone().map(|state| run.state(StateId::at(state))).collect(),
        states.map(|state| fixed.state(StateId::at(state))).collect(),
    )
}

/// A model on a number of PEs with words of a storage and two ports, in engines.
type Sampled = (Model, u32, (u32, u32, u32), &'static [Engine]);

fn assert_sampled(what: &str, designs: impl IntoIterator<Item = Sampled>) {
    for (number, (model, pes, (storage, data, coefficient), engines)) in (1..).zip(designs) {
        let label = format!("{what} {number}, {}", model.solver.name());
        let widths = format(storage, data, coefficient);
        let flow = Flow::of(label, model, pes, widths, Placement::Annealed);
        assert_lively_agreement(&flow.label, &flow.starts(20), engines, HELD);
        let text = flow.program.to_string();
        assert_eq!(
            text.parse::<Program>().map(|program| program.to_string()).ok().as_ref(),
            Some(&text),
            "{}",
            flow.label
        );
        // Ticks are made in the network.
        assert_eq!(flow.program.ports().count(), flow.model.inputs.len(), "{}", flow.label);
        assert_eq!(flow.program.ticks().count(), flow.model.ticks().count(), "{}", flow.label);
        assert!(flow.looped().is_none(), "{}: samples are no stage", flow.label);
        let (exact, rounded) = ends(&flow);
        let tolerance = libm::scalbn(1.0, 8 - data.min(coefficient) as i32);
        for (exact, rounded) in exact.iter().zip(&rounded) {
            let difference = (exact - rounded).abs();
            assert!(difference < tolerance, "{}: {exact} and {rounded}", flow.label);
        }
    }
}

#[test]
fn controlled_motors_agree_bit_for_bit() {
    assert_sampled(
        "motor",
        [
            (motor("10 ms", Solver::Rk4), 2, (32, 32, 32), ENGINES),
            (motor("30 ms", Solver::Rk4), 3, (32, 25, 18), engines(true)),
            (motor("30 ms", Solver::Trapezoidal), 2, (32, 32, 32), ENGINES),
        ],
    );
}

#[test]
fn parts_with_several_rates_agree_bit_for_bit() {
    assert_sampled(
        "rates",
        [
            (rates("10 ms", "30 ms", Solver::Rk4), 3, (32, 32, 32), ENGINES),
            (rates("20 ms", "50 ms", Solver::Euler), 2, (32, 25, 18), ENGINES),
            (rates("10 ms", "20 ms", Solver::Rodas3), 3, (32, 32, 32), ENGINES),
        ],
    );
}

#[test]
fn observers_and_filters_agree_bit_for_bit() {
    assert_sampled(
        "observer",
        [
            (observer("10 ms", Solver::Rk4), 3, (32, 32, 32), ENGINES),
            (observer("20 ms", Solver::Heun), 2, (32, 25, 18), engines(false)),
            (observer("20 ms", Solver::Rk4), 3, (32, 32, 32), ENGINES),
            (observer("10 ms", Solver::Euler), 2, (32, 32, 32), ENGINES),
            (filter("10 ms"), 2, (32, 32, 32), ENGINES),
            (filter("20 ms"), 1, (24, 18, 18), ENGINES),
        ],
    );
}

/// What a part that is sampled in every step costs: no input, and no product for holding.
#[test]
fn a_sample_in_every_step_needs_no_tick() {
    let every = pe_hls::step::build(&motor("10 ms", Solver::Rk4)).expect("builds");
    assert_eq!(every.inputs.len(), 1);
    let third = pe_hls::step::build(&motor("30 ms", Solver::Rk4)).expect("builds");
    assert_eq!(third.inputs.len(), 2);
    assert_eq!(third.names.inputs[1], "tick_1");
    assert_eq!(every.form, third.form);
    assert!(every.macs() < third.macs());
    let alone = pe_hls::step::build(&filter("10 ms")).expect("builds");
    assert_eq!((alone.stages, alone.inputs.len()), (1, 1));
    assert!([StageForm::Method, StageForm::Euler].contains(&alone.form));
}

/// A filter is the same with a tick, word for word, as where it is sampled in every step.
#[test]
fn ticks_lose_nothing_of_coupled_states() {
    let (every, second) = (filter("10 ms"), filter("20 ms"));
    let every = Model { step: 0.02, ..every };
    let every = Model { rates: second.rates.clone(), ..every };
    let words = |model: &Model, held: u64| {
        let flow = Flow::of("filter".to_owned(), model.clone(), 1, format(32, 32, 32), Placement::Annealed);
        let run = flow.fixed_run(20 * held);
        (0..2).map(|state| run.word(flow.graph.states[StateId::new(state)].0)).collect::<Vec<i64>>()
    };
    assert_eq!(words(&every, 1), words(&second, 2));
}

#[test]
fn a_period_of_more_steps_than_a_tick_counts_is_refused() {
    let model = Model { step: 4e-12, ..motor("10 ms", Solver::Rk4) };
    let findings = pe_hls::step::build(&model).expect_err("too many steps");
    assert_eq!(findings[0].code, codes::UNSUITABLE_PERIOD);
    assert!(findings[0].message.contains("2500000000 steps"), "{}", findings[0].message);
}

#[test]
fn a_period_that_is_no_whole_number_of_steps_is_refused_with_a_step_that_suits() {
    let refused = |model: &Model| {
        let findings = pe_hls::step::build(model).expect_err("the period does not suit");
        assert_eq!(findings[0].code, codes::UNSUITABLE_PERIOD);
        assert!(findings[0].span.is_some());
        findings[0].help.clone().expect("a help")
    };
    let help = refused(&motor("25 ms", Solver::Rk4));
    assert!(help.contains("--step 8.333333333333333e-3"), "{help}");
    let help = refused(&motor("4 ms", Solver::Rk4));
    assert!(help.contains("--step 4e-3"), "{help}");
    let help = refused(&rates("15 ms", "25 ms", Solver::Rk4));
    assert!(help.contains("--step 5e-3"), "{help}");
}

/// Chebyshev II low passes as sections of second order in the transposed direct form II, from
/// `scipy.signal.cheby2(order, 40, edge, output='sos')`: order, edge, and b0, b1, b2, a1, a2 of each section.
const FILTERS: [(u32, f64, &[[f64; 5]]); 6] = [
    (
        4,
        0.01,
        &[
            [0.00980927596766147, -0.01955254378006285, 0.009809275967661468, -1.9684898061374367, 0.9687934819787093],
            [1.0, -1.9988438479582429, 0.9999999999999998, -1.9890517019121536, 0.9893030075911196],
        ],
    ),
    (
        4,
        0.05,
        &[
            [
                0.009439484786959934,
                -0.017346800786644908,
                0.009439484786959933,
                -1.8459566061116937,
                0.8531174418302048,
            ],
            [1.0, -1.9711824239411322, 0.9999999999999999, -1.9414461220308026, 0.9476120769972293],
        ],
    ),
    (
        4,
        0.2,
        &[
            [
                0.012483820797182145,
                -0.0040493800263648435,
                0.012483820797182148,
                -1.4211631127606117,
                0.5181470650753173,
            ],
            [1.0, -1.5597125423334535, 1.0000000000000004, -1.7096009567288524, 0.8045656182503007],
        ],
    ),
    (
        6,
        0.01,
        &[
            [
                0.009579555861715416,
                -0.019018465814682313,
                0.009579555861715418,
                -1.9439161140102836,
                0.9448115443866085,
            ],
            [1.0, -1.998026728308157, 0.9999999999999998, -1.970191803238363, 0.970838138137578],
            [1.0, -1.9989422847239102, 0.9999999999999999, -1.991116290996314, 0.9916235074533375],
        ],
    ),
    (
        6,
        0.05,
        &[
            [0.008781256300052833, -0.014589579863804594, 0.008781256300052834, -1.7321229438466343, 0.752260526896856],
            [1.0, -1.9510546615487845, 1.0, -1.8472081767622774, 0.8624782873772977],
            [1.0, -1.973620465368142, 1.0, -1.9463686109306342, 0.9588514686781877],
        ],
    ),
    (
        6,
        0.2,
        &[
            [0.013115394983099255, 0.005865367430038797, 0.013115394983099259, -1.069654791252934, 0.3034180444442494],
            [1.0, -1.3026581944826425, 0.9999999999999999, -1.3512617358448233, 0.5551770955462603],
            [1.0, -1.593397720677305, 1.0, -1.6566468384753021, 0.8475628573300946],
        ],
    ),
];

fn filter_of(sections: &[[f64; 5]], step: &str) -> Model {
    let count = sections.len();
    let mut body = format!("input x = pulse(1, 0, 0.05)\nindex s in 1..{count}\n");
    for (column, name) in ["b0", "b1", "b2", "a1", "a2"].iter().enumerate() {
        let cells: Vec<String> = sections.iter().map(|section| format!("{}", section[column])).collect();
        body += &format!("param {name}[s] = [{}]\n", cells.join(", "));
    }
    body += "every 100 us {
  state m1[s] = 0
  state m2[s] = 0
  feed[s] = if s == 1 then x else y[s - 1]
  y[s] = b0[s]*feed[s] + m1[s]
  next m1[s] = b1[s]*feed[s] - a1[s]*y[s] + m2[s]
  next m2[s] = b2[s]*feed[s] - a2[s]*y[s]
}\n";
    body += &format!("output y[{count}]\n");
    compiled(&body, Solver::Euler, step)
}

/// The word that a filter gets unless the user says otherwise.
fn word_of(model: &Model) -> WordFormat {
    let ports = default_ports(model, 32);
    let feedback = Feedback::of(model).expect("a filter");
    assert!(feedback.rings && feedback.is_stable());
    WordFormat::with_ports(32, ports).with_hidden(feedback.hidden_bits)
}

/// Formats for the filter's pulse.
fn formats_of(model: &Model, graph: &StepGraph, word: WordFormat) -> (FixedPoint, Vec<f64>) {
    let mut run = DoubleRun::new(graph);
    for step in 0..model.steps() {
        run.step(&model.sample_inputs(model.time(step, 0.0))).expect("a stable filter");
    }
    let ranges = Ranges { largest: run.largest(), widened: vec![0; graph.values.len()] };
    let largest = graph.states.iter().map(|(state, _)| ranges.largest[state.index()]).collect();
    (formats::choose(graph, &ranges, word).expect("formats"), largest)
}

/// Largest magnitudes of the output and of all states in storage LSB while a run without input is watched, long after it
/// began; none if it saturated.
fn rest(model: &Model, mut run: FixedRun, graph: &StepGraph, fixed: &FixedPoint, quiet: u64) -> Option<(f64, f64)> {
    let lsb = |value: ValueId, number: f64| {
        let exponent = fixed.exponents[value.index()] + fixed.format.guard_bits as i32;
        libm::floor(libm::scalbn(number, -exponent) + 0.5).abs()
    };
    let (mut output, mut states) = (0.0f64, 0.0f64);
    for step in 0..quiet + 1000 {
        let ticks = model.ticks().map(|(_, steps)| f64::from(u8::from(step.is_multiple_of(steps))));
        let numbers = [0.0].into_iter().chain(ticks).enumerate();
        let words: Vec<i64> = numbers.map(|(index, number)| run.encode_input(index, number).0).collect();
        run.step(&words);
        if step >= quiet {
            output = output.max(lsb(graph.outputs[0], run.output(0)));
            for (index, (state, _)) in graph.states.iter().enumerate() {
                states = states.max(lsb(*state, run.state(StateId::at(index))));
            }
        }
    }
    (run.saturations().iter().sum::<u64>() == 0).then_some((output, states))
}

/// Numbers from -1 to 1 (xorshift).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[test]
fn stable_filters_come_to_rest_at_zero() {
    const STATES: usize = 40;
    let mut random = Random(12345);
    for (order, edge, sections) in FILTERS {
        let slowest = sections.iter().map(|section| section[4].sqrt()).fold(0.0, f64::max);
        for (step, held) in [("100 us", 1), ("50 us", 2)] {
            let model = filter_of(sections, step);
            let graph = pe_hls::step::build(&model).expect("builds");
            let (fixed, largest) = formats_of(&model, &graph, word_of(&model));
            let quiet = held * ((60.0 / (1.0 - slowest)) as u64 + 500);
            let mut worst = (0.0f64, 0.0f64);
            let mut tried = 0;
            for number in 0..STATES {
                let mut run = FixedRun::new(&graph, &fixed);
                match number % 4 {
                    // The end of a pulse of some height and length.
                    0 => {
                        let length = held * (100.0 + 900.0 * random.next().abs()) as u64;
                        let height = random.next();
                        for step in 0..length {
                            let ticks = model.ticks().map(|(_, steps)| f64::from(u8::from(step.is_multiple_of(steps))));
                            let numbers = [height].into_iter().chain(ticks).enumerate();
                            let words: Vec<i64> = numbers.map(|(index, n)| run.encode_input(index, n).0).collect();
                            run.step(&words);
                        }
                    }
                    // Any state, from some LSB to where the next section nearly saturates.
                    _ => {
                        let scale = libm::exp2(8.0 * random.next() - 20.0);
                        let states = largest.iter().enumerate();
                        states.for_each(|(index, largest)| {
                            run.set_state(StateId::at(index), scale * largest * random.next())
                        });
                    }
                }
                if let Some((output, states)) = rest(&model, run, &graph, &fixed, quiet) {
                    worst = (worst.0.max(output), worst.1.max(states));
                    tried += 1;
                }
            }
            let label = format!("order {order}, edge {edge}, step {step}: {worst:?} of {tried}, {:?}", fixed.format);
            println!("{label}");
            assert!(tried > STATES * 3 / 4 && worst.0 == 0.0 && worst.1 <= 1.0, "{label}");
        }
    }
}

/// What guard bits and ports of the multiplier do.
#[test]
fn short_words_hold_a_slow_filter_away_from_zero() {
    let (_, _, sections) = FILTERS[0];
    let model = filter_of(sections, "100 us");
    let graph = pe_hls::step::build(&model).expect("builds");
    let held = |word: WordFormat| {
        let (fixed, largest) = formats_of(&model, &graph, word);
        let mut random = Random(1);
        let mut worst = 0.0f64;
        for _ in 0..20 {
            let mut run = FixedRun::new(&graph, &fixed);
            for (index, largest) in largest.iter().enumerate() {
                run.set_state(StateId::at(index), 1e-6 * largest * random.next());
            }
            worst = worst.max(rest(&model, run, &graph, &fixed, 12_000).expect("no saturation").0);
        }
        worst
    };
    let (eight, own) = (held(WordFormat::new(32, 32, 32)), held(word_of(&model)));
    assert!((2.0..=16.0).contains(&eight), "{eight}");
    assert_eq!(own, 0.0);
}
