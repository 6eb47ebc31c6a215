//! What users of other languages write gets one finding that says how it is written here.

use pe_frontend::{NoFiles, Overrides, compile};
use pe_ir::source::{Diagnostic, Sources};

/// A spec that is right but for the lines in its middle.
fn findings(lines: &str) -> Vec<Diagnostic> {
    let text = format!(
        "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nindex i in 1..3\nparam k = 2\nstate y[i] = 1\ny[i]' = -k*y[i]\noutput y\n{lines}\n"
    );
    let mut sources = Sources::new("m.spec", &text);
    match compile(&mut sources, &NoFiles, &Overrides::default()) {
        Ok((_, warnings)) => warnings,
        Err(findings) => findings,
    }
}

/// With the state `x` declared.
fn of_x(line: &str) -> Vec<Diagnostic> {
    findings(&format!("state x = 1\n{line}\noutput x"))
}

fn told(finding: &Diagnostic) -> String {
    format!("{} | {}", finding.message, finding.help.as_deref().unwrap_or(""))
}

#[track_caller]
fn check(all: Vec<Diagnostic>, line: &str, wanted: &str) {
    let [one] = all.as_slice() else { panic!("{line}: {:?}", all.iter().map(told).collect::<Vec<_>>()) };
    assert!(told(one).contains(wanted), "{line}: {}", told(one));
}

#[test]
fn left_sides_of_other_languages() {
    for left in ["dx/dt", "der(x)", "d(x)/dt", "d/dt x", "ddt(x)", "diff(x, t)", "x'(t)", "D(x)"] {
        check(of_x(&format!("{left} = -x")), left, "a derivative is written `x' = ...`");
    }
    check(of_x("xdot = -x"), "xdot", "that is written `x' = ...`");
    check(of_x("dxdt = -x"), "dxdt", "that is written `x' = ...`");
    check(of_x("x'' = -x"), "x''", "`x' = v` and `v' = ...`");
    check(of_x("x' == -x"), "==", "one `=`");
    check(of_x("x' := -x"), ":=", "`=` alone");
    check(of_x("x' += -x"), "+=", "`=` alone");
    check(of_x("x' = -x\nx(0) = 1"), "x(0)", "`state x = ...`");
    check(of_x("x' = -x\nz(t) = x"), "z(t)", "`z = ...`");
}

#[test]
fn right_sides_of_other_languages() {
    for (right, wanted) in [
        ("x > 0 ? 1 : 2", "`if c then a else b`"),
        ("if(x > 0, 1, 2)", "`if c then a else b`"),
        ("1 if x > 0 else 2", "`if c then a else b`"),
        ("if x > 0 then 1 else 2 end", "without a word at its end"),
        ("(5 V - x)", "`5 [V]`"),
        ("2x", "`2*x`"),
        ("2(x + 1)", "needs its sign"),
        ("k(x + 1)", "`k*(...)`"),
        ("x(t)", "`x` alone"),
        ("clamp(x, 0, 1)", "min(max(x, lo), hi)"),
        ("atan2(x, 2)", "atan(y/x)"),
        ("ln(x)", "`log(x)`"),
        ("pow(x, 2)", "`x^2`"),
        ("sqr(x)", "`x^2`"),
        ("atanh(x)", "0.5*log"),
        ("step(1, 0.5 s)", "pulse(1, 0.5 s, 1e9 s)"),
        ("delay(x, 2)", "there is no such function"),
        ("edge(x > 1)", "`when x > 1 { x = 0 }`"),
        ("file(\"u.csv\")", "`samples(\"u.csv\", \"column\", linear)`"),
        ("piecewise(1, x > 2, 3)", "if c then a else b"),
        ("x**2", "`x^2`"),
        ("x .^ 2", "element by element"),
        ("x % 2", "`a mod b`"),
        ("1_000*x", "`1000`"),
        ("min(0,5*x)", ""),
        ("x && 1", "`and`"),
        ("!x", "`not`"),
        ("der(x)", "name its right-hand side"),
        ("x'", "alone on the left"),
        ("sum(y)", "`sum(i: x[i])`"),
        ("sum(i = 1..3: y[i])", "`i in 1..5`"),
        ("y[1:3]", "`1..5`"),
        ("sin(x, 2)", "takes 1 argument"),
        ("sine(x)", ""),
        ("x \u{d7} 2", "`*`"),
        ("x\u{b2}", "`x^2`"),
        ("\u{3c0}*x", "`pi`"),
    ] {
        let all = of_x(&format!("x' = {right}"));
        if wanted.is_empty() {
            continue;
        }
        check(all, right, wanted);
    }
}

#[test]
fn suggestions_take_as_many_arguments() {
    for (call, never) in
        [("atan3(x, 2)", "`atan`"), ("sinn(x, 2)", "`sin`"), ("mini(x)", "`min`"), ("dott(x)", "`dot`")]
    {
        let all = of_x(&format!("x' = {call}"));
        assert!(all.iter().all(|finding| !told(finding).contains(never)), "{call}: {all:?}");
    }
    check(of_x("x' = sinn(x)"), "sinn", "did you mean `sin`?");
}

#[test]
fn statements_of_other_languages() {
    for (line, wanted) in [
        ("parameter a = 1", "`param k = 1`"),
        ("Real z", "`state x = 0`"),
        ("initial x = 1", "stands in the declaration"),
        ("equation", "no sections"),
        ("def f(x) = 2", "`function f(x) = x^2`"),
        ("import math", "include"),
        ("step = 1 ms", "takes no `=`"),
        ("index j = 1..3", "`i in 1..5`"),
        ("print x", "`output x`"),
        ("output 2*x", "`output y`"),
        ("output x + 1", "`output y`"),
        ("output x(t - 1)", "`output y`"),
        ("z = 0,5", "a point"),
        ("param A[i, j in 1..2] = [1 2; 3 4; 5 6]", "parted by commas"),
    ] {
        let all = findings(line);
        let first = all.first().unwrap_or_else(|| panic!("{line} is accepted"));
        assert!(all.iter().any(|finding| told(finding).contains(wanted)), "{line}: {} {all:?}", told(first));
    }
}

#[test]
fn solvers_of_other_tools() {
    for (name, wanted) in
        [("rk45", "steps are fixed"), ("cvode", "stiff"), ("crank_nicolson", "trapezoidal"), ("rkk4", "did you mean")]
    {
        let text = format!("model m\nsolver {name}\nstep 1 ms\nspan 1 s\nstate x = 1\nx' = -x\noutput x\n");
        let mut sources = Sources::new("m.spec", &text);
        let all = compile(&mut sources, &NoFiles, &Overrides::default()).expect_err("no such solver");
        check(all, name, wanted);
    }
}

#[test]
fn what_is_allowed_beside_what_other_languages_write() {
    for lines in [
        "index j in 1..2\nz = sum(i, j: y[i]*j)",
        "z = sum(i, j in 1..i where j > 1: y[j])",
        "input u = 2*sine(1, 50 Hz) + 1\nz = u",
        "input u = pulse(1, 0.5 s, 1e9 s)\nz = u",
        "z = y[1] + 0.02 [mM]",
    ] {
        let all = findings(&format!("{lines}\noutput z"));
        assert!(all.iter().all(|finding| finding.code.starts_with('W')), "{lines}: {all:?}");
    }
}

#[test]
fn numbers_with_a_unit_are_checked_like_names_with_one() {
    let model = |line: &str| {
        let text = format!(
            "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nunits strict\nstate c [mM] = 1\nstate r = 0\n{line}\noutput c, r\n"
        );
        let mut sources = Sources::new("m.spec", &text);
        match compile(&mut sources, &NoFiles, &Overrides::default()) {
            Ok((_, warnings)) => warnings,
            Err(findings) => findings,
        }
    };
    let right = "r' = (1/(1 + c/0.02 [mM]))*1 [1/s]\nc' = -c/2 [s]";
    assert_eq!(model(right), []);
    check(model("r' = 1 [1/s]\nc' = c*3 [mM/s]"), "product", "units do not agree");
    check(model("r' = 1 [1/s]\nc' = c/2 [ms]"), "factor", "differ by a factor");
    check(model("r' = 1 [1/s]\nc' = c/2 [floz]"), "unknown", "floz");
    check(model("r' = 1 [1/s]\nc' = -c^2 [s]/1 [s]"), "exponent", "[1] is needed here");
}

#[test]
fn ranges_without_values_are_told_at_their_places() {
    let warned = |lines: &str| -> Vec<String> { findings(lines).iter().map(told).collect() };
    let sums = warned("z = sum(j in 5..4: y[j])\noutput z");
    assert!(sums.len() == 1 && sums[0].contains("`5..4` is empty"), "{sums:?}");
    let equations = warned("const n = 1\nz[i] = y[i] for i in 2..n\nz[i] = 2*y[i] for i in 1..3\noutput z");
    assert!(equations.len() == 1 && equations[0].contains("`2..1` is empty"), "{equations:?}");
    // Empty for some elements is how triangles are written.
    assert_eq!(warned("z[i] = sum(j in 1..i - 1: y[j])\noutput z"), [""; 0]);
}
