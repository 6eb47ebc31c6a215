//! The paper's four models against versions of them that were written independently, in plain loops.
//!
//! Nothing here shares code or formulas with the specs: parameters, initial values and right-hand sides are typed anew
//! from the equations (Huang, Vahid, Givargis 2013, doi 10.1145/2514641.2514650, and the `README.md` of each model).

#![allow(clippy::disallowed_methods, reason = "the tests' own numbers may come from the standard library")]

use pe_frontend::NoFiles;
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Model, Solver, Variable};
use pe_ir::source::Sources;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

/// Specs with the equations of the paper's four models, full size and small.
const PAPER: [&str; 8] = ["weibel11", "weibel5", "lutchen4000", "lutchen20", "wave80", "wave6", "atrial15", "atrial3"];

/// Reads and compiles `models/NAME/NAME.spec`.
fn load(name: &str) -> Model {
    let path = format!("{}/../../models/{name}/{name}.spec", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    let mut sources = Sources::new(format!("{name}.spec"), &text);
    match pe_frontend::compile(&mut sources, &NoFiles, &pe_frontend::Overrides::default()) {
        Ok((model, warnings)) if warnings.is_empty() => model,
        Ok((_, findings)) | Err(findings) => {
            panic!("{}", findings.iter().map(|f| format!("{f}\n")).collect::<String>())
        }
    }
}

/// A value and the sum of the absolute values of the terms that made it.
///
/// A difference of large terms has a rounding error of their size, so that size is what differences are measured by.
#[derive(Clone, Copy)]
struct Weighed {
    value: f64,
    size: f64,
}

/// Evaluates an expression over the given values of the variables.
fn eval(expr: &Expr, states: &[f64], inputs: &[f64], algebraics: &[Weighed]) -> Weighed {
    let exact = |value: f64| Weighed { value, size: value.abs() };
    match expr {
        Expr::Constant(value) => exact(*value),
        Expr::Variable(Variable::State(i)) => exact(states[i.index()]),
        Expr::Variable(Variable::Input(i)) => exact(inputs[*i as usize]),
        Expr::Variable(Variable::Algebraic(i)) => algebraics[*i as usize],
        Expr::Sum(terms) => terms.iter().fold(Weighed { value: 0.0, size: 0.0 }, |sum, term| {
            let term = eval(term, states, inputs, algebraics);
            Weighed { value: sum.value + term.value, size: sum.size + term.size }
        }),
        Expr::Product(factors) => factors.iter().fold(Weighed { value: 1.0, size: 1.0 }, |product, factor| {
            let factor = eval(factor, states, inputs, algebraics);
            Weighed { value: product.value * factor.value, size: product.size * factor.size }
        }),
        Expr::Power(base, exponent) => {
            let base = eval(base, states, inputs, algebraics);
            Weighed { value: base.value.powi(*exponent as i32), size: base.size.powi(*exponent as i32) }
        }
        Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => unreachable!("the paper's models are polynomials"),
    }
}

/// All derivatives of a model.
fn derivatives(model: &Model, states: &[f64], inputs: &[f64]) -> Vec<Weighed> {
    let mut algebraics = Vec::with_capacity(model.algebraics.len());
    for algebraic in &model.algebraics {
        let value = eval(&algebraic.expr, states, inputs, &algebraics);
        algebraics.push(value);
    }
    model.states.iter().map(|state| eval(&state.derivative, states, inputs, &algebraics)).collect()
}

/// All derivatives of a model, as plain numbers.
fn slope(model: &Model, states: &[f64], inputs: &[f64]) -> Vec<f64> {
    derivatives(model, states, inputs).iter().map(|weighed| weighed.value).collect()
}

/// `y + h * k`, element by element.
fn moved(y: &[f64], h: f64, k: &[f64]) -> Vec<f64> {
    y.iter().zip(k).map(|(y, k)| y + h * k).collect()
}

/// Smallest and largest value of every state over the first `steps` steps, inputs sampled once per step.
fn extremes(model: &Model, steps: u64) -> Vec<(f64, f64)> {
    let h = model.step;
    let mut y: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let mut extremes: Vec<(f64, f64)> = y.iter().map(|y| (*y, *y)).collect();
    for step in 0..steps {
        let inputs: Vec<f64> = model.inputs.iter().map(|input| input.waveform.at(step as f64 * h)).collect();
        let k1 = slope(model, &y, &inputs);
        y = match model.solver {
            Solver::Euler => moved(&y, h, &k1),
            Solver::Rk4 => {
                let k2 = slope(model, &moved(&y, h / 2.0, &k1), &inputs);
                let k3 = slope(model, &moved(&y, h / 2.0, &k2), &inputs);
                let k4 = slope(model, &moved(&y, h, &k3), &inputs);
                let sum: Vec<f64> = (0..y.len()).map(|i| k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]).collect();
                moved(&y, h / 6.0, &sum)
            }
            other => panic!("no model of the paper uses {other:?}"),
        };
        for (y, (low, high)) in y.iter().zip(&mut extremes) {
            assert!(y.is_finite(), "{}: not finite after step {step}", model.name);
            (*low, *high) = (low.min(*y), high.max(*y));
        }
    }
    extremes
}

/// Every state must travel by more than 2^10 units of a 32-bit word that is scaled to its own largest value.
fn assert_every_state_moves(model: &Model, steps: u64) {
    for (state, (low, high)) in model.states.iter().zip(extremes(model, steps)) {
        let largest = low.abs().max(high.abs());
        let lsb = largest * f64::powi(2.0, -31);
        assert!(high - low > 1024.0 * lsb, "{}: {} stays within {low} .. {high}", model.name, state.name);
    }
}

/// Random numbers without a dependency: splitmix64.
struct Random(u64);

impl Random {
    /// Uniform between `low` and `high`.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        low + (high - low) * ((z >> 11) as f64 / (1u64 << 53) as f64)
    }
}

/// A right-hand side over plain slices of states and inputs.
type RightHandSide = Box<dyn Fn(&[f64], &[f64]) -> Vec<f64>>;

/// A model written by hand: names and initial values of its states, names of its inputs, right-hand side.
struct Handwritten {
    states: Vec<(String, f64)>,
    inputs: Vec<&'static str>,
    derivative: RightHandSide,
}

/// Airway tree; volumes first, then flows, both counted from 1 as in the equations.
fn weibel(generations: u32) -> Handwritten {
    let n = (1usize << generations) - 1;
    let (mut r1, mut r2, mut inertance, mut compliance) = (vec![0.0], vec![0.0], vec![0.0], vec![0.0]);
    let mut states = Vec::new();
    for b in 1..=n {
        let (z, x) = (b.ilog2() as i32, b as f64);
        let generation = f64::from(z);
        let (diameter, length) = if z <= 3 {
            (1.8 * (-0.388 * generation).exp(), 12.0 * (-0.92 * generation).exp())
        } else {
            (1.3 * (-(0.293 - 0.0065 * generation) * generation).exp(), 2.5 * (-0.17 * generation).exp())
        };
        let radius = diameter / 2.0 * (1.0 + 0.02 * (1.3 * x).sin());
        let length = length * (1.0 + 0.05 * (0.7 * x).cos());
        // Poiseuille resistance and inertance of the air column, from dyn/cm^5 to cmH2O/L.
        let resistance = 8.0 * 1.9e-4 * length / (PI * radius.powi(4)) * 1000.0 / 980.665;
        r1.push(resistance / 2.0);
        r2.push(resistance / 2.0);
        inertance.push(1.12e-3 * length / (PI * radius.powi(2)) * 1000.0 / 980.665);
        let part = 0.2 / (f64::from(generations) * 2f64.powi(z)) * (1.0 + 0.04 * (2.1 * x).sin());
        compliance.push(part);
        states.push((format!("V[{b}]"), 0.05 * part * (1.0 - generation / f64::from(generations))));
    }
    for b in 1..=n {
        states.push((format!("F[{b}]"), 0.4 * 0.5f64.powi(b.ilog2() as i32)));
    }
    let derivative = move |y: &[f64], inputs: &[f64]| {
        let (u, p_pl) = (inputs[0], inputs[1]);
        let volume = |b: usize| y[b - 1];
        let flow = |b: usize| y[n + b - 1];
        let middle = |b: usize| volume(b) / compliance[b];
        let outlet = |b: usize| {
            if 2 * b > n {
                return p_pl;
            }
            let (left, right) = (2 * b, 2 * b + 1);
            (flow(b) + middle(left) / r1[left] + middle(right) / r1[right]) / (1.0 / r1[left] + 1.0 / r1[right])
        };
        let mut dy = vec![0.0; 2 * n];
        dy[0] = u - flow(1);
        for c in 2..=n {
            dy[c - 1] = (outlet(c / 2) - middle(c)) / r1[c] - flow(c);
        }
        for b in 1..=n {
            dy[n + b - 1] = (middle(b) - outlet(b) - r2[b] * flow(b)) / inertance[b];
        }
        dy
    };
    Handwritten { states, inputs: vec!["u", "p_pl"], derivative: Box::new(derivative) }
}

/// Chain of gas cells.
fn lutchen(n: usize) -> Handwritten {
    let part = |i: usize| i as f64 / n as f64;
    let volume: Vec<f64> =
        (0..=n).map(|i| 0.8e-4 * (1.0 + part(i) / 2.0) * (1.0 + 0.04 * (1.1 * i as f64).sin())).collect();
    // One more than there are cells: no diffusion out of the last one.
    let diffusion: Vec<f64> = (0..=n + 1)
        .map(
            |i| if i > n { 0.0 } else { 0.012 * (1.0 + 9.0 * part(i).powi(2)) * (1.0 + 0.03 * (0.9 * i as f64).cos()) },
        )
        .collect();
    let states = (1..=n).map(|i| (format!("c[{i}]"), 0.3 + 0.2 * (3.0 * PI * part(i)).cos())).collect();
    let derivative = move |c: &[f64], inputs: &[f64]| {
        let flow = 0.4;
        let mut dc = Vec::new();
        for i in 1..=n {
            let (own, before) = (c[i - 1], if i == 1 { inputs[0] } else { c[i - 2] });
            let mut gain = flow * (before - own) + diffusion[i] * (before - own);
            if i < n {
                gain += diffusion[i + 1] * (c[i] - own);
            }
            dc.push(gain / volume[i]);
        }
        dc
    };
    Handwritten { states, inputs: vec!["c_0"], derivative: Box::new(derivative) }
}

/// Grid with the printed wave equation.
fn wave(n: usize) -> Handwritten {
    let mut states = Vec::new();
    for i in 1..=n {
        for j in 1..=n {
            let (di, dj) = (i as f64 - 0.35 * n as f64, j as f64 - 0.6 * n as f64);
            states.push((format!("v[{i},{j}]"), (-9.0 * (di * di + dj * dj) / (n * n) as f64).exp()));
        }
    }
    let derivative = move |v: &[f64], _: &[f64]| {
        // A border of zeros saves the conditions.
        let mut padded = vec![vec![0.0; n + 2]; n + 2];
        for i in 0..n {
            padded[i + 1][1..=n].copy_from_slice(&v[i * n..(i + 1) * n]);
        }
        let mut dv = Vec::new();
        for i in 1..=n {
            for j in 1..=n {
                let around = padded[i - 1][j] + padded[i + 1][j] + padded[i][j - 1] + padded[i][j + 1];
                dv.push(4410.0 * around - 17660.0 * padded[i][j]);
            }
        }
        dv
    };
    Handwritten { states, inputs: vec![], derivative: Box::new(derivative) }
}

/// Block of excitable cells.
fn atrial(n: usize) -> Handwritten {
    let mut cells = Vec::new();
    for x in 0..n {
        for y in 0..n {
            for z in 0..n {
                cells.push([x, y, z]);
            }
        }
    }
    let states = cells
        .iter()
        .map(|[x, y, z]| {
            let distance = ((x * x + y * y + z * z) as f64).sqrt();
            let name = format!("V[{},{},{}]", x + 1, y + 1, z + 1);
            (name, 1.0 / (1.0 + ((distance - n as f64 / 3.0) / 1.2).exp()))
        })
        .collect();
    let derivative = move |v: &[f64], _: &[f64]| {
        let at = |cell: [usize; 3]| v[(cell[0] * n + cell[1]) * n + cell[2]];
        let mut dv = Vec::new();
        for cell in &cells {
            let [x, y, z] = *cell;
            let number = (x + 1 + n * (y + 1) + n * n * (z + 1)) as f64;
            let along = |index: usize| index as f64 / (n - 1) as f64;
            let k = 1000.0 * (1.0 - 0.2 * along(x)) * (1.0 + 0.03 * (1.7 * number).sin());
            let alpha = 0.12 + 0.06 * along(y) + 0.005 * (2.3 * number).cos();
            let own = at(*cell);
            let mut coupling = 0.0;
            for axis in 0..3 {
                let mut neighbour = *cell;
                if cell[axis] > 0 {
                    neighbour[axis] = cell[axis] - 1;
                    coupling += at(neighbour) - own;
                }
                if cell[axis] + 1 < n {
                    neighbour[axis] = cell[axis] + 1;
                    coupling += at(neighbour) - own;
                }
            }
            dv.push(400.0 * coupling - k * own * (own - alpha) * (own - 1.0));
        }
        dv
    };
    Handwritten { states, inputs: vec![], derivative: Box::new(derivative) }
}

/// The handwritten version of a spec of [`PAPER`].
fn handwritten(name: &str) -> Handwritten {
    match name {
        "weibel11" => weibel(11),
        "weibel5" => weibel(5),
        "lutchen4000" => lutchen(4000),
        "lutchen20" => lutchen(20),
        "wave80" => wave(80),
        "wave6" => wave(6),
        "atrial15" => atrial(15),
        "atrial3" => atrial(3),
        _ => unreachable!("no handwritten version of {name}"),
    }
}

/// How far apart two numbers are, as a part of `size`.
fn apart(a: f64, b: f64, size: f64) -> f64 {
    if a == b { 0.0 } else { (a - b).abs() / size }
}

/// Position of every state of the model by its name without blanks.
fn positions(model: &Model) -> BTreeMap<String, usize> {
    model.states.iter().enumerate().map(|(i, state)| (state.name.replace(' ', ""), i)).collect()
}

#[test]
fn specs_agree_with_the_handwritten_equations() {
    for name in PAPER {
        let (model, reference) = (load(name), handwritten(name));
        let position = positions(&model);
        assert_eq!(position.len(), reference.states.len(), "{name}: number of states");
        let place: Vec<usize> = reference
            .states
            .iter()
            .map(|(state, _)| *position.get(state).unwrap_or_else(|| panic!("{name}: no state {state}")))
            .collect();
        for ((state, initial), at) in reference.states.iter().zip(&place) {
            let ours = model.states[StateId::at(*at)].initial;
            assert!(apart(ours, *initial, initial.abs()) <= 1e-12, "{name}: {state} starts at {ours}, not {initial}");
        }

        let mut random = Random(1);
        for _ in 0..3 {
            // Between half and twice the size of the initial value, and of either sign: every term counts then.
            let theirs: Vec<f64> = reference
                .states
                .iter()
                .map(|(_, initial)| {
                    random.between(0.5, 2.0) * initial.abs().max(1e-3) * random.between(-1.0, 1.0).signum()
                })
                .collect();
            let mut ours = vec![0.0; theirs.len()];
            for (value, at) in theirs.iter().zip(&place) {
                ours[*at] = *value;
            }
            let their_inputs: Vec<f64> = reference.inputs.iter().map(|_| random.between(-1.0, 1.0)).collect();
            let our_inputs: Vec<f64> = model
                .inputs
                .iter()
                .map(|input| their_inputs[reference.inputs.iter().position(|name| *name == input.name).unwrap()])
                .collect();
            let expected = (reference.derivative)(&theirs, &their_inputs);
            let found = derivatives(&model, &ours, &our_inputs);
            for ((state, _), (expected, at)) in reference.states.iter().zip(expected.iter().zip(&place)) {
                let Weighed { value, size } = found[*at];
                assert!(apart(value, *expected, size) <= 1e-12, "{name}: {state}' is {value}, not {expected}");
            }
        }
    }
}

#[test]
fn sizes_solvers_and_steps_are_the_papers() {
    let facts = [
        ("weibel11", 4094, Solver::Rk4, 1e-4),
        ("lutchen4000", 4000, Solver::Rk4, 1e-4),
        ("wave80", 6400, Solver::Euler, 1.0 / 44100.0),
        ("atrial15", 3375, Solver::Rk4, 1e-4),
    ];
    for (name, states, solver, step) in facts {
        let model = load(name);
        assert_eq!((model.states.len(), model.solver), (states, solver), "{name}");
        assert!(apart(model.step, step, step) < 1e-15, "{name}: step {}", model.step);
        assert!(model.left_out.is_empty(), "{name}: {:?} left out", model.left_out);
        let zeros = model.states.iter().filter(|state| state.initial == 0.0).count();
        assert!(zeros * 10 <= states, "{name}: {zeros} states start at zero");
    }
}

/// Collects the variables an expression reads, an algebraic equation that is only another name looked through.
fn reads(model: &Model, expr: &Expr, variables: &mut BTreeSet<Variable>) {
    expr.each_variable(&mut |variable| match variable {
        Variable::Algebraic(i) if is_alias(&model.algebraics[i as usize].expr) => {
            reads(model, &model.algebraics[i as usize].expr, variables);
        }
        variable => {
            variables.insert(variable);
        }
    });
}

/// Whether an algebraic equation says no more than that one variable is another.
fn is_alias(expr: &Expr) -> bool {
    matches!(expr, Expr::Variable(_))
}

#[test]
fn multiply_accumulates_per_evaluation() {
    // One per variable that an affine equation reads; the cubic of an atrial cell takes two more (Horner).
    for (name, more_per_state, expected) in
        [("weibel11", 0, 15_350), ("lutchen4000", 0, 11_999), ("wave80", 0, 31_680), ("atrial15", 2, 29_025)]
    {
        let model = load(name);
        let states = model.states.iter().map(|state| &state.derivative);
        let algebraics = model.algebraics.iter().map(|algebraic| &algebraic.expr).filter(|expr| !is_alias(expr));
        let products: usize = states
            .chain(algebraics)
            .map(|expr| {
                let mut variables = BTreeSet::new();
                reads(&model, expr, &mut variables);
                variables.len()
            })
            .sum();
        assert_eq!(products + more_per_state * model.states.len(), expected, "{name}");
    }
}

/// Derivative of every state of the array `of`, every state but the one of the same element in the array `at` at rest.
fn own_coefficients(model: &Model, of: &str, at: &str) -> Vec<f64> {
    let position = positions(model);
    let inputs = vec![0.0; model.inputs.len()];
    let mut states = vec![0.0; model.states.len()];
    let mut coefficients = Vec::new();
    for (name, row) in position.iter().filter(|(name, _)| name.starts_with(&format!("{of}["))) {
        let column = position[&name.replace(of, at)];
        states[column] = 0.5;
        // Only the algebraic equations take long, and only one row is wanted.
        let mut algebraics = Vec::with_capacity(model.algebraics.len());
        for algebraic in &model.algebraics {
            let value = eval(&algebraic.expr, &states, &inputs, &algebraics);
            algebraics.push(value);
        }
        coefficients.push(eval(&model.states[StateId::at(*row)].derivative, &states, &inputs, &algebraics).value);
        states[column] = 0.0;
    }
    coefficients
}

/// Number of values that differ from each other by more than one in 10^9.
fn distinct(mut values: Vec<f64>) -> usize {
    values.sort_by(f64::total_cmp);
    1 + values.windows(2).filter(|pair| apart(pair[0], pair[1], pair[1].abs()) > 1e-9).count()
}

#[test]
fn every_branch_and_cell_has_parameters_of_its_own() {
    for (name, of, at) in [
        ("weibel11", "V", "V"),
        ("weibel11", "F", "V"),
        ("weibel11", "F", "F"),
        ("lutchen4000", "c", "c"),
        ("atrial15", "V", "V"),
    ] {
        let coefficients = own_coefficients(&load(name), of, at);
        let count = coefficients.len();
        // A few values may coincide by chance.
        assert!(distinct(coefficients) * 100 >= count * 99, "{name}: d{of}/d{at} repeats");
    }
    // The two constants of the wave grid are shared.
    assert_eq!(distinct(own_coefficients(&load("wave6"), "v", "v")), 1);
}

#[test]
fn spectral_radius_suits_the_step() {
    // The model is affine: the difference to the rest position is the Jacobian. The length grows by the spectral
    // radius per application; the first ones are left out because they still carry the start.
    let model = load("weibel11");
    let inputs = vec![0.0; model.inputs.len()];
    let rest = slope(&model, &vec![0.0; model.states.len()], &inputs);
    assert!(rest.iter().all(|value| *value == 0.0));
    let mut random = Random(2);
    let mut y: Vec<f64> = model.states.iter().map(|_| random.between(-1.0, 1.0)).collect();
    let (mut growth, mut counted) = (0.0, 0);
    for application in 0..600 {
        y = slope(&model, &y, &inputs);
        let length = y.iter().map(|value| value * value).sum::<f64>().sqrt();
        y.iter_mut().for_each(|value| *value /= length);
        if application >= 300 {
            growth += length.ln();
            counted += 1;
        }
    }
    let radius = model.step * (growth / f64::from(counted)).exp();
    assert!((0.2..=2.0).contains(&radius), "h times the spectral radius is {radius}");
    assert!((radius - 1.5415).abs() < 0.01, "the README says 1.54, found {radius}");
}

#[test]
fn small_models_stay_finite_and_every_state_moves() {
    for name in [
        "weibel5",
        "lutchen20",
        "wave6",
        "atrial3",
        "lutchen_breathing",
        "wave_fdtd",
        "harmonic_oscillator",
        "van_der_pol",
        "lorenz",
        "lotka_volterra",
        "rc_ladder",
    ] {
        let model = load(name);
        assert_every_state_moves(&model, model.steps());
    }
}

#[test]
fn full_size_models_move_everywhere_from_the_start() {
    for (name, steps) in
        [("weibel11", 200), ("weibel11_square", 50), ("lutchen4000", 200), ("wave80", 200), ("atrial15", 100)]
    {
        assert_every_state_moves(&load(name), steps);
    }
}

#[test]
fn square_breathing_changes_only_the_mouth_flow() {
    let (sine, square) = (load("weibel11"), load("weibel11_square"));
    assert_eq!(sine.states.len(), square.states.len());
    for (a, b) in sine.states.iter().zip(&square.states) {
        assert_eq!((&a.name, a.initial, &a.derivative), (&b.name, b.initial, &b.derivative));
    }
    assert_ne!(sine.inputs[0].waveform, square.inputs[0].waveform);
    assert_eq!(sine.inputs[1].waveform, square.inputs[1].waveform);
}

#[test]
fn small_versions_differ_only_in_size_and_span() {
    // Headline, span and constants aside, the texts must be equal to the letter.
    for (full, small) in
        [("weibel11", "weibel5"), ("lutchen4000", "lutchen20"), ("wave80", "wave6"), ("atrial15", "atrial3")]
    {
        let body = |name: &str| -> Vec<String> {
            let path = format!("{}/../../models/{name}/{name}.spec", env!("CARGO_MANIFEST_DIR"));
            let text = std::fs::read_to_string(path).unwrap();
            let sized = |line: &&str| ["model", "span", "const"].iter().any(|word| line.starts_with(word));
            text.lines().filter(|line| !sized(line)).map(str::to_owned).collect()
        };
        assert_eq!(body(full), body(small), "{full} and {small}");
    }
}
