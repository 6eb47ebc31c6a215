//! Behaviour of the front end as a whole: what models look like, and how fast and how robust their making is.

mod common;

use common::{derivatives, model, model_with, source};
use pe_frontend::{Limits, NoFiles, Overrides, compile, elaborate_within, parse};
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Model, Solver, Variable, Waveform};
use pe_ir::source::Diagnostic;
use std::time::{Duration, Instant};

/// A spec with these statements after the usual head.
fn spec(statements: &str) -> String {
    format!("model m \"title\"\nsolver rk4\nstep 1 ms\nspan 1 s\n{statements}")
}

fn errors(text: &str) -> Vec<Diagnostic> {
    match compile(&mut source(text), &NoFiles, &Overrides::default()) {
        Ok(_) => Vec::new(),
        Err(errors) => errors,
    }
}

fn codes(text: &str) -> Vec<&'static str> {
    errors(text).iter().map(|error| error.code).collect()
}

#[test]
fn header_values_reach_the_model() {
    let model = model("model a \"b c\"\nsolver euler\nstep 1/44100 s\nspan 100 us\nstate x = 1\nx' = -x\noutput x");
    assert_eq!((model.name.as_str(), model.title.as_str(), model.solver), ("a", "b c", Solver::Euler));
    assert_eq!((model.step, model.span), (1.0 / 44100.0, 1e-4));
}

#[test]
fn a_list_of_steps_is_phases_and_an_input() {
    let listed = |steps: &str| {
        format!("model a\nsolver rodas3\nstep {steps}\nspan 40 s\nconst end = 2\nstate x = 1\nx' = -x\noutput x")
    };
    let model = model(&listed("1 ms until 0.4, then 10 ms until end s, then 100 ms"));
    let phases: Vec<(f64, f64)> = model.phases.iter().map(|phase| (phase.until, phase.ratio)).collect();
    assert_eq!(phases, [(0.4, 100.0), (2.0, 10.0)]);
    assert_eq!((model.step, model.steps()), (0.1, 400 + 160 + 380));
    assert_eq!(model.inputs.last().expect("the ratio").name, "step_ratio");
    for wrong in [
        "1 ms until 50 s, then 0.1 s",
        "1 ms until 1 s, then 2 ms until 1 s, then 0.1 s",
        "1 ms until 0.4005 s, then 0.1 s",
    ] {
        assert_eq!(codes(&listed(wrong)), ["E0505"], "{wrong}");
    }
    assert_eq!(codes(&listed("1 ms until 1 s 0.1 s")), ["E0101"]);
}

#[test]
fn line_ends_of_windows_and_a_byte_order_mark_do_not_matter() {
    let text = spec("state x = 1 +\n  2 // note\nx' = -x\noutput x");
    let other = format!("\u{FEFF}{}", text.replace('\n', "\r\n"));
    assert_eq!(model(&other).states[StateId::new(0)].initial, 3.0);
    assert_eq!(model(&other).states[StateId::new(0)].derivative, model(&text).states[StateId::new(0)].derivative);
}

#[test]
fn the_same_text_gives_the_same_model() {
    let text =
        spec("param b = 2\nparam a = b\nstate y = a\nstate x = b\nx' = p\ny' = q\np = q - y\nq = a*x\noutput y, x");
    assert_eq!(format!("{:?}", model(&text)), format!("{:?}", model(&text)));
}

#[test]
fn parameters_fold_into_coefficients() {
    let model = model(&spec("index b in 1..2\nparam R[b] = 2*b\nstate F[b] = 0\nF[b]' = 1 - R[b]*F[b]/4\noutput F"));
    let product = Expr::Product(vec![Expr::Constant(-0.5), Expr::Variable(Variable::State(StateId::new(0)))]);
    assert_eq!(model.states[StateId::new(0)].derivative, Expr::Sum(vec![product, Expr::Constant(1.0)]));
    assert_eq!(model.states[StateId::new(1)].name, "F[2]");
}

#[test]
fn products_are_not_multiplied_out() {
    let model = model(&spec("state x = 0\nstate y = 0\nx' = 2*(x + y)*(x - 1)^2\ny' = 0\noutput x"));
    let Expr::Product(factors) = &model.states[StateId::new(0)].derivative else {
        panic!("{:?}", model.states[StateId::new(0)].derivative)
    };
    assert!(matches!(factors.as_slice(), [Expr::Constant(2.0), Expr::Sum(_), Expr::Power(_, 2)]), "{factors:?}");
}

#[test]
fn the_branch_not_taken_may_be_out_of_range() {
    let model = model(&spec(
        "index i in 1..3\nstate x[i] = 0\nx[i]' = (if i > 1 then x[i - 1] else 7) - x[i]*(if i < 3 then x[i + 1] else 0)\noutput x",
    ));
    assert_eq!(derivatives(&model, &[1.0, 2.0, 3.0], &[]), [5.0, -5.0, 2.0]);
}

#[test]
fn equations_of_one_array_may_be_split() {
    let model = model(&spec(
        "const n = 4\nstate x[k in 1..n] = k\nx[n]' = 1\nx[1]' = 2\nx[k]' = 10*k where k > 1 and k < n\noutput x",
    ));
    assert_eq!(derivatives(&model, &[0.0; 4], &[]), [2.0, 20.0, 30.0, 1.0]);
    assert_eq!(model.states.iter().map(|state| state.initial).collect::<Vec<_>>(), [1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn sums_nest_and_may_be_empty() {
    let model = model(&spec(
        "state x = 1\nx' = sum(i in 1..3: sum(j in i..3 where i + j != 4: 10*i + j))*x + sum(k in 5..4: k)\noutput x",
    ));
    // Pairs (1,1) (1,2) (2,3) (3,3).
    assert_eq!(derivatives(&model, &[1.0], &[]), [11.0 + 12.0 + 23.0 + 33.0]);
}

#[test]
fn algebraic_equations_come_in_dependency_order() {
    let model = model(&spec("state x = 1\nx' = c\nc = a + b\nb = 2*a\na = x\noutput x"));
    assert_eq!(model.algebraics.iter().map(|a| a.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c"]);
    assert_eq!(derivatives(&model, &[5.0], &[]), [15.0]);
}

#[test]
fn what_no_output_depends_on_is_left_out_and_numbers_stay_dense() {
    let model = model(&spec(
        "input unused = 1\ninput u = 2\nindex i in 1..2\nstate a = 0\nstate x[i] = 0\nspare = a\na' = unused\nx[i]' = u*x[i]\noutput x[2]",
    ));
    assert_eq!(model.left_out, ["unused", "spare", "a", "x[1]"]);
    assert_eq!(model.states.len(), 1);
    let product =
        Expr::Product(vec![Expr::Variable(Variable::Input(0)), Expr::Variable(Variable::State(StateId::new(0)))]);
    assert_eq!(model.states[StateId::new(0)].derivative, product);
    assert_eq!(
        (model.states[StateId::new(0)].quantity, model.outputs[0].variable),
        (1, Variable::State(StateId::new(0)))
    );
}

#[test]
fn waveforms_take_units_and_defaults() {
    let model = model(&spec(
        "input a = sine(5, 0.25 Hz)\ninput b = square(1, 2 kHz, 3)\ninput c = 4*2\nstate x = 0\nx' = a + b + c\noutput x",
    ));
    let waveforms: Vec<Waveform> = model.inputs.iter().map(|input| input.waveform.clone()).collect();
    let sine = Waveform::Sine { amplitude: 5.0, frequency: 0.25, offset: 0.0, phase: 0.0 };
    let square = Waveform::Square { amplitude: 1.0, frequency: 2000.0, offset: 3.0, duty: 0.5 };
    assert_eq!(waveforms, [sine, square, Waveform::Constant(8.0)]);
}

#[test]
fn values_can_be_set_from_outside() {
    let text = spec(
        "const n = 2\ninput u = 1\nparam R[k in 1..n] = k\nparam S[k in 1..n] = 10*R[k]\nstate x[k in 1..n] = S[k]\n\
         x[k]' = -R[k]*x[k] + u\noutput x",
    );
    let set = |name: &str, value: f64| (name.to_owned(), value);
    let with = |set: &[(String, f64)]| Overrides { set: set.to_vec(), ..Overrides::default() };
    let initial = |set: &[(String, f64)]| {
        model_with(&text, with(set)).states.iter().map(|state| state.initial).collect::<Vec<_>>()
    };
    assert_eq!(initial(&[set("n", 3.0), set("R", 5.0)]), [50.0; 3]);
    // What depends on an element follows; of several values for one the last counts.
    assert_eq!(initial(&[set("R", 5.0), set("R[2]", 7.0)]), [50.0, 70.0]);
    assert_eq!(initial(&[set("R[2]", 7.0), set("R", 5.0), set("R[1]", 1.0), set("R [ 1 ]", 2.0)]), [20.0, 50.0]);
    assert_eq!(initial(&[set("x", -1.0), set("x[2]", 4.0)]), [-1.0, 4.0]);
    assert_eq!(initial(&[set("x[1]", 4.0)]), [4.0, 20.0]);

    let wrong = ["nn", "u", "k", "pi", "R[3]", "R[1,1]", "R[", "n[1]", "x[0]", "R[a]"];
    let wrong: Vec<(String, f64)> = wrong.iter().map(|name| set(name, 1.0)).chain([set("R", f64::NAN)]).collect();
    let errors = compile(&mut source(&text), &NoFiles, &with(&wrong)).unwrap_err();
    assert_eq!(errors.iter().map(|error| error.code).collect::<Vec<_>>(), ["E0209"; 11]);
    let helps: Vec<&str> = errors.iter().filter_map(|error| error.help.as_deref()).collect();
    assert!(helps.contains(&"did you mean `n`?") && helps.contains(&"subscripts of `R` are in 1..2"), "{helps:?}");
}

#[test]
fn tables_give_values_to_elements_and_arrays_may_have_many_dimensions() {
    let model = model(&spec(
        "index i in 1..2, j in 0..2\nparam A[i, j] = [1, 2, 3\n; 4*j, 5*i, A[1, 2] + 6]\nparam B[k in 1..3] = [7; 8;\n 9]\n\
         state x[i] = [A[i, 1], B[3] - 1]\nx[i]' = sum(j: A[i, j]*B[j + 1])\n\
         state t[a in 1..2, b in 1..1, c in 1..2, d in 1..1, e in 3..4] = 10*a + c + e/10\n\
         t[a, b, c, d, e]' = t[3 - a, 1, c, d, e]\noutput x, t",
    ));
    let initial: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    assert_eq!(initial[..3], [2.0, 8.0, 11.3]);
    assert_eq!(derivatives(&model, &[0.0; 10], &[])[..2], [7.0 + 16.0 + 27.0, 80.0 + 81.0]);
    assert_eq!((model.states[StateId::new(9)].name.as_str(), initial[9]), ("t[2,1,2,1,4]", 22.4));
}

/// Outputs named from outside, as `--observe` does.
fn observing(text: &str, lists: &[&str]) -> Result<Model, Vec<Diagnostic>> {
    let observe = lists.iter().map(|list| (*list).to_owned()).collect();
    compile(&mut source(text), &NoFiles, &Overrides { observe, ..Overrides::default() }).map(|(model, warnings)| {
        assert_eq!(warnings, []);
        model
    })
}

/// Two tanks in a row, a third apart, and an algebraic quantity without its first element.
const TANKS: &str = "index i in 1..3\ninput p = sine(1, 1 Hz)\nstate V[i] = 1\nstate w[a in 1..2, b in 0..1] = 0\n\
                     V[1]' = p - V[1]\nV[2]' = V[1] - V[2]\nV[3]' = -V[3]\nw[a, b]' = -a*w[a, b]\n\
                     q[i] = V[i] - V[i - 1] where i >= 2\noutput V";

#[test]
fn outputs_can_be_named_from_outside() {
    let outputs = |lists: &[&str]| {
        let model = observing(&spec(TANKS), lists).unwrap_or_else(|errors| panic!("{lists:?}: {errors:?}"));
        model.outputs.into_iter().map(|output| output.name).collect::<Vec<_>>()
    };
    assert_eq!(outputs(&["V[2]"]), ["V[2]"]);
    assert_eq!(outputs(&["q, w[1,0]", " V [ 1 ],q[2], p"]), ["q[2]", "q[3]", "w[1,0]", "V[1]", "p"]);
    let model = observing(&spec(TANKS), &["V[2]"]).expect("it compiles");
    assert_eq!(model.states.iter().map(|state| state.name.as_str()).collect::<Vec<_>>(), ["V[1]", "V[2]"]);
    assert_eq!(model.inputs.len(), 1);
    assert_eq!(model.left_out, ["V[3]", "w[1,0]", "w[1,1]", "w[2,0]", "w[2,1]", "q[2]", "q[3]"]);
    assert!(observing(&spec(TANKS), &["V[3]"]).expect("it compiles").inputs.is_empty());
}

#[test]
fn observing_takes_the_place_of_output_statements() {
    let without = spec(TANKS).replace("output V", "");
    assert_eq!(observing(&without, &["V[3]"]).expect("no `output` is needed").outputs.len(), 1);
    let broken = spec(TANKS).replace("output V", "output V[9]");
    assert_eq!(observing(&broken, &["V[3]"]).unwrap_err()[0].code, "E0501", "what is wrong stays wrong");
}

#[test]
fn what_cannot_be_observed_is_refused_with_its_reason() {
    let refused = [
        ("v", "E0201", "unknown name `v` to observe", "did you mean `V`?"),
        ("i", "E0208", "`i` does not change over time and cannot be observed", ""),
        ("pi", "E0208", "`pi` does not change over time and cannot be observed", ""),
        ("V[4]", "E0501", "`V[4]` does not exist", "subscripts of `V` are in 1..3"),
        ("w[1,7]", "E0501", "`w[1,7]` does not exist", "subscripts of `w` are in 1..2, 0..1"),
        ("q[1]", "E0502", "no equation defines `q[1]`", ""),
        ("V[1,1]", "E0207", "`V` has 1 subscripts, not 2", ""),
        ("p[1]", "E0207", "`p` has 0 subscripts, not 1", ""),
    ];
    let shape = "name scalars, elements or whole arrays: `--observe 'p,V[3],w[1,2]'`";
    let misshapen =
        ["", "V[", "V]", "V[a]", "V[1]]", "V[1] V[2]", "V[1],,p", "V[]", "'; rm -rf", "V[99999999999999999999]"];
    for text in misshapen {
        let errors = observing(&spec(TANKS), &[text]).unwrap_err();
        assert_eq!((errors[0].code, errors[0].help.as_deref()), ("E0209", Some(shape)), "{text}: {errors:?}");
    }
    for (text, code, message, help) in refused {
        let errors = observing(&spec(TANKS), &[text]).unwrap_err();
        assert_eq!((errors.len(), errors[0].code, errors[0].message.as_str()), (1, code, message));
        if !help.is_empty() {
            assert_eq!(errors[0].help.as_deref(), Some(help), "{text}");
        }
    }
}

#[test]
fn messages_name_the_element_and_the_index_values() {
    let errors = errors(&spec("index i in 1..80\nstate w[i] = 0\nw[i]' = w[i + 1]\noutput w"));
    assert_eq!(errors.len(), 1);
    assert_eq!(errors[0].message, "`w[81]` does not exist: its subscript runs from 1 to 80");
    assert!(errors[0].labels.iter().any(|(_, label)| label == "for i = 80"), "{errors:?}");
}

#[test]
fn loops_are_shown_as_cycles() {
    let errors = errors(&spec("state x = 0\nx' = a\na = b\nb = c + x\nc = a\noutput x"));
    assert_eq!(errors[0].message, "algebraic loop: `a` reads `b` reads `c` reads `a`");
    assert_eq!(errors[0].labels.len(), 3);
}

#[test]
fn a_long_chain_of_definitions_is_no_danger_to_the_stack() {
    let text = spec(
        "const n = 200000\nparam r[k in 1..n] = if k == n then 1 else r[k + 1]\nstate x = r[1]\nx' = a[1]\na[k] = if k == n then x else a[k + 1] for k in 1..n\noutput x",
    );
    let model = model(&text);
    assert_eq!((model.states[StateId::new(0)].initial, model.algebraics.len()), (1.0, 200_000));
    assert_eq!(model.algebraics[0].name, "a[200000]");
}

#[test]
fn deep_nesting_is_refused_at_once() {
    let begin = Instant::now();
    let many = 700_000;
    for (open, close) in
        [("(", ")"), ("-", ""), ("sin(", ")"), ("if 1 < 2 then 1 else ", ""), ("2^", ""), ("not ", ""), ("x[", "]")]
    {
        let text = spec(&format!("state x = {}1{}\nx' = -x\noutput x", open.repeat(many), close.repeat(many)));
        assert!(codes(&text).contains(&"E0104"), "{open}");
    }
    let unclosed = spec(&"(".repeat(many));
    assert!(!codes(&unclosed).is_empty());
    assert!(begin.elapsed() < Duration::from_secs(10), "{:?}", begin.elapsed());
}

#[test]
fn nesting_up_to_the_limit_is_accepted() {
    let value = format!("{}1{}", "(-".repeat(90), ")".repeat(90));
    let chain = format!("{}3", "if 1 > 2 then 1 else ".repeat(190));
    let powers = format!("{}1", "1^".repeat(190));
    for value in [value, chain, powers] {
        assert_eq!(codes(&spec(&format!("state x = {value}\nx' = -x*({value})\noutput x"))), Vec::<&str>::new());
    }
}

#[test]
fn a_sum_of_many_terms_is_as_flat_as_a_short_one() {
    let text = spec(&format!("state x = 0\nx' = {}1\noutput x", "x + 1 - ".repeat(100_000)));
    assert!(matches!(&model(&text).states[StateId::new(0)].derivative, Expr::Sum(terms) if terms.len() == 100_000 + 1));
}

#[test]
fn large_files_and_floods_of_errors_are_cut_short() {
    assert_eq!(codes(&" ".repeat((16 << 20) + 1)), ["E0105"]);
    let flood = codes(&"$\n".repeat(1_000_000));
    assert_eq!(flood.len(), 101 + 5, "{flood:?}");
    assert!(flood.contains(&"E0108"));
}

#[test]
fn models_beyond_the_limits_are_refused_by_name() {
    let errors_of = |statements: &str, limits: Limits| {
        let (spec, errors) = parse(&mut source(&spec(statements)), &NoFiles);
        assert!(errors.is_empty(), "{errors:?}");
        let (model, errors) = elaborate_within(&spec, &Overrides::default(), &limits);
        assert!(model.is_none());
        errors
    };
    let array = "state x[i in 1..3000, j in 1..3000] = 0\nx[i, j]' = 1\noutput x";
    let errors = errors_of(array, Limits::default());
    assert_eq!(errors[0].code, "E0601");
    assert!(errors[0].message.contains("`x`"), "{errors:?}");

    let few = Limits { evaluations: 1000, ..Limits::default() };
    let errors = errors_of("state x = 0\nx' = sum(i in 1..1e12: i)\noutput x", few);
    assert_eq!(errors.iter().map(|error| error.code).collect::<Vec<_>>(), ["E0602"]);

    let errors = errors_of("y[i] = 1 for i in 1..1e15\nstate x = 0\nx' = y[1]\noutput x", Limits::default());
    assert_eq!(errors[0].code, "E0601");
}

#[test]
fn a_hundred_thousand_equations_take_about_a_second() {
    let begin = Instant::now();
    let model = model(&spec(
        "const n = 320\nindex i in 1..n, j in 1..n\nstate v[i, j] = exp(-((i - 40)^2 + (j - 60)^2)/100)
         v[i, j]' = 4410*((if i > 1 then v[i - 1, j] else 0) + (if i < n then v[i + 1, j] else 0)
                        + (if j > 1 then v[i, j - 1] else 0) + (if j < n then v[i, j + 1] else 0)) - 17660*v[i, j]
         output v[1, 1]",
    ));
    let taken = begin.elapsed();
    println!("{} ODEs in {taken:?}", model.states.len());
    assert_eq!(model.states.len(), 320 * 320);
    // Generous: the machine may be busy.
    assert!(taken < Duration::from_secs(5), "{taken:?}");
}

#[test]
fn a_duty_is_written_out_and_not_named() {
    let named = |duty: &str| errors(&spec(&format!("state y = 0\n{duty}\ny' = pwm(0, 1, 10 Hz, d) - y\noutput y")));
    for duty in ["d = 0.5 + 0.3*sine(1, 1 Hz)", "input d = 0.5 + 0.3*sine(1, 1 Hz)", "state d = 0.5\nd' = -d"] {
        let errors = named(duty);
        let helps = errors[0].help.as_deref().is_some_and(|help| help.starts_with("write the signal itself in place"));
        assert!(errors.len() == 1 && errors[0].code == "E0208" && helps, "{duty}: {errors:?}");
    }
    assert!(named("param d = 0.5").is_empty());
    let written = spec("state y = 0\ny' = pwm(0, 1, 10 Hz, 0.5 + 0.3*sine(1, 1 Hz)) - y\noutput y");
    assert_eq!(codes(&written), [""; 0]);
}

#[test]
fn comparisons_of_conditions_hold_where_both_or_neither_do() {
    let cases = [
        ("(x > 1) == (y > 1)", [true, false, false, true]),
        ("(x > 1) != (y > 1)", [false, true, true, false]),
        ("not (x > 1) == (y > 1)", [false, true, true, false]),
        ("(x > 1) == (2 > 1)", [false, false, true, true]),
        ("(x > 1 and y > 1) != (x > 1 or y > 1)", [false, true, true, false]),
        ("((x > 1) == (y > 1)) == (x > 1)", [false, true, false, true]),
    ];
    for (condition, holds) in cases {
        let text = format!("state x = 1\nx' = if {condition} then 1 else 0\nstate y = 1\ny' = 0\noutput x, y");
        let derivative = &model(&spec(&text)).states[StateId::new(0)].derivative;
        for (at, holds) in [(0.0, 0.0), (0.0, 2.0), (2.0, 0.0), (2.0, 2.0)].into_iter().zip(holds) {
            let number = |variable| if variable == Variable::State(StateId::new(0)) { at.0 } else { at.1 };
            assert_eq!(derivative.evaluate(&number) == 1.0, holds, "{condition} at {at:?}");
        }
    }
    for wrong in ["x > 1 == 1", "1 < x < 2", "(x > 1) < (y > 1)", "1 == (x > 1)"] {
        let text = format!("state x = 1\nx' = if {wrong} then 1 else 0\nstate y = 1\ny' = 0\noutput x, y");
        assert_eq!(codes(&spec(&text)), ["E0402"], "{wrong}");
    }
    // However deep, it is no larger than it is written.
    let deep = (0..60).fold("(x > 1)".to_owned(), |all, _| format!("((y > 1) == {all})"));
    let text = format!("state x = 1\nx' = if {deep} then 1 else 0\nstate y = 1\ny' = 0\noutput x, y");
    assert_eq!(codes(&spec(&text)), Vec::<&str>::new());
}

#[test]
fn a_model_means_the_same_in_any_unit_of_time() {
    // Rates, times and frequencies of one model, written in each unit.
    let of = |unit: &str, seconds: f64| {
        let (time, rate) = (|t: f64| t / seconds, |r: f64| r * seconds);
        format!(
            "model m\nsolver rk4\nstep {}\nspan {}\ntime [{unit}]\nstate x = 1\nstate y = 2\nstate z = 0\n\
             x' = {}*x*y - {}*x + ramp(0, {}, {}, {})\ny' = if time > {} then {} else -{}*y\nz' = {}*exp(-x)\n\
             every {} {{\nstate k = 0\nnext k = k + 0.5*x\n}}\noutput x, y, z, k\n",
            time(1e-3),
            time(2.0),
            rate(3.0),
            rate(4.0),
            rate(5.0),
            time(0.5),
            time(0.25),
            time(1.0),
            rate(6.0),
            rate(7.0),
            rate(8.0),
            time(0.01),
        )
    };
    let seconds = model(&of("s", 1.0));
    for (unit, length) in [("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0)] {
        let other = model(&of(unit, length));
        let close = |one: f64, two: f64| (one - two).abs() <= 1e-12 * one.abs().max(two.abs());
        assert!(close(seconds.step, other.step) && close(seconds.span, other.span), "{unit}");
        assert!(close(seconds.rates[0].period, other.rates[0].period), "{unit}");
        for at in [0.1, 0.3, 0.7, 0.9, 1.3, 1.9] {
            let rates = |model: &Model, per_second: f64| -> Vec<f64> {
                let value = |variable| match variable {
                    Variable::State(state) => at + f64::from(state.number()),
                    _ => at * per_second,
                };
                let own = model.states.iter().filter(|state| state.motion.is_none());
                own.map(|state| state.derivative.evaluate(&value)).collect()
            };
            for (one, two) in rates(&seconds, 1.0).into_iter().zip(rates(&other, 1.0 / length)) {
                assert!(close(one, two), "{unit} at {at}: {one} {two}");
            }
        }
    }
}
