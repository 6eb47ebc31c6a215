//! Data files: parameters, initial values and sampled inputs, and what is said about files that do not fit.

mod common;

use pe_frontend::{Overrides, compile};
use pe_ir::model::{Model, Waveform};
use pe_ir::source::Sources;
use std::collections::BTreeMap;

/// Compiles statements beside a file `t.csv`; findings one per line with code, place and message.
fn build(statements: &str, table: &str) -> Result<Model, String> {
    with_warnings(statements, table).map(|(model, _)| model)
}

/// The same with the warnings.
fn with_warnings(statements: &str, table: &str) -> Result<(Model, String), String> {
    let text = format!("model m\nsolver rk4\nstep 1 ms\nspan 1 s\nindex b in 1..3\n{statements}");
    let mut sources = Sources::new("m.spec", &text);
    let files = BTreeMap::from([("t.csv".to_owned(), table.as_bytes().to_vec())]);
    let result = compile(&mut sources, &files, &Overrides::default());
    let lines = |findings: &[pe_ir::source::Diagnostic]| -> String {
        let line = |finding: &pe_ir::source::Diagnostic| {
            let at = finding.span.map(|span| sources.position(span.start));
            let at = at.map_or_else(String::new, |at| format!("{}:{}:{}", at.file, at.line, at.column));
            format!("{} {at} {}\n", finding.code, finding.message)
        };
        findings.iter().map(line).collect()
    };
    result.map(|(model, warnings)| (model, lines(&warnings))).map_err(|errors| lines(&errors))
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

/// The right-hand side of the first state, with names.
fn right_side(statements: &str, table: &str) -> String {
    let model = build(statements, table).unwrap_or_else(|errors| panic!("{errors}"));
    let text = model.to_string();
    text.lines().find_map(|line| line.trim().strip_prefix("x[2]' = ")).expect("it is there").to_owned()
}

#[test]
fn sums_over_rows_take_those_that_the_condition_chooses() {
    let edges = "from, to, weight [1/s]\n1,2,0.5\n3,2,-1\n2,1,4\n# none\n3,3,7\n1,2,0.25\n";
    let sum = |inside: &str| format!("state x[b] = 1\nx[b]' = sum(e in rows(\"t.csv\") {inside})\noutput x");
    // By the index that is made of the condition, in any order and beside other parts, and without one.
    let all = right_side(&sum("where e.to == b: e.weight*x[e.from]"), edges);
    assert_eq!(all, right_side(&sum("where b == e.to: e.weight*x[e.from]"), edges));
    assert_eq!(all, right_side(&sum("where e.to - b == 0: e.weight*x[e.from]"), edges));
    assert_eq!(all, right_side(&sum("where e.weight != 4 and e.to == b: x[e.from]*e.weight"), edges));
    let written = build(
        "state x[b] = 1\nx[b]' = if b == 2 then 0.5*x[1] - x[3] + 0.25*x[1] else if b == 1 then 4*x[2] else 7*x[3]\noutput x",
        "",
    );
    let rows = build(&sum("where e.to == b: e.weight*x[e.from]"), edges);
    assert_eq!(written.unwrap().to_string(), rows.unwrap().to_string());
    // In functions of numbers alone, in parameters, and one in the other.
    let nested = "param k[b] = sum(e in rows(\"t.csv\") where e.to == b: e.weight)\nstate x[b] = 1\n\
                  x[b]' = sum(c in 1..3, e in rows(\"t.csv\") where e.to == c and c == b: k[c]*x[e.from])\noutput x";
    assert_eq!(right_side(nested, edges), right_side(&sum("where e.to == b: -0.25*x[e.from]"), edges));
    // No row is zero; both zeros are one number.
    assert_eq!(right_side(&sum("where e.to == 9*b: x[e.from]"), edges), "0");
    assert_eq!(right_side(&sum("where e.z == 0*b: x[b]"), "z\n-0\n"), "x[2]");
}

#[test]
fn a_sum_over_no_rows_is_told() {
    let sum = |inside: &str| {
        format!("state x[b] = 1\nx[b]' = -x[b] + sum(e in rows(\"t.csv\") {inside}: e.weight*x[e.from])\noutput x")
    };
    let warnings =
        |inside: &str, table: &str| with_warnings(&sum(inside), table).unwrap_or_else(|errors| panic!("{errors}")).1;
    let edges = "from,to,weight\n2,1,4\n1,2,0.5\n";
    // Those of element 3 are none, those of others are.
    assert_eq!(warnings("where e.to == b", edges), "");
    let told = "W0006 m.spec:7:17 nothing is summed here: no row is chosen, so the sum is always 0\n";
    assert_eq!(warnings("where e.to == b + 5", edges), told);
    assert_eq!(warnings("where e.to == b", "from,to,weight\n"), told);
    assert_eq!(warnings("", "from,to,weight\n"), told);
}

#[test]
fn units_in_headers_are_checked_where_no_other_unit_is_written() {
    let text = "state x[b] = 1\nx[b]' = sum(e in rows(\"t.csv\") where e.to == b: x[e.from](t - e.delay))\noutput x";
    let (_, warnings) = with_warnings(text, "from,to,delay [ms]\n1,2,0.02\n3,1,0.04\n").unwrap();
    assert!(warnings.contains("W0701") && warnings.contains("[s] and [ms] differ by a factor"), "{warnings}");
    let (_, warnings) = with_warnings(text, "from,to,delay [s]\n1,2,0.02\n3,1,0.04\n").unwrap();
    assert_eq!(warnings, "");
}

#[test]
fn delays_may_come_from_rows() {
    let text = right_side(
        "state x[b] = 1\nx[b]' = sum(e in rows(\"t.csv\") where e.to == b: x[e.from](t - e.delay))\noutput x",
        "from,to,delay\n1,2,0.02\n3,1,0.04\n",
    );
    assert!(text.contains("x[1](t-0.02)"), "{text}");
}

#[test]
fn rows_that_do_not_fit_a_sum_are_told() {
    let sum =
        |inside: &str| format!("state x[b] = 1\nx[b]' = -x[b]\ny = sum(e in rows(\"t.csv\") {inside})\noutput x, y");
    let edges = "from,to,note\n1,2,a\n4,2,b\n2.5,1,c\n";
    for (inside, wanted) in [
        (": e.form", "E0201"),
        (": e.note", "E0509 t.csv:2:5 this is not a finite number"),
        ("where e.to == 2: x[e.from]", "E0501"),
        ("where e.to == 1: x[e.from]", "E0408"),
        ("where x[1] > 0: e.to", "E0405"),
        (": e.to[1]", "E0207"),
        (": e", "E0208"),
        (": from", "E0201"),
    ] {
        let found = errors(&sum(inside), edges);
        assert!(found.starts_with(wanted), "{inside}: {found}");
    }
    assert!(errors(&sum(": e.to").replace("t.csv", "u.csv"), edges).starts_with("E0111"));
    assert!(errors(&sum(": e.to"), "from,to\n1\n").starts_with("E0508 t.csv:2:1 this row has 1 cells"));
    let outside = "state x[b] = 1\nx[b]' = -x[b]\ny = sum(e in rows(\"t.csv\"): e.to) + e.to\noutput x, y";
    assert!(errors(outside, edges).starts_with("E0201"));
}

/// 100,000 synapses between 1,000 neurons, with a delay each: rows are found by the condition, and not looked through for each.
#[test]
fn a_hundred_thousand_rows_take_seconds() {
    let mut table = String::from("from,to,weight,delay\n");
    for row in 0..100_000u32 {
        let (from, to, delay) = (1 + row % 1000, 1 + (row / 1000 * 37 + row * 7) % 1000, 1 + row / 7 % 20);
        table += &format!("{from},{to},0.{row},{delay}\n");
    }
    let text = "model m\nsolver euler\nstep 1 ms\nspan 1 s\ntime [ms]\nindex i in 1..1000\nstate s[i] = 0\n\
                s[i]' = sum(e in rows(\"t.csv\") where e.to == i: e.weight*s[e.from](t - e.delay))\noutput s[1]\n";
    let files = BTreeMap::from([("t.csv".to_owned(), table.into_bytes())]);
    let begin = std::time::Instant::now();
    let (model, _) = pe_frontend::compile(&mut Sources::new("m.spec", text), &files, &Overrides::default()).unwrap();
    let seconds = begin.elapsed().as_secs_f64();
    println!("{} states in {seconds:.1} s", model.states.len());
    assert_eq!(model.states.len(), 8_000);
    assert!(seconds < 60.0, "{seconds:.0} s");
}
