//! Data files: parameters, initial values and sampled inputs, and what is said about files that do not fit.

mod common;

use pe_frontend::{Overrides, compile};
use pe_ir::model::{Model, Waveform};
use pe_ir::source::Sources;
use std::collections::BTreeMap;

/// Compiles statements beside a file `t.csv`; findings one per line with code, place and message.
fn build(statements: &str, table: &str) -> Result<Model, String> {
    let text = format!("model m\nsolver rk4\nstep 1 ms\nspan 1 s\nindex b in 1..3\n{statements}");
    let mut sources = Sources::new("m.spec", &text);
    let files = BTreeMap::from([("t.csv".to_owned(), table.as_bytes().to_vec())]);
    compile(&mut sources, &files, &Overrides::default()).map(|(model, _)| model).map_err(|errors| {
        let line = |error: &pe_ir::source::Diagnostic| {
            let at = error.span.map(|span| sources.position(span.start));
            let at = at.map_or_else(String::new, |at| format!("{}:{}:{}", at.file, at.line, at.column));
            format!("{} {at} {}\n", error.code, error.message)
        };
        errors.iter().map(line).collect()
    })
}

const X: &str = "state x[b] = data(\"t.csv\", \"v\")*2\nx[b]' = -x[b]\noutput x";

fn initial(statements: &str, table: &str) -> Vec<f64> {
    let model = build(statements, table).unwrap_or_else(|errors| panic!("{errors}"));
    model.states.iter().map(|state| state.initial).collect()
}

fn errors(statements: &str, table: &str) -> String {
    build(statements, table).expect_err("it must not compile")
}

#[test]
fn rows_belong_to_elements_in_order_or_by_key() {
    assert_eq!(initial(X, "v\n1\n2\n3"), [2.0, 4.0, 6.0]);
    assert_eq!(initial(X, "v,b\n1,3\n2,1\n3,2"), [4.0, 6.0, 2.0]);
    let matrix = "state x[i in 0..1, j in 1..2] = data(\"t.csv\", \"v\")\nx[i, j]' = -x[i, j]\noutput x";
    assert_eq!(initial(matrix, "v\n1\n2\n3\n4"), [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(initial(matrix, "j,i,v\n1,0,1\n1,1,3\n2,0,2\n2,1,4"), [1.0, 2.0, 3.0, 4.0]);
    // Only what is asked for has to be a number.
    assert_eq!(initial(X, "name, v\nleft, 1\n, 2\n\"a, b\", 3"), [2.0, 4.0, 6.0]);
    let scalar = "param p = data(\"t.csv\", \"v\")\nstate x = p\nx' = -x\noutput x";
    assert_eq!(initial(scalar, "v\n7"), [7.0]);
}

#[test]
fn what_does_not_fit_is_shown_in_the_file() {
    let cases = [
        ("v\n1\n2", "E0508 m.spec:6:19 the file has 2 rows for 3 element(s) of `x`\n"),
        ("v\n1\n2\n3\n4", "E0508 m.spec:6:19 the file has 4 rows for 3 element(s) of `x`\n"),
        ("v\n1\nx2\n", "E0509 t.csv:3:1 this is not a finite number\n"),
        (
            "a,v\n1,1\n2,\n3,NaN",
            "E0509 t.csv:3:3 a number is missing here\nE0509 t.csv:4:3 this is not a finite number\n",
        ),
        ("v\n1e999\n2\n3", "E0509 t.csv:2:1 this is not a finite number\n"),
        ("v,b\n1,1\n2,2\n3,4", "E0508 t.csv:4:3 `b` is an integer from 1 to 3\n"),
        ("v,b\n1,1\n2,2\n3,2.5", "E0508 t.csv:4:3 `b` is an integer from 1 to 3\n"),
        ("v,b\n1,1\n2,2\n3,2", "E0508 t.csv:4:3 a second row for `x[2]`\n"),
        ("v,b\n1,1\n2,2", "E0508 m.spec:6:19 the file has no row for `x[3]`\n"),
        ("V\n1\n2\n3", "E0201 m.spec:6:28 the file has no column `v`\n"),
        ("v,v\n1,1", "E0508 m.spec:6:28 the file has two columns `v`\n"),
        ("v,w\n1,1\n2\n3,3", "E0508 t.csv:3:1 this row has 1 cells, the header 2\n"),
        ("", "E0508 t.csv:1:1 the file holds no table: its first row has to name the columns\n"),
    ];
    for (table, wanted) in cases {
        assert_eq!(errors(X, table), wanted, "{table:?}");
    }
    let flood = "v\n".to_owned() + &"x\n".repeat(100_000);
    assert_eq!(errors(X, &flood).lines().count(), 5);
    assert!(
        errors("y = data(\"t.csv\", \"v\")\nstate x = 0\nx' = y\noutput x", "v\n1").starts_with("E0208 m.spec:6:10")
    );
    assert!(errors("param p = data(\"u.csv\", \"v\")\nstate x = p\nx' = -x\noutput x", "").starts_with("E0111"));
}

#[test]
fn samples_become_a_signal_over_time() {
    let input =
        |kind: &str| format!("input u = samples(\"t.csv\", \"p\", {kind}) in -9 .. 9\nstate x = 0\nx' = u\noutput x");
    let model =
        build(&input("linear"), "t [ms], p [Pa]\n0, 1\n500, 2\n1000, -3").unwrap_or_else(|errors| panic!("{errors}"));
    let Waveform::Samples(samples) = &model.inputs[0].waveform else { panic!("{:?}", model.inputs[0]) };
    assert_eq!((samples.times(), samples.values()), (&[0.0, 0.5, 1.0][..], &[1.0, 2.0, -3.0][..]));
    assert_eq!(model.inputs[0].waveform.at(0.25), 1.5);
    let held = build(&input("hold"), "t,p\n0,1\n1,2").unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(held.inputs[0].waveform.at(0.9), 1.0);

    assert!(errors(&input("cubic"), "t,p\n0,1").starts_with("E0202 m.spec:6:33 unknown interpolation `cubic`"));
    assert!(errors(&input("hold"), "t,p\n0,1\n0,2").starts_with("E0508 t.csv:3:1 this time is not later"));
    assert!(errors(&input("hold"), "t [Pa],p\n0,1").starts_with("E0204 t.csv:1:1 "));
    assert!(errors(&input("hold"), "t,p\n").starts_with("E0508 t.csv:1:3 the file holds no samples"));
}

#[test]
fn pulses_and_ramps_take_times() {
    let model = build(
        "input a = pulse(5, 100 ms, 0.2)\ninput c = pulse(-1, 0, 1 ms, 2, 4 ms)\ninput d = ramp(1, 3, 1 min, 2 s)\nstate x = 0\nx' = a + c + d\noutput x",
        "",
    );
    let model = model.unwrap_or_else(|errors| panic!("{errors}"));
    let waveforms: Vec<Waveform> = model.inputs.into_iter().map(|input| input.waveform).collect();
    let period = f64::INFINITY;
    let wanted = [
        Waveform::Pulse { height: 5.0, start: 0.1, width: 0.2, offset: 0.0, period },
        Waveform::Pulse { height: -1.0, start: 0.0, width: 1e-3, offset: 2.0, period: 4e-3 },
        Waveform::Ramp { from: 1.0, to: 3.0, start: 60.0, duration: 2.0 },
    ];
    assert_eq!(waveforms, wanted);
    for bad in
        ["pulse(1, -1, 1)", "pulse(1, 0, 2, 0, 1)", "pulse(1, 0, 0, 0, 0)", "ramp(0, 1, 0, 0)", "ramp(0, 1, 0, -1)"]
    {
        assert!(errors(&format!("input a = {bad}\nstate x = 0\nx' = a\noutput x"), "").starts_with("E0507"), "{bad}");
    }
}

#[test]
fn stated_ranges_of_algebraic_quantities_reach_the_model() {
    let model =
        build("state x[b] = 0\nx[b]' = p[b]\np[b] [W] = -x[b] in -b .. 2*b where b != 2\np[2] = x[1]\noutput x", "");
    let model = model.unwrap_or_else(|errors| panic!("{errors}"));
    let ranges: Vec<_> = model.algebraics.iter().map(|algebraic| (algebraic.name.as_str(), algebraic.range)).collect();
    assert_eq!(ranges, [("p[1]", Some((-1.0, 2.0))), ("p[2]", None), ("p[3]", Some((-3.0, 6.0)))]);
    assert!(errors("state x = 0\nx' = 1 in 0 .. 1\noutput x", "").starts_with("E0306 m.spec:7:11 "));
    assert!(errors("state x = 0\nx' = a\na = x in 1 .. 1\noutput x", "").starts_with("E0506"));
}
