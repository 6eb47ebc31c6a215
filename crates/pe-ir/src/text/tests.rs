//! Expressions and names of every kind are read as they were printed; damaged texts have a place.

use crate::expr::tests::functions;
use crate::graph::StepGraph;
use crate::index::StateId;
use crate::model::{Expr, Function, Model, Select, Variable};

use super::labels::distinct;
use super::{Stage, expr, name, number, sections};

const MODEL: &str = include_str!("example_model.txt");
const STEP: &str = include_str!("example_step.txt");

fn next(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *seed >> 33
}

const NUMBERS: [f64; 10] = [0.0, -0.0, 1.0, -1.0, 2.0, 0.1, -3.5e-300, 1.7e308, 5e-324, 1e6];
const NAMES: [&str; 6] = ["x", "V[3]", "if", "a b", "exp", "1e5"];

/// A random expression, folded or not.
fn random(seed: &mut u64, depth: u32) -> Expr {
    let kind = if depth == 0 { next(seed) % 2 } else { next(seed) % 7 };
    let many = |seed: &mut u64| (0..next(seed) % 4).map(|_| random(seed, depth - 1)).collect();
    match kind {
        0 => Expr::Constant(NUMBERS[next(seed) as usize % NUMBERS.len()]),
        1 => Expr::Variable(Variable::State(StateId::new(next(seed) as u32 % NAMES.len() as u32))),
        2 => Expr::Sum(many(seed)),
        3 => Expr::Product(many(seed)),
        4 => Expr::Power(Box::new(random(seed, depth - 1)), 2 + next(seed) as u32 % 5),
        5 => Expr::Apply(functions()[next(seed) as usize % functions().len()], Box::new(random(seed, depth - 1))),
        _ => {
            let [condition, yes, no] = std::array::from_fn(|_| random(seed, depth - 1));
            Expr::Select(Box::new(Select { condition, yes, no }))
        }
    }
}

fn text_of(expr: &Expr) -> String {
    expr::print(expr, &|variable| match variable {
        Variable::State(state) => name(NAMES[state.index()]),
        other => panic!("{other:?}"),
    })
}

#[test]
fn expressions_are_read_as_they_were_printed() {
    let mut seed = 1;
    let known = |name: &str| Some(Variable::State(StateId::at(NAMES.iter().position(|known| *known == name)?)));
    for _ in 0..20_000 {
        let expr = random(&mut seed, 4);
        let text = format!("pe-synth model 1\n{}\n", text_of(&expr));
        let sections = sections(&text).unwrap();
        let mut line = sections[0].lines().next().unwrap();
        let read = expr::read(&mut line, &known).unwrap_or_else(|error| panic!("{text}: {error}"));
        line.done().unwrap_or_else(|error| panic!("{text}: {error}"));
        // Debug texts tell 0 and -0 apart.
        assert_eq!(format!("{read:?}"), format!("{expr:?}"), "{text}");
    }
}

#[test]
fn expressions_look_like_those_of_a_spec() {
    let x = || Expr::Variable(Variable::State(StateId::new(0)));
    let recip = |inner| Expr::Apply(Function::Reciprocal, Box::new(inner));
    for (expr, text) in [
        (Expr::Sum(vec![Expr::scaled(-2.0, x()), Expr::Constant(-1.0)]), "-2*x - 1"),
        (Expr::Product(vec![Expr::Constant(1.0), recip(x())]), "(1)/x"),
        (recip(Expr::Sum(vec![x(), Expr::Constant(1.0)])), "1/(x + 1)"),
        (Expr::Power(Box::new(Expr::Constant(-2.0)), 2), "(-2)^2"),
        (Expr::Apply(Function::RealPower(-0.5), Box::new(x())), "x^(-0.5)"),
        (Expr::Sum(vec![x()]), "sum(x)"),
    ] {
        assert_eq!(text_of(&expr), text);
    }
}

#[test]
fn numbers_are_read_as_they_were_printed() {
    let mut seed = 7;
    for _ in 0..20_000 {
        let bits = next(&mut seed) << 32 ^ next(&mut seed) << 11 ^ next(&mut seed);
        let exact = f64::from_bits(bits);
        if exact.is_finite() {
            assert_eq!(number(exact).parse::<f64>().map(f64::to_bits), Ok(bits));
        }
    }
}

#[test]
fn labels_are_different_whatever_the_names() {
    let names = ["a", "a", "a~2", "b", "a", "a~2"];
    let labels = distinct(names.iter().map(|name| (*name).to_owned()));
    assert_eq!(labels, ["a", "a~3", "a~2", "b", "a~4", "a~2~2"]);
}

#[test]
fn names_need_quotes_unless_they_look_like_names() {
    for (given, printed) in [
        ("V[3]", "V[3]"),
        ("x.stage2", "x.stage2"),
        ("a b", "\"a b\""),
        ("if", "\"if\""),
        ("5e-1", "\"5e-1\""),
        ("", "\"\""),
    ] {
        assert_eq!(name(given), printed);
    }
    assert_eq!(name("\"\\\n\u{7}\u{fc}"), "\"\\\"\\\\\\n\\u{7}\u{fc}\"");
}

#[test]
fn the_examples_are_printed_as_they_stand() {
    assert_eq!(MODEL.parse::<Model>().map(|model| model.to_string()).as_deref(), Ok(MODEL));
    assert_eq!(STEP.parse::<StepGraph>().map(|graph| graph.to_string()).as_deref(), Ok(STEP));
}

#[test]
fn errors_say_where_and_what() {
    let broken = |text: &str, from: &str, to: &str| text.replacen(from, to, 1);
    for (text, expected) in [
        (broken(MODEL, "pe-synth model 1", "pe-synth model 2"), "line 1, column 1: expected version 1"),
        (broken(MODEL, "solver rk4", "solver rk5"), "line 4, column 8: expected one of euler, heun"),
        (broken(MODEL, "10*y[1]", "10*v"), "column 11: no variable is called `v`"),
        (broken(MODEL, "x' =", "z' ="), "expected the equation `x' = ...`, found `z`"),
        (broken(MODEL, "span 2", "span 0.001"), "line 1, column 1: this is no valid model"),
        (broken(MODEL, "step 0.01", "step 1e999"), "a number too large for double precision"),
        (broken(STEP, "2^-1*", "2^0.5*"), "expected `*`, found `.5*("),
        (broken(STEP, "pe-synth step", "pe-synth stairs"), "line 1, column 1: `stairs` is no stage"),
    ] {
        let error = match text.contains("model") {
            true => text.parse::<Model>().map(|_| ()).unwrap_err(),
            false => text.parse::<StepGraph>().map(|_| ()).unwrap_err(),
        };
        assert!(error.to_string().contains(expected), "{error}");
    }
}

/// A text with a few letters, fields or lines changed, left out or doubled.
fn damaged(text: &str, seed: &mut u64) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..1 + next(seed) % 3 {
        let at = next(seed) as usize % bytes.len();
        let end = (at + 1 + next(seed) as usize % 12).min(bytes.len());
        match next(seed) % 5 {
            // Something is left.
            0 => drop(bytes.drain(at..end.min(at + bytes.len() - 1))),
            1 => bytes[at] = b" \n()*+-^=.,:#\"\\'0129aexz"[next(seed) as usize % 24],
            2 => {
                let copy = bytes[at..end].to_vec();
                let to = next(seed) as usize % bytes.len();
                bytes.splice(to..to, copy);
            }
            3 => bytes.truncate(at.max(1)),
            _ => {
                let lines: Vec<&[u8]> = bytes.split_inclusive(|byte| *byte == b'\n').collect();
                let (one, other) = (next(seed) as usize % lines.len(), next(seed) as usize % lines.len());
                let mut lines = lines;
                lines.swap(one, other);
                bytes = lines.concat();
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[test]
fn damaged_texts_are_refused_or_valid_and_never_panic() {
    let mut seed = 3;
    let mut refused = [0; 2];
    for _ in 0..20_000 {
        match damaged(MODEL, &mut seed).parse::<Model>() {
            Ok(model) => assert_eq!(crate::verify::model::check(&model), Vec::<String>::new()),
            Err(error) => {
                assert!(error.line > 0 && error.column > 0 && !error.message.is_empty());
                refused[0] += 1;
            }
        }
        match damaged(STEP, &mut seed).parse::<StepGraph>() {
            Ok(graph) => assert_eq!(crate::verify::step::check(&graph), Vec::<String>::new()),
            Err(error) => {
                assert!(error.line > 0 && error.column > 0 && !error.message.is_empty());
                refused[1] += 1;
            }
        }
    }
    assert!(refused.iter().all(|refused| *refused > 10_000), "{refused:?}");
}

#[test]
fn stages_come_in_order() {
    let header = |stage: Stage| format!("{}\n", stage.header());
    let found = |text: &str| sections(text).map(|found| found.iter().map(|section| section.stage).collect::<Vec<_>>());
    assert_eq!(found(&Stage::ALL.map(header).concat()), Ok(Stage::ALL.to_vec()));
    let late = found(&(header(Stage::Step) + &header(Stage::Model))).unwrap_err();
    assert_eq!((late.line, late.column), (2, 1));
    assert!(found("").is_err() && found("# nothing\n\nstep 1\n").is_err());
}
