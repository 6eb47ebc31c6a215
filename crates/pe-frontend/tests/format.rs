//! Laying out a spec changes nothing but blanks: the model stays, and what is laid out stays as it is.

mod common;

use pe_frontend::{Overrides, compile, format, main_file};
use pe_ir::source::{Severity, Sources};
use std::collections::BTreeMap;
use std::path::Path;

/// Files of a folder, in the places of those that a spec names.
fn files(spec: &Path) -> BTreeMap<String, Vec<u8>> {
    fn add(root: &Path, folder: &Path, files: &mut BTreeMap<String, Vec<u8>>) {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                add(root, &path, files);
            } else if path.extension().is_some_and(|end| end == "spec" || end == "csv") {
                let name = path.strip_prefix(root).expect("below the folder").to_string_lossy().into_owned();
                files.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    let folder = spec.parent().expect("a folder");
    let mut files = BTreeMap::new();
    add(folder, folder, &mut files);
    files
}

/// The model as text, or the codes of the findings.
fn meaning(text: &str, files: &BTreeMap<String, Vec<u8>>) -> String {
    let (mut sources, problem) = main_file("m.spec", text.as_bytes());
    assert_eq!(problem, None);
    match compile(&mut sources, files, &Overrides::default()) {
        Ok((model, warnings)) => {
            let codes: Vec<&str> = warnings.iter().map(|warning| warning.code).collect();
            format!("{model}\n{codes:?}")
        }
        Err(findings) => {
            let mut codes: Vec<&str> = findings.iter().map(|finding| finding.code).collect();
            codes.sort_unstable();
            format!("{codes:?}")
        }
    }
}

/// Everything but blanks.
fn words(text: &str) -> String {
    text.split_whitespace().collect()
}

#[test]
fn all_models_and_specs_keep_their_meaning_and_words() {
    let mut formatted = 0;
    for folder in [common::root().join("models"), common::root().join("crates/pe-frontend/tests/specs")] {
        for path in common::specs(&folder) {
            let bytes = std::fs::read(&path).expect("a spec");
            let (sources, problem) = main_file("m.spec", &bytes);
            let (None, Ok(laid_out)) = (problem, format(&sources)) else { continue };
            let shown = path.display();
            assert_eq!(words(sources.text()), words(&laid_out), "{shown}");
            let again = format(&Sources::new("m.spec", &laid_out)).unwrap_or_else(|_| panic!("{shown} is broken"));
            assert_eq!(laid_out, again, "{shown} changes again");
            let files = files(&path);
            assert_eq!(meaning(sources.text(), &files), meaning(&laid_out, &files), "{shown}");
            formatted += 1;
        }
    }
    assert!(formatted > 40, "{formatted} specs");
}

fn laid_out(text: &str) -> String {
    match format(&Sources::new("m.spec", text)) {
        Ok(text) => text,
        Err(findings) => panic!("{findings:?}"),
    }
}

#[test]
fn words_of_a_line_are_parted_as_in_the_reference() {
    for (written, wanted) in [
        ("x'=-omega ^ 2*x-2 * d*v+u", "x' = -omega^2*x - 2*d*v + u"),
        (
            "T[i]'=k[ i ]*( ( if i>1 then T[i-1] else 0 )-2*T[i] )",
            "T[i]' = k[i]*((if i > 1 then T[i - 1] else 0) - 2*T[i])",
        ),
        ("index  b in 1 .. n,j in 2..n-1", "index b in 1..n, j in 2..n - 1"),
        ("state V[ b ] [ L ]=0 in 0..2*( 1+x )", "state V[b] [ L ] = 0 in 0 .. 2*(1 + x)"),
        ("z=sum( i,k in 1 ..i where k>1:y[ k ])", "z = sum(i, k in 1..i where k > 1: y[k])"),
        ("z=-( -x )^-2", "z = -(-x)^-2"),
        ("z = a mod ( b+1 )+mod( a,2 )", "z = a mod (b + 1) + mod(a, 2)"),
        ("input u[k]=sine( 1/k,k Hz )in -1 ..1,linear", "input u[k] = sine(1/k, k Hz) in -1 .. 1, linear"),
        ("param A[i,j]=[ 1,2;3,-4 ]", "param A[i, j] = [1, 2; 3, -4]"),
        (
            "flow[b]=V[b]/0.5 [ L/s ]where 2*b<=n and not(b==1)",
            "flow[b] = V[b]/0.5 [ L/s ] where 2*b <= n and not (b == 1)",
        ),
        ("y[1]=x for i in 2 .. 3", "y[1] = x for i in 2..3"),
        ("every 1 ms{", "every 1 ms {"),
        ("\u{feff}model m   \"a  b\"   ", "model m \"a  b\""),
        ("step 0.5ms until 0.4s,then 0.1 s", "step 0.5 ms until 0.4 s, then 0.1 s"),
    ] {
        assert_eq!(laid_out(written), format!("{wanted}\n"), "{written}");
    }
}

#[test]
fn columns_of_neighbouring_lines_are_equal_and_empty_lines_single() {
    let written = "\n\nsolver rk4\nstep 1 ms\n\n\n\nparam omega [1/s]=2 // rate\nparam d=0.1// of the\n              // damper\nx'=v\nenergy=x^2\n\n";
    let wanted = "solver rk4\nstep   1 ms\n\nparam omega [1/s] = 2    // rate\nparam d           = 0.1  // of the\n                         // damper\n";
    let laid = laid_out(written);
    assert_eq!(laid, format!("{wanted}x'     = v\nenergy = x^2\n"));
    assert_eq!(laid_out(&laid), laid);
    let units = laid_out(
        "param a [m]=1\nparam long_one [kg/s] = 2\nstate x=3\n\nindex i in 1..3 // three\noutput a\nw = 1 // last",
    );
    let declared = "param a        [m]    = 1\nparam long_one [kg/s] = 2\nstate x               = 3\n";
    assert_eq!(units, format!("{declared}\nindex i in 1..3  // three\noutput a\nw = 1            // last\n"));
    assert_eq!(laid_out("solver rk4\ntime [ms]\nunits strict\n"), "solver rk4\ntime   [ms]\nunits  strict\n");
    // What lies too far apart has no column.
    let far = "a = 1\nthis_is_a_very_long_name_for_a_quantity_of_it = 2\n";
    assert_eq!(laid_out(far), far);
}

#[test]
fn blocks_are_indented_and_statements_over_several_lines_stay() {
    let written = "every 1 ms {\nstate m=0\n// remark\n  next m = m+1\n}\nparam A[i, j] = [1,   2;\n                 -3, 40]\nz = x\n  + y // both\n";
    let wanted = "every 1 ms {\n    state m = 0\n    // remark\n    next m = m + 1\n}\nparam A[i, j] = [1,   2;\n                 -3, 40]\nz = x\n  + y // both\n";
    assert_eq!(laid_out(written), wanted);
    assert_eq!(laid_out(wanted), wanted);
}

#[test]
fn texts_of_any_kind_are_laid_out_once_for_all() {
    // Endings of lines, remarks without statements, statements on one line, blanks of all kinds.
    for text in [
        "",
        "\n\n",
        "// only",
        "a = 1\r\nb = 2\r\n",
        "\tx = 1 // \u{e4}\u{1F600}\t\n",
        "every 1 s { x = 1 }",
        "x = 1 //",
        "    // deep\nx = 1",
    ] {
        let once = laid_out(text);
        assert_eq!(once, laid_out(&once), "{text:?}");
        assert_eq!(words(text), words(&once), "{text:?}");
    }
}

#[test]
fn a_spec_with_syntax_errors_is_refused() {
    for text in ["x = (1", "x = 1 +", "x ? 1", "state = 0"] {
        let findings = format(&Sources::new("m.spec", text)).expect_err(text);
        assert!(findings.iter().any(|finding| finding.severity == Severity::Error), "{text}");
    }
}
