//! Functions written with constants of their own have one shape, and what is only close to it has not.

use pe_ir::functions::ScalarFunction;
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Function, Variable};
use pe_ir::word::WordFormat;

use super::shape::{Shaped, shaped};
use super::share::Member;

const FORMAT: WordFormat = WordFormat::new(32, 32, 32);

fn x() -> Expr {
    Expr::Variable(Variable::State(StateId::new(0)))
}

fn apply(function: Function, argument: Expr) -> Expr {
    Expr::Apply(function, Box::new(argument))
}

fn over(above: Expr, below: Expr) -> Expr {
    Expr::product(vec![above, apply(Function::Reciprocal, below)])
}

fn plus(expr: Expr, number: f64) -> Expr {
    Expr::sum(vec![expr, Expr::Constant(number)])
}

fn scalar(body: &Expr) -> ScalarFunction {
    ScalarFunction {
        name: body.text(&|_, _| "x".to_owned()),
        body: body.clone(),
        variable: Variable::State(StateId::new(0)),
    }
}

/// Numbers between 0 and 1.
fn noise() -> impl FnMut() -> f64 {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Members of families, with numbers of their own.
type Make = fn(&mut dyn FnMut() -> f64) -> Expr;

fn kinds() -> Vec<(&'static str, Make)> {
    vec![
        ("activation", |next| {
            let k = 0.1 + next();
            Expr::scaled(0.2 + next(), over(Expr::power(x(), 2), plus(Expr::power(x(), 2), k)))
        }),
        ("repression", |next| {
            let c = 0.1 + 2.0 * next();
            Expr::scaled(0.2 + next(), over(Expr::Constant(1.0), plus(Expr::scaled(c, Expr::power(x(), 2)), 1.0)))
        }),
        ("repression of fourth order beside a decay", |next| {
            let hill = over(Expr::Constant(0.5 + next()), plus(Expr::power(x(), 4), 0.3 + next()));
            Expr::sum(vec![hill, Expr::scaled(-next(), x()), Expr::Constant(next())])
        }),
        ("repression of broken order", |next| {
            over(Expr::Constant(1.0 + next()), plus(apply(Function::RealPower(2.5), x()), 0.3 + next()))
        }),
        ("saturation", |next| over(x(), plus(x(), 0.2 + next()))),
        ("hyperbola", |next| over(Expr::Constant(1.0 + next()), plus(Expr::scaled(0.5 + next(), x()), 0.2 + next()))),
        ("root", |next| apply(Function::Sqrt, plus(Expr::scaled(0.5 + next(), x()), 0.2 + next()))),
        ("exponential", |next| {
            Expr::scaled(1.0 + next(), apply(Function::Exp, plus(Expr::scaled(-0.5 - next(), x()), next())))
        }),
        ("rising sigmoid", |next| {
            let argument = Expr::scaled(-0.5 - next(), plus(x(), -next()));
            over(Expr::Constant(1.0 + next()), plus(Expr::scaled(0.5 + next(), apply(Function::Exp, argument)), 1.0))
        }),
        ("sine", |next| apply(Function::Sin, plus(Expr::scaled(0.5 + next(), x()), next()))),
        ("gate", |next| {
            let (centre, slope) = (next(), -1.0 - next());
            let moved = plus(x(), -centre);
            let fallen = apply(Function::Exp, Expr::scaled(slope, moved.clone()));
            over(Expr::scaled(0.1 + next(), moved), plus(Expr::scaled(-1.0, fallen), 1.0))
        }),
    ]
}

#[test]
fn members_of_a_family_have_its_shape_and_no_other() {
    let mut next = noise();
    let mut keys: Vec<String> = Vec::new();
    for (kind, make) in kinds() {
        let first = shaped(&scalar(&make(&mut next))).unwrap_or_else(|| panic!("{kind}"));
        for _ in 0..40 {
            let function = scalar(&make(&mut next));
            let own = shaped(&function).unwrap_or_else(|| panic!("{kind}: {}", function.name));
            assert_eq!(own.key, first.key, "{kind}: {}", function.name);
            let member = Member::proven(&function, &scalar(&first.body), &own, (0.1, 2.5), FORMAT);
            assert!(member.is_some(), "{kind}: {} as {}", function.name, scalar(&first.body).name);
        }
        assert!(!keys.contains(&first.key), "{kind}: {}", first.key);
        keys.push(first.key);
    }
}

#[test]
fn what_is_not_quite_its_shape_is_not_taken_for_it() {
    let mut next = noise();
    for (kind, make) in kinds() {
        let function = scalar(&make(&mut next));
        let own = shaped(&function).expect(kind);
        let shape = scalar(&own.body);
        let proven = |function: &ScalarFunction, own: &Shaped| {
            Member::proven(function, &shape, own, (0.1, 2.5), FORMAT).is_some()
        };
        assert!(proven(&function, &own), "{kind}");
        let close = 1.0 + 1e-9;
        let damages: [fn(&mut Shaped, f64); 4] = [
            |own, close| own.factor *= close,
            |own, close| own.slope *= close,
            |own, close| own.beside.0 += close - 1.0,
            |own, close| own.beside.1 += close - 1.0,
        ];
        for (number, damage) in damages.into_iter().enumerate() {
            // A square root of a scaled argument is a scaled one: only both damages together would be none.
            let mut other = own.clone();
            damage(&mut other, close);
            assert!(!proven(&function, &other), "{kind}, damage {number}");
        }
        // A function that is a little more than its shape.
        let body = Expr::sum(vec![function.body.clone(), Expr::scaled(1e-9, Expr::power(x(), 3))]);
        assert!(!proven(&scalar(&body), &own), "{kind}");
    }
}

#[test]
fn shapes_tell_functions_apart() {
    let hill = |power: u32, below: Expr| over(Expr::Constant(1.0), Expr::sum(vec![Expr::power(x(), power), below]));
    let different = [
        hill(2, Expr::Constant(0.4)),
        hill(3, Expr::Constant(0.4)),
        hill(2, Expr::Constant(-0.4)),
        Expr::sum(vec![hill(2, Expr::Constant(0.4)), Expr::power(x(), 2)]),
        hill(4, plus(Expr::scaled(0.3, Expr::power(x(), 2)), 0.4)),
        hill(4, plus(Expr::scaled(0.3000001, Expr::power(x(), 2)), 0.4)),
        apply(Function::Exp, Expr::scaled(-1.0, Expr::power(x(), 2))),
        over(Expr::Constant(1.0), plus(apply(Function::Exp, x()), 1.0)),
        over(Expr::Constant(1.0), plus(apply(Function::Exp, x()), -1.0)),
        over(Expr::Constant(1.0), plus(apply(Function::Exp, Expr::scaled(2.0, x())), -1.0)),
    ];
    let keys: Vec<String> = different[..9].iter().filter_map(|body| Some(shaped(&scalar(body))?.key)).collect();
    for (number, key) in keys.iter().enumerate() {
        assert!(!keys[..number].contains(key), "{key}");
    }
    let two = [&different[8], &different[9]].map(|body| shaped(&scalar(body)).expect("a shape").key);
    assert_eq!(two[0], two[1]);
}
