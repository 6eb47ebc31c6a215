//! Leaving out what the scene does not need: dropping an output makes every shipped model smaller, and asking for it
//! again gives the original.

use crate::support::models::{Compiled, compile};
use pe_flow::features;
use pe_flow::pipeline::Design;
use pe_flow::report::types::Features;
use pe_flow::scene;
use pe_target::area;

/// Models that compile in a moment, and spans in which nothing diverges. Their outputs are coupled but for those of
/// lutchen_breathing: leaving one out saves its port and registers, not an equation.
const SMALL: [(&str, &str); 11] = [
    ("atrial3", "5ms"),
    ("harmonic_oscillator", "100ms"),
    ("lorenz", "100ms"),
    ("lotka_volterra", "500ms"),
    ("lutchen20", "5ms"),
    ("lutchen_breathing", "50ms"),
    ("rc_ladder", "5ms"),
    ("van_der_pol", "500ms"),
    ("wave6", "1ms"),
    ("wave_fdtd", "1ms"),
    ("weibel5", "5ms"),
];

/// What a design takes.
#[derive(Debug)]
struct Size {
    products: u64,
    writes: u64,
    cycles: u32,
    lut: f64,
    flip_flops: f64,
}

fn size(design: &Design) -> Size {
    let area = area::estimate(&design.program, area::Family::default());
    Size {
        products: design.graph.macs(),
        writes: design.program.writes_per_step(),
        cycles: design.program.period,
        lut: area.lut,
        flip_flops: area.ff,
    }
}

fn observing(model: &str, span: &str, outputs: &[&str]) -> Compiled {
    let mut options = vec!["--pes", "2", "--span", span, "--tries", "2000"];
    for output in outputs {
        options.extend(["--observe", output]);
    }
    compile(model, &options)
}

#[test]
fn dropping_an_output_makes_every_model_smaller_and_adding_it_gives_the_original() {
    for (model, span) in SMALL {
        let whole = observing(model, span, &[]);
        let names: Vec<&str> = whole.loaded.model.outputs.iter().map(|output| output.name.as_str()).collect();
        assert!(names.len() > 1, "{model} has one output only");
        assert_eq!(observing(model, span, &names).design.program, whole.design.program, "{model}");
        let whole_size = size(&whole.design);
        for dropped in &names {
            let rest: Vec<&str> = names.iter().copied().filter(|name| name != dropped).collect();
            let smaller = size(&observing(model, span, &rest).design);
            let shown = format!("{model} without {dropped}: {smaller:?} instead of {whole_size:?}");
            assert!(smaller.lut < whole_size.lut && smaller.flip_flops < whole_size.flip_flops, "{shown}");
            assert!(smaller.products <= whole_size.products && smaller.writes <= whole_size.writes, "{shown}");
            assert!(smaller.cycles <= whole_size.cycles, "{shown}");
        }
    }
}

#[test]
fn equations_that_only_a_dropped_output_needs_take_their_words_and_cycles_along() {
    let whole = size(&observing("lutchen_breathing", "50ms", &[]).design);
    let mechanics = observing("lutchen_breathing", "50ms", &["w"]);
    let small = size(&mechanics.design);
    assert!(small.products * 10 < whole.products && small.writes * 10 < whole.writes, "{small:?}");
    assert!(small.cycles * 5 < whole.cycles && small.lut < 0.7 * whole.lut, "{small:?}");
    assert_eq!(mechanics.loaded.model.left_out.len(), 85);
}

#[test]
fn an_algebraic_output_costs_its_own_products() {
    let flow = ["V[1]", "Pout[1]"];
    let [without, with] = [1, 2].map(|count| size(&observing("weibel5", "5ms", &flow[..count]).design));
    assert!(without.products < with.products && without.writes < with.writes, "{without:?}, {with:?}");
}

#[test]
fn the_report_tells_why_each_quantity_is_there() {
    let Compiled { loaded, design } = observing("lutchen_breathing", "50ms", &["c[1]"]);
    let kept = scene::kept(&loaded.model, &design.graph);
    let of = |name: &str| kept.iter().find(|entry| entry.name == name).unwrap();
    assert_eq!((of("c").kept, of("c").left_out), (40, 0));
    assert_eq!(of("c").because, "`c[1]` is an output");
    assert_eq!(of("J").because, "`J[1]` is read by `c[1]`");
    assert_eq!(of("J").put_in_place, of("J").kept);
    let chain = &of("c").chain;
    assert_eq!((chain[0].as_str(), chain[7].as_str(), chain.len()), ("c[40]", "c[1]", 8), "{chain:?}");
    assert!(kept.len() < 12, "one entry per quantity");

    let mechanics = observing("lutchen_breathing", "50ms", &["w"]);
    let kept = scene::kept(&mechanics.loaded.model, &mechanics.design.graph);
    let gone = kept.iter().find(|entry| entry.name == "c").unwrap();
    assert_eq!((gone.kept, gone.left_out), (0, 40));
    assert_eq!(gone.because, "no output depends on it");
}

#[test]
fn the_report_counts_the_hardware_features_and_says_what_needs_them() {
    let rows = |model: &str, span: &str| {
        let Compiled { design, .. } = observing(model, span, &[]);
        let features = features::features(&design.program, &design.graph, &design.judged, &design.mapping);
        let pes = design.program.pes.len();
        let counts = features.pe.iter().map(|row| (row.with, row.without));
        for (with, without) in counts.chain(features.control_word.iter().map(|row| (row.with, row.without))) {
            assert_eq!(with + without, pes, "{features:?}");
        }
        features
    };
    let row = |features: &Features, name: &str| features.pe.iter().find(|row| row.feature == name).unwrap().clone();
    let cubic = rows("atrial3", "5ms");
    assert_eq!(row(&cubic, "factor").with, 2);
    assert!(row(&cubic, "factor").because.contains("multiplies by `V["), "{cubic:?}");
    assert_eq!(row(&cubic, "swap").with, 0);
    let euler = rows("wave6", "1ms");
    assert_eq!(row(&euler, "swap").with, 2);
    assert_eq!(row(&euler, "factor").because, "no PE needs it");
    assert_eq!(row(&euler, "operand_addition").with, 2);
    assert_eq!(row(&euler, "saturation").because, "every word is proven to be in range");
    assert_eq!(row(&cubic, "saturation").because, "PE 0: no bound of its values was found");
    let single = rows("harmonic_oscillator", "100ms");
    let fields = &single.control_word;
    assert!(fields.iter().any(|field| field.field == "coefficient" && field.bits[&32] == 2));
    assert!(!fields.iter().any(|field| field.field == "factor_address"));
}

#[test]
fn pes_whose_words_are_proven_are_counted() {
    let home = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("scene");
    std::fs::create_dir_all(&home).unwrap();
    let saturation = |rate: &str| {
        let text = format!(
            "model m \"one state, one copy\"\nsolver rk4\nstep 1 ms\nspan 10 ms\n\
             state x = 0.8\nx' = {rate}\ny = 0.9*x\noutput x, y\n"
        );
        std::fs::write(home.join("m.spec"), text).unwrap();
        let command = std::process::Command::new(env!("CARGO_BIN_EXE_pe-synth"))
            .current_dir(&home)
            .args(["compile", "m.spec", "--pes", "2", "--quiet", "-o", "out"])
            .output()
            .unwrap();
        assert!(command.status.success(), "{}", String::from_utf8_lossy(&command.stderr));
        let report = std::fs::read_to_string(home.join("out/report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        let states = report["ranges"]["states"].clone();
        let rows = report["features"]["pe"].as_array().unwrap();
        (rows.iter().find(|row| row["feature"] == "saturation").unwrap().clone(), states)
    };
    let (row, states) = saturation("-x");
    assert_eq!(
        (&row["with"], &row["provable"], &row["because"]),
        (&0.into(), &2.into(), &"every word is proven to be in range".into())
    );
    assert_eq!(states, serde_json::json!({"proven": 1, "probable": 0, "unknown": 0}));
    let (row, states) = saturation("-x^2");
    assert_eq!((&row["with"], &row["provable"]), (&2.into(), &0.into()));
    assert_eq!(states, serde_json::json!({"proven": 0, "probable": 1, "unknown": 0}));
}
