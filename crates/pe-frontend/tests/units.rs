//! Checked units: what agrees, what is said where it does not, and how functions of the spec behave.

mod common;

use common::{derivatives, model, root, source, specs};
use pe_frontend::{NoFiles, Overrides, Units, compile};
use pe_ir::source::{Diagnostic, Severity};

const HEAD: &str = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\n";

fn findings(statements: &str, units: Option<Units>) -> Vec<Diagnostic> {
    let overrides = Overrides { units, ..Overrides::default() };
    match compile(&mut source(&format!("{HEAD}{statements}")), &NoFiles, &overrides) {
        Ok((_, warnings)) => warnings,
        Err(errors) => errors,
    }
}

#[test]
fn a_difference_in_size_is_named_and_both_sides_are_shown() {
    let text = "state V [L] = 0\nparam Q [mL/s] = 3\nV' = Q\noutput V";
    let found = findings(text, None);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((found[0].code, found[0].severity), ("W0701", Severity::Warning));
    assert_eq!(found[0].message, "[L/s] and [mL/s] differ by a factor: 1 mL/s is 0.001 L/s");
    let labels: Vec<&str> = found[0].labels.iter().map(|(_, text)| text.as_str()).collect();
    assert_eq!(labels, ["[L/s]", "[mL/s]"]);
    assert_eq!(findings(text, Some(Units::Strict))[0].code, "E0701");
    assert_eq!(findings(text, Some(Units::Off)), []);
    // The command line goes before the spec's word.
    assert_eq!(findings(&format!("units strict\n{text}"), Some(Units::Off)), []);
    assert_eq!(findings(&format!("{text}\nunits strict"), None)[0].code, "E0701");
    assert_eq!(
        findings(&format!("{text}\nparam k [L/mL] = 0.001").replace("V' = Q", "V' = k*Q"), Some(Units::Strict)),
        []
    );
}

#[test]
fn units_follow_definitions_through_names_without_units() {
    let text = "param R [Ohm] = 2\nparam C [F] = 3\nparam tau = R*C\nstate v [V] = 0\ni = v/R\nv' = -i/C + j/tau\nj = 2*i\noutput v";
    let found = findings(text, None);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].message.starts_with("units do not agree: [V/s] and ["), "{}", found[0].message);
    assert!(found[0].help.as_deref().is_some_and(|help| help.starts_with("check the equation")), "{:?}", found[0].help);
    // Without a unit anything goes, unless strictly: there a variable is a number.
    let loose = "state x [m] = 0\nstate y = 0\nx' = y\ny' = x\noutput x";
    assert_eq!(findings(loose, None), []);
    assert_eq!(findings(loose, Some(Units::Strict)).len(), 2);
    let numbers = "param k = 2\nstate x = 0\nx' = -k*x\noutput x";
    assert_eq!(findings(numbers, Some(Units::Strict)), []);
}

#[test]
fn every_shipped_model_passes_strictly() {
    for path in specs(&root().join("models")) {
        let text = std::fs::read_to_string(&path).expect("the spec can be read");
        let overrides = Overrides { units: Some(Units::Strict), ..Overrides::default() };
        let folder = common::Folder(path.parent().expect("a folder").to_owned());
        match compile(&mut source(&text), &folder, &overrides) {
            Ok((_, warnings)) => {
                let about_units = warnings.iter().any(|warning| warning.code[1..].starts_with("07"));
                assert!(!about_units, "{}: {warnings:?}", path.display());
            }
            Err(errors) => panic!("{}: {errors:?}", path.display()),
        }
    }
}

#[test]
fn functions_are_put_in_with_their_arguments() {
    let model = model(&format!(
        "{HEAD}function cube(x) = x*square_(x)\nfunction square_(y) = y^2\nparam k = 3\nfunction scaled(x) = k*x\n\
         function pick(i) = sum(j in 1..i: j*V[j])\nindex b in 1..2\nstate V[b] = scaled(b)\n\
         V[b]' = cube(V[b] - 1) + scaled(cube(2)) + pick(b) + scaled(scaled(V[1]))\noutput V"
    ));
    assert_eq!(model.states.iter().map(|state| state.initial).collect::<Vec<_>>(), [3.0, 6.0]);
    let (a, b) = (2.0, 5.0);
    let wanted = [1.0 + 24.0 + a + 9.0 * a, 64.0 + 24.0 + a + 2.0 * b + 9.0 * a];
    assert_eq!(derivatives(&model, &[a, b], &[]), wanted);
}

#[test]
fn units_flow_through_functions() {
    let text = "function drop(p, q) = p - q\nstate a [V] = 0\nstate b [A] = 0\na' = drop(a, 2*a)/t\nb' = drop(a, b)/t\n\
                param t [s] = 1\noutput a, b";
    let found = findings(text, None);
    let messages: Vec<&str> = found.iter().map(|finding| finding.message.as_str()).collect();
    // Once inside of the call, once because its value is taken for volts.
    assert_eq!(messages, ["units do not agree: [V] and [A]", "units do not agree: [A/s] and [V/s]"]);
    assert!(found[0].labels.iter().any(|(_, text)| text == "called from here"), "{found:?}");
}

#[test]
fn functions_that_grow_without_end_are_refused() {
    let double = |count: usize, body: &str| {
        let next = |n: usize| format!("function f{}(x) = {}\n", n + 1, body.replace('f', &format!("f{n}")));
        let functions: String = (0..count).map(next).collect();
        format!("function f0(x) = x*x + x\n{functions}state x = 1\nx' = f{count}(x)\noutput x")
    };
    let codes = |text: &str| findings(text, None).iter().map(|finding| finding.code).collect::<Vec<_>>();
    assert_eq!(codes(&double(5, "f(x) + f(x)")), Vec::<&str>::new());
    assert_eq!(codes(&double(16, "f(x)"))[0], "E0104");
    // Deep, but each function is small.
    assert_eq!(codes(&double(12, "(f(f(f(x))) - 1)^2").replace("f0(x) = x*x + x", "f0(x) = x"))[0], "E0104");
    let many = (0..2000).map(|n| format!("function g{n}(x) = g{}(x) + 1\n", n + 1)).collect::<String>();
    assert!(codes(&format!("{many}function g2000(x) = x\nstate x = 1\nx' = g0(x)\noutput x")).contains(&"E0104"));
}

#[test]
fn headers_of_data_files_have_units_too() {
    let text = format!("{HEAD}input u [V] = samples(\"t.csv\", \"u\", hold)\nstate x [V*s] = 0\nx' = u\noutput x");
    let found = |header: &str| {
        let files = std::collections::BTreeMap::from([("t.csv".to_owned(), format!("t,{header}\n0,1").into_bytes())]);
        let (_, warnings) = compile(&mut source(&text), &files, &Overrides::default()).expect("only warnings");
        warnings.into_iter().map(|warning| warning.message).collect::<Vec<_>>()
    };
    assert_eq!(found("u [V]"), Vec::<String>::new());
    assert_eq!(found("u"), Vec::<String>::new());
    assert_eq!(found("u [mV]"), ["[V] and [mV] differ by a factor: 1 mV is 0.001 V"]);
    assert_eq!(found("u [furlong]"), ["unknown unit `furlong`"]);
}
