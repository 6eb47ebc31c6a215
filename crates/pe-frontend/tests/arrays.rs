//! Algebra of whole arrays: the same model as written out by hand, and what is said where shapes do not fit.

mod common;

use common::{derivatives, model, source};
use pe_frontend::{NoFiles, Overrides, Units, compile};
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Span};

const HEAD: &str = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\n";

/// Three states, two inputs, two outputs.
const SYSTEM: &str = "index i in 1..3, j in 1..3, k in 1..2, l in 1..2
param A[i, j] [1/s] = [-1, 2, 0; -2, -1, 0.5; 0, 0.25, -3]
param B[i, k] [m/(V*s)] = [1, 0; 0, 2; 0.5, 0.5]
param C[k, j] [V/m] = [1, 0, 0; 0, 1, 1]
param D[k, l] = [0.5, 0; 0, 0.25]
param w[j] [V] = [1, 2, 3]
param K[i, j] [1/s] = [1, 2, 3; 4, 5, 6; 7, 8, 9]
input u[k] [V] = sine(k, 1 Hz)
state x[i] [m] = i
";

fn findings(statements: &str) -> Vec<Diagnostic> {
    compile(&mut source(&format!("{HEAD}{statements}")), &NoFiles, &Overrides::default()).err().unwrap_or_default()
}

/// A model without the places in its text.
fn placeless(mut model: Model) -> Model {
    model.outputs.iter_mut().for_each(|output| output.span = Span::default());
    model.states.iter_mut().for_each(|state| state.span = Span::default());
    model.algebraics.iter_mut().for_each(|algebraic| algebraic.span = Span::default());
    model.inputs.iter_mut().for_each(|input| input.span = Span::default());
    model
}

fn same(whole: &str, written_out: &str) {
    let both = [whole, written_out].map(|text| {
        let text = format!("{HEAD}units strict\n{text}");
        let (model, warnings) = compile(&mut source(&text), &NoFiles, &Overrides::default())
            .unwrap_or_else(|errors| panic!("{errors:#?}\n{text}"));
        let unused = |warning: &&Diagnostic| !["W0001", "W0002"].contains(&warning.code);
        assert_eq!(warnings.iter().find(unused), None, "{text}");
        format!("{:#?}", placeless(model))
    });
    assert_eq!(both[0], both[1], "{whole}\n{written_out}");
}

#[test]
fn a_state_space_model_is_that_written_out() {
    same(
        &format!("{SYSTEM}x' = A*x + B*u\ny = C*x + D*u\noutput y, x"),
        &format!(
            "{SYSTEM}x[i]' = sum(j: A[i, j]*x[j]) + sum(k: B[i, k]*u[k])
            y[k] = sum(j: C[k, j]*x[j]) + sum(l: D[k, l]*u[l])\noutput y, x"
        ),
    );
}

#[test]
fn every_operation_is_that_of_its_elements() {
    for (whole, written_out) in [
        ("x' = (transpose(A)*x - 2*x/tau)", "x[i]' = sum(j: A[j, i]*x[j]) - 2*x[i]/tau"),
        ("x' = -x/tau + (if n > 2 then x/tau else 3*x/tau)", "x[i]' = -x[i]/tau + x[i]/tau"),
        ("x' = A*K*x*tau", "x[i]' = sum(j: sum(m in 1..3: A[i, m]*K[m, j])*x[j])*tau"),
        ("x' = A*(K*x)*tau", "x[i]' = sum(j: A[i, j]*sum(m in 1..3: K[j, m]*x[m]))*tau"),
        ("x' = (A + K)*x", "x[i]' = sum(j: (A[i, j] + K[i, j])*x[j])"),
        ("x' = sum(m in 1..2: m*x)/tau", "x[i]' = (x[i] + 2*x[i])/tau"),
        ("x' = z\nz = v/2\nv = half(4)*x/tau", "x[i]' = z[i]\nz[i] = v[i]/2\nv[i] = half(4)*x[i]/tau"),
        (
            "x' = z - x/tau\nz[i] = x[i]/tau where i <= 2\nz[3] = 0*x[1]/tau",
            "x[i]' = z[i] - x[i]/tau\nz[i] = x[i]/tau where i <= 2\nz[3] = 0*x[1]/tau",
        ),
        ("x[i]' = dot(x, x)/s*x[i]", "x[i]' = sum(m in 1..3: x[m]*x[m])/s*x[i]"),
        ("x' = e*x\ne = dot(x, x)/s in -1 .. 1", "x[i]' = e*x[i]\ne = sum(m in 1..3: x[m]*x[m])/s in -1 .. 1"),
        (
            "param M[i, j] [1/s] = A + K*transpose(K)*tau\nx' = M*x",
            "param M[i, j] [1/s] = A[i, j] + sum(m in 1..3: K[i, m]*K[j, m])*tau\nx[i]' = sum(j: M[i, j]*x[j])",
        ),
        (
            "x' = x/tau + q\nstate q[i] [m/s] = c\nq' = 0*q/tau\nparam c[j] [m/s] = [1, 2, 3] + 0*K*b\nparam b[j] [m] = i2[j]\nparam i2[j] [m] = j",
            "x[i]' = x[i]/tau + q[i]\nstate q[i] [m/s] = i\nq[i]' = 0*q[i]/tau\nparam c[j] [m/s] = j\nparam b[j] [m] = i2[j]\nparam i2[j] [m] = j",
        ),
        (
            "input f[k] [V] = sine(2*amp, 1 Hz)\nparam amp[k] [V] = 3\nx' = B*f",
            "input f[k] [V] = sine(6, 1 Hz)\nparam amp[k] [V] = 3\nx[i]' = sum(k: B[i, k]*f[k])",
        ),
    ] {
        let more = "const n = 3\nparam tau [s] = 0.5\nparam s [m^2*s] = 2\nfunction half(a) = a/2*dot(w, w)/ww\nparam ww [V^2] = 7\noutput x";
        same(&format!("{SYSTEM}{whole}\n{more}"), &format!("{SYSTEM}{written_out}\n{more}"));
    }
}

#[test]
fn sizes_follow_constants_of_the_command_line() {
    let text = format!("{HEAD}const n = 2\nindex i in 0..n\nstate x[i] = 1\nx' = -dot(x, x)*x\noutput x");
    let overrides = Overrides { set: vec![("n".to_owned(), 4.0)], ..Overrides::default() };
    let model = common::model_with(&text, overrides);
    assert_eq!(derivatives(&model, &[1.0, 2.0, 0.0, 0.0, 3.0], &[]), [-14.0, -28.0, 0.0, 0.0, -42.0]);
}

#[test]
fn units_are_checked_in_whole_arrays() {
    let text = format!("{HEAD}{SYSTEM}x' = A*x + D*u\noutput x")
        .replace("D[k, l]", "D[i, l]")
        .replace("[0.5, 0; 0, 0.25]", "1");
    let overrides = Overrides { units: Some(Units::Strict), ..Overrides::default() };
    let found = compile(&mut source(&text), &NoFiles, &overrides).expect_err("units do not agree");
    assert_eq!(found[0].code, "E0701", "{found:?}");
}

#[test]
fn both_shapes_are_shown_at_their_places() {
    let found = findings(&format!("{SYSTEM}x' = A*x + B*w\noutput x"));
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(
        (found[0].code, found[0].message.as_str()),
        ("E0511", "shapes do not fit: a matrix over 1..3, 1..2 and a vector over 1..3, multiplied")
    );
    let labels: Vec<&str> = found[0].labels.iter().map(|(_, text)| text.as_str()).collect();
    assert_eq!(labels, ["a matrix over 1..3, 1..2", "a vector over 1..3"]);
}

#[test]
fn deep_and_long_expressions_do_no_harm() {
    for (open, close) in [("A*(-(", "))"), ("A*", "")] {
        let product = format!("x' = {}x{}", open.repeat(60), close.repeat(60));
        let found = findings(&format!("{SYSTEM}{product}\noutput x"));
        assert_eq!(found[0].message, "more than 8 products of arrays are nested", "{found:?}");
    }
    let nested = format!("x' = {}x{}", "-(1*(".repeat(61), "))".repeat(61));
    assert_eq!(derivatives(&model(&format!("{HEAD}{SYSTEM}{nested}\noutput x")), &[1.0; 3], &[0.0; 2]), [-1.0; 3]);
    let sum = format!("x' = {}x", "2*x + ".repeat(5000));
    assert_eq!(derivatives(&model(&format!("{HEAD}{SYSTEM}{sum}\noutput x")), &[1.0; 3], &[0.0; 2]), [10001.0; 3]);
    let chain: String = (1..2000).map(|n| format!("a{n} = 2*a{}\n", n + 1)).collect();
    assert_eq!(findings(&format!("{SYSTEM}{chain}a2000 = x\nx' = 0*a1\noutput x")), []);
}
