//! The quick part of the validation set: verdicts and errors against references from another library.
//!
//! `xtask validation` runs all of it.

use crate::validation_set::{Outcome, Reference, Whole, cases, words};
use pe_sim::error::Trajectory;

#[test]
fn quick_cases_have_the_verdict_and_the_errors_that_they_must_have() {
    let quick: Vec<_> = cases().into_iter().filter(|case| case.quick).collect();
    assert!(quick.len() >= 20, "only {} cases", quick.len());
    let complaints: Vec<String> = quick.iter().flat_map(|case| case.complaints(&case.run(false))).collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn options_are_parted_at_blanks_outside_of_quotes() {
    assert_eq!(words("  --step 1ms\t--span  2 "), ["--step", "1ms", "--span", "2"]);
    assert_eq!(words("--set 'a = 1' --step='5 ms'x ''"), ["--set", "a = 1", "--step=5 msx", ""]);
    assert!(words("").is_empty());
}

#[test]
fn every_case_and_every_reference_is_used() {
    let cases = cases();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/validation");
    let stems = |folder: &std::path::Path, ending: &str| -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        entries.filter_map(|name| Some(name.strip_suffix(ending)?.to_owned())).collect()
    };
    for name in stems(&folder, ".spec") {
        assert!(cases.iter().any(|case| case.spec == format!("validation/{name}.spec")), "no case runs {name}.spec");
    }
    for name in stems(&folder.join("reference"), ".csv") {
        assert!(cases.iter().any(|case| case.reference == name), "no case is compared with {name}.csv");
    }
    for case in &cases {
        // Figures that must hold need something to hold them against.
        assert!(case.total.is_none() || !case.reference.is_empty(), "{} has no reference", case.name);
        assert!(case.verdict != "fine" || case.word_length.is_some(), "{} asks for nothing", case.name);
    }
}

#[test]
fn a_wrong_state_a_wrong_verdict_and_a_missing_figure_are_noticed() {
    let reference = Reference::parse("# remark\nt,x,y\nlargest,2,4\n1,1,4\n2,2,1\n");
    let run = Trajectory { states: 2, samples: vec![4.0, 1.0, 0.0, 0.0, 1.0, 2.0], ..Trajectory::default() };
    // The states in another order than in the reference, and a sample that it does not have.
    assert_eq!(reference.error(&[("y", 0), ("x", 1)], &[1.0, 1.5, 2.0], &run), 0.0);
    let off = Trajectory { samples: vec![4.0, 1.0, 0.0, 0.0, 1.0, 2.5], ..run.clone() };
    assert_eq!(reference.error(&[("y", 0), ("x", 1)], &[1.0, 1.5, 2.0], &off), 0.25);
    let lost = Trajectory { samples: vec![4.0, 1.0, 0.0, 0.0, f64::NAN, 2.0], ..run };
    assert_eq!(reference.error(&[("y", 0), ("x", 1)], &[1.0, 1.5, 2.0], &lost), f64::INFINITY);

    let case = cases().into_iter().find(|case| case.name == "lorenz").expect("lorenz is a case");
    let good = case.run(true);
    assert!(case.complaints(&good).is_empty(), "{:?}", case.complaints(&good));
    let refused = Outcome { verdict: "E0901".into(), figures: None, ..good.clone() };
    assert_eq!(case.complaints(&refused).len(), 3, "verdict and both errors");
    let mut bad = good.clone();
    bad.figures.as_mut().expect("it compiles").word_length = f64::NAN;
    assert_eq!(case.complaints(&bad).len(), 1);
    let mut bad = good.clone();
    bad.figures.as_mut().expect("it compiles").total = Some(1.0);
    assert_eq!(case.complaints(&bad).len(), 3, "the error, and both statements, which are far below it");
    let whole = good.figures.as_ref().and_then(|figures| figures.whole).expect("all steps were looked at");
    for (whole, parts) in [
        (Whole { truth: 1e-5, stated: 1e-5, ..whole }, 1e-5),
        (Whole { stated: 0.3 * whole.truth, ..whole }, 1.0),
        (Whole { stated: f64::NAN, ..whole }, 1.0),
        (Whole { doubt: 1e-6, ..whole }, 1.0),
        (whole, 0.3 * whole.truth),
    ] {
        let mut bad = good.clone();
        let figures = bad.figures.as_mut().expect("it compiles");
        (figures.whole, figures.parts) = (Some(whole), parts);
        assert_eq!(case.complaints(&bad).len(), 1, "{whole:?}");
    }
    for method in [None, Some(f64::INFINITY)] {
        assert_eq!(case.complaints(&Outcome { method, ..good.clone() }).len(), 1);
    }
}

#[test]
#[should_panic(expected = "no sample at t = 2")]
fn a_time_that_the_run_lacks_is_no_agreement() {
    let reference = Reference::parse("t,x\nlargest,2\n1,1\n2,2\n");
    reference.error(&[("x", 0)], &[1.0], &Trajectory { states: 1, samples: vec![1.0], ..Trajectory::default() });
}

#[test]
#[should_panic(expected = "lacks `y`")]
fn a_state_that_the_reference_lacks_is_no_agreement() {
    let reference = Reference::parse("t,x\nlargest,2\n1,1\n");
    reference.error(&[("y", 0)], &[1.0], &Trajectory { states: 1, samples: vec![1.0], ..Trajectory::default() });
}
